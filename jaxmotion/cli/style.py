"""``jaxmotion style``: exaggerate or calm a motion."""

from functools import partial
from typing import TYPE_CHECKING

import click

from jaxmotion.cli._options import (
    Batch,
    Gain,
    Running,
    Selection,
    batch_options,
    keep_contacts_option,
    running_options,
    selection_options,
)
from jaxmotion.cli._work import Edited

if TYPE_CHECKING:
    from jaxmotion import Motion


@click.command(short_help="Exaggerate or calm a motion.")
@batch_options
@click.option(
    "--alpha",
    type=float,
    help="Gain of the style: above 1 exaggerates, below 1 calms, 0 leaves the smooth base.",
)
@click.option(
    "--gain",
    "gains",
    type=Gain(),
    multiple=True,
    help="Gain of the joints whose names match, such as '*Arm*=2.0'; may be repeated, later ones "
    "win. Other joints get --alpha, or 1 without it.",
)
@click.option(
    "--residual",
    type=click.FloatRange(min=0),
    default=0.0,
    show_default=True,
    help="Share of the capture's noise that is kept.",
)
@keep_contacts_option
@selection_options
@running_options
def command(
    batch: Batch,
    running: Running,
    selection: Selection,
    alpha: float | None,
    gains: tuple[tuple[str, float], ...],
    residual: float,
    keep_contacts: bool | None,
) -> None:
    """Exaggerate or calm the style of a motion; its noise is removed on the way.

    \b
    jaxmotion style walk.bvh -o lively.bvh --alpha 2.0
    jaxmotion style walk.bvh -o arms.bvh --gain '*Arm*=2.0' --gain 'Head=0.5'
    """
    from jaxmotion.cli._batch import edit_files

    if alpha is None and not gains:
        raise click.UsageError("say how much: --alpha 2.0, or --gain '*Arm*=2.0'")
    changes = partial(
        edit,
        alpha=1.0 if alpha is None else alpha,
        gains=gains,
        residual=residual,
    )
    edit_files(changes, batch, running, selection, keep=keep_contacts)


def edit(
    motion: "Motion",
    length: int,
    *,
    alpha: float,
    gains: tuple[tuple[str, float], ...],
    residual: float,
) -> Edited:
    """The library's style gains on a padded clip."""
    import jaxmotion as jm
    from jaxmotion.cli._learned import of_base

    weights = jm.joint_weights(motion.skeleton, dict(gains), default=alpha)
    layers = jm.decompose(motion, length=length)
    return Edited(jm.synthesize(layers, weights, residual), partial(of_base, layers))

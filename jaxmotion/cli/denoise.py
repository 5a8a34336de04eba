"""``jaxmotion denoise``: remove the noise of the capture, keep the motion."""

from functools import partial
from typing import TYPE_CHECKING, Any

import click

from jaxmotion.cli._options import (
    Batch,
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

_POSITIVE = click.FloatRange(min=0, min_open=True)


@click.command(short_help="Remove the noise of the capture.")
@batch_options
@selection_options
@click.option(
    "--method",
    type=click.Choice(["chordal", "geodesic"]),
    help="How rotations are smoothed: fast, or exactly on the rotations.  [default: chordal]",
)
@click.option(
    "--tune/--no-tune",
    "--auto/--paper",
    "auto",
    default=None,
    help="Learn the smoothness of every joint from the clip, or take the paper's.  [default: auto]",
)
@click.option("--robust", is_flag=True, default=None, help="Find spikes first, and bridge them.")
@click.option("--lam", type=_POSITIVE, help="Smoothness of what is kept; for experts.")
@click.option("--sigma", type=_POSITIVE, help="Noise of the capture; for experts.")
@keep_contacts_option
@running_options
def command(
    batch: Batch,
    running: Running,
    selection: Selection,
    method: str | None,
    auto: bool | None,
    robust: bool | None,
    lam: float | None,
    sigma: float | None,
    keep_contacts: bool | None,
) -> None:
    """Remove the noise of the capture and keep the motion.

    \b
    jaxmotion denoise take.bvh -o clean.bvh
    jaxmotion denoise takes -o clean --jobs 4 --report report.html
    jaxmotion denoise take.bvh -o clean.bvh --robust
    jaxmotion denoise take.bvh -o clean.bvh --joints 'Left*' --range 120:480
    """
    from jaxmotion.cli._batch import edit_files

    if auto and (lam is not None or sigma is not None):
        raise click.UsageError("--auto learns what --lam and --sigma give; use one or the other")
    given = {"method": method, "tune": auto, "robust": robust, "lam": lam, "sigma": sigma}
    options = {name: value for name, value in given.items() if value is not None}
    edit_files(partial(edit, options=options), batch, running, selection, keep=keep_contacts)


def edit(motion: "Motion", length: int, *, options: dict[str, Any]) -> Edited:
    """The library's denoiser on a padded clip; what is not given is left to it."""
    from jaxmotion.cli._learned import of_noise
    from jaxmotion.layers.synthesize import denoised

    found = denoised(motion, length=length, **options)
    return Edited(found.motion, partial(of_noise, motion, length, found.tuning))

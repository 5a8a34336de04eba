"""``jaxmotion denoise``: remove the noise of the capture, keep the motion."""

import math
import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path
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
from jaxmotion.cli._terminal import Notice
from jaxmotion.cli._work import Edited, confined

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion._types import ArrayLike
    from jaxmotion.smoothing import Bridge

_NAMED = 5
_SEEN = 0.05  # degrees; less is outside of the selection
_POSITIVE = click.FloatRange(min=0, min_open=True)
_PRIORS = ("student", "gaussian")


class _Prior(click.ParamType):
    """A prior's name, or the file that ``jaxmotion prior`` wrote."""

    name = "prior"

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        return "[student|gaussian|FILE.npz]"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        if value not in _PRIORS and not Path(value).is_file():
            self.fail(f"{value!r} is neither {' nor '.join(_PRIORS)} nor a file", param, ctx)
        return value


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
@click.option(
    "--prior",
    type=_Prior(),
    help="Leave sudden moves as they are, or smooth them with all else, as the paper does; or "
    "smooth joints together, as the file that jaxmotion prior wrote says they turn.  "
    "[default: student]",
)
@click.option(
    "--max-change",
    type=_POSITIVE,
    metavar="DEGREES",
    help="Turn no joint by more than this, whatever is learned of the noise.",
)
@click.option(
    "--robust", is_flag=True, default=None, help="Find spikes first, and bridge and list them."
)
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
    prior: str | None,
    max_change: float | None,
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
    jaxmotion denoise takes -o clean --prior walkers.npz
    """
    from jaxmotion.cli._batch import edit_files

    if auto and (lam is not None or sigma is not None):
        raise click.UsageError("--auto learns what --lam and --sigma give; use one or the other")
    given = {"method": method, "tune": auto, "prior": prior, "robust": robust}
    given |= {"lam": lam, "sigma": sigma}
    if max_change is not None:
        given["max_change"] = math.radians(max_change)
    options = {name: value for name, value in given.items() if value is not None}
    made = partial(edit, options=options, selection=selection)
    edit_files(made, batch, running, selection, keep=keep_contacts)


def edit(motion: "Motion", length: int, *, options: dict[str, Any], selection: Selection) -> Edited:
    """The library's denoiser on a padded clip; what is not given is left to it. Tells what it
    bridged, and what it turned most."""
    from jaxmotion.cli import _changes
    from jaxmotion.layers.synthesize import denoised
    from jaxmotion.smoothing import MotionPrior

    prior = options.get("prior", "student")
    if prior not in _PRIORS:
        options = options | {"prior": MotionPrior.load(prior)}
    found = denoised(motion, length=length, **options)
    clean = confined(motion, found.motion, length, selection)
    rows = ()
    if found.weights is not None:
        rows = bridges(motion, clean, found.weights, length)
    if rows:
        warnings.warn(in_brief(rows), Notice, stacklevel=2)
    changes = _changes.of_joints(motion, clean, length, found.tuning)
    dropped = _changes.made_anew(motion, found.dropped)
    tables = {"changes": changes, "bridged": [row._asdict() for row in rows], "dropped": dropped}
    learned = partial(_learned, motion, length, found.tuning, tables)
    notes = _changes.frames_in_brief(dropped), _changes.in_brief(changes)
    return Edited(found.motion, learned, "; ".join(filter(None, notes)))


def _learned(
    motion: "Motion", length: int, tuning: Any, tables: dict[str, list[dict[str, Any]]]
) -> dict[str, Any]:
    """What goes into the report: the noise of every joint, and the tables that hold anything."""
    from jaxmotion.cli._learned import of_noise

    noise = of_noise(motion, length, tuning)
    return noise | {name: table for name, table in tables.items() if table}


def bridges(
    motion: "Motion", clean: "Motion", weights: "ArrayLike", length: int
) -> "tuple[Bridge, ...]":
    """The spikes of a padded clip, of weight 0, that differ in the ``clean`` one."""
    import numpy as np

    from jaxmotion.smoothing import bridged

    weights = np.where(np.arange(motion.num_frames)[:, None] < length, weights, 1)
    return tuple(row for row in bridged(motion, clean, weights) if row.degrees > _SEEN)


def in_brief(rows: "Sequence[Bridge]") -> str:
    """What was bridged, in a line: each of a few, of many the largest."""
    count = "1 spike" if len(rows) == 1 else f"{len(rows)} spikes"
    if len(rows) <= _NAMED:
        return f"bridged {count}: {', '.join(map(_named, rows))}"
    return f"bridged {count}, the largest {_named(max(rows, key=lambda row: row.degrees))}"


def _named(row: "Bridge") -> str:
    frames = f"{row.frame}" if row.frame == row.last_frame else f"{row.frame}-{row.last_frame}"
    return f"{row.joint} {frames} by {row.degrees:.3g}°"

"""``jaxmotion augment``: sound variations of a motion."""

import zlib
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxmotion.cli._files import Job
from jaxmotion.cli._options import Batch, Reading, Running, batch_options, running_options

if TYPE_CHECKING:
    from jaxmotion import Motion, Variations
    from jaxmotion.cli._work import Effect, Learned
    from jaxmotion.spacetime import JointLimits

_SHOWN = 5  # variations, in a player
_ROUNDS = 4  # of as many as are wanted, until there are enough


@dataclass(frozen=True)
class Wanted:
    """What was asked for: ``styles`` and ``limits`` are files, ``margin`` in degrees."""

    count: int
    seed: int
    alpha: tuple[float, float]
    time_warp: float
    styles: tuple[str, ...]
    limits: tuple[str, ...]
    margin: float
    keep_contacts: bool


@click.command(short_help="Make sound variations of a motion.")
@batch_options
@click.option(
    "--count",
    type=click.IntRange(1),
    default=8,
    show_default=True,
    help="How many of each file.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Another makes others.")
@click.option(
    "--alpha",
    type=(float, float),
    default=(0.8, 1.25),
    show_default=True,
    help="Least and greatest gain of the style: above 1 exaggerates, below 1 calms.",
)
@click.option(
    "--time-warp",
    type=click.FloatRange(0),
    default=0.15,
    show_default=True,
    help="How much faster and slower it may go here and there.",
)
@click.option(
    "--style",
    "styles",
    type=click.Path(exists=True, dir_okay=False),
    multiple=True,
    help="A clip, or an .npz file of a style, whose manner is mixed in; may be repeated.",
)
@click.option(
    "--limits",
    type=click.Path(exists=True),
    multiple=True,
    help="Clean clips, or a folder of them: how far joints turn there is as far as they may; "
    "may be repeated.",
)
@click.option(
    "--margin",
    type=click.FloatRange(0),
    default=3.0,
    show_default=True,
    help="Degrees beyond that.",
)
@click.option(
    "--keep-contacts/--no-keep-contacts",
    default=True,
    show_default=True,
    help="Let feet stand where they stand.",
)
@running_options
def command(batch: Batch, running: Running, styles: tuple[str, ...], **options: Any) -> None:
    """Make variations of a motion: more and less of its style, others mixed in, another timing.

    OUT gets 01.bvh, 02.bvh, ...; for several inputs, a folder each. What breaks joint limits,
    slides more than the motion itself or goes through the floor is left out, and others made. The
    same seed and file name make the same variations.

    \b
    jaxmotion augment walk.bvh -o walks --count 20
    jaxmotion augment takes -o more --style tired.bvh --style proud.bvh --limits takes
    """
    from jaxmotion.cli import _files
    from jaxmotion.cli._batch import run

    wanted = Wanted(styles=styles, **options)
    low, high = wanted.alpha
    if low > high:
        raise click.UsageError(f"--alpha {low:g} {high:g}: the lesser gain comes first")
    if wanted.limits:
        found = _files.expand(wanted.limits, avoid=batch.out)
        wanted = replace(wanted, limits=tuple(str(file.path) for file in found))
    jobs = _files.plan_folders(_files.expand(batch.files, avoid=batch.out), batch.out)
    names = _names(wanted.count)
    process = partial(_augment, batch, wanted)
    run(process, jobs, batch, running, writes=lambda folder: [folder / name for name in names])


def _names(count: int) -> list[str]:
    digits = max(2, len(str(count)))
    return [f"{number:0{digits}}.bvh" for number in range(1, count + 1)]


def _augment(batch: Batch, wanted: Wanted, job: Job) -> "Effect":
    from jaxmotion.cli._compared import compared
    from jaxmotion.cli._work import Clip, Effect, read, write

    motion = read(job.source, batch.reading, uses_up=True)
    found, tried = vary(motion, wanted, batch.reading, job.source.name)
    if len(found) < wanted.count:
        refused = _refusals(tried)
        raise ValueError(f"only {len(found)} of {_tried(tried)} variations are sound; {refused}")
    for name, made in zip(_names(wanted.count), found, strict=False):
        write(made, job.target / name, overwrite=batch.overwrite, up=batch.out_up)
    learned = _rows(tried, _names(wanted.count)) if batch.report is not None else {}
    refused = _refusals(tried)
    message = f"{wanted.count} variations{f'; {refused}' if refused else ''}"
    names = [Path(name).stem for name in _names(wanted.count)]
    clips = dict(zip(["before", *names[:_SHOWN]], [motion, *found], strict=False))
    beside = compared(clips, batch.report, job.source.name)
    made = Clip.of(found[0])
    return Effect((Clip.of(motion),), made, message, learned=learned, compared=beside)


def vary(
    motion: "Motion", wanted: Wanted, reading: Reading, name: str
) -> "tuple[list[Motion], list[Variations]]":
    """Sound variations, as many as are wanted if there are, and all that were made on the way."""
    import jax

    import jaxmotion as jm
    from jaxmotion.cli.transfer import reference_of

    key = jax.random.fold_in(jax.random.key(wanted.seed), zlib.crc32(name.encode()))
    styles = [reference_of(Path(path), reading) for path in wanted.styles]
    limits = _limits_of(wanted.limits, wanted.margin, reading) if wanted.limits else None
    found, tried = [], []
    for number in range(_ROUNDS):
        made = jm.augment(
            motion,
            jax.random.fold_in(key, number),
            n=wanted.count,
            styles=styles,
            alpha=wanted.alpha,
            time_warp=wanted.time_warp,
            limits=limits,
            keep_contacts=wanted.keep_contacts,
        )
        tried.append(made)
        found += made.sound()
        if len(found) >= wanted.count:
            break
    return found, tried


@lru_cache(1)
def _limits_of(paths: tuple[str, ...], margin: float, reading: Reading) -> "JointLimits":
    import math

    from jaxmotion.cli._work import read
    from jaxmotion.spacetime import learn_limits

    clips = [read(Path(path), reading) for path in paths]
    return learn_limits(clips, margin=math.radians(margin))


def _tried(tried: "list[Variations]") -> int:
    return sum(map(len, tried))


def _refusals(tried: "list[Variations]") -> str:
    """How many were refused, and for what."""
    import numpy as np

    refused = sum(len(made.refused()) for made in tried)
    checks = {
        check: sum(int(np.sum(made.faults[check])) for made in tried) for check in tried[0].faults
    }
    reasons = ", ".join(f"{n} {check}" for check, n in checks.items() if n)
    return f"refused {refused} of {_tried(tried)}: {reasons}" if refused else ""


def _rows(tried: "list[Variations]", names: list[str]) -> "Learned":
    """A row a variation, with the file it went to; degrees and the file's unit."""
    import numpy as np

    rows, left = [], iter(names)
    for made in tried:
        reasons = made.refused()
        rows += [
            {
                "file": "" if i in reasons else next(left, ""),
                "gain": float(made.alpha[i]),
                "own share": float(made.shares[i, 0]),
                "beyond limits": float(np.degrees(np.asarray(made.excess[i]).max())),
                "slide": float(made.slide[i]),
                "depth": float(made.depth[i]),
                "refused": reasons.get(i, ""),
            }
            for i in range(len(made))
        ]
    return {"variations": rows}

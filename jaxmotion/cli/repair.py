"""``jaxmotion repair``: find joints that are in error, and put them where the body has them
elsewhere."""

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from jaxmotion._plain import printable
from jaxmotion.cli._files import Job
from jaxmotion.cli._options import (
    NOWHERE,
    Batch,
    Reading,
    Running,
    batch_options,
    running_options,
)

if TYPE_CHECKING:
    import numpy as np

    from jaxmotion import Motion
    from jaxmotion.cleaning import DetectedErrors, Repaired
    from jaxmotion.cli._beside import Beside
    from jaxmotion.cli._feet import Skate
    from jaxmotion.cli._work import Effect, Learned, Outcome


@dataclass(frozen=True)
class Wanted:
    """What was asked for: ``context`` are files, ``joints`` patterns."""

    context: tuple[str, ...]
    method: Any
    joints: tuple[str, ...]
    confidence: float
    keep_contacts: bool


@click.command(short_help="Find joints that are in error, and repair them.")
@batch_options(out_required=False)
@click.option(
    "--context",
    multiple=True,
    metavar="FILE|FOLDER",
    help="Look at each file beside these clips, not beside the other inputs; may be repeated.",
)
@click.option(
    "--method",
    type=click.Choice(["median", "medoid", "nearest_end"]),
    default="median",
    show_default=True,
    help="What is put in place: the median of what the body does elsewhere, the pose that is "
    "nearest to all of it, or one passage, that which fits best at its ends.",
)
@click.option(
    "--joints",
    "--joint",
    "joints",
    multiple=True,
    metavar="PATTERN",
    help="Only joints whose names match, such as 'Left*'; may be repeated.",
)
@click.option(
    "--confidence",
    type=click.FloatRange(0, 1),
    default=0.0,
    show_default=True,
    help="The least confidence of errors to repair, such as 0.8; those below it are told of, and "
    "left as they are.",
)
@click.option(
    "--keep-contacts/--no-keep-contacts",
    default=True,
    show_default=True,
    help="Bring legs that were repaired back to where their feet stand.",
)
@click.option("--detect-only", is_flag=True, help="List the errors, and write nothing to -o.")
@running_options
def command(
    batch: Batch, running: Running, context: tuple[str, ...], detect_only: bool, **options: Any
) -> None:
    """Find joints that are in error, and put them where the body has them elsewhere.

    A body does the same again and again: a joint that is not where it is at such times, that jumps
    there and back, or stands still while all else moves, is in error. Each file is looked at beside
    those eight of the other inputs (or of --context) that are most like it, of the same joints; a
    file alone, beside itself. All else stays as it is.

    \b
    jaxmotion repair takes -o clean --report report.html
    jaxmotion repair takes --detect-only
    jaxmotion repair takes -o clean --confidence 0.8
    jaxmotion repair take.bvh -o clean.bvh --context good-takes --joint '*Arm*'
    """
    from jaxmotion.cli import _batch, _files

    if batch.out == NOWHERE and not detect_only:
        raise click.UsageError("say where to write, with -o, or only --detect-only")
    avoid = None if batch.out == NOWHERE else batch.out
    inputs = _files.expand(batch.files, avoid=avoid)
    around = _files.expand(context, avoid=avoid) if context else inputs
    wanted = Wanted(context=tuple(str(item.path) for item in around), **options)
    if detect_only:
        jobs = [Job(item.path, NOWHERE) for item in inputs]
        _batch.look(partial(_look, batch, wanted), jobs, batch, running, tell=_as_text, heavy=True)
    jobs = _files.plan(inputs, batch.out)
    _batch.run(partial(_repair, batch, wanted), jobs, batch, running, heavy=True)


def _repair(batch: Batch, wanted: Wanted, job: Job) -> "Effect":
    import numpy as np

    from jaxmotion import metrics
    from jaxmotion.cleaning.repair import Repaired, repaired
    from jaxmotion.cli import _pictures, _runs
    from jaxmotion.cli._compared import compared, is_page
    from jaxmotion.cli._work import Clip, Effect, finite, write

    motion, around, free = _read(batch.reading, wanted, job)
    errors, sure, left = _errors(motion, around, free, wanted.confidence)
    least = wanted.confidence
    found = repaired(
        around.evidence, motion, errors, None, free, method=wanted.method, confidence=least
    )
    found, skate = _planted(found, free, wanted.keep_contacts)
    found = Repaired(found.motion, found.mask, found.before, sure)
    rows, result = _runs.of_repair(found), finite(found.motion)
    if rows:
        write(result, job.target, overwrite=batch.overwrite, up=batch.out_up)
    else:
        _copy(result, job, batch)
    change = metrics.difference(motion, result, world=batch.report is not None)
    share = float(found.mask.mean())
    seen = 100 * float(np.asarray(sure.mask).mean())
    done = f"repaired ({seen:.2g} % were found in error)"
    message = _runs.told(rows, share, done, left, least)
    note = "; ".join(filter(None, (_runs.largest(rows), _runs.surest(left), str(around))))
    learned, drawings = _for_report(batch, around, rows, left, least), ()
    if is_page(batch.report):
        drawings = _pictures.of_repair(found)
    both, title = {"before": motion, "after": result}, job.source.name
    beside = compared(both, batch.report, title, errors=found.mask)
    clips = (Clip.of(motion),), Clip.of(result)
    return Effect(*clips, message, change, skate, learned, note, drawings, beside)


def _look(batch: Batch, wanted: Wanted, job: Job) -> "Effect":
    """What a file's errors are; writes nothing."""
    from jaxmotion.cli import _pictures, _runs
    from jaxmotion.cli._compared import compared, is_page
    from jaxmotion.cli._work import Clip, Effect

    motion, around, free = _read(batch.reading, wanted, job)
    least = wanted.confidence
    _, found, left = _errors(motion, around, free, least)
    rows = _runs.of_errors(found)
    share = float(found.mask.mean())
    message = _runs.told(rows, share, "in error", left, least)
    lines = _runs.listed(rows, left)
    drawings = _pictures.of_errors(found) if is_page(batch.report) else ()
    return Effect(
        (Clip.of(motion),),
        message=message,
        learned=_for_report(batch, around, rows, left, least),
        note="\n".join(filter(None, (*lines, f"  {around}" * bool(str(around))))),
        drawings=drawings,
        compared=compared({job.source.stem: motion}, batch.report, job.source.name, errors=found),
    )


def _as_text(outcome: "Outcome") -> list[str]:
    """A file's errors, in lines."""
    effect = outcome.effect
    assert effect is not None
    lines = effect.note.split("\n") if effect.note else []
    return [f"{printable(outcome.job.source)}: {effect.message}", *lines]


def _read(reading: Reading, wanted: Wanted, job: Job) -> "tuple[Motion, Beside, np.ndarray]":
    """The clip, its context, and which joints are meant."""
    import numpy as np

    from jaxmotion.cli._beside import shelf
    from jaxmotion.cli._work import read

    motion = read(job.source, reading, uses_up=True)
    free = np.full(motion.num_joints, not wanted.joints)
    free[list(motion.skeleton.matching(*wanted.joints))] = True
    return motion, shelf(wanted.context, reading).beside(job.source, motion), free


def _errors(
    motion: "Motion", around: "Beside", free: "np.ndarray", confidence: float
) -> "tuple[DetectedErrors, DetectedErrors, list[dict[str, Any]]]":
    """Those found; of the joints that are meant those of some confidence, and rows of the rest."""
    from jaxmotion.cleaning.detect import detected
    from jaxmotion.cli import _runs

    found = detected(around.evidence, around.levels, motion)
    sure = _only(found.at_least(confidence), free)
    return found, sure, _runs.of_errors(_only(found, ~sure.mask & free))


def _only(found: "DetectedErrors", meant: Any) -> "DetectedErrors":
    """Errors of some joints, or entries."""
    import equinox as eqx
    import jax

    masks = jax.tree.map(lambda mask: mask & meant, (found.mask, found.by))
    return eqx.tree_at(lambda errors: (errors.mask, errors.by), found, masks)


def _planted(found: "Repaired", free: "np.ndarray", keep: bool) -> "tuple[Repaired, Skate | None]":
    """Legs that were repaired brought back to where the feet stand in the repaired clip, and how
    these slide."""
    import jax.numpy as jnp
    import numpy as np

    from jaxmotion.cleaning import Repaired
    from jaxmotion.cleaning.planted import planted_again
    from jaxmotion.cli._feet import find_feet, with_contacts
    from jaxmotion.cli._padding import pad, unpadded

    mask = np.asarray(found.mask)
    if not mask.any():
        return found, None
    before, length = pad(found.before)
    after, _ = pad(found.motion)
    contacts = find_feet(after, length)
    masks = [np.pad(mask, ((0, after.num_frames - length), (0, 0)))]

    def restore(edited: "Motion", *_: Any) -> "Motion":
        planted, changed = planted_again(edited, contacts, masks[0], free)
        masks.append(np.asarray(changed))
        return planted

    keep = keep and bool(np.asarray(contacts.mask).any())
    kept, skate = with_contacts(before, after, contacts, length, keep, restore=restore)
    if keep:
        changed = jnp.asarray(masks[-1][:length])
        found = Repaired(unpadded(kept, length), changed, found.before, found.errors)
    return found, skate


def _copy(motion: "Motion", job: Job, batch: Batch) -> None:
    """A file in which there is nothing to repair, byte for byte if it is wanted as it is."""
    from jaxmotion.cli._work import write
    from jaxmotion.io.atomic import atomic_write
    from jaxmotion.io.formats import files_of

    same = job.source.suffix.lower() == job.target.suffix.lower()
    as_it_is = batch.reading == Reading(None, None) and batch.out_up is None
    if same and as_it_is and len(files_of(job.target)) == 1:
        job.target.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(job.target, overwrite=batch.overwrite) as file:
            file.write(job.source.read_bytes())
    else:
        write(motion, job.target, overwrite=batch.overwrite, up=batch.out_up)


def _for_report(
    batch: Batch,
    around: "Beside",
    rows: list[dict[str, Any]],
    left: list[dict[str, Any]],
    least: float,
) -> "Learned":
    """What goes into a report, if there is one."""
    from jaxmotion.cli._beside import named

    if batch.report is None:
        return {}
    left_out = {"other_joints": around.other, "unreadable": around.unreadable}
    learned = {"context": named(around.paths), "left_out": left_out, "runs": rows}
    return learned | ({"least_confidence": least, "runs_left": left} if least else {})

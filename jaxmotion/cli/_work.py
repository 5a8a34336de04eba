"""One file through an edit: read, edit, confine, check, write, compare; in any process.

Clips are padded to a few lengths on the way, so that a folder of clips needs a few compilations,
not one each; edits are given the number of frames that count.
"""

import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from jaxmotion._plain import printable
from jaxmotion.cli._app import described
from jaxmotion.cli._feet import Skate, find_feet, keep_contacts, with_contacts
from jaxmotion.cli._files import Job
from jaxmotion.cli._options import Reading, Selection
from jaxmotion.cli._padding import pad, unpadded, unpadded_contacts
from jaxmotion.cli._terminal import Notice

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion.cli._compared import Compared
    from jaxmotion.cli._pictures import Drawing
    from jaxmotion.contacts import Contacts
    from jaxmotion.metrics import Difference


# What was learned of a clip, by name: a value, or rows of a table, which have the same keys.
Learned: TypeAlias = dict[str, Any]


@dataclass
class Outcome:
    """What became of one file: ``status`` is "written", "read" (where nothing is written),
    "skipped" or "failed"."""

    job: Job
    status: str
    message: str = ""
    warnings: list[str] = field(default_factory=list)
    seconds: float = 0.0
    effect: "Effect | None" = None
    traceback: str = ""


@dataclass(frozen=True)
class Clip:
    """Frames, frames a second, and metres a unit, None where it is not told."""

    frames: int
    rate: float
    unit: float | None

    @classmethod
    def of(cls, motion: "Motion") -> "Clip":
        """Of a motion."""
        rate = round(1.0 / float(motion.frame_time), 6)
        unit = motion.skeleton.conventions.metres
        return cls(motion.num_frames, rate, None if unit is None else float(unit))


@dataclass(frozen=True)
class Effect:
    """What came of the clips that were ``read``, the file's own first: ``made``, the clip that is
    written; a ``message``, if there is more to say than ``change``, how it differs; ``skate``, how
    its feet slide, None if none touch; what was ``learned`` on the way, if a report asks; a line to
    tell below that of the file, ``note``; for a report ``drawings``, and the clips ``compared``."""

    read: tuple[Clip, ...]
    made: Clip | None = None
    message: str = ""
    change: "Difference | None" = None
    skate: Skate | None = None
    learned: Learned = field(default_factory=dict)
    note: str = ""
    drawings: "tuple[Drawing, ...]" = ()
    compared: "Compared | None" = None


@dataclass(frozen=True)
class Edited:
    """What an edit makes of a clip, a function to ask, if there is a report, for what it learned of
    it, and a ``note`` on it. Where its frames last longer or shorter than the clip's, the result is
    brought back to the clip's rate."""

    motion: "Motion"
    learned: Callable[[], Learned] = dict
    note: str = ""


@dataclass(frozen=True)
class Editing:
    """What :func:`edit_file` does to every file: ``edit(motion, length)`` makes a motion of the
    same shape; ``keep``: whether contacts are kept, ``None`` where the feet would slide more;
    ``find(motion, length)`` finds them, ``restore`` keeps them as :func:`with_contacts` has it;
    for a ``report`` it finds out what only that shows: moves in the world, what is learned."""

    edit: "Callable[[Motion, int], Edited]"
    selection: Selection
    reading: Reading
    out_up: str | None = None
    overwrite: bool = False
    report: Path | None = None
    keep: bool | None = None
    find: "Callable[[Motion, int], Contacts]" = find_feet
    restore: "Callable[[Motion, Motion, Contacts, int], Motion]" = keep_contacts


def guarded(process: Callable[[Job], Effect], job: Job) -> Outcome:
    """Run ``process`` on a job; whatever goes wrong becomes a failed outcome."""
    begun = time.perf_counter()
    outcome = Outcome(job, "written")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            outcome.effect = process(job)
        except Exception as error:
            outcome.status = "failed"
            outcome.message = described(error)
            outcome.traceback = traceback.format_exc()
    outcome.warnings = told(caught, job.target, job.source)
    outcome.seconds = time.perf_counter() - begun
    return outcome


def told(caught: list[warnings.WarningMessage], *paths: Path) -> list[str]:
    """What a user should hear of: repairs, changes of layout, notices and solvers that did not come
    to rest, without the ``paths`` in front."""
    from jaxmotion.io import MotionFileWarning
    from jaxmotion.spacetime import ConvergenceWarning

    kinds = (MotionFileWarning, Notice, ConvergenceWarning)
    texts = [str(w.message) for w in caught if issubclass(w.category, kinds)]
    for path in paths:
        texts = [text.removeprefix(f"{printable(path)}: ") for text in texts]
    return texts


def edit_file(editing: Editing, job: Job) -> Effect:
    """Read the job's source, edit it and write its target."""
    from jaxmotion import metrics
    from jaxmotion.cli._compared import compared

    motion = read(job.source, editing.reading, uses_up=True)
    padded, length = pad(motion)
    selection = editing.selection
    edit = editing.edit(padded, length)
    edited = confined(padded, edit.motion, length, selection)
    contacts = editing.find(padded, length)
    # What restores contacts stays in the selection too, at its full strength.
    within = partial(confined, edited, length=length, selection=replace(selection, strength=1.0))
    kept, skate = with_contacts(
        padded, edited, contacts, length, editing.keep, restore=editing.restore, within=within
    )
    result = finite(unpadded(kept, length))
    measured = editing.report is not None
    change = metrics.difference(motion, result, world=measured)
    result = _at_rate_of(motion, result)
    write(result, job.target, overwrite=editing.overwrite, up=editing.out_up)
    learned = edit.learned() if measured else {}
    feet = unpadded_contacts(contacts, length)
    clips, title = {"before": motion, "after": result}, job.source.name
    beside = compared(clips, editing.report, title, contacts=feet)
    made = Clip.of(result)
    return Effect((Clip.of(motion),), made, "", change, skate, learned, edit.note, (), beside)


def _at_rate_of(motion: "Motion", result: "Motion") -> "Motion":
    """The result at the clip's frame time."""
    import jaxmotion as jm

    if float(result.frame_time) == float(motion.frame_time):
        return result
    result = jm.resample(result, fps=float(motion.fps))
    return motion.with_transforms(result.translations, result.rotations)


def finite(motion: "Motion") -> "Motion":
    """The motion, if no number in it is NaN or infinite; else ``ValueError``."""
    import numpy as np

    for part in (np.asarray(motion.rotations), np.asarray(motion.translations)):
        if not np.isfinite(part).all():
            frame, joint = np.argwhere(~np.isfinite(part))[0][:2]
            name = motion.skeleton.names[joint]
            raise ValueError(f"the result is not finite, first at frame {frame}, joint {name!r}")
    return motion


def read(path: Path, reading: Reading, *, uses_up: bool = False) -> "Motion":
    """Load a motion; ``uses_up``: warn if it seems to stand along another axis than it says."""
    import jaxmotion as jm
    from jaxmotion.axes import doubt_up

    motion = jm.load(path, fps=reading.fps, up=reading.up)  # type: ignore[arg-type]
    if uses_up and (doubt := doubt_up(motion)):
        warnings.warn(f"{path}: {doubt}", jm.io.MotionFileWarning, stacklevel=2)
    return motion


def duration(motion: "Motion") -> float:
    """Seconds from the first frame to the last."""
    return (motion.num_frames - 1) * float(motion.frame_time)


def write(
    motion: "Motion", path: Path, *, overwrite: bool, up: str | None = None, **format_options: Any
) -> None:
    """Save a motion, making the folders it goes to; ``up``: the axis to point up in the file;
    ``format_options`` go to the format. What other programs make of the file is a notice."""
    import jaxmotion as jm
    from jaxmotion.io.formats import viewer_note

    path.parent.mkdir(parents=True, exist_ok=True)
    jm.save(motion, path, overwrite=overwrite, up=up, **format_options)  # type: ignore[arg-type]
    if note := viewer_note(path, motion):
        warnings.warn(note, Notice, stacklevel=2)


def confined(original: "Motion", edited: "Motion", length: int, selection: Selection) -> "Motion":
    """The edit where it was asked for; both clips padded."""
    if selection.everything or edited is original:
        return edited
    import numpy as np

    from jaxmotion.confine import confine, selection_weights

    weights = selection_weights(
        original.skeleton,
        length,
        joints=selection.joints,
        frames=selection.frames,
        fade=selection.fade,
        strength=selection.strength,
    )
    padding = np.zeros((original.num_frames - length, original.num_joints))
    return confine(original, edited, np.concatenate([weights, padding]))

"""What may be wrong with a clip, frame by frame and joint by joint, from measures and thresholds.

| kind | found when |
|---|---|
| ``nan`` | an entry is not finite (then nothing else is looked for) |
| ``empty`` | there are fewer than two frames |
| ``rate`` | the frame rate is not within 0.5 % of one that cameras and engines use |
| ``duplicate`` | a frame repeats the one before in every joint, while the clip moves |
| ``flip`` | a quaternion changes sign from one frame to the next: a jump of 360° in the file |
| ``jump`` | a joint turns by more than 120° from one frame to the next |
| ``first`` | the first frame stands apart: to the second a joint turns by more than 30°, and by \
four times any later step within ten frames |
| ``spike`` | a joint or the root is out for one frame and back: its bend is over 30° (2 % of the \
figure's size), more than its neighbours in time differ, four times any other within ten frames |
| ``up`` | the figure stands along another axis than the one that points up |
| ``gimbal`` | a joint's Euler angles come within 2° of gimbal lock |

Neighbouring frames with one problem are one finding. ``flip`` and ``gimbal`` are notes: most good
captures have some, this library minds neither, and other tools may.
T frames, J joints, O(T·J), NumPy on the host.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from jaxmotion._entry import one_clip
from jaxmotion.axes import doubt_up
from jaxmotion.metrics import measures
from jaxmotion.motion import Motion

KINDS = ("nan", "empty", "rate", "duplicate", "flip", "jump", "first", "spike", "up", "gimbal")
NOTES = ("flip", "gimbal")
_RATES = (12, 15, 20, 24, 25, 30, 48, 50, 60, 72, 75, 90, 100, 120, 144, 150, 180, 200, 240, 250)
_RATES = (*_RATES, 300, 360, 400, 480, 500, 1000, *(r * 1000 / 1001 for r in (24, 30, 60, 120)))
_RATE_TOLERANCE, _LIKELY = 0.005, 0.2
_ROOT_SPIKE = 0.02  # of the figure's size
_ISOLATION, _AROUND = 4.0, 10


@dataclass(frozen=True)
class Problem:
    """One finding about a clip.

    **Fields:** ``kind``: one of the module's table; ``message``: a sentence for people; ``frame``,
    ``last_frame``: the first and the last it is about, from 0, None for the whole clip; ``joint``:
    by name, None for all.
    """

    kind: str
    message: str
    frame: int | None = None
    last_frame: int | None = None
    joint: str | None = None

    @property
    def serious(self) -> bool:
        """Whether it is more than a note."""
        return self.kind not in NOTES


def find_problems(
    motion: Motion,
    *,
    jump: float = np.radians(120),
    spike: float = np.radians(30),
    gimbal: float = np.radians(2),
) -> list[Problem]:
    """Look for everything in the module's table.

    **Arguments:** ``motion``: T frames, J joints, one clip; ``jump``: turn from frame to frame;
    ``spike``: bend of a single frame, and turn after a first; ``gimbal``: margin to gimbal lock;
    radians.
    **Returns:** a list of :class:`Problem` in the order of the table, then by joint and frame; none
    is good news.
    **Raises:** ``ValueError`` for what is not one clip.
    """
    one_clip("find_problems", motion, on_host=True)
    broken = list(_not_finite(motion))
    if broken:
        return broken
    if motion.num_frames < 2:
        return [Problem("empty", f"{motion.num_frames} frame: there is no motion in it")]
    return [
        *_rate(motion),
        *_duplicates(motion),
        *_flips(motion),
        *_jumps(motion, jump),
        *_first(motion, spike),
        *_spikes(motion, spike),
        *_up(motion),
        *_gimbal(motion, gimbal),
    ]


def _not_finite(motion: Motion) -> Iterator[Problem]:
    parts = np.asarray(motion.rotations), np.asarray(motion.translations)
    broken = np.any([~np.isfinite(part).all(axis=-1) for part in parts], axis=0)
    for joint, first, last in _runs(np.asarray(broken), motion):
        yield Problem("nan", "values that are not numbers", first, last, joint)


def _rate(motion: Motion) -> Iterator[Problem]:
    seconds = float(motion.frame_time)
    fps = 1.0 / seconds
    nearest, share = _nearest_rate(fps)
    if share <= _RATE_TOLERANCE:
        return
    told = f"the frame time is {seconds:.6g} seconds"
    if seconds > 1 and _nearest_rate(seconds)[1] <= _RATE_TOLERANCE:
        likely = f"{told}; is it a rate, {seconds:.6g} frames a second?"
    elif seconds > 1 and _nearest_rate(1000 / seconds)[1] <= _RATE_TOLERANCE:
        likely = f"{told}; is it milliseconds, {1000 / seconds:.5g} frames a second?"
    elif share <= _LIKELY:
        likely = f"{fps:.6g} frames a second is unusual; is it {nearest:.5g}?"
    else:
        likely = f"{fps:.6g} frames a second is unusual"
    yield Problem("rate", f"{likely} (--fps sets it)")


def _nearest_rate(fps: float) -> tuple[float, float]:
    """The nearest rate that cameras and engines use, and by which share ``fps`` differs."""
    nearest = min(_RATES, key=lambda rate: abs(np.log(fps / rate)))
    return float(nearest), abs(fps / nearest - 1.0)


def _duplicates(motion: Motion) -> Iterator[Problem]:
    same = measures.duplicate_frames(motion)
    if same[1:].all():
        yield Problem("duplicate", "nothing moves: all frames are alike")
        return
    for _, first, last in _runs(same[:, None], motion):
        count = last - first + 1
        yield Problem(
            "duplicate", f"{count} frame{'s' * (count > 1)} like the one before", first, last
        )


def _flips(motion: Motion) -> Iterator[Problem]:
    for joint, frame, _ in _runs(measures.sign_flips(motion), motion, after=1, merge=False):
        yield Problem("flip", "changes sign: 360° from the frame before", frame, frame, joint)


def _jumps(motion: Motion, least: float) -> Iterator[Problem]:
    angle = measures.rotation_rates(motion) * float(motion.frame_time)
    names = motion.skeleton.names
    for joint, frame, _ in _runs(angle > least, motion, after=1, merge=False):
        degrees = np.degrees(angle[frame - 1, names.index(joint)])
        yield Problem("jump", f"turns {degrees:.0f}° from the frame before", frame, frame, joint)


def _first(motion: Motion, least: float) -> Iterator[Problem]:
    angle = measures.rotation_rates(motion)[: _AROUND + 1] * float(motion.frame_time)
    later = angle[1:].max(axis=0, initial=0.0)
    apart = np.where(angle[0] > _ISOLATION * later, angle[0], 0.0)
    if len(angle) > 1 and apart.max() > least:
        name, degrees = motion.skeleton.names[apart.argmax()], np.degrees(apart.max())
        text = f"stands apart from the second frame, by {degrees:.0f}° at {name}; a rest pose?"
        yield Problem("first", text, 0, 0)


def _spikes(motion: Motion, least: float) -> Iterator[Problem]:
    if motion.num_frames < 3:
        return
    names = motion.skeleton.names
    q, p = np.asarray(motion.rotations), np.asarray(motion.translations, np.float64)[:, :1]
    bend = measures.bend(motion)
    out = _isolated(bend, measures.turn(q[2:], q[:-2]), least)
    for joint, frame, _ in _runs(out, motion, after=1, merge=False):
        degrees = np.degrees(bend[frame - 1, names.index(joint)])
        yield Problem("spike", f"out by {degrees:.0f}° for one frame", frame, frame, joint)
    far, size = measures.root_bend(motion)[:, None], measures.figure_size(motion.skeleton)
    out = _isolated(far, np.linalg.norm(p[2:] - p[:-2], axis=-1), _ROOT_SPIKE * size)
    for joint, frame, _ in _runs(out, motion, after=1, merge=False):
        text = f"position out by {far[frame - 1, 0]:.4g} for one frame"
        yield Problem("spike", text, frame, frame, joint)


def _up(motion: Motion) -> Iterator[Problem]:
    if doubt := doubt_up(motion):
        yield Problem("up", doubt)


def _isolated(bend: np.ndarray, across: np.ndarray, least: float) -> np.ndarray:
    """Where bends [T − 2, J] pass ``least``, what the neighbours differ by, ``across``, and
    ``_ISOLATION`` times all other bends close by."""
    marked = np.zeros(bend.shape, bool)
    for frame, joint in np.argwhere((bend > least) & (bend > across)):
        around = bend[max(frame - _AROUND, 0) : frame + _AROUND + 1, joint].copy()
        here = min(frame, _AROUND)
        # The neighbours of a spike bend too, by half as much.
        beside = around[max(here - 1, 0) : here + 2].max()
        around[max(here - 1, 0) : here + 2] = 0.0
        value = bend[frame, joint]
        marked[frame, joint] = value == beside and value > _ISOLATION * around.max()
    return marked


def _gimbal(motion: Motion, least: float) -> Iterator[Problem]:
    margin, names = measures.gimbal_margin(motion), motion.skeleton.names
    for joint, first, last in _runs(margin < least, motion):
        closest = np.degrees(margin[first : last + 1, names.index(joint)].min())
        yield Problem("gimbal", f"Euler angles {closest:.1f}° from gimbal lock", first, last, joint)


def _runs(
    marked: np.ndarray, motion: Motion, *, after: int = 0, merge: bool = True
) -> Iterator[tuple[str, int, int]]:
    """(joint, first, last) of each run of marked frames, ``marked`` [T, J]; one frame each if not
    ``merge``; ``after`` is added to the numbers."""
    for joint in np.flatnonzero(marked.any(axis=0)):
        frames = np.flatnonzero(marked[:, joint]) + after
        breaks = np.flatnonzero(np.diff(frames) > (1 if merge else 0)) + 1
        for run in np.split(frames, breaks):
            yield motion.skeleton.names[joint], int(run[0]), int(run[-1])

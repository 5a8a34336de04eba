"""What may be wrong with a clip, frame by frame and joint by joint, from measures and thresholds.

| kind | found when |
|---|---|
| ``nan`` | an entry is not finite (then nothing else is looked for) |
| ``dtype`` | arrays are neither float32 nor float64, or not all alike |
| ``norm`` | a rotation is no unit quaternion |
| ``order`` | rotations look like (x, y, z, w) (after ``norm`` or this only ``rate`` is sought) |
| ``empty`` | there are fewer than two frames |
| ``rate`` | the frame rate is not within 0.5 % of one that cameras and engines use |
| ``degrees`` | rotations turn as fast as if degrees had been taken for radians |
| ``duplicate`` | a frame repeats the one before in every joint, while the clip moves |
| ``flip`` | a quaternion changes sign from one frame to the next: a jump of 360° in the file |
| ``jump`` | a joint turns by more than 120° from one frame to the next |
| ``first`` | the first frame stands apart: to the second a joint turns by more than 30°, and by \
four times any later step within ten frames |
| ``spike`` | a joint or the root is out for one frame and back: its bend is over 30° (2 % of the \
figure's size), more than its neighbours in time differ, four times any other within ten frames |
| ``up`` | the figure stands along another axis than the one that points up |
| ``gimbal`` | a joint's Euler angles come within 2° of gimbal lock |

``norm``, ``order``, ``rate`` and ``degrees`` name the likely cause: :mod:`jaxmotion._likely`.
Neighbouring frames with one problem are one finding. ``flip`` and ``gimbal`` are notes: most good
captures have some, this library minds neither, and other tools may.
T frames, J joints, O(T·J), NumPy on the host.
"""

from collections.abc import Iterator

import numpy as np

from jaxmotion import _likely
from jaxmotion._checks import traced
from jaxmotion._entry import one_clip
from jaxmotion._plain import some
from jaxmotion.axes import doubt_up
from jaxmotion.metrics import measures
from jaxmotion.metrics.findings import Findings, Problem
from jaxmotion.motion import Motion

KINDS = (
    *("nan", "dtype", "norm", "order", "empty", "rate", "degrees"),
    *("duplicate", "flip", "jump", "first", "spike", "up", "gimbal"),
)
_LIKELY = 0.2  # share by which a frame rate may miss one that is usual
_ROOT_SPIKE = 0.02  # of the figure's size
_ISOLATION, _AROUND = 4.0, 10


def check(motion: Motion, *, notes: bool = False) -> Findings:
    """What may be wrong with a clip, and the likely cause: a wrong convention, NaN, jumps, spikes.

    The table of kinds is in :mod:`jaxmotion.metrics.checks`. NumPy on the host, O(T·J).

    **Arguments:** ``motion``: one clip of known values, T frames, J joints; ``notes``: whether to
    tell too of what this library does not mind and other tools may: quaternions that change sign
    and Euler angles near gimbal lock.
    **Returns:** :class:`~jaxmotion.metrics.Findings`: a tuple with a kind, a sentence, joint and
    frames each; empty, and so false, when all is well.
    **Raises:** ``ValueError`` for a traced motion or a batch.

    **Example:**

        >>> import numpy as np, jaxmotion as jm
        >>> motion = jm.samples.load("walk").motion
        >>> jm.check(motion)
        nothing found
        >>> swapped = motion.with_transforms(rotations=jm.quaternion.to_xyzw(motion.rotations))
        >>> jm.check(swapped).kinds
        ('order',)
    """
    _one_known_clip(motion, "check")
    return Findings(p for p in find_problems(motion) if notes or p.serious)


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
    **Raises:** ``ValueError`` for a traced motion, or what is not one clip.
    """
    _one_known_clip(motion, "find_problems")
    broken = list(_not_finite(motion))
    if broken:
        return broken
    found = [*_dtypes(motion), *_no_rotations(motion)]
    if motion.num_frames < 2:
        return [*found, Problem("empty", f"{motion.num_frames} frame: there is no motion in it")]
    found += _rate(motion)
    if any(problem.kind in ("norm", "order") for problem in found):
        return found
    return [
        *found,
        *_degrees(motion),
        *_duplicates(motion),
        *_flips(motion),
        *_jumps(motion, jump),
        *_first(motion, spike),
        *_spikes(motion, spike),
        *_up(motion),
        *_gimbal(motion, gimbal),
    ]


def _one_known_clip(motion: Motion, caller: str) -> None:
    one_clip(caller, motion, on_host=True)
    if traced(motion):
        raise ValueError(f"{caller}: the motion is traced; look at it outside of jit and vmap")


def _not_finite(motion: Motion) -> Iterator[Problem]:
    parts = np.asarray(motion.rotations), np.asarray(motion.translations)
    broken = np.any([~np.isfinite(part).all(axis=-1) for part in parts], axis=0)
    for joint, first, last in _runs(np.asarray(broken), motion):
        yield Problem("nan", "values that are not numbers", first, last, joint)


def _dtypes(motion: Motion) -> Iterator[Problem]:
    kinds = {name: getattr(motion, name).dtype for name in ("rotations", "translations")}
    if len(set(kinds.values())) > 1 or motion.dtype not in (np.float32, np.float64):
        told = " and ".join(f"{name} are {kind}" for name, kind in kinds.items())
        yield Problem("dtype", f"{told}; all float32 or all float64 is expected (motion.astype)")


def _no_rotations(motion: Motion) -> Iterator[Problem]:
    q = np.asarray(motion.rotations, np.float64)
    if doubt := _likely.doubt_rotations(q):
        yield Problem(*doubt)
        return
    for joint, first, last in _runs(~_likely.unit(q), motion):
        norm = np.linalg.norm(q[first, motion.skeleton.names.index(joint)])
        yield Problem("norm", f"norm {norm:.4g}: no unit quaternion", first, last, joint)


def _rate(motion: Motion) -> Iterator[Problem]:
    seconds = float(motion.frame_time)
    fps = 1.0 / seconds
    nearest, share = _likely.nearest_rate(fps)
    if share <= _likely.RATE_TOLERANCE:
        return
    likely = _likely.doubt_frame_time(seconds) or f"{fps:.6g} frames a second is unusual"
    if share <= _LIKELY:
        likely = f"{likely}; is it {nearest:.5g}?"
    yield Problem("rate", f"{likely} (--fps, or load(fps=), sets it)")


def _degrees(motion: Motion) -> Iterator[Problem]:
    seconds = float(motion.frame_time)
    if doubt := _likely.doubt_rates(measures.rotation_rates(motion) * seconds, seconds):
        yield Problem("degrees", doubt)


def _duplicates(motion: Motion) -> Iterator[Problem]:
    same = measures.duplicate_frames(motion)
    if same[1:].all():
        yield Problem("duplicate", "nothing moves: all frames are alike")
        return
    for _, first, last in _runs(same[:, None], motion):
        count = last - first + 1
        yield Problem("duplicate", f"{some(count, 'frame')} like the one before", first, last)


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
    q, body = np.asarray(motion.rotations), motion.body_joint
    p = measures.body_positions(motion, body)[:, None]
    bend = measures.bend(motion)
    out = _isolated(bend, measures.turn(q[2:], q[:-2]), least)
    for joint, frame, _ in _runs(out, motion, after=1, merge=False):
        degrees = np.degrees(bend[frame - 1, names.index(joint)])
        yield Problem("spike", f"out by {degrees:.0f}° for one frame", frame, frame, joint)
    far, size = measures.root_bend(motion)[:, None], measures.figure_size(motion.skeleton)
    out = _isolated(far, np.linalg.norm(p[2:] - p[:-2], axis=-1), _ROOT_SPIKE * size)
    for _, frame, _ in _runs(out, motion, after=1, merge=False):
        text = f"position out by {far[frame - 1, 0]:.4g} for one frame"
        yield Problem("spike", text, frame, frame, names[body])


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

"""Joints that jump and that stand still: what errors with hard edges look like.

    leap    v = log(s⁻¹ q(t)⁻¹q(t+1)), s the nearest of the step before, the one after, and the mean
            of both: 0 of what goes on at its pace
    jump    e = ‖v‖
    pair    of a frame the greatest min(e, e′) over two jumps on both sides of it: what goes away
            and comes back. The second turns back, within 45° of −v, as the joint or as its parent
            sees it; at most 1.3 seconds lie between; and of all such each leaves least, ‖v + v′‖,
            of the other, a later one only if less by a tenth: what is between two errors is none
    hold    of a frame how many steps on end, itself included, turn by less than 10⁻⁴ rad while at
            least half of the joints move; not in a pose that the joint comes to at other times, to
            10⁻³ rad: there it rests, at a limit of its own or of what wrote the file; nor from the
            first frame to the last: nobody captured the joint

NumPy on the host. T frames, J joints, L frames in 1.3 s: O(T·J·L).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from jaxmotion.cleaning.turns import angles_between, between, rotated, steps, vectors_between
from jaxmotion.frames.runs import spans

_APART = 1.3  # seconds
_BACK = np.cos(np.pi / 4)
_CLEAR = 0.1  # of the jumps' size
_STILL = 1e-4  # radians a frame
_SAME = 1e-3  # radians
_MOVING = 0.12  # radians a second


def turns(rotations: Float[np.ndarray, "time joint 4"]) -> Float[np.ndarray, "step joint"]:
    """The angle of every step, radians."""
    return angles_between(rotations[:-1], rotations[1:])


def leaps(rotations: Float[np.ndarray, "time joint 4"]) -> Float[np.ndarray, "step joint 3"]:
    """The leap of every step, radians; 0 of the first and the last, which have but one beside."""
    step = steps(rotations)
    found = np.zeros((*step.shape[:2], 3), step.dtype)
    if len(found) > 2:
        before, here, after = step[:-2], step[1:-1], step[2:]
        half = np.full(here.shape[:2], 0.5, here.dtype)
        likely = before, after, between(before, after, half)
        away = np.stack([vectors_between(x, here) for x in likely])
        nearest = np.linalg.norm(away, axis=-1).argmin(axis=0)
        found[1:-1] = np.take_along_axis(away, nearest[None, ..., None], axis=0)[0]
    return found


def jumps(rotations: Float[np.ndarray, "time joint 4"]) -> Float[np.ndarray, "step joint"]:
    """The jump of every step, radians."""
    return np.linalg.norm(leaps(rotations), axis=-1)


def paired(
    rotations: Float[np.ndarray, "time joint 4"],
    leap: Float[np.ndarray, "step joint 3"],
    fps: float,
) -> Float[np.ndarray, "time joint"]:
    """The pair of every frame, radians."""
    found = np.zeros(rotations.shape[:2], leap.dtype)
    jump = np.linalg.norm(leap, axis=-1)
    other = _other_of(rotations, leap, jump, round(_APART * fps))
    for joint in range(jump.shape[1]):
        first = np.arange(len(jump))
        first = first[other[:, joint] > first]
        last = other[first, joint]
        mutual = other[last, joint] == first
        for a, b in zip(first[mutual].tolist(), last[mutual].tolist(), strict=True):
            both = min(jump[a, joint], jump[b, joint])
            inside = found[a + 1 : b + 1, joint]
            np.maximum(inside, both, out=inside)
    return found


def _other_of(
    rotations: Float[np.ndarray, "time joint 4"],
    leap: Float[np.ndarray, "step joint 3"],
    jump: Float[np.ndarray, "step joint"],
    apart: int,
) -> Int[np.ndarray, "step joint"]:
    """The jump that leaves least of each, of those that turn back; −1 where none does."""
    seen = leap, rotated(rotations[1:], leap)
    least, other = np.full(jump.shape, np.inf), np.full(jump.shape, -1)
    for n in range(1, min(apart, len(jump) - 1) + 1):
        on = np.min([np.einsum("tjx,tjx->tj", v[:-n], v[n:]) for v in seen], axis=0)
        product = jump[:-n] * jump[n:]
        left = np.where(on < -_BACK * product, jump[:-n] ** 2 + 2 * on + jump[n:] ** 2, np.inf)
        numbers = np.arange(len(left))[:, None]
        for half, number in ((slice(None, -n), numbers + n), (slice(n, None), numbers)):
            better = left + _CLEAR**2 * product < least[half]
            least[half] = np.where(better, left, least[half])
            other[half] = np.where(better, number, other[half])
    return other


def held(
    rotations: Float[np.ndarray, "time joint 4"],
    fps: float,
    others: Sequence[Float[np.ndarray, "_ joint 4"]] = (),
) -> Int[np.ndarray, "time joint"]:
    """The hold of every frame; 0 of the frame that a hold begins from, which is not in error, and
    of joints at rest. ``others``: the context's rotations."""
    step = turns(rotations)
    moving = np.median(step, axis=1) > _MOVING / fps if step.size else np.zeros(len(step), bool)
    frames, joints = rotations.shape[:2]
    found = np.zeros((frames, joints), int)
    for joint in range(joints):
        for begin, end in spans(step[:, joint] < _STILL):
            if end - begin < 2 or end - begin == len(step):
                continue
            elsewhere = [rotations[:begin, joint], rotations[end + 1 :, joint]]
            elsewhere += [x[:, joint] for x in others]
            if not _comes_to(rotations[begin, joint], elsewhere):
                found[begin + 1 : end + 1, joint] = np.where(moving[begin:end], end - begin, 0)
    return found


def _comes_to(pose: Float[np.ndarray, "4"], elsewhere: Sequence[np.ndarray]) -> bool:
    """Whether the joint has the same rotation in other frames."""
    # Rotations of angle θ between them are 2 sin(θ/4) apart, as quaternions on one hemisphere.
    near = 2 * np.sin(_SAME / 4)
    return any(
        len(q) and min(np.linalg.norm(x, axis=-1).min() for x in (q - pose, q + pose)) < near
        for q in elsewhere
    )


def greatest_about(values: np.ndarray, shifts: range, frames: int) -> np.ndarray:
    """Of every frame t the greatest of values[t − shift], 0 or False where there is none."""
    found = np.zeros((frames, *values.shape[1:]), values.dtype)
    for shift in shifts:
        low, high = max(0, shift), min(frames, len(values) + shift)
        if low < high:
            found[low:high] = np.maximum(found[low:high], values[low - shift : high - shift])
    return found

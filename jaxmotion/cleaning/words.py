"""Motion words: what a body does for a moment, wherever it is and whichever way it goes.

A word is N consecutive frames of some joints' local rotations. Of the joint that the body hangs
from only the lean counts: its place is dropped, and its yaw removed (:mod:`jaxmotion._posture`).
Words begin at every ``stride``-th frame, and one ends with the clip. Source: Aristidou et al. 2018,
§3. O(T·J).
"""

from collections.abc import Iterator, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxmotion import quaternion
from jaxmotion._checks import known, one_of, static, traced
from jaxmotion._entry import finite_clip
from jaxmotion._portable import Portable
from jaxmotion._posture import axes_of, posture, upright
from jaxmotion._room import room_for
from jaxmotion._summary import some
from jaxmotion._types import AnyArray, Vector3
from jaxmotion.cleaning.groups import GROUPS, joint_groups
from jaxmotion.kinematics import forward_kinematics
from jaxmotion.motion import Motion

_PACE = 0.1  # seconds, for which velocities count


class MotionWords(Portable):
    """The words of a clip.

    **Fields:** ``rotations``: f[W, N, J, 4], of J joints; ``starts``: i32[W], the frame each begins
    at; ``joints``: their numbers, static.
    """

    rotations: Float[AnyArray, "word frame joint 4"]
    starts: Int[AnyArray, " word"]
    joints: tuple[int, ...] = eqx.field(static=True)

    def _words(self) -> Iterator[str]:
        yield some(self.rotations.shape[0], "word")
        yield some(self.rotations.shape[1], "frame")
        yield some(len(self.joints), "joint")


@static("length", "stride", "joints")
def motion_words(
    motion: Motion,
    *,
    length: int = 15,
    stride: int = 5,
    joints: str | Sequence[int | str] | None = None,
) -> MotionWords:
    """The words of a clip.

    **Arguments:** ``motion``: one clip, T frames; ``length``: N, frames of a word, at least 2;
    ``stride``: frames from word to word; ``joints``: "whole", "upper", "lower", "left" or "right"
    (:func:`joint_groups` of the clip), or numbers and names of joints; None for all of them.
    **Returns:** :class:`MotionWords`; none of a clip of fewer than N frames.
    **Raises:** ``ValueError`` for what is not one finite clip, numbers that make no words, joints
    that the skeleton does not have.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk = jm.samples.load("walk", fps=24.0).motion
        >>> jm.cleaning.motion_words(walk[:32], joints="lower").starts.tolist()
        [0, 5, 10, 15, 17]
    """
    motion = finite_clip("motion_words", motion, at_run_time=True)
    check_sizes("motion_words", length, stride)
    chosen = chosen_joints("motion_words", motion, joints)
    starts = word_starts(motion.num_frames, length, stride)
    frames = starts[:, None] + np.arange(length)
    rotations = texture(motion, chosen)[frames]
    return MotionWords(rotations, jnp.asarray(starts, jnp.int32), chosen)


def check_sizes(caller: str, length: int, stride: int) -> None:
    """``ValueError`` unless words can be so long, and so far from each other."""
    whole = all(isinstance(x, (int, np.integer)) for x in (length, stride))
    if not (whole and length >= 2 and stride >= 1):
        raise ValueError(
            f"{caller}: length={length}, stride={stride}; expected whole numbers, 2 and 1 at least"
        )


def chosen_joints(
    caller: str, motion: Motion, joints: str | Sequence[int | str] | None
) -> tuple[int, ...]:
    """The numbers of the joints that are meant."""
    skeleton = motion.skeleton
    if joints is None:
        return tuple(range(motion.body_joint, skeleton.num_joints))
    if isinstance(joints, str):
        one_of(f"{caller}: joints", joints, GROUPS)
        groups = joint_groups(motion)
        if joints not in groups:
            raise ValueError(f"{caller}: the skeleton has no group {joints!r}, only {[*groups]}")
        return groups[joints]
    found = tuple(skeleton.index(j) if isinstance(j, str) else int(j) for j in joints)
    if not found or not all(0 <= j < skeleton.num_joints for j in found):
        raise ValueError(
            f"{caller}: joints={joints}; expected one of {skeleton.num_joints} joints at least"
        )
    return found


def word_starts(frames: int, length: int, stride: int) -> Int[np.ndarray, " word"]:
    """Where words begin."""
    last = frames - length
    starts = np.arange(0, last + 1, stride)
    return np.append(starts, last) if last > 0 and last % stride else starts


def texture(
    motion: Motion, joints: tuple[int, ...], stands: Vector3 | None = None
) -> Float[Array, "time joint 4"]:
    """Rotations of the joints, the body's without its yaw; ``stands``: the axis of the body that
    points up, by default the one that does most of the time."""
    body, chosen = motion.body_joint, np.array(joints, int)
    # In NumPy if it can be: JAX would compile that for every length.
    rotations = known(motion.rotations)[:, chosen]
    if body not in joints:
        return jax.device_put(rotations)
    room = room_for(motion)
    leans = room.cut(_lean(room.fill(motion), upright(motion) if stands is None else stands))
    if traced(leans):
        return jnp.asarray(motion.rotations)[:, chosen].at[:, joints.index(body)].set(leans)
    rotations = np.array(rotations)
    rotations[:, joints.index(body)] = leans
    return jax.device_put(rotations)


@eqx.filter_jit
def _lean(motion: Motion, stands: Vector3) -> Float[Array, "time 4"]:
    return quaternion.exp(posture(motion, stands)[2])


def points(
    motion: Motion, joints: tuple[int, ...], stands: Vector3
) -> Float[Array, "time joint 6"]:
    """Positions of the joints as seen from the body's place on the ground and its yaw, and their
    velocities times 0.1 s, in the file's unit."""
    room = room_for(motion)
    seen = room.cut(_seen(room.fill(motion), stands, joints))
    return jax.device_put(np.asarray(seen))


@eqx.filter_jit
def _seen(motion: Motion, stands: Vector3, joints: tuple[int, ...]) -> Float[Array, "time joint 6"]:
    position, yaw, _ = posture(motion, stands)
    flat = 1 - jnp.asarray(axes_of(motion).up, motion.dtype)
    where = forward_kinematics(motion).positions[:, np.array(joints, int)]
    away = where - (position * flat)[:, None]
    moved = jnp.diff(where, axis=0) * (_PACE / motion.frame_time)
    moved = jnp.concatenate([moved[:1], moved]) if len(moved) else jnp.zeros_like(away)
    back = quaternion.conjugate(yaw)[:, None]
    return jnp.concatenate([quaternion.rotate(back, x) for x in (away, moved)], axis=-1)

"""Which axis a figure stands along.

Of up to 64 frames spread over the clip, lengths in units of the figure's height (the distance of
head and feet, the median over the frames), for each axis k of the world:

    posture   mean of (hips − feet)·k over mean of ‖hips − feet‖, and the same of head − feet
    sway_k    from the 5 % to the 50 % quantile of the lowest joint or end site's place along k
    way_k     range of the hips along k

The figure stands along k if its legs do (within 35°) and its head is above its feet (within 60°),
and k is also seen to be up by one of these, which a figure that lies or crawls along k lacks:

    floor     the lowest point keeps its level: sway_k ≤ 6 %, and at most half the sway along either
              other axis (a tenth where that is under 1 %; frozen, under 0.05 %, it says nothing)
    walk      the hips go a long way (way ≥ 75 %) across k, four times as far as along it, without
              rolling (turning round k by more than 150°)
    rest      nothing moves (sway ≤ 1 %), and the rest pose stands along k too

Feet, head by name; hips are the joint that the feet have in common. What the figure does not show
is not guessed: lying, crawling, seated, upside down, cameras, unknown names. NumPy, O(J).
"""

from typing import NamedTuple

import numpy as np

from jaxmotion._checks import traced
from jaxmotion._entry import one_clip
from jaxmotion._summary import line
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton, feet_by_name

_FRAMES = 64
_LEGS, _HEAD = np.cos(np.radians([35.0, 60.0]))
_LEVEL, _SHARE, _SHARE_OF_LITTLE = 0.06, 0.5, 0.1
_FAR, _FLAT, _ROLLS = 0.75, 0.25, np.radians(150.0)
_STILL, _FROZEN, _REST = 0.01, 5e-4, np.cos(np.radians(20.0))


class UpGuess(NamedTuple):
    """The axis that points up, as far as a motion shows it.

    **Fields:** ``axis``: "x", "y", "z", or None if the motion does not show it; ``reason``: why,
    for people: what it goes by, or what is missing.

    **Example:**

        >>> import jaxmotion as jm
        >>> axis, reason = jm.guess_up(jm.samples.load("walk").motion)
        >>> axis, reason
        ('y', 'it stands along y, on a level floor')
    """

    axis: str | None
    reason: str

    def __repr__(self) -> str:
        return line(self)


def guess_up(motion: Motion) -> UpGuess:
    """Guess the axis that points up from how the figure stands and moves.

    See the module for the rules; what the figure does not show is not guessed. NumPy, O(J).

    **Arguments:** ``motion``: one clip of known values; its ``skeleton.up`` is not looked at.
    **Returns:** an :class:`UpGuess`.
    **Raises:** ``ValueError`` for a traced motion, a batch, or no frames.

    **Example:**

        >>> import jaxmotion as jm
        >>> motion = jm.samples.load("walk").motion
        >>> jm.guess_up(motion).axis, jm.guess_up(jm.reorient(motion, "z")).axis
        ('y', 'z')
    """
    one_clip("guess_up", motion, on_host=True)
    if traced(motion.rotations):
        raise ValueError("guess_up: the motion is traced; guess outside of jit and vmap")
    if motion.num_frames == 0:
        raise ValueError("guess_up: the motion has no frames")
    feet, head = feet_by_name(motion.skeleton), _head(motion.skeleton)
    hips = _common_ancestor(motion.skeleton, feet)
    if not feet or head is None:
        return UpGuess(None, f"no {'head' if feet else 'feet'} by name")
    if hips is None or hips in feet:
        return UpGuess(None, "no hips above two feet")
    points, tips, rotations, rest = sampled_positions(motion)
    if not (np.isfinite(points).all() and np.isfinite(tips).all()):
        return UpGuess(None, "positions that are not finite")
    legs = points[:, hips] - points[:, feet].mean(axis=1)
    body = points[:, head] - points[:, feet].mean(axis=1)
    height = float(np.median(np.linalg.norm(body, axis=-1)))
    if not height > 0:
        return UpGuess(None, "a figure without height")
    k = int(np.argmax(_along(legs)))
    if _along(legs)[k] < _LEGS or _along(body)[k] < _HEAD:
        return UpGuess(None, "the figure stands along none of the axes")
    lowest = np.concatenate([points, tips], axis=1).min(axis=1) / height
    sway = np.subtract(*np.quantile(lowest, [0.5, 0.05], axis=0))
    way = np.ptp(points[:, hips], axis=0) / height
    others = [i for i in range(3) if i != k]
    axis = "xyz"[k]
    moves = sway[others].min()
    share = _SHARE if moves > _STILL else _SHARE_OF_LITTLE
    if sway[k] <= min(_LEVEL, share * moves) and moves > _FROZEN:
        return UpGuess(axis, f"it stands along {axis}, on a level floor")
    far = way[others].max()
    if far >= _FAR and way[k] <= _FLAT * far and _twist(rotations[:, hips], k) <= _ROLLS:
        return UpGuess(axis, f"it stands along {axis} and goes across it")
    rest_body = rest[head] - rest[list(feet)].mean(axis=0)
    if sway.max() <= _STILL and _along(rest_body[None])[k] >= _REST:
        return UpGuess(axis, f"it stands along {axis}, as its rest pose does")
    return UpGuess(None, f"it is stretched along {axis}, but may be lying")


def doubt_up(motion: Motion) -> str:
    """What speaks against the axis that ``motion.skeleton`` says points up.

    **Arguments:** ``motion``: as :func:`guess_up`.
    **Returns:** a sentence for people; "" if nothing speaks against it.
    **Raises:** as :func:`guess_up`.
    """
    guess, skeleton = guess_up(motion), motion.skeleton
    if guess.axis in (None, skeleton.up):
        return ""
    how = "" if skeleton.conventions.up == "told" else f" ({skeleton.conventions.up})"
    return f"{skeleton.up} points up{how}, but {guess.reason}; --up {guess.axis}?"


def _head(skeleton: Skeleton) -> int | None:
    named = (j for j, name in enumerate(skeleton.names) if "head" in name.lower())
    return next(named, None)


def _common_ancestor(skeleton: Skeleton, joints: tuple[int, ...]) -> int | None:
    """The lowest joint that all ``joints`` hang from."""
    shared: list[int] | None = None
    for joint in joints:
        chain = []
        while joint >= 0:
            chain.append(joint)
            joint = skeleton.parents[joint]
        shared = chain if shared is None else [j for j in shared if j in chain]
    return shared[0] if shared else None


def sampled_positions(motion: Motion):
    """Of some frames, world positions of joints f[F, J, 3] and end sites f[F, E, 3], and rotation
    matrices f[F, J, 3, 3]; the rest pose's positions f[J, 3]. In NumPy: a few frames are done
    before a compiler has begun."""
    frames = np.linspace(0, motion.num_frames - 1, _FRAMES).round().astype(int)
    positions = np.array(np.asarray(motion.translations)[frames], np.float64)
    rotations = _matrices(np.asarray(motion.rotations)[frames].astype(np.float64))
    rest = np.array(motion.skeleton.offsets, np.float64)
    for j, parent in enumerate(motion.skeleton.parents[1:], 1):
        above = rotations[:, parent]
        positions[:, j] = positions[:, parent] + (above @ positions[:, j, :, None])[..., 0]
        rotations[:, j] = above @ rotations[:, j]
        rest[j] += rest[parent]
    ends = list(motion.skeleton.end_joints)
    end_offsets = np.asarray(motion.skeleton.end_offsets, np.float64)
    tips = positions[:, ends] + (rotations[:, ends] @ end_offsets[:, :, None])[..., 0]
    return positions, tips, rotations, rest


def _matrices(q: np.ndarray) -> np.ndarray:
    """Rotation matrices f[..., 3, 3] of unit quaternions f[..., 4]: columns w²e + 2w(u×e) + …"""
    w, u = q[..., :1, None], q[..., None, 1:]
    e = np.eye(3)
    once = np.cross(u, e)
    return np.swapaxes(e + 2 * w * once + 2 * np.cross(u, once), -1, -2)


def _along(vectors: np.ndarray) -> np.ndarray:
    """Mean of vectors [F, 3] over their mean length: how far they agree on each axis, −1..1."""
    return vectors.mean(axis=0) / max(np.linalg.norm(vectors, axis=-1).mean(), 1e-300)


def _twist(rotations: np.ndarray, axis: int) -> float:
    """Range of the turn of rotations [F, 3, 3] about an axis of the world, radians."""
    since = rotations @ rotations[0].T
    i, j = (axis + 1) % 3, (axis + 2) % 3
    angle = np.arctan2(since[:, j, i] - since[:, i, j], since[:, i, i] + since[:, j, j])
    return float(np.ptp(np.unwrap(angle)))

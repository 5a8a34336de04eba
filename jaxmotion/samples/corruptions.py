"""Seeded damage to a whole clip, with the entries it touched.

    noise        q ← q ⊗ exp(ε n),  p ← p + s m,     n, m ~ N(0, I)
    drop         frames are lost; the last one kept is repeated
    slide        the root drifts along the floor, as skating feet do
    flip         q ← −q: the same rotation, another sign

Every corruption, here and in :mod:`jaxmotion.samples.joint_errors`, takes a
:class:`~jaxmotion.Motion` f[T, J, …] and a JAX key, is deterministic, and returns a
:class:`Corrupted`: the motion and mask bool[T, J] of the joints touched in each frame. What the
mask leaves out is bit-identical. Radians; lengths in the motion's unit. O(T·J).
"""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxmotion import quaternion
from jaxmotion._checks import one_number, require
from jaxmotion._entry import one_clip
from jaxmotion._file_facts import compiled
from jaxmotion._numerics import safe_norm
from jaxmotion._portable import Portable
from jaxmotion._types import Key, ScalarLike
from jaxmotion.motion import Motion


class Corrupted(Portable):
    """A damaged clip and what was damaged.

    **Fields:** ``motion``: the damaged clip, T frames; ``mask``: bool[T, J], True where it was
    touched; all else is bit-identical; ``change``: f[T, J], radians by which rotations were turned,
    0 also where it happens to change nothing.
    """

    motion: Motion
    mask: Bool[Array, "time joint"]
    change: Float[Array, "time joint"]

    @classmethod
    def of(cls, before: Motion, after: Motion, mask: Bool[Array, "time joint"]) -> "Corrupted":
        """The damaged clip with how far it is from what it was."""
        turned = quaternion.log(quaternion.between(before.rotations, after.rotations))
        return cls(after, mask, jnp.where(mask, safe_norm(turned), 0))

    def _words(self) -> Iterator[str]:
        return self.motion._words()


def add_noise(
    motion: Motion, key: Key, *, rotation: ScalarLike = 0.02, translation: ScalarLike = 0.0
) -> Corrupted:
    """White noise on every rotation and on the translations of the joints that have any.

    The mask tells all joints if ``rotation`` is not 0, and ``motion.translated_joints`` if
    ``translation`` is not.

    **Arguments:** ``motion``: one clip, T frames; ``key``: of JAX's random numbers; ``rotation``:
    standard deviation of each component, radians; ``translation``: the same in the file's unit.
    **Returns:** :class:`Corrupted`.
    **Raises:** ``ValueError`` for what is not one clip, a negative amount, at run time where it is
    traced.
    """
    motion = not_negative("add_noise", motion, rotation=rotation, translation=translation)
    kind = motion.dtype
    return _add_noise(motion, key, jnp.asarray(rotation, kind), jnp.asarray(translation, kind))


def drop_frames(motion: Motion, key: Key, *, rate: ScalarLike = 0.1) -> Corrupted:
    """Lose frames at random; each repeats the last frame kept. The first frame is never lost.

    The mask's rows tell which: ``mask[:, 0]``.

    **Arguments:** ``motion``: one clip, T frames; ``key``: of JAX's random numbers; ``rate``:
    probability that a frame is lost, from 0 to 1.
    **Returns:** :class:`Corrupted`.
    **Raises:** ``ValueError`` for what is not one clip, a rate out of range, at run time where it
    is traced.
    """
    motion = _with_share("drop_frames", motion, rate)
    return _drop(motion, key, jnp.asarray(rate, motion.dtype))


def slide_root(motion: Motion, key: Key, *, amount: ScalarLike = 0.1) -> Corrupted:
    """Let the root drift along the floor, so that planted feet skate.

    A constant velocity of random direction plus one slow seeded wave, along the two axes that are
    not ``skeleton.up``. Rotations stay.

    **Arguments:** ``motion``: one clip, T frames; ``key``: of JAX's random numbers; ``amount``:
    drift at the last frame, as a fraction of the skeleton's longest chain from the root (about the
    height from the hips to the hands or toes).
    **Returns:** :class:`Corrupted`; the mask tells the root.
    **Raises:** ``ValueError`` for what is not one clip, a negative amount, at run time where it is
    traced.
    """
    motion = not_negative("slide_root", motion, amount=amount)
    return _slide(motion, key, jnp.asarray(amount, motion.dtype))


def flip_signs(motion: Motion, key: Key, *, rate: ScalarLike = 0.05) -> Corrupted:
    """Negate quaternions at random: the rotations stay the same, as after careless conversions.

    **Arguments:** ``motion``: one clip, T frames; ``key``: of JAX's random numbers; ``rate``:
    probability that an entry is negated, from 0 to 1.
    **Returns:** :class:`Corrupted`.
    **Raises:** ``ValueError`` for what is not one clip, a rate out of range, at run time where it
    is traced.
    """
    motion = _with_share("flip_signs", motion, rate)
    return _flip(motion, key, jnp.asarray(rate, motion.dtype))


@compiled
def _add_noise(motion, key, rotation, translation):
    q, p = motion.rotations, motion.translations
    noise = jax.random.normal(key, (*q.shape[:-1], 6), q.dtype)
    noise, shift = noise[..., :3], noise[..., 3:]
    turned = jnp.broadcast_to(rotation != 0, q.shape[:-1])
    moved = jnp.zeros(motion.num_joints, bool).at[np.array(motion.translated_joints, int)].set(True)
    moved = jnp.broadcast_to(moved & (translation != 0), q.shape[:-1])
    return Corrupted.of(
        motion,
        motion.with_transforms(
            jnp.where(moved[..., None], p + translation * shift, p),
            jnp.where(
                turned[..., None], quaternion.multiply(q, quaternion.exp(rotation * noise)), q
            ),
        ),
        turned | moved,
    )


@compiled
def _drop(motion, key, rate):
    frames = jnp.arange(motion.num_frames)
    lost = (jax.random.uniform(key, frames.shape, motion.dtype) < rate) & (frames > 0)
    kept = jax.lax.cummax(jnp.where(lost, 0, frames))
    mask = jnp.broadcast_to(lost[:, None], motion.rotations.shape[:2])
    lost_to = motion.with_transforms(motion.translations[kept], motion.rotations[kept])
    return Corrupted.of(motion, lost_to, mask)


@compiled
def _slide(motion, key, amount):
    kind, skeleton = motion.dtype, motion.skeleton
    depth = [jnp.zeros((), kind)]
    lengths = jnp.linalg.norm(jnp.asarray(skeleton.offsets, kind), axis=-1)
    for j, parent in enumerate(skeleton.parents[1:], 1):
        depth.append(depth[parent] + lengths[j])
    size = jnp.max(jnp.stack(depth)) * amount
    heading, phase = jax.random.uniform(key, (2,), kind, 0, 2 * jnp.pi)
    u = jnp.arange(1, motion.num_frames + 1, dtype=kind) / motion.num_frames
    forward, across = u * size, 0.25 * size * (jnp.sin(2 * jnp.pi * u + phase) - jnp.sin(phase))
    first, second = (a for a in range(3) if a != skeleton.up_axis)
    cos, sin = jnp.cos(heading), jnp.sin(heading)
    drift = jnp.zeros((motion.num_frames, 3), kind)
    drift = drift.at[:, first].set(cos * forward - sin * across)
    drift = drift.at[:, second].set(sin * forward + cos * across)
    moved = motion.translations.at[:, 0].add(drift)
    mask = jnp.zeros(motion.rotations.shape[:2], bool).at[:, 0].set(size > 0)
    return Corrupted.of(motion, motion.with_transforms(moved), mask)


@compiled
def _flip(motion, key, rate):
    mask = jax.random.uniform(key, motion.rotations.shape[:-1], motion.dtype) < rate
    return replace_where(motion, mask, -motion.rotations)


def replace_where(motion, mask, rotations) -> Corrupted:
    """The clip with ``rotations`` where the mask is set, and untouched elsewhere."""
    kept = jnp.where(mask[..., None], rotations, motion.rotations)
    return Corrupted.of(motion, motion.with_transforms(rotations=kept), mask)


def not_negative(who: str, motion: Motion, **amounts: ScalarLike) -> Motion:
    """The motion, one clip, unless an amount is no number of 0 or more."""
    one_clip(who, motion)
    for name, value in amounts.items():
        wrong = ~(one_number(f"{who}: {name}", value) >= 0)
        motion = require(motion, wrong, f"{who}: {name} must be 0 or more", got=value)
    return motion


def _with_share(who: str, motion: Motion, rate: ScalarLike) -> Motion:
    one_clip(who, motion)
    share = one_number(f"{who}: rate", rate)
    wrong = ~((share >= 0) & (share <= 1))
    return require(motion, wrong, f"{who}: rate must be a share from 0 to 1", got=rate)

"""Seeded errors of single joints over runs of frames, with the entries they touched.

    offset       q ← q ⊗ exp(v) over a run of frames, ‖v‖ in ``magnitude``; with a ramp, exp(w v),
                 where w goes up from 0 as ½ − ½cos at the run's beginning, and down at its end
    spike        the same in single frames
    limit        the rotation vector's part along the joint's own widest direction is pushed
                 ``excess`` beyond the widest it goes in this clip, over a run
    freeze       a joint keeps the rotation it has as a run begins, with noise on it if asked
    gap          a joint goes the short way, at one speed, from the frame before a run to the one
                 after it: a gap that was filled
    swap         left and right joints exchange rotations over a run

Runs are drawn with replacement: where two fall on one entry, the first drawn wins. A run that
reaches beyond the last frame is cut there. Takes and returns what
:mod:`jaxmotion.samples.corruptions` says. Radians. O(R·T·J) for R runs.

The set is the one Aristidou et al. 2018, §5, describe in words; the magnitudes are ours.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmotion import quaternion
from jaxmotion._checks import one_number, require, static, traced
from jaxmotion._entry import one_clip
from jaxmotion._file_facts import compiled
from jaxmotion._numerics import safe_norm
from jaxmotion._types import Key, ScalarLike
from jaxmotion.motion import Motion
from jaxmotion.samples.corruptions import Corrupted, replace_where
from jaxmotion.samples.error_runs import (
    Runs,
    check_range,
    check_runs,
    draw_runs,
    scaled,
    turn_vectors,
)
from jaxmotion.skeleton import Skeleton


@static("runs", "ramp")
def offset_joints(
    motion: Motion,
    key: Key,
    *,
    runs: int = 8,
    magnitude: tuple[float | int, float | int] = (0.5, 1.5),
    length: tuple[int, int] = (5, 30),
    joints: Sequence[int] | None = None,
    ramp: int = 0,
) -> Corrupted:
    """Turn a joint by a constant rotation, in its own frame, over each of ``runs`` runs.

    **Arguments:** ``motion``: one clip, T frames; ``key``: of JAX's random numbers; ``runs``: how
    many, at least 1; ``magnitude``: least and greatest angle, radians; ``length``: least and
    greatest number of frames, both included; ``joints``: indices of those that may be hit, all but
    the root when absent; ``ramp``: frames over which the turn comes and goes, as of sensors that
    drift away and back; 0 for an edge.
    **Returns:** :class:`Corrupted`.
    **Raises:** ``ValueError`` for what is not one clip, fewer than one run, bounds that are not in
    order, negative angles, runs of less than a frame, no joints, joints that the skeleton does not
    have, or a negative ramp.
    """
    joints = check_runs("offset_joints", motion, runs, length, joints)
    check_range("offset_joints", "magnitude", magnitude)
    if not isinstance(ramp, (int, np.integer)) or ramp < 0:
        raise ValueError(f"offset_joints: ramp={ramp!r}; expected a number of frames, 0 or more")
    return _offset(motion, key, runs, magnitude, length, joints, int(ramp))


@static("count")
def add_spikes(
    motion: Motion,
    key: Key,
    *,
    count: int = 10,
    magnitude: tuple[float | int, float | int] = (0.5, 1.5),
    joints: Sequence[int] | None = None,
) -> Corrupted:
    """Turn a joint by a rotation, in its own frame, in a single frame, ``count`` times.

    **Arguments:** ``count``: how many, at least 1; ``motion``, ``key``, ``magnitude``, ``joints``:
    as :func:`offset_joints`.
    **Returns:** :class:`Corrupted`.
    **Raises:** ``ValueError`` as :func:`offset_joints`.
    """
    joints = check_runs("add_spikes", motion, count, (1, 1), joints, name="count")
    check_range("add_spikes", "magnitude", magnitude)
    return _offset(motion, key, count, magnitude, (1, 1), joints, 0)


@static("runs")
def violate_limits(
    motion: Motion,
    key: Key,
    *,
    runs: int = 4,
    excess: tuple[float | int, float | int] = (0.3, 0.8),
    length: tuple[int, int] = (5, 30),
    joints: Sequence[int] | None = None,
) -> Corrupted:
    """Push a joint beyond the range it has in this clip, over each of ``runs`` runs.

    With v the rotation vector from the joint's first pose and e the direction of the longest v of
    the clip, v·e becomes max(v·e) + ``excess`` and the rest of v stays.

    **Arguments:** ``excess``: least and greatest, radians; ``motion``, ``key``, ``runs``,
    ``length``, ``joints``: as :func:`offset_joints`.
    **Returns:** :class:`Corrupted`.
    **Raises:** ``ValueError`` as :func:`offset_joints`.
    """
    joints = check_runs("violate_limits", motion, runs, length, joints)
    check_range("violate_limits", "excess", excess)
    return _violate_limits(motion, key, runs, excess, length, joints)


@static("runs")
def freeze_joints(
    motion: Motion,
    key: Key,
    *,
    runs: int = 4,
    length: tuple[int, int] = (5, 30),
    joints: Sequence[int] | None = None,
    noise: ScalarLike = 0.0,
) -> Corrupted:
    """Hold a joint at the rotation of a run's first frame for the frames that follow it.

    **Arguments:** ``length``: frames held, the first not counted, least and greatest; ``noise``:
    standard deviation of a Gaussian turn on every held frame, radians about each axis; ``motion``,
    ``key``, ``runs``, ``joints``: as :func:`offset_joints`.
    **Returns:** :class:`Corrupted`.
    **Raises:** ``ValueError`` as :func:`offset_joints`; for a negative ``noise``, at run time if
    traced.
    """
    joints = check_runs("freeze_joints", motion, runs, length, joints)
    sigma = one_number("freeze_joints: noise", noise)
    motion = require(motion, ~(sigma >= 0), "freeze_joints: noise must be 0 or more", got=noise)
    shaken = None if not traced(noise) and sigma == 0 else jnp.asarray(noise, motion.dtype)
    return _freeze(motion, key, runs, length, joints, shaken)


@static("runs")
def fill_gaps(
    motion: Motion,
    key: Key,
    *,
    runs: int = 4,
    length: tuple[int, int] = (12, 30),
    joints: Sequence[int] | None = None,
) -> Corrupted:
    """Have a joint go the short way from the frame before a run to the one after it, as where what
    a camera did not see was filled.

    A run that reaches the last frame ends there, and nothing is filled in clips of two frames.

    **Arguments:** ``motion``, ``key``, ``runs``, ``length``, ``joints``: as :func:`offset_joints`.
    **Returns:** :class:`Corrupted`.
    **Raises:** ``ValueError`` as :func:`offset_joints`.
    """
    joints = check_runs("fill_gaps", motion, runs, length, joints)
    return _fill(motion, key, runs, length, joints)


@static("runs")
def swap_limbs(
    motion: Motion,
    key: Key,
    *,
    runs: int = 1,
    length: tuple[int, int] = (5, 30),
    pairs: Sequence[tuple[int, int]] | None = None,
) -> Corrupted:
    """Exchange the rotations of left and right joints, as mixed-up channels do, over runs.

    **Arguments:** ``pairs``: indices of joints to exchange, all together; when absent, every
    "Left…" with its "Right…"; ``motion``, ``key``, ``runs``, ``length``: as :func:`offset_joints`.
    **Returns:** :class:`Corrupted`.
    **Raises:** ``ValueError`` as :func:`offset_joints`, for a joint named twice, or if no pair is
    given and none is found by name.
    """
    one_clip("swap_limbs", motion)
    chosen = _pairs_by_name(motion.skeleton) if pairs is None else [tuple(p) for p in pairs]
    if not chosen:
        raise ValueError("swap_limbs: no joints called Left… and Right…; give pairs=[(i, j), …]")
    both = [j for pair in chosen for j in pair]
    count = motion.num_joints
    if any(len(pair) != 2 for pair in chosen) or not all(0 <= j < count for j in both):
        raise ValueError(
            f"swap_limbs: pairs={chosen!r}; expected pairs of joints from 0 to {count - 1}"
        )
    if len(set(both)) != len(both):
        raise ValueError(f"swap_limbs: pairs={chosen!r} names a joint twice")
    check_runs("swap_limbs", motion, runs, length, both)
    partner = np.arange(motion.num_joints)
    for i, j in chosen:
        partner[i], partner[j] = j, i
    return _swap(motion, key, runs, length, tuple(int(j) for j in partner))


@static("runs")
def inject_errors(
    motion: Motion,
    key: Key,
    *,
    runs: int = 3,
    length: tuple[int, int] = (5, 30),
    joints: Sequence[int] | None = None,
) -> Corrupted:
    """Offsets, limit violations, frozen joints and spikes together, ``runs`` of each.

    The magnitudes are the defaults of each; spikes last a frame, whatever ``length`` is.

    **Arguments:** ``motion``, ``key``, ``runs``, ``length``, ``joints``: as :func:`offset_joints`.
    **Returns:** :class:`Corrupted`.
    **Raises:** ``ValueError`` as :func:`offset_joints`.
    """
    joints = check_runs("inject_errors", motion, runs, length, joints)
    offsets, limits, frozen, spikes = jax.random.split(key, 4)
    damaged = offset_joints(motion, offsets, runs=runs, length=length, joints=joints)
    mask = damaged.mask
    for damage in (
        lambda m: violate_limits(m, limits, runs=runs, length=length, joints=joints),
        lambda m: freeze_joints(m, frozen, runs=runs, length=length, joints=joints),
        lambda m: add_spikes(m, spikes, count=runs, joints=joints),
    ):
        damaged = damage(damaged.motion)
        mask = mask | damaged.mask
    return Corrupted.of(motion, damaged.motion, mask)


@compiled
def _offset(motion, key, runs, magnitude, length, joints, ramp):
    drawn = draw_runs(motion, key, runs, length, joints)
    v = turn_vectors(drawn, magnitude)
    turn = quaternion.exp(_ramped(drawn, ramp, motion)[..., None] * v)
    return replace_where(motion, drawn.hit, quaternion.multiply(motion.rotations, turn))


def _ramped(drawn: Runs, ramp: int, motion: Motion) -> Array:
    """w of every frame and joint: 1 in the middle of runs that are longer than both ramps."""
    t = jnp.arange(motion.num_frames)[:, None]
    before, after = t + 1 - drawn.spread(drawn.start), drawn.spread(drawn.stop) - t
    way = jnp.minimum(before, after).astype(motion.dtype) / (ramp + 1)
    return 0.5 - 0.5 * jnp.cos(jnp.pi * jnp.clip(way, 0, 1))


@compiled
def _violate_limits(motion, key, runs, excess, length, joints):
    drawn = draw_runs(motion, key, runs, length, joints)
    v = quaternion.log(quaternion.between(motion.rotations[:1], motion.rotations))
    widest = jnp.argmax(jnp.sum(v * v, axis=-1), axis=0)
    e = jnp.take_along_axis(v, widest[None, :, None], axis=0)
    norm = safe_norm(e, keepdims=True)
    zero = norm < float(jnp.finfo(v.dtype).eps) ** 0.5
    e = jnp.where(zero, jnp.array([1, 0, 0], v.dtype), e / jnp.where(zero, 1, norm))
    along = jnp.sum(v * e, axis=-1)
    goal = jnp.max(along, axis=0) + drawn.spread(scaled(drawn.spare[:, 0], excess))
    beyond = quaternion.exp(v + (goal - along)[..., None] * e)
    return replace_where(motion, drawn.hit, quaternion.multiply(motion.rotations[:1], beyond))


@compiled
def _freeze(motion, key, runs, length, joints, shaken):
    drawn = draw_runs(motion, key, runs, length, joints, earliest=1)
    _, held = _of_run(motion, drawn, drawn.start - 1)
    if shaken is not None:
        shape = (*drawn.hit.shape, 3)
        turn = jax.random.normal(jax.random.fold_in(key, 1), shape, motion.dtype)
        held = quaternion.multiply(held, quaternion.exp(shaken * turn))
    return replace_where(motion, drawn.hit, held)


def _of_run(motion: Motion, drawn: Runs, frames: Array) -> tuple[Array, Array]:
    """A frame of each run, for every frame and joint, and the joint's rotation there."""
    at = jnp.broadcast_to(drawn.spread(frames), drawn.hit.shape)
    at = jnp.clip(at, 0, motion.num_frames - 1)
    return at, jnp.take_along_axis(motion.rotations, at[..., None], axis=0)


@compiled
def _fill(motion, key, runs, length, joints):
    drawn = draw_runs(motion, key, runs, length, joints, earliest=1)
    t = jnp.arange(motion.num_frames)[:, None]
    before, first = _of_run(motion, drawn, drawn.start - 1)
    after, final = _of_run(motion, drawn, drawn.stop)
    way = (t - before).astype(motion.dtype) / jnp.maximum(after - before, 1).astype(motion.dtype)
    filled = quaternion.slerp(first, final, jnp.clip(way, 0, 1))
    return replace_where(motion, drawn.hit & (t < after), filled)


@compiled
def _swap(motion, key, runs, length, partner):
    partner = np.array(partner)
    hit = draw_runs(motion, key, runs, length, (0,)).hit[:, :1]
    mask = hit & jnp.asarray(partner != np.arange(len(partner)))
    return replace_where(motion, mask, motion.rotations[:, partner])


def _pairs_by_name(skeleton: Skeleton):
    names = {name: j for j, name in enumerate(skeleton.names)}
    return [
        (j, names[name.replace("Left", "Right")])
        for name, j in names.items()
        if "Left" in name and name.replace("Left", "Right") in names
    ]

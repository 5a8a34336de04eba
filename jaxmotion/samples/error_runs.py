"""Runs of frames of single joints, drawn at random: where errors are."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmotion._entry import one_clip


class Runs(NamedTuple):
    """``cover`` bool[R, T, J]; ``start``, ``stop`` int[R], the first frame and the one after the
    last; ``spare`` f[R, 3] in [0, 1)."""

    cover: Array
    start: Array
    stop: Array
    spare: Array

    @property
    def hit(self):
        return jnp.any(self.cover, axis=0)

    def spread(self, values):
        """A value of each run, R first, where the first run to cover an entry rules: [T, J, …]."""
        return values[jnp.argmax(self.cover, axis=0)]


def draw_runs(motion, key, runs, length, joints, earliest=0) -> Runs:
    """All that is random comes from one draw: it is what takes long to compile."""
    frames, (low, high) = motion.num_frames, length
    u = jax.random.uniform(key, (6, runs), motion.dtype)
    joint = jnp.asarray(np.array(joints))[_pick(u[0], len(joints))]
    start = earliest + _pick(u[1], max(frames - low - earliest, 0) + 1)
    stop = start + low + _pick(u[2], high - low + 1)
    t = jnp.arange(frames)
    during = (t >= start[:, None]) & (t < stop[:, None])
    mine = jnp.arange(motion.num_joints) == joint[:, None, None]
    return Runs(during[..., None] & mine, start, stop, u[3:].T)


def _pick(u, count: int):
    """Whole numbers 0 … count − 1 from uniform ones in [0, 1)."""
    return jnp.minimum((u * count).astype(int), count - 1)


def scaled(u, bounds):
    """Numbers between the bounds, of uniform ones in [0, 1)."""
    return bounds[0] + (bounds[1] - bounds[0]) * u


def turn_vectors(drawn: Runs, bounds):
    """A rotation vector of each run, its length between the bounds, where it rules: [T, J, 3]."""
    height, around = 2 * drawn.spare[:, 0] - 1, 2 * jnp.pi * drawn.spare[:, 1]
    flat = jnp.sqrt(1 - height * height)  # Archimedes: uniform on the sphere
    axis = jnp.stack([flat * jnp.cos(around), flat * jnp.sin(around), height], axis=-1)
    return drawn.spread(axis * scaled(drawn.spare[:, 2:], bounds))


def check_range(who, name, pair):
    """``ValueError`` unless the pair is in order and not negative."""
    if len(pair) != 2 or not 0 <= pair[0] <= pair[1]:
        raise ValueError(f"{who}: {name}={pair!r}; expected (least, greatest), both at least 0")


def check_runs(who, motion, runs, length, joints, name="runs") -> tuple[int, ...]:
    """The joints that may be hit; ``ValueError`` for numbers that make no runs."""
    one_clip(who, motion)
    if not isinstance(runs, (int, np.integer)) or runs < 1:
        raise ValueError(f"{who}: {name}={runs!r}; expected a whole number of at least 1")
    if len(length) != 2 or not 1 <= length[0] <= length[1]:
        raise ValueError(f"{who}: length={length!r}; expected (least, greatest) frames, from 1 up")
    count = motion.num_joints
    if joints is None:
        return tuple(range(1, count)) or (0,)
    chosen = tuple(int(j) for j in joints)
    if not chosen or not all(0 <= j < count for j in chosen):
        raise ValueError(f"{who}: joints={joints!r}; expected indices from 0 to {count - 1}")
    return chosen

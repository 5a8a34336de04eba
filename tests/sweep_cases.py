"""The cases of the sweep: clips at the places where motion code breaks, and steps from there."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PRNGKeyArray

from jaxmotion import Motion, Skeleton
from jaxmotion.contacts import ContactPoints, Contacts
from tests.helpers import world_by_matrices

DTYPES = ("float64", "float32")
CASES = (
    "plain",
    "identity",
    "signs",
    "pi",
    "opposite",
    "still",
    "constant",
    "T1",
    "T2",
    "T3",
    "joint1",
    "joints200",
    "soft",
    "stiff",
    "fps24",
    "fps240",
    "far",
)


class Case(eqx.Module):
    """All arguments a recipe may want; three clips f[T, J, …] of one skeleton."""

    motion: Motion
    other: Motion
    third: Motion
    contacts: Contacts
    vectors: Array  # f[T, J, 3], rotation vectors
    weights: Array  # f[T], between 0.2 and 0.9
    times: Array  # f[T], uneven
    lam: Array
    sigma: Array
    key: PRNGKeyArray

    @property
    def q(self):
        return self.motion.rotations

    @property
    def o(self):
        return self.other.rotations

    @property
    def p(self):
        return self.motion.translations

    @property
    def x(self):
        return self.p.reshape(len(self.p), -1)

    @property
    def y(self):
        return self.other.translations.reshape(len(self.p), -1)

    @property
    def dtype(self):
        return self.motion.dtype

    @property
    def frames(self):
        return len(self.p)

    @property
    def fps(self):
        return float(1 / self.motion.frame_time)


def _exp(v):
    """Rotation vectors to quaternions."""
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), 0.5 * v * np.sinc(angle / (2 * np.pi))], -1)


def _multiply(a, b):
    (s, u), (t, v) = ((x[..., :1], x[..., 1:]) for x in (a, b))
    real = s * t - np.sum(u * v, -1, keepdims=True)
    return np.concatenate([real, s * v + t * u + np.cross(u, v)], -1)


def _skeleton(joints) -> Skeleton:
    """Two legs of hip, knee and foot, and a chain of the joints that are left."""
    names = ["Hips", "LeftUpLeg", "LeftLeg", "LeftFoot", "RightUpLeg", "RightLeg", "RightFoot"]
    parents = [-1, 0, 1, 2, 0, 4, 5]
    down = [0.02, -0.42, 0.01]
    offsets = [[0, 0.9, 0], [0.1, -0.05, 0], down, down, [-0.1, -0.05, 0], down, down]
    for j in range(7, joints):
        names.append(f"Spine{j}")
        parents.append(0 if j == 7 else j - 1)
        offsets.append([0.01, 0.05, 0.02])
    ends = [3, 6] if joints > 1 else [0]
    return Skeleton(
        names[:joints],
        parents[:joints],
        np.asarray(offsets[:joints], np.float64),
        end_joints=ends,
        end_offsets=np.full((len(ends), 3), 0.1),
    )


def _clip(rng, skeleton, frames, fps):
    """Rotations of up to about a radian and a root that walks, both smooth in time."""
    time = np.arange(frames)[:, None, None] / 6
    joints = skeleton.num_joints
    size, phase = rng.normal(size=(2, joints, 3))
    v = 0.4 * size + 0.3 * np.sin(time + phase)
    sway = 0.1 * np.sin(2 * time + rng.uniform(0, 6, 3)) + time * [0, 0, 1]
    translations = np.tile(skeleton.offsets, (frames, 1, 1))
    translations[:, 0] += sway[:, 0]
    return Motion(skeleton, translations, _exp(v), np.float64(1 / fps), translated_joints=(0,))


@cache
def case(name: str, dtype: str) -> Case:
    """The arguments of one case."""
    rng = np.random.default_rng(0)
    frames = {"T1": 1, "T2": 2, "T3": 3, "joints200": 5}.get(name, 9)
    joints = {"joint1": 1, "joints200": 200}.get(name, 7)
    fps = {"fps24": 24, "fps240": 240}.get(name, 60)
    skeleton = _skeleton(joints)
    motion, other, third = (_clip(rng, skeleton, frames, fps) for _ in range(3))
    turns = rng.normal(size=(frames, joints, 3))
    axes = turns / np.linalg.norm(turns, axis=-1, keepdims=True)
    half_turns = _exp(np.pi * axes)
    half_turns[..., 0] = 0
    turns *= 0.5
    match name:
        case "identity":
            motion = motion.with_transforms(rotations=np.tile([1.0, 0, 0, 0], (frames, joints, 1)))
            turns = 0 * turns
        case "signs":
            other = motion
            flip = np.where((np.arange(frames) % 2 == 1)[:, None, None], -1.0, 1.0)
            motion = motion.with_transforms(rotations=flip * motion.rotations)
        case "pi":  # every rotation, about axes that change slowly
            q = motion.rotations * [0, 1, 1, 1]
            q /= np.linalg.norm(q, axis=-1, keepdims=True)
            motion = motion.with_transforms(rotations=q)
            turns = np.pi * axes
        case "opposite":  # pi from frame to frame, and from clip to clip
            q = motion.rotations.copy()
            q[1::2] = _multiply(q[: 2 * (frames // 2) : 2], half_turns[1::2])
            motion = motion.with_transforms(rotations=q)
            other = other.with_transforms(rotations=_multiply(q, half_turns))
        case "still":
            still = np.zeros(frames, int)
            motion = motion.with_transforms(motion.translations[still], motion.rotations[still])
            other = motion
        case "constant":
            q, p = motion.rotations.copy(), motion.translations.copy()
            q[:, ::2], p[..., 1] = q[:1, ::2], p[:1, :, 1]
            motion = motion.with_transforms(p, q)
        case "far":
            motion, other, third = (
                m.with_transforms(m.translations + 1e6 * (np.arange(joints) == 0)[:, None])
                for m in (motion, other, third)
            )
    product = {"soft": 1e-6, "stiff": 1e6}.get(name, 1.0)
    feet = (3, 6) if joints > 1 else (0,)
    points = ContactPoints(skeleton, feet)
    mask = np.ones((frames, len(feet)), bool)
    mask[frames // 2 :, 1:] = False
    target = world_by_matrices(motion)[0][:, feet].mean(0) + np.zeros((frames, 1, 1))
    made = Case(
        motion,
        other,
        third,
        Contacts(points, mask, target),
        jnp.asarray(turns),
        jnp.asarray(rng.uniform(0.2, 0.9, frames)),
        jnp.asarray(np.cumsum(rng.uniform(0.5, 1.5, frames))),
        jnp.asarray(np.sqrt(product)),
        jnp.asarray(np.sqrt(product)),
        jax.random.key(0),
    )
    return _cast(made, dtype)


def _cast(tree, dtype):
    def cast(x):
        x = x if isinstance(x, jax.Array) else np.asarray(x)
        return jnp.asarray(x, dtype if jnp.issubdtype(x.dtype, jnp.floating) else x.dtype)

    return jax.tree.map(cast, tree)


def direction(c: Case, seed: int) -> Case:
    """A random tangent of every floating-point leaf: of unit quaternions along the sphere, of
    scalars in proportion, of joints that are not translated the same in every frame."""
    rng = np.random.default_rng(seed)

    def tangent(x):
        if not jnp.issubdtype(x.dtype, jnp.floating):
            return x
        x, dtype = np.asarray(x, np.float64), x.dtype
        t = rng.standard_normal(x.shape)
        if _turns(x):
            t -= np.sum(t * x, -1, keepdims=True) * x
        return jnp.asarray(t * x if x.ndim == 0 else t, dtype)

    def as_translated(motion):
        t = np.array(motion.translations)
        t[:, 1:] = t[:1, 1:]
        return motion.with_transforms(jnp.asarray(t))

    made = jax.tree.map(tangent, c)
    return eqx.tree_at(
        lambda c: (c.motion, c.other, c.third),
        made,
        tuple(as_translated(m) for m in (made.motion, made.other, made.third)),
    )


def _turns(x) -> bool:
    unit = x.shape[-1:] == (4,)
    return unit and np.allclose(np.sum(np.square(np.asarray(x)), -1), 1, atol=1e-5)


def moved(x, t, step):
    """Leaves a step along their tangents; unit quaternions stay unit."""

    def along(x, t):
        y = np.asarray(x, np.float64) + step * np.asarray(t, np.float64)
        y = y / np.linalg.norm(y, axis=-1, keepdims=True) if _turns(x) else y
        return jnp.asarray(y, x.dtype)

    return jax.tree.map(along, x, t)

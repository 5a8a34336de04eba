"""A small scene for whole-clip constraints, and its cost posed in numpy for SciPy to minimise.

Kinematics of the oracle are by matrices; it shares no code with the library.
"""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from jaxmotion import Motion, Skeleton
from jaxmotion.contacts import ContactPoints, Contacts
from jaxmotion.spacetime import JointLimits, Weights
from tests.helpers import angle_between, quaternions_by, world_by_matrices

FRAMES, JOINTS = 6, 5
ACTIVE = (0, 1, 2, 3)  # joint 4 is above no contact point
WEIGHTS = Weights(position=1.0, floor=0.5, limits=0.7, size=1e-2, bend=1e-6, root=3.0)
FLOOR, RAMP = -1.75, 0.07


def case(dtype=np.float64, frames=FRAMES):
    """A two-bone leg below a root, moving smoothly, with an arm aside; one point on the foot's
    bone, one at the knee."""
    rng = np.random.default_rng(0)
    skeleton = Skeleton(
        ["root", "hip", "knee", "ankle", "arm"],
        [-1, 0, 1, 2, 0],
        np.array([[0, 0, 0], [0.2, 0, 0], [0, -1, 0], [0, -0.9, 0], [0, 1, 0]], dtype),
    )
    t = np.arange(frames)[:, None, None] / 30
    v = 0.3 * np.sin(6 * t + rng.uniform(0, 6, (1, JOINTS, 3)))
    q = quaternions_by(v)
    root = np.concatenate([1.0 * t[:, 0], 0 * t[:, 0], 0 * t[:, 0]], -1)
    motion = Motion.from_root(
        skeleton, jnp.asarray(root, dtype), jnp.asarray(q, dtype), np.asarray(1 / 30, dtype)
    )
    points = ContactPoints(skeleton, [3, 2], np.array([[0.1, -0.1, 0.2], [0, 0, 0]]))
    mask = np.zeros((frames, 2), bool)
    mask[frames // 3 : frames // 3 + 2, 0], mask[-1:, 1] = True, True
    positions = points.positions(motion)
    shift = jnp.asarray([[0.1, -0.05, 0.05], [0.03, 0.02, -0.02]], dtype)
    return motion, Contacts(points, mask, positions + shift)


def limits_of(dtype=np.float64):
    return JointLimits(np.full((JOINTS, 3), -0.15), np.full((JOINTS, 3), 0.2)).astype(dtype)


class Oracle:
    """E of the module's docstring."""

    def __init__(self, motion, contacts, limits, floor, weights=WEIGHTS):
        self.motion, self.contacts, self.limits, self.floor = motion, contacts, limits, floor
        self.weights, self.start = (
            weights,
            Rotation.from_quat(np.asarray(motion.rotations).reshape(-1, 4), scalar_first=True),
        )
        # Limits move the arm too, by itself.
        self.joints = list(ACTIVE if limits is None else range(JOINTS))
        self.translations = np.array(motion.translations)
        self.skeleton = SimpleNamespace(
            parents=motion.skeleton.parents, end_joints=(), end_offsets=np.zeros((0, 3))
        )
        self.offsets = np.asarray(contacts.point)
        self.dt, self.frames = float(motion.frame_time), motion.num_frames
        # Neither point has a limb of its own: half the longest chain.
        self.length = 0.5 * (0.2 + 1 + 0.9)
        self.goal, self.weight = self.goals()

    def points(self, motion):
        position, turn, _ = world_by_matrices(motion)
        return np.stack(
            [
                position[:, j] + turn[:, j] @ p
                for j, p in zip(self.contacts.joints, self.offsets, strict=True)
            ],
            1,
        )

    def goals(self):
        y, target = self.points(self.motion), np.asarray(self.contacts.target)
        mask = np.asarray(self.contacts.mask)
        goal, weight = y.copy(), np.zeros(mask.shape)
        for t, c in np.ndindex(mask.shape):
            held = np.flatnonzero(mask[:, c])
            border = held[np.argmin(np.abs(held - t))]
            u = min(abs(border - t) * self.dt / RAMP, 1)
            goal[t, c] += target[border, c] - y[border, c]
            weight[t, c] = 1 - 3 * u**2 + 2 * u**3
        return np.where(mask[..., None], target, goal), weight

    def moved(self, delta):
        turn = np.zeros((self.frames, JOINTS, 3))
        turn[:, self.joints] = delta[:, 3:].reshape(self.frames, -1, 3)
        q = (self.start * Rotation.from_rotvec(turn.reshape(-1, 3))).as_quat(scalar_first=True)
        translations = self.translations.copy()
        translations[:, 0] += self.length * delta[:, :3]
        q = q.reshape(self.frames, JOINTS, 4)
        return SimpleNamespace(skeleton=self.skeleton, translations=translations, rotations=q)

    def residuals(self, flat):
        delta, w = flat.reshape(self.frames, -1), self.weights
        motion = self.moved(delta)
        y = self.points(motion)
        parts = [np.sqrt(w.position * self.weight)[..., None] * (y - self.goal) / self.length]
        if self.floor is not None:
            parts.append(np.sqrt(w.floor) * np.maximum(self.floor - y[..., 1], 0) / self.length)
        if self.limits is not None:
            v = Rotation.from_quat(
                motion.rotations[:, self.joints].reshape(-1, 4), scalar_first=True
            )
            v = v.as_rotvec().reshape(self.frames, -1, 3)
            rows = self.joints
            lower, upper = np.asarray(self.limits.lower), np.asarray(self.limits.upper)
            parts.append(np.sqrt(w.limits) * (v - np.clip(v, lower[rows], upper[rows])))
        stiff = np.sqrt(np.where(np.arange(delta.shape[1]) < 6, w.root, 1.0))
        parts.append(np.sqrt(w.size) * stiff * delta)
        parts.append(np.sqrt(w.bend) / self.dt**2 * stiff * np.diff(delta, n=2, axis=0))
        return np.concatenate([np.ravel(part) for part in parts])

    def minimum(self, steps=100):
        start = np.zeros(self.frames * (3 + 3 * len(self.joints)))
        return least_squares(
            self.residuals, start, xtol=1e-13, ftol=1e-13, gtol=1e-11, max_nfev=steps
        )


def difference(a, b):
    turned = angle_between(a.rotations, b.rotations).max()
    return max(turned, np.abs(np.asarray(a.translations) - np.asarray(b.translations)).max())

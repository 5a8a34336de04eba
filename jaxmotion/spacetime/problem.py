"""The displacement of a clip's active joints, and everything asked of it, frame by frame.

    q_j = q0_j exp(delta_j),    p = p0 + L delta_p             delta (T, d): the displacement, body
    z = sqrt(W) delta                                          the unknown; W = stiffness
    E = 1/2 |rows|^2 + 1/2 z^T (A x I) z                       A: size and bend, see prior

rows: of all terms, one after the other (:mod:`jaxmotion.spacetime.terms`), of the frames that
count. K active joints: the points' joints and all their ancestors (nothing else moves a point), and
the root's position p, so d = 3 + 3K. L: a body length, which makes lengths comparable with radians.

The points' Jacobian is written out: turning joint j by w (world axes) moves a point y below it by
w x (y - x_j), with w = R_j J(delta_j) d delta_j, J the derivative of exp. O(T C d).
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion import quaternion
from jaxmotion.frames.count import frame_mask
from jaxmotion.kinematics import WorldPose, forward_kinematics
from jaxmotion.motion import Motion
from jaxmotion.quaternion.parts import parts_of, together
from jaxmotion.quaternion.tangent import jacobian
from jaxmotion.skeleton import Skeleton
from jaxmotion.spacetime.prior import Prior
from jaxmotion.spacetime.terms.term import Pose, Slopes, Term


def active_joints(parents: tuple[int, ...], joints: tuple[int, ...]) -> tuple[int, ...]:
    """The joints and all their ancestors, ascending, the root always among them."""
    found = {0}
    for j in joints:
        while j > 0:
            found.add(j)
            j = parents[j]
    return tuple(sorted(found))


def restrict(motion: Motion, joints: tuple[int, ...]) -> Motion:
    """The clip of those joints alone; with each joint must be its parent."""
    skeleton, rows = motion.skeleton, np.asarray(joints, int)
    parents = [-1] + [joints.index(skeleton.parents[j]) for j in joints[1:]]
    part = Skeleton(
        [skeleton.names[j] for j in joints], parents, skeleton.offsets[rows], up=skeleton.up
    )
    return Motion(part, motion.translations[:, rows], motion.rotations[:, rows], motion.frame_time)


class Problem(eqx.Module):
    """Everything that E depends on; ``start``: the clip of the active joints, K of them.

    ``joints``: each point's joint, an index into those; static. ``point``: its place on that joint;
    ``length``: L; ``stiffness``: f[d], sqrt(W); ``terms``: what is asked.
    """

    start: Motion
    joints: tuple[int, ...] = eqx.field(static=True)
    point: Float[Array, "point 3"]
    length: Float[Array, ""]
    stiffness: Float[Array, " d"]
    prior: Prior
    terms: tuple[Term, ...]

    @property
    def unmoved(self) -> Float[Array, "time d"]:
        """No displacement."""
        frames, d = self.start.num_frames, self.stiffness.shape[0]
        return jnp.zeros((frames, d), self.start.dtype)

    def turns(self, z: Float[Array, "time d"]) -> Float[Array, "time joint 3"]:
        """delta of the joints, rotation vectors."""
        return (z / self.stiffness)[:, 3:].reshape(z.shape[0], -1, 3)

    def motion(self, z: Float[Array, "time d"]) -> Motion:
        """The displaced clip of the active joints."""
        moved = self.start.translations.at[:, 0].add(self.length * (z / self.stiffness)[:, :3])
        turned = quaternion.multiply(self.start.rotations, quaternion.exp(self.turns(z)))
        return self.start.with_transforms(moved, turned)

    def displacement(self, motion: Motion) -> Float[Array, "time d"]:
        """z of a displaced clip; inverse of :meth:`motion` for turns of less than pi."""
        moved = (motion.translations[:, 0] - self.start.translations[:, 0]) / self.length
        turns = quaternion.log(quaternion.between(self.start.rotations, motion.rotations))
        delta = jnp.concatenate([moved, turns.reshape(moved.shape[0], -1)], axis=1)
        return self.stiffness * delta

    def rows(self, z: Float[Array, "time d"]) -> Float[Array, "time row"]:
        """What is asked of each frame by itself, term after term."""
        pose, _ = self._pose(self.motion(z))
        return self._rows(pose)

    def linearized(
        self, z: Float[Array, "time d"]
    ) -> tuple[Float[Array, "time row"], Float[Array, "time row d"]]:
        """``rows(z)`` and their Jacobian, frame by frame."""
        pose, world = self._pose(self.motion(z))
        turns = self.turns(z)
        slopes = Slopes(self._point_slopes(turns, pose, world), self.start.rotations, turns)
        none = jnp.zeros((z.shape[0], 0, z.shape[1]), z.dtype)
        parts = [term.jacobian(pose, slopes) for term in self.terms]
        jacobian = jnp.concatenate([none, *parts], axis=1) / self.stiffness
        return self._rows(pose), self.counted(jacobian)

    def _pose(self, motion: Motion) -> tuple[Pose, WorldPose]:
        world, rows = forward_kinematics(motion), np.asarray(self.joints, int)
        arms = quaternion.rotate(world.rotations[:, rows], self.point)
        return Pose(motion, world.positions[:, rows] + arms, self.length), world

    def _rows(self, pose: Pose) -> Float[Array, "time row"]:
        none = jnp.zeros((pose.points.shape[0], 0), pose.points.dtype)
        rows = jnp.concatenate([none, *(term.rows(pose) for term in self.terms)], axis=1)
        return self.counted(rows)

    def counted(self, x: Float[Array, "time *rest"], beyond=0.0) -> Float[Array, "time *rest"]:
        """x of the frames that count, of which alone something is asked."""
        if self.prior.count is None:
            return x
        counts = frame_mask(self.prior.count, len(x))
        return jnp.where(counts.reshape(-1, *[1] * (x.ndim - 1)), x, beyond)

    def _point_slopes(
        self, turns: Float[Array, "time joint 3"], pose: Pose, world: WorldPose
    ) -> Float[Array, "time point 3 d"]:
        """d points / d delta, in body lengths."""
        y = pose.points
        (frames, points), joints = y.shape[:2], turns.shape[1]
        spin = _spin(turns)  # (T, K, i, 3): turn of the body for each component of delta
        axes = quaternion.rotate(world.rotations[:, :, None], spin)
        arm = (y[:, :, None] - world.positions[:, None])[..., None, :]
        swing = jnp.cross(axes[:, None], arm)  # (T, C, K, i, 3)
        below = np.array([self._carries(j) for j in self.joints]).reshape(points, joints)
        swing = jnp.where(jnp.asarray(below)[None, :, :, None, None], swing, 0)
        swing = jnp.moveaxis(swing, -1, 2).reshape(frames, points, 3, 3 * joints)
        shift = jnp.broadcast_to(self.length * jnp.eye(3, dtype=y.dtype), (frames, points, 3, 3))
        return jnp.concatenate([shift, swing], axis=-1) / self.length

    def _carries(self, joint: int) -> list[bool]:
        chain = active_joints(self.start.skeleton.parents, (joint,))
        return [j in chain for j in range(self.start.num_joints)]


def _spin(turns: Float[Array, "time joint 3"]) -> Float[Array, "time joint 3 3"]:
    """Jr(delta) e_i: body rates of exp(delta) as each component changes."""
    v = parts_of(turns)
    one, none = jnp.ones_like(v[0]), jnp.zeros_like(v[0])
    units = ((one, none, none), (none, one, none), (none, none, one))
    return jnp.stack([together(jacobian(v, unit)) for unit in units], axis=2)

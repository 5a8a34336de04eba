"""The displacement of a clip's active joints, and everything asked of it, frame by frame.

    q_j = q0_j exp(delta_j),    p = p0 + L delta_p             delta (T, d): the displacement, body
    z = sqrt(W) delta                                          the unknown; W = stiffness
    rows   sqrt(a) (y_c(q) - goal_c) / L        contact points               3C a frame
           sqrt(b) max(floor - height_c, 0) / L                              C, with a floor
           sqrt(e) excess_j(q)                  joint limits                 3K, with limits
    E = 1/2 |rows|^2 + 1/2 z^T (A x I) z                       A: size and bend, see prior

K active joints: the points' joints and all their ancestors (nothing else moves a point), and the
root's position p, so d = 3 + 3K. L: a body length, which makes lengths comparable with radians.

The Jacobian of the rows is written out: turning joint j by w (world axes) moves a point below it by
w x (y - x_j), with w = R_j J(delta_j) d delta_j, J the derivative of exp. O(T C d) for all rows.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion import quaternion
from jaxmotion.kinematics import WorldPose, forward_kinematics
from jaxmotion.motion import Motion
from jaxmotion.quaternion.parts import parts_of, together
from jaxmotion.quaternion.tangent import jacobian
from jaxmotion.skeleton import Skeleton
from jaxmotion.spacetime.joint_limits import JointLimits
from jaxmotion.spacetime.prior import Prior


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

    ``joints``: each point's joint, an index into those; static. ``stiffness``: f[d], sqrt(W);
    ``length``: L; ``pull`` f[T, C], ``floor_pull``, ``limit_pull``: sqrt(a), sqrt(b), sqrt(e).
    """

    start: Motion
    joints: tuple[int, ...] = eqx.field(static=True)
    point: Float[Array, "point 3"]
    goal: Float[Array, "time point 3"]
    pull: Float[Array, "time point"]
    length: Float[Array, ""]
    stiffness: Float[Array, " d"]
    prior: Prior
    floor: Float[Array, ""] | None
    floor_pull: Float[Array, ""]
    limits: JointLimits | None
    limit_pull: Float[Array, ""]

    @property
    def still(self) -> Float[Array, "time d"]:
        """No displacement."""
        frames, d = self.start.num_frames, self.stiffness.shape[0]
        return jnp.zeros((frames, d), self.start.dtype)

    @property
    def up(self) -> int:
        """Which component is height."""
        return self.start.skeleton.up_axis

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

    def points(self, pose: WorldPose) -> Float[Array, "time point 3"]:
        """World positions of the contact points."""
        rows = np.asarray(self.joints, int)
        return pose.positions[:, rows] + quaternion.rotate(pose.rotations[:, rows], self.point)

    def rows(self, z: Float[Array, "time d"]) -> Float[Array, "time row"]:
        """What is asked of each frame by itself."""
        motion = self.motion(z)
        return self._rows(motion, self.points(forward_kinematics(motion)))

    def _rows(self, motion: Motion, y: Float[Array, "time point 3"]) -> Array:
        frames, points = y.shape[:2]
        parts = [(self.pull[..., None] * (y - self.goal) / self.length).reshape(frames, 3 * points)]
        if self.floor is not None:
            depth = jnp.maximum(self.floor - y[..., self.up], 0)
            parts.append(self.floor_pull * depth / self.length)
        if self.limits is not None:
            excess = self.limits.excess(motion.rotations)
            parts.append(self.limit_pull * excess.reshape(frames, 3 * motion.num_joints))
        return jnp.concatenate(parts, axis=1)

    def linearized(
        self, z: Float[Array, "time d"]
    ) -> tuple[Float[Array, "time row"], Float[Array, "time row d"]]:
        """``rows(z)`` and their Jacobian, frame by frame."""
        motion = self.motion(z)
        pose = forward_kinematics(motion)
        y = self.points(pose)
        return self._rows(motion, y), self._jacobian(z, pose, y)

    def _jacobian(
        self, z: Float[Array, "time d"], pose: WorldPose, y: Float[Array, "time point 3"]
    ) -> Float[Array, "time row d"]:
        (frames, points), joints = y.shape[:2], pose.positions.shape[1]
        spin = _spin(self.turns(z))  # (T, K, i, 3): turn of the body for each component of delta
        axes = quaternion.rotate(pose.rotations[:, :, None], spin)
        arm = (y[:, :, None] - pose.positions[:, None])[..., None, :]
        swing = jnp.cross(axes[:, None], arm)  # (T, C, K, i, 3)
        below = np.array([self._carries(j) for j in self.joints]).reshape(points, joints)
        swing = jnp.where(jnp.asarray(below)[None, :, :, None, None], swing, 0)
        swing = jnp.moveaxis(swing, -1, 2).reshape(frames, points, 3, 3 * joints)
        shift = jnp.broadcast_to(self.length * jnp.eye(3, dtype=y.dtype), (frames, points, 3, 3))
        moved = jnp.concatenate([shift, swing], axis=-1) / self.length
        parts = [(self.pull[..., None, None] * moved).reshape(frames, 3 * points, 3 + 3 * joints)]
        if self.floor is not None:
            sunk = jnp.where(y[..., self.up] < self.floor, -self.floor_pull, 0)
            parts.append(sunk[..., None] * moved[:, :, self.up])
        if self.limits is not None:
            parts.append(self.limit_pull * self._excess_jacobian(z))
        return jnp.concatenate(parts, axis=1) / self.stiffness

    def _carries(self, joint: int) -> list[bool]:
        chain = active_joints(self.start.skeleton.parents, (joint,))
        return [j in chain for j in range(self.start.num_joints)]

    def _excess_jacobian(self, z: Float[Array, "time d"]) -> Float[Array, "time row d"]:
        limits, start = self.limits, self.start.rotations
        assert limits is not None

        def excess(turns):
            return limits.excess(quaternion.multiply(start, quaternion.exp(turns)))

        slope = _by_component(excess, self.turns(z))  # (T, K, i, 3)
        frames, joints = slope.shape[:2]
        apart = jnp.eye(joints, dtype=z.dtype)[:, None, :, None]
        square = apart * jnp.swapaxes(slope, -1, -2)[:, :, :, None]  # (T, K, 3, K', i)
        square = square.reshape(frames, 3 * joints, 3 * joints)
        return jnp.pad(square, ((0, 0), (0, 0), (3, 0)))


def _spin(turns: Float[Array, "time joint 3"]) -> Float[Array, "time joint 3 3"]:
    """Jr(delta) e_i: body rates of exp(delta) as each component changes."""
    v = parts_of(turns)
    one, none = jnp.ones_like(v[0]), jnp.zeros_like(v[0])
    units = ((one, none, none), (none, one, none), (none, none, one))
    return jnp.stack([together(jacobian(v, unit)) for unit in units], axis=2)


def _by_component(function, x: Float[Array, "time joint 3"]) -> Array:
    """Derivatives of an elementwise function in each component of x: (T, K, i, ...)."""
    steps = jnp.eye(3, dtype=x.dtype)
    slopes = [jax.jvp(function, (x,), (jnp.broadcast_to(steps[i], x.shape),))[1] for i in range(3)]
    return jnp.stack(slopes, axis=2)

"""What a constraint on a whole clip is: rows that shall vanish, frame by frame.

    E = 1/2 sum_terms |rows(pose)|^2 + ..      pose: the clip displaced by delta
    J = rows' (delta)                          by hand, from the slopes of what the rows are made of

:class:`Pose` and :class:`Slopes` hold what several terms need, worked out once for all of them: the
points' places, and how those move with delta. A term sees nothing else of the solver.

Shapes: T frames; K joints of the pose; C points; d = 3 + 3K, the root's displacement in body
lengths and the joints' rotation vectors, radians; r rows of a term a frame, a number that does not
depend on values.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxmotion import quaternion
from jaxmotion._types import Quaternion
from jaxmotion.motion import Motion
from jaxmotion.spacetime.joint_limits import JointLimits


class Pose(eqx.Module):
    """The displaced clip of K joints; ``points``: in the world; ``length``: of the body."""

    motion: Motion
    points: Float[Array, "time point 3"]
    length: Float[Array, ""]


class Slopes(eqx.Module):
    """How a pose changes with delta.

    ``points``: d points / d delta, in body lengths; ``start``, ``turns``: the rotations q0 and
    rotation vectors delta_j of which the pose's are q0 exp(delta_j).
    """

    points: Float[Array, "time point 3 d"]
    start: Float[Array, "time joint 4"]
    turns: Float[Array, "time joint 3"]

    def by_joint(
        self, function: Callable[[Quaternion], Float[Array, "time joint 3"]]
    ) -> Float[Array, "time row d"]:
        """Jacobian of three rows a joint that depend on that joint's local rotation alone."""

        def turned(turns):
            return function(quaternion.multiply(self.start, quaternion.exp(turns)))

        slope = _by_component(turned, self.turns)  # (T, K, i, 3)
        frames, joints = slope.shape[:2]
        apart = jnp.eye(joints, dtype=slope.dtype)[:, None, :, None]
        square = apart * jnp.swapaxes(slope, -1, -2)[:, :, :, None]  # (T, K, 3, K', i)
        square = square.reshape(frames, 3 * joints, 3 * joints)
        return jnp.pad(square, ((0, 0), (0, 0), (3, 0)))


class Term(eqx.Module):
    """One constraint, of all joints of a clip or of some."""

    @abstractmethod
    def rows(self, pose: Pose) -> Float[Array, "time row"]:
        """What shall vanish, each row times the square root of its weight."""

    @abstractmethod
    def jacobian(self, pose: Pose, slopes: Slopes) -> Float[Array, "time row d"]:
        """d rows / d delta."""

    @abstractmethod
    def report(self, motion: Motion, points: Float[Array, "time point 3"]) -> dict[str, Array]:
        """Fields of :class:`~jaxmotion.spacetime.Report` that say how well a whole clip, whose
        points are there, meets this; none is none."""

    def within(self, joints: Sequence[int] | Int[Array, " joint"]) -> "Term":
        """The same, asked of a clip that has those joints alone."""
        del joints
        return self

    @property
    def asks_each_joint(self) -> bool:
        """Whether it asks something also of joints above no point, of each by itself."""
        return False

    @property
    def firmness(self) -> Float[Array, " time"] | None:
        """The largest weight in each frame; None for what any frame may break."""
        return None

    @property
    def box(self) -> JointLimits | None:
        """Bounds on the joints' turns that mean the same, if there are such."""
        return None


def _by_component(function, x: Float[Array, "time joint 3"]) -> Array:
    """Derivatives of an elementwise function in each component of x: (T, K, i, ...)."""
    steps = jnp.eye(3, dtype=x.dtype)
    slopes = [jax.jvp(function, (x,), (jnp.broadcast_to(steps[i], x.shape),))[1] for i in range(3)]
    return jnp.stack(slopes, axis=2)

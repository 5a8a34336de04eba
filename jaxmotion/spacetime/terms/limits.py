"""Joint limits: no joint turns further than it may.

    rows   sqrt(e) excess(q_j)        3K a frame        J   sqrt(e) excess', joint by joint

excess: how far the turn is beyond the box, radians (:mod:`jaxmotion.spacetime.joint_limits`); e:
the weight of one radian. O(T K^2) for the whole Jacobian, nearly all of it zeros.
"""

from collections.abc import Sequence

from jaxtyping import Array, Float, Int

from jaxmotion._numerics import safe_norm
from jaxmotion.motion import Motion
from jaxmotion.spacetime.joint_limits import JointLimits
from jaxmotion.spacetime.terms.term import Pose, Slopes, Term


class LimitTerm(Term):
    """``limits``: of the clip's joints; ``pull``: sqrt(e)."""

    limits: JointLimits
    pull: Float[Array, ""]

    def rows(self, pose: Pose) -> Float[Array, "time row"]:
        excess = self.limits.excess(pose.motion.rotations)
        return self.pull * excess.reshape(len(excess), 3 * excess.shape[1])

    def jacobian(self, pose: Pose, slopes: Slopes) -> Float[Array, "time row d"]:
        return self.pull * slopes.by_joint(self.limits.excess)

    def report(self, motion: Motion, points: Float[Array, "time point 3"]) -> dict[str, Array]:
        return {"limit_excess": safe_norm(self.limits.excess(motion.rotations))}

    def within(self, joints: Sequence[int] | Int[Array, " joint"]) -> "LimitTerm":
        return LimitTerm(self.limits.of(joints), self.pull)

    @property
    def asks_each_joint(self) -> bool:
        return True

    @property
    def box(self) -> JointLimits:
        return self.limits

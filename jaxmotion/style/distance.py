"""How far a motion is from a manner, as a loss.

    d² = mean over joints of ‖log(q̄_r⁻¹q̄)‖² + ‖√C − √C_r‖²   +   mean over channels of Δx̄² + Δσ²

in radians; the body's velocities and height are in mean heights of the style's body above the
ground (a second), its yaw rate in radians a second. ‖√C − √C_r‖, of the deviations as the joints
themselves see them, is between styles as :func:`~jaxmotion.style.interpolate` goes between them. 0
only where all of it agrees; the derivative is finite everywhere, and 0 there and where nothing
moves. O(T·J).
"""

from collections.abc import Sequence
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxmotion import quaternion
from jaxmotion._checks import instance_of, known, one_of, static
from jaxmotion._entry import finite_clip
from jaxmotion._numerics import safe_sqrt
from jaxmotion._room import room_for
from jaxmotion._types import ArrayLike
from jaxmotion.motion import Motion
from jaxmotion.style.root import HEIGHT, encode
from jaxmotion.style.statistics import MEANS, Mean, MotionStyle, square_root, statistics
from jaxmotion.style.transfer import matched, selected

_BODY_LENGTHS = np.array([True, True, False, True, False, False])


@static("joints", "root", "mean", "match")
def style_distance(
    motion: Motion,
    style: MotionStyle,
    *,
    joints: str | Sequence[str] | None = None,
    root: bool = True,
    mean: Mean = "karcher",
    match: Literal["skeleton", "names"] = "skeleton",
    weights: ArrayLike | None = None,
) -> Float[Array, ""]:
    """How far a motion's manner is from another.

    O(T·J). Differentiable in both modes by motion and style.

    **Arguments:** ``motion``: one clip, T frames; ``style``: a :class:`MotionStyle`; ``joints``:
    names or shell patterns of those that count, None for all; ``root``: whether the body's path and
    posture count, if ``joints`` has its joint; ``mean``: as :func:`jaxmotion.quaternion.mean`;
    ``match``: as :func:`~jaxmotion.style.transfer_style`; ``weights``: f[T], ≥ 0, of the frames.
    **Returns:** f[], radians.
    **Raises:** ``ValueError`` for skeletons that differ, patterns that match nothing, clips that
    are not finite (at run time where they are traced), and where nothing is left to compare.

    **Example:** which of two styles a clip is nearer to:

        >>> import jaxmotion as jm
        >>> walk, run = (jm.samples.load(name).motion for name in ("walk", "run"))
        >>> styles = [jm.style.motion_style(clip[:48]) for clip in (walk, run)]
        >>> far = [float(jm.style.style_distance(walk[48:96], style)) for style in styles]
        >>> far[0] < far[1]
        True
    """
    caller = "style_distance"
    motion = finite_clip(caller, motion, at_run_time=True)
    instance_of(f"{caller}: style", style, MotionStyle, "a MotionStyle (motion_style makes one)")
    one_of(f"{caller}: mean", mean, MEANS)
    theirs = matched(caller, motion.skeleton, style, match)
    used = selected(motion.skeleton, joints) & (np.array(theirs) >= 0)
    body = motion.body_joint
    of_joints = tuple((np.flatnonzero(used[body + 1 :]) + body + 1).tolist())
    if weights is None:
        weights = np.ones(motion.num_frames, motion.dtype)
    if np.shape(weights) != (motion.num_frames,):
        raise ValueError(
            f"{caller}: weights have shape {np.shape(weights)}; want ({motion.num_frames},)"
        )
    whole = root and bool(used[body])
    if not of_joints and not whole:
        raise ValueError(f"{caller}: no joint is left to compare")
    room = room_for(motion, style, weights)
    motion, weights = room.fill(motion), room.fill(known(weights))
    return _distance(motion, room.count, style, weights, of_joints, theirs, whole, mean)


@eqx.filter_jit
def _distance(
    motion: Motion,
    count: Int[Array, ""],
    style: MotionStyle,
    weights: ArrayLike,
    joints: tuple[int, ...],
    theirs: tuple[int, ...],
    root: bool,
    mean: Mean,
) -> Float[Array, ""]:
    kind = motion.dtype
    style = jax.tree.map(lambda x: jnp.asarray(x, kind), style)
    channels, _ = encode(motion, style.root_upright, count)
    own = statistics([motion], [channels], [weights], [count], mean, style.root_upright)
    total = jnp.zeros((), kind)
    if joints:
        mine, other = np.array(joints), np.array(theirs)[list(joints)]
        apart = quaternion.log(quaternion.between(style.mean[other], own.mean[mine]))
        spread = square_root(own.covariance[mine]) - square_root(style.covariance[other])
        total += (jnp.sum(apart**2) + jnp.sum(spread**2)) / len(joints)
    if root:
        height = jnp.abs(style.root_mean[HEIGHT])
        unit = jnp.where(_BODY_LENGTHS & (height > 0), height, 1)
        middle = (own.root_mean - style.root_mean) / unit
        spread = (own.root_deviation - style.root_deviation) / unit
        total += jnp.mean(middle**2 + spread**2)
    return safe_sqrt(total)

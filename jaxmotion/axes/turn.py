"""A clip in a world whose other axis points up.

    R e_a = e_b,  R e_b = −e_a,  R e_c = e_c       the quarter turn that takes a, which points up
                                                   now, to b, which is to
    root:  p ↦ R p,  q ↦ r ⊗ q,  OFFSET ↦ R OFFSET
    others stay: they are local

so from Z up to Y up (x, y, z) becomes (x, z, −y). World positions and rotations are the old ones
turned by R; positions and offsets are exact, rotations good to rounding, and the same from b back
to a undoes it. By a third axis on the way, another heading comes out.

The rest pose (all rotations the identity) is drawn in the joints' own frames and stays as it is:
if it stood upright in the old world, it lies in the new one, as the rest pose of AMASS does. O(T).
"""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from jaxmotion import quaternion
from jaxmotion._checks import one_of
from jaxmotion._entry import a_motion
from jaxmotion.motion import Motion


def reorient(motion: Motion, up: str = "y") -> Motion:
    """Turn a clip, a quarter turn at most, so that another axis points up.

    O(T). Differentiable; positions and offsets are exact.

    **Arguments:** ``motion``: one clip or a batch; ``up``: the axis that is to point up, "x", "y"
    or "z".
    **Returns:** the motion seen from the other world, ``skeleton.up`` as asked; the motion itself
    if it stands so already.
    **Raises:** ``ValueError`` for another axis.

    **Example:**

        >>> import jaxmotion as jm
        >>> motion = jm.samples.load("walk").motion
        >>> turned = jm.reorient(motion, "z")
        >>> heights = turned.root_positions[:, turned.skeleton.up_axis]
        >>> turned.skeleton.up, bool((heights == motion.root_positions[:, 1]).all())
        ('z', True)
    """
    a_motion("reorient", motion)
    one_of("reorient: up", up, ("x", "y", "z"))
    skeleton = motion.skeleton
    a, b = ("xyz".index(axis) for axis in (skeleton.up, up))
    if a == b:
        return motion
    c = 3 - a - b
    order, signs = [0, 1, 2], np.ones(3)
    order[a], order[b], signs[a] = b, a, -1
    turn = np.zeros(4)
    turn[0] = np.sqrt(0.5)
    turn[1 + c] = turn[0] if (a - c) % 3 == 1 else -turn[0]

    def turned(v):
        return v[..., order] * jnp.asarray(signs, v.dtype)

    offsets, translations = jnp.asarray(skeleton.offsets), jnp.asarray(motion.translations)
    rotations = jnp.asarray(motion.rotations)
    root = quaternion.multiply(jnp.asarray(turn, rotations.dtype), rotations[..., 0, :])
    return motion.replace(
        skeleton=replace(
            skeleton, offsets=offsets.at[..., 0, :].set(turned(offsets[..., 0, :])), up=up
        ),
        translations=translations.at[..., 0, :].set(turned(translations[..., 0, :])),
        rotations=rotations.at[..., 0, :].set(root),
    )

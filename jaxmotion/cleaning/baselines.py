"""What is out of a joint's range, or too fast: errors as they are found without neighbours.

    limits   beyond the box of rotation vectors that clean clips keep (:func:`learn_limits`)
    rates    a step on either side is faster than any in the clean clips
    both     either of them

The baselines of Aristidou et al. 2018, Table 1. Of clips of other styles than the clean ones they
call much an error that is none. NumPy on the host, O(T·J).
"""

from collections.abc import Sequence
from typing import Literal, TypeAlias

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from jaxmotion._checks import known, one_of, static
from jaxmotion.cleaning.groups import as_clips, one_skeleton
from jaxmotion.cleaning.jumps import turns
from jaxmotion.motion import Motion
from jaxmotion.spacetime.joint_limits import learn_limits

Rule: TypeAlias = Literal["limits", "rates", "both"]


@static("rule")
def baseline_errors(
    motion: Motion, clean: Motion | Sequence[Motion], rule: Rule = "both"
) -> Bool[Array, "time joint"]:
    """Entries that clean clips would not have, by range and by speed.

    **Arguments:** ``motion``: one clip, T frames; ``clean``: clips of the same joints, without
    errors; ``rule``: "limits", "rates" or "both".
    **Returns:** bool[T, J]; the root has no limits.
    **Raises:** ``ValueError`` for no clips, clips of other joints, what is traced or not finite.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk = jm.samples.load("walk").motion
        >>> bool(jm.cleaning.baseline_errors(walk[40:80], walk).any())
        False
    """
    caller = "baseline_errors"
    one_of(f"{caller}: rule", rule, ("limits", "rates", "both"))
    _, *clips = one_skeleton(caller, [motion, *as_clips(clean)])
    if not clips:
        raise ValueError(f"{caller}: no clean clips; expected one at least")
    rotations = known(motion.rotations)
    found = np.zeros(rotations.shape[:2], bool)
    if rule != "rates":
        limits = learn_limits(clips, margin=0.0)
        found |= np.any(np.asarray(limits.excess(motion.rotations)) != 0, axis=-1)
    if rule != "limits":
        most = np.max([_speeds(clip).max(axis=0, initial=0) for clip in clips], axis=0)
        fast = _speeds(motion) > most
        found[1:] |= fast
        found[:-1] |= fast
    return jnp.asarray(found)


def _speeds(motion: Motion) -> np.ndarray:
    """Radians a second, f[T − 1, J]."""
    return float(motion.fps) * turns(np.asarray(known(motion.rotations)))

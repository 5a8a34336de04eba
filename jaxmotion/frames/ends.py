"""What goes on beyond the ends of a clip: its steps, mirrored (Lee & Shin 2001, Eq. 6).

    ω₋ᵢ = ωᵢ          ωₙ₋₁₊ᵢ = ωₙ₋₁₋ᵢ          again and again where that leaves the clip

ω₀ … ωₙ₋₁: steps from frame to frame. Mirrored steps, unlike mirrored poses, keep steady motion
steady. O(1) a step.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from jaxmotion._types import AnyArray


def mirrored_step(
    index: Int[Array | np.ndarray, "..."], count: int | Int[Array, ""]
) -> Int[AnyArray, "..."]:
    """Which of ``count`` steps stands for step ``index``; NumPy in, NumPy out."""
    xp: Any = np if isinstance(index, np.ndarray) and isinstance(count, int) else jnp
    period = xp.maximum(2 * (count - 1), 1)
    index = xp.abs(index) % period
    return xp.clip(xp.minimum(index, period - index), 0, xp.maximum(count - 1, 0))


def steps_around(count: int, before: int, after: int) -> Int[np.ndarray, " step"]:
    """Which of ``count`` steps stand for steps −before … count + after − 1."""
    return np.asarray(mirrored_step(np.arange(-before, count + after), count))

"""Soft dynamic time warping: a smooth loss between two clips, and the alignment it expects.

    soft_dtw(D, γ) = −γ log Σ_paths exp(−Σ_t D[i_t, j_t] / γ)
    R(i, j)        = D[i, j] + softmin_γ(R(i−1, j−1), R(i−1, j), R(i, j−1)),   R(0, 0) = D[0, 0]
    E[i, j]        = ∂ soft_dtw / ∂D[i, j] = probability that a path drawn ∝ exp(−cost/γ) visits (i, j)
    ∂ soft_dtw/∂γ  = (soft_dtw − ⟨E, D⟩) / γ

Paths step by (1, 0), (0, 1) and (1, 1) from (0, 0) to the last cell. D ``(n, m)`` is a cost matrix,
by default squared Euclidean distances; γ > 0 has its unit. As γ → 0 the value falls on that of
``dtw`` from below and E becomes its path; with larger γ more paths take part, and the value may be
negative. Cost O(n m) time and memory.

Sources: Cuturi & Blondel 2017, algorithms 1 and 2; Mensch & Blondel 2018 for E as an expectation.

E is found with a second sweep from the end, which passes each cell's weight back along the softmin
probabilities of the first; both sweeps take an anti-diagonal at a time and subtract the least of the
three before exponentiating. The value's derivative is E itself, in both modes; E is made of
ordinary operations, so it can be differentiated again. Beyond ``x_length``, ``y_length`` it is zero.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxmotion._types import ArrayLike
from jaxmotion.timing.accumulate import skew
from jaxmotion.timing.frame_distance import Metric, frame_distance

"""Measures of clips, of the difference between two, and checks built on them."""

from jaxmotion.metrics.checks import KINDS, Problem, find_problems
from jaxmotion.metrics.measures import (
    Difference,
    Peak,
    bend,
    difference,
    duplicate_frames,
    figure_size,
    gimbal_margin,
    root_bend,
    rotation_rates,
    sign_flips,
    turn,
    world_positions,
)

__all__ = [
    "KINDS",
    "Difference",
    "Peak",
    "Problem",
    "bend",
    "difference",
    "duplicate_frames",
    "figure_size",
    "find_problems",
    "gimbal_margin",
    "root_bend",
    "rotation_rates",
    "sign_flips",
    "turn",
    "world_positions",
]

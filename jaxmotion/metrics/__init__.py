"""Measures of clips, of the difference between two, and checks built on them."""

from jaxmotion.metrics.checks import KINDS, check, find_problems
from jaxmotion.metrics.contact import (
    ContactScores,
    contact_scores,
    foot_skate,
    jerk,
    joint_position_error,
    penetration,
    slides,
)
from jaxmotion.metrics.detection import DetectionScores, detection_scores, pose_error
from jaxmotion.metrics.findings import Findings, Problem
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
    "ContactScores",
    "DetectionScores",
    "Difference",
    "Findings",
    "Peak",
    "Problem",
    "bend",
    "check",
    "contact_scores",
    "detection_scores",
    "difference",
    "duplicate_frames",
    "figure_size",
    "find_problems",
    "foot_skate",
    "gimbal_margin",
    "jerk",
    "joint_position_error",
    "penetration",
    "pose_error",
    "root_bend",
    "rotation_rates",
    "sign_flips",
    "slides",
    "turn",
    "world_positions",
]

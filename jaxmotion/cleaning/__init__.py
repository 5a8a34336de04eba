"""Self-similarity cleaning: errors found and repaired by what the body does elsewhere."""

from jaxmotion.cleaning.baselines import baseline_errors
from jaxmotion.cleaning.detect import DetectedErrors, ErrorRun, detect_errors
from jaxmotion.cleaning.digression import Digression, digression_map
from jaxmotion.cleaning.groups import joint_groups
from jaxmotion.cleaning.levels import Levels, clean_levels
from jaxmotion.cleaning.neighbours import Neighbours, nearest_words
from jaxmotion.cleaning.repair import Repaired, RepairedRun, repair
from jaxmotion.cleaning.similarity import most_alike, sequence_distance
from jaxmotion.cleaning.soft import soft_mask, soft_neighbours, soft_word_distances
from jaxmotion.cleaning.sparse import reconstruct_sparse
from jaxmotion.cleaning.words import MotionWords, motion_words

__all__ = [
    "DetectedErrors",
    "Digression",
    "ErrorRun",
    "Levels",
    "MotionWords",
    "Neighbours",
    "Repaired",
    "RepairedRun",
    "baseline_errors",
    "clean_levels",
    "detect_errors",
    "digression_map",
    "joint_groups",
    "most_alike",
    "motion_words",
    "nearest_words",
    "reconstruct_sparse",
    "repair",
    "sequence_distance",
    "soft_mask",
    "soft_neighbours",
    "soft_word_distances",
]

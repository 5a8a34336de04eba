"""Self-similarity cleaning: errors found and repaired by what the body does elsewhere."""

from jaxmotion.cleaning.groups import joint_groups
from jaxmotion.cleaning.neighbours import Neighbours, nearest_words
from jaxmotion.cleaning.words import MotionWords, motion_words

__all__ = ["MotionWords", "Neighbours", "joint_groups", "motion_words", "nearest_words"]

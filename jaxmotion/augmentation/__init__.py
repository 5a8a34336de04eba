"""Variations of a clip, seeded and checked, by what layers, styles and time warps make together."""

from jaxmotion.augmentation.augment import augment
from jaxmotion.augmentation.variations import Variations

__all__ = ["Variations", "augment"]

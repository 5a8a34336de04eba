"""Smoothers: signals and motions in, posteriors and smoothed motions out."""

from jaxmotion.smoothing.lgs import Posterior, lgs
from jaxmotion.smoothing.rotations import smooth_motion, smooth_quaternions

__all__ = ["Posterior", "lgs", "smooth_motion", "smooth_quaternions"]

"""Smoothers: signals and motions in, posteriors and smoothed motions out."""

from jaxmotion.smoothing.lgs import Posterior, lgs
from jaxmotion.smoothing.rotations import smooth_motion, smooth_quaternions
from jaxmotion.smoothing.streaming import StreamingSmoother, StreamState
from jaxmotion.smoothing.tuning import MotionTuning, Tuning, tune
from jaxmotion.smoothing.windowed import windowed_lgs

__all__ = [
    "MotionTuning",
    "Posterior",
    "StreamState",
    "StreamingSmoother",
    "Tuning",
    "lgs",
    "smooth_motion",
    "smooth_quaternions",
    "tune",
    "windowed_lgs",
]

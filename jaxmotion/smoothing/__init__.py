"""Smoothers: signals and motions in, posteriors and smoothed motions out."""

from jaxmotion.smoothing.geodesic import GeodesicPosterior, geodesic
from jaxmotion.smoothing.keys import KeySuggestions, suggest_keys
from jaxmotion.smoothing.lgs import Posterior, lgs
from jaxmotion.smoothing.rotations import smooth_motion, smooth_quaternions
from jaxmotion.smoothing.streaming import StreamingSmoother, StreamState
from jaxmotion.smoothing.tuning import MotionTuning, Tuning, tune
from jaxmotion.smoothing.windowed import windowed_lgs

__all__ = [
    "GeodesicPosterior",
    "KeySuggestions",
    "MotionTuning",
    "Posterior",
    "StreamState",
    "StreamingSmoother",
    "Tuning",
    "geodesic",
    "lgs",
    "smooth_motion",
    "smooth_quaternions",
    "suggest_keys",
    "tune",
    "windowed_lgs",
]

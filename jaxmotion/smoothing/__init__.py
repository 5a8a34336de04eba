"""Smoothers: signals and motions in, posteriors and smoothed motions out.

Its modules are the library's own; ``design``, ``components``, ``chordal``, ``losses`` and
``low_pass`` hold nothing that is public. The geodesic smoothers load on first use: optimistix takes
a third of a second to import.
"""

from typing import TYPE_CHECKING

from jaxmotion._lazy import loader
from jaxmotion.smoothing.bridges import Bridge, bridged
from jaxmotion.smoothing.keys import KeySuggestions, suggest_keys
from jaxmotion.smoothing.lgs import Posterior, lgs
from jaxmotion.smoothing.motion_prior import MotionPrior, motion_prior
from jaxmotion.smoothing.outliers import outlier_weights
from jaxmotion.smoothing.removal import Removal, removed
from jaxmotion.smoothing.rotations import smooth_motion, smooth_quaternions
from jaxmotion.smoothing.streaming import StreamingSmoother, StreamState
from jaxmotion.smoothing.student import student_stiffness
from jaxmotion.smoothing.tuning import MotionTuning, Tuning, tune
from jaxmotion.smoothing.windowed import windowed_lgs

if TYPE_CHECKING:
    from jaxmotion.smoothing.geodesic_regression import GeodesicPosterior, geodesic
else:  # hidden from type checkers, to which it would make every name one of this module
    __getattr__ = loader(
        __name__, dict.fromkeys(("GeodesicPosterior", "geodesic"), "geodesic_regression")
    )

__all__ = [
    "Bridge",
    "GeodesicPosterior",
    "KeySuggestions",
    "MotionPrior",
    "MotionTuning",
    "Posterior",
    "Removal",
    "StreamState",
    "StreamingSmoother",
    "Tuning",
    "bridged",
    "geodesic",
    "lgs",
    "motion_prior",
    "outlier_weights",
    "removed",
    "smooth_motion",
    "smooth_quaternions",
    "student_stiffness",
    "suggest_keys",
    "tune",
    "windowed_lgs",
]

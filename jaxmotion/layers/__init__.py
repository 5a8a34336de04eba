"""Motion layers: split a motion into base, control and residual, edit, put together again."""

from jaxmotion.layers.decompose import MotionLayers, decompose
from jaxmotion.layers.synthesize import denoise, joint_weights, stylize, synthesize
from jaxmotion.layers.time_warp import time_warp

__all__ = [
    "MotionLayers",
    "decompose",
    "denoise",
    "joint_weights",
    "stylize",
    "synthesize",
    "time_warp",
]

"""Motion layers: split a motion into base, control and residual, edit, put together again."""

from jaxmotion.layers.decompose import MotionLayers, decompose
from jaxmotion.layers.synthesize import denoise, joint_weights, stylize, synthesize

__all__ = ["MotionLayers", "decompose", "denoise", "joint_weights", "stylize", "synthesize"]

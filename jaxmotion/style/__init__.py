"""The manner of a motion: taken, kept, mixed, measured, and given to another motion.

Its modules are the library's own; ``root``, ``carry`` and ``correspondence`` hold nothing that is
public.
"""

from jaxmotion.style.distance import style_distance
from jaxmotion.style.segments import StyleSegment, segment_styles
from jaxmotion.style.statistics import MotionStyle, interpolate, motion_style
from jaxmotion.style.transfer import StyleReport, StyleTransfer, apply_style, transfer_style

__all__ = [
    "MotionStyle",
    "StyleReport",
    "StyleSegment",
    "StyleTransfer",
    "apply_style",
    "interpolate",
    "motion_style",
    "segment_styles",
    "style_distance",
    "transfer_style",
]

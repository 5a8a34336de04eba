"""Time: aligning, warping and resampling clips.

Its modules are the library's own; ``accumulate``, ``antidiagonals``, ``spline``, ``step_patterns``
and ``time_maps`` hold nothing that is public.
"""

from jaxmotion.frames.padding import bucket_size
from jaxmotion.timing.align import Alignment, align
from jaxmotion.timing.buckets import pad_to_bucket
from jaxmotion.timing.dtw import WarpPath, dtw
from jaxmotion.timing.frame_distance import frame_distance
from jaxmotion.timing.motion_warping import MotionWarp, motion_warping, unwarp
from jaxmotion.timing.pose_distance import pose_distance
from jaxmotion.timing.resample import resample
from jaxmotion.timing.soft_dtw import soft_alignment, soft_dtw

__all__ = [
    "Alignment",
    "MotionWarp",
    "WarpPath",
    "align",
    "bucket_size",
    "dtw",
    "frame_distance",
    "motion_warping",
    "pad_to_bucket",
    "pose_distance",
    "resample",
    "soft_alignment",
    "soft_dtw",
    "unwarp",
]

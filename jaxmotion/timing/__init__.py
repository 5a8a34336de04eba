"""Time: aligning, warping and resampling clips."""

from jaxmotion.timing.buckets import bucket_size, pad_to_bucket
from jaxmotion.timing.dtw import WarpPath, dtw
from jaxmotion.timing.frame_distance import frame_distance
from jaxmotion.timing.pose_distance import pose_distance

__all__ = [
    "WarpPath",
    "bucket_size",
    "dtw",
    "frame_distance",
    "pad_to_bucket",
    "pose_distance",
]

"""Multiresolution analysis of motions: filter, take apart by scale, edit, put together again."""

from jaxmotion.multiresolution.compression import CompressedMotion, compress
from jaxmotion.multiresolution.filters import filter_motion, orientation_filter, vector_filter
from jaxmotion.multiresolution.masks import band_pass_mask, binomial_mask, smoothing_mask
from jaxmotion.multiresolution.operations import blend, level_of_detail, scale_details
from jaxmotion.multiresolution.pyramid import Pyramid, build_pyramid
from jaxmotion.multiresolution.stitching import best_cut, follow, stitch
from jaxmotion.multiresolution.subdivision import (
    coarser_times,
    downsample,
    expand,
    reduce,
    upsample,
)

__all__ = [
    "CompressedMotion",
    "Pyramid",
    "band_pass_mask",
    "best_cut",
    "binomial_mask",
    "blend",
    "build_pyramid",
    "coarser_times",
    "compress",
    "downsample",
    "expand",
    "filter_motion",
    "follow",
    "level_of_detail",
    "orientation_filter",
    "reduce",
    "scale_details",
    "smoothing_mask",
    "stitch",
    "upsample",
    "vector_filter",
]

"""Synthetic clips with ground truth, made by formulas: no files, no captures, deterministic.

``walk``, ``run``, ``idle``, ``kick``, ``jump`` and ``dance`` move a person, ``quadruped_walk`` and
``quadruped_trot`` a dog; each returns a :class:`Sample`: a clean motion and exact foot contacts.
The corruptions damage any motion and tell which entries they touched.
"""

from jaxmotion.samples.actions import dance, idle, jump, kick
from jaxmotion.samples.capture_errors import drift_joints, swap_markers
from jaxmotion.samples.catalogue import clean_and_noisy, load, names
from jaxmotion.samples.corruptions import Corrupted, add_noise, drop_frames, flip_signs, slide_root
from jaxmotion.samples.gaits import quadruped_trot, quadruped_walk, run, walk
from jaxmotion.samples.joint_errors import (
    add_spikes,
    fill_gaps,
    freeze_joints,
    inject_errors,
    offset_joints,
    swap_limbs,
    violate_limits,
)
from jaxmotion.samples.posing import Sample
from jaxmotion.samples.skeletons import biped, quadruped

__all__ = [
    "Corrupted",
    "Sample",
    "add_noise",
    "add_spikes",
    "biped",
    "clean_and_noisy",
    "dance",
    "drift_joints",
    "drop_frames",
    "fill_gaps",
    "flip_signs",
    "freeze_joints",
    "idle",
    "inject_errors",
    "jump",
    "kick",
    "load",
    "names",
    "offset_joints",
    "quadruped",
    "quadruped_trot",
    "quadruped_walk",
    "run",
    "slide_root",
    "swap_limbs",
    "swap_markers",
    "violate_limits",
    "walk",
]

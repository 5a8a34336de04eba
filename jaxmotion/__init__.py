"""jaxmotion: differentiable motion capture processing.

Conventions, the same in every room:

- Quaternions are ``(w, x, y, z)``, Hamilton, active, right-handed. A joint's rotation is local,
  child in parent: ``q_world = q_parent_world ⊗ q_local``.
- Rotation vectors are full-angle: ``exp(v)`` turns by ‖v‖ radians.
- Axes are ``(time, joint, component)``; quaternion functions broadcast over leading axes.
- Radians and seconds; lengths in the file's own unit, never rescaled silently; Y up unless the file
  says otherwise (BVH and ASF cannot: ``load(up=...)``, :func:`reorient`).
- dtype in = dtype out, float32 or float64. Importing changes no global setting.
- Wrong shapes and static values raise ``ValueError``; traced trouble raises at run time, or
  becomes NaN, as :func:`jaxmotion.checks` says.
- Flags, choices and numbers of things are static: under ``jax.jit`` name them in
  ``static_argnames``.
- One clip at a time, but where a page says that batch axes are allowed; :func:`stack` makes a batch
  for ``jax.vmap``. What works frame by frame takes NaN and gives it back; what would spread it
  refuses it, and says where it is.
- Discrete choices (signs, warp paths, neighbours, thresholds) pass no gradient.

What a room's ``__all__`` names is public; other modules and names are the library's own and may
change.

Names load on first use, so that ``jaxmotion --help`` does not wait for JAX.
"""

from typing import TYPE_CHECKING

from jaxmotion._lazy import loader

__version__ = "0.1.0"

_MODULES = (
    "cleaning",
    "contacts",
    "corpus",
    "displacement",
    "io",
    "layers",
    "linalg",
    "metrics",
    "multiresolution",
    "quaternion",
    "samples",
    "smoothing",
    "spacetime",
    "style",
    "timing",
    "viz",
)

_HOMES = {
    "Skeleton": "skeleton",
    "Motion": "motion",
    "UpGuess": "axes",
    "Variations": "augmentation",
    "concatenate": "clips",
    "guess_up": "axes",
    "reorient": "axes",
    "facing_direction": "kinematics",
    "forward_kinematics": "kinematics",
    "velocities": "kinematics",
    "MotionLayers": "layers",
    "augment": "augmentation",
    "buckets": "frames.padding",
    "check": "metrics",
    "checks": "_checks",
    "enable_compilation_cache": "_compilation_cache",
    "decompose": "layers",
    "denoise": "layers",
    "joint_weights": "layers",
    "mirror": "reflection",
    "stack": "clips",
    "stylize": "layers",
    "synthesize": "layers",
    "time_warp": "layers",
    "load": "io",
    "resample": "timing",
    "save": "io",
}

if TYPE_CHECKING:
    from jaxmotion import (
        cleaning,
        contacts,
        corpus,
        displacement,
        io,
        layers,
        linalg,
        metrics,
        multiresolution,
        quaternion,
        samples,
        smoothing,
        spacetime,
        style,
        timing,
        viz,
    )
    from jaxmotion._checks import checks
    from jaxmotion._compilation_cache import enable_compilation_cache
    from jaxmotion.augmentation import Variations, augment
    from jaxmotion.axes import UpGuess, guess_up, reorient
    from jaxmotion.clips import concatenate, stack
    from jaxmotion.frames.padding import buckets
    from jaxmotion.io import load, save
    from jaxmotion.kinematics import facing_direction, forward_kinematics, velocities
    from jaxmotion.layers import (
        MotionLayers,
        decompose,
        denoise,
        joint_weights,
        stylize,
        synthesize,
        time_warp,
    )
    from jaxmotion.metrics import check
    from jaxmotion.motion import Motion
    from jaxmotion.reflection import mirror
    from jaxmotion.skeleton import Skeleton
    from jaxmotion.timing import resample

__all__ = [
    "Motion",
    "MotionLayers",
    "Skeleton",
    "UpGuess",
    "Variations",
    "augment",
    "buckets",
    "check",
    "checks",
    "cleaning",
    "concatenate",
    "contacts",
    "corpus",
    "decompose",
    "denoise",
    "displacement",
    "enable_compilation_cache",
    "facing_direction",
    "forward_kinematics",
    "guess_up",
    "io",
    "joint_weights",
    "layers",
    "linalg",
    "load",
    "metrics",
    "mirror",
    "multiresolution",
    "quaternion",
    "reorient",
    "resample",
    "samples",
    "save",
    "smoothing",
    "spacetime",
    "stack",
    "style",
    "stylize",
    "synthesize",
    "time_warp",
    "timing",
    "velocities",
    "viz",
]


if not TYPE_CHECKING:  # to a type checker it would make every name one of this module
    __getattr__ = loader(__name__, _HOMES, _MODULES)


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))

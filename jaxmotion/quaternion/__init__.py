"""Unit quaternions (w, x, y, z): algebra, exponential map, conversions, interpolation, statistics.

Hamilton's product, active rotations, right-handed. Everything broadcasts over leading axes, keeps
its dtype, and has finite gradients at the identity, at q and −q, and at angle π.

Its modules are the library's own; among them ``parts`` (by component), ``tangent`` (right
Jacobians) and ``arcs`` (shortest arc, twist) hold nothing that is public.
"""

from jaxmotion.quaternion.algebra import (
    align_signs,
    between,
    conjugate,
    identity,
    inverse,
    multiply,
    normalize,
    rotate,
)
from jaxmotion.quaternion.convert import (
    from_euler,
    from_matrix,
    from_rotation_6d,
    from_xyzw,
    to_euler,
    to_matrix,
    to_rotation_6d,
    to_xyzw,
)
from jaxmotion.quaternion.explog import distance, exp, exp_half, log, log_half, power
from jaxmotion.quaternion.interpolate import slerp
from jaxmotion.quaternion.sign_choice import least_energy_signs
from jaxmotion.quaternion.statistics import mean, std

__all__ = [
    "align_signs",
    "between",
    "conjugate",
    "distance",
    "exp",
    "exp_half",
    "from_euler",
    "from_matrix",
    "from_rotation_6d",
    "from_xyzw",
    "identity",
    "inverse",
    "least_energy_signs",
    "log",
    "log_half",
    "mean",
    "multiply",
    "normalize",
    "power",
    "rotate",
    "slerp",
    "std",
    "to_euler",
    "to_matrix",
    "to_rotation_6d",
    "to_xyzw",
]

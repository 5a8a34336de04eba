"""Shape annotations shared by every room.

Shapes read ``(time, joint, component)``; ``...`` stands for any leading axes.
Quaternions are ``(w, x, y, z)``; rotation vectors turn by their full length in radians.
"""

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from jaxtyping import Array, Float

if TYPE_CHECKING:
    AnyArray: TypeAlias = Array
else:
    AnyArray: TypeAlias = Array | np.ndarray

Quaternion: TypeAlias = Float[AnyArray, "... 4"]
Vector3: TypeAlias = Float[AnyArray, "... 3"]
Matrix3: TypeAlias = Float[AnyArray, "... 3 3"]
Rotation6d: TypeAlias = Float[AnyArray, "... 6"]
Angles: TypeAlias = Float[AnyArray, "... 3"]
Scalar: TypeAlias = Float[AnyArray, ""]

ScalarLike: TypeAlias = float | int | Array | np.ndarray | np.generic
ArrayLike: TypeAlias = float | int | Array | np.ndarray | np.generic | list | tuple

__all__ = [
    "Angles",
    "AnyArray",
    "ArrayLike",
    "Matrix3",
    "Quaternion",
    "Rotation6d",
    "Scalar",
    "ScalarLike",
    "Vector3",
]

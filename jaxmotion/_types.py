"""Shape annotations shared by every room.

Shapes read ``(time, joint, component)``; ``...`` stands for any leading axes.
Quaternions are ``(w, x, y, z)``; rotation vectors turn by their full length in radians.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias, get_args

import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray, UInt32

if TYPE_CHECKING:
    AnyArray: TypeAlias = Array
    ScalarLike: TypeAlias = float | int | Array | np.ndarray | np.generic
    ArrayLike: TypeAlias = float | int | Array | np.ndarray | np.generic | list | tuple
    Key: TypeAlias = PRNGKeyArray | UInt32[Array, "2"]
    Metric: TypeAlias = str | Callable[[Array, Array], Array]
else:

    def _named(name: str, *members: type) -> type:
        """The union of the members as a type that ``help()`` shows by its name alone."""
        is_member = {"__instancecheck__": lambda cls, value: isinstance(value, members)}
        return type(f"{name}Type", (type,), is_member)(name, (), {"__module__": "builtins"})

    AnyArray = _named("AnyArray", Array, np.ndarray)
    ScalarLike = _named("ScalarLike", float, int, Array, np.ndarray, np.generic)
    ArrayLike = _named("ArrayLike", float, int, Array, np.ndarray, np.generic, list, tuple)
    Key = _named("Key", *get_args(PRNGKeyArray), UInt32[Array, "2"])
    Metric = _named("Metric", str, Callable)

Quaternion: TypeAlias = Float[AnyArray, "... 4"]
Vector3: TypeAlias = Float[AnyArray, "... 3"]
Matrix3: TypeAlias = Float[AnyArray, "... 3 3"]
Rotation6d: TypeAlias = Float[AnyArray, "... 6"]
Angles: TypeAlias = Float[AnyArray, "... 3"]
Scalar: TypeAlias = Float[AnyArray, ""]

__all__ = [
    "Angles",
    "AnyArray",
    "ArrayLike",
    "Key",
    "Matrix3",
    "Metric",
    "Quaternion",
    "Rotation6d",
    "Scalar",
    "ScalarLike",
    "Vector3",
]

"""Modules that travel: between processes, to disk, to the workers of a cluster.

A pickled JAX array is made again in the process that reads it, and where 64-bit types are off there
it silently loses half its digits; and Python counts a module of any size as 56 bytes. A
:class:`Portable` module is pickled with its arrays as NumPy's (protocol 5 sends their memory
without a copy), and its size is that of its arrays.

Shown, a module is one line (:mod:`jaxmotion._summary`), where equinox prints every field. Its hash
goes with ``==``, which leaves out what only its file says: the parts of a motion that
``eqx.partition`` calls static are one static argument for every spelling.

Read back, JAX arrays are JAX arrays of the same dtype; those that the reading process cannot hold
(float64 without ``jax_enable_x64``) stay NumPy arrays, whole. Sharding is not kept.
"""

import copy
from collections.abc import Iterable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from jaxmotion._summary import by_field, line


class Portable(eqx.Module):
    """Base of the modules that users keep and send."""

    def __getstate__(self) -> dict[str, Any]:
        def packed(value: Any) -> Any:
            is_array = isinstance(value, jax.Array) and not isinstance(value, Tracer)
            return _Packed(value) if is_array else value

        def inside(value: Any) -> Any:
            return jax.tree.map(packed, value, is_leaf=lambda x: isinstance(x, eqx.Module))

        return {name: inside(value) for name, value in self.__dict__.items()}

    # A copy in the same process is no journey: arrays stay where they are.
    def __copy__(self):
        return self._holding(dict(vars(self)))

    def __deepcopy__(self, memo):
        return self._holding(copy.deepcopy(dict(vars(self)), memo))

    def _holding(self, values: dict[str, Any]):
        new = object.__new__(type(self))
        vars(new).update(values)
        return new

    def __hash__(self) -> int:
        leaves, structure = jax.tree.flatten(self)
        return hash((structure, *leaves))

    def __repr__(self) -> str:
        return line(self, self._words)

    def __pdoc__(self, **_: Any):
        """For wadler_lindig, which calls it: equinox prints with that what holds such a module."""
        from wadler_lindig import TextDoc

        return TextDoc(repr(self))

    def _words(self) -> Iterable[str]:
        """What the line says."""
        return by_field(self)

    def __sizeof__(self) -> int:
        sizes = (getattr(leaf, "nbytes", 0) for leaf in jax.tree.leaves(self))
        return object.__sizeof__(self) + sum(sizes)


class _Packed:
    """A JAX array, in a pickle."""

    def __init__(self, array: Array):
        self.array = array

    def __reduce__(self):
        return _unpacked, (np.asarray(self.array),)


def _unpacked(array: np.ndarray) -> Array | np.ndarray:
    fits = jax.dtypes.canonicalize_dtype(array.dtype) == array.dtype
    return jnp.array(array) if fits else array

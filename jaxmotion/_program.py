"""What an eager call compiles: :func:`one_program` for small functions, :func:`keepable` for those
that may stop.

Called eagerly, JAX compiles every operation by itself, for every shape: some 20 ms each, and a
logarithm has 25. A function marked ``one_program`` is compiled as a whole. Within another program
it dissolves into its operations, as if it were not marked.

JAX keeps no program on disk that calls the host, as one does that may stop. One that is marked
``keepable`` is compiled so that it can be kept, and looked at afterwards.
"""

import functools
import inspect
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxmotion._checks import at_hand, checks, no_module, stops, traced
from jaxmotion._checks import static as known_when_compiling
from jaxmotion._compilation_cache import folder_of_programs

P = ParamSpec("P")
R = TypeVar("R")


def one_program(*static: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """A decorator: one program per shape, and per value of the arguments named ``static``.

    ``ValueError`` for a motion where an array is wanted: looked for while tracing, it costs a call
    nothing."""

    def marked(function: Callable[P, R]) -> Callable[P, R]:
        names = tuple(inspect.signature(function).parameters)

        @functools.wraps(function)
        def of_arrays(*args: Any, **kwargs: Any) -> R:
            for name, value in (*zip(names, args, strict=False), *kwargs.items()):
                no_module(f"{function.__name__}: {name}", value)
            return function(*args, **kwargs)

        program = jax.jit(of_arrays, static_argnames=static, inline=True)
        program = cast(Callable[P, R], program)
        return known_when_compiling(*static)(program) if static else program

    return marked


def keepable(program: Callable[P, R]) -> Callable[P, R]:
    """A compiled function that may stop at what is wrong, as a decorator above the one that
    compiles it. Where programs are kept on disk an eager call runs the one that makes NaN, and only
    if what comes of it holds one, that which tells why."""

    @functools.wraps(program)
    def call(*args: Any, **kwargs: Any) -> R:
        if folder_of_programs() is None or not stops() or traced(args, kwargs):
            return program(*args, **kwargs)
        with checks("nan"):
            result = program(*args, **kwargs)
        return result if _is_sound(result) else program(*args, **kwargs)

    return call


def _is_sound(result: Any) -> bool:
    """Whether it is there, as it is not within a program that is being traced, and without NaN."""
    leaves = [x for x in jax.tree.leaves(result) if eqx.is_inexact_array(x)]
    return not traced(leaves) and not any(_has_nan(x) for x in leaves if x.size)


def _has_nan(x: jax.Array) -> bool:
    values = at_hand(x)
    return bool(np.isnan(np.min(values) if values is not None else jnp.min(x)))

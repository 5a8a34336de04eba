"""Small functions as one program each.

Called eagerly, JAX compiles every operation by itself, for every shape: some 20 ms each, and a
logarithm has 25. A function marked :func:`one_program` is compiled as a whole. Within another
program it dissolves into its operations, as if it were not marked.
"""

import functools
import inspect
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import jax

from jaxmotion._checks import no_module
from jaxmotion._checks import static as known_when_compiling

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

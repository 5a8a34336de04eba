"""Small functions as one program each.

Called eagerly, JAX compiles every operation by itself, for every shape: some 20 ms each, and a
logarithm has 25. A function marked :func:`one_program` is compiled as a whole. Within another
program it dissolves into its operations, as if it were not marked.
"""

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import jax

from jaxmotion._checks import static as known_when_compiling

P = ParamSpec("P")
R = TypeVar("R")


def one_program(*static: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """A decorator: one program per shape, and per value of the arguments named ``static``."""

    def marked(function: Callable[P, R]) -> Callable[P, R]:
        program = jax.jit(function, static_argnames=static, inline=True)
        program = cast(Callable[P, R], program)
        return known_when_compiling(*static)(program) if static else program

    return marked

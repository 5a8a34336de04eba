"""How many frames each level of a pyramid has, how many count, and how far apart they are.

T frames become T//2 + 1, level by level. Arrays have the sizes of ``frames``, known when a program
is compiled; ``counts`` of their frames count, which may be traced.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxmotion.multiresolution.levels import coarser_spacing


class Schedule(NamedTuple):
    """The levels of a pyramid of N halvings, base first.

    ``frames``: of each, N + 1 numbers; ``skips``: how many each expansion drops at its front, N
    numbers; ``counts``: how many of the frames count, N + 1; ``spacings``: time from frame to
    frame, N + 1 arrays f[frames − 1], or None where all are even; ``lazy``: only odd frames have
    details.
    """

    frames: tuple[int, ...]
    skips: tuple[int, ...]
    counts: tuple[Int[Array, ""], ...]
    spacings: tuple[Float[Array, " _"], ...] | None
    lazy: bool

    @property
    def levels(self) -> int:
        """N."""
        return len(self.skips)


def level_counts(
    frames: tuple[int, ...], length: Int[Array, ""] | None
) -> tuple[Int[Array, ""], ...]:
    """How many frames of each level count, base first, where ``length`` (None: all) of the finest
    do."""
    if length is None:
        return tuple(jnp.asarray(n, int) for n in frames)
    counts = [length]
    for _ in frames[1:]:
        counts.append(counts[-1] // 2 + 1)
    return tuple(counts[::-1])


def level_spacings(
    finest: Float[Array, " step"] | None, counts: tuple[Int[Array, ""], ...]
) -> tuple[Float[Array, " _"], ...] | None:
    """The spacing of each level, base first, from that of the finest."""
    if finest is None:
        return None
    spacings = [finest]
    for count in counts[:0:-1]:
        spacings.append(coarser_spacing(spacings[-1], count))
    return tuple(spacings[::-1])


def level_sizes(frames: int, levels: int | None = None) -> list[int]:
    """Frames of every level, fine to coarse, ``levels`` halvings or as far as 2."""
    sizes = [frames]
    while len(sizes) <= levels if levels is not None else sizes[-1] > 2:
        sizes.append(sizes[-1] // 2 + 1)
    return sizes

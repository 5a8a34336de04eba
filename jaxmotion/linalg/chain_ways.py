"""Which way a position-velocity chain is solved: frame by frame, or in O(log T) parallel steps.

On a CPU frame by frame is faster. An accelerator starts a kernel or more for every frame, some
10 microseconds each, whatever little each has to do: there parallel steps win, until there are so
many channels that memory takes longer than starting. Their number follows from counts of kernels
and bytes; ``benchmarks/devices.py`` measures both ways on the device that it finds.

Parallel steps may lose digits across gaps (``lost_digits``). Who asks for them is told so; where
they are chosen here, the chain decides as it runs.
"""

from typing import Literal, TypeAlias

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

from jaxmotion.linalg.chain_covariance import Knowledge, chain_knowledge
from jaxmotion.linalg.difference_chain import DifferenceChain, chain_factor, chain_smooth
from jaxmotion.linalg.parallel_chain import (
    lost_digits,
    parallel_chain_knowledge,
    parallel_chain_smooth,
)

Way: TypeAlias = Literal["frames", "parallel", "either"]
_FEW_FRAMES = 64
_MANY_CHANNELS = 2**18
_LOSS = 1e-3  # the share of a velocity's digits that may be lost


def way_of(parallel: bool | None, frames: int, channels: int) -> Way:
    """The way that is asked for; of None the one that is fast on the default device.

    **Arguments:** ``parallel``: True, False or None; ``frames``, ``channels``: how many.
    """
    if parallel is not None:
        return "parallel" if parallel else "frames"
    device = jax.config.jax_default_device  # type: ignore[attr-defined]
    platform = getattr(device, "platform", device) or jax.default_backend()
    few = frames < _FEW_FRAMES or channels > _MANY_CHANNELS
    return "frames" if few or platform == "cpu" else "either"


def smooth_by(way: Way, chain: DifferenceChain, readings: Array, push: Array | None) -> Array:
    """:func:`chain_smooth`, that way."""
    ways = parallel_chain_smooth, chain_smooth
    return _done(way, *ways, chain, readings, push)


def knowledge_by(way: Way, chain: DifferenceChain) -> Knowledge:
    """:func:`chain_knowledge`, that way."""
    return _done(
        way, parallel_chain_knowledge, lambda chain: chain_knowledge(chain_factor(chain)), chain
    )


def loses(chain: DifferenceChain) -> Array:
    """Whether parallel steps would lose digits anywhere."""
    return jnp.any(lost_digits(chain) > _LOSS)


def _done(way: Way, parallel, frames, chain: DifferenceChain, *rest):
    if way == "either":
        return lax.cond(loses(chain), frames, parallel, chain, *rest)
    return (parallel if way == "parallel" else frames)(chain, *rest)

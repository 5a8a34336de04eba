"""Linear algebra along time: banded systems and the chain behind the smoothers, all O(frames).

Its modules are the library's own; ``pair_walk`` and ``symmetric`` hold nothing that is public. The
least-squares solvers load on first use: lineax and optimistix take a third of a second.
"""

from typing import TYPE_CHECKING

from jaxmotion._lazy import loader
from jaxmotion.linalg.banded import (
    BandedFactor,
    banded_factor,
    banded_log_det,
    banded_matvec,
    banded_selected_inverse,
    banded_solve,
)
from jaxmotion.linalg.block_banded import (
    BlockBandedFactor,
    block_banded_factor,
    block_banded_log_det,
    block_banded_matvec,
    block_banded_selected_inverse,
    block_banded_solve,
    block_banded_substitute,
)
from jaxmotion.linalg.chain_covariance import (
    Knowledge,
    chain_bend_variance,
    chain_covariance,
    chain_knowledge,
    chain_log_det,
    chain_sample,
    chain_squared_inverse,
)
from jaxmotion.linalg.difference_chain import (
    ChainFactor,
    DifferenceChain,
    chain_factor,
    chain_smooth,
)
from jaxmotion.linalg.parallel_chain import (
    parallel_chain_factor,
    parallel_chain_knowledge,
    parallel_chain_smooth,
)

if TYPE_CHECKING:
    from jaxmotion.linalg.least_squares import (
        BlockBandedCholesky,
        GaussNewton,
        LevenbergMarquardt,
    )
else:  # hidden from type checkers, to which it would make every name one of this module
    _SOLVERS = ("BlockBandedCholesky", "GaussNewton", "LevenbergMarquardt")
    __getattr__ = loader(__name__, dict.fromkeys(_SOLVERS, "least_squares"))

__all__ = [
    "BandedFactor",
    "BlockBandedCholesky",
    "BlockBandedFactor",
    "ChainFactor",
    "DifferenceChain",
    "GaussNewton",
    "Knowledge",
    "LevenbergMarquardt",
    "banded_factor",
    "banded_log_det",
    "banded_matvec",
    "banded_selected_inverse",
    "banded_solve",
    "block_banded_factor",
    "block_banded_log_det",
    "block_banded_matvec",
    "block_banded_selected_inverse",
    "block_banded_solve",
    "block_banded_substitute",
    "chain_bend_variance",
    "chain_covariance",
    "chain_factor",
    "chain_knowledge",
    "chain_log_det",
    "chain_sample",
    "chain_smooth",
    "chain_squared_inverse",
    "parallel_chain_factor",
    "parallel_chain_knowledge",
    "parallel_chain_smooth",
]

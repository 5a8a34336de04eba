"""Which moves a warp path may make: small automata over the cells of a cost matrix.

A path visits cells (i, j) of frames i of x and j of y. Its *state* remembers how a cell was
entered; a *pool* is the cheapest of some states of one cell, P_p = min over s in p of C_s; each
state is entered by one move from one pool:

    C_s(i, j) = weight_s · D[i, j] + P_p(i − Δi, j − Δj),          (Δi, Δj, p) = moves[s]

==============  ==========================  ==================================================
name            steps                       rule
==============  ==========================  ==================================================
``symmetric``   (1,0) (0,1) (1,1)           any order; every cell counts once
``symmetric2``  (1,0) (0,1) (1,1)           the diagonal counts twice (Sakoe & Chiba 1978, P = 0):
                                            cost per frame, see ``normalize="frames"``
``asymmetric``  (1,0) (1,1) (1,2)           every frame of x once; frames of y may be skipped
``slopeK``      (1,0) (0,1) (1,1)           at most K (1, 2, 3) steps on end along one axis;
                                            ``slope3`` is Aristidou et al. 2018, appendix
==============  ==========================  ==================================================

Equal costs are settled by the order of the states in a pool: the diagonal first, then Δi, then Δj.
"""

from typing import NamedTuple

from jaxmotion._checks import one_of


class Move(NamedTuple):
    """The step that enters a state, and the pool it comes from."""

    di: int
    dj: int
    pool: int


class StepPattern(NamedTuple):
    """A path automaton; pool 0 holds every state, and paths start and end in it.

    ``moves[s]`` enters state s; ``pools[p]`` lists states, preferred first; ``weighted`` counts a
    cell Δi + Δj times. ``longest_run`` is the most steps on end along one axis, None without limit.
    """

    name: str
    moves: tuple[Move, ...]
    pools: tuple[tuple[int, ...], ...]
    weighted: bool = False
    longest_run: int | None = None

    def weight(self, move: Move) -> int:
        """How often the cell entered by a move is counted."""
        return move.di + move.dj if self.weighted else 1

    @property
    def depth(self) -> int:
        """How many anti-diagonals back the furthest move reaches."""
        return max(move.di + move.dj for move in self.moves)

    def reaches(self, frames_x: int, frames_y: int) -> bool:
        """Whether some path joins the first cell to the last one."""
        if self.name == "asymmetric":
            return frames_y - 1 <= 2 * (frames_x - 1)
        if self.longest_run is None:
            return True
        short, long = sorted((frames_x - 1, frames_y - 1))
        return long <= self.longest_run + (self.longest_run + 1) * short


def _free(name: str, steps: tuple[tuple[int, int], ...], *, weighted: bool = False) -> StepPattern:
    """Any step after any other."""
    moves = tuple(Move(di, dj, 0) for di, dj in steps)
    return StepPattern(name, moves, (tuple(range(len(steps))),), weighted)


def _slope(longest_run: int) -> StepPattern:
    """States: 0 after a diagonal, 1 … K after that many steps in x, K + 1 … 2K in y.

    Pools: 0 all states, 1 those a run in x may start from, 2 the same for y, then single states
    from which a run goes on.
    """
    along_x = tuple(range(1, longest_run + 1))
    along_y = tuple(range(longest_run + 1, 2 * longest_run + 1))
    moves = [Move(1, 1, 0)]
    pools = [(0, *along_x, *along_y), (0, *along_y), (0, *along_x)]
    for (di, dj), run, start in (((1, 0), along_x, 1), ((0, 1), along_y, 2)):
        moves.append(Move(di, dj, start))
        for state in run[:-1]:
            moves.append(Move(di, dj, len(pools)))
            pools.append((state,))
    return StepPattern(f"slope{longest_run}", tuple(moves), tuple(pools), longest_run=longest_run)


_PATTERNS = {
    pattern.name: pattern
    for pattern in (
        _free("symmetric", ((1, 1), (1, 0), (0, 1))),
        _free("symmetric2", ((1, 1), (1, 0), (0, 1)), weighted=True),
        _free("asymmetric", ((1, 1), (1, 0), (1, 2))),
        *(_slope(k) for k in (1, 2, 3)),
    )
}


def step_pattern_named(name: str) -> StepPattern:
    """Look a pattern up by name; ``ValueError`` lists the names there are."""
    one_of("step_pattern", name, _PATTERNS)
    return _PATTERNS[name]

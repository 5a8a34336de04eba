"""Which moves a warp path may make: small automata over the cells of a cost matrix.

A path visits cells (i, j) of frames i of x and j of y. A state remembers how a cell was entered;
each of its arrivals says from where: the step (Δi, Δj) and the state held before it.

    C_s(i, j) = weight · D[i, j] + min over arrivals (Δi, Δj, r) of s   of   C_r(i − Δi, j − Δj)

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

Equal costs are settled by the order of the arrivals: the diagonal first, then Δi, then Δj.
"""

from typing import NamedTuple


class Arrival(NamedTuple):
    """One way into a cell: the step taken and the state held before it."""

    di: int
    dj: int
    state: int


class StepPattern(NamedTuple):
    """States of the path automaton; state 0 starts the path at cell (0, 0).

    ``arrivals[s]`` lists the ways into a cell in state s; ``weighted`` counts a cell Δi + Δj times.
    ``longest_run`` is the most steps on end along one axis, None without a limit.
    """

    name: str
    arrivals: tuple[tuple[Arrival, ...], ...]
    weighted: bool = False
    longest_run: int | None = None

    def weight(self, di: int, dj: int) -> int:
        """How often the cell entered by this step is counted."""
        return di + dj if self.weighted else 1

    @property
    def depth(self) -> int:
        """How many anti-diagonals back the furthest arrival reaches."""
        return max(a.di + a.dj for ways in self.arrivals for a in ways)

    def reaches(self, frames_x: int, frames_y: int) -> bool:
        """Whether some path joins the first cell to the last one."""
        if self.name == "asymmetric":
            return frames_y - 1 <= 2 * (frames_x - 1)
        if self.longest_run is None:
            return True
        short, long = sorted((frames_x - 1, frames_y - 1))
        return long <= self.longest_run + (self.longest_run + 1) * short


def _free(name: str, weighted: bool) -> StepPattern:
    ways = (Arrival(1, 1, 0), Arrival(1, 0, 0), Arrival(0, 1, 0))
    return StepPattern(name, (ways,), weighted)


def _slope(longest_run: int) -> StepPattern:
    """States: 0 after a diagonal, 1 … K after that many steps in x, K + 1 … 2K in y."""
    along_x = range(1, longest_run + 1)
    along_y = range(longest_run + 1, 2 * longest_run + 1)
    arrivals = [tuple(Arrival(1, 1, s) for s in (0, *along_x, *along_y))]
    for (di, dj), own, other in (((1, 0), along_x, along_y), ((0, 1), along_y, along_x)):
        arrivals.append(tuple(Arrival(di, dj, s) for s in (0, *other)))
        arrivals += [(Arrival(di, dj, s - 1),) for s in own[1:]]
    return StepPattern(f"slope{longest_run}", tuple(arrivals), longest_run=longest_run)


_PATTERNS = {
    pattern.name: pattern
    for pattern in (
        _free("symmetric", weighted=False),
        _free("symmetric2", weighted=True),
        StepPattern("asymmetric", ((Arrival(1, 1, 0), Arrival(1, 0, 0), Arrival(1, 2, 0)),)),
        *(_slope(k) for k in (1, 2, 3)),
    )
}


def step_pattern_named(name: str) -> StepPattern:
    """Look a pattern up by name; ``ValueError`` lists the names there are."""
    if name not in _PATTERNS:
        raise ValueError(f"step_pattern={name!r}; want one of {', '.join(_PATTERNS)}")
    return _PATTERNS[name]

"""A tree of joints worked through level by level, all joints of a level at once.

Arrays of joints first and time last ("lanes"): a joint is one block of memory, so levels and
parents are gathered by whole blocks. O(T·J).
"""

from functools import partial
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion.skeleton import levels_of

Lanes = Float[Array, "joint _ #time"]


class Levels:
    """The tree sorted by depth: index arrays for gathering parents and children."""

    def __init__(self, parents: tuple[int, ...]):
        self.levels = [np.array(level) for level in levels_of(parents)]
        self.restore = np.argsort(np.concatenate(self.levels))
        # up[d]: where in level d−1 the parent of each joint of level d is.
        # down[d][c]: the c-th child, in level d+1, of each joint of level d; the size means none.
        self.up = [np.zeros(1, int)]
        self.down = []
        for above, below in pairwise(self.levels):
            up = np.searchsorted(above, np.asarray(parents)[below])
            kin = [np.flatnonzero(up == k) for k in range(len(above))]
            width = max(len(k) for k in kin)
            self.up.append(up)
            self.down.append(
                np.stack([np.pad(k, (0, width - len(k)), constant_values=len(up)) for k in kin], 1)
            )

    def descend(self, own, join):
        """Root to leaves: ``y = join(y of the parent, own(joints))``, the root's is
        ``join(None, own([0]))``; both give pytrees of lanes."""
        levels = []
        for up, joints in zip(self.up, self.levels, strict=True):
            above = jax.tree.map(partial(rows_of, rows=up), levels[-1]) if levels else None
            # Without the barrier XLA recomputes each level inside the next.
            levels.append(jax.lax.optimization_barrier(join(above, own(joints))))
        joined = jax.tree.map(lambda *y: jnp.concatenate(y)[self.restore], *levels)
        return jax.lax.optimization_barrier(joined)

    def ascend(self, x: Lanes) -> Lanes:
        """Leaves to root: each joint's x plus the sums of its children."""
        levels = [x[self.levels[-1]]]
        for down, joints in zip(reversed(self.down), reversed(self.levels[:-1]), strict=True):
            below = jnp.pad(levels[-1], ((0, 1), (0, 0), (0, 0)))
            total = x[joints]
            for child in down:
                total = total + below[child]
            levels.append(jax.lax.optimization_barrier(total))
        return jnp.concatenate(levels[::-1])[self.restore]


def rows_of(x: Array, rows: np.ndarray) -> Array:
    """x[rows]; a slice where that is one, which XLA does not compute again for every reader."""
    first = rows[0] if len(rows) else 0
    if not np.array_equal(rows, np.arange(first, first + len(rows))):
        return x[rows]
    return x if len(rows) == len(x) else x[first : first + len(rows)]

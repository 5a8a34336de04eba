"""What augmenting makes of a clip, and which of it is sound."""

from collections.abc import Iterator
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxmotion._checks import traced
from jaxmotion._portable import Portable
from jaxmotion._summary import some
from jaxmotion.contacts import Contacts
from jaxmotion.motion import Motion


class Variations(Portable):
    """What :func:`augment` made of a clip, and which of it is sound. ``variations[i]`` is the i-th
    as a motion, ``len(variations)`` is n.

    **Fields:** ``motions``: a :class:`~jaxmotion.Motion` with translations f[n, T, J, 3] and
    rotations f[n, T, J, 4], of one skeleton and frame time; ``contacts``: where each one's feet are
    planted, arrays with n in front, or None; ``alpha``: f[n]; ``shares``: f[n, K + 1], of the
    clip's own manner and of K others; ``frames``: f[n, T], the frame of the clip that each frame
    shows; ``excess``: f[n, J], radians beyond the limits; ``slide``: f[n], mean speed of planted
    points, file unit a second; ``depth``: f[n], how far the lowest joint is below the clip's, file
    unit; ``most_slide``, ``most_depth``: f[], what is let pass.

    **Example:**

        >>> import jax, jaxmotion as jm
        >>> walk = jm.samples.load("walk").motion[:48]
        >>> made = jm.augment(walk, jax.random.key(0), n=3, keep_contacts=False)
        >>> len(made), made[0].num_frames, made.refused()
        (3, 48, {})
    """

    motions: Motion
    contacts: Contacts | None
    alpha: Float[Array, " variation"]
    shares: Float[Array, "variation style"]
    frames: Float[Array, "variation time"]
    excess: Float[Array, "variation joint"]
    slide: Float[Array, " variation"]
    depth: Float[Array, " variation"]
    most_slide: Float[Array, ""]
    most_depth: Float[Array, ""]

    @property
    def faults(self) -> dict[str, Bool[Array, "*batch variation"]]:
        """Which fail each of the checks, bool[n] by its name; what is not finite fails."""
        return _faults(jnp, *self._measures)

    @property
    def accepted(self) -> Bool[Array, "*batch variation"]:
        """Which fail none of them, bool[n]."""
        return ~jnp.any(jnp.stack(list(self.faults.values())), axis=0)

    @property
    def _measures(self) -> tuple:
        return self.excess, self.slide, self.depth, self.most_slide, self.most_depth

    def __len__(self) -> int:
        return self.alpha.shape[0]

    def __getitem__(self, number: int | np.integer) -> Motion:
        if not -len(self) <= number < len(self):
            raise IndexError(f"variation {number} of {len(self)}")
        both = self.motions.translations, self.motions.rotations
        return self.motions.with_transforms(*(x[number] for x in both))

    def __iter__(self) -> Iterator[Motion]:
        return (self[i] for i in range(len(self)))

    def sound(self) -> list[Motion]:
        """Those that were accepted, one clip each; not under ``jax.jit``."""
        return [self[i] for i in np.flatnonzero(self.accepted).tolist()]

    def refused(self) -> dict[int, str]:
        """Why the others were not, by number; not under ``jax.jit``."""
        numbers = np.flatnonzero(~np.asarray(self.accepted)).tolist()
        return {i: "; ".join(self._reasons(i)) for i in numbers}

    def _reasons(self, i: int) -> Iterator[str]:
        names, excess = self.motions.skeleton.names, np.asarray(self.excess[i])
        if not all(np.isfinite(x).all() for x in (excess, self.slide[i], self.depth[i])):
            yield "not finite"
            return
        beyond = [j for j in np.argsort(-excess, kind="stable") if excess[j] > 0]
        if beyond:
            far = ", ".join(f"{names[j]} {np.degrees(excess[j]):.3g}°" for j in beyond[:3])
            more = f" and {len(beyond) - 3} more" if len(beyond) > 3 else ""
            yield f"beyond joint limits: {far}{more}"
        if self.slide[i] > self.most_slide:
            yield f"feet slide at {self.slide[i]:.3g} a second, above {self.most_slide:.3g}"
        if self.depth[i] > self.most_depth:
            yield f"goes {self.depth[i]:.3g} below the floor, more than {self.most_depth:.3g}"

    def _words(self) -> Iterator[str]:
        yield some(len(self), "variation")
        yield some(self.motions.rotations.shape[1], "frame")
        if not traced(self._measures):
            found = _faults(np, *map(np.asarray, self._measures))
            yield f"{int(np.sum(~np.any(list(found.values()), axis=0)))} accepted"


def _faults(on: Any, excess, slide, depth, most_slide, most_depth) -> dict[str, Any]:
    """``on``: JAX's NumPy, or NumPy, which compiles nothing."""
    return {
        "joint limits": ~(on.max(excess, axis=-1) <= 0),
        "feet slide": ~(slide <= most_slide[..., None]),
        "below the floor": ~(depth <= most_depth[..., None]),
    }

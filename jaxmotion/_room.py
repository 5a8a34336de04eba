"""Room for clips: eager calls computed at one of a few sizes, so that clips of many lengths share
compiled programs (:mod:`jaxmotion.frames.padding`).

    room = room_for(motion, weights, length=length)     how large
    motion = room.fill(motion)                          the last frame repeated
    found = f(motion, length=room.length)
    return room.cut(found)                              the frames that count

What is traced, or comes with a length of its own, gets no room and stays as it is. O(T), on the
host: JAX would compile what fills and cuts for every length (``jnp.asarray`` of a NumPy array too,
where ``device_put`` does not).
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Int

from jaxmotion._types import AnyArray
from jaxmotion.displacement import Displacement
from jaxmotion.frames.padding import LONGEST, padded, program_size, shares_programs
from jaxmotion.motion import Motion

Clip = TypeVar("Clip")


class Room(NamedTuple):
    """``frames``: how many count; ``size``: at which is computed, 0 for the clip's own."""

    frames: int
    size: int = 0

    @property
    def length(self) -> int | None:
        """What to pass as ``length=``, None where nothing is padded."""
        return self.frames if self.size else None

    @property
    def count(self) -> Int[Array, ""]:
        """How many frames count, as an array: a program is compiled for any number."""
        return jax.device_put(np.array(self.frames, np.int32))

    def fill(self, clip: Clip, parts: Callable[[Clip], tuple] | None = None) -> Clip:
        """A motion or an array f[T, ...] at the size; or a tree, of which ``parts`` picks such."""
        return self._mapped(clip, lambda x: padded(x, self.size), parts)

    def cut(self, clip: Clip, parts: Callable[[Clip], tuple] | None = None, axis: int = 0) -> Clip:
        """A motion, displacement or array at the size, without the frames that do not count; or a
        tree, of which ``parts`` picks such; ``axis``: where an array's frames are."""
        counted = (slice(None),) * axis + (slice(self.frames),)
        return self._mapped(clip, lambda x: x[counted], parts)

    def _mapped(
        self, clip: Any, change: Callable[[Any], Any], parts: Callable[[Any], tuple] | None = None
    ) -> Any:
        if not self.size:
            return clip
        if parts is not None:
            return eqx.tree_at(parts, clip, tuple(self._mapped(x, change) for x in parts(clip)))
        if not isinstance(clip, (Motion, Displacement)):
            return jax.device_put(change(np.asarray(clip)))
        translations, rotations = (
            self._mapped(x, change) for x in (clip.translations, clip.rotations)
        )
        if isinstance(clip, Motion):
            return clip.with_transforms(translations, rotations)
        return Displacement(translations, rotations, clip.sense)


def room_for(
    clip: Motion | AnyArray, *given: Any, length: Any = None, longest: int | float = LONGEST
) -> Room:
    """Room for a motion or an array f[T, ...] of up to ``longest`` frames; none where it or
    anything ``given`` is traced, a ``length`` is given, or for one frame, which does not determine
    what comes after it."""
    frames = len(clip)
    shared = length is None and frames <= longest and shares_programs(frames, clip, given)
    return Room(frames, program_size(frames) if shared else 0)

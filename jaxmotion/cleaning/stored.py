"""A context that may be larger than memory: a :class:`jaxmotion.corpus.Corpus`, whose clips are
read one at a time, and of which nothing is kept but what is asked of it."""

import operator
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import jax
import numpy as np

from jaxmotion._checks import has_type
from jaxmotion._stored import StoredClips
from jaxmotion.cleaning.words import texture
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton


class Thin(StoredClips):
    """Every ``every``-th frame of the clips of a corpus, each ``frame_time`` after the other."""

    def __init__(self, corpus: StoredClips, every: int, frame_time: Any):
        self._corpus, self._every, self._frame_time = corpus, every, np.asarray(frame_time)

    @property
    def skeleton(self) -> Skeleton:
        """The corpus's."""
        return self._corpus.skeleton

    @property
    def dtype(self) -> np.dtype:
        """The corpus's."""
        return self._corpus.dtype

    @property
    def lengths(self) -> np.ndarray:
        """Frames that are left of each."""
        return -(-self._corpus.lengths // self._every)

    def digest(self) -> str:
        """The corpus's, and how it is thinned."""
        return f"{self._corpus.digest()}/{self._every}/{float(self._frame_time)!r}"

    def __len__(self) -> int:
        return len(self._corpus)

    def __getitem__(self, index: Any) -> Any:
        clip = self._corpus[operator.index(index)]
        # In NumPy: JAX would compile a slice of every length.
        thin = (np.asarray(x)[:: self._every] for x in (clip.translations, clip.rotations))
        t, q = (jax.device_put(x) if has_type(self.dtype) else x for x in thin)
        return clip.replace(translations=t, rotations=q, frame_time=self._frame_time)


class After(Sequence[Motion]):
    """A clip, and those of a corpus after it."""

    def __init__(self, first: Motion, corpus: StoredClips):
        self._first, self._corpus = first, corpus

    def __len__(self) -> int:
        return 1 + len(self._corpus)

    def __getitem__(self, index: Any) -> Any:
        number = operator.index(index)
        return self._first if number == 0 else self._corpus[number - 1]

    def __iter__(self) -> Iterator[Motion]:
        return (self[k] for k in range(len(self)))


class Shown(Sequence[np.ndarray]):
    """Textures f[T, J, 4] of a clip, ``own``, and of those frames of a corpus that ``places``
    i[S, 2] names, by the number of a clip, from 1 on, and the frame in it."""

    def __init__(
        self,
        own: np.ndarray,
        corpus: StoredClips,
        joints: tuple[int, ...],
        stands: Any,
        places: Any,
    ):
        self._own = own
        self._keys = np.unique(_key(*places.T))
        dtype = np.result_type(own.dtype, corpus.dtype)
        self._poses = np.empty((len(self._keys), *own.shape[1:]), dtype)
        clips, frames = np.divmod(self._keys, _CLIP)
        for clip in np.unique(clips):
            here = clips == clip
            whole = np.asarray(texture(corpus[int(clip) - 1], joints, stands))
            self._poses[here] = whole[frames[here]]

    def __len__(self) -> int:
        return 1

    def __getitem__(self, index: Any) -> Any:
        return (self._own,)[index]

    def at(self, clip: np.ndarray, frame: np.ndarray) -> np.ndarray:
        """The poses at these places, of the own clip where ``clip`` is 0."""
        own = clip == 0
        found = np.empty((*clip.shape, *self._own.shape[1:]), self._poses.dtype)
        found[own] = self._own[frame[own]]
        found[~own] = self._poses[np.searchsorted(self._keys, _key(clip[~own], frame[~own]))]
        return found


_CLIP = 2**32  # more than the frames of any clip


def _key(clip: np.ndarray, frame: np.ndarray) -> np.ndarray:
    return clip.astype(np.int64) * _CLIP + frame


def taken(textures: Sequence[np.ndarray], clip: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Poses of clips' textures, by number of the clip and frame in it."""
    if isinstance(textures, Shown):
        return textures.at(clip, frame)
    first = np.cumsum([0, *(len(x) for x in textures)])
    return np.concatenate(textures)[first[clip] + frame]


def places(found: Iterable[Any]) -> np.ndarray:
    """Where the neighbours of all searches are in a corpus: clips and frames, i[S, 2]."""
    parts = [np.zeros((0, 2), np.int64)]
    for neighbours in found:
        clip, warp = np.asarray(neighbours.clip), np.asarray(neighbours.warp)
        clip = np.broadcast_to(clip[..., None], warp.shape)
        parts.append(np.unique(np.stack([clip[clip > 0], warp[clip > 0]], axis=1), axis=0))
    return np.concatenate(parts)

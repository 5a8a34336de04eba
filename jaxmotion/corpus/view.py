"""Some of the clips of a store, as motions."""

import hashlib
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any

import jax
import numpy as np

from jaxmotion._checks import has_type
from jaxmotion.corpus.shards import Clip
from jaxmotion.corpus.store import Store
from jaxmotion.motion import Motion


class View:
    """Clips of a store, by ``numbers`` i64[C]. Nothing of it is JAX's but for what :meth:`motion`
    gives, so that windows are safe in a process that was forked."""

    def __init__(self, store: Store, numbers: np.ndarray):
        self.store, self.numbers = store, numbers

    def __getstate__(self) -> dict[str, Any]:
        return {"store": self.store, "numbers": self.numbers}

    def key(self) -> tuple:
        """What tells two views apart."""
        return tuple(map(str, self.store.files)), tuple(self.numbers.tolist())

    def digest(self) -> str:
        """What tells what is in two views apart."""
        shards = [path.name for path in self.store.files]
        about = [
            (shards[group], row) for group, row in map(self.store.place, self.numbers.tolist())
        ]
        return hashlib.blake2b(repr(about).encode(), digest_size=16).hexdigest()

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.store.names[k] for k in self.numbers)

    @property
    def lengths(self) -> np.ndarray:
        """Frames of each, i64[C]."""
        lengths = self.store.lengths[self.numbers]
        if not lengths.all():
            self.clip(int(np.argmin(lengths)))  # says what is wrong with it
        return lengths

    @property
    def joints(self) -> int:
        return self.store.settings.skeleton.num_joints

    def clip(self, k: int) -> Clip:
        return self.store.clip(int(self.numbers[k]))

    @cached_property
    def frame_time(self) -> np.ndarray:
        settings = self.store.settings
        return np.asarray(settings.frame_time, settings.dtype)

    def motion(self, k: int) -> Motion:
        """A clip, of JAX's arrays, or of NumPy's where JAX has none of that dtype."""
        clip = self.clip(k)
        arrays = (clip.offsets, clip.ends, clip.translations(), clip.rotations, self.frame_time)
        arrays = jax.device_put(arrays) if has_type(self.frame_time.dtype) else arrays
        return self.assembled(arrays, clip.translated)

    def windows(self, clips: Iterable[Any], starts: Iterable[Any], frames: int) -> list[np.ndarray]:
        """Offsets, end offsets, translations, rotations and frame times of ``frames`` from each of
        the clips, from a frame of each on; shorter clips go on with their last frame."""
        skeleton = self.store.settings.skeleton
        clips = [int(k) for k in clips]
        count = len(clips)
        kind, joints = self.frame_time.dtype, self.joints
        offsets = np.empty((count, joints, 3), kind)
        ends = np.empty((count, len(skeleton.end_joints), 3), kind)
        t, q = (np.empty((count, frames, joints, n), kind) for n in (3, 4))
        for row, (k, start) in enumerate(zip(clips, starts, strict=True)):
            clip = self.clip(k)
            there = min(frames, len(clip.rotations) - start)
            q[row, :there] = clip.rotations[start : start + there]
            clip.put_translations(t[row, :there], clip.moved[start : start + there])
            if there < frames:
                q[row, there:], t[row, there:] = q[row, there - 1], t[row, there - 1]
            offsets[row], ends[row] = clip.offsets, clip.ends
        return [offsets, ends, t, q, np.full(count, self.frame_time)]

    def assembled(self, arrays: Sequence, translated: tuple[int, ...] | None = None) -> Motion:
        """A motion of these arrays, with or without clips in front; ``translated``: joints, by
        default those that are in one of the store's clips."""
        if translated is None:
            translated = self.store.moving
        return jax.tree.unflatten(self._structure(translated), arrays)

    def _structure(self, translated: tuple[int, ...]):
        found = self._structures.get(translated)
        if found is None:
            settings = self.store.settings
            joints = settings.skeleton.num_joints
            t, q = (
                np.zeros((1, joints, 3), settings.dtype),
                np.zeros((1, joints, 4), settings.dtype),
            )
            q[..., 0] = 1
            text = settings.frame_time_text
            clip = Motion(
                settings.skeleton,
                *(t, q, settings.frame_time),
                translated_joints=translated,
                frame_time_text=text,
            )
            found = self._structures[translated] = jax.tree.structure(clip)
        return found

    @cached_property
    def _structures(self) -> dict[tuple[int, ...], Any]:
        return {}

"""The library's one currency: a skeleton and its local rigid transforms over time.

Every joint has a translation and a rotation in its parent's frame. ``translations[t, j]``
*replaces* the skeleton's offset (as BVH position channels do); a joint without position channels
repeats its offset. The root's transform is in the world.
"""

import dataclasses
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmotion._checks import floating, has_type, known, require, traced, warn
from jaxmotion._file_facts import file_fact
from jaxmotion._lazy import from_above
from jaxmotion._likely import doubt_frame_time, doubt_rotations
from jaxmotion._portable import Portable
from jaxmotion._program import one_program
from jaxmotion._summary import batched, called, html_table, kept_as, some, timing
from jaxmotion._types import AnyArray, Scalar
from jaxmotion.skeleton import Skeleton

__all__ = ["Motion"]

_LOOKED_AT = 16  # frames
_LONG = 8.0  # seconds: a frame that lasts longer is doubted at the door


class _Kept(NamedTuple):
    """A frame time that a motion has already: that of a derivative may be negative."""

    seconds: Any


class Motion(Portable):
    """A clip. Slice it along time: ``motion[10:90]``, ``motion[::2]`` (the frame time doubles).

    Clips put together by :func:`jaxmotion.stack` or ``jax.vmap`` are a batch: every array has the
    batch axes in front, those of the skeleton too.

    **Fields:**

    - ``skeleton``: the :class:`~jaxmotion.Skeleton`.
    - ``translations``: f[T, J, 3], local, file unit.
    - ``rotations``: f[T, J, 4], local unit quaternions (w, x, y, z).
    - ``frame_time``: f[], seconds, > 0; what is traced is taken as it is.
    - ``translated_joints``: joints whose translations may vary in time; static. The others stay at
      their offsets: algorithms read their first frame and skip the rest.
    - ``frame_time_text``: how the file spelt the frame time, kept for the round trip; a file fact
      (:mod:`jaxmotion._file_facts`): clips that differ in nothing else share compiled functions,
      can be stacked, and have, under a caller's ``jax.jit``, the text of the first clip traced.

    **Raises:** ``ValueError`` when shapes do not fit the skeleton, numbers are whole where they
    must be floating-point, a translated joint is none, or the frame time is known not to be
    positive and finite. **Warns:** where what is given, by Python or NumPy, is most likely meant in
    another convention: rotations (x, y, z, w) or of other norms, a frame rate for the frame time
    (:func:`jaxmotion.check` looks at all of a clip); of float64 where JAX has 64-bit types off.

    **Example:**

        >>> import jaxmotion as jm
        >>> motion = jm.samples.load("walk").motion
        >>> half_rate = motion[:20:2]
        >>> half_rate.rotations.shape, round(float(half_rate.fps), 1)
        ((10, 22, 4), 30.0)
        >>> round(float(motion.replace(frame_time=1 / 120).fps), 1)
        120.0
    """

    skeleton: Skeleton
    translations: Float[AnyArray, "*batch time joint 3"]
    rotations: Float[AnyArray, "*batch time joint 4"]
    frame_time: Scalar | Float[AnyArray, "*batch"]
    translated_joints: tuple[int, ...] = eqx.field(static=True)
    frame_time_text: str | None = file_fact()

    def __init__(
        self,
        skeleton: Skeleton,
        translations,
        rotations,
        frame_time,
        *,
        translated_joints: tuple[int, ...] | None = None,
        frame_time_text: str | None = None,
    ):
        joints = skeleton.num_joints
        shape = np.shape(rotations)
        if len(shape) < 3 or shape[-2:] != (joints, 4):
            ways = "; quaternion.from_euler takes angles, exp rotation vectors"
            hint = ways if shape[-2:] == (joints, 3) else ""
            raise ValueError(
                f"Motion: rotations must have shape (T, {joints}, 4), got {shape}{hint}"
            )
        if np.shape(translations) != (*shape[:-1], 3):
            raise ValueError(
                f"Motion: translations must have shape {(*shape[:-1], 3)} like the rotations, "
                f"got {np.shape(translations)}"
            )
        if any(not 0 <= j < joints for j in translated_joints or ()):
            raise ValueError(
                f"Motion: translated_joints must lie in 0..{joints - 1}, got {translated_joints}"
            )
        # Unpickled where JAX has no 64-bit types, a motion is whole, and so are its slices.
        translations, rotations = floating(
            "Motion",
            whole=not has_type(skeleton.offsets.dtype),
            translations=translations,
            rotations=rotations,
        )
        _doubt_rotations("Motion", rotations)
        if isinstance(frame_time, _Kept):
            frame_time = frame_time.seconds
        elif not traced(frame_time):
            seconds = known(frame_time).ravel().tolist()
            wrong = not all(0 < s < math.inf for s in seconds)
            require(None, wrong, "Motion: frame_time must be a time above 0", got=frame_time)
            long = not isinstance(frame_time, jax.Array) and min(seconds, default=0) > _LONG
            if long and (doubt := doubt_frame_time(float(seconds[0]))):
                warn("Motion", doubt)
        self.skeleton = skeleton
        self.translations = translations
        self.rotations = rotations
        dtype = jax.dtypes.canonicalize_dtype(rotations.dtype)
        if not isinstance(frame_time, jax.Array):
            frame_time = np.asarray(frame_time, dtype)  # JAX takes twice as long for it
        self.frame_time = jnp.asarray(frame_time, dtype)
        self.translated_joints = (
            tuple(range(joints)) if translated_joints is None else tuple(translated_joints)
        )
        self.frame_time_text = frame_time_text

    @classmethod
    def from_root(
        cls,
        skeleton: Skeleton,
        root_positions,
        rotations,
        frame_time,
        *,
        frame_time_text: str | None = None,
    ) -> "Motion":
        """A clip whose joints keep their offsets and only the root is translated.

        **Arguments:** ``skeleton``: of J joints; ``root_positions``: f[T, 3], world, file unit;
        ``rotations``: f[T, J, 4], local unit quaternions (w, x, y, z); ``frame_time``: seconds, >
        0; ``frame_time_text``: how a file spelt the frame time.
        **Returns:** a motion in the dtype of the rotations.
        **Raises:** ``ValueError`` when shapes do not fit the skeleton, numbers are whole where they
        must be floating-point, or the frame time is known not to be positive and finite.
        """
        root, rotations = floating(
            "Motion.from_root", root_positions=root_positions, rotations=rotations
        )
        _doubt_rotations("Motion.from_root", rotations)
        rotations = jax.device_put(rotations)  # jnp.asarray compiles
        translations = _with_root(skeleton.offsets, root, rotations)
        return cls(
            skeleton,
            translations,
            rotations,
            frame_time,
            translated_joints=(0,),
            frame_time_text=frame_time_text,
        )

    @property
    def num_frames(self) -> int:
        """T."""
        return self.rotations.shape[-3]

    @property
    def num_joints(self) -> int:
        """J."""
        return self.skeleton.num_joints

    @property
    def body_joint(self) -> int:
        """The joint that the body hangs from, whose path is the body's: the root, or, where a file
        puts a joint of its own above the hips, the last one down a chain of only children that are
        translated."""
        joint, children = 0, self.skeleton.children
        while len(children[joint]) == 1 and children[joint][0] in self.translated_joints:
            joint = children[joint][0]
        return joint

    @property
    def root_positions(self) -> Float[Array, "*batch time 3"]:
        """World positions of the root, a view of ``translations``. Where a file has a joint above
        the hips that stands still, see ``body_joint``."""
        return self.translations[..., 0, :]

    @property
    def fps(self) -> Array:
        """Frames a second, 1/frame_time."""
        return 1.0 / self.frame_time

    @property
    def duration(self) -> Array:
        """Seconds the clip lasts, num_frames · frame_time: every frame is there for one."""
        return self.num_frames * self.frame_time

    @property
    def times(self) -> Float[Array, "*batch time"]:
        """Time of each frame in seconds, starting at 0."""
        frames = jnp.arange(self.num_frames, dtype=self.rotations.dtype)
        return frames * self.frame_time[..., None]

    @property
    def dtype(self):
        """dtype of the rotations."""
        return self.rotations.dtype

    def __len__(self) -> int:
        return self.num_frames

    def __getitem__(self, frames: slice | int | np.integer) -> "Motion":
        """The chosen frames as a clip.

        **Arguments:** ``frames``: a slice, or one frame by number (T = 1).
        **Returns:** a new motion; its frame time is multiplied by the length of the slice's step.
        **Raises:** ``ValueError`` for anything else, or no frames; ``IndexError`` out of range.
        """
        if isinstance(frames, (int, np.integer)):
            if not -self.num_frames <= frames < self.num_frames:
                raise IndexError(f"frame {frames} of a motion of {self.num_frames} frames")
            frames = slice(int(frames), int(frames) + 1 or None)
        if not isinstance(frames, slice):
            raise ValueError(f"a motion is sliced along time, motion[10:90]; got {frames!r}")
        start, stop, step = frames.indices(self.num_frames)
        if len(range(start, stop, step)) == 0:
            raise ValueError(f"{frames} leaves none of the motion's {self.num_frames} frames")
        rate = {} if abs(step) == 1 else {"frame_time": self.frame_time * abs(step)}
        return self.replace(
            translations=self.translations[..., frames, :, :],
            rotations=self.rotations[..., frames, :, :],
            **rate,
        )

    def replace(self, **changes) -> "Motion":
        """A copy with some fields changed: ``motion.replace(frame_time=1 / 60)``.

        With the frame time, how the file spelt it is left out.

        **Arguments:** ``changes``: of ``skeleton``, ``translations`` f[T, J, 3], ``rotations``
        f[T, J, 4], ``frame_time`` in seconds, ``translated_joints`` and ``frame_time_text``, those
        that are to change, by name.
        **Returns:** a new motion.
        **Raises:** ``ValueError`` for another name, shapes that do not fit together, whole numbers
        where floating-point ones are needed, a translated joint that is none, or a frame time known
        not to be positive and finite.
        """
        fields = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        if unknown := sorted(set(changes) - set(fields)):
            raise ValueError(f"Motion.replace: {', '.join(unknown)}; expected of {list(fields)}")
        if "frame_time" in changes:
            fields["frame_time_text"] = None
        else:
            fields["frame_time"] = _Kept(self.frame_time)
        return Motion(**(fields | changes))

    def with_transforms(self, translations=None, rotations=None) -> "Motion":
        """The same clip with other translations and/or rotations.

        **Arguments:** ``translations``: f[T, J, 3]; ``rotations``: f[T, J, 4]; of any number of
        frames, None to keep those there are.
        **Returns:** a new motion.
        **Raises:** ``ValueError`` for shapes that do not fit each other or the skeleton, and whole
        numbers.
        """
        given = {"translations": translations, "rotations": rotations}
        return self.replace(**{name: x for name, x in given.items() if x is not None})

    def astype(self, dtype) -> "Motion":
        """The same clip with every array in another floating-point type."""

        return jax.tree.map(lambda x: jnp.asarray(x, dtype), self)

    def _words(self) -> Iterator[str]:
        *batch, frames, _, _ = self.rotations.shape
        yield batched(batch, "clip", some(frames, "frame"))
        yield from timing(frames, self.frame_time)
        yield from self.skeleton._figure()
        yield kept_as(self.rotations)

    def _repr_html_(self) -> str | None:
        """A table and, of a clip that is known, a small player, for notebooks; None (they print
        the line then) where arrays are something else, as a tree map makes them."""
        try:
            table = html_table(type(self).__name__, dict(self._rows()))
            thumbnail = from_above("jaxmotion.viz.player.thumbnail", "thumbnail")
            return table + (thumbnail(self) or "")
        except (AttributeError, IndexError, TypeError, ValueError):
            return None

    def _rows(self) -> Iterator[tuple[str, str]]:
        *batch, frames, _, _ = self.rotations.shape
        skeleton, known = self.skeleton, self.skeleton.conventions
        yield "Frames", batched(batch, "clip", some(frames, "frame"))
        for text in timing(frames, self.frame_time):
            yield "Time", text
        if self.frame_time_text is not None:
            yield "Frame time", f"{self.frame_time_text} s in the file"
        yield "Joints", f"{self.num_joints}: {called(skeleton.names, 6)}"
        yield "End sites", str(len(skeleton.end_joints))
        yield "Translated", called([skeleton.names[j] for j in self.translated_joints], 6)
        yield "Up", skeleton.up if known.up == "told" else f"{skeleton.up} ({known.up})"
        yield "Numbers", kept_as(self.rotations)


def _doubt_rotations(caller: str, rotations: AnyArray) -> None:
    """Warn if a few frames, of NumPy's, look like another convention; JAX's may be under way."""
    if isinstance(rotations, np.ndarray) and rotations.size:
        clip = np.asarray(rotations[(0,) * (rotations.ndim - 3)])
        if doubt := doubt_rotations(clip[:: 1 + len(clip) // _LOOKED_AT]):
            warn(caller, doubt[1])


@one_program()
def _with_root(
    offsets: Float[AnyArray, "... joint 3"],
    root: Float[AnyArray, "... 3"],
    rotations: Float[AnyArray, "*batch time joint 4"],
) -> Float[Array, "*batch time joint 3"]:
    """The offsets in every frame, with the root where it is."""
    still = offsets.astype(rotations.dtype)[..., None, :, :]
    still = jnp.broadcast_to(still, (*rotations.shape[:-1], 3))
    return still.at[..., 0, :].set(root)

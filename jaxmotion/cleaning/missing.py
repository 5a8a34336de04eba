"""Frames that are not there: entries that are not finite, filled from the frames about them."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxmotion._checks import known, traced
from jaxmotion._entry import one_clip
from jaxmotion.cleaning.turns import between
from jaxmotion.frames.runs import last_before, next_after
from jaxmotion.motion import Motion


def filled(caller: str, motion: Motion) -> tuple[Motion, Bool[np.ndarray, "time joint"]]:
    """The clip with numbers in all frames, and which entries had none. A joint goes the short way,
    at one speed, between the frames it has; before the first and after the last it stands, and
    where it has none it is as the skeleton has it. O(T·J)."""
    one_clip(caller, motion, on_host=True)
    if traced(motion.rotations, motion.translations):
        raise ValueError(f"{caller}: motion is traced; call it outside of jit and vmap")
    rotations, translations = (
        np.asarray(known(x)) for x in (motion.rotations, motion.translations)
    )
    turns = np.asarray(np.isfinite(rotations).all(axis=-1))
    moves = np.asarray(np.isfinite(translations).all(axis=-1))
    missing = ~(turns & moves)
    if not missing.any():
        return motion, missing
    offsets = np.broadcast_to(known(motion.skeleton.offsets), translations.shape)
    one = np.array([1, 0, 0, 0], rotations.dtype)
    rotations = bridged(np.where(turns[..., None], rotations, one), turns)
    before, after, way = _beside(moves, translations.dtype)
    safe = np.where(
        moves[..., None] | np.asarray(moves.any(axis=0))[:, None], translations, offsets
    )
    first, final = _at(safe, before), _at(safe, after)
    straight = first + way[..., None] * (final - first)
    translations = np.where(moves[..., None], translations, straight)
    return motion.with_transforms(jnp.asarray(translations), jnp.asarray(rotations)), missing


def bridged(
    rotations: Float[np.ndarray, "time joint 4"], there: Bool[np.ndarray, "time joint"]
) -> Float[np.ndarray, "time joint 4"]:
    """The rotations, and where they are not ``there`` the short way between those beside."""
    before, after, way = _beside(there, rotations.dtype)
    short = between(_at(rotations, before), _at(rotations, after), way)
    return np.where(there[..., None], rotations, short)


def _beside(there: Any, kind) -> tuple[np.ndarray, ...]:
    """The frames that a joint has before and after each, and how far between them that is."""
    last, last_frame = np.asarray(last_before(there)), len(there) - 1
    after = np.asarray(next_after(there))
    before = np.where(last < 0, np.minimum(after, last_frame), last)
    after = np.where(after > last_frame, before, after)
    apart = np.maximum(after - before, 1)
    way = (np.arange(len(there))[:, None] - before) / apart
    return before, after, np.clip(way, 0, 1).astype(kind)


def _at(values: np.ndarray, frames: np.ndarray) -> np.ndarray:
    return np.take_along_axis(values, frames[..., None], axis=0)

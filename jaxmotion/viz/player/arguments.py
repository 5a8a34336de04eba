"""What :func:`~jaxmotion.viz.player` was given, by the name of the motion that it belongs to."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from jaxmotion._checks import no_module, one_of, traced
from jaxmotion._entry import one_clip
from jaxmotion.cleaning import DetectedErrors
from jaxmotion.contacts import Contacts
from jaxmotion.contacts.contact import check_frames
from jaxmotion.motion import Motion

THEMES = ("auto", "light", "dark")
_LARGEST = 1e30


class Curve(NamedTuple):
    """``values``: f64[T] or f64[T, J], of the motion ``of``, or in its frames of all motions."""

    name: str
    of: str
    values: np.ndarray
    is_shared: bool = False


class Given(NamedTuple):
    """``contacts`` and ``errors`` (bool[T, J]) by the name of their motion."""

    motions: dict[str, Motion]
    contacts: dict[str, Contacts]
    errors: dict[str, np.ndarray]
    curves: list[Curve]


def read(motion: Any, contacts: Any, errors: Any, curves: Any, theme: Any) -> Given:
    """``ValueError`` for what does not fit together, ``TypeError`` for what is traced."""
    one_of("player: theme", theme, THEMES)
    if not isinstance(motion, Mapping):
        motion = {"": motion}
    if not motion:
        raise ValueError("player: no motion is given; expected one, or some by name")
    motions = {str(name): clip for name, clip in motion.items()}
    if len(motions) < len(motion):
        raise ValueError(f"player: names {list(motion)} are the same as text")
    for name, clip in motions.items():
        one_clip("player", clip, f"motion[{name!r}]" if name else "motion", on_host=True)
    if traced(motions, contacts, errors, curves):
        raise TypeError("player: a page cannot be made inside of jit; call it on what jit returns")
    for clip in motions.values():
        if not 0 < float(clip.frame_time) < math.inf:
            raise ValueError(f"player: frame_time={clip.frame_time}; expected a time above 0")
    found = {name: _errors(motions[name], x) for name, x in _each("errors", errors, motions)}
    return Given(
        motions,
        {name: _contacts(motions[name], x) for name, x in _each("contacts", contacts, motions)},
        {name: mask for name, (mask, _) in found.items()},
        [Curve("digression", name, mdm) for name, (_, mdm) in found.items() if mdm is not None]
        + _curves(motions, {} if curves is None else curves),
    )


def _each(name: str, value: Any, motions: dict[str, Motion]) -> list[tuple[str, Any]]:
    """(name of the motion, value) pairs; what has no name belongs to the first."""
    if value is None:
        return []
    if not isinstance(value, Mapping):
        return [(next(iter(motions)), value)]
    for key in value:
        one_of(f"player: a name in {name}", key, motions)
    return list(value.items())


def _contacts(motion: Motion, contacts: Any) -> Contacts:
    check_frames(motion, contacts, "player", on_host=True)
    if any(joint >= motion.num_joints for joint in contacts.joints):
        raise ValueError("player: contacts are of joints that the motion does not have")
    return contacts


def _errors(motion: Motion, errors: Any) -> tuple[np.ndarray, np.ndarray | None]:
    """The mask, and how far the joints digress if that is told."""
    told = None
    if isinstance(errors, DetectedErrors):
        told = _numbers("errors.mdm", errors.mdm, motion)
        errors = errors.mask
    no_module("player: errors", errors, "jaxmotion.cleaning.detect_errors finds them")
    mask = np.asarray(errors)
    frames, joints = motion.num_frames, motion.num_joints
    if mask.dtype != bool or mask.shape not in ((frames,), (frames, joints)):
        raise ValueError(
            f"player: errors are {mask.dtype} of shape {mask.shape}; expected DetectedErrors, or a "
            f"mask bool[{frames}] or bool[{frames}, {joints}]"
        )
    return np.broadcast_to(mask.reshape(frames, -1), (frames, joints)), told


def _curves(motions: dict[str, Motion], curves: Any) -> list[Curve]:
    if not isinstance(curves, Mapping):
        raise ValueError('player: curves need names; expected a dict, {"name": f[T] or f[T, J]}')
    return [
        Curve(
            str(name),
            of,
            _numbers(f"curves[{name!r}]", values, motions[of]),
            not isinstance(given, Mapping),
        )
        for name, given in curves.items()
        for of, values in _each(f"curves[{name!r}]", given, motions)
    ]


def _numbers(name: str, values: Any, motion: Motion) -> np.ndarray:
    no_module(f"player: {name}", values)
    numbers = np.asarray(values)
    frames, joints = motion.num_frames, motion.num_joints
    is_real = numbers.dtype.kind in "fiub"
    if not is_real or numbers.shape not in ((frames,), (frames, joints)):
        raise ValueError(
            f"player: {name} is {numbers.dtype} of shape {numbers.shape}; expected numbers of "
            f"shape ({frames},) or ({frames}, {joints}), (time, joint)"
        )
    made = numbers.astype(np.float64)
    if (np.abs(made[np.isfinite(made)]) > _LARGEST).any():
        raise ValueError(f"player: {name} has numbers beyond {_LARGEST:g}, which no page can draw")
    return made

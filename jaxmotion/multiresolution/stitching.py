"""Clips joined end to end without a seam (Lee & Shin 2001, §4.4, Eq. 21 corrected).

    i < e  from A      i = e  ½A + ½B      i > e  B(i − e)        e A's last frame, on every level

A's last frame and B's first become one: poses of the base by the midpoint, details by half the sum,
so a difference of poses is spread over the base's frames about the seam, 2·2ᴺ of the finest, while
what is finer changes hands within its own time. (The printed indices run past A's end.)

A clip whose length does not halve evenly is continued by a frame at a level (L3 of
:mod:`~jaxmotion.multiresolution.levels`): A at its start, B at its end, so the seam lies on a frame
of every level. B is first moved rigidly in the ground plane to stand where A ends. Contacts are not
kept: repair them afterwards. O(T·J), differentiable in the clips.
"""

from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from jaxmotion import quaternion
from jaxmotion.displacement import Displacement
from jaxmotion.motion import Motion
from jaxmotion.multiresolution.cascade import level_sizes
from jaxmotion.multiresolution.operations import with_moving_joints
from jaxmotion.multiresolution.poses import check_single
from jaxmotion.multiresolution.pyramid import Pyramid, build_pyramid, level_count, synthesize

_HALF_TRANSITION = 0.5  # seconds


def stitch(motions: Sequence[Motion], levels: int | None = None, *, align: bool = True) -> Motion:
    """Clips one after another, seamlessly.

    **Arguments:** ``motions``: one or more clips of one skeleton and frame time; ``levels``: N,
    a transition takes about 2·2ᴺ frames; by default the power of two that is nearest to half a
    second (which needs a concrete frame time), or less if a clip is short; ``align``: move each
    clip in the ground plane (:func:`follow`) to where the one before it ends.
    **Returns:** T_A + T_B − 1 + T_C − 1 … frames.
    **Raises:** ``ValueError`` for no clips, or clips of different skeletons or frame times.
    Lee & Shin 2001, Eq. 21.
    """
    if not motions:
        raise ValueError("stitch: motions is empty; expected at least one clip")
    first, *others = motions
    check_single(first, "stitch")
    for clip in others:
        _check_pair(first, clip)
    moving = tuple(sorted({j for m in motions for j in m.translated_joints}))
    if levels is None:
        levels = _default_levels(motions)
    for clip in motions:
        level_count(clip.num_frames, levels, "stitch")
    joined = with_moving_joints(first, moving)
    for clip in others:
        joined = _stitch(joined, with_moving_joints(clip, moving), levels, align)
    return joined


def follow(first: Motion, second: Motion) -> Motion:
    """``second`` turned about the vertical and moved over the ground so that its root starts where
    the root of ``first`` ends; heights and tilts stay.

    **Arguments:** two clips of one skeleton. **Returns:** a motion of ``second``'s shape.
    **Raises:** ``ValueError`` for different skeletons.
    """
    _check_pair(first, second)
    return _follow(first, second)


@eqx.filter_jit
def _follow(first: Motion, second: Motion) -> Motion:
    up = np.eye(3)["xyz".index(second.skeleton.up)]
    end, start = first.rotations[-1, 0], second.rotations[0, 0]
    apart = quaternion.multiply(end, quaternion.conjugate(start))
    axis = jnp.asarray(up, apart.dtype)
    twist = quaternion.normalize(jnp.concatenate([apart[:1], jnp.sum(apart[1:] * axis) * axis]))
    p = jnp.asarray(second.translations)
    origin = p[0, 0]
    target = jnp.asarray(first.translations)[-1, 0] * (1 - axis) + origin * axis
    root = quaternion.rotate(twist, p[:, 0] - origin) + target
    turned = quaternion.multiply(twist, second.rotations[:, 0])
    return second.with_transforms(
        p.at[:, 0].set(root), jnp.asarray(second.rotations).at[:, 0].set(turned)
    )


@eqx.filter_jit
def _stitch(first: Motion, second: Motion, levels: int, align: bool) -> Motion:
    if align:
        second = _follow(first, second)
    a = _reversed(build_pyramid(first[::-1], levels))
    b = build_pyramid(second, levels)
    half = jnp.asarray(0.5, first.dtype)
    middle = quaternion.slerp(a.base.rotations[-1], b.base.rotations[0], half)
    base = a.base.with_transforms(
        _joined(a.base.translations, b.base.translations),
        jnp.concatenate([a.base.rotations[:-1], middle[None], b.base.rotations[1:]]),
    )
    details = tuple(
        Displacement(
            _joined(x.translations, y.translations), _joined(x.rotations, y.rotations), "body"
        )
        for x, y in zip(a.details, b.details, strict=True)
    )
    return synthesize(
        Pyramid(
            base=base,
            details=details,
            times=None,
            length=None,
            frames=tuple(x + y - 1 for x, y in zip(a.frames, b.frames, strict=True)),
            skips=a.skips,
            lazy=False,
            frame_time_text=first.frame_time_text,
        ),
        None,
    )


def _joined(a: Array, b: Array) -> Array:
    return jnp.concatenate([a[:-1], 0.5 * (a[-1:] + b[:1]), b[1:]])


def _reversed(pyramid: Pyramid) -> Pyramid:
    """The pyramid of the clip run backwards: continued at its start, not its end."""
    levels = range(pyramid.levels)
    drawn = [2 * pyramid.frames[n] - 1 - pyramid.frames[n + 1] for n in levels]
    flipped = jax.tree.map(lambda x: x[::-1], (pyramid.base.rotations, pyramid.details))
    rotations, details = flipped
    return replace(
        pyramid,
        base=pyramid.base.with_transforms(pyramid.base.translations[::-1], rotations),
        details=details,
        skips=tuple(drawn[n] - pyramid.skips[n] for n in levels),
    )


def _default_levels(motions: Sequence[Motion]) -> int:
    fps = motions[0].fps
    if isinstance(fps, Tracer):
        raise ValueError("stitch: the frame time is traced; give levels")
    wanted = max(0, round(float(np.log2(_HALF_TRANSITION * float(fps)))))
    return min(wanted, *(len(level_sizes(m.num_frames)) - 1 for m in motions))


def _check_pair(first: Motion, second: Motion) -> None:
    check_single(second, "stitch")
    if second.skeleton.names != first.skeleton.names:
        raise ValueError(
            f"stitch: the clips have different joints, {list(first.skeleton.names)} and "
            f"{list(second.skeleton.names)}"
        )
    frame_times = first.frame_time, second.frame_time
    if any(isinstance(t, Tracer) for t in frame_times):
        return
    one, other = (float(t) for t in frame_times)
    if abs(one - other) > 1e-4 * one:
        raise ValueError(f"stitch: the clips have frame times {one:g} and {other:g}; resample one")

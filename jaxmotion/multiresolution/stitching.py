"""Clips joined end to end without a seam (Lee & Shin 2001, §4.4, Eq. 21 corrected).

    i < e  from A      i = e  ½A + ½B      i > e  B(i − e)        e A's last frame, on every level

A's last frame and B's first become one: poses of the base by the midpoint, details by half the sum,
so a difference of poses is spread over the base's frames about the seam, 2·2ᴺ of the finest, while
what is finer changes hands within its own time. (The printed indices run past A's end.)

A clip whose length does not halve evenly is continued by a frame at a level (L3 of
:mod:`~jaxmotion.multiresolution.levels`): A at its start, B at its end, so the seam lies on a frame
of every level. B is first moved rigidly in the ground plane to stand where A ends, and on request
both are cut where they agree best: the pair of frames (i, j) with the least mean pose distance over
frames i + k, j + k, |k| ≤ 2, which weighs velocities too. Contacts are not kept: repair them
afterwards. O(T·J), differentiable in the clips (not in the choice of the cut).
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
from jaxmotion.multiresolution.pyramid import Pyramid, build_pyramid, synthesize
from jaxmotion.timing import pose_distance

_HALF_TRANSITION = 0.5  # seconds
_AROUND = 2  # frames beside a cut that are compared too


def stitch(
    motions: Sequence[Motion],
    levels: int | None = None,
    *,
    align: bool = True,
    search: int = 0,
) -> Motion:
    """Clips one after another, seamlessly.

    **Arguments:** ``motions``: one or more clips of one skeleton and frame time; ``levels``: N,
    a transition takes about 2·2ᴺ frames; by default the power of two that is nearest to half a
    second (which needs a concrete frame time), or less if a clip is short; ``align``: move each
    clip in the ground plane (:func:`follow`) to where the one before it ends; ``search``: drop up
    to so many frames on either side of a seam to cut where the clips agree (:func:`best_cut`).
    **Returns:** T_A + T_B − 1 + T_C − 1 … frames, less what the search dropped.
    **Raises:** ``ValueError`` for no clips, clips of different skeletons or frame times, or a
    search in traced clips.
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
    joined = with_moving_joints(first, moving)
    for clip in others:
        if search:
            end, start = best_cut(joined, clip, search)
            joined, clip = joined[: joined.num_frames - end], clip[start:]
        joined = _stitch(joined, with_moving_joints(clip, moving), levels, align)
    return joined


def best_cut(first: Motion, second: Motion, search: int) -> tuple[int, int]:
    """How many frames to drop at the end of ``first`` and at the start of ``second`` so that the
    clips agree best: at most ``search`` of each, and at most half of a clip.

    Poses are compared by the local rotations of all joints but the root, whose place and heading
    :func:`follow` sees to. O(search²·J), not traceable.

    **Raises:** ``ValueError`` for clips of different skeletons, traced clips or a negative search.
    """
    _check_pair(first, second)
    if search < 0 or isinstance(first.rotations, Tracer) or isinstance(second.rotations, Tracer):
        raise ValueError(f"best_cut: search={search}; expected 0 or more, and clips not traced")
    joints = slice(1 if first.num_joints > 1 else 0, None)
    rows, columns = (min(search, m.num_frames // 2) + 1 for m in (first, second))
    ends = np.asarray(first.rotations)[-rows - _AROUND :, joints]
    starts = np.asarray(second.rotations)[: columns + _AROUND, joints]
    distance = np.asarray(pose_distance(ends, starts))
    before = len(ends) - rows  # frames of context
    total, number = np.zeros((2, rows, columns))
    for k in range(-_AROUND, _AROUND + 1):
        i, j = np.arange(rows) + before + k, np.arange(columns) + k
        there = np.ix_((i >= 0) & (i < len(ends)), (j >= 0) & (j < len(starts)))
        known = distance[np.ix_(i[(i >= 0) & (i < len(ends))], j[(j >= 0) & (j < len(starts))])]
        total[there] += known
        number[there] += 1
    i, j = np.unravel_index(np.argmin(total / number), total.shape)
    return rows - 1 - int(i), int(j)


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


def _stitch(first: Motion, second: Motion, levels: int, align: bool) -> Motion:
    if align:
        second = _follow(first, second)
    # Not one program: clips of one length share theirs.
    ends, starts = build_pyramid(first[::-1], levels), build_pyramid(second, levels)
    return synthesize(_concatenated(ends, starts, first.frame_time_text), None)


@eqx.filter_jit
def _concatenated(ends: Pyramid, starts: Pyramid, frame_time_text: str | None) -> Pyramid:
    a, b = _reversed(ends), starts
    half = jnp.asarray(0.5, a.base.dtype)
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
    return Pyramid(
        base=base,
        details=details,
        times=None,
        length=None,
        frames=tuple(x + y - 1 for x, y in zip(a.frames, b.frames, strict=True)),
        skips=a.skips,
        lazy=False,
        frame_time_text=frame_time_text,
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

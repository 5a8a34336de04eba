"""Clips joined end to end without a seam (Lee & Shin 2001, §4.4, Eq. 21 corrected).

    i < e  from A      i = e  ½A + ½B      i > e  B(i − e)        e A's last frame, on every level

A's last frame and B's first become one: poses of the base by the midpoint, details by half the sum,
so a difference of poses is spread over the base's frames about the seam, 2·2ᴺ of the finest, while
what is finer changes hands within its own time. (The printed indices run past A's end.)

A clip whose length does not halve evenly is continued by a frame at a level (L3 of
:mod:`~jaxmotion.multiresolution.levels`): A at its start, B at its end, so the seam lies on a frame
of every level. B is first moved rigidly in the ground plane to stand where A ends, and on request
both are cut where the joint shows least: the pair of frames (i, j) with the smallest

    max(peak of |a| in A before i, in B after j)  +  |Δpose/τ² , Δv/τ , Δa|

an estimate of the largest acceleration about the seam: what the clips have there of their own, and
what a transition of τ = ¼ s must add; v, a angular velocities and accelerations of the joints, |·|
root mean squares over them. Contacts are kept on request, those of the clips where they were
moved to. O(T·J), differentiable
in the clips (not in the choice of the cut).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmotion import quaternion, spacetime
from jaxmotion._checks import instance_of, static, traced
from jaxmotion._file_facts import compiled
from jaxmotion._posture import hung, pose_in_world
from jaxmotion.contacts import Contacts
from jaxmotion.contacts.contact import check_kept
from jaxmotion.displacement import Displacement
from jaxmotion.motion import Motion
from jaxmotion.multiresolution.operations import with_moving_joints
from jaxmotion.multiresolution.poses import checked_alike
from jaxmotion.multiresolution.pyramid import Pyramid, build_pyramid, level_count
from jaxmotion.multiresolution.schedule import level_sizes
from jaxmotion.quaternion.arcs import twist

_HALF_TRANSITION = 0.5  # seconds
_BESIDE = 0.25  # seconds about a cut that are looked at


@static("levels", "align", "search", "keep_contacts")
def stitch(
    motions: Sequence[Motion],
    levels: int | None = None,
    *,
    align: bool = True,
    search: int = 0,
    keep_contacts: Contacts | bool = False,
) -> Motion:
    """Clips one after another, seamlessly.

    Lee & Shin 2001, Eq. 21, corrected.

    **Arguments:** ``motions``: one or more clips of one skeleton and frame time; ``levels``: N, a
    transition takes about 2·2ᴺ frames; by default the power of two that is nearest to half a second
    (which needs a concrete frame time), or less if a clip is short; ``align``: move each clip in
    the ground plane (:func:`follow`) to where the one before it ends; ``search``: drop up to so
    many frames on either side of a seam to cut where it shows least (:func:`best_cut`);
    ``keep_contacts``: True finds what touches in the clips, put end to end, and restores it
    (:func:`jaxmotion.spacetime.keep_contacts`), contacts are restored as given, for the frames of
    the result (under ``jit`` only these), False lets them go.
    **Returns:** a motion of T_A + T_B − 1 + T_C − 1 … frames, less what the search dropped.
    **Raises:** ``ValueError`` for no clips, what is not one clip of finite numbers, clips of
    different joints or frame times, levels that a clip does not allow, a negative search or one in
    traced clips, a traced frame time without ``levels``, contacts of another number of frames, or
    True for them under ``jit``; at run time for traced frame times that differ.
    """
    joined, unseamed, _ = stitched(motions, levels, align=align, search=search)
    check_kept(joined, keep_contacts, "stitch")
    return spacetime.keep_contacts(joined, original=unseamed, contacts=keep_contacts)


class Stitched(NamedTuple):
    """Clips put together: ``motion``; ``end_to_end``, the same frames as they were in the clips,
    where these were moved to; ``seams``, the frames where one clip becomes the next."""

    motion: Motion
    end_to_end: Motion
    seams: tuple[int, ...]


def stitched(
    motions: Sequence[Motion], levels: int | None = None, *, align: bool = True, search: int = 0
) -> Stitched:
    """:func:`stitch` before contacts are kept, and what is known of it."""
    instance_of("stitch: motions", motions, Sequence, "a list of clips")
    if not motions:
        raise ValueError("stitch: motions is empty; expected at least one clip")
    _check_search(search, "stitch")
    numbered = {f"motions[{i}]": clip for i, clip in enumerate(motions)}
    first, *others = checked_alike("stitch", numbered)
    for clip in motions:
        level_count(clip.num_frames, levels, "stitch")
    moving = tuple(sorted({j for m in motions for j in m.translated_joints}))
    joined = unseamed = with_moving_joints(first, moving)
    seams: list[int] = []
    for clip in others:
        if search:
            _check_known(joined, clip, "stitch")
            end, start = _best_cut(joined, clip, search)
            left = joined.num_frames - end
            joined, unseamed, clip = joined[:left], unseamed[:left], clip[start:]
        depth = _default_levels(joined, clip) if levels is None else levels
        level_count(min(joined.num_frames, clip.num_frames), depth, "stitch")
        clip = with_moving_joints(clip, moving)
        if align:
            clip = _follow(joined, clip)
        seams = [min(seam, joined.num_frames - 1) for seam in [*seams, joined.num_frames - 1]]
        joined, unseamed = _stitch(joined, clip, depth), _end_to_end(unseamed, clip)
    return Stitched(joined, unseamed, tuple(seams))


@static("search")
def best_cut(first: Motion, second: Motion, search: int) -> tuple[int, int]:
    """How many frames to drop on either side of a seam so that it shows least.

    The root, whose place and heading :func:`follow` sees to, is not compared, but its own
    acceleration counts. The module has what is minimised. O(search²·J), not traceable.

    **Arguments:** ``first``, ``second``: single clips of one skeleton and frame time; ``search``:
    how many frames at most of each, and at most half of a clip.
    **Returns:** (frames at the end of ``first``, frames at the start of ``second``), whole numbers.
    **Raises:** ``ValueError`` for clips of different joints or frame times, traced clips or a
    negative search.
    """
    first, second = checked_alike("best_cut", {"first": first, "second": second}, on_host=True)
    _check_search(search, "best_cut")
    _check_known(first, second, "best_cut")
    return _best_cut(first, second, search)


def _check_search(search: int, caller: str) -> None:
    if not isinstance(search, (int, np.integer)) or search < 0:
        raise ValueError(f"{caller}: search={search}; expected a whole number of frames, 0 or more")


def _check_known(first: Motion, second: Motion, caller: str) -> None:
    if traced(*(x for m in (first, second) for x in (m.rotations, m.frame_time))):
        raise ValueError(f"{caller}: the clips are traced; a cut is searched in known clips only")


def _best_cut(first: Motion, second: Motion, search: int) -> tuple[int, int]:
    beside = round(_BESIDE / float(first.frame_time))
    rows, columns = (min(search, m.num_frames // 2) + 1 for m in (first, second))
    body = _body_of(first, second)
    *ends, peak = _kinetics(first[-(rows + beside) :], body)
    *starts, other = _kinetics(second[: columns + beside], body)
    last = len(peak) - rows
    before = [peak[max(last + i - beside, 0) : last + i + 1].max() for i in range(rows)]
    after = [other[j : j + beside + 1].max() for j in range(columns)]
    q, v, a = (x[-rows:] for x in ends)
    r, w, b = (x[:columns] for x in starts)
    added = _apart(q, r) / _BESIDE**4 + _squares_apart(v, w) / _BESIDE**2 + _squares_apart(a, b)
    shown = np.maximum.outer(before, after) + np.sqrt(added)
    i, j = np.unravel_index(np.argmin(shown), shown.shape)
    return rows - 1 - int(i), int(j)


def _kinetics(motion: Motion, body: int) -> tuple[np.ndarray, ...]:
    """Rotations of the joints below the ``body``'s f64[T, J, 4], their angular velocities and
    accelerations f64[T, 3J], each the last axis of one frame, over √J, and the size of the
    acceleration of all f64[T]."""
    q = np.asarray(motion.rotations, np.float64)
    frames, joints = q.shape[:2]
    step = quaternion.log(quaternion.between(jnp.asarray(q[:-1]), jnp.asarray(q[1:])))
    v = np.asarray(step, np.float64) / float(motion.frame_time)
    if frames < 2:
        v = np.zeros((1, joints, 3))
    a = np.diff(v, axis=0) / float(motion.frame_time) if frames > 2 else 0 * v[:1]
    a = np.concatenate([a[:1], a, a[-1:]])[:frames]
    v = 0.5 * (np.concatenate([v[:1], v]) + np.concatenate([v, v[-1:]]))[:frames]
    size = np.sqrt(np.mean(np.sum(a * a, axis=-1), axis=-1))
    some = slice(body + 1 if joints > body + 1 else 0, None)
    flat = (x[:, some].reshape(len(x), -1) / np.sqrt(q[:, some].shape[1]) for x in (v, a))
    return q[:, some], *flat, size


def _apart(q: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Mean square of the joints' angles between all poses of two clips."""
    cosine = np.abs(np.einsum("ijk,ljk->ilj", q, r))
    return np.mean((2 * np.arccos(np.minimum(cosine, 1))) ** 2, axis=-1)


def _squares_apart(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """‖x_i − y_j‖² for all i and j."""
    squares = np.sum(x * x, -1)[:, None] + np.sum(y * y, -1) - 2 * x @ y.T
    return np.maximum(squares, 0)


def follow(first: Motion, second: Motion) -> Motion:
    """``second`` put where ``first`` ends: turned about the vertical, moved over the ground.

    Its root then starts where the root of ``first`` ends; heights and tilts stay. Where a file has
    joints above the hips, the hips do (``motion.body_joint``), and those joints stay as ``first``
    leaves them, so that they do not move at a seam.

    **Arguments:** ``first``, ``second``: single clips of one skeleton and frame time.
    **Returns:** a motion of ``second``'s shape, whose body joint is translated.
    **Raises:** ``ValueError`` for clips of different joints or frame times, at run time for frame
    times that are traced.
    """
    return _follow(*checked_alike("follow", {"first": first, "second": second}, finite=False))


@compiled
def _follow(first: Motion, second: Motion) -> Motion:
    axis = jnp.asarray(np.eye(3)[second.skeleton.up_axis], second.dtype)
    body, last = _body_of(first, second), first[-1]
    end_place, end = (x[0] for x in pose_in_world(last, body))
    place, turned = pose_in_world(second, body)
    heading = twist(quaternion.multiply(end, quaternion.conjugate(turned[0])), axis)
    origin = place[0]
    target = end_place * (1 - axis) + origin * axis
    place = quaternion.rotate(heading, place - origin) + target
    turned = quaternion.multiply(heading, turned)
    # The joints above, one below the other, stay as the first clip leaves them.
    p, q = jnp.asarray(second.translations), jnp.asarray(second.rotations)
    moving = tuple(sorted({*second.translated_joints, body}))
    held = with_moving_joints(second, moving).with_transforms(
        p.at[:, :body].set(last.translations[:, :body]),
        q.at[:, :body].set(last.rotations[:, :body]),
    )
    return hung(held, body, place, turned)


def _body_of(first: Motion, second: Motion) -> int:
    """The joint that the body of both hangs from."""
    return max(first.body_joint, second.body_joint)


def _end_to_end(first: Motion, second: Motion) -> Motion:
    """The clips as they are, the last frame of the first left out."""
    return first.with_transforms(
        jnp.concatenate([first.translations[:-1], second.translations]),
        jnp.concatenate([first.rotations[:-1], second.rotations]),
    )


def _stitch(first: Motion, second: Motion, levels: int) -> Motion:
    # Not one program: clips of one length share theirs.
    ends, starts = build_pyramid(first[::-1], levels), build_pyramid(second, levels)
    return _concatenated(ends, starts).reconstruct()


@compiled
def _concatenated(ends: Pyramid, starts: Pyramid) -> Pyramid:
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
        frame_time_text=ends.frame_time_text,
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


def _default_levels(first: Motion, second: Motion) -> int:
    fps = first.fps
    if traced(fps):
        raise ValueError("stitch: the frame time is traced; give levels")
    wanted = max(0, round(float(np.log2(_HALF_TRANSITION * float(fps)))))
    return min(wanted, *(len(level_sizes(m.num_frames)) - 1 for m in (first, second)))

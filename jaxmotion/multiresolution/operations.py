"""Edits by level (Lee & Shin 2001, §4): level of detail, enhancement and attenuation, blending.

    level of detail n + α    d⁽ⁱ⁾ for i < n, α·d⁽ⁿ⁾, nothing finer                 §4.1
    gains                    g_n·d⁽ⁿ⁾                                              §4.2
    blend                    base  m_c ⊕ (m_b ⊖ m_a),  details  d_b + (d_c − d_a)    Eq. 20

⊕, ⊖ in the body sense of :mod:`jaxmotion.displacement`, so none depends on the coordinates. Each
returns a motion of the input's frames. Contacts are kept on request. O(T·J),
differentiable in the clips, the level and the gains.
"""

import jax.numpy as jnp
from jaxtyping import Array

from jaxmotion import spacetime
from jaxmotion._checks import one_number, static
from jaxmotion._file_facts import compiled
from jaxmotion._types import ArrayLike, ScalarLike
from jaxmotion.contacts import Contacts
from jaxmotion.contacts.contact import check_kept
from jaxmotion.displacement import Displacement, minus, plus
from jaxmotion.motion import Motion
from jaxmotion.multiresolution.poses import Times, checked_alike, checked_times
from jaxmotion.multiresolution.pyramid import (
    Pyramid,
    build_pyramid,
    check_pyramid,
    level_count,
    synthesize,
)


@static("keep_contacts")
def level_of_detail(
    pyramid: Pyramid, level: ScalarLike, *, keep_contacts: Contacts | bool = False
) -> Motion:
    """The motion without the details finer than a level.

    Lee & Shin 2001, §4.1.

    **Arguments:** ``pyramid``: of one clip and N levels; ``level``: n + α in [0, N], traced or not:
    0 leaves the base, N everything, a fraction a part of the next details; beyond counts as the end
    of the range; ``keep_contacts``: as :func:`scale_details`.
    **Returns:** a motion of the original's frames.
    **Raises:** ``ValueError`` for what is no pyramid of one clip, a level that is not one number,
    and for ``keep_contacts`` as :func:`scale_details`.
    """
    check_pyramid(pyramid, "level_of_detail")
    one_number("level_of_detail: level", level)
    finest = jnp.arange(pyramid.levels, dtype=pyramid.base.dtype)
    gains = jnp.clip(jnp.asarray(level, pyramid.base.dtype) - finest, 0, 1)
    return _scaled(pyramid, gains[:, None], keep_contacts, "level_of_detail")


@static("keep_contacts")
def scale_details(
    pyramid: Pyramid, gains: ArrayLike, *, keep_contacts: Contacts | bool = False
) -> Motion:
    """The motion with its details enhanced (gain > 1) or attenuated (< 1).

    Lee & Shin 2001, §4.2.

    **Arguments:** ``pyramid``: of one clip and N levels; ``gains``: a scalar, f[N] one a level from
    coarse to fine, or f[N, J] one a level and joint (f[1, J] for all levels alike);
    ``keep_contacts``: True finds what touches in the original and restores it
    (:func:`jaxmotion.spacetime.keep_contacts`), contacts are restored as given (under ``jit`` only
    these), False lets them go.
    **Returns:** a motion of the original's frames; gains of 1 give it back exactly as
    ``pyramid.reconstruct()`` does.
    **Raises:** ``ValueError`` for what is no pyramid of one clip, gains of another shape, contacts
    of another number of frames, or True under ``jit``.
    """
    check_pyramid(pyramid, "scale_details")
    gains = jnp.asarray(gains, pyramid.base.dtype)
    levels, joints = pyramid.levels, pyramid.base.num_joints
    if gains.shape not in ((), (levels,), (levels, joints), (1, joints)):
        raise ValueError(
            f"scale_details: gains has shape {gains.shape}; expected a scalar, ({levels},) a level "
            f"or ({levels}, {joints}) a level and joint"
        )
    columns = gains[:, None] if gains.ndim == 1 else gains
    return _scaled(pyramid, columns, keep_contacts, "scale_details")


def _scaled(pyramid: Pyramid, gains: Array, keep_contacts: Contacts | bool, caller: str) -> Motion:
    every = jnp.broadcast_to(gains, (pyramid.levels, pyramid.base.num_joints))
    edit = synthesize(pyramid, every)
    check_kept(edit, keep_contacts, caller, pyramid.length)
    if keep_contacts is False:
        return edit
    return spacetime.keep_contacts(
        edit, original=pyramid.reconstruct(), contacts=keep_contacts, length=pyramid.length
    )


@static("levels", "keep_contacts")
def blend(
    reference: Motion,
    first: Motion,
    second: Motion,
    levels: int | None = None,
    *,
    times: Times | None = None,
    keep_contacts: Contacts | bool = False,
) -> Motion:
    """``second`` with what ``first`` has and ``reference`` lacks: limp + (turn − walk).

    blend(a, b, a) = blend(a, a, b) = b. Lee & Shin 2001, Eq. 20.

    **Arguments:** ``reference``, ``first``, ``second``: single clips of T frames and one skeleton,
    aligned in time (:mod:`jaxmotion.timing`) and standing alike; ``levels``, ``times``: as
    :func:`build_pyramid`; ``keep_contacts``: True finds what touches in ``second`` and restores it
    in the blend (:func:`jaxmotion.spacetime.keep_contacts`), contacts are restored as given (under
    ``jit`` only these), False lets them go.
    **Returns:** a motion of T frames, at the rate of ``second``.
    **Raises:** ``ValueError`` for what is not one clip of finite numbers, clips of different
    joints, frame times or numbers of frames, ``levels`` and ``times`` as :func:`build_pyramid`, and
    ``keep_contacts`` as :func:`scale_details`; at run time for traced frame times that differ.
    """
    clips = {"reference": reference, "first": first, "second": second}
    reference, first, second = checked_alike("blend", clips)
    for name, clip in {"first": first, "second": second}.items():
        if clip.rotations.shape != reference.rotations.shape:
            raise ValueError(
                f"blend: {name} has shape {clip.rotations.shape}, the reference "
                f"{reference.rotations.shape} (time, joint, 4); they must agree"
            )
    moving = tuple(sorted({j for m in (reference, first, second) for j in m.translated_joints}))
    levels = level_count(reference.num_frames, levels, "blend")
    times = checked_times(times, reference.num_frames, reference.dtype, "blend")
    check_kept(second, keep_contacts, "blend")
    alike = (with_moving_joints(m, moving) for m in (reference, first, second))
    mixed = _blend(*(build_pyramid(m, levels, times=times) for m in alike))
    return spacetime.keep_contacts(mixed, original=second, contacts=keep_contacts)


@compiled
def _blend(reference: Pyramid, first: Pyramid, second: Pyramid) -> Motion:
    def mixed(a: Displacement, b: Displacement, c: Displacement) -> Displacement:
        return Displacement(
            b.translations + (c.translations - a.translations),
            b.rotations + (c.rotations - a.rotations),
            "body",
        )

    layers = zip(reference.details, first.details, second.details, strict=True)
    pyramid = Pyramid(
        base=plus(second.base, minus(first.base, reference.base, "body")),
        details=tuple(mixed(*layer) for layer in layers),
        times=second.times,
        length=second.length,
        frames=second.frames,
        skips=second.skips,
        lazy=False,
        frame_time_text=second.frame_time_text,
    )
    return pyramid.reconstruct()


def with_moving_joints(motion: Motion, joints: tuple[int, ...]) -> Motion:
    """The motion, its translated joints said to be these."""
    return motion.replace(translated_joints=joints)

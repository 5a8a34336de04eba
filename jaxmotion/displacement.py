"""Displacement maps: the difference of two motions, and a motion moved by one.

Two senses, never mixed; a displacement says which it is in:

    "world"  p ⊕ u = p + u            q ⊕ v = q ⊗ exp(v)        Eom et al. 2019, Eq. 8, 12, 13
    "body"   p ⊕ u = p + q u q⁻¹      q ⊕ v = q ⊗ exp_half(v)   Lee & Shin 2001, Eq. 2, 3

with p, q a joint's translation and rotation in its parent's frame (the world, for the root). In the
body sense u and v are both measured in the joint's own frame, so a rigid motion of the whole clip
leaves them unchanged; in the world sense u stays in the parent's axes and v turns by its full
length. ``plus(reference, minus(motion, reference)) == motion`` in either. Cost O(T·J).
"""

from collections.abc import Iterator
from typing import Literal, TypeAlias

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Float

from jaxmotion._checks import instance_of, one_of
from jaxmotion._entry import a_motion
from jaxmotion._portable import Portable
from jaxmotion._summary import kept_as, moving
from jaxmotion._types import AnyArray, ArrayLike
from jaxmotion.motion import Motion
from jaxmotion.quaternion import between, conjugate, exp, exp_half, log, log_half, multiply, rotate

__all__ = ["Displacement", "minus", "plus"]

Sense: TypeAlias = Literal["world", "body"]


class Displacement(Portable):
    """The difference of two motions, frame by frame and joint by joint.

    **Fields:** ``translations``: f[T, J, 3], file unit; ``rotations``: f[T, J, 3], rotation vectors
    in radians, full-angle in the world sense, half in the body sense; ``sense``: "world" or "body",
    static.
    """

    translations: Float[AnyArray, "*batch time joint 3"]
    rotations: Float[AnyArray, "*batch time joint 3"]
    sense: Sense = eqx.field(static=True, default="world")

    def scale(self, gain: ArrayLike) -> "Displacement":
        """Every vector times a gain.

        **Arguments:** ``gain``: a scalar, f[J] per joint, f[T, 1] per frame, or f[T, J].
        **Returns:** :class:`Displacement` in the same sense.
        **Raises:** ``ValueError`` for a gain of another shape.
        """
        factor = jnp.asarray(gain, self.rotations.dtype)
        frames, joints = self.rotations.shape[-3:-1]
        if factor.shape not in ((), (joints,), (frames, 1), (frames, joints)):
            raise ValueError(
                f"Displacement.scale: gain has shape {factor.shape}; expected a scalar, "
                f"({joints},) per joint, ({frames}, 1) per frame or ({frames}, {joints})"
            )
        factor = factor[..., None] if factor.ndim else factor
        return Displacement(factor * self.translations, factor * self.rotations, self.sense)

    def _words(self) -> Iterator[str]:
        yield from moving(self.rotations, "displacement")
        yield f"{self.sense} sense"
        yield kept_as(self.rotations)


def plus(motion: Motion, displacement: Displacement) -> Motion:
    """motion ⊕ displacement, in the displacement's sense.

    Eom et al. 2019, Eq. 8, 12, 13 (world); Lee & Shin 2001, Eq. 2 (body).

    **Arguments:** ``motion``: T frames, J joints, leading batch axes allowed; ``displacement``: of
    the same shape.
    **Returns:** a motion of the same shape.
    **Raises:** ``ValueError`` when the shapes differ.
    """
    a_motion("plus", motion)
    expected = "a Displacement (jaxmotion.displacement.minus makes them)"
    instance_of("plus: displacement", displacement, Displacement, expected)
    if displacement.rotations.shape != motion.translations.shape:
        raise ValueError(
            f"plus: displacement has shape {displacement.rotations.shape}, the motion "
            f"{motion.translations.shape} (time, joint, 3); they must agree"
        )
    u, v, q = displacement.translations, displacement.rotations, motion.rotations
    if displacement.sense == "body":
        return motion.with_transforms(motion.translations + rotate(q, u), multiply(q, exp_half(v)))
    return motion.with_transforms(motion.translations + u, multiply(q, exp(v)))


def minus(motion: Motion, reference: Motion, sense: Sense = "world") -> Displacement:
    """motion ⊖ reference: the displacement that takes the reference to the motion.

    Rotation vectors take the short way round, so q and −q give the same. Eom et al. 2019, Eq. 8,
    12, 13 (world); Lee & Shin 2001, Eq. 3 (body).

    **Arguments:** ``motion``, ``reference``: clips of one shape, T frames, J joints, leading batch
    axes allowed; ``sense``: "world" or "body".
    **Returns:** :class:`Displacement`, f[T, J, 3] each.
    **Raises:** ``ValueError`` when the shapes differ or the sense is unknown.
    """
    a_motion("minus", motion)
    a_motion("minus", reference, "reference")
    if motion.rotations.shape != reference.rotations.shape:
        raise ValueError(
            f"minus: motion has shape {motion.rotations.shape}, reference "
            f"{reference.rotations.shape} (time, joint, 4); they must agree"
        )
    one_of("minus: sense", sense, ("world", "body"))
    u = motion.translations - reference.translations
    turn = between(reference.rotations, motion.rotations)
    if sense == "body":
        return Displacement(rotate(conjugate(reference.rotations), u), log_half(turn), sense)
    return Displacement(u, log(turn), sense)

"""What :mod:`jaxmotion.io.asf` reads of a bone, kept in the skeleton until it is written again."""

import equinox as eqx

from jaxmotion._portable import Portable


class AsfBone(Portable):
    """What an ASF file says of a bone beyond its offset; one a joint, all static.

    **Fields:** ``axis``: Euler angles in degrees of the bone's own frame C, in ``axis_order``;
    ``direction`` and ``length``: of the bone, which ends where its children begin; ``limits``:
    (low, high) per degree of freedom, in degrees.
    """

    axis: tuple[float, float, float] = eqx.field(static=True, default=(0.0, 0.0, 0.0))
    axis_order: str = eqx.field(static=True, default="XYZ")
    direction: tuple[float, float, float] = eqx.field(static=True, default=(0.0, 0.0, 0.0))
    length: float = eqx.field(static=True, default=0.0)
    limits: tuple[tuple[float, float], ...] = eqx.field(static=True, default=())

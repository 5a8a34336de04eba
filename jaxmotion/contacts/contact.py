"""Contacts: which points of a body stand still, when, where, and how.

A contact point c is fixed in a joint's frame: in the world it is at

    y_c(t) = x_j(t) + R_j(t)·point_c,        j = joints[c]

While ``mask[t, c]`` is set, y_c(t) is to be at ``target[t, c]``. T frames, C points; the motion's
unit of length. C = 0 is allowed, and so is a mask that is never set: no contacts.
"""

from collections.abc import Iterator, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxmotion import quaternion
from jaxmotion._checks import instance_of, traced
from jaxmotion._entry import one_clip, skeleton_of
from jaxmotion._portable import Portable
from jaxmotion._program import one_program
from jaxmotion._summary import batched, called, kept_as, some
from jaxmotion._types import AnyArray, ArrayLike, ScalarLike
from jaxmotion.kinematics import forward_kinematics
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton

FREE, POINT, LINE, PLANE = 0, 1, 2, 3

Limb = tuple[int, int, int]


class ContactPoints(Portable):
    """Points of the body that may touch something.

    Made from a ``skeleton``, or a motion of it, and its ``joints`` by name or number. Left out,
    ``point`` is the joints' origins, ``names`` are the joints', and the limbs are those above the
    joints; joints that hang from another of them share its limb.

    **Fields:** ``joints``: index of the joint each of C points is fixed to, static; ``names``: what
    to call each ("LeftFoot.heel"), static; ``limbs``: the two-bone limb that carries each, (root,
    middle, end) joints, or None where there is none (a head, a root), static; the end is the
    point's joint or above it; ``point``: f[C, 3], in the joint's frame, file unit.
    **Raises:** ``ValueError`` for a joint that the skeleton does not have, or a ``point``,
    ``names`` or ``limbs`` that are not one a joint.
    """

    joints: tuple[int, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    limbs: tuple[Limb | None, ...] = eqx.field(static=True)
    point: Float[AnyArray, "point 3"]

    def __init__(
        self,
        skeleton: Skeleton | Motion,
        joints: Sequence[int | str],
        point: ArrayLike | None = None,
        *,
        names: Sequence[str] | None = None,
        limbs: Sequence[Limb | None] | None = None,
    ):
        skeleton = skeleton_of("ContactPoints", skeleton)
        self.joints = tuple(skeleton.index(j) if isinstance(j, str) else int(j) for j in joints)
        if bad := [j for j in self.joints if not 0 <= j < skeleton.num_joints]:
            raise ValueError(
                f"ContactPoints: joints has {bad[0]}; expected 0..{skeleton.num_joints - 1}"
            )
        count, dtype = len(self.joints), skeleton.offsets.dtype
        self.point = jnp.zeros((count, 3), dtype) if point is None else jnp.asarray(point, dtype)
        self.names = tuple(names or (skeleton.names[j] for j in self.joints))
        self.limbs = tuple(limbs or _limbs(skeleton.parents, self.joints))
        if self.point.shape != (count, 3) or not len(self.names) == len(self.limbs) == count:
            raise ValueError(
                f"ContactPoints: {count} joints, but point has shape {self.point.shape}, expected "
                f"({count}, 3), and there are {len(self.names)} names and {len(self.limbs)} limbs"
            )

    @property
    def num_points(self) -> int:
        """C, the number of points."""
        return len(self.joints)

    def positions(self, motion: Motion) -> Float[Array, "time point 3"]:
        """World positions of the points.

        **Arguments:** ``motion``: one clip, T frames of the skeleton the points are of.
        **Returns:** f[T, C, 3], file unit.
        """
        one_clip("ContactPoints.positions", motion)
        pose = forward_kinematics(motion)
        return _positions(pose.positions, pose.rotations, self.point, self.joints)

    def _words(self) -> Iterator[str]:
        points = some(self.num_points, "point")
        yield f"{points}: {called(self.names, 3)}" if self.names else points
        yield kept_as(self.point)


@one_program("joints")
def _positions(
    positions: Array, rotations: Array, point: AnyArray, joints: tuple[int, ...]
) -> Array:
    """Of points fixed to joints, from all joints' poses."""
    index = np.asarray(joints, int)
    offset = quaternion.rotate(rotations[:, index], jnp.asarray(point, rotations.dtype))
    return positions[:, index] + offset


class Contacts(Portable):
    """When and where the points touch; the module has the equation.

    Left out, ``kind`` is 1 in contact, and ``confidence`` too; both are 0 where free. ``joints``,
    ``names``, ``limbs`` and ``point`` of the points are also properties here.

    **Fields:** ``points``: the :class:`ContactPoints`; ``mask``: bool[T, C], in contact; ``kind``:
    i8[T, C], what of the point's segment is at rest: 0 nothing (free), 1 the point, 2 a line
    through it (the segment rolls over an edge), 3 the whole segment; ``target``: f[T, C, 3], world,
    file unit: where the point is held, one place for each contact; where free, the point's own
    position; ``confidence``: f[T, C], in [0, 1].
    **Raises:** ``ValueError`` for shapes that do not fit.
    """

    points: ContactPoints
    mask: Bool[AnyArray, "time point"]
    kind: Int[AnyArray, "time point"]
    target: Float[AnyArray, "time point 3"]
    confidence: Float[AnyArray, "time point"]

    def __init__(
        self,
        points: ContactPoints,
        mask,
        target,
        *,
        kind=None,
        confidence=None,
    ):
        self.points = points
        self.mask = jnp.asarray(mask)
        self.target = jnp.asarray(target)
        free, point = (jnp.asarray(k, jnp.int8) for k in (FREE, POINT))
        self.kind = jnp.where(self.mask, point, free) if kind is None else jnp.asarray(kind)
        self.confidence = (
            self.mask.astype(self.target.dtype) if confidence is None else jnp.asarray(confidence)
        )
        shape = (*self.mask.shape[:1], points.num_points)
        wanted = {"mask": shape, "target": (*shape, 3), "kind": shape, "confidence": shape}
        for name, size in wanted.items():
            if getattr(self, name).shape != size:
                raise ValueError(
                    f"Contacts: {name} has shape {getattr(self, name).shape}; expected {size}, "
                    f"(frames, points)"
                )

    def at_frames(self, frames: Float[AnyArray, " result"]) -> "Contacts":
        """The contacts for another timing of the clip.

        Each new frame has what the nearest of the present frames has.

        **Arguments:** ``frames``: f[N], the time that each new frame has now, in frames from 0;
        fractions are allowed, and what is outside counts as the nearest end.
        **Returns:** :class:`Contacts` of N frames.
        """
        index = jnp.clip(jnp.round(jnp.asarray(frames)), 0, self.num_frames - 1).astype(jnp.int32)
        return Contacts(
            self.points,
            self.mask[index],
            self.target[index],
            kind=self.kind[index],
            confidence=self.confidence[index],
        )

    @property
    def joints(self) -> tuple[int, ...]:
        """Joint index of each point."""
        return self.points.joints

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each point."""
        return self.points.names

    @property
    def limbs(self) -> tuple[Limb | None, ...]:
        """(root, middle, end) joints of the limb of each point, or None."""
        return self.points.limbs

    @property
    def point(self) -> Float[AnyArray, "point 3"]:
        """Each point in its joint's frame."""
        return self.points.point

    @property
    def num_frames(self) -> int:
        """T, the number of frames."""
        return self.mask.shape[0]

    @property
    def num_points(self) -> int:
        """C, the number of points."""
        return self.points.num_points

    def _words(self) -> Iterator[str]:
        *batch, frames, _ = self.mask.shape
        yield batched(batch, "clip", some(frames, "frame"))
        yield next(self.points._words())
        yield kept_as(self.target)


def over_time(contacts: Contacts) -> tuple:
    """Its arrays f[T, ...], in a fixed order."""
    return contacts.mask, contacts.kind, contacts.target, contacts.confidence


def check_frames(motion: Motion, contacts: Contacts, caller: str, *, on_host: bool = False) -> None:
    """``ValueError`` unless they are one clip and contacts of its number of frames; ``on_host`` as
    of ``one_clip``."""
    one_clip(caller, motion, on_host=on_host)
    check_contacts(contacts, caller)
    if contacts.num_frames != motion.num_frames:
        raise ValueError(
            f"{caller}: contacts have {contacts.num_frames} frames, the motion "
            f"{motion.num_frames}; they must agree"
        )


def check_contacts(contacts: Contacts, caller: str) -> None:
    """``ValueError`` for what are no contacts."""
    expected = "Contacts (jaxmotion.contacts.detect finds them)"
    instance_of(f"{caller}: contacts", contacts, Contacts, expected)


def check_points(points: ContactPoints, caller: str) -> None:
    """``ValueError`` for what are no points."""
    expected = "ContactPoints (jaxmotion.contacts.find_feet finds them)"
    instance_of(f"{caller}: points", points, ContactPoints, expected)


def check_kept(
    motion: Motion, keep_contacts: Contacts | bool, caller: str, length: ScalarLike | None = None
) -> None:
    """``ValueError`` unless an edit can keep such contacts: found on it (True) where it is not
    traced, or given for its frames."""
    if not isinstance(keep_contacts, bool):
        expected = "Contacts (jaxmotion.contacts.detect finds them), True or False"
        instance_of(f"{caller}: keep_contacts", keep_contacts, Contacts, expected)
        check_frames(motion, keep_contacts, caller)
    elif keep_contacts and traced(motion.rotations, length):
        raise ValueError(
            f"{caller}: keep_contacts=True, but the motion is traced; find the contacts outside of "
            "jit or vmap and pass them"
        )


def limb_above(parents: Sequence[int], end: int) -> Limb | None:
    """(root, middle, end): the joint, its parent and grandparent, or None so near the root that
    the limb would have to move the whole body."""
    middle = parents[end]
    root = parents[middle] if middle > 0 else -1
    return (root, middle, end) if root > 0 else None


def _limbs(parents: Sequence[int], joints: Sequence[int]) -> list[Limb | None]:
    """The limb above each joint; joints that hang from another of them (toes) share its limb."""
    limbs = []
    for end in joints:
        while parents[end] in joints:
            end = parents[end]
        limbs.append(limb_above(parents, end))
    return limbs

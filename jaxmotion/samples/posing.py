"""From a pelvis, a trunk and foot paths to a clip: legs solved in closed form, contacts exact.

With d the unit vector hip → ankle, r its length, h the knee's hinge made orthogonal to d,
k = ±(d × h) the side the knee bends to, and thigh and shin of lengths l₁, l₂, the thigh points
along

    cos α d + sin α k,     cos α = (l₁² + r² − l₂²)/(2 l₁ r)                (cosine rule)

and its frame and the shin's are completed by h, so both knees are hinges and the ankle is met to
rounding. Where the wanted pelvis is too far from a foot, the whole clip's pelvis is lowered by one
constant, just enough for legs of at most 0.995 of their full length; smoothness is kept.

All in numpy float64; one compiled call turns the matrices into quaternions. Metres, radians. O(T).
"""

from collections.abc import Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxmotion import quaternion
from jaxmotion._portable import Portable
from jaxmotion._summary import some
from jaxmotion._types import AnyArray, Scalar
from jaxmotion.motion import Motion
from jaxmotion.samples.footsteps import FootPath
from jaxmotion.samples.rotations import about, turn
from jaxmotion.samples.skeletons import Leg, float_type
from jaxmotion.skeleton import Skeleton

Number = float | int

_FULL_REACH = 0.995


class Sample(Portable):
    """A synthetic clip and where its feet truly touch the floor.

    **Fields:** ``motion``: the clean :class:`~jaxmotion.Motion`, T frames, in metres; ``contacts``:
    bool[T, K], exact: the point is planted on the floor in that frame; ``contact_positions``:
    f[T, K, 3], world, metres: the plant, where planted, and the moving point where not;
    ``contact_offsets``: f[K, 3], metres, the point in its joint's frame; ``contact_joints``: that
    joint's index, K of them, static; ``contact_names``: "LeftHeel", "RightToe" and so on, static;
    ``floor``: f[], metres, height of the floor along the skeleton's ``up``.
    """

    motion: Motion
    contacts: Bool[AnyArray, "time point"]
    contact_positions: Float[AnyArray, "time point 3"]
    contact_offsets: Float[AnyArray, "point 3"]
    contact_joints: tuple[int, ...] = eqx.field(static=True)
    contact_names: tuple[str, ...] = eqx.field(static=True)
    floor: Scalar

    def _words(self) -> Iterator[str]:
        yield from self.motion._words()
        yield some(len(self.contact_names), "contact point")

    def clear(self, distance: float = 0.01) -> Bool[AnyArray, "time point"]:
        """Where a detector may be judged: planted, or at least ``distance`` above the floor.

        What is left out are the frames just before and after a contact, in which the point has
        moved too little for anyone to tell.

        **Arguments:** ``distance``: metres.
        **Returns:** bool[T, K].
        """
        height = self.contact_positions[..., self.motion.skeleton.up_axis]
        return self.contacts | (height >= self.floor + distance)


def check_timing(
    caller: str, num_frames: int, fps: Number, seed: int, **positive: Number
) -> np.ndarray:
    """Frame times f[T] in seconds.

    **Raises:** ``ValueError`` for a bad number of frames, rate or seed, or any of ``positive``
    that is not a positive number.
    """
    if not isinstance(num_frames, (int, np.integer)) or num_frames < 1:
        raise ValueError(
            f"{caller}: num_frames={num_frames!r}; expected a whole number of at least 1"
        )
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ValueError(f"{caller}: seed={seed!r}; expected a whole number of at least 0")
    for name, value in {"fps": fps, **positive}.items():
        if not (np.ndim(value) == 0 and np.isfinite(value) and value > 0):
            raise ValueError(f"{caller}: {name}={value!r}; expected a positive number")
    return np.arange(num_frames) / fps


def trunk(skeleton: Skeleton, num_frames: int, spine=(0, 0, 0), head=(0, 0, 0)) -> np.ndarray:
    """Local rotations f[T, J, 3, 3], the identity but for a bent spine, neck and head.

    **Arguments:** ``spine``, ``head``: (yaw, pitch, roll), each f[T] or a number, radians, shared
    among Spine, Spine1 and Spine2, and between Neck and Head.
    """
    local = np.tile(np.eye(3), (num_frames, skeleton.num_joints, 1, 1))
    for names, angles in ((("Spine", "Spine1", "Spine2"), spine), (("Neck", "Head"), head)):
        share = turn("yxz", *(np.asarray(a, float) / len(names) for a in angles))
        local[:, [skeleton.index(name) for name in names]] = np.reshape(share, (-1, 1, 3, 3))
    return local


def place_arm(local, skeleton: Skeleton, side: str, swing, lift, elbow, spread) -> None:
    """Pose one of the biped's arms, in place.

    **Arguments:** ``local``: f[T, J, 3, 3], local rotations; ``side``: "Left" or "Right"; f[T] or
    numbers, radians: ``swing``: forward; ``lift``: from hanging (0) up to the side (π/2);
    ``elbow``: flexion; ``spread``: of the shoulder girdle, upward.
    """
    sign = 1.0 if side == "Left" else -1.0
    hang = np.asarray(lift, float) - 0.5 * np.pi
    local[:, skeleton.index(f"{side}Shoulder")] = about("z", sign * np.asarray(spread, float))
    arm = about("x", -np.asarray(swing, float)) @ about("z", sign * hang)
    local[:, skeleton.index(f"{side}Arm")] = arm
    local[:, skeleton.index(f"{side}ForeArm")] = about("y", -sign * np.asarray(elbow, float))


def make_sample(
    caller: str,
    skeleton: Skeleton,
    legs: tuple[Leg, ...],
    feet: list[FootPath],
    root: np.ndarray,
    local: np.ndarray,
    fps: Number,
    dtype,
    extra: dict[int, np.ndarray] | None = None,
) -> Sample:
    """Solve the legs, lower the pelvis if it must be, and gather the truth.

    **Arguments:** ``feet``: one path a leg; ``root``: f[T, 3]; ``local``: f[T, J, 3, 3], the legs'
    entries still free; ``extra``: rotations f[T, 3, 3] put on after a solved joint's own, for legs
    in the air.
    **Raises:** ``ValueError`` if a leg cannot reach its foot wherever the pelvis' height.
    """
    lift = np.zeros(3)
    lift[1] = -_lowering(caller, skeleton, legs, feet, root, local)
    root = root + lift
    for leg, foot in zip(legs, feet, strict=True):
        _solve_leg(skeleton, leg, foot, root, local)
    for joint, rotation in (extra or {}).items():
        local[:, joint] = local[:, joint] @ rotation
    points = [(*point, foot) for leg, foot in zip(legs, feet, strict=True) for point in leg.points]
    contacts = [foot.heel_down if by == "heel" else foot.ball_down for *_, by, foot in points]
    positions = [_point(skeleton, root, local, j, offset) for _, j, offset, _, _ in points]
    kind = float_type(caller, dtype)
    return Sample(
        motion=_motion(skeleton, root, local, fps, kind),
        contacts=jnp.asarray(np.stack(contacts, axis=1)),
        contact_positions=jnp.asarray(np.stack(positions, axis=1).astype(kind)),
        contact_offsets=jnp.asarray(np.array([offset for _, _, offset, *_ in points], kind)),
        contact_joints=tuple(joint for _, joint, *_ in points),
        contact_names=tuple(name for name, *_ in points),
        floor=jnp.asarray(np.zeros((), kind)),
    )


def _motion(skeleton, root, local, fps, kind) -> Motion:
    translations = np.broadcast_to(skeleton.offsets, (*local.shape[:2], 3)).astype(kind)
    translations[:, 0] = root
    return Motion(
        jax.tree.map(lambda x: jnp.asarray(x.astype(kind)), skeleton),
        jnp.asarray(translations),
        jnp.asarray(_quaternions(local, kind)),
        1.0 / fps,
        translated_joints=(0,),
    )


def _quaternions(matrices: np.ndarray, kind) -> np.ndarray:
    """Unit quaternions f[T, J, 4] of f[T, J, 3, 3], of one sign along time.

    Padded to a power of two, so that clips of all lengths share a few compiled conversions.
    """
    flat = matrices.reshape(-1, 3, 3)
    padding = (1 << (len(flat) - 1).bit_length()) - len(flat)
    padded = np.concatenate([flat, np.tile(np.eye(3), (padding, 1, 1))]).astype(kind)
    q = np.asarray(_from_matrix(padded))[: len(flat)].reshape(*matrices.shape[:2], 4)
    turned = np.sum(q[1:] * q[:-1], axis=-1, keepdims=True) < 0
    return np.concatenate([q[:1], q[1:] * np.cumprod(np.where(turned, -1, 1), axis=0, dtype=kind)])


_from_matrix = jax.jit(quaternion.from_matrix)


def _world(skeleton, root, local, joint):
    """World rotation f[T, 3, 3] and position f[T, 3] of one joint."""
    chain = [joint]
    while skeleton.parents[chain[-1]] >= 0:
        chain.append(skeleton.parents[chain[-1]])
    rotation, position = local[:, 0], root
    for j in chain[-2::-1]:
        position = position + rotation @ np.asarray(skeleton.offsets[j], float)
        rotation = rotation @ local[:, j]
    return rotation, position


def _point(skeleton, root, local, joint, offset):
    rotation, position = _world(skeleton, root, local, joint)
    return position + rotation @ np.asarray(offset, float)


def _hip(skeleton, leg, root, local):
    parent = skeleton.parents[leg.hip]
    rotation, position = _world(skeleton, root, local, parent)
    return rotation, position + rotation @ np.asarray(skeleton.offsets[leg.hip], float)


def _bones(skeleton, leg):
    return (np.asarray(skeleton.offsets[j], float) for j in (leg.knee, leg.ankle))


def _lowering(caller, skeleton, legs, feet, root, local) -> float:
    needed = 0.0
    for leg, foot in zip(legs, feet, strict=True):
        reach = _FULL_REACH * sum(np.linalg.norm(bone) for bone in _bones(skeleton, leg))
        apart = _hip(skeleton, leg, root, local)[1] - foot.ankle
        room = reach**2 - apart[:, 0] ** 2 - apart[:, 2] ** 2
        if np.min(room) <= (0.3 * reach) ** 2:
            raise ValueError(
                f"{caller}: the step is too long for a leg of {reach:.2f} m: a hip and its ankle "
                f"would be {np.sqrt(reach**2 - np.min(room)):.2f} m apart along the floor; "
                "ask for a shorter stride"
            )
        needed = max(needed, float(np.max(apart[:, 1] - np.sqrt(room))))
    return needed


def _solve_leg(skeleton, leg: Leg, foot: FootPath, root, local) -> None:
    base, hip = _hip(skeleton, leg, root, local)
    thigh, shin = _bones(skeleton, leg)
    upper, lower = np.linalg.norm(thigh), np.linalg.norm(shin)
    across = foot.ankle - hip
    r = np.linalg.norm(across, axis=-1, keepdims=True)
    d = across / r
    hinge = base[..., 0] + foot.foot[..., 0]
    hinge = hinge - np.sum(hinge * d, axis=-1, keepdims=True) * d
    hinge /= np.linalg.norm(hinge, axis=-1, keepdims=True)
    cosine = (upper**2 + r**2 - lower**2) / (2.0 * upper * r)
    side = leg.bend * np.cross(d, hinge)
    thigh_line = cosine * d + np.sqrt(1.0 - cosine**2) * side
    thigh_world = _frame(thigh_line, hinge) @ _frame(thigh, np.eye(3)[0]).T
    shin_line = foot.ankle - hip - upper * thigh_line
    shin_world = _frame(shin_line, hinge) @ _frame(shin, np.eye(3)[0]).T
    chain = (base, thigh_world, shin_world, foot.foot, foot.toes)
    for joint, outer, inner in zip(
        (leg.hip, leg.knee, leg.ankle, leg.toes), chain, chain[1:], strict=False
    ):
        local[:, joint] = np.swapaxes(outer, -1, -2) @ inner


def _frame(along, hinge):
    """Columns hinge, up the bone, and their cross product: f[..., 3, 3]."""
    up = -along / np.linalg.norm(along, axis=-1, keepdims=True)
    return np.stack([hinge, up, np.cross(hinge, up)], axis=-1)

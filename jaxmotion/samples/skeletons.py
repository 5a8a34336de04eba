"""A biped and a quadruped, and what the clip makers need to know of their legs.

Both stand Y up, facing +Z, left at +X, in metres, on a floor at height 0. In the rest pose every
rotation is the identity: the biped in a T-pose, the quadruped standing.

A leg is a chain hip → knee → ankle → ball whose first two bones and hinge axis X span a vertical
plane at rest. A foot's sole is the plane through its ball (and heel, if it has one).
"""

from typing import NamedTuple

import jax
import numpy as np

from jaxmotion.skeleton import Conventions, Skeleton

# name, parent, offset in metres; the left side, mirrored below.
_BIPED = (
    ("Hips", None, (0.0, 0.96, 0.0)),
    ("Spine", "Hips", (0.0, 0.10, 0.0)),
    ("Spine1", "Spine", (0.0, 0.13, 0.0)),
    ("Spine2", "Spine1", (0.0, 0.13, 0.0)),
    ("Neck", "Spine2", (0.0, 0.17, -0.01)),
    ("Head", "Neck", (0.0, 0.09, 0.015)),
    ("LeftShoulder", "Spine2", (0.03, 0.12, 0.0)),
    ("LeftArm", "LeftShoulder", (0.15, 0.0, -0.01)),
    ("LeftForeArm", "LeftArm", (0.28, 0.0, 0.0)),
    ("LeftHand", "LeftForeArm", (0.25, 0.0, 0.0)),
    ("LeftUpLeg", "Hips", (0.09, -0.04, 0.0)),
    ("LeftLeg", "LeftUpLeg", (0.0, -0.43, 0.0)),
    ("LeftFoot", "LeftLeg", (0.0, -0.41, 0.0)),
    ("LeftToeBase", "LeftFoot", (0.0, -0.08, 0.14)),
)
_BIPED_ENDS = (
    ("Head", (0.0, 0.19, 0.0)),
    ("LeftHand", (0.17, 0.0, 0.0)),
    ("LeftToeBase", (0.0, 0.0, 0.07)),
)
_QUADRUPED = (
    ("Hips", None, (0.0, 0.52, 0.0)),
    ("Spine", "Hips", (0.0, 0.02, 0.14)),
    ("Spine1", "Spine", (0.0, 0.02, 0.16)),
    ("Spine2", "Spine1", (0.0, 0.0, 0.16)),
    ("Neck", "Spine2", (0.0, 0.07, 0.13)),
    ("Head", "Neck", (0.0, 0.15, 0.13)),
    ("Tail", "Hips", (0.0, 0.02, -0.12)),
    ("Tail1", "Tail", (0.0, -0.05, -0.14)),
    ("LeftShoulder", "Spine2", (0.06, 0.04, 0.02)),
    ("LeftArm", "LeftShoulder", (0.02, -0.16, 0.07)),
    ("LeftForeArm", "LeftArm", (0.0, -0.13, -0.10)),
    ("LeftHand", "LeftForeArm", (0.0, -0.21, 0.01)),
    ("LeftFingerBase", "LeftHand", (0.0, -0.10, 0.03)),
    ("LeftUpLeg", "Hips", (0.08, -0.02, 0.0)),
    ("LeftLeg", "LeftUpLeg", (0.0, -0.17, 0.08)),
    ("LeftFoot", "LeftLeg", (0.0, -0.17, -0.12)),
    ("LeftToeBase", "LeftFoot", (0.0, -0.16, 0.04)),
)
_QUADRUPED_ENDS = (
    ("Head", (0.0, -0.03, 0.17)),
    ("Tail1", (0.0, -0.08, -0.12)),
    ("LeftFingerBase", (0.0, 0.0, 0.04)),
    ("LeftToeBase", (0.0, 0.0, 0.04)),
)
_HEEL = (0.0, -0.08, -0.05)
_TOE = (0.0, 0.0, 0.07)


class Leg(NamedTuple):
    """Joint indices of one leg, its foot, and which of its points touch the floor.

    ``bend``: +1 if the knee bends forward (a human knee), −1 backward (a dog's elbow);
    ``heel``, ``ball``: in the frame of ``ankle`` (metres; no heel on a paw);
    ``points``: (name, joint, offset in its frame, "heel" or "ball": what holds it down).
    """

    hip: int
    knee: int
    ankle: int
    toes: int
    bend: float
    heel: np.ndarray | None
    ball: np.ndarray
    points: tuple[tuple[str, int, tuple[float, float, float], str], ...]


def biped(dtype=None) -> Skeleton:
    """A person of 22 joints and five end sites, in metres: 1.77 m tall, legs of 0.92 m.

    **Arguments:** ``dtype``: of the offsets, float32 or float64; JAX's default when absent.
    **Returns:** a :class:`~jaxmotion.Skeleton`, Y up, facing +Z, in a T-pose.
    **Raises:** ``ValueError`` for a dtype as for :func:`idle`.
    """
    return _build(_BIPED, _BIPED_ENDS, float_type("biped", dtype))


def quadruped(dtype=None) -> Skeleton:
    """A dog of 26 joints and six end sites, in metres: 0.6 m at the withers.

    **Arguments:** ``dtype``: of the offsets, float32 or float64; JAX's default when absent.
    **Returns:** a :class:`~jaxmotion.Skeleton`, Y up, facing +Z, standing.
    **Raises:** ``ValueError`` for a dtype as for :func:`idle`.
    """
    return _build(_QUADRUPED, _QUADRUPED_ENDS, float_type("quadruped", dtype))


def biped_rig() -> tuple[Skeleton, tuple[Leg, ...]]:
    """The biped in float64, whatever JAX uses, and its left and right leg.

    Heel, ball and tip of the toes touch the floor.
    """
    skeleton = _build(_BIPED, _BIPED_ENDS, np.dtype(np.float64))

    def leg(side):
        ankle, toes = (skeleton.index(side + part) for part in ("Foot", "ToeBase"))
        points = (
            (f"{side}Heel", ankle, _HEEL, "heel"),
            (f"{side}Ball", toes, (0.0, 0.0, 0.0), "ball"),
            (f"{side}Toe", toes, _TOE, "ball"),
        )
        return _leg(skeleton, side, ("UpLeg", "Leg", "Foot", "ToeBase"), 1.0, _HEEL, points)

    return skeleton, (leg("Left"), leg("Right"))


def quadruped_rig() -> tuple[Skeleton, tuple[Leg, ...]]:
    """The quadruped in float64, whatever JAX uses, and its legs, whose paws touch the floor.

    Left hind, right hind, left front, right front.
    """
    skeleton = _build(_QUADRUPED, _QUADRUPED_ENDS, np.dtype(np.float64))

    def leg(side, end, parts, bend):
        points = ((f"{side}{end}Paw", skeleton.index(side + parts[-1]), (0.0, 0.0, 0.0), "ball"),)
        return _leg(skeleton, side, parts, bend, None, points)

    hind, front = ("UpLeg", "Leg", "Foot", "ToeBase"), ("Arm", "ForeArm", "Hand", "FingerBase")
    return skeleton, (
        leg("Left", "Hind", hind, 1.0),
        leg("Right", "Hind", hind, 1.0),
        leg("Left", "Front", front, -1.0),
        leg("Right", "Front", front, -1.0),
    )


def float_type(caller: str, dtype) -> np.dtype:
    """The numpy dtype meant: JAX's default float for None.

    **Raises:** ``ValueError`` if it is not float32 or float64, or float64 is switched off in JAX.
    """
    if dtype is None:
        return np.dtype(jax.dtypes.canonicalize_dtype(float))
    wanted = np.dtype(dtype)
    if wanted not in (np.dtype(np.float32), np.dtype(np.float64)):
        raise ValueError(f"{caller}: dtype={dtype!r}; expected float32 or float64")
    if jax.dtypes.canonicalize_dtype(wanted) != wanted:
        raise ValueError(
            f"{caller}: dtype=float64 needs 64-bit JAX: "
            "jax.config.update('jax_enable_x64', True), or ask for float32"
        )
    return wanted


def _leg(skeleton, side, parts, bend, heel, points) -> Leg:
    hip, knee, ankle, toes = (skeleton.index(side + part) for part in parts)
    ball = np.asarray(skeleton.offsets[toes], np.float64)
    return Leg(hip, knee, ankle, toes, bend, None if heel is None else np.array(heel), ball, points)


def _build(left, ends, dtype: np.dtype) -> Skeleton:
    joints, sites = _mirrored(left), _mirrored(ends)
    names = [name for name, _, _ in joints]
    return Skeleton(
        names,
        [-1 if parent is None else names.index(parent) for _, parent, _ in joints],
        np.array([offset for _, _, offset in joints], dtype),
        end_joints=[names.index(name) for name, _ in sites],
        end_offsets=np.array([offset for _, offset in sites], dtype),
        conventions=Conventions(metres=1.0),
    )


def _mirrored(rows):
    """After every chain of rows named Left… the same as Right…, with x turned round.

    A chain hangs together: each row's parent is the row before.
    """
    result, chain = [], []
    for row in rows:
        is_left = row[0].startswith("Left")
        if chain and not (is_left and (len(row) < 3 or row[1] == chain[-1][0])):
            result += chain + [_mirror(r) for r in chain]
            chain = []
        (chain if is_left else result).append(row)
    return result + chain + [_mirror(r) for r in chain]


def _mirror(row):
    *names, (x, y, z) = row
    return (*(n.replace("Left", "Right") for n in names), (-x, y, z))

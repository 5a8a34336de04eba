"""Measures of contacts, smoothness and accuracy.

    slides            ‖y_c(t + 1) − y_c(t)‖ where point c is in contact at t and t + 1, else 0
    foot_skate        their sum over the time spent in contact               file unit a second
    penetration       depth of the points below the floor                    file unit
    contact_scores    precision and recall of a mask against the truth
    jerk              ‖third difference of world positions‖ / Δt³            file unit / s³
    joint_position_error   distance between the joints of two clips          file unit

T frames, J joints, C points. NumPy in float64 on the host, O(T·(J + C)).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmotion._checks import no_module
from jaxmotion._entry import for_people, one_clip
from jaxmotion._summary import line
from jaxmotion._types import ArrayLike
from jaxmotion.contacts import ContactPoints, Contacts
from jaxmotion.contacts.contact import check_frames, check_points
from jaxmotion.metrics.measures import world_positions
from jaxmotion.motion import Motion


class ContactScores(NamedTuple):
    """How well a contact mask agrees with the truth.

    **Fields:** ``precision``: share of what was found that is true, 1 where nothing was found;
    ``recall``: share of what is true that was found, 1 where there is nothing to find.
    """

    precision: float
    recall: float

    def __repr__(self) -> str:
        return line(self)


def slides(motion: Motion, contacts: Contacts) -> Float[np.ndarray, "step point"]:
    """How far each point moves from frame to frame while in contact.

    **Arguments:** ``motion``: one clip, T frames; ``contacts``: of T frames and C points.
    **Returns:** f64[T − 1, C], file unit; 0 where a point is not in contact in both frames.
    **Raises:** ``ValueError`` when the contacts have another number of frames.
    """
    for_people("slides", motion)
    check_frames(motion, contacts, "slides", on_host=True)
    return _slides(motion, contacts)


def _slides(motion: Motion, contacts: Contacts) -> np.ndarray:
    mask = np.asarray(contacts.mask)
    moved = np.diff(np.asarray(contacts.points.positions(motion), np.float64), axis=0)
    return np.linalg.norm(moved, axis=-1) * (mask[1:] & mask[:-1])


def foot_skate(motion: Motion, contacts: Contacts) -> float:
    """Mean speed at which points slide while in contact; 0 without contacts.

    **Arguments:** ``motion``: one clip, T frames; ``contacts``: of T frames.
    **Returns:** a float, file unit a second.
    **Raises:** ``ValueError`` when the contacts have another number of frames.
    """
    for_people("foot_skate", motion)
    check_frames(motion, contacts, "foot_skate", on_host=True)
    mask = np.asarray(contacts.mask)
    seconds = np.sum(mask[1:] & mask[:-1]) * float(motion.frame_time)
    return float(_slides(motion, contacts).sum() / seconds) if seconds else 0.0


def penetration(
    motion: Motion, points: ContactPoints, floor: float = 0.0
) -> Float[np.ndarray, "time point"]:
    """How far each point is below the floor.

    **Arguments:** ``motion``: one clip, T frames; ``points``: C points of its skeleton; ``floor``:
    height, file unit.
    **Returns:** f64[T, C] ≥ 0, file unit.
    **Raises:** ``ValueError`` for what is not one clip and points.
    """
    for_people("penetration", motion)
    one_clip("penetration", motion, on_host=True)
    check_points(points, "penetration")
    positions = np.asarray(points.positions(motion), np.float64)
    return np.maximum(floor - positions[..., motion.skeleton.up_axis], 0.0)


def contact_scores(
    found: ArrayLike, truth: ArrayLike, judged: ArrayLike | None = None
) -> ContactScores:
    """Precision and recall of a contact mask.

    **Arguments:** ``found``, ``truth``: bool[T, C]; ``judged``: bool[T, C], entries that count, all
    when left out.
    **Returns:** :class:`ContactScores`.
    **Raises:** ``ValueError`` when the shapes differ.
    """
    for name, mask in (("found", found), ("truth", truth), ("judged", judged)):
        no_module(f"contact_scores: {name}", mask)
    found, truth = np.asarray(found, bool), np.asarray(truth, bool)
    judged = np.ones(truth.shape, bool) if judged is None else np.asarray(judged, bool)
    if not found.shape == truth.shape == judged.shape:
        raise ValueError(
            f"contact_scores: found has shape {found.shape}, truth {truth.shape}, judged "
            f"{judged.shape}; they must agree"
        )
    hits = np.sum(found & truth & judged)
    shares = [hits / n if n else 1.0 for n in (np.sum(m & judged) for m in (found, truth))]
    return ContactScores(float(shares[0]), float(shares[1]))


def jerk(motion: Motion) -> Float[np.ndarray, "*batch step joint"]:
    """Size of the third derivative in time of every joint's world position.

    **Arguments:** ``motion``: T frames, J joints; leading batch axes allowed.
    **Returns:** f64[T − 3, J], file unit / s³; no rows for fewer than four frames.
    **Raises:** ``ValueError`` for what is no motion.
    """
    for_people("jerk", motion)
    positions = world_positions(motion)[..., : motion.num_joints, :]
    seconds = np.asarray(motion.frame_time, np.float64)[..., None, None]
    return np.linalg.norm(np.diff(positions, n=3, axis=-3), axis=-1) / seconds**3


def joint_position_error(
    motion: Motion, reference: Motion, *, relative: bool = False
) -> Float[np.ndarray, "*batch time joint"]:
    """Distance of every joint from the reference's, in the world.

    **Arguments:** ``motion``, ``reference``: clips of one shape, T frames, J joints, leading batch
    axes allowed; ``relative``: with both bodies (``reference.body_joint``) put in one place,
    frame by frame.
    **Returns:** f64[T, J], file unit.
    **Raises:** ``ValueError`` for what is no motion, or when the shapes differ.
    """
    for_people("joint_position_error", motion)
    for_people("joint_position_error", reference, "reference")
    if motion.rotations.shape != reference.rotations.shape:
        raise ValueError(
            f"joint_position_error: the clips have shapes {motion.rotations.shape} and "
            f"{reference.rotations.shape} (time, joint, 4); they must agree"
        )
    a, b = (world_positions(m)[..., : m.num_joints, :] for m in (motion, reference))
    if relative:
        body = reference.body_joint
        a, b = (p - p[..., body : body + 1, :] for p in (a, b))
    return np.linalg.norm(a - b, axis=-1)

"""Seeded errors of the devices that capture, over runs of frames, with the entries they touched.

    drift    q ← q ⊗ exp(w v) over a run, w from 0 as it begins to 1 in its last frame, ‖v‖ the rate
             times the run's seconds: an inertial sensor that loses its way and is set right again
    markers  q ← q ⊗ exp(v) over a run, and every child's q ← exp(v)⁻¹ ⊗ q: two markers of a bone
             are taken for each other, its joint is off and those below make up for it

Runs are as in :mod:`jaxmotion.samples.joint_errors`; takes and returns what
:mod:`jaxmotion.samples.corruptions` says. O(R·T·J) for R runs. The magnitudes are ours.
"""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from jaxmotion import quaternion
from jaxmotion._checks import static
from jaxmotion._file_facts import compiled
from jaxmotion._types import Key
from jaxmotion.motion import Motion
from jaxmotion.samples.corruptions import Corrupted, replace_where
from jaxmotion.samples.error_runs import (
    check_range,
    check_runs,
    draw_runs,
    turn_vectors,
)


@static("runs")
def drift_joints(
    motion: Motion,
    key: Key,
    *,
    runs: int = 4,
    rate: tuple[float | int, float | int] = (0.3, 1.0),
    length: tuple[int, int] = (15, 60),
    joints: Sequence[int] | None = None,
) -> Corrupted:
    """Turn a joint further and further over each of ``runs`` runs, as sensors do that drift.

    **Arguments:** ``rate``: least and greatest speed, radians a second; ``motion``, ``key``,
    ``runs``, ``length``, ``joints``: as :func:`offset_joints`.
    **Returns:** :class:`Corrupted`.
    **Raises:** ``ValueError`` as :func:`offset_joints`.
    """
    joints = check_runs("drift_joints", motion, runs, length, joints)
    check_range("drift_joints", "rate", rate)
    return _drift(motion, key, runs, rate, length, joints)


@static("runs")
def swap_markers(
    motion: Motion,
    key: Key,
    *,
    runs: int = 4,
    magnitude: tuple[float | int, float | int] = (0.5, 1.5),
    length: tuple[int, int] = (5, 30),
    joints: Sequence[int] | None = None,
) -> Corrupted:
    """Turn a bone over each of ``runs`` runs, but leave those that hang from it where they look, as
    when markers of the bone are taken for each other.

    **Arguments:** ``motion``, ``key``, ``runs``, ``magnitude``, ``length``, ``joints``: as
    :func:`offset_joints`; children of the joints are touched as well.
    **Returns:** :class:`Corrupted`.
    **Raises:** ``ValueError`` as :func:`offset_joints`.
    """
    joints = check_runs("swap_markers", motion, runs, length, joints)
    check_range("swap_markers", "magnitude", magnitude)
    return _swap_markers(motion, key, runs, magnitude, length, joints)


@compiled
def _drift(motion, key, runs, rate, length, joints):
    drawn = draw_runs(motion, key, runs, length, joints)
    v = turn_vectors(drawn, rate)
    since = jnp.arange(motion.num_frames)[:, None] + 1 - drawn.spread(drawn.start)
    seconds = since.astype(motion.dtype) * motion.frame_time
    turn = quaternion.exp(jnp.asarray(seconds, motion.dtype)[..., None] * v)
    return replace_where(motion, drawn.hit, quaternion.multiply(motion.rotations, turn))


@compiled
def _swap_markers(motion, key, runs, magnitude, length, joints):
    drawn = draw_runs(motion, key, runs, length, joints)
    v = turn_vectors(drawn, magnitude)
    turn = jnp.where(drawn.hit[..., None], quaternion.exp(v), quaternion.identity((), motion.dtype))
    parents = np.array(motion.skeleton.parents)
    above = np.maximum(parents, 0)
    # The root hangs from nothing that could turn.
    carried = drawn.hit[:, above] & jnp.asarray(parents >= 0)
    looking = quaternion.multiply(quaternion.conjugate(turn[:, above]), motion.rotations)
    kept = jnp.where(carried[..., None], looking, motion.rotations)
    return replace_where(motion, drawn.hit | carried, quaternion.multiply(kept, turn))

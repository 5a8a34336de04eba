"""A motion in a rerun recording, beside whatever else is logged there."""

from typing import TYPE_CHECKING

import numpy as np

from jaxmotion._entry import one_clip
from jaxmotion._lazy import extra
from jaxmotion.kinematics import forward_kinematics
from jaxmotion.motion import Motion

if TYPE_CHECKING:
    from rerun import RecordingStream


def log_rerun(
    motion: Motion, entity: str = "motion", *, recording: "RecordingStream | None" = None
) -> None:
    """Log a clip to a rerun recording: its joints as points, its bones as lines.

    ``ENTITY/joints`` are Points3D, joints and then end sites, with the joints' names as labels that
    are shown on demand; ``ENTITY/bones`` are LineStrips3D, one from every parent to its child. Both
    are logged at every frame on two timelines, "frame", which counts from 0, and "seconds", from 0
    by the frame time; nothing else is set or changed. The up axis is told once, at ``ENTITY``.
    Lengths stay in the file's unit, numbers are float32. O(T·J).

    **Arguments:** ``motion``: one clip; ``entity``: the path in the recording that it goes below;
    ``recording``: a ``rerun.RecordingStream``, by default the active one (``rerun.init`` makes it).
    **Raises:** ``ValueError`` for several clips, or if there is no recording; ``ImportError``
    without rerun: ``pip install 'jaxmotion[rerun]'``.

    **Example:**

        >>> import rerun, jaxmotion as jm
        >>> recording = rerun.RecordingStream("walks")
        >>> held = recording.memory_recording()
        >>> jm.viz.log_rerun(jm.samples.load("walk").motion[:16], "walk", recording=recording)
        >>> len(held.drain_as_bytes()) > 0
        True
    """
    one_clip("log_rerun", motion, on_host=True)
    rr = extra("rerun", "rerun", "log_rerun", package="rerun-sdk")
    recording = rr.get_data_recording() if recording is None else recording
    if recording is None:
        raise ValueError("log_rerun: no recording; call rerun.init(...) first, or pass recording=")
    skeleton = motion.skeleton
    pose = forward_kinematics(motion)
    points = np.concatenate([pose.positions, pose.end_positions], axis=1).astype(np.float32)
    parents = np.array([*skeleton.parents, *skeleton.end_joints])
    frames, nodes = points.shape[:2]
    upright = getattr(rr.ViewCoordinates, f"RIGHT_HAND_{skeleton.up.upper()}_UP")
    rr.log(entity, upright, static=True, recording=recording)
    names = [*skeleton.names, *(f"{skeleton.names[joint]} end" for joint in skeleton.end_joints)]
    labels = rr.Points3D.from_fields(labels=names, show_labels=False)
    rr.log(f"{entity}/joints", labels, static=True, recording=recording)
    seconds = float(motion.frame_time) * np.arange(frames)
    times = [
        rr.TimeColumn("frame", sequence=np.arange(frames)),
        rr.TimeColumn("seconds", duration=seconds),
    ]
    joints = rr.Points3D.columns(positions=points.reshape(-1, 3)).partition([nodes] * frames)
    rr.send_columns(f"{entity}/joints", times, joints, recording=recording)
    if nodes > 1:
        bones = np.stack([points[:, parents[1:]], points[:, 1:]], axis=2).reshape(-1, 2, 3)
        strips = rr.LineStrips3D.columns(strips=bones).partition([nodes - 1] * frames)
        rr.send_columns(f"{entity}/bones", times, strips, recording=recording)

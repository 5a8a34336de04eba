"""What a smoother bridged, in rows for people: where samples had weight 0, and by how much their
rotations turned. On the host, O(T·J)."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jaxmotion import quaternion
from jaxmotion._entry import check_result, check_weights
from jaxmotion._summary import line
from jaxmotion._types import ArrayLike
from jaxmotion.motion import Motion


class Bridge(NamedTuple):
    """Frames of a joint that were taken for missing, and what became of them.

    **Fields:** ``joint``: by name; ``frame``, ``last_frame``: the first and the last, from 0;
    ``seconds``: when the first is; ``degrees``: the largest angle between a frame's rotation as it
    was and as it is now.
    """

    joint: str
    frame: int
    last_frame: int
    seconds: float
    degrees: float

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        yield str(self.joint)
        yield f"frames {self.frame} to {self.last_frame}"
        yield f"{self.degrees}°"


def bridged(motion: Motion, result: Motion, weights: ArrayLike) -> tuple[Bridge, ...]:
    """List what was bridged: every run of frames of weight 0, joint by joint.

    **Arguments:** ``motion``: one clip, as it was; ``result``: as it is now; ``weights``: f[T] or
    f[T, J], what the smoother was given (``smoothing.outlier_weights``).
    **Returns:** a :class:`Bridge` a run, in the order of time.
    **Raises:** ``ValueError`` for what are no two clips of one shape, and weights of another;
    ``TypeError`` inside ``jit``.
    """
    check_result("bridged", motion, result, weights)
    check_weights("bridged", motion, weights)
    left_out = np.asarray(weights).reshape(motion.num_frames, -1) == 0
    left_out = np.broadcast_to(left_out, motion.rotations.shape[:2])
    angles = np.degrees(np.asarray(quaternion.distance(motion.rotations, result.rotations)))
    edges = np.diff(np.pad(left_out.astype(np.int8), ((1, 1), (0, 0))), axis=0)
    # Column by column, so that the n-th beginning and the n-th end are of one run.
    joints, first = np.nonzero(edges.T == 1)
    last = np.nonzero(edges.T == -1)[1] - 1
    rows = [
        Bridge(
            motion.skeleton.names[joint],
            int(a),
            int(b),
            float(a * np.asarray(motion.frame_time)),
            float(angles[a : b + 1, joint].max()),
        )
        for joint, a, b in zip(joints, first, last, strict=True)
    ]
    return tuple(sorted(rows, key=lambda row: row.frame))

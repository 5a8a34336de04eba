"""Clips made by hand, and how their joints turn by SciPy, for tests of pictures."""

import numpy as np
from scipy.spatial.transform import Rotation

from jaxmotion import Motion, Skeleton
from tests.helpers import quaternions_by, scipy_rotation

SECOND = 0.05  # a frame


def turning(vectors, root=None, *, names=None, parents=None, offsets=None, up="y"):
    """A clip whose joints turn by rotation vectors f[T, J, 3], radians, its root where it is."""
    frames, joints = vectors.shape[:2]
    names = names or [f"joint{j}" for j in range(joints)]
    parents = parents or [j - 1 for j in range(joints)]
    offsets = np.tile([0.0, 1.0, 0.0], (joints, 1)) if offsets is None else offsets
    root = np.zeros((frames, 3)) if root is None else root
    skeleton = Skeleton(names, parents, np.asarray(offsets, float), up=up)
    return Motion.from_root(skeleton, root, quaternions_by(vectors), SECOND)


def about(axis, degrees):
    """Rotation vectors f[..., 3] about "x", "y" or "z"."""
    return np.radians(degrees)[..., None] * np.eye(3)["xyz".index(axis)]


def chordal_mean(q):
    """Of quaternions f[T, 4]."""
    return np.linalg.eigh(np.asarray(q).T @ np.asarray(q))[1][:, -1]


def vectors_from(middle, q):
    """Rotation vectors f[T, 3] from one rotation to others, degrees, by SciPy."""
    return np.degrees((scipy_rotation(middle).inv() * scipy_rotation(q)).as_rotvec())


def turned_by(q, vectors):
    """q exp(v), f[T, 4], by SciPy."""
    return (scipy_rotation(q) * Rotation.from_rotvec(vectors)).as_quat(scalar_first=True)


def prior_rows(frames):
    """Eq. 3 of Eom et al.: second differences, halved."""
    rows = np.zeros((frames - 2, frames))
    for i in range(frames - 2):
        rows[i, i : i + 3] = -0.5, 1, -0.5
    return rows


def legend_of(figure):
    """What the legends of a figure and of its axes say."""
    found = [*figure.legends, *(a.get_legend() for a in figure.axes if a.get_legend())]
    return [text.get_text() for legend in found for text in legend.get_texts()]


def png(figure, path):
    """Whether it can be saved."""
    figure.savefig(path)
    return path.read_bytes().startswith(b"\x89PNG")

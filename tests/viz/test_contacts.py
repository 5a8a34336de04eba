"""The picture shows each point's height and when it touches."""

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.contacts import ContactPoints, Contacts
from jaxmotion.viz import plot_contacts
from tests.helpers import random_motion


def two_points(motion):
    points = ContactPoints(motion.skeleton, [1, 2], names=["elbow", "hand"])
    mask = np.zeros((motion.num_frames, 2), bool)
    mask[2:5, 1] = mask[7:, 1] = True
    return Contacts(points, mask, points.positions(motion))


def test_heights_and_shades(tmp_path):
    motion = random_motion(np.random.default_rng(0), frames=9, skeleton=3)
    contacts = two_points(motion)
    figure = plot_contacts(motion, contacts)
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["elbow", "hand"]
    positions = np.asarray(jm.forward_kinematics(motion).positions)
    for axes, joint in zip(figure.axes, (1, 2), strict=True):
        (line,) = axes.lines
        np.testing.assert_allclose(line.get_ydata(), positions[:, joint, 1], atol=1e-12)
        np.testing.assert_allclose(line.get_xdata(), np.arange(9) * float(motion.frame_time))
    spans = [[patch.get_x(), patch.get_x() + patch.get_width()] for patch in figure.axes[1].patches]
    dt = float(motion.frame_time)
    np.testing.assert_allclose(spans, [[1.5 * dt, 4.5 * dt], [6.5 * dt, 8.5 * dt]])
    assert not figure.axes[0].patches
    figure.savefig(tmp_path / "contacts.png")
    assert (tmp_path / "contacts.png").read_bytes().startswith(b"\x89PNG")


def test_no_points_and_wrong_length():
    motion = random_motion(np.random.default_rng(0), frames=9, skeleton=3)
    none = ContactPoints(motion.skeleton, [])
    empty = Contacts(none, np.zeros((9, 0), bool), np.zeros((9, 0, 3)))
    assert len(plot_contacts(motion, empty).axes) == 1
    with pytest.raises(ValueError, match="plot_contacts: contacts have 9 frames, the motion 5"):
        plot_contacts(motion[:5], two_points(motion))

"""The two skeletons: counts, names, symmetry, rest pose."""

import numpy as np
import pytest

from jaxmotion import samples


def rest_positions(skeleton):
    positions = np.zeros((skeleton.num_joints, 3))
    for j, parent in enumerate(skeleton.parents):
        positions[j] = np.asarray(skeleton.offsets[j]) + (positions[parent] if parent >= 0 else 0)
    return positions


@pytest.mark.parametrize(
    ("make", "joints", "ends"), [(samples.biped, 22, 5), (samples.quadruped, 26, 6)]
)
def test_shape_and_mirror_symmetry(make, joints, ends):
    skeleton = make()
    assert (skeleton.num_joints, len(skeleton.end_joints)) == (joints, ends)
    assert skeleton.up == "y"
    names, positions = skeleton.names, rest_positions(skeleton)
    for j, name in enumerate(names):
        if name.startswith("Left"):
            other = skeleton.index(name.replace("Left", "Right"))
            np.testing.assert_array_equal(positions[other], positions[j] * [-1, 1, 1])
            parent, mirrored = names[skeleton.parents[j]], names[skeleton.parents[other]]
            assert mirrored == parent.replace("Left", "Right")
        elif not name.startswith("Right"):
            assert positions[j, 0] == 0


@pytest.mark.parametrize("make", [samples.biped, samples.quadruped])
def test_stands_on_the_floor_with_its_left_at_plus_x(make):
    skeleton = make()
    positions = rest_positions(skeleton)
    toes = [j for j, n in enumerate(skeleton.names) if n.endswith(("ToeBase", "FingerBase"))]
    np.testing.assert_allclose(positions[toes, 1], 0, atol=1e-15)
    assert positions[skeleton.index("LeftToeBase"), 0] > 0
    toe = skeleton.end_joints.index(skeleton.index("LeftToeBase"))
    assert skeleton.end_offsets[toe, 2] > 0


def test_dtype(dtype):
    assert samples.biped(dtype).offsets.dtype == dtype
    assert samples.quadruped(dtype).end_offsets.dtype == dtype
    with pytest.raises(ValueError, match="float32 or float64"):
        samples.biped(np.int32)

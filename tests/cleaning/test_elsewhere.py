"""What neighbours show in place of each frame, by plain loops."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.cleaning import Neighbours, nearest_words
from jaxmotion.cleaning.elsewhere import (
    Elsewhere,
    Poses,
    mean_texture,
    median_pose,
    medoid_pose,
    poses,
)
from jaxmotion.cleaning.elsewhere import elsewhere as places
from tests.cleaning.clips import repeating
from tests.cleaning.oracles import kept_poses, mean_of, places_by_hand
from tests.helpers import angle_between, assert_same_rotation, random_quaternions


def neighbours(starts, clip, warp):
    k = np.shape(clip)
    frame = np.asarray(warp)[..., 0]
    numbers = (jnp.asarray(x, jnp.int32) for x in (starts, clip, frame, warp))
    first, clip, frame, warp = numbers
    return Neighbours(first, clip, frame, jnp.zeros(k), warp, jnp.zeros(len(starts)), 0.0, (0,))


def listed(shown):
    return [
        sorted((c, f) for c, f in zip(*row, strict=True) if c >= 0)
        for row in zip(shown.clip, shown.frame, strict=True)
    ]


@pytest.mark.parametrize("frames", [15, 16, 33, 47])
def test_places(frames):
    """Of words that begin every five frames, and one that ends with the clip."""
    rng = np.random.default_rng(frames)
    starts = [*range(0, frames - 14, 5)]
    starts += [frames - 15] if starts[-1] != frames - 15 else []
    clip = rng.integers(-1, 3, (len(starts), 4))
    found = neighbours(starts, clip, rng.integers(0, 40, (len(starts), 4, 15)))
    shown = places(found, frames)
    assert shown.clip.shape == shown.frame.shape
    assert len(shown.clip) == frames
    assert listed(shown) == places_by_hand(found, frames)


def test_places_of_words_as_they_are_found():
    motion, other = repeating(0, 62), repeating(0, 50)
    found = nearest_words(motion, other, joints=None, k=3)
    assert listed(places(found, 62)) == places_by_hand(found, 62)


def test_no_words():
    found = neighbours(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3, 15)))
    shown = places(found, 7)
    assert shown.clip.shape == (7, 3)
    assert (shown.clip == -1).all()
    rng = np.random.default_rng(0)
    own = np.asarray(random_quaternions(rng, (7, 2)))
    mean, known = mean_texture(shown, [own], np.zeros((7, 2), bool))
    np.testing.assert_array_equal(mean, own)
    assert not known.any()


@pytest.fixture
def seen():
    """Places of 9 frames in three clips of two joints, and those clips."""
    rng = np.random.default_rng(1)
    textures = [np.array(random_quaternions(rng, (n, 2), angle=2.0)) for n in (9, 12, 5)]
    textures[1] *= rng.choice([-1.0, 1.0], (12, 2, 1))
    clip = rng.integers(-1, 3, (9, 6))
    clip[4] = -1
    clip[5] = 0
    frame = np.array([[-1 if c < 0 else rng.integers(len(textures[c])) for c in x] for x in clip])
    left_out = rng.random((9, 2)) < 0.4
    left_out[:, 1] = frame[5].min() >= 0
    return Elsewhere(clip, frame), textures, left_out


def there(shown, t):
    return [(c, f) for c, f in zip(shown.clip[t], shown.frame[t], strict=True) if c >= 0]


def test_poses(seen):
    shown, textures, left_out = seen
    rotations, counts = poses(*seen)
    assert rotations.shape == (9, 6, 2, 4)
    for t in range(9):
        for j in range(2):
            wanted = kept_poses(there(shown, t), textures, left_out, j)
            np.testing.assert_array_equal(rotations[t, counts[t, :, j], j], wanted)


def test_means(seen, monkeypatch):
    """The first eigenvector of Σ q qᵀ; frames go in chunks, the last of them a short one."""
    shown, textures, left_out = seen
    monkeypatch.setattr("jaxmotion.cleaning.elsewhere._CHUNK", 4)
    mean, known = mean_texture(*seen)
    np.testing.assert_array_equal(known, np.repeat(np.arange(9) != 4, 2).reshape(9, 2))
    np.testing.assert_array_equal(mean[4], textures[0][4])
    for t in np.flatnonzero(known[:, 0]):
        for j in range(2):
            q = kept_poses(there(shown, t), textures, left_out, j)
            assert_same_rotation(mean[t, j], mean_of(q), 1e-7)


def test_medians(seen):
    """Of each component, with the signs of the first pose that counts."""
    shown, textures, left_out = seen
    middle = median_pose(poses(*seen))
    for t in range(9):
        for j in range(2):
            q = kept_poses(there(shown, t), textures, left_out, j)
            wanted = np.array([1.0, 0, 0, 0])
            if len(q):
                wanted = np.median([x if x @ q[0] >= 0 else -x for x in q], axis=0)
            assert_same_rotation(middle[t, j], wanted / np.linalg.norm(wanted), 1e-7)


def test_medoids(seen):
    """The one with the least angles to the others together, itself one that counts."""
    shown, textures, left_out = seen
    middle = medoid_pose(poses(*seen))
    for t in [0, 1, 2, 3, 5, 6, 7, 8]:
        for j in range(2):
            q = kept_poses(there(shown, t), textures, left_out, j)
            total = [angle_between(np.tile(x, (len(q), 1)), q).sum() for x in q]
            assert_same_rotation(middle[t, j], q[np.argmin(total)], 1e-7)


def test_one_that_is_far_from_the_others(dtype):
    """Changes a median little, a medoid not at all."""
    rng = np.random.default_rng(2)
    q = np.array(random_quaternions(rng, (1, 9, 1), dtype, angle=0.1))
    q[0, 3, 0] = [0, 1, 0, 0]
    counts = np.ones((1, 9, 1), bool)
    for middle in (median_pose, medoid_pose):
        found = middle(Poses(q, counts))
        assert found.dtype == dtype
        assert angle_between(found[0, 0], [1, 0, 0, 0]) < 0.1
        counts[0, 3] = False
        assert angle_between(middle(Poses(q, counts))[0, 0], [1, 0, 0, 0]) < 0.1
        signed = q * rng.choice([-1, 1], (1, 9, 1, 1)).astype(dtype)
        assert_same_rotation(middle(Poses(signed, counts)), middle(Poses(q, counts)), 1e-5)

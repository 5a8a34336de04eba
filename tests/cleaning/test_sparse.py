"""Whole motions from a few joints."""

import jax
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cleaning import reconstruct_sparse, sparse
from tests.cleaning.clips import repeating
from tests.helpers import no_shape_checks

LEGS = ["LeftUpLeg", "LeftLeg", "RightUpLeg", "RightLeg"]
NINE = ["Neck", "UpperArm_L", "UpperArm_R", "LowerArm_L", "LowerArm_R"]
NINE += ["UpperLeg_L", "UpperLeg_R", "LowerLeg_L", "LowerLeg_R"]


@pytest.fixture(scope="module")
def walk():
    return jm.samples.load("walk", fps=24.0, num_frames=120).motion


def garbled(motion, kept):
    """All rotations but those of some joints, and the body, are lost."""
    q = np.array(motion.rotations)
    lost = [j for j in range(1, motion.num_joints) if motion.skeleton.names[j] not in kept]
    q[:, lost] = np.array([1, 0, 0, 0], q.dtype)
    return motion.with_transforms(rotations=q)


def test_what_is_known_stays_and_the_rest_comes(walk):
    query = garbled(walk[:50], LEGS)
    made = reconstruct_sparse(query, LEGS, walk[50:])
    known = [walk.skeleton.index(name) for name in LEGS]
    q = np.asarray(query.rotations)
    np.testing.assert_array_equal(np.asarray(made.rotations)[:, known], q[:, known])
    np.testing.assert_array_equal(made.translations, query.translations)
    assert jm.metrics.turn(made.rotations, walk[:50].rotations).mean() < 0.03
    assert made.dtype == walk.dtype
    single = reconstruct_sparse(query.astype("float32"), LEGS, walk[50:].astype("float32"))
    assert single.dtype == np.float32
    assert jm.metrics.turn(single.rotations, made.rotations).max() < 1e-3


def test_by_kernel_regression(monkeypatch):
    """As the module has it, in a dense system; more frames than are kept, the nearest of them."""
    rng = np.random.default_rng(0)
    asked, told = rng.standard_normal((7, 5)), rng.standard_normal((30, 5))
    answers = rng.standard_normal((30, 6))

    def by_hand(chosen):
        x, y = told[chosen], answers[chosen]
        kernel = np.array([[np.exp(-np.sum((a - b) ** 2) / 18) for b in x] for a in x])
        ahead = np.array([[np.exp(-np.sum((a - b) ** 2) / 18) for b in x] for a in asked])
        middle = y.mean(axis=0)
        return middle + ahead @ np.linalg.inv(kernel + 0.1 * np.eye(len(x))) @ (y - middle)

    found = sparse._regressed(asked, told, answers)
    np.testing.assert_allclose(found, by_hand(np.arange(30)), rtol=1e-9)
    monkeypatch.setattr(sparse, "_MOST", 12)
    monkeypatch.setattr(sparse, "_CHUNK", 4)
    far = np.linalg.norm(told[:, None] - asked, axis=-1).min(axis=1)
    nearest = np.sort(np.argsort(far)[:12])
    np.testing.assert_allclose(sparse._regressed(asked, told, answers), by_hand(nearest), rtol=1e-9)


def test_facing_and_place_stay(walk):
    """Turned about the vertical and moved, the query comes out turned and moved so."""
    query = walk[:40]
    turn = jm.quaternion.exp(np.array([0.0, 2.0, 0.0]))
    q, p = np.array(query.rotations), np.array(query.translations)
    q[:, 0] = jm.quaternion.multiply(turn, q[:, 0])
    p[:, 0] = np.asarray(jm.quaternion.rotate(turn, p[:, 0])) + np.array([50.0, 0, -20])
    one, other = (
        reconstruct_sparse(clip, LEGS, walk[40:]) for clip in (query, query.with_transforms(p, q))
    )
    back = np.array(other.rotations)
    back[:, 0] = jm.quaternion.multiply(jm.quaternion.conjugate(turn), back[:, 0])
    assert jm.metrics.turn(one.rotations, back).max() < 1e-6


def test_other_rates_and_few_frames(walk):
    """A corpus at 120 frames a second, and a query of one frame."""
    slow = jm.resample(walk[50:], fps=120.0)
    a, b = (reconstruct_sparse(walk[:30], LEGS, x) for x in (walk[50:], slow))
    assert jm.metrics.turn(a.rotations, b.rotations).mean() < 0.03
    one = reconstruct_sparse(walk[:1], LEGS, walk[50:])
    assert np.isfinite(one.rotations).all()


def test_nothing_else_is_unknown(walk):
    every = walk.skeleton.names
    made = reconstruct_sparse(walk[:30], every, walk[30:])
    np.testing.assert_array_equal(made.rotations, walk[:30].rotations)


def test_real_walks(data_dir):
    """One held back, from those of the others: nearer than their mean pose."""
    paths = sorted(data_dir.glob("bandai/walk_*.bvh"))[::3]
    clips = {path.stem: jm.load(path, dtype=np.float32) for path in paths}
    held = clips.pop("walk_active_001")
    made = reconstruct_sparse(held, NINE, list(clips.values()))
    q = np.concatenate([clip.rotations for clip in clips.values()])
    mean = jm.quaternion.mean(q, method="chordal")
    names = held.skeleton.names
    unknown = [j for j in range(2, held.num_joints) if names[j] not in NINE]
    far = jm.metrics.turn(held.rotations, np.broadcast_to(mean, held.rotations.shape))
    left = jm.metrics.turn(held.rotations, made.rotations)
    assert left[:, unknown].mean() < 0.75 * far[:, unknown].mean()


def test_what_is_wrong_is_said(walk):
    with pytest.raises(ValueError, match="the corpus is empty"):
        reconstruct_sparse(walk, LEGS, [])
    with pytest.raises(ValueError, match="other joints"):
        reconstruct_sparse(walk, LEGS, repeating(0))
    with pytest.raises(ValueError, match="expected one of"):
        reconstruct_sparse(walk, [99], walk)
    with no_shape_checks(), pytest.raises(ValueError, match="traced"):
        jax.jit(lambda m: reconstruct_sparse(m, LEGS, walk))(walk)

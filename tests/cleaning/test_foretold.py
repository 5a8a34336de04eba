"""What the other joints foretell, against least squares of SciPy's rotation vectors."""

import numpy as np
import pytest

from jaxmotion.cleaning.foretold import foretold_residual
from tests.cleaning.oracles import foretold_by_hand, vectors_by_hand
from tests.helpers import quaternions_by
from tests.style.clips import quaternions, rotations, swaying


def textures(*frames, jitter=0.05, dtype=np.float64):
    rng = np.random.default_rng(0)
    made = []
    for n, length in enumerate(frames):
        q = np.asarray(swaying(n, length).rotations)[:, 1:]
        v = jitter * rng.standard_normal((length, 4, 3))
        turned = rotations(q) * rotations(quaternions_by(v))
        made.append(quaternions(turned).reshape(q.shape).astype(dtype))
    return made


@pytest.mark.parametrize(
    ("frames", "step"),
    [((100,), 1), ((100, 40, 25), 1), ((130, 30), 3), ((31,), 1), ((2, 30), 1), ((1,), 1)],
)
def test_as_least_squares(frames, step):
    q = textures(*frames)
    left_out = np.random.default_rng(1).random((frames[0], 4)) < 0.1
    found = foretold_residual(q, step, left_out)
    np.testing.assert_allclose(found, foretold_by_hand(q, step, left_out), atol=1e-8)


def test_float32_and_signs():
    q = textures(70, 40)
    none = np.zeros((70, 4), bool)
    wanted = foretold_residual(q, 1, none)
    single = foretold_residual([x.astype(np.float32) for x in q], 1, none)
    np.testing.assert_allclose(single, wanted, atol=1e-4)
    q[0][3:9] *= -1
    q[1][::2, 1] *= -1
    np.testing.assert_allclose(foretold_residual(q, 1, none), wanted, atol=1e-9)


def following(frames=150):
    """Three joints, the third of which does what the others do together."""
    t = np.arange(frames)[:, None] / 30
    a = 0.3 * np.sin(4 * t + np.array([0, 1, 2]))
    b = 0.3 * np.sin(6 * t + np.array([0, 2, 1]))
    return np.stack([a, b, 0.5 * a + 0.5 * b], axis=1)


def test_an_error_does_not_foretell_itself():
    """It stays in the residual, where it is as large as it is, and nowhere else."""
    v = following()
    none = np.zeros((150, 3), bool)
    clean = np.linalg.norm(foretold_residual([quaternions_by(v)], 1, none)[:, 2], axis=-1)
    assert clean.max() < 0.15
    v[60:75, 2, 0] += 0.8
    broken = [quaternions_by(v)]
    found = np.linalg.norm(foretold_residual(broken, 1, none)[:, 2], axis=-1)
    inside = np.isin(np.arange(150), range(60, 75))
    assert found[inside].min() > 0.6
    assert found[~inside].max() < 0.25
    # Without it nothing is learnt of it.
    out = none.copy()
    out[60:75, 2] = True
    better = np.linalg.norm(foretold_residual(broken, 1, out)[:, 2], axis=-1)
    assert better[~inside].mean() < found[~inside].mean()


def test_a_context_that_knows():
    """What the clip does once is foretold by a context in which it comes often."""
    none = np.zeros((40, 3), bool)
    v = following(190)
    alone = foretold_residual([quaternions_by(v[150:])], 1, none)
    helped = foretold_residual([quaternions_by(v[150:]), quaternions_by(v[:150])], 1, none)
    assert np.linalg.norm(helped[:, 2]) < np.linalg.norm(alone[:, 2])


def test_one_joint():
    """Nothing foretells it: what is left is all that it turns by."""
    q = textures(50)[0][:, :1]
    found = foretold_residual([q], 1, np.zeros((50, 1), bool))
    np.testing.assert_allclose(found, vectors_by_hand(q), atol=1e-9)
    assert foretold_residual([q[:, :0]], 1, np.zeros((50, 0), bool)).shape == (50, 0, 3)

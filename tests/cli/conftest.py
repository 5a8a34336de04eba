"""Commands run in this process, and the clips they are given."""

import json
import re

import jax
import numpy as np
import pytest
from click.testing import CliRunner

import jaxmotion as jm
from jaxmotion.cli import _session
from jaxmotion.cli._app import app
from jaxmotion.cli._page import RECORD
from tests.helpers import assert_same_rotation, quaternions_by

_NOTICE = _session._CompilingNotice


@pytest.fixture
def notice_class():
    """The notice that other tests do without."""
    return _NOTICE


@pytest.fixture(autouse=True)
def own_settings(monkeypatch, notice_class):
    """The tests' process keeps its own JAX settings."""
    monkeypatch.setenv("JAXMOTION_CACHE_DIR", "")
    monkeypatch.setattr(_session, "_CompilingNotice", lambda **_: None)
    yield
    jax.config.update("jax_disable_most_optimizations", False)


@pytest.fixture
def jaxmotion():
    """Run a command line; returns click's Result (exit_code, stdout, stderr)."""

    def run(*words, code=0):
        result = CliRunner().invoke(app, [str(word) for word in words], prog_name="jaxmotion")
        assert result.exit_code == code, result.output
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return result

    return run


def record_in(report):
    """The record in a report, also in a page."""
    text = report.read_text("utf-8")
    return json.loads(text if report.suffix == ".json" else re.findall(RECORD, text, re.DOTALL)[0])


def swinging(frames=40, seed=0, noise=0.02):
    """Four joints, Left… and Right…, swinging with noise; the root glides."""
    rng = np.random.default_rng(seed)
    skeleton = jm.Skeleton(
        ["Hips", "LeftArm", "LeftHand", "RightArm"],
        [-1, 0, 1, 0],
        np.array([[0.0, 0, 0], [2, 5, 0], [3, 0, 0], [-2, 5, 0]]),
        end_joints=[2],
        end_offsets=np.array([[1.0, 0, 0]]),
    )
    t = np.arange(frames)[:, None, None] / 30
    phase = rng.uniform(0, 6, (4, 3))
    turns = 0.5 * np.sin(3 * t + phase) + noise * rng.standard_normal((frames, 4, 3))
    root = np.stack([t[:, 0, 0], 9 + 0 * t[:, 0, 0], 2 * t[:, 0, 0]], -1)
    return jm.Motion.from_root(skeleton, root, quaternions_by(turns), 1 / 30)


@pytest.fixture
def take(tmp_path):
    """A BVH file of 40 frames."""
    path = tmp_path / "take.bvh"
    jm.save(swinging(), path)
    return path


def assert_same_clip(got, want):
    assert_same_rotation(got.rotations, want.rotations, 1e-9)
    np.testing.assert_allclose(got.translations, want.translations, atol=1e-9)
    assert got.frame_time == pytest.approx(float(want.frame_time), rel=1e-9)

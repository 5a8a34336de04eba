"""The player's page of 2526 frames by 65 joints, written to disk, and a clip in a notebook.

No peer writes such a page. The rate is of what is written; times in a browser are in
``tests/viz/test_player_browser.py``, which prints them.
"""

import numpy as np
import pytest

import jaxmotion as jm

FRAMES, JOINTS = 2526, 65


def _clip(frames, joints):
    rng = np.random.default_rng(0)
    parents = [-1, *(max(0, j - 1 - j % 4) for j in range(1, joints))]
    skeleton = jm.Skeleton(
        [f"joint{j}" for j in range(joints)], parents, rng.standard_normal((joints, 3))
    )
    t = np.arange(frames)[:, None, None] / 60
    q = np.sin(t * rng.uniform(0.5, 4, (joints, 4)) + rng.uniform(0, 6, (joints, 4)))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    return jm.Motion.from_root(skeleton, np.cumsum(np.ones((frames, 3)), 0) / 60, q, 1 / 60)


@pytest.mark.parametrize("clips", [1, 2])
def test_player(race, tmp_path, clips):
    """The goal is half a second for one."""
    motion = _clip(FRAMES, JOINTS)
    shown = {f"take {k}": motion for k in range(clips)}
    path = tmp_path / "clip.html"
    jm.viz.player(shown).save(path)
    race(
        f"player {FRAMES}x{JOINTS}, {clips} clip{'s' * (clips > 1)}",
        lambda: jm.viz.player(shown).save(path),
        amount=(path.stat().st_size / 1e6, "MB"),
    )


def test_in_a_notebook(race):
    motion = _clip(600, 22)
    shown, _ = race("a clip in a notebook, 600x22", lambda: motion._repr_html_())
    assert len(shown) < 300_000

"""Variations of a clip: what is drawn, what is made of it, and what is refused."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import jaxmotion as jm
from jaxmotion.augmentation.draws import drawn
from jaxmotion.spacetime import JointLimits, learn_limits
from jaxmotion.style import apply_style, interpolate, motion_style
from tests.helpers import (
    angle_between,
    assert_same_rotation,
    check_gradients,
    compilations,
    no_shape_checks,
)
from tests.style.clips import JOINTS, rotations, swaying

KEY = jax.random.key(7)
plain = functools.partial(jm.augment, alpha=(1.0, 1.0), time_warp=0.0, keep_contacts=False)


def test_draws_are_even():
    """Each gain in a step of its own; shares uniform over the simplex."""
    draws = drawn(KEY, 500, 3, jnp.asarray([0.5, 2.0]))
    gaps = np.diff(np.sort(draws.alpha))
    np.testing.assert_allclose(gaps, 1.5 / 500, rtol=1e-9)
    assert 0.5 <= draws.alpha.min() < 0.5 + 1.5 / 500
    np.testing.assert_allclose(draws.shares.sum(axis=1), 1, rtol=1e-12)
    # Of the Dirichlet distribution with three ones: mean 1/3, mean square 1/6.
    np.testing.assert_allclose(draws.shares.mean(axis=0), 1 / 3, rtol=0.03)
    np.testing.assert_allclose((draws.shares**2).mean(axis=0), 1 / 6, rtol=0.06)
    assert ((draws.periods >= 1) & (draws.periods <= 4)).all()
    assert not (np.diff(draws.alpha) > 0).all()


def test_nothing_asked_is_the_clip():
    motion = swaying(0)
    made = plain(motion, KEY, n=3)
    assert made.accepted.all()
    assert made.contacts is None
    for one in made:
        assert_same_rotation(one.rotations, motion.rotations, 1e-9)
        np.testing.assert_allclose(one.translations, motion.translations, atol=1e-9)
        assert float(one.frame_time) == float(motion.frame_time)


def test_gains_are_those_of_layers():
    motion = swaying(1)
    made = plain(motion, KEY, n=3, alpha=(0.5, 3.0))
    layers = jm.decompose(motion)
    for alpha, one in zip(made.alpha, made, strict=True):
        wanted = jm.synthesize(layers, alpha, 1.0)
        assert_same_rotation(one.rotations, wanted.rotations, 1e-9)
        np.testing.assert_allclose(one.translations, wanted.translations, atol=1e-9)


def test_styles_are_mixed():
    motion, others = swaying(2), [swaying(3, 52), swaying(4)]
    styles = [motion_style(clip) for clip in (motion, *others)]
    made = plain(motion, KEY, n=3, styles=[others[0], styles[2]])
    assert made.shares.shape == (3, 3)
    for shares, one in zip(made.shares, made, strict=True):
        goal = interpolate(styles, shares)
        wanted = apply_style(motion, goal, deviation="covariance", keep_contacts=False)
        assert_same_rotation(one.rotations, wanted.rotations, 1e-9)
        np.testing.assert_allclose(one.translations, wanted.translations, atol=1e-9)


def test_time_is_bent():
    """Whole, forwards, ends where it ended; read by the natural spline of SciPy."""
    motion = swaying(5, 150)
    made = plain(motion, KEY, n=4, time_warp=0.4)
    frames = np.asarray(made.frames)
    np.testing.assert_allclose(frames[:, 0], 0)
    np.testing.assert_allclose(frames[:, -1], 149)
    speed = np.diff(frames, axis=1)
    assert (speed.min(axis=1) >= 1.4**-2).all()
    assert (speed.max(axis=1) <= 1.4**2).all()
    assert (np.ptp(speed, axis=1) > 0.2).all()
    assert np.abs(np.diff(speed, axis=1)).max() < 0.05
    curve = CubicSpline(np.arange(150), motion.root_positions, bc_type="natural")
    for at, one in zip(frames, made, strict=True):
        np.testing.assert_allclose(one.root_positions, curve(at), atol=2e-5)
        nearest = motion.rotations[np.round(at).astype(int)]
        assert angle_between(one.rotations, nearest).max() < 0.2


def test_feet_stand():
    walk = jm.samples.load("walk").motion[:90]
    contacts = jm.contacts.detect(walk)
    made = jm.augment(walk, KEY, n=3, keep_contacts=contacts)
    own = jm.metrics.foot_skate(walk, contacts)
    assert made.contacts is not None
    for i, one in enumerate(made):
        planted = jax.tree.map(lambda x, i=i: x[i], made.contacts.mask)
        at = jm.contacts.Contacts(contacts.points, planted, made.contacts.target[i])
        np.testing.assert_allclose(made.slide[i], jm.metrics.foot_skate(one, at), atol=1e-9)
        assert made.slide[i] <= own
        nearest = np.round(made.frames[i]).astype(int)
        np.testing.assert_array_equal(planted, contacts.mask[nearest])
    again = jm.augment(walk, KEY, n=3)
    np.testing.assert_array_equal(again.motions.rotations, made.motions.rotations)
    loose = jm.augment(walk, KEY, n=3, keep_contacts=False)
    assert loose.contacts is None
    assert (loose.slide == 0).all()


def test_beyond_limits_is_refused():
    """Against SciPy; the root may turn as it likes."""
    motion = swaying(6)
    limits = learn_limits(motion, margin=0.1)
    made = plain(motion, KEY, n=9, alpha=(0.5, 2.5), limits=limits)
    for i, one in enumerate(made):
        for j in range(1, JOINTS):
            turn = rotations(limits.centre[j]).inv() * rotations(one.rotations[:, j])
            v = turn.as_rotvec()
            wanted = np.maximum(v - limits.upper[j], limits.lower[j] - v).max()
            np.testing.assert_allclose(made.excess[i, j], max(wanted, 0), atol=1e-9)
    assert (made.excess[:, 0] == 0).all()
    np.testing.assert_array_equal(made.accepted, made.excess.max(axis=1) == 0)
    assert 0 < made.accepted.sum() < 9
    refused = made.refused()
    assert sorted(refused) == np.flatnonzero(~np.asarray(made.accepted)).tolist()
    worst = max(refused, key=lambda i: float(made.excess[i].max()))
    name = motion.skeleton.names[int(made.excess[worst].argmax())]
    assert refused[worst].startswith(f"beyond joint limits: {name} ")
    assert len(made.sound()) + len(refused) == len(made) == 9
    learned = plain(motion, KEY, n=9, alpha=(0.5, 2.5), limits=[motion])
    assert learned.accepted.sum() <= made.accepted.sum()
    np.testing.assert_allclose(learned.excess.max(), made.excess.max() + 0.05, atol=0.02)


def test_what_sinks_or_slides_is_refused():
    """A walk that is exaggerated into the floor; one that goes faster than its legs can."""
    walk = jm.samples.load("walk").motion[:90]
    made = plain(walk, KEY, n=2, alpha=(-3.0, -2.0))
    lowest = [float(jm.forward_kinematics(one).positions[..., 1].min()) for one in (walk, *made)]
    np.testing.assert_allclose(made.depth, np.maximum(lowest[0] - np.array(lowest[1:]), 0))
    assert not made.accepted.any()
    assert all("below the floor" in text for text in made.refused().values())
    style = motion_style(walk)
    style = eqx.tree_at(lambda style: style.root_mean, style, style.root_mean.at[:2].multiply(6))
    fast = jm.augment(walk, KEY, n=3, styles=[style])
    slid = np.flatnonzero(fast.slide > fast.most_slide)
    assert slid.size
    assert all("feet slide at" in fast.refused()[i] for i in slid.tolist())
    assert not fast.accepted[slid].any()


def test_a_leg_is_half_the_longest_chain():
    motion = swaying(6)
    made = plain(motion, KEY, n=1)
    # hips, leg, foot: 1 + √(1 + 0.2²)
    np.testing.assert_allclose(made.most_depth, 0.02 * 0.5 * (1 + np.sqrt(1.04)), rtol=1e-12)
    assert float(made.most_slide) == pytest.approx(2 * float(made.most_depth))


def test_what_is_not_finite_is_refused():
    made = plain(swaying(6), KEY, n=2)
    broken = jax.tree.map(lambda x: x.at[1].set(jnp.nan), made.excess)
    with no_shape_checks():
        made = type(made)(**{**vars(made), "excess": broken})
    assert made.refused() == {1: "not finite"}


def test_keys_and_numbers():
    motion = swaying(8)
    nine, again = (jm.augment(motion, KEY, n=9, keep_contacts=False) for _ in range(2))
    np.testing.assert_array_equal(nine.motions.rotations, again.motions.rotations)
    other = jm.augment(motion, jax.random.key(8), n=9, keep_contacts=False)
    assert np.abs(other.motions.rotations - nine.motions.rotations).max() > 1e-3
    assert len({float(alpha) for alpha in nine.alpha}) == 9
    np.testing.assert_array_equal(nine[-1].rotations, nine.motions.rotations[8])
    with pytest.raises(IndexError, match="variation 9 of 9"):
        nine[9]
    old = jm.augment(motion, jax.random.PRNGKey(7), n=9, keep_contacts=False)
    np.testing.assert_array_equal(old.alpha, nine.alpha)


def test_jit_vmap_and_float32():
    motion, style = swaying(9), motion_style(swaying(10))

    def poses(key, motion):
        made = jm.augment(motion, key, n=3, styles=[style], keep_contacts=False)
        return made.motions.rotations, made.accepted

    eager = poses(KEY, motion)
    assert_same_rotation(jax.jit(poses)(KEY, motion)[0], eager[0], 1e-9)
    keys = jnp.stack([KEY, jax.random.key(1)])
    many = jax.vmap(poses, in_axes=(0, None))(keys, motion)
    assert_same_rotation(many[0][0], eager[0], 1e-9)
    low = jm.augment(motion.astype(np.float32), KEY, n=3, styles=[style], keep_contacts=False)
    kinds = {x.dtype for x in jax.tree.leaves(low) if jnp.issubdtype(x.dtype, jnp.floating)}
    assert kinds == {np.dtype("float32")}


def test_lengths_that_share_a_program():
    """Padded or not, a clip has the same variations; feet and limits too."""
    walk = jm.samples.load("walk").motion[:57]
    limits = learn_limits(walk, margin=0.1)

    def made(contacts):
        found = jm.augment(walk, KEY, n=2, keep_contacts=contacts, limits=limits)
        return found.motions.rotations, found.slide, found.depth, found.excess, found.frames

    contacts = jm.contacts.detect(walk)
    eager, traced = made(contacts), jax.jit(made)(contacts)
    assert_same_rotation(eager[0], traced[0], 1e-9)
    for one, other in zip(eager[1:], traced[1:], strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)
    first, second = walk[:56], walk[:50]
    jm.augment(first, KEY, n=2, limits=limits)
    with compilations() as names:
        jm.augment(second, KEY, n=2, limits=limits)
    assert names == []


@pytest.mark.parametrize(
    "references",
    [0, pytest.param(1, marks=pytest.mark.sweep)],  # style/test_transfer.py has theirs
)
def test_derivatives(references):
    motion, styles = swaying(11, 12), [motion_style(swaying(12, 15))][:references]

    def numbers(translations, q):
        clip = motion.with_transforms(translations, q)
        made = jm.augment(clip, KEY, n=2, styles=styles, keep_contacts=False)
        return made.motions.rotations, made.motions.translations[:, :, 0]

    given = jnp.asarray(motion.translations), jnp.asarray(motion.rotations)
    check_gradients(numbers, *given, rtol=1e-4, atol=1e-4, eps=1e-6)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_short_clips(frames):
    made = jm.augment(swaying(13, 40)[:frames], KEY, n=2, styles=[swaying(14)])
    assert made.motions.rotations.shape == (2, frames, JOINTS, 4)
    assert np.isfinite(made.motions.rotations).all()
    np.testing.assert_allclose(made.frames[:, -1], frames - 1)


def test_what_is_wrong_is_said():
    motion = swaying(15)
    with no_shape_checks():
        with pytest.raises(ValueError, match="n=0"):
            plain(motion, KEY, n=0)
        with pytest.raises(ValueError, match=r"styles\[0\]"):
            plain(motion, KEY, n=1, styles=["tired"])  # type: ignore[list-item]
        with pytest.raises(ValueError, match="alpha has shape"):
            plain(motion, KEY, n=1, alpha=1.0)
    with pytest.raises(ValueError, match="the lesser first"):
        plain(motion, KEY, n=1, alpha=(2.0, 1.0))
    with pytest.raises(ValueError, match="time_warp must be 0 or more"):
        plain(motion, KEY, n=1, time_warp=-0.1)
    with pytest.raises(ValueError, match="other joints"):
        plain(motion, KEY, n=1, styles=[swaying(1, names=("a", "b", "c", "d", "e"))])
    with pytest.raises(ValueError, match="other joints"):
        plain(motion, KEY, n=1, limits=swaying(1, names=("a", "b", "c", "d", "e")))
    with pytest.raises(ValueError, match="limits of 2 joints"):
        plain(motion, KEY, n=1, limits=JointLimits(-np.ones((2, 3)), np.ones((2, 3))))
    with pytest.raises(ValueError, match="keep_contacts=True"):
        jax.jit(lambda m: jm.augment(m, KEY, n=1).motions.rotations)(motion)


@pytest.mark.sweep  # walks that are made are varied above
def test_real_walks(data_dir):
    """Styles of other walks, limits of all: most are sound, and what is, keeps the limits."""
    paths = sorted(data_dir.glob("bandai/walk_*_001.bvh"))
    clips = {path.stem.split("_")[1]: jm.load(path, dtype=np.float64) for path in paths}
    limits = learn_limits(list(clips.values()))
    styles = [motion_style(clips[name]) for name in ("tired", "proud", "happy", "angry")]
    walk = clips["normal"][:128]
    made = jm.augment(walk, KEY, n=16, styles=styles, limits=limits)
    assert 4 <= len(made.sound()) < 16
    free = [j for j, name in enumerate(walk.skeleton.names) if name in ("joint_Root", "Hips")]
    for one in made.sound():
        beyond = np.abs(np.delete(limits.excess(one.rotations), free, axis=1))
        assert beyond.max() == 0
    assert all(made.refused().values())

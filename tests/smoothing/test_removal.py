"""What was removed, against the figures in plain loops over SciPy's rotations; and what of it is
taken for white noise."""

from typing import NamedTuple

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.contacts import ContactPoints, Contacts
from jaxmotion.smoothing import removed
from tests.helpers import no_shape_checks, quaternions_by

FRAMES = 240
NAMES, PARENTS = ("Hips", "Thigh", "Foot", "Arm"), (-1, 0, 1, 0)
FIGURES = ("correlation", "lean", "contact")


class Touches(NamedTuple):
    """Contacts of points on joints, no more than is asked for."""

    mask: np.ndarray
    joints: tuple[int, ...]


def clip(vectors, *, dtype=np.float64):
    """Four joints turned by rotation vectors f[T, 4, 3] from a pose of their own."""
    poses = Rotation.from_rotvec([[1.0, 2.0, -0.5], [0, 0, 0], [3.0, 0.5, 0], [0, -1.0, 0.2]])
    q = np.stack([rotation(v, poses[j]) for j, v in enumerate(np.moveaxis(vectors, 1, 0))], axis=1)
    skeleton = jm.Skeleton(NAMES, PARENTS, np.eye(4, 3, dtype=dtype))
    offsets = np.broadcast_to(np.eye(4, 3, dtype=dtype), (len(q), 4, 3))
    return jm.Motion(skeleton, offsets, q.astype(dtype), 1 / 60)


def rotation(vectors, pose):
    """Quaternions wxyz of pose ∘ exp(v)."""
    return np.roll((pose * Rotation.from_rotvec(vectors)).as_quat(), 1, axis=-1)


def swings(frames=FRAMES):
    t = np.arange(frames)[:, None, None] / 60
    return 0.5 * np.sin(3 * t + np.arange(12).reshape(4, 3)) * [[[1.0, 0.5, 0.2]]]


def noise(colour=0.0, seed=0, frames=FRAMES, joints=4):
    """Deviation 0.02 rad, of correlation ``colour`` from frame to frame."""
    v = np.random.default_rng(seed).standard_normal((frames, joints, 3))
    for t in range(1, frames):
        v[t] = colour * v[t - 1] + np.sqrt(1 - colour**2) * v[t]
    return 0.02 * v


def residual(vectors, strength):
    """What a smoother of second differences takes away: (1 − (1 + 4ρ²D'D)⁻¹) v, dense."""
    bends = np.diff(np.eye(len(vectors)), n=2, axis=0)
    smoother = np.linalg.inv(np.eye(len(vectors)) + 4 * strength**2 * bends.T @ bends)
    return vectors - np.einsum("st,tjc->sjc", smoother, vectors)


def without(v, contacts=None):
    """The rows, by joint, of a clip of which ``v`` was removed."""
    clean = clip(swings(len(v)))
    turned = jm.quaternion.multiply(clean.rotations, quaternions_by(v))
    rows = removed(clean.with_transforms(rotations=turned), clean, contacts=contacts)
    return {row.joint: row for row in rows}


def test_the_figures_are_those_of_plain_loops():
    rng = np.random.default_rng(3)
    v = rng.standard_normal((FRAMES, 4, 3)) * [[[0.4], [0.1], [0.2], [0.0]]]
    v[50:80] = 0  # as it was
    before, after = clip(swings() + v), clip(swings())
    touches = Touches(rng.random((FRAMES, 2)) < 0.3, (2, 1))
    rows = removed(before, after, contacts=touches)
    assert [row.joint for row in rows] == ["Hips", "Foot", "Thigh"]  # the arm was not turned
    for row in rows:
        j = NAMES.index(row.joint)
        was, now = (
            Rotation.from_quat(np.roll(m.rotations[:, j], -1, axis=-1)) for m in (before, after)
        )
        taken = (now.inv() * was).as_rotvec()
        angle = [np.linalg.norm(u) for u in taken]
        kept = [t for t in range(FRAMES) if angle[t] > 1e-12]
        total = sum(angle[t] ** 2 for t in kept)
        lag = [sum(taken[t + k] @ taken[t] for t in range(FRAMES - k)) / total for k in (1, 2)]
        spread = sum((was.mean().inv() * was).magnitude() ** 2)
        touching = touches.mask[:, 0] | (j < 2) & touches.mask[:, 1]
        inside, outside = (
            np.mean([angle[t] ** 2 for t in kept if touching[t] == state]) for state in (1, 0)
        )
        want = {
            "degrees": np.degrees(max(angle)),
            "frame": np.argmax(angle),
            "seconds": np.argmax(angle) / 60,
            "share": min(1, total / spread),
            "typical": np.degrees(np.sqrt(total / len(kept))),
            "correlation": lag[0] - min(lag[1], 0),
            "lean": np.linalg.norm(sum(angle[t] * taken[t] for t in kept)) / total,
            "contact": inside / outside,
        }
        for name, value in want.items():
            np.testing.assert_allclose(getattr(row, name), value, rtol=1e-7, err_msg=name)
        assert not any(isinstance(x, np.generic) for x in row)


def test_what_a_smoother_takes_of_white_noise_is_white():
    """However much it smooths; of noise that lasts, what is taken lasts, unless that is little."""
    touches = Touches(np.arange(FRAMES)[:, None] % 60 < 30, (2,))
    found = [
        row
        for strength in (0.1, 1, 3, 10, 100, 1e4)
        for seed in range(10)
        for row in without(residual(noise(seed=seed), strength), touches).values()
    ]
    assert len(found) == 240
    assert np.mean([row.white for row in found]) > 0.98
    for strength, least in ((3, 0.8), (10, 0.95), (100, 1.0)):
        rows = [
            row
            for seed in range(10)
            for row in without(residual(noise(0.5, seed), strength)).values()
        ]
        assert np.mean(["correlation" in row.stands_out for row in rows]) >= least


@pytest.mark.parametrize("axes", [[1, 0, 0], [1, 1, 1]])
def test_few_frames_of_white_noise_stand_out_by_chance_only_rarely(axes):
    """As seldom as three standard errors allow, whether noise turns about one axis or about all."""
    touches = Touches(np.arange(30)[:, None] % 3 < 1, (2,))
    rows = [
        row
        for seed in range(100)
        for row in without(noise(seed=seed, frames=30) * axes, touches).values()
    ]
    for figure in FIGURES:
        assert np.mean([figure in row.stands_out for row in rows]) < 0.02, figure
    lasting = [
        row
        for seed in range(100)
        for row in without(noise(0.9, seed=seed, frames=30) * axes).values()
    ]
    assert np.mean(["correlation" in row.stands_out for row in lasting]) > 0.7


def test_flicks_that_are_cut_are_one_sided():
    v = noise() / 20
    for start in range(5, FRAMES, 12):
        v[start : start + 2, 2] += [0.3, 0, 0.1]
        v[start + 2 : start + 10, 2] -= [0.075, 0, 0.025]  # the mean is as before
    rows = without(v)
    assert "lean" in rows["Foot"].stands_out
    assert rows["Thigh"].white
    v[::2] *= -1
    assert "lean" not in without(v)["Foot"].stands_out


def test_contacts_are_those_of_a_joint_and_of_what_hangs_from_it():
    mask = np.arange(FRAMES) % 80 < 30
    v = np.where(mask[:, None, None], 3, 1) * noise()
    rows = without(v, Touches(mask[:, None], (1,)))
    assert {name: row.contact is None for name, row in rows.items()} == {
        "Hips": False,
        "Thigh": False,
        "Foot": True,
        "Arm": True,
    }
    for name in ("Hips", "Thigh"):
        assert 7 < rows[name].contact < 11
        assert rows[name].stands_out == ("contact",)
    less = without(v, Touches(~mask[:, None], (1,)))["Thigh"]
    assert (1 / less.contact, less.stands_out) == (
        pytest.approx(rows["Thigh"].contact),
        ("contact",),
    )
    assert without(v, Touches(np.ones((FRAMES, 1), bool), (1,)))["Thigh"].contact is None
    assert all(row.white and row.contact is None for row in without(v).values())  # none are known


def test_frames_that_stay_do_not_count():
    """A removal from a part of the frames has the figures of that part alone."""
    v = residual(noise(0.5), 10)
    mask = np.arange(FRAMES)[:, None] % 20 < 8
    part = np.where((np.arange(FRAMES) // 60 == 1)[:, None, None], v, 0)
    rows, alone = (
        without(part, Touches(mask, (2,))),
        without(v[60:120], Touches(mask[60:120], (2,))),
    )
    for name, row in rows.items():
        assert row.frame == alone[name].frame + 60
        for figure in ("degrees", "typical", *FIGURES):
            if getattr(row, figure) is not None:
                assert getattr(row, figure) == pytest.approx(getattr(alone[name], figure), rel=1e-9)
        assert row.stands_out == alone[name].stands_out


def test_frames_that_were_missing_do_not_count():
    v = noise(0.5)
    clean = clip(swings())
    rotations = np.array(clip(swings() + v).rotations)
    rotations[20:90, 1] = np.nan
    mask = np.arange(FRAMES)[:, None] % 20 < 8
    touches = Touches(mask, (2,))
    rows = {
        r.joint: r
        for r in removed(clean.with_transforms(rotations=rotations), clean, contacts=touches)
    }
    v[20:90, 1] = 0
    same = {r.joint: r for r in removed(clip(swings() + v), clean, contacts=touches)}
    assert rows == same
    with pytest.raises(
        ValueError, match=r"result\.rotations of 'Thigh' at frame 20 are not finite"
    ):
        removed(clean, clean.with_transforms(rotations=rotations))


def test_signs_types_and_poses_change_nothing():
    v = noise(0.5)
    before, after = clip(swings() + v), clip(swings())
    rows = removed(before, after)
    flips = np.random.default_rng(0).choice([-1.0, 1.0], (2, FRAMES, 4, 1))
    flipped = [
        m.with_transforms(rotations=s * m.rotations)
        for s, m in zip(flips, (before, after), strict=True)
    ]
    for row, same in zip(rows, removed(*flipped), strict=True):
        assert row.stands_out == same.stands_out
        np.testing.assert_allclose(row[1:8], same[1:8], rtol=1e-9)
    single = [clip(swings() + x, dtype=np.float32) for x in (v, 0 * v)]
    for row, same in zip(rows, removed(*single), strict=True):
        assert (row.joint, row.frame, row.stands_out) == (same.joint, same.frame, same.stands_out)
        np.testing.assert_allclose(row[1:8], same[1:8], rtol=1e-3)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_tiny_clips_and_clips_that_stay(frames):
    touches = Touches(np.ones((frames, 1), bool), (2,))
    rows = without(noise(frames=frames), touches)
    assert len(rows) == 4
    assert all(row.white and np.isfinite(row[1:8]).all() for row in rows.values())
    still = clip(swings(frames))
    assert removed(still, still, contacts=touches) == ()


def test_half_turns_have_an_angle():
    v = np.zeros((8, 4, 3))
    v[3, 1] = [0, np.pi, 0]
    [row] = without(v).values()
    assert (row.joint, row.frame, row.lean) == ("Thigh", 3, 1)
    assert row.degrees == pytest.approx(180)


def test_contacts_of_the_library_are_contacts():
    motion, mask = clip(swings()), np.arange(FRAMES)[:, None] % 40 < 20
    points = ContactPoints(motion, ["Foot"])
    contacts = Contacts(points, mask, np.zeros((FRAMES, 1, 3)))
    v = noise() * np.where(mask, 2.0, 1.0)[..., None]
    rows = without(v, contacts)
    assert rows == without(v, Touches(mask, (2,)))
    assert "contact" in rows["Foot"].stands_out


def test_noise_of_a_clip_is_told_from_noise_that_lasts():
    motion = jm.samples.load("walk", num_frames=FRAMES, dtype=np.float64).motion
    white = {}
    for colour in (0.0, 0.5):
        turns = quaternions_by(noise(colour, joints=motion.num_joints))
        noisy = motion.with_transforms(rotations=jm.quaternion.multiply(motion.rotations, turns))
        rows = removed(noisy, jm.denoise(noisy))
        assert len(rows) == motion.num_joints
        white[colour] = np.mean([row.white for row in rows])
    assert white[0.0] > 0.95
    assert white[0.5] < 0.4


def test_mistakes_are_named():
    motion = clip(swings())
    with pytest.raises(ValueError, match=r"removed: result has rotations of shape \(90, 4, 4\)"):
        removed(motion, motion[:90])
    with pytest.raises(ValueError, match=r"one clip at a time for result, got batch axes \(2,\)"):
        removed(motion, jm.stack([motion, motion])[0])
    with pytest.raises(
        ValueError, match=r"contacts has a mask of shape \(90, 1\); expected \(240, 1"
    ):
        removed(motion, motion, contacts=Touches(np.zeros((90, 1), bool), (2,)))
    with no_shape_checks():
        with pytest.raises(ValueError, match="removed: result is a str"):
            removed(motion, "walk.bvh")
        with pytest.raises(ValueError, match="removed: contacts is an array of shape"):
            removed(motion, motion, contacts=np.zeros((FRAMES, 1), bool))
    with pytest.raises(TypeError, match="removed: a list cannot be made inside of jit"):
        jax.jit(lambda m: removed(m, m) and 0)(motion)

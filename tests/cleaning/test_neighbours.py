"""The nearest words: by bounds and by trying all of them, and in plain NumPy."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion._posture import posture, upright
from jaxmotion.cleaning import nearest_words, search
from jaxmotion.cleaning.words import texture
from tests.cleaning.clips import frame_distance, repeating, word_distance
from tests.helpers import no_shape_checks
from tests.style.clips import swaying

FIELDS = ("starts", "clip", "frame", "distance", "warp")


def same(one, other):
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def by_hand(motion, context, k, length, target, trim):
    """Neighbours as the module says, word by word and pair by pair: (distance, clip, frame)."""
    joints = tuple(range(motion.num_joints))
    poses = [np.asarray(texture(clip, joints), float) for clip in (motion, *context)]
    found = []
    for start in range(0, len(poses[0]) - length + 1, 5):
        word, every = poses[0][start : start + length], []
        for number, other in enumerate(poses):
            ends = len(other) - target + 1
            d = np.array([[frame_distance(x, y, trim) for y in other] for x in word])
            at = [word_distance(d[:, t : t + target], target // 2 + 1) for t in range(ends)]
            for t, mean in enumerate(at):
                lower = (t == 0 or mean < at[t - 1]) and (t == ends - 1 or mean <= at[t + 1])
                apart = abs(t + target / 2 - start - length / 2)
                if lower and not (number == 0 and apart < length / 2):
                    every.append((mean, number, t))
        found.append(sorted(every)[:k])
    return found


def test_in_plain_numpy():
    motion, context = repeating(0, 32), [repeating(0, 24, 0.05), swaying(1, 20)]
    k, length, target, trim = 3, 5, 8, 1
    result = nearest_words(
        motion, context, k=k, length=length, target=target, trim=trim, joints=None
    )
    wanted = by_hand(motion, context, k, length, target, trim)
    for row, found in enumerate(wanted):
        for place, (mean, clip, frame) in enumerate(found):
            np.testing.assert_allclose(result.distance[row, place], mean, rtol=1e-9)
            assert (int(result.clip[row, place]), int(result.frame[row, place])) == (clip, frame)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_all_pairs_say_the_same(dtype):
    """Bit for bit, of clips that come again and of ones that do not."""
    clips = [repeating(2, 150), repeating(2, 90), swaying(3, 70)]
    motion, *context = (clip.astype(dtype) for clip in clips)
    bounded, every = (
        nearest_words(motion, context, k=2, joints=None, pairs=pairs)
        for pairs in ("bounded", "all")
    )
    same(bounded, every)
    assert bounded.distance.dtype == np.dtype(dtype)
    assert bounded.warped < 0.7 < every.warped == 1


def test_what_is_left_out_is_farther():
    """Than every neighbour; and whatever is nearer than that was warped."""
    motion, context = repeating(2, 60), [swaying(3, 40)]
    sizes = {"k": 2, "length": 5, "target": 8, "trim": 1, "joints": None}
    found = nearest_words(motion, context, **sizes)
    left_out = np.asarray(found.left_out)
    assert np.isfinite(left_out).mean() > 0.5
    assert (left_out > np.asarray(found.distance)[:, -1]).all()
    poses = [np.asarray(texture(clip, tuple(range(5))), float) for clip in (motion, *context)]
    nearer, pairs = 0, 0
    for word, start in enumerate(np.asarray(found.starts)):
        for number, other in enumerate(poses):
            d = [[frame_distance(x, y, 1) for y in other] for x in poses[0][start : start + 5]]
            for t in range(len(other) - 7):
                pairs += 1
                if number or abs(t + 4 - start - 2.5) >= 2.5:
                    nearer += word_distance(np.array(d)[:, t : t + 8], 5) < left_out[word]
    assert 0 < nearer <= round(found.warped * pairs) < pairs
    every = nearest_words(motion, context, **sizes, pairs="all")
    assert np.isinf(np.asarray(every.left_out)).all()


def test_ties():
    """A clip that comes again exactly, and one that stands still."""
    one = swaying(4, 30)
    q = np.concatenate([one.rotations] * 4)
    again = one.with_transforms(np.concatenate([one.translations] * 4), q)
    same(*(nearest_words(again, joints=None, pairs=pairs) for pairs in ("bounded", "all")))
    found = nearest_words(again, joints=None, k=2)
    assert (np.abs(np.asarray(found.distance)) < 1e-12).all()
    still = one.with_transforms(rotations=np.repeat(one.rotations[:1], 30, axis=0))
    clips = [still, still, still]
    same(*(nearest_words(again, clips, joints=None, pairs=p) for p in ("bounded", "all")))
    # Of a plateau that begins with the clip only its first frame counts.
    found = nearest_words(again, still, joints=None, k=3, own=False)
    assert (found.clip[:, 0] == 1).all()
    assert (found.frame[:, 0] == 0).all()
    assert (found.clip[:, 1:] == -1).all()


def test_the_own_clip():
    motion = repeating(5, 120)
    found = nearest_words(motion, joints=None, k=3)
    apart = np.abs(np.asarray(found.frame) + 10 - (np.asarray(found.starts)[:, None] + 7.5))
    assert (apart[np.asarray(found.clip) == 0] >= 7.5).all()
    # A copy is its nearest word, at the same frame.
    copy = nearest_words(motion, motion, joints=None, k=1, own=False)
    inside = np.asarray(copy.starts) <= 100
    np.testing.assert_array_equal(copy.frame[inside, 0], copy.starts[inside])
    assert (copy.clip == 1).all()


def test_warps():
    """Forwards, within the target, from its first frame; the frames that lie least apart."""
    motion, other = repeating(6, 90), repeating(6, 80)
    found = nearest_words(motion, other, joints=None, k=4)
    warp, frame = np.asarray(found.warp), np.asarray(found.frame)
    there = np.asarray(found.clip) >= 0
    assert (np.diff(warp, axis=-1) >= 0)[there].all()
    assert (warp[..., 0] <= frame + 3)[there].all()
    assert (warp[..., -1] >= frame + 8)[there].all()
    assert (warp[..., -1] <= frame + 19)[there].all()
    copy = nearest_words(motion, motion, joints=None, k=1, own=False)
    inside = np.asarray(copy.starts) <= 60
    steps = np.asarray(copy.starts)[:, None] + np.arange(15)
    np.testing.assert_array_equal(copy.warp[inside, 0], steps[inside])


def test_fewer_than_k():
    motion = swaying(7, 40)
    found = nearest_words(motion, joints=None, k=30)
    there = np.asarray(found.clip) >= 0
    assert 0 < there.sum() < there.size
    assert np.isinf(np.asarray(found.distance)[~there]).all()
    assert (np.asarray(found.frame)[~there] == -1).all()
    assert (np.asarray(found.warp)[~there] == -1).all()
    # What is there comes first, the nearest before the others.
    assert (np.diff(there.astype(int), axis=1) <= 0).all()
    finite = np.where(there, found.distance, 1e9)
    assert (np.diff(finite, axis=1) >= 0).all()
    same(found, nearest_words(motion, joints=None, k=30, pairs="all"))


@pytest.mark.parametrize("frames", [1, 14, 15, 19, 20])
def test_short_clips(frames):
    """No words, or no targets: nothing is found, and nothing fails."""
    short, long = swaying(8, 60)[:frames], swaying(9, 60)
    words = max(frames - 14, 0)
    found = nearest_words(short, long, joints=None)
    assert found.clip.shape == (min(words, 2), 8)
    assert (found.clip != 0).all()
    alone = nearest_words(short, joints=None)
    assert (alone.clip == -1).all()
    inside = nearest_words(long, short, joints=None, own=False, k=1)
    assert (np.asarray(inside.clip) == (1 if frames >= 20 else -1)).all()


def test_place_yaw_and_signs_do_not_matter():
    motion, other = repeating(10, 80), repeating(10, 70)
    q = np.array(other.rotations)
    q[::3] *= -1
    there = np.array(other.translations) + np.array([3.0, 0, -1])
    moved = other.with_transforms(there, q)
    one, two = (nearest_words(motion, clip, joints=None) for clip in (other, moved))
    np.testing.assert_array_equal(one.frame, two.frame)
    np.testing.assert_allclose(one.distance, two.distance, atol=1e-9)


def test_blocks_and_progress(monkeypatch):
    """Words go in blocks; all of them are told of, in order."""
    motion, told = repeating(11, 120), []
    whole = nearest_words(motion, joints=None)
    monkeypatch.setattr(search, "_WORDS", 4)
    same(whole, nearest_words(motion, joints=None, progress=lambda *x: told.append(x)))
    assert told == [(4, 22), (8, 22), (12, 22), (16, 22), (20, 22), (22, 22)]
    few = nearest_words(motion, joints=None, stride=3)
    np.testing.assert_array_equal(few.frame[::5][:7], whole.frame[::3][:7])


def test_groups():
    walk = jm.samples.load("walk", fps=24.0, num_frames=96).motion
    found = {name: nearest_words(walk, joints=name, k=2) for name in ("whole", "lower")}
    assert len(found["lower"].joints) < len(found["whole"].joints)
    steps = np.asarray(found["lower"].frame[:, 0]) - np.asarray(found["lower"].starts)
    # A walk comes again after a stride, some 25 frames.
    assert (np.abs(np.abs(steps) % 25) <= 3).mean() > 0.7 or np.ptp(np.abs(steps)) < 80


def test_real_clips(data_dir):
    paths = sorted(data_dir.glob("bandai/walk_*_001.bvh"))[:4]
    clips = [jm.resample(jm.load(path), fps=24.0, method="slerp") for path in paths]
    found, every = (nearest_words(clips[0], clips[1:], pairs=p) for p in ("bounded", "all"))
    same(found, every)
    assert found.warped < 0.6


def test_what_is_wrong_is_said():
    motion = swaying(12)
    with no_shape_checks():
        for wrong in ({"k": 0}, {"target": 10}, {"length": 1}, {"stride": 0}, {"trim": 5}):
            with pytest.raises(ValueError, match=next(iter(wrong))):
                nearest_words(motion, joints=None, **wrong)
        with pytest.raises(ValueError, match="pairs"):
            nearest_words(motion, joints=None, pairs="some")
    with pytest.raises(ValueError, match="other joints"):
        nearest_words(motion, swaying(1, names=("a", "b", "c", "d", "e")), joints=None)
    with pytest.raises(ValueError, match=r"context\[1\] has 60 frames a second, the motion 30"):
        nearest_words(motion, [motion, motion.replace(frame_time=1 / 60)], joints=None)
    with pytest.raises(ValueError, match="traced"):
        jax.jit(lambda m: nearest_words(m, joints=None).distance)(motion)
    broken = motion.with_transforms(
        rotations=np.where(np.arange(40)[:, None, None] == 3, np.nan, 1) * motion.rotations
    )
    with pytest.raises(ValueError, match="finite"):
        nearest_words(broken, joints=None)


def test_what_interrupts_ends_the_search(monkeypatch):
    """Blocks that wait are not begun."""
    begun = []
    monkeypatch.setattr(search, "_WORDS", 4)
    monkeypatch.setattr(search, "_cores", lambda: 1)
    of_block = search._of_block
    monkeypatch.setattr(search, "_of_block", lambda *x: begun.append(1) or of_block(*x))

    def stop(done, every):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        nearest_words(repeating(13, 200), joints=None, progress=stop)
    assert len(begun) < 5


def test_the_middle_of_several_frames():
    """A pose that is held for three frames stands beside the word's one: the second of them."""
    motion = swaying(14, 60)
    at = np.concatenate([np.arange(40), [40, 40], np.arange(40, 60)])
    held = motion.with_transforms(motion.translations[at], motion.rotations[at])
    found = nearest_words(motion, held, joints=None, k=1, own=False, trim=0, stride=33)
    np.testing.assert_allclose(found.distance[1], 0, atol=1e-12)
    wanted = [*range(33, 40), 41, *range(43, 50)]
    np.testing.assert_array_equal(found.warp[1, 0], wanted)


def test_what_comes_again_soon():
    """Every 11 frames, less than a word: its own clip is searched right up to the word."""
    base = swaying(15, 11, size=0.6)
    again = base.with_transforms(
        *(np.concatenate([x] * 12) for x in (base.translations, base.rotations))
    )
    found = nearest_words(again, joints=None, k=12)
    apart = np.abs(np.asarray(found.frame) - np.asarray(found.starts)[:, None])
    inside = (np.asarray(found.starts) >= 11) & (np.asarray(found.starts) <= 90)
    np.testing.assert_array_equal(np.sort(apart, axis=1)[inside, 0], 11)
    # Of noise the frames beside the word are as likely minima as others.
    rng = np.random.default_rng(0)
    for size, k in ((0.3, 3), (1.0, 4), (1.0, 6), (1.0, 8), (1.0, 10), (1.0, 12)):
        turn = jm.quaternion.exp(size * rng.standard_normal((132, 5, 3)))
        rough = again.with_transforms(rotations=jm.quaternion.multiply(again.rotations, turn))
        same(*(nearest_words(rough, joints=None, k=k, pairs=p) for p in ("bounded", "all")))


def test_points_in_plain_numpy():
    """As Chai and Hodgins compare frames: positions and velocities from the body's place."""
    motion, other = repeating(7, 40), repeating(8, 30)
    found = nearest_words(
        motion, other, metric="points", joints=None, own=False, k=1, length=5, target=8
    )
    seen = []
    for clip in (motion, other):
        world = np.asarray(jm.forward_kinematics(clip).positions)
        body = world[:, 0] * np.array([1, 0, 1])
        stands = upright(motion)
        yaw = np.asarray(posture(clip, stands)[1])
        moved = np.diff(world, axis=0, prepend=2 * world[:1] - world[1:2]) * float(clip.fps) * 0.1
        back = Rotation.from_quat(np.roll(yaw, -1, axis=-1)).inv()
        parts = [
            np.stack([back.apply(x[:, j]) for j in range(world.shape[1])], axis=1)
            for x in (world - body[:, None], moved)
        ]
        seen.append(np.concatenate(parts, axis=-1))
    d = np.sum((seen[0][:, None] - seen[1]) ** 2, axis=(-1, -2))
    for row, start in enumerate(np.asarray(found.starts)):
        at = [word_distance(d[start : start + 5, t : t + 8], 5) for t in range(23)]
        assert float(found.distance[row, 0]) == pytest.approx(min(at), rel=1e-8)
        assert int(found.frame[row, 0]) == int(np.argmin(at))
    same(*(nearest_words(motion, other, metric="points", pairs=p) for p in ("bounded", "all")))
    with no_shape_checks(), pytest.raises(ValueError, match="metric"):
        nearest_words(motion, metric="euler")

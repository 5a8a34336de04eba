"""The cleaning room's measures in plain loops, NumPy and SciPy."""

from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from jaxmotion.cleaning import joint_groups, nearest_words
from jaxmotion.cleaning.words import texture
from tests.style.clips import rotations

LAGS = (-8, -4, 0, 4, 8)


def mean_of(q):
    """The first eigenvector of Σ q qᵀ."""
    return np.linalg.eigh(q.T @ q)[1][:, -1]


def leaps_by_hand(q):
    """Step by step and joint by joint."""
    found = np.zeros((len(q) - 1, q.shape[1], 3))
    for j in range(q.shape[1]):
        one = rotations(q[:, j])
        step = [one[t].inv() * one[t + 1] for t in range(len(q) - 1)]
        for t in range(1, len(step) - 1):
            halfway = Rotation.from_rotvec((step[t - 1].inv() * step[t + 1]).as_rotvec() / 2)
            likely = step[t - 1], step[t + 1], step[t - 1] * halfway
            away = [x.inv() * step[t] for x in likely]
            found[t, j] = min(away, key=lambda x: x.magnitude()).as_rotvec()
    return found


def jumps_by_hand(q):
    return np.linalg.norm(leaps_by_hand(q), axis=-1)


def paired_by_hand(q, leap, apart):
    """Two leaps with frames between them, the second of which turns back, each best undone by the
    other."""
    found = np.zeros(q.shape[:2])
    jump = np.linalg.norm(leap, axis=-1)
    for j in range(q.shape[1]):
        after = rotations(q[1:, j])
        left = {}
        for a, b in combinations(range(len(leap)), 2):
            u, v = leap[a, j], leap[b, j]
            on = min(u @ v, after[a].apply(u) @ after[b].apply(v))
            if -on > np.sqrt(0.5) * jump[a, j] * jump[b, j] and b - a <= apart:
                left[a, b] = left[b, a] = u @ u + 2 * on + v @ v
        best = {}
        for a in {a for a, _ in left}:
            for b in sorted((b for c, b in left if c == a), key=lambda b: (abs(b - a), b)):
                clear = 0.01 * jump[a, j] * jump[b, j]
                if a not in best or left[a, b] + clear < left[a, best[a]]:
                    best[a] = b
        for a, b in best.items():
            if best[b] == a and a < b:
                both = min(jump[a, j], jump[b, j])
                found[a + 1 : b + 1, j] = np.maximum(found[a + 1 : b + 1, j], both)
    return found


def pairs_of(motion):
    """The pairs of a clip's own jumps."""
    q = np.asarray(motion.rotations)
    return paired_by_hand(q, leaps_by_hand(q), round(1.3 * float(motion.fps)))


def places_by_hand(found, frames):
    """Of every frame the places that words over it have beside it, (clip, frame)."""
    shown = [[] for _ in range(frames)]
    starts, clip, warp = (np.asarray(x) for x in (found.starts, found.clip, found.warp))
    for word, start in enumerate(starts):
        for one, way in zip(clip[word], warp[word], strict=True):
            for i, frame in enumerate(way):
                if one >= 0:
                    shown[start + i].append((int(one), int(frame)))
    return [sorted(x) for x in shown]


def kept_poses(places, textures, left_out, j):
    """A joint's poses f[S, 4] at places of a frame; what is ``left_out`` of the own clip if there
    is no other."""
    kept = [(c, f) for c, f in places if not (c == 0 and left_out[f, j])]
    return np.array([textures[c][f, j] for c, f in kept or places]).reshape(-1, 4)


def digression_by_hand(motion, context, k, left_out=None):
    """r f[T, J, 3] and T̄ f[T, J, 4], of the group in which r is least; of joints that all tell."""
    every = [motion, *context]
    shape = motion.rotations.shape[:2]
    left_out = np.zeros(shape, bool) if left_out is None else left_out
    textures = [np.asarray(texture(clip, tuple(range(shape[1])))) for clip in every]
    best, texture_of = np.full((*shape, 3), np.inf), np.array(textures[0])
    for members in joint_groups(every).values():
        places = places_by_hand(nearest_words(motion, context, k=k, joints=members), shape[0])
        there = [t for t, x in enumerate(places) if x]
        for j in members:
            mean = {t: mean_of(kept_poses(places[t], textures, left_out, j)) for t in there}
            away = {
                t: (rotations(mean[t]).inv() * rotations(textures[0][t, j])).as_rotvec()[0]
                for t in there
            }
            middle = np.median([*away.values()], axis=0)
            for t in there:
                if np.linalg.norm(away[t] - middle) < np.linalg.norm(best[t, j]):
                    best[t, j], texture_of[t, j] = away[t] - middle, mean[t]
    return np.where(np.isinf(best), 0, best), texture_of


def vectors_by_hand(q):
    """From the chordal mean, less the medians, f[T, J, 3]."""
    x = np.zeros((*q.shape[:2], 3))
    for j in range(q.shape[1]):
        x[:, j] = (rotations(mean_of(q[:, j])).inv() * rotations(q[:, j])).as_rotvec()
    return x - np.median(x, axis=0)


def lagged(x, frames, step, without):
    """The other joints about each of those frames, held beyond the ends."""
    others = [j for j in range(x.shape[1]) if j != without]
    rows = [
        [x[min(max(t + step * lag, 0), len(x) - 1), j] for lag in LAGS for j in others]
        for t in frames
    ]
    return np.array(rows).reshape(len(frames), -1)


def foretold_by_hand(textures, step, left_out):
    """Row for row: ridge regression is least squares with rows √λ below."""
    own, *others = [vectors_by_hand(np.asarray(x, float)) for x in textures]
    frames = np.arange(0, len(own), step)
    blocks = max(1, int(np.ceil(len(frames) / 30)))
    block_of_row = [n * blocks // len(frames) for n in range(len(frames))]
    block_of_frame = np.array([block_of_row[t // step] for t in range(len(own))])
    residual = np.zeros_like(own)
    for j in range(own.shape[1]):
        every, rows = (lagged(own, x, step, j) for x in (range(len(own)), frames))
        taught = [(lagged(x, range(len(x)), 1, j), x[:, j]) for x in others]
        sound = 5.0 * ~left_out[frames, j]
        weights = sound
        for _ in range(2):
            for b in range(blocks):
                kept = np.array([x != b for x in block_of_row])
                w = np.concatenate([weights[kept], *(np.ones(len(a)) for a, _ in taught)])
                a = np.concatenate([rows[kept], *(a for a, _ in taught)])
                y = np.concatenate([own[frames, j][kept], *(y for _, y in taught)])
                ridge = 0.05 * np.sqrt(w.sum() + 1) * np.eye(a.shape[1])
                a = np.concatenate([np.sqrt(w)[:, None] * a, ridge])
                y = np.concatenate([np.sqrt(w)[:, None] * y, np.zeros((len(ridge), 3))])
                told = np.linalg.lstsq(a, y, rcond=None)[0]
                here = block_of_frame == b
                residual[here, j] = own[here, j] - every[here] @ told
            weights = sound / (1 + np.sum(residual[frames, j] ** 2, axis=-1) / 0.15**2)
    return residual


def digressing_by_hand(motion, context, k, usual, left_out):
    """√(M/s · M′/s′) f[T, J] and M: ``usual`` f[2, J], what half of the context stays below."""
    shape = motion.rotations.shape[:2]
    joints = tuple(range(shape[1]))
    textures = [np.asarray(texture(clip, joints)) for clip in (motion, *context)]
    residual, _ = digression_by_hand(motion, context, k, left_out)
    parts = []
    for x, level in zip((residual, foretold_by_hand(textures, 1, left_out)), usual, strict=True):
        size = np.linalg.norm(x, axis=-1)
        for j in joints:
            size[:, j] /= np.sqrt(0.2**2 + level[j] ** 2 + (2 * np.median(size[:, j])) ** 2)
        parts.append(size)
    return np.sqrt(parts[0] * parts[1]), np.linalg.norm(residual, axis=-1)


def spread_by_hand(strong, weak):
    """Strong frames, and weak ones on end with them."""
    found = strong.copy()
    for j in range(found.shape[1]):
        changed = True
        while changed:
            beside = np.zeros(len(found), bool)
            beside[1:] |= found[:-1, j]
            beside[:-1] |= found[1:, j]
            new = found[:, j] | (beside & weak[:, j])
            changed, found[:, j] = (new != found[:, j]).any(), new
    return found


class ShownByHand:
    """What neighbours show of a joint in a frame: all poses f[S, 4], of every group that holds it,
    but what is ``left_out`` of the clip."""

    def __init__(self, motion, context, k, left_out):
        every = [motion, *context]
        joints = tuple(range(motion.num_joints))
        self.textures = [np.asarray(texture(clip, joints)) for clip in every]
        self.left_out = left_out
        self.places = [
            (members, places_by_hand(nearest_words(motion, context, k=k, joints=members), frames))
            for frames in [motion.num_frames]
            for members in joint_groups(every).values()
        ]

    def __call__(self, t, j):
        return np.concatenate(
            [
                kept_poses(places[t], self.textures, self.left_out, j)
                for members, places in self.places
                if j in members
            ]
        )


def median_by_hand(q):
    """Of each component, on the first one's hemisphere."""
    q = np.where(q @ q[:1].T < 0, -q, q)
    middle = np.median(q, axis=0)
    return middle / np.linalg.norm(middle)


def medoid_by_hand(q):
    """The one with the least angles to the others together."""
    return q[np.arccos(np.minimum(np.abs(q @ q.T), 1)).sum(axis=1).argmin()]

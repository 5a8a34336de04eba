"""Clips brought to one skeleton: joints found by name, put in its order, others left out.

A joint that is left out hands its transform on to what hangs from it, so that the joints that are
kept stand in the world where they stood: below a dropped d, q_j becomes q_d ⊗ q_j and t_j becomes
t_d + q_d t_j q_d⁻¹. On the host, in NumPy, in the clip's dtype. O(T·J).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxmotion._plain import quoted
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton


class Matched(NamedTuple):
    """A clip's arrays in the order of a corpus's joints."""

    translations: np.ndarray
    rotations: np.ndarray
    offsets: np.ndarray
    ends: np.ndarray
    translated: tuple[int, ...]


def reduced(skeleton: Skeleton, patterns: Sequence[str]) -> Skeleton:
    """The skeleton of the joints that match, each hung from the nearest that is kept.

    **Raises:** ``ValueError`` for a pattern that none matches, and joints of several trees.
    """
    kept = skeleton.matching(*patterns)
    above = [_kept_above(j, skeleton.parents, set(kept)) for j in kept]
    tops = [skeleton.names[j] for j, (p, _) in zip(kept, above, strict=True) if p < 0]
    if len(tops) > 1:
        raise ValueError(
            f"Corpus: joints={list(patterns)} are several trees, from "
            f"{', '.join(map(quoted, tops[:4]))}; name a joint that all of them hang from too"
        )
    place = {j: k for k, j in enumerate(kept)}
    offsets = np.asarray(skeleton.offsets)
    whole = [
        offsets[[j, *dropped]].sum(axis=0) for j, (_, dropped) in zip(kept, above, strict=True)
    ]
    ends = [e for e, j in enumerate(skeleton.end_joints) if j in place]
    return Skeleton(
        [skeleton.names[j] for j in kept],
        [place.get(p, -1) for p, _ in above],
        np.stack(whole).astype(offsets.dtype),
        end_joints=[place[skeleton.end_joints[e]] for e in ends],
        end_offsets=np.asarray(skeleton.end_offsets)[ends],
        end_labels=[skeleton.end_labels[e] for e in ends],
        channels=[skeleton.channels[j] for j in kept],
        up=skeleton.up,
        length_unit=skeleton.length_unit,
        encoding=skeleton.encoding,
        conventions=skeleton.conventions,
    )


def matched(motion: Motion, skeleton: Skeleton, may_drop: frozenset[str] | None) -> Matched:
    """The arrays of a clip for a corpus's skeleton.

    **Arguments:** ``motion``: one clip; ``skeleton``: the corpus's; ``may_drop``: joints that may
    be left out, None for any.
    **Raises:** ``ValueError`` for a joint that the clip lacks, one that it may not have, joints
    that hang from others, and another up axis or unit of length.
    """
    own = motion.skeleton
    if own.names != skeleton.names:  # before what else may differ: it tells most
        _same_joints(own.names, skeleton.names, may_drop)
    for what, hint in (("up", "jaxmotion.reorient turns it"), ("length_unit", "scale it first")):
        if getattr(own, what) != getattr(skeleton, what):
            raise ValueError(
                f"{what} is {getattr(own, what)}, the corpus's {getattr(skeleton, what)}; {hint}"
            )
    t, q = np.asarray(motion.translations), np.asarray(motion.rotations)
    offsets, ends = np.asarray(own.offsets), np.asarray(own.end_offsets)
    if own.names == skeleton.names and own.parents == skeleton.parents:
        return Matched(t, q, offsets, _ends(own, ends, skeleton), motion.translated_joints)
    places = {name: j for j, name in enumerate(own.names)}
    kept = [places[name] for name in skeleton.names]
    new_t, new_q, rest = t[:, kept], q[:, kept], offsets[kept]
    translated = {k for k, j in enumerate(kept) if j in motion.translated_joints}
    for k, j in enumerate(kept):
        parent, dropped = _kept_above(j, own.parents, set(kept))
        wanted = skeleton.parents[k]
        if (parent < 0) != (wanted < 0) or (
            parent >= 0 and own.names[parent] != skeleton.names[wanted]
        ):
            found = quoted(own.names[parent]) if parent >= 0 else "none"
            expected = quoted(skeleton.names[wanted]) if wanted >= 0 else "none"
            raise ValueError(
                f"{quoted(skeleton.names[k])} hangs from {found}, in the corpus from {expected}"
            )
        for d in dropped:
            new_t[:, k] = t[:, d] + rotated(q[:, d], new_t[:, k])
            new_q[:, k] = multiplied(q[:, d], new_q[:, k])
            rest[k] += offsets[d]
        if dropped and not (new_t[:, k] == new_t[:1, k]).all():
            translated.add(k)
    return Matched(new_t, new_q, rest, _ends(own, ends, skeleton), tuple(sorted(translated)))


def in_numpy(skeleton: Skeleton, dtype) -> Skeleton:
    """The skeleton with NumPy's arrays of a dtype."""
    offsets, ends = (np.asarray(x, dtype) for x in (skeleton.offsets, skeleton.end_offsets))
    new = object.__new__(Skeleton)
    vars(new).update(vars(skeleton) | {"offsets": offsets, "end_offsets": ends})
    return new


def multiplied(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton's product, f[..., 4]."""
    w, x, y, z = np.moveaxis(a, -1, 0)
    W, X, Y, Z = np.moveaxis(b, -1, 0)
    parts = (
        w * W - x * X - y * Y - z * Z,
        w * X + x * W + y * Z - z * Y,
        w * Y - x * Z + y * W + z * X,
        w * Z + x * Y - y * X + z * W,
    )
    return np.stack(parts, axis=-1)


def rotated(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """q v q⁻¹ for unit quaternions f[..., 4] and vectors f[..., 3]."""
    turn = 2 * np.cross(q[..., 1:], v)
    return v + q[..., :1] * turn + np.cross(q[..., 1:], turn)


def _kept_above(joint: int, parents: Sequence[int], kept: set[int]) -> tuple[int, list[int]]:
    """The nearest joint above that is kept, −1 for none, and those between, the nearest first."""
    between = []
    above = parents[joint]
    while above >= 0 and above not in kept:
        between.append(above)
        above = parents[above]
    return above, between


def _same_joints(
    own: Sequence[str], wanted: Sequence[str], may_drop: frozenset[str] | None
) -> None:
    if missing := [name for name in wanted if name not in own]:
        raise ValueError(
            f"no joint is called {quoted(missing[0])}"
            + (f", nor {len(missing) - 1} more of the corpus's" if missing[1:] else "")
            + f" (its joints: {', '.join(map(quoted, own[:12]))})"
        )
    extra = [name for name in own if name not in wanted]
    if may_drop is not None and (extra := [name for name in extra if name not in may_drop]):
        listed = ", ".join(map(quoted, extra[:6])) + (", …" if extra[6:] else "")
        raise ValueError(
            f"joints that the corpus's skeleton lacks: {listed}; extra_joints='drop' drops them"
        )


def _ends(own: Skeleton, ends: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """End sites for those of the corpus, by joint; the corpus's own where the clip has none."""
    if own.names == skeleton.names and own.end_joints == skeleton.end_joints:
        return ends
    of_joint: dict[str, list[int]] = {}
    for e, j in enumerate(own.end_joints):
        of_joint.setdefault(own.names[j], []).append(e)
    found = np.array(skeleton.end_offsets, ends.dtype)
    for e, j in enumerate(skeleton.end_joints):
        if waiting := of_joint.get(skeleton.names[j]):
            found[e] = ends[waiting.pop(0)]
    return found

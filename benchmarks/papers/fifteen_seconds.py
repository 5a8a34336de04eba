"""Real captures as clips of 15 s, 24 frames a second: the sizes that Aristidou et al. 2018 print.

No capture of walking here is as long. So all walks, runs and dashes of a style of Bandai Namco's
are put end to end and cut at 360 frames; what is left over is a shorter clip, for contexts only.
From one take to the next joints go over half a second, as do heights. The body's yaw and its place
on the ground are taken away: cleaning does not look at them. Frames between two takes are no
capture: words that hold one are left out of every count. ``dance-short`` is longer than a minute,
and is cut as it is.

24 frames a second come from 30 by going the short way between the frames beside.
"""

from typing import NamedTuple

import numpy as np
import remade

import jaxmotion as jm
from jaxmotion.cleaning.body import as_lean
from jaxmotion.cleaning.turns import between
from jaxmotion.cleaning.words import word_starts

FPS, FRAMES, LEAST, SEAM = 24, 360, 48, 12
WORD, STRIDE = 15, 5
TAKES = "walk", "walk-left", "walk-right", "run", "dash"


class Clip(NamedTuple):
    """``motion``: 360 frames or fewer, float32; ``made``: frames between two takes; ``name``."""

    motion: jm.Motion
    made: np.ndarray
    name: str

    @property
    def whole(self) -> bool:
        """Whether it is of 15 s."""
        return len(self.made) == FRAMES

    @property
    def counted(self) -> np.ndarray:
        """Which of its words count."""
        frames = word_starts(FRAMES, WORD, STRIDE)[:, None] + np.arange(WORD)
        return ~self.made[frames].any(axis=1)


def locomotion(styles: tuple[str, ...] | None = None) -> list[Clip]:
    """All clips of the styles, by default of twelve: 17 of 15 s, and what is left over."""
    takes: dict[str, list[str]] = {}
    for action in TAKES:
        for path in remade.captures(f"bandai/{action}_*.bvh"):
            takes.setdefault(path.stem.split("_")[1], []).append(f"bandai/{path.name}")
    chosen = sorted(takes) if styles is None else styles
    return [clip for style in chosen for clip in _cut(style, *_end_to_end(takes[style]))]


def dance() -> list[Clip]:
    """The four clips of ``dance-short``."""
    return _cut("dance", *_end_to_end(["bandai/dance-short_normal_001.bvh"]))


def alike(clips: list[Clip], i: int, many: int = 8) -> list[int]:
    """The others of 15 s that are most like clip i."""
    others = [k for k, clip in enumerate(clips) if k != i and clip.whole]
    motions = [clips[k].motion for k in others]
    return [others[k] for k in jm.cleaning.most_alike(clips[i].motion, motions, many)]


def _at_rate(name: str) -> tuple[jm.Motion, np.ndarray, np.ndarray]:
    """A take, its rotations without yaw and its translations, at 24 frames a second."""
    take = remade.capture(name)
    lean, place = as_lean(take), np.array(take.translations)
    place[:, take.body_joint, [0, 2]] = 0
    at = np.arange(0, take.num_frames - 1, float(take.fps) / FPS)
    before, way = at.astype(int), at % 1
    ways = np.broadcast_to(way[:, None], (len(at), take.num_joints))
    part = way[:, None, None]
    moved = (1 - part) * place[before] + part * place[before + 1]
    return take, between(lean[before], lean[before + 1], ways), moved


def _end_to_end(names: list[str]) -> tuple[jm.Motion, np.ndarray]:
    """The takes in one clip, and which of its frames are between two of them."""
    first, turns, places = _at_rate(names[0])
    made = np.zeros(len(turns), bool)
    way = (0.5 - 0.5 * np.cos(np.pi * (np.arange(SEAM) + 0.5) / SEAM))[:, None]
    for name in names[1:]:
        _, q, p = _at_rate(name)
        ways = np.broadcast_to(way, (SEAM, q.shape[1]))
        seam = between(turns[-SEAM:], q[:SEAM], ways)
        level = (1 - way[..., None]) * places[-SEAM:] + way[..., None] * p[:SEAM]
        turns = np.concatenate([turns[:-SEAM], seam, q[SEAM:]])
        places = np.concatenate([places[:-SEAM], level, p[SEAM:]])
        made = np.concatenate([made[:-SEAM], np.ones(SEAM, bool), np.zeros(len(q) - SEAM, bool)])
    joined = first.with_transforms(places, turns).replace(frame_time=np.float64(1 / FPS))
    return joined.astype("float32"), made


def _cut(name: str, motion: jm.Motion, made: np.ndarray) -> list[Clip]:
    starts = range(0, motion.num_frames - LEAST + 1, FRAMES)
    parts = [slice(start, start + FRAMES) for start in starts]
    return [Clip(motion[part], made[part], f"{name} {k}") for k, part in enumerate(parts, 1)]

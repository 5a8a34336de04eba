"""Figure 9 of Eom et al. 2019: a time warp by itself, slower where displacements are large.

    python benchmarks/papers/eom_figure_9.py [--json FILE] [--picture FILE]

The paper lengthens a kick from 230 to 286 frames, a diving catch from 211 to 261 and a jump from 79
to 139, and has them slower where displacements are large; it prints no rule. Here ``time_warp``
lengthens real captures of those lengths at 24 fps by the frames that are printed: a kick, a piece
of CMU 01_01 and a jump. The rule hands frames out by the angles that joints turn by; what judges it
are the speeds of joints in space, by forward kinematics, which it does not use.

Of the frames added, the share that falls into the quarter of the frames in which joints are
fastest, a quarter if all were slowed alike, and into the slowest quarter; and the top speed of the
joints' mean after the warp, over that before, which an even stretch would divide by the lengths.

Verdict, fixed beforehand: "reproduced" if in all three the fastest quarter gets three eighths or
more, the slowest an eighth or less, and the top speed falls below that of an even stretch;
"refuted" if not. Nothing is drawn at random.
"""

import numpy as np
import remade

import jaxmotion as jm
from jaxmotion.layers.time_warp import warped_frames

PAPER = "Eom et al. 2019"
FPS = 24.0
MUCH, LITTLE = 3 / 8, 1 / 8
# Row, capture at 24 fps, first frame, frames, frames of the result.
ROWS = (
    ("kick", "bandai/kick_normal_001.bvh", 30, 230, 286),
    ("diving catch", "cmu/01_01.amc", 200, 211, 261),
    ("jump", "cmu/02_04.amc", 10, 79, 139),
)


def make(seed: int) -> list[dict]:
    """A row a clip."""
    rows = [of_clip(*row) for row in ROWS]
    good = [
        row["fastest quarter"] >= MUCH
        and row["slowest quarter"] <= LITTLE
        and row["top speed, share left"] < row["by an even stretch"]
        for row in rows
    ]
    fast, slow = (
        [f"{row[f'{which} quarter']:.0%}" for row in rows] for which in ("fastest", "slowest")
    )
    item = remade.told(
        PAPER,
        "Figure 9",
        "Frames are added where displacements are large, which slows the motion down there.",
        f"The fastest quarter of the frames gets {', '.join(fast)} of those added, the slowest "
        f"{', '.join(slow)}.",
        "reproduced" if all(good) else "refuted",
        rows,
        "a kick, a piece of CMU 01_01, a jump (CMU 02_04), at 24 fps, cut to the printed lengths",
    )
    return [item]


def clip_of(file: str, first: int, frames: int) -> jm.Motion:
    return remade.capture(file, FPS)[first : first + frames]


def of_clip(name: str, file: str, first: int, frames: int, made: int) -> dict:
    """Where a clip is slowed."""
    clip = clip_of(file, first, frames)
    assert len(clip) == frames
    amount = (made - 1) / (frames - 1) - 1
    slower = jm.time_warp(clip, amount=amount, num_frames=made)
    assert len(slower) == made
    # When each frame is shown, in frames of the result, and how much longer the next step takes.
    source = np.asarray(warped_frames(clip, amount=amount, num_frames=made))
    shown = np.interp(np.arange(frames), source, np.arange(made))
    added = np.diff(shown) - 1
    speed = speeds(clip)
    order = np.argsort(speed)
    quarter = len(order) // 4
    share = added / added.sum()
    return {
        "clip": name,
        "frames": f"{frames} → {made}",
        "fastest quarter": float(share[order[-quarter:]].sum()),
        "slowest quarter": float(share[order[:quarter]].sum()),
        "top speed, share left": float(speeds(slower).max() / speed.max()),
        "by an even stretch": (frames - 1) / (made - 1),
    }


def speeds(motion: jm.Motion) -> np.ndarray:
    """Mean distance that joints move, step by step."""
    x = np.asarray(jm.forward_kinematics(motion).positions)
    return np.linalg.norm(np.diff(x, axis=0), axis=-1).mean(axis=1)


def draw(seed: int):
    """The jump."""
    _, file, first, frames, made = ROWS[-1]
    clip = clip_of(file, first, frames)
    amount = (made - 1) / (frames - 1) - 1
    return jm.viz.plot_time_warp(clip, amount=amount, num_frames=made)


if __name__ == "__main__":
    remade.main(make, draw, __doc__)

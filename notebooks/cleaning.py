"""The picture in docs/cleaning.md: a walk with errors, what was found in it and what was put right.

python notebooks/cleaning.py        writes cleaning.png beside it; needs matplotlib

Above, how far every joint is from what it does elsewhere in the same walk, what was found outlined.
Below, the left knee where a gap was filled the short way: as it was, damaged, and repaired.
"""

from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np

import jaxmotion as jm

BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#999999"


def main():
    walk = jm.samples.load("walk", fps=30.0, num_frames=180).motion
    knee = walk.skeleton.index("LeftLeg")
    gap = jm.samples.fill_gaps(walk, jax.random.key(15), runs=1, length=(20, 20), joints=[knee])
    broken = jm.samples.inject_errors(gap.motion, jax.random.key(2), runs=1).motion
    found = jm.cleaning.repair(broken)
    figure, panels = plt.subplots(
        2, 1, figsize=(9, 6.4), height_ratios=(2, 1), sharex=True, layout="constrained"
    )
    seconds = np.arange(walk.num_frames) * float(walk.frame_time)
    mesh = panels[0].pcolormesh(
        seconds, np.arange(walk.num_joints), np.asarray(found.errors.mdm).T, cmap="cividis"
    )
    panels[0].contour(
        seconds, np.arange(walk.num_joints), np.asarray(found.mask).T, [0.5], colors=ORANGE
    )
    panels[0].set_yticks(np.arange(walk.num_joints), walk.skeleton.names, fontsize=7)
    panels[0].invert_yaxis()
    figure.colorbar(mesh, ax=panels[0], label="MDM")
    for clip, look in (
        (walk, {"color": GREY, "lw": 5, "label": "as it was"}),
        (broken, {"color": ORANGE, "label": "damaged"}),
        (found.motion, {"color": BLUE, "label": "repaired"}),
    ):
        bend = np.degrees(np.asarray(jm.quaternion.log(clip.rotations[:, knee]))[:, 0])
        panels[1].plot(seconds, bend, **look)
    panels[1].set(xlabel="seconds", ylabel="left knee, degrees")
    figure.legend(
        *panels[1].get_legend_handles_labels(), frameon=False, ncols=3, loc="outside lower center"
    )
    panels[1].spines[["top", "right"]].set_visible(False)
    figure.savefig(Path(__file__).with_name("cleaning.png"), dpi=100)


if __name__ == "__main__":
    main()

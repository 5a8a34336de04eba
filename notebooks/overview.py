"""The picture in the README: a walk, its style doubled, and the layers of one joint.

python notebooks/overview.py        writes overview.png beside it; needs matplotlib
"""

from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np

import jaxmotion as jm

EVERY, APART = 9, 0.55  # frames from pose to pose, metres from figure to figure
BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#999999"


def main():
    jax.config.update("jax_enable_x64", True)
    motion = jm.samples.load("walk", num_frames=121, fps=60.0).motion
    layers = jm.decompose(motion)
    lively = jm.stylize(motion, alpha=2.0, keep_contacts=True)
    figure, (strip, curve) = plt.subplots(
        2, 1, figsize=(9, 5.2), height_ratios=(3, 2), layout="constrained"
    )
    draw_strip(strip, motion, GREY, "as captured")
    draw_strip(strip, lively, BLUE, "style doubled, contacts kept")
    strip.set_aspect("equal")
    strip.axis("off")
    strip.legend(loc="lower left", bbox_to_anchor=(0, 1), frameon=False, ncols=2)
    draw_layers(curve, motion, layers, lively)
    figure.savefig(Path(__file__).with_name("overview.png"), dpi=100)


def draw_strip(axes, motion, colour, label):
    """Poses side by side, seen from the side."""
    pose = jm.forward_kinematics(motion)
    places = np.asarray(pose.positions)
    forward = np.asarray(jm.facing_direction(motion)).mean(0)
    for i, frame in enumerate(range(0, motion.num_frames, EVERY)):
        points = places[frame] - places[frame, :1] * np.array([1, 0, 1])
        x, y = points @ forward + i * APART, points[:, 1]
        for joint, parent in enumerate(motion.skeleton.parents[1:], 1):
            bone = [parent, joint]
            axes.plot(x[bone], y[bone], color=colour, lw=2, solid_capstyle="round", label=label)
            label = None


def draw_layers(axes, motion, layers, lively):
    """How far a forearm is bent, in degrees: the capture, its base, the exaggerated motion."""
    joint = motion.skeleton.index("LeftForeArm")
    seconds = np.asarray(motion.times)
    for clip, colour, label in (
        (motion, GREY, "captured"),
        (layers.base, ORANGE, "base"),
        (lively, BLUE, "style doubled"),
    ):
        bend = np.degrees(np.linalg.norm(jm.quaternion.log(clip.rotations[:, joint]), axis=-1))
        axes.plot(seconds, bend, color=colour, label=label, lw=2)
    axes.set_xlabel("seconds")
    axes.set_ylabel("left elbow, degrees")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), frameon=False, ncols=3)
    axes.spines[["top", "right"]].set_visible(False)


if __name__ == "__main__":
    main()

"""Why denoise learns heavy tails: a toe that flicks, and the noise found in every joint.

python notebooks/sudden_moves.py FILE.bvh JOINT FRAME   a clip of yours, about a frame; else a toe
                                                        made up on the built-in walk
Writes sudden_moves.png into the working directory; needs matplotlib. The picture in the README is
remade by python docs/pictures.py sudden_moves.
"""

import sys

import jax
import matplotlib.pyplot as plt
import numpy as np

import jaxmotion as jm
from jaxmotion.viz.colours import BLUE, GREY, ORANGE

NOISE = 0.01  # radians a joint's axis
AROUND = 20  # frames on either side of the flick
FLICK = (22.0, 32.0, 52.0, 36.0, 22.0)  # degrees, the toe of a published run at 30 frames a second


def main():
    jax.config.update("jax_enable_x64", True)
    if len(sys.argv) == 4:
        path, joint, frame = sys.argv[1:]
        clip = jm.load(path, dtype=np.float64)
        figure = draw(clip, clip.skeleton.index(joint), int(frame))
    else:
        figure = draw(*made_up())
    figure.savefig("sudden_moves.png", dpi=100)


def draw(clip, joint, frame):
    noisy = jm.samples.add_noise(clip, jax.random.key(0), rotation=NOISE).motion
    figure, (clean, shaky, found) = plt.subplots(1, 3, figsize=(11, 3.6), layout="constrained")
    draw_joint(clean, clip, clip, joint, frame)
    clean.set_title("the clip as it is")
    draw_joint(shaky, clip, noisy, joint, frame)
    shaky.set_title(f"with {np.degrees(NOISE):.1f}° of noise")
    shaky.legend(frameon=False)
    draw_noise(found, noisy)
    for axes in (clean, shaky, found):
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def made_up():
    """The built-in walk at 30 frames a second; one toe is at rest, but for a flick each second."""
    clip = jm.samples.load("walk", num_frames=121, fps=30.0).motion
    joint = clip.skeleton.index("LeftToeBase")
    angle = np.full(clip.num_frames, FLICK[0])
    for first in range(15, clip.num_frames - len(FLICK), 30):
        angle[first : first + len(FLICK)] = FLICK
    bent = jm.quaternion.exp(np.radians(angle)[:, None] * np.array([1.0, 0.0, 0.0]))
    rotations = np.asarray(clip.rotations).copy()
    rotations[:, joint] = bent
    return clip.with_transforms(rotations=rotations), joint, 47


def draw_joint(axes, truth, given, joint, frame):
    """How far the joint is turned from where it rests, before and after both ways to denoise."""
    frames = np.arange(max(0, frame - AROUND), min(truth.num_frames, frame + AROUND))
    rest = truth.rotations[frames[0], joint]
    clips = [(given, GREY, "given", 5)]
    for prior, colour in (("gaussian", ORANGE), ("student", BLUE)):
        clips.append((jm.denoise(given, prior=prior), colour, prior, 1.8))
    for clip, colour, label, width in clips:
        turned = jm.quaternion.distance(rest, clip.rotations[frames, joint])
        axes.plot(frames, np.degrees(turned), color=colour, lw=width, label=label)
    axes.set_xlabel("frame")
    axes.set_ylabel(f"{truth.skeleton.names[joint]}, degrees from rest")


def draw_noise(axes, noisy):
    """The noise found in every joint, beside what was added."""
    for prior, colour, size in (("gaussian", ORANGE, 9), ("student", BLUE, 5)):
        sigma = jm.smoothing.tune(noisy, prior=prior).rotations.sigma
        axes.plot(np.degrees(2 * np.asarray(sigma)), "o", ms=size, color=colour)
    axes.axhline(np.degrees(NOISE), color=GREY, lw=1)
    axes.set_yscale("symlog", linthresh=np.degrees(NOISE))
    axes.set_ylim(bottom=-0.05)
    axes.set_title("noise found; the line: added")
    axes.set_xlabel("joint")
    axes.set_ylabel("degrees")


if __name__ == "__main__":
    main()

"""The picture in docs/style.md: knee and hip of a walk, a run, and the walk in the run's manner.

python docs/pictures.py style_phase        remakes docs/pictures/style_phase.png; needs scipy

Each curve is one joint's bend against how fast it bends. Dotted: by Euler angles, Eq. 5 of Wu et
al. 2006, each angle scaled by itself, in the usual order z, x, y: x cannot go beyond 90 degrees,
and the run's knee does.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

import jaxmotion as jm
from jaxmotion.viz.colours import BLUE, GREY, ORANGE


def draw():
    source, reference = (jm.samples.load(name).motion[:129] for name in ("walk", "run"))
    result = jm.style.transfer_style(source, reference, keep_contacts=False).motion
    curves = (
        (source, {"color": GREY, "label": "source: a walk"}),
        (reference, {"color": ORANGE, "label": "reference: a run"}),
        (result, {"color": BLUE, "label": "the walk as the run"}),
        (by_euler(source, reference), {"color": "black", "ls": ":", "label": "by Euler angles"}),
    )
    figure, panels = plt.subplots(1, 2, figsize=(9, 4.2), layout="constrained")
    for axes, joint, name in zip(panels, ("LeftLeg", "LeftUpLeg"), ("knee", "hip"), strict=True):
        for clip, look in curves:
            bend = bent(clip, joint)
            speed = np.gradient(bend, float(clip.frame_time))
            axes.plot(bend, speed, lw=2, **look)
        axes.set_xlabel(f"left {name}, degrees")
        axes.set_ylabel("degrees a second")
        axes.spines[["top", "right"]].set_visible(False)
    lines = panels[0].get_lines()
    figure.legend(handles=lines, loc="outside upper center", frameon=False, ncols=4)
    return figure


def bent(motion, joint):
    """Degrees about the body's left, the part of the joint's rotation vector along it."""
    vectors = jm.quaternion.log(motion.rotations[:, motion.skeleton.index(joint)])
    return np.degrees(np.asarray(vectors)[:, 0])


def by_euler(source, reference):
    """Eq. 5: means and deviations of unwrapped Euler angles."""
    q = np.array(source.rotations)
    for joint in range(1, q.shape[1]):
        own, other = (angles_of(clip, joint) for clip in (source, reference))
        ratio = other.std(axis=0) / np.maximum(own.std(axis=0), 1e-3)
        turned = ratio * (own - own.mean(axis=0)) + other.mean(axis=0)
        q[:, joint] = np.roll(Rotation.from_euler("ZXY", turned).as_quat(), 1, axis=-1)
    return source.with_transforms(rotations=q)


def angles_of(motion, joint):
    q = np.roll(np.asarray(motion.rotations)[:, joint], -1, axis=-1)
    return np.unwrap(Rotation.from_quat(q).as_euler("ZXY"), axis=0)

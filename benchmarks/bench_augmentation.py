"""Many variations at once against the same one by one, by the library's own functions.

No package does it. One by one: gains of the layers, a manner mixed in, time bent, feet planted;
without the checks.
"""

import jax
import jax.numpy as jnp
import numpy as np

import jaxmotion as jm

VARIATIONS = 32


def clips():
    return tuple(jm.samples.load(name).motion for name in ("walk", "run"))


def one_by_one(made, motion, layers, styles, contacts):
    """The variations whose numbers were drawn, each by itself."""
    results = []
    for alpha, shares, frames in zip(made.alpha, made.shares, made.frames, strict=True):
        varied = jm.synthesize(layers, alpha, 1.0)
        goal = jm.style.interpolate(styles, shares)
        varied = jm.style.apply_style(varied, goal, deviation="covariance", keep_contacts=False)
        seconds = np.asarray(frames) * float(motion.frame_time)
        pairs = np.stack([seconds, np.asarray(motion.times)], axis=1)[1:]
        varied = jm.time_warp(varied, pairs=pairs, num_frames=motion.num_frames)
        planted = jm.contacts.replant(varied, contacts.at_frames(frames))
        results.append(jm.contacts.cleanup_footskate(varied, planted).rotations)
    return jnp.stack(results)


def test_many(race):
    walk, run = clips()
    key, styles = jax.random.key(0), [jm.style.motion_style(clip) for clip in (walk, run)]
    contacts = jm.contacts.detect(walk)
    layers = jm.decompose(walk)

    def ours():
        made = jm.augment(walk, key, n=VARIATIONS, styles=styles[1:], keep_contacts=contacts)
        return made.motions.rotations

    made = jm.augment(walk, key, n=VARIATIONS, styles=styles[1:], keep_contacts=contacts)
    race(
        f"augment, {VARIATIONS} variations of {walk.num_frames} frames, {walk.num_joints} joints",
        ours,
        {"one by one": lambda: one_by_one(made, walk, layers, styles, contacts)},
    )


def test_first_call(race):
    """Compiled anew."""
    walk, run = clips()

    def fresh():
        jax.clear_caches()
        made = jm.augment(walk, jax.random.key(0), n=VARIATIONS, styles=[run])
        return made.motions.rotations

    race("augment, first call", fresh, {}, warm=False, rounds=2)

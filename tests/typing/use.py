"""What a user writes, for a type checker beside the installed package: nothing here is run.

``.ci/wheel`` looks at it. Mistakes that it must find stand in ``wrong``.
"""

from pathlib import Path
from typing import assert_type

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxmotion as jm
from jaxmotion import contacts, metrics, multiresolution, quaternion, smoothing, spacetime, timing


def clean(path: Path) -> None:
    motion = jm.load(path)
    assert_type(motion, jm.Motion)
    assert_type(jm.denoise(motion), jm.Motion)
    layers = jm.decompose(motion, gamma=np.pi / 3, scope="per_joint")
    assert_type(layers, jm.MotionLayers)
    assert_type(layers.base, jm.Motion)
    assert_type(jm.synthesize(layers, 1.5, residual=0.5), jm.Motion)
    warped = jm.resample(motion, fps=60)
    assert_type(warped[10:20].skeleton.names, tuple[str, ...])
    jm.save(warped, path.with_suffix(".npz"), overwrite=True)


def keep(edited: jm.Motion, original: jm.Motion) -> jm.Motion:
    found = contacts.detect(original)
    assert_type(found, contacts.Contacts)
    kept = spacetime.keep_contacts(edited, original, found)
    assert_type(kept, jm.Motion)
    assert_type(contacts.cleanup_footskate(kept, found), jm.Motion)
    return kept


def loss(stiffness: Array, motion: jm.Motion) -> Array:
    q = smoothing.geodesic(motion.rotations, stiffness, 0.1).mean
    return jnp.sum(quaternion.distance(q, motion.rotations) ** 2)


def learn(motion: jm.Motion) -> Array:
    return jax.grad(loss)(jnp.asarray(5.0), motion)


def analyse(motion: jm.Motion) -> jm.Motion:
    pyramid = multiresolution.build_pyramid(motion, levels=3)
    assert_type(pyramid, multiresolution.Pyramid)
    aligned = timing.dtw(motion.rotations, motion.rotations, metric="pose")
    assert_type(aligned.cost, Array)
    assert_type(metrics.jerk(motion), np.ndarray)
    where = jm.forward_kinematics(motion)
    assert_type(where.positions, Array)
    return multiresolution.scale_details(pyramid, [1.0, 1.5, 0.5])


def train(folder: Path) -> Array:
    corpus = jm.corpus.Corpus(folder, fps=30)
    assert_type(corpus[0], jm.Motion)
    assert_type(corpus[1:], jm.corpus.Corpus)
    train, _ = corpus.split([0.9, 0.1])
    assert_type(train, jm.corpus.Corpus)
    assert_type(corpus.statistics().limits(), spacetime.JointLimits)
    prior = smoothing.motion_prior(train)
    for batch in train.windows(64, 32, shuffle=True, seed=0):
        jax.vmap(lambda clip: jm.forward_kinematics(clip).positions)(batch)
    return jnp.asarray(prior.covariance)


def wrong(motion: jm.Motion) -> None:
    jm.denoise(motion, method="exact")  # pyright: ignore[reportArgumentType]
    jm.load(motion)  # pyright: ignore[reportArgumentType]
    jm.denoised(motion)  # pyright: ignore[reportAttributeAccessIssue]
    motion.smooth()  # pyright: ignore[reportAttributeAccessIssue]
    contacts.find(motion)  # pyright: ignore[reportAttributeAccessIssue]
    smoothing.lgs(motion, 1.0, 1.0)  # pyright: ignore[reportArgumentType]

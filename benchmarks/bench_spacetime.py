"""Full-body spacetime constraints against SciPy's L-BFGS-B on the same cost with exact gradients.

    python -m pytest benchmarks/bench_spacetime.py --benchmark-only

Wanted: 200 frames x 96 degrees of freedom, hands and feet, below 1 s and to a lower cost; 560
frames x 65 joints, both feet, below 3 s; time linear in the number of frames.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from jaxmotion import Motion, Skeleton
from jaxmotion.contacts import ContactPoints, Contacts, replant
from jaxmotion.spacetime import Weights, satisfy, solve
from jaxmotion.spacetime.gauss_newton import cost
from jaxmotion.spacetime.prior import Prior
from jaxmotion.spacetime.terms.contacts import contact_term


def body(joints: int, limbs: int):
    """A trunk with ``limbs`` limbs, and the other joints as fingers that no contact concerns."""
    trunk, each = 7, 6
    parents, ends = [*range(-1, trunk - 1)], []
    for limb in range(limbs):
        top = 0 if limb < 2 else trunk - 1
        for _ in range(each):
            parents.append(top)
            top = len(parents) - 1
        ends.append(top)
    while len(parents) < joints:
        parents.append(ends[len(parents) % limbs])
    rng = np.random.default_rng(0)
    offsets = rng.uniform(-0.1, 0.1, (joints, 3)) + np.array([0, 0.2, 0])
    offsets[trunk : trunk + 2 * each, 1] *= -1
    return Skeleton([f"joint{j}" for j in range(joints)], parents, offsets), ends


def scene(frames: int, joints: int, limbs: int):
    """Smooth turns of 0.3 rad, and ends that stay for 20 of every 40 frames in one place each time,
    up to 0.1 from where they are on average."""
    skeleton, ends = body(joints, limbs)
    rng = np.random.default_rng(1)
    t = np.arange(frames)[:, None, None] / 60
    v = 0.3 * np.sin(2 * np.pi * t * rng.uniform(0.2, 1, (1, joints, 3)) + rng.uniform(0, 6, 3))
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    q = np.concatenate([np.cos(angle / 2), np.sin(angle / 2) * v / angle], -1)
    root = np.concatenate([0.5 * t[:, 0], 0 * t[:, 0], 0 * t[:, 0]], -1)
    motion = Motion.from_root(skeleton, jnp.asarray(root), jnp.asarray(q), jnp.asarray(1 / 60))
    points = ContactPoints(skeleton, ends)
    phase = (np.arange(frames)[:, None] + 10 * np.arange(limbs)) % 40
    mask = phase < 20
    away = rng.uniform(-0.1, 0.1, (limbs, 3))
    still = replant(motion, Contacts(points, mask, np.zeros((frames, limbs, 3))))
    return motion, Contacts(points, mask, still.target + jnp.where(mask[..., None], away, 0))


def same_cost(motion, contacts, weights: Weights):
    """The cost that ``satisfy`` minimises, for the peer: (function of z, shape of z)."""
    size, bend, root, position = (
        jnp.asarray(x, motion.dtype)
        for x in (weights.size, weights.bend, weights.root, weights.position)
    )
    term = contact_term(motion, contacts, contacts.target, position, jnp.asarray(RAMP))
    prior = Prior(size, bend / motion.frame_time**4)
    problem = solve.problem_of(motion, contacts.points, [term], prior, root)
    value_and_grad = jax.jit(jax.value_and_grad(lambda z: cost(z, problem)))
    return value_and_grad, problem.unmoved.shape


RAMP = 0.0  # seconds, for both


CASES = {"200x96 hands and feet": (200, 31, 4), "560x65 feet": (560, 65, 2)}


@pytest.mark.parametrize("name", CASES)
def test_against_scipy(race, own_size, name):
    motion, contacts = scene(*CASES[name])
    weights = Weights()
    value_and_grad, shape = same_cost(motion, contacts, weights)

    def peer():
        def function(x):
            value, slope = value_and_grad(jnp.asarray(x.reshape(shape)))
            return float(value), np.asarray(slope).ravel()

        options = {"maxiter": 500, "maxfun": 1000}
        return minimize(
            function, np.zeros(shape).ravel(), jac=True, method="L-BFGS-B", options=options
        )

    def padded():
        return satisfy(motion, contacts, weights=weights, ramp=RAMP)

    operation = f"satisfy {name} (d={shape[1]}) f64"
    (_, report), others = race(
        operation, own_size(padded), {"scipy L-BFGS-B": peer, "of many lengths": padded}, rounds=3
    )
    found = others["scipy L-BFGS-B"]
    print(
        f"\n{operation}: cost {float(report.cost):.6g} in {int(report.num_steps)} steps; "
        f"scipy {found.fun:.6g} in {found.nit}"
    )
    assert bool(report.converged)
    assert float(report.cost) <= found.fun * (1 + 1e-9)


@pytest.mark.parametrize("frames", [280, 560, 1120, 2240])
def test_linear_in_frames(race, own_size, frames):
    motion, contacts = scene(frames, 65, 2)
    (_, report), _ = race(
        f"satisfy {frames}x65 feet f64",
        own_size(lambda: satisfy(motion, contacts)),
        rounds=3,
        amount=(frames / 1e3, "thousand frames"),
    )
    assert bool(report.converged)

"""Forward kinematics of 2526 frames by 65 joints, its gradient, and its compile time; a mirror.

Peers: jaxlie's SE(3) products unrolled over the joints and vmapped over the frames (what its users
write), and pymotion's numpy ``fk_quat``. The tree is a capture's: five limbs, thirteen levels.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion import Motion, Skeleton, forward_kinematics, mirror

jaxlie = pytest.importorskip("jaxlie")
pymotion_skeleton = pytest.importorskip("pymotion.ops.skeleton")

FRAMES, JOINTS = 2526, 65
# Spine of six, then head, arms with five fingers of four, and legs.
PARENTS = [-1, 0, 1, 2, 3, 4, 5, 6]
for shoulder in (4, 4):
    first = len(PARENTS)
    PARENTS += [shoulder, first, first + 1, first + 2]
    for _ in range(5):
        PARENTS += [first + 3] + [len(PARENTS) + i for i in range(3)]
PARENTS += [0, 56, 57, 58]
PARENTS += [0, 60, 61, 62, 63][: JOINTS - len(PARENTS)]
DTYPES = ["float32", "float64"]


def _inputs(dtype):
    rng = np.random.default_rng(0)
    q = rng.standard_normal((FRAMES, JOINTS, 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    offsets = rng.standard_normal((JOINTS, 3)).astype(dtype)
    roots = rng.standard_normal((FRAMES, 3)).astype(dtype)
    skeleton = Skeleton([f"joint{j}" for j in range(JOINTS)], PARENTS, offsets)
    return Motion.from_root(skeleton, roots, jnp.asarray(q, dtype), 1 / 60), roots, offsets


def _ours(motion):
    pose = forward_kinematics(motion)
    return pose.positions, pose.rotations


def _jaxlie_one_frame(rotations, translations):
    local = jaxlie.SE3.from_rotation_and_translation(jaxlie.SO3(rotations), translations)
    world = []
    for j, p in enumerate(PARENTS):
        here = jaxlie.SE3(local.wxyz_xyz[j])
        world.append(here if p < 0 else world[p] @ here)
    stacked = jnp.stack([pose.wxyz_xyz for pose in world])
    return stacked[:, 4:], stacked[:, :4]


_jaxlie = jax.vmap(_jaxlie_one_frame)


@pytest.mark.parametrize("dtype", DTYPES)
def test_forward(race, dtype):
    motion, roots, offsets = _inputs(dtype)
    ours, theirs = jax.jit(_ours), jax.jit(_jaxlie)
    q = np.asarray(motion.rotations)
    result, results = race(
        f"forward kinematics {FRAMES}x{JOINTS} {dtype}",
        lambda: ours(motion),
        {
            "jaxlie unrolled": lambda: theirs(motion.rotations, motion.translations),
            "pymotion": lambda: pymotion_skeleton.fk_quat(q, roots, offsets, PARENTS),
        },
        goals={"jaxlie unrolled": 3.0},
    )
    for positions, _ in results.values():
        np.testing.assert_allclose(result[0], positions, atol=2e-4 if dtype == "float32" else 1e-5)


@pytest.mark.parametrize("dtype", DTYPES)
def test_value_and_gradient(race, dtype):
    """Against our own forward pass (the goal: at most four of them) and jaxlie's gradient."""
    motion, _, _ = _inputs(dtype)

    def energy(positions):
        return jnp.sum(positions**2)

    def our_energy(translations, rotations):
        return energy(_ours(motion.with_transforms(translations, rotations))[0])

    given = motion.translations, motion.rotations
    ours = jax.jit(jax.value_and_grad(our_energy, (0, 1)))
    forward = jax.jit(lambda t, q: _ours(motion.with_transforms(t, q)))

    def their_energy(translations, rotations):
        # All joints but the root have one translation each, as the motion says.
        still = jnp.broadcast_to(translations[:1, 1:], (FRAMES, JOINTS - 1, 3))
        all_translations = jnp.concatenate([translations[:, :1], still], axis=1)
        return energy(_jaxlie(rotations, all_translations)[0])

    theirs = jax.jit(jax.value_and_grad(their_energy, (0, 1)))
    result, results = race(
        f"FK value and gradient {FRAMES}x{JOINTS} {dtype}",
        lambda: ours(*given),
        {
            "our forward pass": lambda: forward(*given),
            "jaxlie unrolled": lambda: theirs(*given),
        },
        goals={"our forward pass": 0.25},
    )
    np.testing.assert_allclose(result[0], results["jaxlie unrolled"][0], 1e-4)
    # By rotations they differ along a quaternion's length: jaxlie takes it to be unit.
    ours_by, theirs_by = result[1][0], results["jaxlie unrolled"][1][0]
    scale = np.abs(theirs_by).max()
    np.testing.assert_allclose(ours_by / scale, theirs_by / scale, atol=1e-4)


@pytest.mark.parametrize("what", ["forward", "value and gradient"])
def test_compile(race, what):
    motion, _, _ = _inputs("float32")
    given = motion.translations, motion.rotations

    def ours(translations, rotations):
        return _ours(motion.with_transforms(translations, rotations))

    def compiling(f):
        def run():
            def fresh(t, q):  # a new function each time, so that nothing is remembered
                positions, rotations = f(t, q)
                if what == "forward":
                    return positions, rotations
                return jnp.sum(positions**2)

            jax.clear_caches()
            whole = fresh if what == "forward" else jax.value_and_grad(fresh, (0, 1))
            jax.jit(whole).lower(*given).compile()

        return run

    race(
        f"compile FK {what} {JOINTS} joints",
        compiling(ours),
        {"jaxlie unrolled": compiling(lambda t, q: _jaxlie(q, t))},
        warm=False,
        rounds=3,
    )


@pytest.mark.parametrize("dtype", DTYPES)
def test_mirror(race, dtype):
    """Beside pymotion's "symmetry", which takes which joint is on the other side."""
    motion, side = _of_two_sides(dtype)
    q, offsets = np.asarray(motion.rotations), np.asarray(motion.skeleton.offsets)
    pairs = tuple((j, int(k)) for j, k in enumerate(side) if j < k)

    def theirs():
        roots = np.array(motion.root_positions)  # it writes into what it is given
        return pymotion_skeleton.mirror(
            q,
            roots,
            np.array(motion.skeleton.parents),
            offsets,
            joints_mapping=side,
            mode="symmetry",
        )[:2]

    def ours():
        return mirror(motion, "x", pairs=pairs)

    result, results = race(f"mirror {FRAMES}x{len(side)} {dtype}", ours, {"pymotion": theirs})
    rotations, roots = results["pymotion"]
    np.testing.assert_allclose(result.root_positions, roots, atol=1e-5)
    np.testing.assert_allclose(abs(np.sum(result.rotations * rotations, -1)), 1, atol=1e-4)


def _of_two_sides(dtype):
    """The capture's tree but for its last joint, with offsets alike on both sides; and the joint on
    the other side."""
    motion, roots, offsets = _inputs(dtype)
    arms, legs = np.arange(24), np.arange(4)
    side = np.r_[np.arange(8), 32 + arms, 8 + arms, 60 + legs, 56 + legs]
    joints = np.arange(len(side))
    offsets = offsets[joints]
    offsets[side == joints, 0] = 0
    offsets[side < joints] = offsets[side[side < joints]] * np.array([-1, 1, 1], dtype)
    names = [f"joint{j}" for j in joints]
    skeleton = Skeleton(names, PARENTS[: len(side)], offsets)
    return Motion.from_root(skeleton, roots, motion.rotations[:, joints], 1 / 60), side

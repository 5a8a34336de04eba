"""``length=`` everywhere: what lies beyond the frames that count changes none of them."""

import importlib
import inspect
import pkgutil

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.contacts import Contacts
from tests.helpers import random_quaternions

FRAMES, EXTRA = 50, 21


def _zeros(rng, shape):
    return np.zeros((*shape, 3)), np.zeros((*shape, 4))


def _turns(rng, shape):
    return rng.standard_normal((*shape, 3)), random_quaternions(rng, shape)


def _far(rng, shape):
    return 1e30 * rng.standard_normal((*shape, 3)), random_quaternions(rng, shape)


def _padded(motion, padding):
    p, q = padding(np.random.default_rng(0), (EXTRA, motion.num_joints))
    return motion.with_transforms(
        jnp.concatenate([motion.translations, p]), jnp.concatenate([motion.rotations, q])
    )


def _padded_contacts(contacts):
    """They go on beyond the length, far from where they were."""
    more = (EXTRA, contacts.num_points)
    return Contacts(
        contacts.points,
        jnp.concatenate([contacts.mask, np.ones(more, bool)]),
        jnp.concatenate([contacts.target, np.full((*more, 3), 1e3)]),
    )


def _counted(*parts):
    """Translations and rotations of the frames that count."""
    return [x[:FRAMES] for part in parts for x in (part.translations, part.rotations)]


def _feet(motion, contacts, length):
    return [jm.contacts.find_feet(motion, length=length).point]


def _found(method):
    def run(motion, contacts, length):
        found = jm.contacts.detect(motion, method=method, points=contacts.points, length=length)
        arrays = found.mask, found.kind, found.target, found.confidence
        return [x[:FRAMES] for x in arrays]

    return run


def _cleaned(function, **options):
    return lambda motion, contacts, length: _counted(
        function(motion, contacts, length=length, **options)
    )


def _edited(function, *arguments, **options):
    return lambda motion, contacts, length: _counted(
        function(motion, *arguments, length=length, **options)
    )


def _layers(motion, contacts, length):
    layers = jm.decompose(motion, length=length)
    return _counted(layers.base, layers.control, layers.residual)


def _pyramid(motion, contacts, length):
    pyramid = jm.multiresolution.build_pyramid(motion, 3, length=length)
    coarse = jm.multiresolution.level_of_detail(pyramid, 1.0)
    return _counted(coarse, pyramid.reconstruct())


def _signs(motion, contacts, length):
    return [jm.quaternion.least_energy_signs(motion.rotations, length=length)[:FRAMES]]


def _restored(answer):
    motion, report = answer
    fields = report.position_error, report.penetration, report.limit_excess
    return [
        *_counted(motion),
        *(x[:FRAMES] for x in fields),
        report.cost,
        report.cost_before,
        report.num_steps,
    ]


def _satisfied(method):
    """Everything at once: contacts with ramps, a floor, limits also of joints above no point."""

    def run(motion, contacts, length):
        joints = motion.num_joints
        limits = jm.spacetime.JointLimits(
            jnp.full((joints, 3), -0.2), jnp.full((joints, 3), 0.2), motion.rotations[0]
        )
        asked = {"joint_limits": limits, "floor": 0.01, "ramp": 0.1}
        answer = jm.spacetime.satisfy(
            motion, contacts, **asked, method=method, max_steps=8, length=length
        )
        return _restored(answer)

    return run


def _both_ways(function, results):
    """A function of two clips: the padded one as the first, and as the second."""

    def run(motion, contacts, length):
        x = motion.translations[:, :3].reshape(motion.num_frames, -1)
        y = x[5:35] + 0.01
        first, second = function(x, y, x_length=length), function(y, x, y_length=length)
        return [*results(first), *results(second)]

    return run


CASES = {
    "contacts.find_feet": _feet,
    "contacts.limb_lengths": lambda motion, contacts, length: [
        jm.contacts.limb_lengths(motion, contacts.points, length=length)
    ],
    "contacts.detect[segments]": _found("segments"),
    "contacts.detect[thresholds]": _found("thresholds"),
    "contacts.cleanup_footskate": _cleaned(jm.contacts.cleanup_footskate, floor=0.0),
    "contacts.cleanup_footskate[stretch]": _cleaned(jm.contacts.cleanup_footskate, stretch=0.02),
    "contacts.cleanup_root": _cleaned(jm.contacts.cleanup_root, floor=0.0),
    "layers.decompose": _layers,
    "layers.denoise": _edited(jm.denoise, robust=True),
    "layers.stylize": _edited(jm.stylize, 1.5),
    "multiresolution.build_pyramid": _pyramid,
    "quaternion.least_energy_signs": _signs,
    "spacetime.keep_contacts": lambda motion, contacts, length: _counted(
        jm.spacetime.keep_contacts(motion, motion, contacts, length=length)
    ),
    "spacetime.restore": lambda motion, contacts, length: _restored(
        jm.spacetime.restore(motion, contacts, length=length)
    ),
    "spacetime.satisfy": _satisfied("gauss_newton"),
    "spacetime.satisfy[bounds]": _satisfied("bounds"),
    "timing.dtw": _both_ways(jm.timing.dtw, lambda w: [w.cost, w.path[w.mask]]),
    "timing.soft_dtw": _both_ways(jm.timing.soft_dtw, lambda cost: [cost]),
    "timing.soft_alignment": _both_ways(
        jm.timing.soft_alignment, lambda e: [e[:FRAMES, :30] if len(e) >= FRAMES else e[:, :FRAMES]]
    ),
}


def test_every_function_that_takes_a_length_is_here():
    found = set()
    for room in pkgutil.iter_modules(jm.__path__, "jaxmotion."):
        module = importlib.import_module(room.name)
        for name in getattr(module, "__all__", ()):
            if inspect.isfunction(function := getattr(module, name)):
                kinds = inspect.signature(function).parameters.values()
                if any(p.name.endswith("length") and p.default is None for p in kinds):
                    found.add(f"{room.name.removeprefix('jaxmotion.')}.{name}")
    assert found == {case.split("[")[0] for case in CASES}


@pytest.fixture(scope="module")
def skating():
    walk = jm.samples.walk(FRAMES, fps=30.0).motion
    slid = jm.samples.slide_root(walk, jax.random.key(0), amount=0.2).motion
    return slid, jm.contacts.detect(walk)


# With limits and all a minute to compile, twice; the suite has keep_contacts.
LONG = dict.fromkeys(("spacetime.satisfy", "spacetime.satisfy[bounds]"), pytest.mark.sweep)


@pytest.mark.parametrize("case", [pytest.param(c, marks=LONG.get(c, ())) for c in CASES])
def test_what_lies_beyond_the_length_changes_nothing(skating, case):
    motion, contacts = skating
    with jm.buckets(False):
        want = CASES[case](motion, contacts, None)
    for padding in (_zeros, _turns, _far):
        got = CASES[case](_padded(motion, padding), _padded_contacts(contacts), FRAMES)
        for part, (a, b) in enumerate(zip(got, want, strict=True)):
            np.testing.assert_allclose(
                a, b, 1e-7, 1e-7, err_msg=f"part {part}, padded by {padding.__name__}"
            )

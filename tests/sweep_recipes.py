"""How the sweep calls every public function: a recipe makes its arguments from a ``Case``.

A recipe is written ``recipe(lambda f, c: f(c.q), rotations)``: what to call, and which leaves of
the case it is differentiated by. Keys are ``room.function``, with ``[variant]`` for a function that
has several ways. ``EXCEPTIONS`` names the functions that have no recipe, and why.
"""

import importlib
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp

from jaxmotion import io, layers, multiresolution, quaternion, smoothing, style, timing
from jaxmotion.displacement import Displacement
from jaxmotion.linalg import DifferenceChain, banded_factor, block_banded_factor, chain_factor
from tests.sweep_cases import CASES, Case, case


class Recipe(NamedTuple):
    """``run``: how to call the function; ``where``: the leaves to differentiate by; ``skips``:
    properties that do not apply, and why; ``cases``: the same for single cases ("stiff", or "stiff
    float32" for one dtype alone), with "refused" for what the message of an error says there;
    ``coarse``: how many times more than rounding two ways to the same answer may differ."""

    run: Callable[[Callable, Case], Any]
    where: Callable[[Case], tuple]
    skips: dict[str, str]
    cases: dict[str, dict[str, str]]
    coarse: float


def rotations(c):
    return (c.motion.rotations,)


def moves(c):
    return (c.motion.rotations, c.motion.translations)


def both(c):
    return (*moves(c), c.other.rotations, c.other.translations)


def two_rotations(c):
    return (c.motion.rotations, c.other.rotations)


def positions(c):
    return (c.motion.translations,)


def signals(c):
    return (c.motion.translations, c.other.translations)


def vectors(c):
    return (c.vectors,)


def smoothed_positions(c):
    return (c.motion.translations, c.lam, c.sigma)


def smoothed_rotations(c):
    return (c.motion.rotations, c.lam, c.sigma)


def smoothed_moves(c):
    return (*moves(c), c.lam, c.sigma)


def planted(c):
    return (*moves(c), c.contacts.target)


def weighted(c):
    return (c.weights, c.lam, c.sigma)


def recipe(run, where=moves, skips=None, cases=None, coarse=1.0) -> Recipe:
    return Recipe(run, where, skips or {}, cases or {}, coarse)


def untraced(run, reason, **more) -> Recipe:
    """A function that only takes concrete values."""
    return recipe(run, moves, dict.fromkeys(("jit", "vmap", "gradients"), reason), **more)


def measured(run) -> Recipe:
    """A metric of concrete clips: NumPy, in float64 whatever the clip."""
    return recipe(run, skips=dict.fromkeys(("jit", "vmap", "gradients", "dtype"), "NumPy, float64"))


def chain(c) -> DifferenceChain:
    """What ``lgs`` solves for order 2, with weights."""
    inside = jnp.ones(c.frames, c.dtype).at[0].set(0).at[-1].set(0)
    zero = jnp.zeros_like(c.weights)
    observed = c.weights / c.sigma**2
    lanes = (c.lam**2 * inside, observed, zero, zero)
    return DifferenceChain(*(n[:, None, None] for n in lanes))


def bands(c):
    """diag(w) + ρ D₁ᵀD₁ as lower bands (T, 2)."""
    rho = c.lam * c.sigma
    ones = jnp.ones(c.frames, c.dtype)
    degree = jnp.zeros(c.frames, c.dtype).at[1:].add(1).at[:-1].add(1)
    return jnp.stack([c.weights + rho * degree, -rho * ones], 1)


def blocks(c):
    """The same for three coupled components, (T, 2, 3, 3)."""
    coupling = jnp.eye(3, dtype=c.dtype) + jnp.asarray(0.1, c.dtype)
    return bands(c)[:, :, None, None] * coupling


def limb(c):
    """Root, middle, end and target of limbs that bend by about 0.5."""
    down = jnp.asarray([0.02, -0.4, 0.1], c.dtype)
    middle = c.p + down
    end = middle + down * jnp.asarray([1, 1, -1.5], c.dtype)
    return c.p, middle, end, end + 0.1 * (c.other.translations - c.p) + 0.01


def round_trip(suffix):
    def run(load, c):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"clip{suffix}"
            io.save(c.motion, path)
            return load(path, dtype=c.dtype)

    return run


def pyramid(c):
    return multiresolution.build_pyramid(c.motion)


def of_two_sides(c):
    """A frame at rest whose bones are alike on both sides: only hips lie beside the middle."""
    bones = jnp.asarray(c.other.skeleton.offsets)
    bones = jnp.where(jnp.abs(bones) == 0.1, bones, bones * jnp.array([0, 1, 1], c.dtype))
    q = jnp.zeros((1, len(bones), 4), c.dtype).at[..., 0].set(1)
    return c.other.with_transforms(bones[None], q)


def sample(f, c):
    return f(c.frames, fps=c.fps, dtype=c.dtype)


HALF_TURN = {"quotients": "the logarithm jumps at half a turn"}
AT_PI = {"pi": HALF_TURN}
TIES = {"quotients": "equal alternatives, and the discrete choice falls on another at every step"}
NO_PAIRS = {"joint1": {"refused": "left/right|Left… and Right…"}}
ILL_CONDITIONED = {
    "stiff": {"quotients": "digits are lost as the condition of P, as documented"},
    "stiff float32": dict.fromkeys(("gradients", "jit", "vmap"), "... that is 1 / eps: none left"),
}
ALL_BUT_HINGES = {
    "quotients": "joints that turn about one axis bend the root of C more than a step spans"
}
HALF_OF_THEM = dict.fromkeys(
    ("jit", "vmap"), "roots of covariances of few frames have half of float32's digits"
)
PAST_LGS = {
    "stiff float32": {"gradients": "lam sigma = 1e6 is more than lgs holds there, as documented"}
}
FAR_APART = {"far float32": {"gradients": "differences of numbers a million in size"}}
NO_DIRECTION = {
    name: {"quotients": "a joint that does not move has no direction to exceed"}
    for name in ("identity", "still", "constant")
}
ITERATED = {"quotients": "an iteration that stops at steps of 1e-5 rad is too coarse for them"}
CONSTANT = {"quotients": "what is learned or chosen passes no gradient, as documented"}
FLAT = dict.fromkeys(("jit", "vmap"), "one to three differences: most (lam, sigma) are as likely")
OUT_OF_REACH = {
    f"{name} float32": dict.fromkeys(
        ("jit", "vmap"), "of targets out of reach eps times the cost hides turns of 0.4 rad"
    )
    for name in CASES
}
MASK = multiresolution.binomial_mask(1)
STATIC = "its arguments are static"
DISCRETE = "its answer is discrete"
FILES = "reads and writes files"

RECIPES = {
    "quaternion.align_signs": recipe(lambda f, c: f(c.q), rotations),
    "quaternion.between": recipe(lambda f, c: f(c.q, c.o), two_rotations),
    "quaternion.conjugate": recipe(lambda f, c: f(c.q), rotations),
    "quaternion.distance": recipe(lambda f, c: f(c.q, c.o), two_rotations),
    "quaternion.exp": recipe(lambda f, c: f(c.vectors), vectors),
    "quaternion.exp_half": recipe(lambda f, c: f(c.vectors), vectors),
    "quaternion.from_euler": recipe(lambda f, c: f(c.vectors), vectors),
    "quaternion.from_matrix": recipe(lambda f, c: f(quaternion.to_matrix(c.q)), rotations),
    "quaternion.from_rotation_6d": recipe(
        lambda f, c: f(quaternion.to_rotation_6d(c.q)), rotations
    ),
    "quaternion.from_xyzw": recipe(lambda f, c: f(c.q), rotations),
    "quaternion.identity": recipe(lambda f, c: f((3,), c.dtype), skips={"gradients": STATIC}),
    "quaternion.inverse": recipe(lambda f, c: f(c.q), rotations),
    "quaternion.least_energy_signs": recipe(lambda f, c: f(c.q), rotations),
    "quaternion.log": recipe(lambda f, c: f(c.q), rotations, cases=AT_PI),
    "quaternion.log_half": recipe(lambda f, c: f(c.q), rotations, cases=AT_PI),
    "quaternion.mean": recipe(lambda f, c: f(c.q, c.weights), rotations),
    "quaternion.mean[chordal]": recipe(lambda f, c: f(c.q, c.weights, method="chordal"), rotations),
    "quaternion.mean[recursive]": recipe(
        lambda f, c: f(c.q, c.weights, method="recursive"), rotations
    ),
    "quaternion.multiply": recipe(lambda f, c: f(c.q, c.o), two_rotations),
    "quaternion.normalize": recipe(lambda f, c: f(c.q), rotations),
    "quaternion.power": recipe(
        lambda f, c: f(c.q, c.weights[:, None]), lambda c: (c.q, c.weights), cases=AT_PI
    ),
    "quaternion.rotate": recipe(lambda f, c: f(c.q, c.p)),
    "quaternion.slerp": recipe(lambda f, c: f(c.q, c.o, c.weights[:, None]), two_rotations),
    "quaternion.std": recipe(lambda f, c: f(c.q, weights=c.weights), rotations),
    "quaternion.to_euler": recipe(lambda f, c: f(c.q), rotations),
    "quaternion.to_euler[unwrap]": recipe(lambda f, c: f(c.q, unwrap=True), rotations),
    "quaternion.to_matrix": recipe(lambda f, c: f(c.q), rotations),
    "quaternion.to_rotation_6d": recipe(lambda f, c: f(c.q), rotations),
    "quaternion.to_xyzw": recipe(lambda f, c: f(c.q), rotations),
    "linalg.banded_factor": recipe(lambda f, c: f(bands(c)), weighted, cases=ILL_CONDITIONED),
    "linalg.banded_log_det": recipe(lambda f, c: f(bands(c)), weighted, cases=ILL_CONDITIONED),
    "linalg.banded_matvec": recipe(
        lambda f, c: f(bands(c), c.x), smoothed_positions, cases=FAR_APART
    ),
    "linalg.banded_selected_inverse": recipe(
        lambda f, c: f(banded_factor(bands(c))), weighted, cases=ILL_CONDITIONED
    ),
    "linalg.banded_solve": recipe(
        lambda f, c: f(bands(c), c.x), smoothed_positions, cases=ILL_CONDITIONED
    ),
    "linalg.block_banded_factor": recipe(
        lambda f, c: f(blocks(c)), weighted, cases=ILL_CONDITIONED
    ),
    "linalg.block_banded_log_det": recipe(
        lambda f, c: f(blocks(c)), weighted, cases=ILL_CONDITIONED
    ),
    "linalg.block_banded_matvec": recipe(
        lambda f, c: f(blocks(c), c.p[:, 0]), smoothed_positions, cases=FAR_APART
    ),
    "linalg.block_banded_selected_inverse": recipe(
        lambda f, c: f(block_banded_factor(blocks(c))), weighted, cases=ILL_CONDITIONED
    ),
    "linalg.block_banded_solve": recipe(
        lambda f, c: f(blocks(c), c.p[:, 0]), smoothed_positions, cases=ILL_CONDITIONED
    ),
    "linalg.block_banded_substitute": recipe(
        lambda f, c: f(block_banded_factor(blocks(c)), c.p[:, 0]),
        smoothed_positions,
        cases=ILL_CONDITIONED,
    ),
    "linalg.chain_bend_variance": recipe(lambda f, c: f(chain_factor(chain(c))), weighted),
    "linalg.chain_covariance": recipe(lambda f, c: f(chain_factor(chain(c))), weighted),
    "linalg.chain_factor": recipe(lambda f, c: f(chain(c)), weighted),
    "linalg.chain_log_det": recipe(lambda f, c: f(chain(c)), weighted),
    "linalg.chain_knowledge": recipe(lambda f, c: f(chain_factor(chain(c))), weighted),
    "linalg.chain_sample": recipe(lambda f, c: f(chain_factor(chain(c)), c.key, (2, 3)), weighted),
    "linalg.chain_smooth": recipe(lambda f, c: f(chain(c), c.p), smoothed_positions),
    "linalg.chain_squared_inverse": recipe(lambda f, c: f(chain_factor(chain(c))), weighted),
    "linalg.parallel_chain_factor": recipe(lambda f, c: f(chain(c)), weighted),
    "linalg.parallel_chain_knowledge": recipe(lambda f, c: f(chain(c)), weighted),
    "linalg.parallel_chain_smooth": recipe(lambda f, c: f(chain(c), c.p), smoothed_positions),
    "clips.concatenate": recipe(lambda f, c: f([c.motion, c.other]), both),
    "clips.stack": recipe(lambda f, c: f([c.motion, c.other])[0], both),
    "axes.reorient": recipe(lambda f, c: f(c.motion, "z")),
    "reflection.mirror": recipe(
        lambda f, c: f(c.motion, reference=of_two_sides(c)), cases=NO_PAIRS
    ),
    "kinematics.facing_direction": recipe(lambda f, c: f(c.motion), cases=NO_PAIRS),
    "kinematics.forward_kinematics": recipe(lambda f, c: f(c.motion)),
    "kinematics.velocities": recipe(lambda f, c: f(c.motion)),
    "displacement.minus": recipe(lambda f, c: f(c.motion, c.other), both),
    "displacement.minus[body]": recipe(lambda f, c: f(c.motion, c.other, "body"), both),
    "displacement.plus": recipe(
        lambda f, c: f(c.motion, Displacement(c.other.translations, c.vectors)),
        lambda c: (*moves(c), c.vectors),
    ),
    "displacement.plus[body]": recipe(
        lambda f, c: f(c.motion, Displacement(c.other.translations, c.vectors, "body")),
        lambda c: (*moves(c), c.vectors),
    ),
    "confine.confine": recipe(lambda f, c: f(c.motion, c.other, c.weights[:, None]), both),
    "confine.selection_weights": untraced(
        lambda f, c: f(c.motion.skeleton, c.frames, strength=0.5).astype(c.dtype), STATIC
    ),
    "io.load": untraced(round_trip(".bvh"), FILES),
    "io.load[npz]": untraced(round_trip(".npz"), FILES),
    "samples.add_noise": recipe(lambda f, c: f(c.motion, c.key, translation=0.01)),
    "samples.add_spikes": recipe(lambda f, c: f(c.motion, c.key)),
    "samples.biped": untraced(lambda f, c: f(c.dtype), STATIC),
    "samples.clean_and_noisy": untraced(
        lambda f, c: f(num_frames=c.frames, fps=c.fps, dtype=c.dtype), STATIC
    ),
    "samples.dance": untraced(sample, STATIC),
    "samples.drop_frames": recipe(lambda f, c: f(c.motion, c.key)),
    "samples.flip_signs": recipe(lambda f, c: f(c.motion, c.key)),
    "samples.fill_gaps": recipe(lambda f, c: f(c.motion, c.key, length=(1, 2))),
    "samples.drift_joints": recipe(lambda f, c: f(c.motion, c.key, length=(1, 2))),
    "samples.swap_markers": recipe(lambda f, c: f(c.motion, c.key, length=(1, 2))),
    "samples.freeze_joints": recipe(lambda f, c: f(c.motion, c.key, length=(1, 2))),
    "samples.idle": untraced(sample, STATIC),
    "samples.inject_errors": recipe(
        lambda f, c: f(c.motion, c.key, length=(1, 2)),
        cases=NO_DIRECTION,
    ),
    "samples.jump": untraced(sample, STATIC),
    "samples.kick": untraced(sample, STATIC),
    "samples.load": untraced(
        lambda f, c: f("walk", num_frames=c.frames, fps=c.fps, dtype=c.dtype), STATIC
    ),
    "samples.offset_joints": recipe(lambda f, c: f(c.motion, c.key, length=(1, 2))),
    "samples.quadruped": untraced(lambda f, c: f(c.dtype), STATIC),
    "samples.quadruped_trot": untraced(sample, STATIC),
    "samples.quadruped_walk": untraced(sample, STATIC),
    "samples.run": untraced(sample, STATIC),
    "samples.slide_root": recipe(lambda f, c: f(c.motion, c.key)),
    "samples.swap_limbs": recipe(lambda f, c: f(c.motion, c.key, length=(1, 2)), cases=NO_PAIRS),
    "samples.violate_limits": recipe(
        lambda f, c: f(c.motion, c.key, length=(1, 2)),
        cases=NO_DIRECTION,
    ),
    "samples.walk": untraced(sample, STATIC),
    "smoothing.geodesic": recipe(
        lambda f, c: f(c.q, c.lam, c.sigma).mean,
        smoothed_rotations,
        cases={
            "stiff float32": {"refused": "lam . sigma is too large for the dtype"},
            "stiff float64": {"gradients": "digits go as (lam sigma)^2 = 1e12, as documented"},
            "opposite float64": {"refused": "data lie half a turn from the smoothed motion"},
            "opposite float32": {"gradients": "the answer is no minimum, which is an error"},
        },
    ),
    "smoothing.lgs": recipe(lambda f, c: _posterior(f(c.p, c.lam, c.sigma)), smoothed_positions),
    "smoothing.lgs[parallel]": recipe(
        lambda f, c: f(c.p, c.lam, c.sigma, parallel=True).mean, smoothed_positions
    ),
    "smoothing.outlier_weights": recipe(lambda f, c: f(c.p), positions, CONSTANT),
    "smoothing.outlier_weights[motion]": recipe(lambda f, c: f(c.motion), skips=CONSTANT),
    "smoothing.smooth_motion": recipe(lambda f, c: f(c.motion, c.lam, c.sigma), smoothed_moves),
    "smoothing.smooth_quaternions": recipe(lambda f, c: f(c.q, c.lam, c.sigma), smoothed_rotations),
    "smoothing.smooth_quaternions[order 1]": recipe(
        lambda f, c: f(c.q, c.lam, c.sigma, order=1), smoothed_rotations
    ),
    "smoothing.smooth_quaternions[rotvec]": recipe(
        lambda f, c: f(c.q, c.lam, c.sigma, method="rotvec"), smoothed_rotations, cases=AT_PI
    ),
    "smoothing.student_stiffness": recipe(
        lambda f, c: f(c.p, c.lam, c.sigma, 4.0), smoothed_positions, cases=PAST_LGS
    ),
    "smoothing.student_stiffness[motion]": recipe(
        lambda f, c: f(c.motion, c.lam, c.sigma, 4.0), smoothed_rotations, cases=PAST_LGS
    ),
    "smoothing.suggest_keys": recipe(
        lambda f, c: f(smoothing.lgs(c.p, c.lam, c.sigma, weights=c.weights), 1).variance, weighted
    ),
    "smoothing.tune": recipe(lambda f, c: f(c.p), positions, CONSTANT),
    "smoothing.tune[motion]": recipe(
        lambda f, c: f(c.motion), skips=CONSTANT, cases={"T3": FLAT, "joints200 float32": FLAT}
    ),
    "smoothing.windowed_lgs": recipe(
        lambda f, c: f(c.p, c.lam, c.sigma, window=4), smoothed_positions
    ),
    "style.apply_style": recipe(
        lambda f, c: f(c.motion, style.motion_style(c.other), keep_contacts=False),
        both,
        ALL_BUT_HINGES,
    ),
    "style.interpolate": recipe(
        lambda f, c: f([style.motion_style(m) for m in (c.motion, c.other)], [0.3, 0.7]),
        both,
        ALL_BUT_HINGES,
    ),
    "style.motion_style": recipe(
        lambda f, c: f(c.motion), cases={"still": {"quotients": "deviations have a corner at 0"}}
    ),
    "style.style_distance": recipe(
        lambda f, c: f(c.motion, style.motion_style(c.other)), both, ALL_BUT_HINGES
    ),
    "style.transfer_style": recipe(
        lambda f, c: f(c.motion, c.other, keep_contacts=False).motion, both, ALL_BUT_HINGES
    ),
    "style.transfer_style[covariance]": recipe(
        lambda f, c: (
            f(c.motion, c.other, deviation="covariance", mean="karcher", keep_contacts=False).motion
        ),
        both,
        ALL_BUT_HINGES,
        {"joints200 float32": HALF_OF_THEM},
    ),
    "timing.align": recipe(lambda f, c: _alignment(f(c.motion, c.other)), both),
    "timing.bucket_size": untraced(lambda f, c: f(c.frames), STATIC),
    "timing.dtw": recipe(lambda f, c: f(c.x, c.y), signals),
    "timing.dtw[motions]": recipe(lambda f, c: f(c.motion, c.other), two_rotations),
    "timing.frame_distance": recipe(lambda f, c: f(c.x, c.y), signals),
    "timing.motion_warping": recipe(lambda f, c: f(c.x, c.y), signals, cases={"still": TIES}),
    "timing.pad_to_bucket": recipe(lambda f, c: f(c.p, c.frames + 3)[0], positions),
    "timing.pad_to_bucket[motion]": recipe(lambda f, c: f(c.motion, c.frames + 3)[0]),
    "timing.pose_distance": recipe(lambda f, c: f(c.q, c.o), two_rotations),
    "timing.resample": recipe(lambda f, c: f(c.motion, num_frames=2 * c.frames)),
    "timing.resample[slerp]": recipe(
        lambda f, c: f(c.motion, num_frames=2 * c.frames, method="slerp")
    ),
    "timing.resample[cubic]": recipe(
        lambda f, c: f(c.motion, num_frames=2 * c.frames, method="cubic")
    ),
    "timing.soft_alignment": recipe(lambda f, c: f(c.x, c.y), signals),
    "timing.soft_dtw": recipe(lambda f, c: f(c.x, c.y), signals),
    "timing.soft_dtw[motions]": recipe(lambda f, c: f(c.motion, c.other), two_rotations),
    "timing.unwarp": recipe(lambda f, c: f(*_warped(c)), positions),
    "layers.decompose": recipe(lambda f, c: f(c.motion)),
    "layers.denoise": recipe(lambda f, c: f(c.motion), skips=CONSTANT, cases={"T3": FLAT}),
    "layers.denoise[not tuned]": recipe(lambda f, c: f(c.motion, tune=False)),
    "layers.joint_weights": recipe(
        lambda f, c: f(c.motion.skeleton, {"*": 2.0}), skips={"gradients": STATIC}
    ),
    "layers.stylize": recipe(lambda f, c: f(c.motion, 1.5)),
    "layers.synthesize": recipe(lambda f, c: f(layers.decompose(c.motion), 1.3, 0.5)),
    "layers.time_warp": recipe(
        lambda f, c: f(c.motion, amount=0.25, num_frames=c.frames + c.frames // 4),
        cases={"still": {"quotients": "the time goes where the motion is, and there is none"}},
    ),
    "multiresolution.band_pass_mask": untraced(lambda f, c: f(0.1, 0.3, 2).astype(c.dtype), STATIC),
    "multiresolution.best_cut": untraced(lambda f, c: f(c.motion, c.other, 2), DISCRETE),
    "multiresolution.binomial_mask": untraced(lambda f, c: f(2).astype(c.dtype), STATIC),
    "multiresolution.blend": recipe(lambda f, c: f(c.motion, c.other, c.third), both),
    "multiresolution.build_pyramid": recipe(lambda f, c: f(c.motion)),
    "multiresolution.coarser_times": recipe(lambda f, c: f(c.times), lambda c: (c.times,)),
    "multiresolution.compress": untraced(
        lambda f, c: f(c.motion, rotation_tolerance=1e-2, translation_tolerance=1e-2),
        "codes are integers",
    ),
    "multiresolution.downsample": recipe(lambda f, c: f(c.motion)),
    "multiresolution.expand": recipe(lambda f, c: f(c.motion)),
    "multiresolution.filter_motion": recipe(lambda f, c: f(c.motion, MASK)),
    "multiresolution.follow": recipe(lambda f, c: f(c.motion, c.other), both),
    "multiresolution.level_of_detail": recipe(lambda f, c: f(pyramid(c), 0.6)),
    "multiresolution.orientation_filter": recipe(lambda f, c: f(c.q, MASK), rotations),
    "multiresolution.reduce": recipe(lambda f, c: f(c.motion)),
    "multiresolution.reduce[times]": recipe(
        lambda f, c: f(c.motion, times=c.times), lambda c: (*moves(c), c.times)
    ),
    "multiresolution.scale_details": recipe(lambda f, c: f(pyramid(c), 1.3)),
    "multiresolution.smoothing_mask": recipe(
        lambda f, c: f(1, c.sigma, times=c.times), lambda c: (c.sigma, c.times)
    ),
    "multiresolution.stitch": recipe(lambda f, c: f([c.motion, c.other], 1), both),
    "multiresolution.upsample": recipe(lambda f, c: f(c.motion)),
    "multiresolution.vector_filter": recipe(lambda f, c: f(c.p, MASK), positions),
    "augmentation.augment": recipe(
        lambda f, c: f(c.motion, c.key, n=2, keep_contacts=False).motions
    ),
    "augmentation.augment[styles]": recipe(
        lambda f, c: f(c.motion, c.key, n=2, styles=[c.other], keep_contacts=False).motions,
        both,
        ALL_BUT_HINGES,
        cases=dict.fromkeys(("pi float32", "joints200 float32"), HALF_OF_THEM),
    ),
    "cleaning.motion_words": recipe(lambda f, c: f(c.motion, length=2).rotations, rotations),
    "cleaning.soft_mask": recipe(lambda f, c: f(c.vectors[..., 0], width=0.5), vectors),
    "cleaning.soft_neighbours": recipe(
        lambda f, c: f(c.motion.translations.reshape(-1), k=1, beta=1.0), positions
    ),
    "cleaning.soft_word_distances": recipe(
        lambda f, c: f(c.motion.rotations[None], c.other.rotations[None], gamma=0.1),
        two_rotations,
    ),
    "contacts.cleanup_footskate": recipe(
        lambda f, c: f(c.motion, c.contacts),
        planted,
        cases={
            "identity": {"quotients": "straight legs: any change decides which way they bend"},
            "joint1": {"refused": "no two-bone limb"},
        },
    ),
    "contacts.cleanup_root": recipe(lambda f, c: f(c.motion, c.contacts), planted),
    "contacts.detect": recipe(
        lambda f, c: f(c.motion, points=c.contacts.points, window=3), cases={"still": TIES}
    ),
    "contacts.find_feet": untraced(lambda f, c: f(c.motion), DISCRETE),
    "contacts.fit_distances": recipe(lambda f, c: f(c.motion, c.contacts), planted),
    "contacts.intervals": untraced(lambda f, c: f(c.contacts), DISCRETE),
    "contacts.limb_ik": recipe(lambda f, c: f(*limb(c)), signals),
    "contacts.limb_lengths": recipe(lambda f, c: f(c.motion, c.contacts.points)),
    "contacts.replant": recipe(lambda f, c: f(c.motion, c.contacts)),
    "spacetime.keep_contacts": recipe(
        lambda f, c: f(c.other, c.motion, c.contacts), both, ITERATED, OUT_OF_REACH, coarse=1e5
    ),
    "spacetime.learn_limits": recipe(
        lambda f, c: _finite_limits(f(c.motion)),
        rotations,
        cases=dict.fromkeys(("identity", "still", "constant"), TIES),
    ),
    "spacetime.restore": recipe(
        lambda f, c: f(c.motion, c.contacts), planted, ITERATED, OUT_OF_REACH, coarse=1e5
    ),
    "spacetime.satisfy": recipe(
        lambda f, c: f(c.motion, c.contacts), planted, ITERATED, OUT_OF_REACH, coarse=1e5
    ),
    "spacetime.satisfy[hierarchical]": recipe(
        lambda f, c: f(c.motion, c.contacts, method="hierarchical"), planted, ITERATED, coarse=1e5
    ),
    "metrics.bend": measured(lambda f, c: f(c.motion)),
    "metrics.check": measured(lambda f, c: [p.frame or 0 for p in f(c.motion)]),
    "metrics.contact_scores": measured(lambda f, c: f(c.contacts.mask, c.contacts.mask)),
    "metrics.detection_scores": measured(
        # Shares of nothing are not numbers.
        lambda f, c: f(c.contacts.mask, c.contacts.mask, length=2)[-2:]
    ),
    "metrics.difference": measured(lambda f, c: f(c.motion, c.other, world=True)),
    "metrics.duplicate_frames": measured(lambda f, c: f(c.motion)),
    "metrics.figure_size": measured(lambda f, c: f(c.motion.skeleton)),
    "metrics.find_problems": measured(lambda f, c: f(c.motion)),
    "metrics.foot_skate": measured(lambda f, c: f(c.motion, c.contacts)),
    "metrics.gimbal_margin": measured(lambda f, c: f(c.motion)),
    "metrics.jerk": measured(lambda f, c: f(c.motion)),
    "metrics.joint_position_error": measured(lambda f, c: f(c.motion, c.other)),
    "metrics.penetration": measured(lambda f, c: f(c.motion, c.contacts.points)),
    "metrics.pose_error": measured(lambda f, c: f(c.motion, c.other)),
    "metrics.root_bend": measured(lambda f, c: f(c.motion)),
    "metrics.rotation_rates": measured(lambda f, c: f(c.motion)),
    "metrics.sign_flips": measured(lambda f, c: f(c.motion)),
    "metrics.slides": measured(lambda f, c: f(c.motion, c.contacts)),
    "metrics.turn": measured(lambda f, c: f(c.q, c.o)),
    "metrics.world_positions": measured(lambda f, c: f(c.motion)),
}

EXCEPTIONS = {
    "axes.doubt_up": "a sentence about a concrete clip, in NumPy",
    "axes.guess_up": "an axis for a concrete clip, in NumPy",
    "jaxmotion.buckets": "a setting",
    "jaxmotion.checks": "a setting",
    "jaxmotion.enable_compilation_cache": "a setting",
    "cleaning.baseline_errors": "errors of concrete clips, in NumPy",
    "cleaning.clean_levels": "measured of concrete clips, on the host",
    "cleaning.detect_errors": "errors of concrete clips, on the host",
    "cleaning.digression_map": "a search among concrete clips, on the host",
    "cleaning.joint_groups": "joints of concrete clips, in NumPy",
    "cleaning.most_alike": "numbers of concrete clips, on the host",
    "cleaning.nearest_words": "an exact search among concrete clips, on the host",
    "cleaning.reconstruct_sparse": "learned of concrete clips, on the host",
    "cleaning.sequence_distance": "a search among concrete clips, on the host",
    "cleaning.repair": "errors of concrete clips, on the host",
    "corpus.local_client": "a connection",
    "corpus.map": "files through a function of the caller's",
    "io.save": "writes the file that the recipe of io.load reads",
    "kinematics.mirrored_pairs": "pairs of numbers, from names alone",
    "samples.names": "a list of names",
    "smoothing.bridged": "a list about concrete clips, in NumPy",
    "smoothing.motion_prior": "learned on the host from clips of any length",
    "style.segment_styles": "a list about concrete clips, in NumPy",
    "smoothing.removed": "a list about concrete clips, in NumPy",
    "viz.player": "a page",
    "viz.log_rerun": "writes to a recording",
    "viz.plot_alignment": "a picture",
    "viz.plot_contacts": "a picture",
    "viz.plot_cost_matrix": "a picture",
    "viz.plot_denoising_error": "a picture",
    "viz.plot_digression": "a picture",
    "viz.plot_invariance": "a picture",
    "viz.plot_key_interpolation": "a picture",
    "viz.plot_layers": "a picture",
    "viz.plot_poses": "a picture",
    "viz.plot_pyramid": "a picture",
    "viz.plot_repair": "a picture",
    "viz.plot_seam": "a picture",
    "viz.plot_texture": "a picture",
    "viz.plot_time_warp": "a picture",
    "viz.plot_trajectories": "a picture",
    "viz.plot_wrap": "a picture",
}


def _posterior(posterior):
    return posterior.mean, posterior.variance


def _alignment(found):
    """Without the path, which is padded only when compiled."""
    return found.motion, found.source_frame, found.distance


def _finite_limits(limits):
    """Without the root's infinities."""
    return limits.lower[1:], limits.upper[1:], limits.centre


def _warped(c):
    warp = timing.motion_warping(c.x, c.y)
    return c.x[warp.source_index], warp


class _Captured(Exception):
    pass


def arguments_of(name: str):
    """The function of a recipe, and the arguments that the recipe gives it."""
    given = []

    def capture(*args, **kwargs):
        given.append((args, kwargs))
        raise _Captured

    with suppress(_Captured):
        RECIPES[name].run(capture, case("plain", "float64"))
    room, _, function = name.partition("[")[0].partition(".")
    return (getattr(importlib.import_module(f"jaxmotion.{room}"), function), *given[0])

"""What every public function says of the motions it is given: a walk over all of them.

The recipes of the sweep tell how each is called; here it is called so, but for one argument.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import Motion, Skeleton
from jaxmotion._checks import at_hand
from jaxmotion._entry import finite_clip
from jaxmotion.displacement import Displacement
from jaxmotion.viz import player, plot_contacts
from tests.helpers import no_shape_checks
from tests.sweep_cases import case
from tests.sweep_recipes import RECIPES, arguments_of

# Batch axes allowed; all others refuse a batch by name.
BATCHED = {
    *("kinematics.forward_kinematics", "kinematics.velocities", "kinematics.facing_direction"),
    *("displacement.plus", "displacement.minus", "confine.confine", "axes.reorient"),
    *("metrics.rotation_rates", "metrics.sign_flips", "metrics.bend", "metrics.root_bend"),
    *("metrics.duplicate_frames", "metrics.gimbal_margin", "metrics.world_positions"),
    *("metrics.jerk", "metrics.joint_position_error"),
}
# What is not finite stays where it is; all others refuse it by joint and frame.
FRAME_BY_FRAME = BATCHED | {
    *("metrics.difference", "metrics.check", "metrics.find_problems"),
    *("metrics.foot_skate", "metrics.pose_error", "metrics.slides"),
    *("metrics.penetration", "multiresolution.follow", "clips.stack", "clips.concatenate"),
    *("timing.pad_to_bucket", "reflection.mirror"),
    *(f"samples.{name}" for name in ("add_noise", "add_spikes", "drop_frames", "flip_signs")),
    *(f"samples.{name}" for name in ("fill_gaps", "freeze_joints", "inject_errors")),
    *(f"samples.{name}" for name in ("offset_joints", "slide_root", "swap_limbs")),
    *(f"samples.{name}" for name in ("drift_joints", "swap_markers", "violate_limits")),
}
TAKE_BOTH = {
    *("smoothing.tune", "smoothing.outlier_weights", "smoothing.student_stiffness"),
    "timing.pad_to_bucket",
}
OF_ARRAYS = ("quaternion.", "smoothing.", "timing.", "multiresolution.", "metrics.", "contacts.")


def _places(args, wanted):
    """Where among the arguments, and in lists among them, something wanted is."""
    for i, value in enumerate(args):
        if wanted(value):
            yield i, None
        elif isinstance(value, list):
            yield from ((i, k) for k, item in enumerate(value) if wanted(item))


def _with(args, place, value):
    """The arguments, another value at a place."""
    i, k = place
    if k is not None:
        value = [value if n == k else item for n, item in enumerate(args[i])]
    return (*args[:i], value, *args[i + 1 :])


def _is_motion(value):
    return isinstance(value, Motion)


def _is_signal(value):
    frames = case("plain", "float64").frames
    return isinstance(value, (np.ndarray, jax.Array)) and value.shape[:1] == (frames,)


WALKED = [name for name in RECIPES if not name.startswith(("io.", "linalg."))]
BATCH = jm.stack([case("plain", "float64").motion, case("plain", "float64").third])[0]


def _broken():
    motion = case("plain", "float64").motion
    return motion.with_transforms(rotations=motion.rotations.at[4, 1, 2].set(jnp.nan))


@pytest.mark.parametrize("name", WALKED)
def test_every_function_tells_what_is_no_motion_no_clip_and_no_number(name):
    function, args, kwargs = arguments_of(name)
    caller = name.split(".")[1].partition("[")[0]
    plain = name.partition("[")[0]
    places = list(_places(args, _is_motion))
    for place in places:
        refused = [
            ("walk.bvh", rf"{caller}: \S+ is a str; expected "),
            (np.ones((9, 7, 4)), rf"{caller}: \S+ is an array of shape \(9, 7, 4\); expected "),
        ]
        if plain in TAKE_BOTH:
            refused = []
        if plain not in BATCHED:
            refused.append((BATCH, rf"{caller}: one clip at a time( for \S+)?, got .* \(2,\); "))
        if plain not in FRAME_BY_FRAME:
            where = r"\.rotations of 'LeftUpLeg' at frame 4 are not finite; expected finite"
            refused.append((_broken(), rf"{caller}: \w+(\[\d\])?{where}"))
        for wrong, message in refused:
            with no_shape_checks(), pytest.raises(ValueError, match=f"^{message}"):
                function(*_with(args, place, wrong), **kwargs)
    if name.startswith(OF_ARRAYS) and plain not in TAKE_BOTH:
        motion = case("plain", "float64").motion
        for place in _places(args, _is_signal):
            message = f"{caller}: .*(is a Motion; expected an array|two motions or two arrays)"
            with no_shape_checks(), pytest.raises(ValueError, match=message):
                function(*_with(args, place, motion), **kwargs)


@pytest.mark.parametrize("name", [n for n in WALKED if n.partition("[")[0] in BATCHED])
def test_batches_are_as_each_of_their_clips(name):
    """Those that jm.stack makes, and those of one skeleton and frame time."""
    function, args, kwargs = arguments_of(name)
    clip = case("plain", "float64").third
    moves = Displacement(0.5 * clip.translations, clip.translations)

    def other(value):
        if isinstance(value, Displacement):
            return Displacement(moves.translations, moves.rotations, value.sense)
        return clip if _is_motion(value) else value

    both = [args, tuple(map(other, args))]
    want = [function(*some, **kwargs) for some in both]

    def batched(*values):
        if isinstance(values[0], (Motion, Displacement)):
            return jax.tree.map(lambda *x: jnp.stack(x), *values)
        return values[0]

    stacked = tuple(map(batched, *both))
    shared = tuple(
        Motion(args[i].skeleton, x.translations, x.rotations, 1 / 60, translated_joints=(0,))
        if _is_motion(x)
        else x
        for i, x in enumerate(stacked)
    )
    for batch in (stacked, shared):
        got = function(*batch, **kwargs)
        for k, one in enumerate(want):
            for x, y in zip(_moving(got), _moving(one), strict=True):
                np.testing.assert_allclose(x[k], y, 1e-12, 1e-12)


def _moving(result):
    if isinstance(result, Motion):
        return result.translations, result.rotations
    return jax.tree.leaves(result)


def test_functions_without_a_recipe_say_it_too():
    motion = case("plain", "float64").motion
    contacts = case("plain", "float64").contacts
    calls = {
        "guess_up": jm.guess_up,
        "save": lambda m: jm.save(m, "never.bvh"),
        "ContactPoints.positions": contacts.points.positions,
        "plot_contacts": lambda m: plot_contacts(m, contacts),
        "player": player,
        "log_rerun": jm.viz.log_rerun,
    }
    for name, call in calls.items():
        with no_shape_checks():
            with pytest.raises(ValueError, match=f"^{name}: motion is a str; expected a jaxm"):
                call("walk.bvh")
            with pytest.raises(ValueError, match=f"^{name}: one clip at a time, got batch axes"):
                call(BATCH)
    with no_shape_checks(), pytest.raises(ValueError, match=r"^save: motion is a str"):
        jm.save("walk", "never.npz")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"^save: rotations of 'LeftUpLeg' at frame 4 are not"):
        jm.save(_broken(), "never.bvh")
    assert motion.num_frames == 9


def test_how_to_come_by_a_motion_is_told():
    motion = case("plain", "float64").motion
    hints = [
        ("walk.bvh", r"a str; expected a jaxmotion.Motion \(jaxmotion.load reads files\)"),
        (motion.rotations, r"\(jaxmotion.Motion\(skeleton, translations, rotations, frame_time\)"),
        ([motion], r"a list; .* \(one of them, or jaxmotion.stack makes a batch"),
        (None, "is None; expected a jaxmotion.Motion"),
        (
            jm.samples.Corrupted(motion, jnp.ones((9, 7), bool), jnp.ones((9, 7))),
            r"a Corrupted; .*\(its .motion\)",
        ),
    ]
    for wrong, message in hints:
        with no_shape_checks(), pytest.raises(ValueError, match=message):
            jm.denoise(wrong)


def test_results_are_asked_for_by_name():
    motion, contacts = case("plain", "float64").motion, case("plain", "float64").contacts
    calls = [
        (lambda: jm.synthesize(motion), "synthesize: layers is a Motion; expected MotionLayers"),
        (
            lambda: jm.multiresolution.scale_details(motion, 2.0),
            "scale_details: pyramid is a Motion; expected a Pyramid",
        ),
        (
            lambda: jm.multiresolution.level_of_detail(motion, 2.0),
            "level_of_detail: pyramid is a Motion; expected a Pyramid",
        ),
        (
            lambda: jm.contacts.cleanup_root(motion, contacts.mask),
            r"cleanup_root: contacts is an array of shape \(9, 2\); expected Contacts",
        ),
        (lambda: jm.spacetime.restore(motion, True), "restore: contacts is a bool; expected Con"),
        (
            lambda: jm.stylize(motion, 2.0, keep_contacts="yes"),
            "stylize: keep_contacts is a str; expected Contacts .* True or False",
        ),
        (
            lambda: jm.contacts.limb_lengths(motion, contacts),
            "limb_lengths: points is a Contacts; expected ContactPoints",
        ),
        (
            lambda: jm.displacement.plus(motion, motion),
            "plus: displacement is a Motion; expected a Displacement",
        ),
        (
            lambda: jm.multiresolution.stitch(motion),
            "stitch: motions is a Motion; expected a list of clips",
        ),
        (
            lambda: jm.joint_weights(motion, ["*Leg*"]),
            r"joint_weights: gains is a list; expected patterns and their gains, as in \{",
        ),
        (
            lambda: jm.joint_weights("walk", {"*": 1.0}),
            "joint_weights: skeleton is a str; expected a jaxmotion.Skeleton",
        ),
    ]
    for call, message in calls:
        with no_shape_checks(), pytest.raises(ValueError, match=f"^{message}"):
            call()


def test_a_motion_stands_for_its_skeleton():
    motion = case("plain", "float64").motion
    skeleton = motion.skeleton
    assert isinstance(skeleton, Skeleton)
    for name, call in {
        "joint_weights": lambda s: jm.joint_weights(s, {"Left*": 2.0}),
        "mirrored_pairs": jm.kinematics.mirrored_pairs,
        "figure_size": jm.metrics.figure_size,
        "selection_weights": lambda s: jm.confine.selection_weights(s, 9, joints=["Left*"]),
        "ContactPoints": lambda s: jm.contacts.ContactPoints(s, [3]).limbs,
    }.items():
        np.testing.assert_array_equal(call(motion), call(skeleton), err_msg=name)


def test_what_is_missing_or_padding_does_not_count():
    motion = _broken()
    weights = np.ones(9)
    weights[4] = 0
    assert finite_clip("f", motion, weights=weights) is motion
    per_joint = np.ones((9, 7))
    per_joint[4, 1] = 0
    assert finite_clip("f", motion, weights=jnp.asarray(per_joint)) is motion
    assert finite_clip("f", motion, length=4) is motion
    per_joint[4, 1], per_joint[4, 2] = 1, 0
    for wrong in ({"weights": per_joint}, {"length": 5}, {"length": jnp.asarray(9)}):
        with pytest.raises(ValueError, match=r"^f: motion.rotations of 'LeftUpLeg' at frame 4"):
            finite_clip("f", motion, **wrong)
    with pytest.raises(ValueError, match=r"f: weights have shape \(8,\); expected \(9,\) or \(9"):
        finite_clip("f", motion, weights=np.ones(8))
    far = motion.with_transforms(motion.translations.at[2, 0, 1].set(jnp.inf))
    with pytest.raises(ValueError, match=r"^f: x.translations of 'Hips' at frame 2 are not finite"):
        finite_clip("f", far, "x")


def test_under_jit_the_argument_of_the_function_that_was_called_is_named():
    """It was "y holds NaN" once, whoever was called."""

    @jax.jit
    def checked(motion, weights, length):
        options = {"weights": weights, "length": length, "at_run_time": True}
        return finite_clip("denoise", motion, **options).rotations

    ones = jnp.ones(9)
    for weights, length in ((ones, 9), (ones, 5)):
        with pytest.raises(
            jax.errors.JaxRuntimeError, match="denoise: motion holds values that are not finite"
        ):
            jax.block_until_ready(checked(_broken(), weights, length))
    for weights, length in ((ones.at[4].set(0), 9), (ones, 4)):
        got = checked(_broken(), weights, length)
        np.testing.assert_array_equal(got, _broken().rotations)


def test_what_is_traced_is_not_at_hand():
    assert at_hand(np.ones(2)) is not None
    assert at_hand(jnp.ones(2)) is not None
    seen = []
    jax.eval_shape(lambda x: seen.append(at_hand(x)), 1.0)
    assert seen == [None]

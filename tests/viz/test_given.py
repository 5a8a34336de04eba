"""What every picture of a motion says of what is none, of batches, of NaN and of what is traced."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import viz
from jaxmotion.viz.given import unit_of
from tests.helpers import no_shape_checks, random_motion

CLIP = random_motion(np.random.default_rng(0), frames=5, skeleton=3)
PICTURES = {
    "plot_denoising_error": lambda m: viz.plot_denoising_error(m, CLIP),
    "plot_invariance": viz.plot_invariance,
    "plot_key_interpolation": lambda m: viz.plot_key_interpolation(m, [0, 1, 2, 3, 4], 0),
    "plot_poses": viz.plot_poses,
    "plot_seam": lambda m: viz.plot_seam([m, m]),
    "plot_texture": viz.plot_texture,
    "plot_time_warp": viz.plot_time_warp,
    "plot_trajectories": viz.plot_trajectories,
    "plot_wrap": lambda m: viz.plot_wrap(m, 0),
}


@pytest.mark.parametrize("name", PICTURES)
def test_motions_are_single_known_and_finite(name):
    draw = PICTURES[name]
    batch = jax.tree.map(lambda x: jnp.stack([x, x]), CLIP)
    broken = CLIP.with_transforms(rotations=CLIP.rotations.at[3, 1].set(jnp.nan))
    refused = [
        ("walk.bvh", r" is a str; expected a jaxmotion.Motion"),
        (batch, r"one clip at a time.*take them one by one"),
        (broken, r"rotations of 'joint1' at frame 3 are not finite"),
    ]
    for wrong, message in refused:
        with no_shape_checks(), pytest.raises(ValueError, match=f"^{name}: .*{message}"):
            draw(wrong)
    with pytest.raises(ValueError, match=f"^{name}: .* is traced; pictures are of known values"):
        jax.eval_shape(draw, CLIP)


def test_units_of_length_are_words():
    def skeleton(metres):
        known = jm.skeleton.Conventions(metres=metres)
        return jm.Skeleton(["a"], [-1], np.zeros((1, 3)), conventions=known)

    words = {1: "metres", 0.01: "cm", 0.3: "0.3 m", None: "file's unit"}
    assert {metres: unit_of(skeleton(metres)) for metres in words} == words

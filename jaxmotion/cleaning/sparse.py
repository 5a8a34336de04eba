"""A whole motion from a few of its joints, by what a corpus does where those do the same.

With x(t) the rotation vectors of the known joints from their means over the corpus, at the five
frames −8, −4, 0, 4 and 8 about t of 24 a second, and y(t) those of all others,

    ŷ(t) = ȳ + k(t)ᵀ (K + ν I)⁻¹ (Y − ȳ),      k = exp(−‖x − x′‖²/2ℓ²),   ℓ = 3 rad, ν = 0.1

over the 2000 frames of the corpus that are nearest to some frame of the motion: each joint takes a
mean of what it does in the words most like this one, and what is said of one frame and the next is
as near as their words are. Aristidou et al. 2018, §6, chain words to one another and filter the
jumps; of nearest words and their medians comes a third more of error. O(T·P·J) for P frames.
"""

from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Float

from jaxmotion._checks import known, static
from jaxmotion._entry import finite_clip
from jaxmotion.cleaning.body import as_lean, from_lean
from jaxmotion.cleaning.digression import thinned
from jaxmotion.cleaning.foretold import about
from jaxmotion.cleaning.groups import as_clips, one_skeleton
from jaxmotion.cleaning.turns import mean_rotation, turned, vectors_between
from jaxmotion.cleaning.words import chosen_joints
from jaxmotion.motion import Motion

_WIDTH = 3.0  # radians, ℓ
_NOISE = 0.1  # ν
_MOST = 2000  # frames
_CHUNK = 512


@static("known_joints")
def reconstruct_sparse(
    motion: Motion, known_joints: Sequence[int | str], corpus: Motion | Sequence[Motion]
) -> Motion:
    """The motion with the joints that are not known put where the corpus has them.

    On the host; not differentiable, not under ``jit``.

    **Arguments:** ``motion``: one clip, T frames, of which the body's place and facing and the
    known joints' rotations are used; ``known_joints``: numbers or names, such as neck, shoulders,
    elbows, hips and knees; ``corpus``: whole clips of the same joints, at any rate.
    **Returns:** a motion of T frames; known joints and translations are bit for bit as given.
    **Raises:** ``ValueError`` for no corpus, clips of other joints, what is traced or not finite.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk = jm.samples.load("walk", fps=24.0, num_frames=96).motion
        >>> legs = ["LeftUpLeg", "LeftLeg", "RightUpLeg", "RightLeg"]
        >>> made = jm.cleaning.reconstruct_sparse(walk[:48], legs, walk[48:])
        >>> bool(jm.metrics.turn(made.rotations, walk[:48].rotations).mean() < 0.05)
        True
    """
    caller = "reconstruct_sparse"
    finite_clip(caller, motion, on_host=True)
    others = as_clips(corpus)
    if not others:
        raise ValueError(f"{caller}: the corpus is empty; expected one clip at least")
    clips = one_skeleton(caller, [motion, *others])
    chosen = list(chosen_joints(caller, motion, known_joints))
    step, (_, *thin) = thinned(clips)
    own, *leans = (as_lean(clip) for clip in [motion, *thin])
    mean = mean_rotation(np.concatenate(leans))
    x, *every = (vectors_between(np.broadcast_to(mean, q.shape), q) for q in [own, *leans])
    # What is above the body is the world's, not the performer's.
    unknown = np.ones(own.shape[:2], bool)
    unknown[:, chosen] = False
    unknown[:, : motion.body_joint] = False
    rest = np.flatnonzero(unknown[0])
    asked = about(x[:, chosen], np.arange(len(x)), step)
    told = np.concatenate([about(v[:, chosen], np.arange(len(v)), 1) for v in every])
    answers = np.concatenate([v[:, rest].reshape(len(v), -1) for v in every])
    foretold = _regressed(asked, told, answers).reshape(len(x), len(rest), 3)
    made = own.copy()
    start = np.broadcast_to(mean[rest], (*foretold.shape[:2], 4))
    made[:, rest] = turned(start, foretold.astype(own.dtype))
    whole = from_lean(motion, made, unknown, yaw_holds=True)
    rotations = np.where(unknown[..., None], whole, known(motion.rotations))
    return motion.with_transforms(rotations=jax.device_put(rotations))


def _regressed(
    asked: Float[np.ndarray, "time f"],
    told: Float[np.ndarray, "other f"],
    answers: Float[np.ndarray, "other n"],
) -> Float[np.ndarray, "time n"]:
    """ŷ of every frame that is asked of."""
    asked, told, answers = (np.asarray(a, np.float64) for a in (asked, told, answers))
    if len(told) > _MOST:
        chunks = range(0, len(told), _CHUNK)
        far = np.concatenate([_squared(told[i : i + _CHUNK], asked).min(axis=1) for i in chunks])
        nearest = np.sort(np.argpartition(far, _MOST)[:_MOST])
        told, answers = told[nearest], answers[nearest]
    middle = answers.mean(axis=0)
    kernel = np.exp(_squared(told, told) / (-2 * _WIDTH**2))
    weights = np.linalg.solve(kernel + _NOISE * np.eye(len(told)), answers - middle)
    chunks = range(0, len(asked), _CHUNK)
    near = (np.exp(_squared(asked[i : i + _CHUNK], told) / (-2 * _WIDTH**2)) for i in chunks)
    return middle + np.concatenate([k @ weights for k in near])


def _squared(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Squared distances of all rows of a from all of b."""
    return np.maximum(np.sum(a * a, 1)[:, None] + np.sum(b * b, 1) - 2 * a @ b.T, 0)

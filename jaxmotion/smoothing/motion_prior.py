"""How the joints of a body turn together, learned from clean clips.

The rotations of J joints leave a frame with 3J angular velocities, log(q_t⁻¹ q_{t+1}) in every
joint's own frame, and their differences with 3J accelerations. A body does not use all 3J
directions alike: knees and ankles turn together, spines bend as one. A :class:`MotionPrior` keeps
the accelerations' covariance Q, of which denoising takes the directions and leaves the sizes to the
clip (:mod:`.together`), so that clips of other speed, rate and style have the same prior.

    Q ∝ Σ w_t a_t a_tᵀ,    w_t = 1/(‖a_t‖² + m²/10)       m the clip's median ‖a‖

Frames count alike, whether the body walks or jumps, and an error of the capture counts as a frame.
"""

import json
from collections.abc import Iterable, Iterator
from os import PathLike

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxmotion import quaternion
from jaxmotion._checks import traced
from jaxmotion._entry import finite_clip, skeleton_of
from jaxmotion._plain import quoted
from jaxmotion._portable import Portable
from jaxmotion._types import AnyArray
from jaxmotion.io.archive import Archive, write_archive
from jaxmotion.io.atomic import atomic_write
from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton

MARK = "jaxmotion_motion_prior"
_VERSION = 1
_SOFT = 0.1  # m² times this


class MotionPrior(Portable):
    """In which directions the joints of a body accelerate together.

    **Fields:** ``joints``: J names, static; ``covariance``: f[3J, 3J] of their angular
    accelerations, joint by joint, x, y, z in each joint's own frame; its trace is 1; ``frames``:
    how many it was learned from, static.
    """

    joints: tuple[str, ...] = eqx.field(static=True)
    covariance: Float[AnyArray, "axis axis"]
    frames: int = eqx.field(static=True, default=0)

    def of(self, skeleton: Skeleton | Motion) -> Float[AnyArray, "axis axis"]:
        """The covariance of a skeleton's joints, found by name.

        **Arguments:** ``skeleton``: K joints, or a motion of them.
        **Returns:** f[3K, 3K].
        **Raises:** ``ValueError`` for a joint that the prior does not know.
        """
        names = skeleton_of("MotionPrior.of", skeleton).names
        places = {name: place for place, name in enumerate(self.joints)}
        if strange := [name for name in names if name not in places]:
            raise ValueError(
                f"the prior knows no joint named {quoted(strange[0])} (its joints: "
                f"{', '.join(map(quoted, self.joints[:12]))}); learn one from clips of this "
                "skeleton"
            )
        joints = np.array([places[name] for name in names])
        axes = (3 * joints[:, None] + np.arange(3)).ravel()
        return self.covariance[np.ix_(axes, axes)]

    def save(self, path: str | PathLike, *, overwrite: bool = True) -> None:
        """Write the prior to an .npz file, whole or not at all; nothing is pickled.

        **Arguments:** ``path``: the file; ``overwrite``: whether one of that name may be replaced.
        **Raises:** ``FileExistsError`` and other ``OSError`` from writing.
        """
        arrays = {
            MARK: np.array(_VERSION),
            "joints": np.array(json.dumps(self.joints)),
            "covariance": np.asarray(self.covariance),
            "frames": np.array(self.frames),
        }
        with atomic_write(path, overwrite=overwrite) as file:
            write_archive(file, arrays, compress=True)

    @classmethod
    def load(cls, path: str | PathLike) -> "MotionPrior":
        """Read what :meth:`save` wrote.

        **Arguments:** ``path``: the file.
        **Returns:** :class:`MotionPrior`, in the dtype it was saved with (float64 becomes float32
        where JAX has it disabled).
        **Raises:** :class:`~jaxmotion.io.MotionFileError` for a file that is no prior; ``OSError``
        for one that cannot be opened.
        """
        archive = Archive(path)
        with archive.kept("MotionPrior.save", MARK, _VERSION):
            joints = archive.texts("joints")
            covariance = archive.floats("covariance")
            if covariance.shape != (3 * len(joints), 3 * len(joints)):
                raise ValueError(f"a covariance {covariance.shape} of {len(joints)} joints")
            frames = int(archive.read("frames", "a whole number"))
            return cls(joints, jnp.asarray(covariance), frames)

    def _words(self) -> Iterator[str]:
        yield f"{len(self.joints)} joints"
        yield f"learned from {self.frames} frames"


def motion_prior(clips: Motion | Iterable[Motion]) -> MotionPrior:
    """Learn from clean clips in which directions a body's joints turn together.

    For :func:`jaxmotion.denoise`, whose clips may be other people's, in another style, at another
    rate: only the joints' names must be the same, and what their axes mean. O(T·J²).

    **Arguments:** ``clips``: a motion, or several with joints of the same names in any order, taken
    one by one (a generator may read them).
    **Returns:** :class:`MotionPrior`, in the first clip's dtype.
    **Raises:** ``ValueError`` for no clips, numbers that are not finite, joints of other names, and
    clips in which nothing moves; ``TypeError`` inside ``jit``.

    **Example:**

        >>> import jaxmotion as jm
        >>> takes = [jm.samples.load(name).motion for name in ("walk", "run")]
        >>> prior = jm.smoothing.motion_prior(takes)
        >>> prior.covariance.shape
        (66, 66)
        >>> clean = jm.denoise(takes[0][:16], prior=prior)
    """
    names: tuple[str, ...] = ()
    total, frames, dtype = np.zeros(()), 0, None
    for clip in [clips] if isinstance(clips, Motion) else clips:
        finite_clip("motion_prior", clip, "clips", on_host=True)
        if traced(clip):
            raise TypeError(
                "motion_prior: clips of any length are for the host; call it outside jit"
            )
        if dtype is None:
            names, dtype = clip.skeleton.names, clip.dtype
        if missing := sorted({*names} ^ {*clip.skeleton.names}):
            raise ValueError(
                f"motion_prior: clips with and without a joint named {quoted(missing[0])}; "
                "expected clips of the same joints"
            )
        total = total + _usual_bends(clip.rotations[:, [clip.skeleton.index(n) for n in names]])
        frames += clip.num_frames
    if dtype is None:
        raise ValueError("motion_prior: no clips; expected one at least")
    if not np.trace(total) > 0:
        raise ValueError("motion_prior: nothing turns in these clips; there is nothing to learn")
    covariance = total / np.trace(total)
    return MotionPrior(names, jnp.asarray(covariance, dtype), frames)


def _usual_bends(rotations: Float[AnyArray, "time joint 4"]) -> np.ndarray:
    """Σ w a aᵀ of a clip."""
    speed = quaternion.log(quaternion.between(rotations[:-1], rotations[1:]))
    speed = np.asarray(speed, np.float64).reshape(-1, 3 * rotations.shape[1])
    bends = np.diff(speed, axis=0)
    square = np.sum(bends**2, axis=1)
    soft = _SOFT * np.median(square) if len(square) else 0.0
    weight = np.divide(1, square + soft, out=np.zeros_like(square), where=square > 0)
    return (weight * bends.T) @ bends

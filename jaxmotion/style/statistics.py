"""The manner of a motion as statistics of its joints and of its root (Wu et al. 2006, §5).

    q̄   mean rotation of a joint              quaternion.mean; "recursive": Eq. 6, with 1/n
    C   Σ w v vᵀ / Σ w,  v = log(q̄⁻¹q)       3 × 3, in the mean's own frame
    σ   √tr C, the deviation, a full angle    the paper's is half of it

    ω̄   √(Σ w |q̇|² / Σ σ²), the tempo         over all joints below the body's, radians a second
                                              a radian: how fast they turn for how far they go

and mean and deviation of the root's six channels (:mod:`.root`). v is the logarithm of rotations
whose signs go on from frame to frame, so that a joint that turns past half a circle from its mean
has no jump there; it reaches to a full turn.

Between and beyond styles (:func:`interpolate`) means are the m with Σ w_i log(m⁻¹m_i) = 0, and
roots √C, deviations and channel means are weighted sums, a deviation below 0 is 0; tempos are
weighted products. O(T·J).
"""

import json
from collections.abc import Iterable, Iterator, Sequence
from os import PathLike
from typing import Literal, TypeAlias, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxmotion import quaternion
from jaxmotion._checks import instance_of, known, one_of, require
from jaxmotion._entry import finite_clip
from jaxmotion._file_facts import compiled
from jaxmotion._numerics import angle_over_sine, rounding_angle, safe_sqrt
from jaxmotion._plain import quoted
from jaxmotion._portable import Portable
from jaxmotion._posture import counting, upright
from jaxmotion._room import room_for
from jaxmotion._types import AnyArray, ArrayLike, Quaternion
from jaxmotion.io.archive import Archive, write_archive
from jaxmotion.io.atomic import atomic_write
from jaxmotion.linalg.symmetric import symmetric_function
from jaxmotion.motion import Motion
from jaxmotion.style.root import CHANNELS, Start, encode, rounding

Mean: TypeAlias = Literal["recursive", "karcher", "chordal"]
MEANS = ("recursive", "karcher", "chordal")

MARK = "jaxmotion_motion_style"
_VERSION = 2
_STEPS = 16  # to the mean of several means
STILL = 1e-3  # radians; what deviates less has nothing to scale but rounding
_FULL_TURN = 1e-6  # sin² of half the angle, below which a turn past half is a whole one


class MotionStyle(Portable):
    """The manner in which a body moves: where its joints are, and how far they go from there.

    **Fields:** ``joints``: J names, static; ``mean``: f[J, 4]; ``covariance``: f[J, 3, 3], radians
    squared, in each mean's own frame; ``root_mean``, ``root_deviation``: f[6] of the root's
    channels (velocity ahead and aside in length a second, yaw rate in radians a second, height
    above the ground, lean ahead and aside in radians); ``root_upright``: f[3], the root's axis that
    points up; ``tempo``: f[], how fast the joints turn for how far they go, 1/s (of a swing, 2π a
    period), 0 where all are still; ``up``: the world's axis that points up, static.
    """

    joints: tuple[str, ...] = eqx.field(static=True)
    mean: Float[AnyArray, "joint 4"]
    covariance: Float[AnyArray, "joint 3 3"]
    root_mean: Float[AnyArray, "6"]
    root_deviation: Float[AnyArray, "6"]
    root_upright: Float[AnyArray, "3"]
    tempo: Float[AnyArray, ""]
    up: str = eqx.field(static=True, default="y")

    @property
    def deviation(self) -> Float[Array, " joint"]:
        """σ of every joint in radians, f[J]."""
        squared = jnp.trace(jnp.asarray(self.covariance), axis1=-2, axis2=-1)
        return safe_sqrt(squared, rounding_angle(squared.dtype) ** 2)

    def save(self, path: str | PathLike, *, overwrite: bool = True) -> None:
        """Write the style to an .npz file, whole or not at all; nothing is pickled.

        **Arguments:** ``path``: the file; ``overwrite``: whether one of that name may be replaced.
        **Raises:** ``FileExistsError`` and other ``OSError`` from writing.
        """
        arrays = {
            MARK: np.array(_VERSION),
            "joints": np.array(json.dumps(self.joints)),
            "up": np.array(self.up),
            **{name: np.asarray(getattr(self, name)) for name in _ARRAYS},
        }
        with atomic_write(path, overwrite=overwrite) as file:
            write_archive(file, arrays, compress=True)

    @classmethod
    def load(cls, path: str | PathLike) -> "MotionStyle":
        """Read what :meth:`save` wrote.

        **Arguments:** ``path``: the file.
        **Returns:** :class:`MotionStyle`, in the dtype it was saved with (float64 becomes float32
        where JAX has it disabled).
        **Raises:** :class:`~jaxmotion.io.MotionFileError` for a file that is no style; ``OSError``
        for one that cannot be opened.
        """
        archive = Archive(path)
        with archive.kept("MotionStyle.save", MARK, _VERSION):
            joints = archive.texts("joints")
            up = str(archive.read("up", "a letter"))
            if up not in ("x", "y", "z"):
                raise ValueError(f"up={quoted(up)}")
            arrays = {name: archive.floats(name) for name in _ARRAYS}
            for name, shape in _ARRAYS.items():
                wanted = tuple(len(joints) if n is None else n for n in shape)
                if arrays[name].shape != wanted:
                    raise ValueError(f"{name} {arrays[name].shape} of {len(joints)} joints")
            return cls(joints, **{k: jnp.asarray(x) for k, x in arrays.items()}, up=up)

    def _words(self) -> Iterator[str]:
        yield f"{len(self.joints)} joints"


_ARRAYS: dict[str, tuple[int | None, ...]] = {
    "mean": (None, 4),
    "covariance": (None, 3, 3),
    "root_mean": (len(CHANNELS),),
    "root_deviation": (len(CHANNELS),),
    "root_upright": (3,),
    "tempo": (),
}


def motion_style(
    motion: Motion | Iterable[Motion], weights: ArrayLike | None = None, *, mean: Mean = "recursive"
) -> MotionStyle:
    """The manner of a clip, or of several together, every frame of them counting alike.

    O(T·J). Differentiable in both modes. Source: Wu et al. 2006, §5, Eq. 6.

    **Arguments:** ``motion``: one clip, T frames, J joints, or several with joints of the same
    names in the same order and one up axis, at any rate; ``weights``: ≥ 0, of every clip's frames
    together, f[K] of K clips; of one clip, f[T] of its frames; ``mean``: as
    :func:`jaxmotion.quaternion.mean`.
    **Returns:** :class:`MotionStyle`, in the first clip's dtype.
    **Raises:** ``ValueError`` for no clips, clips of other joints, weights that do not fit or are
    known to be negative or all 0, and numbers that are not finite.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk = jm.samples.load("walk").motion[:60]
        >>> style = jm.style.motion_style(walk)
        >>> style.mean.shape, bool(style.deviation.max() < 1.5)
        ((22, 4), True)
    """
    one_of("motion_style: mean", mean, MEANS)
    several = isinstance(motion, Iterable) and not isinstance(motion, str | jax.Array | np.ndarray)
    clips = list(cast(Iterable[Motion], motion)) if several else [cast(Motion, motion)]
    if not clips:
        raise ValueError("motion_style: no clips; expected one at least")
    names = [f"motion[{k}]" for k in range(len(clips))] if several else ["motion"]
    clips = [
        finite_clip("motion_style", clip, name, at_run_time=True)
        for clip, name in zip(clips, names, strict=True)
    ]
    first = clips[0].skeleton
    for clip in clips[1:]:
        if clip.skeleton.names != first.names or clip.skeleton.up != first.up:
            raise ValueError(
                "motion_style: clips of other joints, or with another axis up; expected the first "
                f"clip's, {', '.join(map(quoted, first.names[:12]))}, {first.up} up"
            )
    lengths = [clip.num_frames for clip in clips]
    wanted = (len(clips),) if several else (lengths[0],)
    if weights is not None:
        if np.shape(weights) != wanted:
            raise ValueError(f"motion_style: weights have shape {np.shape(weights)}; want {wanted}")
        value = known(weights)
        bad = ~((value >= 0).all() & (value.sum() > 0) & (value < np.inf).all())
        message = "motion_style: weights must be 0 or more, and not all 0"
        clips[0] = require(clips[0], bad, message, got=weights)
    rooms = [room_for(clip, clips, weights) for clip in clips]
    clips = [room.fill(clip) for room, clip in zip(rooms, clips, strict=True)]
    of_frames = [np.ones(clip.num_frames, clips[0].dtype) for clip in clips]
    if weights is not None:
        value = value.astype(clips[0].dtype)
        of_frames = [rooms[0].fill(value)]
        if several:
            parts = [value[k] / length for k, length in enumerate(lengths)]
            of_frames = [jnp.full(c.num_frames, w) for c, w in zip(clips, parts, strict=True)]
    counts = [room.count for room in rooms]
    stands = upright(clips[0], counts[0])
    rows = [encode(clip, stands, n)[0] for clip, n in zip(clips, counts, strict=True)]
    return statistics(clips, rows, of_frames, counts, mean, stands)


def of_one(
    clip: Motion, count: Int[Array, ""], mean: Mean, stands: Float[AnyArray, "3"]
) -> tuple[MotionStyle, tuple[Float[Array, "time 6"], Start]]:
    """The manner of a clip whose first ``count`` frames count, all alike, and its body, for that
    side of it up."""
    body = encode(clip, jnp.asarray(stands), count)
    alike = np.ones(clip.num_frames, clip.dtype)
    return statistics([clip], [body[0]], [alike], [count], mean, jnp.asarray(stands)), body


@compiled
def statistics(
    clips: list[Motion],
    rows: Sequence[Float[Array, "_ 6"]],
    weights: Sequence[ArrayLike],
    counts: Sequence[Int[Array, ""]],
    mean: Mean,
    stands: Float[Array, "3"],
) -> MotionStyle:
    """:func:`motion_style` of clips that are checked, with the root's channels of each, and weights
    f[T] or f[T, J] of its frames, of which the first ``counts`` count; the root's channels have the
    body's. ``stands``: its axis that points up."""
    kind, skeleton = clips[0].dtype, clips[0].skeleton
    joints, stands = skeleton.num_joints, jnp.asarray(stands, kind)
    clips = [clip.astype(kind) for clip in clips]
    counted = [counting(n, clip.num_frames) for n, clip in zip(counts, clips, strict=True)]
    w = [jnp.asarray(x, kind) for x in weights]
    w = [x if x.ndim == 2 else x[:, None] * jnp.ones(joints, kind) for x in w]
    w = [jnp.where(c[:, None], x, 0) for c, x in zip(counted, w, strict=True)]
    w = jnp.concatenate(w)
    middle = quaternion.mean(jnp.concatenate([clip.rotations for clip in clips]), w, method=mean)
    share = w / jnp.sum(w, axis=0)
    pairs = list(zip(clips, counts, strict=True))
    v = jnp.concatenate([deviations(middle, clip.rotations, n) for clip, n in pairs])
    covariance = jnp.einsum("tj,tja,tjb->jab", share, v, v)
    ends = np.cumsum([clip.num_frames for clip in clips])[:-1]
    tempo = _tempo(clips, jnp.split(w, ends), counted, covariance)
    of_body = share[:, clips[0].body_joint]
    channels = jnp.concatenate([x.astype(kind) for x in rows])
    root_mean = of_body @ channels
    still = jnp.max(jnp.stack([rounding(clip) for clip in clips]), axis=0)
    spread = safe_sqrt(of_body @ (channels - root_mean) ** 2, still**2)
    return MotionStyle(
        skeleton.names, middle, covariance, root_mean, spread, stands, tempo, up=skeleton.up
    )


def _tempo(
    clips: list[Motion],
    weights: list[Array],
    counted: list[Bool[Array, " _"]],
    covariance: Float[Array, "joint 3 3"],
) -> Float[Array, ""]:
    """ω̄ of the module; a step counts as the frames at its ends do."""
    squared, total = 0.0, 0.0
    for clip, w, counts in zip(clips, weights, counted, strict=True):
        q, pair = clip.rotations, jnp.where(counts[1:, None], 0.5 * (w[1:] + w[:-1]), 0)
        turn = quaternion.log(quaternion.between(q[:-1], q[1:]))
        rate = 1 / jnp.asarray(clip.frame_time, w.dtype)
        squared += jnp.sum(pair * jnp.sum(turn**2, axis=-1), axis=0) * rate**2
        total += jnp.sum(pair, axis=0)
    below = slice(clips[0].body_joint + 1, None)
    nothing = jnp.asarray(total) <= 0
    fast = jnp.sum((squared / jnp.where(nothing, 1, total))[below])
    far = jnp.sum(jnp.trace(covariance[below], axis1=-2, axis2=-1))
    still = far <= STILL**2
    return safe_sqrt(jnp.where(still, 0, fast / jnp.where(still, 1, far)))


def deviations(
    mean: Quaternion, q: Quaternion, count: Int[Array, ""] | None = None
) -> Float[Array, "time joint 3"]:
    """v of the module, of one clip f[T, J, 4], of which the first ``count`` frames count."""
    q = quaternion.align_signs(q)
    counts = counting(count, len(q))[:, None, None]
    nearer = jnp.sum(q * mean, axis=(0, -1), keepdims=True, where=counts) < 0
    away = quaternion.between(mean, jnp.where(nearer, -q, q))
    cosine, axis = away[..., 0], away[..., 1:]
    squared = jnp.sum(axis**2, axis=-1)
    around = (cosine < 0) & (squared < _FULL_TURN)
    length = angle_over_sine(jnp.where(around, 0, squared), jnp.where(around, 1, cosine))
    return jnp.where(around[..., None], 0, length[..., None] * axis)


def interpolate(styles: Sequence[MotionStyle], weights: ArrayLike) -> MotionStyle:
    """A style between others, or beyond them.

    Differentiable in styles and weights.

    **Arguments:** ``styles``: K of the same joints; ``weights``: f[K], which are divided by their
    sum; below 0 they lead away from a style.
    **Returns:** :class:`MotionStyle`, in the first style's dtype.
    **Raises:** ``ValueError`` for no styles, styles of other joints, weights of another shape or
    that are known to sum to 0.

    **Example:** a walk and a half more of what tells it from a run:

        >>> import jaxmotion as jm
        >>> walk, run = (jm.samples.load(name).motion[:60] for name in ("walk", "run"))
        >>> styles = [jm.style.motion_style(clip) for clip in (walk, run)]
        >>> beyond = jm.style.interpolate(styles, [1.5, -0.5])
        >>> speed = lambda style: float((style.root_mean[:2] ** 2).sum() ** 0.5)
        >>> speed(beyond) < speed(styles[0]) < speed(styles[1])
        True
    """
    styles = list(styles)
    if not styles:
        raise ValueError("interpolate: no styles; expected one at least")
    for style in styles:
        instance_of("interpolate: styles", style, MotionStyle, "a MotionStyle (motion_style)")
    for style in styles[1:]:
        if (style.joints, style.up) != (styles[0].joints, styles[0].up):
            raise ValueError("interpolate: styles of other joints, or with another axis up")
    if np.shape(weights) != (len(styles),):
        raise ValueError(
            f"interpolate: weights have shape {np.shape(weights)}; want ({len(styles)},)"
        )
    kind = jnp.asarray(styles[0].mean).dtype
    total = known(weights).sum()
    w = jnp.asarray(weights, kind)
    w = require(w, ~(abs(total) > 0), "interpolate: weights sum to 0", got=weights)
    return mixed(styles, w / jnp.sum(w))


@eqx.filter_jit
def mixed(styles: list[MotionStyle], share: Float[Array, " style"]) -> MotionStyle:
    """:func:`interpolate` by weights that sum to 1."""
    kind = share.dtype
    gathered = jax.tree.map(lambda *x: jnp.stack([jnp.asarray(a, kind) for a in x]), *styles)
    means = gathered.mean
    first = means[0]

    def step(m, _):
        away = jnp.einsum("k,kja->ja", share, quaternion.log(quaternion.between(m, means)))
        return quaternion.normalize(quaternion.multiply(m, quaternion.exp(away))), None

    middle, _ = jax.lax.scan(step, first, None, length=_STEPS)
    root = jnp.einsum("k,kjab->jab", share, square_root(gathered.covariance))
    root = symmetric_function(jax.nn.relu, root)
    return MotionStyle(
        styles[0].joints,
        middle,
        root @ root,
        share @ gathered.root_mean,
        jnp.maximum(share @ gathered.root_deviation, 0),
        styles[0].root_upright,
        _weighted_product(gathered.tempo, share),
        up=styles[0].up,
    )


def _weighted_product(tempo: Float[Array, " style"], share: Float[Array, " style"]) -> Array:
    """The weighted product, 0 where one is still."""
    still = jnp.any(tempo <= 0)
    return jnp.where(still, 0, jnp.exp(share @ jnp.log(jnp.where(tempo > 0, tempo, 1))))


def square_root(covariance: Float[AnyArray, "*batch 3 3"]) -> Float[Array, "*batch 3 3"]:
    """√C, whose derivative is 0 in directions that are still."""
    still = float(jnp.finfo(jnp.asarray(covariance).dtype).eps) ** 1.5

    def root(w: Array) -> Array:
        moves = w > still
        return jnp.where(moves, jnp.sqrt(jnp.where(moves, w, 1)), 0)

    return symmetric_function(root, covariance)

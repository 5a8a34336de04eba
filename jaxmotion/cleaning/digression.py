"""How far each joint is, in each frame, from what it does elsewhere in words like this one.

Every group of joints (:func:`joint_groups`) is searched for by itself (:func:`nearest_words`). With
T the texture and T̄ its mean over all neighbours of the words that cover a frame,

    r = log(T̄⁻¹ T) − median over the clip,      M = ‖r‖,      the least of the groups'

The median is what the joint always does otherwise than the others: another performer's posture. The
least, as an error in one joint spoils the search of every group that holds it, and no other.

    MDM = 1 − 2^(−(M/s)²)     s: the size at which it is ½, of each joint
    MDM = 1 − exp(−(‖log(T̄⁻¹ T)‖/mean over the clip)²)     "row_mean", the paper's

The paper's calls a third of a clean clip an error: its rows have mean 1, whatever is in them.

Words are of frames about 1/24 s apart: every n-th of the clip's and the context's. Between them T̄
is interpolated, so that every frame is judged. Source: Aristidou et al. 2018, §4. O(T·P·J) for P
frames in all.
"""

from collections.abc import Iterator, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxmotion._checks import one_of, static
from jaxmotion._entry import a_motion
from jaxmotion._portable import Portable
from jaxmotion._posture import upright
from jaxmotion._stored import StoredClips
from jaxmotion._summary import some
from jaxmotion._types import AnyArray, ArrayLike
from jaxmotion.cleaning.elsewhere import elsewhere, mean_texture
from jaxmotion.cleaning.groups import as_clips, groups_of, one_skeleton
from jaxmotion.cleaning.neighbours import Neighbours, nearest_words
from jaxmotion.cleaning.parts import connection, needs_corpus
from jaxmotion.cleaning.search import Metric, Progress
from jaxmotion.cleaning.stored import After, Shown, Thin, places
from jaxmotion.cleaning.turns import between, vectors_between
from jaxmotion.cleaning.words import texture
from jaxmotion.motion import Motion

if TYPE_CHECKING:
    from distributed import Client

Normalise: TypeAlias = Literal["scale", "row_mean"]

WORD = 15  # frames
TARGET = 20
FPS = 24.0
HALF = 0.5  # radians


class Digression(Portable):
    """How far a clip of T frames is from its neighbours. Joints that are in no group of joints, and
    frames that no word with neighbours covers, digress by 0.

    **Fields:** ``digression``: f[T, J], M, radians; ``mdm``: f[T, J], from 0 to 1; ``residual``:
    f[T, J, 3], r; ``texture``: f[T, J, 4], T̄ of the group of least M; ``neighbours``:
    :class:`Neighbours` by group, of every ``step``-th frame of the clip and of the context.
    """

    digression: Float[AnyArray, "time joint"]
    mdm: Float[AnyArray, "time joint"]
    residual: Float[AnyArray, "time joint 3"]
    texture: Float[AnyArray, "time joint 4"]
    neighbours: dict[str, Neighbours]
    step: int = eqx.field(static=True)

    def _words(self) -> Iterator[str]:
        yield some(self.digression.shape[0], "frame")
        yield some(self.digression.shape[1], "joint")
        yield some(len(self.neighbours), "group")


@static("k", "normalise", "metric")
def digression_map(
    motion: Motion,
    context: Motion | Sequence[Motion] = (),
    *,
    k: int = 8,
    normalise: Normalise = "scale",
    scale: ArrayLike = HALF,
    metric: Metric = "pose",
    client: "Client | str | None" = None,
    keep: str | PathLike | None = None,
    progress: Progress | None = None,
) -> Digression:
    """How far every joint is, in every frame, from what it does elsewhere in the same motion.

    On the host; not differentiable, not under ``jit``. Of a corpus that is larger than memory no
    more is kept than the frames that neighbours show; it comes to what the list of its clips does,
    bit for bit.

    **Arguments:** ``motion``: one clip, T frames; ``context``: clips of the same joints at any
    rate, or a :class:`jaxmotion.corpus.Corpus`; ``k``: how many neighbours of each word;
    ``normalise``: "scale", an MDM of ½ where a joint is s from its neighbours' mean, or "row_mean",
    the paper's, where it is 0.83 times as far as it is on average; ``scale``: s, radians, one
    number or f[J]; ``metric``: what words are compared by, ``client``: who searches a corpus,
    ``keep``: a folder for what is found in its parts, all as :func:`nearest_words`; ``progress``:
    called with how many words are done, and how many there are, of all groups.
    **Returns:** :class:`Digression`.
    **Raises:** ``ValueError`` for what is traced or not finite, clips of other joints, a scale that
    is not above 0; what :func:`nearest_words` raises for a ``client``.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk = jm.samples.load("walk", fps=24.0, num_frames=96).motion
        >>> found = jm.cleaning.digression_map(walk)
        >>> bool(found.mdm.max() < 0.5)
        True
    """
    caller = "digression_map"
    one_of(f"{caller}: normalise", normalise, ("scale", "row_mean"))
    a_motion(caller, motion)
    sizes = np.asarray(scale, np.float64)
    if sizes.shape not in ((), (motion.num_joints,)) or not (sizes > 0).all():
        raise ValueError(f"{caller}: scale={scale}; expected radians above 0, one or one a joint")
    needs_corpus(caller, context, client, keep)
    setting = settled(caller, motion, context)
    with connection(client) as there:
        found = searched(setting, k, progress, metric, client=there, keep=keep)
    setting = _with_what_is_shown(setting, found)
    judged = digressed(setting, found, np.zeros(setting.textures[0].shape[:2], bool))
    if normalise == "row_mean":
        plain = np.linalg.norm(judged.plain, axis=-1)
        middle = plain.mean(axis=0)
        mdm = 1 - np.exp(-((plain / np.where(middle > 0, middle, 1)) ** 2))
    else:
        sizes = np.broadcast_to(sizes, motion.num_joints)[list(setting.joints)]
        mdm = 1 - 2 ** -((np.linalg.norm(judged.residual, axis=-1) / sizes) ** 2)
    return as_digression(setting, found, judged, mdm)


class Setting(NamedTuple):
    """A clip beside its context. ``clips``: thinned, the clip's first, then the context's or one
    corpus; ``joints``: those that tell; ``own``: the clip's texture of these, f[T, J, 4], at its
    own rate; ``textures``: of the thinned clips, of a corpus only what is shown, when it is known;
    ``step``: frames of the clip from one of the thinned to the next."""

    motion: Motion
    clips: Sequence[Motion]
    context: Sequence[Motion]
    groups: dict[str, tuple[int, ...]]
    joints: tuple[int, ...]
    own: np.ndarray
    textures: list[np.ndarray]
    step: int


def settled(caller: str, motion: Motion, context: Motion | Sequence[Motion]) -> Setting:
    """The clip beside its context, at one rate of about 24 frames a second."""
    if isinstance(context, StoredClips):
        (clip,) = one_skeleton(caller, motion)
        if context.skeleton.names != motion.skeleton.names:
            raise ValueError(f"{caller}: the corpus has other joints than the motion")
        every, step = _steps(float(context[0].fps), float(motion.fps))
        thin, groups = [clip[::step]], groups_of(After(clip, context))
        rest: Sequence[Motion] = Thin(context, every, thin[0].frame_time)
    else:
        clips = one_skeleton(caller, [motion, *as_clips(context)])
        step, thin = thinned(clips)
        groups, rest = groups_of(clips), thin[1:]
    joints = groups.get("whole", ())
    stands = upright(motion)
    own, *textures = (
        np.asarray(texture(clip, joints, stands)) if joints else np.zeros((clip.num_frames, 0, 4))
        for clip in [motion, *thin]
    )
    return Setting(motion, thin, rest, groups, joints, own, textures, step)


def _with_what_is_shown(setting: Setting, found: dict[str, Neighbours]) -> Setting:
    """The setting, with those frames of a corpus that neighbours show."""
    if not isinstance(setting.context, StoredClips):
        return setting
    shown = places(found.values())
    stands = upright(setting.motion)
    own = setting.textures[0]
    return setting._replace(textures=Shown(own, setting.context, setting.joints, stands, shown))


def thinned(clips: Sequence[Motion]) -> tuple[int, list[Motion]]:
    """The clips at one rate of about 24 frames a second, and every how many-th frame of the first
    that takes. What is left of a difference of rates is one of speeds, which words are warped over
    anyway."""
    pairs = [_steps(float(clip.fps), float(clips[0].fps)) for clip in clips]
    thin = [clip[::every] for clip, (every, _) in zip(clips, pairs, strict=True)]
    return pairs[0][1], [clip.replace(frame_time=thin[0].frame_time) for clip in thin]


def _steps(fps: float, own: float) -> tuple[int, int]:
    """Every how many-th frame is taken of a clip, and of the clip that it stands beside."""
    step = max(1, round(own / FPS))
    return max(1, round(fps / (own / step))), step


def searched(
    setting: Setting,
    k: int,
    progress: Progress | None,
    metric: Metric = "pose",
    *,
    client: Any = None,
    keep: str | PathLike | None = None,
) -> dict[str, Neighbours]:
    """The neighbours of the thinned clip's words, of every group."""
    many = len(setting.groups)
    found: dict[str, Neighbours] = {}
    for done, (name, joints) in enumerate(setting.groups.items()):
        told = None if progress is None else _told(progress, done, many)
        found[name] = nearest_words(
            setting.clips[0],
            setting.context,
            k=k,
            length=WORD,
            target=TARGET,
            joints=joints,
            metric=metric,
            client=client,
            keep=keep,
            progress=told,
        )
    return found


def _told(progress: Progress, before: int, many: int) -> Progress:
    """Progress of one of several searches, as of all of them."""
    return lambda done, words: progress(before * words + done, many * words)


class Digressed(NamedTuple):
    """Of the joints that tell: ``residual`` r and ``plain``, log(T̄⁻¹ T), f[T, J, 3]; ``texture``
    T̄ f[T, J, 4]."""

    residual: np.ndarray
    plain: np.ndarray
    texture: np.ndarray


def digressed(
    setting: Setting, found: dict[str, Neighbours], left_out: Bool[np.ndarray, "thinned joint"]
) -> Digressed:
    """The digression of every frame, without what is ``left_out`` of the thinned clip."""
    shape = setting.own.shape
    least = Digressed(np.full((*shape[:2], 3), np.inf), np.zeros((*shape[:2], 3)), setting.own)
    known = np.zeros(shape[:2], bool)
    for name, neighbours in found.items():
        shown = elsewhere(neighbours, len(setting.textures[0]))
        mean, there = mean_texture(shown, setting.textures, left_out)
        mean, there = (at_every_frame(x, shape[0], setting.step) for x in (mean, there))
        plain = vectors_between(mean, setting.own)
        residual = plain - _medians(plain, there)
        here = there & np.isin(setting.joints, setting.groups[name])
        here &= np.linalg.norm(residual, axis=-1) < np.linalg.norm(least.residual, axis=-1)
        new = Digressed(residual, plain, mean)
        least = Digressed(
            *(np.where(here[..., None], a, b) for a, b in zip(new, least, strict=True))
        )
        known |= here
    residual = np.where(known[..., None], least.residual, 0)
    return Digressed(residual, least.plain, least.texture)


def _medians(plain: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Of each joint over the frames that are judged; 0 where none is."""
    if not there.any():
        return np.zeros(plain.shape[1:])
    seen = np.where(there[..., None], plain, np.nan)
    seen[:, ~there.any(axis=0)] = 0
    return np.nanmedian(seen, axis=0)


def at_every_frame(values: np.ndarray, frames: int, step: int) -> np.ndarray:
    """Of every ``step``-th frame, rotations or what is known, at all of them; going on at the end
    as before it."""
    if step == 1 or len(values) == 1:
        return np.repeat(values, step, axis=0)[:frames]
    at = np.arange(frames) / step
    before = np.minimum(at.astype(int), len(values) - 2)
    if values.dtype == bool:
        return values[before] & values[before + 1]
    way = np.broadcast_to((at - before).astype(values.dtype)[:, None], (frames, values.shape[1]))
    return between(values[before], values[before + 1], way)


def as_digression(
    setting: Setting, found: dict[str, Neighbours], judged: Digressed, mdm: np.ndarray
) -> Digression:
    """Of all joints of the skeleton."""
    kind = setting.motion.dtype
    joints = np.array(setting.joints, int)
    shape = setting.motion.rotations.shape[:2]

    def whole(values: np.ndarray, rest: np.ndarray):
        rest[:, joints] = values
        return jnp.asarray(rest, kind)

    return Digression(
        whole(np.linalg.norm(judged.residual, axis=-1), np.zeros(shape)),
        whole(mdm, np.zeros(shape)),
        whole(judged.residual, np.zeros((*shape, 3))),
        whole(judged.texture, np.array(setting.motion.rotations)),
        found,
        setting.step,
    )

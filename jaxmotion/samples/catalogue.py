"""The clips by name, and a clean clip with its noisy twin."""

from collections.abc import Callable

import jax

from jaxmotion._checks import one_of, static
from jaxmotion._types import ScalarLike
from jaxmotion.samples.actions import dance, idle, jump, kick
from jaxmotion.samples.corruptions import Corrupted, add_noise, not_negative
from jaxmotion.samples.gaits import quadruped_trot, quadruped_walk, run, walk
from jaxmotion.samples.posing import Sample

_CLIPS: dict[str, Callable[..., Sample]] = {
    clip.__name__: clip
    for clip in (walk, run, idle, kick, jump, dance, quadruped_walk, quadruped_trot)
}


def names() -> tuple[str, ...]:
    """The names of the clips that :func:`load` knows: "walk", "run" and so on.

    **Returns:** a tuple of strings.
    """
    return tuple(_CLIPS)


def load(name: str, **options) -> Sample:
    """The clip called ``name``.

    **Arguments:** ``name``: one of :func:`names`; ``options``: arguments of the function of that
    name, such as ``num_frames=100``.
    **Returns:** a :class:`Sample`.
    **Raises:** ``ValueError``, listing the names, if there is none; as the function otherwise.
    """
    one_of("load: name", name, _CLIPS)
    return _CLIPS[name](**options)


@static("seed")
def clean_and_noisy(
    name: str = "walk",
    *,
    rotation: ScalarLike = 0.02,
    translation: ScalarLike = 0.005,
    seed: int = 0,
    **options,
) -> tuple[Sample, Corrupted]:
    """A clip and the same with white noise on every rotation and on the root's position.

    **Arguments:** ``name``: one of :func:`names`; ``rotation``: standard deviation of each
    component of the noise, radians; ``translation``: the same in metres; ``seed``: of clip and
    noise; ``options``: as :func:`load`.
    **Returns:** the clean :class:`Sample` and the :class:`Corrupted`.
    **Raises:** ``ValueError`` as :func:`load` and :func:`add_noise`.
    """
    one_of("clean_and_noisy: name", name, _CLIPS)
    sample = load(name, seed=seed, **options)
    not_negative("clean_and_noisy", sample.motion, rotation=rotation, translation=translation)
    noise_key = jax.random.key(seed)
    return sample, add_noise(sample.motion, noise_key, rotation=rotation, translation=translation)

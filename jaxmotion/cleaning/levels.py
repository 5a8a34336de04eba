"""What is usual in clips that are sound: how far joints digress and jump there."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxmotion._checks import known, static
from jaxmotion._portable import Portable
from jaxmotion._summary import some
from jaxmotion.cleaning.digression import Digressed, Setting, digressed, searched, settled
from jaxmotion.cleaning.foretold import foretold_residual
from jaxmotion.cleaning.groups import as_clips
from jaxmotion.cleaning.jumps import held, leaps, paired, turns
from jaxmotion.cleaning.missing import filled
from jaxmotion.cleaning.neighbours import Neighbours
from jaxmotion.motion import Motion


class Levels(Portable):
    """The most that each joint of a clip does. In joints that tell nothing the first two are 0.

    **Fields:** ``digression``: f[J], radians from its neighbours; ``foretold``: f[J], radians from
    what the other joints foretell; ``jump``: f[J], radians, there and back.
    """

    digression: Float[Array, " joint"]
    foretold: Float[Array, " joint"]
    jump: Float[Array, " joint"]

    def _words(self) -> Iterator[str]:
        yield some(self.jump.shape[0], "joint")


@static("k")
def clean_levels(motion: Motion, context: Motion | Sequence[Motion] = (), *, k: int = 8) -> Levels:
    """What is usual in a clip that is taken for sound, beside its context. For
    :func:`detect_errors`, which measures its own context so, each clip beside the others; of a
    folder every file can be measured once.

    On the host; not differentiable, not under ``jit``.

    **Arguments:** ``motion``, ``context``, ``k``: as :func:`digression_map`; entries that are not
    finite do not count.
    **Returns:** :class:`Levels`.
    **Raises:** ``ValueError`` as :func:`digression_map`.

    **Example:**

        >>> import jaxmotion as jm
        >>> walk = jm.samples.load("walk", fps=24.0, num_frames=96).motion
        >>> jm.cleaning.clean_levels(walk)
        Levels(22 joints)
    """
    return levels_of(examined("clean_levels", motion, context, k))


def levels_of(evidence: "Evidence") -> Levels:
    """What is usual in a clip, by what is known of it."""
    motion = evidence.setting.motion
    joints = np.array(evidence.setting.joints, int)
    kind = motion.dtype

    def most(values: np.ndarray) -> Array:
        every = np.zeros(motion.num_joints)
        every[joints] = values.max(axis=0)
        return jnp.asarray(every, kind)

    judged, foretold = weighed(evidence, np.zeros_like(evidence.missing))
    return Levels(
        most(np.linalg.norm(judged.residual, axis=-1)),
        most(np.linalg.norm(foretold, axis=-1)),
        jnp.asarray(evidence.pair.max(axis=0), kind),
    )


class Evidence(NamedTuple):
    """What is known of a clip whatever is in error in it: its ``setting`` and neighbours; which
    entries are ``missing``; of all joints jumps and speeds f[T − 1, J], pairs f[T, J], holds i[T,
    J]."""

    setting: Setting
    found: dict[str, Neighbours]
    missing: Bool[np.ndarray, "time joint"]
    jump: np.ndarray
    speed: np.ndarray
    pair: np.ndarray
    hold: np.ndarray


def examined(
    caller: str, motion: Motion, context: Motion | Sequence[Motion], k: int, progress=None
) -> Evidence:
    """All that does not depend on what is left out."""
    whole, missing = filled(caller, motion)
    setting = settled(caller, whole, [filled(caller, clip)[0] for clip in as_clips(context)])
    rotations, fps = np.asarray(known(whole.rotations)), float(motion.fps)
    found, leap = searched(setting, k, progress), leaps(rotations)
    rest = [np.asarray(known(clip.rotations)) for clip in setting.clips[1:]]
    return Evidence(
        setting,
        found,
        missing,
        jump=np.linalg.norm(leap, axis=-1),
        speed=fps * turns(rotations),
        pair=paired(rotations, leap, fps),
        hold=held(rotations, fps, rest),
    )


def weighed(
    evidence: Evidence, left_out: Bool[np.ndarray, "time joint"]
) -> tuple[Digressed, np.ndarray]:
    """The digression, and the residual of what the other joints foretell, of the joints that tell,
    without what is ``left_out`` or missing."""
    setting = evidence.setting
    out = (left_out | evidence.missing)[:, np.array(setting.joints, int)]
    judged = digressed(setting, evidence.found, out[:: setting.step])
    taught = [setting.own, *setting.textures[1:]]
    return judged, foretold_residual(taught, setting.step, out)

"""Spikes of a capture: a joint leaves its path in one frame and is back within three.

A marker that is lost or taken for another throws a joint off and lets it come back; a foot that
pushes off moves as far at 30 frames a second, but swells before or swings on after. A run of one to
three frames is a spike if it stands out,

    d = min(least angle to the bridge, 10/7 of each of the two edges)

    bridge   whichever is nearer: the chord from the frame before the run to the one after, or the
             cubic through the two before and the two after

and no step, edges and within, is four times d (a turn that stays has one edge), by more than

    2.75·r         r: the largest bend ‖x(t−1) − 2x(t) + x(t+1)‖ of the three frames on each side
    min(f, 15°)    f: the joint's usual largest step from frame to frame
    min(2·h, 40°)  h: the joint's usual largest d

"Usual": the third largest in eight frames (the largest of every eight, sorted), so that what
comes back with every step is the joint's own and up to two spikes are not. The angles are those
of 30 frames a second; at n they are 30/n of them: speeds of 450 and 1200 degrees a second, gained
and lost within three frames. Translations have no such bounds.

The bends around leave out frames that are suspect themselves: those of runs that stand out by three
times as much as the path goes on by. What is beside a suspect frame is not judged without it. The
first or last frame, or one beside a gap, has one edge and needs 1200 degrees a second. Of three
samples none can be told to be the wrong one.

Shapes: x f[T, J, C], unit quaternions of any signs or positions. O(T·J). A choice: no gradient.
"""

from collections.abc import Iterable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxmotion import quaternion
from jaxmotion._numerics import safe_norm

_LONGEST = 3
_AROUND = 3
_ROUGH = 2.75
_EDGE = 0.7
_UNEVEN = 4.0
_SUSPECT = 3.0
_BLOCK = 8
_USUAL = 2  # the third largest
_OFTEN = 2.0
_FAST = float(np.radians(450.0))
_GROSS = float(np.radians(1200.0))
_CALM = float(np.radians(0.3))


def spikes(
    x: Float[Array, "frame joint channel"],
    there: Bool[Array, "frame joint"],
    frame_time: Float[Array, ""],
    *,
    turning: bool,
) -> Bool[Array, "frame joint"]:
    """Which samples are of a spike; ``there``: which count; ``turning``: x are quaternions."""
    x = jax.lax.stop_gradient(x)
    there = there & (jnp.sum(there, axis=0) > 3)
    lengths = range(1, _LONGEST + 1)
    runs = [_Run(x, there, length, turning) for length in lengths]
    beside = there & _at(there, -1)
    step = jnp.where(beside, _apart(x, _at(x, -1), turning), jnp.nan)
    typical = jnp.nanmedian(step, axis=0)
    suspect = _any(
        _covered(run.out > _SUSPECT * (run.across + typical), run.length) for run in runs
    )
    bend = _bends(x, there, suspect, turning)
    fastest = _usual(jnp.nan_to_num(step))
    if turning:
        fastest = jnp.minimum(fastest, _FAST * frame_time)
        gross, calm = _GROSS * frame_time, _CALM
    else:
        eps = 64 * float(jnp.finfo(x.dtype).eps)
        size = jnp.max(jnp.where(there[..., None], jnp.abs(x), 0), axis=(0, 2))
        gross, calm = jnp.inf, eps * size + float(jnp.finfo(x.dtype).tiny)

    def found(run: "_Run") -> Array:
        sides = (k for n in range(2, _AROUND + 2) for k in (-n, run.length - 1 + n))
        rough = jnp.max(jnp.stack([_at(bend, k) for k in sides]), axis=0)
        own = jnp.minimum(_OFTEN * _usual(run.out), gross)
        limit = jnp.maximum(_ROUGH * jnp.maximum(rough, calm), jnp.maximum(fastest, own))
        limit = jnp.where(run.inside, limit, jnp.maximum(limit, gross))
        whole = ~_at(suspect, -1) & ~_at(suspect, run.length)
        return _covered((run.out > limit) & whole, run.length)

    return _any(found(run) for run in runs)


class _Run:
    """For runs of ``length`` frames, by the frame they begin at: ``out``, d, 0 where there is none;
    ``across``: from the frame before to the one after; ``inside``: whether both are there."""

    def __init__(self, x: Array, there: Array, length: int, turning: bool):
        before, after = _at(there, -1), _at(there, length)
        a = jnp.where(before[..., None], _at(x, -1), _at(x, length))
        b = _towards(a, jnp.where(after[..., None], _at(x, length), a), turning)
        a2 = _towards(a, jnp.where(_at(there, -2)[..., None], _at(x, -2), a), turning)
        b2 = _towards(
            b, jnp.where(_at(there, length + 1)[..., None], _at(x, length + 1), b), turning
        )
        self.length, self.inside, self.across = length, before & after, _apart(a, b, turning)
        judged = self.inside
        if length == 1:
            judged = judged | before & _at(there, -2) & _at(there, -3)
            judged = judged | after & _at(there, 2) & _at(there, 3)
        out = jnp.full(there.shape, jnp.inf, x.dtype)
        for k in range(length):
            judged = judged & _at(there, k)
            for bridge in _bridges(a2, a, b, b2, k + 1, length):
                out = jnp.minimum(out, _apart(bridge, _at(x, k), turning))
        left = jnp.where(before, _apart(a, x, turning), jnp.inf)
        back = jnp.where(after, _apart(b, _at(x, length - 1), turning), jnp.inf)
        out = jnp.minimum(out, jnp.minimum(left, back) / _EDGE)
        longest = jnp.maximum(left, back)
        for k in range(1, length):
            longest = jnp.maximum(longest, _apart(_at(x, k - 1), _at(x, k), turning))
        returns = ~self.inside | (longest < _UNEVEN * out)
        self.out = jnp.where(judged & returns, out, 0)


def _bridges(a2: Array, a: Array, b: Array, b2: Array, at: int, length: int) -> tuple[Array, Array]:
    """The chord and the cubic at ``at`` frames after a, when b comes ``length`` + 1 after it."""
    places = (-1.0, 0.0, length + 1.0, length + 2.0)
    shares = [np.prod([(at - q) / (p - q) for q in places if q != p]) for p in places]
    cubic = sum(float(share) * x for share, x in zip(shares, (a2, a, b, b2), strict=True))
    share = at / (length + 1)
    return (1 - share) * a + share * b, jnp.asarray(cubic)


def _bends(x: Array, there: Array, suspect: Array, turning: bool) -> Array:
    """‖x(t−1) − 2x(t) + x(t+1)‖ where all three are there and none is suspect, else 0."""
    before, after = _at(x, -1), _towards(_at(x, -1), _at(x, 1), turning)
    sound = there & ~suspect
    return jnp.where(
        sound & _at(sound, -1) & _at(sound, 1),
        2 * _apart(0.5 * (before + after), x, turning),
        0,
    )


def _usual(x: Array) -> Array:
    """Of each column, the third largest of the maxima of eight frames each."""
    frames, columns = x.shape
    blocks = max(-(-frames // _BLOCK), _USUAL + 1)
    padded = jnp.pad(x, ((0, blocks * _BLOCK - frames), (0, 0)))
    largest = jnp.max(padded.reshape(blocks, _BLOCK, columns), axis=1)
    return jnp.sort(largest, axis=0)[blocks - 1 - _USUAL]


def _at(x: Array, k: int) -> Array:
    """x(t + k), 0 (or False) beyond the ends."""
    frames = x.shape[0]
    pad = ((max(-k, 0), max(k, 0)), *((0, 0),) * (x.ndim - 1))
    return jax.lax.slice_in_dim(jnp.pad(x, pad), max(k, 0), max(k, 0) + frames)


def _covered(starts: Array, length: int) -> Array:
    """The frames of runs that begin where ``starts`` is set."""
    return _any(_at(starts, -k) for k in range(length))


def _any(masks: Iterable[Array]) -> Array:
    return jnp.any(jnp.stack(list(masks)), axis=0)


def _apart(a: Array, b: Array, turning: bool) -> Array:
    return quaternion.distance(a, b) if turning else safe_norm(a - b)


def _towards(a: Array, b: Array, turning: bool) -> Array:
    """b, or −b if that is the same rotation and nearer to a."""
    opposite = turning & (jnp.sum(a * b, axis=-1, keepdims=True) < 0)
    return jnp.where(opposite, -b, b)

"""What a smoother removed, in rows for people: how much of each joint, and whether it was noise.

With a rotation q as it was and p as it is now, what was removed is

    v = log(p⁻¹q)         f[T, J, 3], rotation vectors in the joint's frame

and noise that a smoother does well to remove is white. It leaves no trace in v but one: a smoother
keeps what is slow, noise too, so that v lacks it and its correlations

    cₖ = Σ vₜ₊ₖ·vₜ / Σ ‖vₜ‖²

are below 0, c₁ further than c₂ (those of noise that passed a high-pass filter). Of noise that is
slower than white, c₁ lies above 0, or above c₂, which the smoother lowers as much. Sums are over
the n frames in which the joint changed, and

    correlation    c₁ − min(c₂, 0)                 0 or less; error √(k·tr C²/n)/tr C with C = Σ vvᵀ
                                                   and k = 1, or 2 where c₂ < 0
    lean           ‖Σ ‖v‖v‖ / Σ ‖v‖²               0; error √(Σ ‖v‖⁴) / Σ ‖v‖²
    contact        mean ‖v‖² in contact / out      1; error of its logarithm s·√(1/n_in + 1/n_out),
                                                   s the deviation of ‖v‖² over its mean

are what white noise has of each, on average, and its standard error. (The mean of v itself tells
nothing: a smoother of second differences leaves it 0.) On the host, float64, O(T·J).
"""

from collections.abc import Iterator
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from jaxmotion._checks import instance_of
from jaxmotion._entry import check_result, not_finite
from jaxmotion._numerics import rounding_angle
from jaxmotion._summary import brief, called, line
from jaxmotion._types import AnyArray
from jaxmotion.motion import Motion

_CLEAR = 0.1  # of correlation and lean
_TIMES = 2.0  # of the mean square in contact, or out of it
_ERRORS = 3.0  # standard errors


@runtime_checkable
class Touching(Protocol):
    """What is asked of contacts: :class:`jaxmotion.contacts.Contacts` have it."""

    @property
    def mask(self) -> AnyArray:
        """bool[T, C], in contact."""
        ...

    @property
    def joints(self) -> tuple[int, ...]:
        """Index of each point's joint."""
        ...


class Removal(NamedTuple):
    """What was removed of a joint's rotation; of the frames in which it changed.

    **Fields:** ``joint``: by name; ``degrees``: the largest angle between a frame's rotation as it
    was and as it is now; ``frame``, from 0, and ``seconds``: where that is; ``typical``: the root
    mean square of these angles, degrees; ``share``: of the variance of the rotation about its mean,
    0 to 1; ``correlation``: of one frame's with the next one's, 0 or less for white noise, 1 for
    what lasts; ``lean``: how one-sided it is, 0 as much one way as the other, 1 all one way;
    ``contact``: how many times as much, by mean square, while something touches at the joint or
    below it, None where nothing ever or always does, and without contacts; ``stands_out``: which
    of the last three are not those of white noise, by name.
    """

    joint: str
    degrees: float
    frame: int
    seconds: float
    typical: float
    share: float
    correlation: float
    lean: float
    contact: float | None
    stands_out: tuple[str, ...]

    @property
    def white(self) -> bool:
        """Whether it may be white noise: nothing stands out."""
        return not self.stands_out

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        yield called([self.joint])
        yield f"{brief(self.degrees)}° at frame {brief(self.frame)}"
        yield f"typically {brief(self.typical)}°"
        yield f"share {brief(self.share)}"
        yield (
            ", ".join(f"{name} {brief(getattr(self, name))}" for name in self.stands_out) or "white"
        )


def removed(
    motion: Motion, result: Motion, *, contacts: Touching | None = None
) -> tuple[Removal, ...]:
    """List what was removed of the rotations, joint by joint, and what of it is no white noise.

    A correlation or a lean stands out above 0.1 and above three standard errors of white noise; a
    contact above 2 or below ½, if also by three of its logarithm. Such is noise with a colour of
    its own, a movement that was taken for noise, an error that comes with contacts.

    **Arguments:** ``motion``: one clip, as it was; frames that are not finite were missing, and do
    not count; ``result``: as it is now; ``contacts``: :class:`~jaxmotion.contacts.Contacts` of it,
    whose joints and all above them are in contact.
    **Returns:** a :class:`Removal` a joint that was turned by more than rounding, the one turned
    furthest first.
    **Raises:** ``ValueError`` for what are no two clips of one shape, a result that is not finite,
    and contacts of another clip; ``TypeError`` inside ``jit``.
    """
    check_result("removed", motion, result, contacts)
    before, after = (np.asarray(m.rotations, np.float64) for m in (motion, result))
    if odd := not_finite(motion.skeleton.names, "rotations", after):
        raise ValueError(f"removed: result.{odd}; expected finite numbers")
    before = np.where(np.isfinite(before).all(axis=-1, keepdims=True), before, after)
    v = _vectors(after, before)
    touches = {} if contacts is None else _touches(motion, contacts)
    spread = np.sum(_vectors(_means(before), before) ** 2, axis=(0, 2))
    angles = np.linalg.norm(v, axis=-1)
    changed = angles > rounding_angle(motion.dtype)
    rows = [
        _removal(motion, j, v[:, j], changed[:, j], spread[j], touches.get(j))
        for j in np.flatnonzero(changed.any(axis=0)).tolist()
    ]
    return tuple(sorted(rows, key=lambda row: -row.degrees))


def _vectors(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """log(p⁻¹q) of unit quaternions f[..., 4], exact for tiny angles."""
    w = np.sum(p * q, axis=-1, keepdims=True)
    u = p[..., :1] * q[..., 1:] - q[..., :1] * p[..., 1:] - np.cross(p[..., 1:], q[..., 1:])
    sine = np.linalg.norm(u, axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, np.abs(w))
    return np.where(w < 0, -u, u) * np.divide(angle, sine, out=2 + 0 * sine, where=sine > 0)


def _means(q: np.ndarray) -> np.ndarray:
    """Chordal means over time, f[J, 4]."""
    return np.linalg.eigh(np.einsum("tja,tjb->jab", q, q))[1][..., -1]


def _touches(motion: Motion, contacts: Touching) -> dict[int, np.ndarray]:
    """b[T] of each joint with contact points on it or below it: whether any of them touches."""
    expected = "jaxmotion.contacts.Contacts (jaxmotion.contacts.detect finds them)"
    instance_of("removed: contacts", contacts, Touching, expected)
    mask = np.asarray(contacts.mask)
    if mask.shape != (motion.num_frames, len(contacts.joints)):
        raise ValueError(
            f"removed: contacts has a mask of shape {mask.shape}; expected "
            f"({motion.num_frames}, {len(contacts.joints)}), (frames, points)"
        )
    found: dict[int, np.ndarray] = {}
    for joint, touch in zip(contacts.joints, mask.T, strict=True):
        while joint >= 0:
            found[joint] = found.get(joint, False) | touch
            joint = motion.skeleton.parents[joint]
    return found


def _removal(
    motion: Motion,
    joint: int,
    v: np.ndarray,
    changed: np.ndarray,
    spread: float,
    touches: np.ndarray | None,
) -> Removal:
    """The row of a joint; ``v``: f[T, 3], some of which ``changed``; ``spread``: Σ of the squared
    angles from its mean."""
    squares = np.sum(v * v, axis=-1)
    total, n = np.sum(squares), int(np.sum(changed))
    frame = int(np.argmax(squares))
    correlation, correlation_error = _correlation(v, n)
    lean = np.linalg.norm(np.sqrt(squares) @ v) / total
    lean_error = np.sqrt(np.sum(squares**2)) / total
    contact, contact_error = _contact(squares, changed, touches)
    apart = {
        "correlation": correlation > max(_CLEAR, _ERRORS * correlation_error),
        "lean": lean > max(_CLEAR, _ERRORS * lean_error),
        "contact": abs(np.log(contact or 1)) > max(np.log(_TIMES), _ERRORS * contact_error),
    }
    return Removal(
        joint=motion.skeleton.names[joint],
        degrees=float(np.degrees(np.sqrt(squares[frame]))),
        frame=frame,
        seconds=float(frame * np.asarray(motion.frame_time)),
        typical=float(np.degrees(np.sqrt(total / n))),
        share=float(total / max(spread, total)),
        correlation=float(correlation),
        lean=float(lean),
        contact=contact,
        stands_out=tuple(name for name, is_apart in apart.items() if is_apart),
    )


def _correlation(v: np.ndarray, n: int) -> tuple[float, float]:
    """c₁ − min(c₂, 0), and its error."""
    scatter = v.T @ v
    total = np.trace(scatter)
    c1, c2 = (np.sum(v[k:] * v[:-k]) / total for k in (1, 2))
    error = np.sqrt((2 if c2 < 0 else 1) * np.sum(scatter**2) / n) / total
    return c1 - min(c2, 0), error


def _contact(
    squares: np.ndarray, changed: np.ndarray, touches: np.ndarray | None
) -> tuple[float | None, float]:
    """How many times larger the mean square is in contact, and the error of its logarithm."""
    if touches is None or not (changed & touches).any() or not (changed & ~touches).any():
        return None, 0.0
    inside, outside = squares[changed & touches], squares[changed & ~touches]
    deviation = np.std(squares[changed]) / np.mean(squares[changed])
    error = deviation * np.sqrt(1 / len(inside) + 1 / len(outside))
    return float(np.mean(inside) / np.mean(outside)), float(error)

"""Steady gaits along an arc: a person's walk and run, a dog's walk and trot.

A foot of phase f strikes at times (n + f)·period, period = stride/speed, n whole, and stays for
``duty`` of a period. It is put where the body will be ``lead`` of a period after the strike, beside
the path

    x(t) + i·z(t) = speed·t·sinc(ψ/2)·(sin ψ/2 + i·cos ψ/2),   ψ = turning·t   (an arc; a line at 0)

The pelvis follows the path, rises and falls once a step, sways over the standing foot and turns
with the leading leg; spine and arms turn against it. Metres, seconds,
radians. O(T).
"""

from typing import NamedTuple

import numpy as np

from jaxmotion._checks import static
from jaxmotion.samples.footsteps import Plants, Roll, follow
from jaxmotion.samples.posing import Number, Sample, check_timing, make_sample, place_arm, trunk
from jaxmotion.samples.rotations import about, sway, turn
from jaxmotion.samples.skeletons import Leg, biped_rig, quadruped_rig
from jaxmotion.skeleton import Skeleton


class _Gait(NamedTuple):
    """Timing as fractions of a period, and how large the body's movements are (metres, radians)."""

    duty: float
    lead: float
    flat: float
    heel_off: float
    roll: Roll
    rise: float
    crouch: float
    lean: float
    arm_swing: float
    elbow: float


_WALK = _Gait(
    duty=0.62,
    lead=0.27,
    flat=0.07,
    heel_off=0.40,
    roll=Roll(strike_pitch=0.30, toe_off_pitch=0.65, clearance=0.08),
    rise=0.02,
    crouch=0.0,
    lean=0.04,
    arm_swing=0.38,
    elbow=0.28,
)
_RUN = _Gait(
    duty=0.36,
    lead=0.15,
    flat=0.06,
    heel_off=0.15,
    roll=Roll(strike_pitch=0.15, toe_off_pitch=0.80, clearance=0.26, swing_pitch=0.2),
    rise=0.035,
    crouch=0.03,
    lean=0.18,
    arm_swing=0.65,
    elbow=1.45,
)


@static("num_frames", "seed")
def walk(
    num_frames: int = 240,
    *,
    fps: Number = 60.0,
    speed: Number = 1.25,
    stride: Number = 1.3,
    turning: Number = 0.0,
    seed: int = 0,
    dtype=None,
) -> Sample:
    """A person walking, from a left heel strike at the origin, along +Z.

    **Arguments:** ``num_frames``: T; ``fps``: frames a second; ``speed``: metres a second;
    ``stride``: metres from a left strike to the next; ``turning``: radians a second, left positive;
    ``seed``: of small irregularities of step and posture, 0 or more; ``dtype``: float32 or float64,
    JAX's default when absent.
    **Returns:** a :class:`Sample` with six contact points (heels, balls, toes).
    **Raises:** ``ValueError`` for a number of frames, rate, speed or stride that is not positive, a
    turning that is not finite, a negative seed, a dtype as for :func:`idle`, or a stride the legs
    cannot make.
    """
    return _two_legs("walk", _WALK, num_frames, fps, speed, stride, turning, seed, dtype)


@static("num_frames", "seed")
def run(
    num_frames: int = 240,
    *,
    fps: Number = 60.0,
    speed: Number = 3.2,
    stride: Number = 2.3,
    turning: Number = 0.0,
    seed: int = 0,
    dtype=None,
) -> Sample:
    """A person running, with both feet in the air between steps.

    **Arguments:** ``num_frames``, ``fps``, ``speed``, ``stride``, ``turning``, ``seed``, ``dtype``:
    as :func:`walk`.
    **Returns:** a :class:`Sample` with six contact points (heels, balls, toes).
    **Raises:** ``ValueError`` as :func:`walk`.
    """
    return _two_legs("run", _RUN, num_frames, fps, speed, stride, turning, seed, dtype)


@static("num_frames", "seed")
def quadruped_walk(
    num_frames: int = 240,
    *,
    fps: Number = 60.0,
    speed: Number = 0.8,
    stride: Number = 0.62,
    turning: Number = 0.0,
    seed: int = 0,
    dtype=None,
) -> Sample:
    """A dog walking: left hind, left front, right hind, right front, a quarter period apart.

    **Arguments:** ``num_frames``, ``fps``, ``speed``, ``stride``, ``turning``, ``seed``, ``dtype``:
    as :func:`walk`.
    **Returns:** a :class:`Sample` with four contact points (paws).
    **Raises:** ``ValueError`` as :func:`walk`.
    """
    phases, duty = (0.0, 0.5, 0.25, 0.75), 0.65
    return _four_legs(
        "quadruped_walk", phases, duty, num_frames, fps, speed, stride, turning, seed, dtype
    )


@static("num_frames", "seed")
def quadruped_trot(
    num_frames: int = 240,
    *,
    fps: Number = 60.0,
    speed: Number = 1.9,
    stride: Number = 0.95,
    turning: Number = 0.0,
    seed: int = 0,
    dtype=None,
) -> Sample:
    """A dog trotting: diagonal legs together, in the air between.

    **Arguments:** ``num_frames``, ``fps``, ``speed``, ``stride``, ``turning``, ``seed``, ``dtype``:
    as :func:`walk`.
    **Returns:** a :class:`Sample` with four contact points (paws).
    **Raises:** ``ValueError`` as :func:`walk`.
    """
    phases, duty = (0.0, 0.5, 0.5, 0.0), 0.44
    return _four_legs(
        "quadruped_trot", phases, duty, num_frames, fps, speed, stride, turning, seed, dtype
    )


def _two_legs(caller, gait: _Gait, num_frames, fps, speed, stride, turning, seed, dtype) -> Sample:
    t = check_timing(caller, num_frames, fps, seed, speed=speed, stride=stride)
    _check_turning(caller, turning)
    rng = np.random.default_rng(seed)
    skeleton, legs = biped_rig()
    period = stride / speed
    feet = []
    for leg, phase, side in zip(legs, (0.0, 0.5), (0.095, -0.095), strict=True):
        beside = np.array([side, 0.0, -0.01])
        toes_out = 0.1 * np.sign(side)
        steps = np.random.default_rng((seed, leg.hip))
        plan = _plants(t, phase, gait, period, speed, turning, beside, toes_out, steps)
        feet.append(follow(plan, leg.heel, leg.ball, gait.roll, t))

    cycle = 2.0 * np.pi * t / period
    ahead = np.cos(cycle - 0.15)  # +1 when the left leg leads
    over_left = np.sin(cycle)  # +1 in the middle of the left stance
    bounce = np.cos(2.0 * (cycle - 2.0 * np.pi * gait.lead))
    sign = 1.0 if gait is _WALK else -1.0  # a walk is highest over the foot, a run lowest
    root, heading = _path(t, speed, turning)
    across = heading @ np.array([1.0, 0.0, 0.0])
    root = root + (0.022 * over_left + sway(rng, t, 0.004))[:, None] * across
    root[:, 1] = 0.95 - gait.crouch + sign * gait.rise * bounce

    yaw, roll, bank = -0.09 * ahead, 0.05 * over_left, _bank(speed, turning)
    twist = 0.22 * ahead + sway(rng, t, 0.02)
    nod = sway(rng, t, 0.03)
    bow = gait.lean + 0.015 * np.sin(2.0 * cycle)
    local = trunk(
        skeleton,
        num_frames,
        spine=(twist, bow, -0.8 * roll),
        head=(-yaw - twist, -0.7 * bow + nod, -0.2 * roll - 0.5 * bank),
    )
    pelvis = turn("yzx", yaw, roll + bank, 0.4 * gait.lean + 0.02 * bounce)
    local[:, 0] = heading @ pelvis
    for side, other in (("Left", -1.0), ("Right", 1.0)):
        forward = other * np.cos(cycle - 0.3)
        swing = gait.arm_swing * (forward - 0.15) + sway(rng, t, 0.03)
        elbow = gait.elbow + 0.16 * (1.0 + forward)
        place_arm(local, skeleton, side, swing, 0.14 + 0.02 * over_left, elbow, 0.0)
    return make_sample(caller, skeleton, legs, feet, root, local, fps, dtype)


def _four_legs(
    caller, phases, duty, num_frames, fps, speed, stride, turning, seed, dtype
) -> Sample:
    t = check_timing(caller, num_frames, fps, seed, speed=speed, stride=stride)
    _check_turning(caller, turning)
    rng = np.random.default_rng(seed)
    skeleton, legs = quadruped_rig()
    period = stride / speed
    feet = [
        _paw(skeleton, leg, t, phase, duty, period, speed, turning, seed)
        for leg, phase in zip(legs, phases, strict=True)
    ]
    cycle = 2.0 * np.pi * t / period
    root, heading = _path(t, speed, turning)
    hind = np.cos(cycle)
    sideways = heading @ np.array([1.0, 0.0, 0.0])
    root = root + (0.012 * np.sin(cycle) + sway(rng, t, 0.003))[:, None] * sideways
    root[:, 1] = 0.50 + 0.010 * np.cos(2.0 * (cycle - np.pi * duty))
    bend = 0.10 * hind + sway(rng, t, 0.02)
    nod = 0.06 * np.sin(2.0 * cycle + 0.5) + sway(rng, t, 0.05)
    local = trunk(skeleton, num_frames, spine=(bend, 0.03 * np.sin(2 * cycle), 0.0))
    local[:, 0] = heading @ turn("yzx", -0.05 * hind, 0.03 * np.sin(cycle), 0.0)
    local[:, skeleton.index("Neck")] = turn("yx", -0.5 * bend, nod)
    local[:, skeleton.index("Head")] = about("x", -0.8 * nod)
    wag = 0.25 * np.sin(2.0 * cycle) + sway(rng, t, 0.1, 0.5)
    for name in ("Tail", "Tail1"):
        local[:, skeleton.index(name)] = turn("yx", wag, 0.15)
    for side, phase in (("Left", phases[2]), ("Right", phases[3])):
        reach = -0.18 * np.cos(cycle - 2.0 * np.pi * phase)
        local[:, skeleton.index(f"{side}Shoulder")] = about("x", reach)
    return make_sample(caller, skeleton, legs, feet, root, local, fps, dtype)


def _paw(skeleton: Skeleton, leg: Leg, t, phase, duty, period, speed, turning, seed):
    hind = leg.bend > 0
    roll = Roll(
        strike_pitch=0.25 if hind else 0.15,
        toe_off_pitch=0.55 if hind else 0.8,
        clearance=0.06,
        swing_pitch=0.35 if hind else 0.7,
    )
    gait = _Gait(duty, 0.5 * duty, 0.35 * duty, 0.45 * duty, roll, *(0.0,) * 5)
    beside = _rest_position(skeleton, leg.ankle)
    beside[0] *= 0.85
    beside[2] += 0.0 if hind else -0.02
    steps = np.random.default_rng((seed, leg.hip))
    plan = _plants(t, phase, gait, period, speed, turning, beside, 0.0, steps, jitter=0.004)
    return follow(plan, leg.heel, leg.ball, roll, t)


def _rest_position(skeleton, joint):
    position = np.zeros(3)
    while joint > 0:
        position += skeleton.offsets[joint]
        joint = skeleton.parents[joint]
    return position


def _path(t, speed, turning):
    """Place on the floor f[T, 3] and heading f[T, 3, 3] at times t."""
    half = 0.5 * turning * t
    chord = speed * t * np.sinc(half / np.pi)
    place = np.stack([chord * np.sin(half), np.zeros_like(t), chord * np.cos(half)], axis=-1)
    return place, about("y", 2.0 * half)


def _plants(
    t, phase, gait: _Gait, period, speed, turning, beside, toes_out, rng, jitter=0.008
) -> Plants:
    first = np.floor(t[0] / period) - 2
    count = int(np.ceil(t[-1] / period) - first) + 2
    strike = (first + phase + np.arange(count)) * period
    place, heading = _path(strike + gait.lead * period, speed, turning)
    ground = (place + heading @ np.array([beside[0], 0.0, beside[2]]))[:, [0, 2]]
    ground = ground + rng.uniform(-jitter, jitter, ground.shape)
    return Plants(
        strike=strike,
        flat=strike + gait.flat * period,
        heel_off=strike + gait.heel_off * period,
        toe_off=strike + gait.duty * period,
        place=ground,
        yaw=turning * (strike + gait.lead * period) + toes_out,
    )


def _bank(speed, turning):
    """Lean into a turn: its sideways acceleration against gravity, at most 0.3 rad."""
    return -float(np.clip(speed * turning / 9.81, -0.3, 0.3))


def _check_turning(caller, turning):
    if not (np.ndim(turning) == 0 and np.isfinite(turning)):
        raise ValueError(f"{caller}: turning={turning!r}; expected a number of radians per second")

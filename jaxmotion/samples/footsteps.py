"""Where the feet are: planted exactly, rolling over heel and ball, or swinging.

A foot stands at its plants, one after the other. With a = (t − strike)/(flat − strike) and
b = (t − heel_off)/(toe_off − heel_off), both clipped to [0, 1], its pitch (toes down positive)
about the ground point it turns on is

    p(t) = −θ (1 − a)² + φ b²,      pivot: the heel until ``flat``, then the ball

so the pivot does not move at all. Toes lie flat while the ball is down. Between toe-off and the
next strike the ball follows a cubic Hermite curve over u ∈ [0, 1], matched in place and velocity
at both ends, at the height

    y(u) = w(u) y_heel(p(u)) + 16 c u²(1 − u)²,   w = u²(3 − 2u)

where y_heel(p) is the ball's height with the heel on the floor: heel, ball and toes leave and
reach the floor with velocity zero and finite acceleration, and stay above it in between.

Symbols: θ strike pitch, φ toe-off pitch, c clearance. Shapes: frames T, plants P. Metres, seconds,
radians. O(T).
"""

from typing import NamedTuple

import numpy as np

from jaxmotion.samples.rotations import about

FOREVER = 1e9


class Plants(NamedTuple):
    """The plants of one foot, in order of time.

    ``strike ≤ flat ≤ heel_off < toe_off``: f[P] seconds; ``place``: f[P, 2], x and z of the ankle
    over the flat foot; ``yaw``: f[P], heading of the foot.
    """

    strike: np.ndarray
    flat: np.ndarray
    heel_off: np.ndarray
    toe_off: np.ndarray
    place: np.ndarray
    yaw: np.ndarray


class Roll(NamedTuple):
    """How a foot rolls and swings: θ, φ (radians), c (metres), extra pitch mid-swing (radians)."""

    strike_pitch: float
    toe_off_pitch: float
    clearance: float
    swing_pitch: float = 0.0


class FootPath(NamedTuple):
    """A foot in the world: ``ankle`` f[T, 3], ``foot``, ``toes`` f[T, 3, 3] (world rotations).

    ``heel_down``, ``ball_down``: bool[T], exact; ``swing``: f[T], progress from toe-off (0) to
    strike (1), 0 while planted.
    """

    ankle: np.ndarray
    foot: np.ndarray
    toes: np.ndarray
    heel_down: np.ndarray
    ball_down: np.ndarray
    swing: np.ndarray


def standing(place, yaw) -> Plants:
    """One plant for all time; ``place``: x and z of the ankle."""
    return steps((), [place], [yaw], roll=(0.0, 0.0))


def steps(lifts, places, yaws, *, roll: tuple[float, float]) -> Plants:
    """Standing, then one step for every pair (toe-off, strike) in ``lifts``, then standing.

    **Arguments:** ``lifts``: (S, 2) seconds; ``places``: (S + 1, 2); ``yaws``: (S + 1,);
    ``roll``: seconds from heel-off to toe-off and from strike to flat.
    """
    lifts = np.reshape(np.asarray(lifts, float), (-1, 2))
    strike = np.concatenate([[-2 * FOREVER], lifts[:, 1]])
    toe_off = np.concatenate([lifts[:, 0], [2 * FOREVER]])
    flat = strike + np.where(strike < -FOREVER, FOREVER, roll[1])
    heel_off = toe_off - np.where(toe_off > FOREVER, FOREVER, roll[0])
    return Plants(
        strike, flat, heel_off, toe_off, np.asarray(places, float), np.asarray(yaws, float)
    )


def follow(plants: Plants, heel, ball, roll: Roll, t: np.ndarray) -> FootPath:
    """The foot at times t.

    **Arguments:** ``heel`` (None for a paw) and ``ball``: f[3], in the foot's frame, on its sole;
    ``t``: f[T], no earlier than the first strike, no later than the last toe-off.
    """
    now = np.clip(np.searchsorted(plants.strike, t, side="right") - 1, 0, len(plants.yaw) - 1)
    after = np.minimum(now + 1, len(plants.yaw) - 1)
    in_stance = t <= plants.toe_off[now]
    on_heel = in_stance & (t < plants.flat[now]) & (heel is not None)
    stance = _stance(plants, now, heel, ball, roll, t, on_heel)
    u = np.where(in_stance, 0.0, (t - plants.toe_off[now]) / _swing_time(plants, now, after))
    swing = _swing(plants, now, after, heel, ball, roll, np.clip(u, 0.0, 1.0))
    ankle, foot, toes = (
        np.where(in_stance.reshape((-1,) + (1,) * (s.ndim - 1)), s, w)
        for s, w in zip(stance, swing, strict=True)
    )
    return FootPath(
        ankle=ankle,
        foot=foot,
        toes=toes,
        heel_down=in_stance & (t <= plants.heel_off[now]),
        ball_down=in_stance & ~on_heel,
        swing=u,
    )


def _swing_time(plants, now, after):
    duration = plants.strike[after] - plants.toe_off[now]
    return np.where(after > now, duration, 1.0)


def _pivot_place(plants, which, point, height):
    """World position of a point of the sole of the flat foot of plant ``which``: f[T, 3]."""
    place = plants.place[which]
    ground = np.stack([place[:, 0], np.full(len(place), height), place[:, 1]], axis=-1)
    return ground + about("y", plants.yaw[which]) @ point


def _stance(plants, now, heel, ball, roll, t, on_heel):
    a = np.clip((t - plants.strike[now]) / (plants.flat - plants.strike)[now], 0.0, 1.0)
    b = np.clip((t - plants.heel_off[now]) / (plants.toe_off - plants.heel_off)[now], 0.0, 1.0)
    pitch = -roll.strike_pitch * (1.0 - a) ** 2 + roll.toe_off_pitch * b**2
    yaw = about("y", plants.yaw[now])
    foot = yaw @ about("x", pitch)
    toes = yaw @ about("x", np.where(on_heel, pitch, 0.0))
    point = np.where(on_heel[:, None], ball if heel is None else heel, ball)
    height = -ball[1]
    pivot = np.where(
        on_heel[:, None],
        _pivot_place(plants, now, ball if heel is None else heel, height),
        _pivot_place(plants, now, ball, height),
    )
    ankle = pivot - (foot @ point[:, :, None])[:, :, 0]
    return ankle, foot, toes


def _swing(plants, now, after, heel, ball, roll, u):
    duration = _swing_time(plants, now, after)
    leave = 2.0 * roll.toe_off_pitch / (plants.toe_off - plants.heel_off)[now]
    arrive = 2.0 * roll.strike_pitch / (plants.flat - plants.strike)[after]
    ends = (roll.toe_off_pitch, leave * duration, -roll.strike_pitch, arrive * duration)
    bump = 16.0 * u**2 * (1.0 - u) ** 2
    pitch = _hermite(u, *ends) + roll.swing_pitch * bump
    rise = u**2 * (3.0 - 2.0 * u)
    heading = about("y", plants.yaw[now] + rise * (plants.yaw[after] - plants.yaw[now]))
    foot = heading @ about("x", pitch)

    height = -ball[1]
    start = _pivot_place(plants, now, ball, height)
    if heel is None:
        goal, velocity, lift, curl = _pivot_place(plants, after, ball, height), 0.0, 0.0, 0.0 * u
    else:
        reach = ball - heel
        turned = about("x", np.full(1, -roll.strike_pitch))[0] @ reach
        target_yaw = about("y", plants.yaw[after])
        goal = _pivot_place(plants, after, heel, height) + target_yaw @ turned
        sideways = target_yaw @ np.cross([1.0, 0.0, 0.0], turned)
        velocity = sideways * (arrive * duration)[:, None]
        lift = (about("x", pitch) @ reach)[:, 1]
        curl = _hermite(u, 0.0, 0.0, *ends[2:])
    place = _hermite(u[:, None], start, 0.0, goal, velocity)
    place[:, 1] = rise * lift + roll.clearance * bump
    return place - foot @ ball, foot, heading @ about("x", curl)


def _hermite(u, value0, slope0, value1, slope1):
    """Cubic on [0, 1] with these values and slopes (in u) at its ends."""
    blend = u * u * (3.0 - 2.0 * u)
    return (
        value0
        + blend * (value1 - value0)
        + u * (1.0 - u) ** 2 * slope0
        - u * u * (1.0 - u) * slope1
    )

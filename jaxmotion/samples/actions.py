"""A person on the spot: standing idle, kicking, jumping, dancing.

Each is a plan in seconds, so a clip of fewer frames is the beginning of a longer one up to a
constant height (see :mod:`jaxmotion.samples.posing`). The pelvis runs on C² curves between keys;
a leg in the air gets, on top of its planned step, joint rotations made of the C² bumps
(1 − x²)³, which vanish with two derivatives at toe-off and strike. Metres, seconds, radians. O(T).
"""

import numpy as np

from jaxmotion._checks import static
from jaxmotion.samples.footsteps import Roll, follow, standing, steps
from jaxmotion.samples.posing import Number, Sample, check_timing, make_sample, place_arm, trunk
from jaxmotion.samples.rotations import about, bump, ease, keyed, sway, turn
from jaxmotion.samples.skeletons import biped_rig

_HEIGHT = 0.945  # of the hips over the floor, standing at ease
_STANCE = 0.11  # half the distance between the feet
_TOES_OUT = 0.12
_STEP = Roll(strike_pitch=0.12, toe_off_pitch=0.5, clearance=0.08)


@static("num_frames", "seed")
def idle(num_frames: int = 240, *, fps: Number = 60.0, seed: int = 0, dtype=None) -> Sample:
    """A person standing, both feet planted throughout, shifting weight, breathing, looking about.

    **Arguments:** ``num_frames``: T; ``fps``: frames a second; ``seed``: of the wandering, 0 or
    more; ``dtype``: float32 or float64, JAX's default when absent.
    **Returns:** a :class:`Sample` with six contact points (heels, balls, toes), all planted.
    **Raises:** ``ValueError`` for a number of frames or a rate that is not positive, a negative
    seed, a dtype other than float32 and float64, or float64 where JAX has its 64-bit types off.
    """
    t = check_timing("idle", num_frames, fps, seed)
    rng = np.random.default_rng(seed)
    skeleton, legs = biped_rig()
    feet = [
        follow(standing((x, 0.0), yaw), leg.heel, leg.ball, _STEP, t)
        for leg, x, yaw in zip(legs, (_STANCE, -_STANCE), (_TOES_OUT, -_TOES_OUT), strict=True)
    ]
    side = sway(rng, t, 0.035, 0.15)
    root = np.stack([side, _HEIGHT + sway(rng, t, 0.004, 0.25), sway(rng, t, 0.015)], axis=-1)
    breath = 0.015 * np.sin(2.0 * np.pi * 0.25 * t)
    twist, look = sway(rng, t, 0.06, 0.12), sway(rng, t, 0.45, 0.15)
    local = trunk(
        skeleton,
        num_frames,
        spine=(twist, 0.02 - breath, 0.8 * side),
        head=(look, sway(rng, t, 0.1), sway(rng, t, 0.05)),
    )
    local[:, 0] = turn("yzx", sway(rng, t, 0.06, 0.1), -0.8 * side, sway(rng, t, 0.02))
    for name in ("Left", "Right"):
        swing, lift = sway(rng, t, 0.07), 0.16 + sway(rng, t, 0.04)
        elbow = 0.25 + sway(rng, t, 0.12)
        place_arm(local, skeleton, name, swing, lift, elbow, spread=0.8 * breath)
    return make_sample("idle", skeleton, legs, feet, root, local, fps, dtype)


@static("num_frames", "seed")
def kick(
    num_frames: int = 150,
    *,
    fps: Number = 60.0,
    height: Number = 1.6,
    speed: Number = 1.0,
    seed: int = 0,
    dtype=None,
) -> Sample:
    """A person kicking forward with the right leg, once every 2.5/speed seconds.

    Weight goes over the left foot, the right leg draws back with its knee bent, then hip and knee
    swing through more than π/2 within a quarter of a second, and the foot returns to its place.

    **Arguments:** ``height``: radians the hip flexes at the top, up to 2; ``speed``: tempo;
    ``num_frames``, ``fps``, ``seed``, ``dtype``: as :func:`idle`.
    **Returns:** a :class:`Sample` with six contact points.
    **Raises:** ``ValueError`` for a height or speed that is not positive, a height of more than 2,
    and as :func:`idle`.
    """
    t = check_timing("kick", num_frames, fps, seed, height=height, speed=speed)
    if height > 2.0:
        raise ValueError(f"kick: height={height!r}; a hip flexes by at most 2 radians")
    rng = np.random.default_rng(seed)
    skeleton, legs = biped_rig()
    beat = 2.5 / speed
    kicks = int(np.ceil(t[-1] / beat)) + 1
    lifts = (np.arange(kicks)[:, None] * 2.5 + [0.70, 1.65]) / speed
    spot = np.array([-_STANCE, -0.12])
    plan = steps(
        lifts,
        np.tile(spot, (kicks + 1, 1)),
        np.full(kicks + 1, -3 * _TOES_OUT),
        roll=(0.18 / speed, 0.12 / speed),
    )
    left, right = legs
    feet = [
        follow(standing((_STANCE, 0.05), _TOES_OUT), left.heel, left.ball, _STEP, t),
        follow(plan, right.heel, right.ball, _STEP, t),
    ]
    now = (t % beat) * speed
    u = feet[1].swing
    back, through = bump(u, 0.24, 0.24), bump(u, 0.50, 0.30)
    extra = {
        right.hip: about("x", 0.55 * back - height * through),
        right.knee: about("x", 1.35 * back - 0.42 * through + 0.7 * bump(u, 0.74, 0.22)),
        right.ankle: about("x", 0.5 * through),
    }

    onto_left = ease(now, 0.1, 0.7) - ease(now, 1.55, 2.3)
    wind_up = ease(now, 0.3, 0.92) - ease(now, 0.95, 1.2)
    strike = ease(now, 0.9, 1.22) - ease(now, 1.3, 2.0)
    root = np.stack(
        [
            -0.01 + 0.095 * onto_left + sway(rng, t, 0.008, 0.2),
            _HEIGHT - 0.02 * onto_left - 0.015 * wind_up + 0.015 * strike,
            -0.03 + 0.08 * onto_left + 0.03 * strike,
        ],
        axis=-1,
    )
    yaw = -0.35 * wind_up + 0.45 * strike
    local = trunk(
        skeleton,
        num_frames,
        spine=(-1.1 * yaw + sway(rng, t, 0.03), 0.05 + 0.2 * strike, -0.08 * onto_left),
        head=(0.1 * yaw, 0.05 + 0.1 * strike + sway(rng, t, 0.04), 0.0),
    )
    local[:, 0] = turn("yzx", yaw, 0.07 * onto_left, 0.06 * wind_up - 0.22 * strike)
    left_swing = 0.35 * wind_up + 0.2 * onto_left - 0.3 * strike + sway(rng, t, 0.04)
    right_swing = -0.3 * wind_up - 0.5 * strike + sway(rng, t, 0.04)
    place_arm(
        local, skeleton, "Left", left_swing, 0.2 + 0.75 * onto_left, 0.4 + 0.5 * onto_left, 0.05
    )
    place_arm(
        local, skeleton, "Right", right_swing, 0.2 + 0.5 * onto_left, 0.4 + 0.4 * onto_left, 0.05
    )
    return make_sample("kick", skeleton, legs, feet, root, local, fps, dtype, extra)


@static("num_frames", "seed")
def jump(
    num_frames: int = 150,
    *,
    fps: Number = 60.0,
    height: Number = 0.35,
    distance: Number = 0.5,
    seed: int = 0,
    dtype=None,
) -> Sample:
    """A person jumping forward from both feet, once every 2.5 seconds.

    **Arguments:** ``height``: metres the hips rise above standing, up to 0.6; ``distance``: metres
    forward a jump, up to 1.2; ``num_frames``, ``fps``, ``seed``, ``dtype``: as :func:`idle`.
    **Returns:** a :class:`Sample` with six contact points.
    **Raises:** ``ValueError`` for a height or distance that is not positive or beyond these bounds,
    and as :func:`idle`.
    """
    t = check_timing("jump", num_frames, fps, seed, height=height, distance=distance)
    for name, value, most in (("height", height, 0.6), ("distance", distance, 1.2)):
        if value > most:
            raise ValueError(f"jump: {name}={value!r}; a jump's {name} is at most {most} metres")
    rng = np.random.default_rng(seed)
    skeleton, legs = biped_rig()
    beat = 2.5
    jumps = int(np.ceil(t[-1] / beat)) + 1
    lifts = np.arange(jumps)[:, None] * beat + [0.80, 1.38]
    roll = Roll(strike_pitch=0.10, toe_off_pitch=0.75, clearance=height + 0.02, swing_pitch=0.25)
    feet = []
    for leg, x, yaw in zip(legs, (_STANCE, -_STANCE), (_TOES_OUT, -_TOES_OUT), strict=True):
        places = np.stack([np.full(jumps + 1, x), np.arange(jumps + 1) * distance], axis=-1)
        plan = steps(lifts, places, np.full(jumps + 1, yaw), roll=(0.2, 0.1))
        feet.append(follow(plan, leg.heel, leg.ball, roll, t))
    now = t % beat
    times = (0.05, 0.50, 0.80, 1.09, 1.38, 1.62, 2.3)
    dip = keyed(now, times, (0.0, -0.30, -0.08, 0.0, -0.06, -0.26, 0.0))
    rise = dip + height * bump(now, 1.09, 0.42)
    forward = np.floor(t / beat) + ease(now, 0.55, 1.60)
    back = 0.5 * dip**2  # the hips go back as they go down
    root = np.stack(
        [sway(rng, t, 0.006), _HEIGHT + rise, 0.01 + distance * forward - back], axis=-1
    )
    bow = keyed(now, times, (0.03, 0.65, 0.0, 0.0, 0.1, 0.5, 0.03))
    local = trunk(
        skeleton,
        num_frames,
        spine=(sway(rng, t, 0.03), bow, sway(rng, t, 0.02)),
        head=(sway(rng, t, 0.05), -0.7 * bow, 0.0),
    )
    local[:, 0] = turn("yx", sway(rng, t, 0.02), 0.7 * bow)
    swing = keyed(now, (0.05, 0.48, 0.95, 1.25, 1.75, 2.35), (0.0, -0.7, 2.1, 1.9, 0.3, 0.0))
    elbow = keyed(now, (0.05, 0.48, 0.95, 1.70, 2.35), (0.25, 0.35, 0.6, 0.8, 0.25))
    for side in ("Left", "Right"):
        place_arm(local, skeleton, side, swing + sway(rng, t, 0.04), 0.18, elbow, 0.0)
    return make_sample("jump", skeleton, legs, feet, root, local, fps, dtype)


@static("num_frames", "seed")
def dance(
    num_frames: int = 360,
    *,
    fps: Number = 60.0,
    tempo: Number = 110.0,
    seed: int = 0,
    dtype=None,
) -> Sample:
    """A person dancing: a step on every other beat, left and right in turn, to seeded places.

    Hips roll with the beat, the body turns with the steps, arms circle to above the head.

    **Arguments:** ``tempo``: beats a minute; ``num_frames``, ``fps``, ``seed``, ``dtype``: as
    :func:`idle`.
    **Returns:** a :class:`Sample` with six contact points.
    **Raises:** ``ValueError`` for a tempo that is not positive, and as :func:`idle`.
    """
    t = check_timing("dance", num_frames, fps, seed, tempo=tempo)
    rng = np.random.default_rng(seed)
    skeleton, legs = biped_rig()
    beat = 60.0 / tempo
    rounds = int(np.ceil(t[-1] / (4.0 * beat))) + 1  # a round: one step of either foot
    roll = Roll(strike_pitch=0.1, toe_off_pitch=0.6, clearance=0.12)
    feet, middles, facing = [], [], []
    # A row of draws a round, so that a longer clip begins with the shorter one.
    drawn = np.random.default_rng((seed, 1)).uniform(-1.0, 1.0, (rounds, 5))
    drawn = np.concatenate([np.zeros((1, 5)), drawn])
    turns = np.cumsum(0.55 * drawn[:, 0])
    centres = 0.18 * drawn[:, 1:3]
    widths = _STANCE + 0.05 * drawn[:, 3:] + 0.03
    for leg, sign, width, start in zip(legs, (1.0, -1.0), widths.T, (0.6, 2.6), strict=True):
        lifts = (np.arange(rounds)[:, None] * 4.0 + [start, start + 0.9]) * beat
        sideways = np.stack([np.cos(turns), -np.sin(turns)], axis=-1)
        places = centres + sign * width[:, None] * sideways
        yaws = turns + sign * (_TOES_OUT + 0.1)
        plan = steps(lifts, places, yaws, roll=(0.3 * beat, 0.2 * beat))
        feet.append(follow(plan, leg.heel, leg.ball, roll, t))
        keys = np.concatenate([[0.0], lifts.mean(axis=1)])
        middles.append(keyed(t, keys, places))
        facing.append(keyed(t, keys, turns))

    pulse = 2.0 * np.pi * t / beat
    lean_left = np.sin(0.25 * pulse - 2.0 * np.pi * 0.38)  # over the left foot as the right steps
    middle, yaw = 0.5 * (middles[0] + middles[1]), 0.5 * (facing[0] + facing[1])
    heading = about("y", yaw)
    root = np.stack([middle[:, 0], 0.91 + 0.018 * np.cos(pulse), middle[:, 1]], axis=-1)
    root = root + (0.05 * lean_left)[:, None] * heading[:, :, 0]
    twist = 0.22 * np.sin(0.5 * pulse) + sway(rng, t, 0.1)
    tip = 0.12 * np.sin(0.5 * pulse + 0.8)
    local = trunk(
        skeleton,
        num_frames,
        spine=(-1.6 * twist, 0.08 + 0.06 * np.cos(pulse), -1.4 * tip),
        head=(0.8 * twist, sway(rng, t, 0.15), 0.8 * tip),
    )
    local[:, 0] = heading @ turn("yzx", twist, tip, 0.06 * np.sin(pulse))
    for side, phase in (("Left", 0.0), ("Right", np.pi)):
        wave = 0.25 * pulse + phase
        lift = 1.25 + 0.95 * np.sin(wave) + sway(rng, t, 0.15)
        swing = 0.35 + 0.55 * np.cos(wave) + sway(rng, t, 0.15)
        elbow = 0.85 + 0.6 * np.sin(0.5 * pulse + phase)
        place_arm(local, skeleton, side, swing, lift, elbow, 0.12 * (1.0 + np.sin(wave)))
    return make_sample("dance", skeleton, legs, feet, root, local, fps, dtype)

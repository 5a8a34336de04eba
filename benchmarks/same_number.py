"""The same number elsewhere: what docs/elsewhere.md says of other libraries, asserted.

    python -m venv peers && peers/bin/pip install . SciPy tslearn dtaidistance librosa dtw-python \
        aeon statsmodels jaxlie upc-pymotion
    peers/bin/python benchmarks/same_number.py

Small inputs that it makes itself, float64. A line a relation: the peers, the relation, the largest
difference (absolute for angles in radians, else over the largest value) and what it may be. "is
not" lines assert that two numbers differ. A peer that is not there is skipped, with a word. Exit
status 1 if a relation does not hold. No peer is an extra of this package for it, or part of CI.
"""

import importlib
import inspect
import sys
import warnings
from importlib.metadata import version
from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jax.scipy.spatial.transform import Rotation as JaxRotation
from scipy import interpolate, signal
from scipy.spatial.transform import Rotation, Slerp

import jaxmotion as jm

jax.config.update("jax_enable_x64", True)
warnings.simplefilter("ignore")
quaternion, smoothing, timing = jm.quaternion, jm.smoothing, jm.timing
wrong: list[str] = []

ORDERS = [a + b + c for a, b, c in product("XYZ", repeat=3) if a != b != c]


def peer(module: str, package: str | None = None) -> Any:
    """A module, and None with a word where it is not there."""
    try:
        found = importlib.import_module(module)
    except ImportError as error:
        print(f"{package or module}: skipped, {error}")
        return None
    print(f"{package or module} {version(package or module)}")
    return found


def same(relation: str, ours, theirs, within: float = 1e-12) -> None:
    """Assert that the two are one number, to ``within`` of the largest value."""
    a, b = np.asarray(ours, float), np.asarray(theirs, float)
    off = np.abs(a - b).max() / max(np.abs(b).max(), 1e-300)
    _tell(relation, off, "within", within, off <= within)


def differ(relation: str, ours, theirs, more: float) -> None:
    """Assert that the two are not one number, by ``more`` of the largest value."""
    a, b = np.asarray(ours, float), np.asarray(theirs, float)
    off = np.abs(a - b).max() / max(np.abs(b).max(), 1e-300)
    _tell(relation, off, "more than", more, off > more)


def turned(relation: str, ours, theirs, within: float = 1e-12) -> None:
    """Assert that quaternions wxyz are one rotation, to ``within`` radians."""
    off = float(jnp.max(quaternion.distance(jnp.asarray(ours), jnp.asarray(theirs))))
    _tell(relation, off, "within", within, off <= within)


def holds(relation: str, true: object) -> None:
    """Assert what is no number."""
    _tell(relation, 0.0, "", 0.0, bool(true))


def _tell(relation: str, off: float, word: str, limit: float, good: bool) -> None:
    figures = f"{off:9.1e} {word} {limit:.0e}" if word else ""
    print(f"  {'   ' if good else 'NO '}{relation:108} {figures}")
    if not good:
        wrong.append(relation)


def warping() -> None:
    """``dtw`` and its relations."""
    t = np.arange(20.0)
    x = np.stack([np.sin(0.5 * t), np.cos(0.4 * t)], 1)
    y = np.stack([np.sin(0.5 * t - 2), np.cos(0.4 * t - 1.7)], 1)
    clips = {"equal": y, "longer": np.concatenate([y, y[:6]]), "shorter": y[:13]}
    cost = {name: np.array(timing.frame_distance(x, b)) for name, b in clips.items()}

    def ours(name="shorter", metric="euclidean", **options):
        return float(timing.dtw(x, clips[name], metric=metric, **options).cost)

    rooted = [np.sqrt(ours(name, "sqeuclidean")) for name in clips]
    squared = [ours(name, "sqeuclidean") for name in clips]
    summed = [ours(name) for name in clips]
    radii = range(7)

    def windows(name, metric="euclidean"):
        return [ours(name, metric, window=r) for r in radii]

    if there := peer("tslearn.metrics", "tslearn"):
        same(
            'dtw = sqrt(dtw(metric="sqeuclidean"))',
            rooted,
            [there.dtw(x, b) for b in clips.values()],
        )
        for name, b in clips.items():
            same(
                f"sakoe_chiba_radius=r = window=r, {name} length",
                np.sqrt(windows(name, "sqeuclidean")),
                [
                    there.dtw(x, b, global_constraint="sakoe_chiba", sakoe_chiba_radius=r)
                    for r in radii
                ],
            )
    if peer("dtaidistance"):
        from dtaidistance import dtw, dtw_ndim
        from dtaidistance.subsequence.dtw import SubsequenceAlignment

        same(
            'dtw_ndim.distance = sqrt(dtw(metric="sqeuclidean"))',
            rooted,
            [dtw_ndim.distance(x, b) for b in clips.values()],
        )
        same(
            'dtw_ndim.distance(inner_dist="euclidean") = dtw',
            summed,
            [dtw_ndim.distance(x, b, inner_dist="euclidean") for b in clips.values()],
        )
        for name, b in clips.items():
            same(
                f"window=r + 1 = window=r, {name} length",
                np.sqrt(windows(name, "sqeuclidean")),
                [dtw_ndim.distance(x, b, window=r + 1) for r in radii],
            )
        holds(
            "dtw.distance_fast([3], [0, 1]) is infinite, with its default pruning",
            np.isinf(dtw.distance_fast(np.array([3.0]), np.array([0.0, 1.0]))),
        )
        same(
            "dtw.distance_fast(use_pruning=False) = sqrt(dtw)",
            np.sqrt(13.0),
            dtw.distance_fast(np.array([3.0]), np.array([0.0, 1.0]), use_pruning=False),
        )
        penalty = inspect.signature(SubsequenceAlignment).parameters["penalty"].default
        holds("SubsequenceAlignment adds penalty=0.1 a step unless told otherwise", penalty == 0.1)
    if there := peer("aeon.distances", "aeon"):
        same(
            'dtw_distance(x.T, y.T) = dtw(metric="sqeuclidean")',
            squared,
            [there.dtw_distance(x.T, b.T) for b in clips.values()],
        )
        same(
            "window=r/frames = window=r, equal length",
            windows("equal", "sqeuclidean"),
            [there.dtw_distance(x.T, y.T, window=r / len(x)) for r in radii],
        )
        differ(
            "window=r/frames is not window=r, shorter: its band is slanted",
            windows("shorter", "sqeuclidean"),
            [there.dtw_distance(x.T, clips["shorter"].T, window=r / len(x)) for r in radii],
            0.1,
        )
    if there := peer("librosa.sequence", "librosa"):
        sums = {name: there.dtw(x.T, b.T)[0] for name, b in clips.items()}
        same("dtw(x.T, y.T)[0][-1, -1] = dtw", summed, [s[-1, -1] for s in sums.values()])
        same(
            'dtw(x.T, y.T)[0][-1].min() = dtw(open_end=True, normalize="sum")',
            [ours(name, open_end=True, normalize="sum") for name in clips],
            [s[-1].min() for s in sums.values()],
        )
        for name, c in cost.items():
            few = min(c.shape)
            same(
                f"band_rad=(r + 1)/frames of the shorter = window=r, {name} length",
                windows(name),
                [
                    there.dtw(C=c, global_constraints=True, band_rad=(r + 1) / few)[0][-1, -1]
                    for r in radii
                ],
            )
        same(
            'step_sizes_sigma [1 1][1 0][1 2] = step_pattern="asymmetric"',
            ours(step_pattern="asymmetric"),
            there.dtw(
                C=cost["shorter"],
                step_sizes_sigma=np.array([[1, 1], [1, 0], [1, 2]]),
                weights_mul=np.ones(3),
            )[0][-1, -1],
        )
        same(
            'weights_mul [2 1 1] = step_pattern="symmetric2" - D[0, 0]',
            ours(step_pattern="symmetric2") - cost["shorter"][0, 0],
            there.dtw(
                C=cost["shorter"],
                step_sizes_sigma=np.array([[1, 1], [1, 0], [0, 1]]),
                weights_mul=np.array([2.0, 1, 1]),
            )[0][-1, -1],
        )
    if there := peer("dtw", "dtw-python"):
        c = cost["shorter"]
        n, m = c.shape
        plain = there.dtw(c, step_pattern="symmetric1")
        double = there.dtw(c)
        slanted = there.dtw(c, step_pattern="asymmetric")
        same('step_pattern="symmetric1" = dtw', ours(), plain.distance)
        same(
            'the default, "symmetric2" = step_pattern="symmetric2" - D[0, 0]',
            ours(step_pattern="symmetric2") - c[0, 0],
            double.distance,
        )
        same(
            'its normalizedDistance = (step_pattern="symmetric2" - D[0, 0])/(n + m)',
            ours(step_pattern="symmetric2", normalize="frames") - c[0, 0] / (n + m),
            double.normalizedDistance,
        )
        same(
            '"asymmetric" = step_pattern="asymmetric"',
            ours(step_pattern="asymmetric"),
            slanted.distance,
        )
        same(
            'its normalizedDistance = normalize="mean"',
            ours(step_pattern="asymmetric", normalize="mean"),
            slanted.normalizedDistance,
        )
        opened = there.dtw(c, step_pattern="asymmetric", open_end=True)
        same(
            '"asymmetric", open_end: distance = normalize="sum", normalizedDistance = "mean"',
            [
                ours(step_pattern="asymmetric", open_end=True, normalize=by)
                for by in ("sum", "mean")
            ],
            [opened.distance, opened.normalizedDistance],
        )
        banded = {"step_pattern": "symmetric1", "window_type": "sakoechiba"}
        same(
            "sakoechiba window_size=r = window=r, equal length",
            windows("equal"),
            [
                there.dtw(cost["equal"], **banded, window_args={"window_size": r}).distance
                for r in radii
            ],
        )
        try:
            there.dtw(c, **banded, window_args={"window_size": n - m - 1})
        except ValueError:
            found = False
        else:
            found = True
        holds(
            "sakoechiba narrower than the difference of lengths has no path; ours widens", not found
        )


def soft_warping() -> None:
    """``soft_dtw``: sign, temperature, divergence."""
    t = np.arange(20.0)
    x = np.stack([np.sin(0.5 * t), np.cos(0.4 * t)], 1)
    y = np.stack([np.sin(0.5 * t - 2), np.cos(0.4 * t - 1.7)], 1)[:13]
    gammas = (1e-3, 0.1, 1.0, 10.0)
    ours = [float(timing.soft_dtw(x, y, g)) for g in gammas]
    print("soft_dtw")
    same(
        'gamma to 0 = dtw(metric="sqeuclidean")',
        float(timing.soft_dtw(x, y, 1e-12)),
        float(timing.dtw(x, y, metric="sqeuclidean").cost),
    )
    holds(
        "it is negative for large gamma, and of a clip from itself",
        ours[-1] < 0 > timing.soft_dtw(x, x),
    )
    if there := peer("tslearn.metrics", "tslearn"):
        same("soft_dtw = soft_dtw", ours, [there.soft_dtw(x, y, gamma=g) for g in gammas])
        path, _ = there.soft_dtw_alignment(x, y, gamma=1.0)
        same("soft_dtw_alignment = soft_alignment", timing.soft_alignment(x, y, 1.0), path)
        same(
            "cdist_soft_dtw_normalized = s(x, y) - (s(x, x) + s(y, y))/2",
            timing.soft_dtw(x, y) - (timing.soft_dtw(x, x) + timing.soft_dtw(y, y)) / 2,
            there.cdist_soft_dtw_normalized(x[None], y[None], gamma=1.0)[0, 0],
        )
    if there := peer("aeon.distances", "aeon"):
        same(
            "soft_dtw_distance = |soft_dtw|",
            np.abs(ours),
            [there.soft_dtw_distance(x.T, y.T, gamma=g) for g in gammas],
        )
        holds(
            "soft_dtw_distance of a clip from itself is 0", there.soft_dtw_distance(x.T, x.T) == 0
        )


def smoother() -> None:
    """``lgs`` as a filter of econometrics and of signals."""
    rng = np.random.default_rng(0)
    y = rng.normal(size=300).cumsum()
    lam, sigma = 7.0, 0.6
    half = smoothing.lgs(y, lam, sigma)
    unit = smoothing.lgs(y, lam, sigma, scale="unit")
    if peer("statsmodels.api", "statsmodels"):
        from statsmodels.tsa.filters.hp_filter import hpfilter
        from statsmodels.tsa.statespace.structural import UnobservedComponents

        def trend(lamb):
            return hpfilter(y, lamb=lamb)[1]

        same(
            "hpfilter(lamb) trend = lgs, lamb = (lam sigma)^2/4",
            half.mean,
            trend((lam * sigma) ** 2 / 4),
            1e-11,
        )
        same(
            'hpfilter(lamb) trend = lgs(scale="unit"), lamb = (lam sigma)^2',
            unit.mean,
            trend((lam * sigma) ** 2),
            1e-11,
        )
        same(
            "hpfilter(lamb=1600) = lgs(lam sigma = 80)",
            smoothing.lgs(y, 80.0, 1.0).mean,
            trend(1600),
            1e-11,
        )
        few = y[:80]
        model = UnobservedComponents(few, level="smooth trend", use_exact_diffuse=True)
        found, post = model.smooth([sigma**2, 4 / lam**2]), smoothing.lgs(few, lam, sigma)
        same(
            "UnobservedComponents smooth trend, [sigma^2, 4/lam^2]: level = mean",
            post.mean,
            found.smoothed_state[0],
            1e-8,
        )
        same(
            "its variance of the level = variance",
            post.variance,
            found.smoothed_state_cov[0, 0],
            1e-8,
        )
        same(
            "its exact diffuse llf + log 2 pi = log_evidence",
            post.log_evidence,
            found.llf + np.log(2 * np.pi),
            1e-8,
        )
        model = UnobservedComponents(few, level="local level", use_exact_diffuse=True)
        found, post = (
            model.smooth([sigma**2, 1 / (2 * lam)]),
            smoothing.lgs(few, lam, sigma, order=1),
        )
        away = slice(20, -20)
        same(
            "local level [sigma^2, 1/(2 lam)] = lgs(order=1), away from the ends",
            np.asarray(post.mean)[away],
            found.smoothed_state[0][away],
            1e-5,
        )
        differ(
            "... but not at the ends, where C of order 1 is 1 and not 2",
            post.mean,
            found.smoothed_state[0],
            1e-3,
        )
    print(f"scipy {scipy.__version__}: filters")
    away = slice(500, -500)
    noise = rng.normal(size=2000)
    fps = 120.0
    for cut, limit in ((3.0, 3e-3), (6.0, 1e-2), (12.0, 4e-2), (20.0, 0.11)):
        ratio = 2 * np.sin(np.pi * cut / fps)
        f = np.linspace(0, fps / 2, 2000, endpoint=False)
        sections = signal.butter(2, cut, fs=fps, output="sos")
        twice = np.abs(signal.sosfreqz(sections, worN=f, fs=fps)[1]) ** 2
        gain = 1 / (1 + (2 * np.sin(np.pi * f / fps) / ratio) ** 4)
        same(
            f"butter(2, {cut:g} of {fps:g} Hz) by filtfilt: gain of lgs at the same cut-off",
            gain,
            twice,
            limit,
        )
        tangent = 1 / (1 + (np.tan(np.pi * f / fps) / np.tan(np.pi * cut / fps)) ** 4)
        same("... exactly the same formula, with tan in place of sin", tangent, twice, 1e-10)
    cut = 6.0
    product_ = 1 / (2 * np.sin(np.pi * cut / fps) ** 2)
    swing = np.sin(2 * np.pi * cut * np.arange(2000) / fps)
    same(
        "half the amplitude at f, lam sigma = 1/(2 sin^2(pi f/fps))",
        np.asarray(smoothing.lgs(swing, product_, 1.0).mean)[away],
        0.5 * swing[away],
        1e-9,
    )
    once = np.abs(
        signal.sosfreqz(signal.butter(2, cut, fs=fps, output="sos"), worN=[cut], fs=fps)[1]
    )
    same(
        "butter is at 1/sqrt(2) at its cut-off after one pass, at 1/2 after both",
        [once[0], once[0] ** 2],
        [0.5**0.5, 0.5],
        1e-10,
    )
    factor = (2**0.5 - 1) ** 0.25
    moved = fps / np.pi * np.arctan(np.tan(np.pi * cut / fps) / factor)
    both = (
        np.abs(
            signal.sosfreqz(signal.butter(2, moved, fs=fps, output="sos"), worN=[cut], fs=fps)[1]
        )
        ** 2
    )
    same(
        "with the cut-off over 0.802 (in tan) both passes are at 1/sqrt(2)", both, [0.5**0.5], 1e-10
    )
    lowered = smoothing.lgs(swing, product_ * (2**0.5 - 1) ** 0.5, 1.0).mean
    same(
        "lgs is there with lam sigma times 0.644",
        np.asarray(lowered)[away],
        0.5**0.5 * swing[away],
        1e-9,
    )
    stiff = 2 * lam * sigma**2
    a = 1 + (1 - np.sqrt(1 + 4 * stiff)) / (2 * stiff)
    same(
        "filtfilt([1 - a], [1, -a]) = lgs(order=1) away from the ends, a/(1 - a)^2 = 2 lam sigma^2",
        np.asarray(smoothing.lgs(noise, lam, sigma, order=1).mean)[away],
        signal.filtfilt([1 - a], [1, -a], noise)[away],
    )
    t = np.arange(len(y), dtype=float)
    for lamb, limit in ((1.0, 0.02), (100.0, 2e-3), (1e4, 3e-4)):
        spline = interpolate.make_smoothing_spline(t, y, lam=lamb)(t)
        same(
            f"make_smoothing_spline(lam={lamb:g}) is nearly lgs(lam sigma = 2 sqrt(lam))",
            smoothing.lgs(y, 2 * lamb**0.5, 1.0).mean,
            spline,
            limit,
        )


def rotations() -> None:
    """Quaternions: storage, logarithm, Euler angles, means."""
    rng = np.random.default_rng(0)
    q = np.asarray(quaternion.exp(0.9 * rng.normal(size=(9, 3))))
    w = rng.uniform(0.2, 2.0, 9)
    angles = rng.uniform(-3, 3, (9, 3))
    half_turn = np.array([0.0, 0.0, 1.0, 0.0])
    print(f"scipy {scipy.__version__}, jax {jax.__version__}: Rotation")
    theirs = Rotation.from_quat(q, scalar_first=True)
    jaxs = JaxRotation.from_quat(jnp.asarray(quaternion.to_xyzw(q)))
    same(
        "as_quat() = to_xyzw, as_quat(scalar_first=True) = ours",
        quaternion.to_xyzw(q),
        theirs.as_quat(),
    )
    for name, cls in (("scipy", Rotation), ("jax.scipy", JaxRotation)):
        for order in ORDERS + [o.lower() for o in ORDERS]:
            turn = cls.from_euler(order, angles)
            made = quaternion.from_euler(jnp.asarray(angles), order)
            if quaternion.distance(made, quaternion.from_xyzw(turn.as_quat())).max() > 1e-12:
                holds(f"{name} from_euler({order!r}) = from_euler", False)
        holds(
            f"{name} from_euler = from_euler, 24 orders, capitals moving axes, small letters fixed",
            True,
        )
    for order in ORDERS + [o.lower() for o in ORDERS]:
        given = np.asarray(quaternion.to_euler(q, order))
        if np.abs(given - theirs.as_euler(order)).max() > 1e-12:
            holds(f"as_euler({order!r}) = to_euler", False)
    holds("scipy as_euler = to_euler, 24 orders: the same branch", True)
    locked = Rotation.from_euler("ZXY", [0.3, np.pi / 2, 0.4])
    same(
        "... and the same choice in gimbal lock",
        quaternion.to_euler(locked.as_quat(scalar_first=True), "ZXY"),
        locked.as_euler("ZXY"),
        1e-7,
    )
    differ(
        'from_euler "xyz" is not "XYZ"',
        Rotation.from_euler("xyz", angles).as_matrix(),
        Rotation.from_euler("XYZ", angles).as_matrix(),
        0.1,
    )
    turned(
        'from_euler([a, b, c], "xyz") = from_euler([c, b, a], "ZYX")',
        quaternion.from_euler(angles, "xyz"),
        quaternion.from_euler(angles[:, ::-1], "ZYX"),
    )
    same("as_rotvec = log = 2 log_half", quaternion.log(q), theirs.as_rotvec())
    same(
        "magnitude of a^-1 b = distance",
        quaternion.distance(q[0], q[1]),
        (theirs[0].inv() * theirs[1]).magnitude(),
    )
    turned(
        "a * b = multiply(a, b): b is turned first",
        quaternion.multiply(q[0], q[1]),
        (theirs[0] * theirs[1]).as_quat(scalar_first=True),
    )
    turned(
        "r**t = power", quaternion.power(q[0], 0.3), (theirs[0] ** 0.3).as_quat(scalar_first=True)
    )
    between = Slerp([0, 1], Rotation.from_quat(np.stack([q[0], -q[1]]), scalar_first=True))
    turned(
        "Slerp = slerp, the short way also from q to -q",
        quaternion.slerp(q[0], -q[1], 0.3),
        between(0.3).as_quat(scalar_first=True),
    )
    mean = theirs.mean(weights=w).as_quat(scalar_first=True)
    turned(
        'mean(weights) = mean(weights, method="chordal")',
        quaternion.mean(q, w, method="chordal"),
        mean,
    )
    turned(
        "jax.scipy mean(weights) likewise",
        mean,
        quaternion.from_xyzw(jaxs.mean(jnp.asarray(w)).as_quat()),
    )
    karcher = quaternion.mean(q, w)
    away = float(quaternion.distance(karcher, mean))
    _tell(
        'our default, "karcher", is not it: radians, spread by 1.3 rad',
        away,
        "more than",
        0.1,
        away > 0.1,
    )
    near = np.asarray(quaternion.exp(0.1 * rng.normal(size=(9, 3))))
    turned(
        '... "karcher" and "chordal" of spread by 0.15 rad',
        quaternion.mean(near),
        quaternion.mean(near, method="chordal"),
        2e-3,
    )
    residual = np.asarray(quaternion.log(quaternion.multiply(quaternion.conjugate(karcher), q)))
    _tell(
        '"karcher" leaves no weighted rotation vector over',
        float(np.abs(w @ residual).max()),
        "within",
        1e-10,
        np.abs(w @ residual).max() < 1e-10,
    )
    same(
        "std = root mean square of magnitudes about the mean",
        quaternion.std(q),
        np.sqrt(
            np.mean(
                (
                    Rotation.from_quat(np.asarray(quaternion.mean(q)), scalar_first=True).inv()
                    * theirs
                ).magnitude()
                ** 2
            )
        ),
    )
    broken = jax.jacfwd(lambda v: JaxRotation.from_rotvec(v).as_quat())(jnp.zeros(3))
    ours = jax.jacfwd(quaternion.exp)(jnp.zeros(3))
    holds(
        "jax.scipy Rotation.from_rotvec has a derivative of NaN at 0; exp has one half",
        jnp.isnan(broken).all() and jnp.allclose(ours[1:], 0.5 * jnp.eye(3)),
    )
    broken = jax.jacfwd(lambda v: JaxRotation.from_quat(v).as_rotvec())(jnp.array([0.0, 0, 0, 1]))
    holds(
        "jax.scipy as_rotvec likewise at the identity; log has 2",
        jnp.isnan(broken).all()
        and jnp.allclose(
            jax.jacfwd(quaternion.log)(jnp.array([1.0, 0, 0, 0]))[:, 1:], 2 * jnp.eye(3)
        ),
    )
    if there := peer("jaxlie"):
        logs = jax.vmap(lambda one: there.SO3(one).log())(jnp.asarray(q))
        same("SO3(wxyz).log() = log(q)", quaternion.log(q), logs)
        same(
            "at a half turn it has the other sign: both are right",
            quaternion.log(half_turn),
            -there.SO3(jnp.asarray(half_turn)).log(),
        )
        slopes = (
            jax.jacfwd(lambda v: there.SO3.exp(v).wxyz)(jnp.zeros(3)),
            jax.jacfwd(lambda one: there.SO3(one).log())(jnp.array([1.0, 0, 0, 0])),
        )
        holds(
            "derivatives of exp at 0 and log at the identity are finite",
            all(jnp.isfinite(slope).all() for slope in slopes),
        )
        turned(
            'from_rpy_radians(a, b, c) = from_euler([a, b, c], "xyz")',
            quaternion.from_euler(angles[0], "xyz"),
            there.SO3.from_rpy_radians(*angles[0]).wxyz,
        )
        turned(
            "a @ b = multiply(a, b)",
            quaternion.multiply(q[0], q[1]),
            (there.SO3(jnp.asarray(q[0])) @ there.SO3(jnp.asarray(q[1]))).wxyz,
        )
    if there := peer("pymotion.rotations.quat", "upc-pymotion"):
        from pymotion.rotations import ortho6d

        turned(
            "mul(a, b) = multiply(a, b), both wxyz",
            quaternion.multiply(q[:4], q[4:8]),
            there.mul(q[:4], q[4:8]),
        )
        for order in ("xyz", "zxy", "zyx"):
            made = there.from_euler(angles, np.tile(np.array(list(order)), (9, 1)))
            turned(
                f'from_euler with order "{order}" = from_euler with "{order.upper()}", moving axes',
                quaternion.from_euler(angles, order.upper()),
                made,
            )
        same(
            "to_scaled_angle_axis = log for w >= 0",
            quaternion.log(q * np.sign(q[:, :1])),
            there.to_scaled_angle_axis(q * np.sign(q[:, :1])),
        )
        longer = np.linalg.norm(there.to_scaled_angle_axis(-q[:1]))
        same(
            "of -q it turns the long way, 2 pi - angle; log the short one",
            longer,
            2 * np.pi - float(quaternion.distance(q[0], np.array([1.0, 0, 0, 0]))),
        )
        same(
            "ortho6d.from_quat, [..., 3, 2], transposed and flattened = to_rotation_6d",
            quaternion.to_rotation_6d(q),
            np.swapaxes(ortho6d.from_quat(q), -1, -2).reshape(9, 6),
        )
    same(
        "to_rotation_6d = the first two columns of the matrix, one after the other",
        quaternion.to_rotation_6d(q),
        theirs.as_matrix()[:, :, :2].swapaxes(1, 2).reshape(9, 6),
    )


def main() -> None:
    """Every relation."""
    python = sys.version.split()[0]
    print(f"Python {python}, NumPy {np.__version__}, jaxmotion {jm.__version__}")
    for part in (warping, soft_warping, smoother, rotations):
        part()
    print(f"{len(wrong)} relations do not hold" if wrong else "every relation holds")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()

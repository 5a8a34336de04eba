"""Every public function of every room through the places where motion code breaks.

Each function is called by its recipe (``sweep_recipes``) on every case of ``CASES``, in float32 and
float64, and must keep these properties:

    value      finite
    dtype      that of the arguments
    numpy      arguments in NumPy's arrays do as well
    jit        compiled equals eager
    vmap       mapped equals a loop
    gradients  forward and reverse mode finite, and equal to each other
    quotients  ... and to central differences of a random weighted sum of the outputs along a random
               direction (float64)

A few of these run with the suite. All of them, with a table (function x case) at the end:

    python -m pytest tests/test_sweep.py -m sweep

A function that is new and has no recipe fails ``test_every_public_function_has_a_recipe``.
"""

import importlib
import inspect
import pkgutil
import re
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion
from tests.sweep_cases import CASES, DTYPES, Case, case, direction, moved
from tests.sweep_recipes import EXCEPTIONS, RECIPES

QUICK = ("identity", "signs", "pi", "opposite", "still", "constant", "soft", "stiff", "far")
# Functions whose first call takes more than three quarters of a second; not for the quick part.
SLOW = {
    "augmentation.augment",
    "augmentation.augment[styles]",
    "contacts.cleanup_footskate",
    "contacts.cleanup_root",
    "contacts.detect",
    "contacts.find_feet",
    "contacts.limb_ik",
    "contacts.replant",
    "layers.decompose",
    "layers.denoise",
    "layers.denoise[not tuned]",
    "layers.stylize",
    "layers.synthesize",
    "layers.time_warp",
    "linalg.block_banded_factor",
    "linalg.parallel_chain_smooth",
    "metrics.check",
    "metrics.find_problems",
    "multiresolution.best_cut",
    "multiresolution.blend",
    "multiresolution.coarser_times",
    "multiresolution.compress",
    "multiresolution.downsample",
    "multiresolution.expand",
    "multiresolution.filter_motion",
    "multiresolution.level_of_detail",
    "multiresolution.reduce[times]",
    "multiresolution.smoothing_mask",
    "multiresolution.stitch",
    "quaternion.mean",
    "quaternion.mean[chordal]",
    "samples.clean_and_noisy",
    "samples.inject_errors",
    "smoothing.geodesic",
    "smoothing.lgs[parallel]",
    "smoothing.outlier_weights",
    "smoothing.outlier_weights[motion]",
    "smoothing.student_stiffness",
    "smoothing.student_stiffness[motion]",
    "smoothing.suggest_keys",
    "smoothing.tune",
    "smoothing.tune[motion]",
    "smoothing.windowed_lgs",
    "spacetime.keep_contacts",
    "spacetime.learn_limits",
    "spacetime.restore",
    "spacetime.satisfy",
    "spacetime.satisfy[hierarchical]",
    "style.apply_style",
    "style.interpolate",
    "style.motion_style",
    "style.style_distance",
    "style.transfer_style",
    "style.transfer_style[covariance]",
    "timing.align",
    "timing.motion_warping",
    "timing.soft_alignment",
    "timing.unwarp",
}
DERIVED = (
    "quaternion.distance",
    "quaternion.log",
    "quaternion.slerp",
    "kinematics.forward_kinematics",
    "displacement.minus",
)
# From one half turn to the next, rounding decides which way round.
EITHER_WAY = {"opposite": dict.fromkeys(("jit", "vmap", "quotients"), "half turns go either way")}
# What is wrong today: (function, case, dtype, property) and why. A mark that no longer fails is an
# error, so that the mark goes with the fault.
FAULTS: dict[tuple[str, str, str, str], str] = {}
REFUSALS = ValueError, eqx.EquinoxRuntimeError


# The properties


TOLERANCE = {"float64": 1e-9, "float32": 1e-3}  # jit and vmap, of the size of an answer
SLOPES = {"float64": 1e-7, "float32": 1e-2}  # forward and reverse mode


def floats(out) -> list:
    """The floating-point leaves of an answer."""
    leaves = [
        x for x in jax.tree.leaves(out) if isinstance(x, (float, np.ndarray, jax.Array, np.generic))
    ]
    return [x for x in leaves if jnp.issubdtype(jnp.asarray(x).dtype, jnp.floating)]


def scale_of(x) -> float:
    return float(np.max(np.abs(np.asarray(x, np.float64)), initial=1e-300))


def differ(a, b, tolerance) -> str | None:
    """How two answers differ by more than the tolerance times the size of each leaf."""
    a, b = (jax.tree.leaves(eqx.filter(t, eqx.is_array_like)) for t in (a, b))
    if len(a) != len(b):
        return f"{len(a)} leaves, {len(b)}"
    for x, y in zip(a, b, strict=True):
        if hasattr(x, "dtype") and jnp.issubdtype(x.dtype, jax.dtypes.prng_key):
            continue
        x, y = np.asarray(x), np.asarray(y)
        if x.shape != y.shape or x.dtype != y.dtype:
            return f"{x.dtype}{x.shape}, {y.dtype}{y.shape}"
        if x.dtype.kind != "f":
            if not np.array_equal(x, y):
                return f"{x.dtype}{x.shape} differ"
            continue
        off = scale_of(x - y) / max(scale_of(x), 1e-3)
        if not off <= tolerance and x.size:
            return f"off by {off:.1e}"
    return None


class Checks:
    """The properties of one function; compiled once for all cases of one shape."""

    def __init__(self, name: str):
        self.function = FUNCTIONS[name.partition("[")[0]]
        self.recipe = RECIPES[name]
        self.compiled = eqx.filter_jit(self.value)
        self.mapped = eqx.filter_jit(eqx.filter_vmap(self.value))
        self.derived = eqx.filter_jit(self.derivatives)

    def value(self, c: Case):
        return self.recipe.run(self.function, c)

    def derivatives(self, c: Case, tangent: Case, weights: list):
        """The answer, and the derivative of the terms of its weighted sum along the tangent in
        forward mode, of the sum by every leaf in reverse mode."""
        x, t = self.recipe.where(c), self.recipe.where(tangent)

        def f(x):
            out = self.value(eqx.tree_at(self.recipe.where, c, x))
            terms = [w * y for w, y in zip(weights, floats(out), strict=True)]
            return terms, eqx.filter(out, eqx.is_array_like)

        def summed(x):
            terms, out = f(x)
            return sum(jnp.sum(term) for term in terms), out

        _, forward, out = jax.jvp(f, (x,), (t,), has_aux=True)
        return out, forward, jax.grad(summed, has_aux=True)(x)[0]

    def faults(self, name: str, dtype: str) -> dict[str, str]:
        """What fails in a case: property to what was seen."""
        found, out = self.of_value(name, dtype)
        if out is None:
            return found
        c, skips = case(name, dtype), self.skips(name, dtype)
        # Half turns that are made again on the way back may go the other way than forward.
        beside = moved_case(self.recipe, c, direction(c, 1), 1e-3) if name in EITHER_WAY else c
        for prop, at in (("gradients", beside), ("jit", c), ("vmap", c)):
            if prop not in skips:
                try:
                    found |= getattr(self, prop)(at, out, skips)
                except Exception as error:
                    found[prop] = told(error)
        return found

    def skips(self, name: str, dtype: str) -> dict[str, str]:
        of_case = [self.recipe.cases.get(key, {}) for key in (name, f"{name} {dtype}")]
        return self.recipe.skips | EITHER_WAY.get(name, {}) | of_case[0] | of_case[1]

    def of_value(self, name: str, dtype: str) -> tuple[dict[str, str], Any]:
        """What fails of the value alone; the answer, None for an error."""
        c, skips, found = case(name, dtype), self.skips(name, dtype), {}
        refused = skips.get("refused")
        try:
            out = self.value(c)
        except Exception as error:
            if refused and isinstance(error, REFUSALS) and re.search(refused, str(error)):
                return {}, None
            return {"value": told(error)}, None
        if refused:
            return {"value": f"no error that says {refused!r}"}, None
        numbers = floats(out)
        if "value" not in skips and not all(np.all(np.isfinite(x)) for x in numbers):
            found["value"] = "not finite"
        others = {str(x.dtype) for x in numbers if hasattr(x, "dtype")} - {str(c.dtype)}
        if "dtype" not in skips and others:
            found["dtype"] = " ".join(others)
        if fault := self.of_numpy(c, out):
            found["numpy"] = fault
        return found, out

    def of_numpy(self, c: Case, out) -> str | None:
        """How the answer differs for arguments as a reader without JAX would have them."""
        try:
            return differ(self.value(in_numpy(c)), out, self.tolerance(c))
        except Exception as error:
            return told(error)

    def compiled_value(self, c, out):
        """By the program that has the derivatives too, if there is one."""
        if "gradients" in self.recipe.skips:
            return self.compiled(c)
        return self.derived(c, direction(c, 3), random_weights(out))[0]

    def tolerance(self, c):
        return min(TOLERANCE[str(c.dtype)] * self.recipe.coarse, 1e-3)

    def jit(self, c, out, _):
        fault = differ(self.compiled_value(c, out), out, self.tolerance(c))
        return {"jit": fault} if fault else {}

    def vmap(self, c, out, _):
        pair = [c, moved_case(self.recipe, c, direction(c, 1), 0.01)]
        mapped = self.mapped(jax.tree.map(lambda *x: jnp.stack(x), *pair))
        for i, single in enumerate(pair):
            part = jax.tree.map(lambda x, i=i: x[i] if eqx.is_array(x) else x, mapped)
            fault = differ(part, self.compiled_value(single, out), self.tolerance(c))
            if fault:
                return {"vmap": fault}
        return {}

    def gradients(self, c, out, skips):
        weights, tangent = random_weights(out), direction(c, 3)
        _, terms, reverse = self.derived(c, tangent, weights)
        if not all(np.all(np.isfinite(g)) for g in (*terms, *reverse)):
            return {"gradients": "not finite"}
        forward, along = sum(map(total, terms)), self.recipe.where(tangent)
        rounding = 32 * float(jnp.finfo(c.dtype).eps) * sum(map(absolute, terms))
        along = [inner(g, t) for g, t in zip(reverse, along, strict=True)]
        size = abs(forward) + sum(map(abs, along))
        allowed = SLOPES[str(c.dtype)] * self.recipe.coarse * size + rounding + 1e-12
        if abs(forward - sum(along)) > allowed:
            return {"gradients": f"forward {forward:.9g}, reverse {sum(along):.9g}"}
        if c.dtype == np.float32 or "quotients" in skips:
            return {}
        return self.quotients(c, out, weights, tangent, forward, size)

    def quotients(self, c, out, weights, tangent, forward, size, step=1e-5):
        """Central differences at one and two steps, and what they would be at none."""

        def at(h):
            moved_by = moved_case(self.recipe, c, tangent, h * step)
            return float(weighted(weights, self.derived(moved_by, tangent, weights)[0]))

        once, twice = (at(1) - at(-1)) / (2 * step), (at(2) - at(-2)) / (4 * step)
        quotient = (4 * once - twice) / 3
        sizes = [
            np.vdot(np.abs(w), np.maximum(np.abs(x), 1))
            for w, x in zip(weights, floats(out), strict=True)
        ]
        noise = 1e-15 * float(sum(sizes)) / step
        allowed = 1e-6 * size + noise + min(abs(once - twice), 1e-3 * abs(once))
        if abs(forward - quotient) <= allowed:
            return {}
        return {"quotients": f"derivative {forward:.7g}, quotients {once:.7g}, {twice:.7g}"}


def told(error) -> str:
    """The error in a line; Equinox puts stacks before the message of one inside of jit."""
    text = str(error).rpartition("EquinoxRuntimeError: ")[2].strip() or "no message"
    return f"{type(error).__name__}: {text.splitlines()[0][:150]}"


def in_numpy(c: Case) -> Case:
    """Every array but the key of random numbers."""
    key = lambda x: jnp.issubdtype(x.dtype, jax.dtypes.prng_key)  # noqa: E731
    return jax.tree.map(lambda x: x if key(x) else np.asarray(x), c)


def total(x) -> float:
    return float(np.sum(np.asarray(x, np.float64)))


def absolute(x) -> float:
    return total(np.abs(x))


def inner(a, b) -> float:
    return float(np.vdot(np.asarray(a, np.float64), np.asarray(b, np.float64)))


def weighted(weights, out):
    return sum(jnp.vdot(w, x) for w, x in zip(weights, floats(out), strict=True))


def random_weights(out) -> list:
    """One a number of the answer; numbers that are all small count as if they were about 1, but
    for those that may be rounding."""
    rng, weights = np.random.default_rng(2), []
    for x in floats(out):
        least = max(1e-6, float(jnp.finfo(jnp.asarray(x).dtype).eps) ** 0.5)
        size = np.clip(scale_of(x), least, 1)
        weights.append(jnp.asarray(rng.standard_normal(np.shape(x)) / size, x.dtype))
    return weights


def moved_case(recipe, c, tangent, step):
    x = recipe.where(c)
    return eqx.tree_at(recipe.where, c, moved(x, recipe.where(tangent), step))


# The functions


def public_functions() -> dict[str, object]:
    """``room.function`` of everything public: what ``__all__`` of a room names, or what a module
    that is a room by itself defines."""
    found = {}
    for info in pkgutil.iter_modules(jaxmotion.__path__):
        if info.name.startswith("_") or info.name == "cli":
            continue
        room = importlib.import_module(f"jaxmotion.{info.name}")
        names = getattr(room, "__all__", None) or [
            n
            for n, x in vars(room).items()
            if n[0] != "_" and getattr(x, "__module__", "") == room.__name__
        ]
        found |= {f"{info.name}.{n}": getattr(room, n) for n in names}
    known = set(map(id, found.values()))
    found |= {
        f"jaxmotion.{n}": getattr(jaxmotion, n)
        for n in jaxmotion.__all__
        if id(getattr(jaxmotion, n)) not in known
    }
    return {n: x for n, x in found.items() if callable(x) and not inspect.isclass(x)}


FUNCTIONS = public_functions()


def test_every_public_function_has_a_recipe():
    called = {name.partition("[")[0] for name in RECIPES}
    assert not called & set(EXCEPTIONS), "a recipe and an exception"
    missing = set(FUNCTIONS) - called - set(EXCEPTIONS)
    assert not missing, f"give these a recipe in sweep_recipes.py: {sorted(missing)}"
    gone = (called | set(EXCEPTIONS)) - set(FUNCTIONS)
    assert not gone, f"no longer public: {sorted(gone)}"


# The sweep


@pytest.fixture(scope="module")
def table(request):
    """What every case came to; printed at the end, unless the tests are spread over processes."""
    rows = {}
    yield rows
    reporter = request.config.pluginmanager.getplugin("terminalreporter")
    if rows and reporter:
        reporter.write_line("\n\n" + "\n".join(drawn(rows)))


def drawn(rows: dict[str, dict[str, str]]) -> list[str]:
    """The table as lines of text."""
    width = max(map(len, rows))
    head = [" " * width + " " + " ".join(f"{name[:6]:6}" for name in CASES)]
    legend = [
        "",
        ". ok; R refused as documented; - a part does not apply there; else the letters of what",
        "fails (value, dtype, numpy, jit, vmap, gradients, quotients); capitals stand in FAULTS",
    ]
    body = [
        f"{name:{width}} " + " ".join(f"{cells[c]:6}" for c in CASES)
        for name, cells in rows.items()
    ]
    return head + body + legend


def test_quickly():
    """What the suite has time for: the value of a case, its dtype and that in NumPy, for each
    function that compiles fast; every property of some where q and −q, or all frames, agree."""
    found = {}
    quick = [name for name in RECIPES if name not in SLOW]
    for i, name in enumerate(quick):
        place = QUICK[i % len(QUICK)]
        for prop, seen in Checks(name).of_value(place, "float32")[0].items():
            found[name, place, "float32", prop] = seen
    for i, name in enumerate(DERIVED):
        place = ("signs", "still", "identity", "pi")[i % 4]
        for prop, seen in Checks(name).faults(place, "float64").items():
            found[name, place, "float64", prop] = seen
    wrong = {key: seen for key, seen in found.items() if key not in FAULTS}
    assert not wrong, "\n".join(f"{key}: {seen}" for key, seen in wrong.items())


@pytest.mark.sweep
@pytest.mark.parametrize("name", RECIPES)
def test_sweep(name, table):
    """Every property of every case; what is marked in FAULTS must fail still."""
    jax.clear_caches()  # else the memory maps of a process run out
    checks, found = Checks(name), {}
    for place in CASES:
        for dtype in DTYPES:
            for prop, seen in checks.faults(place, dtype).items():
                found[name, place, dtype, prop] = seen
    table[name] = {place: cell(checks, name, place, found) for place in CASES}
    marked = {key for key in FAULTS if key[0] == name}
    new = "\n".join(f"{key}: {seen}" for key, seen in found.items() if key not in marked)
    assert not new, f"not marked in FAULTS:\n{new}"
    mended = marked - set(found)
    assert not mended, f"these hold now; take their marks out of FAULTS: {sorted(mended)}"


def cell(checks, name, place, found) -> str:
    letters = ""
    for prop in ("value", "dtype", "numpy", "jit", "vmap", "gradients", "quotients"):
        keys = [(name, place, dtype, prop) for dtype in DTYPES]
        if any(key in found for key in keys):
            marked = all(key in FAULTS for key in keys if key in found)
            letters += prop[0].upper() if marked else prop[0]
    if letters:
        return letters
    keys = (place, *(f"{place} {dtype}" for dtype in DTYPES))
    mine = {key for k in keys for key in checks.recipe.cases.get(k, {})}
    return "R" if "refused" in mine else "-" if mine else "."

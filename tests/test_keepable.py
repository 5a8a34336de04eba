"""Eager calls where programs are kept on disk: none calls the host, and what is wrong stops them as
it does elsewhere."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion import _checks, _program
from tests.sweep_cases import case
from tests.sweep_recipes import RECIPES, arguments_of

# Between them they call what may stop; all others are swept.
FEW = ("smoothing.smooth_motion", "layers.decompose", "contacts.detect", "smoothing.tune")


@pytest.fixture
def kept(monkeypatch):
    """As if there were a folder."""
    monkeypatch.setattr(_program, "folder_of_programs", lambda: "a folder")


@pytest.fixture
def called(monkeypatch, kept):
    """Faults that programs call the host about, as they are traced."""
    texts, report = [], _checks._report
    monkeypatch.setattr(
        _checks, "_report", lambda *told: texts.extend(told[0]) or report.__wrapped__(*told)
    )
    jax.clear_caches()
    yield texts
    jax.clear_caches()


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=() if n in FEW else pytest.mark.sweep, id=n)
        for n in RECIPES
        if not n.startswith("io.")  # reads a file that is gone by then
    ],
)
def test_nothing_calls_the_host(called, name):
    function, args, kwargs = arguments_of(name)
    jax.block_until_ready(jax.tree.leaves(eqx.filter(function(*args, **kwargs), eqx.is_array)))
    assert called == []


def test_it_does_where_nothing_is_kept(called, monkeypatch):
    """What the tests above look at is there."""
    monkeypatch.setattr(_program, "folder_of_programs", lambda: None)
    jm.decompose(case("plain", "float64").motion)
    assert called != []


@_program.keepable
@eqx.filter_jit
def root_of(x):
    """√x for each x; for those below 0 there is none."""
    checked = _checks.require(x, jnp.any(x < 0), "root_of: x must not be negative")
    return jnp.sqrt(checked), jnp.arange(3)


@pytest.mark.parametrize("folder", [None, "a folder"])
def test_what_is_wrong_is_told(monkeypatch, folder):
    monkeypatch.setattr(_program, "folder_of_programs", lambda: folder)
    with pytest.raises(eqx.EquinoxRuntimeError, match="root_of: x must not be negative"):
        jax.block_until_ready(root_of(jnp.array([4.0, -1.0])))
    assert root_of(jnp.array([4.0, 9.0]))[0].tolist() == [2.0, 3.0]


def test_nan_that_is_no_fault_comes_out(kept):
    assert np.isnan(root_of(jnp.array([4.0, jnp.nan]))[0]).tolist() == [False, True]


def test_inside_of_other_programs(called):
    """There they are part of what is compiled, known arguments or not, and stop as ever."""
    known = jnp.array([4.0, 9.0])
    assert jax.jit(lambda: root_of(known)[0])().tolist() == [2.0, 3.0]
    assert len(called) == 1
    assert jax.grad(lambda x: root_of(x)[0].sum())(known).tolist() == [0.25, pytest.approx(1 / 6)]
    with pytest.raises(Exception, match="must not be negative"):
        jax.block_until_ready(jax.jit(lambda x: root_of(x)[0])(-known))


@pytest.mark.parametrize("mode", ["nan", "off"])
def test_other_modes_are_the_caller_s(kept, monkeypatch, mode):
    monkeypatch.setattr(_program, "checks", None)
    with jm.checks(mode):
        first, numbers = root_of(jnp.array([4.0, -1.0]))
    assert np.isnan(first).tolist() == [mode == "nan", True]
    assert numbers.tolist() == [0, 1, 2]


def test_empty_results(kept):
    assert root_of(jnp.zeros(0))[0].shape == (0,)

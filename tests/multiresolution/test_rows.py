"""Linear maps of rows against sums row by row; their transposes by ⟨y, Ax⟩ = ⟨Aᵀy, x⟩."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.multiresolution.rows import Ends, every_second, interleaved, window_sums

RNG = np.random.default_rng(0)


def parts(rows, count=2):
    return tuple(jnp.asarray(RNG.standard_normal((rows, 3))) for _ in range(count))


def check_transpose(f, *x):
    """In both modes, against each other."""
    y, pull = jax.vjp(f, *x)
    u = jax.tree.map(lambda a: jnp.asarray(RNG.standard_normal(a.shape)), x)
    v = jax.tree.map(lambda a: jnp.asarray(RNG.standard_normal(a.shape)), y)
    pushed = jax.jvp(f, x, u)[1]

    def product(a, b):
        return sum(np.vdot(p, q) for p, q in zip(*map(jax.tree.leaves, (a, b)), strict=True))

    np.testing.assert_allclose(product(v, pushed), product(pull(v), u), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("rows", [1, 2, 3, 8, 9])
def test_every_second(rows):
    x = parts(rows)
    width = min(rows, 3)
    for start in range(rows - width + 1):
        got, some = every_second(x, jnp.asarray(start), width)
        for a, b, c in zip(x, got, some, strict=True):
            np.testing.assert_array_equal(b, a[::2])
            np.testing.assert_array_equal(c, a[start : start + width])
        check_transpose(lambda *x, start=start: every_second(x, jnp.asarray(start), width), *x)


@pytest.mark.parametrize("dropped", [0, 1])
@pytest.mark.parametrize(("even", "odd"), [(1, 0), (1, 1), (4, 3), (4, 4)])
def test_interleaved(even, odd, dropped):
    e, o, rows = parts(even), parts(odd), max(even + odd - dropped, 1)
    for a, b, c in zip(e, o, interleaved(e, o, rows), strict=True):
        np.testing.assert_array_equal(c[::2], a[: (rows + 1) // 2])
        np.testing.assert_array_equal(c[1::2], b[: rows // 2])
        assert len(c) == rows
    check_transpose(lambda e, o: interleaved(e, o, rows), e, o)


def summed(x, weights, ends, stride):
    """Row by row."""
    front, back = ends.front @ x[: ends.front.shape[1]], ends.back.shape[0]
    rows = [*front, *x, *np.zeros((back, x.shape[1]))]
    near = x[int(ends.start) : int(ends.start) + ends.back.shape[1]]
    for k in range(back):
        rows[len(front) + int(ends.stop) + k] = ends.back[k] @ near
    starts = range(0, len(rows) - len(weights) + 1, stride)
    return np.array([sum(w * rows[i + m] for m, w in enumerate(weights)) for i in starts])


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("taps", [2, 4])
@pytest.mark.parametrize("rows", [3, 4, 13])
def test_window_sums(rows, taps, stride):
    weights: tuple[float, ...] = tuple(RNG.standard_normal(taps).tolist())
    x = parts(rows)
    for stop in (rows, rows - 1, 3):
        near = min(stop, 3)
        ends = Ends(
            jnp.asarray(RNG.standard_normal((2, 3))),
            jnp.asarray(RNG.standard_normal((3, near))),
            jnp.asarray(stop - near),
            jnp.asarray(stop),
        )
        got = window_sums(x, weights, ends, stride)
        for a, b in zip(x, got, strict=True):
            np.testing.assert_allclose(b, summed(a, weights, ends, stride), atol=1e-13)
        check_transpose(lambda *x, ends=ends: window_sums(x, weights, ends, stride), *x)


def test_weights_by_row_are_the_same_sums():
    x, weights = parts(6), (0.3, -1.2, 0.5)
    one = jnp.ones((1, 3))
    ends = Ends(one, one, jnp.asarray(3), jnp.asarray(6))
    want = window_sums(x, weights, ends)
    columns = tuple(jnp.full((len(want[0]), 1), w) for w in weights)
    for a, b in zip(want, window_sums(x, columns, ends), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-14)


def test_rows_are_mapped_over_clips_and_compiled():
    x = parts(7)
    ends = Ends(jnp.ones((1, 3)), jnp.ones((1, 3)), jnp.asarray(4), jnp.asarray(7))
    batch = tuple(jnp.stack([a, 2 * a]) for a in x)
    got = jax.jit(jax.vmap(lambda *x: window_sums(x, (1.0, 2.0, 0.5), ends)))(*batch)
    want = window_sums(x, (1.0, 2.0, 0.5), ends)
    for a, b in zip(want, got, strict=True):
        np.testing.assert_allclose(b, [a, 2 * a], rtol=1e-14)

"""Numbers as text: exact, short, and rounded only where asked."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxmotion.io.decimal_text import table_text

EXACT, ROUNDED = np.array([False]), np.array([True])


def words(values, rounded=EXACT, single=False):
    column = np.asarray(values, np.float64)[:, None]
    return table_text(column, rounded, single=single).decode().split()


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=30))
def test_any_double_reads_back_exactly(values):
    text = words(values)
    assert [float(word) for word in text] == values
    assert all(len(word) <= len(repr(v)) + 12 for word, v in zip(text, values, strict=True))


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.floats(allow_nan=False, allow_infinity=False, width=32), min_size=1, max_size=30)
)
def test_any_single_reads_back_exactly(values):
    text = words(values, single=True)
    np.testing.assert_array_equal(np.array(text, float).astype(np.float32), np.float32(values))


def test_nothing_is_longer_than_it_must_be():
    rng = np.random.default_rng(0)
    for decimals in range(13):
        values = np.round(rng.uniform(-2000, 2000, 500), decimals)
        for word, value in zip(words(values), values.tolist(), strict=True):
            assert len(word) <= len(repr(value))
    single = rng.uniform(-300, 300, 500).astype(np.float32)
    for word, value in zip(words(single, single=True), single, strict=True):
        assert len(word) <= len(str(value))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (1.0, "1"),
        (-12.5, "-12.5"),
        (100.0, "100"),
        (0.001, "0.001"),
        (1e-12, "0.000000000001"),
        (-1e-13, "-1e-13"),
        (123456.0, "123456.0"),
        (0.1 + 0.2, "0.30000000000000004"),
        (1e300, "1e+300"),
    ],
)
def test_spelling(value, text):
    assert words([value]) == [text]


def test_rounded_columns_lose_the_noise_of_a_conversion_and_no_more():
    values = np.array([[12.340000000000002, 12.340000000000002], [-1e-14, -1e-14]])
    text = table_text(values, np.array([True, False]), single=False)
    assert text == b"12.34 12.340000000000002\n0 -1e-14\n"
    rng = np.random.default_rng(1)
    angles = rng.uniform(-2000, 2000, 1000)
    assert np.abs(np.array(words(angles, ROUNDED), float) - angles).max() <= 8e-13
    large = rng.uniform(-1e8, 1e8, 100)
    np.testing.assert_array_equal(np.array(words(large, ROUNDED), float), large)


def test_rows_and_columns_keep_their_places():
    rng = np.random.default_rng(2)
    table = np.round(rng.normal(size=(700, 90)), 4)
    table[::50, 7] = 1e-20 * rng.normal(size=14)
    lines = table_text(table, np.zeros(90, bool), single=False).decode().split("\n")
    assert lines.pop() == ""
    np.testing.assert_array_equal([[float(w) for w in line.split(" ")] for line in lines], table)

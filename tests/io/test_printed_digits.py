"""What the digits of a table say of its rounding, against ``decimal`` and against the numbers."""

from decimal import Decimal

import numpy as np
import pytest

from jaxmotion.io.printed_digits import PrintedDigits, printed_digits

STYLES = {
    "%.4f": lambda v: f"{v:.4f}",
    "%.4f without zeros": lambda v: f"{v:.4f}".rstrip("0").rstrip("."),
    "%.6g": lambda v: f"{v:.6g}",
    "%.3e": lambda v: f"{v:.3e}",
    "repr": lambda v: repr(float(v)),
}
HALF_UNIT = {
    "%.4f": lambda v, e: 0.5e-4,
    "%.4f without zeros": lambda v, e: 0.5e-4,
    "%.6g": lambda v, e: 0.5 * 10.0 ** (e - 5),
    "%.3e": lambda v, e: 0.5 * 10.0 ** (e - 3),
}


def numbers():
    rng = np.random.default_rng(0)
    return np.concatenate([rng.standard_normal(400) * 10.0**k for k in (-3, 0, 2)])


def counted(token):
    """Decimals and significant digits by the standard library."""
    _, digits, exponent = Decimal(token).as_tuple()
    return max(-exponent, 0), len("".join(map(str, digits)).lstrip("0"))


@pytest.mark.parametrize("style", STYLES)
def test_the_most_digits_of_any_number(style):
    tokens = [STYLES[style](v) for v in numbers()]
    want = [max(column) for column in zip(*map(counted, tokens), strict=True)]
    assert printed_digits("\n ".join(tokens).encode()) == tuple(want)


@pytest.mark.parametrize("style", HALF_UNIT)
def test_rounding_is_half_a_unit_of_the_last_digit(style):
    v = numbers()
    tokens = [STYLES[style](x) for x in v]
    printed = np.array(tokens, float)
    rounding = printed_digits(" ".join(tokens).encode()).rounding(printed)
    size = np.abs(printed[printed != 0])
    want = [HALF_UNIT[style](x, np.floor(np.log10(x))) for x in size]
    np.testing.assert_allclose(rounding[printed != 0], want, rtol=1e-12)
    # One more for numbers that rounding took to the next power of ten.
    assert np.all(np.abs(printed - v) <= rounding * (1 + 1e-9))


def test_numbers_that_are_not_rounded():
    v = numbers()
    digits = printed_digits(" ".join(map(repr, v.tolist())).encode())
    assert np.all(digits.rounding(v) <= np.maximum(1e-15 * np.abs(v), 1e-18))


def test_columns_signs_and_odd_spellings():
    rows = b"\t1.25 -0.001\r\n+3. .5\n 0.000 1e3 \n-7E-2 0"
    assert printed_digits(rows, 2, np.array([0])) == (3, 3)
    assert printed_digits(rows, 2, np.array([1])) == (3, 1)
    assert printed_digits(rows, 2) == (3, 3)
    for token in ("1.25", "-0.001", "+3.", ".5", "0.000", "-7E-2", "0", "1.50e-3", "12e1"):
        assert printed_digits(token.encode()) == counted(token), token
    assert printed_digits(b"", 3, np.array([1])) == printed_digits(b"0 0") == (0, 0)
    assert printed_digits(b"1 2", 2, np.zeros(0, int)) == (0, 0)
    assert PrintedDigits(3, 5).and_those(PrintedDigits(4, 2)) == (4, 5)

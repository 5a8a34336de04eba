"""Tables of numbers as text: the shortest decimals that read back as the same numbers, quickly.

A number v is written as a fixed-point integer n with twelve decimals when n/10¹² reads back as v:
the digits come out a column at a time for thousands of numbers, zeros in front and behind are
masked away, and what is left is the text. Any decimal of up to fifteen digits is the shortest for
its double, so nothing shorter exists. The rest (more digits, or large) goes through Python's own
shortest form. float32 numbers get the fewest decimals that read back as the same float32.

Columns marked ``rounded`` (angles in degrees) are first rounded to twelve decimals, 2·10⁻¹⁴ rad:
that is below what a conversion between angles and quaternions costs, and 12.34 that became
12.340000000000002 on the way is written as 12.34 again.

O(numbers · width); about 10 ms for 250 000 numbers.
"""

import numpy as np

_DECIMALS = 12
_SCALE = 10**_DECIMALS
_EXACT_INTEGERS = 2**53
_SINGLE_LIMIT = 9e6
_NUMBERS_AT_ONCE = 1 << 15


def table_text(values: np.ndarray, rounded: np.ndarray, *, single: bool) -> bytes:
    """Rows of numbers, a space between them, a line end after each row.

    **Arguments:** ``values``: f64[n, C], finite; ``rounded``: bool[C], see the module; ``single``:
    whether they stand for float32 numbers. **Returns:** ASCII text.
    """
    rows = max(1, _NUMBERS_AT_ONCE // max(values.shape[1], 1))
    pieces = (values[start : start + rows] for start in range(0, len(values), rows))
    return b"".join(_piece(piece, rounded, single) for piece in pieces)


def number_text(value: np.floating) -> str:
    """One number, shortest in its own type."""
    return str(value)


def _piece(values: np.ndarray, rounded: np.ndarray, single: bool) -> bytes:
    flat = values.ravel()
    loose = np.broadcast_to(rounded, values.shape).ravel()
    scaled, known = (_scaled_single if single else _scaled_double)(flat, loose)
    text, keep = _fixed_point(np.abs(scaled), scaled < 0)
    odd = np.flatnonzero(~known)
    if odd.size:
        text, keep = _with_long_numbers(text, keep, odd, flat, single)
    separators = np.full(values.shape, ord(" "), np.uint8)
    separators[:, -1] = ord("\n")
    text[-1] = separators.ravel()
    return text.T[keep.T].tobytes()


def _scaled_double(v: np.ndarray, loose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """v·10¹² as integers, and which of them say v exactly."""
    with np.errstate(over="ignore"):
        fixed = np.rint(v * _SCALE)
    known = np.abs(fixed) < _EXACT_INTEGERS
    known &= loose | (fixed / _SCALE == v)
    return np.where(known, fixed, 0).astype(np.int64), known


def _scaled_single(v: np.ndarray, loose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As above, with the fewest decimals that read back as the same float32."""
    target = v.astype(np.float32)
    scaled = np.zeros(v.shape, np.int64)
    left = np.flatnonzero(np.abs(v) < _SINGLE_LIMIT)
    for decimals in range(_DECIMALS + 1):
        fixed = np.rint(v[left] * 10**decimals)
        here = (fixed / 10**decimals).astype(np.float32) == target[left]
        scaled[left[here]] = fixed[here].astype(np.int64) * 10 ** (_DECIMALS - decimals)
        left = left[~here]
    known = np.abs(v) < _SINGLE_LIMIT
    known[left] = False
    tiny = left[loose[left]]
    scaled[tiny] = np.rint(v[tiny] * _SCALE).astype(np.int64)
    known[tiny] = True
    return scaled, known


def _fixed_point(magnitude: np.ndarray, negative: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Characters u8[width, N] of sign, digits, point and decimals, and which of them to keep.

    The last row is left for the separator.
    """
    whole = magnitude // _SCALE
    fraction = magnitude - whole * _SCALE
    high = fraction // 10**6
    low = (fraction - high * 10**6).astype(np.uint32)
    high, whole = high.astype(np.uint32), whole.astype(np.uint32)
    digits = len(str(int(whole.max(initial=0))))
    point = 1 + digits
    text = np.empty((point + _DECIMALS + 2, magnitude.size), np.uint8)
    keep = np.ones(text.shape, bool)
    text[0], keep[0] = ord("-"), negative
    left = whole
    for row in range(point - 1, 0, -1):
        if row < point - 1:
            keep[row] = left > 0
        left, text[row] = _pop_digit(left)
    text[point] = ord(".")
    needed = np.zeros(magnitude.size, bool)
    for left, first in ((low, point + 7), (high, point + 1)):
        for row in range(first + 5, first - 1, -1):
            left, text[row] = _pop_digit(left)
            needed |= text[row] != ord("0")
            keep[row] = needed
    keep[point] = needed
    return text, keep


def _pop_digit(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rest = numbers // np.uint32(10)
    return rest, (numbers - rest * np.uint32(10)).astype(np.uint8) + np.uint8(ord("0"))


def _with_long_numbers(text, keep, odd: np.ndarray, flat: np.ndarray, single: bool):
    """Put the shortest form of the numbers ``odd`` in, widening the columns as needed."""
    values = flat[odd].astype(np.float32) if single else flat[odd]
    spelt = [str(v) for v in values] if single else [repr(v) for v in values.tolist()]
    characters = np.array(spelt, "S").view(np.uint8).reshape(len(odd), -1).T
    width = max(len(text), len(characters) + 1)
    wide = np.zeros((width, text.shape[1]), np.uint8)
    wide_keep = np.zeros(wide.shape, bool)
    wide[: len(text) - 1], wide_keep[: len(text) - 1] = text[:-1], keep[:-1]
    wide[:, odd] = 0
    wide[: len(characters), odd] = characters
    wide_keep[:, odd] = wide[:, odd] != 0
    wide_keep[-1] = True
    return wide, wide_keep

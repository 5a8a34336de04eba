"""How finely a table of numbers was printed, told from its text.

    "%.4f", D decimals               a number v is off by up to   ½ 10^−D
    "%.6g", S significant digits     10^e ≤ |v| < 10^(e + 1)      ½ 10^(e + 1 − S)

One number tells little: 3.5 may be all that "%g" had to say, or 3.5000 with its zeros taken off. So
D and S are the most that any number of the table shows. Printed with D decimals, S is that of the
longest number and the second line is never more than the first; printed with S digits, D is that of
the smallest number and the first line is never more than the second. The larger of the two is the
right one, however it was printed.

O(bytes), a third of what it takes to read the numbers.
"""

from typing import NamedTuple

import numpy as np

# What arithmetic in single precision costs, as a share of the longest offset or the farthest
# coordinate; and the share of the longest offset that matters, however coarsely it was printed.
SINGLE_PRECISION = 1e-6
LARGEST_ROUNDING = 1e-2


class PrintedDigits(NamedTuple):
    """The most ``decimals`` and ``significant`` digits of any number of a table."""

    decimals: int = 0
    significant: int = 0

    def rounding(self, values: np.ndarray) -> np.ndarray:
        """By how much numbers may be off that were printed so."""
        size = np.abs(values)
        exponent = np.floor(np.log10(np.where(size > 0, size, 1.0)))
        of_digits = np.where(size > 0, 0.5 * 10.0 ** (exponent + 1 - self.significant), 0.0)
        return np.maximum(0.5 * 10.0**-self.decimals, of_digits)

    def and_those(self, other: "PrintedDigits") -> "PrintedDigits":
        """Of both tables together."""
        return PrintedDigits(*map(max, self, other))


def printed_digits(text: bytes, columns: int = 1, chosen: np.ndarray | None = None):
    """:class:`PrintedDigits` of the columns ``chosen`` (all by default) of rows of ``columns``
    finite decimal numbers, with blanks between them."""
    view = np.frombuffer(text, np.uint8)
    inked = np.concatenate([[False], view > ord(" "), [False]])
    edges = np.flatnonzero(inked[1:] != inked[:-1]).reshape(-1, columns, 2)
    starts, stops = (edges if chosen is None else edges[:, chosen]).reshape(-1, 2).T
    marks = stops
    if b"e" in text or b"E" in text:
        marks = _first(np.flatnonzero(view | 32 == ord("e")), starts, stops)
    points = _first(np.flatnonzero(view == ord(".")), starts, marks)
    digits = _first(np.flatnonzero((view >= ord("1")) & (view <= ord("9"))), starts, marks)
    decimals = np.maximum(marks - points - 1, 0)
    for i in np.flatnonzero(marks < stops).tolist():
        decimals[i] -= int(text[marks[i] + 1 : stops[i]])
    significant = marks - digits - ((digits < points) & (points < marks))
    return PrintedDigits(int(decimals.max(initial=0)), int(significant.max(initial=0)))


def _first(places: np.ndarray, starts: np.ndarray, stops: np.ndarray) -> np.ndarray:
    """The first of the sorted ``places`` in each range, its stop if there is none."""
    following = np.append(places, np.iinfo(places.dtype).max)[np.searchsorted(places, starts)]
    return np.minimum(following, stops)

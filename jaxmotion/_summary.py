"""What a result says of itself where a notebook, a debugger or an error prints it: one line.

    Motion(240 frames, 4.00 s at 60 fps, 22 joints from Hips, y up, float32)
    WarpPath(cost=0.7313, path=i32[47,2], length=24)

In words, where a type has some, else by field. Nothing is computed: shapes and dtypes are there,
and a few numbers are read of arrays that are known. A tree map puts anything in the place of arrays
(None, shapes, other types), and a constructor that fails leaves fields out: no words fit those, and
they are shown by field.
"""

import dataclasses
import html
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxmotion._file_facts import FileFact
from jaxmotion._plain import printable, some

_LONGEST = 119  # characters of a line,
_LONGEST_VALUE = 60  # and of a value in it
_LONGEST_NAME = 24
_NUMBERS = 64  # that are read of an array


def line(thing: Any, words: Callable[[], Iterable[str]] | None = None) -> str:
    """``Name(word, word)``, or by field without words or where they do not fit what is there."""
    said = _joined(words) if words else None
    inside = ", ".join(by_field(thing)) if said is None else said
    return cut(printable(f"{type(thing).__name__}({inside})"), _LONGEST)


def _joined(words: Callable[[], Iterable[str]]) -> str | None:
    try:
        return ", ".join(words())
    except (AttributeError, IndexError, TypeError, ValueError):
        return None


def by_field(thing: Any) -> list[str]:
    """``name=value`` of every public field there is; what only its file says is left out."""
    fields = getattr(thing, "_fields", None) or [f.name for f in dataclasses.fields(thing)]
    held = getattr(thing, "__dict__", {})
    return [
        f"{name}={brief(getattr(thing, name))}"
        for name in fields
        if name[0] != "_" and hasattr(thing, name) and not isinstance(held.get(name), FileFact)
    ]


def brief(value: Any) -> str:
    """A value in a few characters: numbers to four digits, arrays as ``f32[240,3]``."""
    if isinstance(value, (bool, np.bool_)):
        return str(bool(value))
    if isinstance(value, (float, np.floating)):
        return f"{value:.4g}"
    if isinstance(getattr(value, "shape", None), tuple) and hasattr(value, "dtype"):
        return _array(value)
    if type(value) in (tuple, list):
        inside = ", ".join(map(brief, value[:_NUMBERS]))
        text = f"({inside}{',' * (len(value) == 1)})" if type(value) is tuple else f"[{inside}]"
    else:
        text = _of_others(value)
    if len(text) <= _LONGEST_VALUE or isinstance(value, str):
        return cut(text, _LONGEST_VALUE)
    return f"{type(value).__name__}(…)"


def _of_others(value: Any) -> str:
    try:
        return printable(repr(value))
    except Exception:  # another library's, of what a tree map put into it
        return f"{type(value).__name__}(…)"


def _array(x: Any) -> str:
    if x.shape == () and (value := numbers(x)) is not None:
        return brief(value.item())
    kind = str(x.dtype)
    for long, short in (("float", "f"), ("uint", "u"), ("int", "i"), ("complex", "c")):
        kind = kind.replace(long, short)
    return f"{kind}[{','.join(map(str, x.shape))}]"


def numbers(x: Any, most: int = _NUMBERS) -> np.ndarray | None:
    """The values of an array of no more than ``most``; None for more, and for what is not here to
    be read: traced, a mere shape, given away, on another machine."""
    if isinstance(x, jax.Array):
        if isinstance(x, Tracer) or x.is_deleted() or not x.is_fully_addressable:
            return None
    elif not isinstance(x, (np.ndarray, np.generic, float, int)):
        return None
    kind = getattr(x, "dtype", np.dtype(type(x)))
    counts = any(jnp.issubdtype(kind, of) for of in (np.number, np.bool_))  # no random keys
    return np.asarray(x) if counts and np.size(x) <= most else None


# Words


def batched(batch: Sequence[int], noun: str, each: str) -> str:
    """``each``, or of a batch of them "8 clips of" it, "(2, 8) clips of" it."""
    if len(batch) < 2:
        return f"{some(batch[0], noun)} of {each}" if batch else each
    return f"{tuple(batch)} {noun}s of {each}"


def moving(x: Any, noun: str = "clip") -> Iterator[str]:
    """Frames and joints of an array (*batch, frames, joints, components)."""
    *batch, frames, joints, _ = x.shape
    yield batched(batch, noun, some(frames, "frame"))
    yield some(joints, "joint")


def timing(frames: int, frame_time: Any) -> list[str]:
    """ "4.00 s at 60 fps", where the frame time is known and one; of a batch from least to most."""
    read = numbers(frame_time)
    if read is None or not read.size or not np.all((read > 0) & (read < math.inf)):
        return []
    shortest, longest = float(read.min()), float(read.max())
    length, rate = _seconds(frames * shortest), f"{1 / longest:.6g}"
    if _seconds(frames * longest) != length:
        length = f"{length} to {_seconds(frames * longest)}"
    if f"{1 / shortest:.6g}" != rate:
        rate = f"{rate} to {1 / shortest:.6g}"
    return [f"{length} s at {rate} fps"]


def _seconds(x: float) -> str:
    return f"{x:.2f}" if x >= 1 else f"{x:.3g}"


def per_frame(x: Any) -> str:
    """ "240 frames of f64[22,3]"."""
    frames, *channels = x.shape
    return f"{some(frames, 'frame')} of {_array(jax.ShapeDtypeStruct(tuple(channels), x.dtype))}"


def kept_as(x: Any) -> str:
    """The dtype, and what else than an array of JAX's that is known it is."""
    if isinstance(x, Tracer):
        return f"{x.dtype}, traced"
    if isinstance(x, jax.ShapeDtypeStruct):
        return f"{x.dtype}, shapes alone"
    return f"{x.dtype}, NumPy" if isinstance(x, np.ndarray) else f"{x.dtype}"


def called(names: Sequence[str], most: int = 1) -> str:
    """The first of some names, which are anybody's text."""
    shown = ", ".join(cut(printable(name), _LONGEST_NAME) for name in names[:most])
    return shown + ", …" * (len(names) > most > 1)


def cut(text: str, most: int) -> str:
    """``text``, or its beginning."""
    return text if len(text) <= most else f"{text[: most - 1]}…"


# More than a line


def tree(labels: Sequence[str], parents: Sequence[int], notes: Sequence[str]) -> list[str]:
    """A line for each node, below its parent, its note beside it; the root's parent is −1."""
    children: list[list[int]] = [[] for _ in labels]
    for node, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(node)
    rows = list(_branches(labels, children))
    width = max(len(text) for _, text in rows)
    return [f"{text:{width}}  {notes[node]}".rstrip() for node, text in rows]


def _branches(labels: Sequence[str], children: list[list[int]]) -> Iterator[tuple[int, str]]:
    waiting = [(0, "", "")]  # node, what stands before it, and before what hangs from it
    while waiting:
        node, before, below = waiting.pop()
        yield node, before + labels[node]
        for child in reversed(children[node]):
            last = child == children[node][-1]
            arm, on = ("└─ ", "   ") if last else ("├─ ", "│  ")
            waiting.append((child, below + arm, below + on))


def html_table(title: str, rows: Mapping[str, str]) -> str:
    """A table of two columns for a notebook; any text is shown as it is."""
    body = "".join(
        f'<tr><th style="text-align:left">{_escaped(name)}</th>'
        f'<td style="text-align:left">{_escaped(value)}</td></tr>'
        for name, value in rows.items()
    )
    return f"<table><caption>{_escaped(title)}</caption><tbody>{body}</tbody></table>"


def _escaped(text: str) -> str:
    return html.escape(printable(text))

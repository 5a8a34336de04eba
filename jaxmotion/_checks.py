"""Run-time checks: what a wrong value does, everywhere in the package.

A value that is known, of Python, NumPy or JAX, is a ``ValueError``: :func:`one_of` for choices,
:func:`counted` for how many frames count, :func:`one_number` for what is no array, :func:`floating`
for arrays that are kept, :func:`require` for all others; :func:`instance_of` and :func:`no_module`
for what is another thing altogether. One that is traced (:func:`traced`) is only known when the
program runs, and then the setting decides (:func:`checks`):

    "raise"   the program stops with the message (``equinox.EquinoxRuntimeError``; under a
              ``jax.jit`` of your own, JAX's ``JaxRuntimeError``), which under ``vmap`` names the
              batch element; costs a callback to the host, so that the program can be neither
              exported nor kept in the compilation cache (eager calls of the library's own compile
              another where programs are kept: :func:`jaxmotion._program.keepable`)
    "nan"     what the function computes from the faulty element is NaN, other elements of a batch
              keep their values; whole numbers, and what was chosen from a list, stay as they came
    "off"     nothing

Under ``vmap`` JAX computes both branches of a ``lax.cond``, so that "raise" stops for what is wrong
in the branch that is thrown away too; with "nan" nothing is left of it.

A batch spread over a mesh whose axes are explicit, which is what ``jax.make_mesh`` makes, is for
``jax.shard_map(jax.vmap(f), ..., check_vma=False)``: JAX refuses loops that end at another time for
each element of a sharded axis ("Resource axis .. is not found in mesh"). Use "nan" there: where one
device stops, the others wait for it until XLA ends the process.
"""

import dataclasses
import functools
import inspect
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Literal, ParamSpec, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Int

from jaxmotion._types import AnyArray, ArrayLike, ScalarLike

Mode: TypeAlias = Literal["raise", "nan", "off"]
Fault: TypeAlias = tuple[Bool[Array, ""], str]
Tree = TypeVar("Tree")
P = ParamSpec("P")
R = TypeVar("R")

_MODES = ("raise", "nan", "off")
_BETWEEN = ("equinox", "jaxtyping", "beartype")
_INSIDE = ("jaxmotion", *_BETWEEN)
_SHORTENED = (
    "float64 arrays become float32, as JAX has 64-bit types off; "
    "jax.config.update('jax_enable_x64', True), before anything else, keeps them"
)
_FROM_OUTSIDE = os.environ.get("EQX_ON_ERROR", "raise")
# Part of the key of every cache of JAX: a function traced under one setting is traced again under
# another, whoever compiled it.
_chosen = jax.make_user_context(None)


@contextmanager
def checks(mode: Mode) -> Iterator[None]:
    """Inside this ``with``, what faults do that only show when a compiled program runs.

    Programs under "nan" and "off" call nothing on the host: they can be exported, and the
    persistent compilation cache keeps them. Outside, the environment variable ``EQX_ON_ERROR``
    decides, as for equinox, "raise" by default. The setting is read when a function is traced, and
    is the current thread's; JAX traces again for another mode, your own ``jax.jit`` too. Arguments
    known to Python raise ``ValueError`` in every mode.

    **Arguments:** ``mode``: "raise" stops with the message, which names the element of a batch;
    "nan" makes what the function computes from that element NaN; "off" looks for nothing.
    **Returns:** a context manager.
    **Raises:** ``ValueError`` for another mode.

    **Example:**

        >>> import jax, jaxmotion as jm
        >>> smooth = jax.jit(lambda y, lam: jm.smoothing.lgs(y, lam, 1.0).mean)
        >>> with jm.checks("nan"):
        ...     mean = smooth(jax.numpy.ones(8), -1.0)
        >>> bool(jax.numpy.isnan(mean).all())
        True
    """
    one_of("checks: mode", mode, _MODES)
    with _chosen(mode):
        yield


def traced(*values: Any) -> bool:
    """Whether any array of the values is only known when the program runs."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(values))


def known(value: ArrayLike) -> AnyArray:
    """``value`` as an array: NumPy's, unless it is traced. Ask this of what is checked, as under
    ``jit`` whatever ``jax.numpy`` computes is traced, also from what is known."""
    return value if isinstance(value, Tracer) else np.asarray(value)  # type: ignore[return-value]


def static(*names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """A decorator of public functions: ``ValueError`` where one of the arguments called ``names``
    is traced. Flags and numbers of things decide what is compiled."""

    def marked(function: Callable[P, R]) -> Callable[P, R]:
        parameters = tuple(inspect.signature(function).parameters)
        places = [(name, parameters.index(name)) for name in names]

        @functools.wraps(function)
        def call(*args: Any, **kwargs: Any) -> R:
            for name, place in places:
                value = args[place] if place < len(args) else kwargs.get(name)
                if isinstance(value, Tracer):
                    raise ValueError(
                        f"{function.__name__}: {name} is traced, and must be known when compiling: "
                        f"jax.jit(..., static_argnames={name!r})"
                    )
            return function(*args, **kwargs)

        return call

    return marked


def at_hand(value: ArrayLike) -> np.ndarray | None:
    """``value`` as NumPy's array where a look at it costs nothing: None if it is traced, or lies on
    an accelerator."""
    if isinstance(value, Tracer):
        return None
    if isinstance(value, jax.Array) and any(d.platform != "cpu" for d in value.devices()):
        return None
    return np.asarray(value)


def instance_of(name: str, value: Any, kind: type, expected: str) -> None:
    """``ValueError`` unless ``value`` is a ``kind``; ``name`` as in "denoise: motion", ``expected``
    as in "a jaxmotion.Motion (jaxmotion.load reads files)"."""
    if not isinstance(value, kind):
        raise ValueError(f"{name} is {_described(value)}; expected {expected}")


def no_module(name: str, value: Any, hint: str = "") -> None:
    """``ValueError`` for a motion, or any other module, where an array is wanted; ``name`` as in
    "lgs: y", ``hint``: who takes it."""
    if isinstance(value, eqx.Module):
        arrays = [key for key, x in vars(value).items() if eqx.is_array(x) and np.ndim(x)]
        such = f", such as its {' or '.join(arrays[:2])}" if arrays else ""
        more = f" ({hint})" if hint else ""
        raise ValueError(f"{name} is {_described(value)}; expected an array{such}{more}")


def _described(value: Any) -> str:
    """What a value is, for people: "a str", "an array of shape (40, 22, 4)"."""
    if value is None:
        return "None"
    if isinstance(value, (np.ndarray, jax.Array)):
        return f"an array of shape {value.shape}"
    kind = type(value).__name__
    return f"{'an' if kind[0] in 'AEIOUaeiou' else 'a'} {kind}"


def one_of(name: str, value: Any, choices: Iterable[Any]) -> None:
    """``ValueError`` unless ``value`` is one of the choices; ``name`` as in "align: method"."""
    choices = tuple(choices)
    if isinstance(value, (np.ndarray, jax.Array)) or value not in choices:
        *others, last = map(repr, choices)
        listed = f"{', '.join(others)} or {last}" if others else last
        raise ValueError(f"{name}={value!r}; expected {listed}")


def one_number(name: str, value: Any) -> Any:
    """:func:`known` of a value that is to be a single number, ``ValueError`` if it is an array;
    ``name`` as in "decompose: gamma"."""
    number = known(value)
    if number.shape != ():
        raise ValueError(f"{name} has shape {number.shape}; expected one number")
    return number


def floating(caller: str, *, whole: bool = False, **arrays: Any) -> list[Any]:
    """The arrays, each of a floating-point type, or ``ValueError``; lists become NumPy's arrays.

    NumPy's of 64 bits, where JAX has none, become float32, which is said once a process; they stay
    if they are to be ``whole``.
    """
    checked = []
    for name, x in arrays.items():
        given = hasattr(x, "dtype")
        x = x if given else np.asarray(x)
        if not jnp.issubdtype(x.dtype, jnp.floating):
            raise ValueError(
                f"{caller}: {name} must be float32 or float64, got {x.dtype}; x.astype(float) is"
            )
        if isinstance(x, np.ndarray) and not (whole or has_type(x.dtype)):
            x = x.astype(jax.dtypes.canonicalize_dtype(x.dtype))
            if given:
                warnings.warn(_SHORTENED, stacklevel=1)  # of one place: Python says it once
        checked.append(x)
    return checked


def asked_from_inside(*modules: str) -> bool:
    """Whether a constructor of ``modules`` was called by the library itself."""
    frame, name = sys._getframe(1), __name__
    while frame.f_back and (name in (__name__, *modules) or name.partition(".")[0] in _BETWEEN):
        frame = frame.f_back
        name = frame.f_globals.get("__name__", "")
    return name.partition(".")[0] == "jaxmotion"


def has_type(dtype: Any) -> bool:
    """Whether JAX has such arrays here: it has none of 64 bits unless asked to."""
    return jax.dtypes.canonicalize_dtype(dtype) == dtype


def warn(caller: str, text: str, category: type[Warning] = UserWarning) -> None:
    """Warn at the line that calls the library, in the name of the function ``caller``."""
    frame, level = sys._getframe(1), 2
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] in _INSIDE:
        frame, level = frame.f_back, level + 1
    warnings.warn(f"{caller}: {text}", category, stacklevel=level)


def counted(
    name: str, length: ScalarLike | None, frames: int, values: Tree = None
) -> tuple[Int[Array, ""], Tree]:
    """How many of the ``frames`` count, all for None, and the ``values`` that depend on it. Frames
    beyond may hold anything finite and change nothing of those that count.

    ``ValueError`` unless it is a whole number from 1 to ``frames``; traced, as
    :func:`raise_faults`, which the values go through. ``name`` as in "decompose: length".
    """
    if length is None:
        return jnp.asarray(frames, jnp.int32), values
    message = f"{name} must be a whole number from 1 to the {frames} frames there are"
    number = known(length)
    integer = jnp.issubdtype(number.dtype, jnp.integer)
    if number.shape != () or not (integer or (not traced(number) and number % 1 == 0)):
        raise ValueError(f"{message}, got {length}")
    wrong = (number < 1) | (number > frames)
    count = jnp.clip(jnp.asarray(number).astype(jnp.int32), 1, frames)
    return require((count, values), wrong, message, got=length)


def require(value: Tree, bad: Any, text: str, *, got: Any = None) -> Tree:
    """``value``, unless ``bad`` (Python, NumPy or JAX, scalar) holds: ``ValueError`` where that is
    known, with ``got``, else as :func:`raise_faults`."""
    return raise_faults(value, fault(bad, text, got=got))


def fault(bad: Any, text: str, *, got: Any = None) -> list[Fault]:
    """What :func:`raise_faults` is to look for, together with others, if ``bad`` is traced; where
    it is known to hold, ``ValueError`` as :func:`require`."""
    if traced(bad):
        return [(bad, text)]
    if known(bad):
        raise ValueError(text if got is None else f"{text}, got {got}")
    return []


def raise_faults(x: Tree, faults: Sequence[Fault]) -> Tree:
    """``x``, unless one of the faults holds when it is computed: the first such is the error.

    One check for all: each check by itself is a callback to trace and compile. Under "nan" the
    floating-point arrays of ``x`` become NaN: let it be what every result is made of.
    """
    if not faults:
        return x
    mode = _mode()
    if mode == "off":
        return x
    return _checked(x, [holds for holds, _ in faults], tuple(text for _, text in faults), mode)


def poisoned(x: Tree, faults: Sequence[Fault]) -> Tree:
    """``x``, NaN under "nan" where one of the faults holds; for results that do not depend on what
    went through :func:`raise_faults`."""
    return _checked(x, [holds for holds, _ in faults], (), "nan") if _mode() == "nan" else x


def _mode() -> str:
    return _chosen.value or _FROM_OUTSIDE


def stops() -> bool:
    """Whether a compiled program stops at what is wrong."""
    return _mode() not in ("nan", "off")


@eqx.filter_jit
def _checked(x: Any, holds: list[Array], texts: tuple[str, ...], mode: str) -> Any:
    stop = functools.reduce(jnp.logical_or, holds) if mode == "nan" else _report(texts, mode)(holds)
    values, others = eqx.partition(x, eqx.is_inexact_array)
    if mode != "nan":  # one branch of the two for all: no pass over the values
        others = jax.tree.map(lambda leaf: _held(leaf, stop), others)
        return eqx.combine(_held_together(values, stop), others)
    return eqx.combine(jax.tree.map(lambda leaf: _spoilt(leaf, stop), values), others)


@jax.custom_jvp
def _spoilt(x: Array, stop: Array) -> Array:
    """x, not a number if ``stop``; a derivative passes as it is."""
    return jnp.where(stop, jnp.asarray(jnp.nan, x.dtype), x)


@jax.custom_jvp
def _held_together(values: Any, stop: Array) -> Any:
    """The values, once ``stop`` is known, which is False; a derivative passes as it is."""
    return jax.lax.cond(stop, lambda x: jax.tree.map(jnp.zeros_like, x), lambda x: x, values)


def _held(leaf: Any, stop: Array) -> Any:
    return jnp.where(stop, jnp.zeros((), leaf.dtype), leaf) if eqx.is_array(leaf) else leaf


@_spoilt.defjvp
def _spoilt_jvp(primals, tangents):
    return _spoilt(*primals), tangents[0]


@_held_together.defjvp
def _held_together_jvp(primals, tangents):
    return _held_together(*primals), tangents[0]


@functools.lru_cache(maxsize=256)
def _report(texts: tuple[str, ...], mode: Any):
    """A function of bool[*batch] of every fault that stops the program where one holds, and returns
    False. Mapped over a batch it is called once, with the axis in front: it sees all elements.
    """

    @jax.custom_batching.custom_vmap
    def report(holds):
        batch = holds[0].shape
        all_codes = int(np.prod(batch)) * len(holds)
        # In one number: the first fault of the first element that has one, and how many have.
        codes = np.arange(all_codes, dtype=np.int32).reshape(*batch, len(holds))
        first = functools.reduce(
            jnp.minimum,
            [
                jnp.min(jnp.where(h, codes[..., i], np.int32(all_codes)))
                for i, h in enumerate(holds)
            ],
        )
        bad = functools.reduce(jnp.logical_or, holds)
        others = jnp.sum(bad, dtype=np.int32) - np.int32(1)
        most = np.int32(np.iinfo(np.int32).max // max(all_codes, 1) - 1)
        code = first + np.int32(all_codes) * jnp.minimum(others, most)
        messages: Any = _Messages(texts, batch)
        return eqx.branched_error_if(
            jnp.zeros((), bool), jnp.any(bad), code, messages, on_error=mode
        )

    @report.def_vmap
    def _(axis_size, in_batched, holds):
        (batched,) = in_batched
        everywhere = [
            h if its else jnp.broadcast_to(h, (axis_size, *h.shape))
            for h, its in zip(holds, batched, strict=True)
        ]
        return report(everywhere), False

    return report


@dataclasses.dataclass(frozen=True)
class _Messages(Sequence):
    """The message of every code of :func:`_report`."""

    texts: tuple[str, ...]
    batch: tuple[int, ...]

    def __len__(self) -> int:
        return np.iinfo(np.int32).max

    def __getitem__(self, code: int) -> str:  # type: ignore[override]
        elements = int(np.prod(self.batch))
        others, first = divmod(int(code), elements * len(self.texts))
        element, fault = divmod(first, len(self.texts))
        if not self.batch:
            return self.texts[fault]
        where = tuple(int(i) for i in np.unravel_index(element, self.batch))
        place = where[0] if len(where) == 1 else where
        more = f", and {others} more of {elements}" if others else f" of {elements}"
        return f"{self.texts[fault]} (batch element {place}{more})"

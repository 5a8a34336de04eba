"""What only a file says of a motion, kept beside what JAX compares.

How the frame time was spelt, the order of the channels, the axes of an ASF's bones: a field
declared with :func:`file_fact` goes from a file to the motion and on to the next file, and no
algorithm depends on it. To JAX all such facts are equal: clips of one skeleton and size share
compiled functions and can be stacked, whoever wrote their files. The field itself reads, is set by
its constructor, copied and pickled like any other.

The price: what JAX remembers under "equal" arguments, it remembers with the facts of the first.

- The library's own compiled functions (:func:`compiled`) hand each result the facts of the clips it
  was made from. Inside, a fact is a stand-in that can be passed on and not read.
- Under a caller's ``jax.jit`` a result has the facts of the clip that was traced. So whatever reads
  facts must be right with another clip's: the writers use a spelling only where it reads back as
  the motion's own frame time, and say any motion in any channels or axes (adding what is missing).
- Clips stacked by ``jax.tree.map`` have the facts of the first.

What changes the meaning of a motion (names, the up axis, the unit of length) is no file fact.
"""

import dataclasses
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

import equinox as eqx
import jax

Function = TypeVar("Function", bound=Callable)
Tree = TypeVar("Tree")


def file_fact() -> Any:
    """A dataclass field of an ``eqx.Module``, static, in which two modules never differ."""
    return eqx.field(static=True, default=_Field())


class FileFact:
    """A fact as JAX sees it: equal to any other, or it would compile anew for every spelling."""

    def __init__(self, value):
        self.value = value

    def __eq__(self, other) -> bool:
        return isinstance(other, FileFact)

    def __hash__(self) -> int:
        return hash(FileFact)

    def __repr__(self) -> str:
        return f"FileFact({self.value!r})"


class _Field:
    """Shows the value, and leaves the :class:`FileFact` where equinox flattens the module from."""

    def __set_name__(self, owner, name: str) -> None:
        self.name = name

    def __get__(self, module, owner=None):
        if module is None:
            return self
        if self.name not in module.__dict__:
            raise AttributeError(self.name)
        return module.__dict__[self.name].value

    def __set__(self, module, value) -> None:
        if value is self:  # a dataclass's own constructor, left to its default
            raise TypeError(f"{type(module).__name__}: {self.name} is missing")
        module.__dict__[self.name] = value if isinstance(value, FileFact) else FileFact(value)


class _StandIn(str):
    """The ``number``-th fact among the arguments of a compiled function; a text, so that it can be
    passed on where a spelling is asked for."""

    number: int

    def __new__(cls, number: int):
        self = super().__new__(cls, f"file fact {number}")
        self.number = number
        return self

    def _unreadable(self, *_):
        raise TypeError("a compiled function passes file facts on, but cannot read them")

    __iter__ = __len__ = __getitem__ = __contains__ = _unreadable  # pyright: ignore


def compiled(function: Function) -> Function:
    """``eqx.filter_jit`` for functions that return what holds file facts; see the module."""
    program = eqx.filter_jit(function)

    @wraps(function)
    def call(*args, **kwargs):
        given: list[FileFact] = []

        def stand_in(fact: FileFact) -> FileFact:
            given.append(fact)
            return FileFact(_StandIn(len(given) - 1))

        def put_back(fact: FileFact) -> FileFact:
            return given[fact.value.number] if isinstance(fact.value, _StandIn) else fact

        args, kwargs = _mapped((args, kwargs), stand_in)
        return _mapped(program(*args, **kwargs), put_back)

    return call  # pyright: ignore[reportReturnType]


def _mapped(tree: Tree, change: Callable[[FileFact], FileFact]) -> Tree:
    """The tree with each of its facts changed, visited in one order for trees of one structure."""
    leaves, structure = jax.tree.flatten(tree, is_leaf=_is_module)
    return structure.unflatten([_changed(x, change) if _is_module(x) else x for x in leaves])


def _is_module(x) -> bool:
    return isinstance(x, eqx.Module)


def _changed(module, change: Callable[[FileFact], FileFact]):
    copy, values = object.__new__(type(module)), dict(vars(module))
    for field in dataclasses.fields(module):
        value = values.get(field.name)
        if isinstance(value, FileFact):
            values[field.name] = change(value)
        elif not field.metadata.get("static", False):
            values[field.name] = _mapped(value, change)
    vars(copy).update(values)
    return copy

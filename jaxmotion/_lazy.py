"""Names that load on first use: of a package (PEP 562), for what is costly to import and not always
needed; from a room above, where a value is asked to show itself."""

import importlib
import importlib.util
import sys
from collections.abc import Callable, Collection, Mapping
from typing import Any


def loader(
    package: str, homes: Mapping[str, str], modules: Collection[str] = ()
) -> Callable[[str], Any]:
    """The ``__getattr__`` of ``package``: a name of ``homes`` comes from that module of the
    package, and each of ``modules`` is itself one. No name may be both."""

    def __getattr__(name: str) -> Any:
        if name in homes:
            value = getattr(importlib.import_module(f"{package}.{homes[name]}"), name)
        elif name in modules:
            value = importlib.import_module(f"{package}.{name}")
        else:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        setattr(sys.modules[package], name, value)
        return value

    return __getattr__


def from_above(module: str, name: str) -> Any:
    """A name of a module that imports the caller's; call it when the name is wanted, not before.
    ``tests/test_architecture.py`` lists who may."""
    return getattr(importlib.import_module(module), name)


class LacksExtra(ImportError):
    """A package that only some functions need is not there; the message says how to get it."""


def extra(module: str, name: str, what: str, *, package: str | None = None) -> Any:
    """A module of an extra of jaxmotion's.

    **Arguments:** ``module``: to import; ``name``: of the extra; ``what`` it is needed for;
    ``package``: that it comes in, where that is called otherwise.
    **Raises:** :class:`LacksExtra` if it is not there.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        raise LacksExtra(_how_to_get(module, name, what, package)) from error


def lacking(module: str, name: str, what: str, *, package: str | None = None) -> str:
    """What :func:`extra` would say; "" if the module is there. Nothing is imported."""
    there = importlib.util.find_spec(module) is not None
    return "" if there else _how_to_get(module, name, what, package)


def _how_to_get(module: str, name: str, what: str, package: str | None) -> str:
    return f"{what} needs {package or module}: pip install 'jaxmotion[{name}]'"

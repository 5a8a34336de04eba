"""What ``help()`` shows of everything public: a name, a text, and a signature that can be read."""

import inspect

import pytest

from tests.test_docstrings import _public

# What an alias shows of its inside where nobody names it.
EXPANDED = ("numpy.generic", "numpy.ndarray", "list | tuple", "UInt32", "Union[jaxtyping", "lambda")
FUNCTIONS = {name: thing for name, thing in _public().items() if not inspect.isclass(thing)}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_are_functions_to_help(name):
    """Under ``jit`` too: an object of any other kind is shown as one of its class."""
    function = FUNCTIONS[name]
    assert inspect.isroutine(function)
    assert function.__name__ == function.__qualname__ == name.rpartition(".")[2]
    assert function.__module__.startswith("jaxmotion")
    assert inspect.isfunction(inspect.unwrap(function))
    assert inspect.getdoc(function) == inspect.getdoc(inspect.unwrap(function))
    assert function.__annotations__


@pytest.mark.parametrize("name", FUNCTIONS)
def test_signatures_name_their_types(name):
    text = str(inspect.signature(FUNCTIONS[name]))
    assert not [inside for inside in EXPANDED if inside in text], text


def test_signatures_of_classes_name_their_types():
    classes = {name: thing for name, thing in _public().items() if inspect.isclass(thing)}
    assert classes
    for name, cls in classes.items():
        if not issubclass(cls, Warning | Exception):
            text = str(inspect.signature(cls))
            assert not [inside for inside in EXPANDED if inside in text], f"{name}{text}"

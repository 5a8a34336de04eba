"""Docstrings of all that is public: one form, and examples that run.

    A first sentence.    **Arguments:** ``name``: ...    **Returns:** ...    **Raises:** ...
    **Example:** >>> ...

Public is what a module's ``__all__`` names.
"""

import ast
import doctest
import functools
import importlib
import inspect
import pkgutil
import re
from pathlib import Path

import equinox as eqx
import pytest

import jaxmotion

PACKAGE = Path(jaxmotion.__file__).parent
SECTIONS = ("Arguments", "Returns", "Raises", "Warns", "Example")
HEADING = re.compile(r"\*\*([\w ]+):\*\*")
ELSEWHERE = re.compile(r"see\s+the\s+module\b(?!\s+for)|as\s+the\s+(?:class|module)")
OTHER_FORMS = re.compile(
    r"^ *(Args|Arguments|Parameters|Returns|Raises|Yields|Attributes|Examples?|Notes?):"
    r"|^ *Raises (?!:)|:param\b|:returns?:|^ *-{4,}$",
    re.MULTILINE,
)


def _own(module):
    """No API: private modules, and the command line, whose docstrings are its help."""
    return any(part[0] == "_" or part == "cli" for part in module.split("."))


@functools.cache
def _public():
    """``module.name`` to what that is, once each, of what is callable."""
    found, seen = {}, set()
    walked = pkgutil.walk_packages(jaxmotion.__path__, "jaxmotion.")
    for module in ["jaxmotion", *(info.name for info in walked)]:
        if _own(module):
            continue
        room = importlib.import_module(module)
        for name in getattr(room, "__all__", ()):
            thing = getattr(room, name)
            if callable(thing) and id(thing) not in seen:
                found[f"{module}.{name}"] = thing
                seen.add(id(thing))
    return found


def _faults_of_function(function):
    doc = inspect.getdoc(function) or ""
    prose, *rest = HEADING.split(doc)
    sections = dict(zip(rest[::2], rest[1::2], strict=True))
    if not prose.partition("\n\n")[0].rstrip().endswith("."):
        yield "no first sentence with a full stop"
    if rest[::2] != [s for s in SECTIONS if s in sections]:
        yield f"sections {rest[::2]}; expected of {SECTIONS}, in that order"
    signature = inspect.signature(function)
    named = re.findall(r"``(\w+)``", sections.get("Arguments", ""))
    if missing := [name for name in signature.parameters if name not in named]:
        yield f"**Arguments:** leaves out {missing}"
    if elsewhere := ELSEWHERE.findall(" ".join(sections.values())):
        yield f"{elsewhere} is no help in help(): say it"
    if "Returns" not in sections and signature.return_annotation is not None:
        yield "no **Returns:**"


def _faults_of_class(cls):
    doc = inspect.getdoc(cls) or ""
    if not doc.partition("\n\n")[0].rstrip().endswith("."):
        yield "no first sentence with a full stop"
    known = {"Fields", *SECTIONS}
    if strange := [head for head in HEADING.findall(doc) if head not in known]:
        yield f"sections {strange}; expected of {known}"
    for name, method in inspect.getmembers(cls, callable):
        if name[0] != "_" and ELSEWHERE.search(inspect.getdoc(method) or ""):
            yield f"{name}: {ELSEWHERE.search(inspect.getdoc(method))[0]}"
    named = re.findall(r"``(\w+)``", doc)
    given = inspect.signature(cls).parameters if issubclass(cls, eqx.Module) else ()
    if missing := [name for name in given if name[0] != "_" and name not in named]:
        yield f"{missing} are not named"


def test_docstrings_of_what_is_public_have_the_form():
    faults = []
    for name, thing in _public().items():
        of = _faults_of_class if inspect.isclass(thing) else _faults_of_function
        faults += [f"{name}: {fault}" for fault in of(thing)]
    assert not faults, "\n".join(faults)


def test_no_docstring_has_another_form():
    wrong = []
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
                for found in OTHER_FORMS.finditer(ast.get_docstring(node) or ""):
                    wrong.append(f"{place}: {getattr(node, 'name', '')}: {found[0].strip()!r}")
    assert not wrong, "\n".join(wrong)


# A test each: long files of few tests would begin last, and one worker wait for them.
@pytest.mark.parametrize("name", _public())
def test_examples_run(name):
    options = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    for example in _examples(name):
        told = []
        runner = doctest.DocTestRunner(verbose=False, optionflags=options)
        runner.run(example, out=told.append)
        assert not runner.failures, "".join(told)


def _examples(name):
    return doctest.DocTestFinder().find(_public()[name], name, module=False, globs={})


def test_what_is_called_by_its_first_name_has_an_example():
    owing = {
        f"jaxmotion.{name}"
        for name in jaxmotion.__all__
        if not inspect.ismodule(getattr(jaxmotion, name))
    }
    without = {name for name in owing if not any(x.examples for x in _examples(name))}
    assert not without

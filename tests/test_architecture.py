"""The house rules that a machine can keep: floors, sizes, no stubs, public names that exist.

A room is a top-level module or package of jaxmotion. Imports point down the floors; on one floor
only the pairs in ``SIDEWAYS`` may meet. A new room is given a floor here first.
"""

import ast
import graphlib
import importlib
import pkgutil
import re
from pathlib import Path

import pytest

import jaxmotion

PACKAGE = Path(jaxmotion.__file__).parent
FLOORS = (
    (
        *("_types", "_numerics", "_checks", "_autodiff"),
        *("_portable", "_summary", "_lazy", "_likely", "_plain", "_file_facts", "_asf_bone"),
        *("_program", "_compilation_cache", "_cluster", "_width", "_caller"),
    ),
    ("quaternion", "linalg", "frames"),
    (
        *("skeleton", "motion", "_entry", "clips", "_levels"),
        *("kinematics", "displacement", "_room"),
        *("confine", "axes", "io", "samples", "_posture", "_stored", "reflection"),
    ),
    ("smoothing", "timing"),
    ("layers", "multiresolution", "style", "cleaning", "contacts", "spacetime"),
    ("metrics", "viz", "augmentation", "corpus"),
    ("cli", "__main__"),
)
FLOOR_OF = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
# Skeleton and Motion are what the rest of their floor speaks, _entry is its door; the others are
# services to an edit.
SIDEWAYS = {
    "_checks": {"_types"},
    "_compilation_cache": {"_plain"},
    "_numerics": {"_types"},
    "_summary": {"_plain", "_file_facts"},
    "_portable": {"_summary"},
    "_asf_bone": {"_portable"},
    "_cluster": {"_lazy", "_plain"},
    "_caller": {"_compilation_cache", "_width"},
    "_program": {"_checks", "_compilation_cache"},
    "motion": {"skeleton"},
    "_entry": {"skeleton", "motion"},
    "clips": {"skeleton", "motion", "_entry"},
    "_levels": {"skeleton"},
    "kinematics": {"skeleton", "motion", "_entry", "_levels"},
    "_posture": {"skeleton", "motion"},
    "_stored": {"skeleton", "motion"},
    "displacement": {"skeleton", "motion", "_entry"},
    "_room": {"motion", "displacement"},
    "confine": {"skeleton", "motion", "_entry", "displacement"},
    "axes": {"skeleton", "motion", "_entry"},
    "reflection": {"skeleton", "motion", "_entry", "kinematics", "_levels", "_posture"},
    "io": {"skeleton", "motion", "_entry", "axes"},
    "samples": {"skeleton", "motion", "_entry", "kinematics"},
    "layers": {"contacts", "spacetime"},
    "multiresolution": {"contacts", "spacetime"},
    "style": {"contacts", "spacetime"},
    "cleaning": {"contacts", "spacetime"},
    "spacetime": {"contacts"},
    "__main__": {"cli"},
}
# Who shows itself with a room above: jaxmotion._lazy.from_above, when it is asked to.
FROM_ABOVE = {"motion.py": {"viz"}}
_JITS = ("filter_jit", "jax.jit")
LINES_A_FILE = 400
LINES_A_FUNCTION = 80

FILES = sorted(PACKAGE.rglob("*.py"))
TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in FILES}
# The top __init__ only names what lives below.
INSIDE = [path for path in FILES if path != PACKAGE / "__init__.py"]


def _name(path):
    return str(path.relative_to(PACKAGE))


def _room(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def _imports(path):
    """(line, dotted path inside jaxmotion) of every import, inside functions too."""
    package = path.relative_to(PACKAGE.parent).parent.parts
    for node in ast.walk(TREES[path]):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name.split(".")
        elif isinstance(node, ast.ImportFrom):
            origin = list(package[: len(package) + 1 - node.level]) if node.level else []
            origin += node.module.split(".") if node.module else []
            for alias in node.names:
                yield node.lineno, [*origin, alias.name]


def _rooms_imported(path):
    for line, (top, *inner) in _imports(path):
        if top == "jaxmotion" and inner and not inner[0].startswith("__"):
            yield line, jaxmotion._HOMES.get(inner[0], inner[0])


def test_every_room_has_a_floor():
    homeless = {_room(path) for path in INSIDE} - set(FLOOR_OF)
    assert not homeless, f"give {sorted(homeless)} a floor in FLOORS"


def test_imports_point_down():
    wrong = []
    for path in INSIDE:
        here = _room(path)
        for line, there in _rooms_imported(path):
            below = FLOOR_OF[there] < FLOOR_OF[here]
            if not (below or there == here or there in SIDEWAYS.get(here, ())):
                wrong.append(f"{_name(path)}:{line}: {here} imports {there}")
    assert not wrong, "\n".join(wrong)


def test_only_what_shows_itself_reaches_up():
    found = {}
    for path in INSIDE:
        for node in ast.walk(TREES[path]):
            is_call = isinstance(node, ast.Call) and ast.unparse(node.func) == "from_above"
            if is_call:
                room = ast.literal_eval(node.args[0]).split(".")[1]
                found.setdefault(_name(path), set()).add(room)
                assert FLOOR_OF[room] > FLOOR_OF[_room(path)], "an ordinary import will do"
    assert found == FROM_ABOVE


def test_imports_have_no_cycle():
    """Between modules, those inside of functions too; a room's own ``__init__`` only gathers it."""
    modules = {path.relative_to(PACKAGE.parent).with_suffix("").parts: path for path in FILES}
    graph = {}
    for module, path in modules.items():
        wanted = {tuple(name) for _, name in _imports(path)}
        wanted |= {name[:-1] for name in wanted}
        graph[module] = {name for name in wanted if name in modules}
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        pytest.fail(" -> ".join(".".join(module) for module in error.args[1]))


def test_only_one_file_touches_the_inside_of_jax():
    inner = ("jax.extend", "jax.interpreters", "jax._src", "jax.lib")
    touching = {
        _name(path)
        for path in FILES
        for _, name in _imports(path)
        if ".".join(name).startswith(inner)
    }
    assert touching == {"_autodiff.py"}


def test_what_holds_file_facts_is_compiled_with_them():
    """jit hands every call the facts of the clip it compiled for; ``compiled`` those of its own."""
    bearers = {"Motion", "Skeleton", "Pyramid", "CompressedMotion", "MotionLayers", "Corrupted"}
    bearers |= {"motion", "skeleton", "pyramid", "layers"}  # arguments, where nothing is annotated
    wrong = []
    for path in set(INSIDE) - {PACKAGE / "_file_facts.py"}:
        for node in ast.walk(TREES[path]):
            if isinstance(node, ast.FunctionDef) and any(
                word in ast.unparse(mark) for mark in node.decorator_list for word in _JITS
            ):
                returned = ast.unparse(node.returns or node.args)
                if bearers & set(re.findall(r"\w+", returned)):
                    wrong.append(f"{_name(path)}:{node.lineno}: {node.name} -> {returned}")
    assert not wrong, "use _file_facts.compiled, or annotate:\n" + "\n".join(wrong)


def test_the_check_sees_every_way_to_import():
    """The walk itself: an upward import in each form is found."""
    forms = (
        "import jaxmotion.cli",
        "from jaxmotion import cli",
        "from jaxmotion.cli import main",
        "from ..cli import main",
        "def f():\n    from .. import cli",
        "from jaxmotion import decompose",
    )
    path = PACKAGE / "quaternion" / "imagined.py"
    for source in forms:
        TREES[path] = ast.parse(source)
        try:
            ((_, room),) = _rooms_imported(path)
        finally:
            del TREES[path]
        assert room in ("cli", "layers"), source


@pytest.mark.parametrize("word", ["TODO", "FIXME", "XXX", "NotImplementedError"])
def test_nothing_is_left_unfinished(word):
    found = [
        f"{_name(path)}:{i}"
        for path in FILES
        for i, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if word in line
    ]
    assert not found, f"{word} in {found}"


def _functions(path):
    for node in ast.walk(TREES[path]):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield node


def test_no_function_is_a_stub():
    stubs = []
    for path in FILES:
        for function in _functions(path):
            body = function.body[1:] if ast.get_docstring(function) else function.body
            empty = all(
                isinstance(node, ast.Pass)
                or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
                for node in body
            )
            described = ast.get_docstring(function) and function.decorator_list  # click groups
            if empty and not described:
                stubs.append(f"{_name(path)}:{function.lineno}: {function.name}")
    assert not stubs, "\n".join(stubs)


def test_sizes():
    large = []
    for path in FILES:
        lines = len(path.read_text(encoding="utf-8").splitlines())
        if lines > LINES_A_FILE:
            large.append(f"{_name(path)} has {lines} lines, at most {LINES_A_FILE}")
        for function in _functions(path):
            size = (function.end_lineno or function.lineno) - function.lineno + 1
            if size > LINES_A_FUNCTION:
                large.append(f"{_name(path)}: {function.name} has {size} lines")
    assert not large, "\n".join(large)


def test_modules_and_public_names_have_docstrings():
    bare = []
    for path in FILES:
        tree = TREES[path]
        if not ast.get_docstring(tree):
            bare.append(_name(path))
        for node in tree.body:
            public = isinstance(node, (ast.FunctionDef, ast.ClassDef)) and node.name[0] != "_"
            if public and not ast.get_docstring(node):
                bare.append(f"{_name(path)}: {node.name}")
    assert not bare, "\n".join(bare)


def test_only_the_command_line_changes_global_settings():
    """And what its user asks to: the folder of compiled programs."""
    guilty = []
    for path in FILES:
        if _room(path) in ("cli", "_compilation_cache"):
            continue
        for node in ast.walk(TREES[path]):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                text = ast.unparse(node.func)
                if text in ("jax.config.update", "np.seterr", "numpy.seterr"):
                    guilty.append(f"{_name(path)}:{node.lineno}: {text}")
                if text in ("warnings.simplefilter", "warnings.filterwarnings") and not any(
                    "catch_warnings" in ast.unparse(item.context_expr)
                    for block in ast.walk(TREES[path])
                    if isinstance(block, ast.With) and node in ast.walk(block)
                    for item in block.items
                ):
                    guilty.append(f"{_name(path)}:{node.lineno}: {text} outside catch_warnings")
    assert not guilty, "\n".join(guilty)


def test_every_module_imports_and_every_public_name_exists():
    names = [info.name for info in pkgutil.walk_packages([str(PACKAGE)], "jaxmotion.")]
    for name in ["jaxmotion", *names]:
        if name.endswith(".__main__"):
            continue
        module = importlib.import_module(name)
        public = getattr(module, "__all__", [])
        assert len(set(public)) == len(public), f"{name}.__all__ repeats a name"
        for attribute in public:
            assert getattr(module, attribute) is not None, f"{name}.{attribute}"


def test_lazy_names_are_public_and_unknown_ones_are_refused():
    assert set(jaxmotion._HOMES) | set(jaxmotion._MODULES) == set(jaxmotion.__all__)
    assert set(jaxmotion.__all__) <= set(dir(jaxmotion))
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        jaxmotion.nothing  # noqa: B018

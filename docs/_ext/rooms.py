"""API pages: every public name once, in rooms, with docstrings as they are written here.

    .. room:: jaxmotion.smoothing

lists what ``__all__`` of a room names, then describes each by the module that it is from, with what
the top of that module says: equations, cost, sources. A thing has one page, under its shortest
public name: ``jaxmotion.load`` is not described in ``jaxmotion.io`` again, but listed there.

Docstrings: ``**Arguments:**`` and ``**Fields:**`` become lists, indented blocks are kept as they
are, Markdown's tables become tables. Signatures are those of the source, with jaxtyping's shapes
and choices spelt out. A reference to a name that is the library's own is shown without a link; one
to a name that does not exist is a warning, and so is a public name that no page describes.
"""

import ast
import builtins
import importlib
import inspect
import pkgutil
import re
import sys
import textwrap
import typing
from functools import cache
from typing import ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

import jaxmotion

LOG = logging.getLogger(__name__)
ROOMS = ("jaxmotion", *(f"jaxmotion.{name}" for name in jaxmotion._MODULES))
HEADING = re.compile(r"[ \t]*\*\*(Arguments|Fields|Returns|Raises|Warns|Example):\*\*[ \t]*")
ITEM = re.compile(r"[;.]\s+(?=``\w+``(?:, ``\w+``)*:)")
MARKED = re.compile(
    r"(``.+?``|:\w+:`[^`]+`|`[^`]+`_|\*\*[^*\s][^*]*\*\*|(?<![\w*[(])\*[a-z ]+\*(?!\w))", re.S
)
SPECIAL = re.compile(r"[*|]|(?<=\w)_(?!\w)")
ROLE = re.compile(r":\w+:`[~.]*([^`]+)`")
TEXT = ".. code-block:: text"
BACK = re.compile(r'<a class="viewcode-back"[^>]*>.*?</a>')
OTHERS = (
    "jax",
    "jaxlib",
    "numpy",
    "equinox",
    "optimistix",
    "lineax",
    "os",
    "pathlib",
    "collections",
)


# What is public


def _own(module):
    return any(part[0] == "_" or part == "cli" for part in module.split("."))


@cache
def modules():
    """Public modules by name, the shortest first."""
    walked = pkgutil.walk_packages(jaxmotion.__path__, "jaxmotion.")
    names = ["jaxmotion", *(found.name for found in walked if not _own(found.name))]
    names.sort(key=lambda name: name.count("."))
    return {name: importlib.import_module(name) for name in names}


@cache
def public():
    """The shortest public name of everything public, and what it is."""
    homes, seen = {}, {}
    for module, room in modules().items():
        for name in getattr(room, "__all__", ()):
            thing = getattr(room, name)
            if inspect.ismodule(thing):
                continue
            key = id(thing) if callable(thing) else (module, name)
            if key not in seen:
                seen[key] = f"{module}.{name}"
                homes[f"{module}.{name}"] = thing
    return homes


@cache
def _by_identity():
    return {id(thing): name for name, thing in public().items() if callable(thing)}


def room_of(name):
    """The room on whose page a public name is."""
    parts = name.split(".")
    return ".".join(parts[:2]) if ".".join(parts[:2]) in ROOMS and len(parts) > 2 else "jaxmotion"


def source_of(name):
    """The module that a public thing is written in."""
    thing = public()[name]
    if not callable(thing):
        return name.rpartition(".")[0]
    return inspect.unwrap(thing).__module__


def anchor_of(module):
    """Of the section of a module on its room's page."""
    return nodes.make_id(f"module-{module}")


@cache
def sections():
    """The modules that have a section, and on which room's page: rather not the first one's."""
    found = {}
    for name in public():
        module, room = source_of(name), room_of(name)
        if room != "jaxmotion" or module not in found:
            found[module] = room
    return found


class Room(SphinxDirective):
    """The page of a room."""

    required_arguments = 1
    option_spec: ClassVar = {
        "from": directives.unchanged
    }  # modules that are described first, in order

    def run(self):
        room = self.arguments[0]
        if room not in ROOMS:
            raise self.error(f"{room} is no room; there are {', '.join(ROOMS)}")
        here = [name for name in public() if room_of(name) == room]
        self.env.rooms_described = getattr(self.env, "rooms_described", set()) | set(here)
        lines = [f".. py:currentmodule:: {room}", "", *written(inspect.getdoc(modules()[room]))]
        groups = {}
        for name in here:
            groups.setdefault(source_of(name), []).append(name)
        order = self._order(room, groups)
        here = [name for module in order for name in sorted(groups[module], key=_line)]
        lines += self._table(room, here)
        for module in order:
            lines += self._group(room, module, groups[module])
        return self.parse_text_to_nodes("\n".join(lines), allow_section_headings=True)

    def _order(self, room, groups):
        """As the room's own file imports them, else by name."""
        first = [f"jaxmotion.{name}" for name in self.options.get("from", "").split()]
        text = inspect.getsource(modules()[room])
        places = {m: text.find(f"from {m} import") for m in groups}
        known = {m: first.index(m) if m in first else len(first) for m in groups}
        return sorted(groups, key=lambda m: (known[m], places[m] < 0, places[m], m))

    def _table(self, room, here):
        named = {f"{room}.{name}" for name in getattr(modules()[room], "__all__", ())}
        aliases = [n for n in sorted(named) if n not in public() and callable(_thing(n) or 0)]
        yield from (".. list-table::", "   :widths: 30 70", "   :class: names", "")
        for name in [*here, *aliases]:
            thing = _thing(name)
            home = _by_identity().get(id(thing), name) if callable(thing) else name
            label = home.removeprefix(f"{room}.")
            yield f"   * - :py:obj:`{label} <{home}>`"
            said = " ".join(" ".join(written(_first(thing))).split())
            yield f"     - {said if callable(thing) else f'``{thing!r}``'}"
        yield ""

    def _group(self, room, module, names):
        short = module.removeprefix(f"{room}.")
        title = short if room != module else "Constants"
        if sections()[module] == room:
            yield from ("", f".. _{anchor_of(module)}:")
        yield from ("", title, "-" * len(title), "")
        if module not in ROOMS and sections()[module] != room:
            yield from (f"More of this file: :mod:`{module}`.", "")
        elif module not in ROOMS:
            first, _, rest = inspect.getdoc(sys.modules[module]).partition("\n\n")
            yield from written(first)
            if rest.strip():
                yield from (".. container:: behind", "")
                yield from (f"   {line}" for line in written(rest))
                yield ""
        for name in sorted(names, key=_line):
            yield from described(name)


class Rooms(SphinxDirective):
    """All rooms, with the first sentence of each."""

    def run(self):
        lines = [".. list-table::", "   :widths: 30 70", "   :class: names", ""]
        for room in ROOMS:
            first = " ".join(" ".join(written(_first(modules()[room]))).split())
            lines += [f"   * - :doc:`{room} <{room.rpartition('.')[2]}>`", f"     - {first}"]
        return self.parse_text_to_nodes("\n".join(lines))


def _line(name):
    """Where in its file something begins."""
    thing = public().get(name)
    try:
        return inspect.getsourcelines(inspect.unwrap(thing))[1]
    except (TypeError, OSError):
        return 0


def _thing(name):
    module, _, attribute = name.rpartition(".")
    thing = getattr(importlib.import_module(module), attribute, None)
    return None if inspect.ismodule(thing) else thing


def _first(thing):
    return (inspect.getdoc(thing) or "").partition("\n\n")[0]


def described(name):
    thing = public()[name]
    if inspect.isclass(thing) and issubclass(thing, Exception) and "__init__" not in vars(thing):
        text = written(inspect.getdoc(thing))  # autodoc asks for a signature, and finds none
        yield from ("", f".. py:exception:: {name.rpartition('.')[2]}", "")
        yield from (f"   {line}" for line in text)
    elif inspect.isclass(thing):
        yield from ("", f".. autoclass:: {name}", "   :members:", "   :member-order: bysource", "")
    elif callable(thing):
        yield from ("", f".. autofunction:: {name}", "")
    else:
        yield from ("", f".. py:data:: {name.rpartition('.')[2]}", f"   :value: {thing!r}", "")


# Docstrings


def written(text):
    """Lines of reST from a docstring."""
    prose, *rest = HEADING.split(text or "")
    lines = _blocks(prose)
    for head, body in zip(rest[::2], rest[1::2], strict=True):
        lines += ["", f"**{head}:**", ""]
        body = textwrap.dedent(body.strip("\n"))
        if head in ("Arguments", "Fields") and not body.lstrip().startswith("- "):
            lines += _items(body)
        else:
            lines += _blocks(body.lstrip("\n"))
    return [*lines, ""]


def _items(body):
    """``a``: ...; ``b``: ... as a list; what follows in paragraphs of its own stays."""
    first, _, rest = body.partition("\n\n")
    items = ITEM.split(" ".join(first.split()))
    lines = [f"- {_plain(item)}" for item in items] if len(items) > 1 else [_plain(items[0])]
    return [*lines, "", *_blocks(rest)]


def _blocks(text):
    """Paragraphs; indented ones as literal blocks, tables of Markdown as tables."""
    lines = []
    for block in re.split(r"\n[ \t]*\n", text):
        if not block.strip():
            continue
        rows = block.strip("\n").splitlines()
        if rows[0].startswith("|") and rows[0].rstrip().endswith("|"):
            lines += _table(rows)
        elif rows[0].startswith("    ") and not rows[0].lstrip().startswith(">>>"):
            lines += _kept(rows)
        else:
            lines += [*_paragraphs(rows), ""]
    return lines


def _kept(rows):
    """A block that stays as it is, but for roles, which nobody reads there."""
    return [TEXT, "", *(ROLE.sub(r"\1", row) for row in rows), ""]


def _plain(text):
    """Prose in which asterisks, bars and underscores are themselves: f[T, *channels]."""
    parts = MARKED.split(text)
    parts[::2] = [SPECIAL.sub(lambda found: "\\" + found[0], part) for part in parts[::2]]
    return "".join(parts)


def _paragraphs(rows):
    """A block whose later lines are indented deeper is prose and then what is kept as it is."""
    if rows[0].lstrip().startswith(">>>"):
        return textwrap.dedent("\n".join(rows)).splitlines()
    if rows[0].lstrip().startswith("- "):
        return textwrap.dedent(_plain("\n".join(rows))).splitlines()
    for i, row in enumerate(rows):
        if i and row.startswith("    "):
            kept = rows[i:]
            stop = next((k for k, r in enumerate(kept) if not r.startswith("    ")), len(kept))
            tail = _paragraphs(kept[stop:]) if kept[stop:] else []
            return [
                *_plain("\n".join(rows[:i])).splitlines(),
                "",
                TEXT,
                "",
                *kept[:stop],
                "",
                *tail,
            ]
    return _plain("\n".join(rows)).splitlines()


def _table(rows):
    cells = [[_plain(c.strip()) for c in row.strip().strip("|").split("|")] for row in rows]
    lines = [".. list-table::", "   :header-rows: 1", ""]
    for row in [cells[0], *cells[2:]]:
        lines += [f"   {'* -' if not i else '  -'} {cell}" for i, cell in enumerate(row)]
    return [*lines, ""]


def process_docstring(app, what, name, obj, options, lines):
    lines[:] = written("\n".join(lines))


def skip_member(app, what, name, obj, skip, options):
    """Fields of named tuples, which the class's docstring tells."""
    return True if (inspect.getdoc(obj) or "").startswith("Alias for field number") else None


# Signatures


def process_signature(app, what, name, obj, options, signature, returns):
    node = _definition(obj)
    if isinstance(node, ast.FunctionDef):
        bound = what == "method" and not isinstance(_raw(name), staticmethod)
        return _parameters(node, bound), _annotation(node.returns, obj)
    if isinstance(node, ast.ClassDef):
        init = [n for n in node.body if isinstance(n, ast.FunctionDef) and n.name == "__init__"]
        if init:
            return _parameters(init[0], True), None
        if issubclass(obj, Exception) or any(field[0] == "_" for field in _fields(node)):
            return "", None
        return _fields_signature(node), None
    return None


def _raw(name):
    """A class's attribute as it is written, by its dotted name."""
    owner, _, attribute = name.rpartition(".")
    for home, thing in public().items():
        if owner.endswith(home.rpartition(".")[2]) and inspect.isclass(thing):
            return inspect.getattr_static(thing, attribute, None)
    return None


def _definition(obj):
    try:
        source = textwrap.dedent(inspect.getsource(inspect.unwrap(obj)))
        return ast.parse(source).body[0]
    except (TypeError, OSError, SyntaxError, IndexError):
        return None


def _parameters(node, bound):
    arguments = node.args
    if bound:
        (arguments.posonlyargs or arguments.args)[:1] = []
    return f"({ast.unparse(_Choices().visit(arguments))})"


def _annotation(node, obj):
    if node is None:
        return None
    return ast.unparse(_Choices().visit(node)).strip("'")


def _fields(node):
    return [
        field.target.id
        for field in node.body
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
    ]


def _fields_signature(node):
    parameters = []
    for field in node.body:
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            text = f"{field.target.id}: {ast.unparse(_Choices().visit(field.annotation))}"
            value = field.value
            if isinstance(value, ast.Call):  # eqx.field(static=True) and the like
                defaults = [k.value for k in value.keywords if k.arg == "default"]
                value = defaults[0] if defaults else None
            parameters.append(text if value is None else f"{text}={ast.unparse(value)}")
    return f"({', '.join(parameters)})"


@cache
def _names():
    """Every name of every module of the library."""
    found = {}
    for module in [m for n, m in sys.modules.items() if n.split(".")[0] == "jaxmotion" and m]:
        for name, thing in vars(module).items():
            found.setdefault(name, thing)
    return found


class _Choices(ast.NodeTransformer):
    """Names of choices, such as ``Criterion``, as the choices; types told as text as types."""

    def visit_Name(self, node):
        thing = _names().get(node.id)
        if typing.get_origin(thing) is typing.Literal:
            return ast.parse(f"Literal{list(typing.get_args(thing))}", mode="eval").body
        return node

    def visit_Constant(self, node):
        if isinstance(node.value, str) and node.value in _names() and node.value[:1].isupper():
            return ast.Name(node.value)
        return node


# References


def missing_reference(app, env, node, contnode):
    """Another name of a thing is a link to its page; what is the library's own, or another's, is
    shown without one."""
    if node.get("refdomain") != "py":
        return None
    target, room = node["reftarget"], node.get("py:module") or "jaxmotion"
    found = _resolved(target, room, node.get("py:class"))
    if found is _ABSENT:
        return None
    home = None if isinstance(found, str) else _by_identity().get(id(found))
    if inspect.ismodule(found):
        room = found.__name__ if found.__name__ in ROOMS else sections().get(found.__name__)
        if room is None:
            return contnode
        anchor = "" if room == found.__name__ else anchor_of(found.__name__)
        return _link(app, node, f"api/{room.rpartition('.')[2]}", anchor, contnode)
    if home is None:
        return contnode
    entry = env.domains.python_domain.objects.get(home)
    return contnode if entry is None else _link(app, node, entry.docname, entry.node_id, contnode)


def _link(app, node, page, anchor, contnode):
    uri = app.builder.get_relative_uri(node["refdoc"], page)
    link = nodes.reference("", "", internal=True)
    link["refuri"] = f"{uri}#{anchor}" if anchor else uri
    link += contnode
    return link


_ABSENT = object()


def _resolved(target, room, cls):
    """The thing that a reference names, as one sees it from a room."""
    inside = [m for n, m in sys.modules.items() if n.startswith(f"{room}.") and m is not None]
    for start in (None, sys.modules.get(room), *inside, jaxmotion):
        found = _walk(target, start)
        if found is not _ABSENT:
            return found
    if cls and (found := _walk(f"{cls}.{target}", sys.modules.get(room))) is not _ABSENT:
        return found
    head, _, rest = target.partition(".")
    if head in _names() and not inspect.ismodule(_names()[head]):
        return _walk(rest, _names()[head]) if rest else _names()[head]
    known = any(
        hasattr(home, target) for home in (builtins, typing, sys.modules["collections.abc"])
    )
    if known or target.partition(".")[0] in OTHERS:
        return target
    return _ABSENT


def _walk(path, start):
    parts = path.split(".")
    if start is None:
        if len(parts) == 1 and parts[0] not in sys.modules:
            return _ABSENT
        for stop in range(len(parts), 0, -1):
            try:
                start = importlib.import_module(".".join(parts[:stop]))
            except (ImportError, ValueError):
                continue
            parts = parts[stop:]
            break
        else:
            return _ABSENT
    for part in parts:
        start = getattr(start, part, _ABSENT)
        if start is _ABSENT:
            return _ABSENT
    return start


def without_backlinks(app, page, template, context, doctree):
    """Pages of source do not lead back: viewcode knows one name for all of a file."""
    if page.startswith("_modules/") and "body" in context:
        context["body"] = BACK.sub("", context["body"])


def check_complete(app, env):
    """Every public name is described, by name."""
    described = set(env.domains.python_domain.objects)
    for name in public():
        if name not in described:
            LOG.warning("%s is public, and on no page", name)


def setup(app):
    app.add_directive("room", Room)
    app.add_directive("rooms", Rooms)
    app.connect("autodoc-process-docstring", process_docstring)
    app.connect("autodoc-skip-member", skip_member)
    app.connect("autodoc-process-signature", process_signature)
    app.connect("missing-reference", missing_reference)
    app.connect("env-check-consistency", check_complete)
    app.connect("html-page-context", without_backlinks)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

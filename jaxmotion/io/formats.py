"""The file formats, a row each: what ``load``, ``save`` and the command line go by.

A new format is a module with a reader and a writer that take what those of :mod:`jaxmotion.io.bvh`
take, and a row. Two formats may share a suffix if archives tell them apart; one may be only read,
or only written. Nothing is imported to read the table.
"""

import zipfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

from jaxmotion._lazy import extra, lacking
from jaxmotion.io.errors import MotionFileError

if TYPE_CHECKING:
    from jaxmotion.motion import Motion

Up: TypeAlias = Literal["x", "y", "z", "auto"]  # what a reader is told
UpOut: TypeAlias = Literal["x", "y", "z", "keep"]  # what a writer is told


class Format(NamedTuple):
    """``suffix`` of its files; ``load`` and ``save``, "module:function" in :mod:`jaxmotion.io`,
    None if it is only written or only read; ``knows``: tells its files from others of that suffix
    that come before it in the table; ``arrays``: of archives, the names of which it holds one set;
    ``beside``: suffix of the file that goes with each; ``finds``: the function that finds it for a
    file that is read; ``note``: the function of a motion that says what viewers make of its rate,
    of formats for other programs, whose writers take ``metres``; ``needs``: the extra that its
    writer needs, as :func:`jaxmotion._lazy.extra` has it: module, extra, what for, package."""

    suffix: str
    load: str | None
    save: str | None
    knows: str | None = None
    arrays: tuple[frozenset[str], ...] = ()
    beside: str | None = None
    finds: str | None = None
    note: str | None = None
    needs: tuple[str, str, str, str] | None = None


_GLTF = ("pygltflib", "gltf", "writing .glb files", "pygltflib")
_USD = ("pxr", "usd", "writing .usda and .usdc files", "usd-core")
FORMATS = (
    Format(".bvh", "bvh:load_bvh", "bvh:save_bvh"),
    Format(".amc", "asfamc:load_amc", "asfamc:save_amc", beside=".asf", finds="asfamc:asf_beside"),
    Format(".npz", "npz:load_npz", "npz:save_npz", arrays=(frozenset({"jaxmotion_motion"}),)),
    Format(
        ".npz",
        "amass:load_amass",
        None,
        knows="amass:is_amass",
        arrays=(frozenset({"poses", "trans"}), frozenset({"root_orient", "pose_body", "trans"})),
    ),
    Format(".glb", None, "gltf:save_glb", note="gltf:viewer_note", needs=_GLTF),
    Format(".usda", None, "usd:save_usd", note="usd:viewer_note", needs=_USD),
    Format(".usdc", None, "usd:save_usd", note="usd:viewer_note", needs=_USD),
)
SUFFIXES = tuple(dict.fromkeys(row.suffix for row in FORMATS if row.load))  # of what is read
WRITTEN = tuple(dict.fromkeys(row.suffix for row in FORMATS if row.save))


def reader(path: Path) -> Callable:
    """The function that reads a file.

    **Raises:** :class:`MotionFileError` for a suffix that is not in the table, or only written.
    """
    rows = [(row, row.load) for row in _rows(path) if row.load is not None]
    if not rows:
        raise _written_only(path) if _rows(path) else unknown_suffix(path, writing=False)
    for row, load in rows[1:]:
        if row.knows is not None and _named(row.knows)(path):
            return _named(load)
    return _named(rows[0][1])


def writer(path: Path) -> Callable[..., None]:
    """The function that writes a file of that suffix; errors as :func:`reader`."""
    for row in _rows(path):
        if row.save is not None:
            return _named(row.save)
    raise unknown_suffix(path, writing=True)


def files_of(path: Path) -> list[Path]:
    """The files that a motion is written to."""
    return [path, *(path.with_suffix(row.beside) for row in _rows(path) if row.beside)]


def read_with(path: Path) -> list[Path]:
    """The files that are read along with one; none where reading it will tell that they lack."""
    found = []
    for row in _rows(path):
        if row.finds is not None:
            with suppress(OSError, ValueError):
                found.append(_named(row.finds)(path))
    return found


def for_other_programs(path: Path) -> bool:
    """Whether files of that suffix are for other programs; their writers take ``metres``."""
    return any(row.note for row in _rows(path))


def viewer_note(path: Path, motion: "Motion") -> str:
    """What people should know who open a file of that suffix, of that motion, elsewhere; "" for
    nothing."""
    return next((_named(row.note)(motion) for row in _rows(path) if row.note), "")


def extra_of(suffix: str) -> Any:
    """The package that files of a suffix are written with; :class:`LacksExtra` if it is not
    there."""
    needs = (row.needs for row in FORMATS if row.suffix == suffix)
    module, name, what, package = next(filter(None, needs))
    return extra(module, name, what, package=package)


def lacking_for(path: Path) -> str:
    """How to get what files of that suffix are written with; "" if it is there, or none is
    needed."""
    for row in _rows(path):
        if row.needs is not None:
            module, name, what, package = row.needs
            return lacking(module, name, what, package=package)
    return ""


def may_hold_a_motion(path: Path) -> bool:
    """Whether a file found in a folder is one to read: of a suffix of the table, and an archive
    with the arrays of a motion. What cannot be looked into is: reading it will tell."""
    rows = _rows(path)
    wanted = [names for row in rows for names in row.arrays]
    if not wanted:
        return any(row.load for row in rows)
    try:
        with zipfile.ZipFile(path) as archive:
            held = {name.removesuffix(".npy") for name in archive.namelist()}
    except (OSError, zipfile.BadZipFile):
        return True
    return any(names <= held for names in wanted)


def unknown_suffix(path: Path, *, writing: bool) -> MotionFileError:
    """What to say of a name whose suffix is not in the table; it lists those that are, and are
    written or read."""
    suffix = path.suffix.lower()
    main = [row.suffix for row in FORMATS if row.beside == suffix]
    hint = "give one of those suffixes"
    if main:
        hint = f"name the {main[0]} file; its {suffix} skeleton is found beside it"
    return MotionFileError(
        path,
        f"the suffix {suffix!r}" if suffix else "no suffix",
        expected=_listed(row for row in FORMATS if (row.save if writing else row.load)),
        hint=hint,
    )


def _written_only(path: Path) -> MotionFileError:
    suffix = path.suffix.lower()
    return MotionFileError(
        path,
        f"the suffix {suffix!r}, a format that is written only",
        expected=_listed(row for row in FORMATS if row.load),
        hint="keep the motion in a format that is read, such as .npz, beside it",
    )


def _listed(rows: Iterable[Format]) -> str:
    *others, last = dict.fromkeys(
        row.suffix if row.beside is None else f"{row.suffix} (with its {row.beside})"
        for row in rows
    )
    return f"{', '.join(others)} or {last}"


def _rows(path: Path) -> list[Format]:
    suffix = path.suffix.lower()
    return [row for row in FORMATS if row.suffix == suffix]


def _named(place: str) -> Callable:
    module, _, name = place.partition(":")
    return getattr(import_module(f"jaxmotion.io.{module}"), name)

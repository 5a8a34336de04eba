"""Pages that are shown: where they go, and the browser they are opened in."""

import functools
import os
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from jaxmotion._plain import irregular, printable
from jaxmotion.cli._terminal import say

_NAME = 60  # letters of a temporary page's name that are the clip's


@dataclass(frozen=True)
class Showing:
    """What the options of :func:`showing_options` say: ``out`` is None for a temporary file."""

    out: Path | None
    overwrite: bool
    opens: bool

    def check(self, sources: "list[Path]") -> None:
        """Refuse to write over what is there, or over an input."""
        from jaxmotion.cli import _files

        if self.out is None:
            return
        if _files.overlaps(sources)(self.out):
            raise click.UsageError(f"{self.out} would be written over an input")
        if kind := irregular(self.out):
            raise click.ClickException(f"{self.out} cannot be written: {kind}, not a file")
        if self.out.exists() and not self.overwrite:
            raise click.ClickException(f"{self.out} exists; add --overwrite")

    def show(self, page: str, name: str) -> None:
        """Write a page and open it; of a temporary file ``name`` is a part of the name."""
        from jaxmotion.io.atomic import atomic_write

        out = self.out or Path(tempfile.mkdtemp(prefix="jaxmotion-")) / f"{name[:_NAME]}.html"
        out.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(out, overwrite=self.overwrite or self.out is None) as file:
            file.write(page.encode())
        say(f"{printable(out)}: {out.stat().st_size / 1e6:.2g} MB", err=True)
        if self.opens and (not _has_screen() or click.launch(out.resolve().as_uri())):
            say("no browser could be opened: open the file in one.", err=True)


def _has_screen() -> bool:
    """Whether a browser can be shown, as far as the system tells."""
    named = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))
    return named or not sys.platform.startswith("linux") or "WSL_DISTRO_NAME" in os.environ


def showing_options(function: Callable) -> Callable:
    """``-o --overwrite --no-open``; the command is given ``showing``."""

    @click.option(
        "-o",
        "--out",
        type=click.Path(dir_okay=False, path_type=Path),
        callback=_html,
        help="Where to write the page, an .html file.  [default: a temporary file]",
    )
    @click.option("--overwrite", is_flag=True, help="Replace a page that exists.")
    @click.option("--no-open", is_flag=True, help="Do not open the page in a browser.")
    @functools.wraps(function)
    def command(*args, out: Path | None, overwrite: bool, no_open: bool, **values):
        return function(*args, showing=Showing(out, overwrite, not no_open), **values)

    return command


def _html(ctx: click.Context, param: click.Parameter, value: Path | None) -> Any:
    if value is not None and value.suffix.lower() not in (".html", ".htm"):
        raise click.BadParameter(f"{value} is no .html file", ctx, param)
    return value


def _apart(paths: list[Path]) -> list[str]:
    """The paths without the folders that all of them begin with."""
    parts = [path.parts for path in paths]
    same = 0
    while all(len(x) > same + 1 and x[same] == parts[0][same] for x in parts):
        same += 1
    return [str(Path(*x[same:])) for x in parts]


def names_of(paths: list[Path]) -> list[str]:
    """What to call files beside each other: by their names, or what tells them apart."""
    names = [path.stem for path in paths]
    if len(set(names)) < len(names):
        names = [path.name for path in paths]
    if len(set(names)) < len(names):
        names = _apart(paths)
    names = [printable(name) for name in names]
    if len(set(names)) < len(names):  # one file several times, or what does not print
        names = [f"{name} ({number})" for number, name in enumerate(names, 1)]
    return names

"""The table of commands, loaded one by one as needed, and how every run ends."""

import difflib
import importlib
import pkgutil
import sys
import traceback
from collections.abc import Sequence
from typing import Any

import click

from jaxmotion import __version__, cli
from jaxmotion._lazy import LacksExtra
from jaxmotion._plain import in_words, printable
from jaxmotion.cli._terminal import refusal, say, show, silence

_STEM = 6  # letters that words of one stem share, as "exaggerate" and "exaggeration"


class CommandTable(click.Group):
    """A group whose commands are the modules of :mod:`jaxmotion.cli`."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the command modules, in alphabetical order."""
        return sorted(m.name for m in pkgutil.iter_modules(cli.__path__) if m.name[0] != "_")

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the module called ``cmd_name`` and return its command."""
        if cmd_name not in self.list_commands(ctx):
            return None
        return importlib.import_module(f"{cli.__name__}.{cmd_name}").command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click's, but a name that is no command's gets a suggestion."""
        if self.get_command(ctx, args[0]) is None and not args[0].startswith("-"):
            near = self._near(ctx, args[0])
            hint = f"did you mean {' or '.join(near)}?" if near else "jaxmotion --help lists them"
            raise click.UsageError(f"there is no command {args[0]!r}; {hint}", ctx)
        return super().resolve_command(ctx, args)

    def _near(self, ctx: click.Context, name: str) -> list[str]:
        """Commands that are spelt alike, else those whose help speaks of it."""
        commands = self.list_commands(ctx)
        if alike := difflib.get_close_matches(name.lower(), commands, n=2):
            return alike
        stem, near = name.lower()[:_STEM], []
        for other in commands:
            command = self.get_command(ctx, other)
            words = f"{command.short_help} {command.help}".lower().split() if command else []
            near += [other] if any(word.startswith(stem) for word in words) else []
        return near[:3]

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; trouble it did not foresee ends in one line, not in a traceback."""
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.Abort, click.exceptions.Exit, BrokenPipeError):
            raise
        except Exception as error:
            debug = bool(ctx.meta.get("jaxmotion.debug"))
            if debug:
                say(*traceback.format_exc().splitlines(), err=True)
            raise click.ClickException(described(error, debug=debug)) from None

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        **extra: Any,
    ) -> Any:
        """Run and leave with one of the module's exit codes."""
        if not standalone_mode:
            return super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
        try:
            code = super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
            sys.stdout.flush()
        except click.ClickException as error:
            show(error)
            code = error.exit_code
        except (click.Abort, KeyboardInterrupt) as error:
            say("Interrupted.", *filter(None, error.args), err=True)
            code = 130
        except OSError as error:  # of the last flush: all others have become a ClickException
            silence(sys.stdout)
            if not isinstance(error, BrokenPipeError):
                show(refusal(error))
            code = 1
        sys.exit(code if isinstance(code, int) else 0)


def described(error: BaseException, *, debug: bool = False) -> str:
    """One line on what went wrong, fit for someone who did not write the program."""
    from jaxmotion.io import MotionFileError

    if isinstance(error, MotionFileError):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        where = f"{printable(error.filename)}: " if error.filename else ""
        return f"{where}{in_words(error)}"
    text = " ".join(str(error).split()) or "no message"
    if isinstance(error, LacksExtra):
        return text
    if isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in text:
        return "not enough memory for this file"
    if not isinstance(error, (ValueError, OSError)):
        text = f"unexpected {type(error).__name__}: {text}"
    return text if debug else f"{text} (--debug shows where)"


@click.group(
    cls=CommandTable,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, prog_name="jaxmotion")
def app() -> None:
    """Clean, edit and convert motion captures: BVH, ASF/AMC, AMASS and npz;
    to glTF and USD for other programs.

    FILES are files, folders (searched through) or patterns such as 'takes/*.bvh'. Edited files go
    to -o, never over their originals.

    Exit codes: 0 success, 1 some files failed, 2 usage, 3 check found problems, 130 interrupted,
    143 terminated.
    """

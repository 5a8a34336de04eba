"""What the program says: every line to stdout and stderr passes here, made printable.

Progress and complaints never stop the work: a stderr that is closed, full or gone is left. Results
on stdout that cannot be written end the run.
"""

import errno
import io
import os
import sys
from contextlib import suppress
from typing import Any

import click

from jaxmotion._plain import as_json, in_words, printable


class Notice(UserWarning):
    """What a command has to say of a motion besides its result; told with the file's name."""


def make_ready() -> None:
    """Give the process the three streams that it may have been started without: the next file it
    opens would take the place, and get what was meant for a terminal."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    make_streams_lenient()


def make_streams_lenient() -> None:
    """Escape what an encoding lacks."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def say(*lines: object, err: bool = False) -> None:
    """Print lines, each on one line whatever is in it.

    **Raises:** ``BrokenPipeError`` if nobody reads stdout any more; ``click.ClickException`` if it
    cannot be written. Nothing about stderr.
    """
    _put("".join(f"{printable(line)}\n" for line in lines), err)


def say_json(value: Any) -> None:
    """Print a value as JSON, in ASCII where stdout lacks a character."""
    text = as_json(value, indent=1)
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeError:
        text = as_json(value, indent=1, ascii_only=True)
    _put(text + "\n", False)


def show(error: click.ClickException) -> None:
    """Print a complaint, with its usage line if it has one."""
    # First: click would take colour sequences out of names.
    vars(error)["message"] = "\n".join(map(printable, error.message.split("\n")))
    text = io.StringIO()
    error.show(file=text)
    say(*text.getvalue().removesuffix("\n").split("\n"), err=True)


def silence(stream: Any) -> None:
    """Send what is still buffered for a stream, and all that follows, nowhere."""
    with suppress(OSError, ValueError), open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


def refusal(error: OSError) -> click.ClickException:
    """What to say of a stdout that cannot be written."""
    return click.ClickException(f"standard output cannot be written: {in_words(error)}")


def _put(text: str, err: bool) -> None:
    try:
        click.echo(text, nl=False, err=err)
    except OSError as error:
        silence(sys.stderr if err else sys.stdout)
        if err:
            return
        if error.errno == errno.EPIPE:
            raise
        raise refusal(error) from error

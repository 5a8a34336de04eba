"""Leaving before the end: on a signal, or because the parent process is gone.

A signal may come at any time: while a library is half imported, or in code that swallows what it
does not know. So it is no exception that has to find its way out. The handler does the few things
that must not be left undone (temporary files, workers, a terminal's cursor) and ends the process,
with exit code 128 + the signal's number: 130 after Ctrl-C, 143 after SIGTERM.
"""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")

_acts: list[Callable[[], object]] = []
_words: list[Callable[[], str]] = []
_leaving = threading.Event()


def on_signals() -> None:
    """Leave on the signals that ask for it, if the process is not told to ignore them."""
    for name in _SIGNALS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda signum, frame: leave(128 + signum, b"Interrupted.\n"))


def with_parent() -> None:
    """In a worker: leave Ctrl-C to the parent, leave quietly on other signals, and as soon as the
    parent is gone, however it went and whatever the worker is at."""
    for name in _SIGNALS:
        number = getattr(signal, name, None)
        if number is not None:
            signal.signal(number, lambda signum, frame: leave(128 + signum))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from multiprocessing import parent_process

    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_outlive, args=(parent.join,), daemon=True).start()


@contextmanager
def last_act(act: Callable[[], object]) -> Iterator[None]:
    """Have ``act`` done should the process leave while the block runs."""
    _acts.append(act)
    try:
        yield
    finally:
        _acts.remove(act)


@contextmanager
def last_word(words: Callable[[], str]) -> Iterator[None]:
    """Have a line said last of all should the process be interrupted while the block runs, by
    whatever way; an empty one is none."""
    _words.append(words)
    try:
        yield
    except KeyboardInterrupt:  # no handler was set: the table of commands says it
        import click

        raise click.Abort(words()) from None
    finally:
        _words.remove(words)


def always(act: Callable[[], object]) -> None:
    """Have ``act`` done whenever the process leaves before its end."""
    if act not in _acts:
        _acts.append(act)


def leave(code: int, message: bytes = b"") -> None:
    """Do the last acts, newest first, and end the process here and now."""
    if not _leaving.is_set():  # a second signal does not wait for the rest
        _leaving.set()
        for act in reversed(_acts):
            with suppress(Exception):
                act()
        with suppress(Exception):
            lines = [line for words in _words if message and (line := words())]
            os.write(2, message + "".join(f"{line}\n" for line in lines).encode())
    os._exit(code)


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Keep interrupts back while a process is started, which inherits that: a terminal's Ctrl-C
    goes to it as well, and would find it without a handler."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _outlive(wait: Callable[[], object]) -> None:
    wait()
    leave(1)

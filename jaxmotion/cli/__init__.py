"""The command line, ``jaxmotion COMMAND FILES… -o OUT``.

One file a command: any module here whose name does not begin with an underscore is a command, and
defines ``command``, a ``click.Command`` whose docstring is its help. Nothing mathematical happens
here. Modules import only click at the top; JAX and the library load inside functions, so help
never waits for them.

| module | what |
|---|---|
| ``_app`` | finds the commands; exit codes; no tracebacks |
| ``_options`` | options that commands share |
| ``_files`` | files, folders and globs in; where each output goes |
| ``_batch`` | files through an edit: processes, progress, failures, summary |
| ``_work`` | one file through an edit |
| ``_joining`` | several clips into one file |
| ``_session`` | float64, the compile cache, the notice while compiling |
| ``_progress``, ``_report`` | what is told on the way, and at the end |

Exit codes: 0 success, 1 some files failed, 2 usage, 3 ``check`` found problems, 130 interrupted.
"""

import signal
import sys


def main() -> None:
    """Entry point of the ``jaxmotion`` script."""
    from jaxmotion.cli._app import app

    signal.signal(signal.SIGTERM, leave)
    app(prog_name="jaxmotion")


def leave(signum, frame) -> None:
    """A signal handler that leaves by an exception, so that half-written files are removed."""
    sys.exit(128 + signum)

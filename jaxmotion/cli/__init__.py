"""The command line, ``jaxmotion COMMAND FILES… -o OUT``.

The library's own: public are the commands and their exit codes. One file a command: any module here
whose name does not begin with an underscore is a command, and defines ``command``, a
``click.Command`` whose docstring is its help. Nothing mathematical happens here. Modules import
only click at the top; JAX and the library load inside functions, so help never waits for them.

| module | what |
|---|---|
| ``_app`` | finds the commands; exit codes; no tracebacks |
| ``_options`` | options that commands share |
| ``_files`` | files, folders and globs in; where each output goes |
| ``_batch`` | files through an edit: progress, failures, summary |
| ``_workers`` | files side by side, in processes |
| ``_work`` | one file through an edit |
| ``_beside`` | clips that a clip is looked at beside |
| ``_runs`` | runs of errors, in rows and in lines |
| ``_feet`` | what an edit does to the feet; contacts kept |
| ``_padding`` | clips at a few lengths |
| ``_record`` | which options outputs were made with, for ``--resume`` |
| ``_joining`` | several clips into one file |
| ``_reading`` | files that are only read |
| ``_session`` | float64, the notice while compiling, the compile cache |
| ``_terminal`` | everything that is printed |
| ``_leaving`` | signals, and what must not be left undone |
| ``_progress`` | what is told on the way |
| ``_report``, ``_page``, ``_pictures`` | the record of a run, as JSON and as HTML |
| ``_compared`` | clips beside each other, for it |
| ``_showing`` | pages that are opened in a browser |
| ``_learned`` | what smoothers learned, in rows for it |

Exit codes: 0 success, 1 some files failed, 2 usage, 3 ``check`` found problems, 130 interrupted,
143 terminated (128 + the signal's number).
"""


def main() -> None:
    """Entry point of the ``jaxmotion`` script."""
    from jaxmotion.cli import _leaving

    _leaving.on_signals()
    from jaxmotion.cli import _terminal
    from jaxmotion.cli._app import app

    _terminal.make_ready()
    app(prog_name="jaxmotion")

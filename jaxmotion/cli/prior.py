"""``jaxmotion prior``: learn from clean clips how the joints of a body turn together."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jaxmotion.cli._joining import a_file, check_targets
from jaxmotion.cli._options import (
    Reading,
    Running,
    files_argument,
    reading_options,
    report_option,
    running_options,
)
from jaxmotion.cli._terminal import say

if TYPE_CHECKING:
    from jaxmotion import Motion

SUFFIX = ".npz"


@click.command(short_help="Learn how joints turn together, for denoise --prior.")
@files_argument
@click.option("-o", "--out", type=a_file(), required=True, help="The .npz file to write.")
@click.option("--overwrite", is_flag=True, help="Replace an output that exists.")
@report_option
@reading_options
@running_options
def command(
    files: tuple[str, ...],
    out: Path,
    overwrite: bool,
    report: Path | None,
    reading: Reading,
    running: Running,
) -> None:
    """Learn from clean clips in which directions joints turn together.

    All FILES have joints of the same names; performers, styles and frame rates may differ. denoise
    --prior then smooths clips of these joints along the same directions.

    \b
    jaxmotion prior clean-takes -o walkers.npz
    jaxmotion denoise noisy-takes -o out --prior walkers.npz
    """
    from jaxmotion.cli import _files
    from jaxmotion.cli._reading import each, report_of

    if out.suffix.lower() != SUFFIX:
        raise click.UsageError(f"-o {out.name}: a prior is an {SUFFIX} file")
    inputs = _files.expand(files, avoid=out)
    check_targets([out], [source.path for source in inputs], overwrite=overwrite)
    _files.clearing([out])()
    failed = False

    def clips() -> "Iterator[Motion]":
        nonlocal failed
        for item in each(inputs, reading, running):
            record.add(item.outcome({}))
            failed |= item.motion is None
            if item.motion is not None:
                yield item.motion

    with report_of(inputs, report, overwrite) as record:
        from jaxmotion.smoothing import motion_prior

        prior = motion_prior(clips())
        prior.save(out, overwrite=overwrite)
    say(
        f"{out}: how {len(prior.joints)} joints turn together, from {prior.frames} frames", err=True
    )
    raise click.exceptions.Exit(1 if failed else 0)

"""``jaxmotion demo``: the main job on a built-in clip."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from jaxmotion._plain import printable
from jaxmotion.cli._options import Output, Running, running_options

if TYPE_CHECKING:
    from jaxmotion import Motion

_ALPHA = 2.0


@click.command(short_help="Denoise and exaggerate a built-in clip.")
@click.option(
    "-o",
    "--out",
    type=Output(file_okay=False),
    default=Path("jaxmotion-demo"),
    show_default=True,
    help="Folder to write to.",
)
@click.option(
    "--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True, help="Of the noise."
)
@click.option("--overwrite", is_flag=True, help="Replace outputs that exist.")
@running_options
def command(out: Path, seed: int, overwrite: bool, running: Running) -> None:
    """Make a synthetic walk, add noise, remove it, exaggerate it, break two joints of it; write
    the BVH files.

    Then print how far each is from the truth.
    """
    from jaxmotion.cli import _files, _session
    from jaxmotion.cli._work import write

    names = ("clean", "noisy", "denoised", "exaggerated", "broken")
    paths = {name: out / f"{name}.bvh" for name in names}
    there = [path for path in paths.values() if path.exists()]
    if there and not overwrite:
        raise click.ClickException(f"{there[0]} exists; add --overwrite")
    _files.clearing(paths.values())()
    _session.start(cache=running.cache, little=True)
    clips = _clips(seed)
    for name, path in paths.items():
        write(clips[name], path, overwrite=overwrite)
    _print_table(clips, paths)


def _clips(seed: int) -> "dict[str, Motion]":
    import jax

    import jaxmotion as jm

    sample, noisy = jm.samples.clean_and_noisy("walk", seed=seed)
    layers = jm.decompose(noisy.motion, tune="evidence", prior="student")
    return {
        "clean": sample.motion,
        "noisy": noisy.motion,
        "denoised": jm.synthesize(layers, 1.0),
        "exaggerated": jm.synthesize(layers, _ALPHA),
        "broken": jm.samples.offset_joints(sample.motion, jax.random.key(seed), runs=2).motion,
    }


def _print_table(clips: "dict[str, Motion]", paths: dict[str, Path]) -> None:
    import math

    import numpy as np
    from rich.console import Console
    from rich.table import Table

    from jaxmotion import metrics

    truth = clips["clean"]
    table = Table("clip", box=None, pad_edge=False)
    for heading in ("off, mean", "off, most", "turned, most", "shakiness"):
        table.add_column(heading, justify="right")
    for name, clip in clips.items():
        off = np.linalg.norm(
            metrics.world_positions(clip) - metrics.world_positions(truth), axis=-1
        )
        turned = math.degrees(metrics.difference(truth, clip).angle.value)
        table.add_row(
            name,
            f"{100 * off.mean():.2f} cm",
            f"{100 * off.max():.2f} cm",
            f"{turned:.1f}°",
            f"{math.degrees(metrics.bend(clip).mean()):.2f}°",
        )
    frames, joints, fps = truth.num_frames, truth.num_joints, 1.0 / float(truth.frame_time)
    console = Console(markup=False, emoji=False, highlight=False)
    console.print(f"A synthetic walk: {frames} frames at {fps:g} a second, {joints} joints.")
    console.print(table)
    console.print(
        "Off, turned: joints against the clean clip, in the world and in their parents.\n"
        "Shakiness: mean angle between a frame and the midpoint of its neighbours.\n"
        f"The exaggeration multiplies the style by {_ALPHA:g}.\nWritten:"
    )
    for path in paths.values():
        console.print(f"  {printable(path)}", soft_wrap=True)
    both = " ".join(printable(paths[name]) for name in ("noisy", "denoised"))
    console.print(f"See it: jaxmotion compare {both}", soft_wrap=True)
    folder = printable(paths["broken"].parent)
    console.print(f"Find the two errors: jaxmotion repair {folder} --detect-only", soft_wrap=True)

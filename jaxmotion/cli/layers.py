"""``jaxmotion layers``: take a motion apart into base, style and noise."""

from functools import partial
from typing import TYPE_CHECKING

import click

from jaxmotion.cli._files import Job
from jaxmotion.cli._options import Batch, Running, batch_options, running_options

if TYPE_CHECKING:
    import numpy as np

    from jaxmotion.cli._work import Effect
    from jaxmotion.layers import MotionLayers

_NAMES = ("base.bvh", "denoised.bvh", "layers.npz")


@click.command(short_help="Take a motion apart into base, style and noise.")
@batch_options
@click.option(
    "--scope",
    type=click.Choice(["global", "per_joint"]),
    default="global",
    show_default=True,
    help="One smoothness for the body, or one for every joint.",
)
@running_options
def command(batch: Batch, running: Running, scope: str) -> None:
    """Take a motion apart: OUT gets base.bvh, denoised.bvh and layers.npz.

    base.bvh is the smooth gist of the motion, denoised.bvh has its style as well; each keeps at
    least half of a swing that is slower than the Hz that are told. layers.npz holds
    the displacements of style ("control") and noise ("residual"): rotation vectors in radians and
    translations in the file's unit, (frame, joint, 3). For several inputs, OUT gets a folder each.

    \b
    jaxmotion layers walk.bvh -o walk-layers
    """
    from jaxmotion.cli import _files
    from jaxmotion.cli._batch import run

    inputs = _files.expand(batch.files, avoid=batch.out)
    jobs = _files.plan_folders(inputs, batch.out)
    process = partial(_decompose, batch, scope)
    run(process, jobs, batch, running, writes=lambda folder: [folder / name for name in _NAMES])


def _decompose(batch: Batch, scope: str, job: Job) -> "Effect":
    import jaxmotion as jm
    from jaxmotion.cli._compared import compared
    from jaxmotion.cli._learned import of_base
    from jaxmotion.cli._padding import pad, unpadded
    from jaxmotion.cli._work import Clip, Effect, read, write
    from jaxmotion.io.conventions import turned_for

    # All outputs are of one world: turned before anything is taken apart.
    up, overwrite = batch.out_up or "y", batch.overwrite
    motion = turned_for(read(job.source, batch.reading), up, job.target, "layers")  # type: ignore[arg-type]
    padded, length = pad(motion)
    layers = jm.decompose(padded, scope=scope, length=length)  # type: ignore[arg-type]
    denoised = unpadded(jm.synthesize(layers, 1.0, 0.0), length)
    base, denoised_name, _ = _NAMES
    smooth = unpadded(layers.base, length)
    write(smooth, job.target / base, overwrite=overwrite, up=up)
    write(denoised, job.target / denoised_name, overwrite=overwrite, up=up)
    message = _write_displacements(layers, length, job, overwrite)
    learned = of_base(layers) if batch.report is not None else {}
    clips = {"before": motion, "base": smooth, "denoised": denoised}
    beside = compared(clips, batch.report, job.source.name)
    made = Clip.of(denoised)
    return Effect((Clip.of(motion),), made, message, learned=learned, compared=beside)


def _write_displacements(layers: "MotionLayers", length: int, job: Job, overwrite: bool) -> str:
    import numpy as np

    from jaxmotion.io.archive import write_archive
    from jaxmotion.io.atomic import atomic_write

    parts = {"control": layers.control, "residual": layers.residual}
    arrays = {
        f"{name}_{kind}": np.asarray(getattr(part, kind))[:length]
        for name, part in parts.items()
        for kind in ("translations", "rotations")
    }
    arrays |= {name: np.asarray(getattr(layers, name)) for name in ("lam", "sigma", "saturated")}
    arrays["joints"] = np.array(layers.base.skeleton.names)
    with atomic_write(job.target / _NAMES[2], overwrite=overwrite) as file:
        write_archive(file, arrays, compress=True)
    return _summary(arrays, float(layers.base.frame_time))


def _summary(arrays: "dict[str, np.ndarray]", frame_time: float) -> str:
    import numpy as np

    from jaxmotion.smoothing.low_pass import half_gain

    lam, sigma, saturated = (arrays[name] for name in ("lam", "sigma", "saturated"))
    base, style = (_range(half_gain(x, frame_time)) for x in (lam * sigma, np.ones(())))
    ended = f"saturated ({saturated.sum()} of {saturated.size})" if saturated.any() else "bounded"
    turns = []
    for name in ("control", "residual"):
        angle = np.degrees(np.linalg.norm(arrays[f"{name}_rotations"], axis=-1))
        turns.append(f"turns up to {angle.max():.3g}°, rms {np.sqrt(np.mean(angle**2)):.3g}°")
    return (
        f"base below {base} Hz (lambda {_range(lam)}, sigma {_range(sigma)}, {ended}); "
        f"style, below {style} Hz, {turns[0]}; noise {turns[1]}"
    )


def _range(values) -> str:
    low, high = float(values.min()), float(values.max())
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"

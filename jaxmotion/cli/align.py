"""``jaxmotion align``: give one clip the timing of another."""

import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from jaxmotion import __version__
from jaxmotion._plain import as_json
from jaxmotion.cli._joining import Joined, Joining, a_file, join, joining_options
from jaxmotion.cli._options import keep_contacts_option

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion.timing import Alignment

_PLOTS = (".png", ".svg", ".pdf")
_PATTERNS = ("symmetric", "symmetric2", "asymmetric", "slope1", "slope2", "slope3")


def _plot_suffix(ctx: click.Context, param: click.Parameter, value: Path | None) -> Path | None:
    if value is not None and value.suffix.lower() not in _PLOTS:
        raise click.BadParameter(f"{value.name!r} ends neither in .png nor in .svg nor in .pdf")
    return value


@click.command(short_help="Give a clip the timing of another.")
@click.argument("source", type=a_file(exists=True))
@click.argument("reference", type=a_file(exists=True))
@click.option(
    "--method",
    type=click.Choice(["dtw", "warping"]),
    default="dtw",
    show_default=True,
    help="Pair the likest poses, or bend one clip onto the other (the same action in another "
    "posture).",
)
@click.option(
    "--step-pattern",
    "--steps",
    "steps",
    type=click.Choice(_PATTERNS),
    default="symmetric",
    show_default=True,
    help="How unevenly time may run (dtw): slope3 holds a clip for at most 3 frames.",
)
@click.option(
    "--settle",
    type=click.FloatRange(min=0),
    default=2.0,
    show_default=True,
    help="Frames over which the new timing is smoothed.",
)
@click.option(
    "--few-joints",
    is_flag=True,
    help="Go on if less than half of the joints have one of the same name in the other clip.",
)
@click.option("--path", type=a_file(), help="Write the pairs of frames to this .json file.")
@click.option(
    "--plot",
    type=a_file(),
    callback=_plot_suffix,
    help="Draw the pairs of frames into this .png, .svg or .pdf file.",
)
@keep_contacts_option
@joining_options
def command(
    source: Path,
    reference: Path,
    method: Literal["dtw", "warping"],
    steps: str,
    settle: float,
    few_joints: bool,
    path: Path | None,
    plot: Path | None,
    keep_contacts: bool | None,
    joining: Joining,
) -> None:
    """Give SOURCE the timing of REFERENCE: what happens in both happens at the same time.

    Joints are matched by name and compared by their rotations; the root, which says where a clip is
    and which way it faces, is not compared.

    \b
    jaxmotion align walk.bvh limp.bvh -o walk-in-time.bvh --path path.json --plot path.png
    """
    from jaxmotion.cli import _files

    if method == "warping" and steps != "symmetric":
        raise click.UsageError("--steps goes with --method dtw")
    also = [file for file in (path, plot) if file is not None]
    named = [file for file in (joining.out, joining.report, *also) if file is not None]
    if len(set(map(_files.real, named))) < len(named):
        raise click.UsageError("-o, --path, --plot and --report name the same file")
    if plot is not None and not joining.dry_run:
        _require_matplotlib()

    def combine(clips: "list[Motion]") -> Joined:
        from jaxmotion.cli._feet import with_timed_feet
        from jaxmotion.timing import align

        compared, joints = _compared(*clips, few=few_joints)
        found = align(*clips, method=method, step_pattern=steps, settle=settle)
        copy, skate = with_timed_feet(clips[0], found.motion, found.source_frame, keep_contacts)

        def then() -> None:
            if path is not None:
                _write_path(found, path, source, reference, method, overwrite=joining.overwrite)
            if plot is not None:
                _write_plot(found, plot, source, reference, overwrite=joining.overwrite)

        pairs = _pairs(found)
        held, hurried = (
            sum(b[axis] == a[axis] for a, b in itertools.pairwise(pairs)) for axis in (0, 1)
        )
        message = (
            f"{pairs[-1][0] + 1} frames in the time of {pairs[-1][1] + 1}, held {held} times, "
            f"hurried {hurried} times; joints differ by {_degrees(found):.3g}° (rms); "
            f"{compared} of {joints} joints compared"
        )
        learned = {"rms_degrees": _degrees(found), "held": held, "hurried": hurried}
        learned |= {"joints_compared": compared, "joints": joints}
        return Joined(copy, message, skate=skate, learned=learned, then=then)

    join(combine, [source, reference], joining, also=also)


def _compared(source: "Motion", reference: "Motion", *, few: bool) -> tuple[int, int]:
    """How many joints are compared, and how many the skeleton has that has fewer; refused below
    half of them, unless ``few``."""
    from jaxmotion.timing.align import compared_joints

    count = len(compared_joints(source.skeleton, reference.skeleton))
    # The root is not compared, unless it is all there is.
    joints = max(1, min(source.num_joints, reference.num_joints) - 1)
    if not few and 0 < 2 * count < joints:
        text = f"only {count} of {joints} joints have one of the same name in the other clip"
        raise click.ClickException(f"{text}; --few-joints aligns by those")
    return count, joints


def _require_matplotlib() -> None:
    from importlib.util import find_spec

    if find_spec("matplotlib") is None:
        raise click.ClickException("--plot needs Matplotlib: pip install 'jaxmotion[viz]'")


def _write_path(
    found: "Alignment", path: Path, source: Path, reference: Path, method: str, *, overwrite: bool
) -> None:
    from jaxmotion.io.atomic import atomic_write

    facts = {
        "jaxmotion": __version__,
        "source": str(source),
        "reference": str(reference),
        "method": method,
        "rms_degrees": _degrees(found),
        "pairs": _pairs(found),
        "source_frame": [round(float(at), 6) for at in found.source_frame],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path, overwrite=overwrite) as file:
        file.write((as_json(facts) + "\n").encode())


def _write_plot(
    found: "Alignment", plot: Path, source: Path, reference: Path, *, overwrite: bool
) -> None:
    from jaxmotion.io.atomic import atomic_write
    from jaxmotion.viz import plot_alignment

    figure = plot_alignment(found, source=source.name, reference=reference.name)
    plot.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(plot, overwrite=overwrite) as file:
        figure.savefig(file, format=plot.suffix[1:].lower(), dpi=150)


def _pairs(found: "Alignment") -> list[list[int]]:
    """The path in order, each pair once."""
    path = [[int(i), int(j)] for i, j in found.path[: int(found.length)].tolist()]
    return [pair for k, pair in enumerate(path) if k == 0 or pair != path[k - 1]]


def _degrees(found: "Alignment") -> float:
    import math

    return math.degrees(float(found.distance))

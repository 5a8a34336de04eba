"""``jaxmotion transfer``: a motion in another's manner."""

from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxmotion.cli._options import (
    Batch,
    Running,
    Selection,
    batch_options,
    keep_contacts_option,
    running_options,
    selection_options,
)
from jaxmotion.cli._padding import pad, unpadded
from jaxmotion.cli._work import Edited, Learned, read

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion.cli._options import Reading
    from jaxmotion.contacts import Contacts
    from jaxmotion.style import MotionStyle, StyleReport

_NAMED = 5


@click.command(short_help="Give a motion another one's style.")
@batch_options
@click.option(
    "--reference",
    type=click.Path(exists=True, dir_okay=False),
    required=True,
    help="The clip whose manner is wanted, or an .npz file of a style.",
)
@click.option(
    "--amount",
    type=float,
    default=1.0,
    show_default=True,
    help="How much of it: above 1 exaggerates, below 0 leads away from it.",
)
@click.option(
    "--deviation",
    type=click.Choice(["scalar", "covariance"]),
    default="scalar",
    show_default=True,
    help="How far joints go, as one number each or in each direction: a hinge stays a hinge.",
)
@click.option(
    "--warp/--no-warp",
    default=True,
    show_default=True,
    help="Set frames beside the reference's that do the same, or count all alike.",
)
@click.option(
    "--root/--no-root",
    default=True,
    show_default=True,
    help="Also how fast and how upright it goes.",
)
@click.option(
    "--tempo/--no-tempo",
    default=False,
    show_default=True,
    help="Also how fast: the result gets longer or shorter, at the file's own rate.",
)
@click.option(
    "--max-ratio",
    type=click.FloatRange(min=0, min_open=True),
    help="The most that a joint's movement may be multiplied by.",
)
@click.option(
    "--match",
    type=click.Choice(["skeleton", "names"]),
    default="skeleton",
    show_default=True,
    help="Of another skeleton, change the joints whose names agree.",
)
@keep_contacts_option
@selection_options
@running_options
def command(
    batch: Batch,
    running: Running,
    selection: Selection,
    reference: str,
    amount: float,
    deviation: str,
    warp: bool,
    root: bool,
    tempo: bool,
    max_ratio: float | None,
    match: str,
    keep_contacts: bool | None,
) -> None:
    """Give a motion the style of another: its postures, how far joints go, how fast it walks.

    What it does, and when, stays its own; with --tempo also how long it takes is the other's.

    \b
    jaxmotion transfer walk.bvh -o tired-walk.bvh --reference tired.bvh
    jaxmotion transfer takes -o proud --reference proud.bvh --deviation covariance
    jaxmotion transfer walk.bvh -o arms.bvh --reference tired.bvh --joints '*Arm*' --no-root
    """
    from jaxmotion.cli._batch import edit_files

    if tempo and not selection.everything:
        raise click.UsageError("--tempo changes the time of the whole clip; choose no part of it")
    options = {"strength": amount, "deviation": deviation, "root": root, "tempo": tempo}
    options |= {"max_ratio": max_ratio, "match": match}
    made = partial(
        edit, reference=Path(reference), reading=batch.reading, warp=warp, options=options
    )
    edit_files(made, batch, running, selection, keep=keep_contacts, restore=planted)


def edit(
    motion: "Motion",
    length: int,
    *,
    reference: Path,
    reading: "Reading",
    warp: bool,
    options: dict[str, Any],
) -> Edited:
    """The library's transfer on the frames of a padded clip that count."""
    from jaxmotion.style import MotionStyle, apply_style, transfer_style

    source = unpadded(motion, length)
    other = reference_of(reference, reading)
    if isinstance(other, MotionStyle):
        result = apply_style(source, other, keep_contacts=False, **options)
        return Edited(pad(result)[0])
    way = "shared" if warp else None
    found = transfer_style(source, other, warp=way, keep_contacts=False, **options)
    learned = partial(_learned, found.report)
    return Edited(pad(found.motion)[0], learned, in_brief(found.report))


@lru_cache(maxsize=32)
def reference_of(path: Path, reading: "Reading") -> "Motion | MotionStyle":
    """The style or clip in a file, which is read once for a whole folder."""
    from jaxmotion.io import MotionFileError
    from jaxmotion.style import MotionStyle

    if path.suffix.lower() == ".npz":
        try:
            return MotionStyle.load(path)
        except MotionFileError as error:
            try:
                return read(path, reading)
            except MotionFileError:
                raise error from None
    return read(path, reading, uses_up=True)


def planted(edited: "Motion", original: "Motion", contacts: "Contacts", length: int) -> "Motion":
    """The original's contacts, where the edit has them."""
    from jaxmotion.contacts import cleanup_footskate, replant

    return cleanup_footskate(edited, replant(edited, contacts), length=length)


def in_brief(report: "StyleReport") -> str:
    """The joints whose posture changed most, and those with nothing to scale."""
    import numpy as np

    turned = np.degrees(np.asarray(report.turned))
    order = [j for j in np.argsort(-turned) if turned[j] >= 1][:_NAMED]
    parts = [f"{report.joints[j]} {turned[j]:.0f}°" for j in order]
    still = np.flatnonzero(np.asarray(report.still))
    text = f"posture: {', '.join(parts)}" if parts else ""
    if still.size:
        names = ", ".join(report.joints[j] for j in still[:_NAMED])
        text += f"{'; ' if text else ''}still in the source, nothing to scale: {names}"
    return text


def _learned(report: "StyleReport") -> Learned:
    import numpy as np

    turned, ratio = np.degrees(np.asarray(report.turned)), np.asarray(report.ratio)
    rows = [
        {
            "joint": name,
            "degrees": float(turned[j]),
            "ratio": float(ratio[j]),
            "still": bool(report.still[j]),
        }
        for j, name in enumerate(report.joints)
        if name not in report.left
    ]
    return {"style": rows}

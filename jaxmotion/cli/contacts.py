"""``jaxmotion contacts``: when the feet touch the floor, and feet that do not slide."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxmotion._plain import printable, some
from jaxmotion.cli._feet import keep_contacts
from jaxmotion.cli._options import (
    NOWHERE,
    Batch,
    Running,
    Selection,
    batch_options,
    running_options,
)
from jaxmotion.cli._terminal import say, say_json
from jaxmotion.cli._work import Edited

if TYPE_CHECKING:
    from jaxmotion import Motion
    from jaxmotion.contacts import Contacts

_SHOWN = 8
_NO_FEET = "no feet found; --joint names others"
_WAYS = ("legs", "root", "spacetime")


@click.command(short_help="When the feet touch the floor; stop them from sliding.")
@batch_options(out_required=False)
@click.option(
    "--method",
    type=click.Choice(["segments", "thresholds"]),
    default="segments",
    show_default=True,
    help="How to find contacts: segments at rest, or points that are low and slow.",
)
@click.option(
    "--joints",
    "--joint",
    "joints",
    multiple=True,
    metavar="PATTERN",
    help="Look at the joints whose names match, such as '*Hand', not at the feet; may be repeated.",
)
@click.option(
    "--no-floor", is_flag=True, help="Let contacts be anywhere: stairs, tables, other people."
)
@click.option("--json", "as_json", is_flag=True, help="As JSON, a list with one entry a file.")
@click.option(
    "--restore",
    type=click.Choice(_WAYS),
    help="Write the motion to -o with every contact in one place, by moving legs and root, the "
    "root alone, or all joints above the contact, smoothly, in one solve over the clip.",
)
@running_options
def command(
    batch: Batch,
    running: Running,
    method: str,
    joints: tuple[str, ...],
    no_floor: bool,
    as_json: bool,
    restore: str | None,
) -> None:
    """List when the feet (or other joints) touch, or stop them from sliding while they do.

    \b
    jaxmotion contacts walk.bvh
    jaxmotion contacts takes --json --method thresholds
    jaxmotion contacts takes -o clean --restore legs --jobs 4
    """
    finding = partial(find, method=method, joints=joints, floor=None if no_floor else "auto")
    if restore is None:
        if batch.cluster is not None:
            raise click.UsageError("--cluster goes with --restore")
        if batch.out != NOWHERE:
            raise click.UsageError("say how to write to -o: --restore legs, root or spacetime")
        _list(batch, running, finding, as_json)
        return
    if batch.out == NOWHERE:
        raise click.UsageError("--restore writes files: say where, with -o")
    from jaxmotion.cli._batch import edit_files

    everything = Selection(strength=1.0, joints=(), frames=(None, None), fade=0)
    finding, restoring = partial(find_any, finding=finding), partial(restored, way=restore)
    edit_files(unedited, batch, running, everything, keep=True, find=finding, restore=restoring)


def find(
    motion: "Motion", length: int, *, method: Any, joints: tuple[str, ...], floor: Any
) -> "Contacts":
    """The library's contacts of a padded clip."""
    import jaxmotion as jm

    matching = motion.skeleton.matching(*joints)
    return jm.contacts.detect(
        motion, method=method, joints=matching or None, floor=floor, length=length
    )


def find_any(motion: "Motion", length: int, *, finding: Any) -> "Contacts":
    """Contacts, of a clip that must have something to touch with."""
    found = finding(motion, length)
    if not found.names:
        raise ValueError(_NO_FEET)
    return found


def unedited(motion: "Motion", length: int) -> Edited:
    """The clip as it is: its own contacts are to be restored."""
    return Edited(motion)


def restored(
    edited: "Motion", original: "Motion", contacts: "Contacts", length: int, *, way: str
) -> "Motion":
    """The library's cleanup on a padded clip."""
    import jaxmotion as jm

    if way == "spacetime":
        return keep_contacts(edited, original, contacts, length)
    cleanup = jm.contacts.cleanup_footskate if way == "legs" else jm.contacts.cleanup_root
    return cleanup(edited, contacts, length=length)


def _list(batch: Batch, running: Running, finding: Any, as_json: bool) -> None:
    from jaxmotion.cli._files import expand
    from jaxmotion.cli._reading import each, report_of

    found = []
    failed = False
    inputs = expand(batch.files)
    with report_of(inputs, batch.report, batch.overwrite) as report:
        for item in each(inputs, batch.reading, running, uses_up=True):
            failed |= item.motion is None
            facts = _facts(item.motion, finding) if item.motion else {}
            report.add(item.outcome(facts))
            if item.motion is None:
                continue
            entry = {"file": str(item.path), **facts, "warnings": item.warnings}
            found.append(entry)
            if not as_json:
                say(*_as_text(item.path, entry))
                say(*(f"  warning: {text}" for text in item.warnings), err=True)
    if as_json:
        say_json(found)
    raise click.exceptions.Exit(1 if failed else 0)


def _facts(motion: "Motion", finding: Any) -> dict[str, Any]:
    import numpy as np

    from jaxmotion import contacts, metrics
    from jaxmotion.cli._padding import pad

    padded, length = pad(motion)
    found = finding(padded, length)
    share = np.asarray(found.mask).sum(axis=0) / length
    return {
        "frames": length,
        "fps": round(1.0 / float(motion.frame_time), 6),
        "slide": metrics.foot_skate(padded, found),
        "points": dict(zip(found.names, share.tolist(), strict=True)),
        "contacts": [interval._asdict() for interval in contacts.intervals(found)],
    }


def _as_text(path: Path, facts: dict[str, Any]) -> list[str]:
    if not facts["points"]:
        return [f"{path}: {_NO_FEET}"]
    many = some(len(facts["contacts"]), "contact")
    sliding = f", which slide at {facts['slide']:.3g} a second" if facts["contacts"] else ""
    lines = [f"{path}: {many} of {some(len(facts['points']), 'point')}{sliding}"]
    width = max(len(printable(point)) for point in facts["points"])
    for point, share in facts["points"].items():
        spans = [f"{c['first']}-{c['last']}" for c in facts["contacts"] if c["point"] == point]
        more = f" and {len(spans) - _SHOWN} more" if len(spans) > _SHOWN else ""
        told = f"frames {', '.join(spans[:_SHOWN])}{more}" if spans else "never"
        lines.append(f"  {printable(point):<{width}}  {100 * share:3.0f} %  {told}")
    return lines

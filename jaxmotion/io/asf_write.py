"""Acclaim skeleton files (.asf), out: :class:`~jaxmotion.Skeleton` → text.

In an ASF every child begins where its parent's bone ends (:mod:`jaxmotion.io.asf`), so bones are
made to fit the offsets:

- a bone whose ``AsfBone`` agrees with the offsets is written as it was;
- where all that hangs from a joint hangs at one place, the bone ends there;
- otherwise the bone has length 0, and each child X is reached by a rigid bone ``X__link`` (each
  end site by ``X__end``), which our reader folds back and others show as what it is.

The root is called ``root``, blanks and other marks the format reads as its own become ``_``. What
an ASF cannot say is not written: the up axis, labels of end sites.
"""

import re
from collections.abc import Sequence

import numpy as np

from jaxmotion._asf_bone import AsfBone
from jaxmotion.io.asf import END, LINK
from jaxmotion.skeleton import Skeleton


def asf_names(skeleton: Skeleton) -> list[str]:
    """The joints' names as an ASF file can hold them; one word each, unique, the first "root"."""
    names = ["root"]
    for name in skeleton.names[1:]:
        word = re.sub(r"[\s#,()\x00-\x1f]+", "_", name, flags=re.ASCII).lstrip(":") or "_"
        word = word.encode("utf-8", "backslashreplace").decode()
        if re.fullmatch(rf"\d+|begin|end|root|.*{LINK}|.+{END}\d*", word, re.I | re.A):
            word += "_"
        base, count = word, 1
        while word in names:
            count += 1
            word = f"{base}_{count}"
        names.append(word)
    return names


def asf_bones(skeleton: Skeleton) -> list[AsfBone]:
    """A bone a joint: the skeleton's own where they agree with its offsets, else made to fit."""
    offsets, end_offsets = np.asarray(skeleton.offsets), np.asarray(skeleton.end_offsets)
    bones = list(skeleton.asf) or [AsfBone()] * skeleton.num_joints
    for j in range(1, skeleton.num_joints):
        bone = bones[j]
        targets = [offsets[c] for c in skeleton.children[j]]
        targets += [end_offsets[e] for e, joint in enumerate(skeleton.end_joints) if joint == j]
        if not all(_close(target, _tip(bone)) for target in targets) or not targets:
            common = targets and all(_close(target, targets[0]) for target in targets)
            tip = np.asarray(targets[0], np.float64) if common else np.zeros(3)
            length = float(np.linalg.norm(tip))
            x, y, z = (tip / length).tolist() if length else bone.direction
            bones[j] = AsfBone(bone.axis, bone.axis_order, (x, y, z), length, bone.limits)
    return bones


def asf_text(
    skeleton: Skeleton,
    bones: Sequence[AsfBone],
    dofs: Sequence[Sequence[str]],
    limits: Sequence[Sequence[tuple[float, float]]],
) -> str:
    """The file. ``bones`` from :func:`asf_bones`; ``dofs`` and ``limits`` one entry a joint."""
    names = asf_names(skeleton)
    offsets, end_offsets = np.asarray(skeleton.offsets), np.asarray(skeleton.end_offsets)
    blocks: list[list[str]] = []
    tree: list[list[str]] = [[name] for name in names]
    for j, name in enumerate(names):
        tip = _tip(bones[j]) if j else np.zeros(3)
        if j:
            parent = skeleton.parents[j]
            above = _tip(bones[parent]) if parent else np.zeros(3)
            hook = tree[parent]
            if not _close(offsets[j], above):
                blocks.append(_block(name + LINK, _towards(offsets[j] - above)))
                hook.append(name + LINK)
                hook = [name + LINK]
                tree.append(hook)
            hook.append(name)
            blocks.append(_block(name, bones[j], dofs[j], limits[j]))
        sites = [end_offsets[e] for e, joint in enumerate(skeleton.end_joints) if joint == j]
        lone_leaf = len(sites) == 1 and not skeleton.children[j] and np.any(tip)
        if lone_leaf and _close(sites[0], tip):
            continue
        for count, site in enumerate(sites, 1):
            label = f"{name}{END}{count if count > 1 else ''}"
            blocks.append(_block(label, _towards(site - tip)))
            tree[j].append(label)
    lines = [
        "# Acclaim skeleton written by jaxmotion",
        ":version 1.10",
        ":name jaxmotion",
        ":units",
        "  mass 1.0",
        f"  length {skeleton.length_unit!r}",
        "  angle deg",
        ":root",
        f"  order {' '.join(dofs[0])}",
        f"  axis {bones[0].axis_order}",
        f"  position {_row(offsets[0])}",
        f"  orientation {_row(bones[0].axis)}",
        ":bonedata",
    ]
    for number, block in enumerate(blocks, 1):
        lines += ["  begin", f"    id {number}", *block, "  end"]
    lines += [":hierarchy", "  begin"]
    lines += [f"    {' '.join(row)}" for row in tree if len(row) > 1]
    return "\n".join([*lines, "  end", ""])


def _block(name: str, bone: AsfBone, dofs: Sequence[str] = (), limits=()) -> list[str]:
    lines = [
        f"    name {name}",
        f"    direction {_row(bone.direction)}",
        f"    length {float(bone.length)!r}",
        f"    axis {_row(bone.axis)} {bone.axis_order}",
    ]
    if dofs:
        lines.append(f"    dof {' '.join(dofs)}")
    pairs = [f"({float(low)!r} {float(high)!r})" for low, high in limits]
    return lines + [f"    {'limits' if not i else '      '} {p}" for i, p in enumerate(pairs)]


def _row(values) -> str:
    return " ".join(repr(float(value)) for value in values)


def _tip(bone: AsfBone) -> np.ndarray:
    return bone.length * np.array(bone.direction)


def _towards(vector: np.ndarray) -> AsfBone:
    length = float(np.linalg.norm(np.asarray(vector, np.float64)))
    x, y, z = (vector / length).tolist() if length else (0.0, 0.0, 0.0)
    return AsfBone(direction=(x, y, z), length=length)


def _close(a: np.ndarray, b: np.ndarray) -> bool:
    """Equal but for rounding in the offsets' own precision."""
    tolerance = 16 * np.finfo(a.dtype).eps * max(float(np.abs(a).max()), float(np.abs(b).max()))
    return bool(np.abs(a - b).max() <= tolerance)

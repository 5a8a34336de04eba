"""The page: a frame of HTML, its style and scripts, and the clips as JSON.

Names are anybody's text. In the page they are JSON without any ``<``, and its scripts show text as
text; by its own policy no other script runs in it, and nothing is fetched.
"""

import html
import re
from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from importlib.resources import files
from os import PathLike
from typing import Any

import numpy as np
from jaxtyping import Bool

from jaxmotion._plain import as_json, printable
from jaxmotion._summary import called, line, some
from jaxmotion._types import ArrayLike
from jaxmotion.cleaning import DetectedErrors
from jaxmotion.contacts import Contacts
from jaxmotion.io.atomic import atomic_write
from jaxmotion.motion import Motion
from jaxmotion.viz.player import encode
from jaxmotion.viz.player.arguments import Given, read

SCRIPTS = (
    *("math.js", "clips.js", "camera.js", "scene.js", "meshes.js", "webgl.js", "canvas2d.js"),
    *("timeline.js", "curves.js", "panels.js", "keys.js", "pointer.js", "looking.js"),
    *("address.js", "main.js", "api.js"),
)
HEIGHT = 560  # pixels of a frame in a notebook


@dataclass(frozen=True, repr=False)
class Player:
    """A page that plays clips: one file of HTML, which needs no network and opens from disk.

    A notebook shows it in a frame.

    **Fields:** ``html``: the page; ``names``: of the motions in it; ``num_frames``: of the longest.
    """

    html: str
    names: tuple[str, ...]
    num_frames: int

    def save(self, path: str | PathLike) -> None:
        """Write the page; a file of that name is replaced, whole or not at all.

        **Arguments:** ``path``: best ``.html``; its folder must exist.
        **Raises:** ``OSError`` where that cannot be.
        """
        with atomic_write(path) as file:
            file.write(self.html.encode("utf-8"))

    def _repr_html_(self) -> str:
        return framed(self.html, HEIGHT)

    def __repr__(self) -> str:
        return line(self, self._words)

    def _words(self) -> Iterator[str]:
        if any(self.names):
            yield called(self.names, 3)
        yield some(self.num_frames, "frame")
        yield f"{len(self.html) / 1e6:.2f} MB"


def player(
    motion: Motion | Mapping[str, Motion],
    *,
    contacts: Contacts | Mapping[str, Contacts] | None = None,
    errors: DetectedErrors
    | Bool[ArrayLike, "time *joint"]
    | Mapping[str, DetectedErrors | Bool[ArrayLike, "time *joint"]]
    | None = None,
    curves: Mapping[str, Any] | None = None,
    picked: Sequence[str] = (),
    title: str = "",
    side_by_side: bool = False,
    theme: str = "auto",
) -> Player:
    """A page that plays a clip, or several at once, in any browser and in notebooks.

    Orbit, pan, zoom and follow; play, scrub, loop and step; contacts and errors on the timeline,
    curves below it; ``?`` shows the keys. Motions share a clock in seconds. Where numbers are not
    finite joints are absent. About 11 bytes a joint and frame: 0.3 MB for 600 frames × 22 joints.

    **Arguments:** ``motion``: one clip, T frames of J joints, or several by name, each with its
    own frames, joints and up axis; ``contacts``: of :func:`jaxmotion.contacts.detect`; ``errors``:
    of :func:`jaxmotion.cleaning.detect_errors`, or a mask bool[T] or bool[T, J]; ``curves``: f[T]
    or f[T, J] by what to call them; of several motions these are of all of them together, in the
    first's frames. Contacts and errors belong to the first. All are of one motion that are given by
    its name: ``contacts={"after": found}``, ``curves={"energy": {"after": e}}``.
    ``picked``: joints that stand out at first, and have curves of their own, by name; ``title``: of
    the page; ``side_by_side``: begin so with several motions, not one over the other;
    ``theme``: "light", "dark", or "auto" as the system has it.
    **Returns:** :class:`Player`: ``.html``, ``.save("walk.html")``.
    **Raises:** ``ValueError`` for what is no motion, batches, contacts, errors and curves of other
    frames or joints, unknown names; ``TypeError`` under ``jit``.

    **Example:**

        >>> import jax, jaxmotion as jm
        >>> noisy = jm.samples.add_noise(jm.samples.load("walk").motion, jax.random.key(0)).motion
        >>> page = jm.viz.player({"before": noisy, "after": jm.denoise(noisy)}, title="walk")
        >>> page
        Player(before, after, 240 frames, 0... MB)
        >>> page.save("walk.html")  # doctest: +SKIP
    """
    given = read(motion, contacts, errors, curves, theme)
    known = {name for clip in given.motions.values() for name in clip.skeleton.names}
    if unknown := [name for name in picked if name not in known]:
        raise ValueError(f"player: picked={unknown[0]!r} is no joint of any motion")
    view = {
        "title": title,
        "picked": [printable(name) for name in picked],
        "sideBySide": bool(side_by_side),
    }
    text = written(content_of(given, view), title or "jaxmotion", theme)
    frames = max(clip.num_frames for clip in given.motions.values())
    return Player(text, tuple(given.motions), frames)


def content_of(given: Given, view: Mapping[str, Any]) -> dict[str, Any]:
    """All that the scripts are told."""
    figures = {name: encode.figure_of(clip) for name, clip in given.motions.items()}
    first = next(iter(figures.values()))
    origin = _origin(first)
    clips = []
    for name, figure in figures.items():
        clip = {"name": printable(name), **encode.encoded(figure, origin)}
        if name in given.contacts:
            clip["contacts"] = encode.encoded_contacts(figure, given.contacts[name], origin)
        if name in given.errors:
            clip["errors"] = encode.encoded_mask(given.errors[name])
        clips.append(clip)
    order = list(figures)
    curves = [
        {
            "name": printable(curve.name),
            "clip": order.index(curve.of),
            "isShared": curve.is_shared,
            **encode.encoded_curve(curve.values),
        }
        for curve in given.curves
    ]
    shown = {**view, "title": printable(view["title"])}
    return {"origin": origin.tolist(), "clips": clips, "curves": curves, **shown}


def written(content: Mapping[str, Any], title: str, theme: str = "auto") -> str:
    """The page that shows the content."""
    script, style = _script(), _text("style.css")
    policy = "; ".join(
        (
            "default-src 'none'",
            f"script-src {_source(script)}",
            f"style-src {_source(style)}",
            "img-src data:",
            "base-uri 'none'",
            "form-action 'none'",
        )
    )
    parts = {
        "theme": theme,
        "policy": html.escape(policy, quote=True),
        "title": html.escape(printable(title)),
        "style": style,
        "data": as_json(content).replace("<", r"\u003c"),
        "script": script,
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], _text("page.html"))


def framed(page: str, height: int) -> str:
    """The page in a frame of its own, where it can touch nothing of the notebook."""
    return (
        f'<iframe srcdoc="{html.escape(page)}" sandbox="allow-scripts" loading="lazy" '
        f'title="jaxmotion player" '
        f'style="width:100%;height:{height}px;border:0;border-radius:8px"></iframe>'
    )


def _origin(first: encode.Figure) -> np.ndarray:
    """Below the first pose, on the floor."""
    middles = encode.middle_of(first.points)
    whole = middles[np.isfinite(middles).all(axis=-1)]
    x, _, z = whole[0] if len(whole) else np.zeros(3)
    return np.array([x, first.floor, z])


@cache
def _text(name: str) -> str:
    return files("jaxmotion.viz.player").joinpath(name).read_text(encoding="utf-8")


@cache
def _script() -> str:
    """The scripts as one, with names of their own."""
    return '"use strict";\n{\n' + "\n".join(map(_text, SCRIPTS)) + "\n}\n"


def _source(text: str) -> str:
    """What a policy calls the text of a script or style."""
    return f"'sha256-{b64encode(sha256(text.encode('utf-8')).digest()).decode('ascii')}'"

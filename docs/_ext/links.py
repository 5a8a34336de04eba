"""After the build: every link of every page leads somewhere, anchors too, and no page asks the
network for anything.

A link to another site is followed by nobody; a picture, style or script from one is refused.
"""

import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from sphinx.util import logging

LOG = logging.getLogger(__name__)
FETCHED = re.compile(r"""url\(\s*['"]?(?:https?:)?//|@import\s+['"](?:https?:)?//""")


class Page(HTMLParser):
    """Anchors of a page, and what it links and loads."""

    def __init__(self, text):
        super().__init__()
        self.anchors, self.links, self.loaded = {"", "top"}, [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.anchors.update(given[key] for key in ("id", "name") if given.get(key))
        if tag == "a" and given.get("href"):
            self.links.append(given["href"])
        elif tag == "link" and given.get("rel") in ("stylesheet", "icon", "preload"):
            self.loaded.append(given["href"])
        elif tag in ("img", "script", "iframe", "source") and given.get("src"):
            self.loaded.append(given["src"])


def faults(folder):
    """What is wrong with the links of a built site, in sentences."""
    pages = {path: Page(path.read_text("utf-8")) for path in Path(folder).rglob("*.html")}
    for path, page in sorted(pages.items()):
        where = path.relative_to(folder)
        for link in page.links + page.loaded:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                if link in page.loaded and parts.scheme != "data":
                    yield f"{where} loads {link}"
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.is_file():
                yield f"{where} links {link}: no such file"
            elif target in pages and unquote(parts.fragment) not in pages[target].anchors:
                yield f"{where} links {link}: no such anchor"
    for path in sorted(Path(folder).rglob("*.css")):
        if FETCHED.search(path.read_text("utf-8")):
            yield f"{path.relative_to(folder)} loads from another site"


def check(app, exception):
    if exception is None and app.builder.name == "html":
        for fault in faults(Path(app.outdir).resolve()):
            LOG.warning(fault)


def setup(app):
    app.connect("build-finished", check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

"""The site: ``sphinx-build --fail-on-warning docs .site``, then open ``.site/index.html``.

Nothing is fetched, neither by the build nor by the pages. What is our own is in ``_ext/``.
"""

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))
os.environ.setdefault("JAX_PLATFORMS", "cpu")

import jaxmotion

project = "jaxmotion"
version = release = jaxmotion.__version__
copyright = "the jaxmotion authors, Apache-2.0"
extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "myst_parser",
    "commands",
    "rooms",
    "links",
]
exclude_patterns = ["_ext"]

nitpicky = True  # a name in a docstring that does not exist is a warning
add_module_names = False
maximum_signature_line_length = 80
toc_object_entries_show_parents = "hide"
smartquotes = False  # "evidence" is a string
myst_heading_anchors = 3
myst_enable_extensions = ["attrs_inline"]

html_theme = "furo"
html_title = "jaxmotion"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"navigation_with_keys": False}
highlight_language = "none"
pygments_style = "default"
pygments_dark_style = "github-dark"

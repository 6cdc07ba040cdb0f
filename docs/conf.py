"""Settings of the documentation's site; `python docs/tools/make_site.py` builds it."""

from __future__ import annotations

import sys
from pathlib import Path

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx

import ident

sys.path.insert(0, str(Path(__file__).parent / "tools"))

project = "ident"
author = "The ident developers"
release = version = ident.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["tools", "README.md"]

smartquotes = False  # two hyphens are a flag, not a dash
copyright = "The ident developers, BSD-3-Clause"  # noqa: A001 - Sphinx names it

html_theme = "furo"
html_title = f"ident {release}"
html_static_path: list[str] = ["static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_copy_source = False
html_extra_path: list[str] = []
highlight_language = "none"  # a block that names no language is what a program printed
pygments_style, pygments_dark_style = "default", "github-dark"

autodoc_typehints = "none"  # shapes and meanings are in the docstrings
autodoc_member_order = "bysource"
napoleon_google_docstring = False
default_role = "literal"
html_math_renderer = "mathml"
suppress_warnings = ["ref.python"]  # shapes such as (n,) in docstrings are no names to link to


def setup(app: Sphinx) -> None:
    """Docstrings are prose with absolute values: |x| is no substitution; what stands before a colon is no type of an attribute."""

    def whole(app: Sphinx, what: str, name: str, found: object, options: object, lines: list[str]) -> None:
        if what in ("attribute", "data", "property") and lines:
            lines.insert(0, "\\ ")  # a first line without a colon, which shows nothing: napoleon takes "A: b" for type and description

    def plain(app: Sphinx, what: str, name: str, found: object, options: object, lines: list[str]) -> None:
        lines[:] = ["`".join(p.replace("|", "\\|") if i % 2 == 0 else p for i, p in enumerate(line.split("`"))) for line in lines]

    def shown(app: Sphinx, doctree: nodes.document) -> None:
        for link in list(doctree.findall(pending_xref)):
            if link.get("refdomain") == "py" and link["reftarget"][:1].islower() and "." not in link["reftarget"]:
                link.replace_self(link.children)  # a size in a shape, (n,), or a word: no name to link to
        for words in list(doctree.findall(nodes.Text)):
            if words == " -- ":
                words.parent.replace(words, nodes.Text(" – "))

    app.connect("doctree-read", shown)
    app.connect("autodoc-process-docstring", whole, priority=100)
    app.connect("autodoc-process-docstring", plain, priority=900)

"""Formulas as MathML, which every browser shows without a script and without a network: an extension of Sphinx."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util import logging

_LOG = logging.getLogger(__name__)


def formula(node: nodes.Node, display: str) -> str:
    """LaTeX as MathML; a warning where the converter does not know a piece of it."""
    made = convert(node.astext(), display=display)
    if "<mi>&</mi>" in made or "<mi>\\" in made:
        _LOG.warning("formula not understood: %s", node.astext(), location=node)
    return made


def visit_inline(self: Any, node: nodes.math) -> None:
    """A formula within a line."""
    self.body.append(formula(node, "inline"))
    raise nodes.SkipNode


def visit_block(self: Any, node: nodes.math_block) -> None:
    """A formula on a line of its own."""
    self.body.append(f'<div class="math">{formula(node, "block")}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """The renderer `mathml`."""
    app.add_html_math_renderer("mathml", inline_renderers=(visit_inline, None), block_renderers=(visit_block, None))
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}

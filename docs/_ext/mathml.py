"""Formulas as MathML, which browsers draw by themselves: the pages need no script and no network."""

from __future__ import annotations

import re
from itertools import cycle

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

BAR = re.compile(r"<mo[^>]*>([|‖])</mo>")


def paired(formula: str) -> str:
    """The bars of a norm or a magnitude as an opening and a closing one.

    A bar says nothing of which it is. A browser takes both for operators between two things, with blanks about them,
    and stretches the one that carries an exponent down below the line.
    """
    sides = cycle(("prefix", "postfix"))
    written = r'<mo form="{}" stretchy="false" lspace="0" rspace="0">{}</mo>'
    if len(BAR.findall(formula)) % 2:
        return formula
    return BAR.sub(lambda bar: written.format(next(sides), bar[1]), formula)


def _inline(writer: HTML5Translator, node: nodes.math) -> None:
    writer.body.append(paired(tex2mathml(node.astext())))
    raise nodes.SkipNode


def _block(writer: HTML5Translator, node: nodes.math_block) -> None:
    formula = paired(tex2mathml(node.astext().strip(), as_block=True))
    writer.body.append(f'<div class="math">{formula}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer under the name that `html_math_renderer` asks for."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}

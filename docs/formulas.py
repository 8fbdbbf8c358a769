"""Formulas are MathML, which browsers draw without a script or a network."""

from __future__ import annotations

import re
from html import unescape
from xml.etree import ElementTree

from docutils import nodes
from math_core import LatexError, LatexToMathML
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

MATHML = LatexToMathML()

PRIMES = set("′″‴")
"""Signs that most fonts raise by themselves: as superscripts they float far above their letter."""

NAMED = re.compile(r"&(?!amp;|lt;|gt;)\w+;")
"""Signs written by names that HTML knows and XML does not."""


def with_primes_beside(formula: ElementTree.Element) -> ElementTree.Element:
    """Put the primes of a formula beside their letters instead of above them, in place."""
    for parent in formula.iter():
        parent[:] = [_beside(part) for part in parent]
    return formula


def _beside(part: ElementTree.Element) -> ElementTree.Element:
    """Return w′ with its prime in the row of w; what is raised beside the prime stays raised."""
    if part.tag not in ("msup", "msubsup"):
        return part
    base, *below, above = part
    raised = list(above) if above.tag == "mrow" else [above]
    if not raised or raised[0].tag != "mo" or raised[0].text not in PRIMES:
        return part
    row = ElementTree.Element("mrow")
    prime = ElementTree.SubElement(row, "mo", form="postfix", lspace="0", rspace="0")
    prime.text = raised.pop(0).text
    row.insert(0, base)
    if not (below or raised):
        return row
    new = ElementTree.Element("m" + "sub" * bool(below) + "sup" * bool(raised))
    new.extend([row, *below])
    if raised:
        ElementTree.SubElement(new, "mrow").extend(raised)
    return new


def write_formula(translator: HTML5Translator, node: nodes.Element) -> None:
    """Write a formula as MathML; one that cannot be read is a warning, which ends the build."""
    block = isinstance(node, nodes.math_block)
    tex = node.astext()
    try:
        mathml = MATHML.convert_with_local_state(tex, displaystyle=block)
        tree = ElementTree.fromstring(NAMED.sub(lambda sign: unescape(sign[0]), mathml))
        formula = ElementTree.tostring(with_primes_beside(tree), encoding="unicode")
    except LatexError as error:
        logging.getLogger(__name__).warning("formula %r: %s", tex, error, location=node)
        formula = f"<code>{translator.encode(tex)}</code>"
    classes = "math notranslate nohighlight"
    if not block:
        translator.body.append(f'<span class="{classes}">{formula}</span>')
        raise nodes.SkipNode
    ids = [f' id="{name}"' for name in node["ids"][:1]]
    translator.body.append(f'<div class="{classes}"{"".join(ids)}>{formula}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", (write_formula, None), (write_formula, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}

"""What Sphinx does not do to pages by itself: charts open by a click, numbers are not broken,
tables of many columns are small."""

from __future__ import annotations

import re
from pathlib import PurePosixPath

from docutils import nodes
from sphinx.application import Sphinx

NUMBER = r"(?<![\w.])[<>≤≥≈~±+−-]?\d[\d.]*(?: \d{3}\b)*(?:e[+−-]?\d+)?"
UNIT = r"(?: ?(?:%|[nµm]?s|min|h|[kM]B|rad|k?g|m|N[²³]?|bits|digits)(?!\w))?"
RUN = re.compile(rf"(?:\bN [=≤≥<>] )?{NUMBER}{UNIT}(?:(?: ?/ ?| to ){NUMBER}{UNIT})*(?!\w)")
"""Numbers with their signs and units, such as 429 µs, 2.3e-15, 127 / 757 and 0.1 to 10."""

SHORT = 20
"""Characters of a first cell of a row that stay in one line."""

MANY = 9
"""Columns of a table from which on it is set smaller."""


def keep_numbers_whole(tree: nodes.document) -> None:
    """Mark numbers in which a line could be broken, and the short names of rows."""
    for row in tree.findall(nodes.row):
        if len(row[0].astext()) <= SHORT:
            row[0]["classes"].append("unbroken")
    for text in list(tree.findall(nodes.Text)):
        if not isinstance(text.parent, (nodes.paragraph, nodes.inline, nodes.emphasis)):
            continue
        parts, end = [], 0
        for run in RUN.finditer(text):
            if not re.search(r"[ /+−-]", run[0]):
                continue
            parts += [nodes.Text(text[end : run.start()])]
            parts += [nodes.inline("", run[0], classes=["unbroken"])]
            end = run.end()
        if parts:
            text.parent.replace(text, [*parts, nodes.Text(text[end:])])


def narrow_wide_tables(tree: nodes.document) -> None:
    """Mark tables of many columns."""
    for group in tree.findall(nodes.tgroup):
        if len(list(group.findall(nodes.colspec))) >= MANY and group.parent is not None:
            group.parent["classes"].append("wide")


def link_charts(app: Sphinx, tree: nodes.document, page: str) -> None:
    """Let each picture of dots lead to its file: a chart is read large."""
    up = "../" * (len(PurePosixPath(page).parts) - 1)
    for image in list(tree.findall(nodes.image)):
        if not image["uri"].endswith(".png") or isinstance(image.parent, nodes.reference):
            continue
        file = f"{up}{app.builder.imagedir}/{app.env.images[image['uri']][1]}"
        image.replace_self(nodes.reference("", "", image.deepcopy(), refuri=file, internal=True))


def mend(app: Sphinx, tree: nodes.document, page: str) -> None:
    """Mend a page that is about to be written."""
    if app.builder.format == "html":
        keep_numbers_whole(tree)
        narrow_wide_tables(tree)
        link_charts(app, tree, page)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("doctree-resolved", mend)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

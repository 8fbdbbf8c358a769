"""What Sphinx does not do to pages by itself: charts open by a click, numbers are not broken,
tables of many columns are small, mechanisms are turned by hand."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from eomcheck.lab.show import viewer_plotly as viewer
from eomcheck.lab.show.chart_plotly import plotly_js
from eomcheck.lab.show.pictures import scene_and_pose
from eomcheck.scenes import SCENES

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


POSES = 25
"""Poses of a motion."""
TURN = "Drag with the mouse or a finger to turn the mechanism."


class ViewerNode(nodes.General, nodes.Element):
    """The place of a mechanism, with the key of its `scene` and the `end` of a motion, s."""


class ViewerDirective(SphinxDirective):
    """A scene that is turned by hand, in one pose or, with `end`, in motion."""

    required_arguments = 1
    option_spec: ClassVar[dict[str, Any]] = {"end": float}

    def run(self) -> list[nodes.Node]:
        return [ViewerNode(scene=self.arguments[0], end=self.options.get("end"))]


def viewer_of(key: str, end: float | None) -> str:
    """Return the HTML of a mechanism."""
    if end is None:
        scene, q = scene_and_pose(SCENES[key])
        states = [viewer.shown_state(scene, q)]
    else:
        scene = SCENES[key].example()
        states = viewer.states_of_motion(scene, "au", end, POSES)
    return viewer.viewer_figure(viewer.viewer_json(scene, states), TURN)


def put_viewers(tree: nodes.document) -> None:
    """Put mechanisms in their places."""
    for node in list(tree.findall(ViewerNode)):
        node.replace_self(nodes.raw("", viewer_of(node["scene"], node["end"]), format="html"))
        tree["viewers"] = True


def write_viewer_files(app: Sphinx) -> None:
    """Write the scripts of mechanisms and plotly, as it is installed, beside the static files."""
    if app.builder.format != "html":
        return
    folder = Path(app.outdir) / "_static"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "plotly.min.js").write_text(plotly_js(), encoding="utf-8")
    (folder / "viewer.css").write_text(viewer.viewer_style(), encoding="utf-8")
    (folder / "viewer.js").write_text(viewer.viewer_script(), encoding="utf-8")


def load_viewers(
    app: Sphinx, page: str, template: str, context: dict[str, Any], tree: nodes.document | None
) -> None:
    """Load the scripts of mechanisms on pages that have one."""
    if tree is not None and tree.get("viewers"):
        app.add_css_file("viewer.css")
        app.add_js_file("viewer.js", loading_method="defer")
        app.add_js_file("load-viewer.js", loading_method="defer")


def mend(app: Sphinx, tree: nodes.document, page: str) -> None:
    """Mend a page that is about to be written."""
    if app.builder.format == "html":
        keep_numbers_whole(tree)
        narrow_wide_tables(tree)
        link_charts(app, tree, page)
        put_viewers(tree)


def skip(translator: Any, node: nodes.Element) -> None:
    """Leave out mechanisms where pages are not HTML."""
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_node(ViewerNode, text=(skip, None), latex=(skip, None))
    app.add_directive("viewer", ViewerDirective)
    app.connect("builder-inited", write_viewer_files)
    app.connect("doctree-resolved", mend)
    app.connect("html-page-context", load_viewers)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

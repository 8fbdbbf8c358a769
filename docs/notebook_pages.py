"""Pages of the notebooks in `docs/notebooks`: their cells in Markdown, and the outputs of these.

The notebooks are stored without outputs. Each is run once, in its folder, like a script: the text
that a cell prints and the value of its last expression follow it. Without a library that a notebook
needs, its page has no outputs, and a sentence about it.
"""

from __future__ import annotations

import ast
import contextlib
import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from eomcheck.errors import EngineError

NOTEBOOKS = Path(__file__).parent / "notebooks"


def output_of(code: str, names: dict[str, Any]) -> str:
    """Return the text that a cell prints when it is run, and the value of its last expression.

    Args:
        code: its source.
        names: the variables of the notebook, to which those of the cell are added.
    """
    tree, printed = ast.parse(code), io.StringIO()
    last = tree.body[-1] if tree.body else None
    if isinstance(last, ast.Expr):
        tree.body.pop()
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, "<cell>", "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "<cell>", "eval"), names)
            if value is not None:
                print(repr(value))
    return printed.getvalue().rstrip()


def outputs_of(cells: list[str]) -> list[str] | None:
    """Return the outputs of the code cells of a notebook; None without a library it needs."""
    names: dict[str, Any] = {"__name__": "__main__"}
    try:
        with contextlib.chdir(NOTEBOOKS):
            return [output_of(code, names) for code in cells]
    except (ImportError, EngineError):
        return None


def _fenced(language: str, text: str) -> str:
    return f"````{{code-block}} {language}\n{text}\n````\n"


def notebook_page(path: Path) -> str:
    """Return a notebook as Markdown."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    sources = [(cell["cell_type"], "".join(cell["source"])) for cell in cells]
    outputs = outputs_of([text for kind, text in sources if kind == "code"])
    remaining: Iterator[str] = iter(outputs or ())
    parts = []
    for kind, text in sources:
        if kind == "markdown":
            parts.append(f"{text}\n")
            continue
        parts.append(_fenced("python", text))
        if output := next(remaining, ""):
            parts.append(_fenced("text", output))
    if outputs is None:
        parts.append(
            "A library that this notebook needs was not installed: its outputs are left out.\n"
        )
    parts.append(f"To run it yourself: {{download}}`{path.name} <{path.name}>`.\n")
    return "\n".join(parts)


def notebook_pages() -> dict[str, str]:
    """Return the page of each notebook by the name of its file without ending."""
    return {path.stem: notebook_page(path) for path in sorted(NOTEBOOKS.glob("*.ipynb"))}

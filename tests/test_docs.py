"""Python blocks of README and docs run. Doctests are run by Sphinx."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("[!_]*/*.md"))]
LONG = {"four-bar-chain.md": "compiles seven formulations; test_four_bar_chain moves the chain"}
"""Pages whose blocks are only compiled here, and why."""

BLOCKS = [
    (page, number, block)
    for page in PAGES
    for number, block in enumerate(
        re.findall(r"^```python\n(.*?)^```$", page.read_text(encoding="utf-8"), re.S | re.M)
    )
]


@pytest.mark.parametrize(
    ("page", "number", "block"), BLOCKS, ids=[f"{page.name}-{k}" for page, k, _ in BLOCKS]
)
def test_a_python_block_runs(page: Path, number: int, block: str, monkeypatch):
    monkeypatch.chdir(ROOT)
    code = compile(block, f"{page.name}, block {number}", "exec")
    if page.name not in LONG:
        exec(code, {"__name__": "block"})


def test_there_are_blocks_and_none_is_excused_in_vain():
    assert {"README.md", "check-your-own.md", *LONG} <= {page.name for page, *_ in BLOCKS}

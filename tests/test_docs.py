"""Python blocks of README and docs run. Doctests are run by Sphinx."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted([*DOCS.glob("*.md"), *DOCS.glob("[!_]*/*.md")])]

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
    exec(compile(block, f"{page.name}, block {number}", "exec"), {"__name__": "block"})


def test_there_are_blocks():
    assert {"README.md", "andrews.md", "in-your-ci.md"} <= {page.name for page, *_ in BLOCKS}


TERM = re.compile(r"\{term\}`(?:[^`<]*<)?\s*([^`>]+?)>?`", re.S)


def test_every_word_of_the_glossary_is_linked_from_some_other_page():
    glossary = DOCS / "glossary.md"
    blocks = re.findall(r"^```\{glossary\}\n(.*?)^```$", glossary.read_text("utf-8"), re.S | re.M)
    words = {line for block in blocks for line in re.findall(r"^(\S.*)$", block, re.M)}
    assert len(words) > 40
    others = (page.read_text("utf-8") for page in PAGES if page != glossary)
    linked = {" ".join(word.split()) for text in others for word in TERM.findall(text)}
    assert not words - linked

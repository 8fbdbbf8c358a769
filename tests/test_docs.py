"""Python blocks of README and docs run. Doctests are run by Sphinx."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from eomcheck.lab.report.registries import function_claims_sheet

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


SHOWN = [
    (page, file, block)
    for page in PAGES
    for file, block in re.findall(
        r"^<!-- (\S+\.py) -->\n\n```py\n(.*?)^```$", page.read_text(encoding="utf-8"), re.S | re.M
    )
]
"""Files that pages show: whoever reads a page without building it sees them too."""


@pytest.mark.parametrize(
    ("page", "file", "block"), SHOWN, ids=[f"{page.name}-{file}" for page, file, _ in SHOWN]
)
def test_a_file_that_a_page_shows_is_the_file_that_tests_run(page: Path, file: str, block: str):
    source = (page.parent / file).read_text(encoding="utf-8")
    # All of it, or what comes last of it.
    assert source.endswith(block)
    assert source == block or f"\n\n\n{block}" in source


def test_no_guide_hides_its_code_from_who_reads_it_unbuilt():
    guides = [page for page in PAGES if page.parent.name == "guides"]
    assert not [page.name for page in guides if "{literalinclude}" in page.read_text("utf-8")]
    assert {"cart.py", "planar.py", "ci/by_hand.py", "trailer.py"} <= {file for _, file, _ in SHOWN}
    tagged = sum(len(re.findall(r"^```py$", page.read_text("utf-8"), re.M)) for page in PAGES)
    assert tagged == len(SHOWN)


def test_the_table_of_claims_about_functions_is_that_of_the_registry():
    page = (DOCS / "guides" / "check-your-own.md").read_text(encoding="utf-8")
    assert f"\n\n{function_claims_sheet().markdown().strip()}\n\n" in page


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

"""Python blocks of README and docs run. Doctests are run by Sphinx."""

from __future__ import annotations

import importlib.util
import math
import re
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import pytest
from tests.house import CLAUSES, without_code

from eomcheck.deprecated import FIELDS, MODULES, NAMES, OPTIONS
from eomcheck.lab.report.registries import function_claim_table, registry_table

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
README = ROOT / "README.md"
FOLDERS = ("*.md", "[!_]*/*.md", "reference/api/*.md")
PAGES = [
    README,
    *sorted(x for folder in FOLDERS for x in DOCS.glob(folder) if x.parent.name != "paper-joss"),
]

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


def test_what_the_first_page_shows_is_what_its_code_prints(capsys):
    page = README.read_text(encoding="utf-8")
    ((block, shown),) = re.findall(
        r"^```python\n(.*?)^```\n\n```text\n(.*?)^```$", page, re.S | re.M
    )
    exec(compile(block, "README.md", "exec"), {"__name__": "block"})
    assert capsys.readouterr().out == shown and 3 < len(shown.splitlines()) <= 10


def test_the_picture_of_the_first_page_is_what_its_command_prints():
    module, command = loaded("terminal_picture"), ["eomcheck", "check", "half.py"]
    drawn = module.picture(command, module.colored_output(command, "passed"))
    assert drawn == (DOCS / "figures" / "first-failure.svg").read_text(encoding="utf-8")
    assert "@font-face" not in drawn and "half&#160;the&#160;expected&#160;value" in drawn


def test_sentences_of_the_first_page_are_short():
    page = re.sub(r"^```.*?^```$|^\|.*?$|^#.*?$", "", README.read_text("utf-8"), flags=re.S | re.M)
    text = re.sub(r"\]\([^)]*\)", "", page)
    sentences = re.split(r"[.:;](?=\s)|\n\n|\n- ", text)
    assert len(sentences) > 30
    assert not [one for one in sentences if len(one.split()) > 25]


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
    page = (DOCS / "reference" / "functions.md").read_text(encoding="utf-8")
    assert f"\n\n{function_claim_table().markdown().strip()}\n\n" in page


def test_the_table_of_quantities_is_that_of_the_registry():
    page = (DOCS / "reference" / "quantities.md").read_text(encoding="utf-8")
    assert f"\n\n{registry_table('quantities').markdown().strip()}\n\n" in page


def test_every_row_of_a_table_is_in_it():
    """A row after a blank line is text, unless it is the head of another table."""
    for page in PAGES:
        lines = ["", *page.read_text(encoding="utf-8").split("\n"), ""]
        for before, line, after in zip(lines, lines[1:], lines[2:], strict=False):
            if not before and line.startswith("|"):
                assert re.match(r"[|] ?---", after), f"{page.name}: {line}"


def test_there_are_blocks():
    assert {"README.md", "andrews.md", "in-your-ci.md"} <= {page.name for page, *_ in BLOCKS}


NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))


@pytest.mark.night
@pytest.mark.parametrize("path", NOTEBOOKS, ids=[path.stem for path in NOTEBOOKS])
def test_a_notebook_runs_from_its_folder(path: Path):
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    book = nbformat.read(path, as_version=4)
    assert not any(cell.get("outputs") for cell in book.cells), "outputs are not kept in git"
    nbclient.NotebookClient(book, resources={"metadata": {"path": str(path.parent)}}).execute()
    assert any(cell.get("outputs") for cell in book.cells)


# ---- Parts, sizes and words of pages -------------------------------------------------------------

INDEX = (DOCS / "index.md").read_text(encoding="utf-8")
PARTS = {
    caption: [DOCS / f"{name}.md" for name in names.split()]
    for caption, names in re.findall(
        r"^```\{toctree\}\n:caption: ([^\n]*)\n:hidden:\n\n(.*?)^```$", INDEX, re.S | re.M
    )
}
"""Part of the documentation -> its pages, in their order."""


def test_the_documentation_has_five_parts_and_20_pages_of_use():
    assert [*PARTS] == ["Use", "Explanation", "Evidence", "Development", "Reference"]
    assert len(PARTS["Use"]) <= 20


@pytest.mark.parametrize("page", PARTS["Use"], ids=[page.stem for page in PARTS["Use"]])
def test_a_page_of_use_is_short_and_in_the_words_of_the_field(page: Path):
    text = without_code(page.read_text(encoding="utf-8"))
    words = len(re.findall(r"\w+", text))
    assert words <= 1200
    markers = sum(len(clause.findall(text)) for clause in CLAUSES.values())
    assert markers <= math.ceil(3 * words / 1000)


@pytest.mark.parametrize("part", PARTS)
def test_a_page_opens_with_a_sentence_about_what_it_is_for(part: str):
    for page in PARTS[part]:
        _, _, below = page.read_text(encoding="utf-8").partition("\n\n")
        assert page.stem == "changelog" or re.match(r"[A-Z`\[{*]", below.lstrip()), page.name


def test_every_page_is_in_one_part():
    paths = [page for pages in PARTS.values() for page in pages]
    folders = ("theory", "scenes", "api", "figures", "paper-joss", "notebooks")
    children = {page for page in PAGES if page.parent.name in folders}
    children |= {page for page in PAGES if page.stem == "verified-equivalences"}
    outside = {DOCS / "index.md", README}
    assert len(paths) == len({*paths})
    assert {*PAGES} - children - outside == {*paths} - children


TYPED = [
    (page, line)
    for page in PAGES
    for line in re.findall(r"^\$ (eomcheck [a-z].*)$", page.read_text(encoding="utf-8"), re.M)
]
"""Commands that pages show."""


def test_commands_that_pages_show_have_the_options_that_there_are():
    pytest.importorskip("sphinx")
    known = loaded("commands").options_of()
    assert len(TYPED) > 60
    for page, line in TYPED:
        words = line.split(" #")[0].split()
        path = max((x for x in known if f"{' '.join(words)} ".startswith(f"{x} ")), key=len)
        typed = {word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)}
        assert typed <= known[path], f"{page.name}: {line}"


def test_examples_of_the_page_of_commands_are_run_by_tests():
    from tests.cli.test_widths import COMMANDS

    assert {*loaded("commands").EXAMPLES.values()} <= {*COMMANDS.values()}


# ---- Renamed names -------------------------------------------------------------------------------

RENAMED = DOCS / "reference" / "renamed.md"
CODE = re.compile(r"^```[^\n]*\n(.*?)^```$|(?<!`)`([^`\n]+)`(?!`)", re.S | re.M)
"""Blocks of code, and code within a line."""

CURRENT = {"closed", "constraint_drift", "energy_drift", "source", "turn", "velocity", "where"}
"""Old names that are current ones of other objects."""


def old_names_in(page: str) -> set[str]:
    """Return the old names that the code of a page uses, as names, keywords or paths."""
    codes = [block or inline for block, inline in CODE.findall(page)]
    old = {path for path in MODULES if any(re.search(rf"{path}(?![\w/])", code) for code in codes)}
    for module, names in NAMES.items():
        for name in names.keys() - CURRENT:
            imported = rf"from {module} import [^#\n]*\b{name}\b|\b{module}\.{name}\b"
            bare = rf"\A(?:\w+\.)*{name}(?:\(.*)?\Z" if name[0].islower() else r"(?!)"
            if any(re.search(f"{imported}|{bare}", code) for code in codes):
                old.add(name)
    for name in {name for names in FIELDS.values() for name in names} - CURRENT:
        used = rf"\A{name}\Z|[\w)]\.{name}\b(?!\()|[(,]\s*{name}=|\A{name}="
        if any(re.search(used, code) for code in codes):
            old.add(name)
    for command, options in OPTIONS.items():
        for option in options:
            if any(re.search(rf"\b{command}\b[^\n]*{option}\b", code) for code in codes):
                old.add(f"{command} {option}")
    return old


@pytest.mark.parametrize("page", PAGES, ids=[page.name for page in PAGES])
def test_no_page_teaches_a_renamed_name(page: Path):
    if page != RENAMED:
        # Also current: `Finding.follows`, and `square` in counts of random constraints.
        assert old_names_in(page.read_text(encoding="utf-8")) <= {"follows", "square"}


@pytest.mark.parametrize(
    ("code", "old"),
    [
        ("`first=` names them", {"first"}),
        ("`scene.made.description`", {"made"}),
        ("`made.left_out`", {"left_out"}),
        ("`pictured` is the pose", {"pictured"}),
        ("`drawn=(low, high)`", {"drawn"}),
        ("`square(name, link, along, other, along_other)`", {"square"}),
        ("```text\nJoint(\n    name,\n    place=(0, 0, 0),\n)\n```\n", {"place"}),
        ("```python\nfrom eomcheck.testing import Functions\n```\n", {"Functions"}),
        (
            "```python\nfrom eomcheck.random_mechanisms import x\n```\n",
            {"eomcheck.random_mechanisms"},
        ),
        ("```console\n$ eomcheck fuzz --states 3\n```\n", {"fuzz --states"}),
        ("a square, drawn first: `origin=` and `dependent`", set()),
    ],
)
def test_an_old_name_in_code_is_found(code: str, old: set[str]):
    assert old_names_in(code) == old


# ---- Glossary ------------------------------------------------------------------------------------

TERM = re.compile(r"\{term\}`(?:[^`<]*<)?\s*([^`>]+?)>?`", re.S)


def test_every_word_of_the_glossary_is_linked_from_some_other_page():
    glossary = DOCS / "reference" / "glossary.md"
    blocks = re.findall(r"^```\{glossary\}\n(.*?)^```$", glossary.read_text("utf-8"), re.S | re.M)
    words = {line for block in blocks for line in re.findall(r"^(\S.*)$", block, re.M)}
    assert len(words) > 40
    others = (page.read_text("utf-8") for page in PAGES if page != glossary)
    linked = {" ".join(word.split()) for text in others for word in TERM.findall(text)}
    assert not words - linked


def loaded(name: str) -> ModuleType:
    """Return what builds the documentation, a file of its folder."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# ---- Formulas and numbers, where what builds the documentation is installed ----------------------


@pytest.mark.parametrize(
    ("raised", "beside"),
    [
        ("<msup><mi>w</mi><mo>′</mo></msup>", "<mrow><mi>w</mi>PRIME</mrow>"),
        (
            "<msup><mi>a</mi><mrow><mo>′</mo><mi>T</mi></mrow></msup>",
            "<msup><mrow><mi>a</mi>PRIME</mrow><mrow><mi>T</mi></mrow></msup>",
        ),
        (
            "<msubsup><mi>x</mi><mi>k</mi><mo>′</mo></msubsup>",
            "<msub><mrow><mi>x</mi>PRIME</mrow><mi>k</mi></msub>",
        ),
        (
            "<mrow><msup><mi>w</mi><mo>′</mo></msup><msup><mi>x</mi><mn>2</mn></msup></mrow>",
            "<mrow><mrow><mi>w</mi>PRIME</mrow><msup><mi>x</mi><mn>2</mn></msup></mrow>",
        ),
    ],
)
def test_a_prime_stands_beside_its_letter_and_powers_stay_raised(raised: str, beside: str):
    pytest.importorskip("sphinx")
    pytest.importorskip("math_core")
    formula = ElementTree.fromstring(f"<math>{raised}</math>")
    prime = '<mo form="postfix" lspace="0" rspace="0">′</mo>'
    found = ElementTree.tostring(loaded("formulas").with_primes_beside(formula), "unicode")
    assert found == f"<math>{beside.replace('PRIME', prime)}</math>"


def test_numbers_stay_whole_with_sign_and_unit_and_words_do_not():
    pytest.importorskip("sphinx")
    said = "It took 429 µs, 2.3e-15 of 1 365 953 at N = 100, 127 / 757 or 0.1 to 10 of em 7 in M-2"
    found = [run[0] for run in loaded("pages").RUN.finditer(said)]
    assert found[:5] == ["429 µs", "2.3e-15", "1 365 953", "N = 100", "127 / 757"]
    assert found[5:] == ["0.1 to 10", "7", "2"]


# ---- Links ---------------------------------------------------------------------------------------


def anchors(page: Path) -> set[str]:
    """Return the places of a page in Markdown that GitHub links to: its headings."""
    heads = re.findall(r"^#+ (.*)$", page.read_text("utf-8"), re.M)
    return {re.sub(r"[^\w\- ]", "", head).strip().lower().replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_links_of_pages_outside_the_documentation_lead_somewhere(page: str):
    links = re.findall(r"\]\(([^)]+)\)", (ROOT / page).read_text("utf-8"))
    inside = [link for link in links if not link.startswith("https://")]
    assert len(inside) > 1
    for link in inside:
        path, _, place = link.partition("#")
        assert (ROOT / path).is_file(), link
        assert not place or place in anchors(ROOT / path), link


@pytest.mark.parametrize(
    ("second", "said"),
    [
        ("<p id='there'></p>", ""),
        ("<p></p>", "index.html links to second.html#there"),
        (None, "index.html links to second.html#there"),
        ("<p id='there'><img src='none.png'></p>", "second.html links to none.png"),
        (
            "<p id='there'><script src='https://x.org/x.js'></script></p>",
            "loads https://x.org/x.js",
        ),
    ],
    ids=["whole", "no place", "no page", "no picture", "from elsewhere"],
)
def test_a_link_that_leads_nowhere_is_found(second: str | None, said: str, tmp_path: Path):
    module = loaded("check_links")
    index = "<a href='second.html#there'>x</a> <a href='#top'>y</a> <a href='https://x.org'>z</a>"
    (tmp_path / "index.html").write_text(index, encoding="utf-8")
    if second is not None:
        (tmp_path / "second.html").write_text(second, encoding="utf-8")
    found = module.broken(tmp_path)
    assert (len(found) == 1 and said in found[0]) if said else not found


def test_set_up_is_two_commands():
    blocks = re.findall(r"^```sh\n(.*?)^```$", (ROOT / "README.md").read_text("utf-8"), re.S | re.M)
    assert [len(block.splitlines()) for block in blocks] == [1, 1]
    assert blocks[0].endswith("eomcheck validate\n") and blocks[1].endswith("python -m pytest\n")

"""Measures of the source, on small texts made by hand."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.house import (
    CLAUSES,
    Event,
    Passage,
    comments_of,
    identifier_parts,
    matches,
    sorts_of,
    source_passages,
    walk_of,
    without_code,
    word_count,
)

SOURCE = '''"""Title.

Second paragraph.
"""

from math import (
    pi,
)

# A comment
# that goes on.
TURN = 2 * pi  # and one beside code
"""Angle of
a turn."""


@property
def one(
    x,
):
    """Return what there is."""
    text = """not a docstring

    """
    return x, text
'''
FILE = Path("one.py")


def test_each_line_is_of_one_sort():
    expected = {"docstrings": 7, "imports": 3, "comments": 2, "code": 9, "blank": 4}
    assert sorts_of(SOURCE) == expected
    assert sum(expected.values()) == len(SOURCE.splitlines())


def test_passages_are_docstrings_and_comments_with_their_lines():
    passages = {(one.line, one.text) for one in source_passages(FILE, SOURCE)}
    assert passages == {
        (1, "Title.\n\nSecond paragraph.\n"),
        (10, "A comment\nthat goes on.\nand one beside code"),
        (13, "Angle of\na turn."),
        (21, "Return what there is."),
    }


def test_comments_on_lines_apart_are_two():
    assert list(comments_of("# one\nx = 1\n# two\n")) == [(1, "one"), (3, "two")]


def places(clause: str, text: str) -> list[str]:
    return [place for place, _ in matches(CLAUSES[clause], [Passage(FILE, 5, text)])]


def test_what_as_a_noun_is_found_across_lines():
    assert places("what as a noun", "Return what is.\n\nWhat is, and a list of\nwhat was.") == [
        "one.py:5",
        "one.py:7",
        "one.py:8",
    ]
    assert not places("what as a noun", "See what is, whatever by: what.")


def test_verbs_count_in_their_forms_and_not_in_other_words():
    assert places("say, says, said", "Said so;\nit says, essay") == ["one.py:5", "one.py:6"]
    assert places("look(ed) at", "looked\nat, outlook at, look for") == ["one.py:6"]
    assert places("tell, tells, told", "tells, intelligible") == ["one.py:5"]


def test_code_is_no_prose_and_lines_keep_their_numbers():
    page = "one `two`\n```text\nthree\n```\nfour <!-- five\n--> six\n```{note}\nseven\n```\neight\n"
    left = without_code(page)
    assert left.split() == ["one", "four", "six", "seven", "eight"]
    assert left.splitlines()[4] == page.splitlines()[4].replace(" <!-- five", " ")
    assert [i for i, line in enumerate(left.splitlines()) if line == "eight"] == [9]


def test_words_are_counted():
    assert word_count([Passage(FILE, 1, "κ · scale of a\nquantity"), Passage(FILE, 2, "")]) == 5


def test_identifiers_are_counted_by_their_words():
    counts = identifier_parts(["def looked_at(x): return LookAgain + looked_at"])
    assert counts == {
        frozenset({"looked", "at"}): 2,
        frozenset({"look", "again"}): 1,
        frozenset({"x"}): 1,
    }


def test_a_walk_counts_crossings_by_the_stack_and_changes_by_the_events():
    inside = [Event(True, "b/two.py"), Event(False, "b/two.py")]
    walk = walk_of([Event(True, "a/one.py"), *inside, *inside, Event(False, "a/one.py")])
    assert walk._asdict() == {
        "files": 2,
        "rooms": 2,
        "depth": 2,
        "crossings": 2,
        "changes": 2,
        "calls": 3,
    }
    assert walk_of([Event(True, "errors.py"), Event(False, "errors.py")]).rooms == 1


def test_only_frames_of_the_package_are_recorded(tmp_path: Path):
    # In a process of its own, where nothing else runs that a profiler would have to follow.
    inside, outside = tmp_path / "inside" / "one.py", tmp_path / "other.py"
    inside.parent.mkdir()
    inside.write_text("def run():\n    return sorted([2, 1])\n", encoding="utf-8")
    outside.write_text("def run():\n    return 1\n", encoding="utf-8")
    code = (
        "import sys; from pathlib import Path; from tests.house import profiled; "
        f"sys.path[:0] = [{str(inside.parent)!r}, {str(tmp_path)!r}]; import one, other; "
        f"here = Path({str(inside.parent)!r}); "
        "print([tuple(x) for file in (one, other) for x in profiled(file.run, here)])"
    )
    run = [sys.executable, "-c", code]
    done = subprocess.run(run, capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.strip() == "[(True, 'one.py'), (False, 'one.py')]"

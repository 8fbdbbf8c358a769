"""The faults that are kept as data still fit the source, and what plants them can be believed."""

from __future__ import annotations

import ast
import re
import subprocess
from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from tests import mutants as planted
from tests.mutants import (
    KINDS,
    PACKAGE,
    ROOT,
    LostFaultError,
    Mutant,
    mutants,
    mutants_of,
    named_in,
)
from tests.mutants.__main__ import (
    Kept,
    Result,
    attempt,
    campaign,
    command_of,
    commands_of,
    files_of,
    open_questions,
    table,
    unplanted,
)

ALL = mutants()
every_file = pytest.mark.parametrize("file", sorted({mutant.file for mutant in ALL}))

# ---- The data ------------------------------------------------------------------------------------


@cache
def starts(source: str) -> list[int]:
    """Indices of the lines with which statements of a file begin."""
    body = ast.parse(source).body
    return [min(x.lineno for x in (y, *getattr(y, "decorator_list", ()))) - 1 for y in body]


def another_program(planted: str, source: str) -> bool:
    """Whether two texts are two programs. Only statements with lines that differ are parsed."""
    lines = planted.splitlines(), source.splitlines()
    same, shorter = 0, min(map(len, lines))
    while same < shorter and lines[0][same] == lines[1][same]:
        same += 1
    rest = 0
    while rest < shorter - same and lines[0][-1 - rest] == lines[1][-1 - rest]:
        rest += 1
    begin = max((x for x in starts(source) if x <= same), default=0)
    end = min((x for x in starts(source) if x >= len(lines[1]) - rest), default=len(lines[1]))
    after = len(lines[1]) - end
    first, second = ("\n".join(x[begin : len(x) - after]) for x in lines)
    return ast.dump(ast.parse(first)) != ast.dump(ast.parse(second))


@every_file
def test_every_fault_is_found_once(file: str):
    known: dict[tuple[bool, str], str] = {}
    for mutant in ALL:
        if mutant.file == file:
            # Planted once is enough for a test, and once for a claim.
            key = mutant.claim == "", mutant.planted()
            assert known.setdefault(key, mutant.id) == mutant.id


@pytest.mark.sampled(8)
@every_file
def test_every_fault_makes_another_program(file: str):
    source = (PACKAGE / file).read_text(encoding="utf-8")
    same = [
        one.id for one in ALL if one.file == file and not another_program(one.planted(), source)
    ]
    assert same == []


def test_the_faults_of_a_commit_are_those_of_its_tables(tmp_path: Path, monkeypatch):
    def git(*arguments: str) -> None:
        identity = ["-c", "user.name=A", "-c", "user.email=a@b.c"]
        subprocess.run(["git", "-C", tmp_path, *identity, *arguments], check=True)

    table = tmp_path / "faults" / "report.toml"
    table.parent.mkdir()
    kept = '[[file]]\npath = "a.py"\n[[file.fault]]\nid = "a, b"\nbefore = "1"\nafter = "2"\n'
    table.write_text(kept)
    git("init", "-q")
    git("add", ".")
    git("commit", "-q", "-m", "Add a fault")
    table.write_text(kept + kept.replace("a, b", "c"))
    monkeypatch.setattr(planted, "ROOT", tmp_path)
    monkeypatch.setattr(planted, "HERE", table.parent)
    assert mutants_of("HEAD") == [Mutant("a, b", "report", "a.py", "1", "2")]
    assert [one.id for one in mutants() if one not in mutants_of("HEAD")] == ["c"]


def test_a_comment_and_a_line_break_make_no_other_program():
    source = "@cache\ndef f(x):\n    return g(x, 1)\n\n\nA = 1\n"
    assert not another_program(source, source)
    assert not another_program(source.replace("A = 1", "A = 1  # one"), source)
    assert not another_program(source.replace("(x, 1)", "(\n        x, 1)"), source)
    assert another_program(source.replace("(x, 1)", "(1, x)"), source)
    assert another_program(source.replace("@cache", "@lru_cache"), source)
    assert another_program(source.replace("A = 1", "A = 1\nA = 2"), source)
    assert another_program(source.replace("A = 1\n", ""), source)
    assert another_program("A = 1\n" + source.replace("A = 1\n", ""), source)


@every_file
def test_every_catcher_is_there_and_names_something(file: str):
    for mutant in ALL:
        if mutant.file != file:
            continue
        text = files_of(mutant.catcher).decode()
        assert text or mutant.catcher.startswith("python "), mutant.id
        assert mutant.named or mutant.equivalent, mutant.id
        # What it prints is the name of a test of its own, if it is one.
        if re.fullmatch(r"test_\w{8,}", mutant.named):
            assert f"def {mutant.named}" in text, mutant.id


def test_there_are_200_faults_and_60_in_the_harness_itself():
    counts = Counter(mutant.kind for mutant in ALL)
    assert counts.keys() <= set(KINDS)
    assert counts["harness"] >= 60
    assert len(ALL) >= 200 and sum(mutant.claim != "" for mutant in ALL) >= 200
    assert len({mutant.id for mutant in ALL}) == len(ALL)
    assert sum(mutant.quick for mutant in ALL) >= 10


@pytest.mark.parametrize(
    ("catcher", "named"),
    [
        ("tests/test_it.py -k test_one", "test_one"),
        ("tests/test_it.py::test_one", "test_one"),
        ("tests/test_it.py -x -k 'one or two'", ""),
        ("tests/test_it.py", ""),
    ],
)
def test_a_catcher_of_one_test_names_it(catcher: str, named: str):
    assert named_in(catcher) == named


# ---- The campaign --------------------------------------------------------------------------------

CATCHER = (
    "python -c 'from eomcheck.numbers import banded_solve as b; assert b.STALLED == 0.5, \"named\"'"
)
STALLED = Mutant(
    "stalled",
    "harness",
    "numbers/banded_solve.py",
    "STALLED = 0.5",
    "STALLED = 0.6",
    CATCHER,
    "AssertionError: named",
)
UNSEEN = replace(STALLED, id="unseen", before="= 1, 20", after="= 1, 21")


def test_a_fault_is_named_or_caught_or_survives():
    assert attempt(STALLED).outcome == "named"
    assert attempt(replace(STALLED, named="another text")).outcome == "caught"
    assert attempt(UNSEEN).outcome == "survived"


def test_the_named_test_of_a_catcher_runs_first_and_then_the_whole_catcher():
    named = "test_the_source_stays_as_it_is"
    one = replace(STALLED, catcher="tests/test_mutants.py -x -k stays", named=named)
    assert commands_of(one) == [
        command_of(f"tests/test_mutants.py::{named} -x -k stays"),
        command_of("tests/test_mutants.py -x -k stays"),
    ]
    for catcher in (f"tests/test_mutants.py::{named}", "tests/numbers/test_ball.py", CATCHER):
        assert commands_of(replace(one, catcher=catcher)) == [command_of(catcher)]
    two = "tests/test_mutants.py tests/numbers/test_ball.py"
    assert commands_of(replace(one, catcher=two)) == [command_of(two)]
    assert commands_of(replace(one, named="stays")) == [command_of(one.catcher)]


@pytest.mark.parametrize(
    ("ends", "outcome"),
    [
        ([(1, "test_named fails")], "named"),
        ([(1, "something fails")], "caught"),
        ([(0, ""), (1, "test_other fails")], "caught"),
        ([(5, "nothing run"), (1, "test_named fails")], "named"),
        ([(0, ""), (0, "")], "survived"),
        ([(5, "nothing run"), (0, "")], "survived"),
        ([(0, ""), (5, "nothing run")], "error"),
        ([(0, "2 skipped in 1 s"), (0, "3 skipped, 9 deselected in 1 s")], "skipped"),
        ([(5, "1 skipped in 1 s"), (5, "1 skipped in 1 s")], "skipped"),
        ([(0, "1 skipped in 1 s"), (0, "1 passed, 3 skipped in 1 s")], "survived"),
        ([(-1, "too long")], "error"),
    ],
)
def test_what_the_named_test_does_not_notice_the_rest_of_its_catcher_may(
    monkeypatch, ends: list[tuple[int, str]], outcome: str
):
    left = [*ends]
    monkeypatch.setattr(f"{attempt.__module__}.run", lambda *arguments: left.pop(0))
    catcher, named = "tests/test_it.py", "test_named"
    commands = [command_of(catcher, named), command_of(catcher)]
    monkeypatch.setattr(f"{attempt.__module__}.commands_of", lambda mutant: commands)
    assert attempt(replace(STALLED, catcher=catcher, named=named)).outcome == outcome
    assert not left


@pytest.mark.sampled(6)
@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"before": "STALLED = 0.7"}, "is 0 times in"),
        ({"before": "EPS"}, "times in numbers/banded_solve.py"),
        ({"catcher": "tests/test_mutants.py::test_that_is_not_there"}, "not found"),
        ({"catcher": "tests/numbers/test_ball.py -k no_such_test"}, "deselected"),
        ({"catcher": "python -c 'import time; time.sleep(60)'"}, "not done after"),
    ],
)
def test_what_was_not_tried_is_an_error_and_never_caught(change: dict, says: str):
    sleeping = "sleep" in change.get("catcher", "")
    result = attempt(replace(STALLED, **change), longest=2.0 if sleeping else 120.0)
    assert result.outcome == "error"
    assert says in result.said


def test_a_place_that_is_not_there_once_is_told():
    for before in ("no such text", "EPS"):
        with pytest.raises(LostFaultError, match="stalled: "):
            replace(STALLED, before=before).planted()


def test_a_catcher_that_fails_without_the_fault_catches_nothing():
    assert unplanted("python -c pass").outcome == "named"
    assert unplanted("python -c 'raise SystemExit(1)'").outcome == "error"


def test_a_fault_without_the_library_of_its_tests_is_named_as_skipped_and_not_kept(
    tmp_path: Path, monkeypatch
):
    ends = [(0, "2 skipped in 1 s"), (5, "1 skipped in 1 s"), *[(5, "1 skipped in 1 s")] * 3]
    monkeypatch.setattr(f"{attempt.__module__}.run", lambda *arguments: ends.pop())
    assert [unplanted(CATCHER).outcome for _ in "ab"] == ["skipped"] * 2
    results = campaign([STALLED], Kept(tmp_path / "results"), 1, tell=lambda line: None)
    assert {x.outcome for x in results} == {"skipped"} and not (tmp_path / "results").exists()
    skipped = Result("e", "harness", "skipped", 1.0)
    text = table([*RESULTS, skipped], {})
    assert "| harness | 2 | 1 | 0 | 1 | 0 |" in text
    assert "\n\nNot planted, as the library is not installed: e.\n" in text
    assert open_questions([skipped], {}) == []


def test_the_source_stays_as_it_is():
    before = (PACKAGE / STALLED.file).read_bytes()
    attempt(STALLED)
    assert (PACKAGE / STALLED.file).read_bytes() == before


@pytest.mark.night
def test_a_campaign_goes_on_where_it_was_stopped(tmp_path: Path):
    path, said = tmp_path / "results.jsonl", []
    tell = said.append
    first = campaign([STALLED], Kept(path), 1, tell=tell)
    assert [result.outcome for result in first] == ["named", "named"]
    with path.open("a") as file:
        file.write('["cut off", [{"id"')
    said.clear()
    both = campaign([STALLED, UNSEEN], Kept(path), 2, tell=tell)
    assert len(said) == 1 and "survived" in said[0]
    assert sorted((result.id, result.outcome) for result in both if result.kind == "harness") == [
        ("stalled", "named"),
        ("unseen", "survived"),
    ]
    said.clear()
    here = replace(STALLED, catcher="tests/numbers/test_ball.py -k no_such_test")
    campaign([here, UNSEEN], Kept(tmp_path / "others.jsonl"), 1, tell=tell, passing=True)
    assert [line.partition(": ")[2] for line in sorted(said)] == [
        f"the source as it is: {CATCHER}",
        "stalled",
        "unseen",
    ]
    said.clear()
    changed = campaign([replace(STALLED, after="STALLED = 0.7")], Kept(path), 1, tell=tell)
    assert len(said) == 1 and {result.outcome for result in changed} == {"named"}


# ---- What is said --------------------------------------------------------------------------------

RESULTS = [
    Result("a", "harness", "named", 1.0),
    Result("b", "harness", "survived", 1.0),
    Result("c", "report", "caught", 1.0),
    Result("d", "report", "survived", 1.0),
]


def test_the_table_counts_by_kind_and_explains_survivors():
    text = table(RESULTS, {"b": "no number changes"})
    assert "| harness | 2 | 1 | 0 | 1 | 1 |" in text
    assert "| report | 2 | 0 | 1 | 1 | 0 |" in text
    assert "| all | 4 | 1 | 1 | 2 | 1 |" in text
    assert "- `b`: no number changes\n- `d`: not explained\n" in text


def test_what_is_neither_named_nor_explained_is_left_to_be_looked_at():
    assert [one.id for one in open_questions(RESULTS, {"b": "no number changes"})] == ["c", "d"]
    assert [one.id for one in open_questions(RESULTS[:1], {"a": "is caught all the same"})] == ["a"]


def test_the_page_tells_a_campaign_of_no_more_faults_than_there_are():
    kept = (ROOT / "docs" / "figures" / "trust-table.md").read_text(encoding="utf-8")
    explained = {mutant.id for mutant in ALL if mutant.equivalent}
    assert "not explained" not in kept
    assert set(re.findall(r"^- `(.+?)`", kept, re.M)) <= explained
    for kind, count in Counter(mutant.kind for mutant in ALL).items():
        (told,) = re.findall(rf"^\| {kind} \| (\d+) \|", kept, re.M)
        assert 0 < int(told) <= count

"""Options that many studies have, and studies themselves, against values and whole sentences."""

from __future__ import annotations

import sys
from inspect import signature
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any

import pytest

from eomcheck.errors import InputError
from eomcheck.lab import study as module
from eomcheck.lab.option_parsing import (
    MOST_LINKS,
    check_count,
    no_more_than,
    parse_interval,
    parse_numbers,
    parse_parameters,
    parse_whole_numbers,
    split_list,
)
from eomcheck.lab.store.record_file import Record, Records
from eomcheck.lab.studies import STUDIES, study_of
from eomcheck.lab.study import Study

# ---- Options -------------------------------------------------------------------------------------


def test_numbers_of_links_are_read_alone_in_ranges_and_in_both():
    assert parse_whole_numbers("3") == [3]
    assert parse_whole_numbers("20, 1..4,3..5,50") == [1, 2, 3, 4, 5, 20, 50]
    assert (parse_interval("3"), parse_interval(" 1..12 "), parse_interval("7..7")) == (
        (3, 3),
        (1, 12),
        (7, 7),
    )
    assert parse_interval(f"1..{MOST_LINKS}") == (1, 100_000) and MOST_LINKS == 100_000
    assert no_more_than(None) is None and no_more_than(MOST_LINKS) == MOST_LINKS


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "a number or a range such as 1..12"),
        ("1...3", "a number or a range such as 1..12"),
        ("-1", "a number or a range such as 1..12"),
        ("2..", "a number or a range such as 1..12"),
        ("0", "whole numbers of at least 1"),
        ("0..3", "whole numbers of at least 1"),
        ("4..3", "first <= last"),
        ("100001", "at most 100000"),
        ("1..100001", "at most 100000"),
    ],
)
def test_what_is_no_number_of_links_is_refused_in_a_sentence(text, why):
    with pytest.raises(InputError) as error:
        parse_interval(text)
    assert str(error.value) == f"links = {text!r}, expected {why}"
    if text == "100001":
        with pytest.raises(InputError) as error:
            no_more_than(100_001)
        assert str(error.value) == "links = 100001, expected at most 100000"


def test_names_are_one_list_however_they_are_given_and_files_are_left_whole():
    assert split_list(None) is None and split_list([]) is None
    assert split_list(["au, em", "", "kane,"]) == ["au", "em", "kane"]
    assert split_list(["C:/a,b.py:X", " own.py:Y "]) == ["C:/a,b.py:X", "own.py:Y"]
    assert split_list(x for x in ("au", "em")) == ["au", "em"]
    with pytest.raises(InputError) as error:
        split_list([",", ""])
    assert str(error.value) == "', ' names nothing, expected at least one, or several: a,b"


def test_numbers_are_read_in_order_by_their_kind_and_what_is_none_is_named():
    assert (
        parse_numbers("rtol", ["1,0.5", "2e-3"]) == [1.0, 0.5, 0.002]
        and parse_numbers("rtol", None) == []
    )
    assert parse_numbers("n", ["3,1"], int) == [3, 1]
    for kind, said in ((float, "numbers"), (int, "whole numbers")):
        with pytest.raises(InputError) as error:
            parse_numbers("steps", ["1", "x"], kind)
        assert str(error.value) == f"steps = 'x', expected {said} such as 1,2"


def test_parameters_are_lists_of_numbers_or_absent_and_given_once():
    assert parse_parameters(None) == {}
    given = ["mass = 2", "length=1, 0.5", "damping=none"]
    assert parse_parameters(given) == {"mass": [2.0], "length": [1.0, 0.5], "damping": None}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["mass"], "set = 'mass', expected NAME=VALUE such as mass=2 or mass=1,2,3"),
        (["=2"], "set = '=2', expected NAME=VALUE such as mass=2 or mass=1,2,3"),
        (["mass= "], "set = 'mass= ', expected NAME=VALUE such as mass=2 or mass=1,2,3"),
        (["m=1", "m=2"], "set: m is given twice, expected m=1,2,3 for a list"),
        (["m=none", "m=none"], "set: m is given twice, expected m=1,2,3 for a list"),
        (["mass=,"], "set = 'mass=,', expected a number after mass="),
        (["mass=1,x"], "mass = 'x', expected numbers such as 1,2"),
    ],
)
def test_what_sets_no_parameter_is_refused_in_a_sentence(given, message):
    with pytest.raises(InputError) as error:
        parse_parameters(given)
    assert str(error.value) == message


def test_counts_are_one_at_least_and_the_one_that_is_not_is_named():
    check_count(states=1, seed=5)
    with pytest.raises(InputError) as error:
        check_count(states=3, repeats=0, seed=-1)
    assert str(error.value) == "repeats = 0, expected a whole number of at least 1"


# ---- Studies -------------------------------------------------------------------------------------


def cells(
    *,
    links: Annotated[int, "Links."] = 2,
    seed: Annotated[int, "Seed."] = 7,
    free: Annotated[bool, "Free."] = False,
) -> list[dict]:
    """Return two cells."""
    return [{"case": 1, "n": links}, {"case": 2, "n": links}]


def worker(known: Any, *, seed: int = 7) -> Any:
    """Return what makes Records with the seed and with what is known."""
    return lambda one: Record("x", one, counts={"seed": seed, "known": len(known)})


def first_worker(known: Any, *, free: bool = False) -> Any:
    """Return what makes Records of another study."""
    return lambda one: Record("first", one, counts={"free": int(free)})


def of(**more: Any) -> Study:
    """Return a study."""
    usual = {"key": "x", "cells": cells, "worker": worker, "tables": lambda found: ()}
    return Study(**usual | more)


FIRST = Study(key="first", cells=lambda: [{"a": 1}], worker=first_worker, tables=lambda found: ())


def test_a_study_has_the_options_of_its_cells_and_the_executor_of_a_parallel_one():
    assert [*of().options()] == ["links", "seed", "free"]
    found = of(before=(FIRST,), parallel_by=("case",)).options()
    assert [*found] == ["links", "seed", "free", "executor"]
    assert found["executor"].default == "local" and found["links"].default == 2


@pytest.mark.parametrize("key", STUDIES)
def test_workers_have_no_options_that_cells_do_not_have(key):
    study = study_of(key)
    for one in (study, *study.before):
        for function in (one.cells, one.worker):
            own = signature(function).parameters.values()
            assert {x.name for x in own if x.kind is x.KEYWORD_ONLY} <= study.options().keys()


def test_records_of_studies_before_are_known_first_and_are_those_of_the_study_too(monkeypatch):
    study = of(before=(FIRST,))
    with Records(None) as records:
        found = study.measure(records, links=5, seed=3, free=True)
        assert [(one.study, one.settings) for one in found] == [
            ("first", {"a": 1}),
            ("x", {"case": 1, "n": 5}),
            ("x", {"case": 2, "n": 5}),
        ]
        assert found[2].counts == {"seed": 3, "known": 1}
        again = study.measure(records, links=5, seed=4)
        assert [one.counts.get("seed") for one in again] == [None, 3, 3]
        fresh = study.measure(records, True, links=5, seed=4)
        assert [one.counts.get("seed") for one in fresh] == [None, 4, 4]
        # What comes before is measured anew as well.
        assert (again[0].counts["free"], fresh[0].counts["free"]) == (1, 0)
    other = Record("other", {})
    assert study.of([other, *found]) == found and of().of([other, *found]) == found[1:]


def test_cells_that_are_spread_go_where_they_are_to_by_their_settings_and_under_their_label(
    monkeypatch,
):
    asked: list[dict] = []
    places: list[str] = []

    def run_cells(records: Any, key: str, given: Any, work: Any, **how: Any) -> list:
        asked.append({"key": key, "cells": given} | how)
        return []

    monkeypatch.setattr(module, "run_cells", run_cells)
    monkeypatch.setattr(module, "check_executor", places.append)
    records: Any = None
    of().measure(records)
    spread = of(parallel_by=("case",), label="looking")
    spread.measure(records, True, executor="local:3")
    spread.measure(records)
    usual = {"key": "x", "cells": cells()}
    assert asked == [
        usual | {"fresh": False, "label": "measuring {case}", "executor": None, "by": ()},
        usual | {"fresh": True, "label": "looking", "executor": "local:3", "by": ("case",)},
        usual | {"fresh": False, "label": "looking", "executor": "local", "by": ("case",)},
    ]
    assert places == ["local:3", "local"]
    spread.check(executor="local:5", links=1, nothing=3)
    assert places[2:] == ["local:5"]


def test_each_figure_of_a_chart_is_drawn_and_tables_with_rows_are_written(
    monkeypatch, tmp_path: Path
):
    drawn: list[Any] = []

    def chart(*names: str) -> Any:
        return SimpleNamespace(files=lambda: [SimpleNamespace(name=name) for name in names])

    def sheet(name: str, rows: int = 1, detail: bool = False) -> Any:
        text = f"table {name}\n"
        return SimpleNamespace(name=name, rows=[0] * rows, detail=detail, markdown=lambda: text)

    def draw(file: Any, folder: Path) -> list[Path]:
        drawn.append((file.name, folder))
        return [folder / f"{file.name}.svg"]

    stub = SimpleNamespace(draw_both=draw)
    monkeypatch.setitem(sys.modules, "eomcheck.lab.show.chart_matplotlib", stub)  # slow to import
    study = of(
        charts=lambda found: [chart("a", "b"), chart(), chart("c")],
        tables=lambda found: [sheet("one"), sheet("none", 0), sheet("more", 1, True)],
        files=lambda found, folder: [folder / f"{len(found)}.json"],
    )
    written = study.write([Record("x", {})], tmp_path)
    assert written == [tmp_path / x for x in ("a.svg", "b.svg", "c.svg", "one.md", "1.json")]
    assert drawn == [(name, tmp_path) for name in "abc"]
    assert [x.name for x in tmp_path.iterdir()] == ["one.md"]
    assert (tmp_path / "one.md").read_text() == "table one\n"


def test_what_a_study_does_not_say_is_nothing_but_why_cells_are_not_done():
    made = of()
    done, lost = Record("x", {"n": 1}), Record("x", {"n": 2}, "refused", "too large")
    assert [*made.remarks([done, lost])] == ["n 2 refused: too large"]
    assert made.alarm([lost]) is False and made.files([], Path()) == made.charts([]) == ()
    assert [x["settings"] for x in made.document([done, lost])["records"]] == [{"n": 1}, {"n": 2}]
    assert (made.small, made.reading, made.label) == (False, "", "measuring {case}")

"""Trials say how far they are, and print the table of what is done when they are interrupted."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.trials.progress import Progress


def interrupted_after(count: int) -> Iterator[int]:
    yield from range(count)
    raise KeyboardInterrupt


def test_an_interrupted_trial_ends_with_what_is_done(capsys):
    done = 0
    with Progress(5, period=0.0) as progress:
        for item in progress.of(interrupted_after(2)):
            done += 1 + item
    assert (progress.interrupted, done) == (True, 3)
    assert capsys.readouterr().err == "1 of 5\n2 of 5\ninterrupted after 2 of 5\n"


def test_a_trial_that_ends_says_nothing_more(capsys):
    with Progress(2, period=1e9) as progress:
        assert list(progress.of("ab")) == ["a", "b"]
    assert not progress.interrupted
    assert capsys.readouterr().err == ""
    with pytest.raises(ValueError, match="something else"), Progress(2):
        raise ValueError("something else")


@pytest.mark.night
@pytest.mark.parametrize("trial", ["right_models", "wrong_functions"])
def test_a_table_is_printed_and_the_exit_code_is_that_of_an_interrupt(trial, monkeypatch, capsys):
    for library in ("pinocchio", "casadi"):
        pytest.importorskip(library)
    if trial == "right_models":
        from tests.trials import right_models as module

        alarm = ["an alarm"]
        monkeypatch.setattr(module, "models", lambda: [SimpleNamespace(origin="one")])
        monkeypatch.setattr(module, "judgements", lambda *_: iter_then_stop((0, {}, alarm)))
        said = "1 models, 1 with a false alarm"
    else:
        from tests.trials import wrong_functions as module

        monkeypatch.setattr(module, "faults", list)
        monkeypatch.setattr(module, "outcomes", lambda *_: iter_then_stop(None))
        said = "0 faults of 0 kinds"
    monkeypatch.setattr(sys, "argv", ["trial"])
    assert module.main() == 130
    printed = capsys.readouterr()
    assert said in printed.out
    assert printed.err.startswith("interrupted after 1 of ")


def iter_then_stop(item: object) -> Iterator[object]:
    yield item
    raise KeyboardInterrupt


# ---- Other ways of checking ----------------------------------------------------------------------

FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "alternatives.md"


def test_other_ways_pass_the_right_model_and_each_of_twenty_mistakes_is_one_edit():
    alternatives = pytest.importorskip("tests.trials.alternatives")
    right = alternatives.functions_of(None)
    assert not [name for name, way in alternatives.WAYS.items() if way(right)]
    assert len({mistake.name for mistake in alternatives.MISTAKES}) == 20
    for mistake in alternatives.MISTAKES:
        assert vars(alternatives.functions_of(mistake)).keys() == vars(right).keys()


def test_the_table_of_other_ways_has_the_twenty_mistakes():
    alternatives = pytest.importorskip("tests.trials.alternatives")
    rows = FIGURE.read_text(encoding="utf-8").splitlines()[2:]
    names = [row.strip("| ").split(" | ")[0] for row in rows]
    assert names == [*(mistake.name for mistake in alternatives.MISTAKES), "found in all"]


# ---- Wrong engines -------------------------------------------------------------------------------


def test_a_fault_of_an_engine_is_named_in_what_validate_prints_of_it(tmp_path):
    from tests.trials.wrong_engines import TREE, TRIAL, Fault, run

    fault = Fault("half of M", "mass_matrix", "return right / 2.0", says="half")
    few = "--scene", "sleigh", "--claim", "mass-matrix", "--examples", "2"
    outcome = run(fault, tmp_path, 0, TREE, TRIAL._replace(options={TREE: few}))
    assert outcome.found and outcome.named, outcome.output
    assert not outcome._replace(fault=fault._replace(says="twice")).named
    assert not outcome._replace(output=outcome.output.replace("FAIL ", "passed: ")).named

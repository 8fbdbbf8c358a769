"""`eomcheck fuzz`: what it says, keeps and returns."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import fields
from pathlib import Path

import pytest

from eomcheck import cli
from eomcheck.cli.fuzz_command import parse_duration
from eomcheck.lab.fuzzing import motion_rounds, state_rounds
from eomcheck.lab.fuzzing.campaign import RoundResult

FEW = ("--links", "2", "--engine", "none", "--ration", "0,0,0,0,0")


def run(*arguments: str, monkeypatch: pytest.MonkeyPatch) -> int:
    """Run `eomcheck fuzz` in this process and return its exit code."""
    few = () if "--replay" in arguments else FEW
    monkeypatch.setattr(sys, "argv", ["eomcheck", "fuzz", *few, *arguments])
    monkeypatch.setattr(state_rounds, "BATCH", 8)
    monkeypatch.setattr("eomcheck.lab.report.finding_output.EVERY", math.inf)  # no line of progress
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code or 0


def test_times_are_read():
    assert [parse_duration(x) for x in ("20s", "10m", "1.5h")] == [20.0, 600.0, 5400.0]


@pytest.mark.night
def test_without_a_find_it_tells_states_by_structure_and_exits_with_0(monkeypatch, capsys):
    how = "--examples", "1", "--family", "ordinary"
    assert run(*how, monkeypatch=monkeypatch) == 0
    said = capsys.readouterr().out
    assert "no failure" in said and "2 links, without stiffness" in said and "equivalence" in said


def test_a_find_is_printed_kept_and_replayed(monkeypatch, capsys, tmp_path: Path):
    scene = tmp_path / "wrong.py"
    scene.write_text(
        "from eomcheck.scenes import Snake, snake\n"
        "class Wrong(Snake, functions=()):\n"
        "    @staticmethod\n"
        "    def terms(*here):\n"
        "        found = snake.terms(*here)\n"
        "        return found._replace(B=-found.B)\n"
    )
    kept, records = tmp_path / "found.json", tmp_path / "r.db"
    how = ["--scene", f"{scene}:Wrong", "--claim", "kane-ml-force", "--examples", "1"]
    how += ["--family", "ordinary", "--keep", str(kept), "--records", str(records)]
    assert run(*how, monkeypatch=monkeypatch) == 1
    said = capsys.readouterr().out
    assert "kane-ml-force" in said and "for finding in eomcheck.check_state" in said
    (find,) = json.loads(kept.read_text())
    assert find["claim"] == "kane-ml-force" and find["whose"] == "scene"
    again = "--replay", str(kept), "--scene", f"{scene}:Wrong"
    assert run(*again, monkeypatch=monkeypatch) == 1
    assert "1 fail" in capsys.readouterr().out
    # It goes on with what was found before.
    assert run(*how, monkeypatch=monkeypatch) == 1
    assert len(json.loads(kept.read_text())) == 1


def test_interrupted_it_prints_what_was_looked_at_and_exits_with_130(monkeypatch, capsys):
    def stopped(plan, given) -> RoundResult:
        raise KeyboardInterrupt

    monkeypatch.setattr(state_rounds.StatePlan, "run", stopped)
    assert run("--examples", "1", monkeypatch=monkeypatch) == 130
    assert "interrupted" in capsys.readouterr().out


def test_rounds_of_workers_come_to_what_rounds_here_come_to(monkeypatch, capsys):
    how = ("--examples", "4", "--family", "ordinary", "--claim", "kinetic-energy")
    tables = []
    for where in ((), ("--executor", "local:2")):
        assert run(*how, *where, monkeypatch=monkeypatch) == 0
        lines = capsys.readouterr().out.splitlines()
        tables.append([line for line in lines if "CPU time" not in line])
    assert tables[0] == tables[1]


def test_motions_are_compared_by_the_same_command(monkeypatch, capsys):
    monkeypatch.setattr(motion_rounds.MotionPlan.__init__, "__defaults__", few_motions())
    monkeypatch.setattr(sys, "argv", ["eomcheck", "fuzz", "--motions", "--scene", "sleigh"])
    sys.argv += ["--examples", "1", "--seed", "3", "--no-climb"]
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert not stop.value.code
    said = capsys.readouterr().out
    assert "no failure" in said and "Motions by structure" in said and "end-states" in said


def few_motions() -> tuple:
    """Return the defaults of plans of four motions."""
    names = [one.name for one in fields(motion_rounds.MotionPlan)]
    defaults = dict(zip(names[3:], motion_rounds.MotionPlan.__init__.__defaults__, strict=True))
    return tuple((defaults | {"batch": 4}).values())


def test_what_says_nothing_of_motions_is_bad_input(monkeypatch, capsys):
    assert run("--motions", monkeypatch=monkeypatch) == 2
    assert "--engine has no effect with --motions" in capsys.readouterr().err

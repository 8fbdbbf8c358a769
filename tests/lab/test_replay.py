"""Kept failures checked again: nothing holds that was not checked, and no code runs unasked."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest

from eomcheck import cli
from eomcheck.claims import Finding
from eomcheck.errors import InputError
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing import failures
from eomcheck.lab.fuzzing.failures import FailureRecord, read_failures, replay_failures, runs_code

KEYS = tuple(FORMULATIONS)
SLEIGH = {"mass": 1.0, "inertia": 0.25, "offset": 0.5}
ROW = {"scene": "sleigh", "parameters": SLEIGH, "q": [0.0, 0.0, 0.5]}
ROW |= {"v": [0.0, 0.0, 0.0], "claim": "mass-matrix-symmetric"}


def find(**changed) -> FailureRecord:
    return FailureRecord(**{**ROW, "claim": "kinetic-energy", **changed})


def outcome_of(**changed) -> tuple[str, str]:
    (result,) = replay_failures([find(**changed)], KEYS)
    return result.outcome, result.reason


def run(path: Path, *more: str, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["eomcheck", "fuzz", "--replay", str(path), *more])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code or 0


def test_a_claim_that_is_decided_for_its_subject_holds():
    assert outcome_of() == ("holds", "")
    assert outcome_of(claim="equivalence", subject="au ~ im") == ("holds", "")
    assert outcome_of(claim="equivalence", subject="im ~ au") == ("holds", "")


@pytest.mark.parametrize(("claim", "outcome"), [("kinetic-energy", "inconclusive"), ("", "holds")])
@pytest.mark.parametrize("order", [1, -1])
def test_of_one_claim_all_is_decided_where_it_holds(monkeypatch, claim, outcome, order):
    """Of all claims some are undecided in any state."""
    of = "au", *find().case, 1e-3
    findings = [
        Finding("kinetic-energy", *of, 1.0, "passed", "made up"),
        Finding("kinetic-energy", *of, 2.0, "inconclusive", "made up"),
    ]
    monkeypatch.setattr(failures, "check_case", lambda *_: findings[::order])
    found, reason = outcome_of(claim=claim, subject="au")
    assert found == outcome
    assert reason == ("au: observed 0.001, allowed 2" if outcome == "inconclusive" else "")


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"subject": "hamel"}, "nothing is about 'hamel'"),
        ({"claim": "kinetic"}, "no claim 'kinetic'"),
        ({"parameters": {"mass": 1.0, "inertia": 0.25, "shift": 0.5}}, "'shift'"),
        ({"parameters": SLEIGH | {"mass": -1.0}}, "mass = -1.0"),
        ({"scene": "hovercraft"}, "unknown scene 'hovercraft'"),
        ({"q": [0.0]}, "q has shape (1,)"),
        ({"v": [0.0] * 4}, "v has shape (4,)"),
        ({"t_end": 1.0}, "no claim 'kinetic-energy'"),
        ({"t_end": 1.0, "claim": "end-states", "subject": "hamel"}, "nothing is about 'hamel'"),
    ],
)
def test_a_find_that_cannot_be_checked_does_not_hold(changed, reason: str):
    outcome, why = outcome_of(**changed)
    assert outcome == "not checked" and reason in why


def test_a_formulation_that_takes_no_part_is_named():
    (result,) = replay_failures([find(claim="equivalence", subject="au ~ im")], ["im", "kane"])
    assert (result.outcome, result.reason) == ("not checked", "au takes no part")


@pytest.mark.parametrize(
    "changed",
    [
        {"t_end": float("nan")},
        {"t_end": -1.0},
        {"t_end": "1"},
        {"t": float("inf")},
        {"q": [0.0, 0.0, float("nan")]},
        {"q": [0.0, 0.0, "0"]},
        {"q": [0.0, 0.0, 10**400]},
        {"q": 3},
        {"claim": None},
        {"subject": ["au"]},
        {"parameters": [1.0]},
        {"scene": 7},
    ],
)
def test_fields_that_are_no_find_are_told_when_the_file_is_read(tmp_path: Path, changed):
    file = tmp_path / "found.json"
    file.write_text(json.dumps([ROW | changed]))
    with pytest.raises(InputError, match="holds no failures") as told:
        read_failures(file)
    assert next(iter(changed)) in str(told.value)


@pytest.mark.parametrize("text", ["{}", "3", "null", "[3]", "[" * 100_000, "[{}]", "\x00", ""])
def test_other_documents_are_no_finds(tmp_path: Path, text: str):
    file = tmp_path / "found.json"
    file.write_text(text)
    with pytest.raises(InputError, match="holds no failures"):
        read_failures(file)


def test_a_pipe_is_no_file_of_finds(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="is not a regular file"):
        read_failures(tmp_path / "pipe")


def test_what_was_not_checked_is_counted_printed_and_no_success(tmp_path, monkeypatch, capsys):
    file = tmp_path / "found.json"
    good, unknown = ROW | {"claim": "kinetic-energy"}, ROW | {"claim": "kinetic"}
    file.write_text(json.dumps([good, unknown]))
    assert run(file, monkeypatch=monkeypatch) == 2
    told = capsys.readouterr()
    assert "2 failures: 1 hold now, 0 fail, 1 not checked" in told.out
    assert "not checked: failure 2, kinetic on sleigh: there is no claim 'kinetic'" in told.out
    assert "1 failure could not be checked" in told.err
    file.write_text(json.dumps([good]))
    assert run(file, monkeypatch=monkeypatch) == 0
    assert capsys.readouterr().out == "1 failure: 1 hold now, 0 fail\n"
    file.write_text("[]")
    assert run(file, monkeypatch=monkeypatch) == 0
    assert "holds no failures" in capsys.readouterr().out


def test_inconclusive_finds_are_counted_and_no_failure(tmp_path, monkeypatch, capsys):
    kept = json.loads((Path(__file__).parents[2] / "validation" / "found.json").read_text())
    one = next(x for x in kept if x.get("subject") == "uk, aᵀλ")
    file = tmp_path / "found.json"
    file.write_text(json.dumps([one]))
    assert run(file, monkeypatch=monkeypatch) == 0
    told = capsys.readouterr().out
    assert "0 hold now, 0 fail" in told and "1 inconclusive" in told
    assert "inconclusive: failure 1, redundant-rows on snake: uk, aᵀλ:" in told


OWN = """
from pathlib import Path
from eomcheck.scenes.sleigh import Sleigh, sleigh_terms
Path({mark!r}).write_text("imported")
class Own(Sleigh, functions=()):
    pass
"""


def test_code_that_a_corpus_names_is_imported_only_where_it_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "path", list(sys.path))
    mark, code = tmp_path / "mark", tmp_path / "own_of_a_corpus.py"
    code.write_text(OWN.format(mark=str(mark)).replace(", sleigh_terms", ""))
    file = tmp_path / "found.json"
    file.write_text(json.dumps([ROW | {"claim": "kinetic-energy", "scene": f"{code}:Own"}]))
    assert run(file, monkeypatch=monkeypatch) == 2
    assert not mark.exists()
    told = capsys.readouterr()
    assert "1 not checked" in told.out and f"--scene {code}:Own" in told.err
    assert run(file, "--scene", f"{code}:Other", monkeypatch=monkeypatch) == 2
    assert not mark.exists()
    monkeypatch.chdir(tmp_path)
    assert run(file, "--scene", f"{code.name}:Own", monkeypatch=monkeypatch) == 0
    assert mark.exists()


def test_robots_and_registered_scenes_run_no_code():
    assert runs_code("sleigh") is runs_code("arm.urdf:floating") is runs_code("arm.xml") is None
    assert runs_code("package.module:Own") == ("package.module", "Own")


def test_one_file_has_one_name_whatever_leads_to_it(tmp_path: Path):
    (tmp_path / "own").mkdir()
    own, link = tmp_path / "own" / "own.py", tmp_path / "link.py"
    own.write_text("Own = 1\n")
    link.symlink_to(own)
    expected = str(own.resolve()), "Own"
    for path in (own, link, tmp_path / "own" / ".." / "own" / "own.py"):
        assert runs_code(f"{path}:Own") == expected
    assert runs_code(f"{own}:Other") == (expected[0], "Other")

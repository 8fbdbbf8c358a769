"""Long runs of proofs: saved as they are made, resumed, spread over processes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from eomcheck.errors import InputError, UnknownNameError
from eomcheck.lab import proofs
from eomcheck.lab.proofs import Proofs, proof_jobs
from eomcheck.lab.store.record_file import Records


def jobs(links=(1, 2, 3), points=1, seed=5, formulations=None):
    return proof_jobs("snake", links, points, seed, formulations)


@pytest.mark.night
def test_every_structure_is_proved_and_written(tmp_path: Path):
    path = tmp_path / "proofs.json"
    run = Proofs(jobs(), path)
    run.run()
    run.write()
    document = json.loads(path.read_text(encoding="utf-8"))
    assert list(document["findings"]) == [
        "snake[1], no stiffness",
        "snake[2]",
        "snake[2], no stiffness",
        "snake[2], with damping",
        "snake[2], no stiffness, with damping",
        "snake[3]",
        "snake[3], no stiffness",
        "snake[3], with damping",
        "snake[3], no stiffness, with damping",
    ]
    assert document["seed"] == 5
    rows = [row for rows in document["findings"].values() for row in rows]
    assert all(row["verdict"] == "passed" and row["proof"]["primes"] for row in rows)
    assert not path.with_name("proofs.json.part").exists()
    assert not run.failed


def test_only_the_claims_that_are_named_are_proved_and_others_start_over(tmp_path: Path):
    path = tmp_path / "proofs.json"
    named = proof_jobs("sleigh", None, 1, 5, None, ["frame-rates", "kinetic-energy"])
    run = Proofs(named, path)
    run.run()
    rows = [row for rows in run.findings.values() for row in rows]
    assert {row.claim for row in rows} == {"kinetic-energy", "frame-rates"}
    assert {row.verdict for row in rows} == {"passed"}
    again = Proofs(named, path)
    again.run()
    assert (again.taken_over, again.started_over) == (1, False)
    every = Proofs(proof_jobs("sleigh", None, 1, 5, None), path)
    every.run()
    assert (every.taken_over, every.started_over) == (0, True)


@pytest.mark.parametrize(
    ("claims", "message"),
    [
        (["frame-rate"], "did you mean 'frame-rates'"),
        (["engine-gravity"], "claim = 'engine-gravity', expected one that is an identity"),
        ([], "names nothing"),
    ],
)
def test_a_claim_that_is_no_identity_is_refused(claims, message):
    with pytest.raises(InputError, match=message):
        proof_jobs("sleigh", None, 1, 5, None, claims)


@pytest.mark.night
def test_a_run_goes_on_where_another_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "proofs.json"
    whole = Proofs(jobs())
    whole.run()
    proved = []

    def stopping(scene, *how):
        if len(proved) == 2:
            raise KeyboardInterrupt
        proved.append(scene.structure)
        return real(scene, *how)

    real = proofs._prove
    monkeypatch.setattr(proofs, "_prove", stopping)
    first = Proofs(jobs(), path)
    with pytest.raises(KeyboardInterrupt):
        first.run()
    assert list(first.findings) == proved
    monkeypatch.setattr(proofs, "_prove", real)
    second = Proofs(jobs(), path)
    second.run()
    assert second.taken_over == 2
    assert second.findings == whole.findings


def test_what_other_sources_points_or_seeds_made_is_not_taken_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = tmp_path / "proofs.json"
    Proofs(jobs(links=(1,)), path).run()
    again = Proofs(jobs(links=(1,)), path)
    again.run()
    assert again.taken_over == 1
    for other in (jobs(links=(1,), points=2), jobs(links=(1,), seed=6)):
        run = Proofs(other, path)
        run.run()
        assert run.taken_over == 0
        assert run.started_over
    monkeypatch.setattr(proofs, "sources", lambda: "changed")
    run = Proofs(jobs(links=(1,), seed=6), path)
    run.run()
    assert run.taken_over == 0


def test_an_unfinished_file_that_is_none_of_records_is_started_over(tmp_path: Path):
    path = tmp_path / "proofs.json"
    path.with_name("proofs.json.part").write_text('{"eomcheck": "0.1"}\n', encoding="utf-8")
    run = Proofs(jobs(links=(1,)), path)
    run.run()
    assert run.started_over
    run.write()
    assert [one.name for one in tmp_path.iterdir()] == ["proofs.json"]


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path):
    path = tmp_path / "proofs.json"
    path.with_name("proofs.json.part").mkdir()
    with pytest.raises(InputError, match=r"proofs\.json\.part' is not a regular file"):
        Proofs(jobs(links=(1,)), path).run()


def test_a_seed_of_the_system_is_kept_when_a_run_goes_on(tmp_path: Path):
    path = tmp_path / "proofs.json"
    first = Proofs(jobs(links=(1,), seed=None), path)
    first.run()
    second = Proofs(jobs(links=(1, 2), seed=None), path)
    second.run()
    assert second.seed == first.seed
    assert second.taken_over == 1


@pytest.mark.night
def test_processes_prove_the_same_as_one(monkeypatch: pytest.MonkeyPatch):
    one = Proofs(jobs(links=(2, 3)))
    one.run()
    monkeypatch.setattr(proofs, "WORTH_A_PROCESS", 5)
    two = Proofs(jobs(links=(2, 3)))
    two.run()
    assert two.findings == one.findings


@pytest.mark.parametrize(
    ("arguments", "error", "says"),
    [
        (("worm", [1], 4, None, None), UnknownNameError, "unknown scene 'worm'"),
        (("snake", [1], 0, None, None), InputError, "points = 0"),
        (("snake", [0], 4, None, None), InputError, "links = 0"),
        (("snake", [1], 4, None, ["xx"]), UnknownNameError, "unknown formulation 'xx'"),
    ],
)
def test_bad_jobs_are_named(arguments, error, says):
    with pytest.raises(error, match=says):
        proof_jobs(*arguments)


@pytest.mark.night
def test_a_killed_command_resumes(tmp_path: Path):
    path = tmp_path / "proofs.json"
    part = path.with_name("proofs.json.part")
    command = [
        *(sys.executable, "-c", "from eomcheck.cli import main; main()"),
        *("prove", "--links", "1..60", "--examples", "1", "--json", str(path)),
    ]
    killed = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline:
        with suppress(InputError), Records(part, readonly=True) as records:
            if len(records) > 5:
                break
        time.sleep(0.05)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.wait()
    assert not path.exists()
    command[command.index("1..60")] = "1..2"
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    said = " ".join(done.stdout.split())  # however wide the terminal is
    assert "5 of 5 structures (5 of them in an earlier run)" in said
    assert path.exists() and not part.exists()

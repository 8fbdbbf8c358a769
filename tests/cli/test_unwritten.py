"""Results that cannot be written are printed, and a damaged file is refused before it is needed."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path
from threading import Thread

import pytest

from eomcheck import cli
from eomcheck.cli.application import CommandEnd
from eomcheck.console import deferring_interrupts
from eomcheck.errors import UnwrittenError
from eomcheck.lab.fuzzing import campaign as campaigns
from eomcheck.lab.fuzzing import failures as corpus
from eomcheck.lab.fuzzing.failures import FailureRecord
from eomcheck.lab.store.record_file import Records

FULL = Path("/dev/full")
FIND = FailureRecord(
    "sleigh", {}, [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.0, "bias", "au ~ el", 1.0, 0.5, "au"
)
FEW = "validate", "--scene", "sleigh", "--examples", "1", "--engine", "casadi"

needs_full = pytest.mark.skipif(not FULL.exists(), reason="no /dev/full")


def run(monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    """Run the command line in this process and return its exit code."""
    monkeypatch.setattr(sys, "argv", ["eomcheck", *map(str, words)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code or 0


@pytest.fixture
def campaign(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Let `fuzz_command` make one find at once; what it was asked for is noted."""
    ran = []

    def of_one_find(campaign: campaigns.Campaign, *how: object) -> None:
        ran.append(how)
        campaign.failure_records[FIND.key] = FIND

    monkeypatch.setattr(campaigns.Campaign, "run", of_one_find)
    return ran


def test_of_several_files_that_cannot_be_written_the_first_is_reported():
    end = CommandEnd()
    for name in ("first", "second"):
        with end.collected():
            raise UnwrittenError(name)
    with pytest.raises(UnwrittenError, match=r"^first$"):
        end.conclude(None, failed=False)


@needs_full
def test_findings_that_cannot_be_written_are_printed(monkeypatch, capsys):
    assert run(monkeypatch, *FEW, "--json", FULL) == 2
    said = capsys.readouterr()
    assert "mass-matrix" in said.out and "written" not in said.out
    assert said.err.endswith("'/dev/full' cannot be written: No space left on device\n")


@pytest.mark.parametrize("after", [0, 2])
def test_a_validation_goes_on_where_its_records_can_no_longer_be_written(
    after, monkeypatch, capsys, tmp_path
):
    add, calls = Records.add, []

    def full(records, record):
        calls.append(record)
        if len(calls) > after:
            raise UnwrittenError("database or disk is full")
        add(records, record)

    monkeypatch.setattr(Records, "add", full)
    assert run(monkeypatch, *FEW, "--records", tmp_path / "r.db") == 2
    said = capsys.readouterr()
    assert "mass-matrix" in said.out and ", 3 states, " in said.out
    assert said.err.endswith("eomcheck: database or disk is full\n")
    assert len(calls) == after + 1


def test_a_damaged_corpus_is_refused_before_a_campaign(campaign, monkeypatch, capsys, tmp_path):
    path = tmp_path / "k.json"
    path.write_text("[{")
    assert run(monkeypatch, "fuzz", "--examples", 1, "--keep", path) == 2
    assert not campaign
    assert "holds no failures" in capsys.readouterr().err
    assert path.read_text() == "[{"


@needs_full
@pytest.mark.parametrize("option", ["--keep", "--records"])
def test_finds_that_cannot_be_kept_are_printed(option, campaign, monkeypatch, capsys, tmp_path):
    def full(*how: object) -> None:
        campaign.append(how)
        raise UnwrittenError("No space left on device")

    monkeypatch.setattr(corpus, "write_failures", full)
    if option == "--records":
        run_of_one = campaigns.Campaign.run

        def run_then_full(made, *how):
            run_of_one(made, *how)
            full()

        monkeypatch.setattr(campaigns.Campaign, "run", run_then_full)
    assert run(monkeypatch, "fuzz", "--examples", 1, option, tmp_path / "k") == 2
    said = capsys.readouterr()
    assert "# bias, au ~ el: observed 1, allowed 0.5" in said.out and "written" not in said.out
    assert said.err.endswith("eomcheck: No space left on device\n")


def test_finds_are_stored_whole_by_a_campaign_that_is_told_to_end_meanwhile(
    campaign, monkeypatch, capsys, tmp_path
):
    path, write = tmp_path / "k.json", corpus.write_failures

    def told_to_end(*how):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.01)
        write(*how)

    monkeypatch.setattr(corpus, "write_failures", told_to_end)
    assert run(monkeypatch, "fuzz", "--examples", 1, "--keep", path) == 130
    assert [one["claim"] for one in json.loads(path.read_text())] == ["bias"]
    assert f"written: {path}" in capsys.readouterr().out
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_a_block_that_is_undisturbed_ends_and_raises_then():
    ended = []
    with pytest.raises(KeyboardInterrupt), deferring_interrupts():
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)
        ended.append(True)
    assert ended


def test_two_that_add_to_a_corpus_at_once_lose_nothing(monkeypatch, tmp_path):
    path, read = tmp_path / "k.json", corpus.read_failures

    def slowly(path):
        found = read(path)
        time.sleep(0.05)
        return found

    monkeypatch.setattr(corpus, "read_failures", slowly)
    finds = [replace(FIND, scene=scene) for scene in ("sleigh", "snake")]
    threads = [Thread(target=corpus.add_failures, args=(path, [one])) for one in finds]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert sorted(one.scene for one in read(path)) == ["sleigh", "snake"]

"""What becomes of the printing changes no file and no exit code."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from eomcheck.console import interruptible, progress
from eomcheck.errors import InputError
from eomcheck.lab.store.record_file import Records
from eomcheck.lab.store.validation_runs import STATES
from eomcheck.safe_output import ERROR_HANDLER, to_ascii, unfailing_output

COMMAND = [sys.executable, "-c", "from eomcheck.cli import main; main()"]
VALIDATE = "validate", "--scene", "sleigh", "--examples", "1"


def start(*words: object, **options) -> subprocess.Popen:
    env = os.environ | options.pop("env", {})
    return subprocess.Popen(
        [*COMMAND, *map(str, words)], env=env, stderr=subprocess.PIPE, **options
    )


def errors(said: bytes) -> bytes:
    """Return what was said on standard error, without what goes on for two seconds."""
    return b"".join(x for x in said.splitlines(keepends=True) if not x.endswith(b" ...\n"))


@pytest.mark.parametrize("words", [VALIDATE, ("list", "claims")])
@pytest.mark.night
def test_a_reader_that_has_gone_changes_no_exit_code_and_no_file(tmp_path: Path, words: tuple):
    file = tmp_path / "found.json"
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "wb") as gone:
        run = start(*words, *(["--json", file] if words is VALIDATE else []), stdout=gone)
    _, said = run.communicate(timeout=60)
    assert (run.returncode, errors(said)) == (0, b"")
    assert words is not VALIDATE or json.loads(file.read_text(encoding="utf-8"))["findings"]


@pytest.mark.night
def test_output_that_is_lost_on_its_way_is_said_and_the_file_is_there(tmp_path: Path):
    file, full = tmp_path / "found.json", Path("/dev/full")
    if not full.is_char_device():
        pytest.skip("no such device here")
    with full.open("wb") as output:
        run = start(*VALIDATE, "--json", file, stdout=output)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 2
    assert errors(said) == b"eomcheck: standard output cannot be written: No space left on device\n"
    assert json.loads(file.read_text(encoding="utf-8"))["findings"]


@pytest.mark.parametrize("gone", [False, True])
def test_output_that_is_lost_is_told_unless_its_reader_has_gone(gone, monkeypatch, capsys):
    reading, writing = os.pipe()
    os.close(reading)
    if not gone:
        os.close(writing)
        if not Path("/dev/full").is_char_device():
            pytest.skip("no such device here")
        writing = os.open("/dev/full", os.O_WRONLY)
    code = 0
    with os.fdopen(writing, "w", encoding="utf-8") as lost:
        monkeypatch.setattr(sys, "stdout", lost)
        try:
            with unfailing_output():
                print("a table")
        except SystemExit as stop:
            code = stop.code
        monkeypatch.undo()
    said = "eomcheck: standard output cannot be written: No space left on device\n"
    assert (code, capsys.readouterr().err) == ((0, "") if gone else (2, said))


@pytest.mark.night
@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "utf-8"])
def test_characters_that_an_encoding_lacks_are_written_by_name(tmp_path: Path, encoding: str):
    file, env = tmp_path / "found.json", {"PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"}
    run = start(*VALIDATE, "--json", file, stdout=subprocess.PIPE, env=env)
    printed, said = run.communicate(timeout=60)
    assert (run.returncode, errors(said)) == (0, b"")
    text = printed.decode(encoding)
    assert ("q̈ in doubles" if encoding == "utf-8" else "qddot in doubles") in text
    assert json.loads(file.read_text(encoding="utf-8"))["findings"]


@pytest.mark.night
def test_errors_are_written_in_any_encoding():
    env = {"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    run = start("validate", "--scene", "θ", env=env, stdout=subprocess.PIPE)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 2
    assert said.startswith(b"eomcheck: ") and b"theta" in said and b"Traceback" not in said


@pytest.mark.parametrize(
    ("text", "written"),
    [
        *[("θ_3 Δκ", "theta_3 Deltakappa"), ("ς", "sigma"), ("v̇ q̈", "vdot qddot"), ("μ", "mu")],
        *[("12 µs", "12 us"), ("N³·x²", "N^3.x^2"), ("a ≤ b → c…", "a <= b -> c...")],
        *[("é\ud800漢", "e??"), ("─│┌┼", "-|++"), ("aᵀ", "aT"), ("°", "deg")],
    ],
)
def test_greek_has_names_and_the_rest_a_plain_form(text: str, written: str):
    assert text.encode("ascii", ERROR_HANDLER) == written.encode()


def test_every_character_of_the_package_has_a_plain_form():
    package = Path(sys.modules["eomcheck"].__file__ or "").parent
    files = [*package.rglob("*.py"), *package.rglob("*.j2")]
    used = {x for file in files for x in file.read_text(encoding="utf-8") if not x.isascii()}
    assert len(used) > 20
    assert {x for x in used if to_ascii(x) in ("", "?")} == set()


def kept(records: Path) -> bool:
    with suppress(InputError), Records(records, readonly=True) as found:
        return bool(found.all(STATES))
    return False


@pytest.mark.sampled(2)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_validation_that_is_told_to_end_writes_what_it_has(tmp_path: Path, number: int):
    file, records = tmp_path / "found.json", tmp_path / "found.db"
    file.write_text("old")
    words = "--examples", "1000000", "--json", file, "--records", records
    script = COMMAND[-1]
    # A shell that runs the tests in the background has its jobs ignore Ctrl-C.
    script = f"import signal; signal.signal(signal.SIGINT, signal.default_int_handler); {script}"
    run = subprocess.Popen(
        [*COMMAND[:-1], script, "validate", "--scene", "sleigh", *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    deadline = time.monotonic() + 60
    while not kept(records):
        assert time.monotonic() < deadline
        time.sleep(0.1)
    assert file.read_text() == "old"
    run.send_signal(number)
    printed, said = run.communicate(timeout=60)
    assert (run.returncode, errors(said)) == (130, b"")
    assert b"interrupted: the table holds what was checked until then" in printed
    assert json.loads(file.read_text(encoding="utf-8"))["findings"]
    assert not list(tmp_path.glob(".*"))


def test_standard_output_is_the_same_again_afterwards(monkeypatch, capsys):
    from eomcheck.safe_output import unfailing_output

    raw = io.BytesIO()
    stream = io.TextIOWrapper(io.BufferedWriter(Raw(raw)), "ascii")
    monkeypatch.setattr("sys.stdout", stream)
    with unfailing_output():
        print("θ")
    assert sys.stdout is stream
    assert raw.getvalue() == b"theta\n"


class Raw(io.RawIOBase):
    def __init__(self, into: io.BytesIO):
        self.into = into

    def writable(self) -> bool:
        return True

    def write(self, data, /) -> int:
        return self.into.write(data)


@pytest.mark.parametrize("file", [None, "r.db"])
def test_an_interrupted_study_says_where_it_goes_on(tmp_path: Path, monkeypatch, capsys, file):
    from eomcheck.cli import main
    from eomcheck.lab.studies import study_of

    def stopped(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(type(study_of("operations")), "run", stopped)
    records = ["--records", str(tmp_path / file)] if file else []
    monkeypatch.setattr("sys.argv", ["eomcheck", "study", "operations", *records])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 130
    said = capsys.readouterr().out
    assert "nothing is kept without a file of records" in said if file is None else file in said
    assert ("goes on with the others" in said) is (file is not None)


def test_an_interruption_is_over_with_the_block_that_it_ends():
    with pytest.raises(KeyboardInterrupt), interruptible():
        signal.raise_signal(signal.SIGTERM)
    again = False
    try:
        with interruptible(), progress("", 1) as advance:
            advance()
    except KeyboardInterrupt:  # which would end pytest
        again = True
    assert not again


def test_an_interruption_that_something_swallows_comes_with_the_next_step(capfd):
    done = []

    class Swallowing:
        def __del__(self):
            signal.raise_signal(signal.SIGTERM)
            sum(range(1000))

    with pytest.raises(KeyboardInterrupt), interruptible(), progress("", 3) as advance:
        one = Swallowing()
        del one
        done.append("went on")
        advance()
        done.append("too far")
    assert done == ["went on"]
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    assert capfd.readouterr().err == ""
    with progress("", 1) as advance:  # and is over then
        advance()

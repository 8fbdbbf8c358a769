"""Commands on code of a user's file that exits, dies or never returns."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from tests.engines.planar import with_fault

import eomcheck
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.class_lookup import in_file, outside_error
from eomcheck.engines import Engine, engine_of, version_of
from eomcheck.errors import CallError, InputError, described_error
from eomcheck.scenes import Sleigh
from eomcheck.testing import check_functions

GUIDES = Path(__file__).parents[2] / "docs" / "guides"
COMMAND = [sys.executable, "-c", "from eomcheck.cli import main; main()"]
ENDS = {
    "SystemExit: 0": "import sys; sys.exit(0)",
    "GeneratorExit": "raise GeneratorExit",
    "Own: 5": "raise type('Own', (BaseException,), {})(5)",
}
"""How code wants to end its process -> what is reported of it."""


def eom(*words: object, stdin: str | None = None) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, input=stdin)


def sentence(run: subprocess.CompletedProcess[str]) -> str:
    """Return what was said on standard error, without what goes on for two seconds."""
    return "".join(x for x in run.stderr.splitlines(keepends=True) if not x.endswith(" ...\n"))


def trailer(folder: Path, name: str, body: str, before: str = "def drift(") -> str:
    """Write the scene of the guide with a function that begins otherwise; return its name."""
    source = (GUIDES / "trailer.py").read_text(encoding="utf-8")
    head, _, rest = source.partition(before)
    first, _, rest = rest.partition("\n")
    path = folder / f"{name}.py"
    path.write_text(f"{head}{before}{first}\n    {body}\n{rest}", encoding="utf-8")
    return f"{path}:Trailer"


def engine(folder: Path, name: str, body: str, method: str = "def bias(self, q, v, t=0.0):"):
    return with_fault(folder, name, method, f"{method}\n        {body}")


# ---- Where Python runs on: failures of that code -------------------------------------------------


@pytest.mark.parametrize("reported", ENDS)
def test_an_engine_that_wants_to_exit_fails_by_name(tmp_path: Path, reported: str):
    file = engine(tmp_path, f"exits_{reported[:3]}", ENDS[reported])
    own = engine_of(f"{file}:Planar")
    q, v = Sleigh().initial_state()
    claims = ["mass-matrix", "bias"]
    mass, bias = eomcheck.check_state(Sleigh(), q, v, engines=[own], claims=claims)
    assert mass.verdict == "passed"
    assert bias.verdict == "failed"
    assert f"bias raised {reported} ({file.name}, line " in bias.detail


@pytest.mark.parametrize("reported", ENDS)
def test_a_function_that_wants_to_exit_fails_by_name(reported: str):
    def M(q):
        exec(ENDS[reported])

    found = check_functions(2, M=M, gravity=lambda q: np.zeros(2))
    failed = [one for one in found if one.verdict == "failed"]
    assert failed
    assert failed[0].detail == f"M, {reported}"


@pytest.mark.parametrize("reported", ENDS)
def test_a_scene_that_wants_to_exit_is_named(tmp_path: Path, reported: str):
    name = trailer(tmp_path, f"leaves_{reported[:3]}", ENDS[reported])
    scene = in_file(*name.split(":"))()
    found = eomcheck.check_state(scene, *scene.initial_state())
    failed = [one for one in found if one.verdict == "failed"]
    assert failed
    assert f"Trailer.drift raised {reported}" in failed[0].detail


@pytest.mark.parametrize("n", [-1, -3, 20_001, 10**9, 1.5, None])
def test_a_scene_with_a_senseless_number_of_coordinates_is_bad_input(n):
    class Own(Sleigh):
        pass

    Own.n = n
    says = f"Own.n = {n}, expected a whole number from 0 to 20000"
    with pytest.raises(InputError, match=re.escape(says)):
        eomcheck.check_state(Own(), [0.0] * 3, [0.0] * 3)


@pytest.mark.parametrize("state", [None, 5, (), ([0.0] * 3,), ([0.0] * 3,) * 3])
def test_an_initial_state_that_is_no_pair_is_bad_input(state):
    class Own(Sleigh):
        def initial_state(self):
            return state

    with pytest.raises(InputError, match=r"Own\.initial_state returned .*, expected \(q, v\)"):
        Own().initial_state()


@pytest.mark.parametrize(
    ("returned", "says"),
    [
        (None, "version() returned None, expected a text"),
        (3, "version() returned an int, expected a text"),
        ("", "version() returned '', expected a text"),
        (KeyError("x"), "version() raised KeyError: 'x'"),
        (SystemExit(0), "version() raised SystemExit: 0"),
    ],
)
def test_a_version_that_is_no_text_is_bad_input(returned, says: str):
    class Own(Engine):
        @classmethod
        def version(cls):
            if isinstance(returned, BaseException):
                raise returned
            return returned

        @classmethod
        def represents(cls, scene):
            return True

    with pytest.raises(InputError) as caught:
        version_of(Own)
    assert str(caught.value).startswith(f"engine Own: {says}")


def test_a_version_is_one_line_without_control_characters():
    class Own(Engine):
        version = classmethod(lambda cls: " own\n1\x1b[31m ")
        represents = classmethod(lambda cls, scene: True)

    assert version_of(Own) == "own 1\ufffd[31m"


def test_an_exception_whose_text_exits_is_described_all_the_same():
    class Own(Exception):
        def __str__(self):
            raise SystemExit

    assert described_error(Own()) == "Own: its text cannot be read: __str__ raises SystemExit"


# ---- Commands ------------------------------------------------------------------------------------


@pytest.mark.night
def test_a_command_whose_process_vanishes_reports_that_and_exits_with_1(tmp_path: Path):
    name = trailer(tmp_path, "vanishes", "import os; os._exit(0)")
    run = eom("acceleration", "--scene", name)
    assert run.returncode == 1
    assert sentence(run) == "eomcheck: Trailer.drift ended its process with exit code 0\n"


@pytest.mark.night
def test_an_import_that_vanishes_is_reported_and_not_tried_again(tmp_path: Path):
    (tmp_path / "gone.py").write_text("print('once', flush=True)\nimport os; os._exit(0)\n")
    run = eom("validate", "--scene", f"{tmp_path / 'gone.py'}:Trailer")
    assert run.returncode == 1
    died = f"died: import of {tmp_path / 'gone.py'} ended its process with exit code 0"
    assert run.stdout.splitlines() == ["once", died]


def test_an_import_that_exits_is_bad_input(tmp_path: Path):
    path = tmp_path / "silent.py"
    path.write_text("import sys; sys.exit(0)\n")
    run = eom("validate", "--engine", f"{path}:Own")
    assert run.returncode == 2
    assert run.stdout == ""
    assert sentence(run) == f"eomcheck: {str(path)!r} cannot be imported: SystemExit: 0\n"


def test_an_import_that_gives_no_answer_is_a_failure_with_its_line(tmp_path: Path):
    path = tmp_path / "hanging.py"
    path.write_text("import time\ntime.sleep(1000)\n")
    with pytest.raises(CallError) as caught, eomcheck.time_limit(0.02):
        in_file(str(path), "Own")
    limit = "0.1 s, 5 times the limit of 0.02 s for a first call"
    why = f"gave no answer in {limit} (hanging.py, line 2)"
    assert outside_error(caught.value) == f"import of {path} {why}"


@pytest.mark.night
def test_a_command_ends_with_1_at_an_import_that_gives_no_answer(tmp_path: Path):
    for k, body in enumerate(("time.sleep(1000)", "sum(itertools.repeat(0))")):
        path = tmp_path / f"silent{k}.py"
        path.write_text(f"import itertools, time\n{body}\n")
        run = eom("validate", "--engine", f"{path}:Own", "--patience", "0.2")
        assert run.returncode == 1
        limit = "1 s, 5 times the limit of 0.2 s for a first call"
        why = f"import of {path} gave no answer in {limit} (silent{k}.py, line 2)\n"
        assert (run.stdout + sentence(run)).endswith(why)


@pytest.mark.night
def test_functions_of_a_file_that_give_no_answer_fail_with_their_line_and_leave_no_process(
    tmp_path: Path,
):
    """Whether Python can interrupt them or not, and where n is still to be found."""
    hang = "sum(__import__('itertools').repeat(0))"
    for k, (body, when) in enumerate({"while True: pass": "", hang: "", f"{hang} ": " n"}.items()):
        path = tmp_path / f"endless{k}.py"
        n = "" if when else "n = 1\n"
        path.write_text(f"import numpy\n{n}def M(q):\n    {body}\n    return numpy.eye(1)\n")
        run = eom("check", path, "--patience", "0.1", "--examples", "2")
        assert run.returncode == 1
        line = path.read_text().split("\n").index(f"    {body}") + 1
        place = f"gave no answer in 0.5 s (endless{k}.py, line {line})"
        said = run.stderr if when else run.stdout
        assert place in said, said
        assert "Traceback" not in run.stderr
        commands = [x.read_bytes() for x in Path("/proc").glob("[0-9]*/cmdline")]
        assert not any(str(path).encode() in command for command in commands)


def test_a_scene_that_raises_whatever_it_is_asked_is_a_failure(tmp_path: Path):
    kind = in_file(*trailer(tmp_path, "raises", "raise ValueError('no axle')").rsplit(":", 1))
    selection = RunSelection.of(engines=[], claims=["finite-terms"], scenes=[kind])
    for look in (
        lambda run: run.validate_kind(kind, selection, (1, 1), 3, 0),
        lambda run: run.validate_scene(kind.example(), selection, 3, 0),
    ):
        run = ValidationRun()
        look(run)
        (finding,) = run.finish(selection)
        assert finding.verdict == "failed"
        assert "Trailer.drift raised ValueError: no axle (raises.py, line" in finding.detail


def test_a_scene_that_raises_while_states_are_drawn_and_did_not_fail_before_is_an_error():
    class Late(Sleigh):
        def coordinate_ranges(self):
            raise ZeroDivisionError

    run = ValidationRun()
    with pytest.raises(ZeroDivisionError):
        run.validate_scene(Late(), RunSelection.of(engines=[], claims=["finite-terms"]), 3, 0)


def test_an_exception_is_reported_of_the_function_of_the_file_that_raised_it(tmp_path: Path):
    """Whatever called that function, and whatever of Python's own it called."""
    path = tmp_path / "nested.py"
    path.write_text(
        "import json\n\n\n"
        "class Nested:\n"
        "    def asked(self):\n        return helper('no number')\n\n\n"
        "def helper(text):\n    return json.loads(text)\n"
    )
    with pytest.raises(ValueError) as raised:
        in_file(str(path), "Nested")().asked()
    said = outside_error(raised.value)
    assert said.startswith("nested.py: helper raised JSONDecodeError: Expecting value")
    assert said.endswith("(nested.py, line 10)")


def test_a_call_without_an_answer_is_reported_after_its_patience(tmp_path: Path):
    name = trailer(tmp_path, "waits", "import time; time.sleep(1000)")
    run = eom("acceleration", "--scene", name, "--patience", "0.3")
    assert run.returncode == 1
    limit = "1.5 s, 5 times the limit of 0.3 s for a first call"
    drift = f"Trailer.drift gave no answer in {limit} (waits.py, line 24)"
    assert sentence(run) == f"eomcheck: {drift}\n"


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "2e6"])
def test_patience_is_a_positive_number_of_seconds(seconds: str, capsys, monkeypatch):
    from eomcheck.cli import app

    with pytest.raises(InputError, match=r"patience = .*, expected seconds, a positive number"):
        app(["acceleration", "--patience", seconds], standalone_mode=False)


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 130)], ids=["SIGINT", "SIGTERM"]
)
@pytest.mark.night
def test_a_supervised_validation_that_is_interrupted_prints_what_it_has(
    tmp_path: Path, number: int, code: int
):
    note = tmp_path / "note"
    body = f"import time; open({str(note)!r}, 'a').write('.'); time.sleep(0.01)"
    file = engine(tmp_path, "slow", body)
    words = "validate", "--engine", f"{file}:Planar", "--scene", "sleigh", "--examples", "5000"
    with subprocess.Popen(
        [*COMMAND, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as run:
        until = time.monotonic() + 60
        while not (note.exists() and note.stat().st_size > 60) and time.monotonic() < until:
            time.sleep(0.05)
        os.kill(run.pid, number)
        out, _ = run.communicate(timeout=60)
    assert run.returncode == code
    assert b"interrupted: the table holds what was checked until then" in out
    assert b" passed; " in out


@pytest.mark.night
def test_an_engine_that_dies_or_hangs_is_a_failure_of_it_and_the_rest_is_told(tmp_path: Path):
    for k, (body, says) in enumerate(
        {
            "import os; os._exit(0)": "bias ended its process with exit code 0",
            "import os; os.kill(os.getpid(), 11)": "bias ended its process by SIGSEGV",
            "while True: pass": "bias gave no answer in 5 s",
        }.items()
    ):
        file = engine(tmp_path, f"dies{k}", body)
        words = "--scene", "sleigh", "--examples", "2", "--patience", "1"
        run = eom("validate", "--engine", f"{file}:Planar", *words)
        assert run.returncode == 1
        assert says in " ".join(run.stdout.split())
        assert re.search(r"^\d+ of \d+ findings failed\.$", run.stdout, re.M)


DYING = """
from eomcheck.engines.pinocchio import PinocchioEngine

def bias(self, q, v, t=0.0):
    import os
    os.kill(os.getpid(), 11)

PinocchioEngine.bias = bias
"""


@pytest.mark.night
def test_a_library_that_dies_in_validate_is_a_failure_and_the_rest_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    for name in ("sitecustomize", "usercustomize"):  # one of them may be somebody else's
        (tmp_path / f"{name}.py").write_text(DYING)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    run = eom("validate", "--scene", "sleigh", "--examples", "2")
    assert run.returncode == 1
    assert "PinocchioEngine: bias ended its process by SIGSEGV" in run.stdout
    assert re.search(r"^\d+ of \d+ findings failed\.$", run.stdout, re.M)
    assert "kinetic-energy" in run.stdout


@pytest.mark.night
def test_code_that_dies_in_workers_is_a_failure_of_it(tmp_path: Path):
    name = trailer(tmp_path, "in_workers", "import os; os._exit(0)")
    words = "--examples", "100", "--executor", "local:2"
    run = eom("fuzz", "--scene", name, *words)
    assert run.returncode == 1
    assert "Trailer.drift ended its process with exit code 0" in run.stdout + run.stderr
    assert "Traceback" not in run.stderr


def test_commands_that_run_only_our_code_start_no_process(monkeypatch, capsys):
    from eomcheck import cli, supervisor

    monkeypatch.setattr(supervisor, "can_supervise", lambda: True)
    monkeypatch.setattr(supervisor, "run_supervised", lambda words: 77)
    codes = []
    for words in (
        ["list", "claims"],
        ["list", "engines"],
        ["constraints", "--scene", "nowhere.py:A"],
        ["validate", "--examples", "0"],
        ["fuzz", "--examples", "0"],
        ["check", "model.py"],
    ):
        monkeypatch.setattr(sys, "argv", ["eomcheck", *words])
        with pytest.raises(SystemExit) as end:
            cli.main()
        codes.append(end.value.code)
    assert codes == [0, 0, 77, 77, 77, 77]

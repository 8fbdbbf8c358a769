"""Engines in processes of their own: the same answers, and faults that end no command."""

from __future__ import annotations

import gc
import importlib.metadata
import json
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests import robots
from tests.engines import failing_library
from tests.samples import random_state

import eomcheck
from eomcheck import calls
from eomcheck.engines import (
    ENGINES,
    LIBRARIES,
    READERS,
    Answers,
    EngineFault,
    PinocchioFile,
    engine_of,
    engines_among,
    environments,
    is_under_test,
    isolated_names,
    isolation,
    reader_of,
    tree_engine,
    version_of,
)
from eomcheck.engines.isolation import adapter_of
from eomcheck.engines.pipe_protocol import HEAD, MAGIC, ProtocolError, decoded, encoded
from eomcheck.engines.tree_engine import TreeEngine
from eomcheck.errors import CallError, EngineError, InputError, UnknownNameError
from eomcheck.lab.library_comparison import compare_libraries
from eomcheck.mechanics.records import Tree
from eomcheck.scenes import ChainPendulum, Snake, from_urdf

PENDULUM = ChainPendulum.example()
Q, V = random_state(PENDULUM, np.random.default_rng(0))[:2]

Stub = failing_library.Stub

BLOCKED = (
    "scipy",
    "llvmlite",
    "casadi",
    "flint",
    "CyRK",
    "hypothesis",
    "matplotlib",
    "typer",
    "rich",
)
"""Modules of the libraries that eomcheck requires beside NumPy and Pinocchio."""

BLOCKING = f"""
import importlib.abc
import sys
class Blocked(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {BLOCKED}:
            raise ImportError(f"{{name}} is blocked")
sys.meta_path.insert(0, Blocked())
"""


@pytest.fixture(autouse=True)
def processes(monkeypatch: pytest.MonkeyPatch):
    """Run processes in the environment of the tests, without what they may not need."""
    monkeypatch.setattr(isolation, "python_with", lambda requirement: Path(sys.executable))
    monkeypatch.setattr(isolation, "START", BLOCKING + isolation.START)
    isolation._isolated.cache_clear()
    isolation._process.cache_clear()
    yield
    while isolation.PROCESSES:
        isolation.PROCESSES.pop().stop()


def failing(name: str):
    """Return an engine of the pendulum that fails."""
    return isolation.isolated(getattr(failing_library, name))(PENDULUM)


# ---- Answers -------------------------------------------------------------------------------------


def test_every_library_that_eomcheck_requires_is_blocked_but_numpy_and_pinocchio():
    required = importlib.metadata.requires("eomcheck") or []
    names = {re.split(r"[<>=]", x)[0] for x in required if "extra" not in x}
    distributions = importlib.metadata.packages_distributions()
    blocked = {one for module in BLOCKED for one in distributions.get(module, ())}
    assert {x.lower() for x in names} - {x.lower() for x in blocked} == {"numpy", "pin"}


@pytest.mark.parametrize("kind", [PENDULUM, Snake.example()], ids=["pendulum", "snake"])
def test_answers_of_a_process_have_the_bits_of_those_of_the_library_here(kind):
    scene = kind
    q, v, t = random_state(scene, np.random.default_rng(1))
    ours, theirs = ENGINES["pinocchio"](scene), engine_of("pinocchio==*")(scene)
    here, there = Answers(ours), Answers(theirs)
    assert np.array_equal(here.mass_matrix(q, t), there.mass_matrix(q, t))
    assert np.array_equal(here.bias(q, v, t), there.bias(q, v, t))
    third = v[::-1].copy()
    for name in ("inverse_dynamics", "momentum", "regressor", "forward_dynamics_derivatives"):
        x, y = (one.ask(name, q, v, third, "", t) for one in (here, there))
        assert np.array_equal(x, y) and x.any(), name
    assert isinstance(ours, TreeEngine)
    frame = ours.frames[-1].name
    assert np.array_equal(*(x.ask("frame_jacobian", q, v, v, frame, t) for x in (here, there)))
    assert there.has_frame("nowhere") == here.has_frame("nowhere")


def test_a_process_offers_what_its_adapter_offers_and_is_no_engine_under_test():
    kind = engine_of("pinocchio==*")
    adapter = ENGINES["pinocchio"]
    assert adapter_of(kind) is adapter and adapter_of(adapter) is adapter
    for method in eomcheck.engines.OPTIONAL:
        assert kind.offers(method) == adapter.offers(method), method
    assert (kind.key, kind.version()) == ("pinocchio", adapter.version())
    assert not is_under_test(kind)
    assert pickle.loads(pickle.dumps(kind)) is kind
    pair = engines_among(["pinocchio", "pinocchio==4.0"])
    assert [one.key for one in pair] == ["pinocchio", "pinocchio==4.0"]
    with pytest.raises(InputError, match="two have the key 'pinocchio'"):
        engines_among(["pinocchio", "pinocchio==*"])


@pytest.mark.night
def test_a_robot_is_read_from_its_file_by_the_process(tmp_path: Path):
    scene = from_urdf(robots.arm(tmp_path / "arm.urdf"))
    comparison = compare_libraries(scene, ["pinocchio", "pinocchio==4.0"], states=3)
    assert comparison.agree and [*comparison.libraries] == ["pinocchio", "pinocchio==4.0"]
    here, there = (one.engine for one in comparison.answered)
    assert here is not None and there is not None and type(there) is not type(here)
    assert (there.description, there.joints()) == (here.description, here.joints())
    assert isinstance(there, PinocchioFile) and there.base == 0


def test_claims_about_engines_are_checked_in_a_process():
    findings = eomcheck.check_state(PENDULUM, Q, V, engines=["pinocchio==*"])
    passed = {one.claim for one in findings if "pinocchio" in one.subject}
    assert {"mass-matrix", "engine-regressor", "engine-coriolis-matrix"} <= passed
    assert not [one for one in findings if one.verdict == "failed"]


# ---- Names ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "error", "text"),
    [
        ("mujoco==2.3.7", InputError, "version = '2.3.7' of mujoco, expected 3.3.7 or newer"),
        ("mujoco==3.3", InputError, "expected 3.3.7 or newer"),
        ("mujoco==", InputError, "expected as in mujoco==1.2.3"),
        ("mujoco==4.0;x", InputError, "expected as in mujoco==1.2.3"),
        ("casadi==3.7", InputError, "engine casadi cannot be isolated: it reads the equations"),
        ("muojco==4.0", UnknownNameError, "did you mean 'mujoco'"),
    ],
)
def test_a_name_with_a_version_that_stands_for_nothing_is_refused(name, error, text):
    with pytest.raises(error, match=re.escape(text)):
        engine_of(name)


def test_versions_are_compared_by_their_numbers(tmp_path: Path):
    scene = from_urdf(robots.arm(tmp_path / "arm.urdf"))
    for version in ("3.3.7", "3.10.0", "4.0.0rc1", "4"):
        assert engine_of(f"mujoco=={version}").key == f"mujoco=={version}"
        assert reader_of(scene, f"mujoco=={version}").key == f"mujoco_file=={version}"


def test_optional_libraries_are_isolated_by_name_and_no_others():
    names = ["mujoco", "pinocchio", "mjx64", "drake==1.51", "own.py:Drake", "unknown"]
    isolated = isolated_names(names)
    assert isolated == ["mujoco==*", "pinocchio", "mjx64==*", *names[3:]]
    assert [engine_of(name).key for name in isolated[:3]] == names[:3]
    assert [x is ENGINES[y] for x, y in zip(map(engine_of, isolated[:3]), names, strict=False)] == [
        *(False, True, False)
    ]


@pytest.mark.night
def test_an_isolated_comparison_has_the_keys_of_its_libraries(tmp_path: Path, monkeypatch):
    """The stub is Pinocchio with an extra, as optional libraries have one."""
    monkeypatch.setitem(READERS, "stub", Stub)
    monkeypatch.setitem(LIBRARIES, "stub", Stub)
    scene = from_urdf(robots.arm(tmp_path / "arm.urdf"))
    names = ["stub", "pinocchio"]
    comparison = compare_libraries(scene, names, states=2, isolated=True)
    assert comparison.agree and [*comparison.libraries] == names
    stub, pinocchio = (type(one.engine) for one in comparison.answered)
    assert stub is not Stub and adapter_of(stub) is Stub and stub.key == "stub_file"
    assert pinocchio is READERS["pinocchio"]


def test_a_library_that_is_missing_says_how_it_runs_without_being_installed():
    with pytest.raises(EngineError) as missing:
        version_of(failing_library.Missing)
    for hint in ("extra `stub`", "--isolated", "--engine 'missing==*'"):
        assert hint in str(missing.value)
    with pytest.raises(EngineError) as isolated:
        version_of(isolation.isolated(failing_library.Missing))
    assert "--isolated" not in str(isolated.value)


def test_an_environment_has_all_that_an_extra_installs(monkeypatch):
    lines = ["numpy>=1", *(f"{x}; extra == 'stub'" for x in ("torch", "stub-more>=2", "stub>=1.5"))]
    monkeypatch.setattr(tree_engine.metadata, "requires", lambda name: lines)
    assert Stub.requirements() == ["stub>=1.5", "torch", "stub-more>=2"]
    assert Stub.requirements("1.7") == ["stub==1.7", "torch", "stub-more"]
    process: Any = isolation.isolated(Stub)
    assert process.process.requirement == "stub>=1.5 torch stub-more>=2"


# ---- Models --------------------------------------------------------------------------------------


def test_the_models_of_engines_that_are_gone_are_dropped():
    counted = isolation.isolated(failing_library.Counted)
    kept = counted(PENDULUM)
    for _ in range(5):
        counted(PENDULUM).bias(Q, V)
    gc.collect()
    assert kept.bias(Q, V)[0] == 1.0
    both = counted(PENDULUM)
    assert both.bias(Q, V)[0] == 2.0
    del kept
    gc.collect()
    assert both.bias(Q, V)[0] == 1.0


def test_an_engine_that_is_collected_in_the_middle_of_a_request_disturbs_it_not(monkeypatch):
    counted = isolation.isolated(failing_library.Counted)
    kept, gone = counted(PENDULUM), [counted(PENDULUM)]
    write = isolation.write_bytes

    def collected(*arguments):
        write(*arguments)
        gone.clear()  # before the answer is read
        gc.collect()

    monkeypatch.setattr(isolation, "write_bytes", collected)
    assert [kept.bias(Q, V)[0] for _ in range(2)] == [2.0, 1.0]


# ---- Faults --------------------------------------------------------------------------------------


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("name", "text"),
    [
        (
            "Segfaulting",
            r"SIGSEGV \(failing_library.py, line \d+\) after it wrote 'about to read address 0'",
        ),
        ("Exiting", "ended its process with exit code 0"),
        ("Babbling", "answered no message"),
        ("Undefined", "returned nan in entry"),
        ("Raising", r"raised KeyError: 'Coriolis' \(failing_library.py, line \d+\)"),
        ("Overwriting", "changes an array that it is handed"),
        ("Textual", "returned a value of type object"),
    ],
)
def test_a_failure_is_a_fault_of_the_call_and_the_others_answer(name: str, text: str):
    answers, truth = Answers(failing(name)), Answers(ENGINES["pinocchio"](PENDULUM))
    for _ in range(2):
        with pytest.raises(EngineFault, match=text):
            answers.bias(Q, V)
        assert np.array_equal(answers.mass_matrix(Q), truth.mass_matrix(Q))


@pytest.mark.parametrize("name", ["Sleeping", "Waiting"])
def test_a_call_that_never_returns_ends_at_its_time_limit_and_is_not_repeated(name, monkeypatch):
    engine = failing(name)
    monkeypatch.setattr(calls, "_patience", [0.05])
    monkeypatch.setattr(isolation, "FIRST", 2)
    engine.velocity_map(Q, V)
    text = r"0\.1 s, 2 times .* \(failing_library.py, line \d+\)"
    for _ in range(2):
        with pytest.raises(EngineFault, match=text):
            Answers(engine).bias(Q, V)
        monkeypatch.setattr(calls, "_patience", [2.0])
    assert engine.process.counts[f"{name}.bias"] == 1


def test_what_a_library_prints_is_no_answer_and_no_obstacle(capfd):
    bias = Answers(failing("Printing")).bias(Q, V)
    assert np.array_equal(bias, Answers(ENGINES["pinocchio"](PENDULUM)).bias(Q, V))
    assert capfd.readouterr().out == ""


def test_a_comparison_with_a_library_that_dies_is_complete():
    kinds = [isolation.isolated(failing_library.Segfaulting), ENGINES["pinocchio"]]
    findings = eomcheck.check_state(PENDULUM, Q, V, engines=kinds)
    of = {kind: [x for x in findings if x.engine is kind] for kind in kinds}
    failed = {x.claim for x in of[kinds[0]] if x.verdict == "failed"}
    assert "bias" in failed and "mass-matrix" not in failed
    assert not [x for x in of[kinds[1]] if x.verdict == "failed"]
    assert {x.claim for x in of[kinds[0]]} >= {x.claim for x in of[kinds[1]]}


ORPHAN = """
import os, sys
from pathlib import Path
from eomcheck.engines import isolation
from eomcheck.scenes import ChainPendulum
from tests.engines import failing_library
isolation.python_with = lambda requirement: Path(sys.executable)
scene = ChainPendulum.example()
engine = isolation.isolated(failing_library.{name})(scene)
print(engine.process.pid, flush=True)
{then}
"""


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("name", "then"),
    [
        ("Sleeping", "engine.bias(*scene.initial_state())"),
        ("Waiting", "engine.bias(*scene.initial_state())"),
        ("Failing", "os.read(0, 1)"),
    ],
)
def test_no_process_outlives_the_one_that_started_it(name: str, then: str):
    text = ORPHAN.format(name=name, then=then)
    with subprocess.Popen(
        [sys.executable, "-c", text], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        child = int(process.stdout.readline())
        time.sleep(0.3)
        os.kill(child, 0)
        process.kill()
        process.wait()
    until = time.monotonic() + 20
    while time.monotonic() < until and not failing_library.has_ended(child):
        time.sleep(0.02)
    assert failing_library.has_ended(child)


def test_an_interrupt_stops_the_process_and_the_next_call_starts_another(monkeypatch):
    engine = failing("Waiting")
    monkeypatch.setattr(calls, "_patience", [2.0])
    old = signal.signal(signal.SIGALRM, _interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    try:
        with pytest.raises(KeyboardInterrupt):
            engine.bias(Q, V)
    finally:
        signal.signal(signal.SIGALRM, old)
    assert engine.mass_matrix(Q).shape == (len(Q), len(Q))
    assert engine.process.generation == 2


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


# ---- Messages ------------------------------------------------------------------------------------


def reader(message: bytes):
    """Return a function that reads a message piece by piece."""
    position = [0]

    def read(size: int) -> bytes:
        part = message[position[0] : position[0] + size]
        if len(part) < size:
            raise EOFError
        position[0] += size
        return part

    return read


def test_a_message_holds_what_engines_are_given_and_answer():
    tree = PENDULUM.tree()
    assert tree is not None
    value = [
        None,
        True,
        3,
        0.1,
        "x",
        (1, [2]),
        {"a": {1.5}},
        frozenset({"b"}),
        np.arange(6.0),
        tree,
    ]
    result = decoded(reader(encoded(value)))
    assert result[:8] == value[:8] and [type(x) for x in result] == [type(x) for x in value]
    assert np.array_equal(result[8], value[8])
    assert isinstance(result[9], Tree) and result[9].joint == tree.joint
    assert np.array_equal(result[9].inertia, tree.inertia)
    for array in (
        np.zeros((0, 3)),
        np.array(2.5),
        np.ones(2, np.float32),
        np.array([[1, 2]]).T[:, ::-1],
    ):
        again = decoded(reader(encoded(array)))
        assert (again.shape, again.dtype) == (array.shape, array.dtype)
        assert np.array_equal(again, array) and again.flags.writeable
    assert np.isnan(decoded(reader(encoded(float("nan")))))


@pytest.mark.parametrize("value", [object(), np.array(["x"]), np.array([object()]), importlib, 1j])
def test_a_message_holds_nothing_else(value):
    with pytest.raises(ProtocolError):
        encoded(value)


def raw(plain: object, *kinds: object, block: bytes = b"", magic: bytes = MAGIC) -> bytes:
    """Return a message with any JSON."""
    content = json.dumps([plain, kinds]).encode()
    return HEAD.pack(magic, len(content), len(block)) + content + block


@pytest.mark.parametrize(
    "message",
    [
        b"x" * 24,
        raw(1.0, magic=b"language"),
        HEAD.pack(MAGIC, 2**40, 0),
        raw(1.0).replace(b"1.0", b"1,0"),
        raw({"tree": []}),
        raw({"list": [], "tuple": []}),
        raw({"array": 0}),
        raw({"array": 0}, ["<f8", [9]], block=bytes(8)),
        raw({"record": ["urllib.parse", "DefragResult"], "parts": ["a", "b"]}),
        raw({"record": ["eomcheck.mechanics.records", "State"], "parts": []}),
    ],
)
def test_what_is_no_message_is_refused(message: bytes):
    with pytest.raises(ProtocolError, match=r"message|record"):
        decoded(reader(message))


# ---- Environments --------------------------------------------------------------------------------


def test_an_environment_is_made_once_and_again_if_it_was_not_finished(tmp_path, monkeypatch):
    monkeypatch.setenv(environments.CACHE, str(tmp_path))
    made = []

    def install(requirement: str, folder: Path, executable: Path) -> None:
        assert not folder.exists()
        made.append(requirement)
        folder.mkdir()
        if len(made) == 1:
            raise EngineError("no network")

    monkeypatch.setattr(environments, "_install", install)
    with pytest.raises(EngineError, match="no network"):
        environments.python_with("library==1.0")
    python = [environments.python_with("library==1.0") for _ in range(2)]
    assert made == ["library==1.0"] * 2 and python[0] == python[1]
    assert environments.python_with("library==1.1") != python[0]
    assert python[0].is_relative_to(tmp_path)


def test_another_library_is_installed_meanwhile_and_the_same_one_waits(tmp_path, monkeypatch):
    monkeypatch.setenv(environments.CACHE, str(tmp_path))
    made, second = [], threading.Event()

    def install(requirement: str, folder: Path, executable: Path) -> None:
        made.append(requirement)
        folder.mkdir()
        if requirement == "first==1.0":
            assert second.wait(20.0)

    monkeypatch.setattr(environments, "_install", install)
    with ThreadPoolExecutor(2) as pool:
        waiting = [pool.submit(environments.python_with, "first==1.0") for _ in range(2)]
        environments.python_with("second==1.0")
        second.set()
        python = {one.result() for one in waiting}
    assert sorted(made) == ["first==1.0", "second==1.0"] and len(python) == 1


@pytest.mark.parametrize("uv", [None, "uv"])
def test_a_library_is_installed_of_wheels_and_with_numpy_alone(uv, tmp_path, monkeypatch):
    commands = []

    def run(command, **options):
        commands.append(command)
        failed = "install" in command
        return subprocess.CompletedProcess(command, int(failed), "", "ERROR: one\nERROR: No such\n")

    monkeypatch.setattr(environments.shutil, "which", lambda name: uv)
    monkeypatch.setattr(environments.subprocess, "run", run)
    monkeypatch.setenv(environments.CACHE, str(tmp_path))
    with pytest.raises(EngineError, match=r"^library==1\.0 cannot be installed: No such$"):
        environments.python_with("library==1.0")
    make, install = commands
    assert "venv" in make and (make[0] == "uv") == bool(uv)
    assert install[-4:] == ["--only-binary", ":all:", "numpy", "library==1.0"]


def test_a_cache_folder_that_cannot_be_written_is_named(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(environments.CACHE, str(tmp_path / "file"))
    with pytest.raises(EngineError, match=r"library==1\.0 cannot be installed in .*file"):
        environments.python_with("library==1.0")


def test_a_process_that_cannot_start_is_one_sentence(monkeypatch):
    monkeypatch.setattr(isolation, "START", "raise SystemExit('no such library')")
    with pytest.raises(CallError, match="exit code 1 after it wrote 'no such library'"):
        isolation.EngineProcess("library").ask("name", "version", "x", "y")

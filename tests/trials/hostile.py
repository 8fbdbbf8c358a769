"""Hand hostile inputs to commands and functions, and count those that end as none may.

    python -m tests.trials.hostile [--every N] [--kind KIND] [--seed 0] [--patience 60]

Inputs are kinds times variants: arguments of commands, robots' files, functions, engines, scenes,
databases of Records, corpora of failures. Each runs in a forked process of its own, some commands
in a new interpreter. A breach is a traceback, exit code 0 without a printed word, another exit code
than those documented, a failure without a word, or no answer within the patience. The exit code is
1 if there is a breach.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import eomcheck
from eomcheck import cli
from eomcheck.console import progress
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.errors import EomcheckError, message_of
from eomcheck.lab.report.overview import Overview, read_records
from eomcheck.lab.show.table import ResultTable, print_tables
from eomcheck.lab.store.record_file import Record, Records
from eomcheck.scenes import Sleigh, from_mjcf, from_urdf
from eomcheck.testing import check_functions

LEAST = 2000
"""So many inputs there are at least."""
MEMORY = 8 * 2**30
"""Bytes of address space that an input may take."""
SAMPLE = 100
"""One command in so many runs in an interpreter of its own."""
CODES = frozenset({0, 1, 2, 130})


class Input(NamedTuple):
    """A hostile input: its kind, a name, and what runs it: words of a command, or a function."""

    kind: str
    name: str
    run: list[str] | Callable[[], object]


class Ended(NamedTuple):
    """How a process ended: its exit code, None after a kill, and all that it printed."""

    code: int | None
    output: str


# ---- Inputs --------------------------------------------------------------------------------------

TEXTS = (
    "", " ", ",", "-1", "0", "nan", "inf", "1e400", "9" * 60, "0x10", "1_0", "..", "1..", "5..1",
    "1..9..2", "x" * 5000, "\x1b[31mred", "a\nb", "\u202e", "%s%n", "a:b", "no.py:Class",
    "mass=nan", "mass=1e999", "=", "mass=", "/", "/dev/null/x", "~", "{}", "ö", "--", "-",
)  # fmt: skip
OPTIONS = {
    ("validate", "--scene", "sleigh", "--examples", "1"): (
        "--scene", "--links", "--set", "--examples", "--seed", "--engine", "--formulation",
        "--executor", "--json", "--records",
    ),
    ("prove", "--scene", "sleigh", "--examples", "1"): (
        "--scene", "--links", "--examples", "--seed", "--formulation", "--executor",
    ),
    ("fuzz", "--scene", "sleigh", "--examples", "1", "--engine", "none", "--no-climb"): (
        "--scene", "--links", "--engine", "--formulation", "--claim", "--examples", "--seed",
        "--family", "--check-frequency", "--executor", "--keep",
    ),
    ("fuzz",): ("--time", "--replay"),
    ("simulate", "0.01", "--scene", "sleigh"): (
        "--scene", "--links", "--set", "--formulation", "--integrator", "--tolerance", "--speeds",
    ),
    ("list",): ("",),
    ("report",): ("",),
    ("export",): ("",),
}  # fmt: skip


def arguments(folder: Path, rng: random.Random) -> Iterator[Input]:
    """Words of commands that nobody means."""
    for words, options in OPTIONS.items():
        for option in options:
            for i, text in enumerate(TEXTS):
                word = [f"{option}={text}"] if option.startswith("--") else [text]
                yield Input("arguments", f"{words[0]} {option} {i}", [*words, *word])


URDF = """<robot name="r"><link name="base"/>
<link name="arm"><inertial><origin xyz="0.1 0 0.2" rpy="0.1 0 0"/><mass value="1.5"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<origin xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
<dynamics damping="0.1"/></joint></robot>"""
MJCF = """<mujoco model="m"><option gravity="0 0 -9.81"/><worldbody>
<body name="a" pos="0 0 1"><joint name="j" type="hinge" axis="0 1 0" damping="0.1"
stiffness="2"/><inertial pos="0 0 .1" mass="1" diaginertia=".1 .1 .1"/><body name="b" pos="0 0 1">
<joint name="k" type="slide"/><geom type="sphere" size=".1" mass="1"/></body></body></worldbody>
<equality><joint joint1="j" joint2="k" polycoef="0 1 0 0 0"/></equality></mujoco>"""
NUMBERS = ("nan", "inf", "-1", "1e308", "1e-320", "", "x", "1 2", "\u0663", "9" * 400, "0", "1e400")


def _damaged(data: bytes, rng: random.Random, number: int) -> bytes:
    """Data with a bit flipped, cut off, doubled or overwritten."""
    place, made = rng.randrange(len(data)), bytearray(data)
    if number % 4 == 0:
        return data[:place]
    if number % 4 == 1:
        return data[:place] + data[place // 2 :]
    if number % 4 == 2:
        made[place : place + 8] = rng.randbytes(8)
    else:
        made[place] ^= 1 << rng.randrange(8)
    return bytes(made)


def robots(folder: Path, rng: random.Random) -> Iterator[Input]:
    """Files of robots: each value replaced, and damaged."""
    for suffix, text, reader in ((".urdf", URDF, from_urdf), (".xml", MJCF, from_mjcf)):
        made: list[bytes] = []
        parts = text.split('"')
        for i in range(1, len(parts), 2):
            values = NUMBERS[:: 1 if suffix == ".urdf" else 2]
            made += ['"'.join([*parts[:i], x, *parts[i + 1 :]]).encode() for x in values]
        made += [_damaged(text.encode(), rng, i) for i in range(150)]
        for i, data in enumerate(made):
            path = folder / f"r{i}{suffix}"
            path.write_bytes(data)
            yield Input("robots", f"{i}{suffix}", partial(reader, path))


class Mute(Exception):
    """An exception whose text raises."""

    def __str__(self) -> str:
        raise RuntimeError("mute")


class Odd:
    """An object of which everything raises."""

    def __getattr__(self, name: str) -> Any:
        raise ValueError(name)

    def __repr__(self) -> str:
        raise ValueError("repr")


def _raise(error: BaseException) -> Any:
    raise error


def _recurse() -> Any:
    return _recurse()


ANSWERS: dict[str, Callable[[], Any]] = {
    "None": lambda: None,
    "text": lambda: "x" * 5000,
    "nan": lambda: np.nan,
    "inf": lambda: np.full((3, 3), np.inf),
    "empty": lambda: [],
    "ragged": lambda: [[1.0], [1.0, 2.0]],
    "wide": lambda: np.ones((2, 3, 4, 5)),
    "complex": lambda: 1j * np.eye(3),
    "whole": lambda: 10**400,
    "masked": lambda: np.ma.array(np.eye(3), mask=np.eye(3) > 0),
    "objects": lambda: np.array([Odd()] * 3),
    "dates": lambda: np.array(["2000-01-01"], dtype="datetime64[D]"),
    "dict": lambda: {"a": 1},
    "class": lambda: Odd,
    "odd": Odd,
    "bytes": lambda: b"\xff",
    "huge": lambda: 1e308 * np.ones((3, 3)),
    "small": lambda: 5e-324 * np.ones((3, 3)),
    "mute": lambda: _raise(Mute()),
    "long": lambda: _raise(ValueError("x" * 5000)),
    "control": lambda: _raise(ValueError("\x1b[31m\x00\u202e")),
    "recursion": lambda: _recurse(),
    "memory": lambda: _raise(MemoryError()),
    "stop": lambda: _raise(StopIteration()),
    "assertion": lambda: _raise(AssertionError()),
    "arithmetic": lambda: 1 / 0,
}


def functions(folder: Path, rng: random.Random) -> Iterator[Input]:
    """Functions of which one answers what is none."""
    good = {"M": lambda q: np.eye(3), "bias": lambda q, v: np.zeros(3)}
    names = ("M", "bias", "gravity", "T", "U", "R", "qdd", "a", "Q", "C")
    for name in names:
        for answer, of in ANSWERS.items():
            given = good | {name: lambda *_, of=of: of()}
            run = partial(check_functions, 3, states=2, **given)
            yield Input("functions", f"{name} {answer}", run)


METHODS = "mass_matrix", "bias", "forces", "constraint_jacobian", "constraint_drift", "acceleration"


def replaced(owner: type, names: tuple[str, ...]) -> Iterator[str]:
    """Yield names, each of a function that a class has: another one would replace nothing."""
    for name in names:
        if not callable(getattr(owner, name, None)):
            raise LookupError(f"{owner.__name__} has no function {name!r} to replace")
        yield name


def engines(folder: Path, rng: random.Random) -> Iterator[Input]:
    """Engines of which one method answers what is none."""
    for name in replaced(CasadiEngine, METHODS):
        for answer, of in ANSWERS.items():
            engine = type("Wrong", (CasadiEngine,), {name: lambda self, *_, of=of, **__: of()})
            yield Input("engines", f"{name} {answer}", partial(_checked, Sleigh, engine))


def _checked(kind: type[Sleigh], engine: Any) -> object:
    scene = kind()
    return eomcheck.check_state(scene, *scene.initial_state(), engines=[engine] if engine else [])


FUNCTIONS = "terms", "energies", "velocities", "constraint", "prepare", "speeds"


def scenes(folder: Path, rng: random.Random) -> Iterator[Input]:
    """Scenes of which one function answers what is none."""
    for name in replaced(Sleigh, FUNCTIONS):
        for answer, of in ANSWERS.items():
            wrong = staticmethod(lambda *_, of=of: of())
            kind = partial(type, "Wrong", (Sleigh,), {name: wrong})
            yield Input("scenes", f"{name} {answer}", partial(_of_kind, kind))


def _of_kind(kind: Callable[[], Any]) -> object:
    return _checked(kind(), None)


def databases(folder: Path, rng: random.Random) -> Iterator[Input]:
    """Files of Records, damaged."""
    path = folder / "sound.db"
    with Records(path) as records:
        for i in range(20):
            records.add(Record("fuzz", {"scene": "sleigh", "round": i}, counts={"states": i}))
    sound = path.read_bytes()
    for i in range(260):
        path = folder / f"d{i}.db"
        path.write_bytes(_damaged(sound, rng, i))
        yield Input("databases", str(i), partial(_read, path))


def _read(path: Path) -> object:
    unread: list[str] = []
    overview = Overview(read_records([path], unread), unread)
    return f"{overview.headline} {len(unread)} unread"


ROW = {
    "scene": "sleigh", "parameters": {}, "q": [0.0, 0.0, 0.0], "v": [0.0, 0.0, 0.0], "t": 0.0,
    "claim": "bias", "subject": "au", "observed": 1.0, "allowed": 0.5, "whose": "au",
}  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, [], {}, "", "x" * 5000, -1, 10**400, [None], [1e400], [[0.0]], {"mass": None},
    "no.py:Class", "\x1b[31m", "snake", [0.0] * 1000,
)  # fmt: skip


def corpora(folder: Path, rng: random.Random) -> Iterator[Input]:
    """Corpora whose rows have other values, and damaged ones."""
    made = [json.dumps([ROW | {name: x}]).encode() for name in ROW for x in VALUES]
    sound = json.dumps([ROW]).encode()
    made += [_damaged(sound, rng, i) for i in range(60)]
    for i, data in enumerate(made):
        path = folder / f"c{i}.json"
        path.write_bytes(data)
        yield Input("corpora", str(i), ["fuzz", "--replay", str(path)])


KINDS = (arguments, robots, functions, engines, scenes, databases, corpora)


# ---- Running -------------------------------------------------------------------------------------


def _work(run: list[str] | Callable[[], object]) -> int:
    """Run an input in this process and return its exit code."""
    if isinstance(run, list):
        sys.argv = ["eomcheck", *run]
        try:
            cli.main()
        except SystemExit as end:
            return end.code if isinstance(end.code, int) else 0 if end.code is None else 1
        return 0
    try:
        answer = run()
    except EomcheckError as error:
        print(f"refused: {message_of(error)}")
        return 2
    print(f"answered: {type(answer).__name__} {str(answer)[:200]}")
    return 0


def _in_child(one: Input, output: Path) -> None:
    """Run an input and end this process, a forked one."""
    code = 70
    try:
        file = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for number in (1, 2):
            os.dup2(file, number)
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
        sys.stderr = open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
        os.chdir(output.parent)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        code = _work(one.run)
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(code)


def ended(one: Input, folder: Path, patience: float, afresh: bool) -> Ended:
    """How an input ends in a process of its own, a new interpreter or a forked one."""
    if afresh and isinstance(one.run, list):
        words = [sys.executable, "-c", "from eomcheck.cli import main; main()", *one.run]
        try:
            done = subprocess.run(
                words, capture_output=True, timeout=patience, cwd=folder, check=False
            )
        except subprocess.TimeoutExpired:
            return Ended(None, "")
        return Ended(done.returncode, (done.stdout + done.stderr).decode(errors="replace"))
    output = folder / "output"
    child = os.fork()
    if child == 0:
        _in_child(one, output)
    deadline = time.monotonic() + patience
    while (done := os.waitpid(child, os.WNOHANG))[0] == 0:
        if time.monotonic() > deadline:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return Ended(None, output.read_text(errors="replace"))
        time.sleep(0.005)
    return Ended(os.waitstatus_to_exitcode(done[1]), output.read_text(errors="replace"))


def breach(how: Ended) -> str:
    """Why an input must not end so, "" where it may."""
    if how.code is None:
        return "no answer"
    if "Traceback (most recent call last)" in how.output:
        return "traceback"
    if how.code not in CODES:
        return f"exit code {how.code}"
    said = [line for line in how.output.splitlines() if not line.endswith(" ...")]
    return "" if any(line.strip() for line in said) else f"exit code {how.code} without a word"


def inputs(folder: Path, seed: int) -> list[Input]:
    """All inputs; files of theirs are written into a folder."""
    return [one for kind in KINDS for one in kind(folder, random.Random(seed))]


def main() -> int:
    """Run all, print a table, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--every", type=int, default=1, help="only every N-th input")
    parser.add_argument("--kind", default="", help="only kinds that begin so")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--patience", type=float, default=60.0, help="seconds an input")
    parser.add_argument("--markdown", type=Path, help="write the table to this file too")
    options = parser.parse_args()
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    done = 0
    with tempfile.TemporaryDirectory() as name, suppress(KeyboardInterrupt):
        folder = Path(name)
        every = inputs(folder, options.seed)
        chosen = [x for x in every[:: options.every] if x.kind.startswith(options.kind)]
        with progress("hostile inputs", len(chosen)) as advance:
            for done, one in enumerate(chosen, 1):
                how = ended(one, folder, options.patience, done % SAMPLE == 1)
                why = breach(how)
                counts[one.kind].update(["inputs", f"code {how.code}", *["breaches"] * bool(why)])
                if why:
                    print(f"{why}: {one.kind}, {one.name}", flush=True)
                    print("\n".join(how.output.splitlines()[-4:])[-1500:], flush=True)
                advance()
    columns = ["kind", "inputs", "code 0", "code 1", "code 2", "breaches"]
    rows = [[kind, *(str(of[x]) for x in columns[1:])] for kind, of in counts.items()]
    sheet = ResultTable("hostile", "Hostile inputs", columns, rows)
    print_tables([sheet])
    if options.markdown is not None:
        options.markdown.write_text(sheet.markdown(), encoding="utf-8")
    breaches = sum(of["breaches"] for of in counts.values())
    print(f"{done} of {len(every)} inputs, {breaches} breaches")
    return int(breaches > 0 or len(every) < LEAST or done < len(chosen))


if __name__ == "__main__":
    raise SystemExit(main())

"""Plant faults in engines, and count what `eomcheck validate --engine FILE` finds in its default.

    python -m tests.trials.wrong_engines [--jobs 2] [--seed 0] [--only ID] [--markdown FILE]

Each engine is a file of its own: a right one of which some methods are wrong, always or in some
calls. The command runs as a process. Found is a fault for which it exits with 1 and prints the term
that is wrong. The exit code is 1 if fewer than `LEAST` are found or named, or a right engine fails.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import NamedTuple

from eomcheck.lab.show.table import ResultTable, print_tables

LEAST = 38
"""So many of the faults must be found, each by the name of its term."""
SECONDS = 1200.0
"""No command takes so long."""

TREE = "eomcheck.engines.pinocchio:PinocchioEngine"
ALL = "eomcheck.engines.casadi:CasadiEngine"

SOURCE = '''"""An engine with a fault."""

import os
import sys

import numpy as np

from {module} import {base}


class Wrong({base}):
    {attributes}

    def __init__(self, scene):
        super().__init__(scene)
        self.calls, self.kept, self.last = 0, {{}}, None

    @classmethod
    def version(cls):
        return "wrong 1.0"

{methods}
'''

METHOD = """    def {signature}:
        right = super().{call}
        {body}
"""

Signatures = dict[str, tuple[str, str]]

SIGNATURES: Signatures = {
    "mass_matrix": ("mass_matrix(self, q, t=0.0)", "mass_matrix(q, t)"),
    "bias": ("bias(self, q, v, t=0.0)", "bias(q, v, t)"),
    "forces": ("forces(self, q, v, t=0.0)", "forces(q, v, t)"),
    "constraint_jacobian": (
        "constraint_jacobian(self, q, v, t=0.0)",
        "constraint_jacobian(q, v, t)",
    ),
    "constraint_drift": ("constraint_drift(self, q, v, t=0.0)", "constraint_drift(q, v, t)"),
    "acceleration": (
        "acceleration(self, q, v, Q, a, gamma, t=0.0)",
        "acceleration(q, v, Q, a, gamma, t)",
    ),
}


class Fault(NamedTuple):
    """A fault in an engine.

    Attributes:
        id: its name.
        method: the method that is wrong.
        body: lines that end with a `return`; `right` is the right answer.
        base: the engine that is right otherwise.
        says: words with | between them that the text on a failure must contain; "" for the usual
            name of the term.
    """

    id: str
    method: str
    body: str
    base: str = TREE
    says: str = ""


def _every(n: int, wrong: str, right: str = "right") -> str:
    return f"self.calls += 1\nreturn {wrong} if self.calls % {n} == 0 else {right}"


FAULTS: tuple[Fault, ...] = (
    # Mass matrix
    Fault("armature", "mass_matrix", "return right + 0.01 * np.eye(len(right))"),
    Fault("sign beside the diagonal", "mass_matrix", "return 2 * np.diag(np.diag(right)) - right"),
    Fault("upper half", "mass_matrix", "return np.triu(right)"),
    Fault("diagonal only", "mass_matrix", "return np.diag(np.diag(right))"),
    Fault("float32 matrix", "mass_matrix", "return np.float32(right).astype(float)"),
    Fault("matrix 1e-6 too large", "mass_matrix", "return right * (1 + 1e-6)"),
    Fault("order reversed", "mass_matrix", "return right[::-1, ::-1]"),
    Fault(
        "matrix of the first call",
        "mass_matrix",
        "if self.last is None: self.last = right\nreturn self.last",
    ),
    Fault(
        "matrix of the call before",
        "mass_matrix",
        "old, self.last = self.last, right\nreturn right if old is None else old",
    ),
    Fault(
        "matrix where |q| > pi",
        "mass_matrix",
        "return right * (1.001 if np.abs(q).max() > np.pi else 1.0)",
    ),
    Fault(
        "matrix where |q| > 6",
        "mass_matrix",
        "return right * (1.001 if np.abs(q).max() > 6.0 else 1.0)",
    ),
    Fault(
        "matrix kept by rounded q",
        "mass_matrix",
        "return self.kept.setdefault(tuple(np.round(q, 2)), right)",
    ),
    Fault("matrix in every 37th call", "mass_matrix", _every(37, "1.001 * right")),
    Fault(
        "matrix after 100 calls",
        "mass_matrix",
        "self.calls += 1\nreturn right * (1.001 if self.calls > 100 else 1.0)",
    ),
    Fault(
        "no number where q[0] > 0.5",
        "mass_matrix",
        "return right * (np.nan if q[-1] > 0.5 else 1.0)",
    ),
    # Bias
    Fault("no bias", "bias", "return 0.0 * right"),
    Fault("bias with the other sign", "bias", "return -right"),
    Fault("half the bias", "bias", "return right / 2"),
    Fault("gravity in the bias", "bias", "return right - super().forces(q, v, t)", ALL),
    Fault("first row of the bias", "bias", "right[0] = 0.0\nreturn right", ALL),
    Fault("last row of the bias", "bias", "right[-1] *= 1.01\nreturn right"),
    Fault("bias linear in v", "bias", "return right + 1e-3 * v"),
    Fault(
        "bias where |v| > 20", "bias", "return right * (1.001 if np.abs(v).max() > 20.0 else 1.0)"
    ),
    Fault("speeds are clipped", "bias", "return super().bias(q, np.clip(v, -5.0, 5.0), t)"),
    Fault("float32 bias", "bias", "return np.float32(right).astype(float)"),
    Fault(
        "bias stale every 7th call",
        "bias",
        "self.calls += 1\nif self.calls % 7: self.last = right\nreturn self.last",
    ),
    Fault("bias of wrong shape", "bias", "return right[:-1]"),
    Fault("bias raises now and then", "bias", _every(50, "1 / 0")),
    Fault("bias writes into v", "bias", "v *= 1.0 + 1e-9\nreturn right"),
    Fault("bias answers None", "bias", "return None"),
    # Forces and constraints
    Fault("sign of forces", "forces", "return -right", ALL),
    Fault("half the forces", "forces", "return right / 2", ALL),
    Fault("sign of a row of a", "constraint_jacobian", "right[0] = -right[0]\nreturn right", ALL),
    Fault("column of a is missing", "constraint_jacobian", "right[:, -1] = 0.0\nreturn right", ALL),
    Fault("sign of gamma", "constraint_drift", "return -right", ALL),
    Fault("gamma is missing", "constraint_drift", "return 0.0 * right", ALL),
    # Acceleration
    Fault(
        "accelerations without gamma",
        "acceleration",
        "if gamma is None: return right\nreturn super().acceleration(q, v, Q, a, 0.0 * gamma, t)",
    ),
    Fault(
        "accelerations without forces",
        "acceleration",
        "return super().acceleration(q, v, 0.0 * Q, a, gamma, t)",
    ),
    Fault(
        "sign of multipliers",
        "acceleration",
        "x, y = right\nreturn x, None if y is None else -y",
        says="multipliers",
    ),
    Fault("acceleration 1 % off", "acceleration", "x, y = right\nreturn 1.01 * x, y"),
    # Ends of the process
    Fault("exits", "bias", _every(20, "sys.exit(0)")),
    Fault("ends the process", "bias", _every(20, "os._exit(0)"), says="bias ended its process"),
)
"""Faults, about half of them in some calls or states only."""


def source_of(fault: Fault | None, base: str = TREE, signatures: Signatures = SIGNATURES) -> str:
    """Return the file of an engine with a fault, or of a right one."""
    module, name = (base if fault is None else fault.base).split(":")
    method = ""
    if fault is not None:
        signature, call = signatures[fault.method]
        body = fault.body.replace("\n", "\n        ")
        method = METHOD.format(signature=signature, call=call, body=body)
    # An engine of one's own reads the parameters in every call, and says so.
    return SOURCE.format(module=module, base=name, methods=method, attributes="name = 'wrong'")


class Outcome(NamedTuple):
    """The end of a command."""

    fault: Fault | None
    code: int
    output: str

    @property
    def found(self) -> bool:
        """Whether the command failed with a verdict, and not with a traceback."""
        return self.code == 1 and "Traceback" not in self.output

    @property
    def named(self) -> bool:
        """Whether the text on a failure names the term."""
        assert self.fault is not None
        words = (self.fault.says or self.fault.method.replace("_", " ").split()[-1]).split("|")
        parts = self.output.split("\n\n")
        failures = (part for part in parts if part.startswith("FAIL") or " died" in part)
        return any(all(word in part for word in words) for part in failures)


def run(
    fault: Fault | None,
    folder: Path,
    seed: int,
    base: str = TREE,
    trial: Trial | None = None,
) -> Outcome:
    """Return how `validate --engine` ends for an engine with a fault."""
    trial = TRIAL if trial is None else trial
    name = "right" if fault is None else "".join(c if c.isalnum() else "_" for c in fault.id)
    path = folder / f"engine_{name}_{base.rpartition(':')[2]}.py"
    path.write_text(source_of(fault, base, trial.signatures), encoding="utf-8")
    command = [sys.executable, "-c", "from eomcheck.cli import main; main()", "validate"]
    base = base if fault is None else fault.base
    options = trial.options.get(base, trial.options.get("", ()))
    command += ["--engine", f"{path}:Wrong", "--seed", str(seed), *options]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS)
    except subprocess.TimeoutExpired:
        return Outcome(fault, -1, f"no answer in {SECONDS:g} s")
    return Outcome(fault, done.returncode, done.stdout + done.stderr)


def outcomes(
    chosen: list[Fault], seed: int, jobs: int, trial: Trial | None = None
) -> Iterator[Outcome]:
    """Yield the end of each command, in order."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(jobs) as pool:
        yield from pool.map(partial(run, folder=Path(folder), seed=seed, trial=trial), chosen)


class Trial(NamedTuple):
    """A trial of faults in engines.

    Attributes:
        faults: the faults.
        least: so many must be found and named.
        bases: engines that are right, which must pass.
        signatures: method -> its signature, and the call of the right one.
        options: base, or "" for any other -> further options of the command.
    """

    faults: tuple[Fault, ...]
    least: int
    bases: tuple[str, ...]
    signatures: Signatures
    options: Mapping[str, tuple[str, ...]] = {}


TRIAL = Trial(FAULTS, LEAST, (TREE, ALL), SIGNATURES)


def main(trial: Trial = TRIAL) -> int:
    """Run all, print a table, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="only faults that begin so")
    parser.add_argument("--markdown", type=Path, help="write the table to this file too")
    options = parser.parse_args()
    chosen = [one for one in trial.faults if one.id.startswith(options.only)]
    rows, good = [], 0
    for one in outcomes(chosen, options.seed, options.jobs, trial):
        assert one.fault is not None
        good += one.found and one.named
        result = "named" if one.found and one.named else "found" if one.found else "MISSED"
        rows.append([one.fault.id, one.fault.method, result, str(one.code)])
        if result != "named":
            print(f"{result}: {one.fault.id}, exit code {one.code}", flush=True)
            print("\n".join(one.output.splitlines()[-6:]), flush=True)
    failed = 0
    if not options.only:
        with tempfile.TemporaryDirectory() as folder:
            for base in trial.bases:
                right = run(None, Path(folder), options.seed, base, trial)
                if right.code != 0:
                    failed += 1
                    print(
                        f"the right engine {base} ends with {right.code}:\n{right.output[-2000:]}"
                    )
    columns = ["fault", "method", "result", "exit code"]
    sheet = ResultTable("wrong-engines", "Faults in engines", columns, rows)
    print_tables([sheet])
    if options.markdown is not None:
        options.markdown.write_text(sheet.markdown(), encoding="utf-8")
    print(f"{good} of {len(chosen)} found and named; right engines that fail: {failed}")
    return int(failed > 0 or (not options.only and good < trial.least))


if __name__ == "__main__":
    raise SystemExit(main())

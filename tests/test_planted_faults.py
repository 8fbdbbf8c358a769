"""Plant one fault at a time into a copy of the source, and see the checks catch and name it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.linalg import null_space

import eomcheck
from eomcheck.arithmetic.generic import GENERIC
from eomcheck.checks import Finding, State, identities
from eomcheck.checks.validate import Run, Selection
from eomcheck.evaluate import Evaluation, consistent_velocity
from eomcheck.formulations import FORMULATIONS
from eomcheck.scenes import Snake

PACKAGE = Path(eomcheck.__file__).parent
_numbers = count()


@dataclass(frozen=True)
class Fault:
    """A change of the source, the claim that must fail first, and what its Finding must say."""

    file: str
    old: str
    new: str
    claim: str
    says: str

    @property
    def id(self) -> str:
        return f"{Path(self.file).stem}: {self.old} => {self.new}"


SNAKE, CHAIN, BANDED = "scenes/snake.py", "scenes/snake_chain.py", "formulations/banded.py"
COUPLING = "chain-coupling", "coupling of a chain, entry (joint "
REMAINDER = "chain-remainder", "remainder of a chain, entry (joint "
RESULT = "equations-residual", "[banded]"
FAULTS = [
    # M
    Fault(SNAKE, "-mu[i] * sin[i]", "mu[i] * sin[i]", "mass-matrix", "sign"),
    Fault(SNAKE, "mass[i] / 4 + tail", "mass[i] / 2 + tail", "mass-matrix", "(θ_"),
    Fault(SNAKE, " + inertia[i]\n", "\n", "mass-matrix", "(θ_"),
    Fault(SNAKE, "length[j] * mu[i] *", "length[i] * mu[j] *", "mass-matrix", "(θ_"),
    Fault(SNAKE, "cos[j] + sin[i] * sin[j]", "cos[j] - sin[i] * sin[j]", "mass-matrix", "(θ_"),
    Fault(SNAKE, "tail[i] + mass[i]\n", "tail[i] + mass[i - 1]\n", "mass-matrix", "entry"),
    Fault(SNAKE, "length * (mass / 2 + tail)", "length * (mass + tail)", "mass-matrix", "entry"),
    Fault(
        SNAKE,
        "M[i + 2, j + 2] = M[j + 2, i + 2] = c",
        "M[i + 2, j + 2] = c",
        "mass-matrix",
        "missing",
    ),
    # B
    Fault(SNAKE, "B[0] -= mu", "B[0] += mu", "bias", "row x: sign"),
    Fault(SNAKE, "    return B\n", "    return 0 * B\n", "bias", "missing"),
    Fault(SNAKE, "mu[i] * (sin[i] * along -", "mu[i] * (sin[i] * along +", "bias", "row θ_"),
    Fault(SNAKE, "B[i + 2] += length[i]", "B[i + 2] -= length[i]", "bias", "row θ_"),
    Fault(SNAKE, "B[i + 2] += length[i]", "B[i + 2] += 2 * length[i]", "bias", "row θ_"),
    # Q
    Fault(SNAKE, "Q[k + 2] -= torque", "Q[k + 2] += torque", "generalized-forces", "row θ_"),
    Fault(SNAKE, "(theta[joint] - theta", "(-theta[joint] + theta", "generalized-forces", "sign"),
    Fault(SNAKE, "Q[k + 3] += torque", "pass", "generalized-forces", "row θ_"),
    # a and gamma
    Fault(SNAKE, "= -cos_phi[i]\n", "= cos_phi[i]\n", "constraint-jacobian", ", y): sign"),
    Fault(
        SNAKE,
        "-length[i] / 2 * cos_alpha[i]",
        "-length[i] * cos_alpha[i]",
        "constraint-jacobian",
        "2 times too large",
    ),
    Fault(SNAKE, "-length[j] * (cos_phi", "-length[i] * (cos_phi", "constraint-jacobian", "θ_"),
    Fault(
        SNAKE,
        "return cos_alpha * cos - sin",
        "return cos_alpha * cos + sin",
        "constraint-jacobian",
        "wheel",
    ),
    Fault(SNAKE, "    return gamma\n", "    return -gamma\n", "constraint-drift", "sign"),
    Fault(
        SNAKE, "cos_phi[i] + omega * (Vx", "cos_phi[i] - omega * (Vx", "constraint-drift", "wheel"
    ),
    Fault(
        SNAKE,
        "        half = length[i] / 2\n",
        "        half = length[i]\n",
        "constraint-drift",
        "wheel",
    ),
    # w′ and its remainder
    Fault(SNAKE, "ww_w = -before", "ww_w = before", "null-space-speeds", "w′"),
    Fault(SNAKE, "sin_psi + offset * ww_w", "sin_psi - offset * ww_w", "null-space-speeds", "w′"),
    Fault(
        SNAKE, "= sin_phi, -half * cos[0]", "= sin_phi, half * cos[0]", "null-space-speeds", "w′"
    ),
    Fault(
        SNAKE,
        "sin_alpha[0] * v[2]",
        "-sin_alpha[0] * v[2]",
        "speeds-velocity",
        "generalized speeds",
    ),
    Fault(
        SNAKE,
        "- offset * omega * omega",
        "+ offset * omega * omega",
        "speeds-remainder",
        "remainder",
    ),
    Fault(SNAKE, "+ turning * sin_delta", "- turning * sin_delta", "speeds-remainder", "remainder"),
    Fault(SNAKE, "- lever * omega * omega", "", "speeds-remainder", "remainder"),
    Fault(
        SNAKE, "spin * cos[0] - turning", "spin * cos[0] + turning", "speeds-remainder", "remainder"
    ),
    Fault(SNAKE, "v[k + 2] = omega", "v[k + 2] = -omega", "speeds-velocity", "q̇"),
    # Kane's bodies
    Fault(
        SNAKE,
        "omega_u[k + 1, 0, i] - omega_u[k, 0, i]",
        "omega_u[k, 0, i] - omega_u[k + 1, 0, i]",
        "active-forces",
        "sign",
    ),
    Fault(SNAKE, "inertia[:, np.new", "inertia[::-1, np.new", "kane-ml-mass", "M_Kane"),
    Fault(SNAKE, "rolling.s_rest,", "-rolling.s_rest,", "kane-ml-force", "N q̇"),
    # the second derivation
    Fault(
        SNAKE, "V[i, 1] = joint_y + length", "V[i, 1] = joint_y - length", "mass-matrix", "[casadi]"
    ),
    Fault(
        SNAKE,
        "(theta[k + 1] - theta[k]) / 2",
        "(theta[k + 1] - theta[k])",
        "generalized-forces",
        "0.5 times",
    ),
    # not a number, and nothing at all
    Fault(SNAKE, "    return B\n", "    return B * np.nan\n", "finite-terms", "[B]"),
    Fault(SNAKE, "    return M\n", "    return M * np.nan\n", "finite-terms", "[M]"),
    Fault(SNAKE, "    return Q\n", "    return Q * np.nan\n", "finite-terms", "[Q]"),
    Fault(SNAKE, "    return a\n", "    return a * np.nan\n", "finite-terms", "[a]"),
    Fault(SNAKE, "    return a\n", "    return 0 * a\n", "constraint-jacobian", "missing"),
    Fault(
        "formulations/au.py", "M_Au[n:, :n] = -a", "pass", "refusals", "au, M_Au: refused in vain"
    ),
    Fault(
        "formulations/au.py", "M_Au[:n, :n] = M", "pass", "refusals", "au, M_Au: refused in vain"
    ),
    Fault(
        "formulations/el.py", "M_El[n - r :] = a", "pass", "refusals", "el, M_El: refused in vain"
    ),
    Fault("formulations/im.py", "M_IM[i, i] = 1", "pass", "refusals", "im, M_IM: refused in vain"),
    Fault("formulations/gw.py", "columns[:, :r] = a.T", "pass", "refusals", "refused in vain"),
    Fault("formulations/gw.py", '"M_GW"), lambda_', '"M_GW"), None', "multipliers", "[gw]"),
    # formulations
    Fault("formulations/im.py", "(v, F_Au)", "(v, -F_Au)", "equations-residual", "[im]"),
    Fault("formulations/im.py", "[v.size :]", "[: -v.size]", "equations-residual", "[im]"),
    Fault("formulations/au.py", "n:] = -a.T", "n:] = a.T", "equations-residual", "[au]"),
    Fault("formulations/au.py", "(F, gamma)", "(F, -gamma)", "constraint-acceleration", "[au]"),
    Fault(
        "formulations/au.py",
        "M_Au[n:, :n] = -a",
        "M_Au[n:, :n] = -a[::-1]",
        "constraint-acceleration",
        "[au]",
    ),
    Fault(
        "formulations/el.py",
        "M[second] - reduced",
        "M[second] + reduced",
        "equations-residual",
        "[el]",
    ),
    Fault(
        "formulations/el.py",
        "F[second] - reduced[:, n], -gamma",
        "F[second] - reduced[:, n], gamma",
        "constraint-acceleration",
        "[el]",
    ),
    Fault(
        "formulations/el.py",
        "primed[:, n] = F[first]",
        "primed[:, n] = F[first[::-1]]",
        "equations-residual",
        "[el]",
    ),
    Fault(
        "formulations/gw.py",
        "mobility[:, r] + gamma",
        "mobility[:, r] - gamma",
        "constraint-acceleration",
        "[gw]",
    ),
    Fault(
        "formulations/gw.py", "F + a.T @ lambda_", "F - a.T @ lambda_", "equations-residual", "[gw]"
    ),
    Fault(
        "formulations/em.py",
        "w[first] = -dep",
        "w[first] = dep",
        "null-space-embedding",
        "w of the embedding",
    ),
    Fault(
        "formulations/em.py",
        "rest[first] = -dep",
        "rest[first] = dep",
        "constraint-acceleration",
        "[em]",
    ),
    Fault(
        "formulations/em.py",
        "a[:, first])",
        "a[:, first[::-1]])",
        "null-space-embedding",
        "w of the embedding",
    ),
    Fault(
        "formulations/ml.py", "solve(M_ML, F_ML", "solve(M_ML, -F_ML", "equations-residual", "[ml]"
    ),
    # a chain
    Fault(CHAIN, "+ Vy * sin_phi[k]", "- Vy * sin_phi[k]", "chain-velocity", "velocity of a chain"),
    Fault(CHAIN, "x[0] * cos_phi + across", "x[0] * cos_phi - across", "chain-velocity", "row x"),
    Fault(CHAIN, "D[1::2] = inertia", "D[1::2] = mass", "chain-energy", "mass of a chain"),
    Fault(CHAIN, "torque[k] - torque[k - 1]", "torque[k] + torque[k - 1]", "chain-forces", "θ_"),
    Fault(CHAIN, "f[-1] = -torque[-1]", "f[-1] = torque[-1]", "chain-forces", "row θ_4"),
    Fault(CHAIN, "sin[j]\n        sin_psi", "cos[j]\n        sin_psi", *COUPLING),
    Fault(CHAIN, "cos_delta, before * sin_psi", "cos_delta, -before * sin_psi", *COUPLING),
    Fault(CHAIN, "sin_delta, -before", "sin_delta, before", *COUPLING),
    Fault(CHAIN, "= -1, half", "= -1, -half", *COUPLING),
    Fault(CHAIN, "= -half * cos_alpha[k]", "= -length[k] * cos_alpha[k]", *COUPLING),
    Fault(CHAIN, "turning * sin_delta - spin", "turning * sin_delta + spin", *REMAINDER),
    Fault(CHAIN, "s * omega - turning", "-s * omega - turning", *REMAINDER),
    Fault(CHAIN, " - spin * sin_alpha[k]", "", *REMAINDER),
    Fault(CHAIN, "* sin + spin * cos", "* sin - spin * cos", "chain-acceleration", "row x"),
    Fault(CHAIN, "[j + 1] += across", "[j + 1] -= across", *RESULT),
    Fault(CHAIN, "-mass[k] * x", "mass[k] * x", *RESULT),
    Fault(BANDED, "right[i + 2] = rest", "right[i + 2] = -rest", *RESULT),
    Fault(BANDED, "bands[i + 3, 0] = -before", "_ = -before", *RESULT),
    Fault(BANDED, "bands[i, 6] = bands", "bands", *RESULT),
    Fault(
        BANDED, "right[i + 1] = force", "right[i + 1] = -force", "equations-residual", "[banded]"
    ),
    Fault(BANDED, "mass[2 * k + 1]\n", "mass[2 * k]\n", *RESULT),
    Fault(BANDED, "xdot[::2] = found[::4]", "xdot[::2] = found[1::4]", *RESULT),
    Fault("formulations/kane.py", "range(i + 1)", "range(i)", "kane-ml-mass", "M_Kane"),
    Fault(
        "formulations/kane.py",
        "momentum * remainder[k, c]",
        "-momentum * remainder[k, c]",
        "kane-ml-force",
        "N q̇",
    ),
    Fault(
        "formulations/kane.py",
        "force[i] - left[i]",
        "force[i] + left[i]",
        "kane-ml-force",
        "F_Kane",
    ),
]


@contextmanager
def planted(file: str, source: str) -> Iterator[ModuleType]:
    """Run `source` as a module of its own, beside the real one."""
    marked = len(GENERIC)
    module = ModuleType(f"planted_{next(_numbers)}")
    module.__file__ = str(PACKAGE / file)
    sys.modules[module.__name__] = module
    try:
        exec(compile(source, file, "exec"), module.__dict__)
        yield module
    finally:
        del sys.modules[module.__name__], GENERIC[marked:]


def changed(fault: Fault) -> str:
    """Return the source with the fault; the place must exist, or the fault would test nothing."""
    source = (PACKAGE / fault.file).read_text(encoding="utf-8")
    head, *rest = source.split(fault.old)
    assert rest, f"{fault.old!r} is no longer in {fault.file}"
    return head + fault.new + fault.old.join(rest)


def first_failure(scene: type[Snake], formulations: dict, links: int = 4) -> Finding | None:
    """Look at a few random states in Python, claims in their order; return what fails first."""
    selection = Selection(
        tuple(formulations.values()), Selection.of().engines, Selection.of().claims
    )
    for seed in range(3):
        random = np.random.default_rng(seed)
        parameters = (
            random.uniform(0.5, 2, links),
            random.uniform(0.5, 2, links),
            random.uniform(0.1, 1, links),
            random.uniform(10, 100, links - 1),
            random.uniform(-1, 1, links),
        )
        made = scene(*parameters)
        q = random.uniform(-2, 2, links + 2)
        # The velocity is right even where the fault is in a.
        at = Evaluation(Snake(*parameters), q, np.zeros(made.n))
        v = consistent_velocity(at, null_space(at.terms.a) @ random.uniform(1, 3, 2))
        for finding in Run().look_at(made, State(q, v), selection):
            if finding.verdict == "failed":
                return finding
    return None


class InterpretedSnake(Snake):
    compiled = False


def snake_in(module: ModuleType) -> type[Snake]:
    """Return the snake with the functions of a module in the place of its own, not compiled."""
    if hasattr(module, "Snake"):
        module.Snake.compiled = False
        return module.Snake
    own = {name: staticmethod(x) for name, x in vars(module).items() if hasattr(Snake, name)}
    return type("Snake", (InterpretedSnake,), own)


def formulation_in(module: ModuleType, key: str) -> dict:
    found = [x for x in vars(module).values() if isinstance(x, type(FORMULATIONS[key]))]
    return FORMULATIONS | {found[0].key: found[0]}


def test_the_source_as_it_is_shows_no_fault():
    for file in (SNAKE, CHAIN):
        with planted(file, (PACKAGE / file).read_text(encoding="utf-8")) as module:
            assert first_failure(snake_in(module), FORMULATIONS) is None


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.id)
def test_a_planted_fault_is_caught_and_named(fault: Fault, monkeypatch: pytest.MonkeyPatch):
    with planted(fault.file, changed(fault)) as module:
        if fault.file in (SNAKE, CHAIN):
            failure = first_failure(snake_in(module), FORMULATIONS)
        else:
            key = Path(fault.file).stem
            if hasattr(identities, key):
                monkeypatch.setattr(identities, key, module)
            failure = first_failure(InterpretedSnake, formulation_in(module, key))
    assert failure is not None, "not caught"
    assert failure.claim == fault.claim, str(failure)
    assert fault.says in str(failure)


def test_at_least_25_different_faults_are_planted():
    assert len({(fault.file, fault.old, fault.new) for fault in FAULTS}) >= 25

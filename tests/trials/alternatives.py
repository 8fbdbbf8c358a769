"""Plant twenty mistakes in one model, and print which of six ways of checking finds each.

    python -m tests.trials.alternatives [--only WORD] [--markdown FILE]

The model is `docs/guides/cart.py`: a cart on a rail that carries a double pendulum, with M, bias,
gravity, qdd, energies and a dissipation function. A mistake is an edit of its source, carried along
by functions that call each other. All ways see the same 8 states, but the motion, which is one.
The ways beside eomcheck have a tolerance, which their authors have to choose: an argument here. The
exit code is 1 if a way fails on the right model, or eomcheck misses a mistake that the given
functions show.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import sympy
from scipy.optimize import check_grad
from sympy.physics.mechanics import LagrangesMethod, dynamicsymbols

from eomcheck.console import progress
from eomcheck.lab.show.table import ResultTable, print_tables
from eomcheck.testing import EquationsOfMotion, check

SOURCE = Path(__file__).parents[2] / "docs" / "guides" / "cart.py"
NAMES = ("M", "bias", "gravity", "qdd", "T", "U", "R")
STATES = np.random.default_rng(0).uniform(-1.0, 1.0, (8, 2, 3))


class Mistake(NamedTuple):
    """A mistake: its name, the edits (old, new) of the source, and whether functions share it."""

    name: str
    edits: tuple[tuple[str, str], ...]
    shared: bool = False


QDD = "return np.linalg.solve(M(q), -bias(q, v) - gravity(q) - np.array([d * v[0], 0.0, 0.0]))"
PULL, ROW, END = "[pull, m2 * l1", "[0.0, (m1 + m2) * g", "m2 * g * l2 * np.sin(q[2])]"

MISTAKES = (
    Mistake(
        "M: one entry above the diagonal has the wrong sign",
        (("[m0 + m1 + m2, (m1", "[m0 + m1 + m2, -(m1"),),
    ),
    Mistake("M: sine for cosine in a coupling", (("np.cos(q[1] - q[2])", "np.sin(q[1] - q[2])"),)),
    Mistake("M: a mass is missing", (("(m1 + m2) * l1**2", "m1 * l1**2"),)),
    Mistake("bias: wrong sign of one term", (("-(m1 + m2) * l1 * s1", "(m1 + m2) * l1 * s1"),)),
    Mistake("bias: twice one term", ((PULL, "[pull, 2 * m2 * l1"),)),
    Mistake(
        "bias: the other velocity in one term", (("s12 * v[2] ** 2, -m2", "s12 * v[1] ** 2, -m2"),)
    ),
    Mistake(
        "bias: an angle difference the other way round",
        (("np.sin(q[1] - q[2])", "np.sin(q[2] - q[1])"),),
    ),
    Mistake("bias: a velocity without its square", (("s12 * v[1] ** 2]", "s12 * v[1]]"),)),
    Mistake("bias: one row is 0", (("-m2 * l1 * l2 * s12 * v[1] ** 2]", "0.0]"),)),
    Mistake("gravity: wrong sign of one row", ((ROW, "[0.0, -(m1 + m2) * g"),)),
    Mistake("gravity: a mass is missing", ((ROW, "[0.0, m1 * g"),)),
    Mistake("gravity: an angle for its sine", ((END, "m2 * g * l2 * q[2]]"),)),
    Mistake("gravity: 9.8 in one row, 9.81 elsewhere", ((END, END.replace("g", "9.8", 1)),)),
    Mistake("qdd: the damper drives", ((QDD, QDD.replace("- np.array", "+ np.array")),)),
    Mistake("qdd: the damper is missing", ((" - np.array([d * v[0], 0.0, 0.0])", ""),)),
    Mistake("qdd: gravity has the wrong sign", ((QDD, QDD.replace("- gravity", "+ gravity")),)),
    Mistake("qdd: float32", ((QDD, f"{QDD}.astype(np.float32)"),)),
    Mistake("T: no half on one body", (("+ m1 * first @ first", "+ 2 * m1 * first @ first"),)),
    Mistake("all: a length is 0.55 m for 0.5 m", (("0.6, 0.5, 9.81", "0.6, 0.55, 9.81"),), True),
    Mistake(
        "U and gravity: the second body hangs on the rail",
        ((ROW, "[0.0, m1 * g"), ("(l1 * np.cos(q[1]) + l2", "(l2")),
        True,
    ),
)
"""Twenty mistakes as people make them; two of them are in all functions that could show them."""


def functions_of(mistake: Mistake | None) -> SimpleNamespace:
    """The functions of the model, with a mistake."""
    source = SOURCE.read_text(encoding="utf-8")
    for old, new in mistake.edits if mistake else ():
        old, new = fitted(source, old, new)
        source = source.replace(old, new)
    space: dict[str, Any] = {"__name__": "cart"}
    exec(compile(source, str(SOURCE), "exec"), space)
    return SimpleNamespace(**{name: space[name] for name in NAMES})


def fitted(source: str, old: str, new: str) -> tuple[str, str]:
    """An edit whose old text stands once in the source."""
    if source.count(old) != 1:
        raise ValueError(f"{old!r} stands {source.count(old)} times in {SOURCE.name}")
    return old, new


# ---- Ways of checking: each returns whether it found something -----------------------------------


def apart(actual: Any, expected: Any, tolerance: float) -> bool:
    """Whether two results differ by more than a tolerance, relative to the larger of them and 1."""
    difference = np.abs(np.subtract(actual, expected)).max()
    return bool(difference > tolerance * max(1.0, np.abs(expected).max(), np.abs(actual).max()))


def gradient(f: Callable[[np.ndarray], Any], x: np.ndarray, step: float) -> np.ndarray:
    """Central differences of f; the last axis is that of x."""
    shifts = step * np.eye(len(x))
    return np.stack([(f(x + e) - f(x - e)) / (2 * step) for e in shifts], -1)


def unit_tests(f: SimpleNamespace, tolerance: float = 1e-9) -> bool:
    """Tests as libraries have them: symmetry, definiteness, rest, forward of inverse dynamics."""
    for q, v in STATES:
        M, qdd = f.M(q), f.qdd(q, v)
        residual = M @ qdd + f.bias(q, v) + f.gravity(q) + [0.3 * v[0], 0.0, 0.0]
        if (
            apart(M, M.T, tolerance)
            or np.linalg.eigvalsh(M)[0] <= 0
            or apart(f.bias(q, 0 * v), 0.0, tolerance)
            or apart(residual, 0.0, tolerance)
        ):
            return True
    return False


def scipy_check_grad(f: SimpleNamespace, tolerance: float = 1e-6) -> bool:
    """`scipy.optimize.check_grad` of the two gradients that the functions have: of U, and of T."""
    return any(
        check_grad(f.U, f.gravity, q) > tolerance
        or check_grad(lambda v, q=q: f.T(q, v), lambda v, q=q: f.M(q) @ v, v) > tolerance
        for q, v in STATES
    )


def differences(f: SimpleNamespace, tolerance: float = 1e-6) -> bool:
    """Differences by hand: g of U, M of T, the bias of M, and q̈ of all of them."""
    for q, v in STATES:
        by_velocity = gradient(lambda w, q=q: gradient(lambda u, q=q: f.T(q, u), w, 1e-3), v, 1e-3)
        M_rate = gradient(f.M, q, 1e-5)
        bias = M_rate @ v @ v - 0.5 * np.einsum("i,ijk,j->k", v, M_rate, v)
        force = -f.bias(q, v) - f.gravity(q) - gradient(lambda w, q=q: f.R(q, w), v, 1e-4)
        if (
            apart(f.gravity(q), gradient(f.U, q, 1e-5), tolerance)
            or apart(f.M(q), by_velocity, tolerance)
            or apart(f.bias(q, v), bias, tolerance)
            or apart(f.M(q) @ f.qdd(q, v), force, tolerance)
        ):
            return True
    return False


def energy_drift(f: SimpleNamespace, tolerance: float = 1e-6) -> bool:
    """Energy and dissipated work along a motion of 5 s, by Runge and Kutta's method."""
    step, y = 2e-3, np.array([0.0, 0.8, -0.4, 0.0, 0.0, 0.0, 0.0])

    def rates(y: np.ndarray) -> np.ndarray:
        q, v = y[:3], y[3:6]
        return np.concatenate([v, f.qdd(q, v), [2 * f.R(q, v)]])

    energies = []
    for _ in range(2500):
        energies.append(f.T(y[:3], y[3:6]) + f.U(y[:3]) + y[6])
        k1 = rates(y)
        k2 = rates(y + step / 2 * k1)
        k3 = rates(y + step / 2 * k2)
        y = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + rates(y + step * k3))
        if not np.isfinite(y).all() or np.abs(y).max() > 1e6:
            return True
    return bool(np.ptp(energies) > tolerance * np.abs(energies).max())


NUMBERS = ("2.0", "0.7", "0.4", "0.6", "0.5", "9.81", "0.3")


@cache
def second_derivation() -> SimpleNamespace:
    """The same model derived by SymPy from positions, with numbers of its own."""
    x, first, second = coordinates = dynamicsymbols("x θ1 θ2")
    rates = [q.diff() for q in coordinates]
    m0, m1, m2, l1, l2, g, d = map(sympy.Rational, NUMBERS)
    bob = sympy.Matrix([x + l1 * sympy.sin(first), -l1 * sympy.cos(first)])
    end = bob + sympy.Matrix([l2 * sympy.sin(second), -l2 * sympy.cos(second)])
    time = dynamicsymbols._t
    squares = [rates[0] ** 2, *((p.diff(time).T * p.diff(time))[0] for p in (bob, end))]
    kinetic = sum(m * v for m, v in zip((m0, m1, m2), squares, strict=True)) / 2
    potential = g * (m1 * bob[1] + m2 * end[1])
    lagrange = LagrangesMethod(kinetic - potential, coordinates)
    lagrange.form_lagranges_equations()
    gravity = sympy.Matrix([potential]).jacobian(coordinates).T
    bias = -lagrange.forcing - gravity
    symbols = sympy.symbols("a0:3 b0:3")
    plain = dict(zip((*rates, *coordinates), (*symbols[3:], *symbols[:3]), strict=True))

    def compiled(expression: Any) -> Callable[..., np.ndarray]:
        plainly = sympy.sympify(expression).subs(plain)
        f = sympy.lambdify(symbols, plainly, "numpy", cse=True)
        return lambda q, v=(0.0, 0.0, 0.0): np.asarray(f(*q, *v), float)

    M, T, U = compiled(lagrange.mass_matrix), compiled(kinetic), compiled(potential)
    B, G = compiled(bias), compiled(gravity)
    damper = float(d)
    return SimpleNamespace(
        M=lambda q: M(q),
        bias=lambda q, v: B(q, v)[:, 0],
        gravity=lambda q: G(q)[:, 0],
        qdd=lambda q, v: np.linalg.solve(M(q), -B(q, v)[:, 0] - G(q)[:, 0] - [damper * v[0], 0, 0]),
        T=lambda q, v: float(T(q, v)),
        U=lambda q: float(U(q)),
        R=lambda q, v: 0.5 * damper * v[0] ** 2,
    )


def by_sympy(f: SimpleNamespace, tolerance: float = 1e-9) -> bool:
    """All functions against a second derivation by SymPy."""
    right = second_derivation()
    return any(
        apart(getattr(f, name)(*x), getattr(right, name)(*x), tolerance)
        for q, v in STATES
        for name, x in (("M", (q,)), ("gravity", (q,)), ("U", (q,)), ("bias", (q, v)),
                        ("qdd", (q, v)), ("T", (q, v)))
    )  # fmt: skip


def failures(f: SimpleNamespace, against: Any = None) -> list[Any]:
    """The findings of `check` that failed."""
    mine = EquationsOfMotion(3, **vars(f), name="cart")
    states = [(q, v) for q, v in STATES]
    return [x for x in check(mine, states=states, against=against) if x.verdict == "failed"]


WAYS: dict[str, Callable[[SimpleNamespace], bool]] = {
    "unit tests": unit_tests,
    "check_grad": scipy_check_grad,
    "energy drift": energy_drift,
    "differences by hand": differences,
    "SymPy again": by_sympy,
}
"""The ways beside eomcheck, by the heads of their columns."""


def diagnosis(failed: list[Any]) -> str:
    """The function to blame and the kind of error, of the first failure."""
    if not failed:
        return "-"
    first = failed[0]
    parts = [x for x in str(first.detail).split("; ") if not x.endswith("repeats any mistake")]
    return f"{first.cause}: {parts[1] if len(parts) > 1 else parts[0]}"


def main() -> int:
    """Run all, print the table, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", default="", help="only mistakes whose name has this word")
    parser.add_argument("--markdown", type=Path, help="write the table to this file too")
    options = parser.parse_args()
    chosen = [x for x in MISTAKES if options.only in x.name]
    wrong = any(way(functions_of(None)) for way in WAYS.values()) or bool(
        failures(functions_of(None))
    )
    counts = dict.fromkeys([*WAYS, "eomcheck", "eomcheck, against SymPy"], 0)
    rows = []
    with progress("mistakes", len(chosen)) as advance:
        for mistake in chosen:
            f = functions_of(mistake)
            failed = failures(f)
            found = [way(f) for way in WAYS.values()]
            second = EquationsOfMotion(3, **vars(second_derivation()), name="sympy")
            found += [bool(failed), bool(failures(f, against=second))]
            wrong |= not failed and not mistake.shared
            for name, one in zip(counts, found, strict=True):
                counts[name] += one
            cells = ["found" if one else "-" for one in found]
            rows.append([mistake.name, *cells, diagnosis(failed)])
            advance()
    rows.append(["found in all", *map(str, counts.values()), ""])
    columns = ["mistake", *counts, "first finding of eomcheck"]
    sheet = ResultTable("alternatives", f"{len(chosen)} mistakes, six ways", columns, rows)
    print_tables([sheet])
    if options.markdown is not None:
        options.markdown.write_text(sheet.markdown(), encoding="utf-8")
    return int(wrong)


if __name__ == "__main__":
    raise SystemExit(main())

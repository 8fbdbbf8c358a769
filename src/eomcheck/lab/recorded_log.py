"""Logs of simulators: recorded motions, checked against time and against the equations of motion.

A log has a column t, coordinates and velocities, and accelerations and applied forces if there are
any. Rates are differences of the rows around a row: polynomials through seven and through three of
them, whose difference estimates the truncation error, beside the rounding of the printed digits;
rows farther apart are tried too. A velocity that is a difference of two rows exactly, or the rate
half a step or a step beside, is recognized as such: it is a matter of the integrator or of the
row, not of the equations. Methods of second order pass, errors of first order in the step decide
nothing. The equations of motion are compared row by row, as recorded answers are; the energy
changes by the work of the forces; and constraints drift.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims.confusions import UNITS, ConfusionContext, agreement_within, locate
from eomcheck.claims.finding import Finding, Verdict
from eomcheck.engines.file_engine import FREE
from eomcheck.errors import InputError
from eomcheck.evaluation.evaluation import BatchEvaluation
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.lab.recorded_answers import (
    EQUATIONS,
    AnswerColumns,
    JudgedRow,
    RecordedRow,
    ScreenedGroup,
    TableLayout,
    batch_point,
    check_answers,
    chunks_of_rows,
    compared_answers,
    explain_failure,
    judge_group,
    judge_row,
    screen_rows,
    table_layout,
)
from eomcheck.lab.recorded_base import CONVENTIONS, base_errors, text_of
from eomcheck.lab.recorded_finding import (
    ComparedEntry,
    ComparedRow,
    RecordedFinding,
    compared_entries,
)
from eomcheck.lab.recorded_table import CHUNK, EXACT, RecordedTable, open_table
from eomcheck.lab.show.chart import Axis, Chart, Line, Panel
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.batch_arrays import batch_data
from eomcheck.numbers.generic import Array
from eomcheck.safe_output import listed

LOG_CLAIM = "recorded-log"
"""Id of the claim: a recorded motion is one of the scene, to its printed digits and its steps."""

LEAST_ROWS = 3
"""Least number of rows of a log: two have no rate that could be compared."""

WIDE, NARROW = 7, 3
"""Number of rows through which polynomials run; one less between two rows."""

STRIDES = 1, 2, 4, 8, 16
"""Distances, in rows, of the rows through which they run."""

AROUND = 3
"""Number of rows on either side whose errors and changes count for a row."""

AT_ONCE = 2**16
"""Number of rows whose weights are computed at once."""

TURN = 2.0 * np.pi


class RecordedMotion(NamedTuple):
    """A motion in the coordinates of the scene, with the errors of its numbers.

    Attributes:
        table: the table.
        scene: the scene.
        t: times (k,), s.
        q, v: coordinates and velocities (k, n).
        a: accelerations (k, n), None without.
        tau: applied forces (k, n), zeros without.
        t_error, q_error, v_error, a_error, tau_error: errors of these by their digits.
        unit_roundoff: u of the numbers of the program.
        options: `base` and `precision` as they were given.
    """

    table: RecordedTable
    scene: Scene
    t: Array
    q: Array
    v: Array
    a: Array | None
    tau: Array
    t_error: Array
    q_error: Array
    v_error: Array
    a_error: Array
    tau_error: Array
    unit_roundoff: float
    options: Mapping[str, str | None] = {}

    def rounding(self, name: str) -> Array:
        """Return the errors of numbers by their digits and by the arithmetic of the program."""
        digits = getattr(self, f"{name}_error")
        return digits + allowed_error(1.0, self.unit_roundoff) * np.abs(getattr(self, name))

    def state(self, row: int) -> State:
        """Return the state of a row."""
        return State(self.q[row], self.v[row], float(self.t[row]))


def on_a_grid(t: Array) -> bool:
    """Return whether times have equal steps as printed: they are exact then, 0.01, 0.02, ..."""
    steps = np.diff(t)
    return bool(np.ptp(steps) <= 2.0 * allowed_error(float(np.abs(t).max())))


def check_times(table: RecordedTable, t: Array, t_error: Array) -> list[str]:
    """Check that times, with their errors, increase; return notes about their steps.

    Raises:
        InputError: there are fewer rows than `LEAST_ROWS`, or a time is repeated or goes back.
    """
    if len(t) < LEAST_ROWS:
        raise InputError(
            f"{str(table.path)!r} has {len(t)} rows: a log needs {LEAST_ROWS} for rates"
        )
    steps = np.diff(t)
    for wrong, what in ((steps == 0.0, "is repeated"), (steps < 0.0, "goes back")):
        if wrong.any():
            row = int(np.argmax(wrong)) + 1
            before = f"{t[row - 1]:.10g} s in the row before"
            raise InputError(
                f"{str(table.path)!r}, {table.line_of(row)}: t = {t[row]:.10g} s {what}, {before}"
            )
    least, most = float(steps.min()), float(steps.max())
    if not on_a_grid(t) and most - least > 4.0 * float(t_error.max()):
        return [f"time steps differ: from {least:.6g} s to {most:.6g} s"]
    return [f"time steps of {np.median(steps):.6g} s"]


# ---- Rates ---------------------------------------------------------------------------------------


def rate_weights(nodes: Array, at: Array) -> Array:
    """Return the weights (m, p) of the derivative of the polynomial through p nodes.

    By Fornberg's recursion, for any distances.

    Args:
        nodes: abscissae (m, p).
        at: abscissae of the derivatives (m,).
    """
    m, p = nodes.shape
    value, slope = np.zeros((2, p, m))
    value[0] = 1.0
    before, arm = np.ones(m), nodes[:, 0] - at
    for i in range(1, p):
        product, last, arm = np.ones(m), arm, nodes[:, i] - at
        for j in range(i):
            apart = nodes[:, i] - nodes[:, j]
            product = product * apart
            if j == i - 1:
                slope[i] = before * (value[j] - last * slope[j]) / product
                value[i] = -before * last * value[j] / product
            slope[j] = (arm * slope[j] - value[j]) / apart
            value[j] = arm * value[j] / apart
        before = product
    return slope.T


def largest_around(x: Array, width: int = AROUND) -> Array:
    """Return the largest entries of the rows around each row of x (k, ...), same shape."""
    result = x.copy()
    for shift in range(1, min(width, len(x) - 1) + 1):
        np.maximum(result[shift:], x[:-shift], out=result[shift:])
        np.maximum(result[:-shift], x[shift:], out=result[:-shift])
    return result


def _polynomial_rate(
    t: Array, x: Array, error: Array, low: Array, high: Array, size: int, stride: int
) -> tuple[Array, Array]:
    """Return derivatives (m, n) between rows `low` and `high`, and their rounding errors."""
    span = stride * (size - 1)
    first = np.clip((low + high - span) // 2, 0, len(t) - 1 - span)
    rate, rounding = np.empty((2, len(low), x.shape[1]))
    for start in range(0, len(low), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        nodes = first[part, None] + stride * np.arange(size)
        at = (t[low[part]] + t[high[part]]) / 2.0
        weights = rate_weights(t[nodes] - at[:, None], np.zeros(len(nodes)))
        rate[part] = np.einsum("mp,mpn->mn", weights, x[nodes])
        rounding[part] = np.einsum("mp,mpn->mn", np.abs(weights), error[nodes])
    return rate, rounding


class Rates(NamedTuple):
    """Rates of columns by differences.

    Attributes:
        rows: rows (m,) to which they are compared.
        value: rates (m, n).
        error: estimated truncation error and rounding (m, n).
    """

    rows: Array
    value: Array
    error: Array


def difference_rates(t: Array, x: Array, error: Array, half_steps: int = 0) -> Rates:
    """Return the rates of columns so many half steps behind each row, with their errors.

    Of several distances of the rows, for each entry, that with the least error.

    Args:
        t: times (k,), s.
        x: columns (k, n).
        error: rounding errors of x (k, n).
        half_steps: number of half steps from a row to the place of the rate.
    """
    count, between = len(t), half_steps % 2
    rows = np.arange(count)
    low, high = rows + half_steps // 2, rows + -(-half_steps // 2)
    rows = rows[(low >= 0) & (high < count)]
    low, high = low[rows], high[rows]
    best: Rates | None = None
    finer: list[tuple[Array, Array]] = []
    for stride in STRIDES:
        wide = min(WIDE - between, (count - 1) // stride + 1)
        if wide < 3 and best is not None:
            break
        narrow = max(2, wide - (WIDE - NARROW))
        value, rounding = _polynomial_rate(t, x, error, low, high, wide, stride)
        other, _ = _polynomial_rate(t, x, error, low, high, narrow, stride)
        truncation = np.abs(value - other)
        for closer, noise in finer:  # their rounding has to explain how far they lie apart
            truncation = np.maximum(truncation, np.abs(value - closer) - noise)
        finer.append((value, rounding))
        size = largest_around(truncation, AROUND * stride) + rounding
        if best is None:
            best = Rates(rows, value, size)
        else:
            better = size < best.error
            best = Rates(
                rows, np.where(better, value, best.value), np.where(better, size, best.error)
            )
    assert best is not None
    return best


# ---- Velocities and accelerations ----------------------------------------------------------------


class Alignment(NamedTuple):
    """How the rate of columns lies beside them.

    Attributes:
        text: description, "" where it is at the same time.
        half_steps: number of half steps by which it lies beside, negative behind.
        by: methods that produce it, "" for a mistake of rows.
    """

    text: str
    half_steps: int
    by: str = ""


SAME = Alignment("", 0)
BY_STEPS = {
    "after": Alignment("half a step behind", -1, "semi-implicit Euler or leapfrog"),
    "before": Alignment("half a step ahead of", 1, "explicit Euler or leapfrog"),
    "mean": Alignment("in the mean of both ends of a step the rate of", 0, "trapezoidal rule"),
}
"""Which rate of a step is its difference quotient -> the alignment."""

IMPLICIT = {
    False: "semi-implicit Euler, dampers implicit",
    True: "implicit Euler in the velocities",
}
"""Integrators whose step from v follows from a, by whether more forces than those of dampers are
implicit.
"""

BESIDE = (
    BY_STEPS["after"],
    BY_STEPS["before"],
    Alignment("one step behind", -2),
    Alignment("one step ahead of", 2),
    Alignment("one and a half steps behind", -3),
    Alignment("one and a half steps ahead of", 3),
)
"""Alignments that are compared with rates beside the row."""


MOST_BESIDE = 2
"""Largest number of steps by which the mean of a step lies beside it, of all alignments."""


class RateCheck(NamedTuple):
    """Comparison of a rate with differences.

    Attributes:
        rates: the differences at the same time.
        error: errors (k, n).
        allowed: allowed errors (k, n).
        first_order: change (k, n) of the rate within a step.
        alignments: that of each coordinate, None if none was recognized.
        broken: flags (k, n) of entries that differ by more than both.
        jumps: flags (k - 1, n) of steps of x that no rate nearby explains.
        step, explained: changes of x in a step (k - 1, n), and those by the rate.
    """

    rates: Rates
    error: Array
    allowed: Array
    first_order: Array
    alignments: tuple[Alignment | None, ...]
    broken: Array
    jumps: Array
    step: Array
    explained: Array

    @property
    def common(self) -> Alignment | None:
        """The alignment of all coordinates, None if there is no common one."""
        return self.alignments[0] if len({*self.alignments}) == 1 else None

    def sides(
        self,
        name: str,
        coordinates: Sequence[str],
        columns: Sequence[int],
        rate: Array,
        row: int,
    ) -> tuple[ComparedEntry, ...]:
        """Return the recorded rates (k, n) of some columns in a row beside the differences."""
        columns = list(columns)
        allowed = (self.allowed + self.first_order)[row, columns]
        names = [f"{name}[{coordinates[j]}]" for j in columns]
        return compared_entries(names, rate[row, columns], self.rates.value[row, columns], allowed)


def compare_rate(
    t: Array, t_error: Array, x: Array, x_error: Array, rate: Array, rate_error: Array
) -> RateCheck:
    """Compare a recorded rate with differences of columns.

    Args:
        t, t_error: times (k,) and their errors.
        x, x_error: columns (k, n) and their errors.
        rate, rate_error: their recorded rates (k, n) and the errors of these.
    """
    moved = x_error + np.abs(rate) * t_error[:, None]
    here = difference_rates(t, x, moved)
    error, allowed = np.abs(rate - here.value), here.error + rate_error
    # Of a right log both change alike; differences of columns in other units change by more.
    changes = (largest_around(_on_rows(np.abs(np.diff(y, axis=0))), 1) for y in (here.value, rate))
    first_order = np.minimum(*changes)
    h = np.diff(t)[:, None]
    step = np.diff(x, axis=0)
    step_error = moved[1:] + moved[:-1] + h * (rate_error[1:] + rate_error[:-1])
    quotients = {"after": rate[1:], "before": rate[:-1], "mean": (rate[1:] + rate[:-1]) / 2.0}
    n = x.shape[1]
    found: list[Alignment | None] = [None] * n
    # A step that no rate nearby explains: columns jump there.
    swing = largest_around(np.abs(np.diff(rate, axis=0)), 2)
    jumps = np.abs(step - h * quotients["mean"]) > step_error + MOST_BESIDE * h * swing

    def recognize(alignment: Alignment, right: Array, together: bool = False) -> None:
        if together and not right.all():
            return
        for j in range(n):
            if found[j] is None and right[:, j].all():
                found[j] = alignment

    same = error <= allowed
    recognize(SAME, same, together=True)
    for name, value in quotients.items():
        recognize(BY_STEPS[name], np.abs(step - h * value) <= step_error, together=True)
    recognize(SAME, same)
    for alignment in BESIDE:
        if None in found and len(t) > LEAST_ROWS + abs(alignment.half_steps):
            beside = difference_rates(t, x, moved, alignment.half_steps)
            off = np.abs(rate[beside.rows] - beside.value)
            right = off <= beside.error + rate_error[beside.rows]
            recognize(alignment, right, together=bool(alignment.by))
    found = [None if jumps[:, j].any() else found[j] for j in range(n)]
    broken = error > allowed + largest_around(first_order)  # a rate may be at its extremum
    sides = jumps, step, h * quotients["mean"]
    return RateCheck(here, error, allowed, first_order, tuple(found), broken, *sides)


def implicit_alignment(motion: RecordedMotion, a: Array, a_error: Array) -> Alignment | None:
    """Return the alignment of accelerations with the steps of an integrator implicit in v.

    With f the forces that depend on v, the step Δv of such an integrator from a row solves
    (M + h ∂f/∂v) Δv = h M a, where f is that of dampers, or that of all terms. As f has degree 2 in
    v, ∂f/∂v Δv is (f(v + Δv) - f(v - Δv)) / 2; of dampers, which have degree 1, the same at v = 0.

    Args:
        motion: the motion, its v not whole steps beside the rows.
        a, a_error: accelerations (k, n) and the errors of these.
    """
    count = len(motion.t) - 1
    few = np.linspace(0, count - 1, min(count, JUDGED_IN_LOG)).astype(int)
    # The row of a step's end may have the acceleration before it, as after MuJoCo's `mj_step`.
    beside = {"before": (a, a_error), "after": (np.roll(a, -1, 0), np.roll(a_error, -1, 0))}
    for (side, sides), (full, by) in product(beside.items(), IMPLICIT.items()):
        if all(_is_implicit(motion, *sides, rows, full).all() for rows in (few, np.arange(count))):
            return BY_STEPS[side]._replace(by=by)
    return None


def _is_implicit(
    motion: RecordedMotion, a: Array, a_error: Array, rows: Array, full: bool
) -> Array:
    """Return flags (k, n) of rows whose step solves the equation of `implicit_alignment`."""
    h = np.diff(motion.t)[rows, None]
    v, step = motion.v[rows], np.diff(motion.v, axis=0)[rows]
    noise = motion.rounding("v")
    noise = (noise[rows + 1] + noise[rows]) / h + a_error[rows]

    def needed(v: Array, vdot: Array) -> Array:
        velocities, accelerations = np.zeros_like(motion.v), np.zeros_like(motion.v)
        velocities[rows], accelerations[rows] = v, vdot
        return _expected_forces(motion._replace(v=velocities), accelerations, rows)

    still, at = 0.0 * v, v if full else 0.0 * v
    terms = (
        needed(v, step / h),
        needed(v, a[rows]),
        needed(at + step, still),
        needed(at - step, still),
    )
    off = terms[0] - terms[1] + (terms[2] - terms[3]) / 2.0
    relative = allowed_error(1.0, motion.unit_roundoff) + motion.rounding("q")[rows].max(axis=1)
    allowed = np.max(np.abs(terms), axis=(0, 2))[:, None] * relative[:, None]
    weight = needed(still, still)
    for j in range(v.shape[1]):
        alone = np.zeros_like(noise)
        alone[:, j] = noise[:, j]
        allowed = allowed + np.abs(needed(still, alone) - weight)
    return np.abs(off) <= allowed


def _on_rows(of_steps: Array) -> Array:
    """Return values of steps (k - 1, n) as those of the rows (k, n) before them."""
    return np.concatenate((of_steps, of_steps[-1:]))


def unwrapped(t: Array, q: Array, v: Array) -> tuple[Array, Array]:
    """Return coordinates without jumps by full turns, and the number of such jumps of each (n,)."""
    h = np.diff(t)[:, None]
    excess = np.diff(q, axis=0) - h * (v[1:] + v[:-1]) / 2.0
    turns = np.rint(excess / TURN)
    bound = h * largest_around(np.abs(np.diff(v, axis=0)), 2) + h * np.abs(v[1:])
    turns[np.abs(excess - TURN * turns) > np.minimum(bound, TURN / 4.0)] = 0.0
    back = np.concatenate((np.zeros((1, q.shape[1])), TURN * np.cumsum(turns, axis=0)))
    return q - back, np.count_nonzero(turns, axis=0)


def rate_findings(
    motion: RecordedMotion, names: tuple[str, str], check: RateCheck, rate: Array
) -> tuple[list[Finding], list[str]]:
    """Return the Findings about a rate, and notes.

    Args:
        motion: the motion.
        names: names of the rate and of what it is the rate of, such as ("v", "q").
        check: the comparison.
        rate: the recorded rate (k, n).
    """
    name, of = names
    coordinates = motion.scene.coordinate_names
    subject = f"{name} against {of}"
    log = _LogFindings(motion, subject)
    notes, findings = [], []
    groups: dict[Alignment | None, list[int]] = {}
    for j, alignment in enumerate(check.alignments):
        groups.setdefault(alignment, []).append(j)
    for alignment, columns in groups.items():
        some = "" if len(columns) == len(coordinates) else f"[{_few(coordinates, columns)}]"
        if alignment is None:
            findings.append(_unaligned(motion, log, names, check, rate, columns))
            continue
        worst = _worst(check.error, check.allowed, columns)
        numbers = float(check.error[worst]), float(check.allowed[worst])
        if alignment is SAME:
            findings += _same(log, check, columns, coordinates, worst, numbers)
            continue
        text = f"{name}{some} is {alignment.text} {of}"
        if alignment.by:
            notes.append(f"{text}: {alignment.by}")
            findings.append(log.finding(worst[0], 0.0, numbers[1], "passed"))
        else:
            text += f": it is of another row; {motion.table.line_of(worst[0])}"
            sides = check.sides(name, coordinates, columns, rate, worst[0])
            findings.append(log.finding(worst[0], *numbers, "failed", text, sides))
    return findings, notes


def _same(
    log: _LogFindings,
    check: RateCheck,
    columns: Sequence[int],
    coordinates: Sequence[str],
    worst: tuple[int, int],
    numbers: tuple[float, float],
) -> Iterator[Finding]:
    """Yield that rates at the same time pass, and those that the differences do not resolve."""
    resolved: Array = np.any(np.abs(check.rates.value) > 2.0 * check.allowed, axis=0)
    equal = np.all(check.error == 0.0, axis=0)
    vanish: Array = np.all(np.abs(check.rates.value) <= check.allowed, axis=0) & equal
    hidden = [j for j in columns if not (resolved[j] or vanish[j])]
    if len(hidden) < len(columns):
        yield log.finding(worst[0], *numbers, "passed")
    if hidden:
        detail = f"{_few(coordinates, hidden)} cannot be told with these digits and time steps"
        yield log.finding(worst[0], *numbers, "inconclusive", detail)


def _unaligned(
    motion: RecordedMotion,
    log: _LogFindings,
    names: tuple[str, str],
    check: RateCheck,
    rate: Array,
    columns: Sequence[int],
) -> Finding:
    """Return the Finding about coordinates whose rate was not recognized."""
    coordinates = motion.scene.coordinate_names
    broken, jumps = check.broken[:, columns], check.jumps[:, columns]
    if not (broken.any() or jumps.any()):
        worst = _worst(check.error, check.allowed, columns)
        numbers = float(check.error[worst]), float(check.allowed[worst])
        slope = np.gradient(check.rates.value, axis=0)[:, columns]
        off = (rate - check.rates.value)[:, columns]
        lag = float((off * slope).sum() / (slope**2).sum()) if slope.any() else 0.0
        side = f"{abs(lag):.2g} steps {'behind' if lag < 0 else 'ahead of'} {names[1]}"
        detail = f"{names[0]} is {side}: errors of first order in the step explain it"
        return log.finding(worst[0], *numbers, "inconclusive", detail)
    if np.count_nonzero(jumps.any(axis=1)) <= len(jumps) // MOST_JUMPS:
        return _jump(motion, log, names, check, rate, columns)
    allowed = check.allowed + check.first_order
    broken = broken if broken.any() else np.concatenate((jumps, jumps[-1:]))
    rows = np.flatnonzero(broken.any(axis=1))
    ratios = np.where(check.broken, check.error / np.maximum(allowed, np.finfo(float).tiny), 0.0)
    worst_row = int(rows[np.argmax(ratios[rows][:, columns].max(axis=1))])
    sides = [(k, rate[k], check.rates.value[k], allowed[k]) for k in _spread(rows, worst_row)]
    row, text = explained(sides, (coordinates,), names[0])
    entry = _worst(check.error[row : row + 1], allowed[row : row + 1], columns)[1]
    return log.finding(
        row,
        float(check.error[row, entry]),
        float(allowed[row, entry]),
        "failed",
        f"{text}; {motion.table.line_of(row)}; {len(rows)} of {len(rate)} rows differ",
        check.sides(names[0], coordinates, columns, rate, row),
    )


def _jump(
    motion: RecordedMotion,
    log: _LogFindings,
    names: tuple[str, str],
    check: RateCheck,
    rate: Array,
    columns: Sequence[int],
) -> Finding:
    """Return the Finding about columns that jump in a few steps, or of rates that do."""
    off = np.abs(check.step - check.explained)
    broken = check.broken[:, columns]
    if not check.jumps[:, columns].any():
        row, entry = _worst(check.error, check.allowed + check.first_order, columns)
        numbers = float(check.error[row, entry]), float(check.allowed[row, entry])
        count = int(broken.any(axis=1).sum())
        sides = check.sides(names[0], motion.scene.coordinate_names, columns, rate, row)
    else:
        steps = np.where(check.jumps, off, 0.0)[:, columns]
        row, k = (int(x) for x in np.unravel_index(int(np.argmax(steps)), steps.shape))
        entry, count = columns[k], int(check.jumps[:, columns].any(axis=1).sum())
        numbers = float(off[row, entry]), 0.0
        sides = ()
    name, place = motion.scene.coordinate_names[entry], motion.table.line_of(row + 1)
    change, by = (float(x[row, entry]) for x in (check.step, check.explained))
    sides = sides or (ComparedEntry(f"step of {names[1]}[{name}]", change, by, 0.0),)
    detail = f"{names[1]}[{name}] jumps to {place}: by {change:.6g}, {names[0]} explains {by:.6g}"
    return log.finding(row, *numbers, "failed", f"{detail}; {count} such steps", sides)


MOST_JUMPS = 10
"""One step in so many may be a jump of a coordinate; if more are, its rate is wrong."""

EXPLAINED_ROWS = 9
"""Number of rows from which the cause of a failure is concluded."""


def _spread(rows: Array, first: int) -> list[int]:
    """Return some rows, all over them, a given one first."""
    chosen = rows[np.linspace(0, len(rows) - 1, min(len(rows), EXPLAINED_ROWS)).astype(int)]
    return list(dict.fromkeys([first, *chosen.tolist()]))


def explained(
    sides: Sequence[tuple[int, Array, Array, Array]],
    names: tuple[tuple[str, ...], ...],
    subject: str,
    context: Callable[[int], ConfusionContext] = lambda row: ConfusionContext(),
) -> tuple[int, str]:
    """Return the row that shows the likely cause of a failure, and the cause.

    Args:
        sides: row, recorded array, expected array and allowed errors.
        names: names along each axis.
        subject: name of the array.
        context: function of a row that returns further arrays.
    """
    located = []
    for row, actual, expected, allowed in sides:
        with np.errstate(all="ignore"):
            ratio = np.nan_to_num(np.abs(actual - expected) / allowed)
        worst = tuple(int(i) for i in np.unravel_index(int(np.argmax(ratio)), actual.shape))
        agree = agreement_within(allowed)
        how: Any = {"context": context(row), "worst": worst, "agree": agree}
        located.append((row, locate(actual, expected, names, **how)))
    causes = [difference.what for _, difference in located if difference.what]
    shown = located[0]
    if causes:
        cause = max(dict.fromkeys(causes), key=causes.count)
        if causes.count(cause) > len(located) // 2:
            shown = next(x for x in located if x[1].what == cause)
    row, difference = shown
    where = f"{subject}, {difference.where}" if difference.where else subject
    unit = "" if difference.what else unit_of(sides)
    return row, f"{where}: {difference.text}" + (f"; {unit}" if unit else "")


def unit_of(sides: Sequence[tuple[int, Array, Array, Array]]) -> str:
    """Return the larger unit in which recorded arrays are, whose errors grow with it; "" if none.

    Args:
        sides: row, recorded array, expected array and allowed errors.
    """
    if not any((np.abs(expected) > 2.0 * allowed).any() for _, _, expected, allowed in sides):
        return ""
    for text, factor in UNITS.items():
        if factor > 1.0 and all(
            (np.abs(actual / factor - expected) <= allowed).all()
            for _, actual, expected, allowed in sides
        ):
            return text
    return ""


def _few(names: Sequence[str], which: Sequence[int]) -> str:
    return listed([names[k] for k in which], 4)


def _worst(error: Array, allowed: Array, columns: Sequence[int]) -> tuple[int, int]:
    """Return row and column of the largest ratio of errors among some columns."""
    columns = list(columns)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num(error[:, columns] / allowed[:, columns])
    row, k = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
    return int(row), columns[int(k)]


class _LogFindings(NamedTuple):
    """Maker of the Findings of a log about one subject."""

    motion: RecordedMotion
    subject: str

    def finding(
        self,
        row: int,
        observed: float,
        allowed: float,
        verdict: Verdict,
        detail: str = "",
        compared: tuple[ComparedEntry, ...] = (),
    ) -> Finding:
        """Return a Finding about a row, with the numbers of a failure that are compared."""
        motion, evidence = self.motion, f"compared: {self.motion.table.path.name}"
        about = LOG_CLAIM, self.subject, motion.scene, motion.state(row)
        return RecordedFinding(
            *about,
            *(observed, allowed, verdict, evidence, detail),
            path=motion.table.path,
            row=row,
            options=motion.options,
            compared=compared,
        )


# ---- Energy and constraints ----------------------------------------------------------------------


class Observed(NamedTuple):
    """Quantities of a scene along a motion.

    Attributes:
        energy: T + U (k,), J.
        kinetic: T (k,), J.
        power: power of the applied forces and of dampers (k,), W.
        size: size of the terms of the energy (k,), J.
        power_size: size of the terms of the power (k,), W.
        violation: a v + b (k, r), m/s, None without constraints.
        violation_size: size of its terms (k, r).
        momentum: |M v| (k, n), by which an error of v changes the energy.
        force: |Q| (k, n), by which an error of q changes the energy.
    """

    energy: Array
    kinetic: Array
    power: Array
    size: Array
    power_size: Array
    violation: Array | None
    violation_size: Array | None
    momentum: Array
    force: Array


def observe(motion: RecordedMotion) -> Observed:
    """Return the quantities of a scene along a motion, in batches of rows."""
    parts = [
        _observe(motion, slice(first, first + CHUNK)) for first in range(0, len(motion.t), CHUNK)
    ]
    joined: list[Any] = [
        None if x[0] is None else np.concatenate(x) for x in zip(*parts, strict=True)
    ]
    return Observed(*joined)


def _observe(motion: RecordedMotion, rows: slice) -> Observed:
    scene = motion.scene
    q, v, t, tau = (x[rows] for x in (motion.q, motion.v, motion.t, motion.tau))
    count = len(t)
    states = [State(*state) for state in zip(q, v, t.tolist(), strict=True)]
    at = BatchEvaluation([scene] * count, states)
    T, U = at.call(scene.energies, at.parameters, at.prepared, at.q, at.v)
    kinetic, potential = batch_data(T, count), 0.0 if U is None else batch_data(U, count)
    power = (tau * v).sum(axis=1)
    damping = at.dissipation(at.v)
    lost = 0.0 if damping is None else 2.0 * batch_data(damping, count)
    M = batch_data(at.terms.M, count)
    momentum = np.einsum("kij,kj->ki", M, v)
    terms = np.abs(np.einsum("ki,ki->k", np.abs(v), np.abs(momentum))) + np.abs(potential)
    violation = size = None
    if at.terms.a is not None:
        a = batch_data(at.terms.a, count)
        b = 0.0 if at.terms.b is None else batch_data(at.terms.b, count)
        violation = np.einsum("krn,kn->kr", a, v) + b
        size = np.einsum("krn,kn->kr", np.abs(a), np.abs(v)) + np.abs(b)
    force = 0.0 * v if at.terms.Q is None else np.abs(batch_data(at.terms.Q, count))
    return Observed(
        kinetic + potential,
        kinetic,
        power - lost,
        terms,
        np.abs(tau * v).sum(axis=1) + np.abs(lost),
        violation,
        size,
        np.abs(momentum),
        force,
    )


class EnergyCheck(NamedTuple):
    """Energy and work along a motion.

    Attributes:
        energy: change of the energy from the first row on (k,), J.
        work: work of applied forces and dampers (k,), J.
        error, allowed, first_order: of each step (k - 1,), J.
        step_work: work of each step (k - 1,), J.
    """

    energy: Array
    work: Array
    error: Array
    allowed: Array
    first_order: Array
    step_work: Array


def compare_energy(motion: RecordedMotion, seen: Observed) -> EnergyCheck:
    """Compare the change of the energy in each step with the work of the forces."""
    t, h = motion.t, np.diff(motion.t)
    power_error = (motion.tau_error * np.abs(motion.v)).sum(1) + (
        np.abs(motion.tau) * motion.v_error
    ).sum(1)
    power_error += allowed_error(1.0, motion.unit_roundoff) * seen.power_size
    slope = difference_rates(t, seen.power[:, None], power_error[:, None])
    bend, bend_error = slope.value[:, 0], slope.error[:, 0]
    correction = h**2 * np.diff(bend) / 12.0
    work = h * (seen.power[1:] + seen.power[:-1]) / 2.0 - correction
    # A method of second order exchanges kinetic and potential energy by the trapezoidal rule.
    kinetic = difference_rates(t, seen.kinetic[:, None], 0.0 * seen.kinetic[:, None]).value[:, 0]
    exchange = np.diff(seen.kinetic) - h * (kinetic[1:] + kinetic[:-1]) / 2.0
    truncation = largest_around(np.abs(correction) + np.abs(exchange))
    truncation += h**2 * (bend_error[1:] + bend_error[:-1]) / 12.0
    digits = (seen.momentum * motion.rounding("v") + seen.force * motion.rounding("q")).sum(1)
    digits += allowed_error(1.0, motion.unit_roundoff) * seen.size
    step = np.diff(seen.energy)
    allowed = truncation + digits[1:] + digits[:-1] + h * (power_error[1:] + power_error[:-1])
    allowed += np.abs(seen.power[1:]) * (motion.t_error[1:] + motion.t_error[:-1])
    # A method of first order errs by the change of the rates from one step to the next.
    parts = np.diff(seen.kinetic), np.diff(seen.energy - seen.kinetic), work
    changes = np.sum([np.abs(np.diff(x)) for x in parts], axis=0)
    for x, size in ((motion.v, seen.momentum), (motion.q, seen.force)):
        bends = np.diff(np.diff(x, axis=0) / h[:, None], axis=0) * h[1:, None]
        changes += (size[1:-1] * np.abs(bends)).sum(axis=1)
    first_order = largest_around(np.concatenate((changes[:1], changes)))
    total = np.concatenate(([0.0], np.cumsum(work)))
    return EnergyCheck(
        seen.energy - seen.energy[0], total, np.abs(step - work), allowed, first_order, work
    )


def energy_finding(motion: RecordedMotion, check: EnergyCheck) -> Finding:
    """Return the Finding about the work of the forces."""
    log = _LogFindings(motion, "energy against work")
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num(check.error / check.allowed)
        beyond = np.nan_to_num(check.error / (check.allowed + check.first_order))
    row = int(np.argmax(ratio))
    numbers = float(check.error[row]), float(check.allowed[row])
    if ratio[row] <= 1.0:
        change = np.abs(np.diff(check.energy)) + np.abs(check.step_work)
        if (check.allowed < change / 2.0).any() or not change.any():
            return log.finding(row, *numbers, "passed")
        detail = "the work of a step cannot be told with these digits and time steps"
        return log.finding(row, *numbers, "inconclusive", detail)
    if beyond.max() <= 1.0:
        drift = float(check.energy[-1] - check.work[-1])
        detail = f"energy is off by {drift:.3g} J at the end: errors of first order explain it"
        return log.finding(row, *numbers, "inconclusive", detail)
    rows = np.flatnonzero(beyond > 1.0)
    row = int(np.argmax(beyond))
    allowed = check.allowed + check.first_order
    change, done = np.diff(check.energy), check.step_work
    text = f"energy changes by {change[row]:.6g} J in a step, forces do {done[row]:.6g} J of work"
    for cause, term in (("without", 0.0 * done), ("with the wrong sign", -done)):
        right = np.abs(change - term) <= allowed
        if right.all() and (np.abs(done - term) > allowed).any():
            text += f": as if {cause}" + (" it" if cause == "without" else "")
    numbers = float(check.error[row]), float(allowed[row])
    place = f"{motion.table.line_of(row)}; {len(rows)} of {len(change)} steps differ"
    sides = float(change[row]), float(done[row]), numbers[1]
    energy = ComparedEntry("change of the energy in the step / J", *sides)
    return log.finding(row, *numbers, "failed", f"{text}; {place}", (energy,))


def constraint_findings(
    motion: RecordedMotion, seen: Observed
) -> tuple[list[Finding], list[str], Array]:
    """Return the Findings about constraints, notes on their drift, and the allowed (k, r)."""
    assert seen.violation is not None and seen.violation_size is not None
    names, h = motion.scene.constraint_names, np.diff(motion.t)
    u = motion.unit_roundoff
    relative = motion.rounding("v").max(axis=1) / np.maximum(
        np.abs(motion.v).max(axis=1), np.finfo(float).tiny
    )
    turned = motion.rounding("q").max(axis=1)
    allowed = seen.violation_size * (allowed_error(1.0, u) + relative + turned)[:, None]
    # In a step a constraint may change by as much as its terms do.
    change = np.abs(np.diff(seen.violation_size, axis=0))
    swing = np.abs(np.diff(motion.v, axis=0)).max(axis=1) / np.maximum(
        np.abs(motion.v[1:]).max(axis=1), np.finfo(float).tiny
    )
    change = np.maximum(change, seen.violation_size[1:] * swing[:, None])
    first_order = largest_around(np.concatenate((change[:1], change)))
    findings, notes = [], []
    size = np.abs(seen.violation)
    for j, name in enumerate(names):
        log = _LogFindings(motion, f"constraint {name}")
        row = int(np.argmax(size[:, j] / np.maximum(allowed[:, j], np.finfo(float).tiny)))
        numbers = float(size[row, j]), float(allowed[row, j])
        if numbers[0] <= numbers[1]:
            findings.append(log.finding(row, *numbers, "passed"))
            continue
        jump = np.abs(np.diff(seen.violation[:, j], prepend=0.0)) - allowed[:, j]
        at = int(np.argmax(jump - first_order[:, j]))
        if jump[at] > first_order[at, j]:
            what = "is violated from the first row on" if at == 0 else "jumps"
            detail = f"{name} {what}: {seen.violation[at, j]:.3g} m/s; {motion.table.line_of(at)}"
            numbers = float(size[at, j]), float(allowed[at, j])
            sides = float(seen.violation[at, j]), 0.0, numbers[1]
            row_of_a = (ComparedEntry(f"a v + b of {name} / (m/s)", *sides),)
            findings.append(log.finding(at, *numbers, "failed", detail, row_of_a))
            continue
        rate = float(size[-1, j] - size[0, j]) / float(h.sum())
        detail = (
            f"{name} drifts by {rate:.3g} m/s in 1 s, to {size[:, j].max():.3g} m/s: errors of "
            "the integrator explain it"
        )
        findings.append(log.finding(row, *numbers, "inconclusive", detail))
    return findings, notes, allowed


# ---- Charts --------------------------------------------------------------------------------------

MOST_POINTS = 1500
"""Largest number of points of a line."""


def _thinned(t: Array, x: Array) -> tuple[list[float], list[float]]:
    """Return a line with few points: the largest of as many rows as one point stands for."""
    every = -(-len(t) // MOST_POINTS)
    if every == 1:
        return t.tolist(), x.tolist()
    starts = np.arange(0, len(t), every)
    return t[starts].tolist(), np.maximum.reduceat(x, starts).tolist()


def error_panel(title: str, unit: str, t: Array, error: Array, allowed: Array) -> Panel:
    """Return a panel of the largest errors (k, n) of rows, beside the allowed ones."""
    least = np.finfo(float).tiny
    errors = _thinned(t, np.maximum(error.max(axis=1), least))
    bounds = _thinned(t, np.maximum(allowed.max(axis=1), least))
    lines = [Line("error", *errors), Line("allowed", *bounds, appearance="dotted")]
    floor = min((y for line in lines for y in line.y if float(y) > 1e-30), default=1.0)
    shown = [line._replace(y=[y if float(y) > 1e-30 else np.nan for y in line.y]) for line in lines]
    bounds = (float(floor) / 3.0, None)
    return Panel(Axis("t / s"), Axis(unit, log=True, range=bounds, own=True), shown, title)


def energy_panel(t: Array, check: EnergyCheck) -> Panel:
    """Return a panel of the change of the energy and of the work."""
    lines = [
        Line(key, *_thinned(t, x), appearance="line")
        for key, x in (("energy", check.energy), ("work", check.work))
    ]
    return Panel(Axis("t / s"), Axis("change / J", own=True), lines, "energy and work")


def log_chart(name: str, panels: Iterable[Panel]) -> Chart:
    """Return the chart of a log."""
    shown = {(panel.title,): panel for panel in panels}
    keys = [*shown]
    grid = [keys[k : k + 2] for k in range(0, len(keys), 2)]
    return Chart(name, f"Log {name}", ["part"], shown, grid=grid, height=2.1)


# ---- Equations of motion -------------------------------------------------------------------------

JUDGED_IN_LOG = 40
"""Number of rows whose bounds are measured: those with the largest errors, and others between."""


class EquationsCheck(NamedTuple):
    """Applied forces of a motion, and those that its accelerations need.

    Attributes:
        expected: forces (k, n) at all rows.
        error: their errors (k, n).
        first_order: changes (k, n) of the forces within a step; of M a too, if accelerations are
            differences of v, which lie half a step beside those of many integrators.
        judged: row -> the row with its allowed errors, of some rows.
        inertia: |M a| (n,) of these rows: without applied forces it shows what is resolved.
    """

    expected: Array
    error: Array
    first_order: Array
    judged: dict[int, JudgedRow]
    inertia: dict[int, Array]


def _rows_at(motion: RecordedMotion, a: Array, rows: Array, state: int = 0) -> list[RecordedRow]:
    """Return rows whose forces and accelerations belong to the state so many rows behind them."""
    return [
        RecordedRow(k, motion.tau[k], motion.state(k + state), a[k], motion.tau[k], motion.v[k])
        for k in rows.tolist()
    ]


def _expected_forces(motion: RecordedMotion, a: Array, rows: Array, state: int = 0) -> Array:
    """Return the forces (k, n) that rows need, in batches."""
    parts = []
    for first in range(0, len(rows), CHUNK):
        some = _rows_at(motion, a, rows[first : first + CHUNK], state)
        point = batch_point(some, motion.scene)
        parts.append(batch_data(EQUATIONS.value(point, ""), len(some)))
    return np.concatenate(parts)


def _force_error(motion: RecordedMotion, a: Array, a_error: Array, row: int) -> Array:
    """Return the errors (n,) of needed forces by the digits of the state and of accelerations."""
    q, v, n = motion.q[row], motion.v[row], motion.scene.n
    errors = motion.q_error[row], motion.v_error[row], a_error[row]
    total = motion.tau_error[row].copy()
    if not np.any(errors):
        return total
    shifts = [(part, j) for part in range(3) for j in range(n) if errors[part][j]]
    rows = [_rows_at(motion, a, np.array([row]))[0]]
    for part, j in shifts:
        for sign in (1.0, -1.0):
            state = [q.copy(), v.copy(), a[row].copy()]
            state[part][j] += sign * errors[part][j]
            at = State(state[0], state[1], float(motion.t[row]))
            rows.append(rows[0]._replace(state=at, vdot=state[2]))
    point = batch_point(rows, motion.scene)
    values = batch_data(EQUATIONS.value(point, ""), len(rows))
    changes = np.abs(values[1:] - values[0]).reshape(len(shifts), 2, n)
    return total + changes.max(axis=1).sum(axis=0)


def compare_equations(
    motion: RecordedMotion, a: Array, a_error: Array, differences: bool = False
) -> tuple[EquationsCheck, AnswerColumns]:
    """Compare applied forces with those that accelerations need; some rows with their bounds.

    Args:
        motion: the motion.
        a, a_error: accelerations (k, n) and their errors.
        differences: whether they are differences of v.
    """
    count, n = motion.q.shape
    rows = np.arange(count)
    expected = _expected_forces(motion, a, rows)
    error = np.abs(motion.tau - expected)
    changes = np.abs(np.diff(expected, axis=0))
    if differences:
        later = _expected_forces(motion, np.roll(a, -1, axis=0), rows[:-1])
        changes = np.maximum(changes, np.abs(later - expected[:-1]))
    first_order = largest_around(_on_rows(changes), 1)
    size = np.abs(expected).max(axis=1, initial=0.0)[:, None]
    noise = motion.tau_error + allowed_error(1.0, motion.unit_roundoff) * size
    least = np.finfo(float).tiny
    chosen = set(np.linspace(0, count - 1, min(count, JUDGED_IN_LOG // 2)).astype(int).tolist())
    for bound in (noise, noise + first_order):
        ratio = (error / (bound + least)).max(axis=1)
        chosen |= set(np.argsort(-ratio)[: JUDGED_IN_LOG // 2].tolist())
    names = motion.scene.coordinate_names
    entries = tuple(range(n))
    columns = AnswerColumns(EQUATIONS, "", (n,), (names,), entries, entries, EXACT, EQUATIONS)
    group = ScreenedGroup(columns, motion.scene, motion.unit_roundoff)
    layout = TableLayout({}, None, ())
    some = np.array(sorted(chosen))
    sizes = np.abs(expected[some] - _expected_forces(motion, np.zeros_like(a), some))
    judged, inertia = {}, dict(zip(some.tolist(), sizes, strict=True))
    for k in inertia:
        before = _rows_at(motion, a, np.array([k - 1]))[0] if k else None
        one = judge_row(group, _rows_at(motion, a, np.array([k]))[0], before, layout)
        allowed = one.allowed + _force_error(motion, a, a_error, k)
        resolved = np.maximum(np.abs(one.expected), inertia[k]) > 2.0 * allowed
        judged[k] = one._replace(allowed=allowed, resolved=resolved)
    return EquationsCheck(expected, error, first_order, judged, inertia), columns


def _row_alignment(
    motion: RecordedMotion, a: Array, check: EquationsCheck, stage: bool = False
) -> str:
    """Return how forces or accelerations lie beside the state, by rows; "" if they do not.

    Args:
        motion: the motion.
        a: accelerations (k, n).
        check: the comparison of forces.
        stage: allow errors of second order too, as those of a Runge-Kutta method, whose last stage
            is at an estimate of the next state, and whose mean is that of a step.
    """
    count = len(motion.t)
    rows = np.array([k for k in check.judged if 0 < k < count - 1], dtype=int)
    if not len(rows):
        return ""
    allowed = np.max([one.allowed for one in check.judged.values()], axis=0)
    if stage:
        rest = _expected_forces(motion, 0.0 * a, np.arange(count))
        parts = rest, check.expected - rest
        bends = np.sum([np.abs(np.diff(x, 2, axis=0)) for x in parts], axis=0)
        allowed = allowed + largest_around(np.concatenate((bends[:1], bends, bends[-1:])))[rows]
    for shift, text in ((-1, "the row before"), (1, "the row behind")):
        beside = rows + shift
        expected = {
            "a and tau are those of the state of": _expected_forces(motion, a, rows, shift),
            "tau are those of": check.expected[beside],
            "a are those of": _expected_forces(motion, np.roll(a, shift, axis=0), rows),
        }
        if stage:
            here = _expected_forces(motion, a, rows)
            mean = (here + expected["a and tau are those of the state of"]) / 2.0
            expected["a and tau are means of the step to the state of"] = mean
        for what, needed in expected.items():
            if (np.abs(motion.tau[rows] - needed) <= allowed).all():
                return f"{what} {text}"
    return ""


def equations_findings(
    motion: RecordedMotion, check: EquationsCheck, columns: AnswerColumns, a: Array
) -> tuple[list[Finding], list[str]]:
    """Return the Findings about the equations of motion, and notes."""
    log = _LogFindings(motion, "equations of motion")
    judged = check.judged
    worst = max(judged, key=lambda k: float(judged[k].ratios.max()))
    at = judged[worst].worst
    numbers = float(judged[worst].errors[at]), float(judged[worst].allowed[at])
    if not judged[worst].fails:
        resolved = np.any([one.resolved for one in judged.values()], axis=0)
        sizes = {k: np.maximum(np.abs(x.expected), check.inertia[k]) for k, x in judged.items()}
        moves = np.any([sizes[k] > one.own for k, one in judged.items()], axis=0)
        hidden = [j for j in range(motion.scene.n) if moves[j] and not resolved[j]]
        findings = []
        if len(hidden) < motion.scene.n:
            findings.append(log.finding(worst, *numbers, "passed"))
        if hidden:
            names = _few(motion.scene.coordinate_names, hidden)
            detail = f"{names} cannot be told with these digits and time steps"
            findings.append(log.finding(worst, *numbers, "inconclusive", detail))
        return findings, []
    if text := _row_alignment(motion, a, check):
        return [log.finding(worst, 0.0, numbers[1], "passed")], [f"{text}: one step beside"]
    wider = {
        k: one._replace(allowed=one.allowed + check.first_order[k]) for k, one in judged.items()
    }
    failing = [one for one in wider.values() if one.fails]
    if not failing:
        detail = "forces are off by no more than they change in a step: of first order"
        return [log.finding(worst, *numbers, "inconclusive", detail)], []
    if text := _row_alignment(motion, a, check, stage=True):
        detail = f"{text}, up to errors of second order in the step"
        return [log.finding(worst, *numbers, "inconclusive", detail)], []
    failing.sort(key=lambda one: -float(one.ratios.max()))
    layout = TableLayout({}, None, ())
    shown, text = explain_failure(failing[0], failing, columns, motion.scene, layout)
    row, at = shown.row.number, shown.worst
    numbers = float(shown.errors[at]), float(shown.allowed[at])
    allowed = check.first_order + np.max([one.allowed for one in judged.values()], axis=0)
    many = max(len(failing), int((check.error > allowed).any(axis=1).sum()))
    text = text.replace("equations_of_motion, ", "tau, ")
    if ", expected " in text and "; as " not in text:
        sides = [(0, one.actual, one.expected, one.allowed) for one in failing[:EXPLAINED_ROWS]]
        text += "".join(f"; {unit}" for unit in [unit_of(sides)] if unit)
    place = f"{motion.table.line_of(row)}; {many} of {len(motion.t)} rows differ"
    columns_of = [f"tau[{name}]" for name in motion.scene.coordinate_names]
    sides = compared_entries(columns_of, shown.actual, shown.expected, shown.allowed)
    return [log.finding(row, *numbers, "failed", f"{text}; {place}", sides)], []


# ---- Logs ----------------------------------------------------------------------------------------


def is_log(table: RecordedTable, scene: Scene) -> bool:
    """Return whether a table is a log: it has times, and states alone would need none.

    States of a scene whose equations depend on time have times too; a log of it has columns a.
    """
    names = [name.strip() for name in table.names]
    if "t" not in names:
        return False
    return not scene.depends_on_time or any(name.startswith(("a[", "qdd[")) for name in names)


class _Reader:
    """Reader of the motion in a log, beside the quantities that are screened."""

    def __init__(
        self,
        table: RecordedTable,
        layout: TableLayout,
        scene: Scene,
        options: Mapping[str, str | None],
    ):
        self.table, self.layout, self.scene, self.options = table, layout, scene, options
        self.rows: list[tuple[Array, ...]] = []
        self.errors: list[tuple[Array, ...]] = []

    def chunks(self) -> Iterator[list[RecordedRow]]:
        """Yield the rows in chunks, and keep their motion."""
        for rows in chunks_of_rows(self.table, self.layout, self.scene):
            values = np.array([row.values for row in rows])
            q, v, t = (np.array(x) for x in zip(*(row.state for row in rows), strict=True))
            vdot, force = (np.array([getattr(x, y) for x in rows]) for y in ("vdot", "force"))
            self.rows.append((t, q, v, vdot, force))
            self.errors.append(self._errors(values, q, v))
            yield rows

    def _errors(self, values: Array, q: Array, v: Array) -> tuple[Array, ...]:
        """Return the errors of t, q, v, v̇ and forces by their digits."""
        layout, digits, n = self.layout, self.table.digits, self.scene.n

        def of(columns: Sequence[int]) -> Array:
            each = [digits[k].error_of(values[:, k]) for k in columns]
            return np.column_stack(each) if each else np.zeros((len(values), 0))

        parts = {name: np.zeros((len(values), n)) for name in ("q", "v", "vdot", "force")}
        for name, columns in layout.inputs.items():
            parts[name][:, n - len(columns) :] = of(columns)
        if layout.convention is not None:
            base = {name: of(columns) for name, columns in layout.base.items()}
            for k in range(len(values)):
                row = {name: x[k] for name, x in base.items()}
                forces = parts["force"][k, :FREE].copy()
                mapped = base_errors(layout.convention, q[k], v[k], row, forces)
                for name, error in zip(parts, mapped, strict=True):
                    parts[name][k, :FREE] = error
        time = of([] if layout.time is None else [layout.time])
        return time.sum(axis=1), *parts.values()

    def motion(self) -> RecordedMotion:
        """Return the motion that was read."""
        t, q, v, vdot, force = (np.concatenate(x) for x in zip(*self.rows, strict=True))
        joined = (np.concatenate(x) for x in zip(*self.errors, strict=True))
        t_error, q_error, v_error, a_error, tau_error = joined
        if len(t) > 1 and on_a_grid(t):
            t_error = 0.0 * t_error
        a = vdot if "vdot" in self.layout.inputs else None
        if self.layout.convention is not None and "vdot" not in self.layout.base:
            a = None
        end = self.layout.unit_roundoff, self.options
        errors = t_error, q_error, v_error, a_error, tau_error
        return RecordedMotion(self.table, self.scene, t, q, v, a, force, *errors, *end)


def check_recorded(
    path: Path, scene: Scene, base: str | None = None, precision: str | None = None
) -> tuple[list[Finding], list[str], Chart | None]:
    """Return the Findings about a recorded table, notes on it, and the chart of a log.

    Args:
        path: file with recorded answers, or with a log.
        scene: the scene that it is about.
        base: see `eomcheck.lab.recorded_answers.check_answers`.
        precision: see there too.

    Returns:
        Findings, sentences, and a chart of errors over time, None for answers.

    Raises:
        InputError: the table cannot be read, has no column that is needed, or the times of a log
            do not increase.
        UnknownNameError: no such quantity or link.
    """
    table = open_table(path)
    if not is_log(table, scene):
        return *check_answers(path, scene, base, precision), None
    layout = table_layout(table, scene, base, precision, log=True)
    groups = [ScreenedGroup(x, scene, layout.unit_roundoff) for x in layout.answers]
    options = {"base": base, "precision": precision}
    reader = _Reader(table, layout, scene, options)
    screen_rows(reader.chunks(), groups, scene)
    findings, notes, chart = check_motion(reader.motion(), "force" in layout.inputs)
    if any(one.verdict == "failed" for one in findings):
        notes += _other_twist(table, layout, scene)
    findings += [x for group in groups for x in judge_group(group, scene, table, layout, options)]
    return findings, notes, chart


def compared_row(
    path: Path,
    scene: Scene,
    subject: str,
    row: int,
    base: str | None = None,
    precision: str | None = None,
) -> ComparedRow:
    """Return one row of a recorded table beside the values that are expected there.

    Of a log the numbers that fail are computed again, of the whole motion.

    Args:
        path: file with recorded answers, or with a log.
        scene: the scene that it is about.
        subject: subject of a Finding, such as "bias", "M" or "v against q".
        row: index of the row.
        base: see `check_recorded`.
        precision: see there too.

    Raises:
        InputError: there is no such row, or no such failure of a log there; see `check_recorded`.
    """
    table = open_table(path)
    log = is_log(table, scene)
    layout = table_layout(table, scene, base, precision, log=log)
    for columns in layout.answers:
        if columns.subject == subject:
            return compared_answers(table, layout, scene, columns, row)
    for one in check_recorded(path, scene, base, precision)[0] if log else ():
        if isinstance(one, RecordedFinding) and (one.subject, one.row) == (subject, row):
            assert one.state is not None
            return ComparedRow(table.line_of(row), one.state, one.compared)
    raise InputError(f"subject = {subject!r}: nothing in row {row} of {str(path)!r} is about it")


def _other_twist(table: RecordedTable, layout: TableLayout, scene: Scene) -> Iterator[str]:
    """Yield that the twist of a free base is the rate of its pose in another convention."""
    if layout.convention is None:
        return
    for text, convention in {text_of(layout.convention): layout.convention, **CONVENTIONS}.items():
        reader = _Reader(table, layout._replace(convention=convention), scene, {})
        next(reader.chunks())
        motion = reader.motion()
        q, _ = unwrapped(motion.t, motion.q, motion.v)
        t, x, v = motion.rounding("t"), motion.rounding("q"), motion.rounding("v")
        alignments = compare_rate(motion.t, t, q, x, motion.v, v).alignments[:FREE]
        if all(one is not None for one in alignments):
            if convention != layout.convention:
                yield f"base: v is the rate of q with a twist of {text}"
            return


def check_motion(
    motion: RecordedMotion, forced: bool = True
) -> tuple[list[Finding], list[str], Chart]:
    """Return the Findings about a motion, notes on it, and a chart of its errors over time.

    Args:
        motion: the motion.
        forced: whether it has columns of applied forces.

    Raises:
        InputError: there are too few rows, or times do not increase.
    """
    scene, t, t_error = motion.scene, motion.t, motion.rounding("t")
    notes = [f"log of {len(t)} rows, {motion.t[-1] - motion.t[0]:.6g} s"]
    notes += check_times(motion.table, t, motion.t_error)
    if not forced:
        notes.append("no columns tau: no forces are applied")
    q, turns = unwrapped(t, motion.q, motion.v)
    for j in np.flatnonzero(turns).tolist():
        notes.append(f"q[{scene.coordinate_names[j]}] is wrapped by 2π {turns[j]} times")
    motion = motion._replace(q=q)
    rounding = {name: motion.rounding(name) for name in ("q", "v")}
    speeds = compare_rate(t, t_error, q, rounding["q"], motion.v, rounding["v"])
    findings, more = rate_findings(motion, ("v", "q"), speeds, motion.v)
    notes += more
    allowed = speeds.allowed + speeds.first_order
    panels = [error_panel("v against q", "error / (rad/s, m/s)", t, speeds.error, allowed)]
    a, a_error = motion.a, motion.a_error
    differences, of_a = a is None, []
    if a is None:
        rates = difference_rates(t, motion.v, rounding["v"])
        a, a_error = rates.value, rates.error
        notes.append("no columns a: accelerations are differences of v")
    else:
        sides = motion.v, rounding["v"], a, motion.rounding("a")
        accelerations = compare_rate(t, t_error, *sides)
        if None in accelerations.alignments:
            # Where v is whole steps beside, a row has not the state from which its step goes.
            beside = 0 if speeds.common is None else int(speeds.common.half_steps / 2)
            implicit = None if beside else implicit_alignment(motion, a, motion.rounding("a"))
            if implicit is not None:
                accelerations = accelerations._replace(alignments=(implicit,) * scene.n)
        of_a, more = rate_findings(motion, ("a", "v"), accelerations, a)
        notes += more
        allowed = accelerations.allowed + accelerations.first_order
        title = "a against v", "error / (rad/s², m/s²)"
        panels.append(error_panel(*title, t, accelerations.error, allowed))
    motion, a, a_error = _with_v_of_its_row(motion, a, a_error, speeds.common)
    t = motion.t
    equations, columns = compare_equations(motion, a, a_error, differences)
    more_findings, more = equations_findings(motion, equations, columns, a)
    # Implicit steps are recognized by the equations: where these fail, they come first.
    first = any(one.verdict == "failed" for one in more_findings)
    findings += [*more_findings, *of_a] if first else [*of_a, *more_findings]
    notes += more
    known = np.max([largest(one.allowed) for one in equations.judged.values()])
    allowed = known + equations.first_order
    panels.append(
        error_panel("equations of motion", "error / (N m, N)", t, equations.error, allowed)
    )
    seen = observe(motion)
    if not scene.depends_on_time:
        energy = compare_energy(motion, seen)
        findings.append(energy_finding(motion, energy))
        panels.append(energy_panel(t, energy))
    if seen.violation is not None:
        more_findings, more, allowed = constraint_findings(motion, seen)
        findings, notes = findings + more_findings, notes + more
        panels.append(
            error_panel("constraints", "a v + b / (m/s)", t, np.abs(seen.violation), allowed)
        )
    return findings, notes, log_chart(motion.table.path.stem, panels)


def _with_v_of_its_row(
    motion: RecordedMotion, a: Array, a_error: Array, alignment: Alignment | None
) -> tuple[RecordedMotion, Array, Array]:
    """Return a motion, and accelerations, whose velocities are not whole steps beside the rows."""
    steps = 0 if alignment is None else int(alignment.half_steps / 2)
    if not steps:
        return motion, a, a_error
    count = len(motion.t)
    rows = np.arange(max(0, steps), count + min(0, steps))
    parts = {
        name: getattr(motion, name)[rows]
        for name in ("t", "q", "tau", "t_error", "q_error", "a_error", "tau_error")
    }
    v, v_error = motion.v[rows - steps], motion.v_error[rows - steps]
    shifted = motion._replace(**parts, v=v, v_error=v_error, a=None)
    return shifted, a[rows], a_error[rows]

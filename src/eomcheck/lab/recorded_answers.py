"""Recorded answers: quantities that another program computed at given states, checked from a file.

A row has a state, columns q[...] and v[...], and v̇ in vdot[...] and forces in force[...] where a
quantity depends on them; all other columns are answers. Every row is screened in float64. Of each
quantity the rows with the largest errors are judged: the allowed error is half a unit of the last
printed digit and our own rounding error. A failure is explained by the confusions of conventions
that are recognized in any array, or by a state that the program understood otherwise.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import islice, permutations, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims.confusions import ConfusionContext, Difference, agreement_within, locate
from eomcheck.claims.engine_quantities import compared_value, context_of, own_value
from eomcheck.claims.finding import Finding, entry_name
from eomcheck.draws.pairwise_design import state_cases, with_wide
from eomcheck.errors import InputError, RefusedError, UnknownNameError
from eomcheck.evaluation.conformance import QUANTITIES, ConformancePoint, Quantity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.lab.recorded_table import (
    ColumnName,
    Digits,
    RecordedTable,
    index_in,
    most_digits,
    open_table,
    parse_name,
    write_table,
)
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import EPS, Array
from eomcheck.safe_output import counted

TINY = float(np.finfo(np.float64).tiny)

CLAIM = "recorded-answers"
"""Id of the claim: recorded answers are those of the scene, to their printed digits."""

INPUTS = {"q": "coordinates", "v": "velocities", "vdot": "accelerations", "force": "forces"}
"""Name of the columns of a state -> what they hold."""

MOST_JUDGED = 1000
"""Number of rows of a quantity with the largest errors, which are judged with their bounds."""

EXPLAINED = 5
"""Number of failing rows that an explanation has to agree with."""

MOST_ORDERS = 120
"""Number of orders of joints that are tried."""

MASS_MATRIX = Quantity(
    *("mass_matrix", "M", ("q",), ("n", "n"), "matrix", "kg, kg m²", "mass matrix"),
    lambda point, frame: point.at.terms.M,
    needs_tree=False,
)
BIAS = Quantity(
    *("bias", "B", ("q", "v"), ("n",), "force", "N, N m", "Coriolis and centrifugal forces"),
    lambda point, frame: point.bias,
    needs_tree=False,
)
ANSWERS: dict[str, Quantity] = {one.name: one for one in (MASS_MATRIX, BIAS)} | QUANTITIES
"""Name of a quantity -> the quantity."""

SHORT_NAMES = {
    "M": "mass_matrix",
    "tau": "inverse_dynamics",
    "qdd": "forward_dynamics",
    "C": "coriolis_matrix",
    "T": "kinetic_energy",
    "U": "potential_energy",
    "com": "center_of_mass",
    "com_jacobian": "center_of_mass_jacobian",
    "com_velocity": "center_of_mass_velocity",
    "com_acceleration": "center_of_mass_acceleration",
    "J": "frame_jacobian",
}
"""Short name of a column -> name of the quantity, as `check_functions` calls its arguments."""


def _base_axes() -> dict[str, Array]:
    """Return text -> matrix that gives the axes of a base in other orders and directions."""
    axes = {}
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            R = np.diag(signs) @ np.eye(3)[list(order)]
            names = ", ".join(
                f"{'-' if sign < 0 else ''}{'xyz'[k]}" for sign, k in zip(signs, order, strict=True)
            )
            if not np.array_equal(R, np.eye(3)) and np.linalg.det(R) > 0.0:
                axes[f"along other axes of the base: {names}"] = R
    return axes | {"x and y exchanged": np.eye(3)[[1, 0, 2]]}


BASE_AXES = _base_axes()
"""Text -> rotation to the axes that another program may have for the base."""


# ---- States --------------------------------------------------------------------------------------


def write_states(scene: Scene, path: Path, examples: int, seed: int = 0) -> None:
    """Write random states of a scene as a table: q, v and an acceleration v̇.

    The first is its initial state; of the others every second one is wide: turned by many turns, or
    slow or fast. They satisfy the constraints.

    Args:
        scene: the scene.
        path: file to write, see `eomcheck.lab.recorded_table.write_table`.
        examples: number of states.
        seed: seed of the draws.

    Raises:
        InputError: the file cannot be written, or no position satisfies the loop closure.
    """
    first = scene.initial_state()
    drawn = with_wide(state_cases(scene, examples, seed), seed) if examples > 1 else iter(())
    states = [State(*first, 0.0), *(state for _, state in islice(drawn, examples - 1))]
    q, v = (np.array([state[k] for state in states]) for k in (0, 1))
    vdot = np.random.default_rng([abs(seed), 2]).uniform(-1.0, 1.0, q.shape)
    columns = {
        f"{name}[{coordinate}]": values[:, k]
        for name, values in (("q", q), ("v", v), ("vdot", vdot))
        for k, coordinate in enumerate(scene.coordinate_names)
    }
    if scene.depends_on_time:
        columns["t"] = np.array([state.t for state in states])
    write_table(path, columns)


# ---- Columns -------------------------------------------------------------------------------------


class AnswerColumns(NamedTuple):
    """Columns of a table that hold one quantity.

    Attributes:
        quantity: the quantity.
        frame: name of its link, "" for a quantity of none.
        shape: shape of the quantity.
        names: names along each axis.
        columns: index of each column.
        entries: index in the quantity of each column, raveled.
        digits: printed digits, the most of any column: one that holds 0 and 1 alone shows few.
    """

    quantity: Quantity
    frame: str
    shape: tuple[int, ...]
    names: tuple[tuple[str, ...], ...]
    columns: tuple[int, ...]
    entries: tuple[int, ...]
    digits: Digits

    @property
    def subject(self) -> str:
        """Name for messages: the symbol, and the link."""
        symbol = {"mass_matrix": "M", "bias": "bias"}.get(self.quantity.name, self.quantity.name)
        return f"{symbol}, {self.frame}" if self.frame else symbol

    @property
    def is_whole(self) -> bool:
        """Whether all entries are there."""
        return len(self.entries) == int(np.prod(self.shape, initial=1))


class TableLayout(NamedTuple):
    """Columns of a table by their meaning.

    Attributes:
        inputs: name of an input -> index of the column of each coordinate.
        time: index of the column t, or None.
        answers: columns of the answers, quantity by quantity.
    """

    inputs: dict[str, tuple[int, ...]]
    time: int | None
    answers: tuple[AnswerColumns, ...]


def table_layout(table: RecordedTable, scene: Scene) -> TableLayout:
    """Return the meaning of the columns of a table.

    Raises:
        InputError: a column of the state is missing, or there is no answer; a name that is no
            column of anything; a quantity that the scene has not.
        UnknownNameError: no such quantity or link.
    """
    point = ConformancePoint(Evaluation(scene, *scene.initial_state()))
    inputs: dict[str, dict[int, int]] = {name: {} for name in INPUTS}
    answers: dict[tuple[str, str], dict[int, int]] = {}
    kinds: dict[tuple[str, str], tuple[Any, ...]] = {}
    time = None
    for k, text in enumerate(table.names):
        name = parse_name(text)
        if name is None:
            raise InputError(
                f"column {text!r} is no name such as q[elbow], M[0;1] or kinetic_energy"
            )
        if name == ColumnName("t", ()):
            time = k
            continue
        if name.quantity in INPUTS:
            (j,) = index_in(_only(name, text), [scene.coordinate_names], text)
            _add(inputs[name.quantity], j, k, table)
            continue
        one = _quantity_named(name.quantity, text)
        if what := one.lacks(point):
            raise InputError(f"column {text!r}: {scene.name} {what}")
        frame, entry = _frame_and_entry(one, name, point, text)
        key = one.name, frame
        if key not in kinds:
            value = np.asarray(one.value(point, frame))
            kinds[key] = value.shape, one.axis_names(point)[: value.ndim]
            answers[key] = {}
        shape, names = kinds[key]
        index = index_in(entry, names, text)
        _add(answers[key], int(np.ravel_multi_index(index, shape)) if shape else 0, k, table)
    groups = tuple(
        AnswerColumns(
            ANSWERS[key[0]],
            key[1],
            kinds[key][0],
            kinds[key][1],
            tuple(entries.values()),
            tuple(entries),
            most_digits(table.digits[k] for k in entries.values()),
        )
        for key, entries in answers.items()
    )
    if not groups:
        raise InputError(f"{str(table.path)!r} has no answers: columns such as M[0;1] or bias[0]")
    needed = {"q"} | {x for group in groups for x in _needs(group.quantity)}
    for name in needed if "force" not in needed else needed - {"force"}:
        for j, coordinate in enumerate(scene.coordinate_names):
            if j not in inputs[name]:
                raise InputError(f"{str(table.path)!r} has no column {name}[{coordinate}]")
    n = scene.n
    given = {name: tuple(x[j] for j in range(n)) for name, x in inputs.items() if len(x) == n}
    return TableLayout(given, time, groups)


def _needs(one: Quantity) -> Iterator[str]:
    """Yield the inputs on which a quantity depends."""
    names = {"q": "q", "v": "v", "vdot": "vdot", "tau": "force"}
    yield from (names[x] for x in one.arguments if x in names)


def _add(entries: dict[int, int], entry: int, column: int, table: RecordedTable) -> None:
    if entry in entries:
        names = table.names[entries[entry]], table.names[column]
        raise InputError(f"columns {names[0]!r} and {names[1]!r} are the same entry")
    entries[entry] = column


def _only(name: ColumnName, text: str) -> str:
    if len(name.brackets) != 1:
        raise InputError(f"column {text!r}: expected one index in brackets")
    return name.brackets[0]


def _quantity_named(name: str, text: str) -> Quantity:
    known = {**{x: x for x in ANSWERS}, **SHORT_NAMES}
    if name not in known:
        raise UnknownNameError("column", text, [*INPUTS, "t", *known])
    if known[name] == "coriolis_matrix":
        raise InputError(f"column {text!r}: a Coriolis matrix is not unique, expected bias, C v")
    return ANSWERS[known[name]]


def _frame_and_entry(
    one: Quantity, name: ColumnName, point: ConformancePoint, text: str
) -> tuple[str, str]:
    """Return the name of the link and the text of the indices of a column."""
    brackets = list(name.brackets)
    frame = ""
    if one.of_frame:
        if not brackets:
            raise InputError(f"column {text!r}: expected the name of a link in brackets first")
        frame = brackets.pop(0)
        if frame not in point.model.links:
            raise UnknownNameError("link", frame, point.model.links)
    if len(brackets) > 1:
        raise InputError(f"column {text!r} has more brackets than indices")
    return frame, brackets[0] if brackets else ""


# ---- Screening -----------------------------------------------------------------------------------


class RecordedRow(NamedTuple):
    """A row of a table.

    Attributes:
        number: its index in the table.
        values: its numbers.
        state: its state.
        vdot: its accelerations (n,).
        force: its applied forces (n,).
    """

    number: int
    values: Array
    state: State
    vdot: Array
    force: Array

    def point(self, scene: Scene, change: Callable[[Array, Array], Any] | None = None) -> Any:
        """Return the point at its state, or at a changed one."""
        q, v, t = self.state
        if change is not None:
            q, v = change(q, v)
        return ConformancePoint(Evaluation(scene, q, v, t), self.vdot, tau=self.force)


def _rows(table: RecordedTable, layout: TableLayout, scene: Scene) -> Iterator[RecordedRow]:
    """Yield all rows of a table."""
    none = np.zeros(scene.n)
    for first, values in table.chunks():
        for k, row in enumerate(values):
            q, v, vdot, force = (
                row[list(layout.inputs[name])] if name in layout.inputs else none for name in INPUTS
            )
            t = 0.0 if layout.time is None else float(row[layout.time])
            state = *np.concatenate((q, v, vdot, force)), t
            if not np.isfinite(state).all():
                place = table.line_of(first + k)
                raise InputError(f"{str(table.path)!r}, {place}: the state has no finite numbers")
            yield RecordedRow(first + k, row, State(q, v, t), vdot, force)


class _Screened(NamedTuple):
    """A row with its largest error, and the row before it."""

    ratio: float
    number: int
    row: RecordedRow
    before: RecordedRow | None


class _Group:
    """Rows of one quantity: those with the largest errors, and counts.

    Args:
        columns: its columns.
    """

    def __init__(self, columns: AnswerColumns):
        self.columns = columns
        self.worst: list[_Screened] = []
        self.broken: list[RecordedRow] = []
        self.rows = 0
        self.offset = 0.0
        self._index, self._entries = list(columns.columns), list(columns.entries)

    def add(
        self, row: RecordedRow, point: ConformancePoint, before: RecordedRow | None = None
    ) -> None:
        """Add a row, with the point at its state, and the row before it."""
        self.rows += 1
        actual = row.values[self._index]
        if not np.isfinite(actual).all():
            self.broken.append(row)
            return
        ours = np.ravel(self.columns.quantity.value(point, self.columns.frame))
        expected = ours[self._entries]
        if self.columns.quantity.name == "potential_energy" and self.rows == 1:
            self.offset = float(actual[0] - expected[0])
        error = np.abs(actual - self.offset - expected)
        size = largest(ours)
        with np.errstate(over="ignore"):
            ratio = float(np.max(error / (self.printed(actual) + EPS * size + TINY)))
        heapq.heappush(self.worst, _Screened(ratio, row.number, row, before))
        if len(self.worst) > MOST_JUDGED:
            heapq.heappop(self.worst)

    def printed(self, actual: Array) -> Array:
        """Return the largest error of printed numbers, one per column."""
        return self.columns.digits.error_of(actual)


# ---- Judging -------------------------------------------------------------------------------------


class JudgedRow(NamedTuple):
    """A row of a quantity with the errors of its entries.

    Attributes:
        row: the row.
        before: the row before it, None for the first one.
        actual, expected: all entries; an entry that is not recorded is our own.
        allowed: allowed errors, same shape.
        own: our own rounding error, a part of each.
        resolved: flags of entries of which a wrong sign would be noticed.
        context: arrays by which confusions are recognized.
    """

    row: RecordedRow
    before: RecordedRow | None
    actual: Array
    expected: Array
    allowed: Array
    own: float
    resolved: Array
    context: Callable[[], ConfusionContext]

    @property
    def errors(self) -> Array:
        """Errors of all entries."""
        return np.abs(self.actual - self.expected)

    @property
    def ratios(self) -> Array:
        """Ratios of the errors to those that are allowed; 0 for 0 / 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.nan_to_num(self.errors / self.allowed, nan=0.0)

    @property
    def worst(self) -> tuple[int, ...]:
        """Index of the entry with the largest ratio."""
        return tuple(
            int(i) for i in np.unravel_index(int(np.argmax(self.ratios)), self.actual.shape)
        )

    @property
    def fails(self) -> bool:
        """Whether an entry differs by more than is allowed."""
        return bool((self.errors > self.allowed).any())


def check_answers(path: Path, scene: Scene) -> tuple[list[Finding], list[str]]:
    """Return the Findings about recorded answers, and notes on the table.

    Args:
        path: file with the table.
        scene: the scene that the answers are about.

    Returns:
        For each quantity, and link, a Finding, that of the worst row; a second one lists entries
        whose printed digits decide nothing. The notes are sentences.

    Raises:
        InputError: the table cannot be read, or see `table_layout`.
        UnknownNameError: see `table_layout`.
    """
    table = open_table(path)
    layout = table_layout(table, scene)
    groups = [_Group(columns) for columns in layout.answers]
    count = 0
    last: RecordedRow | None = None
    for row in _rows(table, layout, scene):
        point = row.point(scene)
        for group in groups:
            group.add(row, point, last)
        last, count = row, count + 1
    findings = [x for group in groups for x in _judge_group(group, scene, table)]
    shown = dict.fromkeys(group.columns.digits.text for group in groups)
    notes = [f"{counted(count, 'row')}; printed with {' and '.join(islice(shown, 3))}"]
    return findings, notes


def _judge_group(group: _Group, scene: Scene, table: RecordedTable) -> Iterator[Finding]:
    """Yield the Findings of a quantity."""
    columns = group.columns
    about = CLAIM, columns.subject, scene
    evidence = f"compared: {table.path.name}"
    if group.broken:
        first = group.broken[0]
        place = table.line_of(first.number)
        detail = f"{columns.subject}, {place}: no finite numbers; {len(group.broken)} such rows"
        yield Finding(*about, first.state, np.inf, 0.0, "failed", evidence, detail)
    judged = [_judge(group, screened, scene) for screened in sorted(group.worst, reverse=True)]
    if not judged:
        return
    worst = max(judged, key=lambda one: float(one.ratios.max()))
    failing = [one for one in judged if one.fails]
    numbers, state = _errors(worst), worst.row.state
    if failing:
        shown, detail = _explained(worst, failing, columns, scene)
        place, state, numbers = table.line_of(shown.row.number), shown.row.state, _errors(shown)
        many = "" if group.rows == 1 else f"; {len(failing)} of {group.rows} rows differ"
        yield Finding(*about, state, *numbers, "failed", evidence, f"{detail}; {place}{many}")
        return
    resolved = np.any([one.resolved for one in judged], axis=0)
    recorded = np.zeros(columns.shape, bool).ravel()
    recorded[list(columns.entries)] = True
    hidden = recorded.reshape(columns.shape) & ~resolved
    vanish = np.all([np.abs(one.expected) <= one.own for one in judged], axis=0)
    hidden &= ~vanish
    if np.any(np.logical_or(resolved, vanish)[recorded.reshape(columns.shape)]):
        yield Finding(*about, state, *numbers, "passed", evidence)
    if np.any(hidden):
        names = [
            entry_name(index, columns.names) for index in zip(*np.nonzero(hidden), strict=True)
        ]
        shown = ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
        detail = f"{shown or 'value'} cannot be told with the digits that are printed"
        yield Finding(*about, state, *numbers, "inconclusive", evidence, detail)


def _errors(judged: JudgedRow) -> tuple[float, float]:
    """Return the error of the worst entry of a row, and the allowed one."""
    return float(judged.errors[judged.worst]), float(judged.allowed[judged.worst])


def _judge(group: _Group, screened: _Screened, scene: Scene) -> JudgedRow:
    """Return a row of a quantity with the errors of its entries."""
    row, columns = screened.row, group.columns
    point = row.point(scene)
    one, frame = columns.quantity, columns.frame
    tau = row.force if "tau" in one.arguments else None
    own = partial(compared_value, one, frame, row.vdot, tau)
    expected = np.asarray(one.value(point, frame), np.float64)
    with np.errstate(all="ignore"):
        ours = own_value(point.at, one, frame, own, point)
    recorded = row.values[list(columns.columns)]
    actual, printed = expected.ravel().copy(), np.zeros(expected.size)
    actual[list(columns.entries)] = recorded - group.offset
    printed[list(columns.entries)] = group.printed(recorded)
    if group.offset:  # the difference of two printed numbers
        printed *= 2.0
    rounding = allowed_error(ours.sensitivity)
    allowed = (printed + rounding).reshape(expected.shape)
    resolved = np.abs(expected) > 2.0 * allowed
    context = partial(_context, columns, point)
    sides = actual.reshape(expected.shape), expected
    return JudgedRow(row, screened.before, *sides, allowed, rounding, resolved, context)


def _context(columns: AnswerColumns, point: ConformancePoint) -> ConfusionContext:
    """Return the arrays by which confusions of a quantity are recognized."""
    one, context = columns.quantity, context_of(columns.quantity, columns.frame, point)
    if not point.has_tree:
        return context
    if context.rows:
        ours = np.asarray(one.value(point, columns.frame))
        turned = {text: np.kron(np.eye(len(ours) // 3), R) @ ours for text, R in BASE_AXES.items()}
        return context._replace(alternatives={**context.alternatives, **turned})
    if one is MASS_MATRIX:
        tree = point.at.scene.tree()
        if (
            tree is not None
            and np.any(tree.armature)
            and tree.armature.shape == (point.at.scene.n,)
        ):
            return context._replace(terms={"armature": np.diag(tree.armature)})
    if one is BIAS:
        weight = point.weight.gradient
        more = {
            "with gravity in it": point.bias + weight,
            "with gravity of the wrong sign in it": point.bias - weight,
        }
        return context._replace(alternatives=more)
    return context


# ---- Explanations --------------------------------------------------------------------------------


def _explained(
    worst: JudgedRow, failing: Sequence[JudgedRow], columns: AnswerColumns, scene: Scene
) -> tuple[JudgedRow, str]:
    """Return the failing row that shows the likely cause best, its place and the cause.

    It is the cause that most of a few rows show: one row alone, at rest, may show a simpler one.
    """
    spread = list(dict.fromkeys([0, *range(0, len(failing), max(1, len(failing) // EXPLAINED))]))
    rows = [worst, *(failing[k] for k in spread if failing[k] is not worst)][: 2 * EXPLAINED]
    located = [(one, _located(one, columns)) for one in rows]
    causes = Counter(difference.what for _, difference in located if difference.what)
    if causes:
        (cause, _), *_ = causes.most_common(1)
        shown, difference = next((x, y) for x, y in located if y.what == cause)
        if causes[cause] > len(rows) // 2 or shown is worst:
            return shown, _placed(columns, difference)
    text = _placed(columns, located[0][1])
    for name, change, order in _state_confusions(scene):
        if all(_agrees(one, columns, scene, change, order) for one in rows):
            return worst, f"{text}; as if {name}"
    if all(_is_stale(one, columns, scene) for one in rows):
        return worst, f"{text}; as the row before: stale"
    return worst, text


def _located(judged: JudgedRow, columns: AnswerColumns) -> Difference:
    """Return the place of the difference in a row, and the confusion that explains it."""
    return locate(
        judged.actual,
        judged.expected,
        columns.names,
        context=judged.context(),
        worst=judged.worst,
        agree=_agreement(judged.allowed),
    )


def _placed(columns: AnswerColumns, difference: Difference) -> str:
    """Return a difference as text, with its quantity."""
    where = f"{columns.subject}, {difference.where}" if difference.where else columns.subject
    return f"{where}: {difference.text}"


def _agreement(allowed: Array) -> Callable[[Any, Any], Any]:
    """Return the agreement within the errors of all entries; of parts, within the largest."""
    of_all, of_part = agreement_within(allowed), agreement_within(largest(allowed))
    return lambda x, y: (of_all if np.shape(x) == np.shape(y) == allowed.shape else of_part)(x, y)


Change = Callable[[Array, Array], tuple[Array, Array]]


def _state_confusions(scene: Scene) -> Iterator[tuple[str, Change, Sequence[int] | None]]:
    """Yield states that a program may have understood: (text, change, order of the results)."""
    degree = np.pi / 180.0
    yield "q and v were degrees", lambda q, v: (q * degree, v * degree), None
    yield "q were degrees", lambda q, v: (q * degree, v), None
    yield "v were degrees/s", lambda q, v: (q, v * degree), None
    yield "q were radians and it takes degrees", lambda q, v: (q / degree, v), None
    yield "q and v were radians and it takes degrees", lambda q, v: (q / degree, v / degree), None
    yield "q had the other sign", lambda q, v: (-q, v), None
    yield "q and v had the other sign", lambda q, v: (-q, -v), None
    yield "v were 0", lambda q, v: (q, 0.0 * v), None
    yield "v had the other sign", lambda q, v: (q, -v), None
    yield "q were 0", lambda q, v: (0.0 * q, v), None
    yield "v were given for q and q for v", lambda q, v: (v, q), None
    for order in _orders(scene):
        names = ", ".join(scene.coordinate_names[k] for k in order)
        take = list(order)
        change: Change = lambda q, v, take=take: (q[take], v[take])  # noqa: E731
        yield f"the joints of q and v were in the order {names}", change, None
        yield f"the joints of all were in the order {names}", change, order


def _orders(scene: Scene) -> Iterator[Sequence[int]]:
    """Yield orders of the joints other than the own one, likely ones first."""
    n = scene.n
    own = tuple(range(n))
    names = scene.coordinate_names
    likely = [own[::-1], tuple(sorted(own, key=lambda k: names[k]))]
    swaps = [
        tuple(b if k == a else a if k == b else k for k in own) for a in own for b in own[a + 1 :]
    ]
    every: Iterable[tuple[int, ...]] = permutations(own) if n <= 5 else ()
    yield from islice(
        (x for x in dict.fromkeys([*likely, *swaps, *every]) if x != own), MOST_ORDERS
    )


def _agrees(
    judged: JudgedRow,
    columns: AnswerColumns,
    scene: Scene,
    change: Change,
    order: Sequence[int] | None,
) -> bool:
    """Return whether a row is the answer at a changed state."""
    try:
        with np.errstate(all="ignore"):
            point = judged.row.point(scene, change)
            value = np.asarray(columns.quantity.value(point, columns.frame))
    except (RefusedError, InputError):
        return False
    if order is not None:
        back = np.argsort(order)
        for axis, size in enumerate(columns.quantity.shape):
            if size == "n":
                value = np.take(value, back, axis)
    return _equals_recorded(judged, columns, value)


def _equals_recorded(judged: JudgedRow, columns: AnswerColumns, value: Array) -> bool:
    """Return whether the recorded entries of a row are those of a value."""
    entries = list(columns.entries)
    x, y = judged.actual.ravel()[entries], value.ravel()[entries]
    slack = judged.allowed.ravel()[entries] + 1e3 * EPS * np.maximum(np.abs(x), np.abs(y))
    return bool((np.abs(x - y) <= slack).all())


def _is_stale(judged: JudgedRow, columns: AnswerColumns, scene: Scene) -> bool:
    """Return whether a row has the answer of the row before."""
    if judged.before is None:
        return False
    value = np.asarray(columns.quantity.value(judged.before.point(scene), columns.frame))
    return _equals_recorded(judged, columns, value)

"""Recorded answers: quantities that another program computed at given states, checked from a file.

A row has a state, columns q[...] and v[...], and v̇ in vdot[...] and forces in force[...] where a
quantity depends on them; all other columns are answers. A free base may be given as a pose and a
twist instead (`eomcheck.lab.recorded_base`). Every row is screened in float64, in batches. Of each
quantity the rows with the largest errors are judged: the allowed error is half a unit of the last
printed digit and our own rounding error. A failure is explained by the confusions of conventions
that are recognized in any array, or by a state that the program understood otherwise.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import islice, permutations, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims.batched_claims import NOT_BATCHABLE
from eomcheck.claims.confusions import ConfusionContext, Difference, agreement_within, locate
from eomcheck.claims.engine_quantities import (
    MASS_MATRIX_RATE,
    compared_value,
    context_of,
    own_value,
)
from eomcheck.claims.finding import Finding, entry_name
from eomcheck.draws.pairwise_design import state_cases, with_wide
from eomcheck.engines.file_engine import FREE, BaseVelocity
from eomcheck.errors import InputError, RefusedError, UnknownNameError
from eomcheck.evaluation.conformance import QUANTITIES, ConformancePoint, Quantity
from eomcheck.evaluation.evaluation import BatchEvaluation, Evaluation
from eomcheck.evaluation.tolerance import UNIT_ROUNDOFF, allowed_error, largest, rounded
from eomcheck.lab.recorded_base import (
    BASE_COLUMNS,
    OTHER_QUATERNIONS,
    UNMAPPED,
    base_state,
    check_free,
    check_quaternion,
    in_coordinates_of,
    mapped_terms,
    mapped_value,
    other_conventions,
    parse_convention,
    recorded_base,
    text_of,
    twist_names,
    velocity_map,
)
from eomcheck.lab.recorded_finding import ComparedRow, RecordedFinding, compared_entries
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
from eomcheck.numbers.batch_arrays import BatchArray, batch_data, of_each
from eomcheck.numbers.generic import EPS, Array
from eomcheck.safe_output import counted, listed

TINY = float(np.finfo(np.float64).tiny)

CLAIM = "recorded-answers"
"""Id of the claim: recorded answers are those of the scene, to their printed digits."""

LOG_NAMES = {"a": "vdot", "qdd": "vdot", "tau": "force"}
"""Name of a column of a log -> the input that it is."""

LOG_UNREAD = "multiplier", "residual"
"""Columns of a log that are not compared."""

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
ENERGY = Quantity(
    *("energy", "T + U", ("q", "v"), (), "invariant", "J", "energy, up to a constant"),
    lambda point, frame: sum(
        x
        for x in point.at.call(
            point.at.scene.energies,
            *(point.at.parameters, point.at.prepared, point.at.q, point.at.v),
        )
        if x is not None
    ),
    needs_tree=False,
)


def _applied_force(point: ConformancePoint, frame: str) -> Any:
    """Return M v̇ + B - Q, and the constraint forces aᵀλ that explain τ best, if there are any."""
    at = point.at
    force, a = at.terms.M @ point.vdot - at.F, at.terms.a
    return force if a is None else of_each(_with_constraint_forces, force, a, point.tau)


def _with_constraint_forces(force: Array, a: Array, tau: Array) -> Array:
    """Return force + aᵀλ, λ by least squares of τ - force."""
    return force + a.T @ np.linalg.lstsq(a.T, tau - force, rcond=None)[0]


EQUATIONS = Quantity(
    *("equations_of_motion", "τ", ("q", "v", "vdot", "tau"), ("n",), "force", "N, N m"),
    "applied forces M v̇ + B - Q - aᵀλ, Q the forces of the scene: weight, springs, dampers",
    _applied_force,
    needs_tree=False,
)
"""The forces that a log has to have applied."""

C_TIMES_V = BIAS._replace(name="coriolis_matrix", symbol="C v", mapping="coriolis")
"""The value by which a Coriolis matrix is compared, which is not unique."""

ANSWERS: dict[str, Quantity] = {one.name: one for one in (MASS_MATRIX, BIAS, ENERGY)} | QUANTITIES
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


def write_states(
    scene: Scene, path: Path, examples: int, seed: int = 0, base: str | None = None
) -> None:
    """Write random states of a scene as a table: q, v and an acceleration v̇.

    The first is its initial state; of the others every second one is wide: turned by many turns, or
    slow or fast. They satisfy the constraints.

    Args:
        scene: the scene.
        path: file to write, see `eomcheck.lab.recorded_table.write_table`.
        examples: number of states.
        seed: seed of the draws.
        base: convention of the twist of a free base, which is then written as pose and twist; see
            `eomcheck.lab.recorded_base.parse_convention`.

    Raises:
        InputError: the file cannot be written, no position satisfies the loop closure, there is no
            such convention, or the scene has no free base.
    """
    convention = None if base is None else parse_convention(base)
    if convention is not None:
        check_free(scene)
    first = scene.initial_state()
    drawn = with_wide(state_cases(scene, examples, seed), seed) if examples > 1 else iter(())
    states = [State(*first, 0.0), *(state for _, state in islice(drawn, examples - 1))]
    q, v = (np.array([state[k] for state in states]) for k in (0, 1))
    vdot = np.random.default_rng([abs(seed), 2]).uniform(-1.0, 1.0, q.shape)
    columns = state_columns(scene, q, v, vdot, convention)
    if scene.depends_on_time:
        columns["t"] = np.array([state.t for state in states])
    write_table(path, columns, {} if convention is None else {"base": text_of(convention)})


def state_columns(
    scene: Scene, q: Array, v: Array, vdot: Array, convention: BaseVelocity | None = None
) -> dict[str, Array]:
    """Return the columns of states.

    Args:
        scene: the scene.
        q, v, vdot: coordinates, velocities and accelerations (k, n).
        convention: that of the twist of a free base, None for the scene's own coordinates.
    """
    columns: dict[str, Array] = {}
    parts = {"q": q, "v": v, "vdot": vdot}
    base: Mapping[str, Array] = {}
    if convention is not None:
        rows = [recorded_base(convention, *state) for state in zip(q, v, vdot, strict=True)]
        base = dict(zip(parts, map(np.array, zip(*rows, strict=True)), strict=True))
    for name, values in parts.items():
        if name in base:
            columns |= dict(zip(BASE_COLUMNS[name], base[name].T, strict=True))
        for k in range(FREE if base else 0, scene.n):
            columns[f"{name}[{scene.coordinate_names[k]}]"] = values[:, k]
    return columns


# ---- Columns -------------------------------------------------------------------------------------


class AnswerColumns(NamedTuple):
    """Columns of a table that hold one quantity.

    Attributes:
        quantity: the quantity, in the coordinates of the table.
        frame: name of its link, "" for a quantity of none.
        shape: shape of the quantity.
        names: names along each axis.
        columns: index of each column.
        entries: index in the quantity of each column, raveled.
        digits: printed digits, the most of any column: one that holds 0 and 1 alone shows few.
        plain: the quantity in the coordinates of the scene.
        reading: how the columns are read, "" as they are, or a key of `READINGS`.
    """

    quantity: Quantity
    frame: str
    shape: tuple[int, ...]
    names: tuple[tuple[str, ...], ...]
    columns: tuple[int, ...]
    entries: tuple[int, ...]
    digits: Digits
    plain: Quantity
    reading: str = ""

    @property
    def subject(self) -> str:
        """Name for messages: the symbol, and the link."""
        if self.reading:
            return self.reading
        symbol = {"mass_matrix": "M", "bias": "bias"}.get(self.quantity.name, self.quantity.name)
        return f"{symbol}, {self.frame}" if self.frame else symbol

    @property
    def is_whole(self) -> bool:
        """Whether all entries are there."""
        return len(self.entries) == int(np.prod(self.shape, initial=1))

    def recorded(self, values: Array, w: Array) -> tuple[Array, Array, tuple[int, ...]]:
        """Return the recorded entries of rows, their errors and their indices in the quantity.

        Args:
            values: rows of the table (k, columns).
            w: velocities (k, n) in the coordinates of the table.

        Returns:
            The entries (k, m), the errors (k, m) by the printed digits, and the indices (m,).
        """
        x = values[:, list(self.columns)]
        error = self.digits.error_of(x)
        if not self.reading:
            return x, error, self.entries
        n = w.shape[1]
        C, C_error = np.empty((2, len(values), n * n))
        C[:, list(self.entries)], C_error[:, list(self.entries)] = x, error
        C, C_error = C.reshape(-1, n, n), C_error.reshape(-1, n, n)
        return READINGS[self.reading](C, C_error, w)


Reading = Callable[[Array, Array, Array], tuple[Array, Array, tuple[int, ...]]]


def _times_v(C: Array, error: Array, w: Array) -> tuple[Array, Array, tuple[int, ...]]:
    """Return C w, its error and its indices, of matrices (k, n, n) with errors and w (k, n)."""
    size = error + allowed_error(1.0) * np.abs(C)
    product, its_error = (np.einsum("kij,kj->ki", x, y) for x, y in ((C, w), (size, np.abs(w))))
    return product, its_error, tuple(range(w.shape[1]))


def _with_transpose(C: Array, error: Array, w: Array) -> tuple[Array, Array, tuple[int, ...]]:
    """Return C + Cᵀ (k, n²), its error and its indices."""
    both, its_error = ((x + x.transpose(0, 2, 1)).reshape(len(x), -1) for x in (C, error))
    return both, its_error, tuple(range(w.shape[1] ** 2))


READINGS: dict[str, Reading] = {"C v": _times_v, "C + Cᵀ": _with_transpose}
"""Reading of a Coriolis matrix -> its function."""


class TableLayout(NamedTuple):
    """Columns of a table by their meaning.

    Attributes:
        inputs: name of an input -> index of the column of each coordinate; without the base's.
        time: index of the column t, or None.
        answers: columns of the answers, quantity by quantity.
        convention: that of the twist of a free base, None in the scene's own coordinates.
        base: name of an input -> index of each column of the base, see `BASE_COLUMNS`.
        unit_roundoff: u of the numbers in which the program computes.
    """

    inputs: dict[str, tuple[int, ...]]
    time: int | None
    answers: tuple[AnswerColumns, ...]
    convention: BaseVelocity | None = None
    base: Mapping[str, tuple[int, ...]] = {}
    unit_roundoff: float = UNIT_ROUNDOFF


PRECISIONS = {"float64": UNIT_ROUNDOFF, "float32": 2.0**-24}
"""Precision of a program -> its unit roundoff."""


def _declared(table: RecordedTable, name: str, option: str | None) -> str | None:
    """Return the text of an option, else that of the header of a table; None for neither."""
    return table.header.get(name) if option is None else option


def _convention_of(table: RecordedTable, scene: Scene, option: str | None) -> BaseVelocity | None:
    """Return the convention of the base of a table, None in the scene's own coordinates."""
    text = _declared(table, "base", option)
    first = next((name for name in table.names if name.strip().startswith("base.")), None)
    if text is None:
        if first is not None:
            raise InputError(
                f"{str(table.path)!r} has a column {first!r} and no header line "
                "'# base: world axes, linear first' that says which twist it is"
            )
        return None
    convention = parse_convention(text)
    check_free(scene)
    return None if first is None else convention


def _roundoff_of(table: RecordedTable, option: str | None) -> float:
    """Return the unit roundoff in which the program of a table computes."""
    text = _declared(table, "precision", option)
    if text is None:
        return max([UNIT_ROUNDOFF, *(digits.roundoff for digits in table.digits)])
    if text not in PRECISIONS:
        raise InputError(f"precision = {text!r}: expected {' or '.join(PRECISIONS)}")
    return PRECISIONS[text]


def table_layout(
    table: RecordedTable,
    scene: Scene,
    base: str | None = None,
    precision: str | None = None,
    log: bool = False,
) -> TableLayout:
    """Return the meaning of the columns of a table.

    Args:
        table: the table.
        scene: the scene.
        base: convention of the twist of a free base, by default that of the header.
        precision: key of `PRECISIONS`, by default that of the header or of the numbers' type.
        log: whether it is a log, whose columns a, qdd and tau are inputs.

    Raises:
        InputError: a column of the state is missing, or there is no answer; a name that is no
            column of anything; a quantity that the scene has not; a twist without a convention.
        UnknownNameError: no such quantity or link.
    """
    convention = _convention_of(table, scene, base)
    roundoff = _roundoff_of(table, precision)
    velocities = scene.coordinate_names
    joints = velocities
    if convention is not None:
        velocities, joints = twist_names(scene, convention), joints[FREE:]
    first = len(velocities) - len(joints)
    base_columns: dict[str, dict[int, int]] = {name: {} for name in BASE_COLUMNS}
    point = ConformancePoint(Evaluation(scene, *scene.initial_state()))
    inputs: dict[str, dict[int, int]] = {name: {} for name in INPUTS}
    answers: dict[tuple[str, str], dict[int, int]] = {}
    kinds: dict[tuple[str, str], tuple[tuple[int, ...], tuple[tuple[str, ...], ...]]] = {}
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
        if log and name.quantity in LOG_UNREAD:
            continue
        if log:
            name = name._replace(quantity=LOG_NAMES.get(name.quantity, name.quantity))
        if name.quantity.startswith("base."):
            part, j = _base_column(name, text)
            _add(base_columns[part], j, k, table)
            continue
        if name.quantity in INPUTS:
            along = velocities if name.quantity == "force" else joints
            (j,) = index_in(_only(name, text), [along], text)
            _add(inputs[name.quantity], j + (first if along is joints else 0), k, table)
            continue
        one = _quantity_named(name.quantity, text)
        if convention is not None and one.mapping == UNMAPPED:
            raise InputError(
                f"column {text!r}: derivatives are not compared on a base with a twist"
            )
        if what := one.lacks(point):
            raise InputError(f"column {text!r}: {scene.name} {what}")
        frame, entry = _frame_and_entry(one, name, point, text)
        key = one.name, frame
        if key not in kinds:
            value = np.asarray(one.value(point, frame))
            along_axes = [
                velocities if names == scene.coordinate_names else names
                for names in one.axis_names(point)[: value.ndim]
            ]
            kinds[key] = value.shape, tuple(along_axes)
            answers[key] = {}
        shape, names = kinds[key]
        index = index_in(entry, names, text)
        _add(answers[key], int(np.ravel_multi_index(index, shape)) if shape else 0, k, table)
    groups = tuple(
        group
        for key, entries in answers.items()
        for group in _groups(table, convention, ANSWERS[key[0]], key[1], *kinds[key], entries)
    )
    if not (groups or log):
        raise InputError(f"{str(table.path)!r} has no answers: columns such as M[0;1] or bias[0]")
    needed = {"q"} | {x for group in groups for x in _needs(group.quantity)}
    if convention is not None or log:  # the map of a twist depends on v
        needed |= {"v"}
    if log and (inputs["vdot"] or base_columns["vdot"]):
        needed |= {"vdot"}
    if log and inputs["force"] and len(inputs["force"]) < scene.n:
        missing = [velocities[j] for j in range(scene.n) if j not in inputs["force"]]
        raise InputError(f"{str(table.path)!r} has no column tau[{missing[0]}], 0 if none acts")
    given = _inputs_given(table, scene, inputs, needed, first)
    given_base = _base_given(table, base_columns, needed) if convention is not None else {}
    return TableLayout(given, time, groups, convention, given_base, roundoff)


def _inputs_given(
    table: RecordedTable,
    scene: Scene,
    inputs: Mapping[str, dict[int, int]],
    needed: set[str],
    first: int,
) -> dict[str, tuple[int, ...]]:
    """Return the columns of the inputs that are there, in order; without those of a base.

    Raises:
        InputError: a column of an input that is needed is missing.
    """
    given = {}
    for name, columns in inputs.items():
        wanted = range(0 if name == "force" else first, scene.n)
        missing = [j for j in wanted if j not in columns]
        if missing and name in needed - {"force"}:
            column = f"{name}[{scene.coordinate_names[missing[0]]}]"
            raise InputError(f"{str(table.path)!r} has no column {column}")
        if not missing:
            given[name] = tuple(columns[j] for j in wanted)
    return given


def _base_given(
    table: RecordedTable, columns: Mapping[str, dict[int, int]], needed: set[str]
) -> dict[str, tuple[int, ...]]:
    """Return the columns of a base that are there, in order.

    Raises:
        InputError: one that is needed is missing.
    """
    given = {}
    for name, there in columns.items():
        missing = [text for j, text in enumerate(BASE_COLUMNS[name]) if j not in there]
        if missing and name in needed:
            raise InputError(f"{str(table.path)!r} has no column {missing[0]}")
        if not missing:
            given[name] = tuple(there[j] for j in range(len(there)))
    return given


def _base_column(name: ColumnName, text: str) -> tuple[str, int]:
    """Return the input to which a column of the base belongs, and its index there."""
    for part, columns in BASE_COLUMNS.items():
        if name.quantity in columns and not name.brackets:
            return part, columns.index(name.quantity)
    raise UnknownNameError("column", text, [x for names in BASE_COLUMNS.values() for x in names])


def _groups(
    table: RecordedTable,
    convention: BaseVelocity | None,
    one: Quantity,
    frame: str,
    shape: tuple[int, ...],
    names: tuple[tuple[str, ...], ...],
    entries: dict[int, int],
) -> Iterator[AnswerColumns]:
    """Yield the columns of a quantity; of a Coriolis matrix C, as C v, and C + Cᵀ if declared."""
    digits = most_digits(table.digits[k] for k in entries.values())
    where = tuple(entries.values()), tuple(entries), digits

    def columns(plain: Quantity, reading: str = "") -> AnswerColumns:
        quantity = plain if convention is None else in_coordinates_of(convention, plain)
        sizes = (shape[:1], names[:1]) if reading == "C v" else (shape, names)
        return AnswerColumns(quantity, frame, *sizes, *where, plain, reading)

    if one.name != "coriolis_matrix":
        yield columns(one)
        return
    if len(entries) < int(np.prod(shape)):
        raise InputError(
            f"{str(table.path)!r} has some entries of C: all are needed, it is compared by C v"
        )
    yield columns(C_TIMES_V, "C v")
    if "skew" in table.header.get("coriolis", ""):
        if convention is not None:
            raise InputError("coriolis = 'skew': C + Cᵀ is not compared on a base with a twist")
        yield columns(MASS_MATRIX_RATE, "C + Cᵀ")


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
        w: its velocities (n,) in the coordinates of the table.
        sizes: sizes of q and v (n,) to which their rounding is relative, None for their own.
    """

    number: int
    values: Array
    state: State
    vdot: Array
    force: Array
    w: Array
    sizes: tuple[Array, Array] | None = None

    def point(self, scene: Scene, change: Callable[[Array, Array], Any] | None = None) -> Any:
        """Return the point at its state, or at a changed one."""
        q, v, t = self.state
        if change is not None:
            q, v = change(q, v)
        at = Evaluation(scene, q, v, t)
        at.input_sizes = self.sizes
        return ConformancePoint(at, self.vdot, tau=self.force)


def chunks_of_rows(
    table: RecordedTable, layout: TableLayout, scene: Scene
) -> Iterator[list[RecordedRow]]:
    """Yield all rows of a table, in chunks."""
    for first, values in table.chunks():
        rows = []
        for k, row in enumerate(values):
            where = f"{str(table.path)!r}, {table.line_of(first + k)}"
            rows.append(row_of(layout, scene, first + k, row, where, table.digits))
        yield rows


def row_of(
    layout: TableLayout,
    scene: Scene,
    number: int,
    values: Array,
    where: str = "",
    digits: Sequence[Digits] | None = None,
    quaternion: Callable[[Array], Array] = lambda x: x,
) -> RecordedRow:
    """Return a row of a table.

    Args:
        layout: the meaning of its columns.
        scene: the scene.
        number: index of the row.
        values: its numbers.
        where: file and row, for messages.
        digits: printed digits of all columns, by which a quaternion is checked; None for none.
        quaternion: function of the recorded quaternion that returns the one that is meant.

    Raises:
        InputError: the state is not finite, or the quaternion has another length than 1.
    """
    n, u = scene.n, layout.unit_roundoff
    t = 0.0 if layout.time is None else float(values[layout.time])
    q, v, vdot, force = parts = np.zeros((len(INPUTS), n))
    for part, name in zip(parts, INPUTS, strict=True):
        if name in layout.inputs:
            joints = values[list(layout.inputs[name])]
            part[n - len(joints) :] = joints if u == UNIT_ROUNDOFF else rounded(joints, u)
    w, sizes = v, None
    base = {name: values[list(columns)] for name, columns in layout.base.items()}
    if not np.isfinite((*parts.ravel(), t, *(x for y in base.values() for x in y))).all():
        raise InputError(f"{where}: the state has no finite numbers")
    if layout.convention is not None:
        if digits is not None:
            columns = layout.base["q"][3:]
            error = [digits[k].error_of(values[k : k + 1])[0] for k in columns]
            check_quaternion(base["q"][3:], np.array(error), where)
        pose, twist = (rounded(base[name], u) for name in ("q", "v"))
        pose[3:] = quaternion(pose[3:])
        rates = rounded(base.get("vdot", np.zeros(FREE)), u)
        state = base_state(layout.convention, pose, twist, rates)
        q[:FREE], vdot[:FREE] = state.q, state.vdot
        w = v.copy()
        w[:FREE] = np.roll(twist, 3) if layout.convention.turns_first else twist
        v[:FREE] = state.v
        force[:] = velocity_map(layout.convention, q, v)[0].T @ force
        sizes = np.abs(q), np.abs(v)
        sizes[0][:FREE], sizes[1][:FREE] = state.q_size, state.v_size
    return RecordedRow(number, values.copy(), State(q, v, t), vdot, force, w, sizes)


UP_TO_CONSTANT = "potential_energy", "energy"
"""Quantities with a constant that is free: that of the first row is taken."""


class _Screened(NamedTuple):
    """A row with its largest error, and the row before it."""

    ratio: float
    number: int
    row: RecordedRow
    before: RecordedRow | None


class ScreenedGroup:
    """Rows of one quantity: those with the largest errors, and counts.

    Args:
        columns: its columns.
        scene: the scene.
        unit_roundoff: u of the numbers of the program.
    """

    def __init__(self, columns: AnswerColumns, scene: Scene, unit_roundoff: float = UNIT_ROUNDOFF):
        self.columns, self.scene, self.unit_roundoff = columns, scene, unit_roundoff
        self.worst: list[_Screened] = []
        self.broken: list[RecordedRow] = []
        self.rows = 0
        self.offset = 0.0

    def add(self, rows: Sequence[RecordedRow], ours: Array, before: RecordedRow | None) -> None:
        """Add rows, with our own values (k, ...) there, and the row before them."""
        values, w = np.array([row.values for row in rows]), np.array([row.w for row in rows])
        actual, printed, entries = self.columns.recorded(values, w)
        ours = ours.reshape(len(rows), -1)
        expected = ours[:, list(entries)]
        if self.columns.quantity.name in UP_TO_CONSTANT and self.rows == 0:
            self.offset = float(actual[0, 0] - expected[0, 0])
        self.rows += len(rows)
        size = np.abs(ours).max(axis=1, initial=0.0)
        rounding = (self.unit_roundoff + UNIT_ROUNDOFF) * size[:, None] + TINY
        with np.errstate(over="ignore", invalid="ignore"):
            ratios = np.abs(actual - self.offset - expected) / (printed + rounding)
        finite = np.isfinite(actual).all(axis=1)
        for row in (rows[int(k)] for k in np.flatnonzero(~finite)):
            self.broken.append(row)
        largest_ratios = ratios.max(axis=1, initial=0.0)
        for k in np.flatnonzero(finite).tolist():
            ratio, row = float(largest_ratios[k]), rows[k]
            if len(self.worst) >= MOST_JUDGED and ratio <= self.worst[0].ratio:
                continue
            last = rows[k - 1] if k else before
            heapq.heappush(self.worst, _Screened(ratio, row.number, row, last))
            if len(self.worst) > MOST_JUDGED:
                heapq.heappop(self.worst)


def screen_rows(
    chunks: Iterable[list[RecordedRow]],
    groups: Sequence[ScreenedGroup],
    scene: Scene,
    each: Callable[[list[RecordedRow], ConformancePoint | None], None] | None = None,
) -> int:
    """Compare all rows with our own values, in batches; return their number.

    Args:
        chunks: the rows.
        groups: the quantities.
        scene: the scene.
        each: function of the rows of a chunk and their points as a batch, or None.
    """
    count, before = 0, None
    for rows in chunks:
        batch = batch_point(rows, scene)
        if each is not None:
            each(rows, batch)
        points = None
        for group in groups:
            one, frame = group.columns.quantity, group.columns.frame
            values = None
            with suppress(*NOT_BATCHABLE, RefusedError):
                values = batch_data(one.value(batch, frame), len(rows))
            if values is None:
                points = [row.point(scene) for row in rows] if points is None else points
                values = np.array([one.value(point, frame) for point in points])
            group.add(rows, values, before)
        before, count = rows[-1], count + len(rows)
    return count


def batch_point(rows: Sequence[RecordedRow], scene: Scene) -> ConformancePoint:
    """Return the points at the states of rows, as a batch."""
    at = BatchEvaluation([scene] * len(rows), [row.state for row in rows])
    vectors: list[Any] = [
        BatchArray(np.array([getattr(x, name) for x in rows])) for name in VECTORS
    ]
    vdot, force = vectors
    return ConformancePoint(at, vdot, tau=force)


VECTORS = "vdot", "force"


# ---- Judging -------------------------------------------------------------------------------------


class JudgedRow(NamedTuple):
    """A row of a quantity with the errors of its entries.

    Attributes:
        row: the row.
        before: the row before it, None for the first one.
        actual, expected: all entries; an entry that is not recorded is our own.
        allowed: allowed errors, same shape.
        own: our own rounding error, a part of each.
        entries: indices of the recorded entries, raveled.
        resolved: flags of entries of which a wrong sign would be noticed.
        context: arrays by which confusions are recognized.
    """

    row: RecordedRow
    before: RecordedRow | None
    actual: Array
    expected: Array
    allowed: Array
    own: float
    entries: tuple[int, ...]
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


def check_answers(
    path: Path, scene: Scene, base: str | None = None, precision: str | None = None
) -> tuple[list[Finding], list[str]]:
    """Return the Findings about recorded answers, and notes on the table.

    Args:
        path: file with the table.
        scene: the scene that the answers are about.
        base: convention of the twist of a free base, by default that of the header.
        precision: "float32" or "float64", by default that of the header or of the numbers' type.

    Returns:
        For each quantity, and link, a Finding, that of the worst row; a second one lists entries
        whose printed digits decide nothing. The notes are sentences.

    Raises:
        InputError: the table cannot be read, or see `table_layout`.
        UnknownNameError: see `table_layout`.
    """
    table = open_table(path)
    layout = table_layout(table, scene, base, precision)
    groups = [ScreenedGroup(x, scene, layout.unit_roundoff) for x in layout.answers]
    count = screen_rows(chunks_of_rows(table, layout, scene), groups, scene)
    options = {"base": base, "precision": precision}
    findings = [x for group in groups for x in judge_group(group, scene, table, layout, options)]
    shown = dict.fromkeys(group.columns.digits.text for group in groups)
    notes = [f"{counted(count, 'row')}; printed with {' and '.join(islice(shown, 3))}"]
    return findings, notes


def judge_group(
    group: ScreenedGroup,
    scene: Scene,
    table: RecordedTable,
    layout: TableLayout,
    options: Mapping[str, str | None],
) -> Iterator[Finding]:
    """Yield the Findings of a quantity.

    Args:
        group: its rows with the largest errors.
        scene: the scene.
        table: the table.
        layout: the meaning of its columns.
        options: `base` and `precision` as they were given.
    """
    columns = group.columns
    about = CLAIM, columns.subject, scene
    source: Any = {"path": table.path, "options": options}
    evidence = f"compared: {table.path.name}"
    if group.broken:
        first = group.broken[0]
        place = table.line_of(first.number)
        detail = f"{columns.subject}, {place}: no finite numbers; {len(group.broken)} such rows"
        failed = *about, first.state, np.inf, 0.0, "failed", evidence, detail
        yield RecordedFinding(*failed, **source, row=first.number)
    in_order = sorted(group.worst, key=lambda one: (-one.ratio, one.number))
    judged = [judge_row(group, one.row, one.before, layout) for one in in_order]
    if not judged:
        return
    worst = max(judged, key=lambda one: float(one.ratios.max()))
    failing = [one for one in judged if one.fails]
    numbers, state = _errors(worst), worst.row.state
    if failing:
        shown, detail = explain_failure(worst, failing, columns, scene, layout)
        place, state, numbers = table.line_of(shown.row.number), shown.row.state, _errors(shown)
        many = "" if group.rows == 1 else f"; {len(failing)} of {group.rows} rows differ"
        failed = *about, state, *numbers, "failed", evidence, f"{detail}; {place}{many}"
        yield RecordedFinding(*failed, **source, row=shown.row.number)
        return
    resolved = np.any([one.resolved for one in judged], axis=0)
    recorded = np.zeros(columns.shape, bool).ravel()
    recorded[list(judged[0].entries)] = True
    hidden = recorded.reshape(columns.shape) & ~resolved
    vanish = np.all([np.abs(one.expected) <= one.own for one in judged], axis=0)
    hidden &= ~vanish
    if np.any(np.logical_or(resolved, vanish)[recorded.reshape(columns.shape)]):
        yield Finding(*about, state, *numbers, "passed", evidence)
    if np.any(hidden):
        names = [
            entry_name(index, columns.names) for index in zip(*np.nonzero(hidden), strict=True)
        ]
        detail = f"{listed(names, 4) or 'value'} cannot be told with the digits that are printed"
        yield Finding(*about, state, *numbers, "inconclusive", evidence, detail)


def _errors(judged: JudgedRow) -> tuple[float, float]:
    """Return the error of the worst entry of a row, and the allowed one."""
    return float(judged.errors[judged.worst]), float(judged.allowed[judged.worst])


def judge_row(
    group: ScreenedGroup, row: RecordedRow, before: RecordedRow | None, layout: TableLayout
) -> JudgedRow:
    """Return a row of a quantity, and the row before it, with the errors of its entries."""
    columns = group.columns
    point = row.point(group.scene)
    one, frame = columns.quantity, columns.frame
    tau = row.force if "tau" in one.arguments else None
    own = partial(compared_value, one, frame, row.vdot, tau)
    expected = np.asarray(one.value(point, frame), np.float64)
    with np.errstate(all="ignore"):
        ours = own_value(point.at, one, frame, own, point)
    (recorded,), (error,), entries = columns.recorded(row.values[None], row.w[None])
    actual, printed = expected.ravel().copy(), np.zeros(expected.size)
    actual[list(entries)] = recorded - group.offset
    printed[list(entries)] = error
    if group.offset:  # the difference of two printed numbers
        printed *= 2.0
    rounding = allowed_error(ours.sensitivity, group.unit_roundoff)
    allowed = (printed + rounding).reshape(expected.shape)
    resolved = np.abs(expected) > 2.0 * allowed
    context = partial(_context, columns, point, layout.convention)
    sides = actual.reshape(expected.shape), expected
    return JudgedRow(row, before, *sides, allowed, rounding, entries, resolved, context)


def compared_answers(
    table: RecordedTable, layout: TableLayout, scene: Scene, columns: AnswerColumns, number: int
) -> ComparedRow:
    """Return the recorded entries of a quantity in one row beside our own values.

    Args:
        table: the table.
        layout: the meaning of its columns.
        scene: the scene.
        columns: those of the quantity.
        number: index of the row.

    Raises:
        InputError: there is no such row, or its state is not finite.
    """
    rows, count = dict[int, RecordedRow](), 0
    for first, values in table.chunks():
        count = first + len(values)
        for k in {0, number} & set(range(first, count)):
            where = f"{str(table.path)!r}, {table.line_of(k)}"
            rows[k] = row_of(layout, scene, k, values[k - first], where, table.digits)
    if number not in rows:
        raise InputError(f"row = {number}: {str(table.path)!r} has {counted(count, 'row')}")
    group = ScreenedGroup(columns, scene, layout.unit_roundoff)
    ours = np.asarray(columns.quantity.value(rows[0].point(scene), columns.frame))
    group.add([rows[0]], ours[None], None)  # a constant that is free is that of the first row
    judged = judge_row(group, rows[number], None, layout)
    entries = list(judged.entries)
    if columns.reading:
        indices = (np.unravel_index(k, columns.shape) for k in entries)
        places = (entry_name(tuple(int(i) for i in index), columns.names) for index in indices)
        names = [f"{columns.subject}, {place}" for place in places]
    else:
        names = [table.names[k] for k in columns.columns]
    sides = judged.actual + group.offset, judged.expected + group.offset, judged.allowed
    compared = compared_entries(names, *(x.ravel()[entries] for x in sides))
    return ComparedRow(table.line_of(number), rows[number].state, compared)


def _context(
    columns: AnswerColumns, point: ConformancePoint, convention: BaseVelocity | None = None
) -> ConfusionContext:
    """Return the arrays by which confusions of a quantity are recognized."""
    one, context = columns.plain, context_of(columns.plain, columns.frame, point)
    if one is EQUATIONS:
        forces = {"the bias": point.bias, "M a": point.inertia_force - point.bias}
        if point.has_tree:
            forces["gravity"] = point.weight.gradient
        Q = point.at.terms.Q
        rest = None if Q is None else -Q - forces.get("gravity", 0.0)
        if rest is not None and np.any(np.abs(rest) > EPS * largest(Q)):
            forces["springs and dampers" if point.has_tree else "the scene's forces"] = rest
        return context._replace(terms=forces)
    if not point.has_tree:
        return context
    if convention is not None:
        return _context_of_twist(columns, point, convention, context)
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
            and not np.any(tree.gimbal_armature)
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


def _context_of_twist(
    columns: AnswerColumns,
    point: ConformancePoint,
    convention: BaseVelocity,
    context: ConfusionContext,
) -> ConfusionContext:
    """Return the confusions of a quantity in the coordinates of a base with a twist."""
    one, frame = columns.plain, columns.frame
    mapped = mapped_terms(convention, one, point)
    terms = {name: mapped(name, term) for name, term in context.terms.items()}
    alternatives = {
        f"as with a twist of {text}": mapped_value(other, one, point, frame)
        for text, other in other_conventions(convention)
    }
    return context._replace(terms=terms, alternatives=alternatives)


# ---- Explanations --------------------------------------------------------------------------------


def explain_failure(
    worst: JudgedRow,
    failing: Sequence[JudgedRow],
    columns: AnswerColumns,
    scene: Scene,
    layout: TableLayout,
) -> tuple[JudgedRow, str]:
    """Return the failing row that shows the likely cause best, its place and the cause.

    It is the cause that most of a few rows show, or a state that explains all of them: one row
    alone, at rest, may show a simpler one.
    """
    spread = list(dict.fromkeys([0, *range(0, len(failing), max(1, len(failing) // EXPLAINED))]))
    rows = [worst, *(failing[k] for k in spread if failing[k] is not worst)][: 2 * EXPLAINED]
    located = [(one, _located(one, columns)) for one in rows]
    causes = Counter(difference.what for _, difference in located if difference.what)
    for cause, times in causes.most_common(1):
        if times > len(rows) // 2:
            shown, difference = next((x, y) for x, y in located if y.what == cause)
            return shown, _placed(columns, difference)
    text = _placed(columns, located[0][1])
    for name, read in _twist_confusions(scene, layout):
        if all(_equals_recorded(one, read(one.row, columns)) for one in rows):
            return worst, f"{text}; as if {name}"
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


def _twist_confusions(
    scene: Scene, layout: TableLayout
) -> Iterator[tuple[str, Callable[[RecordedRow, AnswerColumns], Array]]]:
    """Yield pose and twist as a program may have understood them: (text, function of a row)."""
    if layout.convention is None:
        return

    def value(other: BaseVelocity, row: RecordedRow, columns: AnswerColumns, **how: Any) -> Array:
        as_read = layout._replace(convention=other)
        point = row_of(as_read, scene, row.number, row.values, **how).point(scene)
        return np.asarray(mapped_value(other, columns.plain, point, columns.frame))

    for text, change in OTHER_QUATERNIONS.items():
        yield text, partial(value, layout.convention, quaternion=change)
    for text, other in other_conventions(layout.convention):
        yield f"the twist had {text}", partial(value, other)


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
    return _equals_recorded(judged, value)


def _equals_recorded(judged: JudgedRow, value: Array) -> bool:
    """Return whether the recorded entries of a row are those of a value."""
    entries = list(judged.entries)
    x, y = judged.actual.ravel()[entries], value.ravel()[entries]
    slack = judged.allowed.ravel()[entries] + 1e3 * EPS * np.maximum(np.abs(x), np.abs(y))
    return bool((np.abs(x - y) <= slack).all())


def _is_stale(judged: JudgedRow, columns: AnswerColumns, scene: Scene) -> bool:
    """Return whether a row has the answer of the row before."""
    if judged.before is None:
        return False
    value = np.asarray(columns.quantity.value(judged.before.point(scene), columns.frame))
    return _equals_recorded(judged, value)

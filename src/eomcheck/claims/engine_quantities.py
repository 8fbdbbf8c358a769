"""Claims about the conformance quantities of engines, one for each line of `QUANTITIES`.

An engine's answer is mapped to the scene's coordinates (`Answers.quantity`) and compared with our
own value. A quantity of a frame is asked for a few links per state, other ones in other states. An
engine that does not offer a method has no finding about it, unless the claim is named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from math import gcd
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

from eomcheck.claims.bodies_and_frames import TREE
from eomcheck.claims.case import (
    ONCE,
    UNABLE,
    Case,
    ask_engine,
    compare_with_engine,
    is_blamed,
    skipped_finding,
)
from eomcheck.claims.confusions import ConfusionContext, RowKind
from eomcheck.claims.finding import Finding
from eomcheck.claims.own_coordinates import derivatives_fault, inverse_fault
from eomcheck.claims.registry import case_claim
from eomcheck.descriptions.tree_quantities import BY_COLUMNS, PER_BODY
from eomcheck.engines import Answers, Engine, VelocityMap, engine_class_of, is_under_test
from eomcheck.engines.answers import (
    CORIOLIS_RATE,
    composite_inertia,
    inertia_size,
    turning_rate,
    weight_size,
)
from eomcheck.engines.tree_engine import parameters_at_joint
from eomcheck.errors import RefusedError
from eomcheck.evaluation.conformance import QUANTITIES, ConformancePoint, Quantity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import entry_sensitivity_of, sensitivity_of
from eomcheck.evaluation.tolerance import allowed_error, largest, rounded
from eomcheck.numbers.generic import Array

FEW = 4
"""Largest number of repeated calls of an engine under test for each answer: there are many."""

LINKS_PER_STATE = 3
"""Number of links whose frames are compared in one state; all in the first ones of an engine under
test."""

FAR_APART = 7
"""Least number of links from one that is compared to the next."""


def acceleration_asked(at: Evaluation) -> Array:
    """Return the acceleration v̇ (n,) at which an engine is asked: no two entries are the same."""
    return np.cos(1.0 + np.arange(at.scene.n)) * max(1.0, largest(at.v) ** 2)


def frames_asked(
    at: Evaluation, point: ConformancePoint, known: Callable[[str], bool] = lambda frame: True
) -> tuple[str, ...]:
    """Return the links compared in this state: the last one that moves, and others by q.

    Args:
        at: the state.
        point: the point at that state.
        known: returns whether an engine has the frame of a link; if it has none, all are returned.
    """
    model = point.model
    moving = {name: joint >= 0 for name, joint in zip(model.links, model.joints, strict=True)}
    names = sorted(model.links, key=lambda name: moving[name])
    names = list(filter(known, names)) or names
    if len(names) <= LINKS_PER_STATE:
        return tuple(reversed(names))
    start, others = crc32(np.ascontiguousarray(at.q).tobytes()), len(names) - 1
    step = next(k for k in range(FAR_APART, FAR_APART + others) if gcd(k, others) == 1)
    chosen = (names[(start + step * i) % others] for i in range(LINKS_PER_STATE - 1))
    return names[-1], *chosen


def knows_frame(engine: Engine | type[Engine], frame: str) -> bool:
    """Return whether an engine has the frame of a link; True if it could not be constructed."""
    return isinstance(engine, type) or Answers(engine).has_frame(frame)


def _links_under_test(
    case: Case, engine: Engine, point: ConformancePoint
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the links that an engine under test is asked for, and those that it does not have.

    Where answers are repeated often, in the first states of a run, these are all that it has.
    """
    links = point.model.links
    known = tuple(filter(partial(knows_frame, engine), links))
    unknown = tuple(name for name in links if name not in known)
    if not known or case.repeats > ONCE:
        return known, unknown
    return frames_asked(case.at, point, known.__contains__), unknown


def _some_knows(engines: Sequence[Engine | type[Engine]], frame: str) -> bool:
    return any(knows_frame(engine, frame) for engine in engines)


def cancelling_terms(
    at: Evaluation, point: ConformancePoint, one: Quantity, ours: Array, block: int = 0
) -> float:
    """Return the size of the terms that an engine may sum to a quantity and that may cancel.

    Engines work in frames that turn, where accelerations have terms ω × v, or about the origin of
    the world, where momenta and moments of inertia are those of the mass at its distance. Arms may
    be differences of positions in the world: their errors are relative to these.

    Args:
        at: the state.
        point: the point at that state.
        one: the quantity.
        ours: its value, of derivatives that of the block.
        block: index of the block of derivatives, by q, by v or by τ.
    """
    v = np.abs(at.v)
    turning = turning_rate(at)
    arm = largest(point.links.p) if point.has_tree else 0.0
    local = largest(np.abs(point.links.jacobian) @ v) if point.has_tree else 0.0
    speed = local + turning * arm
    heavy = point.mass * arm if point.has_tree else 0.0
    if one.name == "gravity":
        return at.cached(weight_size)
    if one.mapping in ("force", "rows") or one.name == "forward_dynamics":
        size = inertia_size(at) + at.cached(weight_size)
        size += largest(np.abs(at.terms.M) @ np.abs(point.vdot))
        if one.name != "forward_dynamics":
            return size
        return (size + heavy * turning**2) * largest(point.inverse_mass_matrix)
    if one.name in ("frame_velocity", "center_of_mass_velocity"):
        return speed
    if one.name.startswith(("frame_acc", "frame_bias", "center_of_mass_acc")):
        return turning * speed
    if one.name == "kinetic_energy":
        return heavy * turning * local
    if one.name == "momentum_matrix":
        return arm * largest(ours)
    if one.name.startswith("momentum"):
        rate = turning if one.name == "momentum_rate" else 1.0
        return rate * arm * largest(np.abs(point.momentum.matrix) @ v)
    about_origin = heavy * arm
    if one.mapping == "derivatives" and block < BY_FORCE:
        if block == 0:
            size = about_origin * (largest(point.vdot) + turning * largest(v))
            size += inertia_size(at) + at.cached(weight_size)
            # M v̇ along axes that turn: terms that cancel where nothing depends on q.
            size += largest(np.abs(at.terms.M) @ np.abs(point.vdot))
        else:  # the derivatives of these by v: forces of weight and of v̇ have none
            size = about_origin * (largest(v) + turning)
            size += turning * largest(at.terms.M) + largest(np.abs(at.terms.M) @ v)
        if one.name == "inverse_dynamics_derivatives":
            return size
        inverse = largest(point.inverse_mass_matrix)
        return inverse * (size + at.cached(composite_inertia) * largest(ours))
    if one.name == "coriolis_matrix":
        return inertia_size(at) + turning * heavy * arm * largest(v)
    if one.name == CORIOLIS_RATE:
        return turning * (largest(at.terms.M) + about_origin)
    if one.name == "inverse_mass_matrix" or one.mapping == "derivatives":
        return at.cached(composite_inertia) * largest(ours) ** 2
    return 0.0


BY_FORCE = 2
"""Index of the block of derivatives by τ: those of forward dynamics by τ are M⁻¹."""


def _points(e: Evaluation) -> dict[tuple[bytes, bytes], ConformancePoint]:
    """Return the points at an evaluation that are kept, by v̇ and τ."""
    return {}


def point_at(e: Evaluation, vdot: Array, tau: Array | None = None) -> ConformancePoint:
    """Return the point at an evaluation, or at its perturbed samples, the same one each time."""
    points = e.cached(_points)
    key = vdot.tobytes(), b"" if tau is None else tau.tobytes()
    if key not in points:
        points[key] = ConformancePoint(e, vdot, tau=tau)
    return points[key]


def compared_value(one: Quantity, frame: str, vdot: Array, tau: Array | None, e: Evaluation) -> Any:
    """Return our own value of a quantity at an evaluation, or at its perturbed samples."""
    return one.compared(point_at(e, vdot, tau), frame)


class OwnValue(NamedTuple):
    """Value of a quantity by ourselves, with κ · scale of it and of terms that engines may sum.

    Attributes:
        array: the value.
        sensitivity: κ · scale of the value and of the terms.
        own: κ · scale of the value.
    """

    array: Array
    sensitivity: float
    own: float

    def __sub__(self, other: OwnValue) -> OwnValue:
        """Return the difference, whose errors may add."""
        errors = self.sensitivity + other.sensitivity, self.own + other.own
        return OwnValue(self.array - other.array, *errors)


def _own_values(at: Evaluation) -> dict[tuple[str, str, int], OwnValue]:
    """Return the own values at a state that are kept, by quantity, link and block."""
    return {}


def own_value(
    at: Evaluation, one: Quantity, frame: str, own: Any, point: Any, block: int = 0
) -> OwnValue:
    """Return our own value of a quantity at a state, the same one for all engines."""
    values = at.cached(_own_values)

    def value(q: Array) -> OwnValue:
        there = at if q is at.q else at.elsewhere(q)
        array = np.asarray(own(there), np.float64)
        without_terms = sensitivity_of(there, own, coordinates=True)
        sensitivity = without_terms + cancelling_terms(at, point, one, array, block)
        return OwnValue(array, sensitivity, without_terms)

    if (one.name, frame, block) not in values:
        values[one.name, frame, block] = one.up_to_constant(value, at.q)
    return values[one.name, frame, block]


MASS_MATRIX_RATE = QUANTITIES["coriolis_matrix"]._replace(
    name=CORIOLIS_RATE,
    symbol="C + Cᵀ",
    mapping="matrix",
    value=lambda point, frame: point.coriolis_matrix + point.coriolis_matrix.T,
)
"""Sum of a Coriolis matrix and its transpose: Ṁ, for engines that declare `coriolis_skew`."""


class ComparedBlock(NamedTuple):
    """An array that is compared by itself: a quantity, or its derivatives by q, by v or by τ.

    Each has a bound of its own: one of them may be larger than another by any factor.

    Attributes:
        symbol: symbol of the derivatives; "" for a quantity that is one array.
        position: index among the blocks of the quantity.
        columns: its columns in the quantity, all of an array that is one.
        own: its value by ourselves, with the sensitivity to rounding.
        value: function of an evaluation, or of its perturbed samples -> its value by ourselves.
        names: names along each axis.
    """

    symbol: str
    position: int
    columns: Any
    own: OwnValue
    value: Callable[[Evaluation], Any]
    names: tuple[tuple[str, ...], ...]


def _blocks(
    at: Evaluation, point: ConformancePoint, one: Quantity, frame: str, own: Any
) -> Iterator[ComparedBlock]:
    """Yield the blocks of a quantity, of which `own` is the value by ourselves."""
    names = one.axis_names(point)
    if one.mapping != "derivatives":
        ours = own_value(at, one, frame, own, point)
        yield ComparedBlock("", 0, ..., ours, own, names[: ours.array.ndim])
        return
    n = at.scene.n
    for k, symbol in enumerate(one.symbol.split(", ")):
        columns = np.s_[:, k * n : (k + 1) * n]
        value = partial(_columns_of, own, columns)
        ours = own_value(at, one, frame, value, point, k)
        yield ComparedBlock(symbol, k, columns, ours, value, (names[0], names[1][columns[1]]))


def _columns_of(own: Callable[[Evaluation], Any], columns: Any, e: Evaluation) -> Any:
    """Return columns of a quantity at an evaluation, or at its perturbed samples."""
    return own(e)[columns]


def _compare(
    case: Case, engine: Engine | type[Engine], one: Quantity, frame: str
) -> Iterator[Finding]:
    """Yield the Findings of a quantity, of one link, being equal to that of an engine."""
    at = case.at
    if reason := _incomparable(engine, one, at, frame):
        yield skipped_finding(case, engine_class_of(engine), reason)
        return
    vdot = rounded(acceleration_asked(at), at.unit_roundoff)
    point = point_at(at, vdot)
    tau = rounded(point.torques, at.unit_roundoff) if "tau" in one.arguments else None
    own = partial(compared_value, one, frame, vdot, tau)
    blocks = list(_blocks(at, point, one, frame, own))
    ours = np.concatenate([x.own.array for x in blocks], -1) if blocks[1:] else blocks[0].own.array
    arguments = at.q, at.v, vdot if tau is None else tau, frame, at.t
    errors = partial(_in_own_sizes, blocks)
    how: dict[str, Any] = {"expected": lambda: errors(ours), "part": errors, "asks": one.name}
    theirs = ask_engine(case, engine, *arguments, **how, most_repeats=FEW)
    if isinstance(theirs, Finding) or isinstance(engine, type):
        yield theirs
        return
    for block in blocks:
        yield _compare_block(case, engine, one, frame, point, arguments, theirs, ours, block)


def _in_own_sizes(blocks: Sequence[ComparedBlock], array: Array) -> Array:
    """Return an array whose blocks are divided by their sizes: the worst answer is chosen by it."""
    if not blocks[1:]:
        return array
    parts = [array[x.columns] / (x.own.sensitivity or 1.0) for x in blocks]
    return np.concatenate(parts, -1)


def _compare_block(
    case: Case,
    engine: Engine,
    one: Quantity,
    frame: str,
    point: ConformancePoint,
    arguments: tuple[Array, Array, Array, str, float],
    theirs: Array,
    whole: Array,
    block: ComparedBlock,
) -> Finding:
    """Return the Finding of a block being equal to that of an engine.

    Args:
        case: the state, and the claim being checked.
        engine: the engine.
        one: the quantity.
        frame: name of the link, "" for a quantity of none.
        point: the point.
        arguments: those with which the engine was asked.
        theirs: its answer, all blocks.
        whole: the expected answer, all blocks.
        block: the block.
    """
    at, ours = case.at, block.own.array
    part = one.symbol if one is MASS_MATRIX_RATE else frame or block.symbol
    size = block.own.sensitivity
    if not is_under_test(type(engine)):
        size += engine.quantity_size(one.name, *arguments[:3], at.t)
    finding = compare_with_engine(
        case,
        engine,
        f"{engine.key}, {part}" if part else engine.key,
        ours,
        theirs[block.columns],
        size,
        lambda answers: answers.ask(one.name, *arguments)[block.columns],
        names=block.names,
        scale=size,
        own=partial(entry_sensitivity_of, at, block.value),
        context=partial(context_of, one, frame, point),
    )
    if finding.verdict == "failed" and is_blamed(type(engine)):
        text, arrays = "", (theirs, whole)
        with suppress(*UNABLE):
            if one.mapping == "derivatives":
                where = block.position, finding.allowed
                text = derivatives_fault(engine, one, point, arguments, arrays, *where)
            elif one.mapping == "inverse":
                text = inverse_fault(engine, *arguments[:2], arrays, finding.allowed)
        return finding.because(text) if text else finding
    # A bound as large as a value that is more than rounding: zeros would pass as well.
    noise = allowed_error(block.own.own, at.unit_roundoff)
    if finding.verdict == "passed" and noise < largest(ours) <= finding.allowed:
        return replace(finding, verdict="inconclusive")
    return finding


ROWS: dict[str, RowKind] = {
    "center_of_mass": "point",
    "center_of_mass_jacobian": "vector",
    "center_of_mass_velocity": "vector",
    "center_of_mass_acceleration": "vector",
    "momentum": "force",
    "momentum_matrix": "force",
    "momentum_rate": "force",
    "frame_velocity": "motion",
    "frame_jacobian": "motion",
    "frame_acceleration": "acceleration",
    "frame_bias": "acceleration",
}
"""Quantity -> kind of its rows."""

ORIGIN = "the origin of the world"


def context_of(one: Quantity, frame: str, point: ConformancePoint) -> ConfusionContext:
    """Return the axes, points and summands by which confusions of a quantity are recognized."""
    context = ConfusionContext(ROWS.get(one.name, ""), terms=_summands(one, point))
    if one.of_frame:
        link = point.link(frame)
        if one.name == "frame_acceleration":
            context = context._replace(terms={"J̇ v": link.bias})
        context = context._replace(
            R=link.R,
            frame=frame,
            point="the frame's origin",
            arms={ORIGIN: -link.p},
            omega=link.velocity[3:],
            velocity=link.velocity[:3],
        )
    elif context.rows == "force":
        arms = {ORIGIN: -point.center.position}
        context = context._replace(point="the centre of mass", arms=arms)
    if one.name == "inverse_mass_matrix":
        return context._replace(alternatives={"the mass matrix": point.at.terms.M})
    if one.name == "regressor":
        Y = point.regressor.Y
        columns = [PER_BODY * b + i for b in range(Y.shape[1] // PER_BODY) for i in BY_COLUMNS]
        text = "products of inertia in the order xx, xy, yy, xz, yz, zz"
        turned = "along the axes of the joints, expected along those of the links"
        alternatives = {text: Y[:, columns], turned: _regressor_of_joints(point)}
        return context._replace(alternatives=alternatives)
    return context


def _regressor_of_joints(point: ConformancePoint) -> Array:
    """Return the regressor of parameters along the axes of joints, not of links, about the links.

    Libraries that are handed a tree of joints turn them, or forget to.
    """
    tree, Y = point.at.scene.tree(), np.array(point.regressor.Y)
    assert tree is not None
    frames = {frame.name: frame for frame in tree.frames}
    for b, name in enumerate(point.model.bodies):
        columns = np.s_[:, PER_BODY * b : PER_BODY * (b + 1)]
        turned = frames[name]._replace(p=np.zeros(3))
        Y[columns] = Y[columns] @ np.linalg.inv(parameters_at_joint(turned))
    return Y


def _summands(one: Quantity, point: ConformancePoint) -> dict[str, Array]:
    """Return the summands of a quantity that engines forget or add, by name."""
    if not point.has_tree:
        return {}
    weight, bias = point.weight.gradient, point.bias
    if one.name == "inverse_dynamics":
        return {"gravity": weight, "the bias": bias, "M v̇": point.inertia_force - bias}
    if one.name == "forward_dynamics":
        with suppress(RefusedError):
            inverse = point.inverse_mass_matrix
            return {"gravity": -inverse @ weight, "the bias": -inverse @ bias}
    if one.name == "center_of_mass_acceleration":
        return {"J̇ v": point.center.acceleration - point.center.jacobian @ point.vdot}
    if one.name == "momentum_rate":
        return {"Ȧ v": point.momentum.rate - point.momentum.matrix @ point.vdot}
    return {}


BY_DIFFERENCES = "its derivatives are difference quotients"


def by_differences(kind: type[Engine], method: str) -> bool:
    """Return whether a method returns derivatives that an engine takes by differences."""
    return QUANTITIES[method].mapping == "derivatives" and kind.derivatives_by_differences


SOLVED = "acceleration", "inverse"
"""Mappings of results of a solve, which is another one where joints of an engine follow others."""


def _map_of(engine: Engine, at: Evaluation) -> VelocityMap | None:
    """Return the velocity map of an engine, None for one in the scene's coordinates."""
    if not engine.offers("velocity_map"):
        return None
    try:
        return Answers(engine).velocity_map(at.q, at.v)
    except UNABLE:
        return None  # it is asked, and the fault is reported


def follow(engine: Engine, at: Evaluation) -> bool:
    """Return whether an engine has more velocities than the scene, some of which follow others."""
    own = _map_of(engine, at)
    return own is not None and own.S.shape[0] > own.S.shape[1]


def turns(engine: Engine, at: Evaluation) -> bool:
    """Return whether the map S of an engine's velocities changes with q, also where v = 0.

    By ∂(S v)/∂q of unit velocities.
    """
    if _map_of(engine, at) is None:
        return False
    answers = Answers(engine)
    try:
        return any(answers.map_derivatives(at.q, unit)[0].any() for unit in np.eye(at.scene.n))
    except UNABLE:
        return False  # it is asked


def _no_frame(*links: str) -> str:
    """Return the reason why links are not compared: an engine has no frames of them."""
    return f"its model has no frame of link {', '.join(links)}"


def _incomparable(engine: Engine | type[Engine], one: Quantity, at: Evaluation, frame: str) -> str:
    """Return the reason why a quantity of an engine is not compared; "" if it is."""
    if isinstance(engine, type):
        return ""
    if frame and not knows_frame(engine, frame):
        return _no_frame(frame)
    if one.name in QUANTITIES and by_differences(type(engine), one.name):
        return BY_DIFFERENCES
    if (one.mapping == "derivatives" or one is MASS_MATRIX_RATE) and not (
        engine.offers("velocity_map_derivatives") or not engine.offers("velocity_map")
    ):
        return "it does not offer velocity_map_derivatives"
    if one.name == "constraint_force_derivatives" and turns(engine, at):
        return "its velocities are no constant sums of the scene's"
    if one.mapping in SOLVED or one.name == "forward_dynamics_derivatives":
        return "its joints that follow others are independent there" if follow(engine, at) else ""
    return ""


def engines_offering(case: Case, method: str) -> Iterator[Engine | type[Engine]]:
    """Yield the engines that offer a method; those that could not be constructed among them."""
    for engine in (*case.engines, *case.unavailable):
        if engine_class_of(engine).offers(method):
            yield engine


def _check(one: Quantity, case: Case) -> Iterator[Finding]:
    """Yield the Findings of a quantity of all engines that offer it."""
    if "r" in one.shape and not case.at.scene.r:
        return
    engines = list(engines_offering(case, one.name))
    known = partial(_some_knows, engines)
    for engine in engines:
        rounded_case = case.rounded_for(engine)
        at, point = rounded_case.at, ConformancePoint(rounded_case.at)
        if one.lacks(point):
            continue
        frames = frames_asked(at, point, known) if one.of_frame else ("",)
        if one.of_frame and not isinstance(engine, type) and is_under_test(type(engine)):
            frames, unknown = _links_under_test(rounded_case, engine, point)
            if unknown:
                reason = _no_frame(*unknown)
                yield skipped_finding(rounded_case, type(engine), reason)
        for frame in frames:
            try:
                yield from _compare(rounded_case, engine, one, frame)
            except RefusedError as refusal:
                outcome = 0.0, 0.0, "skipped", "property-tested", str(refusal)
                yield case.finding(frame or one.name, *outcome)
        declared = one.mapping == "coriolis" and engine_class_of(engine).coriolis_skew
        if declared and not isinstance(engine, type):
            yield from _compare(rounded_case, engine, MASS_MATRIX_RATE, "")


EVERY = 4
"""Only each such state of a run is checked, unless engines are named."""


def _register(one: Quantity) -> str:
    """Register the claim about a quantity, and return its id."""
    id = "engine-" + one.name.replace("_", "-")
    about = id, f"{one.symbol} = {one.symbol} of the engine", "", one.name
    needs = [TREE] if one.needs_tree else []
    needs += ["constraints"] if "r" in one.shape else []

    @case_claim(*about, asks=one.name, needs=", and ".join(needs), every=EVERY)
    def check(case: Case) -> Iterator[Finding]:
        return _check(one, case)

    check.__name__ = check.__qualname__ = f"engine_{one.name}"
    return id


CONFORMANCE = tuple(map(_register, QUANTITIES.values()))
"""Ids of the claims here."""

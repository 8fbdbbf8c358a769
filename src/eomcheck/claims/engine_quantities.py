"""Claims about the conformance quantities of engines, one for each line of `QUANTITIES`.

An engine's answer is mapped to the scene's coordinates (`Answers.quantity`) and compared with our
own value. A quantity of a frame is asked for a few links per state, other ones in other states. An
engine that does not offer a method has no finding about it, unless the claim is named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any
from zlib import crc32

import numpy as np

from eomcheck.claims.case import (
    UNABLE,
    Case,
    ask_engine,
    compare_with_engine,
    skipped_finding,
)
from eomcheck.claims.finding import Finding
from eomcheck.claims.registry import case_claim
from eomcheck.engines import Answers, Engine, engine_class_of, is_under_test
from eomcheck.engines.engine import inertia_size, turning_rate, weight_size
from eomcheck.errors import RefusedError
from eomcheck.evaluation.conformance import QUANTITIES, ConformancePoint, Quantity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import sensitivity_of
from eomcheck.evaluation.tolerance import largest, rounded
from eomcheck.numbers.generic import Array

FEW = 4
"""Largest number of repeated calls of an engine under test for each answer: there are many."""

LINKS_PER_STATE = 3
"""Number of links whose frames are compared in one state."""


def acceleration_asked(at: Evaluation) -> Array:
    """Return the acceleration v̇ (n,) at which an engine is asked: no two entries are the same."""
    return np.cos(1.0 + np.arange(at.scene.n)) * max(1.0, largest(at.v) ** 2)


def frames_asked(
    at: Evaluation, point: ConformancePoint, known: Callable[[str], bool] = lambda frame: True
) -> tuple[str, ...]:
    """Return the links compared in this state: the last one, and others by q; none at rest.

    Args:
        at: the state.
        point: the point at that state.
        known: returns whether an engine has the frame of a link; if it has none, all are returned.
    """
    model = point.model
    names = [name for name, joint in zip(model.links, model.joints, strict=True) if joint >= 0]
    names = list(filter(known, names)) or names
    if len(names) <= LINKS_PER_STATE:
        return tuple(names)
    start = crc32(np.ascontiguousarray(at.q).tobytes())
    others = [names[(start + 7 * i) % (len(names) - 1)] for i in range(LINKS_PER_STATE - 1)]
    return tuple(dict.fromkeys((names[-1], *others)))


def knows_frame(engine: Engine | type[Engine], frame: str) -> bool:
    """Return whether an engine has the frame of a link; True if it could not be constructed."""
    return isinstance(engine, type) or Answers(engine).has_frame(frame)


def _some_knows(engines: Sequence[Engine | type[Engine]], frame: str) -> bool:
    return any(knows_frame(engine, frame) for engine in engines)


def cancelling_terms(at: Evaluation, point: ConformancePoint, one: Quantity, ours: Array) -> float:
    """Return the size of the terms that an engine may sum to a quantity and that may cancel.

    Engines work in frames that turn, where accelerations have terms ω × v, or about the origin of
    the world, where momenta and moments of inertia are those of the mass at its distance. Arms may
    be differences of positions in the world: their errors are relative to these.
    """
    v = np.abs(at.v)
    turning = turning_rate(at)
    arm = largest(point.links.p) if point.has_tree else 0.0
    local = largest(np.abs(point.links.jacobian) @ v) if point.has_tree else 0.0
    speed = local + turning * arm
    heavy = point.mass * arm if point.has_tree else 0.0
    if one.mapping in ("force", "rows") or one.name == "forward_dynamics":
        size = inertia_size(at) + at.cached(weight_size)
        size += largest(np.abs(at.terms.M) @ np.abs(point.vdot))
        if "tau" not in one.arguments:
            return size
        return (size + heavy * turning**2) * largest(point.inverse_mass_matrix)
    if one.name in ("frame_velocity", "center_of_mass_velocity"):
        return speed
    if one.name.startswith(("frame_acc", "frame_bias", "center_of_mass_acc")):
        return turning * speed
    if one.name == "kinetic_energy":
        return heavy * turning * local
    if one.name.startswith("momentum"):
        rate = turning if one.name == "momentum_rate" else 1.0
        return rate * arm * largest(np.abs(point.momentum.matrix) @ v)
    if one.name == "coriolis_matrix":
        return inertia_size(at) + turning * heavy * arm * largest(v)
    if one.name == "inverse_mass_matrix":
        return heavy * arm * largest(ours) ** 2
    return 0.0


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


def _value(one: Quantity, frame: str, vdot: Array, tau: Array | None, e: Evaluation) -> Any:
    """Return our own value of a quantity at an evaluation, or at its perturbed samples."""
    point = point_at(e, vdot, tau)
    return point.bias if one.name == "coriolis_matrix" else one.value(point, frame)


def _compare(case: Case, one: Quantity, frame: str) -> Iterator[Finding]:
    """Yield the Findings of one quantity, of one link, being equal to those of the engines."""
    groups: dict[int, tuple[Case, list[Engine | type[Engine]]]] = {}
    for engine in engines_offering(case, one.name):
        at_state = case.rounded_for(engine)
        groups.setdefault(id(at_state), (at_state, []))[1].append(engine)
    for at_state, engines in groups.values():
        yield from _compare_at(at_state, engines, one, frame)


def _compare_at(
    case: Case, engines: Sequence[Engine | type[Engine]], one: Quantity, frame: str
) -> Iterator[Finding]:
    """Yield the Findings of engines that are asked at one state: that of their own numbers."""
    at, u = case.at, case.at.unit_roundoff
    vdot = rounded(acceleration_asked(at), u)
    point = point_at(at, vdot)
    tau = rounded(point.torques, u) if "tau" in one.arguments else None
    own = partial(_value, one, frame, vdot, tau)
    ours = np.asarray(own(at), np.float64)
    sensitivity = sensitivity_of(at, own, coordinates=True)
    sensitivity += cancelling_terms(at, point, one, ours)
    if one.name == "potential_energy":  # it is known up to a constant
        origin = Evaluation(at.scene, 0.0 * at.q, at.v, at.t)
        ours = ours - own(origin)
        sensitivity += sensitivity_of(origin, own, coordinates=True)
    names = one.axis_names(point)[: ours.ndim]
    arguments = at.q, at.v, vdot if tau is None else tau, frame, at.t
    asked = replace(case, repeats=min(case.repeats, FEW))
    for engine in engines:
        if frame and not knows_frame(engine, frame):
            why = f"its model has no frame of link {frame}"
            yield skipped_finding(case, engine_class_of(engine), why)
            continue
        if one.mapping in SOLVED and isinstance(engine, Engine) and follow(engine, at):
            why = "its joints that follow others are independent there"
            yield skipped_finding(case, type(engine), why)
            continue
        theirs = ask_engine(asked, engine, *arguments, expected=lambda: ours)
        if isinstance(theirs, Finding) or isinstance(engine, type):
            yield theirs
            continue
        subject = f"{engine.key}, {frame}" if frame else engine.key
        again = partial(_asked_again, one.name, arguments)
        size = sensitivity
        if not is_under_test(type(engine)):
            size += engine.quantity_size(one.name, *arguments[:3], at.t)
        compared = asked, engine, subject, ours, theirs, size, again
        yield compare_with_engine(*compared, names=names, scale=size)


SOLVED = "acceleration", "inverse"
"""Mappings of results of a solve, which is another one where joints of an engine follow others."""


def follow(engine: Engine, at: Evaluation) -> bool:
    """Return whether an engine has more velocities than the scene, some of which follow others."""
    if not engine.offers("velocity_map"):
        return False
    try:
        S = Answers(engine).velocity_map(at.q, at.v).S
    except UNABLE:
        return False  # it is asked, and the fault is reported
    return S.shape[0] > S.shape[1]


def _asked_again(method: str, arguments: tuple[Any, ...], answers: Answers) -> Any:
    return answers.ask(method, *arguments)


def engines_offering(case: Case, method: str) -> Iterator[Engine | type[Engine]]:
    """Yield the engines that offer a method; those that could not be constructed among them."""
    for engine in (*case.engines, *case.unavailable):
        if engine_class_of(engine).offers(method):
            yield engine


def _check(one: Quantity, case: Case) -> Iterator[Finding]:
    point, engines = ConformancePoint(case.at), list(engines_offering(case, one.name))
    if one.needs_tree and not point.has_tree:
        for engine in engines:
            why = "the scene has no tree of bodies"
            yield skipped_finding(case, engine_class_of(engine), why)
        return
    if not engines:
        return
    known = partial(_some_knows, engines)
    for frame in frames_asked(case.at, point, known) if one.of_frame else ("",):
        try:
            yield from _compare(case, one, frame)
        except RefusedError as refusal:
            outcome = 0.0, 0.0, "skipped", "property-tested", str(refusal)
            yield case.finding(frame or one.name, *outcome)


def _register(one: Quantity) -> str:
    """Register the claim about a quantity, and return its id."""
    id = "engine-" + one.name.replace("_", "-")

    @case_claim(id, f"{one.symbol} = {one.symbol} of the engine", "", one.name, asks=one.name)
    def check(case: Case) -> Iterator[Finding]:
        return _check(one, case)

    check.__name__ = check.__qualname__ = f"engine_{one.name}"
    return id


CONFORMANCE = tuple(map(_register, QUANTITIES.values()))
"""Ids of the claims here."""

"""Run time of derivatives of accelerations in machine code, beside Pinocchio's.

∂v̇/∂q, ∂v̇/∂v and ∂v̇/∂τ, with v̇ itself, at 10⁴ different states. Ours are called by a loop in
machine code; Pinocchio's `computeABADerivatives` of the same tree, for scenes without constraints,
is called from Python. The same call for a tree without joints, which computes nothing, is timed
beside it, and subtracted in the ratios. Times are medians per state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from eomcheck.console import progress
from eomcheck.engines.engine import required
from eomcheck.engines.pinocchio import PinocchioEngine
from eomcheck.formulations import Formulation, formulations_for
from eomcheck.kernels.kernel import call_along_rows
from eomcheck.lab.option_parsing import Kind, Repeats, check_count
from eomcheck.lab.show.table import ResultTable, seconds_text
from eomcheck.lab.store.record_file import Record, Settings, group, record_of_rows, rows_in
from eomcheck.lab.studies.rhs import PINOCCHIO, Call, Job, Timing, time_calls, usual_state
from eomcheck.lab.study import Formulations, Study, document_of, failed
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.compiled_derivatives import compile_derivatives
from eomcheck.numbers.generic import Array
from eomcheck.scene_lookup import scene_classes_named

STATES = 10_000
"""Number of different states."""

SPREAD = 0.1
"""Standard deviation of coordinates, velocities and forces about those of an ordinary state."""

ALONE = f"{PINOCCHIO}, no joints"
"""Name of the timing of Pinocchio's call for a tree without joints."""


def _states(scene: Scene) -> tuple[Array, Array, Array]:
    """Return q, v and τ (k, n) of random states about an ordinary one."""
    state, random = usual_state(scene), np.random.default_rng(0)
    q, v, tau = SPREAD * random.normal(size=(3, STATES, scene.n))
    return state.q + q, state.v + v, tau


def _formulation_call(formulation: Formulation, scene: Scene) -> Call:
    """Return a function that differentiates by a formulation at k states, one after the other."""
    compiled = compile_derivatives(scene, formulation.key)
    y = np.ascontiguousarray(np.concatenate(_states(scene), axis=1)[..., None])
    t, out = np.zeros((STATES, 1)), np.empty((STATES, compiled.kernel.size, 1))
    last = compiled.kernel.last_argument(compiled.block)

    def call(count: int) -> None:
        for first in range(0, count, STATES):
            size = min(STATES, count - first)
            call_along_rows(compiled.kernel.address, last, t[:size], y[:size], out[:size])

    return call


def _pinocchio_calls(scene: Scene) -> Iterator[tuple[str, Call]]:
    """Yield Pinocchio's algorithm at k states, and for a tree without joints."""
    pin, engine = required(PINOCCHIO), PinocchioEngine(scene)
    T = engine.coordinates
    q, v, tau = _states(scene)
    states = q @ T.T + engine.shift, v @ T.T, tau @ np.linalg.inv(T)
    empty = pin.Model()
    none = np.zeros((STATES, 0))
    for what, model, (x, xd, force) in (
        (PINOCCHIO, engine.model, states),
        (ALONE, empty, (none, none, none)),
    ):
        yield what, _loop(pin.computeABADerivatives, model, list(zip(x, xd, force, strict=True)))


def _loop(function: Callable, model: object, states: list[tuple[Array, ...]]) -> Call:
    data = model.createData()  # type: ignore[attr-defined]

    def call(count: int) -> None:
        for i in range(count):
            x, xd, force = states[i % STATES]
            function(model, data, x, xd, force)

    return call


# ---- The study -----------------------------------------------------------------------------------


def cells(
    *, scene: Kind = "chain-pendulum", formulation: Formulations = None, repeats: Repeats = 15
) -> Iterator[Settings]:
    """Yield a cell for each scene class.

    Raises:
        InputError: a number of repeats below 1, or a formulation that does not apply.
        UnknownNameError: no such scene or formulation.
    """
    check_count(repeats=repeats)
    for kind in scene_classes_named(scene):
        formulations_for(kind, formulation)
        yield {"scene": kind.key, "formulations": formulation, "repeats": repeats}


def worker(
    stored: Sequence[Record], *, scene: Kind = "chain-pendulum"
) -> Callable[[Settings], Record]:
    """Return the function that times the derivatives of a scene class."""
    kinds = {kind.key: kind for kind in scene_classes_named(scene)}

    def timed(settings: Settings) -> Record:
        example = kinds[settings["scene"]].example()
        formulations = formulations_for(example, settings["formulations"])

        def jobs() -> Iterator[Job]:
            for f in formulations:
                yield f.key, 0, _formulation_call(f, example)
            if not example.r and PinocchioEngine.represents(example):
                for what, call in _pinocchio_calls(example):
                    yield what, 0, call

        repeats = settings["repeats"]
        count = (1 + repeats) * (len(formulations) + 2)
        with progress("making code and timing it in {step}", count) as advance:
            timings = time_calls(settings["scene"], jobs(), repeats, advance)
        return record_of_rows(STUDY.key, settings, timings)

    return timed


def tables(records: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield, for each scene, median times per state and their ratios to Pinocchio's."""
    for key, rows in group(rows_in(records, Timing), lambda timing: timing.scene).items():
        seconds = {timing.what: timing.seconds for timing in rows}
        theirs = seconds[PINOCCHIO] - seconds[ALONE] if PINOCCHIO in seconds else None
        table = [
            (
                timing.what,
                seconds_text(timing.seconds),
                "" if theirs is None or timing.what == ALONE else f"{timing.seconds / theirs:.2f}",
                seconds_text(timing.compile_seconds),
            )
            for timing in rows
        ]
        sheet = ResultTable(
            f"differentiation-{key}",
            f"Median time of the derivatives of one state, {key}",
            ("derivatives", "time", "of Pinocchio's, without its call", "making it"),
            table,
        )
        yield sheet if theirs is not None else sheet.without("of Pinocchio's, without its call")


STUDY = Study(
    key="differentiation",
    cells=cells,
    worker=worker,
    tables=tables,
    label="",
    alarm=failed,
    document=document_of("timings", Timing),
    small=True,
)

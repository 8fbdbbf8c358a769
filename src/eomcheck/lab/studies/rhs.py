"""The cost of one right-hand side: every formulation, over the number of links.

All in one run and one process: the right-hand sides as integrators call them, in a loop of machine
code; the sines and cosines of the angles alone, by the C library; the same source for Kane's method
as C code that CasADi writes, compiled by `gcc -O2` where there is a compiler; and Pinocchio on the
same tree, called from Python as its users do: `aba`, or with constraints `computeAllTerms` and
`forwardDynamics`. Kane's method in lanes counts by the state. Medians of warm runs; what making
them ready takes stands apart.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median, quantiles
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Annotated

import numpy as np

from eomcheck import strategies
from eomcheck.console import progress
from eomcheck.engines.engine import required
from eomcheck.engines.pinocchio import PinocchioEngine
from eomcheck.errors import InputError
from eomcheck.evaluation.dynamics import speeds_of, velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.formulations import FORMULATIONS, Formulation, formulations_for
from eomcheck.kernels.kernel import sincos_timing_loop, timing_loop
from eomcheck.lab.option_parsing import Kind, Repeats, Set, check_count, parse_parameters
from eomcheck.lab.run_time import slope
from eomcheck.lab.show.document_text import seconds_text
from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.record_file import Record, Settings, group, record_of_rows, rows_in
from eomcheck.lab.strategy_samples import draw_samples
from eomcheck.lab.study import Formulations, Study, document_of, failed
from eomcheck.mechanics.parameters import with_parameters
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.batch import lane_parameters
from eomcheck.motion.right_hand_side import (
    RightHandSide,
    kernel_of,
    parameter_arrays,
    parameter_record,
    state_of,
)
from eomcheck.numbers.dual import RecordingArithmetic
from eomcheck.numbers.generic import FLOAT64, Angles, Array
from eomcheck.numbers.symbolic import CasadiArithmetic
from eomcheck.scene_lookup import scene_classes_named
from eomcheck.scenes import Snake

LINKS = (7, 20, 100, 1000, 10000)
DENSE_LIMIT = 200
"""Largest N for what costs O(N³), unless a formulation is named."""
BATCH_SECONDS = 0.02
"""A timed batch repeats the call until it takes about this long."""

TRIGONOMETRY = "sin, cos"
KANE = "kane"
LANES = 8
CASADI = "casadi, C"
PINOCCHIO = PinocchioEngine.key
ABA = f"{PINOCCHIO}, aba"


@dataclass(frozen=True)
class Timing:
    """Seconds of one call: `what` at N = `links`.

    `seconds` is the median over batches, `quartiles` the lower and the upper one. `compile_seconds`
    is what making it ready took.
    """

    scene: str
    what: str
    links: int
    seconds: float
    quartiles: tuple[float, float]
    compile_seconds: float


def bench_state(
    kind: type[Scene],
    links: int | None,
    given: Mapping[str, Sequence[float] | None] = MappingProxyType({}),
) -> tuple[Scene, Array, Array]:
    """Return a scene in motion, (scene, q, u), with the parameters that are `given`.

    Snakes are coiled as the paper's robot, by 44° from link to link: their angles go all around, as
    those of robots do. With wheels nearly along the links W does not grow.
    """
    if kind is not Snake:
        scene = kind.example() if links is None else next(kind.structures(links))
        scene = with_parameters(scene, given)
        ((state,),) = draw_samples(strategies.states(scene).map(lambda state: (state,)), 1, 0)
        return scene, state.q, speeds_of(scene, state.q, state.v)
    assert links is not None
    one, k = np.ones(links), np.arange(links)
    snake = Snake(one, one, one / 12, 10.0 * one[1:], 0.2 * np.cos(k))
    theta = np.radians(44.0) * (k + 1)
    return with_parameters(snake, given), np.concatenate(([0.0, 0.0], theta)), np.array([1.0, 0.3])


Call = Callable[[int], object]
"""What does something so many times."""

Job = tuple[str, int, Call]
"""What is timed, at how many links, and a function call(k) that does it k times."""


def time_calls(
    scene: str, jobs: Iterable[Job], repeats: int, advance: Callable[[], None] = lambda: None
) -> list[Timing]:
    """Time jobs in turn, one batch of each, so often: a slow second is one of all of them.

    Args:
        scene: key of the scene.
        jobs: what is timed; each is made when its turn comes.
        repeats: batches of each, of which the median counts.
        advance: called after each job is made, and after each batch.
    """
    ready, began = [], time.perf_counter()
    for what, links, call in jobs:
        first, count = time.perf_counter() - began, 1
        for _ in range(3):  # one call is mostly the way into compiled code
            count = max(1, round(BATCH_SECONDS * count / max(_seconds(call, count), 1e-7)))
        ready.append((what, links, call, count, first))
        advance()
        began = time.perf_counter()
    batches: list[list[float]] = [[] for _ in ready]
    for _ in range(repeats):
        for (_, _, call, count, _), seconds in zip(ready, batches, strict=True):
            seconds.append(_seconds(call, count) / count)
            advance()
    return [
        _timing(scene, what, links, seconds, first)
        for (what, links, _, _, first), seconds in zip(ready, batches, strict=True)
    ]


def _seconds(call: Callable[[int], object], count: int) -> float:
    start = time.perf_counter()
    call(count)
    return time.perf_counter() - start


def _timing(scene: str, what: str, links: int, seconds: list[float], first: float) -> Timing:
    low, _, high = quantiles(seconds, n=4) if len(seconds) > 1 else [seconds[0]] * 3
    middle = median(seconds)
    return Timing(scene, what, links, middle, (low, high), first)


def _formulation_call(formulation: Formulation, scene: Scene, q: Array, u: Array) -> Call:
    at = Evaluation(scene, q, np.zeros(scene.n))
    at.u = u
    # Not `velocity`, which looks at the full constraint Jacobian.
    at.v = at.velocity
    return rate_call(at, formulation)


def rate_call(at: Evaluation, formulation: Formulation) -> Call:
    """Return what calls the right-hand side, as an integrator does, so many times at a state."""
    rates, y = RightHandSide(at.scene, formulation), state_of(at, formulation)
    out = np.empty_like(y)
    pointers = (x.ctypes.data for x in (out, y, rates.arguments))
    call = timing_loop(rates.address, *pointers)
    alive = out, y, rates
    return lambda count: (call(count), alive)[0]


def _angles(scene: Scene, q: Array) -> Array:
    """Return the angles (k,), rad, whose sines and cosines the scene asks for."""
    recorder = RecordingArithmetic(FLOAT64)
    scene.prepare(recorder, scene.parameters(FLOAT64), q, 0.0)
    made = [one.value for one in recorder.recorded if isinstance(one, Angles)]
    return np.concatenate([np.empty(0), *made])


def _lanes_call(formulation: Formulation, scene: Scene, q: Array, u: Array) -> Call:
    """Return what calls the right-hand side for `LANES` states at once, so many in all."""
    kernel = kernel_of(scene, formulation, width=LANES)
    y = np.ascontiguousarray(np.tile(np.concatenate((q, u))[:, None], LANES))
    t, out = np.zeros(LANES), np.empty((kernel.size, LANES))
    last = kernel.last_argument(kernel.block(lane_parameters([scene] * LANES)))
    call = timing_loop(kernel.address, *(x.ctypes.data for x in (out, t, y, last)))
    alive = kernel, y, t, out, last
    return lambda count: (call(-(-count // LANES)), alive)[0]


def _casadi_call(scene: Scene, q: Array, u: Array) -> Call | None:
    """Return Kane's right-hand side in C as CasADi writes it, by the compiler; None without one."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        return None
    symbols, names = CasadiArithmetic(), parameter_arrays(scene)
    columns, given = [], {}
    for name, x in names.items():
        column, entries = symbols.variables(name, x.size)
        columns.append(column)
        given[name] = entries.reshape(x.shape)
    column, y = symbols.variables("y", scene.n + scene.p)
    time_now = symbols.casadi.SX.sym("t")
    at = Quantities(scene, symbols, y[: scene.n], time_now)
    at.parameters = parameter_record(scene, given)
    at.u = y[scene.n :]
    rates = symbols.casadi.vertcat(*at.qdot, *at.rates(FORMULATIONS[KANE]).vdot)
    function = symbols.casadi.Function("kane", [column, time_now, *columns], [rates])
    generator = symbols.casadi.CodeGenerator("kane.c")
    generator.add(function)
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        generator.generate(f"{folder}/")
        source, made = f"{folder}/kane.c", f"{folder}/kane.so"
        subprocess.run([compiler, "-O2", "-shared", "-fPIC", source, "-o", made, "-lm"], check=True)
        library = ctypes.CDLL(made)
    inputs = [np.concatenate((q, u)), np.zeros(1), *(np.ravel(x).copy() for x in names.values())]
    work = np.empty(function.sz_w() + 1)
    whole = np.zeros(function.sz_iw() + 1, np.int64)
    out = np.empty(scene.n + scene.p)
    outputs = np.array([out.ctypes.data] + [0] * function.sz_res(), np.uintp)
    arguments = np.array([x.ctypes.data for x in inputs] + [0] * function.sz_arg(), np.uintp)
    address = ctypes.cast(library.kane, ctypes.c_void_p).value
    assert address is not None
    pointers = (x.ctypes.data for x in (arguments, outputs, whole, work))
    call = timing_loop(address, *pointers)
    alive = library, inputs, work, whole, out, outputs, arguments
    return lambda count: (call(count), alive)[0]


def _pinocchio_call(scene: Scene, q: Array, u: Array) -> tuple[str, Call]:
    pin = required(PINOCCHIO)
    at = Evaluation(scene, q, velocity(scene, q, u))
    engine = PinocchioEngine(scene)
    T = engine.coordinates
    back = np.linalg.inv(T)
    Q = np.zeros(scene.n) if at.terms.Q is None else at.terms.Q
    x, xd, force = T @ at.q, T @ at.v, back.T @ Q
    model, data = engine.model, engine.data

    def aba(count: int) -> None:
        for _ in range(count):
            pin.aba(model, data, x, xd, force)

    if at.terms.a is None:
        return ABA, aba
    jacobian, drift = at.terms.a @ back, at.terms.gamma

    def constrained(count: int) -> None:
        for _ in range(count):
            pin.computeAllTerms(model, data, x, xd)
            pin.forwardDynamics(model, data, force, jacobian, drift)

    return PINOCCHIO, constrained


# ---- The study -----------------------------------------------------------------------------------


def cells(
    *,
    scene: Kind = "snake",
    links: Annotated[list[int] | None, "Number of links, or several: 7,100 or 2..5."] = None,
    formulation: Formulations = None,
    repeats: Repeats = 15,
    set: Set = None,
) -> Iterator[Settings]:
    """Yield a cell for each kind of scene: all in it are timed in turn.

    Formulations that are named are timed beyond `DENSE_LIMIT` too.

    Raises:
        InputError: a number of links or of repeats below 1, links of a kind without, or parameters
            that are none.
        UnknownNameError: no such scene or formulation.
    """
    for kind in scene_classes_named(scene):
        formulations_for(kind, formulation)
        if links and not kind.has_links:
            raise InputError(f"links = {links}: {kind.key} has no number of links to choose")
        check_count(repeats=repeats)
        for value in links or ():
            check_count(links=value)
        default = (LINKS if kind is Snake else (3,)) if kind.has_links else (None,)
        for value in (links or default) if set else ():
            bench_state(kind, value, parse_parameters(set))  # refuses what the scene does not know
        yield {
            "scene": kind.key,
            "links": links or default,
            "formulations": formulation,
            "repeats": repeats,
        } | ({"set": set} if set else {})


def worker(known: Sequence[Record], *, scene: Kind = "snake") -> Callable[[Settings], Record]:
    """Return what times everything in a kind of scene."""
    kinds = {kind.key: kind for kind in scene_classes_named(scene)}

    def timed(settings: Settings) -> Record:
        kind, chosen, keys = kinds[settings["scene"]], settings["links"], settings["formulations"]
        formulations = formulations_for(kind, keys)

        def jobs() -> Iterator[Job]:
            for n in chosen:
                scene, q, u = bench_state(kind, n, parse_parameters(settings.get("set")))
                size = n or 0
                if (angles := _angles(scene, q)).size:
                    yield TRIGONOMETRY, size, sincos_timing_loop(angles)
                for f in formulations:
                    if f.linear or keys is not None or size <= DENSE_LIMIT:
                        yield f.key, size, _formulation_call(f, scene, q, u)
                for f in formulations if size <= DENSE_LIMIT else ():
                    if f.key == KANE:
                        yield f"{KANE}, {LANES} lanes", size, _lanes_call(f, scene, q, u)
                if size <= DENSE_LIMIT and (call := _casadi_call(scene, q, u)) is not None:
                    yield CASADI, size, call
                if size <= DENSE_LIMIT and PinocchioEngine.represents(scene):
                    what, call = _pinocchio_call(scene, q, u)
                    yield what, size, call

        repeats, count = settings["repeats"], len(chosen) * (len(formulations) + 4)
        with progress("making code and timing it in {step}", (1 + repeats) * count) as advance:
            timings = time_calls(kind.key, jobs(), repeats, advance)
        return record_of_rows(STUDY.key, settings, timings)

    return timed


def tables(found: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield, for each scene, medians, their ratio to sines alone, the slope of log t over log N."""
    for key, rows in group(rows_in(found, Timing), lambda one: one.scene).items():
        at = {(one.what, one.links): one for one in rows}
        links = sorted({one.links for one in rows})
        table = []
        for what in dict.fromkeys(one.what for one in rows):
            mine = [at[what, n] for n in links if (what, n) in at]
            large = [(one.links, one.seconds) for one in mine if one.links >= 100]
            fitted = f"{slope(large):.3f}" if len(large) > 1 else ""
            making = seconds_text(max(one.compile_seconds for one in mine))
            cells = (_beside_sines(at.get((what, n)), at.get((TRIGONOMETRY, n))) for n in links)
            table.append((what, *cells, fitted, making))
        sizes = (f"N = {n}" if n else key for n in links)
        columns = ("right-hand side", *sizes, "slope, N >= 100", "making it")
        title = f"Median time of one right-hand side, {key}"
        note = "In brackets the ratio to the sines and cosines of the N angles alone."
        note = note if any(what == TRIGONOMETRY for what, _ in at) else ""
        sheet = ResultTable(f"rhs-{key}", title, columns, table, note=note)
        known = any(row[-2] for row in table)
        yield sheet if known else sheet.without("slope, N >= 100")


def _beside_sines(one: Timing | None, sines: Timing | None) -> str:
    if one is None or sines is None:
        return "" if one is None else seconds_text(one.seconds)
    return f"{seconds_text(one.seconds)} ({one.seconds / sines.seconds:.3g} ×)"


STUDY = Study(
    key="rhs",
    cells=cells,
    worker=worker,
    tables=tables,
    label="",
    alarm=failed,
    document=document_of("timings", Timing),
    small=True,
)

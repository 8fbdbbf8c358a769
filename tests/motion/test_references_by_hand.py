"""What a reference solution tells of its two integrations, and what is stored of it."""

from __future__ import annotations

import ctypes
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import flint
import numpy as np
import pytest
from tests.scenes.test_own_scene import Free, OnBelt

from eomcheck.errors import RefusedError
from eomcheck.formulations import FORMULATIONS
from eomcheck.motion import reference
from eomcheck.motion.integrators import INTEGRATORS, integrate
from eomcheck.motion.observables import singular_between, solves_partition
from eomcheck.motion.reference_solution import (
    ReferenceRun,
    decimals,
    load_reference,
    save_reference,
)
from eomcheck.scenes import RollingDisk, Sleigh, Snake

FOLDER = Path(__file__).parents[2] / "validation" / "references"

# ---- Taylor series -------------------------------------------------------------------------------


class Digits(float):
    """A double that is written with all of its digits."""

    def __str__(self) -> str:
        return repr(float(self))


def taylor(monkeypatch, steps: list[float], **options: Any) -> tuple[ReferenceRun, list[Any]]:
    """Return a run of which state i is q = i, 2i and u = 3i, 4i, and after every step 10 i.

    v is twice u, and the energy 6 less q₀.
    """
    asked: list[Any] = []
    states = [np.array([1.0, 2.0, 3.0, 4.0]) * i for i in range(3)]
    every = [np.array([0.125, 2.0, 3.0, 4.0]) * i for i in (0, 30, 8)]

    def system(scene, numbers, start, t0) -> Any:
        asked.append((start.tolist(), t0))
        outputs = lambda x: np.array([2 * x[2], 2 * x[3], 6 - x[0]], object)  # noqa: E731
        return SimpleNamespace(tol=2.0**-100, order=28), outputs

    def taken(numbers, integrator, times, longest_step) -> Any:
        asked.append((times, longest_step))
        return states, every, steps

    library = SimpleNamespace(__version__="7.1")
    numbers = SimpleNamespace(heyoka=library, quad=Digits)
    monkeypatch.setattr(reference, "HeyokaArithmetic", lambda: numbers)
    monkeypatch.setattr(reference, "_taylor_system", system)
    monkeypatch.setattr(reference, "_taylor_steps", taken)
    times = [0.5, 0.75, 2.0]
    return reference.taylor_reference(Free(), [0.25, -1.0], [3.0, 4.0], times, **options), asked


@pytest.mark.parametrize("steps", [[0.25, 0.75, 0.5], [0.75, 0.5], [0.25, 0.75]])
def test_a_taylor_run_tells_its_longest_step_wherever_it_is(monkeypatch, steps: list[float]):
    run, asked = taylor(monkeypatch, steps, longest_step=0.8)
    assert asked == [([0.25, -1.0, 3.0, 4.0], 0.5), ([0.5, 0.75, 2.0], 0.8)]
    assert (run.facts["longest_step"], run.facts["steps"]) == (0.75, len(steps))
    told = {name: run.facts[name] for name in ("library", "number", "bits", "tolerance", "order")}
    assert told == {
        **{"library": "heyoka 7.1", "number": "Digits", "bits": 113},
        **{"tolerance": 2.0**-100, "order": 28},
    }


def test_a_taylor_run_is_that_of_its_states_and_drifts_by_every_step(monkeypatch):
    run, _ = taylor(monkeypatch, [1.0, 0.5])
    assert run.times == [0.5, 0.75, 2.0]
    assert run.q.astype(float).tolist() == [[0, 0], [1, 2], [2, 4]]
    assert run.v.astype(float).tolist() == [[0, 0], [6, 8], [12, 16]]
    assert run.energy is not None
    assert run.energy.astype(float).tolist() == [6, 5, 4]
    assert run.drift == 3.75 / 6


@pytest.mark.parametrize(("fails", "reached"), [(1, 0.25), (3, 0.75)])
def test_a_motion_that_ends_early_is_refused_with_the_time_reached(fails: int, reached: float):
    class Short:
        time, state, taken = 0.0, np.zeros(1), 0

        def step(self, max_delta_t: float, write_tc: bool) -> tuple[str, float]:
            self.taken += 1
            self.time += 0.25
            return "lost" if self.taken == fails else "limit", 0.25

    outcomes = SimpleNamespace(success="success", time_limit="limit")
    numbers: Any = SimpleNamespace(
        heyoka=SimpleNamespace(taylor_outcome=outcomes), constant=lambda x: x
    )
    with pytest.raises(RefusedError, match=f"beyond t = {reached} s: lost"):
        reference._taylor_steps(numbers, Short(), [0.0, 2.0], None)


# ---- Extrapolation -------------------------------------------------------------------------------


def test_an_extrapolated_run_tells_its_steps_and_drifts_by_every_step(monkeypatch):
    seen, made = [0.5], []

    class Watched(reference.Extrapolation):
        def __init__(self, *given: Any):
            super().__init__(*given)
            made.append(self)

    monkeypatch.setattr(reference, "Extrapolation", Watched)
    times = [0.5, 0.75, 2.0]
    start = [1.0, 2.0], [0.5, 0.25], times
    run = reference.extended_reference(Free(), *start, tolerance=1e-12, watch=seen.append)
    steps, (method,) = np.diff(seen), made
    assert seen[-1] == 2.0 and set(times) <= set(seen)
    effort = method.effort
    assert len(set(steps.round(6).tolist())) > 1
    told = {key: run.facts[key] for key in ("steps", "evaluations", "bits", "tolerance")}
    assert told == {
        **{"steps": len(steps), "evaluations": effort.evaluations},
        **{"bits": 160, "tolerance": 1e-12},
    }
    assert run.facts["longest_step"] == pytest.approx(steps.max())
    assert run.facts["order"] == f"{min(effort.orders)}..{max(effort.orders)}"
    assert run.energy is not None and run.energy.shape == (3,)
    assert 0 < (run.drift or 0) < 1e-10
    assert run.q.shape == run.v.shape == (3, 2)
    assert run.v[0].astype(float).tolist() == [0.5, 0.25]


def test_an_extrapolated_run_drifts_by_its_worst_step(monkeypatch):
    energies = iter([4.0, 3.0, 9.0, 5.0, *[4.5] * 99])
    monkeypatch.setattr(
        *(reference, "ball", lambda x: SimpleNamespace(mid=lambda: flint.arb(next(energies))))
    )
    monkeypatch.setattr(reference, "_stripped", lambda x: np.array([y.mid() for y in x], object))
    start = [1.0, 2.0], [0.5, 0.25], [0.0, 2.0]
    monkeypatch.setattr(reference, "_arb_decimals", lambda x: x)
    run = reference.extended_reference(Free(), *start, tolerance=1e-12)
    assert run.facts["steps"] > 3
    assert run.drift == 5.0 / 4.0


# ---- What is stored ------------------------------------------------------------------------------


def test_a_start_is_stored_with_all_of_its_digits(tmp_path: Path):
    found = load_reference(FOLDER / "free-3.json")
    u0, times = np.array([1.0 / 3.0, -2e-17 / 7.0]), found.times.copy()
    times[1] += 1.0 / 3e4
    runs = tuple(replace(run, times=times.tolist()) for run in found.runs)
    q0 = found.q0.copy()
    q0[1] = 0.1 + 0.2
    runs = tuple(replace(run, q=run.q.copy()) for run in runs)
    for run in runs:
        run.q[0, 1] = decimals(np.array([repr(float(q0[1]))], object))[0]
    first, second = runs
    one = replace(found, name="other", description="words", u0=u0, times=times, q0=q0)
    one = replace(one, runs=(first, second), check={"steps": 3})
    path = tmp_path / "other.json"
    save_reference(one, path, command="eomcheck reference")
    document = json.loads(path.read_text(encoding="utf-8"))
    assert document["command"] == "eomcheck reference"
    assert (document["q0"], document["u0"]) == (q0.tolist(), u0.tolist())
    assert document["scene"]["kind"] == "snake"
    assert document["scene"]["python"] == repr(found.scene)
    assert [run["energy_drift"] for run in document["runs"]] == [run.drift for run in runs]
    assert document["differences"] == found.differences.tolist()
    again = load_reference(path)
    assert (again.name, again.description, again.check) == ("other", "words", {"steps": 3})
    for name in ("q0", "u0", "times", "differences"):
        assert getattr(again, name).tolist() == getattr(one, name).tolist()
    for mine, its in zip(again.runs, runs, strict=True):
        assert (mine.times, mine.drift, mine.facts) == (its.times, its.drift, its.facts)
        assert (mine.q == its.q).all() and (mine.v == its.v).all()
    assert again.q[0].tolist() == q0.tolist()


def test_a_stored_file_has_a_line_for_each_row(tmp_path: Path):
    path = tmp_path / "again.json"
    text = (FOLDER / "free-3.json").read_text(encoding="utf-8")
    more = {name: json.loads(text)[name] for name in ("made_by", "eomcheck")}
    save_reference(load_reference(FOLDER / "free-3.json"), path, **more)
    saved = path.read_text(encoding="utf-8")
    assert saved.replace(',\n"damping": null', "") == text  # which is older than dampers


# ---- Integrators ---------------------------------------------------------------------------------


def test_an_integrator_is_what_it_says():
    for key, one in INTEGRATORS.items():
        assert key == one.key
        assert one.implicit is ("explicit" not in one.what)
        head, embedded, _ = one.what.partition("(")
        order = int(head.split()[-1]) if embedded else 5 if key == "Radau" else None
        assert one.order == order


@ctypes.CFUNCTYPE(
    None,
    ctypes.POINTER(ctypes.c_double),
    ctypes.c_double,
    ctypes.POINTER(ctypes.c_double),
    ctypes.POINTER(ctypes.c_double),
)
def growing(out, t, y, arguments):
    """ẏ = (a t, b y₀), a and b the arguments."""
    out[0], out[1] = arguments[0] * t, arguments[1] * y[0]


def grown(*more: Any, **options: Any):
    address = ctypes.cast(growing, ctypes.c_void_p).value
    assert address is not None
    return integrate(address, np.array([3.0, -2.0]), np.array([5.0, 7.0]), *more, **options)


def grown_at(t: np.ndarray) -> np.ndarray:
    """Return the states at times t behind t = 1."""
    first = 5.0 + 1.5 * (t**2 - 1.0)
    return np.stack((first, 7.0 - 2.0 * (3.5 * (t - 1.0) + 0.5 * (t**3 - 1.0))), axis=1)


@pytest.mark.parametrize("integrator", ["RK45", "DOP853", "Radau"])
def test_a_motion_begins_at_its_start_and_is_what_was_asked_for(integrator: str):
    how: dict[str, Any] = {"t_start": 1.0, "integrator": integrator, "rtol": 1e-8, "atol": 1e-8}
    every = grown(2.0, **how, max_step=0.125)
    assert every.success and every.t[[0, -1]].tolist() == [1.0, 2.0]
    assert every.steps == every.t.size - 1 >= 8
    assert np.diff(every.t).max() <= 0.125 * (1 + 1e-12)
    assert every.y == pytest.approx(grown_at(every.t), rel=1e-6)
    some = grown(2.0, **how, output_times=np.array([1.25, 1.5, 2.0]))
    assert some.t.tolist() == [1.25, 1.5, 2.0]
    assert some.y == pytest.approx(grown_at(some.t), rel=1e-5)
    assert grown(2.0, **how, first_step=0.0625).t[1] == pytest.approx(1.0625)
    few = grown(2.0, **how, max_step=0.125, max_steps=3)
    assert (few.success, few.steps) == (False, 3)
    assert few.message and few.t[-1] < 2.0


# ---- Poses that are crossed ----------------------------------------------------------------------


def turned(degrees: float) -> list[list[float]]:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return [[c, -s], [s, c]]


@pytest.mark.parametrize(
    ("A", "B", "between"),
    [
        (np.eye(2), [[1.0, 0.0], [0.0, -2.0]], True),
        (np.eye(2), [[-1.0, 0.0], [0.0, -3.0]], True),
        ([[0.0, 2.0], [1.0, 0.0]], [[0.0, -2.0], [1.0, 0.0]], True),
        (np.eye(2), turned(90.0), False),
        (np.eye(2), turned(179.0), False),
        (np.eye(2), turned(180.0), True),
        (np.eye(2), [[-1.0, 1.0], [-1e-15, -1.0]], True),
        (np.eye(2), [[-1.0, 1.0], [-1e-13, -1.0]], False),
        (np.eye(2), [[3.0, 0.5], [0.0, 9.0]], False),
        (np.eye(2), [[0.5, 0.2], [0.1, 0.4]], False),
        (np.eye(2), [[np.nan, 0.0], [0.0, -1.0]], False),
        (1e-3 * np.eye(2), [[1e-3, 0.0], [0.0, -1e-9]], True),
    ],
)
def test_between_two_matrices_is_one_that_is_singular(A: Any, B: Any, between: bool):
    found = singular_between(np.array([np.eye(2), A, B, B]))
    assert found.tolist()[1:] == [between, False]
    assert found.size == 3
    assert singular_between(np.array([A])).size == 0


def test_speeds_of_a_partition_and_what_splits_coordinates_are_solved_by_one():
    split = {"el", "em"}
    for scene in (Snake.coil(3), Sleigh.example(), RollingDisk.example(), Free(), OnBelt()):
        found = {key for key, f in FORMULATIONS.items() if solves_partition(scene, f)}
        by_speeds = set() if scene.natural_speeds else {"ml", "kane"}
        assert found == (split | by_speeds if scene.r else set()), scene.key

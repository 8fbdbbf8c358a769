"""The study of stiff joints: its truths, its crossovers, and exact Jacobians."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.machine_code import evaluated
from tests.samples import ordinary
from tests.widths import check_sheets_fit

from eomcheck.errors import InputError
from eomcheck.evaluation.dynamics import velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS, applicable
from eomcheck.lab.show.table import print_tables
from eomcheck.lab.store.record_file import Record, Records
from eomcheck.lab.studies import stiff as stiff
from eomcheck.lab.studies.stiff import COMPILED, STUDY, cheapest, crossover, stiff_robot
from eomcheck.motion import right_hand_side
from eomcheck.motion.right_hand_side import JACOBIAN, exact_jacobian, parameter_arrays, trace_rates
from eomcheck.motion.simulate import Motion
from eomcheck.numbers import tape
from eomcheck.scenes import SCENES, Snake

KANE = FORMULATIONS["kane"]
REFERENCES = Path("validation/references")
TINY = {"stiffness": [5e3], "quick": True}


def moving(scene: Snake, key: str) -> Motion:
    q, _ = scene.initial_state()
    u = np.array([1.0, 0.5])
    return Motion(scene, FORMULATIONS[key], q, velocity(scene, q, u), u)


def assert_approached(motion: Motion, y: np.ndarray, exact: np.ndarray, t: float = 0.0) -> None:
    """Assert that differences of the rates approach the exact Jacobian."""
    found = np.empty_like(exact)
    for column in range(y.size):
        # The error of one is that of its step squared, which the second one takes away.
        one, half = (
            (motion.rates(t, y + e) - motion.rates(t, y - e)) / (2 * h)
            for h in (1e-6, 5e-7)
            for e in (h * (np.arange(y.size) == column),)
        )
        found[:, column] = (4 * half - one) / 3
    assert np.isfinite(exact).all()
    assert np.abs(exact - found).max() < 1e-8 * max(np.abs(exact).max(), 1.0)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("damping", [None, np.arange(1.0, 7.0)])
@pytest.mark.parametrize("stiffness", [None, 5e3 * np.ones(6)])
def test_the_exact_jacobian_is_what_differences_approach(damping, stiffness):
    scene = replace(Snake.paper(), stiffness=stiffness, damping=damping)
    motion = moving(scene, "kane")
    assert_approached(motion, motion.y0, exact_jacobian(scene, KANE)(0.0, motion.y0))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("key", FORMULATIONS)
@pytest.mark.parametrize("links", [2, 3])
def test_every_formulation_has_an_exact_jacobian(key, links):
    scene = replace(Snake.coil(links), damping=np.arange(1.0, links))
    motion = moving(scene, key)
    exact = exact_jacobian(scene, FORMULATIONS[key])(0.0, motion.y0)
    assert_approached(motion, motion.y0, exact)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
def test_every_scene_is_differentiated_on_the_tape_by_every_formulation(kind, sized):
    """The tapes are run in Python: code of so many operations takes its time to make."""
    scene, (q, v, t) = ordinary(kind)
    for key, formulation in list(applicable(kind).items())[:: sized(1, 3)]:
        motion, at = Motion(scene, formulation, q, v), Evaluation(scene, q, v, t)
        y = motion.y0.copy()
        if formulation.state == "q, u":
            y[scene.n :] = at.u
        tape, _, _, outputs = trace_rates(scene, formulation, also=JACOBIAN)
        given = {**parameter_arrays(scene), "y": y, "t": np.array([t])}
        rates = evaluated(tape, outputs["rates"], given)
        assert rates == pytest.approx(motion.rates(t, y), rel=1e-9, abs=1e-9), key
        exact = evaluated(tape, outputs["jacobian"], given).reshape(y.size, y.size)
        assert_approached(motion, y, exact, t)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("key", ["sleigh", "rolling-disk", "turntable-ball", "flyball-governor"])
def test_jacobians_in_machine_code_are_those_on_the_tape(key):
    scene, (q, v, t) = ordinary(SCENES[key])
    for formulation in applicable(scene).values():
        y = Motion(scene, formulation, q, v).y0
        tape, _, _, outputs = trace_rates(scene, formulation, also=JACOBIAN)
        given = {**parameter_arrays(scene), "y": y, "t": np.array([t])}
        expected = evaluated(tape, outputs["jacobian"], given)
        found = exact_jacobian(scene, formulation)(t, y).ravel()
        assert np.abs(found - expected).max() <= 1e-9 * max(np.abs(expected).max(), 1.0)


def test_products_of_matrices_too_large_to_be_written_out_are_differentiated_as_well(monkeypatch):
    monkeypatch.setattr(tape, "LARGEST_EXPANDED_PRODUCT", 0)
    monkeypatch.setattr(right_hand_side, "_kernels", {})
    for key in ("gw", "el"):
        motion = moving(Snake.coil(3), key)
        traced = trace_rates(motion.scene, motion.formulation)
        assert any(group.kind == tape.PRODUCT for group in traced.tape.groups)
        exact = exact_jacobian(motion.scene, motion.formulation)(0.0, motion.y0)
        assert_approached(motion, motion.y0, exact)


def test_without_dampers_stiffness_only_sets_the_unit_of_time():
    soft, stiffer = (moving_from_rest(stiff_robot("undamped", k)) for k in (5e3, 5e3 * 4.0**6))
    end = 0.2
    one, other = (
        m.solve(end * t, rtol=1e-12, atol=1e-12, output_times=np.array([end * t])).y[-1]
        for m, t in ((soft, 1.0), (stiffer, 2.0**-6))
    )
    assert np.allclose(other[:9], one[:9], atol=1e-9)
    assert np.allclose(other[9:] / 2.0**6, one[9:], atol=1e-8)
    assert stiff.unit_of_time("undamped", 5e3 * 4.0**6) == 2.0**-6


def moving_from_rest(scene: Snake) -> Motion:
    return Motion(scene, KANE, *scene.initial_state())


def run(k: float, integrator: str, seconds: float | None, error: float = 1e-4) -> Record:
    settings = {
        "problem": "damped",
        "formulation": "kane",
        "stiffness": k,
        "integrator": integrator,
        "jacobian": None,
        "tolerance": 1e-3,
    }
    return Record(
        stiff.KEY,
        settings,
        "failed" if seconds is None else "done",
        seconds=seconds,
        cpu_seconds=seconds,
        counts={"right-hand sides": 10},
        errors={"final": error, "floor": 1e-12},
    )


def test_the_crossover_lies_where_the_ratio_of_the_best_of_both_kinds_passes_one():
    records = [run(1e4, "DOP853", 1.0), run(1e4, "Radau", 10.0)]
    assert crossover(records, 1e-3, "damped", "kane") is None
    records += [run(1e6, "DOP853", 10.0), run(1e6, "Tsit5", 90.0), run(1e6, "Radau", 1.0)]
    assert crossover(records, 1e-3, "damped", "kane") == pytest.approx(1e5)
    # LSODA is of both kinds and decides nothing, nor does a run that is not right.
    records += [run(1e4, "LSODA", 0.1), run(1e4, "BDF", 0.1, error=0.1)]
    assert crossover(records, 1e-3, "damped", "kane") == pytest.approx(1e5)


def test_an_explicit_integrator_that_does_not_get_there_counts_as_dearer():
    records = [run(1e4, "DOP853", 1.0), run(1e4, "Radau", 10.0)]
    records += [run(1e6, "DOP853", None), run(1e6, "Radau", 1e3)]
    assert crossover(records, 1e-3, "damped", "kane") == 1e6
    assert cheapest(records, 1e-3, ("DOP853",)) is records[0]
    assert cheapest(records, 1e-9, COMPILED) is None


@pytest.mark.night
def test_a_study_is_whole_resumes_and_shows_what_jacobians_save(tmp_path, capsys, monkeypatch):
    with Records(tmp_path / "stiff.db") as records:
        found = STUDY.measure(records, references=REFERENCES, **TINY)
        monkeypatch.setattr(stiff, "damped_truth", None)
        monkeypatch.setattr(stiff, "_by_cyrk", None)
        assert STUDY.measure(records, references=REFERENCES, **TINY) == found
    assert {r.status for r in found} == {"done"}
    (truth,) = (r for r in found if r.study == stiff.TRUTH)
    assert truth.errors["uncertainty"] < 1e-11
    for integrator in stiff.IN_SCIPY:
        plain, exact = (
            next(r for r in found if (integrator, how) == pick(r)) for how in stiff.JACOBIANS
        )
        assert exact.counts["right-hand sides"] < plain.counts["right-hand sides"]
    for r in found:
        if r.settings.get("tolerance") == 1e-6:
            assert r.errors["floor"] < r.errors["final"] < 1e-2
    print_tables(STUDY.tables(found))
    check_sheets_fit(STUDY.tables(found))
    said = capsys.readouterr().out
    assert "No run failed" in said and "cheaper ones from this k on" in said
    written = STUDY.write(found, tmp_path)
    names = ("stiff-work-precision", "stiff-cost", "stiff-jacobians")
    figures = [path for path in written if path.suffix == ".svg"]
    assert {path.stem for path in figures} == {
        f"{x}{dark}" for x in names for dark in ("", "-dark")
    }
    assert all(path.stat().st_size > 10_000 for path in figures)


def pick(record: Record) -> tuple:
    return record.settings.get("integrator"), record.settings.get("jacobian")


def test_two_integrations_that_disagree_leave_the_truth_as_uncertain_as_that(monkeypatch):
    def off(scene, key, integrator, tolerance):
        return np.ones(18) + (1e-5 if key == "kane" else 0.0)

    monkeypatch.setattr(stiff, "_end_state", off)
    record = stiff.damped_truth({"stiffness": 5e3})
    assert record.errors["uncertainty"] == pytest.approx(1e-5, rel=1e-3)


@pytest.mark.parametrize("k", [0.0, -1.0, float("nan"), float("inf")])
def test_a_stiffness_that_is_not_positive_is_refused(k: float):
    with pytest.raises(InputError, match="stiffness = "):
        list(stiff.cells(stiffness=[k]))

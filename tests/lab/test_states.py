"""One scene's states in several processes: found, kept and stopped at as in one."""

from __future__ import annotations

import multiprocessing
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from tests.engines.planar import planar

from eomcheck.claims import run
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.draws.pairwise_design import scene_cases
from eomcheck.lab.store import validation_runs
from eomcheck.lab.store.record_file import Records
from eomcheck.lab.store.validation_runs import (
    STATES_PER_PROCESS,
    all_built_in,
    check_in_parallel,
    default_executor,
    stored_findings_in,
    validate_kind,
)
from eomcheck.scenes import SCENES, ChainPendulum, Sleigh

SELECTION = RunSelection.of(["au", "em"], [], ["kinetic-energy", "equivalence", "coverage"])


class HeavyInside(Sleigh):
    """A sleigh whose kinetic energy is twice what its mass matrix says where it turns fast."""

    @staticmethod
    def energies(parameters, angle, q, v):
        """Return T and U, J."""
        kinetic, potential = Sleigh.energies(parameters, angle, q, v)
        return (2 * kinetic if v[2] > 2 else kinetic), potential


def looked(
    where: str | None, kind=Sleigh, on_case=lambda: None, path: Path | None = None
) -> ValidationRun:
    run = ValidationRun()
    how = SELECTION, (1, 1), 12, 0, on_case
    if path is None:
        validate_kind(kind, run, *how, executor=where)
    else:
        with Records(path) as records:
            validate_kind(kind, run, *how, records, executor=where)
    return run


@pytest.mark.night
def test_two_processes_find_and_keep_what_one_does(tmp_path: Path):
    cases: list[int] = []
    runs, kept = [], []
    for number, where in enumerate((None, "local:2")):
        path = tmp_path / f"{number}.db"
        runs.append(looked(where, on_case=lambda: cases.append(1), path=path))
        with Records(path) as records:
            kept.append(stored_findings_in(records.all()))
    one, two = runs
    assert [f.as_dict() for f in one.findings] == [f.as_dict() for f in two.findings]
    assert one.ends == two.ends and len(cases) == one.cases + two.cases == 2 * 14
    assert one.variants == two.variants and one.seconds.keys() == two.seconds.keys()
    assert [drawn.refused for drawn in one.drawn] == [drawn.refused for drawn in two.drawn]
    assert kept[0] == kept[1] and len(kept[0]) == len(one.findings)


@pytest.mark.night
def test_two_processes_stop_where_one_does_and_at_the_same_smallest_failure():
    one, two = looked(None, HeavyInside), looked("local:2", HeavyInside)
    assert one.minimal is not None and two.minimal is not None
    assert one.minimal.claim == "kinetic-energy"
    assert one.minimal.as_dict() == two.minimal.as_dict()
    assert 1 < one.cases == two.cases < 14
    assert not multiprocessing.active_children()


@pytest.mark.night
def test_an_interruption_keeps_what_was_found_and_ends_the_processes():
    cases: list[int] = []

    def interrupted() -> None:
        cases.append(1)
        if len(cases) == 4:
            raise KeyboardInterrupt

    run = ValidationRun()
    with pytest.raises(KeyboardInterrupt):
        validate_kind(Sleigh, run, SELECTION, (1, 1), 12, 0, interrupted, executor="local:2")
    assert run.cases == 4 and run.findings
    assert not multiprocessing.active_children()


def test_looks_come_in_the_order_of_the_cases(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(
        validation_runs,
        "parallel_map",
        lambda _, look, items: ((x, look(x)) for x in reversed(list(items))),
    )
    cases = list(scene_cases(SCENES["snake"], (1, 3), 5, seed=0))
    for (scene, state), (other, same, seen) in zip(
        cases, check_in_parallel("local:2", cases, SELECTION), strict=True
    ):
        assert other is scene and same is state
        assert {f.scene.structure for f in seen.findings} == {scene.structure}
        assert all(np.array_equal(f.state.q, state.q) for f in seen.findings)


def test_an_engine_on_trial_is_asked_as_often_in_several_processes_as_in_one(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(
        validation_runs,
        "parallel_map",
        lambda _, look, items: [(x, look(x)) for x in reversed(list(items))],
    )
    monkeypatch.setattr(run, "OFTEN", 9)
    calls: list[int] = []

    class Counting(planar()):
        def mass_matrix(self, q, t=0.0):
            calls.append(1)
            return super().mass_matrix(q, t)

    selection, asked = RunSelection.of(engines=[Counting], claims=["mass-matrix"]), []
    for where in (None, "local:2"):
        calls.clear()
        validate_kind(
            ChainPendulum, ValidationRun(), selection, (1, 1), 2, 0, lambda: None, executor=where
        )
        asked.append(len(calls))
    assert asked[0] == asked[1] > 0


def test_cases_are_drawn_as_they_are_looked_at(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(
        validation_runs, "parallel_map", lambda _, look, items: ((x, look(x)) for x in items)
    )
    drawn: list[int] = []

    def cases():
        for i, case in enumerate(scene_cases(Sleigh, (1, 1), 40, seed=0)):
            drawn.append(i)
            yield case

    with closing(check_in_parallel("local:2", cases(), SELECTION)) as looks:
        next(looks)
        next(looks)
        assert len(drawn) == 2


def test_many_states_of_what_is_ours_are_spread_unless_one_core_is_all(
    monkeypatch: pytest.MonkeyPatch,
):
    for cores, examples, expected in (
        (2, 4 * STATES_PER_PROCESS, "local:2"),
        (64, 4 * STATES_PER_PROCESS, "local:4"),
        (64, 2 * STATES_PER_PROCESS - 1, None),
        (1, 4 * STATES_PER_PROCESS, None),
        (None, 4 * STATES_PER_PROCESS, None),
    ):
        monkeypatch.setattr("os.cpu_count", lambda cores=cores: cores)
        assert default_executor(examples, [Sleigh], SELECTION.engines) == expected
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    assert not all_built_in(HeavyInside)
    assert default_executor(4 * STATES_PER_PROCESS, [HeavyInside], ()) is None

"""The stability atlas: its families, what is measured and kept, what is read off the Records."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.widths import check_sheets_fit

from eomcheck.errors import RefusedError, UnknownNameError
from eomcheck.evaluation.certified import FLOAT64_DIGITS, accuracy
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import check_consistent
from eomcheck.evaluation.tolerance import C
from eomcheck.formulations import FORMULATIONS, applicable
from eomcheck.lab import study as store
from eomcheck.lab.show.table import print_tables
from eomcheck.lab.store.record_file import Record, Records
from eomcheck.lab.studies import study_of
from eomcheck.lab.studies.stability import (
    FAMILIES,
    STATE,
    STUDY,
    CellOutcome,
    Method,
    atlas_of,
    break_of,
    cells,
    digits_lost,
    measure,
    methods_of,
    outcome_of,
    settings_of,
)
from eomcheck.lab.studies.stability.families import decades
from eomcheck.lab.studies.stability.two_wheels import TwoWheels
from eomcheck.numbers.generic import EPS

families = pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES)

# ---- The families --------------------------------------------------------------------------------


@families
def test_severities_rise_or_fall_all_the_way_and_quick_ones_are_among_them(family):
    ways = {math.copysign(1.0, b - a) for a, b in pairwise(family.values)}
    steps = list(pairwise(family.values))
    if family.values[0] == 0.0:
        steps = steps[1:]
    assert len(ways) == 1, "none is there twice, and none out of order"
    assert all(a != b for a, b in steps)
    places = [family.values.index(value) for value in family.quick]
    assert places == sorted(places)
    assert len(set(family.variants)) == len(family.variants)


@families
def test_each_variant_is_a_state_at_its_mildest_and_at_its_most_severe_quick_one(family):
    for variant in family.variants:
        for severity in (family.quick[0], family.quick[-1]):
            posed = family.pose(variant, severity)
            assert (posed.u is None) != (posed.v is None)
            assert posed.q.shape == (posed.scene.n,)
            if posed.u is not None:
                assert posed.u.shape == (posed.scene.p,)
            else:
                assert posed.v.shape == (posed.scene.n,)


@pytest.mark.sampled(3)
@families
def test_some_formulation_solves_the_mildest_state_to_ten_digits(family):
    for variant in family.variants:
        posed = family.pose(variant, family.values[0])
        found = accuracy(posed.scene, "kane", posed.q, posed.u, v=posed.v)
        assert found.relative < 1e-10


def test_decades_rise_and_fall():
    assert decades(0, 2) == (1.0, 10.0, 100.0)
    assert decades(-1, -3) == (0.1, 0.01, 0.001)
    assert decades(0, 160, 80) == (1.0, 1e80, 1e160)


def test_a_wheel_comes_as_near_to_π_over_2_as_doubles_let_it():
    family = FAMILIES["wheel-angle"]
    for distance in family.values:
        alpha = family.pose("+π/2, wheel 3", distance).scene.wheel_angle[2]
        assert np.cos(alpha) == pytest.approx(distance, rel=0.3)
    assert family.pose("+π/2, wheel 3", family.values[-1]).scene.wheel_angle[2] == np.pi / 2


def test_a_second_wheel_holds_the_centre_of_its_link_still():
    posed = FAMILIES["dependent"].pose("moving", 0.1)
    at = Evaluation(posed.scene, posed.q, np.zeros(posed.scene.n))
    at.u = posed.u
    moving = Evaluation(posed.scene, posed.q, at.velocity)
    check_consistent(moving)
    V, omega = at.call(posed.scene.velocities, at.parameters, at.prepared, at.q, moving.v)
    assert np.abs(V[0]).max() < 1e-15
    assert omega[0, 0] == 1.0
    a, first = moving.terms.a, TwoWheels(posed.scene.first, 0.0)
    assert np.linalg.matrix_rank(a) == 6
    repeated = Evaluation(first, posed.q, moving.v).terms
    assert np.array_equal(repeated.a[-1], repeated.a[0])
    assert repeated.gamma[-1] == repeated.gamma[0]


def test_two_wheels_at_one_angle_leave_no_speed_to_choose():
    posed = FAMILIES["dependent"].pose("moving", 0.0)
    at = Evaluation(posed.scene, posed.q, np.zeros(posed.scene.n))
    with pytest.raises(RefusedError, match="one constraint"):
        at.speeds  # noqa: B018


def test_every_formulation_refuses_a_constraint_written_twice():
    for method in methods_of(applicable(TwoWheels)):
        record = measure(settings_of("dependent", "moving", 0.0, method))
        assert record.status == "refused", method


# ---- Measuring -----------------------------------------------------------------------------------

ATLAS = study_of("stability")
PLACE = ("straight", "3 links", 1e-4)


@pytest.mark.parametrize("variant", FAMILIES["dependent"].variants)
def test_uk_is_compared_with_the_truth_of_the_rows_that_it_keeps(variant: str):
    posed = FAMILIES["dependent"].pose(variant, 1e-16)
    assert posed.u is not None
    found = accuracy(posed.scene, "uk", posed.q, posed.u)
    redundant = Evaluation(posed.scene, posed.q, 0 * found.vdot).independent_partition.redundant
    assert redundant is not None and redundant.size == 1
    assert 0 < found.relative <= found.relative_bound <= 1e-9
    # Of two wheels that are not quite parallel the truth is another motion.
    with pytest.raises(RefusedError):
        accuracy(posed.scene, "au", posed.q, posed.u)
    assert (
        outcome_of(measure(settings_of("dependent", variant, 1e-16, Method("uk"))))
        is CellOutcome.GOOD
    )


def test_a_formulation_with_a_partition_is_measured_with_both():
    assert list(methods_of(["au", "el"])) == [Method("au"), Method("el"), Method("el", True)]
    assert {method.key for method in methods_of(FORMULATIONS)} == set(FORMULATIONS)


def test_a_formulation_that_does_not_apply_to_the_scenes_of_a_family_has_no_cells_there():
    planned = list(cells(family=["straight", "dependent"]))
    known = {(one["family"], one["formulation"]) for one in planned}
    assert ("straight", "banded") in known
    assert ("dependent", "banded") not in known
    assert ("dependent", "kane") in known


def test_a_cell_holds_the_true_error_what_was_foreseen_and_every_condition_number():
    posed = FAMILIES["straight"].pose("3 links", 1e-4)
    for method in methods_of(FORMULATIONS):
        record = measure(settings_of(*PLACE, method))
        found = accuracy(posed.scene, method.key, posed.q, posed.u, pivoted=method.pivoted)
        assert record.settings == settings_of(*PLACE, method)
        assert record.status == "done"
        assert record.errors["relative"] == found.relative
        assert record.errors["bound"] == found.relative_bound, "one state, one bound"
        assert record.errors["predicted"] == pytest.approx(record.errors["bound"] / C)
        names = {name.removeprefix("condition ") for name in record.errors if " " in name}
        assert names == set(found.condition)
        assert record.errors["condition"] == max(found.condition.values())


def test_a_refused_cell_names_the_matrix():
    record = measure(settings_of("straight", "3 links", 0.0, Method("em")))
    assert record.status == "refused"
    assert "matrix a_1 is singular to working precision" in record.reason


def test_where_constraints_are_violated_each_has_its_own_truth():
    au, kane = (measure(settings_of("violated", "coil", 1e-4, Method(k))) for k in ("au", "kane"))
    for record in (au, kane):
        assert record.errors["relative"] < 1e-12
    assert au.errors["question"] < EPS
    assert 1e-8 < kane.errors["question"] < 1e-2


def test_a_run_is_resumed_and_repeats_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(store, "parallel_map", _here)
    planned: dict[str, Any] = {"family": ["turns"], "formulation": ["au", "kane"], "quick": True}
    with Records(tmp_path / "records.db") as records:
        first = ATLAS.measure(records, **planned)
        assert len(first) == 2 * 2 * len(FAMILIES["turns"].quick)
        assert {outcome_of(record) for record in first} == {CellOutcome.GOOD}
        records.forget(STUDY.key, [first[3].settings])
        asked.clear()
        again = ATLAS.measure(records, **planned)
        assert asked == [(_place(first[3].settings), 1)]
        assert [r.settings for r in again] == [r.settings for r in first]
        asked.clear()
        wider = ATLAS.measure(records, **planned | {"formulation": ["au", "kane", "em"]})
        assert len(wider) == len(first) * 2
        assert {count for _, count in asked} == {2}, "em, and em with a pivoted partition"
        asked.clear()
        assert len(ATLAS.measure(records, fresh=True, **planned)) == len(first)
        assert len(asked) == len(first) / 2


asked: list[tuple[tuple, int]] = []


def _here(where, function, items, killed):
    for together in items:
        (place,) = set(map(_place, together))
        asked.append((place, len(together)))
        yield together, function(together)


def _place(settings: dict) -> tuple:
    return tuple(settings[name] for name in STATE)


@pytest.mark.night
def test_processes_measure_the_same(tmp_path: Path):
    planned: dict[str, Any] = {"family": ["dependent"], "formulation": ["au"], "quick": True}
    with Records(tmp_path / "records.db") as records:
        found = ATLAS.measure(records, executor="local:2", **planned)
    for record in found:
        here = measure(record.settings)
        assert (here.status, here.errors) == (record.status, record.errors)


@pytest.mark.parametrize(
    "unknown", [{"family": ["none"]}, {"formulation": ["newton"]}, {"scene": "worm"}]
)
def test_unknown_families_formulations_and_scenes_are_named(unknown):
    with pytest.raises(UnknownNameError):
        list(cells(**unknown))


def test_a_plan_covers_every_family_variant_and_severity_once():
    planned = [_place(cell) for cell in cells(scene="all", formulation=["kane"])]
    assert len(planned) == len(set(planned))
    assert len(planned) == sum(len(f.values) * len(f.variants) for f in FAMILIES.values())


# ---- What is read off the Records ----------------------------------------------------------------


def record(severity: float, relative: float | None, bound: float = math.inf, variant="3 links"):
    settings = settings_of("straight", variant, severity, Method("el"))
    if relative is None:
        return Record(STUDY.key, settings, "refused", "a'T is singular", errors={"rcond": 0.0})
    errors = {"relative": relative, "bound": bound, "predicted": 2 * relative, "condition": 7.0}
    return Record(STUDY.key, settings, errors=errors | {"condition a'T": 7.0})


RECORDS = [
    record(1e-1, 1e-15),
    record(1e-1, 1e-14, variant="7 links"),
    record(1e-4, 1e-9),
    record(1e-4, 1e-12, variant="7 links"),
    record(1e-8, 1e-4, 1e-3),
    record(1e-8, None, variant="7 links"),
    record(0.0, None),
    record(0.0, None, variant="7 links"),
]


@pytest.mark.parametrize(
    ("one", "expected"),
    [
        (record(0.1, 0.0), CellOutcome.GOOD),
        (record(0.1, 1e-6), CellOutcome.GOOD),
        (record(0.1, 1e-6, 0.0), CellOutcome.GOOD),
        (record(0.1, 2e-6, 2e-6), CellOutcome.REPORTED),
        (record(0.1, 2e-6, 1e-6), CellOutcome.SILENT),
        (record(0.1, math.inf, math.inf), CellOutcome.REPORTED),
        (record(0.1, math.inf, 1.0), CellOutcome.SILENT),
        (record(0.1, None), CellOutcome.REFUSED),
    ],
)
def test_an_outcome_is_read_off_error_and_bound(one, expected):
    assert outcome_of(one) is expected


def steps(records):
    return atlas_of(records)["straight"][Method("el")]


def test_steps_go_from_mild_to_severe_and_keep_the_worst_variant():
    found = steps(reversed(RECORDS))
    assert [step.severity for step in found] == [1e-1, 1e-4, 1e-8, 0.0]
    assert [step.worst for step in found] == [
        CellOutcome.GOOD,
        CellOutcome.GOOD,
        CellOutcome.REPORTED,
        CellOutcome.REFUSED,
    ]
    assert [step.refused for step in found] == [0.0, 0.0, 0.5, 1.0]
    assert found[1].lost == pytest.approx(FLOAT64_DIGITS - 9)
    assert found[1].predicted == pytest.approx(FLOAT64_DIGITS - 9 + math.log10(2))
    assert math.isnan(found[3].lost)
    assert list(atlas_of(RECORDS)["straight"]) == [Method("el")]


def test_a_method_breaks_where_some_variant_first_fails():
    found = break_of(steps(RECORDS))
    assert found is not None
    assert (found.severity, found.outcome) == (1e-8, CellOutcome.REPORTED)
    assert break_of(steps(RECORDS[:4])) is None


def printed(records, capsys) -> str:
    print_tables(ATLAS.tables(records))
    return "\n".join((capsys.readouterr().out, *ATLAS.remarks(records)))


def test_records_that_say_otherwise_change_where_it_breaks_and_what_is_printed(capsys):
    before = printed(RECORDS, capsys)
    assert "1e-08" in before and "bound tells" in before and "0 silently wrong" in before
    doctored = [
        replace(r, errors=r.errors | {"relative": 1e-3, "bound": 1e-5})
        if r.settings["severity"] == 1e-4
        else r
        for r in RECORDS
    ]
    found = break_of(steps(doctored))
    assert found is not None
    assert (found.severity, found.outcome) == (1e-4, CellOutcome.SILENT)
    after = printed(doctored, capsys)
    assert "0.0001" in after and "2 silently wrong" in after
    (wrong,) = (sheet for sheet in ATLAS.tables(doctored) if sheet.name == "stability-wrong")
    assert [row[:2] for row in wrong.rows] == [("el", "SILENT")] * 2
    assert "stability-wrong" not in {sheet.name for sheet in ATLAS.tables(RECORDS)}
    assert ATLAS.alarm(doctored) and not ATLAS.alarm(RECORDS)


def test_digits_lost_count_from_those_that_doubles_have():
    assert digits_lost(0.0) == digits_lost(1e-17) == 0.0
    assert digits_lost(1e-6) == pytest.approx(9.95, abs=0.01)
    assert digits_lost(math.inf) == digits_lost(2.0) == FLOAT64_DIGITS


def test_the_atlas_and_a_figure_a_family_are_drawn_and_fit_into_the_documentation(tmp_path: Path):
    silent = record(1e-4, 1e-3, 1e-9, "20 links")
    check_sheets_fit(ATLAS.tables([*RECORDS, silent, *_cheap()]))
    paths = ATLAS.write([*RECORDS, silent, *_cheap()], tmp_path)
    assert [path.name for path in paths] == [
        "stability.svg",
        "stability-dark.svg",
        "stability-straight.svg",
        "stability-straight-dark.svg",
        "stability-dependent.svg",
        "stability-dependent-dark.svg",
        "stability-breaks.md",
        "stability-wrong.md",
    ]
    table = paths[6].read_text(encoding="utf-8").splitlines()
    assert table[0] == "| method | Straight snake | Dependent constraints |"
    assert table[2].startswith("| el | 0.0001 SILENT | – |")
    assert table[3].startswith("| au | – | 1e-12 |")
    for path in paths[:6]:
        assert 10_000 < path.stat().st_size < 400_000
    assert "silently wrong" in paths[2].read_text(encoding="utf-8"), "in a comment on the letters"


def _cheap() -> list[Record]:
    method = Method("au")
    return [
        measure(settings_of("dependent", "moving", x, method)) for x in FAMILIES["dependent"].quick
    ]

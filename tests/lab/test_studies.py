"""What holds for every study, on the small ones: kept, told, drawn, and reported alike."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from statistics import median

import pytest
from tests.widths import check_sheets_fit

from eomcheck.claims.finding import Finding
from eomcheck.claims.run import ValidationRun
from eomcheck.engines.pinocchio import PinocchioEngine
from eomcheck.errors import InputError
from eomcheck.evaluation.tolerance import C
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.report.overview import Overview, read_records
from eomcheck.lab.report.report_formats import sections_of
from eomcheck.lab.show.chart import Axis, Chart, Panel
from eomcheck.lab.show.chart_plotly import chart_json
from eomcheck.lab.store.record_file import Record, Records, record_of_rows
from eomcheck.lab.studies import (
    BENCHMARKS,
    DRAWN,
    STUDIES,
    accuracy,
    agreement,
    engines,
    motion,
    study_of,
)
from eomcheck.lab.studies.accuracy import Delivered
from eomcheck.lab.studies.agreement import REFERENCE, Agreement
from eomcheck.lab.studies.rhs import TRIGONOMETRY
from eomcheck.lab.study import failed, rows_in, unfinished
from eomcheck.mechanics.records import State
from eomcheck.scenes import Sleigh

ROBOTS = Path(__file__).parents[1] / "scenes" / "robots"
SMALL = {
    "operations": {"links": "2..5", "formulation": ["kane", "au"]},
    "accuracy": {"links": "2..3", "examples": 3},
    "agreement": {"links": "1..2", "per_size": 3},
    "rhs": {"scene": "sleigh", "formulation": ["kane"], "repeats": 2},
    "differentiation": {"scene": "chain-pendulum", "formulation": ["au"], "repeats": 2},
    "motion": {"formulation": ["kane"]},
    "engines": {"engine": ["pinocchio"], "links": "2", "states": 2},
    "tolerance": {"links": "2", "examples": 2},
    "robots": {
        "robot": [str(ROBOTS / "arm.urdf"), str(ROBOTS / "gripper.urdf")],
        "free": [str(ROBOTS / "walker.urdf")],
        "states": 1,
        "points": 1,
    },
}


@pytest.fixture(autouse=True)
def brief(monkeypatch):
    monkeypatch.setattr(motion, "END", 0.01)


@pytest.mark.parametrize("key", SMALL)
@pytest.mark.sampled(9)
def test_a_study_is_worked_once_then_read_told_drawn_and_reported(key: str, tmp_path: Path):
    study, options = study_of(key), SMALL[key]
    assert study.small and not study.key.count(" ")
    found = study.run(tmp_path / "r.db", **options)
    again = study.run(tmp_path / "r.db", **options)
    assert [(r.settings, r.series, r.counts, r.when) for r in again] == [
        (r.settings, r.series, r.counts, r.when) for r in found
    ]
    assert not study.alarm(found) and not list(unfinished(found))
    sheets = list(study.tables(found))
    assert sheets and all(sheet.rows for sheet in sheets)
    assert all(len(row) == len(sheet.columns) for sheet in sheets for row in sheet.rows)
    check_sheets_fit(sheets)
    written = study.write(found, tmp_path)
    assert len({path.name for path in written}) == len(written)
    json.dumps(study.document(found), allow_nan=False)
    for chart in study.charts(found):
        assert {f"{chart.name}.svg", f"{chart.name}-dark.svg"} <= {path.name for path in written}
        assert len(json.loads(chart_json(chart))) == len(chart.panels)
    (section,) = sections_of(Overview(read_records([tmp_path / "r.db"])))
    assert section.id == key and section.text.startswith(STUDIES[key])


@pytest.mark.night
def test_the_groups_of_commands_name_studies_and_drawn_ones_have_a_chart():
    assert set(BENCHMARKS) | set(DRAWN) <= set(STUDIES)
    for key in DRAWN:
        study = study_of(key)
        assert next(iter(study.charts(study.run(**SMALL[key])))).name == key


def test_machine_code_beyond_the_bound_is_named_and_an_alarm(monkeypatch):
    right = accuracy.acceleration_in_machine_code
    monkeypatch.setattr(accuracy, "applicable", lambda _: {"kane": FORMULATIONS["kane"]})
    study = study_of("accuracy")
    for factor, beyond in ((1.0, False), (1.01, True)):
        monkeypatch.setattr(
            accuracy, "acceleration_in_machine_code", lambda *of, x=factor: x * right(*of)
        )
        found = study.run(None, links="2", examples=3)
        assert study.alarm(found) == beyond
        assert (
            any(one.startswith("beyond its bound: kane") for one in study.remarks(found)) == beyond
        )


def test_accuracy_draws_the_same_states_one_a_cell_whatever_is_known(tmp_path: Path):
    study, options = study_of("accuracy"), SMALL["accuracy"]
    whole = study.run(tmp_path / "a.db", **options)
    with Records(tmp_path / "b.db") as records:
        records.add(whole[1])
    rows = rows_in(study.run(tmp_path / "b.db", **options), Delivered)
    assert [(one.key, one.links, one.digits) for one in rows] == [
        (one.key, one.links, one.digits) for one in rows_in(whole, Delivered)
    ]


def test_no_formulation_is_as_far_from_the_reference_as_a_flipped_sign():
    rows = rows_in(study_of("agreement").run(links="1..4", per_size=4), Agreement)
    assert {one.links for one in rows} == set(range(1, 5))
    assert REFERENCE not in {one.key for one in rows}
    assert all(one.observed <= one.allowed for one in rows)
    # At rest the flipped sign is that of zero.
    assert median(one.faulty / one.allowed for one in rows) > 1e3


@pytest.mark.parametrize("of_reference", [True, False])
def test_rounding_of_the_reference_and_of_the_formulation_is_allowed(monkeypatch, of_reference):
    def sensitivity(at, formulation):
        return 1e6 if (formulation.key == REFERENCE) == of_reference else 0.0

    study = study_of("agreement")
    right = rows_in(study.run(links="2", per_size=1), Agreement)
    monkeypatch.setattr(agreement, "acceleration_sensitivity", sensitivity)
    rows = rows_in(study.run(links="2", per_size=1), Agreement)
    assert len(rows) == len(right) > 3
    assert len({one.allowed for one in rows}) == 1
    assert all(one.allowed > 10 * known.allowed for one, known in zip(rows, right, strict=True))


def test_snakes_at_rest_leave_no_table_of_agreement_empty():
    (sheet,) = study_of("agreement").tables(study_of("agreement").run(links="2", per_size=1))
    assert len(sheet.rows) > 3 and {row[1] for row in sheet.rows} == {"1"}


def test_motions_and_tolerances_are_measured_of_other_scenes_too():
    study = study_of("motion")
    (sheet,) = study.tables(study.run(scene="sleigh", formulation=["kane", "au"]))
    assert {row[0] for row in sheet.rows} == {"kane", "au"} and "of sleigh by" in sheet.note
    assert "scene" not in next(iter(study.cells()))  # what was kept of the paper's robot is known
    study = study_of("tolerance")
    (sheet,) = study.tables(study.run(scene="sleigh", examples=2))
    assert {"mass-matrix", "equivalence"} <= {row[0] for row in sheet.rows}
    assert "scene" not in next(iter(study.cells()))
    with pytest.raises(InputError, match="sleigh has no number of links"):
        list(study.cells(scene="sleigh", links="3"))


@pytest.mark.parametrize(("observed", "alarm"), [(0.5, False), (1.0, False), (1.5, True)])
def test_tolerance_keeps_errors_over_rounding_and_not_over_what_is_allowed(
    monkeypatch, observed, alarm
):
    """Errors of `allowed` are C times rounding; what decides nothing has no ratio."""
    here = Sleigh.example()
    of = here, State(*here.initial_state(), 0.0), observed, 1.0
    found = [
        Finding("bias", "casadi", *of, "passed" if observed <= 1 else "failed", "made up"),
        Finding("bias", "au", *of, "inconclusive", "made up"),
        Finding("refusals", "au", *of, "passed", "made up"),
    ]
    monkeypatch.setattr(ValidationRun, "explore", lambda run, *_: run.findings.extend(found))
    study = study_of("tolerance")
    (record,) = study.run(scene="sleigh", examples=1)
    assert record.series == {"bias": [C * observed]}
    assert study.alarm([record]) is alarm


def test_a_motion_that_does_not_reach_its_end_has_no_time(monkeypatch):
    study = study_of("motion")
    monkeypatch.setattr(motion, "END", 1.0)
    (sheet,) = study.tables(study.run(scene="sleigh", formulation=["kane", "el"]))
    assert [row[0] for row in sheet.rows] == ["kane"] and "Do not reach the end: el." in sheet.note


def test_benchmarks_of_a_scene_without_links_are_told_by_its_name():
    study = study_of("rhs")
    (sheet,) = study.tables(study.run(**SMALL["rhs"]))
    assert sheet.columns[1] == "sleigh"
    assert {row[0] for row in sheet.rows} >= {TRIGONOMETRY, "kane"}
    with pytest.raises(InputError, match="sleigh has no number of links"):
        list(study.cells(scene="sleigh", links=[3]))


@pytest.mark.parametrize(("taken", "states"), [(lambda mass: mass > 1.5, 1), (lambda _: False, 0)])
def test_an_engine_is_compared_where_it_represents_what_is_drawn(taken, states, monkeypatch):
    drawn = [Sleigh.example(), replace(Sleigh.example(), mass=2.0), Sleigh.example()]
    cases = [(scene, State(*scene.initial_state())) for scene in drawn]
    monkeypatch.setattr(engines, "scene_cases", lambda *_: iter(cases))
    represents = classmethod(lambda _, scene: taken(scene.mass))
    monkeypatch.setattr(PinocchioEngine, "represents", represents)
    settings = {"engine": "pinocchio", "scene": "sleigh", "links": (1, 1), "states": 3, "seed": 0}
    record = study_of("engines").worker([])(settings)
    if states:
        assert {one.states for one in rows_in([record], engines.EngineDifference)} == {states}
    else:
        assert (record.status, record.reason) == (
            *("refused", "pinocchio takes no sleigh that is drawn"),
        )


def test_what_went_wrong_is_told_with_its_cell():
    record = Record("s", {"links": 3}, "failed", "no compiler")
    assert failed([record])
    assert list(unfinished([record])) == ["links 3 failed: no compiler"]
    assert not failed([Record("s", {"links": 3}, "refused", "singular")])


def test_a_chart_offers_what_its_panels_are_of_in_their_order():
    panel = Panel(Axis("x"), Axis("y"), ())
    chosen = [("energy", "kane"), ("energy", "au"), ("constraint", "au")]
    chart = Chart("c", "", ["error", "by"], dict.fromkeys(chosen, panel))
    assert chart.choices == {"error": ["energy", "constraint"], "by": ["kane", "au"]}
    assert chart.rows() == [[("energy", "kane"), ("energy", "au")], [("constraint", "au")]]
    assert Chart("none", "", ["error"], {}).choices == {"error": []}


@pytest.mark.parametrize("compliant", [False, True])
def test_an_engine_is_soft_by_its_own_word_and_only_where_it_is_constrained(compliant, monkeypatch):
    monkeypatch.setattr(PinocchioEngine, "compliant", compliant)
    of = {"engine": "pinocchio", "links": (1, 2), "states": 2, "seed": 0}
    work = study_of("engines").worker([])
    held, free = (work(of | {"scene": key}) for key in ("sleigh", "chain-pendulum"))
    soft = {one.claim for one in rows_in([held, free], engines.EngineDifference) if one.gives_way}
    assert soft == (set(engines.CONSTRAINED) if compliant else set())
    printed = "".join(sheet.markdown() for sheet in study_of("engines").tables([held]))
    assert ("soft" in printed) is compliant
    assert "soft" not in "".join(sheet.markdown() for sheet in study_of("engines").tables([free]))


def test_what_could_not_be_judged_of_an_engine_is_inconclusive_and_not_soft():
    who = "pinocchio", "pinocchio 4", "sleigh", "engine-acceleration", 1, 0, 0.5
    settings = {"engine": "pinocchio", "scene": "sleigh"}
    record = record_of_rows("engines", settings, [engines.EngineDifference(*who, None, False)])
    sheet, _ = study_of("engines").tables([record])
    assert "5e-01 inconclusive" in sheet.rows[0] and "soft" not in sheet.markdown()
    assert any("nothing was decided" in said for said in study_of("engines").remarks([record]))

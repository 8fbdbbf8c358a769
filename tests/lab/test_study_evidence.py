"""The paper's claims, charts and cells: every number held against Records that are made by hand."""

from __future__ import annotations

import math

import pytest

from eomcheck.lab.show.chart import Chart, Panel
from eomcheck.lab.store.record_file import Record
from eomcheck.lab.studies import study_of
from eomcheck.lab.studies.paper import measure as paper
from eomcheck.lab.studies.paper import robot_motion
from eomcheck.lab.studies.paper.measure import FULL, QUICK, STUDY, PaperRecords, Solver, growth
from eomcheck.lab.studies.paper.paper_claims import PAPER_CLAIMS, judge_paper_claim

FIRST, SECOND = SOLVERS = (Solver("RK45", 1e-3), Solver("DOP853", 1e-9))
LINKS = (2, 7, 20)
KEYS = ("im", "el", "ml", "kane")
MILLISECONDS = {
    "im": (1.5, 3.0, 18.0),
    "el": (3.0, 11.0, 40.0),
    "ml": (0.9, 1.25, 4.0),
    "kane": (1.0, 1.0, 2.0),
}
OVER_TIME = (0.0, 1.0, 3.0, 2.0, 5.0, 9.0, 4.0, 2.0)


def state(links: int, key: str, across: int = 0) -> Record:
    settings = {"cell": "equations", "links": links, "formulation": key, "across": across}
    if across and ((key in ("ml", "kane") and across >= 3) or (key == "el" and across <= 5)):
        return Record(STUDY, settings, "refused", "a wheel across its link")
    n = links + 2
    orders = {"im": 2 * n + links, "el": n + (links == 7), "ml": 2, "kane": 2}
    counts = {"n": n, "r": links, "degrees of freedom": 2 if links < 20 else 3}
    counts |= {"multipliers": links if key in ("im", "el") else 0, "final system": orders[key]}
    off = {"im": 0.0, "el": 1.0, "ml": 3e-9 * links / 7, "kane": 0.0}[key]
    series = {"vdot": [1.0, 2.0 - off, 3.0]}
    return Record(STUDY, settings, counts=counts, errors={"bound": 2e-9}, series=series)


def motion(place: int, key: str, solver: Solver) -> Record:
    links, factor = LINKS[place], 1.0 if solver == FIRST else 4.0
    settings = {"cell": "motion", "links": links, "formulation": key, **solver._asdict()}
    if (key, place, solver) == ("ml", 0, SECOND):
        return Record(STUDY, settings, "failed", "singular", counts={"state": 5})
    c = {"im": 4e-6, "el": 3e-7, "ml": 2e-15, "kane": 5e-16}[key] * (1 + place) * factor
    e = {"im": 6e-3, "el": 1e-4, "ml": 5e-4, "kane": 2e-3}[key] * (2 + place) / factor
    sizes = {"im": 3 * links + 4, "el": 2 * links + 2, "ml": links + 4}
    last = 12.0 if key == "im" else 3.0
    series = {
        "times": [k / 8 for k in range(9)],
        "constraint": [x * c for x in (*OVER_TIME, last)],
        "energy": [(-1) ** k * x * e for k, x in enumerate((*OVER_TIME, last))],
    }
    return Record(
        STUDY,
        settings,
        cpu_seconds=1e-3 * MILLISECONDS[key][place] * factor**0.5,
        counts={"state": sizes.get(key, links + (4 if place else 6))},
        errors={"constraint": c, "constraint allowed": 1e-15 * (1 + place), "energy": e},
        series=series,
    )


@pytest.fixture(scope="module")
def records() -> list[Record]:
    made = [state(links, key) for key in KEYS for links in LINKS]
    made += [state(7, key, wheel) for key in KEYS for wheel in range(1, 8)]
    return made + [motion(i, key, by) for i in range(3) for key in KEYS for by in SOLVERS]


EVIDENCE = (
    (
        "Sec. 1",
        17,
        28,
        "Wheels refused at N = 7: im: none; el: 1 to 5; ml, kane: 3 to 7.",
    ),
    (
        "Eqs. (6), (8), (14), (19)",
        10,
        12,
        "As printed in 10 of 12 cases. At N = 20: im 64, el 42, ml 24, kane 24.",
    ),
    (
        "Table I, Eqs. (7)-(23)",
        11,
        12,
        "The last system has this order in 11 of 12 cases. At N = 20: im 64, el 22, ml 2, kane 2.",
    ),
    (
        "Table I",
        15,
        23,
        "Norm of the constraint error over what rounding explains: acceleration level "
        "3e+08 to 2e+10; velocity level 0.5 to 8.",
    ),
    (
        "Table I",
        3,
        4,
        "They come out with im, el.",
    ),
    (
        "Sec. 3",
        27,
        33,
        "The larger order takes longer in 22 of 28 comparisons. Of equal order, 5 of 5 "
        "pairs are within a factor of 2; the largest ratio is 2 (ml to kane, N = 20, RK45"
        " 1e-03).",
    ),
    (
        "Sec. 9",
        2,
        3,
        "In 2 of 3 states, one for each N, q̈ is the same within the bounds of rounding; "
        "the largest difference is 2 of what they allow.",
    ),
    (
        "Sec. 10",
        2,
        3,
        "n - rank(a) is 2, 3 at 3 values of N.",
    ),
    (
        "Sec. 1",
        6,
        12,
        "Mean constraint error of the last quarter over the first: more than 2 in 6 of 12"
        " comparisons (3 by RK45 1e-03, 3 by DOP853 1e-09), less than 0.5 in 0; median "
        "2.38, from 1.25 (el, N = 2, DOP853 1e-09) to 3.5 (im, N = 20, RK45 1e-03).",
    ),
    (
        "Fig. 3",
        8,
        8,
        "Error of im, el over that of ml, kane: more than 2 in 8 of 8 comparisons (4 by "
        "RK45 1e-03, 4 by DOP853 1e-09), less than 0.5 in 0; median 1.3e+09, from 1.5e+08"
        " (el to ml, N = 7, DOP853 1e-09) to 8e+09 (im to kane, N = 7, RK45 1e-03).",
    ),
    (
        "Fig. 3(b)",
        2,
        2,
        "Error over that of kane: more than 2 in 2 of 2 comparisons (1 by RK45 1e-03, 1 "
        "by DOP853 1e-09), less than 0.5 in 0; median 4, from 4 (ml to kane, N = 7, "
        "DOP853 1e-09) to 4 (ml to kane, N = 7, RK45 1e-03).",
    ),
    (
        "Fig. 4",
        4,
        8,
        "Error of im, el over that of ml, kane: more than 2 in 4 of 8 comparisons (2 by "
        "RK45 1e-03, 2 by DOP853 1e-09), less than 0.5 in 4; median 1.6, from 0.05 (el to"
        " kane, N = 7, DOP853 1e-09) to 12 (im to ml, N = 7, RK45 1e-03).",
    ),
    (
        "Fig. 5",
        22,
        22,
        "Error of im, el over that of ml, kane: more than 2 in 22 of 22 comparisons (12 "
        "by RK45 1e-03, 10 by DOP853 1e-09), less than 0.5 in 0; median 1.3e+09, from "
        "1.5e+08 (el to ml, N = 2, RK45 1e-03) to 8e+09 (im to kane, N = 20, RK45 1e-03).",
    ),
    (
        "Fig. 6",
        11,
        22,
        "Error of im, el over that of ml, kane: more than 2 in 11 of 22 comparisons (6 by"
        " RK45 1e-03, 5 by DOP853 1e-09), less than 0.5 in 11; median 1.6, from 0.05 (el "
        "to kane, N = 2, DOP853 1e-09) to 12 (im to ml, N = 7, RK45 1e-03). Median norm: "
        "0.003 J by RK45 1e-03, 0.001 J by DOP853 1e-09.",
    ),
    (
        "Fig. 7",
        10,
        17,
        "Time over that of kane: more than 2 in 10 of 17 comparisons (5 by RK45 1e-03, 5 "
        "by DOP853 1e-09), less than 0.5 in 0; median 3, from 0.9 (ml to kane, N = 2, "
        "RK45 1e-03) to 20 (el to kane, N = 20, RK45 1e-03).",
    ),
    (
        "Fig. 7, Sec. 12",
        5,
        6,
        "Time over that of kane at N = 20, over the same at the fewest links finished: "
        "more than 2 in 5 of 6 comparisons (3 by RK45 1e-03, 2 by DOP853 1e-09), less "
        "than 0.5 in 0; median 6, from 1.6 (ml, DOP853 1e-09) to 6.67 (el, RK45 1e-03).",
    ),
    (
        "Sec. 12",
        6,
        17,
        "6 of 17 ratios lie between 5 and 20; they go from 0.9 (ml to kane, N = 2, RK45 "
        "1e-03) to 20 (el to kane, N = 20, RK45 1e-03), median 3. The mean over the "
        "methods first exceeds 10 at N = 20 (RK45 1e-03), N = 20 (DOP853 1e-09).",
    ),
    (
        "Abstract, Sec. 12",
        12,
        18,
        "No other is clearly better: constraint error in 6 of 6, energy error in 0 of 6, "
        "CPU time in 6 of 6 cases.",
    ),
)


@pytest.mark.parametrize("place", range(len(EVIDENCE)))
def test_each_claim_of_the_paper_counts_and_tells_its_comparisons(place: int, records):
    claim = PAPER_CLAIMS[place]
    assert (claim.place, *claim.measure(PaperRecords(records))) == EVIDENCE[place]
    made = judge_paper_claim(claim, PaperRecords(records))
    right = {"holds": claim.reason_if_true}.get(made.verdict, claim.reason_if_false)
    assert (made.measured, made.why) == (EVIDENCE[place][3], right)


def test_every_claim_of_the_paper_has_its_evidence_here():
    assert len(PAPER_CLAIMS) == len(EVIDENCE)


def panels(chart: Chart) -> dict[tuple[str, ...], Panel]:
    assert all(isinstance(panel, Panel) for panel in chart.panels.values())
    return {chosen: panel for chosen, panel in chart.panels.items() if isinstance(panel, Panel)}


def test_figures_5_to_7_draw_each_norm_over_the_links_of_each_solver(records):
    norms, over_time = study_of("paper").charts(records)
    drawn = panels(norms)
    names = "constraint error", "energy error", "CPU time"
    assert [*drawn] == [(name, str(by)) for name in names for by in SOLVERS]
    assert [(one.name, one.title, one.grid) for one in norms.parts] == [
        (
            f"paper-fig{figure}",
            f"Fig. {figure}: {name} of the coil, over the number of links",
            [[(name, str(by))] for by in SOLVERS],
        )
        for figure, name in zip((5, 6, 7), names, strict=True)
    ]
    for (name, by), panel in drawn.items():
        of = {"constraint error": "constraint", "energy error": "energy"}.get(name)
        lines = {line.key: line for line in panel.lines if line.appearance == "line"}
        assert [*lines] == [*KEYS] and panel.x.log and panel.y.log
        assert panel.title == by
        for key, line in lines.items():
            mine = [
                one
                for one in records
                if one.settings["formulation"] == key
                and one.settings.get("integrator") == by.split()[0]
                and one.status == "done"
            ]
            # A gap where a motion was not finished.
            finished = [k for k, y in enumerate(line.y) if not math.isnan(y)]
            assert [line.x[k] for k in finished] == [one.settings["links"] for one in mine]
            values = [one.cpu_seconds if of is None else one.errors[of] for one in mine]
            assert [line.y[k] for k in finished] == values
            for k, text in enumerate(line.hover_text):
                assert text[:1] == ([f"{key}, N = {line.x[k]}"] if k in finished else [])
        crosses = [
            (line.key, line.x, line.label) for line in panel.lines if line.appearance != "line"
        ]
        cross = "ml", [2], "not finished, in the color of its line"
        assert crosses == ([cross] if by == str(SECOND) else [])
    ms, name = 1e3, ("CPU time", str(FIRST))
    assert [ms * y for y in drawn[name].lines[1].y] == pytest.approx(MILLISECONDS["el"])
    told = drawn["energy error", str(FIRST)].lines[0].hover_text[2]
    assert told == [
        "im, N = 20",
        "RK45, tolerance 1e-03, done",
        "CPU time 18 ms",
        "constraint error 1.20e-05 m/s",
        "energy error 2.40e-02 J",
        "64 state",
    ]
    assert over_time.name == "paper-robot"


def test_figures_3_and_4_draw_the_errors_of_seven_links_and_enlarge_those_of_velocity_level(
    records,
):
    _, over_time = study_of("paper").charts(records)
    drawn = panels(over_time)
    assert len(drawn) == (1 + 2) * len(SOLVERS)  # of the energy error one part is enlarged
    assert [(one.name, one.title) for one in over_time.parts] == [
        ("paper-fig3", "Fig. 3: constraint error of the robot of 7 links"),
        ("paper-fig4", "Fig. 4: energy error of the robot of 7 links"),
    ]
    for (error, part, by), panel in drawn.items():
        whole = part == "all formulations"
        assert panel.y.log == whole and panel.y.own != whole
        assert [line.key for line in panel.lines] == list(KEYS if whole else KEYS[2:])
        for line in panel.lines:
            (one,) = (
                one
                for one in records
                if one.settings["cell"] == "motion"
                and one.settings["links"] == 7
                and one.settings["formulation"] == line.key
                and str(Solver(one.settings["integrator"], one.settings["tolerance"])) == by
            )
            times, values = one.series["times"], one.series[error.split()[0]]
            if whole:
                times, values = times[1:], [abs(x) for x in values[1:]]
            assert (line.x, line.y) == (times, values)


def test_growth_is_fitted_from_20_links_on_and_for_each_solver():
    def timed(links: int, seconds: float, by: Solver) -> Record:
        settings = {"cell": "motion", "links": links, "formulation": "ml", **by._asdict()}
        return Record(STUDY, settings, cpu_seconds=seconds)

    found = PaperRecords(
        [
            *(timed(n, n**1.5, FIRST) for n in (20, 40, 80)),
            *(timed(n, 1e6, FIRST) for n in (2, 19)),
            *(timed(n, n**3.0, SECOND) for n in (20, 100)),
        ]
    )
    assert growth(found, "ml") == pytest.approx([1.5, 3.0])
    assert growth(PaperRecords([timed(20, 1.0, FIRST), timed(7, 2.0, FIRST)]), "ml") == []


def test_the_robot_is_drawn_by_the_last_solver_that_finished(records):
    shown = robot_motion(PaperRecords(records))
    assert shown is not None
    assert (shown.settings["formulation"], shown.settings["links"]) == ("kane", 7)
    assert shown.settings["integrator"] == "DOP853"
    failed = [
        Record(STUDY, one.settings, "failed", "stopped") if one is shown else one for one in records
    ]
    other = robot_motion(PaperRecords(failed))
    assert other is not None and other.settings["integrator"] == "RK45"


@pytest.mark.parametrize(("quick", "plan"), [(True, QUICK), (False, FULL)])
def test_a_plan_has_a_cell_a_state_a_wheel_across_and_a_motion(quick, plan):
    planned = list(paper.cells(quick=quick))
    states = [one for one in planned if one["cell"] == "equations"]
    motions = [one for one in planned if one["cell"] == "motion"]
    assert len(states) == 7 * (len(plan.links) + 7)
    assert [one["across"] for one in states if one["formulation"] == "au"] == [
        *[0] * len(plan.links),
        *range(1, 8),
    ]
    assert all(one["links"] == 7 for one in states if one["across"])
    assert len({tuple(one.items()) for one in motions}) == len(motions)
    assert len(motions) == 7 * len(plan.links) * len(plan.solvers)
    assert {(one["end"], one["outputs"]) for one in motions} == {(1.0, 101)}
    assert {(one["integrator"], one["tolerance"]) for one in motions} == set(plan.solvers)


@pytest.mark.parametrize(("quick", "runs"), [(True, 3), (False, 10)])
def test_motions_are_timed_as_often_as_their_plan_says_each_made_once(quick, runs, monkeypatch):
    made: list[tuple[int, str]] = []
    monkeypatch.setattr(paper, "prepare_motion", lambda s, key: (made.append((s.links, key)), 0.5))
    monkeypatch.setattr(paper, "_simulate", lambda *of: of)
    work = paper.worker((), quick=quick)
    cells = [
        {"cell": "motion", "links": n, "formulation": key, "tolerance": x}
        for n, key, x in ((2, "au", 1e-3), (2, "au", 1e-6), (3, "au", 1e-3), (2, "el", 1e-3))
    ]
    for cell in cells:
        assert work(cell) == (cell, (None, 0.5), runs)
    assert made == [(2, "au"), (3, "au"), (2, "el")]

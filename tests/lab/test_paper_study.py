"""The paper's study: what is measured, what is made of it, and that verdicts follow the numbers."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.widths import check_sheets_fit

from eomcheck import cli
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show.panel import Panel
from eomcheck.lab.store.record import Record
from eomcheck.lab.store.records import Records
from eomcheck.lab.studies.paper import STUDY as PAPER_STUDY
from eomcheck.lab.studies.paper import measure as paper
from eomcheck.lab.studies.paper.claims.claim import (
    PAPER_CLAIMS,
    Evidence,
    PaperClaim,
    judge,
    judgements,
    verdict_of,
)
from eomcheck.lab.studies.paper.measure import FULL, PAPER, QUICK, STUDY, Found, Plan, Solver
from eomcheck.lab.studies.paper.show import said, sheets

SOLVERS = (Solver("RK45", 1e-3), Solver("DOP853", 1e-9))
LINKS = (2, 7, 20)

SPREAD = {"im": 8.0, "au": 7.0, "el": 6.0, "gw": 5.0, "em": 4.0, "ml": 3.0, "kane": 1.0}
"""CPU times of made-up Records are these, times N."""


def level(key: str) -> str:
    return FORMULATIONS[key].level


def state(links: int, key: str, across: int = 0) -> Record:
    """Return a Record of one state, as the paper has it."""
    settings = {"cell": "equations", "links": links, "formulation": key, "across": across}
    if across >= 2:
        return Record(STUDY, settings, "refused", "a wheel across its link")
    f, n = FORMULATIONS[key], links + 2
    counts = {"n": n, "r": links, "degrees of freedom": 2}
    counts |= {"multipliers": links if f.multipliers_in_paper else 0}
    counts |= {"final system": f.unknowns(n, links), "order of M": f.unknowns(n, links)}
    errors = {"bound": 1e-9}
    return Record(STUDY, settings, counts=counts, errors=errors, series={"vdot": [1.0] * n})


def motion(links: int, key: str, solver: Solver) -> Record:
    """Return a Record of one motion in which velocity level is better in everything."""
    worse = level(key) == "acceleration"
    times = np.linspace(0, 1, 21)
    error = 1e-6 * times if worse else 1e-15 + 0 * times
    series = {"times": times, "constraint": error, "energy": 1e3 * error}
    if links == 7:
        series["q"] = np.outer(times, np.ones(9))
    return Record(
        STUDY,
        {"cell": "motion", "links": links, "formulation": key, **solver._asdict()},
        cpu_seconds=1e-3 * links * SPREAD[key] ** (links / 7),
        counts={"state": {"im": 2, "em": 1}.get(key, 1) * links},
        errors={
            "constraint": float(np.linalg.norm(error)),
            "constraint allowed": 1e-13,
            "energy": 1e3 * float(np.linalg.norm(error)),
        },
        series={name: value.tolist() for name, value in series.items()},
    )


def made_up() -> list[Record]:
    """Return Records of a world in which the paper is right, as far as the Records can say."""
    records = [state(links, key) for key in PAPER for links in LINKS]
    records += [state(7, key, wheel) for key in PAPER for wheel in range(1, 8)]
    records += [motion(n, key, solver) for n in LINKS for key in PAPER for solver in SOLVERS]
    return records


def doctored(change) -> list[Record]:
    """Return the Records of `made_up`, each as `change` returns it, or as it is."""
    return [change(record) or record for record in made_up()]


def claim_at(place: str, says: str = "") -> PaperClaim:
    (claim,) = [c for c in PAPER_CLAIMS if c.place == place and says in c.says]
    return claim


def verdict(records: list[Record], place: str, says: str = "") -> str:
    return judge(claim_at(place, says), Found(records)).verdict


# ---- Verdicts ------------------------------------------------------------------------------------


def test_a_verdict_is_the_share_of_comparisons_that_are_as_the_paper_says():
    shares = [(4, 4), (3, 4), (2, 4), (1, 4), (0, 4), (0, 0)]
    assert [verdict_of(Evidence(good, of, "")) for good, of in shares] == [
        "holds",
        *("holds partly", "holds partly"),
        *("does not hold here", "does not hold here"),
        "not measured",
    ]


def test_without_records_nothing_is_said_to_hold_or_not_to_hold():
    assert {made.verdict for made in judgements([])} == {"not measured"}


def test_every_claim_has_numbers_and_a_reason():
    for made in judgements(made_up()):
        assert len(made.measured) > 20
        assert made.why
        assert made.claim.place
        assert made.claim.says


def energy_of_velocity_level_grows(record: Record) -> Record | None:
    if "energy" in record.errors and level(record.settings["formulation"]) == "velocity":
        return replace(record, errors=record.errors | {"energy": 1.0})
    return None


def every_constraint_error_is_the_same(record: Record) -> Record | None:
    if "constraint" in record.errors:
        return replace(record, errors=record.errors | {"constraint": 1e-5})
    return None


def errors_do_not_grow(record: Record) -> Record | None:
    if "constraint" in record.series:
        return replace(record, series=record.series | {"constraint": [1e-6] * 21})
    return None


def kane_is_slow(record: Record) -> Record | None:
    if record.settings["formulation"] == "kane" and record.cpu_seconds is not None:
        return replace(record, cpu_seconds=1e3 / record.settings["links"])
    return None


def kane_grows_fastest(record: Record) -> Record | None:
    if record.settings["formulation"] == "kane" and record.cpu_seconds is not None:
        return replace(record, cpu_seconds=10.0 ** record.settings["links"])
    return None


def times_are_upside_down(record: Record) -> Record | None:
    return (
        None if record.cpu_seconds is None else replace(record, cpu_seconds=1 / record.cpu_seconds)
    )


def all_give_multipliers(record: Record) -> Record | None:
    if "multipliers" in record.counts:
        return replace(record, counts=record.counts | {"multipliers": 1})
    return None


def orders_are_one(record: Record) -> Record | None:
    if "final system" in record.counts:
        return replace(record, counts=record.counts | {"final system": 1})
    return None


def three_degrees_of_freedom(record: Record) -> Record | None:
    if "final system" in record.counts:
        return replace(record, counts=record.counts | {"degrees of freedom": 3})
    return None


def nothing_is_refused(record: Record) -> Record | None:
    if record.status == "refused":
        return replace(record, status="done", reason="")
    return None


def kane_differs(record: Record) -> Record | None:
    if record.settings["formulation"] == "kane" and "vdot" in record.series:
        return replace(record, series={"vdot": [1.1] * len(record.series["vdot"])})
    return None


@pytest.mark.parametrize(
    ("place", "says", "fault"),
    [
        ("Sec. 1", "singular", nothing_is_refused),
        ("Table I, Eqs. (7)-(23)", "", orders_are_one),
        ("Table I", "velocity level", every_constraint_error_is_the_same),
        ("Table I", "multipliers", all_give_multipliers),
        ("Sec. 3", "", times_are_upside_down),
        ("Sec. 9", "", kane_differs),
        ("Sec. 10", "", three_degrees_of_freedom),
        ("Sec. 1", "accumulate", errors_do_not_grow),
        ("Fig. 3", "", every_constraint_error_is_the_same),
        ("Fig. 4", "", energy_of_velocity_level_grows),
        ("Fig. 5", "", every_constraint_error_is_the_same),
        ("Fig. 6", "", energy_of_velocity_level_grows),
        ("Fig. 7", "", kane_is_slow),
        ("Fig. 7, Sec. 12", "", kane_grows_fastest),
        ("Abstract, Sec. 12", "", kane_is_slow),
    ],
)
def test_a_verdict_turns_when_the_numbers_do(place, says, fault):
    before, after = verdict(made_up(), place, says), verdict(doctored(fault), place, says)
    order = ("holds", "holds partly", "does not hold here")
    assert order.index(after) > order.index(before)


def test_where_the_numbers_say_so_the_energy_claims_hold():
    assert verdict(made_up(), "Fig. 4") == verdict(made_up(), "Fig. 6") == "holds"


def test_rounding_against_rounding_is_no_smaller_error():
    assert verdict(made_up(), "Fig. 3(b)") == "does not hold here"

    def kane_is_much_better(record: Record) -> Record | None:
        if record.settings["formulation"] == "kane" and "constraint" in record.errors:
            return replace(record, errors=record.errors | {"constraint": 1e-18})
        return None

    assert verdict(doctored(kane_is_much_better), "Fig. 3(b)") == "holds"


def test_ten_times_holds_only_where_the_ratios_are_near_ten():
    def ten(record: Record) -> Record | None:
        if record.cpu_seconds is None:
            return None
        return replace(
            record, cpu_seconds=1.0 if record.settings["formulation"] == "kane" else 11.0
        )

    assert verdict(doctored(ten), "Sec. 12") == "holds"
    assert verdict(made_up(), "Sec. 12") != "holds"


def test_the_printed_sizes_of_states_are_held_against_those_integrated():
    assert verdict(made_up(), "Eqs. (6), (8), (14), (19)") == "does not hold here"

    def as_printed(record: Record) -> Record | None:
        if "state" not in record.counts:
            return None
        links, key = record.settings["links"], record.settings["formulation"]
        size = (
            3 * links + 4 if key == "im" else 2 * links + 2 if key in ("au", "el", "gw") else None
        )
        return replace(record, counts={"state": links + 4 if size is None else size})

    assert verdict(doctored(as_printed), "Eqs. (6), (8), (14), (19)") == "holds"


def test_a_motion_that_failed_is_compared_with_nothing_and_named():
    def failing(record: Record) -> Record | None:
        if record.settings["cell"] == "motion" and record.settings["formulation"] == "em":
            return Record(STUDY, record.settings, "failed", "a_1 is singular", counts={"state": 4})
        return None

    records = doctored(failing)
    measured = judge(claim_at("Fig. 3"), Found(records)).measured
    assert "16 of 16 comparisons" in measured  # 4 by 2 formulations by 2 solvers
    assert "failed: em, 20 links, RK45 1e-03: a_1 is singular" in list(said(records))


def test_growth_is_told_from_the_fewest_links_that_a_method_finished():
    place = "Fig. 7, Sec. 12"

    def cannot(key: str, *few: int):
        def change(record: Record) -> Record | None:
            at = record.settings
            if (at["cell"], at["formulation"]) == ("motion", key) and at["links"] in few:
                return Record(STUDY, at, "failed", "a_1 is singular", counts={"state": 4})
            return None

        return judge(claim_at(place), Found(doctored(change))).measured

    assert "in 12 of 12 comparisons" in cannot("em", 99)
    assert "in 12 of 12 comparisons" in cannot("em", 2)
    assert "in 10 of 10 comparisons" in cannot("em", 2, 7)
    assert "in 10 of 10 comparisons" in cannot("em", 20)


# ---- Tables and figures --------------------------------------------------------------------------


@pytest.mark.night
def test_tables_and_figures_are_written(tmp_path: Path):
    records = made_up()
    check_sheets_fit(sheets(records))
    written = PAPER_STUDY.write(records, tmp_path)
    tables = [path for path in written if path.suffix == ".md"]
    assert [path.name for path in tables] == [f"{sheet.name}.md" for sheet in sheets(records)]
    (claims,) = [path for path in tables if path.name == "paper-claims.md"]
    assert len(claims.read_text(encoding="utf-8").splitlines()) == 2 + len(PAPER_CLAIMS)
    figures = sorted(path for path in written if path.suffix != ".md")
    assert [path.name for path in figures] == [
        "paper-fig2.gif",
        *(f"paper-fig{i}.png" for i in range(2, 8)),
    ]
    assert all(path.stat().st_size > 5_000 for path in figures)
    assert figures[0].read_bytes()[:6] == b"GIF89a"


def test_table_i_shows_the_systems_in_n_and_r():
    (table,) = [sheet for sheet in sheets(made_up()) if sheet.name == "paper-table1"]
    assert {row[0]: row[1] for row in table.rows}["au"] == "n + r"
    assert {row[0]: row[2] for row in table.rows}["im"] == "M: 2n + r"


def test_figures_show_only_what_was_measured(tmp_path: Path):
    records = [motion(n, key, SOLVERS[0]) for n in (2, 20) for key in ("au", "kane")]
    written = [path.name for path in PAPER_STUDY.write(records, tmp_path)]
    figures = [name for name in written if not name.endswith(".md")]
    assert figures == [f"paper-fig{i}.png" for i in range(5, 8)]


def test_crosses_of_motions_not_finished_stand_apart_above_what_was_measured():
    def failing(record: Record) -> Record | None:
        at = record.settings
        if at["cell"] == "motion" and at["links"] == 7 and at["formulation"] in ("el", "em"):
            return Record(STUDY, at, "failed", "a_1 is singular", counts={"state": 4})
        return None

    chart = next(iter(PAPER_STUDY.charts(doctored(failing))))
    for panel in chart.panels.values():
        assert isinstance(panel, Panel)
        crosses = {line.key: line.y for line in panel.lines if line.look == "crosses"}
        drawn = [line for line in panel.lines if line.look == "line"]
        at_7 = max(line.y[list(line.x).index(7)] for line in drawn if 7 in line.x)
        assert at_7 < crosses["el"][0] < crosses["em"][0]
        assert crosses["em"][0] / crosses["el"][0] == pytest.approx(crosses["el"][0] / at_7)


# ---- Measuring -----------------------------------------------------------------------------------


def test_the_study_is_about_the_papers_seven_formulations():
    assert PAPER == ("im", "au", "el", "gw", "em", "ml", "kane")
    assert QUICK.formulations == FULL.formulations == PAPER
    assert len(FULL.links) == 20
    assert (min(FULL.links), max(FULL.links)) == (2, 100)
    assert set(QUICK.links) <= set(FULL.links)
    assert set(QUICK.solvers) < set(FULL.solvers)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Record]]:
    path = tmp_path_factory.mktemp("paper") / "records.db"
    with Records(path) as records, pytest.MonkeyPatch.context() as patch:
        patch.setattr(paper, "OUTPUTS", OUTPUTS)
        patch.setattr(paper, "QUICK", SMALL)
        return path, PAPER_STUDY.measure(records, quick=True)


OUTPUTS = 21
SMALL = Plan((2, 3, 7), (Solver("RK45", 1e-5),), ("au", "kane"), runs=2)


def test_each_cell_is_one_record(measured):
    _, records = measured
    found = Found(records)
    assert len(records) == 2 * (3 + 7) + 2 * 3
    assert not found.unfinished
    for (links, key, _), record in found.motions.items():
        assert record.cpu_seconds is not None and 1 <= record.runs <= SMALL.runs
        assert len(record.series["times"]) == OUTPUTS
        norm = np.linalg.norm(record.series["constraint"])
        assert record.errors["constraint"] == pytest.approx(norm)
        assert ("q" in record.series) == (links == 7)
        within = record.errors["constraint"] <= record.errors["constraint allowed"]
        assert within == (level(key) == "velocity")


def test_a_motion_that_is_far_between_output_times_crosses_no_singular_pose(monkeypatch):
    """Six links turn so far in 1/100 s that the straight line from one output to the next does."""
    monkeypatch.setattr(paper, "FULL", replace(FULL, runs=2))
    cell = {"cell": "motion", "formulation": "el", "end": 0.2, "outputs": 21}
    cell |= Solver("RK45", 1e-6)._asdict()
    found = paper.worker(())(cell | {"links": 6})
    assert (found.status, found.reason) == ("done", "")
    crossing = paper.worker(())(cell | {"links": 4})
    assert crossing.status == "failed" and "a_1" in crossing.reason


def test_the_systems_solved_are_those_of_table_i(measured):
    for (links, key), record in Found(measured[1]).equations.items():
        assert record.counts["final system"] == {"au": 2 * links + 2, "kane": 2}[key]
        assert record.counts["multipliers"] == {"au": links, "kane": 0}[key]


def test_a_wheel_across_its_link_stops_generalized_speeds_only(measured):
    across = Found(measured[1]).across
    refused = [at for at, record in across.items() if record.status == "refused"]
    assert refused == [(wheel, "kane") for wheel in range(2, 8)]


def test_the_robot_begins_in_the_papers_pose(measured):
    record = Found(measured[1]).motions[7, "kane", SMALL.solvers[0]]
    assert record.series["q"][0] == [0, 0, 0.7679, 1.536, 2.304, 3.072, 3.840, 4.608, 5.376]
    assert record.errors["initial energy"] == pytest.approx(8847.744025)


def test_a_study_that_goes_on_repeats_nothing(measured, monkeypatch: pytest.MonkeyPatch):
    path, before = measured
    monkeypatch.setattr(paper, "OUTPUTS", OUTPUTS)
    monkeypatch.setattr(paper, "QUICK", SMALL)
    monkeypatch.setattr(paper, "_equations", None)
    monkeypatch.setattr(paper, "_moved", None)
    with Records(path) as records:
        assert PAPER_STUDY.measure(records, quick=True) == before


# ---- The command ---------------------------------------------------------------------------------


def run(*arguments: str, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["eomcheck", "study", "paper", *arguments])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code or 0


def test_the_command_measures_prints_and_draws(measured, tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setattr(paper, "QUICK", SMALL)
    monkeypatch.setattr(paper, "OUTPUTS", OUTPUTS)
    folder = str(tmp_path)
    assert run(str(measured[0]), "--quick", "--figures", folder, monkeypatch=monkeypatch) == 0
    printed = capsys.readouterr().out
    assert "The paper's claims" in printed
    assert (tmp_path / "paper-fig2.gif").exists()
    assert "does not hold here" in (tmp_path / "paper-claims.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("x.db", "--figures", "no/such/folder"), "'no/such/folder' is not a folder"),
        (("pyproject.toml", "--quick"), "is not a file of records"),
    ],
)
def test_bad_input_is_exit_code_2(arguments, says, monkeypatch, capsys):
    assert run(*arguments, monkeypatch=monkeypatch) == 2
    assert says in capsys.readouterr().err

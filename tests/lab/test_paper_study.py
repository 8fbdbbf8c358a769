"""The paper's study: what is made of its Records, and that verdicts follow the numbers."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.widths import check_sheets_fit

from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show.chart import Panel
from eomcheck.lab.store.record_file import Record
from eomcheck.lab.studies.paper import STUDY as PAPER_STUDY
from eomcheck.lab.studies.paper import remarks
from eomcheck.lab.studies.paper import tables as sheets
from eomcheck.lab.studies.paper.measure import PAPER, STUDY, PaperRecords, Solver
from eomcheck.lab.studies.paper.paper_claims import (
    PAPER_CLAIMS,
    Evidence,
    PaperClaim,
    judge_paper_claim,
    judgements,
    verdict_of,
)

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


def not_finished(*keys: str, links: tuple[int, ...] = LINKS):
    """Return a change of Records by which motions of these formulations failed."""

    def change(record: Record) -> Record | None:
        at = record.settings
        if at["cell"] == "motion" and at["formulation"] in keys and at["links"] in links:
            return Record(STUDY, at, "failed", "a_1 is singular", counts={"state": 4})
        return None

    return change


def claim_at(place: str, says: str = "") -> PaperClaim:
    (claim,) = [c for c in PAPER_CLAIMS if c.place == place and says in c.statement]
    return claim


def verdict(records: list[Record], place: str, says: str = "") -> str:
    return judge_paper_claim(claim_at(place, says), PaperRecords(records)).verdict


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
        assert made.claim.statement


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
    records = doctored(not_finished("em"))
    measured = judge_paper_claim(claim_at("Fig. 3"), PaperRecords(records)).measured
    assert "16 of 16 comparisons" in measured  # 4 by 2 formulations by 2 solvers
    assert "failed: em, 20 links, RK45 1e-03: a_1 is singular" in list(remarks(records))


def test_growth_is_told_from_the_fewest_links_that_a_method_finished():
    def measured(*links: int) -> str:
        records = doctored(not_finished("em", links=links))
        return judge_paper_claim(claim_at("Fig. 7, Sec. 12"), PaperRecords(records)).measured

    assert "in 12 of 12 comparisons" in measured()
    assert "in 12 of 12 comparisons" in measured(2)
    assert "in 10 of 10 comparisons" in measured(2, 7)
    assert "in 10 of 10 comparisons" in measured(20)


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
        "paper-fig2-dark.svg",
        "paper-fig2.gif",
        "paper-fig2.svg",
        *(f"paper-fig{i}{ground}.svg" for i in range(3, 8) for ground in ("-dark", "")),
    ]
    assert all(path.stat().st_size > 5_000 for path in figures)
    assert figures[1].read_bytes()[:6] == b"GIF89a"


def test_table_i_shows_the_systems_in_n_and_r():
    (table,) = [sheet for sheet in sheets(made_up()) if sheet.name == "paper-table1"]
    assert {row[0]: row[1] for row in table.rows}["au"] == "n + r"
    assert {row[0]: row[2] for row in table.rows}["im"] == "M: 2n + r"


def test_figures_show_only_what_was_measured(tmp_path: Path):
    records = [motion(n, key, SOLVERS[0]) for n in (2, 20) for key in ("au", "kane")]
    written = [path.name for path in PAPER_STUDY.write(records, tmp_path)]
    figures = [name for name in written if not name.endswith(".md")]
    assert figures == [f"paper-fig{i}{ground}.svg" for i in range(5, 8) for ground in ("", "-dark")]


def test_crosses_of_motions_not_finished_stand_apart_above_what_was_measured():
    chart = next(iter(PAPER_STUDY.charts(doctored(not_finished("el", "em", links=(7,))))))
    for panel in chart.panels.values():
        assert isinstance(panel, Panel)
        crosses = {line.key: line.y for line in panel.lines if line.appearance == "crosses"}
        drawn = [line for line in panel.lines if line.appearance == "line"]
        seven = {line.key: line.y[list(line.x).index(7)] for line in drawn}
        assert math.isnan(seven.pop("el")) and math.isnan(seven.pop("em")), "no line across a gap"
        at_7 = max(seven.values())
        assert at_7 < crosses["el"][0] < crosses["em"][0]
        assert crosses["em"][0] / crosses["el"][0] == pytest.approx(crosses["el"][0] / at_7)

"""The paper's table and figures as numbers, and its claims beside them: printed, and as files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Column

from eomcheck.console import console
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.report.benchmarks import seconds_text
from eomcheck.lab.report.operations import signed_sum
from eomcheck.lab.show.layout import table, write_markdown_table
from eomcheck.lab.show.sheet import Sheet
from eomcheck.lab.store.records import Record
from eomcheck.lab.studies.operations import fit_order
from eomcheck.lab.studies.paper import LARGE, PAPER_LINKS, QUANTITIES, Found, Solver, growth
from eomcheck.lab.studies.paper_claims import KANE, judgements

POSES = (0.0, 0.2, 0.4, 0.6, 0.8)
"""Times of the poses of Fig. 2, s."""


def sheets(records: Iterable[Record]) -> list[Sheet]:
    """Return every table of the study."""
    records = list(records)
    found = Found(records)
    made = [_table_i(found), _fig_2(found), _figs_3_and_4(found)]
    made += [
        _over_links(found, 5, "constraint", "m/s"),
        _over_links(found, 6, "energy", "J"),
        _fig_7(found),
        _claims(records),
    ]
    return [sheet for sheet in made if sheet.rows]


def print_paper(records: Iterable[Record]) -> None:
    """Print every table, and what could not be measured."""
    records = list(records)
    for sheet in sheets(records):
        columns = [
            Column(column, no_wrap=width is None and len(column) < 12, ratio=width)
            for column, width in zip_longest(sheet.columns, sheet.widths)
        ]
        wide, rows = bool(sheet.widths), [map(escape, row) for row in sheet.rows]
        shown = table(columns, rows, show_lines=wide, expand=wide)
        console.print(f"\n[bold]{escape(sheet.title)}[/]", shown, sep="\n")
    for machine in dict.fromkeys(_machine(record) for record in records):
        console.print(f"Measured on {machine}.", highlight=False)
    for record in Found(records).unfinished:
        console.print(
            escape(f"{record.status}: {_what(record.settings)}: {record.reason}"), soft_wrap=True
        )


def _machine(record: Record) -> str:
    """Return the machine of a Record, such as "a CPU (2 cores), numpy 2.2"."""
    libraries = ("numpy", "llvmlite", "CyRK")
    versions = [f"{name} {record.versions.get(name, '?')}" for name in libraries]
    cpu, cores = record.machine["cpu"], record.machine["cores"]
    return ", ".join((f"{cpu} ({cores} cores)", *versions))


def _what(settings: dict[str, Any]) -> str:
    what = [settings["formulation"], f"{settings['links']} links"]
    if settings["cell"] == "motion":
        what.append(str(Solver(settings["integrator"], settings["tolerance"])))
    return ", ".join(what)


def write_sheets(records: Iterable[Record], folder: Path) -> list[Path]:
    """Write every table as Markdown, one file each, and return the files."""
    written = []
    for sheet in sheets(records):
        written.append(folder / f"{sheet.name}.md")
        write_markdown_table(written[-1], [sheet.columns, *sheet.rows])
    return written


# ---- Table I, and the robot of Figs. 2 to 4 ------------------------------------------------------


def _table_i(found: Found) -> Sheet:
    rows = []
    for key in found.formulations:
        f = FORMULATIONS[key]
        solved = {
            links: record.counts
            for (links, other), record in found.equations.items()
            if other == key and record.status == "done"
        }
        if not solved:
            continue
        last = solved[max(solved)]
        systems = [name for name in last if name.startswith("order of ")]
        rows.append(
            (
                key,
                f.order_text,
                ", then ".join(
                    f"{name.removeprefix('order of ')}: {_order(solved.values(), name)}"
                    for name in systems
                ),
                f"{last['final system']}",
                f"{f.level} level",
                "yes" if f.multipliers_in_paper else "no",
                "yes" if last["multipliers"] else "no",
            )
        )
    columns = ("formulation", "number of equations (paper)", "systems really solved")
    largest = max((links for links, _ in found.equations), default=0)
    return Sheet(
        "paper-table1",
        "Table I, with the systems really solved",
        (
            *columns,
            f"last one at N = {largest}",
            "constraints at",
            "multipliers (paper)",
            "multipliers (here)",
        ),
        rows,
    )


def _order(counts: Iterable[dict[str, int]], name: str) -> str:
    """Return the order of a system in n and r, or all orders where there are too few to tell."""
    known = [(here["n"], here["r"], here[name]) for here in counts]
    fitted = fit_order(known)
    if fitted is None:
        return ", ".join(str(order) for _, _, order in known)
    return signed_sum([(str(factor), of) for factor, of in zip(fitted, "nr", strict=True)], "")


def _fig_2(found: Found) -> Sheet:
    record = robot(found)
    rows = []
    if record is not None:
        times = record.series["times"]
        for pose in POSES:
            q = record.series["q"][_nearest(times, pose)]
            rows.append((f"{pose:g}", *(f"{x:.6f}" for x in q)))
    angles = [f"θ_{i + 1} / rad" for i in range(PAPER_LINKS)]
    return Sheet(
        "paper-fig2",
        f"Fig. 2: five poses of the robot, by {KANE}",
        ("t / s", "x / m", "y / m", *angles),
        rows,
    )


def robot(found: Found) -> Record | None:
    """Return the motion of Fig. 2: the paper's robot by Kane's method and the last solver."""
    records = [found.motions.get((PAPER_LINKS, KANE, solver)) for solver in found.solvers]
    done = [record for record in records if record is not None and record.status == "done"]
    return done[-1] if done else None


def _nearest(times: Sequence[float], time: float) -> int:
    return min(range(len(times)), key=lambda i: abs(times[i] - time))


def _figs_3_and_4(found: Found) -> Sheet:
    rows = []
    for solver in found.solvers:
        for key in found.formulations:
            record = found.motions.get((PAPER_LINKS, key, solver))
            if record is None or record.status != "done":
                continue
            constraint, energy = record.series["constraint"], record.series["energy"]
            numbers = (
                *(max(constraint), record.errors["constraint"]),
                *(max(map(abs, energy)), record.errors["energy"]),
            )
            rows.append((str(solver), key, *(f"{number:.2e}" for number in numbers)))
    return Sheet(
        "paper-fig3-4",
        f"Figs. 3 and 4: errors of the robot of {PAPER_LINKS} links",
        (
            *("solver", "formulation"),
            *("constraint error, largest, m/s", "norm, m/s"),
            *("energy error, largest, J", "norm, J"),
        ),
        rows,
    )


# ---- Figs. 5 to 7, and the claims ----------------------------------------------------------------


def _over_links(found: Found, figure: int, quantity: str, unit: str) -> Sheet:
    rows = []
    for solver in found.solvers:
        for links in found.links:
            values = [found.value(quantity, links, key, solver) for key in found.formulations]
            cells = ["-" if value is None else f"{value:.1e}" for value in values]
            rows.append((str(solver), str(links), *cells))
    return Sheet(
        f"paper-fig{figure}",
        f"Fig. {figure}: norm of the {QUANTITIES[quantity]} (Eqs. (32)-(33)), {unit}",
        ("solver", "N", *found.formulations),
        rows,
    )


def _fig_7(found: Found) -> Sheet:
    rows = []
    for solver in found.solvers:
        for links in found.links:
            ours = found.value("cpu_seconds", links, KANE, solver)
            cells = []
            for key in found.formulations:
                seconds = found.value("cpu_seconds", links, key, solver)
                ratio = f" ({_short(seconds / ours)})" if seconds and ours and key != KANE else ""
                cells.append("-" if seconds is None else f"{seconds_text(seconds)}{ratio}")
            rows.append((str(solver), str(links), *cells))
    slopes = [growth(found, key) for key in found.formulations]
    for i, solver in enumerate(found.solvers):
        cells = [f"{of[i]:.2f}" if len(of) == len(found.solvers) else "-" for of in slopes]
        rows.append((str(solver), "N^p", *cells))
    return Sheet(
        "paper-fig7",
        f"Fig. 7: CPU time (its ratio to that of {KANE}); it grows as N^p from N = {LARGE} on",
        ("solver", "N", *found.formulations),
        rows,
    )


def _short(ratio: float) -> str:
    return f"{ratio:.1f}" if ratio < 99.95 else f"{ratio:.0f}"


def _claims(records: Iterable[Record]) -> Sheet:
    return Sheet(
        "paper-claims",
        "The paper's claims",
        ("where", "what the paper says", "measured here", "verdict", "why"),
        [
            (made.claim.place, made.claim.says, made.measured, made.verdict, made.why)
            for made in judgements(records)
        ],
        widths=(2, 5, 8, 2, 6),
    )

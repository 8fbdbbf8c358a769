"""Repetition of the paper's simulations: its table, its figures, and verdicts on its claims."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show.chart import Axis, Chart, File, Line, Panel
from eomcheck.lab.show.table import ResultTable, seconds_text, table_of
from eomcheck.lab.store.record_file import Record
from eomcheck.lab.studies.operations import fit_order, signed_sum
from eomcheck.lab.studies.paper import measure
from eomcheck.lab.studies.paper.measure import (
    LARGE,
    PAPER_LINKS,
    QUANTITIES,
    PaperRecords,
    Solver,
    coil_of,
    growth,
)
from eomcheck.lab.studies.paper.paper_claims import KANE, judgements
from eomcheck.lab.study import Study, line_of
from eomcheck.safe_output import counted

POSES = (0.0, 0.2, 0.4, 0.6, 0.8)
"""Times of the poses of Fig. 2, s."""
NOTHING = 1e-18
"""Ordinate at which norms of exactly 0 are drawn."""
HEIGHT = 1 / 20
"""Distance of the cross of an unfinished motion above the finished ones, as a share of the axis."""


def tables(records: Iterable[Record]) -> list[ResultTable]:
    """Return every table of the study."""
    records = list(records)
    paper_records = PaperRecords(records)
    sheets = [_table_i(paper_records), _fig_2(paper_records), _figs_3_and_4(paper_records)]
    for figure, quantity, unit in ((5, "constraint", "m/s"), (6, "energy", "J")):
        title = f"Fig. {figure}: norm of the {QUANTITIES[quantity]} (Eqs. (32)-(33)), {unit}"
        sheets.append(
            _over_links(paper_records, f"paper-fig{figure}", title, quantity, "{:.1e}".format)
        )
    sheets += [_fig_7(paper_records), _claims(records)]
    return [sheet for sheet in sheets if sheet.rows]


def remarks(records: Iterable[Record]) -> Iterator[str]:
    """Yield the machines of the measurements, and the reasons of unfinished cells."""
    records = list(records)
    for machine in dict.fromkeys(map(_machine, records)):
        yield f"Measured on {machine}."
    for record in PaperRecords(records).unfinished:
        yield f"{record.status}: {', '.join(_what(record))}: {record.reason}"


def _machine(record: Record) -> str:
    """Return the machine of a Record, such as "a CPU (2 cores), numpy 2.2"."""
    libraries = ("numpy", "llvmlite", "CyRK")
    versions = [f"{name} {record.versions.get(name, '?')}" for name in libraries]
    cpu, cores = record.machine["cpu"], record.machine["cores"]
    return ", ".join((f"{cpu} ({cores} cores)", *versions))


def _what(record: Record) -> list[str]:
    settings = record.settings
    what = [settings["formulation"], counted(settings["links"], "link")]
    if settings["cell"] == "motion":
        what.append(str(Solver(settings["integrator"], settings["tolerance"])))
    return what


# ---- Table I, and the robot of Figs. 2 to 4 ------------------------------------------------------


def _table_i(records: PaperRecords) -> ResultTable:
    rows = []
    for key in records.formulations:
        f = FORMULATIONS[key]
        solved = {n: record.counts for (n, other), record in records.solved.items() if other == key}
        if not solved:
            continue
        last = solved[max(solved)]
        systems = [name for name in last if name.startswith("order of ")]
        orders = (
            f"{name.removeprefix('order of ')}: {_order(solved.values(), name)}" for name in systems
        )
        solving = (f.order_text, ", then ".join(orders), f"{last['final system']}")
        multipliers = ("yes" if x else "no" for x in (f.multipliers_in_paper, last["multipliers"]))
        rows.append((key, *solving, f"{f.level} level", *multipliers))
    largest = max((links for links, _ in records.equations), default=0)
    columns = (
        *("formulation", "number of equations (paper)", "systems really solved"),
        *(f"last one at N = {largest}", "constraints at"),
        *("multipliers (paper)", "multipliers (here)"),
    )
    return ResultTable("paper-table1", "Table I, with the systems really solved", columns, rows)


def _order(counts: Iterable[dict[str, int]], name: str) -> str:
    """Return the order of a system in n and r, or all orders if none fits."""
    orders = [(one["n"], one["r"], one[name]) for one in counts]
    fitted = fit_order(orders)
    if fitted is None:
        return ", ".join(str(order) for _, _, order in orders)
    return signed_sum([(str(factor), of) for factor, of in zip(fitted, "nr", strict=True)], "")


def _fig_2(records: PaperRecords) -> ResultTable:
    rows = []
    if (record := robot_motion(records)) is not None:
        for pose in POSES:
            q = record.series["q"][_nearest(record.series["times"], pose)]
            rows.append((f"{pose:g}", *(f"{x:.6f}" for x in q)))
    angles = (f"θ_{i + 1} / rad" for i in range(PAPER_LINKS))
    title = f"Fig. 2: five poses of the robot, by {KANE}"
    return ResultTable("paper-fig2", title, ("t / s", "x / m", "y / m", *angles), rows)


def robot_motion(records: PaperRecords) -> Record | None:
    """Return the motion of Fig. 2: the paper's robot by Kane's method and the last solver."""
    motions = (records.finished(PAPER_LINKS, KANE, solver) for solver in reversed(records.solvers))
    return next(filter(None, motions), None)


def _nearest(times: Sequence[float], time: float) -> int:
    return min(range(len(times)), key=lambda i: abs(times[i] - time))


def _figs_3_and_4(records: PaperRecords) -> ResultTable:
    rows = []
    for solver, key in product(records.solvers, records.formulations):
        if record := records.finished(PAPER_LINKS, key, solver):
            numbers = []
            for error in ("constraint", "energy"):
                numbers += [max(map(abs, record.series[error])), record.errors[error]]
            rows.append((str(solver), key, *(f"{number:.2e}" for number in numbers)))
    heads = ("constraint error, largest, m/s", "norm, m/s", "energy error, largest, J", "norm, J")
    title = f"Figs. 3 and 4: errors of the robot of {PAPER_LINKS} links"
    return ResultTable("paper-fig3-4", title, ("solver", "formulation", *heads), rows)


# ---- Figs. 5 to 7, and the claims ----------------------------------------------------------------


def _over_links(
    records: PaperRecords,
    name: str,
    title: str,
    quantity: str,
    text: Callable[[float], str],
    over: str | None = None,
) -> ResultTable:
    """Return a quantity by solver, N and formulation; in brackets its ratio to that of `over`."""
    rows = []
    for solver, links in product(records.solvers, records.links):
        values = {key: records.value(quantity, links, key, solver) for key in records.formulations}
        reference = values.get(over or "")
        cells = []
        for key, value in values.items():
            ratio = f" ({_short(value / reference)})" if value and reference and key != over else ""
            cells.append("-" if value is None else f"{text(value)}{ratio}")
        rows.append((str(solver), str(links), *cells))
    return ResultTable(name, title, ("solver", "N", *records.formulations), rows)


def _fig_7(records: PaperRecords) -> ResultTable:
    title = f"Fig. 7: CPU time (its ratio to that of {KANE}); it grows as N^p from N = {LARGE} on"
    sheet = _over_links(records, "paper-fig7", title, "cpu_seconds", seconds_text, KANE)
    slopes = [growth(records, key) for key in records.formulations]
    powers = []
    for i, solver in enumerate(records.solvers):
        cells = [f"{of[i]:.2f}" if len(of) == len(records.solvers) else "-" for of in slopes]
        powers.append((str(solver), "N^p", *cells))
    return sheet._replace(rows=[*sheet.rows, *powers])


def _short(ratio: float) -> str:
    return f"{ratio:.1f}" if ratio < 99.95 else f"{ratio:.0f}"


def _claims(records: Iterable[Record]) -> ResultTable:
    columns = (
        ("where", lambda one: one.claim.place),
        ("what the paper says", lambda one: one.claim.statement),
        ("measured here", lambda one: one.measured),
        ("verdict", lambda one: one.verdict),
        ("why", lambda one: one.why),
    )
    widths = (2, 5, 8, 2, 6)
    made = judgements(records)
    return table_of("paper-claims", "The paper's claims", made, columns, widths=widths)


# ---- Charts --------------------------------------------------------------------------------------

NORMS = {
    "constraint": Axis("error norm / (m/s)", log=True),
    "energy": Axis("error norm / J", log=True),
    "cpu_seconds": Axis("CPU time / s", log=True),
}
LINKS = Axis("number of links N", log=True, ticks=(2, 5, 10, 20, 50, 100))
TIME = Axis("t / s")
OVER_TIME = {
    "constraint error": (Axis("‖c‖ / (m/s)", log=True),),
    "energy error": (
        Axis("|T + U - E₀| / J", log=True),
        Axis("T + U - E₀ of em, ml, kane / J", own=True),
    ),
}
PARTS = "all formulations", "velocity level, enlarged"


def charts(records: Iterable[Record]) -> Iterator[Chart]:
    """Yield Figs. 5 to 7, and Figs. 3 and 4 if the paper's robot is among the motions."""
    paper_records = PaperRecords(records)
    solvers = [*map(str, paper_records.solvers)]
    if not solvers:
        return
    yield Chart(
        "paper",
        "Figs. 5 to 7: one line a formulation, one point a number of links",
        ["quantity", "solver"],
        {
            (label, str(solver)): Panel(
                LINKS,
                NORMS[quantity],
                [
                    *_norms(paper_records, quantity, solver),
                    *_unfinished(paper_records, quantity, solver),
                ],
                str(solver),
            )
            for (quantity, label), solver in product(QUANTITIES.items(), paper_records.solvers)
        },
        parts=[
            File(
                f"paper-fig{figure}",
                f"Fig. {figure}: {label} of the coil, over the number of links",
                [[(label, solver)] for solver in solvers],
            )
            for figure, label in enumerate(QUANTITIES.values(), 5)
        ],
    )
    if PAPER_LINKS in paper_records.links:
        yield _over_time(paper_records, solvers)


def _norms(records: PaperRecords, quantity: str, solver: Solver) -> Iterator[Line]:
    """Yield a line per formulation, with a gap where a motion was not finished."""
    for key in records.formulations:
        y, hover = [], []
        for links in records.links:
            record = records.finished(links, key, solver)
            value = records.value(quantity, links, key, solver)
            y.append(math.nan if value is None else max(value, NOTHING))
            hover.append([] if record is None else _hover_text(record))
        yield Line(key, records.links, y, hover)


def _links(record: Record) -> int:
    return record.settings["links"]


def _unfinished(records: PaperRecords, quantity: str, solver: Solver) -> Iterator[Line]:
    """Yield crosses for unfinished motions, each above all values at the same number of links."""
    points = product(records.links, records.formulations, records.solvers)
    values = {
        point: max(x, NOTHING)
        for point in points
        if (x := records.value(quantity, *point)) is not None
    }
    least, most = (end(values.values(), default=1.0) for end in (min, max))
    step, height = (most / least) ** HEIGHT, dict.fromkeys(records.links, least)
    for (links, _, by), value in values.items():
        if by == solver:
            height[links] = max(height[links], value)
    for key in records.formulations:
        mine = {"cell": "motion", "formulation": key} | solver._asdict()
        failed = [one for one in records.unfinished if mine.items() <= one.settings.items()]
        for one in failed:
            height[_links(one)] *= step
        if failed:
            yield line_of(
                key,
                failed,
                _links,
                lambda one: height[_links(one)],
                lambda one: [", ".join(_what(one)), f"{one.status}: {one.reason}"],
                label="not finished, in the color of its line",
                appearance="crosses",
            )


def _hover_text(record: Record) -> list[str]:
    settings = record.settings
    return [
        f"{settings['formulation']}, N = {settings['links']}",
        f"{settings['integrator']}, tolerance {settings['tolerance']:.0e}, {record.status}",
        f"CPU time {seconds_text(record.cpu_seconds or 0.0)}",
        f"constraint error {record.errors['constraint']:.2e} m/s",
        f"energy error {record.errors['energy']:.2e} J",
        ", ".join(f"{value} {name}" for name, value in record.counts.items()),
    ]


def _over_time(records: PaperRecords, solvers: Sequence[str]) -> Chart:
    """Return the chart of the robot's errors: all formulations, and enlarged those at velocity
    level.
    """
    panels = {}
    for (error, axes), solver in product(OVER_TIME.items(), records.solvers):
        for part, y in zip(PARTS, axes, strict=False):
            lines = []
            for i, key in enumerate(records.formulations):
                record = records.finished(PAPER_LINKS, key, solver)
                if record is None:
                    continue
                times, values = record.series["times"], record.series[error.split()[0]]
                if y.log:
                    times, values = times[1:], [abs(value) for value in values[1:]]
                elif FORMULATIONS[key].level != "velocity":
                    continue
                # Where lines coincide, their markers are set apart.
                lines.append(Line(key, times, values, every=(3 * i, 3 * len(FORMULATIONS))))
            panels[error, part, str(solver)] = Panel(TIME, y, lines, str(solver))
    return Chart(
        "paper-robot",
        f"Figs. 3 and 4: errors of the robot of {PAPER_LINKS} links over time",
        ["error", "shown", "solver"],
        panels,
        height=2.1,
        parts=[
            File(
                f"paper-fig{figure}",
                f"Fig. {figure}: {error} of the robot of {PAPER_LINKS} links",
                [[(error, part, s) for part in PARTS[: len(axes)]] for s in solvers],
            )
            for figure, (error, axes) in enumerate(OVER_TIME.items(), 3)
        ],
    )


# ---- Poses of the robot (Fig. 2) and its animation, by matplotlib --------------------------------

FRAMES_PER_SECOND = 10
EVERY = 2
"""Number of output times per frame."""
FADED = 0.22
"""Opacity of the first pose of Fig. 2; the last one is opaque."""


def write_robot(records: Sequence[Record], folder: Path) -> list[Path]:
    """Draw the poses and the animation, if the motion is among the Records; return the files."""
    record = robot_motion(PaperRecords(records))
    if record is None:
        return []
    from eomcheck.lab.show.chart_matplotlib import both_paths
    from eomcheck.lab.show.sketch_drawing import DARK, LIGHT

    poses, moving = both_paths(folder, "paper-fig2"), folder / "paper-fig2.gif"
    for path, colors in zip(poses, (LIGHT, DARK), strict=True):
        _draw_poses(record, path, colors)
    _animate(record, moving)
    return [*poses, moving]


def _link_ends(record: Record) -> np.ndarray:
    """Return the ends of the links at all output times (k, N + 1, 2), m."""
    from eomcheck.lab.show.sketch_drawing import link_ends

    length = coil_of(PAPER_LINKS).length
    return np.array([link_ends(length, np.array(q)) for q in record.series["q"]])


def _snake(axes: Any, ends: np.ndarray, color: str, ground: str = "white") -> list[Any]:
    """Draw one pose: links that grow thinner towards the tail, and the head as a ring."""
    drawn = []
    for i, width in enumerate(np.linspace(5.5, 1.8, len(ends) - 1)):
        drawn += axes.plot(*ends[i : i + 2].T, color=color, lw=width, solid_capstyle="round")
    return drawn + axes.plot(*ends[:1].T, "o", color=ground, mec=color, mew=2, ms=9)


def _label_plane(axes: Any) -> None:
    axes.set_aspect("equal")
    axes.set_xlabel("x / m")
    axes.set_ylabel("y / m")
    axes.grid(alpha=0.25)


def _draw_poses(record: Record, path: Path, colors: Any) -> None:
    from matplotlib.colors import to_hex, to_rgb

    from eomcheck.lab.show.chart_matplotlib import WIDTH, plt, save_picture, settings_on

    ends, times = _link_ends(record), np.array(record.series["times"])
    ink, ground = np.array(to_rgb(colors.ink)), np.array(to_rgb(colors.ground))
    with plt.rc_context(settings_on(colors)):
        figure, axes = plt.subplots(figsize=(WIDTH, WIDTH), layout="constrained")
        for time, share in zip(POSES, np.linspace(FADED, 1.0, len(POSES)), strict=True):
            color = to_hex(share * ink + (1 - share) * ground)
            pose = ends[int(np.abs(times - time).argmin())]
            _snake(axes, pose, color, colors.ground)
            axes.plot([], [], color=color, lw=4, label=f"t = {time:g} s")
        axes.plot(*ends[:, 0].T, "--", color=colors.constraint, lw=1.4, label="path of the head")
        _label_plane(axes)
        figure.legend(loc="outside upper center", ncols=3, frameon=False)
        save_picture(figure, path)


def _animate(record: Record, path: Path) -> None:
    from matplotlib.animation import PillowWriter

    from eomcheck.lab.show.chart_matplotlib import plt

    ends, times = _link_ends(record)[::EVERY], record.series["times"][::EVERY]
    figure, axes = plt.subplots(figsize=(3.7, 4.2))
    figure.subplots_adjust(left=0.16, right=0.98, bottom=0.1, top=0.94)
    _label_plane(axes)
    (head_path,) = axes.plot([], [], "--", color="#D55E00", lw=1.2)
    *links, head = _snake(axes, ends[0], "black")
    low, high = ends.min(axis=(0, 1)) - 0.3, ends.max(axis=(0, 1)) + 0.3
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    writer = PillowWriter(fps=FRAMES_PER_SECOND)
    with writer.saving(figure, path, dpi=80):
        for k, time in enumerate(times):
            head_path.set_data(*ends[: k + 1, 0].T)
            for i, link in enumerate(links):
                link.set_data(*ends[k, i : i + 2].T)
            head.set_data(*ends[k, :1].T)
            axes.set_title(f"t = {time:.2f} s", fontsize=10)
            writer.grab_frame()
    plt.close(figure)


STUDY = Study(
    key=measure.STUDY,
    cells=measure.cells,
    label="measuring {case}",
    worker=measure.worker,
    tables=tables,
    charts=charts,
    remarks=remarks,
    files=write_robot,
    reading="The snake of growing length by the paper's seven formulations, from rest over 1 s: "
    "norms of the errors over the output times (Eqs. (32) and (33)), and CPU time.",
)

"""Differences between formulations on random snakes, beside the rounding bound and a fault.

Each formulation's q̈ is compared with that of a reference formulation, relative to max |q̈|. The
fault is a flipped sign of gamma in the reference: it shows how far the rounding bound is below the
effect of an error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from statistics import median
from typing import Annotated

import numpy as np

from eomcheck import strategies
from eomcheck.errors import RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import acceleration_sensitivity
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.formulations import FORMULATIONS, applicable
from eomcheck.lab.option_parsing import Links, Seed, check_count, parse_interval
from eomcheck.lab.show.chart import Axis, Chart, Line, Panel
from eomcheck.lab.show.sketch_drawing import link_ends
from eomcheck.lab.show.table import ResultTable, table_of
from eomcheck.lab.store.record_file import Record, Settings, group, record_of_rows, rows_in
from eomcheck.lab.study import Study, failed
from eomcheck.scenes import Snake
from eomcheck.strategies import draw_samples

REFERENCE = "au"
FLOOR = 1e-18
"""Ordinate at which exact agreement is drawn, since a logarithm has no zero."""
DRAWS_PER_SNAKE = 4
"""Number of snakes drawn for each one to compare: some refuse, some stay at rest."""
HALF_WHEEL = 0.22
"""Half the length of a wheel in the picture, m."""


@dataclass(frozen=True)
class Agreement:
    """Distance of one formulation from the reference at one state, relative to max |q̈|.

    `observed` is the distance, `allowed` its bound by rounding. `faulty` is the distance of the
    reference itself when the sign of gamma is flipped.
    """

    key: str
    links: int
    observed: float
    allowed: float
    faulty: float


def cells(
    *,
    links: Links = "1..40",
    per_size: Annotated[int, "Number of random snakes of each size."] = 3,
    seed: Seed = 0,
) -> Iterator[Settings]:
    """Yield the settings of one cell for each number of links.

    Raises:
        InputError: no such numbers of links, or no snakes.
    """
    low, high = parse_interval(links)
    check_count(**{"per-size": per_size})
    for size in range(low, high + 1):
        yield {"links": size, "per size": per_size, "seed": seed}


def _record_of_size(settings: Settings) -> Record:
    """Compare the formulations on random snakes of one size."""
    links, per_size, seed = (settings[name] for name in ("links", "per size", "seed"))
    drawn = strategies.scene_states(strategies.snakes(links, links))
    cases = draw_samples(drawn, DRAWS_PER_SNAKE * per_size, seed)
    # States without agreements are left out: refused ones, and snakes that stay at rest, as the
    # simplest do.
    by_state = (_agreements_at(Evaluation(scene, *state)) for scene, state in cases)
    rows = chain.from_iterable(islice(filter(None, by_state), per_size))
    return record_of_rows(STUDY.key, settings, rows)


def _agreements_at(at: Evaluation) -> list[Agreement]:
    """Return the distance of each formulation; none if the reference refuses or q̈ is 0."""
    reference = FORMULATIONS[REFERENCE]
    try:
        vdot = at.acceleration(reference).vdot
        sensitivity = acceleration_sensitivity(at, reference)
    except RefusedError:
        return []
    M, _, _, a, gamma, _ = at.terms
    flipped = reference.solution(M, at.F, a, -gamma, at.v, at.partition)[0]
    scale = largest(vdot)
    if scale == 0.0:
        return []
    faulty = largest(flipped - vdot) / scale
    agreements = []
    for key, formulation in applicable(at.scene).items():
        if key == REFERENCE:
            continue
        try:
            observed = largest(at.acceleration(formulation).vdot - vdot) / scale
            allowed = allowed_error(acceleration_sensitivity(at, formulation) + sensitivity) / scale
        except RefusedError:
            continue
        # A snake has one constraint a link.
        agreements.append(Agreement(key, at.scene.r, observed, allowed, faulty))
    return agreements


# ---- Results -------------------------------------------------------------------------------------


def tables(records: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield the table of largest distances from the reference, by formulation."""
    columns = {
        "formulation": lambda agreements: agreements[0].key,
        "states": lambda agreements: str(len(agreements)),
        "largest distance": lambda agreements: f"{max(row.observed for row in agreements):.1e}",
        "of what is allowed": lambda agreements: (
            f"{max(row.observed / row.allowed for row in agreements):.1%}"
        ),
        "fault: median": lambda agreements: (
            f"{median(row.faulty / row.allowed for row in agreements):.1e}"
        ),
    }
    by_key = group(rows_in(records, Agreement), lambda row: row.key).values()
    note = (
        f"Distances of q̈ from that of {REFERENCE}, relative to max |q̈|; last, that of one flipped "
        "sign over what is allowed."
    )
    title = "All formulations on random snakes"
    yield table_of("agreement", title, by_key, columns.items(), note=note)


def snake_panel(scene: Snake) -> Panel:
    """Return the panel of a snake in its initial pose: links, head (hollow) and wheels."""
    q, _ = scene.initial_state()
    ends = link_ends(scene.length, q)
    centres = (ends[:-1] + ends[1:]) / 2
    phi = q[2:] + scene.wheel_angle
    half = HALF_WHEEL * np.column_stack((np.cos(phi), np.sin(phi)))
    x, y = ends.T.tolist()
    wheels = np.stack((centres - half, centres + half), axis=2).tolist()
    lines = [Line("links", x, y, hollow=[True]), *(Line("wheels", *wheel) for wheel in wheels)]
    title = f"Snake of {scene.links} links on wheels"
    return Panel(Axis("x / m"), Axis("y / m"), lines, title, equal=True)


def charts(records: Sequence[Record]) -> Iterator[Chart]:
    """Yield the chart of distances from the reference, beside the rounding bound and a fault."""
    rows = rows_in(records, Agreement)

    def points(key: str, value: Callable[[Agreement], float], agreements: list[Agreement]) -> Line:
        links = [row.links for row in agreements]
        hover = [(f"{key}, N = {row.links}", f"{value(row):.1e}") for row in agreements]
        ordinates = [max(value(row), FLOOR) for row in agreements]
        return Line(key, links, ordinates, hover, joined=False)

    # One point a state. At rest gamma is zero, and flipping its sign has no effect.
    by_fault = list({(row.links, row.faulty): row for row in rows if row.faulty}.values())
    lines = [
        points("allowed by rounding", lambda row: row.allowed, rows),
        points("one sign flipped", lambda row: row.faulty, by_fault),
        *(
            points(key, lambda row: row.observed, agreements)
            for key, agreements in group(rows, lambda row: row.key).items()
        ),
    ]
    distance = Axis(f"distance from {REFERENCE} / max |q̈|", log=True, range=(FLOOR / 3, 1e3))
    title = "Lowest row: equal to the last bit"
    panels = {
        ("distance",): Panel(Axis("number of links N"), distance, lines, title),
        ("snake",): snake_panel(Snake.paper()),
    }
    title = "All formulations on random snakes, beside a fault"
    yield Chart("agreement", title, ["diagram"], panels, [[("distance",)]], height=3.2)


def alarm(records: Sequence[Record]) -> bool:
    """Return whether a cell failed, or a formulation is farther off than rounding allows."""
    return failed(records) or any(row.observed > row.allowed for row in rows_in(records, Agreement))


STUDY = Study(
    key="agreement",
    cells=cells,
    worker=lambda stored: _record_of_size,
    tables=tables,
    charts=charts,
    alarm=alarm,
    label="comparing formulations on snakes of {size}",
    small=True,
)

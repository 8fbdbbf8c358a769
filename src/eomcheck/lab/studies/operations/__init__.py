"""Operation counts of one right-hand side over the number of links, and savings by absent terms.

Counts are shown as exact polynomials in N, tables, charts and JSON. A polynomial is accepted only
if it goes through at least one count more than determines it; its coefficients are exact rationals.
The linear systems solved stand beside the paper's Table I.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from operator import attrgetter
from typing import Annotated, Any

from flint import fmpq_poly

from eomcheck.errors import InputError
from eomcheck.formulations import FORMULATIONS, Formulation, formulation_of
from eomcheck.lab.option_parsing import parse_interval
from eomcheck.lab.show.chart import LINKS, Axis, Chart, Panel
from eomcheck.lab.show.table import ResultTable, grouped, table_of
from eomcheck.lab.store.record_file import Record, Settings, group, record_of_rows, rows_in
from eomcheck.lab.studies.operations import measure
from eomcheck.lab.studies.operations.measure import Operations, Saving, Springs, operations_of
from eomcheck.lab.study import Formulations, Study, failed, line_of, unfinished
from eomcheck.numbers.counting import System
from eomcheck.scene_lookup import scene_classes_named
from eomcheck.scenes import Snake

# ---- Cells --------------------------------------------------------------------------------------

Absent = Annotated[str | None, "Show what absent terms save instead, on a kind of scene or all."]


def cells(
    *,
    links: Annotated[
        str | None, "Numbers of links, N or N..M. [default: 2..100, with --scene 3]"
    ] = None,
    formulation: Formulations = None,
    scene: Absent = None,
    repeats: Annotated[
        int | None, "With --scene: timed runs; the median counts. 0 for counts alone. [default: 15]"
    ] = None,
) -> Iterator[Settings]:
    """Yield a cell for each number of links and formulation; for the last one also with springs.

    Raises:
        InputError: no such numbers of links, or an error of `measure.cells`.
        UnknownNameError: no such formulation or scene.
    """
    low, high = parse_interval(links if links is not None else "2..100" if scene is None else "3")
    if scene is not None:
        kinds = scene_classes_named(scene)
        if links is not None and not any(kind.has_links for kind in kinds):
            raise InputError(f"links = {links!r}: {scene} has no number of links to choose")
        yield from measure.cells(kinds, high, formulation, 15 if repeats is None else repeats)
        return
    if repeats is not None:
        raise InputError(f"repeats = {repeats}: nothing is timed without a scene")
    keys = [formulation_of(key).key for key in dict.fromkeys(formulation or FORMULATIONS)]
    for size in range(low, high + 1):
        yield from ({"formulation": key, "links": size} for key in keys)
    if Snake.coil(high).stiffness is not None:
        for key in keys:
            yield {"formulation": key, "links": high, "springs": "present, absent, alone"}


def worker(stored: Sequence[Record], *, scene: Absent = None) -> Callable[[Settings], Record]:
    """Return the function that counts the operations of a cell."""
    kinds = {} if scene is None else {kind.key: kind for kind in scene_classes_named(scene)}

    def work(settings: Settings) -> Record:
        if scene is not None:
            rows = [measure.saving(kinds[settings["scene"]], settings)]
            return record_of_rows(STUDY.key, settings, rows)
        coil = Snake.coil(settings["links"])
        formulation = FORMULATIONS[settings["formulation"]]
        if "springs" in settings:
            rows = [measure.compare_springs(coil, formulation)]
            return record_of_rows(STUDY.key, settings, rows)
        return measure.count_record(measure.count(coil, formulation))

    return work


# ---- Exact polynomials through counts ------------------------------------------------------------

MAX_DEGREE = 4
"""Largest degree of a fitted polynomial."""


def by_formulation(records: Iterable[Operations]) -> dict[str, list[Operations]]:
    """Return the counts of each formulation, in the order of the number of links."""
    return group(sorted(records, key=lambda one: one.links), lambda one: one.formulation)


KINDS: dict[str, Callable[[Operations], int]] = {
    "additions": attrgetter("additions"),
    "multiplications": attrgetter("multiplications"),
    "divisions": attrgetter("divisions"),
    "sin and cos": attrgetter("trigonometric_pairs"),
    "outside of solves": attrgetter("outside_solves"),
    "solves, by LU": attrgetter("elimination"),
}
"""Kind of operation -> function that returns its count."""


@dataclass(frozen=True)
class Fit:
    """Polynomials in N of one formulation by kind of operation; None if none fits."""

    formulation: str
    polynomials: dict[str, fmpq_poly | None]


def fit_polynomial(points: Iterable[tuple[int, int]]) -> fmpq_poly | None:
    """Return the polynomial of smallest degree through all points (N, count), if there is one.

    Its coefficients are exact rationals. It has a degree of at most `MAX_DEGREE` and goes through
    at least one point more than determines it: any points lie on a polynomial of a high degree.
    """
    distinct = sorted(set(points))
    N, polynomial, vanishing = fmpq_poly([0, 1]), fmpq_poly(), fmpq_poly([1])
    for size, value in distinct[: min(MAX_DEGREE + 1, len(distinct) - 1)]:
        # Newton's form: the added term vanishes at the points already interpolated.
        if vanishing(size) == 0:  # two counts for one N
            return None
        polynomial += vanishing * ((value - polynomial(size)) / vanishing(size))
        vanishing *= N - size
        if all(polynomial(other) == expected for other, expected in distinct):
            return polynomial
    return None


def fit(records: Iterable[Operations]) -> list[Fit]:
    """Return the exact polynomials of each formulation."""
    return [
        Fit(
            key,
            {kind: fit_polynomial((x.links, of(x)) for x in rows) for kind, of in KINDS.items()},
        )
        for key, rows in by_formulation(records).items()
    ]


# ---- The systems solved, beside the paper's Table I ----------------------------------------------


@dataclass(frozen=True)
class SolvedSystem:
    """One linear system of a formulation, over all numbers of links.

    Attributes:
        formulation: key.
        links: the smallest number of links at which it is solved.
        smallest: the system there: name, order, number of right-hand sides.
        order: (i, j) where its order is i n + j r at every N, or None where no such integers fit.
        columns: number of right-hand sides as a polynomial in N, or None where none fits.
        final: whether it is the last one that the formulation solves.
        differing: for the last one, the numbers of links at which its order is not that of Table I.
    """

    formulation: str
    links: int
    smallest: System
    order: tuple[int, int] | None
    columns: fmpq_poly | None
    final: bool
    differing: tuple[int, ...]


def fit_order(points: Iterable[tuple[int, int, int]]) -> tuple[int, int] | None:
    """Return the integers (i, j) with order = i n + j r at all points (n, r, order), if any.

    Two points determine them, so at least three are required.
    """
    distinct = sorted(set(points))
    if len(distinct) < 3:
        return None
    (n, r, order), (n_2, r_2, order_2), *_ = distinct
    determinant = n * r_2 - n_2 * r
    if determinant == 0:
        return None
    i = (order * r_2 - order_2 * r) // determinant
    j = (n * order_2 - n_2 * order) // determinant
    if any(i * n + j * r != order for n, r, order in distinct):
        return None
    return i, j


def solved_systems(records: Iterable[Operations]) -> list[SolvedSystem]:
    """Return every system that every formulation solves, in the order of solution."""
    systems = []
    for key, rows in by_formulation(records).items():
        at: dict[tuple[int, str], list[tuple[Operations, System]]] = {}
        for row in rows:
            for index, system in enumerate(row.solves):
                at.setdefault((index, system.name), []).append((row, system))
        systems += [_solved_system(formulation_of(key), solved) for _, solved in sorted(at.items())]
    return systems


def _solved_system(
    formulation: Formulation, solved: Sequence[tuple[Operations, System]]
) -> SolvedSystem:
    final = all(system is row.solves[-1] for row, system in solved)
    differing = [
        row.links
        for row, system in solved
        if system.order != formulation.unknowns(row.n, row.r, row.s)
    ]
    return SolvedSystem(
        formulation.key,
        solved[0][0].links,
        solved[0][1],
        fit_order((row.n, row.r, system.order) for row, system in solved),
        fit_polynomial((row.links, system.columns) for row, system in solved),
        final,
        tuple(differing) if final else (),
    )


# ---- Tables, charts and JSON ---------------------------------------------------------------------

NO_FIT = "no fit"
OF_CHAIN = (
    "KKT: the matrix of the equations of motion and the constraints together. s: number of "
    "quasi-velocities of a chain, 2r for a snake."
)
POWERS: tuple[str, ...] = ("", "N", "N²", "N³", "N⁴")
TOTALS = ("outside of solves", "solves, by LU")
"""Kinds of `KINDS` that are sums of others, with a table of their own."""


def counted_in(records: Sequence[Record]) -> list[Operations]:
    """Return the counts over the number of links, without those of springs and absent terms."""
    own = {"formulation", "links"}
    return [operations_of(one) for one in records if one.counts and one.settings.keys() == own]


def springs_in(records: Sequence[Record]) -> list[Springs]:
    """Return the counts with springs and without."""
    return rows_in((one for one in records if "springs" in one.settings), Springs)


def savings_in(records: Sequence[Record]) -> list[Saving]:
    """Return the savings by absent terms."""
    return rows_in((one for one in records if "scene" in one.settings), Saving)


def signed_sum(terms: list[tuple[str, str]], between: str = " ") -> str:
    """Return the sum of terms (factor, symbol), such as "9/2 N² - 3"; "" is no symbol.

    `between` stands between a factor and its symbol.
    """
    text = ""
    for factor, symbol in terms:
        size = factor.removeprefix("-")
        if size == "0":
            continue
        sign = ("-" if factor != size else "") if not text else " - " if factor != size else " + "
        text += sign + (symbol if symbol and size == "1" else f"{size}{between}{symbol}".strip())
    return text or "0"


def polynomial_text(polynomial: fmpq_poly | None) -> str:
    """Return a polynomial in N, highest power first."""
    if polynomial is None:
        return NO_FIT
    factors = [str(factor) for factor in polynomial.coeffs()]
    return signed_sum(list(zip(factors, POWERS, strict=False))[::-1])


def order_text(system: SolvedSystem) -> str:
    """Return the order of a system in n and r, or as measured at the least N if nothing fits."""
    if system.order is None:
        return f"{system.smallest.order} at N = {system.links}"
    factors = sorted(zip(system.order, "nr", strict=True), key=lambda term: -term[0])
    return signed_sum([(str(factor), size) for factor, size in factors], between="")


def columns_text(system: SolvedSystem) -> str:
    """Return the number of right-hand sides as a polynomial in N, or as measured at the least N."""
    if system.columns is None:
        return f"{system.smallest.columns} at N = {system.links}"
    return polynomial_text(system.columns)


def table_i_text(system: SolvedSystem) -> str:
    """Return the comparison of a system with Table I."""
    if not system.final:
        return "not counted"
    formulation = formulation_of(system.formulation)
    order = formulation.order_text
    if system.differing:
        return f"{order}: differs at N = {', '.join(map(str, system.differing))}"
    if not formulation.in_paper:
        return f"not there; {order} at every N"
    return f"{order}: the same at every N"


def tables(records: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield counts, polynomials, systems beside Table I, costs of springs, savings by absent
    terms.
    """
    counted = counted_in(records)
    if counted:
        yield from _over_links(counted)
    yield from _springs(springs_in(records))
    yield from _savings(savings_in(records))


def _springs(springs: list[Springs]) -> Iterator[ResultTable]:
    columns = (
        ("formulation", lambda one: one.formulation),
        ("with", lambda one: _listed(one.present)),
        ("without", lambda one: _listed(one.absent)),
        ("difference", lambda one: _listed(one.difference)),
        ("spring terms by themselves", lambda one: _listed(one.alone)),
        ("equal", lambda one: "yes" if one.difference == tuple(one.alone) else "no"),
    )
    for links, mine in sorted(group(springs, lambda one: one.links).items()):
        title = f"Springs at N = {links}: additions, multiplications, divisions"
        yield table_of(f"springs-{links}", title, mine, columns)


def _listed(counts: Iterable[int]) -> str:
    return ", ".join(map(grouped, counts))


def _over_links(counted: list[Operations]) -> Iterator[ResultTable]:
    rows, systems = by_formulation(counted), solved_systems(counted)
    at = {(one.links, one.formulation): grouped(one.outside_solves) for one in counted}
    sizes = sorted({one.links for one in counted})
    title = "Additions, multiplications and divisions of one right-hand side, outside of solves"
    counts = [(str(size), *(at.get((size, key), "") for key in rows)) for size in sizes]
    yield ResultTable("counts", title, ("N", *rows), counts, detail=True)
    single = [kind for kind in KINDS if kind not in TOTALS]
    for name, title, kinds in (
        ("operations", "Polynomials in N that go through every count", single),
        ("totals", "All of them together, and what LU takes for the systems solved", TOTALS),
    ):
        lines = [
            (f.formulation, *(polynomial_text(f.polynomials[kind]) for kind in kinds))
            for f in fit(counted)
        ]
        yield ResultTable(name, title, ("formulation", *kinds), lines)
    columns = (
        ("formulation", lambda one: one.formulation),
        ("matrix", lambda one: one.smallest.name),
        ("order", order_text),
        ("right-hand sides", columns_text),
        ("order in Table I", table_i_text),
    )
    title = "Systems solved, in their order, beside the paper's Table I"
    chain = any(one.formulation == "banded" for one in systems)
    yield table_of("systems", title, systems, columns, note=OF_CHAIN if chain else "")


def _savings(savings: list[Saving]) -> Iterator[ResultTable]:
    for structure, mine in group(savings, lambda one: one.structure).items():
        rows = []
        for one in mine:
            absent, zeros = one.operations
            times = [f"{1e6 * x:.3g}" for x in one.seconds or ()]
            rows.append((one.formulation, *map(grouped, (absent, zeros, zeros - absent)), *times))
        timed = ("left out, µs", "zeros, µs") if mine[0].seconds is not None else ()
        name = re.sub(r"\W+", "-", structure).strip("-")
        title = f"{structure}, without {', '.join(mine[0].absent)}"
        columns = ("formulation", "left out", "zeros", "saved", *timed)
        yield ResultTable(f"absent-{name}", title, columns, rows)


def remarks(records: Sequence[Record]) -> Iterator[str]:
    """Yield the reasons of unfinished cells, a note on missing fits, and the definition of
    savings.
    """
    yield from unfinished(records)
    if any(p is None for one in fit(counted_in(records)) for p in one.polynomials.values()):
        yield (
            f"{NO_FIT}: no polynomial of degree {MAX_DEGREE} or less goes through all counts, with "
            "at least one to spare."
        )
    if savings_in(records):
        yield (
            "One right-hand side, outside of solves: additions, multiplications and divisions, "
            "with what a scene has not left out, and with explicit zeros in its place."
        )


def charts(records: Sequence[Record]) -> Iterator[Chart]:
    """Yield the counts over the number of links."""
    kinds = {
        "all operations": lambda one: one.outside_solves + one.elimination,
        **{kind: KINDS[kind] for kind in TOTALS},
    }
    panels = {}
    for kind, value in kinds.items():
        lines = [
            line_of(key, (row for row in rows if value(row) > 0), _links, value, _parts)
            for key, rows in by_formulation(counted_in(records)).items()
        ]
        panels[(kind,)] = Panel(LINKS, Axis(kind, log=True), lines)
    if any(line.x for line in panels[("all operations",)].lines):
        title = "Operations over the number of links"
        yield Chart("operations", title, ["count"], panels)


def _links(one: Operations) -> int:
    return one.links


def _parts(one: Operations) -> list[str]:
    numbers = {name: getattr(one, name) for name in measure.TALLIED[:3]}
    numbers |= {"pairs of sin and cos": one.trigonometric_pairs, "in solves": one.elimination}
    texts = (f"{grouped(number)} {name}" for name, number in numbers.items())
    return [f"{one.formulation}, N = {one.links}", *texts]


def document(records: Sequence[Record]) -> dict[str, Any]:
    """Return the JSON document: counts, polynomials (coefficients exact, as text), systems; or
    savings.
    """
    counted = counted_in(records)
    if not counted:
        return {"savings": [asdict(one) for one in savings_in(records)]}
    return {
        "operations": [
            asdict(one) | {"solves": [system._asdict() for system in one.solves]} for one in counted
        ],
        "polynomials": [
            {
                "formulation": f.formulation,
                "coefficients": {kind: _coefficients(p) for kind, p in f.polynomials.items()},
            }
            for f in fit(counted)
        ],
        "systems": [
            {
                "formulation": s.formulation,
                "matrix": s.smallest.name,
                "order in n, r": s.order,
                "right-hand sides": _coefficients(s.columns),
                "final": s.final,
                "differing from Table I": s.differing,
            }
            for s in solved_systems(counted)
        ],
    }


def _coefficients(polynomial: fmpq_poly | None) -> list[str] | None:
    """Return the coefficients, that of N⁰ first."""
    return None if polynomial is None else [str(factor) for factor in polynomial.coeffs()]


STUDY = Study(
    key=measure.STUDY,
    cells=cells,
    worker=worker,
    tables=tables,
    charts=charts,
    remarks=remarks,
    label="counting operations in {case}",
    alarm=failed,
    document=document,
    reading="Additions, multiplications and divisions are counted one by one; linear systems by LU "
    "of their orders.",
    small=True,
)

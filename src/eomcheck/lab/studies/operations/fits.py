"""Exact polynomials through counts, and the systems solved beside the paper's Table I."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from flint import fmpq_poly

from eomcheck.formulations import Formulation, formulation_of
from eomcheck.lab.store.groups import group
from eomcheck.lab.studies.operations.counting import Operations
from eomcheck.numbers.counting import System

MAX_DEGREE = 4
"""No polynomial of a higher degree is tried."""


def by_formulation(records: Iterable[Operations]) -> dict[str, list[Operations]]:
    """Return the Records of each formulation, in the order of the number of links."""
    return group(sorted(records, key=lambda one: one.links), lambda one: one.formulation)


KINDS: dict[str, Callable[[Operations], int]] = {
    "additions": lambda record: record.additions,
    "multiplications": lambda record: record.multiplications,
    "divisions": lambda record: record.divisions,
    "sin and cos": lambda record: record.trigonometric_pairs,
    "outside of solves": lambda record: record.outside_solves,
    "solves, by LU": lambda record: record.elimination,
}
"""What is fitted, and where a Record has it."""


@dataclass(frozen=True)
class Fit:
    """The polynomials in N of one formulation by kind of operation; None where none fits."""

    formulation: str
    polynomials: dict[str, fmpq_poly | None]


def fit_polynomial(points: Iterable[tuple[int, int]]) -> fmpq_poly | None:
    """Return the polynomial of smallest degree through all points (N, count), if there is one.

    Its coefficients are exact rationals. It has a degree of at most `MAX_DEGREE` and goes through
    at least one point more than determines it: any points lie on a polynomial of a high degree.
    """
    known = sorted(set(points))
    N, polynomial, vanishing = fmpq_poly([0, 1]), fmpq_poly(), fmpq_poly([1])
    for size, value in known[: min(MAX_DEGREE + 1, len(known) - 1)]:
        # Newton's form: the term added vanishes where the polynomial is right already.
        if vanishing(size) == 0:  # two counts for one N
            return None
        polynomial += vanishing * ((value - polynomial(size)) / vanishing(size))
        vanishing *= N - size
        if all(polynomial(other) == expected for other, expected in known):
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

    Two points determine them, so at least three are asked for.
    """
    known = sorted(set(points))
    if len(known) < 3:
        return None
    (n, r, order), (n_2, r_2, order_2), *_ = known
    determinant = n * r_2 - n_2 * r
    if determinant == 0:
        return None
    i = (order * r_2 - order_2 * r) // determinant
    j = (n * order_2 - n_2 * order) // determinant
    if any(i * n + j * r != order for n, r, order in known):
        return None
    return i, j


def solved_systems(records: Iterable[Operations]) -> list[SolvedSystem]:
    """Return every system that every formulation solves, in the order in which it does."""
    found = []
    for key, rows in by_formulation(records).items():
        at: dict[tuple[int, str], list[tuple[Operations, System]]] = {}
        for row in rows:
            for place, system in enumerate(row.solves):
                at.setdefault((place, system.name), []).append((row, system))
        found += [_solved_system(formulation_of(key), solved) for _, solved in sorted(at.items())]
    return found


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

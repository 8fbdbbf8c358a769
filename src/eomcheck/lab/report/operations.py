"""Operation counts as tables and JSON."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from flint import fmpq_poly

from eomcheck.console import console
from eomcheck.formulations import formulation_of
from eomcheck.lab.show.layout import numbers, table, words, write_json
from eomcheck.lab.studies.operations import (
    KINDS,
    MAX_DEGREE,
    Fit,
    Operations,
    SolvedSystem,
    Springs,
    by_formulation,
)

NO_FIT = "no fit"
POWERS: tuple[str, ...] = ("", "N", "N²", "N³", "N⁴")
TOTALS = ("outside of solves", "solves, by LU")
"""The kinds of `KINDS` that are sums of others: they have a table of their own."""


def grouped(value: int) -> str:
    """Return a whole number with its digits in groups of three."""
    return f"{value:,}".replace(",", " ")


def signed_sum(terms: list[tuple[str, str]], between: str = " ") -> str:
    """Return the sum of terms (factor, symbol), such as "9/2 N² - 3"; "" stands for no symbol.

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
    """Return the order of a system in n and r, or as it was measured where nothing fits."""
    if system.order is None:
        return f"{system.smallest.order} at N = {system.links}"
    i, j = (str(factor) for factor in system.order)
    return signed_sum([(i, "n"), (j, "r")], between="")


def columns_text(system: SolvedSystem) -> str:
    """Return the number of right-hand sides, as `order_text` does."""
    if system.columns is None:
        return f"{system.smallest.columns} at N = {system.links}"
    return polynomial_text(system.columns)


def table_i_text(system: SolvedSystem) -> str:
    """Return what Table I says about a system."""
    if not system.final:
        return "not counted"
    formulation = formulation_of(system.formulation)
    order = formulation.order_text
    if system.differing:
        return f"{order}: differs at N = {', '.join(map(str, system.differing))}"
    if not formulation.in_paper:
        return f"not there; {order} at every N"
    return f"{order}: the same at every N"


def print_operations(
    records: list[Operations],
    fits: list[Fit],
    systems: list[SolvedSystem],
    springs: list[Springs],
) -> None:
    """Print the counts, the polynomials, the systems beside Table I, and what springs cost."""
    rows = by_formulation(records)
    by_size = {(record.links, record.formulation): record for record in records}
    sizes = sorted({record.links for record in records})
    _print(
        "Additions, multiplications and divisions of one right-hand side, outside of solves",
        ("N", *rows),
        [
            [str(size), *(grouped(by_size[size, key].outside_solves) for key in rows)]
            for size in sizes
        ],
    )
    for title, kinds in (
        ("The same as polynomials in N; each goes through every count", set(KINDS) - set(TOTALS)),
        ("All of them together, and what LU takes for the systems solved", set(TOTALS)),
    ):
        shown = [kind for kind in KINDS if kind in kinds]
        _print(
            title,
            ("formulation", *shown),
            [
                [f.formulation, *(polynomial_text(f.polynomials[kind]) for kind in shown)]
                for f in fits
            ],
        )
    if any(polynomial is None for f in fits for polynomial in f.polynomials.values()):
        console.print(
            f"{NO_FIT}: no polynomial of degree {MAX_DEGREE} or less goes through all counts, with "
            "at least one to spare.\n"
        )
    _print(
        "Systems solved, in their order, beside the paper's Table I",
        ("formulation", "matrix", "order", "right-hand sides", "order in Table I"),
        [
            [s.formulation, s.smallest.name, order_text(s), columns_text(s), table_i_text(s)]
            for s in systems
        ],
    )
    if springs:
        _print_springs(springs)


def _print_springs(springs: list[Springs]) -> None:
    _print(
        f"Springs at N = {springs[0].links}: additions, multiplications, divisions",
        ("formulation", "with", "without", "difference", "spring terms by themselves", "equal"),
        [
            [
                s.formulation,
                *(
                    ", ".join(map(grouped, counts))
                    for counts in (s.present, s.absent, s.difference, s.alone)
                ),
                "yes" if s.difference == s.alone else "no",
            ]
            for s in springs
        ],
    )


def _print(title: str, columns: tuple[str, ...], rows: list[list[str]]) -> None:
    made = []
    for column in columns:
        left = column in ("formulation", "matrix", "order in Table I")
        made += words(column, no_wrap=False) if left else numbers(column)
    console.print(f"[bold]{title}[/]", table(made, rows), "", sep="\n")


def write_operations(
    path: Path, records: list[Operations], fits: list[Fit], systems: list[SolvedSystem]
) -> None:
    """Write counts, polynomials and systems to `path` as JSON; coefficients are exact, as text."""
    document = {
        "operations": [
            asdict(record) | {"solves": [system._asdict() for system in record.solves]}
            for record in records
        ],
        "polynomials": [
            {
                "formulation": f.formulation,
                "coefficients": {kind: _coefficients(p) for kind, p in f.polynomials.items()},
            }
            for f in fits
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
            for s in systems
        ],
    }
    write_json(path, document)


def _coefficients(polynomial: fmpq_poly | None) -> list[str] | None:
    """Return the coefficients, that of N⁰ first."""
    return None if polynomial is None else [str(factor) for factor in polynomial.coeffs()]

"""What one right-hand side costs, counted operation by operation, over the number of links.

The functions that `eomcheck.motion.right_hand_side` traces are run on numbers that count
(`eomcheck.numbers.counting` says what counts). What depends on the parameters alone is prepared
once per scene and not counted. Linear systems are listed, and what elimination takes for them is
kept apart: it is computed from their orders.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace

from flint import fmpq_poly

from eomcheck.console import progress
from eomcheck.errors import InputError
from eomcheck.evaluation.point import Quantities, net_force
from eomcheck.formulations import FORMULATIONS, Formulation, formulation_of, kane
from eomcheck.lab.store.records import Record
from eomcheck.mechanics.parameters import whole_links
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.counting import Counting, System, Tally
from eomcheck.scenes import Snake
from eomcheck.scenes.snake_chain import torques_on, wheel_forces
from eomcheck.scenes.snake_speeds import active_forces
from eomcheck.scenes.snake_terms import forces

MAX_DEGREE = 4
"""No polynomial of a higher degree is tried."""


@dataclass(frozen=True)
class Operations:
    """One right-hand side of a formulation, for a snake of `links` links.

    `solves` are the linear systems in the order in which they are solved. What their elimination
    takes is in `elimination` and nowhere else.
    """

    formulation: str
    links: int
    n: int
    r: int
    s: int
    additions: int
    multiplications: int
    divisions: int
    trigonometric_pairs: int
    solves: tuple[System, ...]

    @property
    def outside_solves(self) -> int:
        """Additions, multiplications and divisions outside of linear systems."""
        return self.additions + self.multiplications + self.divisions

    @property
    def elimination(self) -> int:
        """What the linear systems take by LU."""
        return sum(lu_operations(system) for system in self.solves)


STUDY = "operations"


def record_of(counted: Operations) -> Record:
    """Return the Record of one count."""
    counts = {
        field.name: getattr(counted, field.name)
        for field in fields(Operations)
        if field.name not in ("formulation", "solves")
    }
    settings = {"formulation": counted.formulation, "links": counted.links}
    solves = [list(system) for system in counted.solves]
    return Record(STUDY, settings, counts=counts, series={"solves": solves})


def operations_of(record: Record) -> Operations:
    """Return the count that a Record holds."""
    solves = tuple(System(*system) for system in record.series["solves"])
    return Operations(record.settings["formulation"], **record.counts, solves=solves)


def lu_operations(system: System) -> int:
    """Return the additions, multiplications and divisions of LU for a matrix of order m.

    A full one: m (m-1) (4m+1) / 6 for the factors and m (2m-1) for each right-hand side. A banded
    one: see `banded_operations`. Neither the comparisons of pivoting nor an estimate of the
    condition are in it.
    """
    m = system.order
    if system.half is not None:
        return banded_operations(m, system.half)
    return m * (m - 1) * (4 * m + 1) // 6 + system.columns * m * (2 * m - 1)


def banded_operations(m: int, half: int) -> int:
    """Return the operations of `solve_banded`: LU of m rows and one solution, refined once.

    Below a pivot are at most `half` rows and, as rows are exchanged, beside it at most 2 `half`
    columns. The refinement takes the residual, a second solution and their sum; what tells whether
    another step is needed is not in it.
    """
    rows = [min(half, m - 1 - k) for k in range(m)]
    columns = [min(2 * half, m - 1 - k) for k in range(m)]
    factors = sum(b + 2 * b * c for b, c in zip(rows, columns, strict=True))
    solution = sum(2 * b + 2 * c + 1 for b, c in zip(rows, columns, strict=True))
    residual = 2 * (m + 2 * sum(rows))
    return factors + 2 * solution + residual + m


def count(scene: Snake, formulation: Formulation) -> Operations:
    """Count one right-hand side of a snake."""
    found = tally(scene, formulation, Counting())
    return Operations(
        formulation.key,
        scene.links,
        scene.n,
        scene.r,
        scene.s,
        found.additions,
        found.multiplications,
        found.divisions,
        found.trigonometric_pairs,
        tuple(found.systems),
    )


def outline(scene: Scene, counting: Counting) -> Quantities:
    """Return what the scene says in numbers that only count: which terms it has."""
    at = Quantities(scene, counting, counting.vector(scene.n), counting.vector(1)[0])
    at.u = counting.vector(scene.p)
    return at


def tally(scene: Scene, formulation: Formulation, counting: Counting) -> Tally:
    """Count one right-hand side, composed as in `eomcheck.motion.right_hand_side`."""
    at = Quantities(scene, counting, counting.vector(scene.n), counting.vector(1)[0])
    at.parameters  # noqa: B018  (prepared once, so before counting starts)
    counting.tally.clear()
    if formulation.uses == "terms":
        at.v = counting.vector(scene.n)
        M, _, _, a, gamma, _ = at.terms
        formulation.solution(M, at.F, a, gamma, at.v, at.partition)
    elif formulation.uses == "chain":
        at.x = counting.vector(scene.s)
        at.call(scene.chain_velocity, at.parameters, at.prepared, at.q, at.x)
        formulation.solution(*at.chain)
    else:
        at.u = counting.vector(scene.p)
        if formulation.uses == "speeds":
            formulation.solution(at.terms.M, at.F, at.speeds.W, at.speeds.rest)
        else:
            at.qdot  # noqa: B018  (a part of the right-hand side)
            formulation.solution(*at.bodies)
    return counting.tally


def measure(links: Iterable[int], keys: Iterable[str] | None = None) -> list[Operations]:
    """Count every number of links for every formulation, by default all, and return the Records.

    Raises:
        InputError: a number of links below 1, or none.
        UnknownNameError: no such formulation.
    """
    formulations = [formulation_of(key) for key in dict.fromkeys(keys or FORMULATIONS)]
    sizes = [whole_links(size) for size in links]
    if not sizes:
        raise InputError("links is empty, expected at least one number of links")
    records = []
    with progress("counting", len(sizes) * len(formulations)) as advance:
        for size in sizes:
            scene = Snake.coil(size)
            for formulation in formulations:
                records.append(count(scene, formulation))
                advance()
    return records


def by_formulation(records: Iterable[Operations]) -> dict[str, list[Operations]]:
    """Return the Records of each formulation, in the order of the number of links."""
    found: dict[str, list[Operations]] = {}
    for record in sorted(records, key=lambda record: record.links):
        found.setdefault(record.formulation, []).append(record)
    return found


# ---- Exact polynomials in the number of links ----------------------------------------------------

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


# ---- What absent springs cost --------------------------------------------------------------------


@dataclass(frozen=True)
class Springs:
    """One right-hand side with springs and without: (additions, multiplications, divisions) each.

    `alone` is what the functions that only springs need cost when they are run by themselves.
    """

    formulation: str
    links: int
    present: tuple[int, int, int]
    absent: tuple[int, int, int]
    alone: tuple[int, int, int]

    @property
    def difference(self) -> tuple[int, ...]:
        """What the springs add to the right-hand side."""
        return tuple(x - y for x, y in zip(self.present, self.absent, strict=True))


def compare_springs(links: int, keys: Iterable[str] | None = None) -> list[Springs]:
    """Count with and without springs at one number of links; nothing where there are no joints."""
    scene = Snake.coil(links)
    if scene.stiffness is None:
        return []
    rows = []
    for key in dict.fromkeys(keys or FORMULATIONS):
        formulation = formulation_of(key)
        present, absent = (count(x, formulation) for x in (scene, replace(scene, stiffness=None)))
        rows.append(
            Springs(key, links, _counts(present), _counts(absent), _springs(scene, formulation))
        )
    return rows


def _counts(record) -> tuple[int, int, int]:
    return record.additions, record.multiplications, record.divisions


def _springs(scene: Snake, formulation: Formulation) -> tuple[int, int, int]:
    counting = Counting()
    stiffness, theta = counting.vector(scene.links - 1), counting.vector(scene.links)
    omega = counting.vector(scene.links)
    if formulation.uses == "chain":
        wheel_forces(torques_on(stiffness, None, theta, omega), theta)
    elif formulation.uses == "bodies":
        partial = counting.vector(2 * scene.links).reshape(scene.links, 1, 2)
        force = active_forces(stiffness, None, theta, omega, partial)
        kane.right_hand_side(force, counting.vector(scene.p))
    else:
        n = counting.vector(scene.n)
        net_force(n, forces(stiffness, None, theta, omega), n)
    return _counts(counting.tally)

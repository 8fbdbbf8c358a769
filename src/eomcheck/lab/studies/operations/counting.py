"""What one right-hand side costs, counted operation by operation.

The functions that `eomcheck.motion.right_hand_side` traces are run on numbers that count
(`eomcheck.numbers.counting` says what counts). What depends on the parameters alone is prepared
once per scene and not counted. Linear systems are listed, and what elimination takes for them is
kept apart: it is computed from their orders.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from eomcheck.evaluation.scene_quantities import Quantities, net_force
from eomcheck.formulations import Formulation, kane
from eomcheck.lab.store.record import Record
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.counting import Counting, System, Tally
from eomcheck.scenes import Snake
from eomcheck.scenes.snake_chain import torques_on, wheel_forces
from eomcheck.scenes.snake_speeds import active_forces
from eomcheck.scenes.snake_terms import joint_forces


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
"""Key of the study."""


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
            at.rates(formulation)
    return counting.tally


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


def compare_springs(scene: Snake, formulation: Formulation) -> Springs:
    """Count a right-hand side of a snake that has springs, and of one that has none."""
    present, absent = (count(x, formulation) for x in (scene, replace(scene, stiffness=None)))
    counts = _counts(present), _counts(absent), _springs(scene, formulation)
    return Springs(formulation.key, scene.links, *counts)


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
        net_force(n, joint_forces(stiffness, None, theta, omega), n)
    return _counts(counting.tally)

"""Operation counts of one right-hand side, and savings by absent terms.

The functions traced by `eomcheck.motion.right_hand_side` are run on counting numbers
(`eomcheck.numbers.counting` defines the operations). Quantities that depend on the parameters alone
are computed once per scene and not counted. Linear systems are recorded, and the operations of
their elimination are kept apart: they are computed from the orders.

Savings are measured by comparing a scene with `with_zeros(scene)`, the same scene whose functions
return arrays instead of every `None`: zeros for forces, b, offset and the gyroscopic part; without
constraints a Jacobian of no rows and the identity for W. Both are counted, and timed in machine
code, which leaves literal zeros out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, fields, replace
from functools import cache
from itertools import product

import numpy as np

from eomcheck.errors import InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.scene_quantities import Quantities, net_force
from eomcheck.formulations import FORMULATIONS, Formulation, formulations_among, kane
from eomcheck.lab.store.record_file import Record, Settings
from eomcheck.lab.studies.rhs import rate_call, time_calls, usual_state
from eomcheck.mechanics.records import Bodies, Speeds, Terms
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.counting import Counted, Counting, System, Tally
from eomcheck.numbers.generic import generic
from eomcheck.scenes import Snake
from eomcheck.scenes.snake import active_forces, joint_forces, torques_on, wheel_forces


@dataclass(frozen=True)
class Operations:
    """Operation count of one right-hand side of a formulation, for a snake of `links` links.

    `solves` are the linear systems in the order of solution. The operations of their elimination
    are in `elimination` and nowhere else.
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
        """Operations of LU for the linear systems."""
        return sum(lu_operations(system) for system in self.solves)


TALLIED = ("additions", "multiplications", "divisions", "trigonometric_pairs")
"""Fields of `Operations` that a `Tally` has."""
STUDY = "operations"
"""Key of the study."""


def count_record(counted: Operations) -> Record:
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
    """Return the count in a Record."""
    solves = tuple(System(*system) for system in record.series["solves"])
    return Operations(record.settings["formulation"], **record.counts, solves=solves)


def lu_operations(system: System) -> int:
    """Return the additions, multiplications and divisions of LU for a matrix of order m.

    A full one: m (m-1) (4m+1) / 6 for the factors and m (2m-1) for each right-hand side. A banded
    one: see `banded_operations`. Neither the comparisons of pivoting nor an estimate of the
    condition number are included.
    """
    m = system.order
    if system.half is not None:
        return banded_operations(m, system.half)
    return m * (m - 1) * (4 * m + 1) // 6 + system.columns * m * (2 * m - 1)


def banded_operations(m: int, half: int) -> int:
    """Return the operations of `solve_banded`: LU of m rows and one solution, refined once.

    Below a pivot are at most `half` rows and, as rows are exchanged, beside it at most 2 `half`
    columns. The refinement takes the residual, a second solution and their sum; the test for
    another step is not included.
    """
    rows = [min(half, m - 1 - k) for k in range(m)]
    columns = [min(2 * half, m - 1 - k) for k in range(m)]
    factors = sum(b + 2 * b * c for b, c in zip(rows, columns, strict=True))
    solution = sum(2 * b + 2 * c + 1 for b, c in zip(rows, columns, strict=True))
    residual = 2 * (m + 2 * sum(rows))
    return factors + 2 * solution + residual + m


def count(scene: Snake, formulation: Formulation) -> Operations:
    """Count one right-hand side of a snake."""
    total = tally(scene, formulation, Counting())
    counts = {name: getattr(total, name) for name in TALLIED}
    size = scene.links, scene.n, scene.r, scene.s
    return Operations(formulation.key, *size, **counts, solves=tuple(total.systems))


def outline(scene: Scene, counting: Counting) -> Quantities:
    """Return the scene's quantities in counting numbers, which show the terms that are present."""
    at = Quantities(scene, counting, counting.vector(scene.n), counting.vector(1)[0])
    at.u = counting.vector(scene.p)
    return at


def tally(scene: Scene, formulation: Formulation, counting: Counting) -> Tally:
    """Count one right-hand side, composed as in `eomcheck.motion.right_hand_side`."""
    at = outline(scene, counting)
    at.parameters  # noqa: B018  (precomputed once, so before counting starts)
    counting.tally.clear()
    if formulation.uses == "terms":
        at.v = counting.vector(scene.n)
        M, _, _, a, gamma, _ = at.terms
        formulation.solution(M, at.F, a, gamma, at.v, at.partition)
    elif formulation.uses == "chain":
        at.x = counting.vector(scene.s)
        at.call(scene.chain_velocity, at.parameters, at.prepared, at.q, at.x)
        formulation.solution(*at.chain)
    elif formulation.uses == "speeds":
        formulation.solution(at.terms.M, at.F, at.speeds.W, at.speeds.rest)
    else:
        at.qdot  # noqa: B018  (a part of the right-hand side)
        at.rates(formulation)
    return counting.tally


# ---- Costs of springs ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Springs:
    """Counts of one right-hand side with springs and without: (additions, multiplications,
    divisions) each.

    `alone` is the count of the functions that only springs need, run by themselves.
    """

    formulation: str
    links: int
    present: tuple[int, int, int]
    absent: tuple[int, int, int]
    alone: tuple[int, int, int]

    @property
    def difference(self) -> tuple[int, ...]:
        """Operations that the springs add to the right-hand side."""
        return tuple(x - y for x, y in zip(self.present, self.absent, strict=True))


def compare_springs(scene: Snake, formulation: Formulation) -> Springs:
    """Count a right-hand side of a snake that has springs, and of one that has none."""
    present, absent = (count(x, formulation) for x in (scene, replace(scene, stiffness=None)))
    counts = _counts(present), _counts(absent), _springs(scene, formulation)
    return Springs(formulation.key, scene.links, *counts)


def _counts(counted: Operations | Tally) -> tuple[int, int, int]:
    return counted.additions, counted.multiplications, counted.divisions


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


# ---- Absent terms --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Saving:
    """Cost of one right-hand side with a scene's absent terms left out, and with zeros for them.

    Attributes:
        structure: structural variant of the scene.
        absent: names of the terms that are absent.
        formulation: key.
        operations: additions, multiplications and divisions outside of solves: (absent, zeros).
        seconds: median times of one call, s: (absent, zeros), or None if they were not measured.
    """

    structure: str
    absent: tuple[str, ...]
    formulation: str
    operations: tuple[int, int]
    seconds: tuple[float, float] | None


class CountingLiterals(Counting):
    """Counts operations on two literals too: explicit zeros count as any other number."""

    def literal(self, x: int) -> Counted:
        """Return the one number there is."""
        return self._number


# ---- The same scene with zeros -------------------------------------------------------------------


@generic
def zeros_for(x, shape, dtype):
    """Return x, zeros of a shape if it is None."""
    if x is None:
        return np.zeros(shape, dtype)
    return x


@generic
def identity_for(W, kinematics, dtype):
    """Return W, the identity (n, n) if it is None."""
    if W is None:
        size = kinematics.q.size
        identity = np.zeros((size, size), dtype)
        for i in range(size):
            identity[i, i] = 1
        return identity
    return W


def _terms(kind: type[Scene]) -> Callable:
    own = kind.terms

    def terms(parameters, prepared, q, v):
        M, Q, B, a, gamma, b = own(parameters, prepared, q, v)
        n, number = q.size, M.dtype
        a = zeros_for(a, (0, n), number)
        r = a.shape[0]
        return Terms(
            M,
            zeros_for(Q, n, number),
            zeros_for(B, n, number),
            a,
            zeros_for(gamma, r, number),
            zeros_for(b, r, number),
        )

    return terms


def _speeds(kind: type[Scene]) -> Callable:
    own = kind.speeds

    def speeds(parameters, prepared, kinematics):
        W, rest, offset = own(parameters, prepared, kinematics)
        number = parameters.mass.dtype
        W = identity_for(W, kinematics, number)
        n = W.shape[0]
        return Speeds(W, zeros_for(rest, n, number), zeros_for(offset, n, number))

    return speeds


def _bodies(kind: type[Scene]) -> Callable:
    own = kind.bodies

    def bodies(parameters, prepared, kinematics):
        V_u, omega_u, rest, turning, mass, inertia, gyroscopic, force = own(
            parameters, prepared, kinematics
        )
        count, e, p = omega_u.shape
        gyroscopic = zeros_for(gyroscopic, (count, e), V_u.dtype)
        force = zeros_for(force, p, V_u.dtype)
        return Bodies(V_u, omega_u, rest, turning, mass, inertia, gyroscopic, force)

    return bodies


@cache
def _kind_with_zeros(kind: type[Scene]) -> type[Scene]:
    functions = {}
    for name, compose in (("terms", _terms), ("speeds", _speeds), ("bodies", _bodies)):
        function = compose(kind)
        function.__module__, function.__qualname__ = kind.__module__, f"{kind.__name__}.{name}_0"
        functions[name] = staticmethod(generic(function))
    return type(kind.__name__, (kind,), functions)


def with_zeros(scene: Scene) -> Scene:
    """Return a copy of `scene` with arrays of zeros instead of absent terms (for W the
    identity).
    """
    changed = copy(scene)
    object.__setattr__(changed, "__class__", _kind_with_zeros(type(scene)))
    return changed


def absent_terms(scene: Scene) -> tuple[str, ...]:
    """Return the names of the terms that are absent in `scene`."""
    at = outline(scene, CountingLiterals())
    records = at.terms, at.speeds, at.bodies
    return tuple(name for record in records for name, x in record._asdict().items() if x is None)


# ---- Counts and times ----------------------------------------------------------------------------


def cells(
    kinds: Iterable[type[Scene]], links: int, keys: Sequence[str] | None, repeats: int
) -> Iterator[Settings]:
    """Yield a cell for each structural variant of `kinds` and formulation that applies.

    Args:
        kinds: scene classes.
        links: number of links, for scene classes that have one.
        keys: formulations, by default all that apply.
        repeats: timed batches per median; 0 for counts alone.

    Raises:
        InputError: a formulation applies to none of `kinds`, or `repeats` is negative.
        UnknownNameError: no such formulation.
    """
    if repeats < 0:
        raise InputError(f"repeats = {repeats}, expected at least 0")
    kinds = tuple(kinds)
    for kind, formulation in product(kinds, formulations_among(kinds, keys)):
        # The only absent terms of a chain are the springs, and its bodies lack those as well.
        if not formulation.applies_to(kind) or formulation.uses == "chain":
            continue
        size = links if kind.has_links else None
        of = {"scene": kind.key, "links": size, "formulation": formulation.key, "repeats": repeats}
        for scene in kind.structures(size):
            yield of | {"structure": scene.structure}


def saving(kind: type[Scene], settings: Settings) -> Saving:
    """Return the saving by absent terms in a cell."""
    formulation, repeats = FORMULATIONS[settings["formulation"]], settings["repeats"]
    scenes = kind.structures(settings["links"])
    scene = next(scene for scene in scenes if scene.structure == settings["structure"])
    both = scene, with_zeros(scene)
    seconds = _times(both, formulation, repeats) if repeats else None
    counts = _count(both[0], formulation), _count(both[1], formulation)
    return Saving(scene.structure, absent_terms(scene), formulation.key, counts, seconds)


def _count(scene: Scene, formulation: Formulation) -> int:
    return sum(_counts(tally(scene, formulation, CountingLiterals())))


def _times(
    both: tuple[Scene, Scene], formulation: Formulation, repeats: int
) -> tuple[float, float]:
    state = usual_state(both[0])
    jobs = ((scene.name, 0, rate_call(Evaluation(scene, *state), formulation)) for scene in both)
    absent, zeros = time_calls(both[0].key, jobs, repeats)
    return absent.seconds, zeros.seconds

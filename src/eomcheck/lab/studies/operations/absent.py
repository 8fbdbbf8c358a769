"""What leaving out saves: a scene as it is, and with explicit zeros for all that it has not.

`with_zeros(scene)` is the same scene whose functions give arrays in the place of every `None`:
zeros for forces, b, offset and the gyroscopic part; without constraints a Jacobian of no rows and
the identity for W. Both are counted, and timed in machine code, which leaves literal zeros out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np

from eomcheck import strategies
from eomcheck.errors import InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS, Formulation, formulations_among
from eomcheck.lab.draws import draw
from eomcheck.lab.store.settings import Settings
from eomcheck.lab.studies.operations.counting import outline, tally
from eomcheck.lab.studies.rhs import rate_call, time_calls
from eomcheck.mechanics.records import Bodies, Speeds, State, Terms
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.counting import Counted, Counting
from eomcheck.numbers.generic import generic


@dataclass(frozen=True)
class Saving:
    """One right-hand side with a scene's absent terms absent, and with zeros in their place.

    Attributes:
        structure: of the scene.
        absent: names of the terms that are absent.
        formulation: key.
        operations: additions, multiplications and divisions outside of solves: (absent, zeros).
        seconds: median times of one call: (absent, zeros), or None where they were not measured.
    """

    structure: str
    absent: tuple[str, ...]
    formulation: str
    operations: tuple[int, int]
    seconds: tuple[float, float] | None


class CountingLiterals(Counting):
    """Counts operations on two literals too: explicit zeros are numbers like any other."""

    def literal(self, x: int) -> Counted:
        """Return the one number there is."""
        return self._number


# ---- The same scene with zeros -------------------------------------------------------------------


@generic
def zeros_for(x, size, dtype):
    """Return x (size,), zeros where it is None."""
    if x is None:
        return np.zeros(size, dtype)
    return x


@generic
def table_for(x, rows, columns, dtype):
    """Return x (rows, columns), zeros where it is None."""
    if x is None:
        return np.zeros((rows, columns), dtype)
    return x


@generic
def identity_for(W, kinematics, dtype):
    """Return W, the identity (n, n) where it is None."""
    if W is None:
        size = kinematics.q.size
        one = np.zeros((size, size), dtype)
        for i in range(size):
            one[i, i] = 1
        return one
    return W


def _terms(kind: type[Scene]) -> Callable:
    own = kind.terms

    def terms(parameters, prepared, q, v):
        M, Q, B, a, gamma, b = own(parameters, prepared, q, v)
        n, number = q.size, M.dtype
        a = table_for(a, 0, n, number)
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
        gyroscopic = table_for(gyroscopic, count, e, V_u.dtype)
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
    """Return `scene` with arrays in the place of all that it has not."""
    made = copy(scene)
    object.__setattr__(made, "__class__", _kind_with_zeros(type(scene)))
    return made


def absent_terms(scene: Scene) -> tuple[str, ...]:
    """Return the names of the terms that `scene` has not."""
    at = outline(scene, CountingLiterals())
    records = at.terms, at.speeds, at.bodies
    return tuple(name for record in records for name, x in record._asdict().items() if x is None)


def _moving(scene: Scene) -> State:
    """Return an ordinary state."""
    ((state,),) = draw(strategies.states(scene).map(lambda state: (state,)), 1, 0)
    return state


# ---- Counts and times ----------------------------------------------------------------------------


def cells(
    kinds: Iterable[type[Scene]], links: int, keys: Sequence[str] | None, repeats: int
) -> Iterator[Settings]:
    """Yield a cell for each structure of `kinds` and formulation that applies.

    Args:
        kinds: kinds of scenes.
        links: number of links, for kinds that have one.
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
        # A chain has nothing that is absent but the springs, which its bodies have as well.
        if not formulation.applies_to(kind) or formulation.uses == "chain":
            continue
        size = links if kind.has_links else None
        of = {"scene": kind.key, "links": size, "formulation": formulation.key, "repeats": repeats}
        for scene in kind.structures(size):
            yield of | {"structure": scene.structure}


def saving(kind: type[Scene], settings: Settings) -> Saving:
    """Return what leaving out saves in a cell."""
    formulation, repeats = FORMULATIONS[settings["formulation"]], settings["repeats"]
    scenes = kind.structures(settings["links"])
    scene = next(scene for scene in scenes if scene.structure == settings["structure"])
    both = scene, with_zeros(scene)
    seconds = _times(both, formulation, repeats) if repeats else None
    counts = _count(both[0], formulation), _count(both[1], formulation)
    return Saving(scene.structure, absent_terms(scene), formulation.key, counts, seconds)


def _count(scene: Scene, formulation: Formulation) -> int:
    found = tally(scene, formulation, CountingLiterals())
    return found.additions + found.multiplications + found.divisions


def _times(
    both: tuple[Scene, Scene], formulation: Formulation, repeats: int
) -> tuple[float, float]:
    state = _moving(both[0])
    jobs = ((scene.name, 0, rate_call(Evaluation(scene, *state), formulation)) for scene in both)
    absent, zeros = time_calls(both[0].key, jobs, repeats)
    return absent.seconds, zeros.seconds

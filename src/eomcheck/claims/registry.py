"""Claims about scenes and about functions, their registries, and the contexts of the former.

A claim is registered by both its sides (`claim`) or by a check in float64 alone (`case_claim`). A
claim yields `Comparison`s: two arrays, actual = expected, with the names of their axes and the
sizes of the terms that cancel in them. An `EvaluationContext` adds to the quantities of a state the
results of formulations, partitions, directions and sensitivities that claims use. `GenericPoint` is
the generic context: every variable of a scene is free, in any exact arithmetic.

Sides are compared twice. In float64 (`eomcheck.claims.case`) they must agree within a rounding
bound by perturbation analysis; in a finite field (`eomcheck.claims.proof`) they must be equal.

A claim asks which numbers it holds (`exact`, `lanes_in`) only where the statements differ: v is
free in exact numbers and satisfies the constraints in float64, where bounds are measured; and a
batch of states cannot branch on a number.

Claims about functions (`FunctionClaim`) are compared in float64 alone, each entry by its own error,
which travels with the number (`eomcheck.testing.function_checks`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial, reduce
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from eomcheck.claims.confusions import ConfusionContext
from eomcheck.claims.finding import Finding, Verdict
from eomcheck.errors import InputError, RefusedError, at_least_one, distinct, registered
from eomcheck.evaluation.scene_quantities import Quantities, Solution
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import Formulation, Partition
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.batch_arrays import as_float64, batch_size, choose
from eomcheck.numbers.generic import Arithmetic, Array

Names = tuple[tuple[str, ...], ...]


class Comparison(NamedTuple):
    """Two sides of an equation, actual = expected, about `subject`.

    In claims about functions both sides are `UncertainArray`s, which carry their errors, and the
    fields from `size` to `sizes` are not used.

    Attributes:
        subject: name of the compared quantity or formulations.
        actual: the quantity under test.
        expected: its expected value, same shape.
        names: names along each axis.
        size: size of the terms that cancel in a side, which set its scale beside its entries.
        sensitivity: κ · scale of both sides (condition number times scale); None if it is to be
            measured on them. In a batch `size` and `sensitivity` hold one number per state; where
            one is to be measured and another is not, NaN stands for None, which no array of
            float64 can hold.
        may_vanish: whether sides that are 0 are compared too.
        sizes: sizes of the terms that cancel in each entry, same shape; None if unknown.
        explain: function (actual, expected, allowed error, index of the worst entry) -> diagnosis,
            "" where it has none; None for the diagnosis of any two arrays.
        context: returns further arrays by which confusions are recognized, in the numbers of the
            sides; called only where these differ.
        drawn_partition: whether it is about a partition that was drawn, until one is not singular.
    """

    subject: str
    actual: Any
    expected: Any
    names: Names
    size: Any = None
    sensitivity: Any = None
    may_vanish: bool = False
    sizes: Any = None
    explain: Callable[[Array, Array, float, tuple[int, ...]], str] | None = None
    context: Callable[[], ConfusionContext] | None = None
    drawn_partition: bool = False


class Decision(NamedTuple):
    """A verdict that a claim has reached by itself; attributes as in `Finding`."""

    subject: str
    observed: float
    allowed: float
    verdict: Verdict
    detail: str = ""


class Skipped(NamedTuple):
    """A subject that could not be evaluated, with the reason."""

    subject: str
    reason: str


ClaimOutput = Comparison | Decision | Skipped


def vanishing(
    subject: str, actual: Any, names: Names, terms: Any, sensitivity: Any = None
) -> Comparison:
    """Return the comparison of an array with 0.

    Args:
        subject: name of the compared quantity.
        actual: the array that should vanish.
        names: names along each axis.
        terms: magnitudes of the terms that cancel, in each entry or the largest of all.
        sensitivity: see `Comparison`.
    """
    zero = np.zeros(np.shape(actual), object)
    sides = Comparison(subject, actual, zero, names, terms, sensitivity)
    return sized(sides, terms) if np.ndim(terms) > 0 else sides


def sized(sides: Comparison, terms: Any) -> Comparison:
    """Return the comparison with `terms` as the magnitudes of the summed terms of each entry."""
    return sides._replace(size=largest(terms), sizes=terms)


def sensitivity_where(resolved: Any) -> Any:
    """Return `Comparison.sensitivity`: to be measured where sides are resolved, infinite elsewhere.

    Resolved: larger than their own rounding.
    """
    if batch_size(resolved):
        return choose(resolved, np.nan, np.inf)
    return None if resolved else np.inf


def along_directions(
    context: EvaluationContext, subject: str, sides: Callable[[Array], tuple[Any, Any] | None]
) -> Iterator[Comparison]:
    """Yield one comparison of the sides along all directions; nothing if `sides` returns None."""
    pairs = [sides(direction) for direction in context.directions]
    existing = [pair for pair in pairs if pair is not None]
    if existing:
        actual, expected = (np.array(side, object) for side in zip(*existing, strict=True))
        yield Comparison(subject, actual, expected, (context.direction_names,))


class EvaluationContext(Protocol):
    """The part of an evaluation that is not a quantity of the scene: formulations, directions etc.

    Attributes:
        exact: whether nothing is rounded, v follows from u, and every variable is free.
        has_speeds: whether generalized speeds exist at this state.
        speeds_resolved: whether generalized speeds by a partition exceed their rounding error; in a
            batch, per state.
        free: the same point with a velocity that need not satisfy the constraints, if possible.
        directions: virtual displacements (n,) that span all.
        direction_names: their names.
        partitions: names and partitions of the coordinates for the embedding method.
        solutions: formulations that do not refuse, each with its result.
        others: partitioned formulations, each with a result and another one by a second partition.
        added_row: weights (r,) of the constraints in a redundant row that is added last, and the
            partition that names the rows kept with it.
    """

    exact: bool
    has_speeds: bool
    speeds_resolved: Any
    free: Quantities
    directions: Sequence[Array]
    direction_names: tuple[str, ...]
    partitions: Iterable[tuple[str, Partition]]
    solutions: Sequence[tuple[Formulation, Any]]
    others: Sequence[tuple[Formulation, Any, Any]]

    @property
    def added_row(self) -> tuple[Array, Partition]:
        """The weights (r,) of a redundant row, and the partition with the rows kept with it."""
        ...

    def sensitivity(self, quantity: Callable[[Any], Any]) -> float:
        """Return κ · scale of a quantity; 0 where nothing is rounded."""
        ...

    def vdot_sensitivity(self, formulation: Formulation) -> float:
        """Return κ · scale of v̇ by `formulation`."""
        ...

    def multiplier_sensitivity(self, formulation: Formulation) -> float:
        """Return κ · scale of λ by `formulation`."""
        ...


class NoRateError(Exception):
    """Precomputed values that cannot be differentiated: not only angles, roots and the clock."""


ENGINE_TERMS = {
    "mass_matrix": "M",
    "bias": "B",
    "forces": "Q",
    "constraint_jacobian": "a",
    "constraint_drift": "gamma",
}
"""Method of an engine -> the field of `Terms` that it computes."""


@dataclass(frozen=True)
class Claim:
    """A statement that correct equations of motion satisfy, with the function that checks it.

    It has a `check` in float64, or `sides`, which can be proved too. A claim about a whole run has
    neither.

    Attributes:
        id: short name, used everywhere.
        statement: the claim in symbols of the paper.
        equations: numbers of the equations in the paper.
        term: the term to suspect first when the claim fails.
        check: function of a `Case` that yields one Finding per subject.
        sides: function of a point (`Quantities`) and an `EvaluationContext` that yields
            `Comparison` records.
        rate_of: subject of the sides that need the rate of precomputed values (`prepare`).
        asks: name of the engine method that the claim compares with.
        needs: what it needs to be compared at all, where a scene or a run may lack it.
        provable: False if the claim follows from another, proved one.
        batchable: False if its sides are evaluated at one state at a time (`batched_claims`).
        every: k, if only each k-th state of a run is checked unless the claim is named.
    """

    id: str
    statement: str
    equations: str
    term: str
    check: Callable[[Any], Iterator[Finding]] | None = field(default=None, repr=False)
    sides: Callable[[Any, Any], Iterator[Comparison | Skipped]] | None = field(
        default=None, repr=False
    )
    rate_of: str = ""
    asks: str = ""
    needs: str = ""
    provable: bool = True
    batchable: bool = True
    every: int = 1

    @property
    def against(self) -> str:
        """Field of `Terms` compared with engines in float64, in place of the sides; or ""."""
        return ENGINE_TERMS.get(self.asks, "")

    @property
    def requirements(self) -> str:
        """The text of all that the claim needs to be compared at all."""
        engine = f"an engine that offers {self.asks}" if self.asks else ""
        return ", and ".join(filter(None, (self.needs, engine))) or "other states of this scene"

    @property
    def proved(self) -> bool:
        """Whether the claim is an identity that `prove` tests."""
        return self.sides is not None and self.provable


class BlindSpot(NamedTuple):
    """A fault of an input that cannot be detected while other inputs are missing.

    Attributes:
        about: the input, a key of `eomcheck.testing.equations_of_motion.INPUTS`.
        what: description of the fault.
        revealed_by: inputs any one of which would reveal it; "against" is the reference, "x & y"
            both together, "x|y" either.
        derived: whether this holds only where all functions result from one derivation.
    """

    about: str
    what: str
    revealed_by: tuple[str, ...]
    derived: bool = False

    def revealing_inputs(self, at: Inputs) -> str:
        """Return the missing inputs that would reveal it, as text; "" where none is missing."""
        alternatives: list[str] = []
        for alternative in self.revealed_by:
            missing = [x for x in alternative.split(" & ") if not has_any(at, x)]
            if not missing:
                return ""
            alternatives.append(" with ".join(missing).replace("|", " or "))
        joined = ", ".join(alternatives[:-1])
        return f"{joined} or {alternatives[-1]}" if joined else alternatives[-1]


class Inputs(Protocol):
    """Inputs of a check of functions, such as a `FunctionState`."""

    def has(self, name: str) -> bool:
        """Return whether an input is available."""
        ...


def has_any(at: Inputs, names: str) -> bool:
    """Return whether one of the quantities "x|y" is available."""
    return any(map(at.has, names.split("|")))


@dataclass(frozen=True)
class FunctionClaim:
    """A statement about user-supplied functions at a state.

    Attributes:
        id: short name.
        statement: the statement, in symbols.
        term: term to blame when it fails.
        needs: names of quantities without which it is skipped; "T|M" is either.
        without: names of inputs with which it does not hold.
        natural: whether it holds only where T is quadratic in v, see `FunctionState.natural`.
        consistent: whether it is checked where the constraints hold, see
            `FunctionState.consistent`.
        blind_spots: faults that cannot be detected while inputs it needs are missing.
        evaluate: function of a `FunctionState` that yields the outcomes.
    """

    id: str
    statement: str
    term: str
    needs: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    natural: bool = False
    consistent: bool = False
    blind_spots: tuple[BlindSpot, ...] = ()
    evaluate: Callable[[Any], Iterator[ClaimOutput]] = field(
        default=lambda at: iter(()), repr=False
    )

    def applies(self, at: Inputs) -> bool:
        """Return whether all it needs is available, and no input with which it does not hold."""
        return all(has_any(at, x) for x in self.needs) and not any(map(at.has, self.without))


# ---- Registries ----------------------------------------------------------------------------------

K = TypeVar("K", Claim, FunctionClaim)
F = TypeVar("F", bound=Callable)


class ClaimRegistry(dict[str, K], Generic[K]):
    """Id -> claim, ordered so that the first claim that fails is the closest to its cause.

    Args:
        kind: class of the claims.
    """

    def __init__(self, kind: type[K]):
        super().__init__()
        self._kind = kind

    def register(self, body: str, *about: Any, **options: Any) -> Callable[[F], F]:
        """Return a decorator that registers a function as a claim.

        Args:
            body: name of the field of the claim that holds the function.
            about: fields of the claim in their order: its id, its statement and so on.
            options: further fields.
        """

        def decorate(function: F) -> F:
            claim = self._kind(*about, **options, **{body: function})
            assert claim.id not in self, claim.id
            self[claim.id] = claim
            return function

        return decorate

    def select(self, ids: Iterable[str] | None) -> tuple[K, ...]:
        """Return the claims of these ids, at least one; None stands for all.

        Raises:
            InputError: `ids` is empty.
            UnknownNameError: an id is not registered.
        """
        if ids is None:
            return tuple(self.values())
        return tuple(registered("claim", id, self) for id in at_least_one("claims", ids))

    def chosen(self, names: Iterable[str], allowed: Collection[str], what: str) -> tuple[str, ...]:
        """Return ids that are all among the allowed ones, in the order of these.

        Args:
            names: ids, at least one.
            allowed: ids of the claims that a command checks.
            what: verb phrase about what such claims do, for the message.

        Raises:
            InputError: no id, an id twice, or one that is not allowed.
            UnknownNameError: an id is not registered.
        """
        ids = [claim.id for claim in self.select(distinct("claims", names))]
        for id in ids:
            if id not in allowed:
                raise InputError(f"claim = {id!r}, expected one that {what}")
        return tuple(id for id in allowed if id in ids)

    def by_name(self, claims: Collection) -> bool:
        """Return whether claims were requested by name: fewer than all.

        Such claims have a finding in any case: where one does not apply, it is skipped.
        """
        return len(claims) < len(self)


CLAIMS = ClaimRegistry(Claim)
"""Id -> claim about scenes: single terms, then relations, then whole accelerations."""

FUNCTION_CLAIMS = ClaimRegistry(FunctionClaim)
"""Id -> claim about functions: single functions, then relations between them."""

claim = partial(CLAIMS.register, "sides")
"""Decorator of the sides of a claim: (id, statement, equations, term), further fields of `Claim`.

The function takes a point (`Quantities`) and an `EvaluationContext` and yields `Comparison`s.
"""

case_claim = partial(CLAIMS.register, "check")
"""Decorator of a check in float64; see `claim`. The function takes a `Case` and yields Findings."""

function_claim = partial(FUNCTION_CLAIMS.register, "evaluate")
"""Decorator of a claim about functions: (id, statement, term, needs), fields of `FunctionClaim`.

The function takes a `FunctionState` and yields `ClaimOutput`s.
"""

# ---- Helpers of claims ---------------------------------------------------------------------------


def magnitude(*factors: Any) -> Any:
    """Return |x| |y| ... of a product of arrays; 0 for exact numbers and absent factors."""
    if batch_size(factors):
        return reduce(np.matmul, (np.abs(as_float64(x)) for x in factors))
    arrays = [np.asarray(x) for x in factors]
    if any(x.dtype == object for x in arrays):
        return 0.0
    return reduce(np.matmul, map(np.abs, arrays))


def product_size(*factors: Any) -> Any:
    """Return the largest entry of |x| |y| ...; 0 for exact numbers and absent factors."""
    return largest(magnitude(*factors))


def numbered(prefix: str, count: int) -> tuple[str, ...]:
    """Return the names (prefix)1, (prefix)2, ..."""
    return tuple(f"{prefix}{i + 1}" for i in range(count))


def term_of(at: Quantities, term: str) -> Array | None:
    """Return a field of `Terms`; None if it is absent, except for an absent B, which is 0."""
    array = getattr(at.terms, term)
    return np.zeros(at.scene.n) if array is None and term == "B" else array


def names_of_term(scene: Scene, term: str) -> Names:
    """Return the names along the axes of a field of `Terms`."""
    coordinates, constraints = scene.coordinate_names, scene.constraint_names
    return {
        "M": (coordinates, coordinates),
        "Q": (coordinates,),
        "B": (coordinates,),
        "a": (constraints, coordinates),
        "gamma": (constraints,),
        "b": (constraints,),
    }[term]


def speed_names(at: Quantities) -> tuple[str, ...]:
    """Return the names of the generalized speeds, as names along an axis."""
    return numbered("u_", at.scene.p)


def unordered_pairs(items: Sequence) -> Iterator[tuple]:
    """Yield every unordered pair."""
    for i, first in enumerate(items):
        for second in items[i + 1 :]:
            yield first, second


# ---- Generic context: all variables free ---------------------------------------------------------


class Variables(Arithmetic, Protocol):
    """An arithmetic that can create variables: random elements, or symbols."""

    def vector(self, size: int) -> Array:
        """Return new variables (size,)."""
        ...


class GenericPoint(Quantities):
    """A point at which every parameter, angle and speed is a variable; v = W u + offset.

    It is its own `EvaluationContext`.

    Args:
        scene: determines sizes and absent terms; its numbers do not matter.
        arithmetic: source of the variables.
        formulations: formulations to evaluate.
        partition: a second partition of the coordinates, beside the paper's.
    """

    exact: ClassVar[bool] = True
    has_speeds: ClassVar[bool] = True
    speeds_resolved: ClassVar[bool] = True

    def __init__(
        self,
        scene: Scene,
        arithmetic: Variables,
        formulations: tuple[Formulation, ...] = (),
        partition: Partition | None = None,
    ):
        super().__init__(scene, arithmetic, arithmetic.vector(scene.n), arithmetic.vector(1)[0])
        self.u = arithmetic.vector(scene.p)
        self.formulations, self.other_partition = formulations, partition
        self.directions = [arithmetic.vector(scene.n)]
        self._variables = arithmetic
        self._free_velocity = arithmetic.vector(scene.n)
        self._results: dict[tuple[str, bool], Solution | RefusedError] = {}

    @cached_property
    def free(self) -> Quantities:
        """The same point with an independent velocity, which need not satisfy the constraints."""
        free = Quantities(self.scene, self.arithmetic, self.q, self.t)
        free.parameters, free.prepared, free.v = self.parameters, self.prepared, self._free_velocity
        return free

    def use_axis_directions(self) -> None:
        """Replace the direction of a virtual displacement by each coordinate in turn."""
        # Elements, not literals: half a literal 1 would be no element of a field.
        n, zero = self.scene.n, 0 * self.q[0]
        self.directions = [np.array([zero + int(i == j) for j in range(n)]) for i in range(n)]

    @property
    def direction_names(self) -> tuple[str, ...]:
        """Names of the directions."""
        return self.scene.coordinate_names if len(self.directions) > 1 else ("any direction",)

    @property
    def partitions(self) -> Iterator[tuple[str, Partition]]:
        """Names and partitions: the paper's, and the second one if there is one."""
        yield "em", self.partition
        if self.other_partition is not None:
            yield "em, drawn", self.other_partition

    @cached_property
    def added_row(self) -> tuple[Array, Partition]:
        """Random weights of the constraints; the redundant row is the second partition's."""
        r = self.scene.r
        rows = np.arange(r), np.array([r])
        if self.other_partition is not None and self.other_partition.kept is not None:
            rows = self.other_partition.kept, self.other_partition.redundant
        partition = self.partition._replace(kept=rows[0], redundant=rows[1])
        return self._variables.vector(r), partition

    @property
    def solutions(self) -> tuple[tuple[Formulation, Solution], ...]:
        """Formulations that do not refuse, each with its solution."""
        results = ((f, self._result(f)) for f in self.formulations)
        return tuple((f, x) for f, x in results if isinstance(x, Solution))

    @property
    def others(self) -> tuple[tuple[Formulation, Solution, Solution], ...]:
        """Partitioned formulations, each with solutions by the paper's and the second partition."""
        if self.other_partition is None:
            return ()
        solutions = self.solutions
        by_other = ((f, self._result(f, True)) for f in self.formulations if f.partitioned)
        # Its own result by the paper's partition, or that of another formulation if it refuses.
        return tuple(
            (f, dict(solutions).get(f, solutions[0][1]), y)
            for f, y in by_other
            if solutions and isinstance(y, Solution)
        )

    def refusal(self, formulation: Formulation) -> RefusedError | None:
        """Return the refusal of `formulation`, or None."""
        result = self._result(formulation)
        return result if isinstance(result, RefusedError) else None

    def _result(self, formulation: Formulation, other: bool = False) -> Solution | RefusedError:
        """Return the cached solution of a formulation, or its refusal."""
        key = (formulation.key, other)
        if key not in self._results:
            try:
                partition = self.other_partition if other else self.partition
                self._results[key] = self.solution(formulation, partition)
            except RefusedError as refusal:
                self._results[key] = refusal
        return self._results[key]

    def sensitivity(self, quantity: Callable[[Any], Any]) -> float:
        """Return 0: nothing is rounded."""
        return 0.0

    vdot_sensitivity = multiplier_sensitivity = sensitivity

    def prepared_duals(self, qdot: Array, clock: bool = True) -> tuple[Any, Array]:
        """Return (prepared, q) while q changes at `qdot`, see `Quantities`.

        Raises:
            NoRateError: precomputed values other than angles and roots cannot be differentiated.
        """
        try:
            return super().prepared_duals(qdot, clock)
        except (TypeError, AttributeError, NotImplementedError) as error:
            raise NoRateError from error

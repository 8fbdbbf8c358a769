"""Cases (a scene and a state): drawn at random by structural variant and family, and mutated.

A `StructuralVariant` of a scene class is a number of links and a set of optional terms, or of
random topologies. A family is a distribution of numbers: the
ordinary ranges, or a hostile one (magnitudes of 16 decades, numbers next to special ones, extreme
speeds). Velocities are projected onto the constraints, a batch of states at once. Mutated cases,
for hill climbing, differ from their parents in a few numbers.

Numbers come from NumPy's generator, so that a seed draws the same on any machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from itertools import product
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from eomcheck.descriptions.random_mechanisms import CONSTRAINTS, RandomScene
from eomcheck.descriptions.random_trees import ROOT, SPACE
from eomcheck.draws import (
    FAR,
    SPEEDS,
    angles_of,
    draw_array,
    draw_coordinates,
    draw_topology,
    state_ranges,
)
from eomcheck.draws.pairwise_design import (
    ABSENT,
    ATTEMPTS,
    levels_of_range,
    ranges_of,
    sample_level,
)
from eomcheck.errors import EomcheckError, InputError, RefusedError
from eomcheck.evaluation.dynamics import assembled_position, consistent_velocity
from eomcheck.evaluation.evaluation import BatchEvaluation, Evaluation
from eomcheck.evaluation.perturbed import check_consistent
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.mechanics.records import Range, State
from eomcheck.mechanics.scene import Factors, GeneratorChoices, Scene
from eomcheck.numbers.batch_arrays import BatchArray
from eomcheck.numbers.generic import Array
from eomcheck.numbers.linear import least_squares, null_space

# ---- Families ------------------------------------------------------------------------------------

FuzzCase = tuple[Scene, State]

ORDINARY, WIDE, SPECIAL, FAST = "ordinary", "wide", "special", "fast"
FAMILIES = ORDINARY, WIDE, SPECIAL, FAST
"""Distributions of cases: the ranges of the scene class; magnitudes of 16 decades; numbers at or
next to 0, ±π/2 and each other; speeds of 300 decades and angles of many turns."""

DECADES = 8.0
"""Decades of `WIDE` parameters: their magnitudes go from 10^-8 to 10^8."""


# ---- Structures ----------------------------------------------------------------------------------

MOST_STRUCTURES = 16
"""Largest number of variants with one number of links; each optional parameter is present or
absent."""

MOST_TOPOLOGIES = 100
"""Topologies tried until one can be assembled."""

TOGETHER = ("mass",), ("moments", "products"), ("stiffness",), ("damping",), ("armature",)
"""Groups of parameters with magnitudes of 16 decades in `WIDE` cases; one factor a body scales a
group."""


class StructuralVariant(NamedTuple):
    """A structural variant of a scene class: what fixes all terms, or the topologies to draw.

    Attributes:
        links: number of links, the ground not counted; None if the class has no choice of links.
        absent: optional parameters that are absent.
        levels: of a random scene class, (factor, level) pairs that its topologies have in common.
    """

    links: int | None
    absent: tuple[str, ...] = ()
    levels: tuple[tuple[str, str], ...] = ()

    @property
    def name(self) -> str:
        """Name of the variant in reports."""
        size = [] if self.links is None else [f"{self.links} links"]
        without = [f"without {', '.join(self.absent)}"] if self.absent else []
        return ", ".join([*size, *without, *(level for _, level in self.levels)]) or "all terms"


def structural_variants(kind: type[Scene], links: Iterable[int]) -> list[StructuralVariant]:
    """Return the variants of a scene class, for each number of links if it has links.

    Random trees differ by the space and the joint at the root, random mechanisms by their
    constraint, all others by which optional parameters are absent.
    """
    if issubclass(kind, RandomScene):
        each = [(count, entry) for count in links for entry in kind.topologies(count)]
        variants = [StructuralVariant(n, (), x) for n, entry in each for x in _levels(entry)]
        return list(dict.fromkeys(variants))
    variants = []
    for count in links if kind.has_links else (None,):
        ranges = kind.ranges(count).items()
        optional = [name for name, one in ranges if one.optional and 0 not in one.shape]
        for present in list(product((True, False), repeat=len(optional)))[:MOST_STRUCTURES]:
            absent = tuple(name for name, there in zip(optional, present, strict=True) if not there)
            variants.append(StructuralVariant(count, absent))
    return variants


def _levels(entry: Factors) -> list[tuple[tuple[str, str], ...]]:
    """Return the levels by which random topologies are told apart, those of each variant."""
    if CONSTRAINTS in entry:
        return [((CONSTRAINTS, level),) for level in entry[CONSTRAINTS]]
    return [((SPACE, entry[SPACE][0]), (ROOT, entry[ROOT][0]))]


def draw_structure_kind(
    kind: type[Scene], variant: StructuralVariant, random: np.random.Generator
) -> type[Scene]:
    """Return a scene class of one topology drawn from a variant; `kind` itself if not random.

    Raises:
        InputError: none of the topologies tried can be assembled.
    """
    if not variant.levels:
        return kind
    for _ in range(MOST_TOPOLOGIES):
        with suppress(RefusedError):
            return draw_topology(
                kind, variant.links, GeneratorChoices(random), dict(variant.levels)
            )
    raise InputError(
        f"{kind.key}: of {MOST_TOPOLOGIES} structures none fits together, {variant.name}"
    )


def varied(scene: Any, family: str, random: np.random.Generator) -> Any:
    """Return a scene of the same structure: itself, or with inertias and springs of any magnitude.

    Geometry is kept, since loops of another geometry might not close.
    """
    if family != WIDE:
        return scene
    changed = {}
    for names in TOGETHER:
        there = {
            name: np.asarray(x) for name in names if (x := getattr(scene, name, None)) is not None
        }
        count = max((len(np.atleast_1d(x)) for x in there.values()), default=0)
        factors = 10.0 ** random.uniform(-DECADES, DECADES, count)
        for name, x in there.items():
            of = factors[: len(np.atleast_1d(x))]
            changed[name] = (np.atleast_1d(x).T * of).T.reshape(x.shape)
    return scene.changed(**changed)


# ---- Random scenes -------------------------------------------------------------------------------

ACROSS = math.pi / 2


def draw_scene_of(
    kind: type[Scene], variant: StructuralVariant, family: str, random: np.random.Generator
) -> Scene:
    """Return a random scene of a structural variant.

    Raises:
        InputError: the numbers drawn make no scene; draw again.
    """
    return kind(
        **{
            name: _parameter(name, one, variant, family, random)
            for name, one in kind.ranges(variant.links).items()
        }
    )


def _parameter(
    name: str, one: Range, variant: StructuralVariant, family: str, random: np.random.Generator
) -> Any:
    if name in variant.absent:
        return None
    ways = [way for way in levels_of_range(one) if way != ABSENT] or [ABSENT]
    value = sample_level(one, str(random.choice(ways)), random)
    if value is None or np.size(value) == 0 or family in (ORDINARY, FAST):
        return value
    if one.low >= 0 and (family == WIDE or (family == SPECIAL and random.random() < 0.5)):
        wide = 10.0 ** random.uniform(-DECADES, DECADES, one.shape)
        zero = (random.random(one.shape) < 1 / 8) & (one.low == 0)
        value = np.where(zero, 0.0, wide)
    elif family == SPECIAL and one.low < 0 < one.high:
        if random.random() < 0.5:
            value = np.array([special_number(random, value) for _ in range(np.size(value))])
            value = value.reshape(one.shape)
        else:
            signs = random.choice((1.0, 1.0, -1.0), one.shape)
            value = random.choice(_among(random, value)) * signs + distances(random, one.shape)
    elif family == SPECIAL and one.shape and random.random() < 0.5:
        value = np.full(one.shape, value.ravel()[0])
    return value if one.shape else float(value)


def special_number(random: np.random.Generator, others: Any) -> float:
    """Return a number at or next to 0, ±π/2 or one of `others`, or an angle."""
    near = 10.0 ** random.uniform(-16, -1) * random.choice((0.0, 1.0, -1.0))
    return float(random.choice(_among(random, others)) + near)


def _among(random: np.random.Generator, others: Any) -> tuple[float, ...]:
    """Return the special numbers: 0, ±π/2, an entry of `others` and a random angle, rad."""
    return 0.0, ACROSS, -ACROSS, float(np.ravel(others)[0]), random.uniform(-math.pi, math.pi)


def distances(random: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Return signed distances of one common scale, some of them 0.

    A common scale puts several angles next to one another at once; independent scales rarely do.
    """
    scale, shares = 10.0 ** random.uniform(-17, -1), 10.0 ** random.uniform(-3, 0, shape)
    return scale * shares * random.choice((0.0, 1.0, -1.0), shape)


# ---- Consistent velocities -----------------------------------------------------------------------

SAFE = 1 / 4
"""Share of the rounding bound that the constraint violation of a velocity may reach."""


def consistent(
    scenes: Sequence[Scene], states: Sequence[State], velocities: Callable[[BatchEvaluation], Array]
) -> tuple[list[FuzzCase], list[int]]:
    """Return cases with velocities projected onto the constraints, and their input indices.

    Args:
        scenes: scenes of one structure.
        states: their states; velocities do not matter.
        velocities: function of the evaluation at these states -> desired velocities (L, n).

    Returns:
        The cases whose velocity is finite and consistent, and the index of each in `scenes`. Where
        a function of the scene raises in every state, all cases, at rest: each is a failure.
    """
    if not scenes:
        return [], []
    at = batched_terms_at(scenes, states)
    if scenes[0].r and at.terms.a is None:
        rest = [state._replace(v=np.zeros(scenes[0].n)) for state in states]
        return [*zip(scenes, rest, strict=True)], [*range(len(scenes))]
    with np.errstate(all="ignore"):
        finite = np.isfinite(at.q.data).all(axis=1)  # type: ignore[attr-defined]
        for term in (at.terms.a, at.terms.b):
            if term is not None:
                finite &= np.isfinite(term.flattened()).all(axis=1)
    if not finite.all():
        finite_indices = np.flatnonzero(finite).tolist()
        picked = [scenes[i] for i in finite_indices], [states[i] for i in finite_indices]

        def some(of: BatchEvaluation) -> Array:
            return velocities(at)[finite_indices]

        cases, indices = consistent(*picked, some)
        return cases, [finite_indices[i] for i in indices]
    with np.errstate(all="ignore"):
        v = BatchArray(np.array(velocities(at)))
        accepted: Any = np.isfinite(v.data).all(axis=1)
        if at.terms.a is not None:
            v.data[~accepted] = 0.0
            for _ in range(2):
                v = v - least_squares(at.terms.a, _residual(at, v))
            accepted &= _is_consistent(at, v)
    cases, indices = [], []
    for i, (scene, state) in enumerate(zip(scenes, states, strict=True)):
        velocity = v.data[i].copy()
        if not accepted[i] and not (
            np.isfinite(velocity).all() and _mended(scene, state, velocity)
        ):
            continue
        cases.append((scene, State(state.q, velocity, state.t)))
        indices.append(i)
    return cases, indices


class _Stacked(NamedTuple):
    """Stand-in for a `BatchEvaluation` whose terms were computed state by state and stacked."""

    q: Any
    states: int
    terms: Any


def batched_terms_at(scenes: Sequence[Scene], states: Sequence[State]) -> Any:
    """Return the batched evaluation, or a `_Stacked` of functions that cannot run on a batch."""
    at = BatchEvaluation(scenes, states)
    try:
        at.terms  # noqa: B018
    except TypeError:
        return _Stacked(at.q, at.states, _stacked_terms(scenes, states))
    return at


def _stacked_terms(scenes: Sequence[Scene], states: Sequence[State]) -> Any:
    """Return a and b of each state, stacked; NaN where a function of the scene raises."""
    all_terms: list[Any] = []
    for scene, state in zip(scenes, states, strict=True):
        terms = None
        with suppress(Exception):  # user-supplied functions; `check` reports which
            terms = Evaluation(scene, *state).terms
        all_terms.append(terms)
    example = next((terms for terms in all_terms if terms is not None), None)
    parts: dict[str, Any] = {"a": None, "b": None}
    for name in parts:
        like = None if example is None else getattr(example, name)
        if like is not None:
            missing = np.full(like.shape, np.nan)
            rows = [missing if terms is None else getattr(terms, name) for terms in all_terms]
            parts[name] = BatchArray(np.stack(rows))
    return SimpleNamespace(**parts)


def _residual(at: BatchEvaluation, v: BatchArray) -> BatchArray:
    a, b = at.terms.a, at.terms.b
    return a @ v if b is None else a @ v + b


def _is_consistent(at: BatchEvaluation, v: BatchArray) -> Array:
    a, b = at.terms.a, at.terms.b
    size = np.abs(a) @ np.abs(v) + (0.0 if b is None else np.abs(b))
    violation = np.abs(_residual(at, v)).data
    return (violation <= SAFE * allowed_error(1.0) * size.data).all(axis=1)


def _mended(scene: Scene, state: State, v: Array) -> bool:
    """Make v (n,) consistent in place, as `check_state` does; return whether that succeeds."""
    try:
        with np.errstate(all="ignore"):
            projected = consistent_velocity(Evaluation(scene, state.q, v, state.t), v)
            check_consistent(Evaluation(scene, state.q, projected, state.t))
    except (EomcheckError, RefusedError, np.linalg.LinAlgError):
        return False
    v[:] = projected
    return True


# ---- Random cases --------------------------------------------------------------------------------


def draw_position(
    scene: Scene, family: str, random: np.random.Generator
) -> tuple[Array, Array, float]:
    """Return a random position (q (n,), components of v (p,), t).

    Raises:
        RefusedError: no position near the drawn one closes the loops.
    """
    ranges, flags = state_ranges(scene), np.array(angles_of(scene))
    q, heading = draw_coordinates(scene, ranges, GeneratorChoices(random))
    if scene.coordinate_ranges() is None:
        if family == SPECIAL and flags.any():
            near = 10.0 ** random.uniform(-16, -1, q.shape) * random.integers(0, 2, q.shape)
            near = near if random.random() < 0.5 else distances(random, q.shape)
            # About 0, differences far below the rounding of other angles are representable.
            q = np.where(flags, random.choice((0.0, heading)) + near, q)
        if family == FAST and random.random() < 0.5:
            q = random.uniform(-FAR, FAR, q.shape)
    c = draw_array(ranges.components, GeneratorChoices(random))
    if family == FAST:
        c = 10.0 ** random.uniform(-SPEEDS, SPEEDS, c.shape) * random.choice((-1, 0, 1), c.shape)
    elif random.random() < 1 / 16:
        c = np.zeros(c.shape)
    t = random.uniform(ranges.time.low, ranges.time.high)
    return assembled_position(scene, q, t), c, t


def draw_cases(
    kind: type[Scene],
    variant: StructuralVariant,
    families: Sequence[str],
    count: int,
    random: np.random.Generator,
) -> tuple[list[FuzzCase], list[str]]:
    """Return up to `count` cases of a variant and the family of each; families take turns."""
    return draw_cases_with(
        lambda family: draw_scene_of(kind, variant, family, random), families, count, random
    )


def draw_cases_with(
    make: Callable[[str], Scene],
    families: Sequence[str],
    count: int,
    random: np.random.Generator,
) -> tuple[list[FuzzCase], list[str]]:
    """Return cases as `draw_cases` does, with scenes from `make(family)`.

    No case is returned if none of the first `ATTEMPTS` positions closes.
    """
    scenes, states, of = [], [], []
    components = []
    for i in range(count):
        family = families[i % len(families)]
        try:
            scene = make(family)
            q, c, t = draw_position(scene, family, random)
        except EomcheckError:
            if not scenes and i >= ATTEMPTS:
                break
            continue  # no such scene, or no such position
        scenes.append(scene)
        states.append(State(q, np.zeros(scene.n), t))
        components.append(c)
        of.append(family)

    def velocities(at: BatchEvaluation) -> Array:
        c = np.array(components)
        if at.terms.a is None:
            return c
        basis = null_space(at.terms.a).data
        return (basis @ c[:, : basis.shape[2], None])[..., 0]

    cases, kept = consistent(scenes, states, velocities)
    return cases, [of[i] for i in kept]


# ---- Changed cases -------------------------------------------------------------------------------

MOST_CHANGES = 3
"""Largest number of parts of a case that one mutation changes."""


Changed = tuple[Scene, Array, Array]
"""A mutated case before projection: scene, desired coordinates (n,) and velocities (n,)."""


def mutated(
    parents: Sequence[tuple[FuzzCase, FuzzCase]],
    random: np.random.Generator,
    clamp: Callable[[Changed], Changed] = lambda one: one,
) -> tuple[list[FuzzCase], list[int]]:
    """Return mutations of the first case of each pair, and the indices of their pairs.

    Args:
        parents: pairs of cases, all of one structure: the case to mutate, and a donor of numbers.
        random: source of the draws.
        clamp: maps a mutated case to the one to use, such as into the ordinary ranges.

    Returns:
        The cases that could be assembled, and the index in `parents` of each.
    """
    scenes, states, velocities, indices = [], [], [], []
    for i, (case, other) in enumerate(parents):
        try:
            scene, q, v = clamp(_changed(case, other, random))
            q = assembled_position(scene, q, case[1].t)
        except EomcheckError:
            continue  # no such scene, or no such position
        scenes.append(scene)
        states.append(State(q, np.zeros(scene.n), case[1].t))
        velocities.append(v)
        indices.append(i)
    cases, kept = consistent(scenes, states, lambda _: np.array(velocities))
    return cases, [indices[i] for i in kept]


def _changed(case: FuzzCase, other: FuzzCase, random: np.random.Generator) -> Changed:
    scene, (q, v, _) = case
    ranges = ranges_of(scene)
    values = {name: getattr(scene, name) for name in ranges}
    present = [name for name, x in values.items() if x is not None and np.size(x)]
    # q and v as often as all parameters together: which of them matter depends on the claim.
    parts = [*present, *["q", "v"] * max(1, len(present) // 3)]
    for _ in range(int(random.integers(1, MOST_CHANGES + 1))):
        name = parts[random.integers(len(parts))]
        if name == "q":
            q = changed_entries(q, other[1].q, random)
        elif name == "v":
            v = changed_entries(v, other[1].v, random)
        else:
            new = changed_entries(np.asarray(values[name]), getattr(other[0], name), random)
            values[name] = np.abs(new) if ranges[name].low >= 0 else new
    return type(scene)(**values), q, v


def changed_entries(x: Array, other: Array, random: np.random.Generator) -> Array:
    """Return x with some entries changed, by one of ten mutations drawn at random."""
    shape = np.shape(x)
    x = np.array(x, dtype=np.float64).ravel()
    other = np.ravel(other)
    i, j = random.integers(x.size, size=2)
    size = 10.0 ** random.uniform(-16, 0)
    match random.integers(10):
        case 0:
            x[i] *= 10.0 ** random.normal(0, 2)
        case 1:
            x[i] *= 1 + random.normal() * size
        case 2:
            x[i] = x[j] + random.choice([0.0, 1.0]) * random.normal() * size
        case 3:
            x[i] = random.choice([0.0, 1.0, ACROSS, 0.5, math.pi])
        case 4:
            x[i] += random.normal() * size
        case 5:
            x = np.where(random.random(x.size) < 0.5, x, other)
        case 6:
            x[i] = -x[i]
        case 7:  # all entries next to one number, on either side
            one = random.choice([x[i], 0.0, ACROSS]) * random.choice((1.0, 1.0, -1.0), x.size)
            x = one + random.integers(0, 2, x.size) * random.normal(size=x.size) * size
        case 8:  # their differences, or the entries themselves, scaled down
            x = x[i] * random.integers(0, 2) + (x - x[i]) * size
        case _:
            x *= 10.0 ** random.normal(0, 2)
    return x.reshape(shape)

"""Cases (a scene and a state): drawn at random by structure and family, and changed.

A `StructuralVariant` is a structure of a scene class: its number of links and its optional terms;
of random scene classes it is a `TopologyVariant`. A family is what numbers are drawn from: ordinary
ranges, or hostile in one of several ways (magnitudes of 16 decades, numbers next to special ones,
extreme speeds). Velocities are projected onto the constraints, a batch of states at once. Changed
cases, for hill climbing, differ from others in a few numbers.

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

from eomcheck.claims.pairwise_design import ABSENT, ATTEMPTS, levels_of_range, sample_level
from eomcheck.descriptions.random_mechanisms import CONSTRAINTS, RandomScene
from eomcheck.descriptions.random_trees import ROOT, SPACE
from eomcheck.errors import EomcheckError, InputError, RefusedError
from eomcheck.evaluation.batched_evaluation import LaneEvaluation
from eomcheck.evaluation.dynamics import assembled_position, check_consistent, consistent_velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.mechanics.random_source import GeneratorChoices
from eomcheck.mechanics.records import Range, State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.numbers.lanes import LaneArray
from eomcheck.numbers.linear import least_squares, null_space
from eomcheck.strategies.state_strategies import CURVATURE, angles_of, state_ranges

# ---- Families ------------------------------------------------------------------------------------

FuzzCase = tuple[Scene, State]

ORDINARY, WIDE, SPECIAL, FAST = "ordinary", "wide", "special", "fast"
FAMILIES = ORDINARY, WIDE, SPECIAL, FAST
"""What a case is drawn from: the ranges of its kind; magnitudes of 16 decades; numbers at or next
to 0, ±π/2 and each other; speeds of 300 decades and angles of many turns."""

DECADES = 8.0
"""Magnitudes of `WIDE` parameters go from 10^-8 to 10^8."""
SPEEDS = 150.0
"""Components of `FAST` velocities go from 10^-150 to 10^150."""
FAR = 1e9
"""Coordinates of `FAST` states, m or rad, at most."""


# ---- Structures ----------------------------------------------------------------------------------

MOST_STRUCTURES = 16
"""Structures of one number of links at most: with all optional parameters there, or not."""


class StructuralVariant(NamedTuple):
    """A structure: what decides which terms there are, and of which size."""

    links: int | None
    absent: tuple[str, ...]

    @property
    def name(self) -> str:
        """What reports call it."""
        size = "" if self.links is None else f"{self.links} links"
        without = f"without {', '.join(self.absent)}" if self.absent else ""
        return ", ".join(part for part in (size, without) if part) or "all terms"


def structural_variants(kind: type[Scene], links: Iterable[int]) -> list[StructuralVariant]:
    """Return the structures of a kind of scene with numbers of links, if it has such."""
    found: list[StructuralVariant] = []
    for count in links if kind.has_links else (None,):
        ranges = kind.ranges(count)
        optional = [name for name, one in ranges.items() if one.optional and 0 not in one.shape]
        for there in list(product((True, False), repeat=len(optional)))[:MOST_STRUCTURES]:
            absent = (name for name, is_there in zip(optional, there, strict=True) if not is_there)
            found.append(StructuralVariant(count, tuple(absent)))
    return found


# ---- Structures of random scene classes ----------------------------------------------------------

MOST_TOPOLOGIES = 100
"""Structures that are tried until one fits together."""

TOGETHER = ("mass",), ("moments", "products"), ("stiffness",), ("damping",), ("armature",)
"""Parameters that are of all magnitudes in `WIDE` cases; those of a group by one factor a body."""


class TopologyVariant(NamedTuple):
    """In which ways scenes of a random kind hang together; a stratum of theirs.

    Attributes:
        links: their number, the ground not counted.
        ways: names of properties, and of each the way.
    """

    links: int
    ways: tuple[tuple[str, str], ...]

    @property
    def name(self) -> str:
        """What reports call it."""
        return ", ".join([f"{self.links} links", *(way for _, way in self.ways)])


def variants_of(kind: type[Scene], links: Iterable[int]) -> list[Any]:
    """Return the strata of a kind of scene; of a random one they are topologies.

    Trees are told apart by the space and the joint at the root, mechanisms by their constraint.
    """
    if not issubclass(kind, RandomScene):
        return list(structural_variants(kind, links))
    found: dict[TopologyVariant, None] = {}
    for count in links:
        for entry in kind.topologies(count):
            if CONSTRAINTS in entry:
                each = [((CONSTRAINTS, way),) for way in entry[CONSTRAINTS]]
            else:
                each = [((SPACE, entry[SPACE][0]), (ROOT, entry[ROOT][0]))]
            found |= dict.fromkeys(TopologyVariant(count, ways) for ways in each)
    return list(found)


def draw_structure_kind(
    kind: type[Scene], stratum: StructuralVariant | TopologyVariant, random: np.random.Generator
) -> type[Scene]:
    """Return a kind whose scenes are of one structure of a stratum; itself where there is one.

    Raises:
        InputError: none of those that were tried fits together.
    """
    if isinstance(stratum, StructuralVariant):
        return kind
    choices, asked = GeneratorChoices(random), dict(stratum.ways)
    entries = [
        entry
        for entry in kind.topologies(stratum.links)
        if all(way in entry.get(name, ()) for name, way in asked.items())
    ]
    for _ in range(MOST_TOPOLOGIES):
        ways = {name: choices.one_of(of) for name, of in choices.one_of(entries).items()} | asked
        try:
            return kind.of_topology(stratum.links, ways, choices)
        except RefusedError:
            continue
    raise InputError(
        f"{kind.key}: of {MOST_TOPOLOGIES} structures none fits together, {stratum.name}"
    )


def varied(scene: Any, family: str, random: np.random.Generator) -> Any:
    """Return a scene of the same structure: itself, or with inertias and springs of any magnitude.

    Geometry stays, for others might not close.
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
    kind: type[Scene], stratum: StructuralVariant, family: str, random: np.random.Generator
) -> Scene:
    """Return a scene of a structure.

    Raises:
        InputError: there is no such scene: other numbers are to be drawn.
    """
    return kind(
        **{
            name: _parameter(name, one, stratum, family, random)
            for name, one in kind.ranges(stratum.links).items()
        }
    )


def _parameter(
    name: str, one: Range, stratum: StructuralVariant, family: str, random: np.random.Generator
) -> Any:
    if name in stratum.absent:
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
    """Return what special angles are next to."""
    return 0.0, ACROSS, -ACROSS, float(np.ravel(others)[0]), random.uniform(-math.pi, math.pi)


def distances(random: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Return distances of one scale, some of them 0.

    What needs several angles to be next to one another is rare if each is so for itself.
    """
    scale, shares = 10.0 ** random.uniform(-17, -1), 10.0 ** random.uniform(-3, 0, shape)
    return scale * shares * random.choice((0.0, 1.0, -1.0), shape)


# ---- Consistent velocities -----------------------------------------------------------------------

SAFE = 1 / 4
"""Share of what rounding allows that a velocity violates constraints by at most."""


def consistent(
    scenes: Sequence[Scene], states: Sequence[State], velocities: Callable[[LaneEvaluation], Array]
) -> tuple[list[FuzzCase], list[int]]:
    """Return cases with velocities that keep the constraints, and which they are of those given.

    Args:
        scenes: scenes of one structure.
        states: where they are; velocities do not matter.
        velocities: wished for (L, n), by the evaluation at these states.
    """
    if not scenes:
        return [], []
    at = _terms_of(scenes, states)
    with np.errstate(all="ignore"):
        finite = np.isfinite(at.q.data).all(axis=0)  # type: ignore[attr-defined]
        for term in (at.terms.a, at.terms.b):
            if term is not None:
                finite &= np.isfinite(term.data).reshape(-1, at.lanes).all(axis=0)
    if not finite.all():
        kept = np.flatnonzero(finite).tolist()
        picked = [scenes[i] for i in kept], [states[i] for i in kept]

        def some(of: LaneEvaluation) -> Array:
            return velocities(at)[kept]

        cases, places = consistent(*picked, some)
        return cases, [kept[i] for i in places]
    with np.errstate(all="ignore"):
        v = LaneArray(np.ascontiguousarray(velocities(at).T))
        good: Any = np.isfinite(v.data).all(axis=0)
        if at.terms.a is not None:
            v.data[:, ~good] = 0.0
            for _ in range(2):
                v = v - least_squares(at.terms.a, _residual(at, v))
            good &= _is_consistent(at, v)
    cases, places = [], []
    for i, (scene, state) in enumerate(zip(scenes, states, strict=True)):
        here = v.data[:, i].copy()
        if not good[i] and not (np.isfinite(here).all() and _mended(scene, state, here)):
            continue
        cases.append((scene, State(state.q, here, state.t)))
        places.append(i)
    return cases, places


class _Stacked(NamedTuple):
    """What of lanes velocities follow from, where terms were found state by state."""

    q: Any
    lanes: int
    terms: Any


def _terms_of(scenes: Sequence[Scene], states: Sequence[State]) -> Any:
    """Return the evaluation in lanes, or of functions that no lanes can run what stands for it."""
    at = LaneEvaluation(scenes, states)
    try:
        at.terms  # noqa: B018
    except TypeError:
        return _Stacked(at.q, at.lanes, _stacked_terms(scenes, states))
    return at


def _stacked_terms(scenes: Sequence[Scene], states: Sequence[State]) -> Any:
    """Return a and b in lanes, found state by state: NaN where a function of the scene raises."""
    found: list[Any] = []
    for scene, state in zip(scenes, states, strict=True):
        terms = None
        with suppress(Exception):  # somebody's functions; `check` tells which
            terms = Evaluation(scene, *state).terms
        found.append(terms)
    whole = next((terms for terms in found if terms is not None), None)
    parts: dict[str, Any] = {"a": None, "b": None}
    for name in parts:
        like = None if whole is None else getattr(whole, name)
        if like is not None:
            lost = np.full(like.shape, np.nan)
            each = [lost if terms is None else getattr(terms, name) for terms in found]
            parts[name] = LaneArray(np.stack(each, axis=-1))
    return SimpleNamespace(**parts)


def _residual(at: LaneEvaluation, v: LaneArray) -> LaneArray:
    a, b = at.terms.a, at.terms.b
    return a @ v if b is None else a @ v + b


def _is_consistent(at: LaneEvaluation, v: LaneArray) -> Array:
    a, b = at.terms.a, at.terms.b
    size = np.abs(a) @ np.abs(v) + (0.0 if b is None else np.abs(b))
    violation = np.abs(_residual(at, v)).data
    return (violation <= SAFE * allowed_error(1.0) * size.data).all(axis=0)


def _mended(scene: Scene, state: State, v: Array) -> bool:
    """Make v (n,) consistent in place, as the single path does; return whether it is."""
    try:
        with np.errstate(all="ignore"):
            found = consistent_velocity(Evaluation(scene, state.q, v, state.t), v)
            check_consistent(Evaluation(scene, state.q, found, state.t))
    except (EomcheckError, RefusedError, np.linalg.LinAlgError):
        return False
    v[:] = found
    return True


# ---- Random cases --------------------------------------------------------------------------------


def draw_position(
    scene: Scene, family: str, random: np.random.Generator
) -> tuple[Array, Array, float]:
    """Return (q (n,), components of v (p,), t).

    Raises:
        RefusedError: no position near what was drawn is closed.
    """
    coordinates, heading, components, time = state_ranges(scene)
    q = np.array([random.uniform(one.low, one.high) for one in coordinates])
    flags = np.array(angles_of(scene))
    turn = random.uniform(heading.low, heading.high)
    if scene.coordinate_ranges() is None:
        q = q + (CURVATURE * np.cumsum(flags) + turn) * flags
        if family == SPECIAL and flags.any():
            near = 10.0 ** random.uniform(-16, -1, q.shape) * random.integers(0, 2, q.shape)
            near = near if random.random() < 0.5 else distances(random, q.shape)
            # About 0 there is room for differences that are far below rounding of other angles.
            q = np.where(flags, random.choice((0.0, turn)) + near, q)
        if family == FAST and random.random() < 0.5:
            q = random.uniform(-FAR, FAR, q.shape)
    c = random.uniform(components.low, components.high, components.shape)
    if family == FAST:
        c = 10.0 ** random.uniform(-SPEEDS, SPEEDS, c.shape) * random.choice((-1, 0, 1), c.shape)
    elif random.random() < 1 / 16:
        c = np.zeros(c.shape)
    t = float(random.uniform(time.low, time.high))
    return assembled_position(scene, q, t), c, t


def draw_cases(
    kind: type[Scene],
    stratum: StructuralVariant,
    families: Sequence[str],
    count: int,
    random: np.random.Generator,
) -> tuple[list[FuzzCase], list[str]]:
    """Return up to `count` cases of a structure and the family of each, evenly of all families."""
    return draw_cases_with(
        lambda family: draw_scene_of(kind, stratum, family, random), families, count, random
    )


def draw_cases_with(
    make: Callable[[str], Scene],
    families: Sequence[str],
    count: int,
    random: np.random.Generator,
) -> tuple[list[FuzzCase], list[str]]:
    """Return cases as `draw_cases` does, of scenes that `make` makes of the name of a family.

    None where none of the first `ATTEMPTS` could be closed.
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

    def velocities(at: LaneEvaluation) -> Array:
        c = np.array(components)
        if at.terms.a is None:
            return c
        basis = np.moveaxis(null_space(at.terms.a).data, -1, 0)
        return (basis @ c[:, : basis.shape[2], None])[..., 0]

    cases, kept = consistent(scenes, states, velocities)
    return cases, [of[i] for i in kept]


# ---- Changed cases -------------------------------------------------------------------------------

MOST_CHANGES = 3
"""Parts of a case that are changed at once, at most."""


Changed = tuple[Scene, Array, Array]
"""A scene, coordinates (n,) and velocities (n,) wished for."""


def mutated(
    parents: Sequence[tuple[FuzzCase, FuzzCase]],
    random: np.random.Generator,
    clamp: Callable[[Changed], Changed] = lambda one: one,
) -> tuple[list[FuzzCase], list[int]]:
    """Return cases near the first of each pair, all of one structure, and which they are.

    Args:
        parents: pairs of cases: what is changed, and what numbers are taken from.
        random: of the draws.
        clamp: returns what is to be looked at in place of what came of a change.
    """
    scenes, states, wished, places = [], [], [], []
    for i, (case, other) in enumerate(parents):
        try:
            scene, q, v = clamp(_changed(case, other, random))
            q = assembled_position(scene, q, case[1].t)
        except EomcheckError:
            continue  # no such scene, or no such position
        scenes.append(scene)
        states.append(State(q, np.zeros(scene.n), case[1].t))
        wished.append(v)
        places.append(i)
    cases, kept = consistent(scenes, states, lambda _: np.array(wished))
    return cases, [places[i] for i in kept]


def _changed(case: FuzzCase, other: FuzzCase, random: np.random.Generator) -> Changed:
    scene, (q, v, _) = case
    ranges = type(scene).ranges(getattr(scene, "links", None) if scene.has_links else None)
    values = {name: getattr(scene, name) for name in ranges}
    there = [name for name, x in values.items() if x is not None and np.size(x)]
    # State and velocity as often as all parameters: which of them matter depends on the claim.
    parts = [*there, *["q", "v"] * max(1, len(there) // 3)]
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
    """Return x with entries changed, in one of several ways."""
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
        case 7:  # all of them next to one, on either side
            one = random.choice([x[i], 0.0, ACROSS]) * random.choice((1.0, 1.0, -1.0), x.size)
            x = one + random.integers(0, 2, x.size) * random.normal(size=x.size) * size
        case 8:  # what is between them, or what they are, to a smaller scale
            x = x[i] * random.integers(0, 2) + (x - x[i]) * size
        case _:
            x *= 10.0 ** random.normal(0, 2)
    return x.reshape(shape)

"""Ordinary cases drawn by pairwise test design, and wide states beyond the ordinary ones.

A factor is a property of a case with a few possible levels: the number of links; moving or at rest;
a parameter absent, zero, positive or negative. The first draws contain every pair of levels of two
factors at least once (a covering array), the next ones all numbers of links in turn.

Numbers come from NumPy's generator, not from hypothesis, which prefers zeros and constants that it
finds in the source code: the same seed draws the same cases, also after changes of the source.

An ordinary state has angles of one turn at most and moderate velocities. If engines are named,
every other state is wide: joints turned by whole turns, velocities that are fast or slow, or both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import chain, combinations
from typing import Any

import numpy as np

from eomcheck.draws import angles_of, ordinary_state
from eomcheck.errors import InputError, RefusedError, whole_number
from eomcheck.evaluation.dynamics import assembled_position, consistent_velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.mechanics.records import Range, State
from eomcheck.mechanics.scene import Factors, GeneratorChoices, Scene
from eomcheck.numbers.generic import Array

# ---- Pairwise design -----------------------------------------------------------------------------

REST_EVERY = 10
"""Number of draws of which at most one is at rest."""

DECADES = 3
"""Decades below the largest value in log-uniform draws."""

ATTEMPTS = 100
"""Number of positions in a row without loop closure after which drawing fails."""

LINKS, MOTION = "links", "motion"
ABSENT, PRESENT = "absent", "present"
ZERO, POSITIVE, NEGATIVE, BOTH = "zero", "positive", "negative", "both signs"
MOVING, AT_REST = "moving", "at rest"

Row = dict[str, str]
"""Name of a factor -> its level in one case."""
Pair = tuple[tuple[str, str], tuple[str, str]]
"""Levels of two factors, each as (factor, level)."""


def levels_of_range(one: Range) -> tuple[str, ...]:
    """Return the levels at which a parameter of this range is drawn."""
    if 0 in one.shape:
        return (ABSENT,)
    values: tuple[str, ...] = (PRESENT,)
    if one.low < 0 < one.high:
        values = (ZERO, POSITIVE, NEGATIVE, BOTH)[: 4 if np.prod(one.shape) > 1 else 3]
    elif one.low == 0 < one.high:
        values = (ZERO, POSITIVE)
    return (ABSENT, *values) if one.optional else values


def level_of_value(value: Any) -> str:
    """Return the level of a parameter's value, see `levels_of_range`."""
    if value is None or np.size(value) == 0:
        return ABSENT
    positive, negative = np.any(np.asarray(value) > 0), np.any(np.asarray(value) < 0)
    if positive or negative:
        return BOTH if positive and negative else POSITIVE if positive else NEGATIVE
    return ZERO


def factors(kind: type[Scene], links: int | None) -> list[Factors]:
    """Return the factors of a scene class with their levels, those of one level included.

    If the class has several topologies, with levels that cannot all be combined, there is one entry
    for each of `Scene.topologies`. Scenes driven by the clock are never drawn at rest.
    """
    levels: Factors = {} if links is None else {LINKS: (str(links),)}
    topologies = kind.topologies(links)
    # Random mechanisms have motion among their topologies, whether or not the example is driven.
    driven = kind.depends_on_time and not any(MOTION in ways for ways in topologies)
    levels[MOTION] = (MOVING,) if driven else (MOVING, AT_REST)
    levels |= {name: levels_of_range(one) for name, one in kind.ranges(links).items()}
    return [levels | ways for ways in topologies]


def levels_of_case(scene: Scene, state: State) -> Row:
    """Return the level of each factor, as measured on the case itself."""
    links, ranges = link_count(scene), ranges_of(scene)
    levels = {} if links is None else {LINKS: str(links)}
    levels[MOTION] = MOVING if state.v.any() else AT_REST
    levels |= scene.topology
    for name, one in ranges.items():
        if hasattr(scene, name):
            way = level_of_value(getattr(scene, name))
            levels[name] = way if way in (ABSENT, *levels_of_range(one)) else PRESENT
    return levels


def count_levels(cases: Iterable[tuple[Scene, State]]) -> dict[str, dict[str, int]]:
    """Count the cases at each level of each factor.

    Factors with a single level in all of these scenes are left out.

    Returns:
        Factor -> level -> number of cases.
    """
    counts: dict[str, dict[str, int]] = {}
    for scene, state in cases:
        links = link_count(scene)
        for name, ways in chain.from_iterable(x.items() for x in factors(type(scene), links)):
            of = counts.setdefault(name, {})
            for way in ways:
                of.setdefault(way, 0)
        for name, way in levels_of_case(scene, state).items():
            counts[name][way] = counts[name].get(way, 0) + 1
    if LINKS in counts:
        counts[LINKS] = dict(sorted(counts[LINKS].items(), key=lambda item: int(item[0])))
    return {name: of for name, of in counts.items() if len(of) > 1 or name in (LINKS, MOTION)}


def ranges_of(scene: Scene) -> dict[str, Range]:
    """Return the ranges of the parameters of a scene of its size."""
    return type(scene).ranges(link_count(scene))


def link_count(scene: Scene) -> int | None:
    """Return the number of links of a scene, None if its class has no choice of links."""
    return getattr(scene, LINKS) if getattr(scene, "has_links", False) else None


# ---- Covering array ------------------------------------------------------------------------------


def _pair(one: tuple[str, str], other: tuple[str, str]) -> Pair:
    return (one, other) if one < other else (other, one)


def pairs_in(row: Row) -> set[Pair]:
    """Return the pairs of levels of one case."""
    return set(combinations(sorted(row.items()), 2))


def level_pairs(choices: Iterable[Factors]) -> set[Pair]:
    """Return every pair of levels of two factors in one of `choices`."""
    pairs: set[Pair] = set()
    for ways in choices:
        each = [[(name, way) for way in of] for name, of in sorted(ways.items())]
        pairs |= {(x, y) for one, other in combinations(each, 2) for x in one for y in other}
    return pairs


def covering_array(choices: list[Factors], random: np.random.Generator) -> list[Row]:
    """Return rows that contain every level and every pair of levels, each row by one of `choices`.

    Greedy: a row begins with a missing pair, and adds the level with most missing pairs, factor by
    factor. Rows are at rest only if their pair requires it.
    """
    missing = level_pairs(choices)

    def first(pair: Pair) -> tuple:
        return (MOTION, AT_REST) not in pair, LINKS not in dict(pair), pair

    rows: list[Row] = []
    for pair in sorted(missing, key=first):
        if pair not in missing:
            continue
        able = [ways for ways in choices if all(way in ways.get(name, ()) for name, way in pair)]
        ways = able[random.integers(len(able))]
        row = dict(pair)
        for name in random.permutation(sorted(ways.keys() - row.keys())):
            among = [way for way in random.permutation(ways[name]) if way != AT_REST]
            gains = [sum(_pair((name, way), x) in missing for x in row.items()) for way in among]
            row[str(name)] = str(among[int(np.argmax(gains))])
        missing -= pairs_in(row)
        rows.append(row)
    alone = [ways for ways in choices if len(ways) == 1]  # a single factor has no pairs
    return rows + [{name: way} for ways in alone for name, of in ways.items() for way in of]


def design_rows(
    choices: list[Factors], examples: int, random: np.random.Generator
) -> Iterator[Row]:
    """Yield the levels of `examples` cases: rows of a covering array, then random moving ones.

    The latter have no zeros, and the smaller half of the numbers of links: larger ones take longer
    and find fewer errors.
    """
    covered = covering_array(choices, random)
    resting = [row for row in covered if row[MOTION] == AT_REST]
    moving = [row for row in covered if row[MOTION] != AT_REST]
    for left in (resting, moving):
        random.shuffle(left)
    smaller = choices[: (len(choices) + 1) // 2]
    for number in range(examples):
        if resting and number % REST_EVERY == REST_EVERY - 1:
            yield resting.pop()
        elif moving:
            yield moving.pop()
        else:
            ways = smaller[number % len(smaller)].items()
            there = {name: [way for way in of if way != ZERO] or of for name, of in ways}
            row = {name: str(random.choice(of)) for name, of in there.items()}
            yield row | {MOTION: MOVING}


# ---- Cases ---------------------------------------------------------------------------------------


def scene_cases(
    kind: type[Scene], links: tuple[int, int], examples: int, seed: int
) -> Iterator[tuple[Scene, State]]:
    """Yield random scenes of a class, each in a random state.

    Args:
        kind: the scene class.
        links: smallest and largest number of links, for a class that has one.
        examples: number of scenes.
        seed: seed of the draws.

    Raises:
        InputError: `examples` is less than 1, `seed` no whole number, or no position satisfies the
            loop closure.
    """
    random = _generator(examples, seed)
    numbers = range(links[0], links[1] + 1) if kind.has_links else (None,)
    choices = list(chain.from_iterable(factors(kind, n) for n in numbers))
    for row in design_rows(choices, examples, random):
        yield _drawn(partial(_scene, kind, row, random), row[MOTION], random)


def state_cases(scene: Scene, examples: int, seed: int) -> Iterator[tuple[Scene, State]]:
    """Yield `scene` in random states; for arguments and errors see `scene_cases`."""
    random = _generator(examples, seed)
    ways = {MOTION: (MOVING,) if scene.depends_on_time else (MOVING, AT_REST)}
    for row in design_rows([ways], examples, random):
        yield _drawn(lambda: scene, row[MOTION], random)


def _generator(examples: int, seed: int) -> np.random.Generator:
    whole_number("examples", examples)
    seed = whole_number("seed", seed, least=None)
    return np.random.default_rng([abs(seed), int(seed < 0)])


def _drawn(
    make: Callable[[], Scene], motion: str, random: np.random.Generator
) -> tuple[Scene, State]:
    refused, choices = "", GeneratorChoices(random)
    for _ in range(ATTEMPTS):
        scene = None
        try:
            scene = make()
            return scene, ordinary_state(scene, choices, at_rest=motion == AT_REST)
        except RefusedError as refusal:
            refused = str(refusal) if scene is None else f"{scene.name}: {refusal}"
    raise InputError(f"no position near any of {ATTEMPTS} draws is closed; {refused}")


def _scene(kind: type[Scene], row: Row, random: np.random.Generator) -> Scene:
    links = int(row[LINKS]) if LINKS in row else None
    one = kind.of_topology(links, row, GeneratorChoices(random))
    ranges = one.ranges(links)
    return one(**{name: sample_level(of, row[name], random) for name, of in ranges.items()})


def sample_level(one: Range, way: str, random: np.random.Generator) -> Any:
    """Return a number or an array from a range, at one of its levels, see `levels_of_range`."""
    if way == ABSENT:
        return None if one.optional else np.zeros(one.shape)
    if way == ZERO:
        value = np.zeros(one.shape)
    elif way == PRESENT:
        value = _magnitudes(one.low, one.high, one.shape, random)
    else:
        positive = np.full(one.shape, way == POSITIVE)
        if way == BOTH:
            positive = random.permutation(np.arange(positive.size) % 2 == 0).reshape(one.shape)
        up = _magnitudes(0.0, one.high, one.shape, random)
        value = np.where(positive, up, up * (one.low / one.high))
    return value if one.shape else float(value)


def _magnitudes(
    low: float, high: float, shape: tuple[int, ...], random: np.random.Generator
) -> Array:
    """Return numbers in [low, high], uniform or, for every other array, log-uniform."""
    smallest = max(low, high / 10**DECADES)
    if low >= 0 and smallest < high and random.random() < 0.5:
        return np.exp(random.uniform(np.log(smallest), np.log(high), shape)).clip(low, high)
    return random.uniform(low, high, shape)


# ---- Wide states ---------------------------------------------------------------------------------

TURNS = 2
"""Largest number of whole turns of an angle to either side."""

FAST = 1.5, 3.0
"""Decades of the largest entry of a fast velocity, m/s or rad/s."""
SLOW = -6.0, -2.0
"""Decades of the largest entry of a slow velocity, m/s or rad/s."""

WAYS = (True, None), (True, FAST), (True, SLOW), (False, FAST)
"""Cycle of wide states: whether angles are turned, and decades of the velocity."""


def with_wide(cases: Iterable[tuple[Scene, State]], seed: int) -> Iterator[tuple[Scene, State]]:
    """Yield cases, every other of them in a wide state.

    Args:
        cases: scenes in ordinary states.
        seed: seed of the draws.
    """
    random = np.random.default_rng([abs(seed), int(seed < 0), 1])
    for i, (scene, state) in enumerate(cases):
        yield scene, wide_state(scene, state, i // 2, random) if i % 2 else state


def wide_state(scene: Scene, state: State, number: int, random: np.random.Generator) -> State:
    """Return a wide state made from an ordinary one.

    The ordinary state itself is returned if no position near the turned one satisfies the loop
    closure.

    Args:
        scene: the scene.
        state: an ordinary state, (q, v, t).
        number: number of the state, index into the cycle `WAYS`.
        random: source of the draws.
    """
    turned, decades = WAYS[number % len(WAYS)]
    q, v, t = state
    if turned:
        q = q + 2 * math.pi * random.integers(-TURNS, TURNS + 1, scene.n) * rotating_coordinates(
            scene
        )
    if decades is not None and v.any():
        v = v * (10 ** random.uniform(*decades) / largest(v))
    try:
        q = assembled_position(scene, q, t)
        return State(q, consistent_velocity(Evaluation(scene, q, np.zeros(scene.n), t), v), t)
    except RefusedError:
        return state


def rotating_coordinates(scene: Scene) -> Array:
    """Return the flags (n,) of coordinates that only rotate joints and translate none."""
    tree = scene.tree()
    if tree is None:
        return np.array(angles_of(scene))
    uses = tree.coordinates != 0
    turns = np.array([kind.startswith("r") for kind in tree.joint], bool)
    return uses[turns].any(axis=0) & ~uses[~turns].any(axis=0)

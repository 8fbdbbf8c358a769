"""Proofs of claims as identities of rational functions: polynomial identity testing.

`prove` evaluates both sides of a claim at random points modulo random primes. If they agree, the
identity holds, except with a probability that the degree and the coefficients of the two sides
bound (Schwartz-Zippel). Nothing is rounded: one point at which the sides differ is a
counterexample. See docs/explanation/proof.md for the reasoning.
"""

from __future__ import annotations

import math
import random
import traceback
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from eomcheck.claims.confusions import NO_CONTEXT, agree_everywhere, equal, locate
from eomcheck.claims.finding import (
    DECIDED,
    Finding,
    Proof,
    Unresolved,
    skipped_everywhere,
    unresolved_detail,
)
from eomcheck.claims.registry import CLAIMS, Claim, Comparison, GenericPoint, NoRateError, Skipped
from eomcheck.claims.speeds_and_chains import embedding_null_space
from eomcheck.claims.user_scenes import check_shapes, scene_function_that_raised
from eomcheck.errors import (
    MOST_COUNTED,
    CallError,
    EomcheckError,
    InputError,
    RefusedError,
    distinct,
    whole_number,
)
from eomcheck.evaluation import scene_quantities as quantities
from eomcheck.formulations import Formulation, Partition, formulations_for
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.finite_field import (
    PRIME_COUNT,
    PRIMES,
    Bound,
    DegreeArithmetic,
    DomainError,
    FiniteField,
    random_prime,
)
from eomcheck.numbers.generic import Array, NotRationalError
from eomcheck.safe_output import counted

# ---- Random points -------------------------------------------------------------------------------

Key = tuple[str, str]
"""Id of a claim, and the subject."""

REDRAWS = 3
"""Number of random points in a row after which a refusal is taken to hold at all points."""


NO_RATE = "`prepare` uses more than angles, roots and the clock, and its rate is not known"
"""Reason for skipping an identity: only of angles, square roots and time is the rate computed."""


def provable_claims(names: Iterable[str] | None = None) -> tuple[str, ...]:
    """Return the ids of the claims that are identities, by default all, in order of `CLAIMS`.

    Raises:
        InputError: a claim is no identity, or there are no names.
        UnknownNameError: there is no claim of a name.
    """
    known = tuple(claim.id for claim in CLAIMS.values() if claim.proved)
    return known if names is None else CLAIMS.chosen(names, known, "is an identity")


def identities_at(at: GenericPoint, *claims: Claim) -> Iterator[tuple[Key, Comparison | Skipped]]:
    """Yield the sides of identities at a point, by default of all claims in order of `CLAIMS`."""
    for claim in claims or CLAIMS.values():
        if claim.sides is None or not claim.provable:
            continue
        try:
            for sides in claim.sides(at, at):
                yield (claim.id, sides.subject), sides
        except NoRateError:
            yield (claim.id, claim.rate_of), Skipped(claim.rate_of, NO_RATE)


@dataclass
class IdentityResult:
    """The result of one identity at all points so far.

    Attributes:
        primes: primes of the points at which it was evaluated.
        differing_points: number of points at which its sides differ.
        detail: the term, the row and the sort of error at the first of these.
        skip_reason: reason for skipping it, if it was skipped at a point; otherwise empty.
        drawn_partition: whether it is about the partition that was drawn.
    """

    primes: list[int] = field(default_factory=list)
    differing_points: int = 0
    detail: str = ""
    skip_reason: str = ""
    drawn_partition: bool = False


class IdentitySampler:
    """A sampler that evaluates all identities of one structure at random points.

    Attributes:
        count: number of points drawn, unused ones included.
        results: result of every identity.
        refused: formulations that refuse every point -> name of the singular matrix.
        partition: a choice of dependent coordinates drawn at random, beside the paper's.
    """

    def __init__(
        self,
        scene: Scene,
        formulations: tuple[Formulation, ...],
        source: random.Random,
        claims: tuple[Claim, ...] = (),
    ):
        self.scene, self.formulations, self._source = scene, formulations, source
        self._claims = claims
        self.count = 0
        self.results: dict[Key, IdentityResult] = {}
        self.refused: dict[str, str] = {}
        self.partition: Partition | None = None

    def sample(self) -> None:
        """Evaluate all identities at one more point.

        Raises:
            RefusedError, ZeroDivisionError: no generalized speeds exist at any of `REDRAWS` points.
            DomainError: a number is outside the domain of a function, such as a square root.
            TypeError: a function of the scene or of a formulation uses operations that are not
                rational.
        """
        at, prime = self._point()
        for key, sides in identities_at(at, *self._claims):
            outcome = self.results.setdefault(key, IdentityResult())
            if isinstance(sides, Skipped):
                outcome.skip_reason = sides.reason
                continue
            outcome.primes.append(prime)
            outcome.drawn_partition = sides.drawn_partition
            if not agree_everywhere(*_as_arrays(sides), equal):
                outcome.differing_points += 1
                outcome.detail = outcome.detail or self._detail(at, key, sides)

    def _point(self) -> tuple[GenericPoint, int]:
        """Return a random point and its prime.

        The first that no formulation refuses, except those that refuse every point; otherwise the
        last of `REDRAWS`.
        """
        always = {f.key for f in self.formulations}
        for attempt in range(REDRAWS):
            last = attempt == REDRAWS - 1
            self.count += 1
            prime = random_prime(self._source)
            arithmetic = FiniteField(prime, self._source)
            at = GenericPoint(self.scene, arithmetic, self.formulations, self.partition)
            try:
                if self.partition is None:
                    self.partition = at.other_partition = self._drawn_partition(at)
                refusals = {f.key: at.refusal(f) for f in self.formulations}
            except (RefusedError, ZeroDivisionError):
                if last:
                    raise
                continue
            refused = {key: refusal.what for key, refusal in refusals.items() if refusal}
            always &= refused.keys()
            if last:
                self.refused |= {key: what for key, what in refused.items() if key in always}
            if last or refused.keys() <= self.refused.keys():
                return at, prime
        raise AssertionError("the last attempt returns or raises")

    def _drawn_partition(self, at: GenericPoint) -> Partition | None:
        """Return a random choice of dependent coordinates that is not singular, if one is found."""
        n, r = self.scene.n, self.scene.r
        for _ in range(n if r > 0 else 0):
            order = np.array(self._source.sample(range(n), n), dtype=int)
            # `GenericPoint.added_row` adds a row that the others imply: any may be left out.
            redundant = np.array([self._source.randrange(r + 1)])
            kept = np.setdiff1d(np.arange(r + 1), redundant)
            drawn = Partition(np.sort(order[:r]), np.sort(order[r:]), kept, redundant)
            try:
                embedding_null_space(at, drawn)
            except RefusedError:
                continue
            return drawn
        return None

    def _detail(self, at: GenericPoint, key: Key, sides: Comparison) -> str:
        """Return the term and the entry that differ; directions are tried along the axes."""
        if at.direction_names in sides.names:
            at.use_axis_directions()
            along_axes = dict(identities_at(at, CLAIMS[key[0]]))[key]
            sides = along_axes if isinstance(along_axes, Comparison) else sides
        return f"{CLAIMS[key[0]].term}, {describe_difference(sides)}"


def _as_arrays(sides: Comparison) -> tuple[Array, Array]:
    """Return the actual and the expected side."""
    return np.asarray(sides.actual, object), np.asarray(sides.expected, object)


def describe_difference(sides: Comparison) -> str:
    """Return the place of a difference of two exact sides, and the confusion that explains it."""
    actual, expected = _as_arrays(sides)
    if actual.shape != expected.shape:
        return f"shape {actual.shape}, expected {expected.shape}"
    where = tuple(int(i) for i in np.argwhere(actual != expected)[0])
    context = NO_CONTEXT if sides.context is None else sides.context()
    names = sides.names
    difference = locate(actual, expected, names, context=context, worst=where, agree=equal)
    return ": ".join(filter(None, (difference.where, difference.what)))


# ---- Proof ---------------------------------------------------------------------------------------


def prove(
    scene: Scene | type[Scene],
    links: int | Iterable[int] | None = None,
    points: int = 4,
    *,
    seed: int | None = None,
    formulations: Iterable[str] | None = None,
    claims: Iterable[str] | None = None,
) -> list[Finding]:
    """Prove the algebraic claims for all parameters, angles and speeds of a scene at once.

    Args:
        scene: a scene, which stands for all scenes of its size and absent terms; or a scene class,
            of which all `links` are proved, with and without the terms that can be absent.
        links: numbers of links, for a scene class that has one.
        points: random points per identity, each modulo a prime of its own.
        seed: seed of the draws; by default from the operating system, as the probabilities assume.
        formulations: keys of the formulations to prove, by default all that apply.
        claims: ids of the claims to prove, by default all that are identities.

    Returns:
        One Finding per identity, each with its `proof`, which holds the bounds, the primes and the
        probability that all points agree by chance.

    Raises:
        InputError: `points` or a number of links below 1; a scene class without its `links`; a
            formulation that does not apply to the scene; a claim that is no identity; a function of
            the scene that returns an array of wrong shape.
        UnknownNameError: no such formulation or claim.
    """
    ids = None if claims is None else provable_claims(claims)
    keys = None if formulations is None else distinct("formulations", formulations)
    points = whole_number("points", points, most=MOST_COUNTED)
    seed = new_seed() if seed is None else seed
    findings: list[Finding] = []
    for structure in structures(scene, links):
        chosen = formulations_for(structure, keys)
        findings += prove_structure(structure, chosen, points, seed, ids)
    return findings


def new_seed() -> int:
    """Return a seed from the operating system.

    It has enough bits for the smallest failure probability: with a seed of b bits no event is rarer
    than 2^-b.
    """
    return random.SystemRandom().getrandbits(256)


def structures(scene: Scene | type[Scene], links: int | Iterable[int] | None) -> Iterator[Scene]:
    """Yield one scene per structural variant that `prove` has to prove.

    Raises:
        InputError: see `prove`.
    """
    if links is None and isinstance(scene, Scene):
        yield scene
        return
    kind = type(scene) if isinstance(scene, Scene) else scene
    if not (isinstance(kind, type) and issubclass(kind, Scene)):
        raise InputError(f"scene = {scene!r}, expected a scene or a kind of scene such as Snake")
    if links is None:
        if kind.has_links:
            raise InputError(f"links = None: {scene!r} is no scene, so its links must be given")
        yield from kind.structures()
        return
    counts = tuple(links) if isinstance(links, Iterable) else (links,)
    if not counts:
        raise InputError(f"links = {links!r} holds no number of links")
    for count in counts:
        yield from kind.structures(count)


def prove_structure(
    scene: Scene,
    formulations: tuple[Formulation, ...],
    points: int,
    seed: int,
    claims: Iterable[str] | None = None,
) -> list[Finding]:
    """Return the Findings about all scenes of the structure of `scene`.

    Args:
        scene: the scene.
        formulations: the formulations that take part.
        points: random points per identity.
        seed: seed of the draws.
        claims: ids of the claims to prove, by default all that are identities.

    Raises:
        InputError: see `check_shapes`.
    """
    check_shapes(scene)
    if scene.r > scene.n:
        why = (
            f"{scene.r} constraints on {scene.n} coordinates: at a random point no velocity "
            "satisfies them (eomcheck.with_constraints leaves those that are independent)"
        )
        return [skipped_everywhere("finite-terms", "speeds", scene, why)]
    chosen = () if claims is None else tuple(CLAIMS[id] for id in provable_claims(claims))
    source = random.Random(f"{seed} {scene.structure}")
    draws = IdentitySampler(scene, formulations, source, chosen)
    try:
        for _ in range(points):
            draws.sample()
        bounds = largest_bounds(
            GenericPoint(scene, DegreeArithmetic(), formulations, draws.partition), *chosen
        )
    except (TypeError, DomainError) as error:
        return [_not_rational(scene, error)]
    except (RefusedError, ZeroDivisionError) as error:
        return [_failed(scene, ("finite-terms", "speeds"), REDRAWS, f"defined nowhere: {error}")]
    except Exception as error:
        if isinstance(error, CallError) and not error.by_exception:
            raise  # no answer, which says nothing about the functions on exact numbers
        if origin := scene_function_that_raised(scene, error):
            return [skipped_everywhere("finite-terms", "terms", scene, f"not rational: {origin}")]
        raise
    findings = [
        _failed(scene, ("equivalence", key), REDRAWS, f"{what} is singular at every state")
        for key, what in draws.refused.items()
    ]
    for key, outcome in draws.results.items():
        if not outcome.primes:
            findings.append(skipped_everywhere(*key, scene, outcome.skip_reason))
            continue
        if outcome.differing_points:
            findings.append(_failed(scene, key, outcome.differing_points, outcome.detail))
            continue
        degree, height = bounds[key]
        primes = tuple(outcome.primes)
        # Up to n partitions are tried, until one is not singular: any might have been the one.
        choices = scene.n if outcome.drawn_partition else 1
        chance = failure_probability(degree, height, len(primes), draws.count, choices)
        basis = f"failure probability below {chance:.1e}" if chance else "nothing in it is random"
        evidence = f"proved: {counted(len(primes), 'point')}, {basis}"
        proof = Proof(degree, height, primes, draws.count, chance)
        findings.append(Finding(*key, scene, None, 0.0, 0.0, "passed", evidence, proof=proof))
    return findings


def _failed(scene: Scene, key: Key, points: int, detail: str) -> Finding:
    """Return the Finding that an identity fails at a number of points."""
    evidence = f"disproved: {counted(points, 'point')}"
    return Finding(*key, scene, None, float(points), 0.0, "failed", evidence, detail)


def _not_rational(scene: Scene, error: Exception) -> Finding:
    """Return the skipped Finding on a function that does not run on exact numbers.

    Raises:
        TypeError: the error itself, if it comes from a wrong call inside this package.
    """
    *_, caller = traceback.extract_tb(error.__traceback__)
    path = Path(caller.filename)
    from_here = path.parent == Path(__file__).parent or path == Path(quantities.__file__)
    if from_here and not isinstance(error, NotRationalError):
        raise error
    detail = f"not rational, in {caller.name}: {error}"
    return skipped_everywhere("finite-terms", "terms", scene, detail)


def largest_bounds(at: GenericPoint, *claims: Claim) -> dict[Key, tuple[int, float]]:
    """Return bounds on the numerator of actual - expected for each identity, of all claims or some.

    Returns:
        (claim, subject) -> (degree, height): the total degree, and log2 of the sum of the
        coefficients' magnitudes; the largest over all entries.
    """
    bounds: dict[Key, tuple[int, float]] = {}
    for key, sides in identities_at(at, *claims):
        if isinstance(sides, Skipped):
            continue
        actual, expected = _as_arrays(sides)
        if actual.shape != expected.shape:
            continue  # sides that cannot be equal need no bound
        entries = [x for x in np.ravel(actual - expected) if isinstance(x, Bound)]
        degree = max((x.degree for x in entries), default=0)
        bounds[key] = degree, max((x.height for x in entries), default=0.0)
    return bounds


def failure_probability(
    degree: int, height: float, points: int, draws: int, choices: int = 1
) -> float:
    """Bound the probability that a false identity holds at all points (docs/explanation/proof.md).

    Args:
        degree: bound on the total degree of the numerator of actual - expected.
        height: bound on log2 of the sum of its coefficients' magnitudes.
        points: number of points at which it was evaluated.
        draws: number of points drawn; any of them might have been used.
        choices: number of draws of a partition, one of which this identity is about; 1 if none.
    """
    # Writing sin² as 1 - cos² at most doubles the coefficients for each two degrees.
    bad_primes = (height + degree / 2) / math.log2(PRIMES[0])
    chance = 2 * degree / (PRIMES[0] - 1) + bad_primes / PRIME_COUNT
    return min(1.0, choices * math.comb(draws, points) * chance**points)


# ---- Entries hidden by rounding ------------------------------------------------------------------

MOST_COORDINATES = 40
"""Largest number of coordinates of a scene whose hidden entries are checked in exact arithmetic:
beyond, that takes longer than the states themselves."""


def prove_unresolved(
    claim: Claim, unresolved: Sequence[Unresolved], cache: dict[tuple, list[Finding]]
) -> tuple[list[Finding], list[Unresolved]]:
    """Check entries that rounding hides in all states by proof at one point in exact arithmetic.

    Engines return float64: entries of an engine under test stay hidden. Of a claim by which float64
    compares engines (`Claim.against`) proofs have other subjects: all of them count.

    Args:
        claim: the claim.
        unresolved: its unresolved subjects and entries.
        cache: structure of a scene -> findings at one point; structures are added to it.

    Returns:
        (findings, remaining): a Finding on each identity that fails and one on all proved ones;
        the subjects and entries that stay unresolved.
    """
    failed: dict[tuple, tuple[Finding, list[str]]] = {}
    proved: list[Finding] = []
    names: list[str] = []
    remaining: list[Unresolved] = []
    for hidden in unresolved:
        scene = hidden.finding.scene
        proofs: list[Finding] = []
        exact = hidden.finding.engine is None and scene.n <= MOST_COORDINATES
        if claim.proved and hidden.entry and exact:
            structure = type(scene), scene.structure
            if structure not in cache:
                cache[structure] = _at_one_point(scene)
            of_claim = [proof for proof in cache[structure] if proof.claim == claim.id]
            proofs = [
                proof for proof in of_claim if claim.against or proof.subject == hidden.subject
            ]
        if not proofs or any(proof.verdict not in DECIDED for proof in proofs):
            remaining.append(hidden)
            continue
        disproofs = [proof for proof in proofs if proof.verdict == "failed"]
        for proof in disproofs:
            failed.setdefault((scene.structure, proof.subject), (proof, []))[1].append(hidden.name)
        if not disproofs:
            proved += proofs
            names.append(hidden.name)
    results = list(failed.values())
    if proved:
        results.append((max(proved, key=_failure_probability_of), names))
    states = unresolved[0].states if unresolved else 0
    findings = [_with_hidden_entries(proof, entries, states) for proof, entries in results]
    return findings, remaining


def _failure_probability_of(proved: Finding) -> float:
    """Return the failure probability of a proof."""
    assert proved.proof is not None
    return proved.proof.failure_probability


def _with_hidden_entries(proof: Finding, names: Sequence[str], states: int) -> Finding:
    """Return a Finding in exact arithmetic, with the names of the entries hidden in float64."""
    why = f"in exact arithmetic; {unresolved_detail(names, states)}"
    return proof.because(why) if proof.detail else replace(proof, detail=why)


def _at_one_point(scene: Scene) -> list[Finding]:
    """Return the proofs of all claims at one point; none where the scene cannot be proved."""
    try:
        return prove(scene, points=1, seed=0)
    except EomcheckError:
        return []

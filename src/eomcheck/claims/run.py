"""Runs of the claims: on one state, on random states of a scene, on random scenes.

This is property-based testing. A `RunSelection` names the formulations, engines and claims that
take part; `SceneEngines` is a scene with its engines constructed. Cases (a scene in a state) are
drawn by pairwise test design. When a claim fails, hypothesis shrinks the counterexample: the last
Finding is then the smallest case on which the same claim fails.

Both derivations of a robot come from one description, so that no claim detects a misread file. The
library of the file format therefore takes part by default, as a second reader that may itself be
wrong: a difference is a failure of which either reading may be the cause, and quantities that the
library leaves out are skipped with the reason.
"""

from __future__ import annotations

import re
import time
from collections import defaultdict
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import Any, NamedTuple

import hypothesis
from hypothesis import Phase, Verbosity
from hypothesis.errors import Unsatisfiable
from hypothesis.strategies import SearchStrategy

from eomcheck import strategies
from eomcheck.claims import CLAIMS, State
from eomcheck.claims.case import OFTEN, ONCE, Case, skipped_finding
from eomcheck.claims.finding import (
    DECIDED,
    EVERY_ROW,
    Finding,
    skipped_everywhere,
    unresolved_by_claim,
    unresolved_finding,
)
from eomcheck.claims.findings import Findings
from eomcheck.claims.numerical_accuracy import SampledState, coverage
from eomcheck.claims.proof import prove_unresolved
from eomcheck.claims.registry import Claim
from eomcheck.claims.user_scenes import check_shapes, failing_function, scene_function_that_raised
from eomcheck.draws.pairwise_design import (
    count_levels,
    link_count,
    scene_cases,
    state_cases,
    with_wide,
)
from eomcheck.engines import (
    Engine,
    EngineFault,
    FileEngine,
    default_reader,
    engines_among,
    make_engine,
    represents,
)
from eomcheck.errors import EomcheckError, InputError, message_of
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import CONSISTENT_HINT, check_consistent
from eomcheck.formulations import FORMULATIONS, Formulation, formulations_among
from eomcheck.mechanics.scene import Scene, checked_scene
from eomcheck.scenes import Snake

# ---- Selection -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class RunSelection:
    """The formulations, engines and claims of a run; by default all that need no extra."""

    formulations: tuple[Formulation, ...]
    engines: tuple[type[Engine], ...]
    claims: tuple[str, ...]
    reader: type[FileEngine] | None = None
    """The library among `engines` that reads a robot's file itself, if no engines were named."""
    engines_named: bool = False
    """Whether engines were named: they are compared at wide states too, beyond ordinary ones."""
    claims_named: bool = False
    """Whether claims were named: each has a finding of the run, skipped where it does not apply."""

    @classmethod
    def of(
        cls,
        formulations: Iterable[str] | None = None,
        engines: Iterable[str | type[Engine]] | None = None,
        claims: Iterable[str] | None = None,
        *,
        scenes: Sequence[Scene | type[Scene]] = (Snake,),
        default: Iterable[str] | None = None,
    ) -> RunSelection:
        """Return the selection of these names; None stands for all that apply, [] for none.

        Engines that an extra installs take part if named. If no engines are named, the library of
        a robot's file takes part too, since both derivations come from one description.

        Args:
            formulations: keys of formulations.
            engines: keys, names or classes of engines.
            claims: ids of claims, at least one.
            scenes: scenes or scene classes, to which each formulation should apply.
            default: ids of the claims that None stands for, instead of all.

        Raises:
            InputError: a formulation applies to none of `scenes`, or `claims` names none.
            UnknownNameError: a name is not registered.
        """
        ids = tuple(claim.id for claim in CLAIMS.select(default if claims is None else claims))
        chosen, reader = engines_among(engines), None
        if engines is None and len(scenes) == 1 and (reader := default_reader(scenes[0])):
            chosen = (*chosen, reader)
        named_ones = engines is not None and bool(chosen)
        all_formulations = formulations_among(scenes, formulations)
        claims_named = claims is not None and CLAIMS.by_name(ids)
        return cls(all_formulations, chosen, ids, reader, named_ones, claims_named)

    def leaves_out(self, claim: Claim, number: int) -> bool:
        """Return whether a claim is left out in the state of this number (`Claim.every`).

        It is in no state if it is named, or is about engines and these are.
        """
        if self.claims_named or (claim.asks and self.engines_named):
            return False
        return number % claim.every > 0


class SceneEngines(NamedTuple):
    """A scene with its engines constructed, and the errors of those that could not be."""

    scene: Scene
    engines: tuple[Engine, ...]
    unavailable: dict[type[Engine], str]
    reader: FileEngine | None = None
    """The engine among them that reads the file of the scene because no engines were named."""
    failed_reader: tuple[type[FileEngine], str] | None = None
    """The library that failed to read the file, and its error."""


def make_scene_engines(scene: Scene, selection: RunSelection) -> SceneEngines:
    """Construct the engines of `selection` for a scene.

    Raises:
        InputError: a function of the scene returns an array of wrong shape.
    """
    check_shapes(scene)
    engines: list[Engine] = []
    broken: dict[type[Engine], str] = {}
    for kind in selection.engines:
        if kind is not selection.reader and represents(kind, scene):
            try:
                engines.append(make_engine(kind, scene))
            except EngineFault as fault:
                broken[kind] = fault.what
    reader = unread = None
    if selection.reader is not None and getattr(scene, "as_described", False):
        try:
            reader = selection.reader(scene)
            engines.append(reader)
        except Exception as error:  # any exception of a library that cannot read the file
            unread = selection.reader, message_of(error)
    return SceneEngines(scene, tuple(engines), broken, reader, unread)


def make_case(
    scene_engines: SceneEngines,
    state: State,
    selection: RunSelection,
    repeats: int = OFTEN,
    at: Evaluation | None = None,
) -> Case:
    """Return the case of a state of a scene whose engines are constructed.

    Args:
        scene_engines: the scene and its engines.
        state: (q, v, t).
        selection: formulations, engines and claims.
        repeats: number of repeated calls of engines under test for each answer.
        at: the evaluation at the state, if it was made already.
    """
    offers = scene_engines.scene.offers
    formulations = tuple(f for f in selection.formulations if offers(f.uses))
    at = Evaluation(scene_engines.scene, *state) if at is None else at
    return Case(
        at,
        formulations,
        scene_engines.engines,
        unavailable=scene_engines.unavailable,
        repeats=repeats,
    )


def make_case_with_engines(scene: Scene, state: State, selection: RunSelection) -> Case:
    """Return the case of a state of a scene, and construct its engines."""
    return make_case(make_scene_engines(scene, selection), state, selection)


# ---- Findings by the library of a robot's file ---------------------------------------------------

EITHER = "the file is read in two ways: either reading may be wrong"


def evaluate_claim(scene_engines: SceneEngines, case: Case, claim: Claim) -> list[Finding]:
    """Return the Findings of one claim; failures by the file's library blame neither side."""
    findings = [
        _blame_either_side(scene_engines, case, claim, finding) for finding in case.evaluate(claim)
    ]
    if scene_engines.failed_reader is not None and claim.asks == "mass_matrix":
        kind, why = scene_engines.failed_reader
        findings.append(skipped_finding(case, kind, f"takes no part: {why}"))
    return findings


def _blame_either_side(
    scene_engines: SceneEngines, case: Case, claim: Claim, finding: Finding
) -> Finding:
    """Return the Finding of a failure by the file's library, which blames neither side."""
    reader = scene_engines.reader
    if reader is None or finding.engine is not type(reader) or finding.verdict != "failed":
        return finding
    if reason := reader.leaves_out(claim.asks):
        skipped = skipped_finding(case, type(reader), reason)
        return replace(skipped, subject=finding.subject)
    return finding.because(EITHER)


# ---- Shrinking -----------------------------------------------------------------------------------

TRIES = 50
"""Number of random cases in the search for a smaller counterexample, shrinking not counted."""


def no_larger(scene: Scene, links: tuple[int, int]) -> SearchStrategy[tuple[Scene, State]]:
    """Return a strategy for scenes of the class of `scene` with at most as many links, in a state.

    Args:
        scene: the scene.
        links: smallest and largest number of links, for a class that has one.
    """
    most = max(links[0], min(links[1], link_count(scene) or links[1]))
    return strategies.scene_states(strategies.scenes(type(scene), links[0], most))


def states_of(scene: Scene) -> SearchStrategy[tuple[Scene, State]]:
    """Return a strategy for `scene` with each of its ordinary states."""
    return strategies.states(scene).map(lambda state: (scene, state))


def cause_of(one: Any) -> list[str]:
    """Return the words of a subject that identify a cause: formulations, or the engine alone.

    Args:
        one: a failed `Finding`, or a stored one.
    """
    words = one.subject.replace("~", " ").replace(":", " ").split()
    if one.claim in CLAIMS and CLAIMS[one.claim].asks:
        words = [word for word in words if word not in FORMULATIONS]
    return sorted(words)


def sides_of(one: Any) -> list[str]:
    """Return the sides of a subject such as "au ~ im", sorted."""
    return sorted(one.subject.split(" ~ "))


def diagnosis_of(one: Any) -> str:
    """Return the diagnosis in a detail, by which causes differ; "" if none or one with numbers."""
    diagnosis = _end_of_detail(one)
    return "" if any(c.isdigit() for c in diagnosis) else diagnosis


def _end_of_detail(one: Any) -> str:
    """Return the text behind the place in a detail: "wrong sign", "2.5, expected 2"; else ""."""
    end = one.detail.rpartition(": ")[2] if ": " in one.detail else ""
    return end.removesuffix(EVERY_ROW)  # every row that does not vanish in this state


NUMBER = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")


def is_same_failure(one: Finding, other: Finding) -> bool:
    """Return whether a finding fails as another does: claim, sides, and diagnosis but for numbers.

    A smaller state may show another mistake of the same claim; it is no smaller counterexample.
    """

    def kind(x: Finding) -> tuple[str, list[str], str]:
        return x.claim, sides_of(x), NUMBER.sub("#", _end_of_detail(x))

    return one.verdict == "failed" and kind(one) == kind(other)


class _Falsified(AssertionError):
    def __init__(self, finding: Finding):
        self.finding = finding
        super().__init__(str(finding))


def smallest_failure(
    failed: Finding,
    cases: SearchStrategy[tuple[Scene, State]],
    selection: RunSelection,
    seed: int,
    over: Callable[[], bool] = lambda: False,
) -> Finding:
    """Return the smallest counterexample among `cases` that fails as `failed` does, or itself.

    Args:
        failed: a failure.
        cases: strategy of the cases to search.
        selection: formulations, engines and claims.
        seed: seed of the search.
        over: whether the time is up, from when no case is checked.
    """

    def examine(drawn: tuple[Scene, State]) -> None:
        if over():
            return
        scene_engines = make_scene_engines(drawn[0], selection)
        case = make_case(scene_engines, drawn[1], selection, ONCE)
        for finding in evaluate_claim(scene_engines, case, CLAIMS[failed.claim]):
            if is_same_failure(finding, failed):
                raise _Falsified(finding)

    settings = hypothesis.settings(
        strategies.settings,
        max_examples=TRIES,
        database=None,
        derandomize=False,
        report_multiple_bugs=False,
        phases=(Phase.generate, Phase.shrink),
        verbosity=Verbosity.quiet,
    )
    try:
        hypothesis.seed(seed)(settings(hypothesis.given(cases)(examine)))()
    except _Falsified as falsified:
        return falsified.finding
    except Unsatisfiable:
        pass  # no position among them satisfies the loop closure
    return failed


# ---- Runs ----------------------------------------------------------------------------------------


class StateResult(NamedTuple):
    """The result of checking one state.

    Attributes:
        findings: in the order of the claims.
        seconds: time spent per claim.
        refused: keys of the formulations that refused the state.
    """

    findings: Sequence[Finding]
    seconds: dict[str, float]
    refused: tuple[str, ...]


def evaluate_state(
    scene_engines: SceneEngines,
    state: State,
    selection: RunSelection,
    repeats: int,
    at: Evaluation | None = None,
    number: int = 0,
) -> StateResult:
    """Check one state of a scene whose engines are constructed; for arguments see `make_case`.

    `number` counts the states of the run: some claims are checked in each k-th one (`Claim.every`).
    Terms that raise or are not finite are reported whichever claims are selected, and alone.
    """
    case = make_case(scene_engines, state, selection, repeats, at)
    seconds = dict.fromkeys(selection.claims, 0.0)
    if (broken := case.terms_failure) is not None:
        return StateResult([broken], seconds, ())
    findings: list[Finding] = []
    for claim in selection.claims if case.finite else ("finite-terms",):
        if selection.leaves_out(CLAIMS[claim], number):
            continue
        start = time.perf_counter()
        findings += evaluate_claim(scene_engines, case, CLAIMS[claim])
        seconds[claim] = time.perf_counter() - start
    return StateResult(findings, seconds, _refused_keys(case) if case.finite else ())


def repeats_at(number: int) -> int:
    """Return the number of repeated calls of engines under test: many at the first drawn case."""
    return ONCE if number else OFTEN


Cases = Iterable[tuple[Scene, State]]
StateResults = Generator[tuple[Scene, State, StateResult], None, None]
"""Cases in their order, each with its result."""


@dataclass
class ValidationRun:
    """A run of claims in progress, with its findings so far.

    Attributes:
        findings: every Finding, in order.
        seconds: time spent per claim, s.
        ends: number of findings after each state checked.
        sampled: the states drawn, each with the formulations that refused it.
        refused: keys of the formulations that refused the last state checked.
        minimal: the smallest counterexample, if a claim failed.
    """

    findings: list[Finding] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    ends: list[int] = field(default_factory=list)
    sampled: list[SampledState] = field(default_factory=list)
    refused: tuple[str, ...] = ()
    minimal: Finding | None = None
    _engines_for: SceneEngines | None = field(default=None, repr=False, compare=False)
    _reported: set[tuple[str, str, str]] = field(default_factory=set, repr=False, compare=False)

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_engines_for": None}  # engines cannot be pickled

    @property
    def cases(self) -> int:
        """Number of states checked."""
        return len(self.ends)

    @property
    def level_counts(self) -> dict[str, dict[str, int]]:
        """Number of drawn states by factor and level, see `pairwise_design.count_levels`."""
        return count_levels((sampled.scene, sampled.state) for sampled in self.sampled)

    def check_state(
        self, scene: Scene, state: State, selection: RunSelection, at: Evaluation | None = None
    ) -> list[Finding]:
        """Check one state, add its Findings to `findings` and return them; see `make_case`."""
        repeats = OFTEN if len(self.ends) < 2 else ONCE
        return self._add_result(self._evaluate_state(scene, state, selection, repeats, at))

    def _evaluate_state(
        self,
        scene: Scene,
        state: State,
        selection: RunSelection,
        repeats: int,
        at: Evaluation | None = None,
        number: int = 0,
    ) -> StateResult:
        """Evaluate all claims at one state; engines are constructed once per scene."""
        if self._engines_for is None or self._engines_for.scene is not scene:
            # Once for each scene.
            self._engines_for = make_scene_engines(scene, selection)
        return evaluate_state(self._engines_for, state, selection, repeats, at, number)

    def _evaluate_serially(self, cases: Cases, selection: RunSelection) -> StateResults:
        """Yield the results of cases that are computed in this process."""
        for i, (scene, state) in enumerate(cases):
            result = self._evaluate_state(scene, state, selection, repeats_at(i), number=i)
            yield scene, state, result

    def _add_result(self, result: StateResult) -> list[Finding]:
        """Add the result of one state to the run, and return its new Findings."""
        new = list(filter(self._is_new, result.findings))
        for claim, seconds in result.seconds.items():
            self.seconds[claim] += seconds
        self.findings += new
        self.ends.append(len(self.findings))
        self.refused = result.refused
        return new

    def _is_new(self, finding: Finding) -> bool:
        """Return False for a skipped finding that was reported at an earlier state already."""
        lacks = bool(CLAIMS[finding.claim].asks) or finding.detail.startswith("not rational")
        if finding.verdict != "skipped" or not lacks:
            return True
        key = finding.claim, finding.subject, finding.detail
        new = key not in self._reported
        self._reported.add(key)
        return new

    def explore(
        self,
        cases: Cases,
        selection: RunSelection,
        on_case: Callable[[], None] = lambda: None,
        shrink_among: Callable[[Scene], SearchStrategy[tuple[Scene, State]]] | None = None,
        seed: int = 0,
        runner: Callable[[Cases, RunSelection], StateResults] | None = None,
    ) -> None:
        """Check cases; stop at the first failure and shrink it.

        Args:
            cases: drawn cases.
            selection: formulations, engines and claims.
            on_case: called after each case.
            shrink_among: returns the strategy to search for a smaller counterexample, from the
                scene that fails; None leaves the failure as it is.
            seed: seed of that search.
            runner: yields the results of the cases, by default computed in this process.
        """
        with closing((runner or self._evaluate_serially)(cases, selection)) as results:
            for scene, state, result in results:
                new = self._add_result(result)
                state = (new[0].state if new else None) or state
                self.sampled.append(SampledState(scene, state, self.refused))
                on_case()
                self.minimal = next((x for x in new if x.verdict == "failed"), None)
                if self.minimal is not None:
                    break
        if self.minimal is not None and shrink_among is not None:
            self.minimal = smallest_failure(
                self.minimal, shrink_among(self.minimal.scene), selection, seed
            )

    def validate_kind(
        self,
        kind: type[Scene],
        selection: RunSelection,
        links: tuple[int, int],
        examples: int,
        seed: int,
        on_case: Callable[[], None] = lambda: None,
        runner: Callable[[Cases, RunSelection], StateResults] | None = None,
    ) -> None:
        """Check random scenes of a class, and its example in the initial and in a moving state.

        Args:
            kind: the scene class.
            selection: formulations, engines and claims.
            links: smallest and largest number of links, for a class that has one.
            examples: number of random scenes, each in one state.
            seed: seed of the draws.
            on_case: called after each case.
            runner: yields the results of the random cases, by default computed in this process.

        Raises:
            InputError: see `eomcheck.draws.pairwise_design.scene_cases`.
        """
        example = kind.example()
        self.check_state(example, State(*example.initial_state()), selection)
        on_case()
        drawn = chain(state_cases(example, 1, seed), scene_cases(kind, links, examples, seed))
        drawn = with_wide(drawn, seed) if selection.engines_named else drawn
        with self._failing(example):
            self.explore(drawn, selection, on_case, partial(no_larger, links=links), seed, runner)

    def validate_scene(
        self,
        scene: Scene,
        selection: RunSelection,
        examples: int,
        seed: int,
        on_case: Callable[[], None] = lambda: None,
        runner: Callable[[Cases, RunSelection], StateResults] | None = None,
    ) -> None:
        """Check a scene in its initial state and in random states.

        Args:
            scene: the scene.
            selection: formulations, engines and claims.
            examples: number of random states.
            seed: seed of the draws.
            on_case: called after each case.
            runner: yields the results of the random cases, by default computed in this process.

        Raises:
            InputError: see `eomcheck.draws.pairwise_design.state_cases`.
        """
        drawn = state_cases(scene, examples, seed)
        drawn = with_wide(drawn, seed) if selection.engines_named else drawn
        self.check_state(scene, State(*scene.initial_state()), selection)
        on_case()
        with self._failing(scene):
            self.explore(drawn, selection, on_case, states_of, seed, runner)

    @contextmanager
    def _failing(self, scene: Scene) -> Iterator[None]:
        """End the draws if a user-supplied scene function raises after a failure was reported."""
        try:
            yield
        except Exception as error:
            failed = any(finding.verdict == "failed" for finding in self.findings)
            if (
                isinstance(error, EomcheckError)
                or not failed
                or not scene_function_that_raised(scene, error)
            ):
                raise

    def finish(self, selection: RunSelection) -> list[Finding]:
        """Add the Findings about the run as a whole, and return every Finding."""
        if self.minimal is None:  # a run that ends at a failure has not checked all states
            proofs: dict[tuple, list[Finding]] = {}
            for claim, unresolved in unresolved_by_claim(self.findings).items():
                exact, unproved = prove_unresolved(CLAIMS[claim], unresolved, proofs)
                self.findings += [*exact, *([unresolved_finding(unproved)] if unproved else ())]
        if "coverage" in selection.claims and self.sampled:
            self.findings.append(coverage(self.sampled))
        if self.minimal is not None:
            self.findings.append(self.minimal)
        self.findings += self.inapplicable(selection)
        return self.findings

    def inapplicable(self, selection: RunSelection) -> list[Finding]:
        """Return a skipped Finding of each claim that was named and has none, with its reason.

        None after a failure, which may have kept other claims from being checked.
        """
        if not selection.claims_named or self._engines_for is None:
            return []
        if any(finding.verdict == "failed" for finding in self.findings):
            return []
        scene, checked = self._engines_for.scene, {finding.claim for finding in self.findings}
        return [
            skipped_everywhere(claim, "all", scene, f"needs {CLAIMS[claim].requirements}")
            for claim in selection.claims
            if claim not in checked
        ]


def _refused_keys(case: Case) -> tuple[str, ...]:
    """Return the keys of the formulations that refuse the state.

    Empty if a user-supplied scene function raises: its error is one of the Findings.
    """
    try:
        return case.refused
    except Exception as error:
        if not _is_scene_error(case.at.scene, case.state, error):
            raise
        return ()


def _is_scene_error(scene: Scene, state: State, error: Exception) -> bool:
    """Return whether a user-supplied scene function raised an error, or its result led to it."""
    return bool(scene_function_that_raised(scene, error) or failing_function(scene, state))


def check_state(
    scene: Scene,
    q,
    v,
    t: float = 0.0,
    *,
    formulations: Iterable[str] | None = None,
    engines: Iterable[str | type[Engine]] | None = None,
    claims: Iterable[str] | None = None,
    consistent: bool = True,
) -> Findings:
    """Check the claims in one state of a scene.

    Args:
        scene: the scene.
        q: coordinates (n,).
        v: velocities (n,), consistent with the constraints.
        t: time, s.
        formulations: keys of the formulations to check, by default all that apply.
        engines: keys, names or classes of the engines to compare with, see
            `eomcheck.engines.engine_of`; by default those of `engines.ALWAYS`.
        claims: ids of the claims to check, all by default.
        consistent: reject a v that violates the constraints. With False claims fail that hold for
            consistent velocities only, but a scene whose constraint Jacobian a is wrong can be
            checked.

    Returns:
        Every Finding, in the order of the claims, then a skipped one of each claim in `claims` that
        does not apply.

    Raises:
        InputError: wrong shapes, also of arrays that the scene's functions return, or values that
            are not finite.
        InconsistentVelocityError: v violates the constraints.
        UnknownNameError: an unknown key or id.
        EngineError: an engine is not installed.
    """
    at = Evaluation(scene, q, v, t)
    selection = RunSelection.of(formulations, engines, claims, scenes=[scene])
    state = State(at.q, at.v, t)
    check_shapes(scene)
    try:
        if consistent:
            check_consistent(at, CONSISTENT_HINT)
    except EomcheckError:
        raise
    except Exception as error:
        if not _is_scene_error(scene, state, error):  # else it is one of the Findings
            raise
    run = ValidationRun()
    checked = run.check_state(scene, state, selection, at)
    return Findings([*checked, *run.inapplicable(selection)])


def validate(
    scene: Scene,
    *,
    examples: int = 25,
    seed: int = 0,
    formulations: Iterable[str] | None = None,
    engines: Iterable[str | type[Engine]] | None = None,
    claims: Iterable[str] | None = None,
) -> Findings:
    """Check a scene in its initial state and in random consistent states.

    Args:
        scene: the scene.
        examples: number of random states.
        seed: seed of the draws.
        formulations: keys of the formulations to check, by default all that apply.
        engines: keys, names or classes of the engines to compare with, see
            `eomcheck.engines.engine_of`; by default those of `engines.ALWAYS`.
        claims: ids of the claims to check, all by default.

    Returns:
        Every Finding. If a claim fails, the draws stop and the last Finding is the smallest
        counterexample.

    Raises:
        InputError: `examples` is less than 1, or a function of the scene returns an array of wrong
            shape.
        UnknownNameError: an unknown key or id.
        EngineError: an engine is not installed.
    """
    selection = RunSelection.of(formulations, engines, claims, scenes=[checked_scene(scene)])
    run = ValidationRun()
    run.validate_scene(scene, selection, examples, seed)
    return Findings(run.finish(selection))


def check_decided(findings: Iterable[Finding]) -> None:
    """Raise InputError if no claim was decided: a run that checks nothing is no pass."""
    findings = list(findings)
    if any(finding.verdict in DECIDED for finding in findings):
        return
    first = next((one for one in findings if one.detail), None)
    reason = "" if first is None else f": {first.claim} is {first.verdict}: {first.detail}"
    raise InputError(f"no claim could be decided{reason}")


def check_compared(engines: Sequence[type[Engine]], findings: Iterable[Finding]) -> None:
    """Raise InputError if some engine was compared with nothing, which would be no pass."""
    decided = {
        word
        for finding in findings
        if finding.verdict in DECIDED and CLAIMS[finding.claim].asks
        for word in finding.subject.split(" ~ ")
    }
    for kind in engines:
        if kind.key not in decided:
            raise InputError(f"engine {kind.key}: nothing could be compared with it")

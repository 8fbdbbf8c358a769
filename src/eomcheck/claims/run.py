"""A run of the claims: on one state, on random states of a scene, on random scenes.

A `RunSelection` says which formulations, engines and claims take part; `SceneEngines` is a scene
with the engines made for it. Cases are drawn by pairwise design. When a claim fails, hypothesis
shrinks it: the last Finding is then the smallest case found on which that same claim fails.

Both derivations of a robot are made of one description, so that no claim sees a misread file. The
library of the file takes part by default, and is a second reader, not one that is always right: a
difference is a failure of which either reading may be the cause, and quantities that the library
leaves out are skipped with the reason.
"""

from __future__ import annotations

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
from eomcheck.claims.finding import DECIDED, Finding, unresolved_by_claim, unresolved_finding
from eomcheck.claims.numerical_accuracy import SampledState, coverage
from eomcheck.claims.pairwise_design import (
    count_levels,
    link_count,
    scene_cases,
    state_cases,
    with_wide,
)
from eomcheck.claims.proof import prove_unresolved
from eomcheck.claims.registry import Claim
from eomcheck.claims.user_scenes import check_shapes, failing_function, scene_function_that_raised
from eomcheck.engines import Engine, EngineFault, engines_among, make_engine, represents
from eomcheck.engines.files import FileEngine, default_reader
from eomcheck.errors import EomcheckError, InputError, at_least_one, message_of, registered
from eomcheck.evaluation.dynamics import CONSISTENT_HINT, check_consistent
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import Formulation, formulations_among
from eomcheck.mechanics.scene import Scene, checked_scene
from eomcheck.scenes import Snake

# ---- Selection -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class RunSelection:
    """What takes part in a run: all that is installed in any case, unless named."""

    formulations: tuple[Formulation, ...]
    engines: tuple[type[Engine], ...]
    claims: tuple[str, ...]
    reader: type[FileEngine] | None = None
    """The library among `engines` that reads a robot's file itself, where none were named."""
    engines_named: bool = False
    """Whether engines were named: they are asked at states beyond the ordinary ones too."""

    @classmethod
    def of(
        cls,
        formulations: Iterable[str] | None = None,
        engines: Iterable[str | type[Engine]] | None = None,
        claims: Iterable[str] | None = None,
        *,
        scenes: Sequence[Scene | type[Scene]] = (Snake,),
    ) -> RunSelection:
        """Look the names up; None stands for all that apply to any scene, an empty list for none.

        Engines that an extra installs take part when named; without names the library of a robot's
        file does too, for which both derivations are made of one description.

        Raises:
            InputError: a formulation applies to none of `scenes`, or `claims` names none.
            UnknownNameError: a name is not registered.
        """
        ids = tuple(CLAIMS if claims is None else at_least_one("claims", claims))
        for one in ids:
            registered("claim", one, CLAIMS)
        chosen, reader = engines_among(engines), None
        if engines is None and len(scenes) == 1 and (reader := default_reader(scenes[0])):
            chosen = (*chosen, reader)
        named_ones = engines is not None and bool(chosen)
        return cls(formulations_among(scenes, formulations), chosen, ids, reader, named_ones)


class SceneEngines(NamedTuple):
    """A scene, the engines made for it, and those that could not be made."""

    scene: Scene
    engines: tuple[Engine, ...]
    unavailable: dict[type[Engine], str]
    reader: FileEngine | None = None
    """The one among them that reads the file of the scene because none were named."""
    failed_reader: tuple[type[FileEngine], str] | None = None
    """The library that should and cannot, and why."""


def make_scene_engines(scene: Scene, selection: RunSelection) -> SceneEngines:
    """Return a scene with the engines of `selection` made for it.

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
        except Exception as error:  # whatever a library makes of a file it cannot read
            unread = selection.reader, message_of(error)
    return SceneEngines(scene, tuple(engines), broken, reader, unread)


def make_case(
    asked: SceneEngines, state: State, selection: RunSelection, repeats: int = OFTEN
) -> Case:
    """Case of a state, for the claims about a scene whose engines are made.

    Args:
        asked: the scene and its engines.
        state: (q, v, t).
        selection: what takes part.
        repeats: how often engines on trial are asked again for each answer.
    """
    formulations = tuple(f for f in selection.formulations if f.applies_to(asked.scene))
    evaluation = Evaluation(asked.scene, *state)
    return Case(
        evaluation, formulations, asked.engines, unavailable=asked.unavailable, repeats=repeats
    )


def make_case_with_engines(scene: Scene, state: State, selection: RunSelection) -> Case:
    """Return what claims look at in a state; engines are made for it."""
    return make_case(make_scene_engines(scene, selection), state, selection)


# ---- Findings by the library of a robot's file ---------------------------------------------------

EITHER = "the file is read in two ways: either reading may be wrong"


def evaluate_claim(asked: SceneEngines, case: Case, claim: Claim) -> list[Finding]:
    """Return the Findings of one claim; those by the file's library name no one to blame."""
    findings = [_neutral(asked, case, claim, one) for one in case.evaluate(claim)]
    if asked.failed_reader is not None and claim.asks == "mass_matrix":
        kind, why = asked.failed_reader
        findings.append(skipped_finding(case, kind, f"takes no part: {why}"))
    return findings


def _neutral(asked: SceneEngines, case: Case, claim: Claim, finding: Finding) -> Finding:
    reader = asked.reader
    if reader is None or finding.engine is not type(reader) or finding.verdict != "failed":
        return finding
    if reason := reader.leaves_out(claim.asks):
        skipped = skipped_finding(case, type(reader), reason)
        return replace(skipped, subject=finding.subject)
    return finding.because(EITHER)


# ---- Shrinking -----------------------------------------------------------------------------------

TRIES = 50
"""Cases looked at in search of a smaller one that fails, those met while shrinking not counted."""


def no_larger(scene: Scene, links: tuple[int, int]) -> SearchStrategy[tuple[Scene, State]]:
    """Return a strategy for scenes of the kind of `scene`, with at most as many links, in a state.

    Args:
        scene: the scene.
        links: smallest and largest number of links, for a kind that has one.
    """
    most = max(links[0], min(links[1], link_count(scene) or links[1]))
    return strategies.scene_states(strategies.scenes(type(scene), links[0], most))


def states_of(scene: Scene) -> SearchStrategy[tuple[Scene, State]]:
    """Return a strategy for `scene` with each of its ordinary states."""
    return strategies.states(scene).map(lambda state: (scene, state))


class _Falsified(AssertionError):
    def __init__(self, finding: Finding):
        self.finding = finding
        super().__init__(str(finding))


def smallest_failure(
    failed: Finding,
    cases: SearchStrategy[tuple[Scene, State]],
    selection: RunSelection,
    seed: int,
) -> Finding:
    """Return the smallest failure of the same claim among `cases`, or the one there is.

    Args:
        failed: a failure.
        cases: among which a smaller one is looked for.
        selection: what takes part.
        seed: of the search.
    """

    def examine(drawn: tuple[Scene, State]) -> None:
        asked = make_scene_engines(drawn[0], selection)
        case = make_case(asked, drawn[1], selection, ONCE)
        for finding in evaluate_claim(asked, case, CLAIMS[failed.claim]):
            if finding.verdict == "failed":
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
        pass  # none of them could be closed
    return failed


# ---- Runs ----------------------------------------------------------------------------------------


class StateResult(NamedTuple):
    """What looking at one state gave.

    Attributes:
        findings: in the order of the claims.
        seconds: time spent per claim.
        refused: keys of the formulations that refused the state.
    """

    findings: Sequence[Finding]
    seconds: dict[str, float]
    refused: tuple[str, ...]


def evaluate_state(
    asked: SceneEngines, state: State, selection: RunSelection, repeats: int
) -> StateResult:
    """Look at one state of a scene whose engines are made; for arguments see `make_case`."""
    case = make_case(asked, state, selection, repeats)
    broken = case.terms_failure
    findings = [] if broken is None else [broken]
    seconds: dict[str, float] = {}
    for one in selection.claims:
        start = time.perf_counter()
        if broken is None and (case.finite or one == "finite-terms"):
            findings += evaluate_claim(asked, case, CLAIMS[one])
        seconds[one] = time.perf_counter() - start
    return StateResult(findings, seconds, _refused(case) if broken is None and case.finite else ())


def repeats_at(number: int) -> int:
    """Return how often engines on trial are asked again at a drawn case: often at the first."""
    return ONCE if number else OFTEN


Cases = Iterable[tuple[Scene, State]]
StateResults = Generator[tuple[Scene, State, StateResult], None, None]
"""Cases in their order, each with what was seen in it."""


@dataclass
class ValidationRun:
    """What a run has come to so far.

    Attributes:
        findings: every Finding, in the order made.
        seconds: time spent per claim.
        ends: number of findings there were after each state looked at.
        sampled: the states drawn, and who refused them.
        refused: keys of the formulations that refused the last state looked at.
        minimal: the smallest failing case, if a claim failed.
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
        return vars(self) | {
            "_engines_for": None
        }  # engines hold what no process can hand to another

    @property
    def cases(self) -> int:
        """Number of states looked at."""
        return len(self.ends)

    @property
    def level_counts(self) -> dict[str, dict[str, int]]:
        """Number of drawn states by stratum, see `eomcheck.claims.pairwise_design.count_levels`."""
        return count_levels((one.scene, one.state) for one in self.sampled)

    def check_state(self, scene: Scene, state: State, selection: RunSelection) -> list[Finding]:
        """Look at one state, add the Findings to `findings` and return them."""
        return self._add_result(
            self._evaluate_state(scene, state, selection, OFTEN if len(self.ends) < 2 else ONCE)
        )

    def _evaluate_state(
        self, scene: Scene, state: State, selection: RunSelection, asked_again: int
    ) -> StateResult:
        if self._engines_for is None or self._engines_for.scene is not scene:
            self._engines_for = make_scene_engines(
                scene, selection
            )  # engines are made once for each scene
        return evaluate_state(self._engines_for, state, selection, asked_again)

    def _one_after_another(self, cases: Cases, selection: RunSelection) -> StateResults:
        for i, (scene, state) in enumerate(cases):
            yield scene, state, self._evaluate_state(scene, state, selection, repeats_at(i))

    def _add_result(self, seen: StateResult) -> list[Finding]:
        new = list(filter(self._is_new, seen.findings))
        for claim, seconds in seen.seconds.items():
            self.seconds[claim] += seconds
        self.findings += new
        self.ends.append(len(self.findings))
        self.refused = seen.refused
        return new

    def _is_new(self, finding: Finding) -> bool:
        """Return False of what cannot be told, where that was said in an earlier state."""
        lacks = bool(CLAIMS[finding.claim].asks) or finding.detail.startswith("not rational")
        if finding.verdict != "skipped" or not lacks:
            return True
        said = finding.claim, finding.subject, finding.detail
        new = said not in self._reported
        self._reported.add(said)
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
        """Look at cases; stop at the first failure and look for the smallest.

        Args:
            cases: drawn cases.
            selection: what takes part.
            on_case: called after each case.
            shrink_among: the cases among which a smaller one is looked for, given a scene that
                fails.
            seed: of that search.
            runner: who looks at the cases, by default this process.
        """
        with closing((runner or self._one_after_another)(cases, selection)) as looked:
            for scene, state, seen in looked:
                new = self._add_result(seen)
                state = (new[0].state if new else None) or state
                self.sampled.append(SampledState(scene, state, self.refused))
                on_case()
                self.minimal = next((one for one in new if one.verdict == "failed"), None)
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
        """Look at the example of a kind, as it begins and moving, and at `examples` random scenes.

        Args:
            kind: the kind of scene.
            selection: what takes part.
            links: smallest and largest number of links, for a kind that has one.
            examples: number of random scenes, each in one state.
            seed: of the draws.
            on_case: called after each case.
            runner: who looks at the random cases, by default this process.

        Raises:
            InputError: see `eomcheck.claims.pairwise_design.scene_cases`.
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
        """Look at a scene as it begins, and in random states.

        Args:
            scene: the scene.
            selection: what takes part.
            examples: number of random states.
            seed: of the draws.
            on_case: called after each case.
            runner: who looks at the random cases, by default this process.

        Raises:
            InputError: see `eomcheck.claims.pairwise_design.state_cases`.
        """
        drawn = state_cases(scene, examples, seed)
        drawn = with_wide(drawn, seed) if selection.engines_named else drawn
        self.check_state(scene, State(*scene.initial_state()), selection)
        on_case()
        with self._failing(scene):
            self.explore(drawn, selection, on_case, states_of, seed, runner)

    @contextmanager
    def _failing(self, scene: Scene) -> Iterator[None]:
        """End the drawing where a function of the scene's own raises, if a failure says so."""
        try:
            yield
        except Exception as error:
            failed = any(one.verdict == "failed" for one in self.findings)
            if (
                isinstance(error, EomcheckError)
                or not failed
                or not scene_function_that_raised(scene, error)
            ):
                raise

    def finish(self, selection: RunSelection) -> list[Finding]:
        """Add what can be said of the run as a whole, and return every Finding."""
        if self.minimal is None:  # a run that ends at a failure says nothing of all states
            proofs: dict[tuple, list[Finding]] = {}
            for claim, left in unresolved_by_claim(self.findings).items():
                exact, rest = prove_unresolved(CLAIMS[claim], left, proofs)
                self.findings += [*exact, *([unresolved_finding(rest)] if rest else ())]
        if "coverage" in selection.claims and self.sampled:
            self.findings.append(coverage(self.sampled))
        if self.minimal is not None:
            self.findings.append(self.minimal)
        return self.findings


def _refused(case: Case) -> tuple[str, ...]:
    """Return the keys of the formulations that refuse the state.

    None where a function of the scene's own raises: that is one of the Findings.
    """
    try:
        return case.refused
    except Exception as error:
        if not _is_of(case.at.scene, case.state, error):
            raise
        return ()


def _is_of(scene: Scene, state: State, error: Exception) -> bool:
    """Whether a function of the scene's own raised an error, or returned what leads to it."""
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
) -> list[Finding]:
    """Check one state of a scene and return every Finding.

    Args:
        scene: the scene.
        q: coordinates (n,).
        v: velocities (n,), consistent with the constraints.
        t: time, s.
        formulations: keys of the formulations to look at, by default all that apply.
        engines: keys, names or classes of the engines to compare with, see
            `eomcheck.engines.engine_of`; by default those of `engines.ALWAYS`.
        claims: ids of the claims to look at, all by default.
        consistent: refuse a v that violates the constraints. With False claims fail that hold for
            consistent velocities only, but a scene whose own a is wrong can be looked at.

    Raises:
        InputError: bad shapes, also of what the scene's functions return, or values that are not
            finite.
        InconsistentVelocityError: v violates the constraints.
        UnknownNameError: an unknown key or id.
        EngineError: an engine is not installed.
    """
    selection = RunSelection.of(formulations, engines, claims, scenes=[checked_scene(scene)])
    state = State(*scene.check_state(q, v, t), t)
    check_shapes(scene)
    try:
        if consistent:
            check_consistent(Evaluation(scene, *state), CONSISTENT_HINT)
    except EomcheckError:
        raise
    except Exception as error:
        if not _is_of(scene, state, error):  # else it is one of the Findings
            raise
    return ValidationRun().check_state(scene, state, selection)


def validate(
    scene: Scene,
    *,
    examples: int = 25,
    seed: int = 0,
    formulations: Iterable[str] | None = None,
    engines: Iterable[str | type[Engine]] | None = None,
    claims: Iterable[str] | None = None,
) -> list[Finding]:
    """Check a scene in its initial state and in random consistent states.

    Args:
        scene: the scene.
        examples: number of random states.
        seed: of the draws.
        formulations: keys of the formulations to look at, by default all that apply.
        engines: keys, names or classes of the engines to compare with, see
            `eomcheck.engines.engine_of`; by default those of `engines.ALWAYS`.
        claims: ids of the claims to look at, all by default.

    Returns:
        Every Finding. If a claim fails, the drawing stops and the last Finding is the smallest
        failing case.

    Raises:
        InputError: `examples` is less than 1, or a function of the scene returns an array of wrong
            shape.
        UnknownNameError: an unknown key or id.
        EngineError: an engine is not installed.
    """
    selection = RunSelection.of(formulations, engines, claims, scenes=[checked_scene(scene)])
    run = ValidationRun()
    run.validate_scene(scene, selection, examples, seed)
    return run.finish(selection)


def check_compared(engines: Sequence[type[Engine]], findings: Iterable[Finding]) -> None:
    """Raise InputError if an engine was compared with nothing: that is no pass."""
    decided = {
        word
        for finding in findings
        if finding.verdict in DECIDED and CLAIMS[finding.claim].asks
        for word in finding.subject.split(" ~ ")
    }
    for kind in engines:
        if kind.key not in decided:
            raise InputError(f"engine {kind.key}: nothing could be compared with it")

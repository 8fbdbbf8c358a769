"""`parametrize_with_claims`: a pytest test for each claim about an engine, a scene or functions.

A target (`ClaimTarget`) is the code under test: an engine or a scene, checked at many states, or
user-supplied functions. All claims of a target are evaluated together when the first of its tests
runs, once for all processes of pytest-xdist: the first process computes, the others read its result
from a cache. The file of expected failures has one line per test: its id, as in the brackets of the
test, and then the reason.
"""

from __future__ import annotations

import json
import sqlite3
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from hashlib import sha256
from inspect import getsourcefile, unwrap
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, TypeVar

from eomcheck.atomic_write import read_text
from eomcheck.claims import CLAIMS, Finding, State
from eomcheck.claims.engine_quantities import CONFORMANCE
from eomcheck.claims.finding import Verdict, is_unresolved_detail, worst
from eomcheck.claims.run import (
    RunSelection,
    ValidationRun,
    check_compared,
    no_larger,
    smallest_failure,
    states_of,
)
from eomcheck.draws.pairwise_design import scene_cases, state_cases, with_wide
from eomcheck.engines import Engine, engine_of, represents
from eomcheck.engines.answers import represents_some
from eomcheck.errors import EomcheckError, InputError, required, whole_number
from eomcheck.mechanics.scene import Scene
from eomcheck.scene_lookup import scene_classes_named
from eomcheck.scenes import SCENES
from eomcheck.testing.equations_of_motion import EquationsOfMotion
from eomcheck.testing.function_checks import FUNCTION_CLAIMS, check

# ---- File of expected failures -------------------------------------------------------------------


def read_expected_failures(path: Path) -> dict[str, str]:
    """Read a file of expected failures.

    A line holds an id, white space and the reason. Empty lines and those that begin with "#" are
    ignored.

    Returns:
        id -> reason, in the order of the file.

    Raises:
        InputError: there is no such file, it is not text, a line has no reason, or an id is there
            twice.
    """
    try:
        lines = read_text(path).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"expected_failures = {str(path)!r} cannot be read: {error}") from None
    reasons: dict[str, str] = {}
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        id, *reason = line.split(maxsplit=1)
        where = f"{str(path)!r}, line {number}"
        if not reason:
            raise InputError(f"{where}: {id!r} has no reason, expected an id and a reason")
        if id in reasons:
            raise InputError(f"{where}: {id!r} is there twice")
        reasons[id] = reason[0].rstrip()
    return reasons


# ---- Cache shared by processes -------------------------------------------------------------------

WAIT_SECONDS = 3600.0
"""Longest time, s, that a process waits for another that computes the same result."""


def compute_once(folder: Path | None, name: str, work: Callable[[], Any]) -> Any:
    """Return the result of `work()`, computed once by all processes that share `folder`.

    SQLite is the lock, one file a work, for `atomic_write.locked` locks whole folders, and on some
    systems nothing. It is released with the process that holds it, however that ends. Where `work`
    raises, nothing is stored, and the next process tries again.

    Args:
        folder: folder of the cache, None where nothing is shared.
        name: name of the work, the key of the cache.
        work: function that returns JSON data.
    """
    if folder is None:
        return work()
    path = folder / f"eomcheck-{sha256(name.encode()).hexdigest()[:32]}.sqlite"
    with closing(sqlite3.connect(path, timeout=WAIT_SECONDS, isolation_level=None)) as database:
        database.execute("BEGIN EXCLUSIVE")
        database.execute("CREATE TABLE IF NOT EXISTS done (result TEXT)")
        stored = database.execute("SELECT result FROM done").fetchone()
        if stored is not None:
            return json.loads(stored[0])
        result = work()
        database.execute("INSERT INTO done VALUES (?)", (json.dumps(result),))
        database.execute("COMMIT")
        return result


# ---- Results of claims ---------------------------------------------------------------------------

LINKS = 1, 5
"""Least and largest number of links of random scenes: larger ones take longer and show less."""


class ClaimResult(NamedTuple):
    """Result of a claim over all states that were checked.

    Attributes:
        verdict: "failed" if it failed once, otherwise "passed" if it passed once, and so on.
        text: message for the terminal, "" where it passed.
    """

    verdict: Verdict
    text: str = ""


def claim_results(
    claims: Iterable[str],
    findings: Iterable[Finding],
    expected_to_fail: Collection[str],
    smallest: Callable[[Finding], Finding] = lambda failed: failed,
) -> dict[str, ClaimResult]:
    """Return the result of each claim from its Findings.

    Args:
        claims: ids, in the order in which a failure is closest to its cause.
        findings: Findings of all claims. One that follows from another is reported without code,
            which the other one has, unless that is expected to fail.
        expected_to_fail: ids of the claims that are expected to fail.
        smallest: function that returns the smallest failure like the one it is called with. It is
            called once, for the first failure that is not expected: later ones are mostly due to
            that one.

    Returns:
        id of a claim -> its result, for claims with Findings.
    """
    by_claim: dict[str, list[Finding]] = {}
    for finding in findings:
        by_claim.setdefault(finding.claim, []).append(finding)
    results: dict[str, ClaimResult] = {}
    for claim in filter(by_claim.__contains__, claims):
        worst = result_or_failure(by_claim[claim])
        if isinstance(worst, Finding):
            if claim not in expected_to_fail:
                worst, smallest = smallest(worst), lambda failed: failed
            folded = worst.follows and worst.follows not in expected_to_fail
            worst = _folded_result(worst) if folded else _failure_result(worst, by_claim[claim])
        results[claim] = worst
    return results


def result_or_failure(findings: list[Finding]) -> ClaimResult | Finding:
    """Return the first failure among the Findings of one claim, or else the result of the claim."""
    chosen = worst(findings, first=True)
    if chosen.verdict == "failed":
        return chosen
    texts = {"passed": "", "skipped": f"{chosen.subject}: {chosen.detail}"}
    return ClaimResult(chosen.verdict, texts.get(chosen.verdict, str(chosen)))


def _folded_result(shown: Finding) -> ClaimResult:
    """Return the result of a failure that follows from another, without code to reproduce it."""
    why = f"follows from {shown.cause}, see {shown.follows}"
    return ClaimResult("failed", f"{why}\n{replace(shown, follows='')}")


def without_unresolved(
    results: dict[str, ClaimResult], hidden: Iterable[Finding]
) -> dict[str, ClaimResult]:
    """Return the results, inconclusive in place of passed where an entry is resolved in no state.

    Args:
        results: id of a claim -> its result.
        hidden: inconclusive Findings that hold for all states.

    Returns:
        id of a claim -> its result.
    """
    listed = {finding.claim: str(finding) for finding in hidden}
    return {
        claim: ClaimResult("inconclusive", listed[claim])
        if claim in listed and result.verdict == "passed"
        else result
        for claim, result in results.items()
    }


def _failure_result(shown: Finding, findings: list[Finding]) -> ClaimResult:
    """Return the result of a failure: its text, how often it failed, and code to reproduce it."""
    failures = sum(finding.verdict == "failed" for finding in findings)
    count = f"failed in {failures} of {len(findings)} comparisons; " if len(findings) > 1 else ""
    return ClaimResult("failed", f"{shown}\n{count}to see it again:\n\n{shown.as_python()}")


# ---- Engines and scenes --------------------------------------------------------------------------


def engine_claims(engine: type[Engine]) -> tuple[str, ...]:
    """Return the ids of the claims about an engine: its terms, and further quantities it offers."""
    about_engines = (claim for claim in CLAIMS.values() if claim.asks)
    return tuple(x.id for x in about_engines if x.id not in CONFORMANCE or engine.offers(x.asks))


@dataclass(frozen=True)
class SceneTarget:
    """An engine under test on a scene, or the scene itself under test.

    Attributes:
        where: name of the scene.
        scene: the scene, or a scene class of which random scenes are drawn.
        engine: the engine, None where the scene is under test.
    """

    where: str
    scene: Scene | type[Scene]
    engine: type[Engine] | None

    @property
    def claims(self) -> tuple[str, ...]:
        """Ids of the claims about engines, or of all claims that are about a state."""
        if self.engine is not None:
            return engine_claims(self.engine)
        return tuple(id for id, claim in CLAIMS.items() if id != "coverage")

    @property
    def example(self) -> Scene:
        """Scene itself, or the example of the scene class."""
        return self.scene.example() if isinstance(self.scene, type) else self.scene

    @property
    def represented(self) -> bool:
        """Whether the engine represents the scene, or some of the class; True without engine."""
        if self.engine is None:
            return True
        if isinstance(self.scene, type):
            return represents_some(self.engine, self.scene)
        return represents(self.engine, self.scene)

    def results(
        self, examples: int, seed: int, expected_to_fail: Collection[str] = ()
    ) -> dict[str, ClaimResult]:
        """Return the result of each claim; a claim that is missing does not apply.

        Args:
            examples: number of random states.
            seed: seed of the random states.
            known: ids of the claims that are expected to fail.

        Returns:
            id of a claim -> its result.
        """
        if not self.represented:
            return {}
        kind = type(self.example)
        engines = None if self.engine is None else [self.engine]
        # By default, not by name: `absent` gives the reason where a claim does not apply.
        selection = RunSelection.of(None, engines, scenes=[kind], default=self.claims)
        run = ValidationRun()
        cases = self._drawn_cases(examples, seed)
        for scene, state in with_wide(cases, seed) if selection.engines_named else cases:
            run.check_state(scene, state, selection)
        findings = run.finish(selection)
        if self.engine is not None:
            check_compared([self.engine], findings)
        links = partial(no_larger, links=LINKS) if isinstance(self.scene, type) else states_of

        def smallest(failed: Finding) -> Finding:
            assert isinstance(failed.scene, Scene)
            return smallest_failure(failed, links(failed.scene), selection, seed)

        results = claim_results(self.claims, findings, expected_to_fail, smallest)
        return without_unresolved(
            results, (finding for finding in findings if is_unresolved_detail(finding.detail))
        )

    def absent(self, claim: str) -> str:
        """Return the reason why there is no result of a claim."""
        if self.engine is not None and not self.represented:
            return f"{self.engine.key} does not represent {self.where}"
        return f"{claim} does not apply to {self.where}"

    def _drawn_cases(self, examples: int, seed: int) -> Iterator[tuple[Scene, State]]:
        """Yield the initial state of the example, then drawn cases."""
        example = self.example
        first = [(example, State(*example.initial_state()))]
        if isinstance(self.scene, type):
            drawn = scene_cases(self.scene, LINKS, examples, seed)
            return chain(first, state_cases(example, 1, seed), drawn)
        return chain(first, state_cases(example, examples, seed))


@dataclass(frozen=True)
class EquationsTarget:
    """User-supplied functions under test.

    Attributes:
        functions: the functions.
        against: reference, a scene or an engine that they are compared with, or None.
        where: "", for there is no scene.
    """

    functions: EquationsOfMotion
    against: Any = None
    where: str = ""

    @property
    def claims(self) -> tuple[str, ...]:
        """Ids of all claims about functions."""
        return tuple(FUNCTION_CLAIMS)

    def results(
        self, examples: int, seed: int, expected_to_fail: Collection[str] = ()
    ) -> dict[str, ClaimResult]:
        """Return the result of each claim, see `SceneTarget.results`."""
        findings = check(self.functions, states=examples, seed=seed, against=self.against)
        # A Finding of functions is about all states: an entry that none of them resolves no pass.
        hidden = (finding for finding in findings if finding.verdict == "inconclusive")
        return without_unresolved(claim_results(self.claims, findings, expected_to_fail), hidden)

    def absent(self, claim: str) -> str:
        """Return the reason why there is no result of a claim."""
        registered, names = FUNCTION_CLAIMS[claim], self.functions.given
        missing = [
            name for name in registered.needs if not any(x in names for x in name.split("|"))
        ]
        excluded = [name for name in registered.without if name in names]
        why = f", without {' and '.join(missing)}".replace("|", " or ") if missing else ""
        why += f", with {' and '.join(excluded)}" if excluded else ""
        return f"{claim} does not apply to {self.functions.name}{why}"


ClaimTarget = SceneTarget | EquationsTarget
"""Code under test on one scene, or functions under test, and the claims that are checked of it."""

Scenes = Iterable[Scene | type[Scene] | str] | Mapping[str, Scene | type[Scene] | str]
"""Scenes, scene classes, or names as on the command line; a mapping gives them other names."""


def scene_targets(engine: type[Engine] | None, scenes: Scenes | None) -> list[SceneTarget]:
    """Return one target per scene.

    Args:
        engine: the engine, None where the scenes are under test.
        scenes: the scenes, by default every scene class whose example the engine represents.

    Raises:
        InputError: an item is no scene, two scenes have one name, or the engine represents none.
        UnknownNameError: a name that no scene has.
    """
    named: list[tuple[str, Scene | type[Scene]]]
    if scenes is None:
        named = [(kind.key, kind) for kind in SCENES.values()]
        named = [(key, kind) for key, kind in named if SceneTarget(key, kind, engine).represented]
    elif isinstance(scenes, Mapping):
        named = [(str(name), x) for name, item in scenes.items() for x in _scenes_of_item(item)]
    elif isinstance(scenes, str | Scene | type):
        raise InputError(f"scenes = {scenes!r}, expected a list of scenes")
    else:
        named = [(_scene_name(x), x) for item in scenes for x in _scenes_of_item(item)]
    targets: dict[str, SceneTarget] = {}
    for name, scene in named:
        if name in targets:
            hint = "give them names: scenes={name: scene}"
            raise InputError(f"scenes: two of them are called {name!r}; {hint}")
        targets[name] = SceneTarget(name, scene, engine)
    if not any(target.represented for target in targets.values()):
        if engine is None or (scenes is not None and not targets):
            raise InputError(f"scenes = {scenes!r}, expected at least one scene")
        which = f"none of the scenes {', '.join(targets)}" if targets else "no scene of eomcheck's"
        raise InputError(f"engine {engine.key} represents {which}")
    return list(targets.values())


def _scenes_of_item(item: Any) -> tuple[Scene | type[Scene], ...]:
    """Return the scenes or scene classes of an item of `scenes`: a name, a scene or a class."""
    if isinstance(item, str):
        return scene_classes_named(item)
    if isinstance(item, Scene) or (isinstance(item, type) and issubclass(item, Scene)):
        return (item,)
    raise InputError(f"scenes: {item!r} is neither a scene, a kind of scene nor the name of one")


def _scene_name(scene: Scene | type[Scene]) -> str:
    """Return the name of a scene, the key of a scene class."""
    return scene.key if isinstance(scene, type) else scene.name


# ---- Tests ---------------------------------------------------------------------------------------

F = TypeVar("F", bound=Callable)

OF_THE_FILE = "expected-failures"
"""Id of the test that each line of the file of expected failures is about a test."""

STOPPED = ""
"""Key, in place of the id of a claim, of the error because of which no claim could be checked."""

EXAMPLES = 25
"""Default number of random states per scene."""


def parametrize_with_claims(
    subject: type[Engine] | EquationsOfMotion | str | None = None,
    scenes: Scenes | None = None,
    *,
    against: Any = None,
    expected_failures: str | Path | None = None,
    strict: bool = True,
    examples: int = EXAMPLES,
    seed: int = 0,
) -> Callable[[F], F]:
    """Return a decorator that makes one pytest test for each claim and scene::

        @parametrize_with_claims(MyEngine, scenes=["chain-pendulum"])
        def test_my_engine(check):
            check()

    A test is named after its claim and scene, `test_my_engine[mass-matrix-chain-pendulum]`, one of
    functions after its claim alone. It fails with the Finding and with code that reproduces it. It
    is skipped, with the reason, where the claim does not apply, was only inconclusive or was itself
    skipped.

    Args:
        subject: code under test: an engine class or the name of one; `EquationsOfMotion`; None for
            the scenes themselves.
        scenes: scenes, scene classes of which random scenes are drawn, or their names, in a list or
            a mapping from names of your own; by default all that the engine represents. Functions
            have none.
        against: reference that functions are compared with, as in `check_functions`.
        expected_failures: file with an id and a reason per line, beside the test's own file. These
            tests have to fail. A further test, `expected-failures`, fails if a line matches none.
        strict: whether an expected failure that passes, or that is skipped, is a failure.
        examples: number of random states per scene; `--eomcheck-examples` overrides it.
        seed: seed of the random states.

    Raises:
        InputError: an argument is not valid, the file cannot be read, or the engine represents
            none of the scenes.
        UnknownNameError: no engine or scene has this name.
        EngineError: pytest is not installed.
    """
    pytest = required("pytest", "test")
    examples = whole_number("examples", examples)
    seed = whole_number("seed", seed, 0 if isinstance(subject, EquationsOfMotion) else None)
    targets = _targets(subject, scenes, against)

    def decorate(function: F) -> F:
        home = Path(getsourcefile(unwrap(function)) or ".").resolve()
        name = f"{home}::{function.__qualname__}"
        own = None if expected_failures is None else home.parent / expected_failures
        file = _option("xfails") or own
        # Read at collection: a file that cannot be read is reported before any test runs.
        expected = {} if file is None else read_expected_failures(file)
        suite = Suite(name, targets, file, expected, strict, examples, seed)
        _suites[name] = suite
        checks = suite.checks()
        return pytest.mark.parametrize("check", checks.values(), ids=checks)(function)

    return decorate


def _targets(subject: Any, scenes: Scenes | None, against: Any) -> list[ClaimTarget]:
    """Return the targets of the tests: the functions, or one per scene."""
    if isinstance(subject, EquationsOfMotion):
        if scenes is not None:
            raise InputError(f"scenes = {scenes!r}, but functions are no engine of scenes")
        return [EquationsTarget(subject, against)]
    if against is not None:
        raise InputError(f"against = {against!r}, but only functions are compared with something")
    if callable(subject) and not isinstance(subject, type):
        name = getattr(subject, "__name__", repr(subject))
        raise InputError(
            f"@parametrize_with_claims above {name} without parentheses: expected "
            "@parametrize_with_claims(engine) or (functions) or (scenes=[...])"
        )
    if subject is None and scenes is None:
        raise InputError("subject = None, expected an engine, functions, or else scenes")
    return [*scene_targets(None if subject is None else engine_of(subject), scenes)]


def _option(name: str) -> Any:
    """Return an option of pytest's command line; None where the plug-in is off."""
    plugin = sys.modules.get("eomcheck.pytest_plugin")
    return None if plugin is None else getattr(plugin.OPTIONS, name)


# ---- The tests -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Suite:
    """Tests of one decorated function.

    Attributes:
        name: name of the function, with its file.
        targets: code under test, one target per scene.
        file: file of expected failures, or None.
        expected: id -> reason of the tests that have to fail.
        strict: whether an expected failure has to fail.
        examples: number of random states per scene.
        seed: seed of the random states.
    """

    name: str
    targets: list[ClaimTarget]
    file: Path | None
    expected: dict[str, str]
    strict: bool
    examples: int
    seed: int
    _done: dict[str, dict[str, ClaimResult]] = field(default_factory=dict)

    @cached_property
    def ids(self) -> dict[str, tuple[ClaimTarget, str]]:
        """Id -> target and claim, one test each."""
        tests: dict[str, tuple[ClaimTarget, str]] = {}
        for target in self.targets:
            for claim in target.claims:
                id = f"{claim}-{target.where}" if target.where else claim
                if id in tests:
                    raise InputError(f"scenes: two tests would be called {id!r}")
                tests[id] = target, claim
        return tests

    def checks(self) -> dict[str, Callable[[], None]]:
        """Return id -> body of the test: scene by scene, the closest to a cause first."""
        of_file = {} if self.file is None else {OF_THE_FILE: self.check_file}
        return of_file | {id: partial(self.check, id) for id in self.ids}

    def check(self, id: str) -> None:
        """Pass, fail, xfail or skip the test of one claim on one scene by its result."""
        __tracebackhide__ = True
        pytest = required("pytest")
        try:
            verdict, text = self.result(id)
        except EomcheckError as error:
            _fail(f"{id}: {error}")
        reason = self.expected.get(id)
        if verdict == "failed":
            if reason is not None:
                pytest.xfail(reason)
            _fail(text)
        if self.strict and reason is not None and verdict != "inconclusive":
            outcome = "passes" if verdict == "passed" else f"is skipped ({text})"
            _fail(f"{id} {outcome}, but is expected to fail: {reason}")
        if verdict != "passed":
            pytest.skip(f"{verdict}: {text}" if verdict == "inconclusive" else text)

    def check_file(self) -> None:
        """Fail on ids in the file that no test has, in any of the suites that read this file."""
        __tracebackhide__ = True
        sharing = [suite for suite in _suites.values() if suite.file == self.file]
        unmatched = [id for id in self.expected if not any(id in suite.ids for suite in sharing)]
        if unmatched:
            _fail(f"{str(self.file)!r}: no test is called {', '.join(unmatched)}")

    def result(self, id: str) -> ClaimResult:
        """Return the result of a test; all claims of its target are evaluated if not done yet.

        Raises:
            InputError: the scene or the functions could not be checked.
        """
        target, claim = self.ids[id]
        if target.where not in self._done:
            work = partial(self._compute_results, target)
            results = compute_once(_option("shared"), f"{self.name}-{target.where}", work)
            self._done[target.where] = {id: ClaimResult(*pair) for id, pair in results.items()}
        done = self._done[target.where]
        if STOPPED in done:
            raise InputError(done[STOPPED].text)
        return done[claim] if claim in done else ClaimResult("skipped", target.absent(claim))

    def _compute_results(self, target: ClaimTarget) -> dict[str, ClaimResult]:
        """Return the results of all claims on a target; an error becomes the failure `STOPPED`."""
        examples = _option("examples") or self.examples
        expected_to_fail = {
            claim for id, (on, claim) in self.ids.items() if on is target and id in self.expected
        }
        try:
            return target.results(examples, self.seed, expected_to_fail)
        except EomcheckError as error:
            # Cached like any other result: the next claim would raise as well.
            return {STOPPED: ClaimResult("failed", str(error))}


_suites: dict[str, Suite] = {}
"""Name -> suite, all of this process: one file of expected failures may be of several."""


def _fail(text: str) -> NoReturn:
    """Fail the running test, without a traceback."""
    __tracebackhide__ = True
    raise required("pytest").fail.Exception(text, pytrace=False)

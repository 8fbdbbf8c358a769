"""`parametrize_with_claims`: a pytest test for each claim that is made of an engine or functions.

The work on a scene is done when its first test asks for it, once for all claims, and once for all
processes of pytest-xdist. Ids in the file of expected failures are those in the brackets of a test.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from inspect import getsourcefile, unwrap
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from eomcheck.engines import Engine, engine_of
from eomcheck.errors import EomcheckError, InputError, required, whole_number
from eomcheck.testing.expected import expected_failures as read_expected
from eomcheck.testing.once import done_once
from eomcheck.testing.subject import Functions
from eomcheck.testing.trials import FunctionsTrial, Result, Scenes, Trial, scene_trials

F = TypeVar("F", bound=Callable)

OF_THE_FILE = "expected-failures"
"""Id of the test that each line of the file of expected failures is about a test."""

STOPPED = ""
"""In place of a claim: why none could be looked at."""

EXAMPLES = 25
"""Random states a scene, if nobody says otherwise."""


def parametrize_with_claims(
    subject: type[Engine] | Functions | str | None = None,
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

    A test is called after its claim and scene, `test_my_engine[mass-matrix-chain-pendulum]`, one of
    functions after its claim alone. It
    fails with the Finding and with code that shows it again. It is skipped, with the reason, where
    the claim does not apply, was only inconclusive or could not be looked at.

    Args:
        subject: on trial: a class of engine or the name of one; `Functions`; None for the scenes
            themselves.
        scenes: scenes, kinds of scenes of which random ones are drawn, or their names, in a list or
            by names of your own; by default all that the engine represents. Functions have none.
        against: what functions are compared with, as in `check_functions`.
        expected_failures: a file with an id and a reason a line, beside the test's own file. These
            tests have to fail. A further test, `expected-failures`, fails if a line matches none.
        strict: whether an expected failure that passes, or that is not looked at, is a failure.
        examples: number of random states a scene; `--eomcheck-examples` overrides it.
        seed: of the draws.

    Raises:
        InputError: an argument is not valid, the file cannot be read, or the engine represents
            none of the scenes.
        UnknownNameError: no engine or scene has this name.
        EngineError: pytest is not installed.
    """
    pytest = required("pytest", "test")
    examples = whole_number("examples", examples)
    seed = whole_number("seed", seed, 0 if isinstance(subject, Functions) else None)
    trials = _trials(subject, scenes, against)

    def decorate(function: F) -> F:
        home = Path(getsourcefile(unwrap(function)) or ".").resolve()
        name = f"{home}::{function.__qualname__}"
        own = None if expected_failures is None else home.parent / expected_failures
        file = _option("xfails") or own
        # Read here: a file that cannot be is told before anything is run.
        expected = {} if file is None else read_expected(file)
        suite = Suite(name, trials, file, expected, strict, examples, seed)
        _suites[name] = suite
        checks = suite.checks()
        return pytest.mark.parametrize("check", checks.values(), ids=checks)(function)

    return decorate


def _trials(subject: Any, scenes: Scenes | None, against: Any) -> list[Trial]:
    if isinstance(subject, Functions):
        if scenes is not None:
            raise InputError(f"scenes = {scenes!r}, but functions are no engine of scenes")
        return [FunctionsTrial(subject, against)]
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
    return [*scene_trials(None if subject is None else engine_of(subject), scenes)]


def _option(name: str) -> Any:
    """Return what the command line of pytest says; None where the plug-in is off."""
    plugin = sys.modules.get("eomcheck.pytest_plugin")
    return None if plugin is None else getattr(plugin.OPTIONS, name)


# ---- The tests -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Suite:
    """The tests of one function.

    Attributes:
        name: of the function, with its file.
        trials: what is looked at, a trial a scene.
        file: of expected failures, or None.
        expected: id -> reason of the tests that have to fail.
        strict: whether an expected failure has to fail.
        examples: number of random states a scene.
        seed: of the draws.
    """

    name: str
    trials: list[Trial]
    file: Path | None
    expected: dict[str, str]
    strict: bool
    examples: int
    seed: int
    _done: dict[str, dict[str, Result]] = field(default_factory=dict)

    @cached_property
    def ids(self) -> dict[str, tuple[Trial, str]]:
        """Id -> trial and claim, one test each."""
        found: dict[str, tuple[Trial, str]] = {}
        for trial in self.trials:
            for claim in trial.claims:
                id = f"{claim}-{trial.where}" if trial.where else claim
                if id in found:
                    raise InputError(f"scenes: two tests would be called {id!r}")
                found[id] = trial, claim
        return found

    def checks(self) -> dict[str, Callable[[], None]]:
        """Return id -> what the test calls: scene by scene, the closest to a cause first."""
        of_file = {} if self.file is None else {OF_THE_FILE: CheckOfFile(self)}
        return of_file | {id: Check(self, id) for id in self.ids}

    def result(self, id: str) -> Result:
        """Return what a test came to; the work is done here if it is not yet.

        Raises:
            InputError: the scene or the functions could not be looked at.
        """
        trial, claim = self.ids[id]
        if trial.where not in self._done:
            work = partial(self._work, trial)
            found = done_once(_option("shared"), f"{self.name}-{trial.where}", work)
            self._done[trial.where] = {id: Result(*one) for id, one in found.items()}
        done = self._done[trial.where]
        if STOPPED in done:
            raise InputError(done[STOPPED].text)
        return done[claim] if claim in done else Result("not looked at", trial.absent(claim))

    def _work(self, trial: Trial) -> dict[str, Result]:
        examples = _option("examples") or self.examples
        known = {of for id, (on, of) in self.ids.items() if on is trial and id in self.expected}
        try:
            return trial.results(examples, self.seed, known)
        except EomcheckError as error:
            # Kept like any other result: the next claim would end there as well.
            return {STOPPED: Result("failed", str(error))}


_suites: dict[str, Suite] = {}
"""Those of this process, by name: one file of expected failures may be of several."""


@dataclass(frozen=True)
class Check:
    """One claim on one scene; calling it passes, fails or skips the test."""

    suite: Suite = field(repr=False)
    id: str

    def __call__(self) -> None:
        """Look at the claim, and tell pytest."""
        __tracebackhide__ = True
        pytest = required("pytest")
        try:
            verdict, text = self.suite.result(self.id)
        except EomcheckError as error:
            _fail(f"{self.id}: {error}")
        reason = self.suite.expected.get(self.id)
        if verdict == "failed":
            if reason is not None:
                pytest.xfail(reason)
            _fail(text)
        if self.suite.strict and reason is not None and verdict != "inconclusive":
            what = "passes" if verdict == "passed" else f"is not looked at ({text})"
            _fail(f"{self.id} {what}, but is expected to fail: {reason}")
        if verdict != "passed":
            pytest.skip(f"{verdict}: {text}" if verdict == "inconclusive" else text)


@dataclass(frozen=True)
class CheckOfFile:
    """Every id in a file of expected failures is that of a test."""

    suite: Suite = field(repr=False)

    def __call__(self) -> None:
        """Fail on ids that no test has, in any of the suites that read this file."""
        __tracebackhide__ = True
        sharing = [one for one in _suites.values() if one.file == self.suite.file]
        unmatched = [id for id in self.suite.expected if not any(id in one.ids for one in sharing)]
        if unmatched:
            _fail(f"{str(self.suite.file)!r}: no test is called {', '.join(unmatched)}")


def _fail(text: str) -> NoReturn:
    __tracebackhide__ = True
    raise required("pytest").fail.Exception(text, pytrace=False)

"""What a test suite asks of an engine, of a scene or of functions: each claim, on many states."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Any, NamedTuple, Protocol

from eomcheck.claims import CLAIMS, Finding, State
from eomcheck.claims.entries import lists
from eomcheck.claims.finding import Verdict
from eomcheck.claims.run import Run, check_compared
from eomcheck.claims.selection import Selection
from eomcheck.claims.smaller import no_larger, smallest_failure, states_of
from eomcheck.claims.strata import scene_cases, state_cases
from eomcheck.claims.wide import with_wide
from eomcheck.engines import Engine, represents
from eomcheck.engines.answers import represents_some
from eomcheck.errors import InputError
from eomcheck.mechanics.scene import Scene
from eomcheck.scene_lookup import kinds_of
from eomcheck.scenes import SCENES
from eomcheck.testing.run import FUNCTION_CLAIMS, check
from eomcheck.testing.subject import Functions

LINKS = 1, 5
"""Numbers of links of the random scenes of a kind: larger ones take longer and show less."""


class Result(NamedTuple):
    """What a claim came to on all states that were looked at.

    Attributes:
        verdict: "failed" if it failed once, otherwise "passed" if it passed once, and so on.
        text: for whoever reads it in a terminal, "" where it passed.
    """

    verdict: Verdict
    text: str = ""


class Trial(Protocol):
    """Something on trial in one place, and the claims that it is asked."""

    @property
    def where(self) -> str:
        """The name of the scene, "" where there is none."""
        ...

    @property
    def claims(self) -> tuple[str, ...]:
        """Ids of the claims, in the order in which a failure is closest to its cause."""
        ...

    def results(self, examples: int, seed: int, known: Collection[str]) -> dict[str, Result]:
        """Return what each claim came to; one that is not there does not apply.

        Args:
            examples: number of random states.
            seed: of the draws.
            known: ids of the claims that are expected to fail.
        """
        ...

    def absent(self, claim: str) -> str:
        """Return why there is no result of a claim."""
        ...


def results_of(
    claims: Iterable[str],
    findings: Iterable[Finding],
    known: Collection[str],
    smallest: Callable[[Finding], Finding] = lambda failed: failed,
) -> dict[str, Result]:
    """Return what the Findings of each claim come to.

    Args:
        claims: ids, in the order in which a failure is closest to its cause.
        findings: of all claims. One that follows from another is told without code, which the
            other one has, unless that is expected to fail.
        known: ids of the claims that are expected to fail.
        smallest: returns the smallest failure like one that is found. It is asked once, for the
            first that is not expected: what follows is mostly due to that one.
    """
    by: dict[str, list[Finding]] = {}
    for finding in findings:
        by.setdefault(finding.claim, []).append(finding)
    found: dict[str, Result] = {}
    for claim in filter(by.__contains__, claims):
        worst = result_of(by[claim])
        if isinstance(worst, Finding):
            if claim not in known:
                worst, smallest = smallest(worst), lambda failed: failed
            folded = worst.follows and worst.follows not in known
            worst = _folded(worst) if folded else _failed(worst, by[claim])
        found[claim] = worst
    return found


def result_of(findings: list[Finding]) -> Result | Finding:
    """Return what the Findings of one claim come to; the first failure, if there is one."""
    by: dict[Verdict, Finding] = {}
    for finding in findings:
        by.setdefault(finding.verdict, finding)
    if "failed" in by:
        return by["failed"]
    if "passed" in by:
        return Result("passed")
    if "inconclusive" in by:
        return Result("inconclusive", str(by["inconclusive"]))
    why = by["not looked at"]
    return Result("not looked at", f"{why.subject}: {why.detail}")


def _folded(shown: Finding) -> Result:
    """Return a failure that follows from another, without code that shows it again."""
    why = f"follows from {shown.cause}, see {shown.follows}"
    return Result("failed", f"{why}\n{replace(shown, follows='')}")


def without_hidden(results: dict[str, Result], hidden: Iterable[Finding]) -> dict[str, Result]:
    """Return the results without a pass where something is resolved in no state.

    Args:
        results: of claims.
        hidden: inconclusive Findings that hold for all states.
    """
    listed = {one.claim: str(one) for one in hidden}
    return {
        claim: Result("inconclusive", listed[claim])
        if claim in listed and result.verdict == "passed"
        else result
        for claim, result in results.items()
    }


def _failed(shown: Finding, findings: list[Finding]) -> Result:
    failures = sum(one.verdict == "failed" for one in findings)
    count = f"failed in {failures} of {len(findings)} comparisons; " if len(findings) > 1 else ""
    return Result("failed", f"{shown}\n{count}to see it again:\n\n{shown.as_python()}")


# ---- Engines and scenes --------------------------------------------------------------------------


def of_engines() -> tuple[str, ...]:
    """Return the ids of the claims that engines are asked."""
    return tuple(id for id, claim in CLAIMS.items() if claim.asks)


@dataclass(frozen=True)
class SceneTrial:
    """An engine on trial on a scene, or the scene itself.

    Attributes:
        where: name of the scene.
        scene: the scene, or a kind of which random ones are drawn.
        engine: the engine, None where the scene is on trial.
    """

    where: str
    scene: Scene | type[Scene]
    engine: type[Engine] | None

    @property
    def claims(self) -> tuple[str, ...]:
        """Those about engines, or all that are about a state."""
        if self.engine is not None:
            return of_engines()
        return tuple(id for id, claim in CLAIMS.items() if id != "coverage")

    @property
    def example(self) -> Scene:
        """The scene, or the example of its kind."""
        return self.scene.example() if isinstance(self.scene, type) else self.scene

    @property
    def represented(self) -> bool:
        """Whether the engine represents the scene, or some of the kind; a scene does itself."""
        if self.engine is None:
            return True
        if isinstance(self.scene, type):
            return represents_some(self.engine, self.scene)
        return represents(self.engine, self.scene)

    def results(self, examples: int, seed: int, known: Collection[str] = ()) -> dict[str, Result]:
        """Return what each claim came to, as `Trial` says."""
        if not self.represented:
            return {}
        kind = type(self.example)
        engines = None if self.engine is None else [self.engine]
        selection = Selection.of(None, engines, self.claims, scenes=[kind])
        run = Run()
        cases = self._cases(examples, seed)
        for scene, state in with_wide(cases, seed) if selection.named else cases:
            run.look_at(scene, state, selection)
        found = run.finish(selection)
        if self.engine is not None:
            check_compared([self.engine], found)
        links = partial(no_larger, links=LINKS) if isinstance(self.scene, type) else states_of

        def smallest(failed: Finding) -> Finding:
            assert isinstance(failed.scene, Scene)
            return smallest_failure(failed, links(failed.scene), selection, seed)

        results = results_of(self.claims, found, known, smallest)
        return without_hidden(results, (one for one in found if lists(one.detail)))

    def absent(self, claim: str) -> str:
        """Return why there is no result of a claim."""
        if self.engine is not None and not self.represented:
            return f"{self.engine.key} does not represent {self.where}"
        return f"{claim} does not apply to {self.where}"

    def _cases(self, examples: int, seed: int) -> Iterator[tuple[Scene, State]]:
        example = self.example
        first = [(example, State(*example.initial_state()))]
        if isinstance(self.scene, type):
            drawn = scene_cases(self.scene, LINKS, examples, seed)
            return chain(first, state_cases(example, 1, seed), drawn)
        return chain(first, state_cases(example, examples, seed))


@dataclass(frozen=True)
class FunctionsTrial:
    """Functions on trial.

    Attributes:
        functions: the functions.
        against: a scene or an engine that they are compared with, or None.
        where: "", for there is no scene.
    """

    functions: Functions
    against: Any = None
    where: str = ""

    @property
    def claims(self) -> tuple[str, ...]:
        """All that there are about functions."""
        return tuple(FUNCTION_CLAIMS)

    def results(self, examples: int, seed: int, known: Collection[str] = ()) -> dict[str, Result]:
        """Return what each claim came to, as `Trial` says."""
        found = check(self.functions, states=examples, seed=seed, against=self.against)
        # A Finding holds for all states here: what none of them resolves is no pass.
        hidden = (one for one in found if one.verdict == "inconclusive")
        return without_hidden(results_of(self.claims, found, known), hidden)

    def absent(self, claim: str) -> str:
        """Return why there is no result of a claim."""
        one, given = FUNCTION_CLAIMS[claim], self.functions.given
        missing = [name for name in one.needs if not any(x in given for x in name.split("|"))]
        excluded = [name for name in one.without if name in given]
        why = f", without {' and '.join(missing)}".replace("|", " or ") if missing else ""
        why += f", with {' and '.join(excluded)}" if excluded else ""
        return f"{claim} does not apply to {self.functions.name}{why}"


Scenes = Iterable[Scene | type[Scene] | str] | Mapping[str, Scene | type[Scene] | str]
"""Scenes, kinds, or names as on the command line; with names of one's own where it is a mapping."""


def scene_trials(engine: type[Engine] | None, scenes: Scenes | None) -> list[SceneTrial]:
    """Return a trial a scene.

    Args:
        engine: the engine, None where the scenes are on trial.
        scenes: the scenes, by default every kind whose example the engine represents.

    Raises:
        InputError: what is no scene, two scenes of one name, or none that the engine represents.
        UnknownNameError: a name that no scene has.
    """
    named: list[tuple[str, Scene | type[Scene]]]
    if scenes is None:
        named = [(kind.key, kind) for kind in SCENES.values()]
        named = [(key, kind) for key, kind in named if SceneTrial(key, kind, engine).represented]
    elif isinstance(scenes, Mapping):
        named = [(str(name), one) for name, given in scenes.items() for one in _scenes(given)]
    elif isinstance(scenes, str | Scene | type):
        raise InputError(f"scenes = {scenes!r}, expected a list of scenes")
    else:
        named = [(_name(one), one) for given in scenes for one in _scenes(given)]
    trials: dict[str, SceneTrial] = {}
    for name, scene in named:
        if name in trials:
            hint = "give them names: scenes={name: scene}"
            raise InputError(f"scenes: two of them are called {name!r}; {hint}")
        trials[name] = SceneTrial(name, scene, engine)
    if not any(trial.represented for trial in trials.values()):
        if engine is None or (scenes is not None and not trials):
            raise InputError(f"scenes = {scenes!r}, expected at least one scene")
        which = f"none of the scenes {', '.join(trials)}" if trials else "no scene of eomcheck's"
        raise InputError(f"engine {engine.key} represents {which}")
    return list(trials.values())


def _scenes(given: Any) -> tuple[Scene | type[Scene], ...]:
    if isinstance(given, str):
        return kinds_of(given)
    if isinstance(given, Scene) or (isinstance(given, type) and issubclass(given, Scene)):
        return (given,)
    raise InputError(f"scenes: {given!r} is neither a scene, a kind of scene nor the name of one")


def _name(scene: Scene | type[Scene]) -> str:
    return scene.key if isinstance(scene, type) else scene.name

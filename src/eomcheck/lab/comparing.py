"""One robot description as several libraries read it: where they differ, how much, and why."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from eomcheck import strategies
from eomcheck.calls import call
from eomcheck.claims import CLAIMS
from eomcheck.claims.finding import DECIDED, Finding, unresolved
from eomcheck.claims.run import Run, Selection
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.engines import Engine, version_of
from eomcheck.engines.files import BY_FORMAT, FileEngine
from eomcheck.errors import EngineError, InputError, UnknownNameError, message_of
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab.comparison import Comparison
from eomcheck.lab.draws import draw
from eomcheck.lab.parting import Parting
from eomcheck.lab.quantities import QUANTITIES, apart, ours_at, summed_at, theirs_at
from eomcheck.lab.reasons import reasons
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene

OURS = "eomcheck"

OWN = "kinetic-energy", "power-balance"
"""Claims by which our two derivations are compared where a library differs from them."""


def readers(scene: Scene, names: Iterable[str] | None) -> dict[str, type[FileEngine]]:
    """Return the libraries of these names that read the file of a scene, by default all.

    Raises:
        InputError: the scene is no file, or has other parameters.
        UnknownNameError: there is none of a name.
    """
    if not (isinstance(scene, Mechanism) and scene.made.format and scene.as_described):
        raise InputError(f"{scene.name} is no robot as its file describes it")
    known = BY_FORMAT[scene.made.format]
    for name in names or ():
        if name not in known:
            raise UnknownNameError("engine", name, known)
    return known if names is None else {name: known[name] for name in names}


def compare(
    scene: Scene,
    engines: Iterable[str] | None = None,
    states: int = 20,
    seed: int = 0,
    advance: Callable[[], None] = lambda: None,
) -> Comparison:
    """Compare how libraries read the file of a scene, and their equations of motion.

    Args:
        scene: of `eomcheck.scenes.from_urdf` or `from_mjcf`.
        engines: keys of `eomcheck.engines.files.BY_FORMAT`; by default those that are installed.
        states: number of random states.
        seed: of their draws.
        advance: called after each state.

    Raises:
        InputError: the scene is no file, or no library is left to compare with.
        EngineError: a library that was named is not installed.
        UnknownNameError: there is none of a name.
    """
    found, made = Comparison(scene), {}
    for key, kind in readers(scene, engines).items():
        try:
            found.versions[key] = version_of(kind)
        except EngineError as error:
            if engines is not None:
                raise
            found.refused[key] = str(error)
            found.missing.append(key)
            continue
        try:
            made[key] = call(f"{kind.__name__}(scene)", kind, scene)
            found.said[key], found.why[key] = made[key].said, []
        except Exception as error:  # whatever a library makes of a file it cannot read
            found.refused[key] = message_of(error)
            del found.versions[key]
    if not made:
        raise InputError(f"nothing to compare {scene.name} with: " + _told(found.refused))
    asked = [one.id for one in CLAIMS.values() if one.asks in QUANTITIES.values()]
    kinds = [type(engine) for engine in made.values()]
    run, selection = Run(), Selection.of(["gw"], kinds, asked, scenes=[scene])
    for state in draw(strategies.states(scene), states, seed):
        _look(found, made, state, run.look_at(scene, state, selection))
        found.states += 1
        advance()
    keys: dict[type[Engine] | None, str] = {type(engine): key for key, engine in made.items()}
    for claim, left in unresolved(run.findings).items():
        if len(found.skipped) == found.states and CLAIMS[claim].asks == "acceleration":
            continue  # it is said that q̈ is not compared, and why
        for one in left:
            if (key := keys.get(one.finding.engine)) is not None:
                found.hidden.setdefault((key, claim), []).append(one)
    return found


def _worse(one: Finding, other: Finding) -> bool:
    """Return whether a finding counts in place of another: failures first, then larger errors."""
    return (one.verdict == "failed", one.ratio) > (other.verdict == "failed", other.ratio)


def _told(refused: dict[str, str]) -> str:
    return "; ".join(f"{key}: {why}" for key, why in refused.items())


def _look(
    found: Comparison, made: dict[str, FileEngine], state: State, findings: Iterable[Finding]
) -> None:
    """Compare at one state, at which claims have come to these findings."""
    scene = found.scene
    at = Evaluation(scene, *state)
    kinds: dict[type[Engine], str] = {type(engine): key for key, engine in made.items()}
    by_library = [(kinds[one.engine], one) for one in findings if one.engine in kinds]
    ours, summed = ours_at(found, at), summed_at(at)
    theirs = {key: theirs_at(found, key, engine, at, ours) for key, engine in made.items()}
    # Where rounding explains any difference there is no number to show.
    unsure = {
        (key, CLAIMS[one.claim].asks) for key, one in by_library if one.verdict == "inconclusive"
    }
    if "q̈" not in ours:
        unsure = {(key, method) for key, method in unsure if method != "acceleration"}
    found.unsure.update(sorted(unsure))
    for name, method in QUANTITIES.items():
        said = [ours.get(name)]
        said += [None if (x, method) in unsure else told.get(name) for x, told in theirs.items()]
        table = np.array([[apart(x, y, summed[name]) for y in said] for x in said])
        found.apart[name] = np.fmax(found.apart.get(name, table), table)
    bad = set()
    for key, one in by_library:
        bad |= {key} if one.verdict == "failed" else set()
        if one.verdict == "not looked at":
            continue
        found.decided[key] = found.decided.get(key, False) or one.verdict in DECIDED
        before = found.findings.get((key, one.claim))
        if before is None or _worse(one, before):
            found.findings[key, one.claim] = one
    description = next(iter(made.values())).description
    if bad:
        own = Selection.of(["gw"], [], OWN, scenes=[scene])
        seen = Run().look_at(scene, state, own)
        found.own += [one for one in seen if one.verdict == "failed"]
    for key, told in theirs.items():
        if key not in bad or told.keys() != ours.keys():
            continue
        parting = Parting(
            description,
            scene.coordinate_names,
            state.v,
            ours,
            told,
            summed,
            made[key].free_base(*state[:2]),
        )
        for why in reasons(parting):
            if why not in found.why[key]:
                found.why[key].append(why)

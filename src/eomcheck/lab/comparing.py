"""One robot description as several libraries read it: where they differ, how much, and why."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from eomcheck import strategies
from eomcheck.claims import CLAIMS
from eomcheck.claims.finding import Finding
from eomcheck.claims.run import Run, Selection
from eomcheck.engines import Answers, Engine, EngineFault
from eomcheck.engines.files import BY_FORMAT, FileEngine
from eomcheck.errors import EngineError, InputError, UnknownNameError
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.draws import draw
from eomcheck.lab.reasons import Parting, Why, reasons
from eomcheck.mechanics.described.mechanism import Mechanism
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.contract import Array

OURS = "eomcheck"

QUANTITIES = {
    "M": "mass_matrix",
    "bias": "bias",
    "gravity": "forces",
    "forces": "forces",
    "q̈": "acceleration",
}
"""What is compared -> what an engine is asked; gravity is what forces are at rest."""


@dataclass
class Comparison:
    """What came of one robot.

    Attributes:
        scene: the robot, with the parameters of its file.
        versions: key of a library that took part -> its version.
        refused: key of one that did not -> why.
        missing: keys of those among them that are not installed.
        apart: quantity -> the largest difference of any two at any state (k, k), relative to the
            largest entry; eomcheck first, then as in `versions`.
        findings: the worst one by library and claim, of ours and theirs.
        faults: library and quantity -> what it did instead of an answer, the first time.
        why: library -> what explains its differences, as far as that is known.
        said: library -> what it wrote while it read the file.
        states: number of states looked at.
    """

    scene: Scene
    versions: dict[str, str] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    apart: dict[str, Array] = field(default_factory=dict)
    findings: dict[tuple[str, str], Finding] = field(default_factory=dict)
    faults: dict[tuple[str, str], str] = field(default_factory=dict)
    why: dict[str, list[Why]] = field(default_factory=dict)
    said: dict[str, list[str]] = field(default_factory=dict)
    states: int = 0

    @property
    def failed(self) -> list[Finding]:
        """The findings on what differs by more than rounding."""
        return [one for one in self.findings.values() if one.verdict == "failed"]

    @property
    def agree(self) -> bool:
        """Whether all that took part answer everything, and the same."""
        return not (self.failed or self.faults)

    def of(self, library: str) -> list[Finding]:
        """Return what a library differs in by more than rounding."""
        mine = (one for (key, _), one in self.findings.items() if key == library)
        return [one for one in mine if one.verdict == "failed"]

    def differs(self, library: str) -> bool:
        """Return whether a library differs, or does not answer everything."""
        return bool(self.of(library)) or any(key == library for key, _ in self.faults)

    def verdict(self, library: str) -> str:
        """Return a word or two on a library."""
        if library in self.refused:
            return "not installed" if library in self.missing else "no answer"
        if not self.differs(library):
            return "agrees"
        labels = [one.label for one in self.why[library]]
        return ", ".join(labels) if labels and all(labels) else "differs"


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
            found.versions[key] = kind.version()
        except EngineError as error:
            if engines is not None:
                raise
            found.refused[key] = str(error)
            found.missing.append(key)
            continue
        try:
            made[key] = kind(scene)
            found.said[key], found.why[key] = made[key].said, []
        except Exception as error:  # whatever a library makes of a file it cannot read
            found.refused[key] = " ".join(str(error).split())
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
    return found


def _told(refused: dict[str, str]) -> str:
    return "; ".join(f"{key}: {why}" for key, why in refused.items())


def _look(
    found: Comparison, made: dict[str, FileEngine], state: State, findings: Iterable[Finding]
) -> None:
    """Compare at one state, at which claims have come to these findings."""
    scene = found.scene
    at = Evaluation(scene, *state)
    ours = _ours(at)
    theirs = {key: _theirs(found, key, engine, at) for key, engine in made.items()}
    for name in QUANTITIES:
        said = [ours[name], *(one.get(name) for one in theirs.values())]
        table = np.array([[_apart(x, y) for y in said] for x in said])
        found.apart[name] = np.fmax(found.apart.get(name, table), table)
    kinds: dict[type[Engine], str] = {type(engine): key for key, engine in made.items()}
    for one in findings:
        key = kinds.get(one.engine) if one.engine is not None else None
        if key is None or one.verdict == "not looked at":
            continue
        before = found.findings.get((key, one.claim))
        if before is None or one.ratio > before.ratio:
            found.findings[key, one.claim] = one
    description = next(iter(made.values())).description
    bad = {key for (key, _), one in found.findings.items() if one.verdict == "failed"}
    for key, told in theirs.items():
        if key not in bad or len(told) < len(QUANTITIES):
            continue
        parting = Parting(
            description,
            scene.coordinate_names,
            state.v,
            ours,
            told,
            made[key].free_base(*state[:2]),
        )
        for why in reasons(parting):
            if why not in found.why[key]:
                found.why[key].append(why)


def _ours(at: Evaluation) -> dict[str, Array]:
    rest = Evaluation(at.scene, at.q, np.zeros(at.scene.n), at.t)
    vdot = at.acceleration(FORMULATIONS["gw"]).vdot
    terms = at.terms.M, at.terms.B, rest.terms.Q, at.terms.Q, vdot
    zero = np.zeros(at.scene.n)
    said = (zero if one is None else one for one in terms)
    return dict(zip(QUANTITIES, said, strict=True))


def _theirs(found: Comparison, key: str, engine: FileEngine, at: Evaluation) -> dict[str, Array]:
    """Return what a library says, and keep what it does instead of an answer."""
    answers, (q, v, t), zero = Answers(engine), (at.q, at.v, at.t), np.zeros(at.scene.n)
    arguments = {
        "M": (q, t),
        "bias": (q, v, t),
        "gravity": (q, zero, t),
        "forces": (q, v, t),
        "q̈": (q, v, zero, at.terms.a, at.terms.gamma, t),
    }
    told = {}
    for name, method in QUANTITIES.items():
        try:
            answer = answers.ask(method, *arguments[name])
        except EngineFault as fault:
            if (key, name) not in found.faults:
                found.faults[key, name] = fault.what
                found.why[key].append(Why(f"gives no {name}: {fault.what}", f"no {name}"))
        else:
            told[name] = answer.vdot if name == "q̈" else answer
    return told


def _apart(x: Array | None, y: Array | None) -> float:
    if x is None or y is None:
        return np.nan
    scale = max(largest(x), largest(y))
    return largest(x - y) / scale if scale > 0 else 0.0

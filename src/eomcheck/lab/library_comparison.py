"""Comparison of the libraries that read one robot description: differences and reasons.

`compare_libraries` draws random states of a URDF or MJCF file and asks eomcheck and every library
for M, bias, gravity, forces and q̈ at each. The claims judge each difference against the rounding
error; a `LibraryComparison` holds the largest difference of any two per quantity, the worst finding
per library and claim, and the reasons of `eomcheck.lab.discrepancy`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from eomcheck import strategies
from eomcheck.calls import call
from eomcheck.claims import CLAIMS
from eomcheck.claims.finding import DECIDED, Finding, Unresolved, unresolved_by_claim
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.engines import Answers, Engine, EngineFault, version_of
from eomcheck.engines.answers import inertia_size, weight_size
from eomcheck.engines.files import BY_FORMAT, FileEngine
from eomcheck.errors import EngineError, InputError, RefusedError, UnknownNameError, message_of
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.discrepancy import Discrepancy, Explanation, explain, relative_scale
from eomcheck.lab.strategy_samples import draw_samples
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

# ---- Result --------------------------------------------------------------------------------------


@dataclass
class LibraryComparison:
    """What came of one robot.

    Attributes:
        scene: the robot, with the parameters of its file.
        versions: key of a library that took part -> its version.
        refused: key of one that did not -> why.
        missing: keys of those among them that are not installed.
        differences: quantity -> the largest difference of any two at any state (k, k), relative to
            the largest entry; eomcheck first, then as in `versions`.
        findings: the worst one by library and claim, of ours and theirs.
        faults: library and quantity -> what it did instead of an answer, the first time.
        explanations: library -> what explains its differences, as far as that is known.
        messages: library -> what it wrote while it read the file.
        decided: library -> whether any of its findings is more than inconclusive; none of one
            of which nothing was compared.
        inconclusive_counts: library and method -> in how many states rounding explains any
            difference.
        states: number of states looked at.
        skipped: why q̈ is not compared, once for each state in which it is not.
        self_failures: failures of our two derivations being the same, in states where a library
            differs.
        unresolved_entries: library and claim -> what no state resolves of it.
    """

    scene: Scene
    versions: dict[str, str] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    differences: dict[str, Array] = field(default_factory=dict)
    findings: dict[tuple[str, str], Finding] = field(default_factory=dict)
    faults: dict[tuple[str, str], str] = field(default_factory=dict)
    explanations: dict[str, list[Explanation]] = field(default_factory=dict)
    messages: dict[str, list[str]] = field(default_factory=dict)
    decided: dict[str, bool] = field(default_factory=dict)
    inconclusive_counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    states: int = 0
    skipped: list[str] = field(default_factory=list)
    self_failures: list[Finding] = field(default_factory=list)
    unresolved_entries: dict[tuple[str, str], list[Unresolved]] = field(default_factory=dict)

    @property
    def failed(self) -> list[Finding]:
        """The findings on what differs by more than rounding."""
        return [one for one in self.findings.values() if one.verdict == "failed"]

    @property
    def disagree(self) -> bool:
        """Whether some that read the file differ, or do not answer everything."""
        return bool(self.failed or self.faults or self.self_failures)

    @property
    def agree(self) -> bool:
        """Whether something was compared and decided, and nothing differs."""
        return not self.disagree and any(self.decided.values())

    @property
    def undecided_libraries(self) -> list[str]:
        """The keys of libraries that read the file and of which nothing is decided."""
        return [key for key in self.versions if not self.decided.get(key)]

    def check_decided(self) -> None:
        """Raise InputError if nothing differs and nothing is decided: that is no pass."""
        if not (self.disagree or self.agree):
            libraries = ", ".join(self.versions)
            raise InputError(f"{self.scene.name}: nothing was decided about {libraries}")

    @property
    def unanswered(self) -> list[str]:
        """The keys of libraries that are installed and gave no answer."""
        return [key for key in self.refused if key not in self.missing]

    def failures_of(self, library: str) -> list[Finding]:
        """Return what a library differs in by more than rounding."""
        mine = (one for (key, _), one in self.findings.items() if key == library)
        return [one for one in mine if one.verdict == "failed"]

    def differs(self, library: str) -> bool:
        """Return whether a library differs, or does not answer everything."""
        return bool(self.failures_of(library)) or any(key == library for key, _ in self.faults)

    def undecided_claims(self, library: str) -> list[str]:
        """Return the claims about a library that are decided in no state."""
        return [
            claim
            for (key, claim), left in self.unresolved_entries.items()
            if key == library and any(not one.entry for one in left)
        ]

    def verdict(self, library: str) -> str:
        """Return a word or two on a library."""
        if library in self.refused:
            return "not installed" if library in self.missing else "no answer"
        if not self.differs(library):
            if library in self.undecided_libraries:
                return "inconclusive" if library in self.decided else "nothing compared"
            return "agrees where decided" if self.undecided_claims(library) else "agrees"
        labels = [one.label for one in self.explanations[library]]
        return ", ".join(labels) if labels and all(labels) else "differs"


# ---- Quantities: ours, theirs, and how far apart -------------------------------------------------

QUANTITIES = {
    "M": "mass_matrix",
    "bias": "bias",
    "gravity": "forces",
    "forces": "forces",
    "q̈": "acceleration",
}
"""What is compared -> what an engine is asked; gravity is what forces are at rest."""


def reference_quantities(found: LibraryComparison, at: Evaluation) -> dict[str, Array]:
    """Return our quantities, without q̈ where it is refused; the reason is kept.

    Constraints that depend on each other, or a singular M, leave M, bias and forces to compare.
    """
    rest = Evaluation(at.scene, at.q, np.zeros(at.scene.n), at.t)
    terms = at.terms.M, at.terms.B, rest.terms.Q, at.terms.Q
    zero = np.zeros(at.scene.n)
    ours = {
        name: zero if one is None else one for name, one in zip(QUANTITIES, terms, strict=False)
    }
    try:
        ours["q̈"] = at.acceleration(FORMULATIONS["gw"]).vdot
    except RefusedError as refusal:
        found.skipped.append(str(refusal))
    return ours


def summand_sizes(at: Evaluation) -> dict[str, float]:
    """Return the size of the terms that a library may sum to each quantity.

    0 of M and of q̈, for which the entries themselves count.
    """
    B, Q = inertia_size(at), at.cached(weight_size)
    return dict(zip(QUANTITIES, (0.0, B, Q, Q, 0.0), strict=True))


def library_quantities(
    found: LibraryComparison, key: str, engine: FileEngine, at: Evaluation, names: Iterable[str]
) -> dict[str, Array]:
    """Answers of a library by quantity; its faults are kept in `found`."""
    answers, (q, v, t), zero = Answers(engine), (at.q, at.v, at.t), np.zeros(at.scene.n)
    arguments = {
        "M": (q, t),
        "bias": (q, v, t),
        "gravity": (q, zero, t),
        "forces": (q, v, t),
        "q̈": (q, v, zero, at.terms.a, at.terms.gamma, t),
    }
    told = {}
    for name in names:
        try:
            answer = answers.ask(QUANTITIES[name], *arguments[name])
        except EngineFault as fault:
            if (key, name) not in found.faults:
                found.faults[key, name] = fault.what
                found.explanations[key].append(
                    Explanation(f"gives no {name}: {fault.what}", f"no {name}")
                )
        else:
            told[name] = answer.vdot if name == "q̈" else answer
    return told


def relative_difference(x: Array | None, y: Array | None, summed: float = 0.0) -> float:
    """Return the largest difference, relative; see `relative_scale`. NaN where one is not known."""
    if x is None or y is None:
        return np.nan
    scale = relative_scale(max(largest(x), largest(y)), summed)
    return largest(x - y) / scale if scale > 0 else 0.0


# ---- Comparing -----------------------------------------------------------------------------------

REFERENCE_NAME = "eomcheck"

SELF_CHECKS = "kinetic-energy", "power-balance"
"""Claims by which our two derivations are compared where a library differs from them."""


def readers(scene: Scene, names: Iterable[str] | None) -> dict[str, type[FileEngine]]:
    """Return the libraries of these names that read the file of a scene, by default all.

    Raises:
        InputError: the scene is no file, or has other parameters.
        UnknownNameError: there is none of a name.
    """
    if not (isinstance(scene, Mechanism) and scene.source.format and scene.as_described):
        raise InputError(f"{scene.name} is no robot as its file describes it")
    known = BY_FORMAT[scene.source.format]
    for name in names or ():
        if name not in known:
            raise UnknownNameError("engine", name, known)
    return known if names is None else {name: known[name] for name in names}


def compare_libraries(
    scene: Scene,
    engines: Iterable[str] | None = None,
    states: int = 20,
    seed: int = 0,
    advance: Callable[[], None] = lambda: None,
) -> LibraryComparison:
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
    found, made = LibraryComparison(scene), {}
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
            found.messages[key], found.explanations[key] = made[key].library_output, []
        except Exception as error:  # whatever a library makes of a file it cannot read
            found.refused[key] = message_of(error)
            del found.versions[key]
    if not made:
        raise InputError(f"nothing to compare {scene.name} with: " + _refusals_text(found.refused))
    asked = [one.id for one in CLAIMS.values() if one.asks in QUANTITIES.values()]
    kinds = [type(engine) for engine in made.values()]
    run, selection = ValidationRun(), RunSelection.of(["gw"], kinds, asked, scenes=[scene])
    for state in draw_samples(strategies.states(scene), states, seed):
        _compare_at(found, made, state, run.check_state(scene, state, selection))
        found.states += 1
        advance()
    keys: dict[type[Engine] | None, str] = {type(engine): key for key, engine in made.items()}
    for claim, left in unresolved_by_claim(run.findings).items():
        if len(found.skipped) == found.states and CLAIMS[claim].asks == "acceleration":
            continue  # it is said that q̈ is not compared, and why
        for one in left:
            if (key := keys.get(one.finding.engine)) is not None:
                found.unresolved_entries.setdefault((key, claim), []).append(one)
    return found


def _worse(one: Finding, other: Finding) -> bool:
    """Return whether a finding counts in place of another: failures first, then larger errors."""
    return (one.verdict == "failed", one.ratio) > (other.verdict == "failed", other.ratio)


def _refusals_text(refused: dict[str, str]) -> str:
    return "; ".join(f"{key}: {why}" for key, why in refused.items())


def _compare_at(
    found: LibraryComparison, made: dict[str, FileEngine], state: State, findings: Iterable[Finding]
) -> None:
    """Compare at one state, at which claims have come to these findings."""
    scene = found.scene
    at = Evaluation(scene, *state)
    kinds: dict[type[Engine], str] = {type(engine): key for key, engine in made.items()}
    by_library = [(kinds[one.engine], one) for one in findings if one.engine in kinds]
    ours, summed = reference_quantities(found, at), summand_sizes(at)
    theirs = {key: library_quantities(found, key, engine, at, ours) for key, engine in made.items()}
    # Where rounding explains any difference there is no number to show.
    unsure = {
        (key, CLAIMS[one.claim].asks) for key, one in by_library if one.verdict == "inconclusive"
    }
    if "q̈" not in ours:
        unsure = {(key, method) for key, method in unsure if method != "acceleration"}
    found.inconclusive_counts.update(sorted(unsure))
    for name, method in QUANTITIES.items():
        said = [ours.get(name)]
        said += [None if (x, method) in unsure else told.get(name) for x, told in theirs.items()]
        table = np.array([[relative_difference(x, y, summed[name]) for y in said] for x in said])
        found.differences[name] = np.fmax(found.differences.get(name, table), table)
    bad = set()
    for key, one in by_library:
        bad |= {key} if one.verdict == "failed" else set()
        if one.verdict == "skipped":
            continue
        found.decided[key] = found.decided.get(key, False) or one.verdict in DECIDED
        before = found.findings.get((key, one.claim))
        if before is None or _worse(one, before):
            found.findings[key, one.claim] = one
    description = next(iter(made.values())).description
    if bad:
        own = RunSelection.of(["gw"], [], SELF_CHECKS, scenes=[scene])
        seen = ValidationRun().check_state(scene, state, own)
        found.self_failures += [one for one in seen if one.verdict == "failed"]
    for key, told in theirs.items():
        if key not in bad or told.keys() != ours.keys():
            continue
        parting = Discrepancy(
            description,
            scene.coordinate_names,
            state.v,
            ours,
            told,
            summed,
            made[key].free_base(*state[:2]),
        )
        for why in explain(parting):
            if why not in found.explanations[key]:
                found.explanations[key].append(why)

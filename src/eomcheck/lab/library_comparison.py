"""Comparison of the libraries that read one robot description: differences and reasons.

`compare_libraries` draws random states of a URDF or MJCF file and evaluates M, bias, gravity,
forces and q̈ at each by eomcheck and by every library. The claims judge each difference against the
rounding error; a `LibraryComparison` holds the largest difference of any two per quantity, the
worst finding per library and claim, and the explanations of `eomcheck.lab.discrepancy`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from eomcheck import strategies
from eomcheck.calls import call
from eomcheck.claims import CLAIMS
from eomcheck.claims.finding import DECIDED, Finding, Unresolved, unresolved_by_claim, worst
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.engines import BY_FORMAT, Answers, Engine, EngineFault, FileEngine, version_of
from eomcheck.engines.answers import inertia_size, weight_size
from eomcheck.errors import EngineError, InputError, RefusedError, UnknownNameError, message_of
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.discrepancy import Discrepancy, Explanation, explain, relative_scale
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.strategies import draw_samples

# ---- Result --------------------------------------------------------------------------------------


@dataclass
class LibraryComparison:
    """The result of comparing the libraries that read one robot.

    Attributes:
        scene: the robot, with the parameters of its file.
        versions: key of a library that took part -> its version.
        refused: key of a library that did not -> reason.
        missing: keys of those among them that are not installed.
        differences: quantity -> the largest difference of any two at any state (k, k), relative to
            the largest entry; eomcheck first, then as in `versions`.
        findings: (library, claim) -> the worst finding.
        faults: (library, quantity) -> its first fault in place of an answer.
        explanations: library -> known explanations of its differences.
        messages: library -> its output while it read the file.
        decided: library -> whether any of its findings is more than inconclusive; a library of
            which nothing was compared is left out.
        inconclusive_counts: (library, method) -> number of states in which rounding explains any
            difference.
        states: number of states checked.
        skipped: reason why q̈ is not compared, once for each state in which it is not.
        self_failures: failures of the agreement of our two derivations, in states where a library
            differs.
        unresolved_entries: (library, claim) -> entries that no state resolves.
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
        """The findings of differences larger than rounding."""
        return [one for one in self.findings.values() if one.verdict == "failed"]

    @property
    def disagree(self) -> bool:
        """Whether a library that read the file differs, or does not answer everything."""
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
        """Return the findings of a library's differences larger than rounding."""
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
"""Quantity compared -> method of an engine; gravity is the forces at rest."""


def reference_quantities(comparison: LibraryComparison, at: Evaluation) -> dict[str, Array]:
    """Return the quantities by eomcheck; without q̈ where it is refused, and the reason is stored.

    With redundant constraints, or a singular M, there remain M, bias and forces to compare.
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
        comparison.skipped.append(str(refusal))
    return ours


def summand_sizes(at: Evaluation) -> dict[str, float]:
    """Return the size of the terms that a library may sum to each quantity.

    They are 0 for M and for q̈, where the entries themselves count.
    """
    B, Q = inertia_size(at), at.cached(weight_size)
    return dict(zip(QUANTITIES, (0.0, B, Q, Q, 0.0), strict=True))


def library_quantities(
    comparison: LibraryComparison,
    key: str,
    engine: FileEngine,
    at: Evaluation,
    names: Iterable[str],
) -> dict[str, Array]:
    """Return the answers of a library by quantity; store its faults in `comparison`."""
    answers, (q, v, t), zero = Answers(engine), (at.q, at.v, at.t), np.zeros(at.scene.n)
    arguments = {
        "M": (q, t),
        "bias": (q, v, t),
        "gravity": (q, zero, t),
        "forces": (q, v, t),
        "q̈": (q, v, zero, at.terms.a, at.terms.gamma, t),
    }
    quantities = {}
    for name in names:
        try:
            answer = answers.ask(QUANTITIES[name], *arguments[name])
        except EngineFault as fault:
            if (key, name) not in comparison.faults:
                comparison.faults[key, name] = fault.what
                comparison.explanations[key].append(
                    Explanation(f"gives no {name}: {fault.what}", f"no {name}")
                )
        else:
            quantities[name] = answer.vdot if name == "q̈" else answer
    return quantities


def relative_difference(x: Array | None, y: Array | None, summed: float = 0.0) -> float:
    """Return the largest difference, relative, see `relative_scale`; NaN where a value is None."""
    if x is None or y is None:
        return np.nan
    scale = relative_scale(max(largest(x), largest(y)), summed)
    return largest(x - y) / scale if scale > 0 else 0.0


# ---- Comparing -----------------------------------------------------------------------------------

REFERENCE_NAME = "eomcheck"

SELF_CHECKS = "kinetic-energy", "power-balance"
"""Claims that compare our two derivations where a library differs from them."""


def readers(scene: Scene, names: Iterable[str] | None) -> dict[str, type[FileEngine]]:
    """Return the libraries of these names that read the file of a scene, by default all.

    Raises:
        InputError: the scene is no file, or has other parameters.
        UnknownNameError: there is no library of a name.
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
    """Compare the equations of motion of the libraries that read the file of a scene.

    Args:
        scene: scene by `eomcheck.scenes.from_urdf` or `from_mjcf`.
        engines: keys of `eomcheck.engines.BY_FORMAT`; by default those that are installed.
        states: number of random states.
        seed: seed of their draws.
        advance: called after each state.

    Raises:
        InputError: the scene is no file, or no library is left to compare with.
        EngineError: a library that was named is not installed.
        UnknownNameError: there is no library of a name.
    """
    comparison, libraries = LibraryComparison(scene), {}
    for key, kind in readers(scene, engines).items():
        try:
            comparison.versions[key] = version_of(kind)
        except EngineError as error:
            if engines is not None:
                raise
            comparison.refused[key] = str(error)
            comparison.missing.append(key)
            continue
        try:
            libraries[key] = call(f"{kind.__name__}(scene)", kind, scene)
            comparison.messages[key], comparison.explanations[key] = (
                libraries[key].library_output,
                [],
            )
        except Exception as error:  # any error of a library at a file that it cannot read
            comparison.refused[key] = message_of(error)
            del comparison.versions[key]
    if not libraries:
        raise InputError(
            f"nothing to compare {scene.name} with: " + _refusals_text(comparison.refused)
        )
    claim_ids = [one.id for one in CLAIMS.values() if one.asks in QUANTITIES.values()]
    kinds = [type(engine) for engine in libraries.values()]
    run, selection = ValidationRun(), RunSelection.of(["gw"], kinds, claim_ids, scenes=[scene])
    for state in draw_samples(strategies.states(scene), states, seed):
        _compare_at(comparison, libraries, state, run.check_state(scene, state, selection))
        comparison.states += 1
        advance()
    keys: dict[type[Engine] | None, str] = {type(engine): key for key, engine in libraries.items()}
    for claim, unresolved in unresolved_by_claim(run.findings).items():
        if len(comparison.skipped) == comparison.states and CLAIMS[claim].asks == "acceleration":
            continue  # reported by `skipped`
        for one in unresolved:
            if (key := keys.get(one.finding.engine)) is not None:
                comparison.unresolved_entries.setdefault((key, claim), []).append(one)
    return comparison


def _refusals_text(refused: dict[str, str]) -> str:
    return "; ".join(f"{key}: {why}" for key, why in refused.items())


def _compare_at(
    comparison: LibraryComparison,
    libraries: dict[str, FileEngine],
    state: State,
    findings: Iterable[Finding],
) -> None:
    """Compare at one state, at which the claims have these findings."""
    scene = comparison.scene
    at = Evaluation(scene, *state)
    kinds: dict[type[Engine], str] = {type(engine): key for key, engine in libraries.items()}
    by_library = [(kinds[one.engine], one) for one in findings if one.engine in kinds]
    ours, summed = reference_quantities(comparison, at), summand_sizes(at)
    theirs = {
        key: library_quantities(comparison, key, engine, at, ours)
        for key, engine in libraries.items()
    }
    # Where rounding explains any difference, no number is shown.
    inconclusive = {
        (key, CLAIMS[one.claim].asks) for key, one in by_library if one.verdict == "inconclusive"
    }
    if "q̈" not in ours:
        inconclusive = {(key, method) for key, method in inconclusive if method != "acceleration"}
    comparison.inconclusive_counts.update(sorted(inconclusive))
    for name, method in QUANTITIES.items():
        sides = [ours.get(name)]
        sides += [
            None if (x, method) in inconclusive else answers.get(name)
            for x, answers in theirs.items()
        ]
        table = np.array([[relative_difference(x, y, summed[name]) for y in sides] for x in sides])
        comparison.differences[name] = np.fmax(comparison.differences.get(name, table), table)
    failed = set()
    for key, one in by_library:
        failed |= {key} if one.verdict == "failed" else set()
        if one.verdict == "skipped":
            continue
        comparison.decided[key] = comparison.decided.get(key, False) or one.verdict in DECIDED
        before = comparison.findings.get((key, one.claim), one)
        comparison.findings[key, one.claim] = worst((before, one))
    description = next(iter(libraries.values())).description
    if failed:
        own = RunSelection.of(["gw"], [], SELF_CHECKS, scenes=[scene])
        findings_of_own = ValidationRun().check_state(scene, state, own)
        comparison.self_failures += [one for one in findings_of_own if one.verdict == "failed"]
    for key, answers in theirs.items():
        if key not in failed or answers.keys() != ours.keys():
            continue
        discrepancy = Discrepancy(
            description,
            scene.coordinate_names,
            state.v,
            ours,
            answers,
            summed,
            libraries[key].free_base(*state[:2]),
        )
        for explanation in explain(discrepancy):
            if explanation not in comparison.explanations[key]:
                comparison.explanations[key].append(explanation)

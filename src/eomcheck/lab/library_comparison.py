"""Comparison of the libraries that read one robot description: differences and reasons.

`compare_libraries` draws random states of a URDF or MJCF file and evaluates M, bias, gravity,
forces and q̈ at each by eomcheck and by every library. The claims judge each difference against the
rounding error. A `LibraryComparison` holds a `LibraryResult` for each library (worst findings,
faults, and the explanations of `eomcheck.lab.discrepancy`), and the largest difference of any two
per quantity. A `LibraryReading` is the row of one robot and one library, in tables and in Records.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eomcheck import strategies
from eomcheck.atomic_write import write_text
from eomcheck.calls import call
from eomcheck.claims import CLAIMS
from eomcheck.claims.engine_quantities import CONFORMANCE
from eomcheck.claims.finding import (
    DECIDED,
    Finding,
    Unresolved,
    unresolved_by_claim,
    unresolved_finding,
    worst,
)
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.class_lookup import home_of_code
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.engines import (
    BY_FORMAT,
    Answers,
    Engine,
    EngineFault,
    FileEngine,
    asked_by_default,
    isolated_names,
    plain_name,
    reader_of,
    version_of,
)
from eomcheck.engines.answers import inertia_size, weight_size
from eomcheck.errors import EngineError, InputError, RefusedError, message_of
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.deviations import READING, Observation, differs_by, robot_of
from eomcheck.lab.discrepancy import Discrepancy, Explanation, explain, relative_scale
from eomcheck.lab.show.table import Cell, ResultTable, print_tables, say
from eomcheck.lab.store.record_file import group
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.safe_output import counted
from eomcheck.strategies import draw_samples

# ---- Quantities ----------------------------------------------------------------------------------


class ComparedQuantity(NamedTuple):
    """ComparedQuantity that is compared."""

    method: str
    """Method of an engine that returns it."""
    reference: Callable[[Evaluation], Array | None]
    """Its value by eomcheck; None where it vanishes."""
    summed: Callable[[Evaluation], float] = lambda at: 0.0
    """Size of the terms that a library may sum to it, 0 where the entries themselves count."""
    at_rest: bool = False
    """Whether it is evaluated at rest."""


def _weights(at: Evaluation) -> float:
    return at.cached(weight_size)


QUANTITIES = {
    "M": ComparedQuantity("mass_matrix", lambda at: at.terms.M),
    "bias": ComparedQuantity("bias", lambda at: at.terms.B, inertia_size),
    "gravity": ComparedQuantity("forces", lambda at: at.terms.Q, _weights, at_rest=True),
    "forces": ComparedQuantity("forces", lambda at: at.terms.Q, _weights),
    "q̈": ComparedQuantity("acceleration", lambda at: at.acceleration(FORMULATIONS["gw"]).vdot),
}
"""Name -> quantity; gravity is the forces at rest."""


def _difference(x: Array | None, y: Array | None) -> float:
    """Return the largest difference of two values, NaN where one is None."""
    return np.nan if x is None or y is None else largest(x - y)


class RunningDifference:
    """Differences of one quantity between all sides, over the states so far.

    Args:
        sides: number of sides, k.
    """

    def __init__(self, sides: int):
        self._apart = np.full((sides, sides), np.nan)
        self._sizes = np.full(sides, np.nan)
        self._summed = 0.0

    def add(self, values: Sequence[Array | None], summed: float = 0.0) -> None:
        """Take a state into account: the value of each side, None where it has none.

        Args:
            values: values of all sides.
            summed: size of the terms that a library may sum to the value.
        """
        apart = [[_difference(x, y) for y in values] for x in values]
        sizes = [np.nan if x is None else largest(x) for x in values]
        self._apart, self._sizes = np.fmax(self._apart, apart), np.fmax(self._sizes, sizes)
        self._summed = max(self._summed, summed)

    @property
    def relative(self) -> Array:
        """The largest difference of any two sides at any state (k, k), relative.

        To the largest entry of both over all states, see `relative_scale`: at one state entries may
        vanish, and their rounding errors do not. NaN where two sides never have a value together.
        """
        sizes = np.fmax(self._sizes[:, None], self._sizes)
        scales = np.array([[relative_scale(x, self._summed) for x in row] for row in sizes])
        return np.where(scales == 0.0, self._apart, self._apart / np.where(scales, scales, 1.0))


# ---- Results -------------------------------------------------------------------------------------

AGREES = "agrees", "agrees where decided"
OPEN = "inconclusive", "nothing compared", "no answer", "not installed"
"""Verdicts on libraries of which nothing is known."""


@dataclass(frozen=True)
class LibraryReading:
    """Row of one robot and one library: verdict, largest differences from eomcheck, and reasons.

    Attributes:
        robot: name of the robot.
        library: name and version, or the key of a library without an answer.
        verdict: a word or two.
        apart: quantity -> the largest relative difference at any state; empty without an answer.
        why: the known explanations of the differences, or the reason why there is no answer.
    """

    robot: str
    library: str
    verdict: str
    apart: dict[str, float]
    why: str

    @property
    def kind(self) -> str:
        """Kind of a cell with the verdict."""
        return "passed" if self.verdict in AGREES else "open" if self.verdict in OPEN else "failed"


@dataclass
class LibraryResult:
    """Result of one library for one robot: its findings and faults, or why there are none.

    Attributes:
        library: its key.
        version: its name and version, "" without an answer.
        refusal: the reason why it gave no answer, "" if it did.
        missing: whether it is not installed.
        engine: its model of the robot.
        findings: claim -> the worst finding.
        faults: quantity -> the first fault in place of an answer.
        explanations: known explanations of its differences.
        decided: whether any finding is more than inconclusive; None if nothing was compared.
        inconclusive_counts: method -> number of states in which rounding explains any difference.
        unresolved: claim -> entries that no state resolves.
        messages: its output while it read the file.
    """

    library: str
    version: str = ""
    refusal: str = ""
    missing: bool = False
    engine: FileEngine | None = None
    findings: dict[str, Finding] = field(default_factory=dict)
    faults: dict[str, str] = field(default_factory=dict)
    explanations: list[Explanation] = field(default_factory=list)
    decided: bool | None = None
    inconclusive_counts: Counter[str] = field(default_factory=Counter)
    unresolved: dict[str, list[Unresolved]] = field(default_factory=dict)
    messages: list[str] = field(default_factory=list)

    @property
    def failures(self) -> list[Finding]:
        """The findings of differences larger than rounding."""
        return [f for f in self.findings.values() if f.verdict == "failed"]

    @property
    def differs(self) -> bool:
        """Whether it differs, or does not answer everything."""
        return bool(self.failures or self.faults)

    @property
    def undecided_claims(self) -> list[str]:
        """The claims that are decided in no state."""
        return [key for key, u in self.unresolved.items() if any(not x.entry for x in u)]

    @property
    def verdict(self) -> str:
        """A word or two on the library."""
        if self.refusal:
            return "not installed" if self.missing else "no answer"
        if not self.differs:
            if not self.decided:
                return "nothing compared" if self.decided is None else "inconclusive"
            return "agrees where decided" if self.undecided_claims else "agrees"
        labels = [e.label for e in self.explanations]
        if self.unexplained:
            return "differs"
        return ", ".join(labels) if labels and all(labels) else "differs"

    @property
    def unexplained(self) -> list[str]:
        """Conformance quantities that differ, if no explanation is about such."""
        if any(e.of_quantities for e in self.explanations):
            return []
        return [CLAIMS[f.claim].asks for f in self.failures if f.claim in CONFORMANCE]

    @property
    def why(self) -> str:
        """The known explanations of its differences, or the reason why there is no answer."""
        known = "; ".join(e.sentence for e in self.explanations)
        if known and self.unexplained:
            known += f"; no reason known for {', '.join(self.unexplained)}"
        return self.refusal or known

    def add(self, finding: Finding) -> None:
        """Take a finding into account: of each claim the worst one is kept."""
        if finding.verdict != "skipped":
            self.decided = bool(self.decided) or finding.verdict in DECIDED
            before = self.findings.get(finding.claim, finding)
            self.findings[finding.claim] = worst((before, finding))

    def explain(self, explanations: Iterable[Explanation]) -> None:
        """Add explanations of differences, each once."""
        self.explanations += [e for e in explanations if e not in self.explanations]


@dataclass
class LibraryComparison:
    """Comparison of the libraries that read one robot.

    Attributes:
        scene: the robot, with the parameters of its file.
        libraries: key of a library -> its result.
        running: quantity -> differences of eomcheck and the libraries as in `answered`.
        states: number of states checked.
        skipped: reason why q̈ is not compared, once for each state in which it is not.
        self_failures: failures of the agreement of our two derivations, in states where a library
            differs.
        claims: ids of the claims that judge the libraries, all of them if there are none.
    """

    scene: Scene
    libraries: dict[str, LibraryResult] = field(default_factory=dict)
    running: dict[str, RunningDifference] = field(default_factory=dict)
    states: int = 0
    skipped: list[str] = field(default_factory=list)
    self_failures: list[Finding] = field(default_factory=list)
    claims: tuple[str, ...] = ()

    @property
    def quantities(self) -> dict[str, ComparedQuantity]:
        """Name -> quantity, those of `QUANTITIES` that a claim is about."""
        asked = {CLAIMS[claim].asks for claim in self.claims or comparable_claims()}
        return {name: q for name, q in QUANTITIES.items() if q.method in asked}

    @property
    def differences(self) -> dict[str, Array]:
        """Quantity -> `RunningDifference.relative`; eomcheck is the first side."""
        return {name: running.relative for name, running in self.running.items()}

    @property
    def answered(self) -> list[LibraryResult]:
        """The libraries that read the file."""
        return [r for r in self.libraries.values() if not r.refusal]

    @property
    def refused(self) -> list[LibraryResult]:
        """The libraries that gave no answer, or are not installed."""
        return [r for r in self.libraries.values() if r.refusal]

    @property
    def unanswered(self) -> list[str]:
        """The keys of libraries that are installed and gave no answer."""
        return [r.library for r in self.refused if not r.missing]

    @property
    def undecided_libraries(self) -> list[str]:
        """The keys of libraries that read the file and of which nothing is decided."""
        return [r.library for r in self.answered if not r.decided]

    @property
    def disagree(self) -> bool:
        """Whether a library that read the file differs, or does not answer everything."""
        return any(r.differs for r in self.answered) or bool(self.self_failures)

    @property
    def agree(self) -> bool:
        """Whether something was compared and decided, and nothing differs."""
        return not self.disagree and any(r.decided for r in self.answered)

    def check_decided(self) -> None:
        """Raise InputError if nothing differs and nothing is decided: that is no pass."""
        if not (self.disagree or self.agree):
            libraries = ", ".join(r.library for r in self.answered)
            raise InputError(f"{self.scene.name}: nothing was decided about {libraries}")

    def readings(self, robot: str) -> list[LibraryReading]:
        """Return the rows of all libraries, those without an answer last.

        Args:
            robot: name of the robot in them.
        """
        rows = []
        for i, result in enumerate(self.answered, 1):
            apart = {name: float(table[0, i]) for name, table in self.differences.items()}
            rows.append(LibraryReading(robot, result.version, result.verdict, apart, result.why))
        refused = (LibraryReading(robot, x.library, x.verdict, {}, x.why) for x in self.refused)
        return [*rows, *refused]


# ---- Comparing -----------------------------------------------------------------------------------

REFERENCE_NAME = "eomcheck"

SELF_CHECKS = "kinetic-energy", "power-balance"
"""Claims that compare our two derivations where a library differs from them."""


def readers(
    scene: Scene, names: Iterable[str] | None, isolated: bool = False
) -> dict[str, type[FileEngine]]:
    """Return the libraries of these names that read the file of a scene.

    A name is a key, or `FILE.py:CLASS` of a `FileEngine` of a user; None stands for all of
    `asked_by_default`. Optional libraries are `isolated` on demand, see `isolated_names`.

    Raises:
        InputError: the scene is no file, or has other parameters; or a class reads no such file.
        UnknownNameError: there is no library of a name.
    """
    if not (isinstance(scene, Mechanism) and scene.source.format and scene.as_described):
        raise InputError(f"{scene.name} is no robot as its file describes it")
    format = scene.source.format
    named = asked_by_default(BY_FORMAT[format]) if names is None else names
    if isolated:
        named = isolated_names(named)
    kinds = ((name, reader_of(scene, name)) for name in named)
    return {
        plain_name(name) if home_of_code(plain_name(name)) is None else kind.key: kind
        for name, kind in kinds
    }


def library_result(key: str, kind: type[FileEngine], scene: Scene, required: bool) -> LibraryResult:
    """Return the result of a library that has read the file of a scene, or why it cannot.

    Raises:
        EngineError: it is `required`, and not installed.
    """
    try:
        version = version_of(kind)
    except EngineError as error:
        if required:
            raise
        return LibraryResult(key, refusal=str(error), missing=True)
    try:
        engine = call(f"{kind.__name__}(scene)", kind, scene)
    except Exception as error:  # any error of a library at a file that it cannot read
        return LibraryResult(key, refusal=message_of(error))
    return LibraryResult(key, version, engine=engine, messages=engine.library_output)


def comparable_claims(names: Iterable[str] | None = None) -> tuple[str, ...]:
    """Return the ids of the claims that compare libraries, by default all.

    Raises:
        InputError: a claim compares no library, or there are no names.
        UnknownNameError: there is no claim of a name.
    """
    methods = {q.method for q in QUANTITIES.values()}
    terms = [claim.id for claim in CLAIMS.values() if claim.asks in methods]
    known = (*terms, *CONFORMANCE)
    return known if names is None else CLAIMS.chosen(names, known, "compares libraries")


def compare_libraries(
    scene: Scene,
    engines: Iterable[str] | None = None,
    states: int = 20,
    seed: int = 0,
    advance: Callable[[], None] = lambda: None,
    claims: Iterable[str] | None = None,
    isolated: bool = False,
) -> LibraryComparison:
    """Compare the equations of motion of the libraries that read the file of a scene.

    Args:
        scene: scene by `eomcheck.scenes.from_urdf` or `from_mjcf`.
        engines: keys of `eomcheck.engines.BY_FORMAT`; by default those of
            `asked_by_default` that are installed.
        states: number of random states.
        seed: seed of their draws.
        advance: called after each state.
        claims: ids of the claims that judge the libraries; by default all that compare them.
        isolated: whether optional libraries run in processes and environments of their own.

    Raises:
        InputError: the scene is no file, no library is left to compare with, or a claim compares
            none.
        EngineError: a library that was named is not installed.
        UnknownNameError: there is no library or claim of a name.
    """
    claim_ids = comparable_claims(claims)
    kinds, required = readers(scene, engines, isolated), engines is not None
    results = {key: library_result(key, kind, scene, required) for key, kind in kinds.items()}
    comparison = LibraryComparison(scene, results, claims=claim_ids)
    by_engine: dict[type[Engine], LibraryResult] = {
        type(r.engine): r for r in results.values() if r.engine is not None
    }
    if not by_engine:
        refusals = "; ".join(f"{r.library}: {r.refusal}" for r in results.values())
        raise InputError(f"nothing to compare {scene.name} with: {refusals}")
    run, selection = ValidationRun(), RunSelection.of(["gw"], by_engine, claim_ids, scenes=[scene])
    for state in draw_samples(strategies.states(scene), states, seed):
        _compare_at(comparison, state, run.check_state(scene, state, selection))
        comparison.states += 1
        advance()
    for claim, unresolved in unresolved_by_claim(run.findings).items():
        if len(comparison.skipped) == comparison.states and CLAIMS[claim].asks == "acceleration":
            continue  # reported by `skipped`
        for entry in unresolved:
            if (engine := entry.finding.engine) in by_engine:
                by_engine[engine].unresolved.setdefault(claim, []).append(entry)
    return comparison


def _compare_at(comparison: LibraryComparison, state: State, findings: list[Finding]) -> None:
    """Compare at one state, at which the claims have these findings."""
    scene = comparison.scene
    at = Evaluation(scene, *state)
    reference = reference_quantities(comparison, at)
    summed = {name: q.summed(at) for name, q in QUANTITIES.items()}
    sides, differ = [reference], False
    for result in comparison.answered:
        assert result.engine is not None
        own_findings = [finding for finding in findings if finding.engine is type(result.engine)]
        answers = library_quantities(result, at, reference, comparison.quantities)
        unsure = {CLAIMS[x.claim].asks for x in own_findings if x.verdict == "inconclusive"}
        unsure &= {quantity.method for quantity in QUANTITIES.values()}
        unsure -= {"acceleration"} if "q̈" not in reference else set()
        result.inconclusive_counts.update(unsure)
        # Where rounding explains any difference, no number is shown.
        sides.append({x: y for x, y in answers.items() if QUANTITIES[x].method not in unsure})
        for finding in own_findings:
            result.add(finding)
        if any(finding.verdict == "failed" for finding in own_findings):
            differ = True
            if answers.keys() == reference.keys():
                about = result.engine.description, scene.coordinate_names, state.v
                free = result.engine.free_base(state.q, state.v)
                reasons = explain(Discrepancy(*about, reference, answers, summed, free))
                terms = any(f.claim not in CONFORMANCE for f in result.failures)
                result.explain(e for e in reasons if terms or e.of_quantities)
    for name in comparison.quantities:
        running = comparison.running.setdefault(name, RunningDifference(len(sides)))
        running.add([side.get(name) for side in sides], summed[name])
    if differ:
        own = RunSelection.of(["gw"], [], SELF_CHECKS, scenes=[scene])
        findings_of_own = ValidationRun().check_state(scene, state, own)
        comparison.self_failures += [f for f in findings_of_own if f.verdict == "failed"]


def reference_quantities(comparison: LibraryComparison, at: Evaluation) -> dict[str, Array]:
    """Return the quantities by eomcheck; without q̈ where it is refused, and the reason is stored.

    With redundant constraints, or a singular M, there remain M, bias and forces to compare.
    """
    quantities, at_rest = {}, Evaluation(at.scene, at.q, np.zeros(at.scene.n), at.t)
    for name, quantity in QUANTITIES.items():
        try:
            value = quantity.reference(at_rest if quantity.at_rest else at)
        except RefusedError as refusal:
            if name in comparison.quantities:
                comparison.skipped.append(str(refusal))
        else:
            quantities[name] = np.zeros(at.scene.n) if value is None else value
    return quantities


def library_quantities(
    result: LibraryResult, at: Evaluation, names: Iterable[str], judged: Collection[str]
) -> dict[str, Array]:
    """Return the answers of a library by quantity.

    Faults in the quantities that are `judged` are added to `result`; the other ones are asked for
    the sake of explanations.
    """
    assert result.engine is not None
    answers, zero, quantities = Answers(result.engine), np.zeros(at.scene.n), {}
    for name in names:
        quantity = QUANTITIES[name]
        inputs = (zero, at.terms.a, at.terms.gamma) if quantity.method == "acceleration" else ()
        try:
            answer = answers.ask(
                quantity.method, at.q, zero if quantity.at_rest else at.v, *inputs, at.t
            )
        except EngineFault as fault:
            if name not in judged:
                continue
            result.faults.setdefault(name, fault.what)
            first = result.faults[name]
            result.explain([Explanation(f"gives no {name}: {first}", f"no {name}")])
        else:
            quantities[name] = answer.vdot if name == "q̈" else answer
    return quantities


def comparison_observations(comparison: LibraryComparison) -> Iterator[Observation]:
    """Yield the observations of a comparison: of quantities, of faults and of unread files."""
    robot = robot_of(comparison.scene)
    for result in comparison.libraries.values():
        if not result.missing:
            yield Observation(result.library, READING, robot, bool(result.refusal), result.refusal)
        faults = {QUANTITIES[name].method: what for name, what in result.faults.items()}
        for method, what in faults.items():
            yield Observation(result.library, method, robot, True, what)
        for claim, finding in result.findings.items():
            method = CLAIMS[claim].asks
            if method not in faults:
                differs = differs_by(finding.verdict)
                yield Observation(result.library, method, robot, differs, finding.detail)


# ---- Tables and JSON -----------------------------------------------------------------------------

NOBODY = (
    "The two derivations of eomcheck agree in these states, but share one reading of the file: "
    "either reading may be wrong."
)

MOST_LINES = 4
"""Largest number of lines quoted of a library's messages on reading a file."""


def _cell(x: float) -> str:
    return "-" if math.isnan(x) else f"{x:.0e}" if x else "0"


def library_table(comparison: LibraryComparison) -> ResultTable:
    """Return the table of libraries: their largest differences from eomcheck, and the verdict."""
    rows = []
    results = [*comparison.answered, *comparison.refused]
    others = ["others"] if quantity_table(comparison) else []
    for result, row in zip(results, comparison.readings(comparison.scene.name), strict=True):
        apart = [
            Cell("fault", "failed") if name in result.faults else _cell(row.apart.get(name, np.nan))
            for name in comparison.differences
        ]
        shares = [_share_that_agrees(result) for _ in others]
        rows.append([Cell(row.library, "name"), *apart, *shares, Cell(row.verdict, row.kind)])
    size = counted(comparison.scene.n, "coordinate"), counted(comparison.states, "state")
    title = f"{comparison.scene.name}: {', '.join(size)}"
    heads = ["library", *comparison.differences, *others, "verdict"]
    note = (
        "Largest difference from eomcheck, relative to the largest entry over all states; where "
        "entries cancel to less than a thousandth of the terms that they are summed from, to these."
    )
    if others:
        note += " others: quantities that agree, of those that the library has; each by --wide."
    return ResultTable("libraries", title, heads, rows, note=note)


def _share_that_agrees(result: LibraryResult) -> str:
    """Return of how many conformance quantities that a library has it agrees: "14 of 17"."""
    found = [result.findings[claim].verdict for claim in CONFORMANCE if claim in result.findings]
    return f"{found.count('passed')} of {len(found)}" if found else "-"


def quantity_table(comparison: LibraryComparison, wide: bool = True) -> ResultTable | None:
    """Return the table of conformance quantities by library; None if no library has any.

    Args:
        comparison: the comparison.
        wide: whether it has quantities on which all libraries agree, too.
    """
    rows = []
    for claim in CONFORMANCE:
        found = [result.findings.get(claim) for result in comparison.answered]
        if any(one is not None and (wide or one.verdict != "passed") for one in found):
            rows.append([Cell(CLAIMS[claim].asks, "name"), *map(_quantity_cell, found)])
    heads = ["quantity", *(result.library for result in comparison.answered)]
    return ResultTable("quantities", "Other quantities", heads, rows) if rows else None


def _quantity_cell(finding: Finding | None) -> Cell:
    """Return the cell of the worst finding on a quantity of a library."""
    if finding is None:
        return Cell("-", "none")
    if finding.verdict == "passed":
        return Cell("agrees", "passed")
    return (
        Cell("differs", "failed") if finding.verdict == "failed" else Cell("inconclusive", "open")
    )


def pair_tables(comparison: LibraryComparison) -> Iterator[ResultTable]:
    """Yield one table per quantity: libraries × libraries, their largest difference."""
    names = [REFERENCE_NAME, *(r.library for r in comparison.answered)]
    for quantity, table in comparison.differences.items():
        rows = [
            [Cell(name, "name"), *(_cell(x) if i != j else "" for j, x in enumerate(row))]
            for i, (name, row) in enumerate(zip(names, table, strict=True))
        ]
        yield ResultTable(
            quantity, f"{quantity}, each library beside each other", ["library", *names], rows
        )


def claimwise(comparison: LibraryComparison, name: str) -> Iterator[tuple[LibraryResult, str, Any]]:
    """Yield library, claim and value of a dictionary of all libraries, claim by claim."""
    for claim in dict.fromkeys(key for r in comparison.answered for key in getattr(r, name)):
        for result in comparison.answered:
            if claim in getattr(result, name):
                yield result, claim, getattr(result, name)[claim]


def comparison_headline(comparison: LibraryComparison) -> str:
    """Return the verdict in one sentence; empty where nothing was decided."""
    if comparison.disagree:
        differing = group([r for r in comparison.answered if r.differs], lambda r: r.verdict)
        if not differing:
            return "the two derivations of eomcheck differ from each other"
        names = (
            ", ".join(r.library for r in alike) + ("" if verdict == "differs" else f" ({verdict})")
            for verdict, alike in differing.items()
        )
        count = sum(map(len, differing.values()))
        of = f"{count} of {counted(len(comparison.answered), 'library')}"
        return f"{of} {'differs' if count == 1 else 'differ'}: {'; '.join(names)}"
    if not comparison.agree:
        return ""
    undecided = ", ".join(comparison.undecided_libraries)
    who = "all others" if undecided else "all that answered"
    where = " where decided" if any(r.undecided_claims for r in comparison.answered) else ""
    parts = [f"{who} agree to rounding{where}", f"{undecided} undecided" if undecided else ""]
    parts.append("without q̈" if len(comparison.skipped) >= comparison.states else "")
    return ", ".join(filter(None, parts))


def differences_in_words(comparison: LibraryComparison) -> Iterator[str]:
    """Yield sentences on each library that differs: where, and why."""
    for result in comparison.answered:
        if result.differs:
            where = "; ".join(map(_located, result.failures)) or "where it answers, it agrees"
            yield f"{result.version} differs: {where}. Why: {result.why or 'no reason known'}."
            if result.messages:
                more = len(result.messages) - MOST_LINES
                quoted = " / ".join(result.messages[:MOST_LINES])
                yield f"    Its message: {quoted}" + (
                    f" (and {counted(more, 'line')} more)" if more > 0 else ""
                )
    if comparison.self_failures:
        largest_error = max(comparison.self_failures, key=lambda f: f.ratio)
        yield f"The two derivations of eomcheck differ from each other: {largest_error.detail}"
    elif any(r.failures for r in comparison.answered):
        yield NOBODY


def limits_in_words(comparison: LibraryComparison) -> Iterator[str]:
    """Yield sentences on what was not decided, and on libraries that gave no answer."""
    for result, claim, unresolved in claimwise(comparison, "unresolved"):
        yield f"{result.version}: {claim} is {unresolved_finding(unresolved).detail}"
    by_library = sorted(comparison.answered, key=lambda r: r.library)
    counts = [(r.library, x) for r in by_library for x in sorted(r.inconclusive_counts.items())]
    for (method, count), alike in group(counts, lambda entry: entry[1]).items():
        names = " and ".join(name for name, q in QUANTITIES.items() if q.method == method)
        where = f"inconclusive in {count} of {counted(comparison.states, 'state')}"
        libraries = ", ".join(library for library, _ in alike)
        yield f"{names} of {libraries}: {where}, rounding explains any difference there"
    if comparison.skipped:
        where = f"{len(comparison.skipped)} of {counted(comparison.states, 'state')}"
        yield f"q̈ is not compared in {where}: {comparison.skipped[0]}"
    for result in comparison.refused:
        how = "was left out" if result.missing else "gave no answer"
        yield f"{result.library} {how}: {result.refusal}"


def _located(finding: Finding) -> str:
    """Return the detail of a finding, with the frame that its subject names behind the engine."""
    frame = finding.subject.partition(", ")[2] if finding.claim in CONFORMANCE else ""
    return f"{finding.detail} [{frame}]" if frame else finding.detail


def print_comparison(
    comparison: LibraryComparison, pairs: bool = False, wide: bool = False
) -> None:
    """Print the verdict, then what differs, then tables.

    Args:
        comparison: the comparison.
        pairs: whether tables of each library beside each other are printed.
        wide: whether quantities on which all libraries agree have rows of their own.
    """
    if verdict := comparison_headline(comparison):
        say(verdict, "bold red" if comparison.disagree else "bold green")
    for sentence in differences_in_words(comparison):
        say(sentence)
    more = quantity_table(comparison, wide)
    tables = [library_table(comparison), *([] if more is None else [more])]
    print_tables([*tables, *(pair_tables(comparison) if pairs else ())])
    for sentence in limits_in_words(comparison):
        say(sentence)


def write_comparison(comparison: LibraryComparison, path: Path) -> None:
    """Write the whole comparison as JSON."""
    answered = comparison.answered
    plain = {
        "scene": comparison.scene.name,
        "coordinates": list(comparison.scene.coordinate_names),
        "states": comparison.states,
        "versions": {r.library: r.version for r in answered},
        "refused": {r.library: r.refusal for r in comparison.refused},
        "libraries": [REFERENCE_NAME, *(r.library for r in answered)],
        "apart": {
            name: [[x if math.isfinite(x) else None for x in row] for row in table.tolist()]
            for name, table in comparison.differences.items()
        },
        "decided": {r.library: bool(r.decided) for r in answered},
        "faults": [[r.library, *fault] for r in answered for fault in r.faults.items()],
        "findings": [finding.as_dict() for *_, finding in claimwise(comparison, "findings")],
        "why": {r.library: [x.sentence for x in r.explanations] for r in answered},
        "said": {r.library: r.messages for r in answered},
        "hidden": [
            [r.library, claim, unresolved_finding(u).detail]
            for r, claim, u in claimwise(comparison, "unresolved")
        ],
        "skipped": comparison.skipped,
        "own": [f.as_dict() for f in comparison.self_failures],
    }
    write_text(path, json.dumps(plain, ensure_ascii=False, indent=1) + "\n")

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
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eomcheck import strategies
from eomcheck.atomic_write import write_text
from eomcheck.calls import call
from eomcheck.claims import CLAIMS
from eomcheck.claims.finding import (
    DECIDED,
    Finding,
    Unresolved,
    unresolved_by_claim,
    unresolved_finding,
    worst,
)
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.console import console
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.engines import BY_FORMAT, Answers, Engine, EngineFault, FileEngine, version_of
from eomcheck.engines.answers import inertia_size, weight_size
from eomcheck.errors import EngineError, InputError, RefusedError, UnknownNameError, message_of
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.discrepancy import Discrepancy, Explanation, explain, relative_scale
from eomcheck.lab.show.table import Cell, ResultTable, print_tables, say
from eomcheck.lab.store.record_file import group
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.safe_output import counted
from eomcheck.strategies import draw_samples

# ---- Quantities ----------------------------------------------------------------------------------


class Quantity(NamedTuple):
    """Quantity that is compared."""

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
    "M": Quantity("mass_matrix", lambda at: at.terms.M),
    "bias": Quantity("bias", lambda at: at.terms.B, inertia_size),
    "gravity": Quantity("forces", lambda at: at.terms.Q, _weights, at_rest=True),
    "forces": Quantity("forces", lambda at: at.terms.Q, _weights),
    "q̈": Quantity("acceleration", lambda at: at.acceleration(FORMULATIONS["gw"]).vdot),
}
"""Name -> quantity; gravity is the forces at rest."""


def relative_difference(x: Array | None, y: Array | None, summed: float = 0.0) -> float:
    """Return the largest difference, relative, see `relative_scale`; NaN where a value is None."""
    if x is None or y is None:
        return np.nan
    scale = relative_scale(max(largest(x), largest(y)), summed)
    return largest(x - y) / scale if scale > 0 else 0.0


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
        return [one for one in self.findings.values() if one.verdict == "failed"]

    @property
    def differs(self) -> bool:
        """Whether it differs, or does not answer everything."""
        return bool(self.failures or self.faults)

    @property
    def undecided_claims(self) -> list[str]:
        """The claims that are decided in no state."""
        return [key for key, left in self.unresolved.items() if any(not x.entry for x in left)]

    @property
    def verdict(self) -> str:
        """A word or two on the library."""
        if self.refusal:
            return "not installed" if self.missing else "no answer"
        if not self.differs:
            if not self.decided:
                return "nothing compared" if self.decided is None else "inconclusive"
            return "agrees where decided" if self.undecided_claims else "agrees"
        labels = [one.label for one in self.explanations]
        return ", ".join(labels) if labels and all(labels) else "differs"

    @property
    def why(self) -> str:
        """The known explanations of its differences, or the reason why there is no answer."""
        return self.refusal or "; ".join(one.sentence for one in self.explanations)

    def add(self, finding: Finding) -> None:
        """Take a finding into account: of each claim the worst one is kept."""
        if finding.verdict != "skipped":
            self.decided = bool(self.decided) or finding.verdict in DECIDED
            before = self.findings.get(finding.claim, finding)
            self.findings[finding.claim] = worst((before, finding))

    def explain(self, explanations: Iterable[Explanation]) -> None:
        """Add explanations of differences, each once."""
        self.explanations += [one for one in explanations if one not in self.explanations]


@dataclass
class LibraryComparison:
    """Comparison of the libraries that read one robot.

    Attributes:
        scene: the robot, with the parameters of its file.
        libraries: key of a library -> its result.
        differences: quantity -> the largest difference of any two at any state (k, k), relative to
            the largest entry; eomcheck first, then the libraries as in `answered`.
        states: number of states checked.
        skipped: reason why q̈ is not compared, once for each state in which it is not.
        self_failures: failures of the agreement of our two derivations, in states where a library
            differs.
    """

    scene: Scene
    libraries: dict[str, LibraryResult] = field(default_factory=dict)
    differences: dict[str, Array] = field(default_factory=dict)
    states: int = 0
    skipped: list[str] = field(default_factory=list)
    self_failures: list[Finding] = field(default_factory=list)

    @property
    def answered(self) -> list[LibraryResult]:
        """The libraries that read the file."""
        return [one for one in self.libraries.values() if not one.refusal]

    @property
    def refused(self) -> list[LibraryResult]:
        """The libraries that gave no answer, or are not installed."""
        return [one for one in self.libraries.values() if one.refusal]

    @property
    def unanswered(self) -> list[str]:
        """The keys of libraries that are installed and gave no answer."""
        return [one.library for one in self.refused if not one.missing]

    @property
    def undecided_libraries(self) -> list[str]:
        """The keys of libraries that read the file and of which nothing is decided."""
        return [one.library for one in self.answered if not one.decided]

    @property
    def disagree(self) -> bool:
        """Whether a library that read the file differs, or does not answer everything."""
        return any(one.differs for one in self.answered) or bool(self.self_failures)

    @property
    def agree(self) -> bool:
        """Whether something was compared and decided, and nothing differs."""
        return not self.disagree and any(one.decided for one in self.answered)

    def check_decided(self) -> None:
        """Raise InputError if nothing differs and nothing is decided: that is no pass."""
        if not (self.disagree or self.agree):
            libraries = ", ".join(one.library for one in self.answered)
            raise InputError(f"{self.scene.name}: nothing was decided about {libraries}")

    def readings(self, robot: str) -> list[LibraryReading]:
        """Return the rows of all libraries, those without an answer last.

        Args:
            robot: name of the robot in them.
        """
        rows = []
        for i, one in enumerate(self.answered, 1):
            apart = {name: float(table[0, i]) for name, table in self.differences.items()}
            rows.append(LibraryReading(robot, one.version, one.verdict, apart, one.why))
        refused = (LibraryReading(robot, x.library, x.verdict, {}, x.why) for x in self.refused)
        return [*rows, *refused]


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
    kinds, required = readers(scene, engines), engines is not None
    read = {key: library_result(key, kind, scene, required) for key, kind in kinds.items()}
    comparison = LibraryComparison(scene, read)
    by_engine: dict[type[Engine], LibraryResult] = {
        type(one.engine): one for one in read.values() if one.engine is not None
    }
    if not by_engine:
        refusals = "; ".join(f"{one.library}: {one.refusal}" for one in read.values())
        raise InputError(f"nothing to compare {scene.name} with: {refusals}")
    methods = {one.method for one in QUANTITIES.values()}
    claim_ids = [one.id for one in CLAIMS.values() if one.asks in methods]
    run, selection = ValidationRun(), RunSelection.of(["gw"], by_engine, claim_ids, scenes=[scene])
    for state in draw_samples(strategies.states(scene), states, seed):
        _compare_at(comparison, state, run.check_state(scene, state, selection))
        comparison.states += 1
        advance()
    for claim, unresolved in unresolved_by_claim(run.findings).items():
        if len(comparison.skipped) == comparison.states and CLAIMS[claim].asks == "acceleration":
            continue  # reported by `skipped`
        for one in unresolved:
            if (engine := one.finding.engine) in by_engine:
                by_engine[engine].unresolved.setdefault(claim, []).append(one)
    return comparison


def _compare_at(comparison: LibraryComparison, state: State, findings: list[Finding]) -> None:
    """Compare at one state, at which the claims have these findings."""
    scene = comparison.scene
    at = Evaluation(scene, *state)
    ours = reference_quantities(comparison, at)
    summed = {name: one.summed(at) for name, one in QUANTITIES.items()}
    sides, differ = [ours], False
    for one in comparison.answered:
        assert one.engine is not None
        mine = [finding for finding in findings if finding.engine is type(one.engine)]
        theirs = library_quantities(one, at, ours)
        unsure = {CLAIMS[x.claim].asks for x in mine if x.verdict == "inconclusive"}
        unsure -= {"acceleration"} if "q̈" not in ours else set()
        one.inconclusive_counts.update(unsure)
        # Where rounding explains any difference, no number is shown.
        sides.append({x: y for x, y in theirs.items() if QUANTITIES[x].method not in unsure})
        for finding in mine:
            one.add(finding)
        if any(finding.verdict == "failed" for finding in mine):
            differ = True
            if theirs.keys() == ours.keys():
                about = one.engine.description, scene.coordinate_names, state.v
                free = one.engine.free_base(state.q, state.v)
                one.explain(explain(Discrepancy(*about, ours, theirs, summed, free)))
    for name, size in summed.items():
        values = [side.get(name) for side in sides]
        table = np.array([[relative_difference(x, y, size) for y in values] for x in values])
        comparison.differences[name] = np.fmax(comparison.differences.get(name, table), table)
    if differ:
        own = RunSelection.of(["gw"], [], SELF_CHECKS, scenes=[scene])
        findings_of_own = ValidationRun().check_state(scene, state, own)
        comparison.self_failures += [one for one in findings_of_own if one.verdict == "failed"]


def reference_quantities(comparison: LibraryComparison, at: Evaluation) -> dict[str, Array]:
    """Return the quantities by eomcheck; without q̈ where it is refused, and the reason is stored.

    With redundant constraints, or a singular M, there remain M, bias and forces to compare.
    """
    ours, rest = {}, Evaluation(at.scene, at.q, np.zeros(at.scene.n), at.t)
    for name, one in QUANTITIES.items():
        try:
            value = one.reference(rest if one.at_rest else at)
        except RefusedError as refusal:
            comparison.skipped.append(str(refusal))
        else:
            ours[name] = np.zeros(at.scene.n) if value is None else value
    return ours


def library_quantities(
    result: LibraryResult, at: Evaluation, names: Iterable[str]
) -> dict[str, Array]:
    """Return the answers of a library by quantity; its faults are added to `result`."""
    assert result.engine is not None
    answers, zero, quantities = Answers(result.engine), np.zeros(at.scene.n), {}
    for name in names:
        one = QUANTITIES[name]
        given = (zero, at.terms.a, at.terms.gamma) if one.method == "acceleration" else ()
        try:
            answer = answers.ask(one.method, at.q, zero if one.at_rest else at.v, *given, at.t)
        except EngineFault as fault:
            result.faults.setdefault(name, fault.what)
            first = result.faults[name]
            result.explain([Explanation(f"gives no {name}: {first}", f"no {name}")])
        else:
            quantities[name] = answer.vdot if name == "q̈" else answer
    return quantities


# ---- Tables and JSON -----------------------------------------------------------------------------

NOBODY = (
    "The two derivations of eomcheck agree in these states, but share one reading of the file: "
    "either reading may be wrong."
)

MOST_LINES = 4
"""Largest number of lines quoted of a library's messages on reading a file."""


def _cell(x: float) -> str:
    return "-" if math.isnan(x) else f"{x:.0e}" if x else "0"


def library_table(found: LibraryComparison) -> ResultTable:
    """Return the table of libraries: their largest differences from eomcheck, and the verdict."""
    rows = []
    results = [*found.answered, *found.refused]
    for one, row in zip(results, found.readings(found.scene.name), strict=True):
        apart = [
            Cell("fault", "failed") if name in one.faults else _cell(row.apart.get(name, np.nan))
            for name in found.differences
        ]
        rows.append([Cell(row.library, "name"), *apart, Cell(row.verdict, row.kind)])
    size = counted(found.scene.n, "coordinate"), counted(found.states, "state")
    title = f"{found.scene.name}: {', '.join(size)}"
    heads = ["library", *found.differences, "verdict"]
    note = (
        "Largest difference from eomcheck, relative to the largest entry; where entries cancel to "
        "less than a thousandth of the terms that they are summed from, to these."
    )
    return ResultTable("libraries", title, heads, rows, note=note)


def pair_tables(found: LibraryComparison) -> Iterator[ResultTable]:
    """Yield one table per quantity: libraries × libraries, their largest difference."""
    names = [REFERENCE_NAME, *(one.library for one in found.answered)]
    for quantity, table in found.differences.items():
        rows = [
            [Cell(name, "name"), *(_cell(x) if i != j else "" for j, x in enumerate(row))]
            for i, (name, row) in enumerate(zip(names, table, strict=True))
        ]
        yield ResultTable(
            quantity, f"{quantity}, each library beside each other", ["library", *names], rows
        )


def claimwise(found: LibraryComparison, name: str) -> Iterator[tuple[LibraryResult, str, Any]]:
    """Yield library, claim and value of a dictionary of all libraries, claim by claim."""
    for claim in dict.fromkeys(key for one in found.answered for key in getattr(one, name)):
        for one in found.answered:
            if claim in getattr(one, name):
                yield one, claim, getattr(one, name)[claim]


def sentences(found: LibraryComparison) -> Iterator[str]:
    """Yield sentences on each library that differs or gave no answer."""
    for one in found.answered:
        if one.differs:
            where = "; ".join(x.detail for x in one.failures) or "where it answers, it agrees"
            yield f"{one.version} differs: {where}. Why: {one.why or 'no reason known'}."
            if one.messages:
                more = len(one.messages) - MOST_LINES
                quoted = " / ".join(one.messages[:MOST_LINES])
                yield f"    It said: {quoted}" + (
                    f" (and {counted(more, 'line')} more)" if more > 0 else ""
                )
    for one, claim, left in claimwise(found, "unresolved"):
        yield f"{one.version}: {claim} is {unresolved_finding(left).detail}"
    if found.self_failures:
        largest_error = max(found.self_failures, key=lambda one: one.ratio)
        yield f"The two derivations of eomcheck differ from each other: {largest_error.detail}"
    elif any(one.failures for one in found.answered):
        yield NOBODY
    by_library = sorted(found.answered, key=lambda one: one.library)
    counts = [
        (one.library, x) for one in by_library for x in sorted(one.inconclusive_counts.items())
    ]
    for (method, count), alike in group(counts, lambda one: one[1]).items():
        names = " and ".join(name for name, one in QUANTITIES.items() if one.method == method)
        where = f"inconclusive in {count} of {counted(found.states, 'state')}"
        libraries = ", ".join(library for library, _ in alike)
        yield f"{names} of {libraries}: {where}, rounding explains any difference there"
    if found.skipped:
        where = f"{len(found.skipped)} of {counted(found.states, 'state')}"
        yield f"q̈ is not compared in {where}: {found.skipped[0]}"
    for one in found.refused:
        yield f"{one.library} {'was left out' if one.missing else 'gave no answer'}: {one.refusal}"


def print_comparison(found: LibraryComparison, pairs: bool = False) -> None:
    """Print the differences of libraries from eomcheck and, on demand, from each other."""
    print_tables([library_table(found), *(pair_tables(found) if pairs else ())])
    for sentence in sentences(found):
        say(sentence)
    if found.agree:
        undecided = ", ".join(found.undecided_libraries)
        who = "all others" if undecided else "all that answered"
        where = " where decided" if any(one.undecided_claims for one in found.answered) else ""
        parts = [f"{who} agree to rounding{where}", f"{undecided} undecided" if undecided else ""]
        parts.append("without q̈" if len(found.skipped) >= found.states else "")
        console.print(", ".join(filter(None, parts)))


def write_comparison(found: LibraryComparison, path: Path) -> None:
    """Write the whole comparison as JSON."""
    answered = found.answered
    plain = {
        "scene": found.scene.name,
        "coordinates": list(found.scene.coordinate_names),
        "states": found.states,
        "versions": {one.library: one.version for one in answered},
        "refused": {one.library: one.refusal for one in found.refused},
        "libraries": [REFERENCE_NAME, *(one.library for one in answered)],
        "apart": {
            name: [[x if math.isfinite(x) else None for x in row] for row in table.tolist()]
            for name, table in found.differences.items()
        },
        "decided": {one.library: bool(one.decided) for one in answered},
        "faults": [[one.library, *fault] for one in answered for fault in one.faults.items()],
        "findings": [finding.as_dict() for *_, finding in claimwise(found, "findings")],
        "why": {one.library: [x.sentence for x in one.explanations] for one in answered},
        "said": {one.library: one.messages for one in answered},
        "hidden": [
            [one.library, claim, unresolved_finding(left).detail]
            for one, claim, left in claimwise(found, "unresolved")
        ],
        "skipped": found.skipped,
        "own": [one.as_dict() for one in found.self_failures],
    }
    write_text(path, json.dumps(plain, ensure_ascii=False, indent=1) + "\n")

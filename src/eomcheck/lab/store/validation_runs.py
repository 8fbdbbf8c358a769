"""Validation runs of scene classes, and their findings stored as plain data.

A `StoredFinding` is a Finding as plain data, written into Records and read back: one Record per
state checked, or per structure proved. A file holds the last validation of each scene class; it is
saved state by state, or class by class if there are several, and a Record of the run itself holds
its options and whether it was completed.

Several classes are run in parallel class by class, one class state by state; the findings do not
depend on the number of processes. `ValidationWriter` writes them to the file of Records, in place
of an earlier run of the class.
"""

from __future__ import annotations

import json
import os
import pickle
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache, lru_cache, partial
from operator import attrgetter
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

from eomcheck.calls import call, is_ours
from eomcheck.claims.finding import Finding, Proof, Verdict, comparison_text, ratio
from eomcheck.claims.reproducer import reproducer_of
from eomcheck.claims.run import (
    Cases,
    RunSelection,
    SceneEngines,
    StateResult,
    StateResults,
    ValidationRun,
    evaluate_state,
    make_scene_engines,
    repeats_at,
)
from eomcheck.deprecated import current
from eomcheck.draws.pairwise_design import link_count
from eomcheck.engines import Engine, version_of
from eomcheck.errors import UnwrittenError, described_error
from eomcheck.lab.store.parallel_map import parallel_map
from eomcheck.lab.store.record_file import Record, Records
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.mechanics.sketch import Sketch, sketch_of_text, sketch_text
from eomcheck.scene_lookup import scene_classes_named

COLUMNS = (
    *("claim", "subject", "observed", "allowed", "verdict", "evidence", "detail"),
    *("digits", "proof"),
)


@dataclass(frozen=True)
class StoredFinding:
    """A Finding in plain data, as it is stored and shown, with its scene and state.

    Attributes:
        scene: key of the scene class.
        links: its number of links, or None.
        case: number of the state in its run; None for a proof, which is about all states.
        structure: structure of the scene that a proof is about, "" for a state.
        python: code that reproduces the state, or proves the structure again.
        pose: names of the coordinates and the sketch of a failing state, or of the first one of a
            run, as `pose_text` makes it; "" otherwise.

    The other attributes are those of `Finding`.
    """

    claim: str
    subject: str
    observed: float
    allowed: float
    verdict: str
    evidence: str
    detail: str
    digits: float | None
    proof: Proof | None
    scene: str
    links: int | None
    case: int | None
    structure: str
    python: str
    pose: str = ""

    @classmethod
    def read(cls, row: dict[str, Any]) -> StoredFinding:
        """Return the finding that `dataclasses.asdict` and then JSON made into `row`."""
        row = dict(row) | {name: current(row[name]) for name in ("verdict", "evidence")}
        if row["proof"] is not None:
            row["proof"] = Proof(**row["proof"] | {"primes": tuple(row["proof"]["primes"])})
        return cls(**row)

    @property
    def ratio(self) -> float:
        """Ratio observed / allowed."""
        return ratio(self.observed, self.allowed)

    @property
    def level(self) -> str:
        """Level of the evidence: proved, enclosed, property-tested, compared."""
        return self.evidence.partition(":")[0]

    @property
    def location(self) -> str:
        """Scene and state, such as "snake, N = 7, state 12" or "snake[7], no stiffness"."""
        if self.case is None:
            return self.structure
        links = "" if self.links is None else f", N = {self.links}"
        return f"{self.scene}{links}, state {self.case}"

    def __str__(self) -> str:
        """Return the finding in a line, without its claim."""
        about = f"[{self.subject}] {self.verdict} on {self.location} ({self.evidence}): "
        if self.verdict == "skipped":
            return about + self.detail  # it has no numbers
        return about + comparison_text(self.observed, self.allowed, self.detail)


# ---- Findings in Records -------------------------------------------------------------------------

STATES = "validation"
RUNS = "validation run"
PROOFS = "proof"


_columns = attrgetter(*COLUMNS)  # the first fields of `StoredFinding`, in this order


def stored_findings(
    findings: Sequence[Finding], key: str, case: int | None = None
) -> list[StoredFinding]:
    """Return the Findings of one state, or those of one structure, in plain data.

    Args:
        findings: the Findings, at least one.
        key: key of the scene class.
        case: number of the state in its run; None for a structure.
    """
    scene, state = findings[0].scene, findings[0].state
    engines = dict.fromkeys(one.engine for one in findings if one.engine is not None)
    details = " ".join(one.detail for one in findings)
    code = reproducer_of(details, scene, state, engines)
    where = {
        "scene": key,
        "links": link_count(scene),
        "case": case,
        "structure": scene.structure if case is None else "",
        # A Finding about a row of a file has code of its own.
        "python": findings[0].as_python() if len(findings) == 1 else code,
    }
    if case == 0 or any(one.verdict == "failed" for one in findings):
        where["pose"] = pose_text(scene, state)
    return [StoredFinding(*_columns(one), **where) for one in findings]


def pose_text(scene: Any, state: State | None) -> str:
    """Return the names of the coordinates and the sketch of a scene in a state, as JSON.

    Returns:
        "" without a state, without a sketch, or if the scene cannot draw this state.
    """
    if state is None or not isinstance(scene, Scene):
        return ""
    try:
        sketch = call(f"{scene.key}.sketch", scene.sketch, state.q, state.t)
        return (
            "" if sketch is None else json.dumps([[*scene.coordinate_names], sketch_text(sketch)])
        )
    except Exception:  # a user's function, beside the claim that fails
        return ""


def pose_of(text: str) -> tuple[list[str], Sketch]:
    """Return the names of the coordinates and the sketch of which `pose_text` made a text.

    Raises:
        LookupError, TypeError, ValueError: it is no such text.
    """
    names, sketch = json.loads(text)
    return names, sketch_of_text(sketch)


def cases_of(run: ValidationRun, begin: int = 0) -> Iterator[list[Finding]]:
    """Yield the Findings of each completed state of a run, from the Finding number `begin` on."""
    for end in run.ends[bisect_right(run.ends, begin) :]:
        if end > begin:
            yield run.findings[begin:end]
        begin = end


def stored_findings_of_runs(runs: Mapping[str, ValidationRun]) -> list[StoredFinding]:
    """Return every Finding of finished runs, in plain data; `runs` is by keys of scene classes."""
    stored: list[StoredFinding] = []
    for key, run in runs.items():
        last = run.ends[-1] if run.ends else 0
        cases = [*cases_of(run), *([one] for one in run.findings[last:])]
        stored += [
            finding for case, one in enumerate(cases) for finding in stored_findings(one, key, case)
        ]
    return stored


def findings_record(kept: Sequence[StoredFinding]) -> Record:
    """Return the Record of the findings of one state or structure."""
    series = {name: [getattr(one, name) for one in kept] for name in COLUMNS}
    series["proof"] = [None if proof is None else asdict(proof) for proof in series["proof"]]
    first = kept[0]
    where = {"case": first.case} if first.case is not None else {"structure": first.structure}
    settings = {"scene": first.scene, "links": first.links} | where
    study = PROOFS if first.case is None else STATES
    pose = {"pose": [first.pose]} if first.pose else {}
    return Record(study, settings, series=series | {"python": [first.python]} | pose)


def stored_findings_in(records: Iterable[Record]) -> list[StoredFinding]:
    """Return every Finding in these Records."""
    return [
        finding
        for record in records
        if record.study in (STATES, PROOFS)
        for finding in _kept(record)
    ]


@cache
def _types_of(kind: type) -> dict[str, Any]:
    """Return the types of a dataclass's attributes in JSON; a float may be an int, such as 0."""
    types = {}
    for name, hint in get_type_hints(kind).items():
        plain = get_origin(hint) if get_origin(hint) in (dict, list) else hint
        types[name] = plain | int if plain in (float, float | None) else plain
    return types


def check_types(row: Any) -> None:
    """Check the attributes of a dataclass made of JSON.

    Raises:
        TypeError: one is of another type than its annotation.
    """
    for name, kind in _types_of(type(row)).items():
        value = getattr(row, name)
        if not isinstance(value, kind) or isinstance(value, bool):
            raise TypeError(f"{name} = {value!r}")


def why_unreadable(record: Record) -> str | None:
    """Return the reason why a Record of a validation or of proofs cannot be read, or None."""
    try:
        if record.study in (STATES, PROOFS):
            for finding in _kept(record):
                check_types(finding)
                if finding.verdict not in get_args(Verdict):
                    raise ValueError(f"verdict = {finding.verdict!r}")
                if finding.proof is not None:
                    float(finding.proof.failure_probability)
        if record.study == RUNS:
            lists = record.series["claims"], record.series["seconds"]
            _ = record.settings["scene"], [*zip(*lists, strict=True)]
    except (LookupError, TypeError, ValueError) as error:
        return described_error(error)
    return None


def _kept(record: Record) -> Iterator[StoredFinding]:
    where = {"case": None, "structure": "", "python": record.series["python"][0]}
    where |= {"pose": record.series.get("pose", [""])[0]} | record.settings
    for values in zip(*(record.series[name] for name in COLUMNS), strict=True):
        yield StoredFinding.read(dict(zip(COLUMNS, values, strict=True)) | where)


# ---- Writing -------------------------------------------------------------------------------------

# ---- Writing -------------------------------------------------------------------------------------

UNFINISHED = "not finished"


class ValidationWriter:
    """Writer of the validation of one scene class to `records`, in place of an earlier one.

    Where the file can no longer be written, on a full disk, the validation goes on, and `finish`
    raises.

    Args:
        records: file to write, or None to store nothing.
        kind: the scene class.
        run: the run, of which nothing is stored yet.
        selection: formulations, engines and claims that take part.
        links: smallest and largest number of links requested.
        examples: number of random scenes.
        seed: seed of the draws.
    """

    def __init__(
        self,
        records: Records | None,
        kind: type[Scene],
        run: ValidationRun,
        selection: RunSelection,
        links: tuple[int, int],
        examples: int,
        seed: int,
    ):
        self._records, self._kind, self._run, self._selection = records, kind, run, selection
        first, last = links
        counts = {"examples": examples, "seed": seed, "first links": first, "last links": last}
        self._asked = counts
        self._saved = self._cases = 0
        self._unwritten: UnwrittenError | None = None
        if records is not None:
            earlier = records.all(STATES, scene=kind.key)
            records.forget(STATES, [record.settings for record in earlier])
        self._keep_run("failed", UNFINISHED)

    def save(self) -> None:
        """Store the Findings since the last call, state by state."""
        for findings in cases_of(self._run, self._saved):
            self._save(findings)

    def finish(self) -> None:
        """Store the remaining Findings, those on the run as a whole, and that it was completed.

        Raises:
            UnwrittenError: not all could be stored.
        """
        self.save()
        for finding in self._run.findings[self._saved :]:
            self._save([finding])
        self._keep_run("done")
        if self._unwritten is not None:
            raise self._unwritten

    def _add(self, record: Record) -> None:
        """Store a Record; after a failure to write none is, and the file remains "not finished"."""
        if self._records is None or self._unwritten is not None:
            return
        try:
            self._records.add(record)
        except UnwrittenError as error:
            self._unwritten = error

    def _save(self, findings: list[Finding]) -> None:
        if self._records is not None:
            self._add(findings_record(stored_findings(findings, self._kind.key, self._cases)))
        self._saved += len(findings)
        self._cases += 1

    def _keep_run(self, status, reason: str = "") -> None:
        if self._records is None:
            return
        run, selection = self._run, self._selection
        counts = self._asked | {"states": run.cases}
        strata = [(name, *one) for name, of in run.level_counts.items() for one in of.items()]
        series = {
            "formulations": [formulation.key for formulation in selection.formulations],
            "engines": [engine.key for engine in selection.engines],
            "engine versions": [version_of(engine) for engine in selection.engines],
            "claims": list(selection.claims),
            "seconds": [run.seconds.get(one, 0.0) for one in selection.claims],
            "strata": [name for name, _, _ in strata],
            "ways": [way for _, way, _ in strata],
            "states in them": [states for _, _, states in strata],
        }
        where = {"scene": self._kind.key}
        self._add(Record(RUNS, where, status, reason, counts=counts, series=series))


# ---- States of one class in parallel -------------------------------------------------------------

STATES_PER_PROCESS = 30
"""Number of states per process: the start of one takes as long as some ten states."""


def default_executor(
    examples: int, kinds: Sequence[type[Scene]], engines: Sequence[type[Engine]]
) -> str | None:
    """Return the executor used by default for this number of states; None for this process.

    Other processes can import built-in code; a user-supplied scene or engine may be known in this
    process only.
    """
    processes = min(os.cpu_count() or 1, examples // STATES_PER_PROCESS)
    return f"local:{processes}" if processes > 1 and all_built_in(*kinds, *engines) else None


def all_built_in(*classes: type) -> bool:
    """Return whether all of these classes are built in."""
    return all(map(is_ours, classes))


def check_in_parallel(executor: str | None, cases: Cases, selection: RunSelection) -> StateResults:
    """Evaluate cases in the processes of `executor`, and yield the results in order.

    Args:
        executor: see `eomcheck.lab.store.parallel_map.executor`.
        cases: scenes in states.
        selection: formulations, engines and claims that take part.

    Raises:
        WorkerError, InputError, EngineError: see `eomcheck.lab.store.parallel_map.parallel_map`.
    """
    pending: dict[int, tuple[Scene, State]] = {}
    early: dict[int, StateResult] = {}
    following = 0

    def items() -> Iterator[_Item]:
        for i, (scene, state) in enumerate(cases):
            pending[i] = scene, state
            yield _Item(i, pickle.dumps(scene), state, f"{scene.structure} in {state}")

    for item, result in parallel_map(executor, partial(_evaluate, selection=selection), items()):
        early[item.number] = result
        while following in early:
            yield *pending.pop(following), early.pop(following)
            following += 1


class _Item(NamedTuple):
    number: int
    scene: bytes
    state: State
    structure: str
    """Name of the item in the message if it kills its process."""


def _evaluate(item: _Item, selection: RunSelection) -> StateResult:
    asked, number = _asked(item.scene, selection), item.number
    return evaluate_state(asked, item.state, selection, repeats_at(number), number=number)


@lru_cache(1)
def _asked(scene: bytes, selection: RunSelection) -> SceneEngines:
    """Return a scene with its engines, shared by consecutive states."""
    return make_scene_engines(pickle.loads(scene), selection)


# ---- Runs ----------------------------------------------------------------------------------------


def validate_kinds(
    runs: dict[str, ValidationRun],
    selection: RunSelection,
    links: tuple[int, int],
    examples: int,
    seed: int,
    on_case: Callable[[], None],
    records: Records | None = None,
    executor: str | None = None,
) -> None:
    """Run the claims on the scene classes whose keys `runs` has, in parallel.

    A run is put into `runs` when it is done, and stored in `records`, if any. The findings do not
    depend on the number of processes.

    Args:
        runs: key of a scene class in `SCENES` -> its run.
        selection: formulations, engines and claims that take part.
        links: smallest and largest number of links, for classes with links.
        examples: number of random scenes of each class.
        seed: seed of the draws.
        on_case: called for each case.
        records: file in which findings are stored, if any.
        executor: see `eomcheck.lab.store.parallel_map.executor`.

    Raises:
        WorkerError, InputError, EngineError: see `eomcheck.lab.store.parallel_map.parallel_map`.
        UnwrittenError: `records` could not be written completely; all runs are in `runs`.
    """
    arguments = selection, links, examples, seed
    unwritten: UnwrittenError | None = None
    kinds = {key: scene_classes_named(key)[0] for key in runs}
    for key, run in runs.items():
        ValidationWriter(records, kinds[key], run, *arguments)  # marks it as not finished
    # The longest runs start first.
    unknowns = {key: kind.example().n + kind.example().r for key, kind in kinds.items()}
    order = sorted(runs, key=unknowns.__getitem__, reverse=True)
    for key, run in parallel_map(executor, partial(_run_of, how=arguments), order):
        runs[key] = run
        try:
            ValidationWriter(records, kinds[key], run, *arguments).finish()
        except UnwrittenError as error:
            unwritten = error
        for _ in range(run.cases):
            on_case()
    if unwritten is not None:
        raise unwritten


def _run_of(key: str, how: tuple[RunSelection, tuple[int, int], int, int]) -> ValidationRun:
    run = ValidationRun()
    validate_kind(scene_classes_named(key)[0], run, *how, lambda: None)
    return run


def validate_kind(
    kind: type[Scene],
    run: ValidationRun,
    selection: RunSelection,
    links: tuple[int, int],
    examples: int,
    seed: int,
    on_case: Callable[[], None],
    records: Records | None = None,
    one: Scene | None = None,
    executor: str | None = None,
) -> None:
    """Run the claims on one scene class to the end; store the findings in `records`, if any.

    See `ValidationRun.validate_kind`, and `ValidationRun.validate_scene` for `one` scene of the
    class in place of random ones. Findings before an interruption remain in `run` and `records`.
    States are checked in this process, or in those of `executor`, see
    `eomcheck.lab.store.parallel_map.executor`; the findings are the same.

    Raises:
        UnwrittenError: `records` could not be written completely; all findings are in `run`.
    """
    writer = ValidationWriter(records, kind, run, selection, links, examples, seed)

    def after_case() -> None:
        writer.save()
        on_case()

    runner = None if executor is None else partial(check_in_parallel, executor)
    try:
        if one is None:
            run.validate_kind(kind, selection, links, examples, seed, after_case, runner)
        else:
            run.validate_scene(one, selection, examples, seed, after_case, runner)
    finally:
        run.finish(selection)
    writer.finish()

"""Validation runs of scene classes: in this process or in several, stored as findings come.

Several classes are run in parallel class by class, one class state by state; the findings do not
depend on the number of processes. `ValidationWriter` writes them to the file of Records, in place
of an earlier run of the class.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial
from typing import NamedTuple

from eomcheck.calls import is_ours
from eomcheck.claims.finding import Finding
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
from eomcheck.engines import Engine, version_of
from eomcheck.errors import UnwrittenError
from eomcheck.lab.store.parallel_map import parallel_map
from eomcheck.lab.store.record_file import Record, Records
from eomcheck.lab.store.stored_findings import (
    RUNS,
    STATES,
    cases_of,
    findings_record,
    stored_findings,
)
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.scene_lookup import scene_classes_named

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
        executor: see `eomcheck.lab.store.executors.executor`.
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
    return evaluate_state(
        _asked(item.scene, selection), item.state, selection, repeats_at(item.number)
    )


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
        executor: see `eomcheck.lab.store.executors.executor`.

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
    `eomcheck.lab.store.executors.executor`; the findings are the same.

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

"""Validation runs of scene classes: in this process or in several, stored as findings come.

Several classes are run in parallel class by class, one class state by state; the findings do not
depend on how many processes there are. `ValidationWriter` writes them to the file of Records, in
place of an earlier run of the class.
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
    """Keeps the validation of one kind of scene in `records`, in place of an earlier one.

    Where the file can no longer be written, on a full disk, the validation goes on, and `finish`
    raises.

    Args:
        records: where, or None to keep nothing.
        kind: the kind of scene.
        run: the run, of which nothing was kept yet.
        selection: what takes part.
        links: smallest and largest number of links that the run was asked for.
        examples: number of random scenes.
        seed: of the draws.
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
        asked = {"examples": examples, "seed": seed, "first links": first, "last links": last}
        self._asked = asked
        self._saved = self._cases = 0
        self._unwritten: UnwrittenError | None = None
        if records is not None:
            earlier = records.all(STATES, scene=kind.key)
            records.forget(STATES, [record.settings for record in earlier])
        self._keep_run("failed", UNFINISHED)

    def save(self) -> None:
        """Keep the Findings made since the last call, state by state."""
        for findings in cases_of(self._run, self._saved):
            self._save(findings)

    def finish(self) -> None:
        """Keep what is left, what was said of the run as a whole, and that it came to its end.

        Raises:
            UnwrittenError: not all could be kept.
        """
        self.save()
        for finding in self._run.findings[self._saved :]:
            self._save([finding])
        self._keep_run("done")
        if self._unwritten is not None:
            raise self._unwritten

    def _add(self, record: Record) -> None:
        """Keep a Record; after one that could not be kept none is: the file says "not finished"."""
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
"""A process is started for so many states: its start takes as long as some ten of them."""


def default_executor(
    examples: int, kinds: Sequence[type[Scene]], engines: Sequence[type[Engine]]
) -> str | None:
    """Return where so many states are looked at if nobody says: in more processes than this?

    Processes can import what is ours; a scene or an engine in somebody's file may be known here
    only.
    """
    processes = min(os.cpu_count() or 1, examples // STATES_PER_PROCESS)
    return f"local:{processes}" if processes > 1 and all_built_in(*kinds, *engines) else None


def all_built_in(*classes: type) -> bool:
    """Return whether all of these are of this package."""
    return all(map(is_ours, classes))


def check_in_parallel(executor: str | None, cases: Cases, selection: RunSelection) -> StateResults:
    """Look at cases in the processes that `executor` names, and yield them in their order.

    Args:
        executor: see `eomcheck.lab.store.executors.executor`.
        cases: scenes in states.
        selection: what takes part.

    Raises:
        WorkerError, InputError, EngineError: see `eomcheck.lab.store.parallel_map.parallel_map`.
    """
    handed: dict[int, tuple[Scene, State]] = {}
    early: dict[int, StateResult] = {}
    following = 0

    def items() -> Iterator[_Item]:
        for i, (scene, state) in enumerate(cases):
            handed[i] = scene, state
            yield _Item(i, pickle.dumps(scene), state, f"{scene.structure} in {state}")

    for item, seen in parallel_map(executor, partial(_look, selection=selection), items()):
        early[item.number] = seen
        while following in early:
            yield *handed.pop(following), early.pop(following)
            following += 1


class _Item(NamedTuple):
    number: int
    scene: bytes
    state: State
    structure: str
    """What is said of it where it kills its process."""


def _look(item: _Item, selection: RunSelection) -> StateResult:
    return evaluate_state(
        _asked(item.scene, selection), item.state, selection, repeats_at(item.number)
    )


@lru_cache(1)
def _asked(scene: bytes, selection: RunSelection) -> SceneEngines:
    """Return a scene with its engines, which states that follow each other may share."""
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
    """Run the claims on the kinds of scenes whose keys `runs` has, spread over processes.

    A run takes its place in `runs` as it is done, and is kept in `records`, if given. What is found
    does not depend on how many processes there are.

    Args:
        runs: key of a kind in `SCENES` -> its run.
        selection: what takes part.
        links: smallest and largest number of links, for kinds that have one.
        examples: number of random scenes of each kind.
        seed: of the draws.
        on_case: called for each case.
        records: where to keep what is found.
        executor: see `eomcheck.lab.store.executors.executor`.

    Raises:
        WorkerError, InputError, EngineError: see `eomcheck.lab.store.parallel_map.parallel_map`.
        UnwrittenError: `records` could not be written to the end; all kinds are in `runs`.
    """
    how = selection, links, examples, seed
    unwritten: UnwrittenError | None = None
    kinds = {key: scene_classes_named(key)[0] for key in runs}
    for key, run in runs.items():
        ValidationWriter(records, kinds[key], run, *how)  # says that it is not finished
    # What takes longest is to begin first.
    unknowns = {key: kind.example().n + kind.example().r for key, kind in kinds.items()}
    order = sorted(runs, key=unknowns.__getitem__, reverse=True)
    for key, run in parallel_map(executor, partial(_run_of, how=how), order):
        runs[key] = run
        try:
            ValidationWriter(records, kinds[key], run, *how).finish()
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
    """Run the claims on one kind of scene to the end; keep what is found in `records`, if given.

    See `ValidationRun.validate_kind`, and `ValidationRun.validate_scene` for `one` scene of the
    kind in place of random ones. What was found until an interruption stays in `run` and `records`.
    States are looked at in this process, or in those that `executor` names, see
    `eomcheck.lab.store.executors.executor`; what is found is the same.

    Raises:
        UnwrittenError: `records` could not be written to the end; all that was found is in `run`.
    """
    keeper = ValidationWriter(records, kind, run, selection, links, examples, seed)

    def after_case() -> None:
        keeper.save()
        on_case()

    looks = None if executor is None else partial(check_in_parallel, executor)
    try:
        if one is None:
            run.validate_kind(kind, selection, links, examples, seed, after_case, looks)
        else:
            run.validate_scene(one, selection, examples, seed, after_case, looks)
    finally:
        run.finish(selection)
    keeper.finish()

"""Claims on whole kinds of scenes: in this process or in several, and kept as they come."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from eomcheck.claims.run import Run, Selection
from eomcheck.errors import UnwrittenError
from eomcheck.lab.store.keeper import Keeper
from eomcheck.lab.store.records import Records
from eomcheck.lab.store.states import looked_at
from eomcheck.lab.store.workers import spread
from eomcheck.mechanics.scene import Scene
from eomcheck.scene_lookup import kinds_of


def look_at_kinds(
    runs: dict[str, Run],
    selection: Selection,
    links: tuple[int, int],
    examples: int,
    seed: int,
    on_case: Callable[[], None],
    records: Records | None = None,
    where: str | None = None,
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
        where: see `eomcheck.lab.store.executors.executor`.

    Raises:
        WorkerError, InputError, EngineError: see `eomcheck.lab.store.workers.spread`.
        UnwrittenError: `records` could not be written to the end; all kinds are in `runs`.
    """
    how = selection, links, examples, seed
    unwritten: UnwrittenError | None = None
    kinds = {key: kinds_of(key)[0] for key in runs}
    for key, run in runs.items():
        Keeper(records, kinds[key], run, *how)  # says that it is not finished
    # What takes longest is to begin first.
    unknowns = {key: kind.example().n + kind.example().r for key, kind in kinds.items()}
    order = sorted(runs, key=unknowns.__getitem__, reverse=True)
    for key, run in spread(where, partial(_run_of, how=how), order):
        runs[key] = run
        try:
            Keeper(records, kinds[key], run, *how).finish()
        except UnwrittenError as error:
            unwritten = error
        for _ in range(run.cases):
            on_case()
    if unwritten is not None:
        raise unwritten


def _run_of(key: str, how: tuple[Selection, tuple[int, int], int, int]) -> Run:
    run = Run()
    look_at_kind(kinds_of(key)[0], run, *how, lambda: None)
    return run


def look_at_kind(
    kind: type[Scene],
    run: Run,
    selection: Selection,
    links: tuple[int, int],
    examples: int,
    seed: int,
    on_case: Callable[[], None],
    records: Records | None = None,
    one: Scene | None = None,
    where: str | None = None,
) -> None:
    """Run the claims on one kind of scene to the end; keep what is found in `records`, if given.

    See `Run.look_at_kind`, and `Run.look_at_scene` for `one` scene of the kind in place of random
    ones. What was found until an interruption stays in `run` and `records`. States are looked at in
    this process, or in those that `where` names, see `eomcheck.lab.store.executors.executor`;
    what is found is the same.

    Raises:
        UnwrittenError: `records` could not be written to the end; all that was found is in `run`.
    """
    keeper = Keeper(records, kind, run, selection, links, examples, seed)

    def after_case() -> None:
        keeper.save()
        on_case()

    looks = None if where is None else partial(looked_at, where)
    try:
        if one is None:
            run.look_at_kind(kind, selection, links, examples, seed, after_case, looks)
        else:
            run.look_at_scene(one, selection, examples, seed, after_case, looks)
    finally:
        run.finish(selection)
    keeper.finish()

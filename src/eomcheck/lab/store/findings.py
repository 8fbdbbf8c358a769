"""Findings in Records: one Record per state looked at, or per structure proved.

A file keeps the last validation of each scene. It is saved state by state, or of several kinds of
scenes kind by kind; a Record of the run itself says what was asked for, and whether it came to its
end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from eomcheck.claims.finding import Finding, python_of, ratio
from eomcheck.claims.run import Run, Selection
from eomcheck.lab.store.records import Record, Records
from eomcheck.lab.store.workers import spread
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes.named import kinds_of

STATES = "validation"
RUNS = "validation run"
PROOFS = "proof"

COLUMNS = (
    *("claim", "subject", "observed", "allowed", "verdict", "evidence", "detail"),
    *("digits", "proof"),
)
UNFINISHED = "not finished"


@dataclass(frozen=True)
class Kept:
    """A Finding as it was kept: plain data, with the place where it was found.

    Attributes:
        scene: key of the kind of scene.
        links: its number of links, or None.
        case: number of the state in its run; None for a proof, which is about all states.
        python: code that shows the state, or proves the structure, again.

    The other attributes are those of `Finding`; `proof` is a dict.
    """

    claim: str
    subject: str
    observed: float
    allowed: float
    verdict: str
    evidence: str
    detail: str
    digits: float | None
    proof: dict[str, Any] | None
    scene: str
    links: int | None
    case: int | None
    python: str

    @property
    def ratio(self) -> float:
        """observed / allowed."""
        return ratio(self.observed, self.allowed)

    @property
    def level(self) -> str:
        """Level of the evidence: proved, enclosed, property-tested, compared."""
        return self.evidence.partition(":")[0]

    @property
    def place(self) -> str:
        """Where, such as "snake, N = 7, state 12"."""
        links = "" if self.links is None else f", N = {self.links}"
        return self.scene + links + ("" if self.case is None else f", state {self.case}")


def links_of(scene: Scene) -> int | None:
    """Return the number of links of a scene, None if it has none to choose."""
    return getattr(scene, "links", None) if scene.has_links else None


def record_of(
    study: str, settings: dict[str, Any], rows: Iterable[dict[str, Any]], python: str
) -> Record:
    """Return the Record of the Findings, as plain data, that one state or structure gave."""
    rows = list(rows)
    series = {name: [row.get(name) for row in rows] for name in COLUMNS}
    return Record(study, settings, series=series | {"python": [python]})


def kept_in(records: Iterable[Record]) -> list[Kept]:
    """Return every Finding in these Records."""
    return [kept for one in records if one.study in (STATES, PROOFS) for kept in _kept(one)]


def _kept(record: Record) -> Iterator[Kept]:
    where = {
        "scene": record.settings["scene"],
        "links": record.settings["links"],
        "case": record.settings.get("case"),
        "python": record.series["python"][0],
    }
    for values in zip(*(record.series[name] for name in COLUMNS), strict=True):
        yield Kept(**dict(zip(COLUMNS, values, strict=True)), **where)


def keep_proof(records: Records, scene: Scene, rows: Iterable[dict[str, Any]]) -> None:
    """Keep what was proved of the structure of a scene."""
    settings = {"scene": scene.key, "links": links_of(scene), "structure": scene.structure}
    records.add(record_of(PROOFS, settings, rows, python_of(scene, None)))


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
        where: see `eomcheck.lab.store.workers.executor`.

    Raises:
        WorkerError, InputError, EngineError: see `eomcheck.lab.store.workers.spread`.
    """
    how = selection, links, examples, seed
    names = ("selection", "links", "examples", "seed")
    look = partial(_run_of, **dict(zip(names, how, strict=True)))

    kinds = {key: kinds_of(key)[0] for key in runs}
    if records is not None:
        for key, run in runs.items():
            Keeper(records, kinds[key], run, *how)  # says that it is not finished
    # What takes longest is to begin first.
    unknowns = {key: kind.example().n + kind.example().r for key, kind in kinds.items()}
    for key, run in spread(where, look, sorted(runs, key=unknowns.__getitem__, reverse=True)):
        runs[key] = run
        if records is not None:
            Keeper(records, kinds[key], run, *how).finish()
        for _ in range(run.cases):
            on_case()


def _run_of(
    key: str, selection: Selection, links: tuple[int, int], examples: int, seed: int
) -> Run:
    run = Run()
    look_at_kind(kinds_of(key)[0], run, selection, links, examples, seed, lambda: None)
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
) -> None:
    """Run the claims on one kind of scene to the end; keep what is found in `records`, if given.

    See `Run.look_at_kind`. What was found until an interruption stays in `run` and `records`.
    """
    keeper = None
    if records is not None:
        keeper = Keeper(records, kind, run, selection, links, examples, seed)

    def after_case() -> None:
        if keeper is not None:
            keeper.save()
        on_case()

    try:
        run.look_at_kind(kind, selection, links, examples, seed, after_case)
    finally:
        run.finish(selection)
    if keeper is not None:
        keeper.finish()


class Keeper:
    """Keeps the validation of one kind of scene in `records`, in place of an earlier one.

    Args:
        records: where.
        kind: the kind of scene.
        run: the run, of which nothing was kept yet.
        selection: what takes part.
        links: smallest and largest number of links that the run was asked for.
        examples: number of random scenes.
        seed: of the draws.
    """

    def __init__(
        self,
        records: Records,
        kind: type[Scene],
        run: Run,
        selection: Selection,
        links: tuple[int, int],
        examples: int,
        seed: int,
    ):
        self._records, self._kind, self._run = records, kind, run
        self._selection = selection
        self._asked = {
            "examples": examples,
            "seed": seed,
            "first links": links[0],
            "last links": links[1],
        }
        self._saved = self._cases = 0
        earlier = records.all(STATES, scene=kind.key)
        records.forget(STATES, [record.settings for record in earlier])
        self._keep_run("failed", UNFINISHED)

    def save(self) -> None:
        """Keep the Findings made since the last call, state by state."""
        for end in self._run.ends:
            if end > self._saved:
                self._save(self._run.findings[self._saved : end])

    def finish(self) -> None:
        """Keep what is left, what was said of the run as a whole, and that it came to its end."""
        self.save()
        for finding in self._run.findings[self._saved :]:
            self._save([finding])
        self._keep_run("done")

    def _save(self, findings: list[Finding]) -> None:
        scene, state = findings[0].scene, findings[0].state
        settings = {"scene": self._kind.key, "links": links_of(scene), "case": self._cases}
        # as_dict has no infinities, for JSON has none; a Record has.
        rows = [f.as_dict() | {"observed": f.observed, "allowed": f.allowed} for f in findings]
        self._records.add(record_of(STATES, settings, rows, python_of(scene, state)))
        self._saved += len(findings)
        self._cases += 1

    def _keep_run(self, status, reason: str = "") -> None:
        run, selection = self._run, self._selection
        self._records.add(
            Record(
                RUNS,
                {"scene": self._kind.key},
                status,
                reason,
                counts=self._asked | {"states": run.cases},
                series={
                    "formulations": [formulation.key for formulation in selection.formulations],
                    "engines": [engine.key for engine in selection.engines],
                    "engine versions": [engine.version() for engine in selection.engines],
                    "claims": list(selection.claims),
                    "seconds": [run.seconds.get(one, 0.0) for one in selection.claims],
                },
            )
        )

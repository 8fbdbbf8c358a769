"""Findings in Records: one Record per state looked at, or per structure proved.

A file keeps the last validation of each scene. It is saved state by state, or of several kinds of
scenes kind by kind; a Record of the run itself says what was asked for, and whether it came to its
end.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, get_args, get_type_hints

from eomcheck.claims.finding import Finding, Proof, Verdict, ratio
from eomcheck.claims.repeat import python_of
from eomcheck.claims.run import Run
from eomcheck.claims.selection import Selection
from eomcheck.claims.strata import links_of
from eomcheck.lab.store.record import Record
from eomcheck.lab.store.records import Records
from eomcheck.lab.store.states import looked_at
from eomcheck.lab.store.workers import spread
from eomcheck.mechanics.scene import Scene
from eomcheck.named import kinds_of

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
    """A Finding as it is kept and shown: plain data, with the place where it was found.

    Attributes:
        scene: key of the kind of scene.
        links: its number of links, or None.
        case: number of the state in its run; None for a proof, which is about all states.
        structure: what a proof is about, "" for a state.
        python: code that shows the state, or proves the structure, again.

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

    @classmethod
    def read(cls, row: dict[str, Any]) -> Kept:
        """Return what `dataclasses.asdict` and then JSON made of one."""
        row = dict(row)
        if row["proof"] is not None:
            row["proof"] = Proof(**row["proof"] | {"primes": tuple(row["proof"]["primes"])})
        return cls(**row)

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
        """Where, such as "snake, N = 7, state 12" or "snake[7], no stiffness"."""
        if self.case is None:
            return self.structure
        links = "" if self.links is None else f", N = {self.links}"
        return f"{self.scene}{links}, state {self.case}"

    def __str__(self) -> str:
        """Return what was found, without the claim that it is about."""
        about = f"[{self.subject}] {self.verdict} on {self.place} ({self.evidence}): "
        if self.verdict == "not looked at":
            return about + self.detail  # there are no numbers
        about += f"observed {self.observed:.3g}, allowed {self.allowed:.3g}"
        return f"{about}; {self.detail}" if self.detail else about


def kept_of(findings: Sequence[Finding], key: str, case: int | None = None) -> list[Kept]:
    """Return the Findings of one state, or those of one structure, as they are kept.

    Args:
        findings: one at least.
        key: that of the kind of scene.
        case: number of the state in its run; None for a structure.
    """
    scene, state = findings[0].scene, findings[0].state
    engines = dict.fromkeys(one.engine for one in findings if one.engine is not None)
    where = {
        "scene": key,
        "links": links_of(scene),
        "case": case,
        "structure": scene.structure if case is None else "",
        "python": python_of(scene, state, engines),
    }
    return [Kept(**{name: getattr(one, name) for name in COLUMNS}, **where) for one in findings]


def cases_of(run: Run, begin: int = 0) -> Iterator[list[Finding]]:
    """Yield the Findings of each state of a run that is done, those from `begin` on."""
    for end in run.ends[bisect_right(run.ends, begin) :]:
        if end > begin:
            yield run.findings[begin:end]
        begin = end


def kept_of_runs(runs: Mapping[str, Run]) -> list[Kept]:
    """Return every Finding of runs that are over, as it is kept; by the keys of the kinds."""
    found: list[Kept] = []
    for key, run in runs.items():
        last = run.ends[-1] if run.ends else 0
        cases = [*cases_of(run), *([one] for one in run.findings[last:])]
        found += [kept for case, one in enumerate(cases) for kept in kept_of(one, key, case)]
    return found


def record_of(kept: Sequence[Kept]) -> Record:
    """Return the Record of what one state or structure gave."""
    series = {name: [getattr(one, name) for one in kept] for name in COLUMNS}
    series["proof"] = [None if proof is None else asdict(proof) for proof in series["proof"]]
    one = kept[0]
    where = {"case": one.case} if one.case is not None else {"structure": one.structure}
    settings = {"scene": one.scene, "links": one.links} | where
    study = PROOFS if one.case is None else STATES
    return Record(study, settings, series=series | {"python": [one.python]})


def kept_in(records: Iterable[Record]) -> list[Kept]:
    """Return every Finding in these Records."""
    return [kept for one in records if one.study in (STATES, PROOFS) for kept in _kept(one)]


FOUND = {
    name: kind | int if kind in (float, float | None) else kind
    for name, kind in get_type_hints(Kept).items()
}
"""Attribute of `Kept` -> what it is; what is written as 0 may be a float."""


def fault_of(record: Record) -> str | None:
    """Return why a Record of a validation or of proofs cannot be read, or None."""
    try:
        if record.study in (STATES, PROOFS):
            for one in _kept(record):
                for name, kind in FOUND.items():
                    if not isinstance(getattr(one, name), kind):
                        raise TypeError(f"{name} = {getattr(one, name)!r}")
                if one.verdict not in get_args(Verdict):
                    raise ValueError(f"verdict = {one.verdict!r}")
                if one.proof is not None:
                    float(one.proof.failure_probability)
        if record.study == RUNS:
            lists = record.series["claims"], record.series["seconds"]
            _ = record.settings["scene"], [*zip(*lists, strict=True)]
    except (LookupError, TypeError, ValueError) as error:
        return f"{type(error).__name__}: {error}"
    return None


def _kept(record: Record) -> Iterator[Kept]:
    where = {"case": None, "structure": "", "python": record.series["python"][0]} | record.settings
    for values in zip(*(record.series[name] for name in COLUMNS), strict=True):
        yield Kept.read(dict(zip(COLUMNS, values, strict=True)) | where)


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
    kinds = {key: kinds_of(key)[0] for key in runs}
    for key, run in runs.items():
        Keeper(records, kinds[key], run, *how)  # says that it is not finished
    # What takes longest is to begin first.
    unknowns = {key: kind.example().n + kind.example().r for key, kind in kinds.items()}
    order = sorted(runs, key=unknowns.__getitem__, reverse=True)
    for key, run in spread(where, partial(_run_of, how=how), order):
        runs[key] = run
        Keeper(records, kinds[key], run, *how).finish()
        for _ in range(run.cases):
            on_case()


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
    this process, or in those that `where` names, see `eomcheck.lab.store.workers.executor`; what is
    found is the same.
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


class Keeper:
    """Keeps the validation of one kind of scene in `records`, in place of an earlier one.

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
        run: Run,
        selection: Selection,
        links: tuple[int, int],
        examples: int,
        seed: int,
    ):
        self._records, self._kind, self._run, self._selection = records, kind, run, selection
        first, last = links
        asked = {"examples": examples, "seed": seed, "first links": first, "last links": last}
        self._asked = asked
        self._saved = self._cases = 0
        if records is not None:
            earlier = records.all(STATES, scene=kind.key)
            records.forget(STATES, [record.settings for record in earlier])
        self._keep_run("failed", UNFINISHED)

    def save(self) -> None:
        """Keep the Findings made since the last call, state by state."""
        for findings in cases_of(self._run, self._saved):
            self._save(findings)

    def finish(self) -> None:
        """Keep what is left, what was said of the run as a whole, and that it came to its end."""
        self.save()
        for finding in self._run.findings[self._saved :]:
            self._save([finding])
        self._keep_run("done")

    def _save(self, findings: list[Finding]) -> None:
        if self._records is not None:
            self._records.add(record_of(kept_of(findings, self._kind.key, self._cases)))
        self._saved += len(findings)
        self._cases += 1

    def _keep_run(self, status, reason: str = "") -> None:
        if self._records is None:
            return
        run, selection = self._run, self._selection
        counts = self._asked | {"states": run.cases}
        strata = [(name, *one) for name, of in run.strata.items() for one in of.items()]
        series = {
            "formulations": [formulation.key for formulation in selection.formulations],
            "engines": [engine.key for engine in selection.engines],
            "engine versions": [engine.version() for engine in selection.engines],
            "claims": list(selection.claims),
            "seconds": [run.seconds.get(one, 0.0) for one in selection.claims],
            "strata": [name for name, _, _ in strata],
            "ways": [way for _, way, _ in strata],
            "states in them": [states for _, _, states in strata],
        }
        where = {"scene": self._kind.key}
        self._records.add(Record(RUNS, where, status, reason, counts=counts, series=series))

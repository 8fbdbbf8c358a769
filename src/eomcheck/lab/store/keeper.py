"""The validation of one kind of scene, kept state by state."""

from __future__ import annotations

from eomcheck.claims.finding import Finding
from eomcheck.claims.run import Run, Selection
from eomcheck.engines import version_of
from eomcheck.errors import UnwrittenError
from eomcheck.lab.store.findings import RUNS, STATES, cases_of, kept_of, record_of
from eomcheck.lab.store.record import Record
from eomcheck.lab.store.records import Records
from eomcheck.mechanics.scene import Scene

UNFINISHED = "not finished"


class Keeper:
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
            self._add(record_of(kept_of(findings, self._kind.key, self._cases)))
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
            "engine versions": [version_of(engine) for engine in selection.engines],
            "claims": list(selection.claims),
            "seconds": [run.seconds.get(one, 0.0) for one in selection.claims],
            "strata": [name for name, _, _ in strata],
            "ways": [way for _, way, _ in strata],
            "states in them": [states for _, _, states in strata],
        }
        where = {"scene": self._kind.key}
        self._add(Record(RUNS, where, status, reason, counts=counts, series=series))

"""Proofs of many structures of scenes: run in parallel, saved one by one, resumed.

`ProofJobs` are the structures to prove, by numbers of links; `Proofs` is a run of them, which
stores each structure in a file of Records as it is proved, and resumes from that file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import eomcheck
from eomcheck.claims.finding import DECIDED, plain_row
from eomcheck.claims.proof import new_seed, provable_claims, prove_structure
from eomcheck.console import progress
from eomcheck.errors import MOST_COUNTED, InputError, whole_number
from eomcheck.formulations import formulation_of, formulations_among
from eomcheck.lab.show.table import write_json
from eomcheck.lab.store.parallel_map import parallel_map
from eomcheck.lab.store.record_file import Record, Records, group, sources
from eomcheck.lab.store.validation_runs import (
    PROOFS,
    StoredFinding,
    findings_record,
    stored_findings,
    stored_findings_in,
)
from eomcheck.mechanics.scene import Scene
from eomcheck.scene_lookup import ALL, scene_classes_named

# ---- Jobs ----------------------------------------------------------------------------------------

LINKS = (*range(1, 13), 20, 50, 100)
"""Numbers of links proved by default."""


@dataclass(frozen=True)
class ProofJobs:
    """The structures to prove, with the formulations and the number of random points.

    Attributes:
        scenes: one per structure.
        formulations: keys; a scene is proved by those of them that apply to it.
        points: random points per identity.
        seed: seed of the draws, or None for one by the operating system.
        claims: ids of the claims that were named, or None for all identities.
    """

    scenes: tuple[Scene, ...]
    formulations: tuple[str, ...]
    points: int
    seed: int | None
    claims: tuple[str, ...] | None = None


def proof_jobs(
    scene: str,
    links: Iterable[int] | None,
    points: int,
    seed: int | None,
    formulations: Iterable[str] | None,
    claims: Iterable[str] | None = None,
) -> ProofJobs:
    """Return the jobs for the scene classes that `scene` names.

    Args:
        scene: a name, see `eomcheck.scene_lookup.scene_classes_named`.
        links: numbers of links, for classes with links; by default `LINKS`.
        points: random points per identity.
        seed: seed of the draws, or None for one by the operating system.
        formulations: keys, by default all that apply.
        claims: ids of claims, by default all that are identities.

    Raises:
        InputError: `points` below 1, no such number of links, a formulation that does not apply, or
            a claim that is no identity.
        UnknownNameError: no such scene, formulation or claim.
    """
    named = None if claims is None else provable_claims(claims)
    kinds = scene_classes_named(scene)
    points = whole_number("points", points, most=MOST_COUNTED)
    chosen = tuple(formulation.key for formulation in formulations_among(kinds, formulations))
    scenes = tuple(
        structure
        for kind in kinds
        for count in numbers_of_links(kind, links, scene)
        for structure in kind.structures(count)
    )
    return ProofJobs(scenes, chosen, points, seed, named)


def numbers_of_links(
    kind: type[Scene], links: Iterable[int] | None, name: str
) -> Iterable[int | None]:
    """Return the numbers of links to prove; (None,) for a class without links.

    Raises:
        InputError: `links` are given for a scene named `name` that has none.
    """
    if kind.has_links:
        most = kind.most_links
        few = [count for count in LINKS if most is None or count <= most]
        return few if links is None else links
    return (None,) if links is None or name == ALL else links


# ---- Run -----------------------------------------------------------------------------------------

JOBS = "proofs"
"""Study of the Record that identifies the jobs of an unfinished file."""

WORTH_A_PROCESS = 40
"""Number of coordinates below which a proof takes less time than the start of a process."""


def _prove(
    scene: Scene,
    formulations: tuple[str, ...],
    points: int,
    seed: int,
    claims: tuple[str, ...] | None,
) -> list[StoredFinding]:
    chosen = tuple(f for f in map(formulation_of, formulations) if f.applies_to(scene))
    return stored_findings(prove_structure(scene, chosen, points, seed, claims), scene.key)


class Proofs:
    """A run of proofs.

    While it runs, each structure is stored in `path` + ".part", a file of Records, as it is proved;
    a run of the same jobs that finds this file, written by the same sources, resumes from it.

    Args:
        jobs: the structures to prove.
        path: file to write, if any.
        executor: executor for large scenes, see `eomcheck.lab.store.parallel_map.executor`.
        records: another file in which Findings are stored as they come, if any.

    Attributes:
        findings: structure -> its Findings.
        taken_over: number of structures found in the file.
        started_over: whether the file was of other jobs or sources, and was discarded.
    """

    def __init__(
        self,
        jobs: ProofJobs,
        path: Path | None = None,
        executor: str | None = None,
        records: Records | None = None,
    ):
        self.jobs, self.path, self.executor, self.records = jobs, path, executor, records
        self.seed = new_seed() if jobs.seed is None else jobs.seed
        self.findings: dict[str, list[StoredFinding]] = {}
        self.taken_over = 0
        self.started_over = False

    @property
    def failed(self) -> bool:
        """Whether anything was disproved."""
        return "failed" in self._verdicts

    @property
    def decided(self) -> bool:
        """Whether anything was proved or disproved."""
        return not self._verdicts.isdisjoint(DECIDED)

    @property
    def _verdicts(self) -> set[str]:
        return {one.verdict for findings in self.findings.values() for one in findings}

    def run(self) -> None:
        """Prove everything that is not proved yet."""
        with self._unfinished() as unfinished:
            self._resume(unfinished)
            self.taken_over = len(self.findings)
            for findings in self.findings.values():
                self._keep(findings)
            left = [scene for scene in self.jobs.scenes if scene.structure not in self.findings]
            with progress("proving identities of {structure}", len(left)) as advance:
                for structure, findings in self._proved(left):
                    self.findings[structure] = findings
                    self._keep(findings, unfinished)
                    advance()

    def _proved(self, scenes: list[Scene]) -> Iterator[tuple[str, list[StoredFinding]]]:
        jobs = self.jobs
        arguments = jobs.formulations, jobs.points, self.seed, jobs.claims
        large = [scene for scene in scenes if scene.n >= WORTH_A_PROCESS]
        for scene in scenes:
            if scene not in large or len(large) == 1:
                yield scene.structure, _prove(scene, *arguments)
        if len(large) < 2:
            return
        names = ("formulations", "points", "seed", "claims")
        prove = partial(_prove, **dict(zip(names, arguments, strict=True)))
        for scene, findings in parallel_map(self.executor, prove, large):
            yield scene.structure, findings

    @property
    def _part(self) -> Path | None:
        return None if self.path is None else self.path.with_name(self.path.name + ".part")

    def _header(self) -> dict[str, Any]:
        claims = self.jobs.claims
        return {
            "eomcheck": eomcheck.__version__,
            "sources": sources(),
            "formulations": list(self.jobs.formulations),
            "points": self.jobs.points,
            "seed": self.seed,
            **({} if claims is None else {"claims": list(claims)}),
        }

    def _unfinished(self) -> Records:
        """Return the Records of earlier runs; empty ones where the file is no file of Records."""
        with suppress(InputError):
            return Records(self._part)
        assert self._part is not None
        self.started_over = True
        with suppress(OSError):
            self._part.unlink()
        return Records(self._part)

    def _resume(self, unfinished: Records) -> None:
        """Take over the Findings of the same jobs by the same sources; delete all others."""
        header, own_seed = unfinished.all(JOBS), self.seed
        if header and self.jobs.seed is None:
            self.seed = header[0].settings["seed"]
        if [one.settings for one in header] == [self._header()]:
            by_structure = group(stored_findings_in(unfinished.all()), lambda one: one.structure)
            wanted = [scene.structure for scene in self.jobs.scenes]
            self.findings = {key: by_structure[key] for key in wanted if key in by_structure}
            return
        self.started_over, self.seed = self.started_over or len(unfinished) > 0, own_seed
        for study in (JOBS, PROOFS):
            unfinished.forget(study, [one.settings for one in unfinished.all(study)])
        unfinished.add(Record(JOBS, self._header()))

    def _keep(self, findings: list[StoredFinding], *more: Records) -> None:
        for records in (*more, self.records):
            if records is not None:
                records.add(findings_record(findings))

    def write(self) -> None:
        """Write everything to `path` and drop the unfinished file."""
        assert self.path is not None and self._part is not None
        rows = {
            structure: [plain_row(one, {"structure": structure}) for one in findings]
            for structure, findings in self.findings.items()
        }
        write_json(self.path, self._header() | {"findings": rows})
        self._part.unlink(missing_ok=True)

"""Proofs for many numbers of links: spread over processes, saved as they are made, resumed."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import eomcheck
from eomcheck.claims.finding import DECIDED
from eomcheck.claims.proof import new_seed, prove_structure
from eomcheck.console import progress
from eomcheck.errors import InputError, whole_number
from eomcheck.formulations import formulation_of, formulations_among
from eomcheck.lab.show.text import write_json
from eomcheck.lab.store.findings import Kept, kept_of, record_of
from eomcheck.lab.store.provenance import sources
from eomcheck.lab.store.records import Records
from eomcheck.lab.store.workers import spread
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes.named import ALL, kinds_of

LINKS = (*range(1, 13), 20, 50, 100)
"""Numbers of links that are proved by default."""

WORTH_A_PROCESS = 40
"""Below this number of coordinates a proof takes less time than a process to start."""


@dataclass(frozen=True)
class ProofJobs:
    """What is to be proved, and how.

    Attributes:
        scenes: one per structure.
        formulations: keys; a scene is proved by those of them that apply to it.
        points: random points per identity.
        seed: of the draws, or None for one by the operating system.
    """

    scenes: tuple[Scene, ...]
    formulations: tuple[str, ...]
    points: int
    seed: int | None


def proof_jobs(
    scene: str,
    links: Iterable[int] | None,
    points: int,
    seed: int | None,
    formulations: Iterable[str] | None,
) -> ProofJobs:
    """Return the jobs for the kinds of scenes that `scene` stands for.

    Args:
        scene: a name, see `eomcheck.scenes.named.kinds_of`.
        links: numbers of links, for kinds that have one; by default `LINKS`.
        points: random points per identity.
        seed: of the draws, or None for one by the operating system.
        formulations: keys, by default all that apply.

    Raises:
        InputError: `points` below 1, no such number of links, or a formulation that does not apply.
        UnknownNameError: no such scene or formulation.
    """
    kinds = kinds_of(scene)
    points = whole_number("points", points)
    chosen = tuple(formulation.key for formulation in formulations_among(kinds, formulations))
    scenes = tuple(
        one
        for kind in kinds
        for count in numbers_of_links(kind, links, scene)
        for one in kind.structures(count)
    )
    return ProofJobs(scenes, chosen, points, seed)


def numbers_of_links(
    kind: type[Scene], links: Iterable[int] | None, name: str
) -> Iterable[int | None]:
    """Return the numbers of links to look at; None, and no number, for a kind that has none.

    Raises:
        InputError: `links` are given for a scene, called by its `name`, that has none.
    """
    if kind.has_links:
        return LINKS if links is None else links
    return (None,) if links is None or name == ALL else links


def _prove(scene: Scene, formulations: tuple[str, ...], points: int, seed: int) -> list[Kept]:
    chosen = tuple(f for f in map(formulation_of, formulations) if f.applies_to(scene))
    return kept_of(prove_structure(scene, chosen, points, seed), scene.key)


def _row(one: Kept) -> dict[str, Any]:
    """Return a Finding on a structure for JSON, as `Finding.as_dict` does."""
    names = ("claim", "subject", "structure", "observed", "allowed", "verdict", "evidence")
    row = {name: getattr(one, name) for name in (*names, "detail")}
    return row if one.proof is None else row | {"proof": asdict(one.proof)}


class Proofs:
    """A run of proofs.

    While it runs, each structure is appended to `path` + ".part" as it is proved; a run of the same
    jobs that finds this file, made by the same sources, goes on from there.

    Args:
        jobs: what is to be proved.
        path: file to write, if any.
        where: where large scenes are proved, see `eomcheck.lab.store.workers.executor`.
        records: where to keep the Findings too, as they come.

    Attributes:
        findings: structure -> its Findings.
        taken_over: number of structures found in the file.
        started_over: whether the file was of other jobs or sources, and of no use.
    """

    def __init__(
        self,
        jobs: ProofJobs,
        path: Path | None = None,
        where: str | None = None,
        records: Records | None = None,
    ):
        self.jobs, self.path, self.where, self.records = jobs, path, where, records
        self.seed = new_seed() if jobs.seed is None else jobs.seed
        self.findings: dict[str, list[Kept]] = {}
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
        return {one.verdict for found in self.findings.values() for one in found}

    def run(self) -> None:
        """Prove everything that is not proved yet."""
        self._resume()
        self.taken_over = len(self.findings)
        for scene in self.jobs.scenes:
            if scene.structure in self.findings:
                self._keep(scene.structure)
        left = [scene for scene in self.jobs.scenes if scene.structure not in self.findings]
        with progress("proving", len(left)) as advance:
            for structure, found in self._proved(left):
                self.findings[structure] = found
                rows = [asdict(one) for one in found]
                self._save(json.dumps([structure, rows], ensure_ascii=False))
                self._keep(structure)
                advance()

    def _proved(self, scenes: list[Scene]) -> Iterator[tuple[str, list[Kept]]]:
        how = self.jobs.formulations, self.jobs.points, self.seed
        large = [scene for scene in scenes if scene.n >= WORTH_A_PROCESS]
        for scene in scenes:
            if scene not in large or len(large) == 1:
                yield scene.structure, _prove(scene, *how)
        if len(large) < 2:
            return
        names = ("formulations", "points", "seed")
        prove = partial(_prove, **dict(zip(names, how, strict=True)))
        for scene, found in spread(self.where, prove, large):
            yield scene.structure, found

    @property
    def _part(self) -> Path | None:
        return None if self.path is None else self.path.with_name(self.path.name + ".part")

    def _header(self) -> dict[str, Any]:
        return {
            "eomcheck": eomcheck.__version__,
            "sources": sources(),
            "formulations": list(self.jobs.formulations),
            "points": self.jobs.points,
            "seed": self.seed,
        }

    def _resume(self) -> None:
        if self._part is None:
            return
        own_seed = self.seed
        try:
            head, *lines = self._part.read_text(encoding="utf-8").splitlines()
            header = json.loads(head)
            if self.jobs.seed is None:
                self.seed = header["seed"]
            if header != self._header():
                raise ValueError
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            self.started_over, self.seed = self._part.exists(), own_seed
            self._begin()
            return
        wanted = {scene.structure for scene in self.jobs.scenes}
        for line in lines:
            try:
                structure, rows = json.loads(line)
            except (ValueError, RecursionError):  # the line at which a run was killed
                continue
            if structure in wanted:
                self.findings[structure] = [Kept.read(row) for row in rows]

    def _begin(self) -> None:
        self._save(json.dumps(self._header()), "w")

    def _save(self, line: str, mode: str = "a") -> None:
        if self._part is None:
            return
        try:
            with self._part.open(mode, encoding="utf-8") as file:
                file.write(line + "\n")
        except OSError as error:
            raise InputError(f"{str(self._part)!r} cannot be written: {error.strerror}") from None

    def _keep(self, structure: str) -> None:
        if self.records is not None:
            self.records.add(record_of(self.findings[structure]))

    def write(self) -> None:
        """Write everything to `path` and drop the unfinished file."""
        assert self.path is not None and self._part is not None
        rows = {key: [_row(one) for one in found] for key, found in self.findings.items()}
        write_json(self.path, self._header() | {"findings": rows})
        self._part.unlink(missing_ok=True)

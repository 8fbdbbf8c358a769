"""Stored findings: a Finding as plain data, written into Records and read back.

There is one Record per state checked, or per structure proved. A file holds the last validation of
each scene class. It is saved state by state, or class by class if there are several; a Record of
the run itself holds its options and whether it was completed.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from operator import attrgetter
from typing import Any, get_args, get_type_hints

from eomcheck.claims.finding import Finding, Proof, Verdict, ratio
from eomcheck.claims.reproducer import reproducer_code
from eomcheck.claims.run import ValidationRun
from eomcheck.deprecated import current
from eomcheck.draws.pairwise_design import link_count
from eomcheck.errors import described_error
from eomcheck.lab.store.record_file import Record

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
        about += f"observed {self.observed:.3g}, allowed {self.allowed:.3g}"
        return f"{about}; {self.detail}" if self.detail else about


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
    where = {
        "scene": key,
        "links": link_count(scene),
        "case": case,
        "structure": scene.structure if case is None else "",
        "python": reproducer_code(scene, state, engines),
    }
    return [StoredFinding(*_columns(one), **where) for one in findings]


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
    return Record(study, settings, series=series | {"python": [first.python]})


def stored_findings_in(records: Iterable[Record]) -> list[StoredFinding]:
    """Return every Finding in these Records."""
    return [
        finding
        for record in records
        if record.study in (STATES, PROOFS)
        for finding in _kept(record)
    ]


FIELD_TYPES = {
    name: kind | int if kind in (float, float | None) else kind
    for name, kind in get_type_hints(StoredFinding).items()
}
"""Attribute of `StoredFinding` -> its type; a float may be read back as an int, such as 0."""


def why_unreadable(record: Record) -> str | None:
    """Return the reason why a Record of a validation or of proofs cannot be read, or None."""
    try:
        if record.study in (STATES, PROOFS):
            for finding in _kept(record):
                for name, kind in FIELD_TYPES.items():
                    if not isinstance(getattr(finding, name), kind):
                        raise TypeError(f"{name} = {getattr(finding, name)!r}")
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
    where = {"case": None, "structure": "", "python": record.series["python"][0]} | record.settings
    for values in zip(*(record.series[name] for name in COLUMNS), strict=True):
        yield StoredFinding.read(dict(zip(COLUMNS, values, strict=True)) | where)

"""A Finding as it is kept and shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from eomcheck.claims.finding import Proof, ratio

COLUMNS = (
    *("claim", "subject", "observed", "allowed", "verdict", "evidence", "detail"),
    *("digits", "proof"),
)


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

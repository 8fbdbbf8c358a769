"""What came of comparing libraries on one robot."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from eomcheck.claims.finding import Finding, Left
from eomcheck.errors import InputError
from eomcheck.lab.parting import Why
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array


@dataclass
class Comparison:
    """What came of one robot.

    Attributes:
        scene: the robot, with the parameters of its file.
        versions: key of a library that took part -> its version.
        refused: key of one that did not -> why.
        missing: keys of those among them that are not installed.
        apart: quantity -> the largest difference of any two at any state (k, k), relative to the
            largest entry; eomcheck first, then as in `versions`.
        findings: the worst one by library and claim, of ours and theirs.
        faults: library and quantity -> what it did instead of an answer, the first time.
        why: library -> what explains its differences, as far as that is known.
        said: library -> what it wrote while it read the file.
        decided: library -> whether any of its findings is more than inconclusive; none of one
            of which nothing was compared.
        unsure: library and method -> in how many states rounding explains any difference.
        states: number of states looked at.
        skipped: why q̈ is not compared, once for each state in which it is not.
        own: failures of our two derivations being the same, in states where a library differs.
        hidden: library and claim -> what no state resolves of it.
    """

    scene: Scene
    versions: dict[str, str] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    apart: dict[str, Array] = field(default_factory=dict)
    findings: dict[tuple[str, str], Finding] = field(default_factory=dict)
    faults: dict[tuple[str, str], str] = field(default_factory=dict)
    why: dict[str, list[Why]] = field(default_factory=dict)
    said: dict[str, list[str]] = field(default_factory=dict)
    decided: dict[str, bool] = field(default_factory=dict)
    unsure: Counter[tuple[str, str]] = field(default_factory=Counter)
    states: int = 0
    skipped: list[str] = field(default_factory=list)
    own: list[Finding] = field(default_factory=list)
    hidden: dict[tuple[str, str], list[Left]] = field(default_factory=dict)

    @property
    def failed(self) -> list[Finding]:
        """The findings on what differs by more than rounding."""
        return [one for one in self.findings.values() if one.verdict == "failed"]

    @property
    def disagree(self) -> bool:
        """Whether some that read the file differ, or do not answer everything."""
        return bool(self.failed or self.faults or self.own)

    @property
    def agree(self) -> bool:
        """Whether something was compared and decided, and nothing differs."""
        return not self.disagree and any(self.decided.values())

    @property
    def open(self) -> list[str]:
        """The keys of libraries that read the file and of which nothing is decided."""
        return [key for key in self.versions if not self.decided.get(key)]

    def check_decided(self) -> None:
        """Raise InputError if nothing differs and nothing is decided: that is no pass."""
        if not (self.disagree or self.agree):
            libraries = ", ".join(self.versions)
            raise InputError(f"{self.scene.name}: nothing was decided about {libraries}")

    @property
    def unanswered(self) -> list[str]:
        """The keys of libraries that are installed and gave no answer."""
        return [key for key in self.refused if key not in self.missing]

    def of(self, library: str) -> list[Finding]:
        """Return what a library differs in by more than rounding."""
        mine = (one for (key, _), one in self.findings.items() if key == library)
        return [one for one in mine if one.verdict == "failed"]

    def differs(self, library: str) -> bool:
        """Return whether a library differs, or does not answer everything."""
        return bool(self.of(library)) or any(key == library for key, _ in self.faults)

    def undecided(self, library: str) -> list[str]:
        """Return the claims about a library that are decided in no state."""
        return [
            claim
            for (key, claim), left in self.hidden.items()
            if key == library and any(not one.entry for one in left)
        ]

    def verdict(self, library: str) -> str:
        """Return a word or two on a library."""
        if library in self.refused:
            return "not installed" if library in self.missing else "no answer"
        if not self.differs(library):
            if library in self.open:
                return "inconclusive" if library in self.decided else "nothing compared"
            return "agrees where decided" if self.undecided(library) else "agrees"
        labels = [one.label for one in self.why[library]]
        return ", ".join(labels) if labels and all(labels) else "differs"

"""Faults as data, in the product and in what judges it, each with the test that must notice it.

`python -m tests.mutants` plants them one at a time and says which are caught, and by name. Faults
of scenes and formulations name the claim that must fail first, and are planted without a copy.
"""

from __future__ import annotations

import re
import subprocess
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PACKAGE = ROOT / "src" / "eomcheck"
KINDS = ("scene", "formulation", "arithmetic", "motion", "harness", "report")

PLANTED = "tests/claims/test_planted_faults.py::test_a_planted_fault_is_caught_and_named"
"""Plants the faults of scenes and formulations itself, and passes if each is named."""


class LostFaultError(Exception):
    """The place of a fault is not in the source, or there are several."""


@dataclass(frozen=True)
class Mutant:
    """One change of the source.

    Attributes:
        id: its name.
        kind: what it is planted in, one of `KINDS`.
        file: path in the package.
        before: text that is there exactly once.
        after: what it becomes.
        catcher: what must fail: arguments of pytest, or a command that begins with `python`.
            `PLANTED` where a claim is to fail.
        named: what it must print then.
        equivalent: why nothing can notice it, "" where something must.
        quick: whether `.ci/run` plants it.
        claim: the claim that must fail first, "" where a test must.
        says: what its Finding must say.
        scene: key of the scene that shows it, "" where it is that of the file.
    """

    id: str
    kind: str
    file: str
    before: str
    after: str
    catcher: str = PLANTED
    named: str = PLANTED.partition("::")[2]
    equivalent: str = ""
    quick: bool = False
    claim: str = ""
    says: str = ""
    scene: str = ""

    def planted(self, package: Path = PACKAGE) -> str:
        """Return the source of `file` with the fault.

        Raises:
            LostFaultError: `before` is not there exactly once.
        """
        source = (package / self.file).read_text(encoding="utf-8")
        count = source.count(self.before)
        if count != 1:
            raise LostFaultError(f"{self.id}: {self.before!r} is {count} times in {self.file}")
        return source.replace(self.before, self.after)


def mutants() -> list[Mutant]:
    """Return all faults that are kept here, kind by kind."""
    return [one for path in sorted(HERE.glob("*.toml")) for one in _read(path)]


def mutants_of(commit: str) -> list[Mutant]:
    """Return all faults that were kept in a commit, as they were then."""
    folder = HERE.relative_to(ROOT).as_posix()
    listed = _git("ls-tree", "--name-only", commit, f"{folder}/").split()
    names = [name for name in listed if name.endswith(".toml")]
    return [
        one for name in names for one in _parse(Path(name).stem, _git("show", f"{commit}:{name}"))
    ]


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(ROOT), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def _read(path: Path) -> Iterator[Mutant]:
    return _parse(path.stem, path.read_text(encoding="utf-8"))


def _parse(kind: str, table: str) -> Iterator[Mutant]:
    """Yield the faults of a kind from its file's text, whose tables are files of the source."""
    for place in tomllib.loads(table)["file"]:
        shared = {"kind": kind} | place | {"file": place["path"]}
        del shared["path"], shared["fault"]
        for fault in place["fault"]:
            title = f"{Path(place['path']).stem}: {fault['before']} => {fault['after']}"
            fields = {"id": title} | shared | fault
            if "named" not in fields and "catcher" in fields:
                fields["named"] = named_in(fields["catcher"])
            yield Mutant(**fields)


def named_in(catcher: str) -> str:
    """Return the test that a catcher names: its last word after `-k` or `::`; "" if none."""
    match = re.search(r"(?:-k |::)(\w+)$", catcher)
    return match[1] if match else ""

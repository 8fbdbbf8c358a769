"""Plant faults one at a time, each in its own copy of the source, and see who notices.

    python -m tests.mutants [--kind harness] [--only ID]... [--since COMMIT] [--quick] [--jobs 2]
        [--table FILE]

A fault is *named* if its catcher fails and prints what it should, *caught* if it only fails, and
has *survived* if nothing happens. It is *skipped*, which is named and not kept, where all tests of
its catcher are: those of an adapter need its library. The test that is to fail runs first, and all
of its catcher where it does not. Every catcher runs once on the source as it is, where it must
pass. Results are kept as they come: the same command goes on where it was stopped, and runs again
only what has changed. The exit code is 0 if every fault is named, explained or skipped.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable
from compileall import compile_dir
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from xml.etree import ElementTree

from tests.mutants import KINDS, PACKAGE, PLANTED, ROOT, LostFaultError, Mutant, mutants, mutants_of

RESULTS = ROOT / "build" / "mutants.jsonl"
LONGEST = 60.0
"""What a catcher may take, s."""
NOTHING_RUN = (4, 5)
"""Exit codes of pytest for arguments that name no test."""
AS_IT_IS = "the source as it is"


@dataclass(frozen=True)
class Result:
    """What became of a fault: "named", "caught", "survived", "skipped", or "error" if not tried."""

    id: str
    kind: str
    outcome: str
    seconds: float
    said: str = ""


def command_of(catcher: str, test: str = "") -> list[str]:
    """Command of a catcher, or of one test of its file."""
    first, *rest = shlex.split(catcher)
    if first == "python":
        return [sys.executable, *rest]
    pytest = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", "--all"]
    return [*pytest, "--tb", "short", f"{first}::{test}" if test else first, *rest]


def commands_of(mutant: Mutant) -> list[list[str]]:
    """Commands to try in turn: the test that is named, which is quick, then the whole catcher."""
    whole = command_of(mutant.catcher)
    text = files_of(mutant.catcher).decode()
    one_file = "::" not in mutant.catcher and mutant.catcher.count(".py") == 1
    if one_file and re.fullmatch(r"test_\w+", mutant.named) and f"\ndef {mutant.named}(" in text:
        return [command_of(mutant.catcher, mutant.named), whole]
    return [whole]


def run(command: list[str], package: Path, longest: float) -> tuple[int, str]:
    """Return (exit code, output) of a command that imports this copy; -1 after too long."""
    environment = os.environ | {
        # Libraries of engines may be in environments of their own, named there.
        "PYTHONPATH": os.pathsep.join(
            (str(package.parent), str(ROOT), os.environ.get("PYTHONPATH", ""))
        ),
        "PYTHONDONTWRITEBYTECODE": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    process = subprocess.Popen(
        command,
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    )
    try:
        return _ended(process, longest)
    except BaseException:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        raise


def _ended(process: subprocess.Popen, longest: float) -> tuple[int, str]:
    try:
        said, _ = process.communicate(timeout=longest)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        said, _ = process.communicate()
        return -1, f"{said}\nnot done after {longest:g} s"
    return process.returncode, said


def all_skipped(said: str) -> bool:
    """Return whether pytest skipped all tests that it chose, by the last line of its output."""
    last = (said.strip().splitlines() or [""])[-1]
    counts = re.findall(r"\d+ (passed|failed|error|skipped|xfailed|xpassed)", last)
    return counts == ["skipped"]


def attempt(mutant: Mutant, longest: float = LONGEST) -> Result:
    """Plant one fault into a copy of the source and run its catcher."""
    start = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
        package = Path(folder) / PACKAGE.name
        shutil.copytree(PACKAGE, package)
        try:
            planted = package / mutant.file
            planted.write_text(mutant.planted(package), encoding="utf-8")
        except LostFaultError as error:
            return Result(mutant.id, mutant.kind, "error", 0.0, str(error))
        for compiled in planted.parent.glob(f"__pycache__/{planted.stem}.*"):
            compiled.unlink()  # of the source as it is
        code, said = 0, ""
        for command in commands_of(mutant):
            code, said = run(command, package, longest)
            if code not in (0, *NOTHING_RUN):
                break
    seconds = time.perf_counter() - start
    if code in (0, *NOTHING_RUN) and all_skipped(said):
        return Result(mutant.id, mutant.kind, "skipped", seconds, said[-2000:])
    if code == -1 or (code in NOTHING_RUN and not mutant.catcher.startswith("python")):
        return Result(mutant.id, mutant.kind, "error", seconds, said[-2000:])
    outcome = "survived" if code == 0 else "named" if mutant.named in said else "caught"
    return Result(mutant.id, mutant.kind, outcome, seconds, "" if code == 0 else said[-2000:])


def unplanted(catcher: str, longest: float = LONGEST) -> Result:
    """Run a catcher on the source as it is: "named" if it passes, as it must, or "skipped"."""
    start = time.perf_counter()
    code, said = run(command_of(catcher), PACKAGE, longest)
    passing = "skipped" if all_skipped(said) else "named"
    outcome = passing if code == 0 or passing == "skipped" else "error"
    return Result(catcher, AS_IT_IS, outcome, time.perf_counter() - start, said[-2000:])


def planted_elsewhere(longest: float = 10 * LONGEST) -> list[Result]:
    """Return what became of the faults by which a claim must fail."""
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
        report = Path(folder) / "planted.xml"
        _, said = run([*command_of(PLANTED), f"--junitxml={report}"], PACKAGE, longest)
        if not report.is_file():
            return [Result("planted", "scene", "error", 0.0, said[-2000:])]
        cases = {case.get("name", ""): case for case in ElementTree.parse(report).iter("testcase")}
    results = []
    for fault in (one for one in mutants() if one.claim):
        name = fault.id.encode("unicode_escape").decode()  # as pytest writes it
        case = cases.get(f"{PLANTED.partition('::')[2]}[{name}]")
        problem = None if case is None else case.find("failure")
        text = "" if problem is None else f"{problem.get('message')}"
        missed = "survived" if "not caught" in text else "caught"
        outcome = "error" if case is None else "named" if problem is None else missed
        seconds = 0.0 if case is None else float(case.get("time", 0.0))
        results.append(Result(fault.id, fault.kind, outcome, seconds, text))
    return results


# ---- What is known already -----------------------------------------------------------------------


def digest(*parts: str | bytes) -> str:
    """Return a key for what a result depends on."""
    found = hashlib.sha256()
    for part in parts:
        found.update(part.encode() if isinstance(part, str) else part)
    return found.hexdigest()


def files_of(catcher: str) -> bytes:
    """Return the tests that a catcher runs."""
    names = (word.partition("::")[0] for word in shlex.split(catcher))
    return b"".join((ROOT / x).read_bytes() for x in names if x.endswith(".py"))


def all_sources() -> str:
    """Return a digest of the package and of what its tests share."""
    files = [*sorted(PACKAGE.rglob("*.py")), *sorted((ROOT / "tests").glob("*.py"))]
    return digest(*(path.read_bytes() for path in files))


class Kept:
    """Results in a file of lines, each with the digest of what they depend on."""

    def __init__(self, path: Path):
        self.path = path
        self.known: dict[str, list[Result]] = {}
        if path.is_file():
            for line in path.read_text(encoding="utf-8").splitlines():
                try:
                    key, rows = json.loads(line)
                    self.known[key] = [Result(**row) for row in rows]
                except (ValueError, TypeError):  # the line at which a run was killed
                    continue

    def add(self, key: str, results: list[Result]) -> None:
        """Keep what came of one job."""
        self.known[key] = results
        self.path.parent.mkdir(parents=True, exist_ok=True)
        row = json.dumps([key, [asdict(result) for result in results]])
        with self.path.open("a", encoding="utf-8") as file:
            # On a line of its own, whatever was cut off before.
            file.write(f"\n{row}\n")


def campaign(
    chosen: list[Mutant],
    kept: Kept,
    jobs: int,
    planted: Callable[[], list[Result]] | None = None,
    tell: Callable[[str], None] = print,
    *,
    passing: bool = False,
    longest: float = LONGEST,
) -> list[Result]:
    """Return what became of the faults, planted several at a time; of `planted` as well.

    Catchers are run on the source as it is, too, but not tests where all are known to be `passing`.
    """
    now = all_sources()
    work: dict[str, Callable[[], Iterable[Result]]] = {}
    names: dict[str, str] = {}
    if planted is not None:
        work[now] = planted
        names[now] = "faults of scenes and formulations"
    for catcher in dict.fromkeys(one.catcher for one in chosen):
        if passing and not catcher.startswith("python"):
            continue
        key = digest(AS_IT_IS, catcher, files_of(catcher), now)
        work[key] = lambda c=catcher: [unplanted(c, longest)]
        names[key] = f"{AS_IT_IS}: {catcher}"
    for one in chosen:
        key = digest(repr(one), (PACKAGE / one.file).read_bytes(), files_of(one.catcher))
        work[key] = lambda m=one: [attempt(m, longest)]
        names[key] = one.id
    results = [result for key in work for result in kept.known.get(key, ())]
    left = {key: job for key, job in work.items() if key not in kept.known}
    compile_dir(PACKAGE, quiet=2)  # each copy is imported by a process of its own
    with ThreadPoolExecutor(jobs) as pool:
        running = {pool.submit(job): key for key, job in left.items()}
        try:
            for count, done in enumerate(as_completed(running), 1):
                key, found = running[done], list(done.result())
                if all(result.outcome not in ("error", "skipped") for result in found):
                    kept.add(key, found)
                results += found
                tell(f"[{count}/{len(left)}] {_counted(found)}: {names[key]}")
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return results


def _counted(results: Iterable[Result]) -> str:
    found = Counter(result.outcome for result in results)
    return ", ".join(f"{count} {outcome}" for outcome, count in found.items())


# ---- What is said --------------------------------------------------------------------------------


def table(results: list[Result], explained: dict[str, str]) -> str:
    """Return the table of kinds, and why the survivors survive, in Markdown."""
    lines = [
        "| kind | faults | caught and named | caught | survived | of them explained |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    mutated = [result for result in results if result.kind in KINDS]
    planted = [result for result in mutated if result.outcome != "skipped"]
    for kind in (*KINDS, "all"):
        of = [result for result in planted if kind in (result.kind, "all")]
        found = Counter(result.outcome for result in of)
        why = sum(result.outcome == "survived" and result.id in explained for result in of)
        counts = len(of), found["named"], found["caught"], found["survived"], why
        lines.append(f"| {kind} | {' | '.join(map(str, counts))} |")
    survived = [result.id for result in mutated if result.outcome == "survived"]
    if survived:
        lines.append("")
    lines += [f"- `{one}`: {explained.get(one, 'not explained')}" for one in sorted(survived)]
    if skipped := sorted(x.id for x in mutated if x.outcome == "skipped"):
        lines += ["", f"Not planted, as the library is not installed: {', '.join(skipped)}."]
    return "\n".join(lines) + "\n"


def open_questions(results: Iterable[Result], explained: dict[str, str]) -> list[Result]:
    """Return what is neither named nor explained, and what is explained and caught all the same.

    Skipped ones are neither.
    """
    return [
        result
        for result in results
        if result.outcome not in ("skipped", "survived" if result.id in explained else "named")
    ]


def main() -> int:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser("python -m tests.mutants", description=__doc__)
    parser.add_argument("--kind", choices=KINDS, help="only faults of this kind")
    parser.add_argument("--only", action="append", help="only the fault of this id; repeatable")
    parser.add_argument("--since", help="only faults that the tables of this commit have not")
    parser.add_argument("--quick", action="store_true", help="ten, after the tests have passed")
    parser.add_argument("--passing", action="store_true", help="after `pytest --all` has passed")
    parser.add_argument("--jobs", type=int, default=2, help="how many at a time")
    parser.add_argument("--longest", type=float, default=LONGEST, help="most for a catcher, s")
    parser.add_argument("--table", type=Path, help="file to write the table to")
    parser.add_argument("--results", type=Path, default=RESULTS, help="file to keep results in")
    asked = parser.parse_args()
    chosen = [one for one in mutants() if not one.claim]
    if asked.only:
        if unknown := set(asked.only) - {one.id for one in chosen}:
            parser.error(f"no such fault: {', '.join(sorted(unknown))}")
        chosen = [one for one in chosen if one.id in asked.only]
    if asked.since:
        before = mutants_of(asked.since)
        chosen = [one for one in chosen if one not in before]
    if asked.kind:
        chosen = [one for one in chosen if one.kind == asked.kind]
    if asked.quick:
        chosen = [one for one in chosen if one.quick]
    whole = not (asked.only or asked.since or asked.quick) and asked.kind in (
        None,
        "scene",
        "formulation",
    )
    start = time.perf_counter()
    results = campaign(
        chosen,
        Kept(asked.results),
        asked.jobs,
        planted_elsewhere if whole else None,
        lambda line: print(line, flush=True),
        passing=asked.quick or asked.passing,
        longest=asked.longest,
    )
    explained = {one.id: one.equivalent for one in chosen if one.equivalent}
    text = table(results, explained)
    print(text, end="")
    if asked.table:
        asked.table.write_text(text, encoding="utf-8")
    left = open_questions(results, explained)
    for result in left:
        print(f"\n{result.id}: {result.outcome}\n{result.said}")
    print(f"{time.perf_counter() - start:.0f} s; {len(left)} to be looked at")
    return 1 if left else 0


if __name__ == "__main__":
    raise SystemExit(main())

"""docs/evidence/verified-equivalences.md is the page that this suite makes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests import reports

import eomcheck
from eomcheck import CLAIMS
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.errors import InputError
from eomcheck.lab.proofs import Proofs, proof_jobs
from eomcheck.lab.report.overview import Overview, read_records
from eomcheck.lab.report.report_formats import (
    PROVED,
    RUN,
    SHARED,
    independent_parameters,
    named_tests,
    write_equivalences,
)
from eomcheck.lab.show.table import ranges
from eomcheck.lab.store.record_file import Records
from eomcheck.lab.store.validation_runs import validate_kind
from eomcheck.scenes import SCENES, Sleigh

ROOT = Path(__file__).parents[2]
PAGE, SUITE = ROOT / "docs/evidence/verified-equivalences.md", ROOT / "validation"

BY_CHANCE = {"refusals"}
"""Claims about states that not every run draws: their scenes are not compared."""


SOME = ("snake", "sleigh", "rolling-disk", "andrews")
"""Scenes that tell all there is to tell of a page; the others are looked at with `--all`."""


@pytest.fixture(scope="module")
def scenes(sized: Callable) -> list[str]:
    """Keys of the scenes that are run."""
    return sized(list(SCENES), [key for key in SCENES if key in SOME])


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory, scenes: list[str]) -> Path:
    """Records of a run of all claims on scenes, as small as it can be."""
    path = tmp_path_factory.mktemp("run") / "run.db"
    with Records(path) as records:
        for kind in map(SCENES.__getitem__, scenes):
            selection = RunSelection.of(scenes=[kind])
            validate_kind(kind, ValidationRun(), selection, (2, 3), 1, 0, lambda: None, records)
            jobs = proof_jobs(kind.key, [2] if kind.has_links else None, 1, 0, None)
            Proofs(jobs, records=records).run()
    return path


def independent_of_run(page: str) -> list[str]:
    """Return the lines of a page that do not depend on the run that it was made from.

    Those are the claims with statements, equations, scenes, levels of evidence and tests; numbers
    of links and of states, errors, places, dates, versions and machines are taken away.
    """
    lines, in_run = [], False
    for line in page.splitlines():
        if line.startswith("## "):
            in_run = line == RUN
        if in_run or not line:
            continue
        lines.append("|".join(line.split("|")[:3]) if line.startswith("| ") else line)
    return lines


def sections(lines: list[str], scenes: list[str]) -> dict[str, list[str]]:
    """Return the lines under each heading of a page, of other scenes none."""
    others = tuple(f"| {key} |" for key in SCENES.keys() - {*scenes})
    found: dict[str, list[str]] = {}
    name = ""
    for line in lines:
        if line.startswith("## "):
            name = line.removeprefix("## ")
        found.setdefault(name, [])
        if not line.startswith(others):
            found[name].append(line)
    return found


@pytest.mark.night
def test_the_page_is_the_one_that_the_suite_makes(small: Path, scenes, tmp_path: Path):
    # Claims, statements, equations, scenes, levels of evidence and tests are compared; not N,
    # numbers of states, errors, places, dates, versions and machines, which are of one run.
    write_equivalences(Overview(read_records([small])), tmp_path / "page.md", SUITE)
    made, stored = (
        sections(independent_of_run(path.read_text(encoding="utf-8")), scenes)
        for path in (tmp_path / "page.md", PAGE)
    )
    others = {"", SHARED.removeprefix("## ")}
    say = "run the commands at the top of docs/evidence/verified-equivalences.md again"
    assert stored.keys() - BY_CHANCE == CLAIMS.keys() - BY_CHANCE | others, say
    for name in stored.keys() - BY_CHANCE:
        assert stored[name] == made[name], f"{name}: {say}"


def test_scenes_are_in_the_order_of_the_registry_whatever_ended_first(
    small: Path, scenes, tmp_path: Path
):
    made = []
    for name, order in (("page.md", 1), ("turned.md", -1)):
        overview = Overview(read_records([small])[::order])
        assert overview.scenes == scenes
        assert [one.scene for one in independent_parameters(overview)] == scenes
        write_equivalences(overview, tmp_path / name, SUITE)
        made.append(independent_of_run((tmp_path / name).read_text(encoding="utf-8")))
    assert made[0] == made[1]


def test_what_no_engine_has_from_elsewhere_is_said_to_be_common(small: Path, scenes):
    found = {one.scene: one for one in independent_parameters(Overview(read_records([small])))}
    assert [*found] == scenes
    assert found["snake"].covered == "mass, length, inertia (pinocchio, from the tree)"
    common = "common mode not covered: stiffness, damping, wheel_angle"
    assert found["snake"].common == common
    assert found["sleigh"][1:] == ("mass, inertia, offset (pinocchio, from the tree)", "-")
    assert found["rolling-disk"].covered == "-", "a disk has no tree"
    assert "radius" in found["rolling-disk"].common


def test_without_an_engine_of_its_own_data_everything_is_common(tmp_path: Path):
    with Records(tmp_path / "r.db") as records:
        selection = RunSelection.of(engines=["casadi"], claims=["mass-matrix"])
        validate_kind(Sleigh, ValidationRun(), selection, (1, 1), 1, 0, lambda: None, records)
    (only,) = independent_parameters(Overview(read_records([tmp_path / "r.db"])))
    assert only[1:] == ("-", "common mode not covered: mass, inertia, offset")


def test_a_mass_that_is_wrong_in_parameters_is_seen_by_an_engine_that_does_not_read_it():
    class Heavier(Sleigh):
        def parameters(self, arithmetic):
            right = super().parameters(arithmetic)
            return right._replace(mass=1.25 * right.mass)

    for engine, verdict in (("casadi", "passed"), ("pinocchio", "failed")):
        scene = Heavier()
        found = eomcheck.check_state(
            scene, [0, 0, 0.3], [0, 0, 1], engines=[engine], claims=["mass-matrix"]
        )
        assert {finding.verdict for finding in found} == {verdict}, engine


def test_a_change_of_the_page_is_seen():
    page = PAGE.read_text(encoding="utf-8")
    lines = independent_of_run(page)
    for old, new in (
        ("M = ∂²T/∂q̇²", "M = ∂T/∂q̇"),
        ("| snake | proved |", "| snake | compared |"),
        ("| sleigh | compared |", "| worm | compared |"),
        ("::test_terms_are_what_defines_them[mass", "::test_it[mass"),
        ("## bias\n", "## biased\n"),
    ):
        assert old in page
        assert independent_of_run(page.replace(old, new, 1)) != lines, old


def test_what_one_run_says_is_not_compared():
    page = PAGE.read_text(encoding="utf-8")
    start = page.index(RUN)
    end = page.index("\n## ", start)
    changed = page[:start] + RUN + "\n\nanother day" + page[end:]
    changed = changed.replace("| snake | compared | 1", "| snake | compared | 99")
    assert changed != page
    assert independent_of_run(changed) == independent_of_run(page)


def test_every_claim_has_a_test_in_the_validation_suite():
    found = named_tests(SUITE)
    assert CLAIMS.keys() <= found.keys()
    assert found[PROVED] == (
        "validation/test_proofs.py::test_every_identity_is_proved_with_4_points",
    )


def test_there_is_no_page_of_what_was_not_verified(tmp_path: Path):
    reports.validated(tmp_path / "bad.db", reports.Heavy)
    reports.validated(tmp_path / "good.db")
    reports.counted(tmp_path / "counts.db")
    for name, suite, says in (
        ("bad.db", SUITE, "not all claims hold"),
        ("counts.db", SUITE, "no finished validation"),
        ("good.db", tmp_path, "holds no validation suite"),
    ):
        with pytest.raises(InputError, match=says):
            write_equivalences(
                Overview(read_records([tmp_path / name])), tmp_path / "page.md", suite
            )
    (tmp_path / "test_x.py").write_text("def test_x(): holds('bias')\n", encoding="utf-8")
    with pytest.raises(InputError, match="claim 'mass-matrix' has no test"):
        write_equivalences(
            Overview(read_records([tmp_path / "good.db"])), tmp_path / "p.md", tmp_path
        )
    assert not (tmp_path / "page.md").exists()


def test_numbers_are_written_as_ranges():
    assert ranges([1, 2, 3, 5, 7, 8]) == "1 to 3, 5, 7 to 8"
    assert ranges([]) == ""

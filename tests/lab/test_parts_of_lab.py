"""Comparing, proofs, times and studies piece by piece, by data that is written down."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any

import numpy as np
import pytest
from tests.lab.test_comparing import Heavy, parting
from tests.robots import arm

from eomcheck.claims.finding import Finding
from eomcheck.engines import PinocchioFile
from eomcheck.engines.file_engine import read_description
from eomcheck.errors import EngineError, InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab import library_comparison, proofs
from eomcheck.lab import proofs as proof_jobs
from eomcheck.lab.discrepancy import Discrepancy, Explanation, explain, relative_scale
from eomcheck.lab.library_comparison import (
    QUANTITIES,
    LibraryComparison,
    LibraryResult,
    compare_libraries,
    library_quantities,
    readers,
    reference_quantities,
)
from eomcheck.lab.proofs import LINKS, ProofJobs, Proofs, numbers_of_links
from eomcheck.lab.store.record_file import Record, Records
from eomcheck.lab.study import (
    RunTime,
    Study,
    document_of,
    failed,
    run_time,
    slope,
    unfinished,
    was_contended,
)
from eomcheck.mechanics.records import State
from eomcheck.scenes import Sleigh, Snake, from_urdf

N = 3
NAMES = "shoulder", "slide", "wrist"


# ---- What came of comparing ----------------------------------------------------------------------


def finding(verdict: Any, claim: str = "bias") -> Finding:
    return Finding(claim, "x", None, None, 1.0, 0.5, verdict, "compared")


def comparison() -> LibraryComparison:
    """Return what came of seven libraries, of which each is another case."""
    scene: Any = SimpleNamespace(name="arm")
    left: Any = [SimpleNamespace(entry=""), SimpleNamespace(entry="M[0, 1]")]
    right = {"bias": finding("passed")}
    wrong = right | {"mass-matrix": finding("failed", "mass-matrix")}
    unsure = {"bias": finding("inconclusive")}
    libraries = (
        LibraryResult("gone", refusal="not installed", missing=True),
        LibraryResult("broken", refusal="no joint"),
        LibraryResult("right", "1", findings=right, decided=True, unresolved={"bias": left[1:]}),
        LibraryResult("open", "1", findings=unsure, decided=False),
        LibraryResult("wrong", "1", findings=wrong, decided=True),
        LibraryResult("mute", "1", findings=right, decided=True, faults={"M": "returned nan"}),
        LibraryResult("blind", "1", findings=right, decided=True, unresolved={"mass-matrix": left}),
        LibraryResult("never", "1"),
    )
    return LibraryComparison(scene, {one.library: one for one in libraries})


def test_each_library_is_told_by_what_came_of_it_alone():
    found = comparison()
    assert {key: one.verdict for key, one in found.libraries.items()} == {
        "right": "agrees",
        "open": "inconclusive",
        "wrong": "differs",
        "mute": "differs",
        "blind": "agrees where decided",
        "never": "nothing compared",
        "gone": "not installed",
        "broken": "no answer",
    }
    assert [key for key, one in found.libraries.items() if one.differs] == ["wrong", "mute"]
    assert [one.claim for one in found.libraries["wrong"].failures] == ["mass-matrix"]
    assert not found.libraries["mute"].failures
    assert found.undecided_libraries == ["open", "never"] and found.unanswered == ["broken"]
    assert found.libraries["blind"].undecided_claims == ["mass-matrix"]
    assert not found.libraries["right"].undecided_claims
    assert (found.disagree, found.agree) == (True, False)


def test_nothing_is_an_error_beside_a_disagreement():
    found = comparison()
    for one in found.answered:
        one.decided = None
    found.check_decided()


@pytest.mark.parametrize(
    ("labels", "verdict"),
    [
        (["fewer digits"], "fewer digits"),
        (["no damping", "no M"], "no damping, no M"),
        (["no damping", ""], "differs"),
        ([], "differs"),
    ],
)
def test_a_difference_has_a_name_where_all_of_it_is_explained(labels, verdict):
    found = comparison()
    wrong = found.libraries["wrong"]
    wrong.explanations = [Explanation("a sentence", label) for label in labels]
    assert wrong.verdict == verdict


def test_one_kind_of_disagreement_is_enough_and_nothing_decided_is_an_error():
    found = comparison()
    del found.libraries["wrong"].findings["mass-matrix"]
    assert found.disagree
    found.libraries["mute"].faults.clear()
    assert (found.disagree, found.agree) == (False, True)
    found.check_decided()
    found.self_failures = [finding("failed")]
    assert (found.disagree, found.agree) == (True, False)
    found.self_failures = []
    for one in found.answered:
        one.decided = False if one.library == "open" else None
    assert (found.disagree, found.agree) == (False, False)
    with pytest.raises(InputError, match=r"^arm: nothing was decided about right, open, wrong, "):
        found.check_decided()


# ---- Comparing -----------------------------------------------------------------------------------


def test_a_library_that_is_not_installed_is_left_out_unless_it_was_named(monkeypatch, tmp_path):
    class Gone(PinocchioFile):
        key = "gone_file"

    def version_of(kind):
        if kind is Gone:
            raise EngineError("gone is not installed")
        return "1.2"

    monkeypatch.setattr(library_comparison, "version_of", version_of)
    monkeypatch.setitem(library_comparison.BY_FORMAT, "urdf", {"gone": Gone, "here": PinocchioFile})
    scene, told = from_urdf(arm(tmp_path / "arm.urdf")), []
    found = compare_libraries(scene, states=2, advance=lambda: told.append(1))
    (gone,), (here,) = found.refused, found.answered
    assert (gone.library, gone.refusal, gone.missing) == ("gone", "gone is not installed", True)
    assert (here.library, here.version, found.states, len(told)) == ("here", "1.2", 2, 2)
    with pytest.raises(EngineError, match="gone is not installed"):
        compare_libraries(scene, ["gone", "here"], states=1)
    assert list(readers(scene, ["here"])) == ["here"] and len(readers(scene, None)) == 2


@pytest.mark.night
def test_what_no_state_resolves_is_kept_by_library_and_why_is_told_once(monkeypatch, tmp_path):
    left = {
        "mass-matrix": [SimpleNamespace(finding=SimpleNamespace(engine=PinocchioFile), entry="")],
        "bias": [SimpleNamespace(finding=SimpleNamespace(engine=None), entry="")],
    }
    monkeypatch.setattr(library_comparison, "unresolved_by_claim", lambda findings: left)
    monkeypatch.setitem(library_comparison.BY_FORMAT, "urdf", {"a": Heavy, "b": PinocchioFile})
    found = compare_libraries(from_urdf(arm(tmp_path / "arm.urdf")), states=3)
    a, b = found.libraries["a"], found.libraries["b"]
    assert (a.unresolved, b.unresolved) == ({}, {"mass-matrix": left["mass-matrix"]})
    assert [one.label for one in a.explanations] == [""] and b.explanations == []
    assert (a.verdict, b.verdict) == ("differs", "agrees where decided")
    assert a.findings and b.findings
    gravity = found.differences["gravity"]
    assert gravity.shape == (3, 3) and gravity[0, 1] == gravity[1, 0] > 1e-4 > gravity[0, 2]
    assert gravity[1, 2] > 1e-4 and not gravity.diagonal().any()


def test_the_largest_difference_of_all_states_is_kept_for_each_quantity(monkeypatch, tmp_path):
    sizes = [1e-3, 3e-3, 2e-3]

    class Drifting(PinocchioFile):
        key = "drifting_file"

        def mass_matrix(self, q, t=0.0):
            M = super().mass_matrix(q, t)
            largest_entries[len(asked)] = np.abs(M).max()
            return M * (1.0 + sizes[len(asked)])

    asked: list = []
    largest_entries: dict[int, float] = {}

    def advance():
        if len(asked) < 2:
            asked.append(1)

    monkeypatch.setitem(library_comparison.BY_FORMAT, "urdf", {"a": Drifting})
    scene = from_urdf(arm(tmp_path / "arm.urdf"))
    found = compare_libraries(scene, states=3, advance=advance)
    apart = max(size * largest_entries[i] for i, size in enumerate(sizes))
    entry = max((1.0 + size) * largest_entries[i] for i, size in enumerate(sizes))
    assert found.differences["M"][0, 1] == pytest.approx(apart / entry, rel=1e-6)
    worst = found.libraries["a"].findings["mass-matrix"]
    assert worst.verdict == "failed" and found.libraries["a"].decided


def test_quantities_are_taken_moving_and_at_rest_and_sized_by_what_they_are_summed_from(tmp_path):
    scene = from_urdf(arm(tmp_path / "arm.urdf", damping="0.3"))
    state = State(np.array([0.3, -0.2, 0.9]), np.array([0.5, 0.4, -1.0]), 0.0)
    at, rest = Evaluation(scene, *state), Evaluation(scene, state.q, 0 * state.v, 0.0)
    found = LibraryComparison(scene)
    ours = reference_quantities(found, at)
    assert list(ours) == list(QUANTITIES) and found.skipped == []
    for name, value in (("M", at.terms.M), ("bias", at.terms.B), ("forces", at.terms.Q)):
        assert np.array_equal(ours[name], value)
    assert np.array_equal(ours["gravity"], rest.terms.Q)
    assert (ours["forces"] - ours["gravity"]).tolist() == pytest.approx([0.0, -0.12, 0.0])
    summed = {name: one.summed(at) for name, one in QUANTITIES.items()}
    assert summed["M"] == summed["q̈"] == 0.0 < summed["bias"]
    assert summed["gravity"] == summed["forces"] != summed["bias"]
    pin = LibraryResult("pin", "1", engine=PinocchioFile(scene))
    told = library_quantities(pin, at, ours, ours)
    assert np.allclose(told["M"], ours["M"]) and np.allclose(told["gravity"], ours["gravity"])
    still = from_urdf(tmp_path / "arm.urdf", gravity=None)
    of_still = reference_quantities(
        LibraryComparison(still), Evaluation(still, state.q, 0 * state.v, 0.0)
    )
    assert of_still["gravity"].tolist() == [0.0] * 3


def test_the_first_fault_of_a_quantity_is_kept_and_said_once(tmp_path):
    scene, asked = from_urdf(arm(tmp_path / "arm.urdf")), []

    class Failing(PinocchioFile):
        def mass_matrix(self, q, t=0.0):
            asked.append(1)
            raise RuntimeError(f"time {len(asked)}")

    failing = LibraryResult("x", "1", engine=Failing(scene))
    at = Evaluation(scene, np.zeros(3), np.zeros(3), 0.0)
    for _ in range(2):
        told = library_quantities(failing, at, ["M", "bias"], ["M", "bias"])
        assert list(told) == ["bias"]
    ((quantity, said),) = failing.faults.items()
    assert quantity == "M" and "time 1" in said
    assert [(one.label, "time 1" in one.sentence) for one in failing.explanations] == [
        ("no M", True)
    ]


# ---- Why -----------------------------------------------------------------------------------------


def at_of(tmp_path: Path, **theirs: Any) -> Discrepancy:
    """Return a robot of which these quantities are otherwise."""
    ours = {
        "M": np.diag([4.0, 1.0, 0.5]) + 0.25,
        "bias": np.array([1.0, -2.0, 3.0]),
        "gravity": np.array([-9.0, 2.0, 0.5]),
        "forces": np.array([-9.0, 1.5, 0.5]),
        "q̈": np.array([1.0, 2.0, -3.0]),
    }
    of = read_description(arm(tmp_path / "arm.urdf"))
    return Discrepancy(of, NAMES, np.array([0.5, -1.0, 2.0]), ours, ours | theirs, {})


def changed(at: Discrepancy, name: str, share: float, place: int = 1) -> Discrepancy:
    theirs = at.library[name].copy()
    theirs[place] += share * np.abs(at.reference[name]).max()
    return at._replace(library=at.library | {name: theirs})


@pytest.mark.parametrize("name", ["M", "bias", "gravity"])
@pytest.mark.parametrize(
    ("share", "label"),
    [(0.5e-13, None), (2e-13, "fewer digits"), (0.9e-8, "fewer digits"), (1.1e-8, None)],
)
def test_fewer_digits_are_between_rounding_and_eight_digits_of_any_term(
    tmp_path, name, share, label
):
    at = changed(at_of(tmp_path), name, share)
    said = [one.label for one in explain(at) if one.sentence.startswith("the same but for digits")]
    assert said == ([] if label is None else [label])
    assert at.terms_agree == (share < 1e-8) and at.agrees_on(name, 1.2 * share)
    other = changed(at, "q̈", 1e-3)
    said = [one.label for one in explain(other) if one.sentence.startswith("the same but for")]
    assert said == ([] if label is None else [""])


def test_another_gravity_is_a_factor_of_the_whole_vector(tmp_path):
    at = at_of(tmp_path)
    ours = at.reference["gravity"]
    half = at._replace(library=at.library | {"gravity": -0.5 * ours})
    assert Explanation("has -0.5 times our gravity") in explain(half)
    assert not [x for x in explain(changed(half, "gravity", 1e-7)) if "gravity" in x.sentence]
    assert [x for x in explain(changed(half, "gravity", 1e-9)) if "gravity" in x.sentence]
    still = at._replace(reference=at.reference | {"gravity": 0 * ours})
    assert not [x for x in explain(still) if "gravity" in x.sentence]


def test_an_armature_is_told_only_where_nothing_beside_the_diagonal_and_no_bias_differs(tmp_path):
    at = at_of(tmp_path)
    M = at.reference["M"] + np.diag([0.5, 0.0, 0.25])
    armature = at._replace(library=at.library | {"M": M})
    said = "adds to the diagonal of M alone, as an armature does: shoulder, wrist"
    assert [one.sentence for one in explain(armature)] == [said]
    less = at._replace(library=at.library | {"M": at.reference["M"] - np.diag([0.5, 0.0, 0.25])})
    said = "has less on the diagonal of M alone, as without an armature: shoulder, wrist"
    assert [one.sentence for one in explain(less)] == [said]
    beside = M.copy()
    beside[0, 1] = beside[1, 0] = 0.25 + 1e-6
    for other in (
        armature._replace(library=armature.library | {"M": beside}),
        changed(armature, "bias", 1e-6),
    ):
        assert not [x for x in explain(other) if "armature" in x.sentence]


def test_what_is_left_out_by_dampers_is_measured_by_what_the_largest_takes(tmp_path):
    of = read_description(arm(tmp_path / "arm.urdf", damping="0.5"))
    at = at_of(tmp_path)._replace(description=of)
    assert at.damped == [1]
    taken = at.reference["forces"] - at.reference["gravity"]  # -0.5 times a velocity of 1 m/s
    theirs = at.reference["q̈"] - np.linalg.solve(at.reference["M"], taken * [0, -1, 0] * [0, -1, 0])
    for share, told in ((0.0, True), (0.3e-8, True), (1e-6, False)):
        missing = np.linalg.solve(at.reference["M"], np.array([0.0, 0.0, share]))
        one = at._replace(v=np.array([0.5, 1.0, 2.0]), library=at.library | {"q̈": theirs + missing})
        assert one.leaves_out_damping == told, share
        assert [x.label for x in explain(one)] == (["no damping"] if told else [])
        assert not changed(one, "bias", 1e-6).leaves_out_damping
        assert not one._replace(v=-one.v).leaves_out_damping
    assert not at.leaves_out_damping  # nothing differs
    assert not at_of(tmp_path)._replace(library=at.library | {"q̈": theirs}).leaves_out_damping


def test_differences_are_relative_to_what_cancelled_where_it_is_a_thousand_times_as_large():
    assert relative_scale(2.0, 1999.0) == 2.0 and relative_scale(2.0, 2001.0) == 2001.0
    assert relative_scale(0.0, 0.0) == 0.0 and relative_scale(0.0, 3.0) == 3.0


def test_odd_bodies_are_told_each_kind_by_its_own_names(tmp_path):
    at = parting(tmp_path / "arm.urdf")
    of = at.description._replace(massless=("a",), impossible=("b", "c"), empty=("d",))
    said = [one.sentence for one in explain(at._replace(description=of))]
    assert said == [
        "the file has moments of inertia without mass (a), which libraries may drop",
        "the file has inertias that no body can have (b, c), which libraries may change",
        "the file has links without inertia (d), to which libraries may give some",
    ]


# ---- Proofs --------------------------------------------------------------------------------------


def test_numbers_of_links_are_those_asked_for_or_as_many_as_a_kind_may_have():
    class Few(Snake, functions=()):
        most_links = 5

    assert LINKS == (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 20, 50, 100)
    assert tuple(numbers_of_links(Snake, None, "snake")) == LINKS
    assert tuple(numbers_of_links(Few, None, "few")) == (1, 2, 3, 4, 5)
    assert tuple(numbers_of_links(Few, (2, 3), "few")) == (2, 3)
    assert tuple(numbers_of_links(Sleigh, None, "sleigh")) == (None,)
    assert tuple(numbers_of_links(Sleigh, (2, 3), "all")) == (None,)
    assert tuple(numbers_of_links(Sleigh, (2, 3), "sleigh")) == (2, 3)  # and is refused later
    with pytest.raises(InputError):
        proof_jobs.proof_jobs("sleigh", (2,), 1, 0, None)


def proved(verdict: str, structure: str) -> Any:
    return SimpleNamespace(verdict=verdict, structure=structure, scene="snake")


@pytest.fixture
def chains(monkeypatch) -> tuple[list, list]:
    """Return chains of 3, 30 and 40 coordinates, and where each is proved and how."""
    asked: list = []

    def prove(scene, formulations, points, seed, claims):
        asked.append(("here", scene.structure, formulations, points, seed))
        return [proved("passed", scene.structure)]

    def spread(where, work, scenes):
        for scene in scenes:
            asked.append((where, scene.structure, work.keywords))
            yield scene, [proved("passed", scene.structure)]

    monkeypatch.setattr(proofs, "_prove", prove)
    monkeypatch.setattr(proofs, "parallel_map", spread)
    monkeypatch.setattr(proofs, "findings_record", lambda found: None)
    monkeypatch.setattr(Proofs, "_keep", lambda *_: None)
    scenes = [SimpleNamespace(n=n, structure=f"chain[{n}]") for n in (3, 40, 39, 60)]
    return scenes, asked


def test_large_scenes_are_spread_where_there_are_several_and_all_others_proved_here(chains):
    scenes, asked = chains
    keywords = {"formulations": ("au",), "points": 2, "seed": 7, "claims": None}
    run = Proofs(ProofJobs(tuple(scenes), ("au",), 2, 7), executor="local:2")
    run.run()
    assert asked == [
        ("here", "chain[3]", ("au",), 2, 7),
        ("here", "chain[39]", ("au",), 2, 7),
        ("local:2", "chain[40]", keywords),
        ("local:2", "chain[60]", keywords),
    ]
    assert set(run.findings) == {one.structure for one in scenes} and run.taken_over == 0
    asked.clear()
    Proofs(ProofJobs(tuple(scenes[:3]), ("au",), 2, 7), executor="local:2").run()
    assert [(one[0], one[1]) for one in asked] == [
        ("here", "chain[3]"),
        ("here", "chain[40]"),
        ("here", "chain[39]"),
    ]


@pytest.mark.parametrize(
    ("verdicts", "told"),
    [
        (["passed", "inconclusive"], (False, True)),
        (["inconclusive", "skipped"], (False, False)),
        (["passed", "failed"], (True, True)),
        (["failed"], (True, True)),
        ([], (False, False)),
    ],
)
def test_a_run_of_proofs_fails_by_one_and_is_decided_by_one(verdicts, told):
    run = Proofs(ProofJobs((), (), 1, 0))
    run.findings = {f"chain[{i}]": [proved(x, "")] for i, x in enumerate(verdicts)}
    assert (run.failed, run.decided) == told


def test_proofs_taken_over_are_kept_in_the_other_file_too_and_written_with_what_made_them(
    tmp_path: Path,
):
    jobs = proof_jobs.proof_jobs("sleigh", None, 1, 3, ["au", "kane"])
    Proofs(jobs, tmp_path / "p.json").run()
    with Records(tmp_path / "r.db") as records:
        again = Proofs(jobs, tmp_path / "p.json", records=records)
        again.run()
        assert again.taken_over == 1 and len(records) == 1
    again.write()
    document = json.loads((tmp_path / "p.json").read_text())
    assert {name: document[name] for name in ("formulations", "points", "seed")} == {
        "formulations": ["au", "kane"],
        "points": 1,
        "seed": 3,
    }
    other = proof_jobs.proof_jobs("sleigh", None, 1, 3, ["au"])
    (rows,) = document["findings"].values()
    assert {row["verdict"] for row in rows} == {"passed"} and all("proof" in row for row in rows)
    Proofs(jobs, tmp_path / "p.json").run()
    run = Proofs(other, tmp_path / "p.json")
    run.run()
    assert (run.taken_over, run.started_over) == (0, True)


# ---- Times ---------------------------------------------------------------------------------------


def test_quartiles_are_of_all_runs_and_long_work_ends_with_the_fewest(monkeypatch):
    def timed(*walls: float, **options: Any) -> RunTime:
        starts = [x for wall in walls for x in (0.0, wall)]
        cpus = [x for wall in walls for x in (0.0, wall / 2)]
        monkeypatch.setattr("eomcheck.lab.study.time.perf_counter", lambda: starts.pop(0))
        monkeypatch.setattr("eomcheck.lab.study.time.thread_time", lambda: cpus.pop(0))
        return run_time(lambda: None, **options)

    found = timed(4.0, 1.0, 3.0, 2.0, 9.0, runs=5, long=99.0)
    assert (found.seconds, found.cpu_seconds, found.quartiles) == (1.0, 0.5, (2.0, 4.0))
    assert timed(2.1, 2.2, 2.3).runs == 3
    assert timed(2.1, 2.2, 1.9, 2.0, 2.0, runs=5).runs == 5
    assert timed(1.9, *[3.0] * 19).runs == 20


@pytest.mark.parametrize(
    ("seconds", "cpu", "told"),
    [
        (1.04, 1.0, False),
        (1.06, 1.0, True),
        (1.0, 1.06, False),
        (None, 1.0, False),
        (1.0, None, False),
    ],
)
def test_a_run_is_disturbed_where_a_twentieth_of_it_was_another_program_s(seconds, cpu, told):
    assert was_contended(Record("x", {}, seconds=seconds, cpu_seconds=cpu)) == told


def test_a_slope_is_the_power_of_y_over_x():
    assert slope([(1, 5.0), (2, 20.0), (4, 80.0)]) == pytest.approx(2.0)
    assert slope([(1, 8.0), (2, 4.0), (4, 8.0), (8, 1.0)]) == pytest.approx(-0.8)


# ---- Studies -------------------------------------------------------------------------------------


def cells(
    *,
    number: Annotated[int, "How many."] = 2,
    quick: Annotated[bool, "Less."] = False,
    scale: Annotated[float, "A factor, of the worker alone."] = 1.0,
):
    if number < 0:
        raise InputError(f"number = {number}")
    return [{"case": i, "quick": quick} for i in range(number)]


def study(key: str, asked: list, **more: Any) -> Study:
    def worker(found, *, scale=1.0):
        def work(settings):
            asked.append((key, settings["case"], scale, len(found)))
            return Record(key, settings, errors={"x": scale * settings["case"]})

        return work

    usual = {"cells": cells, "worker": worker, "tables": lambda found: [], "label": ""}
    return Study(key=key, **(usual | more))


def test_a_study_hands_its_options_on_and_works_those_before_it_first():
    asked: list = []
    first = study("first", asked)
    second = study("second", asked, before=(first,), parallel_by=())
    found = second.run(number=2, scale=3.0, quick=True)
    assert asked == [
        ("first", 0, 3.0, 0),
        ("first", 1, 3.0, 0),
        ("second", 0, 3.0, 2),
        ("second", 1, 3.0, 2),
    ]
    assert [(one.study, one.settings["case"], one.errors["x"]) for one in found] == [
        ("first", 0, 0.0),
        ("first", 1, 3.0),
        ("second", 0, 0.0),
        ("second", 1, 3.0),
    ]
    assert all(one.settings["quick"] for one in found)
    assert list(second.options()) == ["number", "quick", "scale"]
    assert list(study("x", asked, parallel_by=("case",)).options()) == [
        "number",
        "quick",
        "scale",
        "executor",
    ]
    others = [*found, Record("third", {})]
    assert second.of(others) == found and first.of(others) == found[:2]


def test_stored_results_of_a_study_are_those_of_its_file_and_nothing_is_run(tmp_path: Path):
    asked: list = []
    file, one = tmp_path / "r.db", study("one", asked)
    first = one.run(file)
    with Records(file) as records:
        records.forget("one", [first[0].settings])
    assert one.run(file, stored=True) == first[1:] and len(asked) == 2
    both = study("two", asked, before=(one,))
    assert both.run(file, stored=True) == first[1:] and len(asked) == 2
    for where, fresh, why in (
        (None, False, "of no file, expected --records with a file"),
        (tmp_path / "none.db", False, "none.db', expected --records with a file"),
        (file, True, "with --fresh"),
    ):
        with pytest.raises(InputError, match=f"^stored results are asked for .*{why}$"):
            one.run(where, fresh, stored=True)
    assert not (tmp_path / "none.db").exists()


def test_a_study_measures_anew_what_is_known_only_if_asked_to(tmp_path: Path):
    asked: list = []
    one = study("one", asked)
    for fresh, count in ((False, 2), (False, 2), (True, 4), (False, 4)):
        assert len(one.run(tmp_path / "r.db", fresh)) == 2
        assert len(asked) == count


def test_options_that_make_no_sense_leave_no_file_of_the_study_or_of_those_before(tmp_path: Path):
    asked: list = []
    second = study("second", asked, before=(study("first", asked),))
    with pytest.raises(InputError, match="number = -1"):
        second.run(tmp_path / "r.db", number=-1)
    with pytest.raises(InputError):
        study("x", asked, parallel_by=("case",)).run(tmp_path / "r.db", executor="nowhere")
    assert not asked and not [*tmp_path.iterdir()]


def test_what_is_not_done_is_told_and_what_failed_is_an_alarm():
    found = [
        Record("x", {"a": 1, "b": "c"}, "failed", reason="no digits"),
        Record("x", {"a": 2}),
        Record("x", {"a": 3}, "refused", reason="too large"),
    ]
    assert list(unfinished(found)) == ["a 1, b c failed: no digits", "a 3 refused: too large"]
    assert failed(found) and not failed(found[1:])


def test_documents_of_rows_have_null_for_what_is_not_finite(monkeypatch):
    @dataclass
    class Row:
        name: str
        x: float

    rows = [Row("nan", np.nan), Row("a", 0.0), Row("b", -np.inf), Row("c", 2.5)]
    monkeypatch.setattr("eomcheck.lab.study.rows_in", lambda found, kind: rows)
    assert document_of("rows", Row)([]) == {
        "rows": [
            {"name": "nan", "x": None},
            {"name": "a", "x": 0.0},
            {"name": "b", "x": None},
            {"name": "c", "x": 2.5},
        ]
    }


def test_a_library_that_was_decided_once_stays_so_whatever_follows():
    result, found = LibraryResult("one"), []
    for verdict in ("skipped", "inconclusive", "passed", "inconclusive", "skipped"):
        about = "mass-matrix", "one", Snake.example(), None, 0.0, 1.0
        result.add(Finding(*about, verdict, "property-tested"))
        found.append(result.decided)
    assert found == [None, False, True, True, True]

"""What searches start from, ask and decide, and how references are made, of numbers by hand."""

from __future__ import annotations

import json
import math
from collections import Counter
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from eomcheck.claims import Finding
from eomcheck.draws import fuzz_cases as mutation
from eomcheck.draws.fuzz_cases import StructuralVariant
from eomcheck.errors import EomcheckError, InputError, RefusedError
from eomcheck.evaluation.dynamics import velocity
from eomcheck.evaluation.tolerance import NOTICEABLE, UNDERFLOW
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab import references, study
from eomcheck.lab import references as reference_runs
from eomcheck.lab.fuzzing import campaign, motion_comparison, motion_rounds, screening
from eomcheck.lab.fuzzing.campaign import Campaign, RoundResult
from eomcheck.lab.references import REFERENCE_CASES, ReferenceCase
from eomcheck.lab.show import pictures
from eomcheck.lab.show.table import Cell
from eomcheck.mechanics.records import State
from eomcheck.motion.reference_solution import load_reference
from eomcheck.scenes import ChainPendulum, Sleigh, Snake, TurntableBall

# ---- Motions by one formulation ------------------------------------------------------------------


def cases_of(*scenes: Any) -> list[tuple[Any, State]]:
    """Return cases of sleighs, each in a state of its own."""
    return [
        (scene, State(np.array([i, 0.1, 0.2]), np.array([10.0 + i, 20.0, 30.0]), 0.0))
        for i, scene in enumerate(scenes)
    ]


@pytest.fixture
def asked(monkeypatch) -> list[tuple[tuple, dict]]:
    seen: list[tuple[tuple, dict]] = []

    def simulate_many(*of, **options):
        seen.append((of, options))
        if of[1] == "refusing":
            raise InputError("no")
        m, k = len(options["q0"]), len(options["output_times"])
        q = np.full((m, k, 3), 1.0)
        reason = np.array(["why"] * m)
        return SimpleNamespace(q=q, v=q + 1, energy="E", status="S", reason=reason)

    def simulate(*of, **options):
        seen.append((of, options))
        if of[1] == "refusing":
            raise RefusedError("M", 0.0, 1.0, "no")
        k = 40
        q = np.arange(3.0 * k).reshape(k, 3)
        return SimpleNamespace(times=options["output_times"][:k], q=q, v=-q)

    monkeypatch.setattr(motion_comparison, "simulate_many", simulate_many)
    monkeypatch.setattr(motion_comparison, "simulate", simulate)
    return seen


def test_motions_of_several_scenes_are_asked_with_the_numbers_of_each(asked):
    light, heavy = Sleigh.example(), Sleigh(mass=7.0, offset=0.25)
    found = motion_comparison.simulate_batch(cases_of(light, heavy), "au", 2.0, 1e-7, most=300)
    ((of, options),) = asked
    assert of == (light, "au", 2.0)
    given = options.pop("parameters")
    assert given["mass"].tolist() == [light.mass, 7.0]
    assert given["offset"].tolist() == [light.offset, 0.25]
    assert options.pop("q0").tolist() == [[0.0, 0.1, 0.2], [1.0, 0.1, 0.2]]
    assert options.pop("v0").tolist() == [[10.0, 20.0, 30.0], [11.0, 20.0, 30.0]]
    assert options.pop("output_times") == pytest.approx(np.arange(65) / 32)
    assert options == {"rtol": 1e-7, "atol": 1e-7, "max_steps": 300}
    assert found is not None and found.y.shape == (2, 65, 6)
    assert found.y[0, 0].tolist() == [1.0] * 3 + [2.0] * 3
    assert (found.energy, found.status, found.reason.tolist()) == ("E", "S", ["why"] * 2)


def test_motions_of_one_scene_need_no_numbers_and_take_a_thousand_steps(asked):
    one = Sleigh.example()
    motion_comparison.simulate_batch(cases_of(one, one), "au", 1.0, 1e-9)
    ((_, options),) = asked
    assert (options["parameters"], options["max_steps"]) == ({}, 1000)
    assert motion_comparison.simulate_batch(cases_of(one), "refusing", 1.0, 1e-9) is None


def test_parameters_that_a_scene_lacks_are_not_set(asked):
    first, second = (ChainPendulum.rods(2) for _ in range(2))
    state = State(np.zeros(2), np.zeros(2), 0.0)
    snakes = Snake.coil(2), Snake.coil(2)
    motion_comparison.simulate_batch([(one, state) for one in (first, second)], "au", 1.0, 1e-9)
    motion_comparison.simulate_batch([(one, state) for one in snakes], "au", 1.0, 1e-9)
    assert all(len(x) == 2 for _, options in asked for x in options["parameters"].values())
    assert "damping" not in asked[1][1]["parameters"]
    assert asked[1][1]["parameters"]["stiffness"].shape == (2, 1)


def test_a_motion_alone_takes_another_integrator_and_ten_times_the_steps(asked):
    ((scene, state),) = cases_of(Sleigh.example())
    found = motion_comparison.simulate_single((scene, state), "kane", 3.2, 1e-6)
    ((of, options),) = asked
    assert of == (scene, "kane", 3.2)
    assert options.pop("q0") is state.q and options.pop("v0") is state.v
    assert options.pop("output_times") == pytest.approx(np.arange(65) / 20)
    tolerances = {"rtol": 1e-6, "atol": 1e-6}
    assert options == tolerances | {"integrator": "Vern8", "max_steps": 10_000}
    assert found is not None and found.shape == (1, 65, 6)
    assert found[0, 39].tolist() == [117.0, 118.0, 119.0, -117.0, -118.0, -119.0]
    assert np.isnan(found[0, 40:]).all() and np.isfinite(found[0, :40]).all()
    assert motion_comparison.simulate_single((scene, state), "refusing", 3.2, 1e-6) is None


# ---- Where motions begin -------------------------------------------------------------------------


def test_what_begins_is_closed_at_0_and_known_by_its_place(monkeypatch):
    def closed(scene, q, t):
        assert t == 0.0
        if q[0] == 2.0:
            raise RefusedError("a", 0.0, 1.0, "no such position")
        return q + 0.5

    def consistent(scenes, states, velocities):
        wished = velocities(None)
        assert all((x.t, *x.v) == (0.0, *[0.0] * 5) for x in states)
        cases = [(s, State(x.q, v, 0.0)) for s, x, v in zip(scenes, states, wished, strict=True)]
        return cases[1:], list(range(1, len(cases)))

    monkeypatch.setattr(motion_rounds, "assembled_position", closed)
    monkeypatch.setattr(motion_rounds, "consistent", consistent)
    scene = TurntableBall(swing=1.0, frequency=3.0)
    given = [(scene, State(np.full(5, float(i)), np.full(5, 10.0 * i), 7.0)) for i in range(5)]
    begun, places = motion_rounds.at_start(given)
    assert places == [1, 3, 4]
    assert [(x.q[0], x.v[0], x.t) for _, x in begun] == [
        (1.5, 10.0, 0.0),
        (3.5, 30.0, 0.0),
        (4.5, 40.0, 0.0),
    ]
    still = [(Sleigh.example(), State(np.ones(3), np.ones(3), 7.0))]
    begun, places = motion_rounds.at_start(still)
    assert places == [0] and begun[0][1].t == 0.0 and begun[0][1].v.tolist() == [1.0] * 3
    assert motion_rounds.at_start([]) == ([], [])


# ---- Cases near others ---------------------------------------------------------------------------


class Scripted:
    """Draws what it is told: a way to change entries at (1, 2), to a scale of 0.1."""

    def __init__(self, way: int, pick: int = -1):
        self.way, self.pick = way, pick

    def integers(self, low, high=None, size=None):
        if size == 2:
            return np.array([1, 2])
        if (low, high) == (0, 2):
            return 1 if size is None else np.array([0, 1, 1])
        return self.way

    def uniform(self, low, high):
        assert (low, high) == (-16, 0)
        return -1.0

    def normal(self, mean=0.0, deviation=1.0, size=None):
        half = 0.5 if size is None else np.array([0.5, 0.25, -1.0])
        return mean + deviation * half

    def choice(self, of, size=None):
        return of[self.pick] if size is None else np.array([1.0, 1.0, -1.0])

    def random(self, size):
        return np.array([0.2, 0.7, 0.4])


@pytest.mark.parametrize(
    ("way", "pick", "expected"),
    [
        (0, -1, [2.0, 30.0, 5.0]),
        (1, -1, [2.0, 3.15, 5.0]),
        (2, -1, [2.0, 5.05, 5.0]),
        (2, 0, [2.0, 5.0, 5.0]),
        (3, -1, [2.0, math.pi, 5.0]),
        (3, 2, [2.0, math.pi / 2, 5.0]),
        (4, -1, [2.0, 3.05, 5.0]),
        (5, -1, [2.0, 30.0, 5.0]),
        (6, -1, [2.0, -3.0, 5.0]),
        (7, 0, [3.0, 3.0 + 0.025, -3.0 - 0.1]),
        (8, -1, [2.9, 3.0, 3.2]),
        (9, -1, [20.0, 30.0, 50.0]),
    ],
)
def test_entries_change_in_ten_ways(way, pick, expected):
    x, other = np.array([[2.0, 3.0, 5.0]]), np.array([[20.0, 30.0, 50.0]])
    found = mutation.changed_entries(x, other, cast(Any, Scripted(way, pick)))
    assert found.shape == (1, 3) and found[0] == pytest.approx(expected)
    assert x.tolist() == [[2.0, 3.0, 5.0]], "what it comes from is left as it is"


def test_one_to_three_parts_change_and_what_cannot_be_negative_stays_so(monkeypatch):
    taken: list[tuple[float, float]] = []

    def changed(x, other, random):
        taken.append((float(np.ravel(x)[0]), float(np.ravel(other)[0])))
        return -(np.asarray(x) + 1000.0)

    monkeypatch.setattr(mutation, "changed_entries", changed)
    kind = Sleigh
    ranges = kind.ranges(None)
    scene, donor = kind.example(), kind(mass=77.0, offset=0.77)
    case = scene, State(np.full(3, 1.0), np.full(3, 2.0), 5.0)
    other = donor, State(np.full(3, 11.0), np.full(3, 22.0), 6.0)
    random, counts, seen = np.random.default_rng(0), Counter(), Counter()
    for _ in range(200):
        before = len(taken)
        made, q, v = mutation._changed(case, other, random)
        counts[len(taken) - before] += 1
        seen.update(
            [("q" if y == 11 else "v" if y == 22 else "parameter") for _, y in taken[before:]]
        )
        for name, one in ranges.items():
            new, old = np.ravel(getattr(made, name))[0], np.ravel(getattr(scene, name))[0]
            assert new == old or (new > 0) == (one.low >= 0), name
        assert (q[0] == 1.0 or q[0] < 0) and (v[0] == 2.0 or v[0] < 0)
    assert set(counts) == {1, 2, 3} and min(counts.values()) > 40
    assert min(seen.values()) > 50 and set(seen) == {"q", "v", "parameter"}
    assert {y for _, y in taken} >= {11.0, 22.0, 77.0, 0.77}


def test_mutated_cases_keep_the_time_of_the_first_and_say_which_they_are(monkeypatch):
    def closed(scene, q, t):
        assert t == 5.0
        if q[0] == 3.0:
            raise EomcheckError("no position")
        return q

    def consistent(scenes, states, velocities):
        wished = velocities(None)
        kept = range(1, len(scenes))
        return [(scenes[i], State(states[i].q, wished[i], states[i].t)) for i in kept], list(kept)

    monkeypatch.setattr(mutation, "assembled_position", closed)
    monkeypatch.setattr(mutation, "consistent", consistent)
    monkeypatch.setattr(mutation, "_changed", lambda one, other, random: (one[0], *one[1][:2]))
    scene = Sleigh.example()
    of = [(scene, State(np.full(3, float(i)), np.full(3, 10.0 * i), 5.0)) for i in range(1, 6)]
    away = scene, State(np.full(3, 99.0), np.full(3, 99.0), 99.0)

    def tamed(one):
        return one[0], one[1], one[2] + 1

    cases, places = mutation.mutated([(one, away) for one in of], cast(Any, None), tamed)
    assert places == [1, 3, 4]
    assert [(x.q[0], x.v[0], x.t) for _, x in cases] == [
        (2.0, 21.0, 5.0),
        (4.0, 41.0, 5.0),
        (5.0, 51.0, 5.0),
    ]


# ---- Whose fault it is ---------------------------------------------------------------------------

SIZE = 8.0


def fault(monkeypatch, claim: str, subject: str, errors: dict[str, float], **known: Any):
    """Return the fault of a failure: of formulations with these true errors and a bound of 1e-9."""
    scene = Sleigh.example()
    bound = known.get("bound", 1e-9)

    def accelerated(one, key, *state, consistent):
        assert one is scene and not consistent and len(state) == 3
        if key not in errors:
            raise RefusedError("M", 0.0, 1.0, "refused")
        return SimpleNamespace(vdot=key, error_bound=bound)

    def enclosed(one, key, q, *, t, digits, v):
        assert (q.tolist(), v.tolist(), t) == ([1.0] * 3, [2.0] * 3, 3.0)
        return SimpleNamespace(doubles=lambda: np.array([1.0, -SIZE]))

    monkeypatch.setattr(screening, "acceleration", accelerated)
    monkeypatch.setattr(screening, "enclose", enclosed)
    monkeypatch.setattr(screening, "true_error", lambda key, truth: np.array([0.0, errors[key]]))
    monkeypatch.setattr(screening, "unproved", lambda scene: known.get("unproved", frozenset()))
    monkeypatch.setattr(screening, "is_under_test", lambda engine: engine == "mine")
    state = State(np.full(3, 1.0), np.full(3, 2.0), 3.0)
    failed = Finding(
        *(claim, subject, scene, state, 1.0, 0.1, "failed", "made up"),
        detail="the detail",
        engine=known.get("engine"),
    )
    return screening.diagnose_failure(failed)


@pytest.mark.parametrize(
    ("claim", "subject", "errors", "known", "whose", "evidence"),
    [
        ("refusals", "au", {"au": 1.0}, {}, screening.REFUSAL, "the detail"),
        (
            *("equivalence", "au ~ el", {"au": 1e-10, "el": 1e-8, "kane": 1.0}, {}),
            *(screening.SILENT, "enclosed: el: true error 1e-08 of 8, bound 1e-09"),
        ),
        (
            *("equivalence", "au ~ el", {"au": 9e-6, "el": 1e-8}, {}),
            screening.SILENT,
            "enclosed: au: true error 9e-06 of 8, bound 1e-09, noticeable; "
            "el: true error 1e-08 of 8, bound 1e-09",
        ),
        (
            *("equivalence", "au ~ el", {"au": 1e-9, "el": 0.0}, {}),
            screening.ALARM,
            "identities proved; enclosed: au: true error 1e-09 of 8, bound 1e-09; "
            "el: true error 0 of 8, bound 1e-09",
        ),
        (
            *("equivalence", "au ~ el", {"kane": 1.0}, {}),
            *(screening.ALARM, "identities proved; enclosed: no formulation"),
        ),
        (
            *("equivalence", "au ~ el", {"au": 0.0}),
            *({"unproved": frozenset(["speed-forces", "bias"])}, screening.SCENE),
            "not proved either: bias, speed-forces",
        ),
        (
            *("equivalence", "au ~ el", {"au": 0.0}, {"unproved": None}, screening.UNKNOWN),
            "the scene's functions are not rational: nothing is proved",
        ),
        (
            *("mass-matrix", "casadi", {"au": 0.0}, {"engine": "casadi"}, screening.ENGINE),
            "an engine; enclosed: au: true error 0 of 8, bound 1e-09",
        ),
        (
            *("mass-matrix", "casadi", {}, {"engine": "casadi"}, screening.ENGINE),
            "an engine; enclosed: no formulation answers",
        ),
        (
            *("mass-matrix", "casadi", {}, {"engine": "casadi", "unproved": None}),
            *(screening.UNKNOWN, "the scene's functions are not rational: nothing is proved"),
        ),
        (
            *("mass-matrix", "casadi", {"au": 0.0}),
            *({"engine": "casadi", "unproved": frozenset(["bias"])}, screening.SCENE),
            "not proved either: bias",
        ),
        (
            *("mass-matrix", "mine", {"au": 0.0, "el": 0.0, "kane": 0.0}),
            *({"engine": "mine", "unproved": frozenset(["bias"])}, screening.ENGINE),
            "the engine on trial; enclosed: au: true error 0 of 8, bound 1e-09; "
            "el: true error 0 of 8, bound 1e-09",
        ),
        (
            *("equivalence", "au ~ el", {"au": UNDERFLOW / 2}, {"bound": 0.0}, screening.ALARM),
            f"identities proved; enclosed: au: true error {UNDERFLOW / 2:.2g} of 8, bound 0",
        ),
    ],
)
def test_a_failure_is_the_fault_of_what_is_wrong_beyond_its_bound_or_not_proved(
    claim, subject, errors, known, whose, evidence, monkeypatch
):
    assert fault(monkeypatch, claim, subject, errors, **known) == (whose, evidence)


def test_an_error_is_noticeable_beside_the_size_of_the_truth(monkeypatch):
    for factor, word in ((0.99, False), (1.01, True)):
        found = fault(monkeypatch, "equivalence", "au ~ el", {"au": factor * NOTICEABLE * SIZE})
        assert found.evidence.endswith(", noticeable") == word


@pytest.mark.parametrize(
    ("subject", "keys"),
    [("au ~ el", ("au", "el")), ("v̇: kane, gw", ("kane", "gw")), ("nothing", ()), ("auel", ())],
)
def test_a_finding_is_about_the_formulations_that_its_subject_names(subject, keys):
    assert screening.keys_in_subject(subject, FORMULATIONS) == keys


def test_only_formulations_that_apply_are_judged_and_claims_once_each(monkeypatch):
    told: list[Any] = []
    passed, failed = SimpleNamespace(verdict="passed"), SimpleNamespace(verdict="failed")

    def check(*of, **options):
        told.append((of[1:], options))
        return [passed, failed]

    monkeypatch.setattr(screening, "check_state", check)
    q, v = np.ones(3), np.zeros(3)
    case = Sleigh.example(), State(q, v, 2.0)
    found = screening.failed_findings(case, ["b", "a", "b"], ["banded", "au"], ["casadi"])
    assert found == [failed]
    options = {"formulations": ["au"], "engines": ["casadi"], "claims": ["a", "b"]}
    assert told == [((q, v, 2.0), options | {"consistent": False})]


# ---- A campaign by an executor -------------------------------------------------------------------


class Plan:
    """What rounds have in common: each looks at so many states."""

    noun, kind, seed, max_states, settings = "state", Sleigh, 0, 10, {}

    def __init__(self, states: int = 10):
        self.states = states

    def run(self, round_):
        counts = Counter({"states": self.states} if self.states else {})
        return RoundResult(
            round_.number, round_.variant, {}, counts=counts, seconds=2.0, cpu_seconds=1.5
        )

    def record_failure(self, failed, name, known=None):
        raise AssertionError("nothing failed")


STRATA = [StructuralVariant(n, ()) for n in (1, 2, 3, 4)]


@pytest.fixture
def spread_over(monkeypatch) -> list[tuple[str, list[int]]]:
    asked: list[tuple[str, list[int]]] = []

    def spread(where, function, items):
        asked.append((where, [one.number for one in items]))
        for one in reversed(items):
            yield one, function(one)

    monkeypatch.setattr(campaign, "parallel_map", spread)
    return asked


def test_rounds_are_handed_to_the_executor_no_more_than_are_needed(spread_over):
    one = Campaign(cast(Any, Plan()), "sleigh", STRATA)
    told: list[int] = []
    one.run(states=65, executor="local:2", on_round=lambda now: told.append(now.states))
    assert [where for where, _ in spread_over] == ["local:2"] * 2
    assert [numbers for _, numbers in spread_over] == [[0, 1, 2, 3], [4, 5, 6]]
    assert told == [10, 20, 30, 40, 50, 60, 70]
    assert (one.rounds, one.seconds, one.cpu_seconds) == (7, 14.0, 10.5)
    assert sum(one.by_variant.values()) == 70 and max(one.by_variant.values()) == 20


def test_results_of_an_executor_are_taken_until_the_time_is_up(spread_over, monkeypatch):
    clock = count()
    monkeypatch.setattr(campaign.time, "time", lambda: float(next(clock)))
    one = Campaign(cast(Any, Plan()), "sleigh", STRATA)
    one.run(seconds=4.0, executor="local:2")
    assert 1 <= one.rounds < 4
    assert len(spread_over) == 1 and spread_over[0][1] == [0, 1, 2, 3]


@pytest.mark.parametrize("executor", [None, "local:2"])
def test_a_generation_without_a_state_is_refused_with_the_number_of_its_rounds(
    executor, spread_over
):
    one = Campaign(cast(Any, Plan(0)), "mine.py:Scene", STRATA)
    with pytest.raises(InputError, match=r"scene = mine.py:Scene: no state .* in 4 rounds:"):
        one.run(states=5, executor=executor)


# ---- References ----------------------------------------------------------------------------------


def test_a_reference_that_is_missing_is_told_how_to_make_or_which_there_are(tmp_path: Path):
    with pytest.raises(InputError) as known:
        references.stored_reference("disk", tmp_path)
    assert "eomcheck reference disk --folder FOLDER" in str(known.value)
    assert repr(str(tmp_path / "disk.json")) in str(known.value)
    with pytest.raises(InputError) as unknown:
        references.stored_reference("comet", tmp_path)
    assert f"references of eomcheck are: {', '.join(REFERENCE_CASES)}" in str(unknown.value)
    assert "--folder" not in str(unknown.value)


def test_a_reference_is_written_under_its_name_with_the_command_that_makes_it(monkeypatch):
    written = []
    monkeypatch.setattr(references, "save_reference", lambda *of, **how: written.append((of, how)))
    one = cast(Any, SimpleNamespace(name="disk"))
    path = references.write_reference(one, Path("here"))
    own = cast(Any, SimpleNamespace(name="mine", scene=Sleigh.example()))
    references.write_reference(own, Path("here"), "own.py:Own")
    references.write_reference(own, Path("here"), "sleigh")
    (of, how), *scenes = written
    assert path == Path("here") / "disk.json" and of == (one, path, "")
    assert how == {"made_by": "eomcheck reference disk", "eomcheck": references.__version__}
    # A built-in class is stored by its key, whatever it was called.
    assert [of[2] for of, _ in scenes] == ["sleigh", "sleigh"]
    assert scenes[0][1]["made_by"] == "eomcheck reference mine --scene own.py:Own"


class OwnSleigh(Sleigh):
    """A scene of a user."""


def test_a_reference_about_a_scene_of_a_file_is_read_with_its_class_and_never_imports_one(
    tmp_path,
):
    source = Path(__file__).parents[2] / "validation" / "references" / "sleigh.json"
    document = json.loads(source.read_text(encoding="utf-8"))
    document["scene"]["kind"] = "own.py:OwnSleigh"
    path = tmp_path / "own.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    own = load_reference(path, OwnSleigh)
    assert type(own.scene) is OwnSleigh
    assert own.q.tolist() == load_reference(source).q.tolist()
    with pytest.raises(InputError, match=r"name it by --scene own\.py:OwnSleigh"):
        load_reference(path)
    with pytest.raises(InputError, match=r"its parameters are those of 'own\.py:OwnSleigh', not"):
        load_reference(path, ChainPendulum)
    with pytest.raises(InputError, match="compute it: eomcheck reference mine --scene sleigh"):
        references.stored_reference("mine", tmp_path, "sleigh")


def test_the_case_of_a_scene_starts_as_it_does_or_with_other_speeds():
    scene = OwnSleigh()
    case = references.case_of(scene, None, 0.5, 5)
    q, v = scene.initial_state()
    assert case.scene() is scene and case.times.tolist() == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]
    assert np.allclose(velocity(scene, q, case.u0), v, rtol=1e-15, atol=1e-15)
    assert references.case_of(scene, [1.0, 2.0], 1.0).u0 == (1.0, 2.0)
    assert references.reference_name(scene) == "sleigh-motion"
    assert references.reference_name(Snake.coil(3)) == "snake-3"
    for end in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match=r"end = .*, expected a positive number of seconds"):
            references.case_of(scene, None, end)


def run_of(drift: float | None, steps: int, seconds: float, longest: float = 0.5) -> Any:
    facts = {"steps": steps, "seconds": seconds, "longest_step": longest}
    return SimpleNamespace(drift=drift, facts=facts)


def test_the_table_of_references_tells_both_integrations_side_by_side():
    runs = run_of(3e-31, 120, 4.4), run_of(None, 70, 61.6)
    one = SimpleNamespace(name="disk", times=[0.0, 0.25], uncertainty=2.4e-21, runs=runs)
    sheet = references.reference_table([cast(Any, one)])
    (row,) = sheet.rows
    told = dict(zip([*enumerate(sheet.columns)], row, strict=True))
    assert list(told.values()) == ["disk", "0.25", "2e-21", "3e-31", "", "120", "70", "4", "62"]
    assert isinstance(row[0], Cell) and row[0].kind == "name"
    assert [head.split(":")[0] for head in sheet.columns[3::2]] == [
        "energy drift",
        "steps",
        "seconds",
    ]


@pytest.mark.parametrize(
    ("name", "u0", "end", "parts", "minutes"),
    [
        ("paper-rest", (0.0, 0.0), 1.0, 20, 4.0),
        ("paper-rolling", (1.0, 0.5), 1.0, 20, 4.0),
        ("coil-2", (0.0, 0.0), 1.0, 20, 2.0),
        ("coil-20", (0.0, 0.0), 0.25, 5, 10.0),
        ("free-3", (1.0, 0.5), 10.0, 20, 1.0),
        ("pendulum-3", (1.0, 0.5, -0.5), 2.0, 20, 1.0),
        ("sleigh", (1.0, 2.0), 5.0, 20, 1.0),
        ("disk", (0.3, 1.0, 4.0), 1.0, 20, 1.0),
        ("turntable", (1.0, 0.5, 2.0), 2.0, 20, 1.0),
        ("four-bar-2", (1.0,), 1.0, 20, 1.0),
        ("andrews", (0.0,), 0.03, 20, 1.0),
        ("governor", (0.0, 6.0, 0.0, 0.0), 0.1, 20, 1.0),
        ("bricard", (0.0,), 1.0, 20, 1.0),
        ("bicycle", (0.5, 0.0, 4.6 / 0.3), 1.0, 20, 1.0),
    ],
)
def test_motions_to_know_well_start_and_end_as_described(name, u0, end, parts, minutes):
    case = REFERENCE_CASES[name]
    assert (case.u0, case.end, case.parts, case.minutes) == (u0, end, parts, minutes)
    assert case.times == pytest.approx(np.linspace(0.0, end, parts + 1))
    assert case.scene().p == len(u0)


def test_several_references_are_spread_the_longest_first_and_one_is_made_here(monkeypatch):
    cases = {
        name: ReferenceCase("", Sleigh, minutes=x)
        for name, x in (("a", 1.0), ("b", 9.0), ("c", 4.0))
    }
    bars: list[Any] = []
    asked: list[str | None] = []

    @contextmanager
    def progress(text, total):
        bars.append([text, total, 0])

        def advance():
            bars[-1][2] += 1

        yield advance

    def spread(where, function, items):
        asked.append(where)
        yield from ((item, function(item)) for item in items)

    monkeypatch.setattr(reference_runs, "progress", progress)
    monkeypatch.setattr(reference_runs, "parallel_map", spread)
    monkeypatch.setattr(reference_runs, "produce", lambda name, case, shown=True: (name, shown))
    made = [*reference_runs.produce_all(cases, "local:3")]
    assert made == [("b", False), ("c", False), ("a", False)]
    assert (asked, bars) == (["local:3"], [["computing {reference}", 3, 3]])
    assert [*reference_runs.produce_all({"a": cases["a"]}, "local:3")] == [("a", True)]
    assert len(asked) == 1


def test_a_reference_is_made_by_both_methods_and_checked_by_a_third_of_the_longest_step(
    monkeypatch,
):
    asked: list[tuple] = []

    def taylor(scene, q0, u0, times, longest_step=None):
        asked.append(("taylor", u0.tolist(), times, longest_step))
        return run_of(1e-30, 100 if longest_step is None else 300, 1.0, 0.6)

    def extended(scene, q0, v0, times, watch):
        asked.append(("extended", v0, times))
        watch(times[-1] / 2)
        watch(times[-1])
        return run_of(2e-30, 50, 2.0)

    monkeypatch.setattr(reference_runs, "taylor_reference", taylor)
    monkeypatch.setattr(reference_runs, "extended_reference", extended)
    monkeypatch.setattr(reference_runs, "extended_velocity", lambda s, q, u, t: ("v0", t))
    monkeypatch.setattr(reference_runs, "difference", lambda x, y: [1e-25, 3e-25, 2e-25])
    monkeypatch.setattr(reference_runs, "reference_from_runs", lambda *of: of)
    case = ReferenceCase("pushed", Sleigh, (1.0, 2.0), end=2.0, parts=4)
    name, text, scene, _, u0, runs, check = cast(Any, reference_runs.produce("s", case, False))
    assert (name, text, scene.key, u0.tolist()) == ("s", "pushed", "sleigh", [1.0, 2.0])
    times = [0.0, 0.5, 1.0, 1.5, 2.0]
    assert asked == [
        ("taylor", [1.0, 2.0], times, None),
        ("taylor", [1.0, 2.0], times, pytest.approx(0.2)),
        ("extended", ("v0", 0.0), times),
    ]
    assert [run.facts["steps"] for run in runs] == [100, 50]
    assert check == {
        **{"longest_step": pytest.approx(0.2), "steps": 300, "energy_drift": 1e-30},
        "largest_difference": 3e-25,
    }


def test_a_motion_is_made_from_the_start_given_or_the_scene_s_own(monkeypatch):
    made: list[tuple] = []
    monkeypatch.setattr(study, "Motion", lambda scene, f, *start: made.append((f.key, start)))
    clock = iter([1.0, 3.5, 4.0, 4.25])
    monkeypatch.setattr(study.time, "perf_counter", lambda: next(clock))
    scene = Sleigh.example()
    q, v = scene.initial_state()
    assert study.prepare_motion(scene, "au")[1] == 2.5
    assert study.prepare_motion(scene, "kane", q + 1, v + 2)[1] == 0.25
    (first, own), (second, given) = made
    assert (first, second) == ("au", "kane")
    assert [x.tolist() for x in own] == [q.tolist(), v.tolist()]
    assert [x.tolist() for x in given] == [(q + 1).tolist(), (v + 2).tolist()]


# ---- What pictures show --------------------------------------------------------------------------


def test_sketches_of_a_motion_are_six_a_frame_at_equal_times(monkeypatch):
    asked = []

    def simulate(*of, output_times, u0):
        asked.append((*of[1:], u0))
        k = len(output_times) - (of[1] == "el")
        q = np.arange(3.0 * k).reshape(k, 3)
        status = "finished" if of[1] == "kane" else "failed"
        return SimpleNamespace(status=status, reason="too steep", q=q, times=output_times)

    monkeypatch.setattr("eomcheck.motion.simulate.simulate", simulate)
    monkeypatch.setattr(pictures, "sketch_of", lambda scene, q, t: (q[0], t))
    sketches, times, every = pictures.sketches_of_motion(Sleigh.example(), "kane", 0.4, 3)
    assert every == 6 and asked == [("kane", 0.4, None)]
    assert times == pytest.approx(np.arange(13) / 30)
    assert sketches == [(3.0 * k, t) for k, t in enumerate(times)]
    pictures.sketches_of_motion(Sleigh.example(), "kane", 0.4, 3, [1.0, 2.0])
    assert asked[1:] == [("kane", 0.4, [1.0, 2.0])]
    with pytest.raises(InputError, match="frames = 1, expected at least 2"):
        pictures.sketches_of_motion(Sleigh.example(), "kane", 0.4, 1)
    with pytest.raises(InputError, match="the motion of sleigh by el failed: too steep"):
        pictures.sketches_of_motion(Sleigh.example(), "el", 0.4, 2)


def test_a_state_whose_matrices_are_drawn_moves_in_every_way_that_is_allowed():
    free = ChainPendulum.rods(3)
    _, formulation, q, v = pictures.moving_state(free, np.full(3, 0.3), FORMULATIONS["au"])
    assert (formulation.key, q.tolist()) == ("au", [0.3] * 3)
    assert v == pytest.approx([1.0, 0.5, 1 / 3])
    held = Sleigh.example()
    scene, _, q, v = pictures.moving_state(held, np.array([0.1, 0.2, 0.3]), FORMULATIONS["au"])
    at = pictures.Evaluation(scene, q, v)
    assert at.terms.a @ v == pytest.approx(0.0, abs=1e-15)
    assert np.linalg.norm(v) == pytest.approx(math.hypot(1.0, 0.5))


def test_what_is_drawn_has_the_parameters_and_links_asked_for():
    scene, q = pictures.scene_to_draw("sleigh", given={"mass": [4.0]})
    assert scene.mass == 4.0 and q.shape == (3,)  # type: ignore[attr-defined]
    scene, q = pictures.scene_to_draw("snake", 4)
    assert scene.links == 4 and q.shape == (6,)  # type: ignore[attr-defined]
    with pytest.raises(InputError):
        pictures.scene_and_pose(Snake, 0)

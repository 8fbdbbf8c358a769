"""Fuzzing of what is somebody's own: functions, and engines on trial."""

from __future__ import annotations

import importlib.util
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomcheck
from eomcheck import cli
from eomcheck.claims import CLAIMS
from eomcheck.claims.finding import entries_of
from eomcheck.draws.fuzz_cases import FAMILIES, ORDINARY, SPECIAL, StructuralVariant, draw_cases
from eomcheck.engines import engine_of
from eomcheck.errors import InputError
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing import screening
from eomcheck.lab.fuzzing import state_rounds as fuzzed
from eomcheck.lab.fuzzing.campaign import Campaign, Round, ScoredCase
from eomcheck.lab.fuzzing.failures import (
    FUNCTIONS,
    failure_record,
    read_failures,
    replay_failures,
    write_failures,
)
from eomcheck.lab.fuzzing.motion_comparison import jacobians
from eomcheck.lab.fuzzing.screening import DECIDED, OPEN, CheckFrequency, Diagnosis, runs_in_lanes
from eomcheck.lab.fuzzing.state_rounds import (
    SKIPPED,
    FunctionsPlan,
    StatePlan,
    drawn_state,
    hill_climbed_states,
    is_ordinary,
    state_bounds,
)
from eomcheck.lab.store.record_file import Records
from eomcheck.mechanics.records import State
from eomcheck.scenes import Snake, snake
from eomcheck.testing import FUNCTION_CLAIMS, EquationsOfMotion, check_functions

GUIDES = Path(__file__).parents[2] / "docs" / "guides"
ALL = StructuralVariant(None, ())

MINE = """
import sys
sys.path.insert(0, {guides!r})
import cart
import numpy as np
from eomcheck.testing import EquationsOfMotion

given = dict(M=cart.M, gravity=cart.gravity, qdd=cart.qdd, T=cart.T, U=cart.U, R=cart.R)

def close(q, v):
    B = cart.bias(q, v)
    return B if abs(q[1] - q[2]) > 3e-3 else B * np.array([1.0, 0.5, 0.5])

right = EquationsOfMotion(3, bias=cart.bias, name="cart", **given)
wrong = EquationsOfMotion(3, bias=close, name="cart", **given)
"""


@pytest.fixture
def mine(tmp_path: Path, monkeypatch) -> Iterator[str]:
    """Yield the path of a file with functions, right ones and ones that are wrong somewhere."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    file = tmp_path / f"mine_{tmp_path.name.replace('-', '_')}.py"
    file.write_text(MINE.format(guides=str(GUIDES)))
    yield str(file)
    sys.modules.pop("cart", None)  # another test imports another file of this name


def run(*arguments: str, monkeypatch: pytest.MonkeyPatch) -> int:
    """Run `eomcheck fuzz` in this process and return its exit code."""
    monkeypatch.setattr(sys, "argv", ["eomcheck", "fuzz", *arguments])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code or 0


# ---- Functions -----------------------------------------------------------------------------------


@pytest.mark.night
def test_right_functions_are_no_find(mine, monkeypatch, capsys):
    assert run("--scene", f"{mine}:right", "--examples", "20", monkeypatch=monkeypatch) == 0
    said = capsys.readouterr().out
    assert "no failure" in said and "bias-of-mass-matrix" in said


@pytest.mark.night
def test_a_term_lost_next_to_a_special_pose_is_found_kept_and_replayed(
    mine, monkeypatch, capsys, tmp_path: Path
):
    kept = tmp_path / "found.json"
    how = "--scene", f"{mine}:wrong", "--examples", "200", "--keep", str(kept)
    assert run(*how, "--claim", "bias-of-mass-matrix", monkeypatch=monkeypatch) == 1
    said = capsys.readouterr().out
    assert "half the expected value" in said and "check_functions" in said
    # Close to the pose the factor is known to six digits only, and is called a half all the same.
    (find,) = read_failures(kept)
    assert (find.whose, find.claim) == (FUNCTIONS, "bias-of-mass-matrix")
    assert sum(x == 0.0 for x in find.q + find.v) >= 2
    again = "--replay", str(kept), "--scene", f"{mine}:wrong"
    assert run(*again, monkeypatch=monkeypatch) == 1
    mended = [type(find)(**(vars(find) | {"scene": f"{mine}:right"}))]
    write_failures(kept, mended)
    assert [one.outcome for one in replay_failures(read_failures(kept), ())] == ["holds"]
    # Random states of the ranges do not meet it.
    functions = find.case[0]
    assert isinstance(functions, EquationsOfMotion)
    given = {name: functions.function(name) for name in functions.given}
    assert all(x.verdict != "failed" for x in check_functions(3, **given, states=8))


FEW = """
import sys
sys.path.insert(0, {guides!r})
import cart
import numpy as np
from eomcheck.testing import EquationsOfMotion

def T(q, v):
    return cart.T(q, v) - cart.U(q)

def half(q):
    if q[0] > 0:
        raise ValueError("no value")
    return cart.M(q)

few = EquationsOfMotion(3, M=cart.M, bias=cart.bias, qdd=cart.qdd, name="few")
energies = EquationsOfMotion(3, T=T, U=cart.U, name="energies", ranges=(-1, 1))
partly = EquationsOfMotion(3, M=half, ranges=(-1, 1))
"""


@pytest.mark.night
def test_what_cannot_be_told_of_functions_is_printed_once_after_a_campaign(
    mine, monkeypatch, capsys
):
    Path(mine).write_text(FEW.format(guides=str(GUIDES)))
    how = "--examples", "1", "--no-climb", "--family", "ordinary"
    asked = "answers,bias-even,motion,kinetic-energy,reference"
    assert run("--scene", f"{mine}:few", *how, "--claim", asked, monkeypatch=monkeypatch) == 0
    said = capsys.readouterr().out.partition("no failure\n")[2].splitlines()
    about = "few: M, bias, qdd"
    why = "M q̈ + B is not 0, and no force is given: gravity, U, R or Q would tell"
    number = "a number that all functions share, such as a mass, a length or g"
    assert said == [
        f"motion [forces] inconclusive in all states: {why}",
        f"kinetic-energy [few] skipped on {about} (needs M and T)",
        f"reference [few] skipped on {about} ({number}: against would tell)",
        f"reference [few] skipped on {about} "
        "(checked q in [-1, 1], v in [-1, 1]: `ranges` for more)",
    ]
    asked = "energy-quadratic,reference"
    assert run("--scene", f"{mine}:energies", *how, "--claim", asked, monkeypatch=monkeypatch) == 0
    table, _, said = capsys.readouterr().out.partition("no failure\n")
    rest = "T(q, 0) changes with q; is the potential energy in it? bias, qdd or against would tell"
    first, second = said.splitlines()
    assert first == f"energy-quadratic [T at rest] skipped in every state: {rest}"
    assert second.startswith("reference [energies] skipped on energies: T, U (a number that")
    assert "skipped: " not in table


def test_what_is_told_in_some_states_is_no_caveat_and_the_others_are_kept(mine, tmp_path: Path):
    Path(mine).write_text(FEW.format(guides=str(GUIDES)))
    symmetric = FunctionsPlan(f"{mine}:partly", 0, ("mass-matrix-symmetric",), climbing=False)
    campaign = Campaign(symmetric, "mine", [ALL])
    campaign.run(states=16)
    skipped = "mass-matrix-symmetric [M]"
    assert campaign.undecided == {skipped: "skipped in every state: M breaks: ValueError: no value"}
    assert symmetric.caveats(campaign.counts, campaign.undecided, campaign.entries) == []
    open_ = FunctionsPlan(f"{mine}:few", 0, ("motion",), climbing=False, batch=2)
    with Records(tmp_path / "r.db") as records:
        Campaign(open_, "mine", [ALL], records).run(states=2)
    with Records(tmp_path / "r.db") as records:
        again = Campaign(open_, "mine", [ALL], records)
    (said,) = open_.caveats(again.counts, again.undecided, again.entries)
    assert said.startswith("motion [forces] inconclusive in all states: ")


FIELD = """
import numpy as np
from eomcheck.testing import EquationsOfMotion

def gravity(q):
    return np.array([2.0 * np.sin(1e12 * q[0]), 3.0 * q[1]])

def U(q):
    return -np.cos(1e12 * q[0]) / 1e12 + 1.5 * q[1] ** 2

given = {"M": lambda q: np.eye(2), "gravity": gravity, "U": U, "ranges": (-1, 1)}
short = EquationsOfMotion(2, name="short", **given)
"""
"""A field of short wavelength, of which no finite difference knows the force in row q[0]."""


def test_an_entry_that_no_state_of_a_campaign_resolves_is_named_after_it(
    mine, monkeypatch, capsys, tmp_path: Path
):
    Path(mine).write_text(FIELD)
    kept, claim = str(tmp_path / "r.db"), "gravity-of-potential"
    how = "--scene", f"{mine}:short", "--no-climb", "--records", kept, "--claim", claim
    for states in (1, 17):
        assert run(*how, "--examples", str(states), monkeypatch=monkeypatch) == 0
        said = capsys.readouterr().out.partition("no failure\n")[2].splitlines()
        count = 16 if states == 1 else 32
        assert said == [f"{claim} [gravity] not resolved in any of {count} states: row q[0]"]
    # All of these were drawn before: they are known from the records.
    assert run(*how, "--examples", "17", monkeypatch=monkeypatch) == 0
    assert capsys.readouterr().out.partition("no failure\n")[2].splitlines() == said


def test_an_entry_is_compared_in_the_states_in_which_its_subject_was(mine):
    Path(mine).write_text(FIELD)
    plan = FunctionsPlan(f"{mine}:short", 0, ("gravity-of-potential",))
    names, about = (("q[0]", "q[1]"),), "gravity-of-potential [gravity]"
    entries = {about: [entries_of(names, [False, True], [True, False])]}
    counts = Counter({"states": 9, SKIPPED + about: 2, DECIDED + about: 4, OPEN + about: 3})
    said = f"{about} not resolved in any of 7 states: row q[0]"
    assert plan.caveats(counts, {}, entries) == [said]
    # Where no state decides the subject, its own line says so.
    counts = Counter({"states": 9, OPEN + about: 9})
    assert plan.caveats(counts, {about: "why"}, entries) == [f"{about} why"]
    resolved = {about: [*entries[about], entries_of(names, [True, False], [False, False])]}
    counts = Counter({"states": 9, DECIDED + about: 9})
    assert plan.caveats(counts, {}, resolved) == []


ONCE = """
import numpy as np
from eomcheck.testing import EquationsOfMotion

def gravity(q):
    return np.array([2.0 * np.sin(1e12 * q[0]) if q[0] > 0.9 else 2.0 * q[0], 3.0 * q[1]])

def U(q):
    return (-np.cos(1e12 * q[0]) / 1e12 if q[0] > 0.9 else q[0] ** 2) + 1.5 * q[1] ** 2

given = {"M": lambda q: np.eye(2), "gravity": gravity, "U": U, "ranges": (-1, 1)}
once = EquationsOfMotion(2, name="once", **given)
"""
"""A field of short wavelength in a twentieth of the range."""


def test_entries_resolved_in_one_state_are_resolved_and_resumed(mine, tmp_path: Path):
    Path(mine).write_text(ONCE)
    plan = FunctionsPlan(f"{mine}:once", 0, ("gravity-of-potential",), (ORDINARY,), False, 8)
    about = "gravity-of-potential [gravity]"
    with Records(tmp_path / "r.db") as records:
        Campaign(plan, "mine", [ALL], records).run(states=40)
    with Records(tmp_path / "r.db") as records:
        again = Campaign(plan, "mine", [ALL], records)
    (entries,) = again.entries[about]
    assert entries.resolved == bytes([0b11000000]) and entries.hides("row q[0]")
    assert not entries.hides("row q[1]")
    assert again.resumed == 40 and plan.caveats(again.counts, {}, again.entries) == []


def test_what_is_looked_at_stays_within_the_ranges():
    narrow = EquationsOfMotion(
        2, M=lambda q: np.eye(2), ranges=[(0.0, 2.0), (-3.0, -1.0), (0, 1), (5, 6)]
    )
    random = np.random.default_rng(0)
    low, high = state_bounds(narrow)
    states = [drawn_state(narrow, family, random) for family in (ORDINARY, SPECIAL) * 50]
    population = {("a", "b"): [ScoredCase(1.0, (narrow, one)) for one in states[:6]]}  # type: ignore
    climbed = hill_climbed_states(narrow, population, 100, random)  # type: ignore[arg-type]
    for one in (states, climbed):
        x = np.array([np.concatenate(state[:2]) for state in one])
        assert (low <= x).all() and (x <= high).all()
        assert (np.ptp(x, axis=0) > 0.5).all()
    assert len({state.q.tobytes() for state in climbed}) > 50


def test_what_is_made_round_stays_within_the_ranges(monkeypatch):
    leaning = EquationsOfMotion(
        2,
        M=lambda q: np.array([[2.0, 1.0], [0.5, 2.0]]),
        ranges=[(0.31, 2.0), (-3.0, -1.5), (-1.0, 1.0), (5.1, 6.0)],
    )
    monkeypatch.setattr(fuzzed, "functions_named", lambda _: leaning)
    here = FunctionsPlan("", 0, ("mass-matrix-symmetric",), (ORDINARY,), False, 1)
    (failed,) = here.run(Round(0, ALL, {})).failed
    small = here.record_failure(failed, "leaning", [])
    low, high = state_bounds(leaning)
    assert all(low <= [*small.q, *small.v]) and all([*small.q, *small.v] <= high)
    assert small.q[1] in (-3.0, -2.0) and small.q[0] == 1.0 and small.v[0] == 0.0


@pytest.mark.night
def test_climbing_finds_a_corner_of_functions_that_drawing_does_not(monkeypatch):
    def M(q):
        found = 2.0 * np.eye(4)
        found[0, 1] += 1e-15 * np.exp(4.0 * (q.sum() - 2.5))
        return found

    leaning = EquationsOfMotion(4, M=M)
    monkeypatch.setattr(fuzzed, "functions_named", lambda _: leaning)

    def finds(climbing: bool) -> int:
        population, count = {}, 0
        for number in range(20):
            here = FunctionsPlan("", 0, ("mass-matrix-symmetric",), (ORDINARY,), climbing, 8)
            here = here if climbing else replace(here, batch=16)
            result = here.run(Round(number, ALL, population))
            population, count = result.population, count + len(result.failed)
        return count

    assert finds(True) > 0 == finds(False)


@pytest.mark.night
def test_a_campaign_about_functions_goes_on_where_it_stopped(mine, tmp_path: Path):
    here = FunctionsPlan(f"{mine}:right", 0, ("bias-power", "motion"), batch=4)
    whole = Campaign(here, "mine", [ALL])
    whole.run(states=24)
    with Records(tmp_path / "r.db") as records:
        Campaign(here, "mine", [ALL], records).run(states=5)
    with Records(tmp_path / "r.db") as records:
        again = Campaign(here, "mine", [ALL], records)
        assert 0 < again.resumed < 24
        again.run(states=24)
    assert again.counts == whole.counts
    assert {k: x.score for k, x in again.worst.items()} == {
        k: x.score for k, x in whole.worst.items()
    }


def test_what_says_nothing_of_functions_is_bad_input(mine, monkeypatch, capsys):
    for option in (["--motions"], ["--engine", "pinocchio"], ["--check-frequency", "balls=1"]):
        assert run("--scene", f"{mine}:right", *option, monkeypatch=monkeypatch) == 2
        assert f"{option[0]} has no effect of" in capsys.readouterr().err
    assert run("--scene", f"{mine}:right", "--family", "fast", monkeypatch=monkeypatch) == 2
    assert run("--scene", f"{mine}:none", monkeypatch=monkeypatch) == 2


def test_every_claim_about_functions_takes_part():
    plan = FunctionsPlan("", 0, tuple(FUNCTION_CLAIMS))
    assert len(plan.claims) > 10 and plan.settings["claims"] == list(plan.claims)


# ---- Engines -------------------------------------------------------------------------------------

spec = importlib.util.spec_from_file_location("planar", GUIDES / "planar.py")
assert spec is not None and spec.loader is not None
planar = importlib.util.module_from_spec(spec)
spec.loader.exec_module(planar)


class Leaning(planar.Planar):
    """An engine whose mass matrix is wrong by a share that grows into a corner of the ranges."""

    def __init__(self, scene):
        super().__init__(scene)
        self.mass = scene.mass[0]

    def mass_matrix(self, q, t=0.0):
        far = self.mass + np.abs(q[:2]).sum()
        return super().mass_matrix(q, t) * (1.0 + 1e-13 * np.exp(2.0 * (far - 27.0)))


def of_engine(engine: type, **options) -> StatePlan:
    """Return a plan that asks an engine alone."""
    claims = tuple(one for one in CLAIMS if CLAIMS[one].asks == "mass_matrix")
    usual = {"kind": Snake, "seed": 0, "claims": claims, "formulations": tuple(FORMULATIONS)}
    usual |= {
        "families": (ORDINARY,),
        "batch": 16,
        "check_frequency": CheckFrequency(0, 0, 2, 0, 0),
    }
    return StatePlan(**(usual | {"engines": (engine,)} | options))


@pytest.mark.night
def test_an_engine_of_ones_own_is_climbed_to_among_ordinary_states():
    def asked(climbing: bool) -> tuple[int, int]:
        population, count, finds = {}, 0, 0
        for number in range(10):
            here = of_engine(Leaning, climbing=climbing, batch=16 if climbing else 32)
            result = here.run(Round(number, StructuralVariant(2, ("damping",)), population))
            population = result.population
            count += result.counts["engines"] + result.counts["engines, climbed"]
            finds += len(result.failed)
            for key, best in population.items():
                assert key[1] != Leaning.key or all(is_ordinary(one.case) for one in best)
        return count, finds

    (of_climbing, finds), (of_drawing, drawn_) = asked(True), asked(False)
    assert of_climbing <= of_drawing
    assert finds > 0 and drawn_ == 0


class Wrong(planar.Planar):
    """An engine that forgets half of the bias."""

    def bias(self, q, v, t=0.0):
        return super().bias(q, v, t) / 2


@pytest.mark.night
def test_an_engine_that_is_wrong_is_a_find():
    claims = tuple(one for one in CLAIMS if CLAIMS[one].asks)
    result = of_engine(Wrong, claims=claims).run(Round(0, StructuralVariant(2, ("damping",)), {}))
    assert result.failed and {one.engine for one in result.failed} == {Wrong}


class Far(planar.Planar):
    """An engine that is a thousandth off where a joint has turned by more than a whole turn."""

    def mass_matrix(self, q, t=0.0):
        return super().mass_matrix(q, t) * (1.001 if np.abs(q[2:]).max() > 8.0 else 1.0)


@pytest.mark.night
def test_an_engine_that_is_named_is_asked_at_wide_states_too():
    here, found = Round(0, StructuralVariant(2, ("damping",)), {}), {}
    for wide in (False, True):
        plan = of_engine(
            Far, wide=wide, climbing=False, check_frequency=CheckFrequency(0, 0, 1, 0, 0)
        )
        found[wide] = len(plan.run(here).failed)
        assert plan.settings.get("wide", False) == wide
    assert found[False] == 0 and 2 <= found[True] <= plan.batch // 2


def test_what_is_ordinary_is_told_from_what_is_hostile():
    random = np.random.default_rng(0)
    cases, families = draw_cases(Snake, StructuralVariant(3, ()), FAMILIES, 200, random)
    told = {f: [is_ordinary(c) for c, g in zip(cases, families, strict=True) if g == f]
            for f in FAMILIES}  # fmt: skip
    assert np.mean(told[ORDINARY]) > 0.9
    assert np.mean(told["wide"]) < 0.1 and np.mean(told["fast"]) < 0.4
    scene, state = next(
        c for c, f in zip(cases, families, strict=True) if f == ORDINARY and is_ordinary(c)
    )
    assert not is_ordinary((scene, State(state.q, 1e3 * np.ones(scene.n), 0.0)))
    assert not is_ordinary((scene, State(state.q + 1e3, state.v, 0.0)))


# ---- Scenes that no lanes can run ----------------------------------------------------------------


class Rough(Snake, functions=()):
    """A snake whose terms go through numpy, which only doubles do."""

    @staticmethod
    def terms(parameters, prepared, q, v):
        found = snake.terms(parameters, prepared, q, v)
        return found._replace(B=found.B * float(np.cos(0.0 * np.float64(q[0]))))


class RoughAndWrong(Rough, functions=()):
    """And whose bias has the wrong sign."""

    @staticmethod
    def terms(parameters, prepared, q, v):
        found = Rough.terms(parameters, prepared, q, v)
        return found._replace(B=-found.B)


def test_constraints_along_motions_that_no_batch_runs_are_those_of_their_states():
    y = np.concatenate(Snake.coil(2).initial_state())[None, None] + np.zeros((1, 2, 1))
    rough, smooth = (
        jacobians([(kind.coil(2), State(y[0, 0, :4], y[0, 0, 4:], 0.0))], y, 1.0)
        for kind in (Rough, Snake)
    )
    assert rough[0].tolist() == smooth[0].tolist() and rough[1] == smooth[1] == (0, 1)


class NoNumbers(Snake, functions=()):
    """A snake whose constraint Jacobian is no number."""

    @staticmethod
    def terms(*here):
        found = snake.terms(*here)
        return found._replace(a=found.a * np.nan)


def campaign_of(kind, claims=("power-balance", "equivalence")) -> Campaign:
    here = StatePlan(kind, 3, claims, ("kane", "au"), families=(ORDINARY,), batch=8)
    return Campaign(here, kind.__name__, (StructuralVariant(2, ()),))


@pytest.mark.night
def test_functions_that_no_lanes_can_run_are_looked_at_one_by_one():
    assert runs_in_lanes(Snake) and not runs_in_lanes(Rough)
    right, wrong = campaign_of(Rough), campaign_of(RoughAndWrong)
    right.run(states=16)
    assert right.counts["states"] >= 16 and not right.failure_records
    assert right.counts["passed in lanes"] > 0 and right.counts["climbed"] > 0
    assert {claim for claim, _ in right.worst} == {"power-balance", "equivalence"}
    wrong.run(states=1)
    assert "power-balance" in {find.claim for find in wrong.failure_records.values()}
    assert {find.whose for find in wrong.failure_records.values()} == {screening.UNKNOWN}


def test_terms_that_are_no_numbers_end_a_campaign_with_a_sentence():
    with pytest.raises(InputError, match="no state could be drawn"):
        campaign_of(NoNumbers).run(states=1)


SIGNED = """
from eomcheck.engines.pinocchio import PinocchioEngine


class Signed(PinocchioEngine):
    @classmethod
    def version(cls):
        return "signed 1.0"

    def frame_jacobian(self, f, q, t=0.0):
        J = super().frame_jacobian(f, q, t)
        J[5] = -J[5]
        return J
"""


def test_a_find_of_an_engine_of_ones_own_names_it_in_its_code_and_where_it_is_replayed(
    tmp_path: Path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "signed_row.py").write_text(SIGNED, encoding="utf-8")
    engine = engine_of("signed_row.py:Signed")
    scene = eomcheck.scenes.Sleigh()
    chosen = {"claims": ["engine-frame-jacobian"], "engines": [engine]}
    (failed,) = eomcheck.check_state(scene, [0.1, 0.2, 0.3], [0.0, 0.0, 0.0], **chosen)
    record = failure_record(failed, "sleigh", Diagnosis("engine", ""))
    assert record.engine == "signed_row.py:Signed"
    write_failures(tmp_path / "f.json", [record])
    assert read_failures(tmp_path / "f.json") == [record]
    exec(record.python, {})  # the printed code, as it is
    assert "wrong sign" in capsys.readouterr().out
    (unnamed,) = replay_failures([record], ["au"], allowed=[])
    assert unnamed.outcome == "not checked"
    assert unnamed.reason.endswith("imported with --engine signed_row.py:Signed only")
    (again,) = replay_failures([record], ["au"], allowed=["signed_row.py:Signed"])
    assert (again.outcome, again.failure.engine) == ("failed", record.engine)
    assert failure_record(replace(failed, engine=None), "sleigh", Diagnosis("", "")).engine == ""

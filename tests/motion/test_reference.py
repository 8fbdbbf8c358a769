"""Reference solutions: both integrations, what is stored, and what is refused."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import fields, replace
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import flint
import numpy as np
import pytest
from tests.scenes.test_own_scene import Free, OnBelt

from eomcheck import cli
from eomcheck.errors import (
    EngineError,
    InconsistentVelocityError,
    InputError,
    RefusedError,
    UnknownNameError,
)
from eomcheck.lab import references
from eomcheck.lab.references import REFERENCE_CASES, produce, reference_case
from eomcheck.mechanics.records import Bodies, Speeds, Terms
from eomcheck.mechanics.scene import Scene
from eomcheck.motion import reference
from eomcheck.motion.reference import extended_reference, extended_velocity, taylor_reference
from eomcheck.motion.reference_solution import (
    DIGITS,
    ReferenceRun,
    decimals,
    difference,
    load_reference,
    save_reference,
)
from eomcheck.numbers.ball import precision
from eomcheck.numbers.linear import eliminate, solve
from eomcheck.numbers.symbolic import HeyokaArithmetic
from eomcheck.scenes import Snake, TurntableBall

FOLDER = Path(__file__).parents[2] / "validation" / "references"
PATHS = sorted(FOLDER.glob("*.json"))

stored = pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)


@pytest.fixture
def heyoka():
    return pytest.importorskip("heyoka")


# ---- What is stored ------------------------------------------------------------------------------


def test_every_case_is_stored_and_nothing_else():
    assert [path.stem for path in PATHS] == sorted(REFERENCE_CASES)


@stored
def test_a_file_is_small(path: Path):
    assert path.stat().st_size < 40_000


@stored
def test_a_stored_reference_is_the_case_that_its_name_says(path: Path):
    found, case = load_reference(path), REFERENCE_CASES[path.stem]
    assert found.name == path.stem
    assert repr(found.scene) == repr(case.scene())
    assert found.u0.tolist() == list(case.u0)
    assert found.times.tolist() == case.times.tolist()


@stored
def test_a_stored_reference_starts_in_the_scenes_initial_state(path: Path):
    found = load_reference(path)
    q0, rest = found.scene.initial_state()
    v0 = extended_velocity(found.scene, q0, found.u0)
    assert found.q[0].tolist() == q0.tolist()
    assert np.abs(found.v[0] - v0.astype(float)).max() < 1e-15
    if not found.u0.any():
        assert found.v[0].tolist() == rest.tolist()


@stored
def test_both_integrations_agree_far_below_what_doubles_hold(path: Path):
    found = load_reference(path)
    assert found.uncertainty < 1e-15
    assert found.uncertainty < found.rounding
    assert found.differences[0] < 1e-30
    assert difference(*found.runs) == found.differences.tolist()
    for run in found.runs:
        assert run.q.shape == run.v.shape == (found.times.size, found.scene.n)


@stored
def test_energy_is_kept_at_every_step_of_either_integration(path: Path):
    found = load_reference(path)
    for run in found.runs:
        if not found.scene.conserves_energy:
            assert run.drift is run.energy is None
            continue
        assert run.drift is not None
        assert run.drift < 1e-20
        assert run.energy is not None
        energy = run.energy.astype(float)
        assert np.ptp(energy) <= np.spacing(np.abs(energy[0]) or 1.0)


@stored
def test_shorter_steps_of_the_taylor_series_change_nothing(path: Path):
    found = load_reference(path)
    assert found.check["steps"] > found.runs[0].facts["steps"]
    assert found.check["largest_difference"] <= max(found.uncertainty, 1e-25)
    if found.scene.conserves_energy:
        assert found.check["energy_drift"] < 1e-28


@stored
def test_constraints_hold_at_any_time(path: Path):
    """The constraints are a third opinion: neither integration uses `constraint`."""
    found = load_reference(path)
    scene = found.scene
    for run in found.runs:
        for q, v, t in zip(run.q, run.v, found.times, strict=True):
            assert violation(scene, q, v, float(t)) < 1e-20


def violation(scene: Scene, q: np.ndarray, v: np.ndarray, t: float) -> float:
    with precision(160):
        q, v = (np.array([flint.arb(str(x)).mid() for x in y]) for y in (q, v))
        balls = reference.Balls()
        parameters = scene.parameters(balls)
        c = scene.constraint(parameters, scene.prepare(balls, parameters, q, flint.arb(t)), q, v)
        return 0.0 if c is None else max(abs(float(x)) for x in c)


def test_the_papers_robot_has_the_energy_found_before():
    found = load_reference(FOLDER / "paper-rest.json")
    assert float(found.runs[0].energy[0]) == pytest.approx(8847.744025, abs=1e-6)


# ---- Files that are none -------------------------------------------------------------------------


def changed(tmp_path: Path, change) -> Path:
    document = json.loads((FOLDER / "free-3.json").read_text(encoding="utf-8"))
    change(document)
    path = tmp_path / "changed.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d.pop("scene"), "'scene' is missing"),
        (lambda d: d["scene"].update(kind="os.system"), "no scene of the kind 'os.system'"),
        (lambda d: d["scene"]["parameters"].update(color=1), "color"),
        (lambda d: d["scene"]["parameters"].update(mass=[1.0, 1.0, -1.0]), "mass"),
        (lambda d: d["scene"].update(parameters=None), "mapping"),
        (lambda d: d.update(q0=[0.0]), "shapes"),
        (lambda d: d.update(times=[0.0]), "times that rise"),
        (lambda d: d["times"].reverse(), "times that rise"),
        (lambda d: d["times"].pop(), "shape"),
        (lambda d: d["runs"].pop(), "not enough values"),
        (lambda d: d["runs"][0]["q"].pop(), "shape"),
        (lambda d: d["runs"][0]["q"][1].pop(), "shape"),
        (lambda d: d["runs"][1]["v"][1].__setitem__(0, "one"), "strings of digits"),
        (lambda d: d["runs"][1]["v"][1].__setitem__(0, None), "strings of digits"),
        (lambda d: d["runs"][1]["v"][1].__setitem__(0, "NaN"), "finite"),
        (lambda d: d["runs"][1]["v"][1].__setitem__(0, "0.5"), "uncertainty is given as"),
        (lambda d: d.update(uncertainty=1e-40), "uncertainty is given as"),
        (lambda d: d["q0"].__setitem__(0, 1.0), "are not q0"),
        (lambda d: d.pop("check"), "'check' is missing"),
        (lambda d: d.update(check=3), "int"),
        (lambda d: d["runs"][0].pop("energy"), "'energy' is missing"),
    ],
)
def test_a_file_that_is_no_reference_is_named_with_what_is_wrong(tmp_path: Path, change, says: str):
    path = changed(tmp_path, change)
    with pytest.raises(InputError, match=says) as refused:
        load_reference(path)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize("text", ["", "{", "[]", "3", '"x"', "\x00"])
def test_a_file_that_is_not_even_an_object_is_named(tmp_path: Path, text: str):
    path = tmp_path / "broken.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"broken\.json"):
        load_reference(path)


def test_a_file_of_other_bytes_is_named(tmp_path: Path):
    path = tmp_path / "broken.json"
    path.write_bytes(b"\xff\xfe\xfa")
    with pytest.raises(InputError, match=r"broken\.json"):
        load_reference(path)


def test_a_file_that_is_not_there_is_named(tmp_path: Path):
    with pytest.raises(InputError, match=r"none\.json' cannot be read"):
        load_reference(tmp_path / "none.json")


def test_what_is_saved_is_what_is_loaded(tmp_path: Path):
    found = load_reference(FOLDER / "free-3.json")
    path = tmp_path / "again.json"
    save_reference(found, path)
    again = load_reference(path)
    assert repr(again.scene) == repr(found.scene)
    assert again.check == found.check
    for one, other in zip(again.runs, found.runs, strict=True):
        assert one.facts == other.facts
        assert (one.q == other.q).all()
        assert (one.v == other.v).all()
        assert (one.energy == other.energy).all()


def test_a_file_that_cannot_be_written_is_bad_input(tmp_path: Path):
    found = load_reference(FOLDER / "free-3.json")
    with pytest.raises(InputError, match="cannot be written"):
        save_reference(found, tmp_path / "none" / "x.json")


# ---- Numbers of many digits ----------------------------------------------------------------------


def run_of(times: list[float], value: str) -> ReferenceRun:
    q = decimals(np.full((len(times), 2), value, object))
    return ReferenceRun(times, q, q, None, None, {})


def test_differences_are_taken_in_all_digits():
    one = run_of([0.0, 1.0], "1." + "0" * 30 + "1")
    other = run_of([0.0, 1.0], "1")
    assert difference(one, other) == [1e-31, 1e-31]


def test_velocities_that_differ_are_a_difference():
    one, other = run_of([0.0, 1.0], "1"), run_of([0.0, 1.0], "3")
    assert difference(one, replace(one, v=other.v)) == [2.0, 2.0]
    assert difference(one, replace(one, q=other.q)) == [2.0, 2.0]


def test_runs_at_other_times_are_not_compared():
    with pytest.raises(InputError, match="differ in their times"):
        difference(run_of([0.0, 1.0], "1"), run_of([0.0, 2.0], "1"))


def test_decimals_keep_36_digits():
    (x,) = decimals(np.array(["1." + "3" * 60], object))
    assert x == Decimal("1." + "3" * (DIGITS - 1))


# ---- The arithmetic of expressions ---------------------------------------------------------------


def quad_value(numbers: HeyokaArithmetic, expression) -> Fraction:
    """Return the value of a constant expression."""
    compiled = numbers.heyoka.cfunc([expression], vars=[], **numbers.options)
    return Fraction(str(compiled(numbers.constants(np.zeros(0)))[0]))


def test_constants_are_folded_in_quad_precision(heyoka):
    numbers = HeyokaArithmetic()
    x, y = numbers.numbers(np.array([0.1, 0.3]))
    for said, exact in (
        (x * y, Fraction(0.1) * Fraction(0.3)),
        (x / y, Fraction(0.1) / Fraction(0.3)),
        (x / 2 + 1, Fraction(0.1) / 2 + 1),
    ):
        assert abs(quad_value(numbers, said) / exact - 1) < 1e-33


def test_cosines_of_constants_are_those_of_exactly_the_doubles(heyoka):
    numbers = HeyokaArithmetic()
    given = [0.7, -2.0]
    angles = numbers.angles(np.array(given))
    for x, cos, sin in zip(given, angles.cos, angles.sin, strict=True):
        with precision(160):
            true = [Fraction(y.str(45, radius=False)) for y in flint.arb(x).sin_cos()]
        assert abs(quad_value(numbers, sin) - true[0]) < 1e-33
        assert abs(quad_value(numbers, cos) - true[1]) < 1e-33


@pytest.mark.parametrize("size", [1, 2, 3, 4])
@pytest.mark.parametrize("columns", [(), (2,)])
def test_a_solve_of_expressions_is_the_solution(heyoka, size: int, columns: tuple):
    source = np.random.default_rng(size)
    root = source.integers(-4, 5, (size, size)).astype(float)
    A, b = root @ root.T + np.eye(size), source.random((size, *columns))
    numbers = HeyokaArithmetic()
    x = solve(numbers.numbers(A), numbers.numbers(b), "A")
    assert x.shape == b.shape
    exact = eliminate(*(np.vectorize(Fraction, otypes=[object])(y) for y in (A, b)), "A")
    for said, true in zip(x.ravel(), exact.ravel(), strict=True):
        assert abs(quad_value(numbers, said) - true) < 1e-29


def test_nothing_else_needs_heyoka():
    modules = "eomcheck.cli, eomcheck.motion.reference_solution, eomcheck.lab.references"
    code = f"import sys, {modules}; assert 'heyoka' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_missing_library_is_said_in_one_sentence(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "heyoka", None)
    with pytest.raises(EngineError, match=r"pip install 'eomcheck\[reference\]'"):
        taylor_reference(Snake.coil(2), np.zeros(4), np.zeros(2), [0.0, 1.0])


# ---- Both integrations ---------------------------------------------------------------------------

TIMES = [0.0, 0.0125, 0.025]
LOOSE = 1e-22
"""A tolerance for tests, which have less time."""


def test_a_short_piece_computed_anew_is_what_is_stored(heyoka):
    found = load_reference(FOLDER / "coil-2.json")
    times = found.times[:2].tolist()
    fresh = taylor_reference(found.scene, found.q0, found.u0, times)
    second = extended_reference(found.scene, found.q0, np.zeros(4), times, tolerance=LOOSE)
    for run in (fresh, second):
        for mine, kept in ((run.q, found.runs[0].q), (run.v, found.runs[0].v)):
            assert np.abs(mine - kept[:2]).max() < Decimal("1e-17")
    assert max(difference(fresh, second)) < 1e-17


def test_both_agree_on_a_rolling_snake(heyoka):
    scene, u0 = Snake.coil(4), np.array([1.0, -2.0])
    q0, _ = scene.initial_state()
    first = taylor_reference(scene, q0, u0, TIMES)
    v0 = extended_velocity(scene, q0, u0)
    second = extended_reference(scene, q0, v0, TIMES, tolerance=LOOSE)
    assert max(difference(first, second)) < 1e-18
    for run in (first, second):
        assert run.drift is not None
        assert run.drift < 1e-20


class Faulty(Snake):
    """A snake whose wheels lose a millionth of the constraints' drift, in Lagrange's terms only."""

    @staticmethod
    def terms(parameters, angles, q, v):
        M, Q, B, a, gamma, b = Snake.terms(parameters, angles, q, v)
        return Terms(M, Q, B, a, gamma - gamma / 2**20, b)


def test_a_small_fault_in_one_derivation_shows(heyoka):
    coil = Snake.coil(2)
    scene = Faulty(**{field.name: getattr(coil, field.name) for field in fields(coil)})
    q0, _ = scene.initial_state()
    u0 = np.array([1.0, 0.5])
    first = taylor_reference(scene, q0, u0, TIMES)
    v0 = extended_velocity(scene, q0, u0)
    second = extended_reference(scene, q0, v0, TIMES, tolerance=LOOSE)
    assert max(difference(first, second)) > 1e-9


def test_without_real128_the_general_type_gives_the_same(heyoka, monkeypatch: pytest.MonkeyPatch):
    scene = Snake.coil(2)
    q0, _ = scene.initial_state()
    first = taylor_reference(scene, q0, np.zeros(2), TIMES)
    monkeypatch.delattr(heyoka, "real128", raising=False)
    second = taylor_reference(scene, q0, np.zeros(2), TIMES)
    assert second.facts["number"] == "real"
    assert max(difference(first, second)) < 1e-27


def objects(bodies: Bodies) -> Bodies:
    """Return `bodies` with arrays that hold any numbers, not only doubles."""
    return Bodies(*(None if x is None else np.array(x, object) for x in bodies))


class Swinging(Free):
    bodies = staticmethod(lambda *x: objects(Free.bodies(*x)))


class Carried(OnBelt):
    bodies = staticmethod(lambda *x: objects(OnBelt.bodies(*x)))


def test_a_free_point_on_springs_swings_as_the_cosine(heyoka):
    scene = Swinging()
    q0, u0 = np.array([1.0, 2.0]), np.array([0.5, 0.0])
    runs = (
        taylor_reference(scene, q0, u0, [0.0, 3.0]),
        extended_reference(scene, q0, u0, [0.0, 3.0], tolerance=1e-26),
    )
    with precision(160):
        rates = [(flint.arb(k) / 2).sqrt() for k in (3, 5)]
        true = [
            x * (rate * 3).cos() + w / rate * (rate * 3).sin()
            for x, w, rate in zip((1, 2), (flint.arb(0.5), 0), rates, strict=True)
        ]
        for run in runs:
            for said, x in zip(run.q[1], true, strict=True):
                assert abs(float((flint.arb(str(said)) - x).mid())) < 1e-24


def test_constraints_that_move_are_followed(heyoka):
    scene = Carried()
    q0, u0 = np.array([1.0, 2.0]), np.array([0.5])
    v0 = extended_velocity(scene, q0, u0)
    assert v0.astype(float).tolist() == [0.5, 0.75]
    first = taylor_reference(scene, q0, u0, TIMES)
    second = extended_reference(scene, q0, v0, TIMES, tolerance=LOOSE)
    assert first.energy is None
    assert second.drift is None
    assert max(difference(first, second)) < 1e-20


def test_a_motion_starts_with_the_velocity_of_its_first_time(heyoka):
    scene = TurntableBall(swing=1.0, frequency=3.0)
    q0, _ = scene.initial_state()
    times, u0 = [0.4, 0.45], np.array([20.0, 0.0, 0.5])
    v0, other = (extended_velocity(scene, q0, u0, t) for t in (0.4, 0.0))
    assert (v0[:2] != other[:2]).any()
    first = taylor_reference(scene, q0, u0, times)
    second = extended_reference(scene, q0, v0, times, tolerance=LOOSE)
    assert max(difference(first, second)) < 1e-17
    with pytest.raises(InconsistentVelocityError):
        extended_reference(scene, q0, other, times)
    with pytest.raises(InputError, match="t0"):
        extended_velocity(scene, q0, u0, np.nan)


class Horizontal(Free):
    """A pendulum of length 1 m and mass 1 kg, q its angle against the horizontal, g = 8 m/s²."""

    key = "pendulum"
    name = "pendulum"
    n = 1
    coordinate_names = ("q",)
    angle_coordinates = slice(0, 1)

    def __init__(self):
        self._values = ([1.0], np.zeros(0), (8.0,), [0.0])

    @staticmethod
    def prepare(arithmetic, parameters, q, t):
        return arithmetic.angles(q)

    @staticmethod
    def terms(parameters, angles, q, v):
        return Terms(np.eye(1) * parameters.mass[0], force(parameters, angles), *[None] * 4)

    @staticmethod
    def kinematics(parameters, angles, q, u):
        return None

    @staticmethod
    def speeds(parameters, angles, kinematics):
        return Speeds(np.eye(1), np.zeros(1), None)

    @staticmethod
    def bodies(parameters, angles, kinematics):
        return objects(
            Bodies(
                np.eye(1).reshape(1, 1, 1),
                np.zeros((1, 0, 1)),
                np.zeros((1, 1)),
                np.zeros((1, 0)),
                parameters.mass,
                np.zeros((1, 0, 0)),
                None,
                force(parameters, angles),
            )
        )

    @staticmethod
    def energies(parameters, angles, q, v):
        return v[0] * v[0] / 2, -parameters.stiffness[0] * angles.sin[0]


def force(parameters, angles):
    return parameters.stiffness * angles.cos


def test_a_state_in_which_many_taylor_coefficients_vanish_does_no_harm(heyoka):
    """Released from the horizontal, the angle is a series in t², t⁶, t¹⁰, ...

    Its coefficients 39 and 40, and those of its rate, are zero: to heyoka the first step has no
    limit.
    """
    scene = Horizontal()
    numbers = HeyokaArithmetic()
    careless, outputs = reference._taylor_system(scene, numbers, np.zeros(2), 0.0)
    careless.step()
    assert not abs(float(outputs(careless.state)[1])) < 1e-20  # the energy, 0 J at the start

    times = [0.0, 0.5, 1.0]
    first = taylor_reference(scene, [0.0], [0.0], times)
    assert first.drift is not None
    assert first.drift < 1e-30
    second = extended_reference(scene, [0.0], [0.0], times, tolerance=1e-25)
    assert max(difference(first, second)) < 1e-22


# ---- What is refused -----------------------------------------------------------------------------


def test_a_velocity_in_doubles_off_the_constraints_is_refused():
    scene = Snake.coil(2)
    q0, _ = scene.initial_state()
    v0 = extended_velocity(scene, q0, [1.0, 0.5])
    with pytest.raises(InconsistentVelocityError, match="extended_velocity"):
        extended_reference(scene, q0, v0.astype(float), TIMES)


@pytest.mark.parametrize("times", [[], [0.0], [0.0, 0.0], [1.0, 0.0], [0.0, np.inf], [[0.0, 1.0]]])
def test_times_must_be_at_least_two_that_rise(times):
    scene = Snake.coil(2)
    q0, v0 = scene.initial_state()
    for run in (taylor_reference, extended_reference):
        start = np.zeros(2) if run is taylor_reference else v0
        with pytest.raises(InputError, match="times"):
            run(scene, q0, start, times)


def test_a_scene_without_generalized_speeds_is_refused():
    scene = replace(Snake.coil(2), wheel_angle=np.array([0.0, np.pi / 2]))
    q0, _ = scene.initial_state()
    for run in (taylor_reference, lambda *x: extended_velocity(*x[:3])):
        with pytest.raises(RefusedError, match="wheel_angle"):
            run(scene, q0, np.zeros(2), TIMES)


def test_numbers_of_the_wrong_shape_are_bad_input(heyoka):
    scene = Snake.coil(2)
    q0, v0 = scene.initial_state()
    with pytest.raises(InputError, match="u0 has shape"):
        taylor_reference(scene, q0, np.zeros(3), TIMES)
    with pytest.raises(InputError, match="v0 has shape"):
        extended_reference(scene, q0, v0[:2], TIMES)
    with pytest.raises(InputError, match="q has shape"):
        extended_reference(scene, q0[:2], v0, TIMES)


# ---- The command ---------------------------------------------------------------------------------


def test_the_command_computes_writes_and_says_how_well_it_is_known(
    heyoka, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
):
    short = replace(REFERENCE_CASES["free-3"], end=0.05, parts=1)
    monkeypatch.setitem(references.REFERENCE_CASES, "free-3", short)
    monkeypatch.setattr(sys, "argv", ["eomcheck", "reference", "free-3", "--folder", str(tmp_path)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert not stop.value.code
    found = load_reference(tmp_path / "free-3.json")
    assert found.uncertainty < 1e-24
    said = capsys.readouterr().out
    assert f"{found.uncertainty:.1g}" in said
    assert "free-3.json" in said


def test_several_are_spread_over_processes_and_as_good(
    heyoka, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
):
    short = {
        "free-3": replace(REFERENCE_CASES["free-3"], end=0.05, parts=1),
        "coil-2": replace(REFERENCE_CASES["coil-2"], end=0.005, parts=1),
    }
    monkeypatch.setattr(references, "REFERENCE_CASES", short)
    command = ["eomcheck", "reference", "--folder", str(tmp_path), "--executor", "local:2"]
    monkeypatch.setattr(sys, "argv", command)
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert not stop.value.code
    said = capsys.readouterr().out
    for name, case in short.items():
        assert f"{name}.json" in said
        found, here = load_reference(tmp_path / f"{name}.json"), produce(name, case)
        assert (found.runs[0].q == here.runs[0].q).all()
        assert (found.runs[1].v == here.runs[1].v).all()
        assert found.uncertainty == here.uncertainty < 1e-24


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["reference", "free-3", "--executor", "nowhere"], "--executor 'nowhere'"),
        (["reference", "none"], "unknown reference 'none'; known: paper-rest"),
        (["reference", "free-3", "--folder", "no/such"], "there is no folder 'no'"),
    ],
)
def test_bad_input_to_the_command_is_one_sentence(
    arguments: list[str], says: str, monkeypatch: pytest.MonkeyPatch, capsys
):
    monkeypatch.setattr(sys, "argv", ["eomcheck", *arguments])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert stop.value.code == 2
    assert says in capsys.readouterr().err


def test_a_name_that_is_none_is_told_the_known_ones():
    with pytest.raises(UnknownNameError, match="known: paper-rest, "):
        reference_case("paper")

"""Engines in velocities of their own: faults of maps and of derivatives are named as such."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.engines.test_conformance_methods import robot
from tests.engines.test_quantities_under_test import findings, under_test
from tests.engines.test_velocity_map import mapped
from tests.samples import ordinary, random_state
from tests.trials.wrong_engines import Fault, source_of
from tests.trials.wrong_quantities import FREE_BASE, MAP, SIGNATURES, TAU, VDOT

from eomcheck import check_state
from eomcheck.claims import own_coordinates
from eomcheck.claims.own_coordinates import map_fault
from eomcheck.engines import Answers
from eomcheck.engines.drake import DrakeFile
from eomcheck.engines.mujoco import MujocoFile
from eomcheck.engines.pinocchio import PinocchioEngine, PinocchioFile
from eomcheck.evaluation.conformance import QUANTITIES, ConformancePoint
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """Return an arm on a free base, the same one for all tests here."""
    return robot(tmp_path_factory.mktemp("robot"), floating=True)


def details(kind: type[Any], scene: Scene, *names: str) -> list[str]:
    """Return the details of failures of quantities of an engine at an ordinary state."""
    found = findings(kind, *names, scene=scene)
    return [x.detail for x in found if x.verdict == "failed"]


@pytest.mark.sampled(31)
@pytest.mark.parametrize("fault", FREE_BASE, ids=[x.id for x in FREE_BASE])
def test_a_fault_in_maps_or_derivatives_of_a_free_base_is_named(fault: Fault, base: Scene):
    own: dict[str, Any] = {}
    exec(compile(source_of(fault, fault.base, SIGNATURES), fault.id, "exec"), own)
    asked = [fault.method] if fault.method in QUANTITIES else [TAU, VDOT, "inverse_dynamics"]
    words = [fault.method, *fault.says.split("|")]
    texts = details(own["Wrong"], base, *asked)
    assert any(all(word in text for word in words) for text in texts), texts


def test_a_map_is_compared_at_rest_too(base: Scene):
    def still(self: Any, q: Any, v: Any) -> Any:
        along, more = PinocchioFile.velocity_map_derivatives(self, q, v)
        return 0.0 * along, more

    state = random_state(base, np.random.default_rng(1))
    engine = under_test(PinocchioFile, velocity_map_derivatives=still)(base)
    text = "velocity_map_derivatives: ∂(S v)/∂q is not that of velocity_map: missing"
    assert map_fault(engine, Evaluation(base, state.q, 0.0 * state.v)) == text


def test_differences_of_a_map_have_the_rounding_of_its_values():
    """Two steps may have the same error, by which they do not differ."""
    for q in np.linspace(0.1, 0.9, 50):
        position, along = np.array([q]), np.ones(1)
        value, error = own_coordinates._difference(lambda x: 1e8 + x / 7, position, along, 2.0**-53)
        assert np.abs(value - 1 / 7).max() <= error < 1e-3


def test_turns_of_a_free_base_are_named_by_the_matrix_that_turns():
    c, s = np.cos(0.4), np.sin(0.4)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    turns = dict(own_coordinates._turns(8, R))
    for axes, turn in (("R", R), ("Rᵀ", R.T)):
        whole, linear, angular = (
            turns[f"{part}free base turned by {axes}, R its axes"]
            for part in ("", "linear part of ", "angular part of ")
        )
        assert np.array_equal(whole, linear @ angular) and np.array_equal(whole[6:, 6:], np.eye(2))
        assert np.array_equal(linear[:3, :3], turn) and np.array_equal(angular[3:6, 3:6], turn)
    assert len(turns) == 6


@pytest.mark.parametrize("name", [TAU, VDOT])
def test_derivatives_mapped_to_the_scene_and_back_are_the_same(name: str, base: Scene):
    state = random_state(base, np.random.default_rng(2))
    answers, third = Answers(PinocchioFile(base)), np.cos(np.arange(base.n))
    of_map = answers.derivative_map(QUANTITIES[name], state.q, state.v, third)
    count = QUANTITIES[name].symbol.count(",") + 1
    parts = np.random.default_rng(0).normal(size=(base.n, count * base.n))
    np.testing.assert_allclose(of_map.to_engine(of_map.to_scene(parts)), parts, atol=1e-11)
    assert np.abs(of_map.to_scene(parts) - parts).max() > 0.1


@pytest.mark.parametrize("kind", [PinocchioFile, MujocoFile, DrakeFile])
@pytest.mark.parametrize("speed", [0.0, 1.0, 1e4])
def test_right_maps_of_libraries_have_no_fault(kind: type[Any], speed: float, base: Scene):
    for seed in range(3):
        state = random_state(base, np.random.default_rng(seed))
        assert map_fault(kind(base), Evaluation(base, state.q, speed * state.v)) == ""


def test_a_base_that_is_not_turned_shows_no_axes_of_its_own(base: Scene):
    """Along its axes and along the world's, S is the same: no rows of it are wrong."""
    at = Evaluation(base, np.zeros(base.n), np.cos(np.arange(base.n)))
    R = own_coordinates._base_axes(ConformancePoint(at))
    assert R is not None and np.array_equal(R, np.eye(3))
    assert map_fault(PinocchioFile(base), at) == ""


def test_a_small_fault_of_a_map_is_found(base: Scene):
    """One part in 10⁵ of ∂(S v)/∂q: central differences have six digits, others three."""

    def off(self: Any, q: Any, v: Any) -> Any:
        along, more = PinocchioFile.velocity_map_derivatives(self, q, v)
        return (1.0 + 1e-5) * along, more

    state = random_state(base, np.random.default_rng(1))
    engine = under_test(PinocchioFile, velocity_map_derivatives=off)(base)
    assert "∂(S v)/∂q" in map_fault(engine, Evaluation(base, state.q, state.v))


def test_a_right_map_without_derivatives_has_no_fault():
    scene = SCENES["chain-pendulum"].example()
    state = random_state(scene, np.random.default_rng(0))
    assert map_fault(mapped(scene.n)(scene), Evaluation(scene, state.q, state.v)) == ""


def test_a_wrong_block_by_which_a_right_one_is_mapped_is_the_one_to_blame(base: Scene):
    def wrong(self: Any, *asked: Any) -> Any:
        by_q, by_v = PinocchioFile.inverse_dynamics_derivatives(self, *asked)
        return by_q, -by_v

    by_q, by_v = details(under_test(PinocchioFile, inverse_dynamics_derivatives=wrong), base, TAU)
    assert "it is right, and ∂τ/∂v, by which it is mapped, is wrong: " in by_q
    assert by_q.endswith("wrong sign")
    assert "by which it is mapped" not in by_v and "wrong sign" in by_v


def test_at_rest_derivatives_in_place_of_those_by_v_are_named(base: Scene):
    """Those by v vanish there, and what rounding explains in them is no bound for the others."""

    def wrong(self: Any, *asked: Any) -> Any:
        by_q, _ = PinocchioFile.inverse_dynamics_derivatives(self, *asked)
        return by_q, by_q

    state = random_state(base, np.random.default_rng(1))
    kind = under_test(PinocchioFile, inverse_dynamics_derivatives=wrong)
    claims = ["engine-inverse-dynamics-derivatives"]
    found = check_state(base, state.q, 0.0 * state.v, engines=[kind], claims=claims)
    (text,) = [x.detail for x in found if x.subject.endswith("∂τ/∂v")]
    assert text.endswith("∂τ/∂q in place of ∂τ/∂v")


def test_a_library_that_reads_the_file_itself_is_not_blamed(base: Scene):
    """Its map may be wrong by what the reader here reads."""

    class Turned(PinocchioFile):
        def velocity_map(self, q: Any, v: Any) -> Any:
            x, S, rest = super().velocity_map(q, v)
            return x, S, 0.0 * rest

    (text,) = details(under_test(Turned), base, "inverse_dynamics")
    assert f"{MAP}: Ṡ v" in text
    Turned.__module__ = PinocchioFile.__module__
    (text,) = details(Turned, base, "inverse_dynamics")
    assert MAP not in text and "by eomcheck" in text


class Permuted(PinocchioEngine):
    """The scene's tree with its joints in another order, and a changed M⁻¹."""

    S = np.array([[0.0, 2.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])

    def inverse_mass_matrix(self, q: Any, t: Any = 0.0) -> Any:
        inverse = self.S @ np.linalg.inv(self.scene_mass_matrix(q)) @ self.S.T
        return self.change(inverse)

    def velocity_map(self, q: Any, v: Any) -> Any:
        return q, self.S, np.zeros(3)

    def scene_mass_matrix(self, q: Any) -> Any:
        return Evaluation(self.scene, q, np.zeros(3)).terms.M


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (np.triu, "; in its own coordinates, the upper triangle alone"),
        (np.negative, ": wrong sign"),
        (lambda x: x + np.diag([0.1, 0.0, 0.0]), None),
    ],
)
def test_an_inverse_is_wrong_in_coordinates_of_the_engine(change: Any, said: str | None):
    scene = SCENES["chain-pendulum"].example()
    kind = type("Changed", (Permuted,), {"change": staticmethod(change)})
    (text,) = details(kind, scene, "inverse_mass_matrix")
    assert text.endswith(said) if said else "own coordinates" not in text


# ---- Bounds --------------------------------------------------------------------------------------

BLOCKS = [(TAU, 0), (TAU, 1), (VDOT, 0), (VDOT, 1), (VDOT, 2)]


@pytest.mark.parametrize("speed", [1e-3, 1.0])
@pytest.mark.parametrize("name, block", BLOCKS)
@pytest.mark.parametrize("scene", ["bicycle", "chain-pendulum", "snake"])
@pytest.mark.sampled(5)
def test_a_small_error_of_one_block_is_found_whatever_the_size_of_the_others(
    scene: str, name: str, block: int, speed: float
):
    def slightly(self: Any, *asked: Any) -> Any:
        parts = [np.array(x) for x in getattr(PinocchioEngine, name)(self, *asked)]
        parts[block] *= 1.0 + 2.0**-27
        return tuple(parts)

    own = ordinary(SCENES[scene], 2)[0]
    state = random_state(own, np.random.default_rng(1))
    claims, symbol = (
        [f"engine-{name.replace('_', '-')}"],
        QUANTITIES[name].symbol.split(", ")[block],
    )
    for kind, wrong in ((under_test(), set()), (under_test(**{name: slightly}), {symbol})):
        options: dict[str, Any] = {"claims": claims, "consistent": False}
        found = check_state(own, state.q, speed * state.v, engines=[kind], **options)
        assert {x.subject.split(", ")[1] for x in found if x.verdict != "passed"} == wrong


def test_derivatives_by_v_at_rest_are_zero_and_pass(base: Scene):
    state = random_state(base, np.random.default_rng(1))
    for kind in (PinocchioFile, DrakeFile):
        (by_q, by_v) = check_state(
            base, state.q, 0.0 * state.v, engines=[under_test(kind)],
            claims=["engine-inverse-dynamics-derivatives"],
        )  # fmt: skip
        assert (by_q.verdict, by_v.verdict) == ("passed", "passed")
        assert by_v.observed <= by_v.allowed < 1e-12 * by_q.allowed


def test_a_result_of_a_wrong_shape_is_reported_by_its_shape_and_the_expected_one():
    scene = SCENES["chain-pendulum"].example()
    state = random_state(scene, np.random.default_rng(0))
    kind = under_test(gravity=lambda self, q, t=0.0: np.zeros((3, 1)))
    (found,) = check_state(scene, state.q, state.v, engines=[kind], claims=["engine-gravity"])
    assert str(found).endswith(
        "UnderTest: gravity returned an array of shape (3, 1), expected an array of shape (3)"
    )
    assert "inf" not in str(found)


def test_of_repeated_answers_the_worst_is_that_by_the_bounds_of_its_blocks():
    """An error that is none in a large block hides no smaller one that is one in a small block."""
    scene = ordinary(SCENES["bicycle"], 2)[0]
    state = random_state(scene, np.random.default_rng(1))
    calls: list[int] = []

    def wrong(self: Any, *asked: Any) -> Any:
        by_q, by_v = PinocchioEngine.inverse_dynamics_derivatives(self, *asked)
        calls.append(1)
        if len(calls) % 2:
            return by_q, by_v * (1.0 + 2.0**-33)
        return by_q * (1.0 + 2.0**-50), by_v

    kind = under_test(inverse_dynamics_derivatives=wrong)
    options: dict[str, Any] = {"claims": ["engine-inverse-dynamics-derivatives"]}
    slow = 1e-7 * state.v
    found = check_state(scene, state.q, slow, engines=[kind], consistent=False, **options)
    verdicts = {x.subject.split(", ")[1]: x.verdict for x in found}
    assert verdicts == {"∂τ/∂q": "passed", "∂τ/∂v": "failed"}

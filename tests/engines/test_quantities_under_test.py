"""Conformance quantities of engines under test: caches, links, bounds and options all judged."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.engines.test_conformance_methods import robot
from tests.samples import ordinary, random_state

from eomcheck import check_state
from eomcheck.claims.engine_quantities import acceleration_asked, frames_asked
from eomcheck.claims.finding import Finding
from eomcheck.engines import Engine, VelocityMap
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.engines.idyntree import IdyntreeEngine, IdyntreeFile
from eomcheck.engines.pinocchio import PinocchioEngine, PinocchioFile
from eomcheck.engines.tree_engine import parameters_at_joint
from eomcheck.evaluation.conformance import QUANTITIES, ConformancePoint
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES, Snake, from_urdf

BICYCLE, _ = ordinary(SCENES["bicycle"], 1)


def under_test(base: type[Any] = PinocchioEngine, **members: Any) -> type[Any]:
    """Return an engine with these members that is no built-in one."""
    return type("UnderTest", (base,), {"version": classmethod(lambda cls: "ours 1.0"), **members})


def findings(kind: type[Any], *names: str, scene: Scene = BICYCLE, **options: Any) -> list[Finding]:
    """Return the Findings about quantities of an engine in an ordinary state."""
    state = random_state(scene, np.random.default_rng(1))
    claims = [f"engine-{x.replace('_', '-')}" for x in names]
    return check_state(scene, *state, engines=[kind], claims=claims, **options)


# ---- Results that are kept -----------------------------------------------------------------------


def keeping(name: str, ignored: str, *, last: bool) -> dict[str, Any]:
    """Return the method of a quantity that keeps results by all arguments but one.

    Args:
        name: the quantity.
        ignored: the argument that it ignores.
        last: whether it keeps the last result alone.
    """
    arguments = QUANTITIES[name].arguments
    index = arguments.index(ignored)

    def method(self: Any, *asked: Any) -> Any:
        if not hasattr(self, "kept"):
            self.kept = {}
        parts = [x.tobytes() if isinstance(x, np.ndarray) else x for x in asked[: len(arguments)]]
        key = tuple(parts[:index] + parts[index + 1 :])
        if key not in self.kept:
            if last:
                self.kept.clear()
            self.kept[key] = getattr(PinocchioEngine, name)(self, *asked)
        return self.kept[key]

    return {name: method}


KEPT = [
    *((name, "vdot") for name in ("inverse_dynamics", "frame_acceleration", "momentum_rate")),
    *((name, "vdot") for name in ("center_of_mass_acceleration", "inverse_dynamics_derivatives")),
    ("forward_dynamics", "tau"),
    *((name, "f") for name in ("frame_placement", "frame_jacobian", "frame_acceleration")),
]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("last", [False, True])
@pytest.mark.parametrize("name, ignored", KEPT)
def test_a_result_kept_by_all_arguments_but_one_fails(name: str, ignored: str, last: bool):
    failed = [x for x in findings(under_test(**keeping(name, ignored, last=last)), name)
              if x.verdict == "failed"]  # fmt: skip
    assert failed
    assert "it keeps what it was asked before" in failed[0].detail


# ---- Coriolis matrices ---------------------------------------------------------------------------


def along_v(self: Any, q: Any, v: Any, t: float = 0.0) -> Any:
    """Return a matrix C of rank one with C v = B."""
    return np.outer(self.bias(q, v, t), v) / (v @ v)


@pytest.mark.parametrize("skew, verdicts", [(True, {"passed", "failed"}), (False, {"passed"})])
def test_a_coriolis_matrix_declared_to_give_the_rate_of_M_is_compared_with_it(skew, verdicts):
    kind = under_test(coriolis_matrix=along_v, coriolis_skew=skew)
    found = findings(kind, "coriolis_matrix")
    assert {x.verdict for x in found} == verdicts
    assert [x.verdict for x in found if "C + Cᵀ" in x.subject] == ["failed"] * skew


@pytest.mark.parametrize("scene", ["bicycle", "snake", "four-bar-chain", "chain-pendulum"])
@pytest.mark.parametrize("kind", [CasadiEngine, IdyntreeEngine, PinocchioEngine])
def test_coriolis_matrices_of_libraries_give_the_rate_of_M(kind: type[Any], scene: str):
    own = ordinary(SCENES[scene], 2)[0]
    if kind.represents(own):
        found = findings(under_test(kind, coriolis_skew=True), "coriolis_matrix", scene=own)
        assert [x.verdict for x in found] == ["passed", "passed"]


def test_the_rate_of_M_is_mapped_from_the_axes_of_a_free_base(tmp_path: Path):
    scene = robot(tmp_path, floating=True)
    for kind, verdict in ((PinocchioFile, "passed"), (IdyntreeFile, "failed")):
        found = findings(under_test(kind, coriolis_skew=True), "coriolis_matrix", scene=scene)
        assert [x.verdict for x in found] == ["passed", verdict], "iDynTree: C v = B alone"


# ---- Links ---------------------------------------------------------------------------------------

CHAIN = ordinary(Snake, 9)[0]


def links_of(scene: Scene) -> list[str]:
    """Return the names of the links of a scene."""
    tree = scene.tree()
    assert tree is not None
    return [frame.name for frame in tree.frames]


LINKS = links_of(CHAIN)


def wrong_about(*links: str) -> dict[str, Any]:
    """Return the Jacobian of frames, of the other sign for some links."""

    def frame_jacobian(self: Any, f: str, q: Any, t: float = 0.0) -> Any:
        sign = -1.0 if f in links else 1.0
        return sign * PinocchioEngine.frame_jacobian(self, f, q, t)

    return {"frame_jacobian": frame_jacobian}


@pytest.mark.parametrize("link", LINKS)
def test_all_links_are_judged_where_answers_are_repeated_often(link: str):
    found = findings(under_test(**wrong_about(link)), "frame_jacobian", scene=CHAIN)
    assert {x.subject.split(", ")[1] for x in found} == set(LINKS)
    assert [x.subject.split(", ")[1] for x in found if x.verdict == "failed"] == [link]


def test_links_that_an_engine_does_not_have_are_named_in_one_skipped_finding():
    def has_frame(self: Any, f: str) -> bool:
        return f == LINKS[0]

    kind = under_test(**wrong_about(*LINKS[1:]), has_frame=has_frame)
    skipped, passed = findings(kind, "frame_jacobian", scene=CHAIN)
    assert (skipped.verdict, passed.verdict) == ("skipped", "passed")
    assert skipped.detail == f"its model has no frame of link {', '.join(LINKS[1:])}"


@pytest.mark.parametrize("count", [4, 7, 8, 9, 15, 30])
def test_links_of_one_state_differ_and_those_of_many_states_are_all(count: int):
    scene, asked = Snake.coil(count), set()
    random = np.random.default_rng(0)
    for _ in range(40 * count):
        at = Evaluation(scene, random.normal(size=scene.n), np.zeros(scene.n))
        frames = frames_asked(at, ConformancePoint(at))
        assert len(set(frames)) == 3
        asked |= set(frames)
    assert asked == set(links_of(scene))


@pytest.mark.parametrize("speed", [0.0, 1.0, 100.0])
def test_accelerations_that_are_asked_for_are_as_large_as_those_of_the_velocity(speed: float):
    """Beside ω × v a small one would be lost; no two entries are the same or 0."""
    at = Evaluation(CHAIN, np.zeros(CHAIN.n), np.full(CHAIN.n, speed))
    vdot = acceleration_asked(at)
    assert 0.5 * max(1.0, speed**2) <= np.abs(vdot).max() <= max(1.0, speed**2)
    assert len({*vdot.tolist()}) == CHAIN.n and (vdot != 0.0).all()


GROUND = {
    "frame_placement": lambda x: (x[0], x[1] + 7.0),
    "frame_velocity": lambda x: x + 1.0,
    "frame_jacobian": lambda x: x + 1.0,
    "frame_acceleration": lambda x: x + 1.0,
}
"""Quantity -> a fault of it."""


@pytest.mark.parametrize("name", GROUND)
def test_the_motion_of_a_link_on_the_ground_is_judged(name: str, tmp_path: Path):
    def wrong(self: Any, f: str, *asked: Any) -> Any:
        right = getattr(PinocchioFile, name)(self, f, *asked)
        return GROUND[name](right) if f == "base" else right

    scene = robot(tmp_path)
    for kind, verdicts in ((under_test(PinocchioFile), set()),
                           (under_test(PinocchioFile, **{name: wrong}), {"base"})):  # fmt: skip
        found = findings(kind, name, scene=scene)
        failed = {x.subject.split(", ")[1] for x in found if x.verdict != "passed"}
        assert failed == verdicts, found


# ---- Velocities of its own -----------------------------------------------------------------------


class Multipliers(Engine):
    """Our own derivatives of λ, in the coordinates of the scene."""

    version = classmethod(lambda cls: "ours 1.0")
    represents = classmethod(lambda cls, scene: True)

    def mass_matrix(self, q, t=0.0):
        return Evaluation(self.scene, q, 0 * q, t).terms.M

    def bias(self, q, v, t=0.0):
        return Evaluation(self.scene, q, v, t).terms.B

    def constraint_force_derivatives(self, q, v, tau, t=0.0):
        at = Evaluation(self.scene, q, v, t)
        both = ConformancePoint(at, tau=tau).constraint_force_derivatives
        return both[:, : len(q)], both[:, len(q) :]


class Turning(Multipliers):
    """The same in velocities w = S v, S = diag(2 + sin q): its derivatives are not mapped."""

    def velocity_map(self, q, v):
        return VelocityMap(q, np.diag(2.0 + np.sin(q)), np.cos(q) * v * v)

    def velocity_map_derivatives(self, q, v):
        return np.diag(np.cos(q) * v), np.diag(-np.sin(q) * v * v)


@pytest.mark.parametrize("speed", [0.0, 1.0])
@pytest.mark.parametrize("kind, verdict", [(Multipliers, "passed"), (Turning, "skipped")])
def test_derivatives_of_multipliers_by_velocities_that_turn_are_skipped_at_rest_too(
    kind: type[Any], verdict: str, speed: float
):
    scene, state = ordinary(SCENES["four-bar-chain"], 1)
    claims = ["engine-constraint-force-derivatives"]
    found = check_state(scene, state.q, speed * state.v, engines=[kind], claims=claims)
    assert {x.verdict for x in found} == {verdict}, found


# ---- Bounds --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["gravity", "momentum_matrix"])
def test_zeros_fail_at_any_speed_for_a_quantity_of_positions(name: str):
    def zeros(self: Any, q: Any, t: float = 0.0) -> Any:
        return 0.0 * getattr(PinocchioEngine, name)(self, q, t)

    state = random_state(BICYCLE, np.random.default_rng(1))
    for speed in (1.0, 1e7, 1e12):
        for kind, verdict in ((under_test(), "passed"), (under_test(**{name: zeros}), "failed")):
            claims = [f"engine-{name.replace('_', '-')}"]
            asked = BICYCLE, state.q, speed * state.v
            found = check_state(*asked, engines=[kind], claims=claims, consistent=False)
            assert [x.verdict for x in found] == [verdict], (speed, found)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("scene", ["bicycle", "chain-pendulum", "snake", "four-bar-chain"])
def test_derivatives_by_forces_have_a_bound_of_their_own(scene: str):
    def rounded(factor: float) -> Any:
        def derivatives(self: Any, *asked: Any) -> Any:
            parts = PinocchioEngine.forward_dynamics_derivatives(self, *asked)
            by_q, by_v, by_tau = (np.float32(part).astype(np.float64) for part in parts)
            return by_q, by_v, factor * by_tau

        return derivatives

    name, own = "forward_dynamics_derivatives", ordinary(SCENES[scene], 1)[0]
    cases = ((1.0, "passed"), (0.0, "failed"), (-1.0, "failed"))
    # M⁻¹ does not depend on v: however fast, its bound is the same.
    for seed, speed in ((1, 1.0), (2, 1.0), (3, 1.0), (4, 1e6)):
        state = random_state(own, np.random.default_rng(seed))
        for factor, verdict in cases:
            kind = under_test(unit_roundoff=2.0**-24, **{name: rounded(factor)})
            asked = own, state.q, speed * state.v
            claims = ["engine-forward-dynamics-derivatives"]
            found = check_state(*asked, engines=[kind], claims=claims, consistent=False)
            *others, by_tau = found
            assert {x.verdict for x in others} <= {"passed", "inconclusive"}, (seed, factor, others)
            assert by_tau.verdict == verdict, (seed, factor, by_tau)
            assert factor == 1.0 or "by force on" in by_tau.detail


@pytest.mark.parametrize("name", ["inverse_dynamics", "forward_dynamics"])
@pytest.mark.parametrize(("error", "fails"), [(1e-16, False), (1e-9, True)])
def test_rounding_of_derivatives_that_vanish_is_no_fault(name: str, error: float, fails: bool):
    """Nothing of one hinge about a vertical axis depends on q; terms of M v̇ cancel."""

    def off(self: Any, *asked: Any) -> Any:
        by_q, *others = getattr(PinocchioEngine, method)(self, *asked)
        return by_q + error, *others

    method = f"{name}_derivatives"
    scene = from_urdf(Path(__file__).parents[2] / "docs" / "guides" / "tilted.urdf")
    claims = [f"engine-{method.replace('_', '-')}"]
    kind = under_test(**{method: off})
    found = check_state(scene, [0.3], [0.0], engines=[kind], claims=claims)
    assert any(x.verdict == "failed" for x in found) == fails


def test_a_bound_as_large_as_the_value_shows_nothing():
    state = random_state(BICYCLE, np.random.default_rng(1))
    q = state.q + np.r_[1e15, np.zeros(BICYCLE.n - 1)]
    claims = ["engine-kinetic-energy", "engine-center-of-mass-velocity"]
    found = check_state(
        BICYCLE, q, state.v, engines=[under_test()], claims=claims, consistent=False
    )
    assert {x.verdict for x in found} == {"inconclusive"}


# ---- Regressors ----------------------------------------------------------------------------------


def test_a_regressor_of_parameters_along_the_axes_of_joints_is_named(tmp_path: Path):
    def of_joints(self: Any, *asked: Any) -> Any:
        Y = np.array(PinocchioEngine.regressor(self, *asked))
        for b, frame in enumerate(self.body_frames):
            columns = np.s_[:, 10 * b : 10 * b + 10]
            Y[columns] = Y[columns] @ np.linalg.inv(parameters_at_joint(frame))
        return Y

    (only,) = findings(under_test(regressor=of_joints), "regressor", scene=robot(tmp_path))
    text = "along the axes of the joints, expected along those of the links"
    assert only.verdict == "failed" and only.detail.endswith(f": {text}")


# ---- Right engines -------------------------------------------------------------------------------


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", QUANTITIES)
def test_a_right_engine_passes(name: str):
    if PinocchioEngine.offers(name):
        assert {x.verdict for x in findings(under_test(), name)} == {"passed"}

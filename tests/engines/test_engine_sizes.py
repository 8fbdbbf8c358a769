"""How large the terms are that an engine sums and that cancel: measured from the scene, for all."""

from __future__ import annotations

import numpy as np
import pytest
from tests.engines.planar import planar
from tests.scenes.test_not_rational import Blade

import eomcheck
from eomcheck.claims.engine_quantities import own_value
from eomcheck.claims.finding import Finding
from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import Joint, Link, knife_edge, rolling_ball
from eomcheck.draws.pairwise_design import scene_cases
from eomcheck.engines import ENGINES, Answers, Engine, asked_by_default, represents
from eomcheck.engines.answers import composite_inertia, inertia_size, mass_size
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.evaluation.conformance import QUANTITIES, ConformancePoint
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.scenes import SCENES, Bricard, ChainPendulum, Sleigh, Snake

EVERY = asked_by_default(ENGINES)
ENGINES_ALL = {**EVERY, "planar": planar()}


def error_at(key: str, speed: float) -> float:
    """Return the largest relative error of B of a sleigh that travels along itself, 20 headings."""
    scene, worst = Sleigh(mass=1.3, offset=0.7), 0.0
    engine = Answers(ENGINES[key](scene))
    for heading in np.linspace(0.1, 6.1, 20):
        q = np.array([0.3, 0.2, heading])
        v = np.array([speed * np.cos(heading), speed * np.sin(heading), 0.8])
        B = Evaluation(scene, q, v).terms.B
        assert B is not None
        worst = max(worst, largest(engine.bias(q, v) - B) / largest(B))
    return worst


@pytest.mark.parametrize("key", EVERY)
def test_a_fast_sleigh_shows_which_engines_sum_terms_of_its_bias_that_cancel(key):
    assert error_at(key, 1.0) < 1e-14
    if key in ("drake", "pybullet"):
        assert error_at(key, 1e6) < 1e-14
    else:
        assert error_at(key, 1e6) > 1e-12
    # With its speed, and for MuJoCo with the square of that.
    assert (error_at(key, 1e6) > 1e-6) == (key == "mujoco")


@pytest.mark.parametrize(
    ("key", "speed", "verdict"), [("mujoco", 1e2, "passed"), ("mujoco", 1e3, "failed")]
)
def test_the_bias_of_mujoco_fails_at_a_thousand_metres_a_second(key, speed, verdict):
    q, v = [0.3, 0.2, 0.7], [speed * np.cos(0.7), speed * np.sin(0.7), 0.8]
    (found,) = eomcheck.check_state(
        Sleigh(mass=1.3, offset=0.7), q, v, engines=[key], claims=["bias"]
    )
    assert found.verdict == verdict


@pytest.mark.parametrize(("far", "verdict"), [(1e3, "passed"), (1e5, "failed")])
def test_accelerations_of_pinocchio_fail_far_from_the_origin_and_its_bias_does_not(far, verdict):
    scene = Snake.paper()
    q, _ = scene.initial_state()
    q = q + np.pad([far, -far], (0, scene.n - 2))
    v = eomcheck.velocity(scene, q, [0.7, 0.7])
    claims = ["mass-matrix", "bias", "engine-acceleration"]
    found = eomcheck.check_state(scene, q, v, engines=["pinocchio"], claims=claims)
    by_claim = {claim: {f.verdict for f in found if f.claim == claim} for claim in claims}
    assert by_claim["mass-matrix"] == by_claim["bias"] == {"passed"}
    assert by_claim["engine-acceleration"] == {verdict}


class InBody(Engine):
    """A sleigh whose inertia forces m ω × V are formed along it, where they do not cancel."""

    def __init__(self, scene):
        super().__init__(scene)
        parameters = scene.parameters(_Doubles())
        self.m, self.c = float(parameters.mass[0]), float(scene.offset)
        self.right = planar()(scene)

    version = classmethod(lambda cls: "in-body 1")
    represents = classmethod(lambda cls, scene: True)

    def velocity_map(self, q, v):
        return self.right.velocity_map(q, v)

    def mass_matrix(self, q, t=0.0):
        return self.right.mass_matrix(q, t)

    def bias(self, q, v, t=0.0):
        cos, sin, omega = np.cos(q[2]), np.sin(q[2]), v[2]
        R = np.array([[cos, -sin], [sin, cos]])
        V = R.T @ v[:2] + np.array([0.0, self.c * omega])
        # ω × V of the centre, less what v turns by itself: ẋ and ẏ appear, and cancel.
        turned = self.m * omega * np.array([-V[1], V[0]])
        own = (self.m * omega * R.T) @ np.array([-v[1], v[0]])  # another rounding than `turned`
        force = turned - own
        return np.array([*(R @ force), self.c * force[1]])


class _Doubles:
    def numbers(self, x):
        return np.asarray(x, float)


def test_a_bias_that_vanishes_where_its_terms_cancel_is_allowed_their_rounding():
    scene = Sleigh(offset=0.0)
    found = []
    for heading in np.linspace(0.1, 3.0, 30):
        q = np.array([3.0, -5.0, heading])
        v = eomcheck.velocity(scene, q, [40.0, 1.3])
        found += eomcheck.check_state(scene, q, v, engines=[InBody], claims=["bias"])
    assert {f.verdict for f in found} == {"passed"}
    assert any(f.observed > 0 for f in found), "the terms do cancel with an error"


class Puck(
    mechanism(
        "Puck",
        [Link("ground"), Link("a", 4.2, (0.0, 0.0, 0.0), (1.0, 1.0, 7.1))],
        [Joint("p", "planar", "ground", "a")],
        gravity=None,
    )
):
    """A body in the plane whose velocity is told in its own axes, which hardly turn."""

    angle_coordinates = slice(2, None)


def biases_of_a_puck(engine: str | type[Engine]) -> list[Finding]:
    random, found = np.random.default_rng(0), []
    for _ in range(40):
        q, v = random.uniform(-9.0, 9.0, (2, 3)) * (1.0, 1.0, 1e-3)
        q[2] *= 1e3
        found += eomcheck.check_state(Puck(), q, v, engines=[engine], claims=["bias"])
    return found


def test_casadi_is_allowed_the_rounding_of_velocities_times_momenta():
    found = biases_of_a_puck("casadi")
    assert {one.verdict for one in found} == {"passed"}
    assert max(one.observed for one in found) > 1e-14, "they do cancel with an error"


class Skate(
    mechanism(
        "Skate",
        [Link("ground"), Link("skate", 1.0, (0.3, 0.0, 0.0), (1.0, 1.0, 1.0))],
        [Joint("p", "planar", "ground", "skate")],
        constraints=[knife_edge("edge", "skate", (0, -1, 0))],
        gravity=None,
    )
):
    """A body in the plane that glides along an edge: without a force, whatever rounding says."""

    angle_coordinates = slice(2, None)


def test_casadi_is_allowed_what_the_rounding_of_its_bias_makes_of_accelerations():
    errors = {"engine-acceleration": 0.0, "engine-multipliers": 0.0}
    for heading in np.linspace(0.1, 6.1, 40):
        v = 0.3 * np.array([np.cos(heading), np.sin(heading), 0.0])
        q = np.array([0.0, 0.0, heading])
        for one in eomcheck.check_state(Skate(), q, v, engines=["casadi"], claims=list(errors)):
            assert one.verdict == "inconclusive", "beside an acceleration of 0"
            errors[one.claim] = max(errors[one.claim], one.observed)
    assert min(errors.values()) > 0.0, "there is rounding where all terms vanish"


class Ball(
    mechanism(
        "Ball",
        [Link("ground"), Link("ball", 1.0, (0.0, 0.0, 0.0), (0.4, 0.4, 0.4))],
        [Joint("f", "floating", "ground", "ball", origin=(0.0, 0.0, 1.0))],
        constraints=rolling_ball("r", "ball", "ground", 1.0),
    )
):
    """A ball on a floor, which does not feel how fast it spins about the vertical."""


def test_casadi_is_allowed_the_rounding_of_turns_that_a_constraint_does_not_feel():
    worst = 0.0
    for yaw in np.linspace(-3.0, 3.0, 40):
        q = np.array([0.0, -1.5, 0.0, yaw, 0.5, 0.3])
        v = np.array([0.0, 0.0, 0.0, 1.7, 0.0, 0.0])
        (one,) = eomcheck.check_state(Ball(), q, v, engines=["casadi"], claims=["constraint-drift"])
        assert one.verdict == "passed"
        worst = max(worst, one.observed)
    assert worst > 0.0, "they do cancel with an error"


def test_casadi_is_right_where_constraints_that_nearly_depend_carry_large_forces():
    q = [-7.853981633974483, -4.061473392214157, -23.56194490192345]
    q += [10.9955742991867, -10.344658711016166]
    claims = ["engine-acceleration", "engine-multipliers"]
    found = eomcheck.check_state(Bricard(), q, np.zeros(5), engines=["casadi"], claims=claims)
    assert max(one.observed / one.allowed for one in found) < 1e-3
    assert len(found) == 10, "seven with accelerations, three of them with multipliers"


FOLDED = [-1.5707963267948966, -0.5122285004691272, -61.26105674500097]
FOLDED += [-32.986722870542366, -6.795413799799177]


def test_where_a_matrix_of_casadi_is_singular_it_is_not_looked_at():
    claims = ["engine-acceleration", "engine-multipliers"]
    found = eomcheck.check_state(Bricard(), FOLDED, np.zeros(5), engines=["casadi"], claims=claims)
    assert [(one.claim, one.verdict) for one in found] == [(x, "skipped") for x in claims]
    assert all("singular to working precision" in one.detail for one in found)


def test_an_engine_on_trial_whose_matrix_is_singular_fails():
    class Singular(CasadiEngine):
        key = "singular"

        def bias(self, q, v, t=0.0):
            return np.linalg.solve(np.zeros((1, 1)), np.zeros(1))

    assert {one.verdict for one in biases_of_a_puck(Singular)} == {"failed"}


def test_an_engine_on_trial_does_not_say_what_is_allowed():
    class Generous(CasadiEngine):
        key = "generous"

        def bias(self, q, v, t=0.0):
            return super().bias(q, v, t) + 1e-3

        def bias_size(self, q, v, t=0.0):
            return 1e300

    assert {one.verdict for one in biases_of_a_puck(Generous)} == {"failed"}


def test_the_allowance_for_inertia_forces_does_not_hide_a_fault():
    class Wrong(planar()):
        def bias(self, q, v, t=0.0):
            return (1 + 1e-12) * super().bias(q, v, t)

    scene = Sleigh()
    q = np.array([3.0, -5.0, 0.4])
    v = eomcheck.velocity(scene, q, [1.0, 2.0])
    (finding,) = eomcheck.check_state(scene, q, v, engines=[Wrong], claims=["bias"])
    assert finding.verdict == "failed"


@pytest.mark.sampled(3)
@pytest.mark.parametrize("key", ENGINES_ALL)
def test_right_engines_are_within_the_allowance_on_every_scene(key):
    kind, compared = ENGINES_ALL[key], 0
    for scene_kind in SCENES.values():
        for scene, state in scene_cases(scene_kind, (1, 12), 6, seed=5):
            if not represents(kind, scene):
                continue
            at = Evaluation(scene, *state)
            B = np.zeros(scene.n) if at.terms.B is None else at.terms.B
            answers = Answers(kind(scene))
            error = largest(answers.bias(*state) - B)
            assert error <= allowed_error(inertia_size(at) + 20 * largest(B))
            S = answers.velocity_map(state.q, state.v).S
            error = largest(answers.mass_matrix(state.q, state.t) - at.terms.M)
            scale = mass_size(at, S) + 20 * largest(at.terms.M)
            assert error <= allowed_error(scale)
            compared += 1
    assert compared >= 12


def test_where_a_scene_names_no_angles_all_velocities_count():
    class Unnamed(Blade):
        angle_coordinates = slice(0, 0)

    state = np.array([0.1, 0.5, 0.3]), np.array([1.0, 2.0, 0.5])
    m, named = 2.0, inertia_size(Evaluation(Blade(), *state))
    assert named == 0.5 * m * 2.0
    assert inertia_size(Evaluation(Unnamed(), *state)) == 3.5 * m * 2.0


def test_an_engine_whose_own_formulation_is_refused_is_undecided_and_named():
    """The wheel rolls along x, where elimination has to refuse: nothing bounds its rounding."""
    scene, q = Snake([1.0], [1.0], [0.1], None, [0.0]), np.zeros(3)
    v = eomcheck.velocity(scene, q, [1.0, 0.5])

    class Own(CasadiEngine):
        key, solves_like = "own", "el"

    found = eomcheck.check_state(scene, q, v, engines=[Own], claims=["engine-acceleration"])
    assert found and {one.verdict for one in found} == {"inconclusive"}, found


# ---- Inverse mass matrices -----------------------------------------------------------------------


def long_at_its_end() -> ChainPendulum:
    """A chain whose last link is long and heavy: found by MJX in float32."""
    return ChainPendulum(
        mass=[8.7, 0.66, 6.6], length=[0.13, 0.33, 5.7], inertia=[0.92, 6.3, 3.7], gravity=0.99
    )


def test_the_composite_inertia_is_that_of_relative_angles():
    """M of absolute angles has small entries there, and M of relative ones has large ones."""
    scene = long_at_its_end()
    for q in ([0.0, 0.0, 0.0], [0.5, 0.3, 1.7]):
        at = Evaluation(scene, q, [0.0, 0.0, 0.0])
        T = np.tril(np.ones((3, 3)))
        relative = largest(T.T @ at.terms.M @ T)
        assert relative <= composite_inertia(at) <= 1.5 * relative
        assert composite_inertia(at) > 50 * at.terms.M[0, 0]
    rod = Evaluation(ChainPendulum(mass=[2.0], length=[3.0], inertia=[0.5]), [0.1], [0.0])
    assert composite_inertia(rod) == pytest.approx(2.0 * 1.5**2 + 0.5, rel=1e-14)


def test_an_inverse_by_relative_angles_in_float32_is_allowed_its_rounding():
    at = Evaluation(long_at_its_end(), [0.545, 0.289, 1.73], [95.0, 103.0, -88.0])
    T = np.tril(np.ones((3, 3), np.float32))
    relative = T.T @ at.terms.M.astype(np.float32) @ T
    inverse = T @ np.linalg.inv(relative) @ T.T
    error = largest(inverse - np.linalg.inv(at.terms.M))
    one, point = QUANTITIES["inverse_mass_matrix"], ConformancePoint(at)
    value = own_value(at, one, "", lambda e: one.compared(ConformancePoint(e), ""), point)
    assert 1e-7 < error <= allowed_error(value.sensitivity, 2.0**-24)
    assert error > 0.1 * allowed_error(value.own, 2.0**-24), "the matrix itself explains less"

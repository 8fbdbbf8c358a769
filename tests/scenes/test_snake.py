"""The snake as a record: it checks itself, and its named instances are those of the paper."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import eomcheck
from eomcheck import strategies
from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.dynamics import velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import check_consistent
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import FORMULATIONS
from eomcheck.scenes import Snake
from eomcheck.scenes.snake import OF_JOINTS

VALID = {
    "mass": [1.0, 2.0, 3.0],
    "length": [1.0, 1.5, 2.0],
    "inertia": [0.1, 0.0, 0.3],
    "stiffness": [10.0, 0.0],
    "wheel_angle": [0.1, -0.2, 0.3],
    "pose": [0.0, 0.5, -0.5],
    "damping": [0.0, 2.0],
}
SNAKES = [
    Snake(**VALID),
    Snake.paper(),
    Snake.coil(1),
    Snake.coil(2),
    replace(Snake.coil(4), stiffness=None),
    Snake([2.0], [3.0], [0.0], None, [0.5]),
]
snakes = pytest.mark.parametrize("snake", SNAKES, ids=lambda s: f"{s.links}")

# ---- Construction --------------------------------------------------------------------------------


def with_entry(name: str, value: object) -> dict:
    changed = list(VALID[name])
    changed[1] = value
    return VALID | {name: changed}


@pytest.mark.parametrize("name", VALID)
@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_a_parameter_that_is_not_finite_is_refused_with_its_place_and_value(name, value):
    with pytest.raises(InputError) as caught:
        Snake(**with_entry(name, value))
    assert f"{name}[1]" in str(caught.value)
    assert str(value) in str(caught.value)


@pytest.mark.parametrize("name", VALID)
@pytest.mark.parametrize("value", ["heavy", None, 1j, [1.0]])
def test_a_parameter_that_is_no_number_is_refused_with_its_name_and_value(name, value):
    with pytest.raises(InputError, match=name) as caught:
        Snake(**with_entry(name, value))
    # None is read as NaN by numpy, and a complex number has no real value.
    assert str(value) in str(caught.value) or "nan" in str(caught.value)


@pytest.mark.parametrize("name", ["mass", "length"])
@pytest.mark.parametrize("value", [0.0, -0.0, -1.0, -5e-324])
def test_a_mass_or_length_that_is_not_positive_is_refused_with_its_place_and_value(name, value):
    with pytest.raises(InputError) as caught:
        Snake(**with_entry(name, value))
    assert f"{name}[1] = {value}" in str(caught.value)


@pytest.mark.parametrize("name", ["inertia", "damping"])
@pytest.mark.parametrize("value", [-1.0, -5e-324])
def test_a_negative_inertia_or_damping_is_refused_with_its_place_and_value(name, value):
    with pytest.raises(InputError) as caught:
        Snake(**with_entry(name, value))
    assert f"{name}[1] = {value}" in str(caught.value)


def test_a_snake_keeps_its_energy_unless_something_damps_it_and_says_what():
    damped = replace(Snake.paper(), damping=np.ones(6))
    assert Snake.paper().conserves_energy and not Snake.paper().why_not_conserved
    assert not damped.conserves_energy and "dampers" in damped.why_not_conserved
    assert replace(damped, damping=None).conserves_energy


def test_a_snake_names_its_dampers_only_where_it_has_some():
    damped = replace(Snake.coil(3), damping=[1.0, 2.0])
    assert "damping" not in repr(Snake.coil(3)) and Snake.coil(3).structure == "snake[3]"
    assert "damping=[1.0, 2.0]" in repr(damped) and damped.structure == "snake[3], with damping"


def test_dampers_take_twice_their_dissipation_from_the_energy():
    snake = Snake(**VALID)
    q, _ = snake.initial_state()
    v = velocity(snake, q, [1.0, 0.5])
    at = Evaluation(snake, q, v)
    R = at.dissipation(v)
    assert 2.0 * (v[4] - v[3]) ** 2 / 2 == R
    spring = Evaluation(replace(snake, damping=None), q, v)
    assert v @ (at.terms.Q - spring.terms.Q) == pytest.approx(-2 * R)


def test_an_inertia_of_zero_is_a_point_mass_and_allowed():
    assert Snake(**VALID).inertia[1] == 0.0


@pytest.mark.parametrize("name", [name for name in VALID if name != "mass"])
@pytest.mark.parametrize("shape", [(1,), (4,), (3, 1), ()])
def test_a_parameter_of_wrong_shape_is_refused_with_its_name_and_both_shapes(name, shape):
    expected = (2,) if name in OF_JOINTS else (3,)
    with pytest.raises(InputError) as caught:
        Snake(**VALID | {name: np.ones(shape)})
    for part in (name, str(shape), str(expected)):
        assert part in str(caught.value)


@pytest.mark.parametrize("mass", [[], 1.0, [[1.0, 1.0, 1.0]], None, "mass"])
def test_a_snake_without_a_list_of_masses_is_refused(mass):
    with pytest.raises(InputError, match="mass"):
        Snake(**VALID | {"mass": mass})


@pytest.mark.parametrize("maker", [Snake.coil, Snake.pattern], ids=["coil", "pattern"])
@pytest.mark.parametrize("links", [0, -1, True, False, 2.5, 3.0, "3", None])
def test_a_number_of_links_that_is_no_positive_whole_number_is_refused(maker, links):
    with pytest.raises(InputError) as caught:
        maker(links)
    assert f"links = {links!r}" in str(caught.value)


def test_a_number_of_links_may_be_a_numpy_integer():
    assert Snake.coil(np.int64(3)).links == Snake.pattern(np.int32(3)).links == 3


def test_a_snake_keeps_its_own_copy_of_what_it_was_made_from():
    mass = np.ones(3)
    snake = Snake(**VALID | {"mass": mass})
    mass[:] = -1.0
    assert (snake.mass == 1.0).all()


def test_a_snake_cannot_be_given_other_parameters_afterwards():
    with pytest.raises(FrozenInstanceError):
        Snake.coil(2).mass = np.ones(2)


@pytest.mark.parametrize("stiffness", [None, [], np.zeros(0)])
def test_one_link_has_no_springs_whichever_way_that_is_said(stiffness):
    assert Snake([1.0], [1.0], [1.0], stiffness, [0.0]).stiffness is None


def test_one_link_with_a_spring_is_refused():
    with pytest.raises(InputError, match="stiffness"):
        Snake([1.0], [1.0], [1.0], [5.0], [0.0])


# ---- Named instances -----------------------------------------------------------------------------


def test_the_paper_snake_has_the_printed_parameters():
    snake = Snake.paper()
    assert snake.links == 7
    assert (snake.mass == 1).all()
    assert (snake.length == 1).all()
    assert (snake.inertia == 0.0833).all()
    assert (snake.stiffness == 5000).all()
    assert snake.wheel_angle.tolist() == [0.0175, 0.0349, 0.0524, 0.0698, 0.0873, 0.1047, 0.1222]
    assert snake.pose.tolist() == [0.7679, 1.536, 2.304, 3.072, 3.840, 4.608, 5.376]


def test_the_paper_snake_starts_at_rest_with_8847_744025_joules():
    snake = Snake.paper()
    q, v = snake.initial_state()
    at = Evaluation(snake, q, v)
    T, U = at.call(snake.energies, at.parameters, at.prepared, at.q, at.v)
    assert T == 0.0
    assert f"{U:.6f}" == "8847.744025"


def test_the_coil_of_seven_links_is_the_paper_snake_up_to_its_printed_rounding():
    paper, coil = Snake.paper(), Snake.coil(7)
    for name in ("mass", "length", "inertia", "stiffness"):
        assert np.array_equal(getattr(paper, name), getattr(coil, name))
    # α and θ_1 are printed to 4 decimals, the other θ to 3: half a unit of the last one.
    decimals = np.array([4, 3, 3, 3, 3, 3, 3])
    assert (np.abs(paper.wheel_angle - coil.wheel_angle) <= 0.5e-4).all()
    assert (np.abs(paper.pose - coil.pose) <= 0.5 * 10.0**-decimals).all()


def assert_rounded(found, expected):
    assert (np.abs(found - expected) <= allowed_error(1.0) * np.abs(expected)).all()


@pytest.mark.parametrize("links", [1, 2, 7, 20, 100])
def test_the_coil_turns_by_308_degrees_and_its_wheels_by_7_whatever_its_size(links):
    snake = Snake.coil(links)
    i = np.arange(1, links + 1)
    assert_rounded(snake.wheel_angle, np.radians(7.0 * i / links))
    assert_rounded(snake.pose, np.radians(308.0 * i / links))


@pytest.mark.parametrize("links", [1, 2, 7, 20, 100])
def test_the_pattern_turns_by_44_degrees_and_its_wheels_by_1_from_link_to_link(links):
    snake = Snake.pattern(links)
    i = np.arange(1, links + 1)
    assert_rounded(snake.wheel_angle, np.radians(1.0 * i))
    assert_rounded(snake.pose, np.radians(44.0 * i))


@pytest.mark.parametrize("maker", [Snake.coil, Snake.pattern], ids=["coil", "pattern"])
@pytest.mark.parametrize("links", [1, 2, 7])
def test_coil_and_pattern_have_the_links_of_the_paper(maker, links):
    snake = maker(links)
    assert snake.mass.tolist() == snake.length.tolist() == [1.0] * links
    assert snake.inertia.tolist() == [0.0833] * links
    assert (
        snake.stiffness is None
        if links == 1
        else snake.stiffness.tolist() == [5000.0] * (links - 1)
    )


# ---- What a snake says of itself -----------------------------------------------------------------


def assert_same(snake: Snake, other: Snake):
    for field in fields(Snake):
        mine, its = getattr(snake, field.name), getattr(other, field.name)
        assert (mine is None) == (its is None), field.name
        assert mine is None or np.array_equal(mine, its), field.name


def test_the_representation_of_a_class_of_ones_own_names_it():
    class Longer(Snake):
        pass

    assert repr(Longer([1.0], [2.0], [0.0], None, [0.0])).startswith("Longer(mass=[1.0]")


@snakes
def test_the_representation_of_a_snake_evaluates_to_the_same_snake(snake: Snake):
    assert_same(eval(repr(snake), {"Snake": Snake}), snake)


@given(strategies.snakes() | strategies.hostile_snakes())
def test_the_representation_of_any_snake_evaluates_to_the_same_snake(snake: Snake):
    assert_same(eval(repr(snake), {"Snake": Snake}), snake)


@snakes
def test_a_snake_of_n_links_has_n_plus_2_coordinates_n_constraints_and_2_speeds(snake: Snake):
    assert (snake.n, snake.r, snake.p) == (snake.links + 2, snake.links, 2)
    assert len(snake.coordinate_names) == len(set(snake.coordinate_names)) == snake.n
    assert len(snake.constraint_names) == len(set(snake.constraint_names)) == snake.r
    assert str(snake.links) in snake.name


@snakes
def test_a_snake_starts_at_rest_in_its_pose_with_its_tip_at_the_origin(snake: Snake):
    q, v = snake.initial_state()
    assert np.array_equal(q, [0.0, 0.0, *snake.pose])
    assert not v.any()
    assert v.shape == q.shape == (snake.n,)
    check_consistent(Evaluation(snake, q, v))


def test_the_initial_state_is_a_new_array_each_time():
    snake = Snake.coil(2)
    snake.initial_state()[0][:] = 9.0
    assert np.array_equal(snake.initial_state()[0], [0.0, 0.0, *snake.pose])


@pytest.mark.parametrize("angle", [np.pi / 2, -np.pi / 2])
@pytest.mark.parametrize("wheel", [1, 2])
def test_a_wheel_across_its_link_has_no_generalized_speeds_behind_it(angle, wheel):
    alpha = np.zeros(3)
    alpha[wheel] = angle
    with pytest.raises(RefusedError, match=rf"wheel_angle\[{wheel}\]") as caught:
        Snake(**VALID | {"wheel_angle": alpha}).refuse_speeds(np.zeros(5))
    assert caught.value.what == "cos α"
    assert caught.value.rcond <= caught.value.threshold


@pytest.mark.parametrize("alpha", [[np.pi / 2, 0.0, 0.0], [0.0, 1.57, -1.57], [np.pi] * 3])
def test_the_first_wheel_may_stand_across_and_others_nearly(alpha):
    assert Snake(**VALID | {"wheel_angle": alpha}).refuse_speeds(np.zeros(5)) is None


# ---- Mechanics -----------------------------------------------------------------------------------


@given(strategies.scene_states(strategies.snakes(max_links=5)))
def test_the_kinetic_energy_is_half_of_v_M_v(case):
    snake, (q, v, _) = case
    at = Evaluation(snake, q, v)
    T, _ = at.call(snake.energies, at.parameters, at.prepared, at.q, at.v)
    size = np.abs(v) @ np.abs(at.terms.M) @ np.abs(v)
    assert abs(T - v @ at.terms.M @ v / 2) <= allowed_error(size)


@given(strategies.scene_states(strategies.snakes(max_links=5)))
def test_the_first_two_rows_of_M_v_are_the_linear_momentum(case):
    snake, (q, v, _) = case
    at = Evaluation(snake, q, v)
    V, _ = at.call(snake.velocities, at.parameters, at.prepared, at.q, at.v)
    size = np.abs(at.terms.M) @ np.abs(v)
    error = np.abs(snake.mass @ V - (at.terms.M @ v)[:2])
    assert (error <= allowed_error(1.0) * size[:2]).all()


@given(strategies.scene_states(strategies.snakes(max_links=5)))
def test_wheels_do_not_slide_along_their_axles_at_a_consistent_velocity(case):
    snake, (q, v, _) = case
    at = Evaluation(snake, q, v)
    c = at.call(snake.constraint, at.parameters, at.prepared, at.q, at.v)
    assert (np.abs(c) <= 2 * allowed_error(1.0) * (np.abs(at.terms.a) @ np.abs(v))).all()


SYMMETRIES = ["rotation", "translation", "mirror"]


def symmetry_of(snake: Snake, name: str, q, v):
    return {s.name: s for s in snake.symmetries(q, v)}[name]


def test_a_snake_has_the_symmetries_of_the_plane():
    snake = Snake.coil(3)
    q, v = snake.initial_state()
    assert [s.name for s in snake.symmetries(q, v)] == SYMMETRIES


@pytest.mark.parametrize("name", SYMMETRIES)
@given(strategies.scene_states(strategies.snakes(max_links=4)))
def test_a_symmetry_takes_consistent_states_to_consistent_states(name, case):
    snake, (q, v, _) = case
    symmetry = symmetry_of(snake, name, q, v)
    image = symmetry.image
    # Rounding of the turned angles moves the wheels a little, and that times v counts as well.
    moved = Evaluation(symmetry.scene, symmetry.q, symmetry.v)
    turned = np.abs(moved.terms.a) @ np.abs(moved.v)
    rounding = (1 + np.abs(symmetry.q).max()) * np.abs(moved.terms.a).sum() * np.abs(v).sum()
    allowed = allowed_error(1.0) * (turned + rounding)
    assert (np.abs(moved.terms.a @ moved.v) <= allowed).all()
    assert (np.abs(image.T @ image - np.eye(snake.n)) <= allowed_error(1.0)).all()


@pytest.mark.parametrize("name", SYMMETRIES)
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_symmetry_of_the_snake_moves_its_acceleration_along(name, formulation):
    # Eighths, so that the turned angles are exact.
    snake = Snake([1.0, 2.0, 0.5], [1.0, 0.5, 2.0], [0.1, 0.2, 0.3], [4.0, 2.0], [0.125, -0.5, 1.0])
    q = np.array([0.5, -0.25, 0.375, 1.25, -0.625])
    v = eomcheck.velocity(snake, q, [1.5, -0.75])
    symmetry = symmetry_of(snake, name, q, v)
    here = eomcheck.acceleration(snake, formulation, q, v)
    there = eomcheck.acceleration(symmetry.scene, formulation, symmetry.q, symmetry.v)
    allowed = there.error_bound + np.abs(symmetry.image).sum(axis=1).max() * here.error_bound
    assert np.abs(here.vdot).max() > 1e6 * allowed
    assert np.abs(there.vdot - symmetry.image @ here.vdot).max() <= allowed


def centers(tree, x: np.ndarray) -> np.ndarray:
    """Return the centres of mass (n_j, 2) of a tree at joint coordinates x, complex ones too."""
    places, turns = [], []
    for j, parent in enumerate(tree.parent):
        place, turn = (np.zeros(2), 0.0) if parent < 0 else (places[parent], turns[parent])
        place = place + rotated(turn, tree.offset[j, :2])
        match tree.joint[j]:
            case "px":
                place = place + rotated(turn, np.array([1.0, 0.0])) * x[j]
            case "py":
                place = place + rotated(turn, np.array([0.0, 1.0])) * x[j]
            case "rz":
                turn = turn + x[j]
        places.append(place)
        turns.append(turn)
    moved = [rotated(turn, c[:2]) for turn, c in zip(turns, tree.center, strict=True)]
    return np.array(places) + np.array(moved)


def rotated(turn, x: np.ndarray) -> np.ndarray:
    return np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ x


@snakes
def test_the_tree_has_the_bodies_of_the_snake(snake: Snake):
    tree = snake.tree()
    carrying = tree.mass > 0
    assert np.array_equal(tree.mass[carrying], snake.mass)
    assert np.array_equal(tree.inertia[carrying, 2, 2], snake.inertia)
    assert not tree.inertia[~carrying].any()
    assert tree.coordinates.shape == (len(tree.joint), snake.n)
    assert all(-1 <= parent < j for j, parent in enumerate(tree.parent))
    x = tree.coordinates @ np.arange(1.0, snake.n + 1)
    relative = [1.0, 2.0, 3.0, *[1.0] * (snake.links - 1)]
    assert x.tolist() == relative


@snakes
@pytest.mark.parametrize("seed", range(3))
def test_the_bodies_of_the_tree_move_with_the_velocities_of_the_snake(snake: Snake, seed: int):
    random = np.random.default_rng(seed)
    q, v = random.uniform(-3, 3, snake.n), random.uniform(-3, 3, snake.n)
    tree, step = snake.tree(), 1e-150
    # The derivative of the positions along v, by a complex step: no truncation.
    rate = centers(tree, tree.coordinates @ (q + 1j * step * v)).imag / step
    at = Evaluation(snake, q, v)
    V, _ = at.call(snake.velocities, at.parameters, at.prepared, at.q, at.v)
    # Relative angles are differences of q, rounded, and summed again link by link.
    size = snake.n * np.abs(q).max() * np.abs(v).sum() * (1 + snake.length.sum())
    assert np.abs(rate[tree.mass > 0] - V).max() <= allowed_error(size)


@given(st.integers(1, 6).flatmap(lambda n: strategies.snakes(n, n)))
def test_the_arrays_of_a_snake_have_the_shapes_that_its_links_ask_for(snake: Snake):
    for field in fields(Snake):
        value = getattr(snake, field.name)
        if value is not None:
            assert value.shape == (snake.links - (field.name in OF_JOINTS),)
            assert value.dtype == np.float64

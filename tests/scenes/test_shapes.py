"""A scene whose functions return arrays of wrong shape is refused, and the function is named."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np
import pytest
from tests.samples import LINKS
from tests.scenes.test_trailer import TRAILER, Q, trailer

import eomcheck
from eomcheck.claims.user_scenes import check_shapes
from eomcheck.errors import InputError
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES, FourBarChain, Sleigh, Snake


@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
def test_every_structure_of_every_scene_keeps_the_contract(kind: type[Scene]):
    for scene in kind.structures(LINKS if kind.has_links else None):
        check_shapes(scene)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            "v[2] * angle.sin[0])]",
            "v[2] * angle.sin[0])] * 2",
            "drift: gamma has shape (2,), expec",
        ),
        ("cos[0]]], q", "cos[0]]] * 2, q", "constraints: a has shape (2, 3), exp"),
        ("array([slip]", "array([[slip]]", "constraint: c has shape (1, 1), expected (1,)"),
        ("cos[0]]], v", "cos[0]]] * 2, v", "velocities: V has shape (2,"),
        ("sin * v[0] * v[0]]]", "sin * v[0] * v[0]]] * 2", "jacobians: linear_rest has"),
    ],
)
def test_an_array_of_wrong_shape_is_named_in_one_sentence(tmp_path, old, new, says):
    source = TRAILER.read_text(encoding="utf-8")
    assert source.count(old) == 1
    path = tmp_path / f"shape_{abs(hash(old))}.py"
    path.write_text(source.replace(old, new), encoding="utf-8")
    kind = trailer(path)
    for look in (
        lambda: eomcheck.check_state(kind(), Q, np.zeros(3)),
        lambda: eomcheck.validate(kind(), examples=1),
        lambda: eomcheck.prove(kind, points=1, seed=0),
    ):
        with pytest.raises(InputError) as raised:
            look()
        assert says in str(raised.value)
        assert "\n" not in str(raised.value)


def test_more_rows_of_a_position_residual_than_holonomic_constraints_are_refused():
    class Half(FourBarChain):
        holonomic = slice(0, 1)

    with pytest.raises(
        InputError, match=r"Half.position_residual: Φ has shape .*, expected \(1,\)"
    ):
        check_shapes(Half.example())


def test_a_transposed_null_space_is_refused():
    class Transposed(Snake):
        @staticmethod
        def speeds(parameters, prepared, shared):
            right = Snake.speeds(parameters, prepared, shared)
            return right._replace(W=right.W.T)

    with pytest.raises(InputError, match=r"speeds: W has shape \(2, 5\), expected \(5, 2\)"):
        check_shapes(Transposed.coil(3))


def test_a_wrong_shape_is_told_of_the_structure_that_has_it_after_one_that_has_not():
    def energies(parameters, angles, q, v):
        T, U = Snake.energies(parameters, angles, q, v)
        return T, None if U is None else np.array([U, U])

    kind = type("Sprung", (Snake,), {"energies": staticmethod(energies)})
    one = np.ones(3)
    check_shapes(kind(one, one, one, None, one))
    with pytest.raises(InputError, match=r"energies: U has shape \(2,\), expected \(\)"):
        check_shapes(kind(one, one, one, [1.0, 1.0], one))


def test_a_structure_is_checked_again_where_a_function_raised_and_then_no_more():
    asked = []

    def constraint(parameters, angles, q, v):
        asked.append(parameters.mass[0])
        if asked[-1] == 1.0:
            raise ValueError("too light")
        return np.zeros(2 if asked[-1] == 2.0 else 1)

    kind = type("Light", (Sleigh,), {"constraint": staticmethod(constraint)})
    assert check_shapes(kind(mass=1.0)) is None
    with pytest.raises(InputError, match=r"constraint: c has shape \(2,\), expected \(1,\)"):
        check_shapes(kind(mass=2.0))
    assert check_shapes(kind(mass=3.0)) and check_shapes(kind(mass=2.0))
    assert asked == [1.0, 2.0, 3.0]


class Odd:
    """An object of which everything raises."""

    def __getattr__(self, name: str):
        raise ValueError(name)


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (lambda: None, "c is None, expected an array of shape (1,)"),
        (Odd, "c is a Odd, expected an array of shape (1,)"),
        (lambda: np.array(["2000-01-01"], "M8[D]"), "c is an array of datetime64[D], expec"),
        (lambda: np.array([1j]), "c is an array of complex128, expected real numbers"),
    ],
)
def test_what_is_no_array_of_real_numbers_is_refused(answer, says):
    kind = type("Wrong", (Sleigh,), {"constraint": staticmethod(lambda *_: answer())})
    with pytest.raises(InputError) as raised:
        check_shapes(kind())
    assert f"Wrong.constraint: {says}" in str(raised.value)


def test_velocities_and_kinetic_energy_are_left_out_by_no_scene():
    kind = type("Still", (Sleigh,), {"energies": staticmethod(lambda *_: (None, None))})
    with pytest.raises(InputError, match="energies: T is None, expected"):
        check_shapes(kind())


def without_rows(where: Callable[[float], bool]) -> Scene:
    """Return a sleigh whose terms leave out a, by the first coordinate."""

    def terms(parameters, prepared, q, v):
        found = Sleigh.terms(parameters, prepared, q, v)
        return found._replace(a=None) if where(float(q[0])) else found

    return type("Loose", (Sleigh,), {"terms": staticmethod(terms)}).example()


def test_a_scene_with_constraints_leaves_out_their_jacobian_nowhere():
    with pytest.raises(
        InputError, match=r"Loose.terms: a is None, expected an array of .*\(1, 3\)"
    ):
        check_shapes(without_rows(lambda x: x > 0.0))
    # Where shapes are looked at it is there.
    state = [-0.1, 0.2, 0.3], [1.0, 0.5, 0.2]
    claims = ["constraint-velocity"]
    scene = without_rows(lambda x: x < 0.0)
    (found,) = eomcheck.check_state(scene, *state, claims=claims, consistent=False)
    assert found.verdict == "failed"
    assert "constraints at velocity level, row edge: missing" in found.detail


@pytest.mark.parametrize("function", ["terms", "speeds"])
def test_what_is_no_named_tuple_is_refused(function: str):
    kind = type("Wrong", (Sleigh,), {function: staticmethod(lambda *_: Odd())})
    with pytest.raises(InputError, match=f"{function}: a Odd, expected a NamedTuple of"):
        check_shapes(kind())


@pytest.mark.parametrize(
    ("name", "broken", "says"),
    [
        ("terms", lambda found: found._replace(M=found.M[:2]), "M has shape (2, 3), expected (3"),
        ("constraints", lambda found: (found[0][:, :2], None), "constraints: a has shape (1, 2)"),
        ("velocities", lambda found: (None, found[1]), "IndexError: tuple index out of range"),
        ("energies", lambda found: None, "TypeError: cannot unpack non-iterable NoneType object"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_a_shape_that_is_wrong_in_some_states_is_a_failure_there(name, broken, says):
    kind = trailer(TRAILER)
    right = getattr(kind, name)

    def sometimes(*arguments):
        found = right(*arguments)
        with suppress(TypeError, AttributeError):  # of other numbers
            if next(float(x.cos[0]) for x in arguments if hasattr(x, "cos")) < 0.3:
                return broken(found)
        return found

    wrong = type("Sometimes", (kind,), {name: staticmethod(sometimes), "key": "sometimes"})()
    claims = "kinetic-energy", "null-space-speeds", "equivalence", "power-balance"
    along = 1.4 * np.array([-np.sin(2.0), np.cos(2.0)]) + np.array([np.cos(2.0), np.sin(2.0)])
    found = eomcheck.check_state(wrong, [2.0, 0.3, -0.1], [0.5, *along], claims=claims)
    said = [one.detail for one in found if one.verdict == "failed"]
    assert any(says in one for one in said), said
    still = eomcheck.check_state(wrong, Q, np.zeros(3), claims=claims)
    assert not [one for one in still if one.verdict == "failed"]

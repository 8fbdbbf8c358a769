"""Arguments that no caller should hand in: each refused in one sentence, or a failure by name."""

from __future__ import annotations

import numpy as np
import pytest
from tests.engines.planar import planar

import eomcheck
from eomcheck.errors import LONGEST, InputError
from eomcheck.scenes import FourBarChain, Sleigh, Snake
from eomcheck.strategies import states
from eomcheck.testing import check_functions, from_scene

HUGE = 10**70


def identity(q):
    return np.eye(len(q))


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: check_functions(HUGE, M=identity), "n = 1"),
        (lambda: check_functions(3, M=identity, states=HUGE), "states = 1"),
        (lambda: check_functions(3, M=identity, qdot=identity, speeds=HUGE), "speeds = 1"),
        (lambda: Snake.coil(2**70), "links = 1"),
        (lambda: Snake.pattern(10**5000), "links = a number of 16610 bits"),
        (lambda: FourBarChain.rods(HUGE), "windows = 1"),
        (lambda: eomcheck.enclose(Sleigh(), "au", [0, 0, 0], [1, 1], digits=10**9), "digits = 1"),
        (lambda: from_scene("sleigh"), "scene = 'sleigh'"),
        (lambda: states("x"), "scene = 'x'"),
        (lambda: check_functions(1, M=identity, ranges=(0, 10**400)), "ranges = "),
        (lambda: check_functions(1, M=identity, ranges=np.ma.array([0, 1.0], mask=1)), "ranges = "),
        (lambda: check_functions(1, M=identity, states=[([10**400], [0])]), "states = "),
        (lambda: Sleigh(mass=np.ma.array(1.0, mask=True)), "mass = "),
        (lambda: eomcheck.acceleration(Sleigh(), "x" * 5000, [0, 0, 0], [0, 0, 0]), "unknown form"),
    ],
)
def test_an_argument_beyond_use_is_refused_by_name_in_a_sentence(call, name):
    with pytest.raises(InputError) as caught:
        call()
    text = str(caught.value)
    assert text.startswith(name)
    assert len(text) <= LONGEST + 20
    assert "\n" not in text


class Mute(Exception):
    """An exception whose text raises."""

    def __str__(self):
        raise RuntimeError("mute")


def raising(error: Exception):
    def M(q):
        raise error

    return M


@pytest.mark.parametrize(
    ("M", "says"),
    [
        (lambda q: np.ma.array([[1.0]], mask=[[True]]), "answers a masked array"),
        (lambda q: [[10**400]], "answers a number that is too large for a double"),
        (raising(Mute()), "Mute: its text cannot be read"),
        (raising(ValueError("x" * 5000)), "ValueError: xxx"),
        (raising(ValueError("a\x1b[31m\nb")), "ValueError: a"),
    ],
)
def test_an_answer_beyond_use_is_a_failure_by_name(M, says):
    found = check_functions(1, M=M, states=2)
    (failed,) = [one for one in found if one.verdict == "failed"]
    assert failed.claim == "answers"
    assert says in failed.detail
    assert len(failed.detail) <= LONGEST + 50
    assert failed.detail.isprintable()


def test_a_masked_array_without_masked_entries_is_an_array():
    found = check_functions(1, M=lambda q: np.ma.array([[1.0]], mask=[[False]]), states=2)
    assert not [one for one in found if one.verdict == "failed"]


def test_a_masked_answer_of_an_engine_is_its_failure():
    class Masked(planar()):
        def mass_matrix(self, q, t=0.0):
            M = super().mass_matrix(q, t)
            return np.ma.array(M, mask=np.eye(len(M)) > 0)

    scene = Sleigh()
    found = eomcheck.check_state(
        scene, *scene.initial_state(), engines=[Masked], claims=["mass-matrix"]
    )
    assert [one.verdict for one in found] == ["failed"]
    assert "a masked array" in found[0].detail


@pytest.mark.parametrize(("name", "says"), [("terms", "terms: a str"), ("prepare", "Wrong: Attr")])
def test_a_function_of_a_scene_that_answers_no_record_is_refused_by_name(name, says):
    scene = type("Wrong", (Sleigh,), {name: staticmethod(lambda *_: "ab")})()
    with pytest.raises(InputError, match=says):
        eomcheck.check_state(scene, *scene.initial_state(), engines=[])

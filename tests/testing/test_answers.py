"""What breaks is named with its function and state, and the rest is looked at all the same."""

from __future__ import annotations

import json
import re
import runpy
import subprocess
import sys
from textwrap import indent
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.testing.own import GUIDES, given, guide

import eomcheck
from eomcheck import testing
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.mechanics.records import State
from eomcheck.scenes import ChainPendulum, Snake
from eomcheck.testing import EquationsOfMotion, check_functions
from eomcheck.testing.equations_of_motion import BrokenError, ComparedEquations, FunctionCaller

CART = guide("cart")


def failed(change, **options):
    found = check_functions(**(given("cart") | change), **({"states": 3} | options))
    return [x for x in found if x.verdict == "failed"]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("name", "wrong", "detail"),
    [
        ("M", lambda q: np.full((3, 3), np.nan), "M, M[0, 0] = nan, expected a finite number"),
        ("bias", lambda q, v: np.ones(2), "bias, answers an array of shape (2,), expected (3,)"),
        ("M", lambda q: np.ones(3), "M, answers an array of shape (3,), expected (3, 3)"),
        ("gravity", lambda q: None, "gravity, answers None, expected an array of numbers"),
        ("gravity", lambda q: "g", "gravity, answers a str, expected an array of numbers"),
        ("gravity", lambda q: 1j * q, "gravity, answers complex numbers, expected an array of rea"),
        ("bias", lambda q, v: 1 // 0, "bias, ZeroDivisionError: integer division or modulo by z"),
        ("T", lambda q, v: q, "T, answers an array of shape (3,), expected ()"),
        ("qdd", lambda q, v: [[1], 2], "qdd, answers a list, expected an array of numbers"),
    ],
)
def test_a_function_that_breaks_is_named_and_the_others_are_looked_at(name, wrong, detail):
    found = check_functions(**(given("cart") | {name: wrong}), states=2)
    (broken,) = [x for x in found if x.verdict == "failed"]
    assert (broken.claim, broken.subject) == ("answers", name)
    assert broken.detail.startswith(detail)
    assert broken.state is not None
    others = {x.subject for x in found if x.claim == "answers" and x.verdict == "passed"}
    assert others == set(CART_FUNCTIONS) - {name}
    assert any(x.claim not in ("answers", "arguments-unchanged") for x in found)


@pytest.mark.parametrize(
    ("answer", "kind"),
    [
        ([1j, 0, 0], "complex numbers, expected an array of real numbers"),
        (["a", "b", "c"], "a list of str, expected an array of numbers"),
        (np.array([True, False, True]), "an array of bool, expected an array of numbers"),
        (np.array(["a", "b", "c"]), "an array of str, expected an array of numbers"),
        (["a", 1, 2], "a list, expected an array of numbers"),
        ([[1], 2, 3], "a list, expected an array of numbers"),
        ({"a": 1.0}, "a dict, expected an array of numbers"),
    ],
)
def test_an_answer_of_a_wrong_type_is_told_with_the_type_of_its_entries(answer: Any, kind: str):
    (found,) = failed({"gravity": lambda q: answer}, states=1, claims=["answers"])
    assert found.detail == f"gravity, answers {kind}"


def test_why_a_function_does_not_answer_is_told_once():
    def broken(q, v):
        raise TypeError("unsupported")

    found = check_functions(**(given("cart") | {"bias": broken}), states=2)
    about = [x.detail for x in found if "bias" in x.detail and x.claim != "reference"]
    assert about[0] == "bias, TypeError: unsupported"
    assert len(about) > 5 and {*about[1:]} == {"bias does not answer"}
    alone = check_functions(
        3, M=CART.M, bias=broken, states=2, claims=["bias-even", "bias-quadratic"]
    )
    why = ["bias breaks: TypeError: unsupported", "bias does not answer"]
    assert sorted(x.detail for x in alone) == sorted(why)


def test_claims_go_on_without_a_function_that_another_stands_in_for():
    def broken(*_):
        raise TypeError("unsupported")

    def verdicts(**changed: Any) -> dict[str, str]:
        found = check_functions(**(given("cart") | changed), states=2)
        return {x.claim: x.verdict for x in found if x.verdict != "skipped"}

    assert verdicts(bias=broken)["gravity-velocity"] == "passed"
    without = verdicts(M=broken)
    assert {without[x] for x in ("bias-power", "motion", "power-balance")} == {"passed"}
    assert verdicts(M=broken, bias=None)["motion"] == "passed"
    assert "motion" not in verdicts(M=broken, T=None)


CART_FUNCTIONS = [x for x in given("cart") if x != "n"]


def test_a_function_that_breaks_in_one_state_is_looked_at_in_the_others():
    def at_times(q):
        if q[0] > 0:
            raise ValueError("no value\nhere")
        return CART.gravity(q) * 2

    found = failed({"gravity": at_times}, states=8)
    assert [x.claim for x in found][:2] == ["answers", "gravity-of-potential"]
    assert found[0].detail == "gravity, ValueError: no value here"
    assert found[0].state is not None
    assert found[0].state.q[0] > 0


def test_skipped_states_are_counted_among_all():
    def at_times(q, v):
        if q[0] > 0:
            raise ValueError("no value")
        return CART.bias(q, v)

    states = [([x, 0.7, -0.4], [0.5, -0.8, 0.9]) for x in (-0.4, 0.5, 0.6)]
    options = {"bias": at_times, "states": states, "claims": ["bias-even"]}
    (found,) = check_functions(**(given("cart") | options))
    assert found.verdict == "passed"
    why = "bias breaks: ValueError: no value"
    assert found.detail == f"skipped in 2 of 3 states: {why}"


def test_an_interrupt_is_not_taken_for_a_failure():
    def interrupted(q):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        failed({"M": interrupted})


def test_columns_numbers_in_arrays_and_lists_are_read():
    given_ = given("cart") | {
        "gravity": lambda q: CART.gravity(q).reshape(3, 1),
        "T": lambda q, v: np.array([[CART.T(q, v)]]),
        "U": lambda q: [CART.U(q)],
        "M": lambda q: CART.M(q).tolist(),
    }
    assert not [x for x in check_functions(**given_, states=2) if x.verdict == "failed"]


def asked(**functions) -> FunctionCaller:
    """Functions of two coordinates, to be called one by one."""
    return FunctionCaller(EquationsOfMotion(2, **functions))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_have_no_value_whatever_their_shape(bad: float):
    q, v = np.zeros(2), np.ones(2)
    answers = asked(
        U=lambda q: bad, T=lambda q, v: np.float64(bad), gravity=lambda q: np.array([0, bad])
    )
    for name, entry in (("U", "U"), ("T", "T"), ("gravity", "gravity[1]")):
        for _ in range(2):
            with pytest.raises(BrokenError, match=re.escape(f"{entry} = {bad}")):
                answers(name, q, v)


def test_answers_stay_as_they_were_when_a_function_writes_into_its_array_again():
    kept = np.zeros(2)

    def gravity(q):
        kept[:] = q
        return kept

    answers, v = asked(gravity=gravity), np.ones(2)
    first = answers("gravity", np.array([1.0, 2.0]), v)
    assert answers("gravity", np.array([3.0, 4.0]), v).tolist() == [3.0, 4.0]
    assert first.tolist() == [1.0, 2.0]


def test_a_function_that_answers_in_the_shape_of_another_has_no_value():
    q, v = np.zeros(2), np.ones(2)
    turn = iter([np.eye(2), np.ones(2), np.eye(2)])
    answers = asked(M=lambda q: next(turn), gravity=lambda q: q)
    assert answers("gravity", q, v).shape == (2,)
    assert answers("M", q, v).shape == (2, 2)
    with pytest.raises(BrokenError, match=re.escape("of shape (2,), expected (2, 2)")):
        answers("M", q, v)
    assert answers("M", q, v).shape == (2, 2)


def test_functions_of_another_library_get_its_arrays():
    class Wrapped:
        def __init__(self, x):
            self.x = x

        def detach(self):
            return self.x

    own = {
        "M": lambda q: Wrapped(np.eye(1)),
        "U": lambda q: Wrapped(q.x @ q.x),
        "gravity": lambda q: [Wrapped(2 * x) for x in q.x],
    }
    found = check_functions(1, **own, array=Wrapped, factory=lambda: own, states=2)
    assert not [x for x in found if x.verdict == "failed"]
    passed = {x.claim for x in found if x.verdict == "passed"}
    assert {"gravity-of-potential", "fresh-answer"} <= passed


@pytest.mark.parametrize(
    ("name", "right"),
    [
        ("gravity", lambda q, g=9.81: g * np.sin(q)),
        ("c", lambda q, scale=1.0: scale * (q[:1] - q[1:])),
        ("b", lambda t, scale=1.0: np.array([scale * np.sin(t)])),
    ],
)
def test_arguments_with_a_default_keep_it(name, right):
    own = {"U": lambda q: -9.81 * np.cos(q).sum(), "a": lambda q: np.array([[1.0, -1.0]])}
    found = check_functions(2, **own, **{name: right}, states=2)
    assert not [x for x in found if x.verdict == "failed"]
    ids = {"gravity": "gravity-of-potential", "c": "constraint-jacobian", "b": "answers"}
    assert ids[name] in {x.claim for x in found if x.verdict == "passed"}


def test_functions_that_want_tensors_say_what_to_give():
    def wants(q):
        raise TypeError("cos(): argument 'input' (position 1) must be Tensor, not numpy.float64")

    (found,) = failed({"gravity": wants}, claims=["answers"], states=1)
    assert found.detail.endswith("not numpy.float64; say array=torch.as_tensor")
    (found,) = failed({"gravity": wants}, claims=["answers"], states=1, array=np.asarray)
    assert found.detail.endswith("not numpy.float64")


def test_what_is_not_looked_at_is_told_without_numbers():
    found = check_functions(1, M=lambda q: np.eye(1), states=1)
    lines = [str(x) for x in found if x.verdict == "skipped"]
    assert any(line.startswith("kinetic-energy [M] skipped") for line in lines)
    assert not any("observed" in line or "allowed" in line for line in lines)


def test_single_precision_is_named_as_such():
    (one,) = failed({"M": lambda q: CART.M(q).astype(np.float32)})[:1]
    assert (one.claim, one.detail) == ("double-precision", "M, answers in float32")


def test_the_state_of_a_finding_is_where_it_is_worst():
    states = [(np.full(3, x), np.full(3, 1.0)) for x in (0.1, 0.9, 0.2)]
    own = given("cart") | {"gravity": lambda q: CART.gravity(q) + np.array([0, q[0] ** 8, 0])}
    found = check_functions(**own, states=states, claims=["gravity-of-potential"])
    assert found[0].state is not None
    assert found[0].state.q.tolist() == [0.9, 0.9, 0.9]


@pytest.mark.night
def test_the_same_seed_gives_the_same_findings_and_another_one_other_states():
    def told(seed):
        return [x.as_dict() for x in check_functions(**given("cart"), states=2, seed=seed)]

    assert told(3) == told(3)
    assert told(3) != told(4)


@pytest.mark.parametrize(
    ("ranges", "each"),
    [
        ((2.0, 5.0), [(2, 5)] * 4),
        ([(2.0, 3.0), (5.0, 9.0)], [(2, 3), (5, 9), (-1, 1), (-1, 1)]),
        ([(2, 3), (5, 9), (-4, -3), (0, 2)], [(2, 3), (5, 9), (-4, -3), (0, 2)]),
    ],
)
def test_states_are_drawn_from_the_ranges(ranges: Any, each: list[tuple[float, float]]):
    seen = []

    def bias(q, v):
        seen.append([*q, *v])
        return np.zeros(2)

    check_functions(2, bias=bias, ranges=ranges, claims=["answers"], states=40)
    for values, (low, high) in zip(np.transpose(seen), each, strict=True):
        tenth = 0.1 * (high - low)
        assert low <= min(values) < low + tenth < high - tenth < max(values) <= high


def test_a_finding_is_plain_data():
    for finding in failed({"bias": lambda q, v: CART.bias(q, v) / 2}):
        row = json.loads(json.dumps(finding.as_dict()))
        assert row["verdict"] == "failed"
        assert len(row["q"]) == 3


# ---- As Python -----------------------------------------------------------------------------------

FILE = """
import numpy as np

def M(q):
    return np.eye(2)

def bias(q, v):
    return np.array([v[0], 0.0])
"""


def run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.night
def test_the_code_of_a_finding_runs_as_printed(tmp_path):
    path = tmp_path / "own.py"
    check = (
        "from eomcheck.testing import check_functions\n"
        "for finding in check_functions(2, M=M, bias=bias, ranges=(0, 1), name='own'):\n"
        "    if finding.verdict == 'failed':\n"
        "        print(finding.as_python())\n        break\n"
    )
    path.write_text(f"{FILE}\nif __name__ == '__main__':\n{indent(check, '    ')}")
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("import runpy\n")
    assert run(done.stdout).startswith("bias-quadratic [bias] failed on own")


@pytest.mark.night
def test_the_code_of_what_was_not_looked_at_runs_too():
    found = check_functions(**given("cart"), states=1)
    untold, _ = (x for x in found if x.state is None)
    code = untold.as_python()
    assert str(GUIDES / "cart.py") in code
    assert run(code) == ""


def test_the_code_takes_each_function_from_its_own_file(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    own = {}
    for name, value in (("M", "[[1.0]]"), ("gravity", "q"), ("R", "-(v @ v)")):
        path, head = tmp_path / f"of_{name}.py", f"def {name}(q{', v' * (name == 'R')}):"
        other = "def M(q):\n    return None\n" * (name == "R")
        path.write_text(f"{head}\n    return {value}\n{other}")
        own[name] = runpy.run_path(str(path))[name]
    state = State(np.array([0.5]), np.array([1.0]), 0.0)
    exec(EquationsOfMotion(1, **own, name="own").as_python(state), {})
    assert re.findall(r"^[\w-]+ \[\w+\]", capsys.readouterr().out, re.M) == [
        "dissipation-positive [R]"
    ]
    assert sys.path.count(str(tmp_path)) == 1


def test_the_code_finds_modules_beside_the_file_of_a_function(tmp_path, capsys, monkeypatch):
    (tmp_path / "beside_the_file.py").write_text("factor = -1.0\n")
    path = tmp_path / "own.py"
    path.write_text(
        "from beside_the_file import factor\ndef R(q, v):\n    return factor * (v @ v)\n"
    )
    with monkeypatch.context() as here:
        here.syspath_prepend(str(tmp_path))
        R = runpy.run_path(str(path))["R"]
    del sys.modules["beside_the_file"]
    monkeypatch.setattr(sys, "path", list(sys.path))
    state = State(np.array([0.5]), np.array([1.0]), 0.0)
    exec(
        EquationsOfMotion(1, M=lambda q: np.eye(1), R=R, name="own")
        .as_python(state)
        .replace("    M=M,\n", "    M=lambda q: [[1.0]],\n"),
        {},
    )
    assert capsys.readouterr().out.startswith("dissipation-positive [R] failed")


def test_the_code_says_which_functions_are_to_be_put_in():
    own = EquationsOfMotion(2, M=lambda q: np.eye(2))
    assert "# to be put in: M = test_the_code_says_which" in own.as_python()
    compile(own.as_python(), "printed", "exec")


RODS = ChainPendulum.rods(3)
ENGINE = "    against=(CasadiEngine, scene),"


@pytest.mark.parametrize(
    ("against", "lines"),
    [
        (RODS, ["from eomcheck.scenes import ChainPendulum", "    against=scene,"]),
        (("casadi", RODS), ["from eomcheck.engines.casadi import CasadiEngine", ENGINE]),
        ((CasadiEngine, RODS), [ENGINE]),
        (CasadiEngine(RODS), [ENGINE]),
    ],
)
def test_the_code_of_a_failure_beside_a_reference_fails_again(against, lines, capsys):
    found = check_functions(3, M=CART.M, against=against, states=1)
    (failed,) = (one for one in found if one.verdict == "failed")
    code = failed.as_python()
    assert failed.claim == "reference"
    assert {*lines} <= {*code.splitlines()}, code
    exec(code, {})
    assert capsys.readouterr().out.startswith("reference [M ~ ")


@pytest.mark.parametrize("against", [EquationsOfMotion(1, M=np.eye), SimpleNamespace()])
def test_the_code_says_that_a_reference_without_a_name_is_to_be_put_in(against):
    if not isinstance(against, EquationsOfMotion):  # no class of engine makes it
        against.scene, against.mass_matrix, against.bias = RODS, CART.M, CART.M
    code = ComparedEquations.of(EquationsOfMotion(3, M=CART.M), against).as_python()
    assert f"# to be put in: against = {against!r}"[:60] in code
    assert "    against=against," in code
    compile(code, "printed", "exec")
    assert "against" not in EquationsOfMotion(3, M=CART.M).as_python()


# ---- What is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"n": 0}, "n = 0, expected a whole number of at least 1"),
        ({"n": 2.0}, "n = 2.0, expected a whole number of at least 1"),
        ({"M": np.eye(2)}, "M = array"),
        ({"factory": 3}, "factory = 3, expected a function"),
        ({"M": None}, "no function is given, expected at least one of M, bias, "),
        ({"states": 0}, "states = 0, expected a whole number of at least 1"),
        ({"states": "many"}, "states = ['m', 'a', 'n', 'y'], expected a number of at least 1 or a"),
        ({"states": [([0.0], [1.0])]}, "states = [([0.0], [1.0])], expected a number of at least"),
        ({"states": [([0, 0], [np.nan, 0])]}, "states = "),
        ({"states": []}, "states = [], expected a number"),
        ({"states": 2.5}, "states = 2.5, expected a number"),
        ({"ranges": (1.0, -1.0)}, "ranges = (1.0, -1.0), expected (low, high) with low < high"),
        ({"ranges": [(0, 1)] * 3}, "ranges = "),
        ({"ranges": [(0, 1), (1, -1)]}, "ranges = [(0, 1), (1, -1)], expected (low, high) with"),
        ({"ranges": [(2, 2), (0, 1)]}, "ranges = [(2, 2), (0, 1)], expected (low, high) with"),
        ({"ranges": "wide"}, "ranges = 'wide', expected"),
        ({"ranges": (0.0, np.inf)}, "ranges = "),
        ({"speeds": 1}, "speeds = 1 without qdot(q, u)"),
        ({"bias_has_gravity": True}, "bias_has_gravity = True, but no bias is given"),
        (
            {"against": 3},
            "against = 3, expected a scene, an engine made for one, (engine, scene), ",
        ),
        (
            {"against": {}},
            "against = {}, expected a scene, an engine made for one, (engine, scene), ",
        ),
        ({"against": Snake.coil(3)}, "against has 5 coordinates, expected 2 as the functions have"),
        ({"seed": 0.5}, "seed = 0.5, expected a whole number"),
    ],
)
def test_wrong_arguments_are_refused_in_one_sentence(arguments, message):
    with pytest.raises(InputError) as caught:
        check_functions(**({"n": 2, "M": lambda q: np.eye(2)} | arguments))
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "arguments",
    [{"masses": np.eye}, {"claims": ["no-claim"]}, {"against": ("no-engine", Snake.coil(3))}],
)
def test_unknown_names_are_refused_with_those_that_are_known(arguments):
    with pytest.raises(UnknownNameError, match=r"unknown .*; known: "):
        check_functions(2, M=lambda q: np.eye(2), **arguments)


# ---- What they are compared with -----------------------------------------------------------------


def pendulum():
    """The chain pendulum's own terms by another way: from positions, differentiated by hand."""
    scene = ChainPendulum.example()
    return scene, testing.from_scene(scene)


@pytest.mark.parametrize("how", ["scene", "key", "class", "engine", "functions"])
def test_every_quantity_is_compared_with_a_scene_or_an_engine(how: str):
    scene, own = pendulum()
    engine = eomcheck.ENGINES["pinocchio"]
    against = {
        "scene": scene,
        "key": ("pinocchio", scene),
        "class": (engine, scene),
        "engine": engine(scene),
        "functions": own,
    }[how]
    doubled = {"M": lambda q: 2 * own.M(q), "bias": own.bias, "T": own.T, "gravity": own.gravity}
    found = check_functions(own.n, **doubled, against=against, states=2, claims=["reference"])
    verdicts = {x.subject.split(" ~ ")[0]: x.verdict for x in found}
    expected = {"M": "failed", "bias": "passed"}
    if how in ("scene", "functions"):
        expected |= {"T": "passed", "forces": "passed"}
    assert verdicts == expected
    (wrong,) = [x for x in found if x.verdict == "failed"]
    assert wrong.detail.endswith("twice the expected value (every row)")
    assert wrong.detail.startswith("mass matrix, entry (q[")


def test_dampers_alone_are_compared_with_the_forces_of_a_reference():
    def dampers(factor):
        return lambda q, v: factor * (v @ v)

    against = EquationsOfMotion(2, R=dampers(1.0), name="damped")
    for factor, verdict in ((1.0, "passed"), (0.5, "failed")):
        found = check_functions(2, R=dampers(factor), against=against, states=1)
        (one,) = [x for x in found if x.claim == "reference" and x.subject.startswith("forces")]
        assert (one.subject, one.verdict) == ("forces ~ damped", verdict)


def test_an_engine_that_does_not_represent_the_scene_is_refused():
    scene = eomcheck.SCENES["rolling-disk"].example()
    own = testing.from_scene(scene)
    with pytest.raises(InputError, match="pinocchio, which does not represent rolling-disk"):
        check_functions(own.n, M=own.M, against=("pinocchio", scene))


def test_functions_in_a_dict_are_no_reference_and_it_is_said_what_is():
    with pytest.raises(InputError, match=r"of functions make one: EquationsOfMotion\(n, M"):
        check_functions(2, M=lambda q: np.eye(2), against={"M": np.eye})


class Reference(eomcheck.Engine):
    """A reference that says what `ask_engine` does: right, if that is a double."""

    version = classmethod(lambda cls: "reference 1")
    represents = classmethod(lambda cls, scene: True)
    made, answer = None, 1.0

    def __init__(self, scene):
        super().__init__(scene)
        if self.made is not None:
            raise self.made

    def mass_matrix(self, q, t=0.0):
        found = self.answer(q) if callable(self.answer) else self.answer
        return found * testing.from_scene(self.scene).M(q)

    def bias(self, q, v, t=0.0):
        return testing.from_scene(self.scene).bias(q, v)


def referred(engine: type[eomcheck.Engine], alone: bool = False, **options):
    scene, own = pendulum()
    functions = {"M": own.M} if alone else {"M": own.M, "bias": own.bias}
    more = {"states": 4, "claims": ["reference"]} | options
    return check_functions(own.n, **functions, against=(engine, scene), **more)


def no_answer(q):
    raise ValueError("no\nlicence")


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (np.nan, "mass_matrix returned nan in entry [0, 0]"),
        (np.ones((2, 1, 1)), "mass_matrix returned an array of shape (2, 3, 3), expected an array"),
        (1j, "mass_matrix returned an array of complex128, expected real numbers"),
        (no_answer, "mass_matrix raised ValueError: no licence (test_answers.py, line "),
    ],
)
def test_a_reference_that_never_answers_is_refused_if_nothing_else_is_compared(answer, says):
    engine = type(
        "Silent", (Reference,), {"answer": staticmethod(answer) if callable(answer) else answer}
    )
    found = {x.subject.split()[0]: x for x in referred(engine)}
    assert found["bias"].verdict == "passed", "which it does answer"
    assert found["M"].verdict == "skipped"
    assert found["M"].detail.startswith("the reference breaks: M: ")
    assert says in found["M"].detail
    with pytest.raises(InputError) as caught:
        referred(engine, alone=True)
    start = "against = silent of chain-pendulum[3]: it does not answer in any state: M: "
    assert str(caught.value).startswith(start + says)


def test_a_reference_that_breaks_in_some_states_is_looked_at_in_the_others():
    def at_times(q):
        return np.nan if q[0] > 0.5 else 1.0

    engine = type("Moody", (Reference,), {"answer": staticmethod(at_times)})
    v = np.array([0.5, -0.7, 0.9])
    breaks, works = ((np.array([x, 0.3, -0.2]), v) for x in (0.6, 0.4))
    for states in ([breaks, works], [works, breaks]):
        found = {x.subject.split()[0]: x for x in referred(engine, states=states)}
        assert {x.verdict for x in found.values()} == {"passed"}
        assert found["M"].state is not None and found["M"].state.q[0] == 0.4


def test_a_reference_that_cannot_be_made_is_refused():
    engine = type("Unmade", (Reference,), {"made": RuntimeError("no wheels")})
    with pytest.raises(
        InputError, match=r"against = unmade: Unmade\(scene\) raised RuntimeError: no w"
    ):
        referred(engine)


def test_whether_constraints_are_built_into_the_mass_matrix_can_be_said_to_check():
    functions = EquationsOfMotion(**given("cart"))
    for holonomic, verdict in ((None, "passed"), (True, "passed"), (False, "skipped")):
        (found,) = testing.check(
            functions, states=1, claims=["bias-of-mass-matrix"], holonomic=holonomic
        )
        assert found.verdict == verdict

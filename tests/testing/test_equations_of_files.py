"""Equations of motion in Python files: names that are read, n that is found, SymPy, references."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import eomcheck
from eomcheck import check
from eomcheck.claims.findings import Findings, causes_of, failure_lines, headline
from eomcheck.errors import CallError, InputError
from eomcheck.lab.fuzzing.failures import functions_named
from eomcheck.lab.report.equations_output import (
    equations_records,
    print_checked,
    print_equations,
)
from eomcheck.lab.store.validation_runs import stored_findings_in
from eomcheck.scenes import Snake
from eomcheck.testing import EquationsOfMotion, check_functions
from eomcheck.testing.equations_of_files import (
    equations_named,
    found_coordinates,
    read_equations,
    reference_named,
)

CART = """
import numpy as np

def M(q):
    return np.array([[3.0, np.cos(q[1])], [np.cos(q[1]), 1.0]])

def bias(q, v):
    return np.array([-np.sin(q[1]) * v[1] ** 2, 0.0])
"""

KANE = """
import sympy as sp
from sympy.physics.mechanics import *

q, u = dynamicsymbols("q u")
m, l, g = sp.symbols("m l g")
N, O = ReferenceFrame("N"), Point("O")
A = N.orientnew("A", "Axis", (q, N.z))
A.set_ang_vel(N, u * N.z)
O.set_vel(N, 0)
P = O.locatenew("P", -l * A.y)
P.v2pt_theory(O, N, A)
bob = Particle("bob", P, m)
kane = KanesMethod(N, [q], [u], [q.diff() - u])
kane.kanes_equations([bob], [(P, -m * g * N.y)])
"""


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """A function that writes a file of a text and returns its path."""
    monkeypatch.setattr("sys.path", list(__import__("sys").path))
    count = iter(range(100))

    def write(text: str, name: str = "") -> str:
        path = tmp_path / f"{name or f'{tmp_path.name}_{next(count)}'.replace('-', '_')}.py"
        path.write_text(text, encoding="utf-8")
        return str(path)

    return write


# ---- Functions -----------------------------------------------------------------------------------


def test_functions_of_a_file_are_read_by_their_names_and_n_is_found(file):
    equations, notes = read_equations(file(CART))
    assert (equations.n, equations.given) == (2, ("M", "bias"))
    assert notes == ("n = 2 coordinates, as M shows",)


def test_options_of_a_file_are_read_beside_its_functions(file):
    text = "n = 2\nranges = (-0.5, 0.25)\nbias_has_gravity = True\ncoriolis_skew = False\n"
    equations, notes = read_equations(file(CART + text))
    assert (equations.n, equations.ranges, equations.bias_has_gravity) == (2, (-0.5, 0.25), True)
    assert (equations.coriolis_skew, notes) == (False, ())


def test_n_of_the_call_comes_before_the_one_of_the_file(file):
    path = file(CART + "n = 2\n")
    assert read_equations(path, 3).equations.n == 3


def test_numbers_classes_and_helpers_under_another_name_are_not_read(file):
    text = "from fractions import Fraction as R\nfrom math import hypot as b\nc = 0.3\n"
    equations, (_, note) = read_equations(file(CART + text))
    assert equations.given == ("M", "bias")
    assert note.startswith("not read: R, which is fractions.Fraction, b, which is math.hypot, c")


def test_a_class_of_the_file_is_no_function(file):
    equations, (_, note) = read_equations(file(CART + "class U: pass\n"))
    assert "U" not in equations.given
    assert note.startswith("not read: U = <class")


@pytest.mark.parametrize(
    "holder",
    [
        "own = dict(M=M, bias=bias)",
        "class own:\n    M, bias = staticmethod(M), staticmethod(bias)",
        "class Own:\n    M, bias = staticmethod(M), staticmethod(bias)\nown = Own()",
        "import types\nown = types.SimpleNamespace(M=M, bias=bias)",
    ],
)
def test_an_object_that_holds_functions_is_read(file, holder: str):
    path = file(CART + "def U(q):\n    return 0.0\n" + holder)
    equations, _ = read_equations(f"{path}:own")
    assert (equations.n, equations.given, equations.name) == (2, ("M", "bias"), "own")


def test_the_only_equations_of_a_file_are_those_that_are_meant(file):
    text = CART + "from eomcheck.testing import EquationsOfMotion as E\nboth = E(2, M=M)\n"
    assert read_equations(file(text)).equations.given == ("M",)
    assert read_equations(file(text + "same = both\n")).equations.given == ("M",)
    with pytest.raises(InputError, match="has several: expected one of both, other after a colon"):
        read_equations(file(text + "other = E(2, M=M)\n"))
    with pytest.raises(InputError, match=r"n = 3, but the equations have n = 2"):
        read_equations(file(text), 3)


def test_check_takes_a_file(file):
    half = CART.replace("v[1] ** 2", "v[1] ** 2 / 2")
    assert not any(x.verdict == "failed" for x in check(file(CART)))
    assert "bias-of-mass-matrix" in {x.claim for x in check(file(half)) if x.verdict == "failed"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("def mass_matrix(q):\n    return 1\n", "these would be read: M = mass_matrix"),
        ("M = 3.0\n", "; it has M = 3.0"),
        ("x = 1\n", "such as M(q), bias(q, v), gravity(q), C(q, v), qdd(q, v)"),
    ],
)
def test_a_file_without_functions_is_one_sentence(file, text: str, message: str):
    with pytest.raises(InputError) as error:
        read_equations(file(text))
    assert message in str(error.value)


@pytest.mark.parametrize("name", ["sleigh", "arm.urdf", "x:y z"])
def test_what_is_no_file_is_refused_with_the_command_of_scenes(name: str):
    with pytest.raises(InputError) as error:
        read_equations(name)
    assert (
        "expected FILE.py or FILE.py:NAME; a scene is checked by `eomcheck validate --scene "
        in (str(error.value))
    )


def test_a_scene_or_an_engine_of_a_file_is_refused_with_its_check(file):
    path = file("from eomcheck.scenes import Snake\nown = Snake.coil(2)\n")
    with pytest.raises(InputError, match=r"a scene: eomcheck\.validate checks it"):
        read_equations(f"{path}:own")
    with pytest.raises(InputError, match=r"a scene class: "):
        read_equations(f"{path}:Snake")


def test_a_class_that_cannot_be_made_is_one_sentence(file):
    path = file("class own:\n    def __init__(self, m):\n        self.M = None\n")
    with pytest.raises(InputError, match=r"own\(\) raised TypeError"):
        read_equations(f"{path}:own")


# ---- The number of coordinates -------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 7, 31])
def test_n_is_found_from_shapes_alone(n: int):
    def unpacked(q):
        assert len(q) == n
        return np.eye(n)

    assert found_coordinates({"M": lambda q: np.eye(n)}) == (n, "M")
    assert found_coordinates({"bias": lambda q, v: q[n - 1] * np.ones(n)}) == (n, "bias")
    assert found_coordinates({"M": unpacked}) == (n, "M")


def test_n_is_found_from_another_function_where_one_takes_any_number():
    functions = {"M": lambda q: np.eye(len(q)), "qdd": lambda q, v: np.zeros(3)}
    assert found_coordinates(functions) == (3, "qdd")


@pytest.mark.parametrize(
    ("functions", "message"),
    [
        ({"M": lambda q: np.eye(len(q))}, "M has a result for 1 and for 2 coordinates"),
        ({"M": lambda q: 1 / 0}, "M, called with 100 coordinates: ZeroDivisionError"),
        ({"T": lambda q, v: 0.0}, "no shape of T shows it"),
        ({"M": lambda q: np.eye(2), "qdot": lambda q, u: u}, "with qdot no shape shows it"),
    ],
)
def test_n_that_cannot_be_found_is_asked_for(functions, message: str):
    with pytest.raises(InputError) as error:
        found_coordinates(functions)
    assert message in str(error.value)
    assert "expected `n = ...`" in str(error.value)


# ---- Calls and shapes ----------------------------------------------------------------------------


def failures(n: int = 2, **functions) -> dict[str, str]:
    findings = check_functions(n, states=2, **functions)
    return {x.subject: x.detail for x in findings if x.verdict == "failed"}


def test_further_arguments_are_met_with_the_lambda_that_fills_them_in():
    (detail,) = failures(M=lambda q, p: p * np.eye(2)).values()
    assert detail.endswith("it is called as M(q): write M = lambda q: M(q, p)")


def test_too_few_arguments_are_met_with_those_of_the_call():
    (detail,) = failures(bias=lambda q: q).values()
    assert detail.endswith("it is called as bias(q, v)")


def test_an_error_inside_a_function_is_not_one_of_its_call():
    def M(q):
        return (lambda x, y: x)(1)

    (detail,) = failures(M=M).values()
    assert "is called as" not in detail


def test_a_function_of_many_states_is_met_with_one_state_at_a_time():
    one_at_a_time = "functions are called with one state at a time"
    assert one_at_a_time in failures(M=lambda q: q[:, 0])["M"]
    assert one_at_a_time in failures(M=lambda q: np.eye(2)[None])["M"]


def test_a_transposed_jacobian_is_named_and_nothing_else_blamed():
    a = np.array([[1.0, 0.0, 0.0, 2.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    given = {"c": lambda q: a @ q, "gamma": lambda q, v: np.zeros(3)}
    assert failures(4, a=lambda q: a, **given) == {}
    details = failures(4, a=lambda q: a.T, **given)
    assert details == {"a": "a, answers an array of shape (4, 3), expected (3, 4): transposed?"}


def bias(q, v):
    return np.array([-np.sin(q[1]) * v[1] ** 2, 0.0])


def M(q):
    return np.array([[3.0, np.cos(q[1])], [np.cos(q[1]), 1.0]])


def test_exchanged_arguments_are_named_in_the_first_failure_alone():
    findings = check_functions(2, M=M, bias=lambda v, q: bias(q, v))
    first, *rest = [x for x in findings if x.verdict == "failed"]
    assert first.detail.endswith("q and v changed places? bias(v, q) passes")
    assert rest
    assert not any("changed places" in x.detail for x in rest)


def test_a_wrong_function_whose_arguments_are_right_is_not_called_exchanged():
    findings = check_functions(2, M=M, bias=lambda q, v: 0.5 * bias(q, v))
    assert not any("changed places" in x.detail for x in findings)


# ---- SymPy ---------------------------------------------------------------------------------------


def test_a_sympy_model_takes_the_numbers_of_its_file_or_drawn_ones(file):
    pytest.importorskip("sympy")
    equations, notes = read_equations(file(KANE + "numbers = {m: 2.0, l: 0.5, g: 9.81}\n"))
    assert notes == ()
    np.testing.assert_allclose(equations.M(np.zeros(1)), [[0.5]])
    assert (equations.holonomic, equations.ranges) == (None, None)
    more = "numbers = {m: 2.0, l: 0.5, g: 9.81}\nholonomic = True\n"
    more += "ranges = ((-3.0, 3.0), (-2.0, 2.0))\n"
    with_options = read_equations(file(KANE + more)).equations
    assert with_options.holonomic is True
    assert with_options.ranges == ((-3.0, 3.0), (-2.0, 2.0))
    drawn, (note,) = read_equations(file(KANE), seed=3)
    assert note.startswith("drawn with seed 3, as the file has no dict `numbers`: g = ")
    other = read_equations(file(KANE), seed=4).equations
    assert drawn.M(np.zeros(1)) != other.M(np.zeros(1))
    assert not any(x.verdict == "failed" for x in check(drawn, states=3))


# ---- References ----------------------------------------------------------------------------------


def test_a_reference_is_a_scene_by_name_of_a_file_or_other_equations(file):
    path = file(CART + "from eomcheck.scenes import Snake\nown = Snake.coil(2)\n")
    assert repr(reference_named("snake", 3)) == repr(Snake.example())
    assert repr(reference_named(f"{path}:own", 2)) == repr(Snake.coil(2))
    assert repr(reference_named(f"{path}:Snake", 2)) == repr(Snake.example())
    other = reference_named(path, 2)
    assert isinstance(other, EquationsOfMotion)
    assert other.given == ("M", "bias")


# ---- Output --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def wrong():
    return check_functions(
        2,
        M=M,
        bias=lambda q, v: bias(q, v) / 2,
        a=lambda q: [[1.0, 0.0]],
        c=lambda q: [q[0] + q[1]],
        name="own",
    )


def test_failures_are_grouped_by_their_cause():
    findings = check_functions(2, M=M, bias=lambda q, v: bias(q, v) / 2)
    groups = causes_of(findings)
    assert [[x.claim for x in group] for group in groups] == [["bias-of-mass-matrix", "bias-power"]]
    head, *lines = failure_lines(*groups[0])
    assert head == "FAIL M or bias of functions (bias-of-mass-matrix [bias])"
    assert "     bias, row q[0]: half the expected value (every row)" in lines
    assert lines[-1] == "     follows from it: bias-power"
    assert sum(line.startswith("     error ") for line in lines) == 1


def test_two_causes_are_two_groups(wrong):
    failed = [x for x in wrong if x.verdict == "failed"]
    groups = causes_of(wrong)
    assert [group[0].cause for group in groups] == ["M or bias", "a or c"]
    assert sorted(id(x) for group in groups for x in group) == sorted(map(id, failed))
    assert all(not group[0].follows for group in groups)
    assert all(x.follows and x.cause == group[0].cause for group in groups for x in group[1:])


LARGEST = "largest error 50 % of what rounding allows"


@pytest.mark.parametrize(
    ("verdicts", "line"),
    [
        (
            "passed passed skipped",
            f"2 of 3 claims passed, 1 undecided; {LARGEST} (0 [])",
        ),
        ("skipped inconclusive", "nothing was decided"),
        ("passed failed", "1 of 2 claims failed: cause"),
    ],
)
def test_the_verdict_counts_claims_that_are_decided(verdicts: str, line: str):
    findings = [
        SimpleNamespace(claim=str(i), verdict=x, follows="", cause="cause", subject="", ratio=0.5)
        for i, x in enumerate(verdicts.split())
    ]
    assert headline(findings) == line


def test_a_claim_that_fails_in_one_state_has_failed_in_any_order(wrong):
    failed = next(x for x in wrong if x.follows)
    passed = replace(failed, verdict="passed", cause="", follows="", observed=0.0)
    for findings in (Findings([passed, failed]), Findings([failed, passed])):
        assert (findings.verdict, findings.failures) == ("failed", [failed])
        assert headline(findings).startswith("1 of 1 claim failed: ")


def test_what_is_undecided_is_printed_with_its_reason_and_is_not_among_what_passed(wrong, capsys):
    passed = next(x for x in wrong if x.verdict == "passed")
    open_ = replace(passed, claim="open", verdict="inconclusive", detail="digits decide nothing")
    print_checked("title", [], [passed, open_])
    printed = capsys.readouterr().out
    assert f"passed: {passed.claim}\n" in printed
    assert f"inconclusive: open [{passed.subject}]: digits decide nothing" in printed


def test_everything_is_printed_once(wrong, file, capsys):
    equations, notes = read_equations(file(CART))
    print_equations(SimpleNamespace(equations=equations, notes=notes), wrong, 20, 0, "other")
    printed = capsys.readouterr().out
    assert "n = 2 coordinates, as M shows" in printed
    assert "20 states, seed 0, against other" in printed
    for finding in wrong:
        assert finding.claim in printed
        if finding.verdict in ("skipped", "inconclusive"):
            assert finding.detail in printed
    assert "check_functions(" in printed


def test_a_report_has_every_finding(wrong):
    stored = stored_findings_in(equations_records(wrong))
    assert sorted((x.claim, x.subject, x.verdict) for x in stored) == sorted(
        (x.claim, x.subject, x.verdict) for x in wrong
    )
    assert {x.scene for x in stored} == {"own"}


def test_a_function_that_gives_no_answer_while_n_is_found_is_named_with_the_n_that_is_tried():
    def M(q):
        while len(q) == 1:
            pass
        return np.eye(len(q))

    with pytest.raises(CallError) as caught, eomcheck.time_limit(0.02):
        found_coordinates({"M": M})
    text = r".*: M gave no answer in 0\.1 s, 5 times .* \(test_equations_of_files\.py, line \d+\)"
    assert re.fullmatch(rf"{text}, called with 1 coordinate to find n", str(caught.value))


def test_every_likely_function_is_named_where_none_has_the_name_that_is_read(tmp_path):
    path = tmp_path / "renamed.py"
    names = "mass_matrix", "helper", "potential_energy", "kinetic_energy", "accelerations"
    path.write_text("".join(f"def {name}(q): pass\n" for name in names))
    with pytest.raises(InputError) as caught:
        read_equations(str(path))
    likely = "M = mass_matrix, qdd = accelerations, T = kinetic_energy, U = potential_energy"
    assert str(caught.value).endswith(f"; these would be read: {likely}")


def test_fuzz_reads_whatever_check_reads_and_leaves_scenes_to_others(tmp_path):
    path = tmp_path / "several.py"
    path.write_text(
        CART
        + "from eomcheck.scenes import Sleigh\n"
        + "model = {'M': M, 'bias': bias}\n"
        + "class Model:\n    M, bias = staticmethod(M), staticmethod(bias)\n"
        + "class Other: pass\n"
        + "sleigh = Sleigh.example()\n"
    )
    for name in ("", ":model", ":Model"):
        read = equations_named(f"{path}{name}")
        assert read is not None
        assert (read.equations.n, read.equations.given) == (2, ("M", "bias"))
        assert read.notes == ("n = 2 coordinates, as M shows",)
        assert functions_named(f"{path}{name}") is read.equations
    for name in ("Sleigh", "sleigh", "Other", "missing", "np"):
        assert equations_named(f"{path}:{name}") is None
    assert equations_named("sleigh") is None


LOOP = """
import numpy as np

n = 3

def M(q):
    return np.diag([1.0, 2.0, 3.0])

def a(q):
    return np.array([[1.0, q[1], 0.0], [0.0, 1.0, 1.0], [2.0, 2 * q[1], 0.0]])

def gamma(q, v):
    return np.array([v[1] ** 2, 0.0, 2 * v[1] ** 2])

def qdd(q, v):
    A = a(q)
    K = np.block([[M(q), -A.T], [A, np.zeros((3, 3))]])
    return np.linalg.solve(K, np.concatenate([np.zeros(3), -gamma(q, v)]))[:3]
"""


def test_a_repeated_loop_equation_is_named_where_a_system_is_singular(file):
    findings = check(file(LOOP), states=2)
    (failed,) = [x for x in findings if x.verdict == "failed"]
    assert failed.subject == "qdd"
    singular = "qdd, LinAlgError: Singular matrix"
    assert failed.detail == f"{singular}; rows of a depend on each other: row 2 = 2 row 0"


def test_an_entry_that_is_not_finite_is_named_by_the_coordinates_that_have_names():
    broken = lambda q: np.array([[1.0, 0.0], [0.0, np.nan]])  # noqa: E731
    for names, entry in (({}, "1, 1"), ({"coordinates": ("x", "θ")}, "θ, θ")):
        equations = EquationsOfMotion(2, M=broken, **names)
        failed, *_ = check(equations, states=1)
        assert failed.detail == f"M, M[{entry}] = nan, expected a finite number"
    speeds = {"coordinates": ("x", "θ"), "velocities": ("v", "ω"), "qdot": lambda q, u: u}
    failed, *_ = check(EquationsOfMotion(2, M=broken, **speeds), states=1)
    assert failed.detail == "M, M[ω, ω] = nan, expected a finite number"


MISNAMED = """
import numpy as np

def helper(q): return np.array([[2.0]])

def M(q): return helper(q)

def bias(q, v): return 0.0 * weight(q)

def weight(q): return np.array([1.0 + q[0]])

def mass_matrix(q): return np.array([[4.0]])

def _own(q): return q

class Crane:
    def bias(self, q, v): return self.zero(q)

    def zero(self, q): return np.array([0.0])

    def mass_matrix(self, q): return np.array([[4.0]])
"""


@pytest.mark.parametrize("name", ["", ":Crane"])
def test_a_function_of_another_name_is_reported_unless_one_that_is_read_calls_it(tmp_path, name):
    path = tmp_path / f"misnamed{len(name)}.py"
    path.write_text(MISNAMED)
    _, notes = read_equations(f"{path}{name}")
    assert [one for one in notes if "not read" in one] == ["not read: mass_matrix"]

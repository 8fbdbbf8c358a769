"""The tests of somebody's own repository: what passes, fails, is skipped or is expected."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

import eomcheck
from eomcheck import pytest_plugin, testing, validation
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.scenes import ChainPendulum, Snake
from eomcheck.testing.suite import ClaimTarget, EquationsTarget, SceneTarget, Suite, compute_once

pytest_plugins = ["pytester"]

ROOT = Path(__file__).parents[2]
SHOWN = ROOT / "docs" / "guides" / "ci"
PLUGIN = "eomcheck.pytest_plugin"

SIGN = "self.coupling * np.sin", "-self.coupling * np.sin"
ON_ONE_SCENE = "@parametrize_with_claims(ByHand)", "@parametrize_with_claims(ByHand, {})"
TWO_LINKS = "scenes=[ChainPendulum.rods(2)]"
FEW = "--eomcheck-examples=2"

Session = Callable[..., pytest.RunResult]


@pytest.fixture(scope="module", autouse=True)
def loaded() -> None:
    """Load all libraries: sessions forget what they import, and some cannot be loaded twice."""
    eomcheck.validate(ChainPendulum.rods(1), examples=1)


@pytest.fixture
def session(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> Session:
    """An empty repository with the files that the guide shows; returns what runs pytest there."""
    for name in ("cart", "by_hand"):  # others of these names, which tests before have imported
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.setenv("PYTHONPATH", str(Path(eomcheck.__file__).parents[1]))
    shown(pytester, "by_hand.py", "test_by_hand.py")

    def run(*options: str, plugin: bool = True) -> pytest.RunResult:
        plugins = ("-p", PLUGIN) if plugin else ()
        return pytester.runpytest_inprocess(*plugins, "-rsxX", "-p", "no:cacheprovider", *options)

    return run


def shown(pytester: pytest.Pytester, *names: str) -> None:
    """Put files that the guide shows into the repository."""
    for name in names:
        pytester.path.joinpath(name).write_bytes((SHOWN / name).read_bytes())


def change(pytester: pytest.Pytester, name: str, *changes: tuple[str, str]) -> None:
    """Replace texts in a file of the repository, each of which is there once."""
    path = pytester.path / name
    text = path.read_text(encoding="utf-8")
    for old, new in changes:
        assert text.count(old) == 1
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")


def plant(pytester: pytest.Pytester) -> None:
    """Plant the wrong sign in the bias of the engine."""
    change(pytester, "by_hand.py", SIGN)


def arguments(pytester: pytest.Pytester, text: str) -> None:
    """Hand these arguments to the decorator, behind the engine."""
    old, new = ON_ONE_SCENE
    imported = "from eomcheck.testing", "from eomcheck.scenes import *\nfrom eomcheck.testing"
    change(pytester, "test_by_hand.py", (old, new.format(text)), imported)


def ids(result: pytest.RunResult, outcome: str) -> set[str]:
    """Return what stands in brackets of the tests that came to this."""
    reports = result.reprec.getreports("pytest_runtest_logreport")  # type: ignore[attr-defined]
    told = {(one.nodeid, one.outcome) for one in reports if one.when == "call"}
    return {node.split("[", 1)[1][:-1] for node, came in told if came == outcome}


# ---- What a test comes to ------------------------------------------------------------------------


def test_a_right_engine_passes_in_an_empty_repository_and_what_it_does_not_say_is_skipped(session):
    result = session(FEW, "test_by_hand.py")
    here = "-chain-pendulum"
    assert ids(result, "passed") == {
        "mass-matrix" + here,
        "bias" + here,
        "engine-acceleration" + here,
    }
    assert {"constraint-jacobian" + here, "kane-n-matrix" + here} <= ids(result, "skipped")
    assert not ids(result, "failed")
    said = "SKIPPED * constraint-drift does not apply to chain-pendulum"
    offered = "SKIPPED * byhand: it does not offer kane_inertia_remainder"
    result.stdout.fnmatch_lines_random([said, offered])


def test_it_passes_without_the_plug_in_too(session, pytester):
    arguments(pytester, f"{TWO_LINKS}, examples=2")
    assert len(ids(session(plugin=False), "passed")) == 3


def test_a_wrong_sign_fails_by_name_beside_what_is_right(session, pytester):
    plant(pytester)
    arguments(pytester, TWO_LINKS)
    result = session(FEW, "test_by_hand.py")
    here = "-chain-pendulum[2]"
    assert ids(result, "failed") == {"bias" + here, "engine-acceleration" + here}
    assert "mass-matrix" + here in ids(result, "passed")
    result.stdout.fnmatch_lines(["bias ?byhand? failed on chain-pendulum?2?:*row θ_?: *sign)"])


def test_a_failure_is_the_finding_and_its_code_without_a_traceback(session, pytester):
    plant(pytester)
    arguments(pytester, TWO_LINKS)
    text = session(FEW, "-k", "bias").stdout.str()
    shown = text.split("_ test_by_hand[bias-chain-pendulum[2]] _")[1].split("\n=====")[0]
    finding, *rest = shown.strip(" _\n").splitlines()
    assert finding.startswith("bias [byhand] failed on chain-pendulum[2]: observed")
    assert "scene = ChainPendulum(" in "\n".join(rest)
    assert not any(word in shown for word in ("Traceback", "suite.py", "check()", ">  "))


@pytest.mark.night
def test_the_code_of_a_failure_shows_it_again(session, pytester):
    plant(pytester)
    arguments(pytester, TWO_LINKS)
    text = session(FEW, "-k", "bias").stdout.str()
    code = text.split("to see it again:\n")[1].split("\n=====")[0]
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=pytester.path
    )
    assert not ran.stderr
    assert "bias [byhand] failed on chain-pendulum[2]" in ran.stdout


VAGUE = """
from eomcheck.engines.casadi import CasadiEngine

class Vague(CasadiEngine):
    key = "vague"

    def kane_inertia_remainder(self, q, v, t=0.0):
        remainder, size, _ = super().kane_inertia_remainder(q, v, t)
        return remainder, size, 1e20
"""


@pytest.mark.night
def test_what_was_only_inconclusive_is_skipped_with_the_reason(session, pytester):
    (pytester.path / "by_hand.py").write_text(VAGUE.replace("Vague", "ByHand"), encoding="utf-8")
    arguments(pytester, "scenes=[Sleigh]")
    result = session(FEW)
    assert "kane-n-matrix-sleigh" in ids(result, "skipped")
    assert "bias-sleigh" in ids(result, "passed")
    said = "SKIPPED * inconclusive: kane-n-matrix ?kane ~ vague? inconclusive on sleigh*"
    result.stdout.fnmatch_lines([said])


def test_a_scene_that_the_engine_does_not_represent_is_skipped_beside_one_that_it_does(
    session, pytester
):
    arguments(pytester, "scenes=[ChainPendulum, 'snake']")
    result = session(FEW)
    assert {"bias-snake", "mass-matrix-snake"} <= ids(result, "skipped")
    assert "bias-chain-pendulum" in ids(result, "passed")


BROKEN = """

class Broken(ChainPendulum):
    @staticmethod
    def velocities(parameters, angles, q, v):
        print("asked")
        V, omega = ChainPendulum.velocities(parameters, angles, q, v)
        return V, omega.ravel()


@parametrize"""


def test_a_scene_that_breaks_is_told_in_a_sentence_and_is_no_expected_failure(session, pytester):
    arguments(pytester, "scenes=[Broken([1], [1], [1])], expected_failures='known.txt'")
    change(pytester, "test_by_hand.py", ("\n\n@parametrize", BROKEN))
    (pytester.path / "known.txt").write_text("bias-chain-pendulum[1] known\n")
    result = session(FEW, "-s")
    assert "bias-chain-pendulum[1]" in ids(result, "failed")
    result.stdout.fnmatch_lines(["bias-chain-pendulum?1?: *ω has shape (1,), expected (1, 1)"])
    assert result.stdout.str().count("asked") == 1


# ---- Expected failures ---------------------------------------------------------------------------

HERE = "chain-pendulum[2]"
KNOWN = f"""\
# What is known to fail.

bias-{HERE}    the sign of the centrifugal forces
engine-acceleration-{HERE} the same
"""


def expect(pytester: pytest.Pytester, text: str, options: str = "") -> None:
    """Write a file of expected failures and name it in the test."""
    (pytester.path / "known.txt").write_text(text, encoding="utf-8")
    arguments(pytester, f"{TWO_LINKS}, expected_failures='known.txt'{options}")


def test_an_expected_failure_xfails_with_its_reason(session, pytester):
    plant(pytester)
    expect(pytester, KNOWN)
    result = session(FEW)
    result.assert_outcomes(passed=2, skipped=5, xfailed=2)
    assert ids(result, "passed") == {f"mass-matrix-{HERE}", "expected-failures"}
    result.stdout.fnmatch_lines(["XFAIL *bias-*the sign of the centrifugal forces"])


def test_runxfail_shows_an_expected_failure(session, pytester):
    plant(pytester)
    expect(pytester, KNOWN)
    result = session(FEW, "--runxfail", "-k", "bias")
    assert ids(result, "failed") == {f"bias-{HERE}"}
    result.stdout.fnmatch_lines(["bias ?byhand? failed on *"])


@pytest.mark.parametrize(("options", "failed"), [("", 2), (", strict=False", 0)])
def test_an_expected_failure_that_passes_is_stale(session, pytester, options, failed):
    expect(pytester, KNOWN, options)
    result = session(FEW)
    result.assert_outcomes(passed=4 - failed, skipped=5, failed=failed)
    if failed:
        said = f"bias-{HERE} passes, but is expected to fail: the sign of the centrifugal forces"
        assert said in result.stdout.str()


def test_an_expected_failure_that_is_not_looked_at_is_stale(session, pytester):
    expect(pytester, f"kane-n-matrix-{HERE} who knows")
    result = session(FEW, "-k", "kane")
    assert ids(result, "failed") == {f"kane-n-matrix-{HERE}"}
    assert "is skipped (byhand: it does not offer kane" in result.stdout.str()


@pytest.mark.parametrize("options", ["", ", strict=False"])
def test_an_id_that_matches_nothing_fails_by_name(session, pytester, options):
    expect(pytester, f"bias-{HERE} known\nbias-of-old known\nbais known\n", options)
    plant(pytester)
    result = session(FEW)
    assert {"expected-failures"} < ids(result, "failed")
    assert f"bias-{HERE}" not in ids(result, "failed")
    result.stdout.fnmatch_lines(["*known.txt': no test is called bias-of-old, bais"])


def test_two_tests_may_share_a_file(session, pytester):
    plant(pytester)
    expect(pytester, KNOWN + "mass-matrix-other known\n")
    test = pytester.path / "test_by_hand.py"
    more = test.read_text().replace("test_by_hand", "test_other").replace("=[", "={'other': ")
    test.write_text(test.read_text() + more.replace("(2)]", "(2)}"))
    result = session(FEW, "-k", "expected-failures")
    assert not ids(result, "failed")


def test_an_id_of_another_file_matches_nothing(session, pytester):
    expect(pytester, f"bias-{HERE} known\n")
    test = pytester.path / "test_by_hand.py"
    more = test.read_text().replace("test_by_hand", "test_other").replace("known.txt", "other.txt")
    more = more.replace("=[", "={'other': ").replace("(2)]", "(2)}")
    (pytester.path / "test_other.py").write_text(more)
    (pytester.path / "other.txt").write_text(f"bias-{HERE} known\n")
    result = session(FEW, "-k", "expected-failures")
    result.assert_outcomes(passed=1, failed=1, deselected=16)
    result.stdout.fnmatch_lines(["*other.txt': no test is called bias-*"])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (None, "known.txt' cannot be read"),
        (f"bias-{HERE}\n", "line 1: 'bias-chain-pendulum[2]' has no reason"),
        (KNOWN + f"bias-{HERE} again\n", "line 5: 'bias-chain-pendulum[2]' is there twice"),
    ],
)
def test_a_file_that_cannot_be_read_stops_before_anything_is_run(session, pytester, text, says):
    expect(pytester, text or "")
    if text is None:
        (pytester.path / "known.txt").unlink()
    result = session(FEW)
    assert result.ret == pytest.ExitCode.INTERRUPTED
    assert says in result.stdout.str()


# ---- Work ----------------------------------------------------------------------------------------


def counting(pytester: pytest.Pytester) -> Callable[[], int]:
    """Have the engine tell whenever it is asked for M; return what counts since the last time."""
    log = pytester.path / "asked.txt"
    asked = (
        "def mass_matrix(self, q, t=0.0):\n",
        (
            "def mass_matrix(self, q, t=0.0):\n"
            f"        with open({str(log)!r}, 'a') as file:\n            file.write('asked\\n')\n"
        ),
    )
    change(pytester, "by_hand.py", asked)

    def count() -> int:
        found = len(log.read_text().splitlines()) if log.exists() else 0
        log.unlink(missing_ok=True)
        return found

    return count


def test_the_work_on_a_scene_is_done_once_for_all_its_claims(session, pytester):
    asked = counting(pytester)
    arguments(pytester, TWO_LINKS)
    session(FEW, "-k", "engine-acceleration")
    one = asked()
    session(FEW)
    assert asked() == one > 3


def test_nothing_is_done_before_a_test_of_the_scene_is_run(session, pytester):
    asked = counting(pytester)
    arguments(pytester, "scenes={'one': ChainPendulum.rods(1), 'two': ChainPendulum.rods(2)}")
    session("--co", FEW)
    assert asked() == 0
    session("-k", "two", FEW)
    one = asked()
    session(FEW)
    assert asked() == 2 * one > 0


@pytest.mark.night
def test_processes_of_xdist_share_the_work(session, pytester):
    pytest.importorskip("xdist")
    asked = counting(pytester)
    arguments(pytester, TWO_LINKS)
    session(FEW)
    alone = asked()
    result = pytester.runpytest_subprocess("-p", PLUGIN, "-p", "xdist", "-n", "2", FEW)
    result.assert_outcomes(passed=3, skipped=5)
    assert asked() == alone > 0


WORK = """
import sys, time
from pathlib import Path
from eomcheck.testing.suite import compute_once

folder, log = map(Path, sys.argv[1:])

def work():
    with log.open("a") as file:
        file.write("done\\n")
    time.sleep(0.5)
    return ["found"]

while not (folder / "go").exists():
    time.sleep(0.001)
assert compute_once(folder, "work", work) == ["found"]
"""


@pytest.mark.night
def test_work_is_done_once_by_processes_that_begin_together(session, pytester, tmp_path):
    log = tmp_path / "log"
    command = [sys.executable, "-c", WORK, str(pytester.path), str(log)]
    started = [subprocess.Popen(command) for _ in range(3)]
    (pytester.path / "go").touch()
    assert [one.wait(60) for one in started] == [0, 0, 0]
    assert log.read_text() == "done\n"


def test_work_that_raises_is_not_kept(tmp_path):
    def fail() -> None:
        raise InputError("no")

    with pytest.raises(InputError):
        compute_once(tmp_path, "work", fail)
    assert compute_once(tmp_path, "work", lambda: 2) == 2
    assert compute_once(tmp_path, "work", lambda: 3) == 2
    assert compute_once(tmp_path, "another", lambda: 3) == 3
    assert compute_once(None, "work", lambda: 4) == 4


def test_scenes_of_one_test_are_kept_apart_where_processes_share_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(pytest_plugin.OPTIONS, "shared", tmp_path)
    trials: list[ClaimTarget] = [
        EquationsTarget(testing.EquationsOfMotion(1, M=lambda q, m=m: [[m]]), where=where)
        for where, m in (("right", 2.0), ("wrong", -2.0))
    ]
    for _ in range(2):  # as another process does
        suite = Suite("test", trials, None, {}, True, 1, 0)
        came = [suite.result(f"mass-matrix-positive-{x.where}").verdict for x in trials]
        assert came == ["passed", "failed"]


# ---- Options and arguments -----------------------------------------------------------------------


def test_the_number_of_examples_is_an_argument_and_an_option_goes_before_it(session, pytester):
    asked = counting(pytester)
    arguments(pytester, f"{TWO_LINKS}, examples=4")
    session()
    four = asked()
    session("--eomcheck-examples", "1")
    one = asked()
    session("--eomcheck-examples", "4")
    assert asked() == four > one > 0


@pytest.mark.parametrize("count", ["0", "-3", "many"])
def test_a_number_of_examples_that_is_none_is_bad_input(session, pytester, count):
    result = session(f"--eomcheck-examples={count}")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert f"{count!r}, expected a whole number of at least 1" in result.stderr.str()


def test_expected_failures_of_the_command_line_go_before_those_of_the_test(session, pytester):
    plant(pytester)
    expect(pytester, "no-such-test known\n")
    (pytester.path / "here.txt").write_text(KNOWN, encoding="utf-8")
    # It is found in the folder in which pytest is started, wherever the root is.
    root = "--rootdir", str(pytester.path.parent)
    result = session(FEW, *root, "--eomcheck-xfails", "here.txt")
    result.assert_outcomes(passed=2, skipped=5, xfailed=2)


def test_options_of_a_session_are_those_of_that_session_alone(session, pytester):
    (pytester.path / "here.txt").write_text(KNOWN, encoding="utf-8")
    session(FEW, "--eomcheck-xfails", "here.txt", "--collect-only")
    assert set(vars(pytest_plugin.OPTIONS).values()) == {None}


ONE = testing.EquationsOfMotion(1, bias=lambda q, v: 0 * q)


@pytest.mark.parametrize(
    ("given", "error", "says"),
    [
        ({"subject": "no-such-engine"}, UnknownNameError, "no-such-engine"),
        ({}, InputError, "expected an engine, functions, or else scenes"),
        ({"subject": "casadi", "scenes": Snake}, InputError, "expected a list of scenes"),
        ({"subject": "casadi", "scenes": "snake"}, InputError, "expected a list of scenes"),
        ({"subject": "casadi", "scenes": [3]}, InputError, "3 is neither a scene"),
        ({"subject": "casadi", "scenes": ["snak"]}, UnknownNameError, "unknown scene 'snak'"),
        ({"subject": "casadi", "scenes": []}, InputError, r"scenes = \[\], expected at least one"),
        (
            {"subject": "pinocchio", "scenes": ["rolling-disk"]},
            InputError,
            "engine pinocchio represents none of the scenes rolling-disk",
        ),
        ({"subject": "casadi", "scenes": ["snake", Snake]}, InputError, "two of them are called"),
        ({"subject": lambda check: None}, InputError, "above <lambda> without parentheses"),
        ({"subject": ONE, "scenes": ["snake"]}, InputError, "functions are no engine of scenes"),
        ({"subject": "casadi", "against": Snake}, InputError, "only functions are compared"),
        ({"subject": "casadi", "examples": 0}, InputError, "examples = 0"),
        ({"subject": "casadi", "seed": 0.5}, InputError, "seed = 0.5"),
        ({"subject": ONE, "seed": -1}, InputError, "seed = -1, expected a whole number of at"),
    ],
)
def test_bad_arguments_are_told_in_a_sentence(given, error, says):
    with pytest.raises(error, match=says):
        testing.parametrize_with_claims(**given)


def test_a_claim_that_fails_is_a_failing_test_of_the_installed_package():
    def check() -> None:
        raise AssertionError("bias on sleigh")

    with pytest.raises(AssertionError, match="bias on sleigh"):
        validation.test_claims(check)


@pytest.mark.night
def test_every_scene_of_the_installed_package_can_be_looked_at(session, pytester):
    asked = "--pyargs", validation.__name__, FEW, "-k", "sleigh", "-v"
    result = pytester.runpytest_subprocess("-p", PLUGIN, *asked)
    outcomes = result.parseoutcomes()
    assert outcomes["passed"] > 20 and "failed" not in outcomes
    result.stdout.fnmatch_lines(["*test_claims?bias-sleigh? PASSED*"])


def test_an_engine_is_judged_on_scenes_that_are_drawn(session, pytester):
    # Right where there are as many links as in the example.
    wrong = "np.fill_diagonal", "self.coupling *= 1 + (scene.n != 3)\n        np.fill_diagonal"
    change(pytester, "by_hand.py", wrong)
    result = session("--eomcheck-examples=5")
    assert "mass-matrix-chain-pendulum" in ids(result, "failed")


class Recording(eomcheck.Engine):
    """An engine that is wrong, and keeps the scenes that it is made for."""

    scenes: ClassVar[list[str]] = []

    @classmethod
    def version(cls):
        return "recording 1"

    @classmethod
    def represents(cls, scene):
        return True

    def __init__(self, scene):
        super().__init__(scene)
        self.scenes.append(repr(scene))

    def mass_matrix(self, q, t=0.0):
        return np.eye(len(q))

    def bias(self, q, v, t=0.0):
        return np.zeros(len(v))


def test_random_scenes_of_a_kind_are_those_of_the_seed():
    def drawn(seed):
        Recording.scenes.clear()
        trial = SceneTarget("chain-pendulum", ChainPendulum, Recording)
        trial.results(1, seed, expected_to_fail=trial.claims)  # no smaller failure is looked for
        return set(Recording.scenes) - {repr(ChainPendulum.example())}

    seven, eight = drawn(7), drawn(8)
    assert seven and eight and not seven & eight


# ---- Functions -----------------------------------------------------------------------------------

CART = (ROOT / "docs" / "guides" / "cart.py").read_text(encoding="utf-8")


def test_functions_are_looked_at_in_states_of_the_seed():
    asked: set[tuple[float, ...]] = set()

    def M(q):
        asked.add(tuple(q))
        return np.eye(len(q))

    def drawn(seed: int) -> set[tuple[float, ...]]:
        asked.clear()
        EquationsTarget(testing.EquationsOfMotion(2, M=M)).results(1, seed)
        return set(asked)

    assert drawn(7) == drawn(7)
    assert drawn(7) - drawn(8)


def test_functions_have_a_test_for_each_claim(session, pytester):
    shown(pytester, "test_cart.py")
    pytester.makepyfile(cart=CART)
    result = session(FEW, "test_cart.py")
    assert {"mass-matrix-symmetric", "bias-of-energy"} <= ids(result, "passed")
    assert ids(result, "passed") | ids(result, "skipped") == set(testing.FUNCTION_CLAIMS)
    result.stdout.fnmatch_lines(["SKIPPED *: coriolis-bias does not apply to cart, without C"])


@pytest.mark.night
def test_a_mistake_in_a_function_fails_by_name(session, pytester):
    assert CART.count("np.array([pull,") == 1
    shown(pytester, "test_cart.py")
    pytester.makepyfile(cart=CART.replace("np.array([pull,", "np.array([-pull,"))
    change(pytester, "test_cart.py", ("(CART)", "(CART, expected_failures='known.txt')"))
    (pytester.path / "known.txt").write_text("bias-power known\nbias-of-enregy known\n")
    result = session(FEW, "test_cart.py")
    assert {"bias-of-energy", "expected-failures"} <= ids(result, "failed")
    assert "mass-matrix-symmetric" in ids(result, "passed")
    result.stdout.fnmatch_lines(
        [
            "bias-of-energy ?bias ~ T? failed on cart: *row q?0?: wrong sign)",
            "XFAIL *bias-power* known",
        ]
    )


def test_functions_are_compared_with_a_scene(session, pytester):
    code = """
    from eomcheck.scenes import ChainPendulum
    from eomcheck.testing import EquationsOfMotion, parametrize_with_claims
    import numpy as np

    ROD = EquationsOfMotion(1, M=lambda q: [[WHAT]], bias=lambda q, v: [0.0])

    @parametrize_with_claims(ROD, against=ChainPendulum.rods(1))
    def test_rod(check):
        check()
    """
    for what, failed in (("1 / 3", set()), ("1 / 4", {"reference"})):
        pytester.makepyfile(test_rod=code.replace("WHAT", what))
        assert ids(session(FEW, "test_rod.py"), "failed") == failed


# ---- The plug-in ---------------------------------------------------------------------------------


def test_the_plug_in_is_the_one_that_pytest_finds():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["entry-points"]["pytest11"] == {"eomcheck": PLUGIN}


def test_the_plug_in_imports_nothing_but_pytest():
    code = (
        "import sys, pytest; before = set(sys.modules); "
        f"import {PLUGIN}; print(*sorted(set(sys.modules) - before))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["eomcheck", "eomcheck.deprecated", PLUGIN]


# ---- hypothesis ----------------------------------------------------------------------------------

SLOW = """
import time
from hypothesis import given, settings, strategies as st
from eomcheck import testing

settings.load_profile("default")  # which has a deadline, as that of CI has not
taken = iter([0.5])

@testing.settings
@given(st.integers())
def test_slow(x):
    time.sleep(next(taken, 0))

@settings(testing.settings, max_examples=3)
@given(st.integers())
def test_few(x):
    pass
"""


@pytest.mark.night
def test_the_test_with_hypothesis_that_is_shown_passes_and_finds_a_wrong_sign(session, pytester):
    page = (SHOWN.parent / "in-your-ci.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```$", page, re.S | re.M)
    assert block.count("[-sin") == block.count("@settings\n") == 1
    quick = "from hypothesis import Phase, settings as of\n@of(settings, phases=[Phase.generate])\n"
    wrong = block.replace("[-sin", "[sin").replace("@settings\n", quick)
    pytester.makepyfile(test_right=block, test_wrong=wrong)
    result = pytester.runpytest_subprocess("test_right.py", "test_wrong.py")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["FAILED test_wrong.py::test_my_solver*"])


@pytest.mark.night
def test_the_settings_allow_a_first_case_that_takes_long(session, pytester):
    pytester.makepyfile(test_slow=SLOW)
    pytester.runpytest_subprocess("test_slow.py").assert_outcomes(passed=2)
    without = SLOW.replace("@testing.settings\n", "")
    pytester.makepyfile(test_slow=without)
    pytester.runpytest_subprocess("test_slow.py").assert_outcomes(passed=1, failed=1)


def test_a_scene_of_its_own_is_judged_where_there_is_no_engine():
    from eomcheck.testing.suite import SceneTarget

    trial = SceneTarget("rods", ChainPendulum.rods(2), None)
    verdicts = {id: one.verdict for id, one in trial.results(2, 0).items()}
    assert verdicts["kinetic-energy"] == verdicts["equivalence"] == "passed"
    assert "failed" not in verdicts.values()


# ---- One more engine -----------------------------------------------------------------------------

KANES = Path(__file__).with_name("kanes.py").read_text(encoding="utf-8")
RUN = "from eomcheck.cli import main; main()"


def kanes(pytester: pytest.Pytester, old: str = "", new: str = "") -> pytest.RunResult:
    """Check an adapter of SymPy in an empty repository, by path on the command line."""
    pytest.importorskip("sympy")
    for name in ("by_hand.py", "test_by_hand.py"):
        (pytester.path / name).unlink()
    assert KANES.count(old) == 1 or not old
    pytester.makepyfile(kanes=KANES.replace(old, new) if old else KANES)
    asked = "validate", "--engine", "kanes.py:Kanes", "--links", "1..3", "--examples", "6"
    return pytester.run(sys.executable, "-c", RUN, *asked)


@pytest.mark.night
def test_an_adapter_of_60_lines_is_checked_by_path_and_by_pytest(session, pytester):
    assert len(KANES.splitlines()) <= 60
    found = kanes(pytester)
    assert found.ret == 0
    found.stdout.fnmatch_lines(["* claims passed*", "passed: *generalized-forces*"])
    pytester.makepyfile(
        test_kanes="""
        from kanes import Kanes
        from eomcheck.testing import parametrize_with_claims

        @parametrize_with_claims(Kanes)
        def test_kanes(check):
            check()
        """
    )
    passed = ids(session(FEW), "passed")
    terms = "mass-matrix", "bias", "generalized-forces"
    assert passed == {f"{term}-chain-pendulum" for term in terms}


@pytest.mark.night
def test_a_mistake_in_an_adapter_is_named_on_the_command_line(session, pytester):
    found = kanes(pytester, "return -self.of(1", "return self.of(1")
    assert found.ret == 1
    found.stdout.fnmatch_lines(["bias ?kanes? failed*sign"])

"""Code that changes how doubles are rounded: it fails by name, and the rest goes on as before."""

from __future__ import annotations

import ctypes
import platform
import sys
from collections.abc import Callable

import numpy as np
import pytest

from eomcheck import check_state, enclose
from eomcheck.calls import (
    FLUSHING,
    ROUNDING,
    call,
    environment_change,
    restore_environment,
)
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.errors import CallError, EngineError
from eomcheck.numbers.ball import precision
from eomcheck.scenes import ChainPendulum
from eomcheck.testing import check_functions

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64",
    reason="how the environment is changed is known for this machine alone",
)

CONTROL = 28
"""Place of the control word of SSE in what fegetenv stores."""

MODES = {"down": 1 << 13, "up": 1 << 14, "to zero": 3 << 13}
FLUSHED = {"results": 1 << 15, "operands": 1 << 6}
ALL = [*((x, ROUNDING) for x in MODES.values()), *((x, FLUSHING) for x in FLUSHED.values())]


def change(bits: int) -> None:
    """Set bits of the control word of this thread."""
    library, stored = ctypes.CDLL(None), ctypes.create_string_buffer(64)
    library.fegetenv(stored)
    control = ctypes.c_uint32.from_buffer(stored, CONTROL)
    control.value |= bits
    library.fesetenv(stored)


@pytest.fixture(autouse=True)
def default():
    yield
    restore_environment()


@pytest.mark.parametrize(("bits", "what"), ALL)
def test_each_change_is_seen_and_restored(bits: int, what: str):
    assert environment_change() == ""
    change(bits)
    assert environment_change() == what
    restore_environment()
    assert environment_change() == ""


@pytest.mark.parametrize(("bits", "what"), ALL)
def test_a_call_that_changes_arithmetic_is_a_failure_of_its_function(bits: int, what: str):
    with pytest.raises(CallError, match=f"^Engine.bias {what}$"):
        call("Engine.bias", change, bits)
    assert environment_change() == ""


def test_nothing_is_blamed_for_what_was_changed_before_it_or_by_an_import():
    change(MODES["up"])
    assert call("Engine.bias", lambda: 0.1 + 0.2) == 0.30000000000000004
    assert call("import", lambda: change(FLUSHED["results"]), slow=True) is None
    assert environment_change() == ""


def test_a_call_that_raises_and_changes_arithmetic_is_reported_for_both():
    def both() -> None:
        change(MODES["down"])
        raise KeyError

    with pytest.raises(CallError, match=f"^Engine.bias {ROUNDING} and raised KeyError$") as caught:
        call("Engine.bias", both)
    assert type(caught.value.__cause__) is KeyError
    assert environment_change() == ""
    with pytest.raises(KeyError):
        call("import", both, slow=True)
    assert environment_change() == ""


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (SystemExit(3), f"own.f {ROUNDING} and raised SystemExit: 3"),
        (
            CallError("own.f", "gave no answer in 60 s"),
            f"own.f {ROUNDING} and gave no answer in 60 s",
        ),
        (EngineError("no library"), "no library"),
        (KeyboardInterrupt("now"), "now"),
    ],
)
def test_how_a_call_ended_is_reported_beside_changed_arithmetic(error: BaseException, text: str):
    def both() -> None:
        change(MODES["up"])
        raise error

    with pytest.raises(BaseException) as caught:
        call("own.f", both)
    assert str(caught.value) == text
    assert environment_change() == ""


def function_of(bits: int) -> Callable:
    def M(q):
        change(bits)
        return np.array([[2.0 + np.cos(q[0])]])

    return M


def test_a_function_that_raises_and_changes_arithmetic_fails_for_both():
    def qdd(q, v):
        change(MODES["up"])
        raise ValueError("x")

    (failed,) = [x for x in check_functions(1, qdd=qdd, states=1) if x.verdict == "failed"]
    assert failed.detail.endswith(f"qdd {ROUNDING} and raised ValueError: x")


@pytest.mark.parametrize(("bits", "what"), [ALL[1], ALL[3]])
def test_a_function_that_changes_arithmetic_fails_by_name(bits: int, what: str):
    found = check_functions(1, M=function_of(bits), gravity=lambda q: np.sin(q))
    failed = [one for one in found if one.verdict == "failed"]
    assert failed
    assert all(what in one.detail and "M" in one.detail for one in failed)


class Upward(CasadiEngine):
    key = "upward"

    def bias(self, q, v, t=0.0):
        change(MODES["up"])
        return super().bias(q, v, t)


def test_an_engine_that_changes_arithmetic_fails_and_machine_code_does_not():
    scene = ChainPendulum.rods(2)
    q, v = np.array([0.3, -0.4]), np.array([1.0, 0.5])
    claims = ["mass-matrix", "bias", "machine-code"]
    found = check_state(scene, q, v, engines=[Upward], claims=claims)
    failed = {(one.claim, one.subject) for one in found if one.verdict == "failed"}
    assert ("bias", "upward") in failed
    assert {subject for _, subject in failed} == {"upward"}
    assert all(ROUNDING in one.detail for one in found if one.verdict == "failed")
    assert "passed" in {one.verdict for one in found if one.claim == "machine-code"}


def test_the_text_of_an_enclosure_does_not_depend_on_the_precision_of_other_threads():
    found = enclose(ChainPendulum.rods(1), "gw", [0.3], v=[1.0])
    text = repr(found)
    assert text.startswith("Enclosure(vdot=[[-14.0577764374833 +/- ")
    with precision(300):
        assert repr(found) == text
    with precision(20):
        assert repr(found) == text

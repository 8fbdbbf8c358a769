"""The exceptions of eomcheck: bad input is an `InputError`, an honest "cannot" a `RefusedError`."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from eomcheck.safe_output import printable

if TYPE_CHECKING:
    from traceback import FrameSummary

    import numpy as np


T = TypeVar("T")

LONGEST = 900
"""Characters of a message; of a longer one the beginning and the end are shown."""


def one_line(text: str) -> str:
    """One line of a text, without control characters and without the middle of a long one."""
    if len(text) > LONGEST:
        text = f"{text[: 2 * LONGEST // 3]} ... {text[-LONGEST // 3 :]}"
    return printable(" ".join(text.split()))


def message_of(error: BaseException) -> str:
    """The message of an exception in one line, "" without one, also where its `__str__` raises."""
    try:
        text = str(error)
    except KeyboardInterrupt:
        raise
    except BaseException as broken:
        return f"its text cannot be read: __str__ raises {type(broken).__name__}"
    return one_line(text)


def described_error(error: BaseException) -> str:
    """The type and the message of an exception: "KeyError: 'x'"."""
    text, kind = message_of(error), one_line(type(error).__name__)
    return f"{kind}: {text}" if text else kind


class EomcheckError(Exception):
    """Base of every exception that eomcheck raises on purpose."""

    def __reduce__(self):
        # As usual, but without calling __init__, which may want more than the message: an exception
        # that cannot be read back breaks the pool of processes that it comes from.
        return type(self).__new__, (type(self), *self.args), self.__dict__

    def __str__(self):
        # One sentence on one line, however the values in it are printed.
        return one_line(super().__str__())


class CallError(Exception):
    """A call of code outside this package ended otherwise than by an answer or an Exception.

    Attributes:
        name: of the function, such as "Engine.bias".
        what: how it ended: "raised SystemExit: 0", "gave no answer in 60 s".
    """

    def __init__(self, name: str, what: str):
        self.name, self.what = name, what
        super().__init__(name, what)

    def __str__(self):
        return f"{self.name} {self.what}"


class InputError(EomcheckError, ValueError):
    """Something handed in is not valid; the message names it, its value and what is allowed."""


class UnwrittenError(InputError):
    """A file that cannot be written, or not to its end: results go elsewhere first."""


class UnknownNameError(InputError):
    """A name that is not in a registry."""

    def __init__(self, kind: str, name: object, known: Iterable[str]):
        self.kind, self.name, self.known = kind, name, tuple(known)
        hint = did_you_mean(name, self.known)
        super().__init__(f"unknown {kind} {name!r}{hint}; known: {', '.join(self.known)}")


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Return a hint at the name that looks most like one that is not known, "" if none does.

    Dashes before an option say nothing about how alike two are.
    """
    from difflib import get_close_matches

    lower = {one.lower().lstrip("-"): one for one in known}
    near = get_close_matches(str(name).lower().lstrip("-"), lower, 1, 0.65)
    return f" (did you mean {lower[near[0]]!r}?)" if near else ""


def raised(error: BaseException, at: FrameSummary | None) -> str:
    """Describe an exception and the line: "raised KeyError: 'x' (own.py, line 3)".

    Of a `CallError` it is how the call ended; without `at` there is no line.
    """
    what = error.what if isinstance(error, CallError) else f"raised {described_error(error)}"
    return what if at is None else f"{what} ({Path(at.filename).name}, line {at.lineno})"


def registered(kind: str, name: object, registry: Mapping[str, T]) -> T:
    """Return what `registry` holds under `name`.

    Raises:
        UnknownNameError: nothing.
    """
    if not isinstance(name, str) or name not in registry:
        raise UnknownNameError(kind, name, registry)
    return registry[name]


def distinct(kind: str, names: Iterable[T]) -> tuple[T, ...]:
    """Return the names given, each once.

    Raises:
        InputError: they are no list of names.
    """
    try:
        if isinstance(names, str):
            raise TypeError
        return tuple(dict.fromkeys(names))
    except TypeError:
        raise InputError(f"{kind} = {names!r}, expected a list of names") from None


def at_least_one(kind: str, names: Iterable[T]) -> tuple[T, ...]:
    """The names given, each once, at least one.

    Raises:
        InputError: they are no list of names, or an empty one, with which nothing is checked.
    """
    found = distinct(kind, names)
    if not found:
        raise InputError(f"{kind} = {names!r} names nothing, expected at least one name")
    return found


MOST_COUNTED = 10**9
"""Largest number of examples, states, points and the like."""


def whole_number(name: str, value: Any, least: int | None = 1, most: int | None = None) -> int:
    """Return a whole number as an int.

    Raises:
        InputError: it is none, below `least` or above `most`.
    """
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not whole or (least is not None and value < least):
        bound = "" if least is None else f" of at least {least}"
        raise InputError(f"{name} = {safe_repr(value)}, expected a whole number{bound}")
    number = int(value)
    if most is not None and number > most:
        raise InputError(f"{name} = {safe_repr(value)}, expected at most {most}")
    return number


def safe_repr(value: Any) -> str:
    """The repr of a value that was handed in, in one line, also where its `__repr__` raises.

    Of whole numbers that are longer than Python prints, the number of their bits.
    """
    try:
        return one_line(repr(value))
    except Exception as error:
        if isinstance(value, int):
            return f"a number of {value.bit_length()} bits"
        return f"a {one_line(type(value).__name__)} whose __repr__ raises {type(error).__name__}"


class InconsistentVelocityError(InputError):
    """A velocity that violates the constraints a v + b = 0 by more than rounding explains."""


class EngineError(EomcheckError):
    """An outside library is missing or cannot represent the scene."""


def required(module: str, extra: str | None = None) -> Any:
    """Import and return an outside library.

    Raises:
        EngineError: it is not installed; it comes with our extra of this name.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        hint = "" if extra is None else f"; it comes with the extra `{extra}`"
        raise EngineError(f"the library {module!r} is not installed ({error}){hint}") from None


class WorkerError(EomcheckError):
    """A process or machine that was given work did not return it; the rest is done and safe."""


class DiedError(WorkerError):
    """A process that was given work died, or a scheduler was left without any."""


class RefusedError(EomcheckError, ArithmeticError):
    """A formulation declines a state instead of returning digits that mean nothing.

    Attributes:
        what: name of the matrix or divisor that stands in the way.
        rcond: its reciprocal condition number (for a divisor: its magnitude).
        threshold: the value that `rcond` would have to exceed.
        matrix: the matrix that was to be solved, or its bands; None where a divisor was refused.
    """

    def __init__(
        self, what: str, rcond: float, threshold: float, why: str, matrix: np.ndarray | None = None
    ):
        self.what, self.rcond, self.threshold, self.matrix = what, rcond, threshold, matrix
        super().__init__(why)

"""Exceptions of eomcheck, and one-line descriptions of exceptions and values.

All derive from `EomcheckError`: invalid arguments are an `InputError`, a state that a formulation
declines as ill-conditioned a `RefusedError`. A `CallError` is no `EomcheckError`: it reports how a
call of outside code ended. Messages have one line, whatever the values in them print.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Container, Iterable, Mapping
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from eomcheck.safe_output import printable

if TYPE_CHECKING:
    from traceback import FrameSummary

    import numpy as np


T = TypeVar("T")

LONGEST = 900
"""Longest message, characters; a longer one is shown without its middle."""


def one_line(text: str) -> str:
    """Return a text in one line, without control characters and the middle of a long text."""
    if len(text) > LONGEST:
        text = f"{text[: 2 * LONGEST // 3]} ... {text[-LONGEST // 3 :]}"
    return printable(" ".join(text.split()))


def message_of(error: BaseException) -> str:
    """Return the message of an exception in one line, also if its `__str__` raises; "" if none."""
    try:
        text = str(error)
    except KeyboardInterrupt:
        raise
    except BaseException as broken:
        return f"its text cannot be read: __str__ raises {type(broken).__name__}"
    return one_line(text)


def described_error(error: BaseException) -> str:
    """Return the type and the message of an exception: "KeyError: 'x'"."""
    text, kind = message_of(error), one_line(type(error).__name__)
    return f"{kind}: {text}" if text else kind


class EomcheckError(Exception):
    """Base of every exception that eomcheck raises on purpose."""

    def __reduce__(self):
        # Without calling __init__, which may take more than the message: an exception that cannot
        # be unpickled breaks the process pool that it comes from.
        return type(self).__new__, (type(self), *self.args), self.__dict__

    def __str__(self):
        # One line, however the values in it are printed.
        return one_line(super().__str__())


class CallError(Exception):
    """A call of code outside this package ended otherwise than by an answer or an Exception.

    Attributes:
        name: name of the function, such as "Engine.bias".
        what: description of its end: "raised SystemExit: 0", "gave no answer in 60 s".
    """

    def __init__(self, name: str, what: str):
        self.name, self.what = name, what
        super().__init__(name, what)

    @property
    def by_exception(self) -> bool:
        """Whether the call raised an exception, and so did answer."""
        return self.what.startswith(_RAISED)

    @property
    def text(self) -> str:
        """Description of its end where the call is named before it: "SystemExit: 0"."""
        return self.what.removeprefix(_RAISED)

    def __str__(self):
        return f"{self.name} {self.what}"


_RAISED = "raised "


class RemoteError(CallError):
    """A call in a process of its own raised an Exception there."""


class InputError(EomcheckError, ValueError):
    """An invalid argument; the message names it, its value and the allowed values."""


class UnwrittenError(InputError):
    """A file that cannot be written completely; results are first written elsewhere."""


class UnknownNameError(InputError):
    """A name that is not in a registry."""

    def __init__(self, kind: str, name: object, known: Iterable[str]):
        self.kind, self.name, self.known = kind, name, tuple(known)
        hint = did_you_mean(name, self.known)
        super().__init__(f"unknown {kind} {name!r}{hint}; known: {', '.join(self.known)}")


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Return a hint at the known name most similar to an unknown one, "" if none is similar.

    Leading dashes of options are ignored in the comparison.
    """
    near = nearest_name(name, known)
    return f" (did you mean {near!r}?)" if near else ""


def nearest_name(name: object, known: Iterable[str]) -> str:
    """Return the known name most similar to another one, "" if none is similar."""
    from difflib import get_close_matches

    lower = {one.lower().lstrip("-"): one for one in known}
    near = get_close_matches(str(name).lower().lstrip("-"), lower, 1, 0.65)
    return lower[near[0]] if near else ""


def raised(error: BaseException, at: FrameSummary | None) -> str:
    """Describe an exception and its line: "raised KeyError: 'x' (own.py, line 3)".

    A `CallError` is described by the end of its call; without `at` no line is named.
    """
    what = error.what if isinstance(error, CallError) else f"raised {described_error(error)}"
    return located(what, at)


_LOCATED = re.compile(r"\(.+, line \d+\)$")


def located(what: str, at: FrameSummary | None) -> str:
    """Append the line of a frame, "(own.py, line 3)", to a text that names none yet."""
    if at is None or _LOCATED.search(what):
        return what
    return f"{what} ({Path(at.filename).name}, line {at.lineno})"


def innermost_outside(
    frames: Iterable[FrameSummary], own: Container[str] = ()
) -> FrameSummary | None:
    """Return the innermost frame of code that is neither of this package nor installed.

    Args:
        frames: frames, the outermost first.
        own: files that count as outside wherever they are.
    """
    from sysconfig import get_paths

    inside = [Path(x) for name, x in get_paths().items() if name not in ("scripts", "data")]
    inside.append(Path(__file__).parent)
    outside = None
    for at in frames:
        file = Path(at.filename)
        known = at.filename.startswith("<") or "site-packages" in file.parts
        if at.filename in own or not (known or any(map(file.is_relative_to, inside))):
            outside = at
    return outside


def registered(kind: str, name: object, registry: Mapping[str, T]) -> T:
    """Return the entry `name` of `registry`.

    Raises:
        UnknownNameError: there is no such entry.
    """
    if not isinstance(name, str) or name not in registry:
        raise UnknownNameError(kind, name, registry)
    return registry[name]


def distinct(kind: str, names: Iterable[T]) -> tuple[T, ...]:
    """Return the names, each once, in their order.

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
    """Return the names, each once and at least one.

    Raises:
        InputError: they are no list of names, or an empty one, with which nothing is checked.
    """
    unique = distinct(kind, names)
    if not unique:
        raise InputError(f"{kind} = {names!r} names nothing, expected at least one name")
    return unique


MOST_COUNTED = 10**9
"""Largest allowed number of examples, states, points and the like."""


def whole_number(name: str, value: Any, least: int | None = 1, most: int | None = None) -> int:
    """Return a whole number as an int, checked against its bounds.

    Raises:
        InputError: `value` is no whole number, is below `least` or above `most`.
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
    """Return the repr of a value in one line, also if its `__repr__` raises.

    Integers longer than Python's limit for printing are described by their number of bits.
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
        EngineError: it is not installed; the message names `extra`, the extra that installs it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        hint = "" if extra is None else f"; it comes with the extra `{extra}`"
        raise EngineError(f"the library {module!r} is not installed ({error}){hint}") from None


class WorkerError(EomcheckError):
    """A worker process or machine did not return its task; other results are done and safe."""


class DiedError(WorkerError):
    """A worker process died, or a scheduler was left without workers."""


class RefusedError(EomcheckError, ArithmeticError):
    """A formulation declines an ill-conditioned state instead of returning meaningless digits.

    Attributes:
        what: name of the matrix or divisor that is singular to working precision.
        rcond: its reciprocal condition number (for a divisor: its magnitude).
        threshold: the value that `rcond` has to exceed.
        matrix: the matrix of the linear system, or its bands; None if a divisor was refused.
    """

    def __init__(
        self, what: str, rcond: float, threshold: float, why: str, matrix: np.ndarray | None = None
    ):
        self.what, self.rcond, self.threshold, self.matrix = what, rcond, threshold, matrix
        super().__init__(why)

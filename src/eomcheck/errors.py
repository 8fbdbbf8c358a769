"""The exceptions of eomcheck: bad input is an `InputError`, an honest "cannot" a `RefusedError`."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from traceback import FrameSummary

    import numpy as np


T = TypeVar("T")


class EomcheckError(Exception):
    """Base of every exception that eomcheck raises on purpose."""

    def __reduce__(self):
        # As usual, but without calling __init__, which may want more than the message: an exception
        # that cannot be read back breaks the pool of processes that it comes from.
        return type(self).__new__, (type(self), *self.args), self.__dict__

    def __str__(self):
        # One sentence on one line, however the values in it are printed.
        return " ".join(super().__str__().split())


class InputError(EomcheckError, ValueError):
    """Something handed in is not valid; the message names it, its value and what is allowed."""


class UnknownNameError(InputError):
    """A name that is not in a registry."""

    def __init__(self, kind: str, name: object, known: Iterable[str]):
        self.kind, self.name, self.known = kind, name, tuple(known)
        hint = did_you_mean(name, self.known)
        super().__init__(f"unknown {kind} {name!r}{hint}; known: {', '.join(self.known)}")


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Return a hint at the name that looks most like one that is not known, "" if none does."""
    from difflib import get_close_matches

    lower = {one.lower(): one for one in known}
    near = get_close_matches(str(name).lower(), lower, 1, 0.61)
    return f" (did you mean {lower[near[0]]!r}?)" if near else ""


def raised(error: BaseException, at: FrameSummary) -> str:
    """Return what was raised, and in which line: "raised KeyError: 'x' (own.py, line 3)"."""
    text = " ".join(str(error).split())
    what = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return f"raised {what} ({Path(at.filename).name}, line {at.lineno})"


def named(kind: str, name: object, registry: Mapping[str, T]) -> T:
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


def whole_number(name: str, value: Any, least: int | None = 1) -> int:
    """Return a whole number as an int.

    Raises:
        InputError: it is none, or below `least`.
    """
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not whole or (least is not None and value < least):
        bound = "" if least is None else f" of at least {least}"
        raise InputError(f"{name} = {value!r}, expected a whole number{bound}")
    return int(value)


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

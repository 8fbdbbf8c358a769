"""What the functions answer: each call looked at, and a failure named with its function."""

from __future__ import annotations

from contextlib import suppress
from inspect import Parameter, signature
from math import isfinite
from typing import Any

import numpy as np

from eomcheck.calls import call
from eomcheck.engines import EngineFault
from eomcheck.errors import CallError, described_error
from eomcheck.numbers.generic import Array
from eomcheck.testing.subject import INPUTS, MAY_READ_MORE, Functions


class BrokenError(Exception):
    """A function did not answer with finite numbers of the right shape.

    Attributes:
        name: of the function, a key of `INPUTS`.
        why: what is wrong, in words.
    """

    def __init__(self, name: str, why: str):
        self.name, self.why = name, why
        super().__init__(f"{name}: {why}")


class Answers:
    """The functions, called with copies of what they read.

    Args:
        functions: the functions.
    """

    def __init__(self, functions: Functions):
        self.functions = functions
        self.sizes: dict[str, int] = {"n": functions.n, "p": functions.p}
        self.single: dict[str, str] = {}
        """Names of functions that answered in single precision or less, and their type."""
        self._reads: dict[str, str] = {}
        self._shapes: dict[str, tuple[int, ...]] = {}
        self.changed: set[str] = set()
        """Names of functions that wrote into what they were handed."""
        self.repeated: set[str] = set()
        """Names of functions that were called again and again at one state."""
        self.told: set[str] = set()
        """Names of functions that do not answer somewhere, with the reason in a Finding."""

    def reads(self, name: str) -> str:
        """Return what a function is called with, a letter an argument: "q", "qv", "t" or "qt"."""
        if name not in self._reads:
            more = name in MAY_READ_MORE and _arguments(self.functions.function(name)) == 2
            self._reads[name] = MAY_READ_MORE[name] if more else INPUTS[name].reads
        return self._reads[name]

    def __call__(self, name: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return what the function `name` answers at (q, v, t), called with what it reads.

        Raises:
            BrokenError: an exception inside, no array of numbers, of wrong shape, or not finite.
        """
        function, make = self.functions.function(name), self.functions.array
        assert function is not None
        handed = {"q": q.copy(), "v": v.copy()}
        arrays: dict[str, Any] = handed if make is None else {x: make(y) for x, y in handed.items()}
        given = {**arrays, "t": t}
        arguments = [given[letter] for letter in self.reads(name)]
        before = [] if make is None else _bytes(arrays)
        try:
            answer = call(f"{self.functions.name}: {name}", function, *arguments)
        except EngineFault as fault:
            raise BrokenError(name, fault.what) from fault
        except CallError as error:
            raise BrokenError(name, error.what.removeprefix("raised ")) from error
        except Exception as error:
            what = described_error(error)
            # As PyTorch says of an array of NumPy.
            hint = "; say array=torch.as_tensor" if make is None and "Tensor" in what else ""
            raise BrokenError(name, what + hint) from error
        finally:
            written = handed["q"].tobytes() != q.tobytes() or handed["v"].tobytes() != v.tobytes()
            if written or (make is not None and _bytes(arrays) != before):
                self.changed.add(name)
        return self._checked(name, answer)

    def _checked(self, name: str, answer: Any) -> Array:
        if type(answer) is np.ndarray and answer.dtype == np.float64:
            array = answer.copy()
        else:
            array = self._read(name, answer)
        array = self._shaped(name, array)
        # Of a single number NumPy's own `all` takes longer than the rest.
        finite = np.isfinite(array).all() if array.ndim else isfinite(array.item())
        if not finite:
            where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
            entry = f"{name}{list(where)}" if where else name
            raise BrokenError(name, f"{entry} = {array[where]}, expected a finite number")
        return array

    def _read(self, name: str, answer: Any) -> Array:
        """The numbers of an answer of whatever kind, in doubles."""
        if answer is None:
            raise BrokenError(name, "answers None, expected an array of numbers")
        try:
            raw = np.asarray(_plain(answer))
            if np.ma.is_masked(answer):
                raise BrokenError(name, "answers a masked array, of which entries are masked")
            if raw.dtype.kind == "c":
                raise BrokenError(
                    name, "answers complex numbers, expected an array of real numbers"
                )
            if raw.dtype.kind not in "fiuO":
                raise TypeError
            array = np.array(raw, np.float64)
        except OverflowError:
            raise BrokenError(name, "answers a number that is too large for a double") from None
        except (TypeError, ValueError, RuntimeError):
            what = f"answers {_type_of(answer)}, expected an array of numbers"
            raise BrokenError(name, what) from None
        if raw.dtype.kind == "f" and raw.dtype.itemsize < 8:
            self.single[name] = str(raw.dtype)
        return array

    def _shaped(self, name: str, array: Array) -> Array:
        if array.shape == self._shapes.get(name):
            return array
        symbols = INPUTS[name].shape
        if "r" in symbols and "r" not in self.sizes and array.ndim >= 1:
            self.sizes["r"] = array.shape[0]
        shape = tuple(self.sizes.get(x, 1) for x in symbols)
        # A column, or a number in an array, as lambdified SymPy answers.
        if len(shape) < 2 and array.shape in ((*shape, 1), (1, 1)) and array.size == np.prod(shape):
            return array.reshape(shape)
        if array.shape != shape:
            raise BrokenError(name, f"answers an array of shape {array.shape}, expected {shape}")
        self._shapes[name] = shape
        return array


def _bytes(arrays: dict[str, Any]) -> list[bytes]:
    """Numbers in arrays of any library, as bytes; nothing of those that NumPy cannot read."""
    with suppress(TypeError, ValueError, RuntimeError):
        return [np.asarray(_plain(array)).tobytes() for array in arrays.values()]
    return []


def _type_of(answer: Any) -> str:
    """Type of an answer in words, with that of its entries where all are of one that is no number.

    "a list of str", "an array of bool".
    """
    kind = "an array" if isinstance(answer, np.ndarray) else f"a {type(answer).__name__}"
    entries = np.ravel(answer).tolist() if isinstance(answer, np.ndarray) else answer
    types = {type(x) for x in entries} if isinstance(entries, list | tuple) else set()
    if len(types) != 1 or types & {int, float, list, tuple}:
        return kind
    (of,) = types
    return f"{kind} of {of.__name__}"


PLAIN = np.ndarray, np.float64, float
"""Types of answers that NumPy reads as they are."""


def _plain(answer: Any) -> Any:
    """Return an answer without what NumPy cannot read: gradients, another device."""
    if type(answer) in PLAIN:
        return answer
    if isinstance(answer, list | tuple):
        return [_plain(one) for one in answer]
    for method in ("detach", "cpu"):
        answer = getattr(answer, method, lambda answer=answer: answer)()
    return answer


def _arguments(function: Any) -> int:
    """Return how many arguments must be given to a function, 1 where it does not tell."""
    try:
        found = signature(function).parameters.values()
    except (TypeError, ValueError):
        return 1
    positional = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
    return sum(x.kind in positional and x.default is Parameter.empty for x in found)

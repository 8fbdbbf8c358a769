"""What a scene prepares as a list of operations, so that those between angles and roots are moved.

Of a root of what nearly cancels, as of 1 - cos², the digits are lost before the root is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from eomcheck.kernels.moved import list_of
from eomcheck.numbers.contract import Angles, Array
from eomcheck.numbers.dual import Recorder
from eomcheck.numbers.float64 import FLOAT64
from eomcheck.numbers.lanes import LaneArray


@lru_cache(256)
def preparation(prepare: Callable) -> Callable[[Any, Array, Array], tuple[Any, tuple]]:
    """Return a function of (parameters, q, t), with t (1,), that can be listed.

    It returns what `prepare` does, and the angles and roots that were made on the way, in order.
    """

    def prepared(parameters: Any, q: Array, t: Array) -> tuple[Any, tuple]:
        recorder = Recorder(_Listing())
        return prepare(recorder, parameters, q, t[0]), tuple(recorder.made)

    return prepared


class _Listing:
    """The arithmetic of a list of operations (`eomcheck.numbers.contract.Arithmetic`)."""

    def numbers(self, x: Array) -> Array:
        """Return x as it is."""
        return x

    def angles(self, x: Array) -> Angles:
        """Return the angles x (k,), with cosines and sines that the list finds."""
        listed = list_of(x)
        if listed is None:
            return FLOAT64.angles(x)
        cos, sin = listed.group(_cos_and_sin, (2, *x.shape), x)
        return Angles(x, cos, sin)

    def root(self, x: Array) -> Array:
        """Return the positive square roots of x (k,), which the list finds."""
        listed = list_of(x)
        return (
            FLOAT64.root(FLOAT64.numbers(x)) if listed is None else listed.group(_root, x.shape, x)
        )


def _cos_and_sin(x: Any) -> Any:
    cos, sin = _rounded(np.cos, x), _rounded(np.sin, x)
    if isinstance(x, LaneArray):
        return LaneArray(np.stack((cos.data, sin.data)))
    return np.stack((cos, sin), axis=-2)


def _root(x: Any) -> Any:
    return _rounded(np.sqrt, x)


def _rounded(function: Callable, x: Any) -> Any:
    """Return the function of each entry, moved by the noise of the array if it has any."""
    with np.errstate(invalid="ignore"):
        lanes = isinstance(x, LaneArray)
        found: Any = LaneArray(function(x.data)) if lanes else function(np.asarray(x))
    return found if x.noise is None else x.noise.entries(found)

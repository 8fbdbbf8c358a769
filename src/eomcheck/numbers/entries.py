"""Arrays of objects and records of arrays, entry by entry."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np


def each(function: Callable[..., Any], *arrays: Any) -> np.ndarray:
    """Return function(x, ...) of every entry of arrays of one shape, as an array of objects."""
    out = np.empty(np.shape(arrays[0]), object)
    flat = (np.ravel(array) for array in arrays)
    out.ravel()[:] = [function(*entries) for entries in zip(*flat, strict=True)]
    return out


def map_record(function: Callable[..., Any], record: Any, *others: Any) -> Any:
    """Return a record with `function` applied to every part; what is absent stays absent.

    Args:
        function: of a part, and of the same part of `others`.
        record: arrays, and tuples of them.
        others: records with the same parts.
    """
    if record is None:
        return None
    if isinstance(record, tuple):
        parts = [map_record(function, *same) for same in zip(record, *others, strict=True)]
        return type(record)(*parts) if hasattr(record, "_fields") else tuple(parts)
    return function(record, *others)


def objects(record: Any) -> Any:
    """Return a record whose arrays hold objects, so that what is made like them can hold any."""
    return map_record(lambda part: np.asarray(part, object), record)

"""Messages between eomcheck and the process of an engine: framed JSON, then the bytes of arrays.

A message holds None, numbers, texts, arrays, lists, tuples, sets and dicts of these, and records:
named tuples of this package. Nothing in it is executed, and no version of NumPy matters.
"""

from __future__ import annotations

import importlib
import json
import math
import os
import struct
from collections.abc import Callable
from typing import Any

import numpy as np

HEAD = struct.Struct("<8sQQ")
"""Head of a message: `MAGIC`, the length of the JSON and that of all arrays, bytes."""
MAGIC = b"eomcheck"
LONGEST = 2**31
"""Longest message, bytes."""
OURS = "eomcheck."
"""Beginning of the modules whose records are sent."""


class ProtocolError(Exception):
    """Bytes that are no message, or a value that no message holds."""


def encoded(value: Any) -> bytes:
    """Return a message with a value.

    Raises:
        ProtocolError: a part of it is of another type.
    """
    arrays: list[np.ndarray] = []
    content = json.dumps([_plain(value, arrays), [[x.dtype.str, x.shape] for x in arrays]]).encode()
    blocks = [x.tobytes() for x in arrays]
    return b"".join([HEAD.pack(MAGIC, len(content), sum(map(len, blocks))), content, *blocks])


def decoded(read: Callable[[int], bytes]) -> Any:
    """Return the value of a message.

    Args:
        read: returns as many bytes, or raises an exception.

    Raises:
        ProtocolError: it is no message.
    """
    magic, length, size = HEAD.unpack(read(HEAD.size))
    if magic != MAGIC or length + size > LONGEST:
        raise ProtocolError(f"no message: {magic!r}")
    try:
        plain, kinds = json.loads(read(length))
        block, arrays = read(size), []
        for kind, shape in kinds:
            dtype, count = np.dtype(kind), math.prod(shape)
            arrays.append(np.frombuffer(block, dtype, count).reshape(shape).copy())
            block = block[count * dtype.itemsize :]
        return _value(plain, arrays)
    except (ValueError, TypeError, LookupError, AttributeError, ImportError) as error:
        raise ProtocolError(f"no message: {error}") from None


def read_bytes(pipe: int, size: int, wait: Callable[[], None] = lambda: None) -> bytes:
    """Return as many bytes of a pipe; EOFError where it is closed.

    Args:
        pipe: file descriptor.
        size: number of bytes.
        wait: called before each part is read.
    """
    parts = []
    while size:
        wait()
        part = os.read(pipe, size)
        if not part:
            raise EOFError
        parts.append(part)
        size -= len(part)
    return b"".join(parts)


def write_bytes(pipe: int, message: bytes, wait: Callable[[], None] = lambda: None) -> None:
    """Write a message to a pipe; `wait` is called before each part."""
    rest = memoryview(message)
    while rest:
        wait()
        rest = rest[os.write(pipe, rest) :]


def _plain(value: Any, arrays: list[np.ndarray]) -> Any:
    """Return a value as JSON has it; arrays are collected and numbered."""
    if value is None or type(value) in (bool, int, float, str):
        return value
    if hasattr(value, "__array__"):
        array = np.ascontiguousarray(value)
        if array.dtype.kind not in "biufc":
            raise ProtocolError(f"an array of {array.dtype}")
        arrays.append(array.reshape(np.shape(value)))
        return {"array": len(arrays) - 1}
    if isinstance(value, dict):
        return {"dict": [[_plain(x, arrays) for x in item] for item in value.items()]}
    if not isinstance(value, list | tuple | set | frozenset):
        raise ProtocolError(f"a value of type {type(value).__name__}")
    parts = [_plain(x, arrays) for x in value]
    kind = type(value)
    if hasattr(kind, "_fields"):
        if not kind.__module__.startswith(OURS):
            raise ProtocolError(f"a record {kind.__name__}")
        return {"record": [kind.__module__, kind.__qualname__], "parts": parts}
    return {kind.__name__: parts}


def _value(plain: Any, arrays: list[np.ndarray]) -> Any:
    """Return the value that JSON stands for."""
    if not isinstance(plain, dict):
        return plain
    if "array" in plain:
        return arrays[plain["array"]]
    if "dict" in plain:
        return {_value(x, arrays): _value(y, arrays) for x, y in plain["dict"]}
    if "record" in plain:
        module, name = plain["record"]
        if not module.startswith(OURS):
            raise ProtocolError(f"a record of {module}")
        kind = getattr(importlib.import_module(module), name)
        return kind._make(_value(x, arrays) for x in plain["parts"])
    ((name, parts),) = plain.items()
    kinds: dict[str, type] = {"list": list, "tuple": tuple, "set": set, "frozenset": frozenset}
    return kinds[name](_value(x, arrays) for x in parts)

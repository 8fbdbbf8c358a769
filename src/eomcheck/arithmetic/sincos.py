"""Cosines and sines together: compiled code calls the C library's `sincos` where it has one.

It reduces the angle once for both. Results are those of `cos` and `sin`.
"""

from __future__ import annotations

import ctypes
import math
import os
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types  # pyright: ignore[reportPrivateImportUsage]
from numba.core import cgutils
from numba.extending import intrinsic, overload, register_jitable

IN_C = os.name == "posix" and hasattr(ctypes.CDLL(None), "sincos")


def cos_sin(x):
    """Return (cos x, sin x), each (k,), of angles x (k,), rad."""
    return np.cos(x), np.sin(x)


@intrinsic
def _sincos_in_c(typingctx, x):
    def codegen(context, builder, signature, arguments):
        double = ir.DoubleType()
        kind = ir.FunctionType(ir.VoidType(), (double, double.as_pointer(), double.as_pointer()))
        function = cgutils.get_or_insert_function(builder.module, kind, "sincos")
        places = [cgutils.alloca_once(builder, double) for _ in range(2)]
        builder.call(function, (arguments[0], *places))
        both = [builder.load(place) for place in places]
        return context.make_tuple(builder, signature.return_type, both)

    return types.UniTuple(types.float64, 2)(types.float64), codegen


@register_jitable
def _sincos_apart(x):
    return math.sin(x), math.cos(x)


_sincos: Any = _sincos_in_c if IN_C else _sincos_apart


@overload(cos_sin)
def _compiled_cos_sin(x):
    def loop(x):
        both = np.empty((2, x.size))
        for i in range(x.size):
            both[1, i], both[0, i] = _sincos(x[i])
        return both[0], both[1]

    return loop

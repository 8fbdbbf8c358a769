"""Floating-point environment of this thread: rounding mode and subnormal numbers.

Error bounds assume rounding to nearest and gradual underflow. Code of a user's file or of an
outside library can change either (`fesetround`, or a library compiled with `-ffast-math`), for all
arithmetic that follows in its thread. `changed` detects that in a few operations, and `restore`
sets the default again.
"""

from __future__ import annotations

import ctypes
import sys
from contextlib import suppress

ONE, LITTLE = 1.0, 2.0**-60
SMALLEST = sys.float_info.min
"""The smallest normal number; half of it is subnormal."""

ROUNDING = "changes the floating-point rounding mode"
FLUSHING = "turns on flushing of subnormal numbers to zero"


def changed() -> str:
    """Return the change from the default environment: `ROUNDING`, `FLUSHING`, or ""."""
    nearest = ONE + LITTLE == ONE == ONE - LITTLE
    if nearest and SMALLEST * 0.5 > 0.0:
        return ""
    return FLUSHING if nearest else ROUNDING


def restore() -> None:
    """Restore the default floating-point environment."""
    # If the C library has no such function, a change is still reported.
    with suppress(OSError, TypeError, AttributeError, ValueError):
        library = ctypes.CDLL(None)
        apple = sys.platform == "darwin"
        address = ctypes.c_char.in_dll(library, "_FE_DFL_ENV") if apple else None
        default = ctypes.c_void_p(-1) if address is None else ctypes.byref(address)
        library.fesetenv(default)

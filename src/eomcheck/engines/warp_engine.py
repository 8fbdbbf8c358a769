"""`WarpEngine`: base class of engines whose library computes in Warp, in float32, on the CPU.

Warp compiles the kernels when they are first called, for minutes, and keeps them on the disk.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from eomcheck.engines.file_engine import capture_output
from eomcheck.engines.tree_engine import TreeEngine
from eomcheck.errors import required


class WarpEngine(TreeEngine):
    """Tree of rigid bodies in a library that computes in Warp."""

    unit_roundoff = 2.0**-24

    @classmethod
    def _warp(cls) -> Any:
        """Import and return Warp, which then writes errors alone."""
        warp = required("warp", cls.extra)
        warp.config.log_level = warp.LOG_ERROR
        return warp

    @classmethod
    def _library(cls) -> Any:
        with capture_output():  # Warp writes that there is no other device
            cls._warp().init()
            return super()._library()

    @contextmanager
    def _on_cpu(self) -> Iterator[None]:
        """Compute on the CPU also where there is another device."""
        with self._warp().ScopedDevice("cpu"):
            yield

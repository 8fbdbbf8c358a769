"""`JaxEngine`: base class of engines whose library computes in JAX.

JAX computes in float32 unless told otherwise: each library has an engine of either precision. Its
functions are compiled for seconds, once for each topology, and models are arguments of them.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from eomcheck.engines.file_engine import capture_output
from eomcheck.engines.tree_engine import TreeEngine
from eomcheck.errors import required

DOUBLE = 2.0**-53
"""Unit roundoff of float64."""


class JaxEngine(TreeEngine):
    """Tree of rigid bodies in a library that computes in JAX, in float32 by default."""

    unit_roundoff = 2.0**-24

    @classmethod
    def _library(cls) -> Any:
        # Their imports write that optional parts are missing, and warn of the future.
        with capture_output(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return super()._library()

    @contextmanager
    def _precision(self) -> Iterator[None]:
        """Compute in the numbers of this engine, without warnings."""
        jax = required("jax", self.extra)
        with jax.enable_x64(self.unit_roundoff == DOUBLE), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield

    def _computed(
        self,
        functions: Callable[[], dict[str, Callable[..., Any]]],
        name: str,
        *arguments: Any,
        **options: Any,
    ) -> Any:
        """Return the result of one of the functions of a library as NumPy's arrays."""
        with self._precision():
            result = functions()[name](*arguments, **options)
            return required("jax", self.extra).tree_util.tree_map(np.array, result)

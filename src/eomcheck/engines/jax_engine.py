"""`JaxEngine`: base class of engines whose library computes in JAX.

JAX computes in float32 unless told otherwise: each library has an engine of either precision. Its
functions are compiled for seconds, once for each topology, and models are arguments of them.
"""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, ClassVar

import numpy as np

from eomcheck.engines.file_engine import capture_output
from eomcheck.engines.tree_engine import TreeEngine
from eomcheck.errors import required
from eomcheck.numbers.generic import Array

DOUBLE = 2.0**-53
"""Unit roundoff of float64."""

SINGLE = 2.0**-24
"""Unit roundoff of float32."""


def derivatives_along(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return the derivatives of a function of a model, q, v and a third (n,), by forward mode.

    The result is a function of the same and of the derivative of the coordinates by the velocities
    (n_x, n): derivatives by q are along velocities. All are computed at once, as JAX compiles each
    function for long.
    """
    jax = required("jax", None)

    def derivatives(*arguments: Any) -> Any:
        *model, q, v, third, rates = arguments

        def moved(w: Any, *x: Any) -> Any:
            return function(*model, q + rates @ w, *x)

        return jax.jacfwd(moved, (0, 1, 2))(jax.numpy.zeros_like(v), v, third)

    return derivatives


class JaxEngine(TreeEngine):
    """Tree of rigid bodies in a library that computes in JAX, in float32 by default."""

    unit_roundoff = SINGLE

    @classmethod
    def _library(cls) -> Any:
        # Their imports write that optional parts are missing, and warn of the future.
        with capture_output(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return super()._library()

    @property
    def _dtype(self) -> type[np.floating[Any]]:
        """Type of its numbers."""
        return np.float64 if self.unit_roundoff == DOUBLE else np.float32

    @contextmanager
    def _precision(self) -> Iterator[None]:
        """Compute in the numbers of this engine, without warnings."""
        jax = required("jax", self.extra)
        with jax.enable_x64(self._dtype == np.float64), warnings.catch_warnings():
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


class JaxDynamics(JaxEngine):
    """Engine whose library has inverse and forward dynamics in JAX, with their derivatives.

    Its functions "inverse_derivatives" and "forward_derivatives" are made by `derivatives_along`.
    """

    @abstractmethod
    def _dynamics(self, name: str, q: Array, v: Array, third: Array, *more: Any) -> Any:
        """Return the result of a function under gravity, in the library's own order.

        Args:
            name: name of the function.
            q: coordinates.
            v: velocities.
            third: accelerations or forces (n,).
            more: further arguments of the function.
        """

    def _rates_at(self, q: Array) -> Array:
        """Return the derivative (n_x, n) of the library's coordinates by its velocities."""
        return np.eye(self._n)

    def _derivatives(self, name: str, q: Array, v: Array, third: Array) -> Iterator[Array]:
        parts = self._dynamics(name, q, v, third, self._rates_at(q))
        return map(self._in_tree_order, parts)

    def inverse_dynamics_derivatives(
        self, q: Array, v: Array, vdot: Array, t: float = 0.0
    ) -> tuple[Array, Array]:
        """Return ∂τ/∂q and ∂τ/∂v by `jax.jacfwd` of `inverse_dynamics`."""
        by_q, by_v, _ = self._derivatives("inverse_derivatives", q, v, vdot)
        return by_q, by_v

    def forward_dynamics_derivatives(
        self, q: Array, v: Array, tau: Array, t: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Return ∂v̇/∂q, ∂v̇/∂v and ∂v̇/∂τ by `jax.jacfwd` of `forward_dynamics`."""
        by_q, by_v, by_tau = self._derivatives("forward_derivatives", q, v, tau)
        return by_q, by_v, by_tau


class InFloat64:
    """Mixin of the engines of a library in float64, before the class of that in float32."""

    unit_roundoff: ClassVar[float] = DOUBLE

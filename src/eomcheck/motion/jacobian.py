"""Exact Jacobians of right-hand sides, for implicit integrators that take one (SciPy's).

The generic functions of the scene and of Kane's formulation run on CasADi symbols, and CasADi
differentiates the graph. Written for states (q, u): there the graph is O(N), and one 2 x 2 system
is all that is eliminated in it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from eomcheck.arithmetic.symbolic import Symbols
from eomcheck.errors import InputError
from eomcheck.formulations import Formulation
from eomcheck.model import Array, Scene
from eomcheck.quantities import Quantities


def exact_jacobian(scene: Scene, formulation: Formulation) -> Callable[[float, Array], Array]:
    """Return the function (t, y (n+p,)) -> ∂ẏ/∂y (n+p, n+p) of y = (q, u).

    Raises:
        InputError: the formulation does not sum over bodies, or does not integrate (q, u).
    """
    if (formulation.uses, formulation.state) != ("bodies", "q, u"):
        raise InputError(
            f"no exact Jacobian for {formulation.key}: only where (q, u) is integrated and bodies "
            "are summed over, as by kane"
        )
    symbols = Symbols()
    column, y = symbols.variables("y", scene.n + scene.p)
    time = symbols.casadi.SX.sym("t")
    at = Quantities(scene, symbols, y[: scene.n], time)
    at.u = y[scene.n :]
    rates = symbols.casadi.vertcat(*at.qdot, *formulation.solution(*at.bodies))
    matrix = symbols.casadi.densify(symbols.casadi.jacobian(rates, column))
    function = symbols.casadi.Function("jacobian", [time, column], [matrix])
    return lambda t, y: np.asarray(function(t, y))

"""Derivatives of accelerations and multipliers in machine code, for optimizers.

The acceleration by a formulation is traced on a tape, differentiated there by q, v and τ (forward
automatic differentiation, `eomcheck.numbers.tape.jacobian`), and compiled. Each matrix is factored
once: all columns of A x′ = b′ - A′ x are solved by the factors that gave x. Without constraints
that is ∂v̇ = -M⁻¹ ∂τ.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from eomcheck.console import slow_work_notice
from eomcheck.errors import InputError
from eomcheck.evaluation.derivatives import ARRAYS, Direction
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import Formulation, Partition, formulation_for
from eomcheck.formulations.formulation import Choice
from eomcheck.kernels.kernel import Kernel
from eomcheck.mechanics.scene import Scene, checked_scene, finite_array
from eomcheck.motion.right_hand_side import (
    Traced,
    block_of,
    choice_for,
    quantities_on,
    traced_kernel,
)
from eomcheck.numbers.generic import Array
from eomcheck.numbers.tape import Tape, jacobian


class CompiledResult(NamedTuple):
    """The acceleration of a state, or of k states, and its derivatives; NaN at singular matrices.

    Each array has k as its first axis if there are k states.
    """

    vdot: Array
    """v̇ (n,)."""
    multipliers: Array | None
    """λ (r,), or None if the formulation has none."""
    q: Array
    """∂v̇/∂q (n, n)."""
    v: Array
    """∂v̇/∂v (n, n)."""
    tau: Array
    """∂v̇/∂τ (n, n)."""
    multipliers_q: Array | None
    """∂λ/∂q (r, n), or None."""
    multipliers_v: Array | None
    """∂λ/∂v (r, n), or None."""
    multipliers_tau: Array | None
    """∂λ/∂τ (r, n), or None."""


def trace_derivatives(scene: Scene, formulation: Formulation, choice: Choice | None) -> Traced:
    """Trace the solution and its derivatives; the state is (q, v, τ) (3n,).

    Args:
        scene: the scene.
        formulation: the formulation.
        choice: choice of the partition, by default the paper's, with all constraints.
    """
    tape, n = Tape(), scene.n
    y = tape.inputs("y", (3 * n,))
    at = quantities_on(tape, scene, y[:n])
    at.v, at.tau = y[n : 2 * n], y[2 * n :]
    partition = None if choice is None else Partition.chosen(choice)
    parts = ("vdot", "multipliers"), at.solution(formulation, partition)
    values = {
        name: [tape.number(entry).index for entry in x]
        for name, x in zip(*parts, strict=True)
        if x is not None
    }
    together = [index for indices in values.values() for index in indices]
    rows = np.array(jacobian(tape, together, [x.index for x in y])).reshape(-1, 3, n)
    outputs = dict(values)
    for prefix, which in (("", slice(n)), ("multipliers_", slice(n, None))):
        if len(rows[which]):
            for i, part in enumerate(Direction._fields):
                outputs[prefix + part] = rows[which, i].ravel().tolist()
    return Traced(tape, at, y, outputs)


class CompiledDerivatives:
    """The derivatives of one scene by a formulation, a function in machine code.

    Not for two threads at once: they would share the block of memory with the parameters.

    Args:
        scene: the scene.
        formulation: the formulation.
        choice: choice of the partition, as for `trace_derivatives`.

    Attributes:
        kernel: the compiled function of t and (q, v, τ).
        block: its block of memory.
    """

    def __init__(self, scene: Scene, formulation: Formulation, choice: Choice | None = None):
        self.n, self.r = scene.n, scene.r if formulation.multipliers else 0
        self._made_of = scene, formulation.key, choice
        self.kernel: Kernel = derivatives_kernel(scene, formulation, choice)
        self.block = block_of(self.kernel, scene)
        self._time, self._state = np.zeros(1), np.zeros((3, self.n))
        self._flat = self._state.reshape(-1)
        outputs, self._views, start = np.zeros(self.kernel.size), dict[str, Array](), 0
        for name, size in self.kernel.outputs.items():
            self._views[name] = outputs[start : start + size].reshape(self._shape(name))
            start += size
        self._run = self.kernel.bound(self.block, self._time, self._flat, outputs)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how it is made again, compiled anew where it is unpickled."""
        return _made_again, self._made_of

    def __call__(self, q, v, tau=None, t: float = 0.0) -> CompiledResult:
        """Return v̇, λ and their derivatives at one state, or at k states by a loop in machine code.

        Args:
            q: coordinates (n,) or (k, n).
            v: velocities (n,) or (k, n).
            tau: generalized forces (n,) or (k, n) in addition to the scene's own; None for none.
            t: time, s.

        Raises:
            InputError: wrong shapes, values that are not finite.
        """
        if _is_plain(q, v, tau, t, (self.n,)):
            self._state[0], self._state[1] = q, v
            self._state[2] = 0.0 if tau is None else tau
            self._time[0] = t
            if np.isfinite(self._flat).all():
                self._run()
                copies = {name: view.copy() for name, view in self._views.items()}
                return CompiledResult(**NOTHING | copies)
        shape = np.shape(q)
        if len(shape) not in (1, 2) or shape[-1] != self.n:
            raise InputError(f"q has shape {shape}, expected ({self.n},) or (k, {self.n})")
        q, v = finite_array("q", q, shape), finite_array("v", v, shape)
        tau = np.zeros(shape) if tau is None else finite_array("tau", tau, shape)
        y = np.concatenate((q, v, tau), axis=-1).reshape(-1, 3 * self.n, 1)
        times = np.full((len(y), 1), finite_array("t", t, ()))
        outputs = self.kernel.rows(self.block, times, y)
        arrays = {name: x.reshape(*shape[:-1], *self._shape(name)) for name, x in outputs.items()}
        fields: dict[str, Any] = {name: arrays.get(name) for name in CompiledResult._fields}
        return CompiledResult(**fields)

    def _shape(self, name: str) -> tuple[int, ...]:
        rows = self.r if name.startswith("multipliers") else self.n
        return (rows, self.n) if name in ARRAYS else (rows,)


NOTHING: dict[str, Any] = dict.fromkeys(CompiledResult._fields)


def _is_plain(q: Any, v: Any, tau: Any, t: Any, shape: tuple[int, ...]) -> bool:
    """Return whether the arguments are float64 arrays of this shape, and need no conversion."""
    arrays = (q, v) if tau is None else (q, v, tau)
    for x in arrays:
        if type(x) is not np.ndarray or x.dtype != FLOAT or x.shape != shape:
            return False
    return type(t) is float and math.isfinite(t)


FLOAT = np.dtype(float)


def _made_again(scene: Scene, key: str, choice: Choice | None) -> CompiledDerivatives:
    return CompiledDerivatives(scene, formulation_for(scene, key), choice)


def derivatives_kernel(
    scene: Scene, formulation: Formulation, choice: Choice | None = None, width: int = 1
) -> Kernel:
    """Return the kernel of t and (q, v, τ) (3n,), `width` states at a time.

    Raises:
        NotRationalError: a function of the scene branches on a value.
    """
    n, r = scene.n, scene.r if formulation.multipliers else 0
    outputs = {"vdot": n, "multipliers": r, **dict.fromkeys(Direction._fields, n * n)}
    outputs |= {f"multipliers_{name}": r * n for name in Direction._fields}
    sizes = {name: size for name, size in outputs.items() if size}
    return traced_kernel(
        trace_derivatives, scene, formulation, sizes, width, extrapolated=False, choice=choice
    )


def compile_derivatives(scene: Scene, key: str, q=None, t: float = 0.0) -> CompiledDerivatives:
    """Return the derivatives by one formulation as a function (q, v, tau) in machine code.

    Compiling takes seconds to minutes and is announced on standard error; scenes of the same
    topology share the code in a process. The function can be pickled, and is compiled again where
    it is unpickled.

    They are those of `eomcheck.derivatives`, without an error bound and checks of the state:
    v may violate the constraints, and a singular matrix gives NaN.

    Args:
        scene: the scene.
        key: the formulation, a key of `eomcheck.FORMULATIONS`.
        q: coordinates (n,) at which `uk` determines which constraints are redundant; by default
            those of the scene's initial state.
        t: time of these, s.

    Raises:
        InputError: wrong shape, values that are not finite, or a formulation that does not apply to
            the scene.
        UnknownNameError: no such formulation.
        NotRationalError: a function of the scene does more than rational operations.
        RefusedError: it is not clear which constraints are independent.
    """
    formulation, choice = formulation_for(checked_scene(scene), key), None
    start = q if q is None else scene.check_state(q, np.zeros(scene.n), t)[0]
    if formulation.redundant and scene.r:
        start = scene.initial_state()[0] if start is None else start
        choice = choice_for(Evaluation(scene, start, np.zeros(scene.n), t), formulation)
    with slow_work_notice(f"compiling the derivatives of {scene.name} by {key}"):
        return CompiledDerivatives(scene, formulation, choice)

"""One right-hand side in machine code: sines and cosines, terms, formulation, solve.

The generic functions of a scene and a formulation are run once on a tape, and what they left there
becomes machine code (`eomcheck.kernels`). It serves all scenes of a kind with the same terms and
sizes, whose parameters it reads from a block of memory. A matrix that is singular gives NaN:
machine code does not raise.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from eomcheck.evaluation.doubles import Evaluation
from eomcheck.formulations import Formulation, Partition
from eomcheck.formulations.base import Choice
from eomcheck.kernels.kernel import Kernel
from eomcheck.kernels.layout import CALLS, FAILED, FAILURE_TIME, TIME
from eomcheck.kernels.machine import EFFORT, LEAST_EFFORT
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.stabilization import feed_back
from eomcheck.motion.state import state_of, state_size, state_vector, take_speeds
from eomcheck.motion.trace import (
    ACCELERATION,
    FEEDBACK,
    JACOBIAN,
    Traced,
    block_of,
    state_on_tape,
    traced_kernel,
)
from eomcheck.numbers.contract import Array
from eomcheck.numbers.differentiate import jacobian


def rates_on(
    scene: Scene,
    formulation: Formulation,
    stabilized: bool = False,
    also: str = "",
    choice: Choice | None = None,
) -> Traced:
    """Run a right-hand side on a tape; its outputs are `rates`, those of the state vector.

    Args:
        scene: the scene.
        formulation: the formulation.
        stabilized: with Baumgarte's feedback, whose rate is a parameter.
        also: one further output, `JACOBIAN` or `ACCELERATION`.
        choice: of the partition, by default the paper's, with all constraints.
    """
    tape, at, y, speeds = state_on_tape(scene, formulation)
    take_speeds(at, formulation, speeds)
    if stabilized:
        feed_back(at, formulation, tape.inputs(FEEDBACK, (1,))[0])
    qdot = at.qdot if formulation.uses == "bodies" else at.v
    if choice is not None:
        at.partition = Partition.chosen(choice)
    rates, multipliers = at.rates(formulation)
    if formulation.state == "q, v2":
        rates = rates[at.partition.independent]
    integrals = () if formulation.state != "q, v, μ" or multipliers is None else multipliers
    found = [tape.number(x).place for x in (*qdot, *rates, *integrals)]
    outputs = {"rates": found}
    if also == JACOBIAN:
        outputs[JACOBIAN] = jacobian(tape, found, [x.place for x in y])
    elif also == ACCELERATION:
        vdot, multipliers = at.solution(formulation)
        outputs["vdot"] = [tape.number(x).place for x in vdot]
        if multipliers is not None:
            outputs["multipliers"] = [tape.number(x).place for x in multipliers]
    return Traced(tape, at, y, outputs)


def choice_for(at: Evaluation, formulation: Formulation) -> Choice | None:
    """Return the choice of independent constraints at a state; None where nothing is to choose.

    Raises:
        RefusedError: it is not clear which they are.
    """
    partition = at.partition_for(formulation, pivoted=False)
    return None if partition.redundant is None else partition.choice


def kernel_of(
    scene: Scene,
    formulation: Formulation,
    *,
    stabilized: bool = False,
    also: str = "",
    width: int = 1,
    choice: Choice | None = None,
    effort: int = EFFORT,
) -> Kernel:
    """Return the kernel of a right-hand side.

    Args:
        scene: the scene.
        formulation: the formulation.
        stabilized: whether it reads a rate of feedback.
        also: a further output, as for `rates_on`.
        width: lanes.
        choice: of the partition, as for `rates_on`.
        effort: LLVM's in generating code.

    Raises:
        NotRationalError: a function of the scene branches on a value.
    """
    size = state_size(scene, formulation)
    outputs = {"rates": size}
    if also == JACOBIAN:
        outputs["jacobian"] = size * size
    elif also == ACCELERATION:
        outputs["vdot"] = scene.n
        if formulation.multipliers and scene.r > 0:
            outputs["multipliers"] = scene.r
    options = {"stabilized": stabilized, "also": also, "choice": choice}
    return traced_kernel(rates_on, scene, formulation, outputs, width, effort, **options)


class RightHandSide:
    """The right-hand side of one scene: a kernel, and the block of memory with its parameters.

    Args:
        scene: the scene.
        formulation: the formulation.
        feedback: rate of Baumgarte's feedback, 1/s, or None without.
        choice: of the partition, as for `rates_on`.

    Attributes:
        address: of the C function (derivatives, t, state, arguments).
        arguments: what it is to be given: the address of the block, as a double.
    """

    def __init__(
        self,
        scene: Scene,
        formulation: Formulation,
        feedback: float | None = None,
        choice: Choice | None = None,
    ):
        stabilized = feedback is not None
        self.kernel = kernel_of(scene, formulation, stabilized=stabilized, choice=choice)
        more = {} if feedback is None else {FEEDBACK: feedback}
        self.block = block_of(self.kernel, scene, **more)
        self.address = self.kernel.address
        self.arguments = np.array([self.block.ctypes.data], np.int64).view(np.float64)
        self._counts = self.block[:2].view(np.int64)

    @property
    def calls(self) -> int:
        """Right-hand sides evaluated."""
        return int(self._counts[CALLS])

    @property
    def failed(self) -> int:
        """How many of them were not finite."""
        return int(self._counts[FAILED])

    @property
    def failure_time(self) -> float:
        """When the first of these was evaluated, s; NaN without any."""
        return float(self.block[FAILURE_TIME])

    @property
    def time(self) -> float:
        """Where the last of them was evaluated, s; another thread may ask while they run."""
        return float(self.block[TIME])

    def reset(self) -> None:
        """Set the counts to zero."""
        self._counts[:] = 0
        self.block[FAILURE_TIME] = np.nan

    @cached_property
    def _function(self) -> Any:
        kinds = ctypes.c_size_t, ctypes.c_double, ctypes.c_size_t, ctypes.c_size_t
        return ctypes.CFUNCTYPE(None, *kinds)(self.address)

    def __call__(self, t: float, y: Array) -> Array:
        """Return the derivatives at time t, s, of a state vector y (size,).

        Not for two threads at once: they would share the block.

        Raises:
            InputError: y has another shape.
        """
        y, ydot = state_vector(y, self.kernel.size), np.empty(self.kernel.size)
        self._function(ydot.ctypes.data, t, y.ctypes.data, self.arguments.ctypes.data)
        return ydot


def acceleration_in_machine_code(
    at: Evaluation, formulation: Formulation, y: Array | None = None
) -> Array:
    """Return v̇ (n,) by machine code; NaN where a matrix is singular.

    Args:
        at: where; its coordinates, velocities and time.
        formulation: the formulation.
        y: state vector in place of the one that follows from `at`.

    Raises:
        RefusedError: which constraints are independent is not clear.
    """
    choice = choice_for(at, formulation)
    kernel = kernel_of(at.scene, formulation, also=ACCELERATION, choice=choice, effort=LEAST_EFFORT)
    state = state_of(at, formulation) if y is None else y
    return kernel(block_of(kernel, at.scene), np.array([at.t]), state)["vdot"]


def exact_jacobian(
    scene: Scene, formulation: Formulation, choice: Choice | None = None
) -> Callable[[float, Array], Array]:
    """Return the function (t, y (k,)) -> ∂ẏ/∂y (k, k), differentiated on the tape.

    For implicit integrators that take one (SciPy's). Not for two threads at once. It raises
    `InputError` for a y of another shape. `choice` of the partition is that of `rates_on`.
    """
    kernel = kernel_of(scene, formulation, also=JACOBIAN, choice=choice)
    block, size = block_of(kernel, scene), state_size(scene, formulation)

    def at(t: float, y: Array) -> Array:
        found = kernel(block, np.array([t]), state_vector(y, size))
        return found["jacobian"].reshape(size, size)

    return at

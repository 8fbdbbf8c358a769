"""Right-hand sides of formulations in machine code: sines and cosines, terms, formulation, solve.

The generic functions of a scene and a formulation are traced once on a tape, and the tape is
compiled (`eomcheck.kernels`). A kernel, the compiled function, is shared by all scenes of a class
with the same terms and sizes; it reads their parameters from a block of memory. A singular matrix
gives NaN: machine code does not raise.

The state vector consists of q and the other integrated variables, `Formulation.state` (paper,
Eqs. (6), (8), (14), (19)):

- "q, v, μ": velocities, and the integrals μ of the multipliers, μ̇ = λ
- "q, v": velocities
- "q, v2": the independent velocities of the partition
- "q, u": generalized speeds
- "q, x": quasi-velocities of a chain
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from eomcheck.deprecated import getattr_of
from eomcheck.errors import InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.formulations import Formulation, Partition
from eomcheck.formulations.em import velocity_of_independent
from eomcheck.formulations.formulation import Choice
from eomcheck.kernels.kernel import CALLS, FAILED, FAILURE_TIME, TIME, Kernel
from eomcheck.kernels.llvm import EFFORT, LEAST_EFFORT
from eomcheck.kernels.program import NotRegularError, Program, extrapolate_program, program_of
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.stabilization import feed_back
from eomcheck.numbers.generic import Array
from eomcheck.numbers.tape import Tape, jacobian

# ---- State vectors -------------------------------------------------------------------------------


def number_of_speeds(scene: Scene, formulation: Formulation) -> int:
    """Return the number of speeds in a state vector: entries of v, v2, u or x."""
    return {"q, v2": scene.p, "q, u": scene.p, "q, x": scene.s}.get(formulation.state, scene.n)


def state_size(scene: Scene, formulation: Formulation) -> int:
    """Return the number of entries of a state vector."""
    integrals = scene.r if formulation.state == "q, v, μ" else 0
    return scene.n + number_of_speeds(scene, formulation) + integrals


def state_of(at: Quantities, formulation: Formulation) -> Array:
    """Return the state vector that `formulation` integrates, with integrals of 0."""
    speeds = at.speeds_read(formulation)
    if formulation.state == "q, v2":
        speeds = speeds[at.partition.independent]
    integrals = np.zeros(at.scene.r if formulation.state == "q, v, μ" else 0)
    return np.concatenate((at.q, speeds, integrals))


def state_vector(y: Array, size: int) -> Array:
    """Return y (size,) as contiguous float64, which machine code requires.

    Raises:
        InputError: y has another shape.
    """
    if np.shape(y) != (size,):
        raise InputError(f"y has shape {np.shape(y)}, expected ({size},)")
    return np.ascontiguousarray(y, float)


def set_speeds(at: Quantities, formulation: Formulation, speeds: Any) -> None:
    """Set the velocities of `at` from the speeds of a state vector, in any scalar type.

    Args:
        at: the scene at the coordinates of the state vector.
        formulation: the formulation.
        speeds: speeds of the state vector (`number_of_speeds`,).
    """
    here = at.parameters, at.prepared, at.q
    if formulation.state == "q, u":
        at.u = speeds
    elif formulation.state == "q, x":
        at.x, at.v = speeds, at.call(at.scene.chain_velocity, *here, speeds)
    elif formulation.state == "q, v2":
        a, b = at.call(at.scene.constraints, *here)
        at.v = at.call(velocity_of_independent, a, b, speeds, at.partition)
    else:
        at.v = speeds


# ---- Kernels of a scene --------------------------------------------------------------------------

MANY_LINKS = 48
"""Number of links above which a chain's program is extrapolated from those of shorter chains."""

SHORTER = 20, 4
"""First number of links of the shorter chains, and its increment: patterns may have a period."""


FEEDBACK = "rate_of_feedback"
"""Name of the additional parameter of a stabilized right-hand side, 1/s."""


JACOBIAN, ACCELERATION = "jacobian", "acceleration"
"""Names of optional outputs of a right-hand side: `jacobian`, the derivatives of its rates by the
state, row by row; or the whole `vdot` and, if the formulation has them, `multipliers`.
"""


class Traced(NamedTuple):
    """A tape with the indices of its parameters, state and outputs.

    Attributes:
        tape: the tape.
        at: the scene at the state y.
        y: the state vector.
        outputs: indices of the outputs, by name.
    """

    tape: Tape
    at: Quantities
    y: Array
    outputs: dict[str, list[int]]


def parameter_arrays(scene: Scene) -> dict[str, Array]:
    """Return the parameters of `scene` as float64 arrays, by name; absent ones are left out."""
    record = scene.float64_parameters
    fields = zip(record._fields, record, strict=True)
    return {name: np.asarray(x, np.float64) for name, x in fields if x is not None}


def quantities_on(tape: Tape, scene: Scene, q: Array) -> Quantities:
    """Return the scene's quantities on a tape; its parameters and the time are inputs."""
    at = Quantities(scene, tape, q, tape.inputs("t", (1,))[0])
    parameters = {name: tape.inputs(name, x.shape) for name, x in parameter_arrays(scene).items()}
    at.parameters = parameter_record(scene, parameters)
    return at


def parameter_record(scene: Scene, values: Mapping[str, Any]) -> Any:
    """Return the record of the scene's parameters with these values, by name; None for others."""
    record = scene.float64_parameters
    return record._make(map(values.get, record._fields))


def state_on_tape(scene: Scene, formulation: Formulation) -> tuple[Tape, Quantities, Array, Array]:
    """Return a new tape, the scene on it, the state vector as an input, and the speeds in it."""
    tape, n = Tape(), scene.n
    y = tape.inputs("y", (state_size(scene, formulation),))
    speeds = y[n : n + number_of_speeds(scene, formulation)]
    return tape, quantities_on(tape, scene, y[:n]), y, speeds


CACHED_KERNELS = 128
"""Size of the kernel cache of a process; the least recently used ones are dropped."""

_kernels: dict[Any, Kernel] = {}


def traced_kernel(
    trace: Callable[..., Traced],
    scene: Scene,
    formulation: Formulation,
    outputs: dict[str, int],
    width: int = 1,
    effort: int = EFFORT,
    extrapolated: bool = True,
    **options: Any,
) -> Kernel:
    """Return the compiled kernel of a trace, cached for scenes of this class, terms and sizes.

    Args:
        trace: function (scene, formulation, **options) that returns the tape.
        scene: the scene.
        formulation: the formulation.
        outputs: number of entries of each output, by name.
        width: number of SIMD lanes.
        effort: optimization level of LLVM.
        extrapolated: whether the program of a long chain follows from those of shorter chains.
        options: options of the trace, as in `kernel_of`.
    """
    sizes = {name: x.shape for name, x in parameter_arrays(scene).items()}
    size = state_size(scene, formulation)
    kind = type(scene), formulation, tuple(sizes.items()), size, scene.n, scene.r, scene.s
    key = trace, kind, tuple(outputs.items()), width, effort, tuple(options.items())
    kernel = _kernels.pop(key, None)
    if kernel is None:
        parameters = {name: int(np.prod(shape)) for name, shape in sizes.items()}
        if options.get("stabilized"):
            parameters[FEEDBACK] = 1
        along = extrapolated and formulation.linear and options.get("also") != JACOBIAN
        program = _program(lambda one: trace(one, formulation, **options), scene, along)
        kernel = Kernel(program, parameters, outputs, width, effort)
    _kernels[key] = kernel
    if len(_kernels) > CACHED_KERNELS:
        del _kernels[next(iter(_kernels))]
    return kernel


def _program(trace: Callable[[Scene], Traced], scene: Scene, along: bool) -> Program:
    """Return the program of a trace; `along` a long chain, extrapolated from shorter ones."""
    links = getattr(scene, "links", 0)
    if scene.has_links and along and links > MANY_LINKS:
        first, step = SHORTER
        first += (links - first) % step

        def shorter(count: int) -> Program:
            traced = trace(_shorter_scene(scene, count))
            return program_of(traced.tape, traced.outputs, short=0)

        try:
            return extrapolate_program(shorter, links, first, step)
        except NotRegularError:
            pass  # without a regular pattern it is traced in full
    traced = trace(scene)
    return program_of(traced.tape, traced.outputs)


def _shorter_scene(scene: Scene, links: int) -> Scene:
    """Return a scene of this class, with the same terms, of so many links.

    Raises:
        NotRegularError: the class has none.
    """
    names = parameter_arrays(scene).keys()
    for other in type(scene).structures(links):
        if parameter_arrays(other).keys() == names:
            return other
    raise NotRegularError(f"no {scene.key} of {links} links has the terms of {scene.structure}")


def block_of(kernel: Kernel, scene: Scene, **more: float) -> Array:
    """Return the block of a kernel with the parameters of `scene`, and of `more` by name."""
    parameters = {name: np.ravel(x) for name, x in parameter_arrays(scene).items()}
    return kernel.block({**parameters, **{name: np.array([x]) for name, x in more.items()}})


# ---- Right-hand sides ----------------------------------------------------------------------------


def trace_rates(
    scene: Scene,
    formulation: Formulation,
    stabilized: bool = False,
    also: str = "",
    choice: Choice | None = None,
) -> Traced:
    """Trace a right-hand side; its outputs are `rates`, those of the state vector.

    Args:
        scene: the scene.
        formulation: the formulation.
        stabilized: with Baumgarte's feedback, whose rate is a parameter.
        also: one further output, `JACOBIAN` or `ACCELERATION`.
        choice: choice of the partition, by default the paper's, with all constraints.
    """
    tape, at, y, speeds = state_on_tape(scene, formulation)
    set_speeds(at, formulation, speeds)
    if stabilized:
        feed_back(at, formulation, tape.inputs(FEEDBACK, (1,))[0])
    qdot = at.qdot if formulation.uses == "bodies" else at.v
    if choice is not None:
        at.partition = Partition.chosen(choice)
    rates, multipliers = at.rates(formulation)
    if formulation.state == "q, v2":
        rates = rates[at.partition.independent]
    integrals = () if formulation.state != "q, v, μ" or multipliers is None else multipliers
    derivatives = [tape.number(x).index for x in (*qdot, *rates, *integrals)]
    outputs = {"rates": derivatives}
    if also == JACOBIAN:
        outputs[JACOBIAN] = jacobian(tape, derivatives, [x.index for x in y])
    elif also == ACCELERATION:
        vdot, multipliers = at.solution(formulation)
        outputs["vdot"] = [tape.number(x).index for x in vdot]
        if multipliers is not None:
            outputs["multipliers"] = [tape.number(x).index for x in multipliers]
    return Traced(tape, at, y, outputs)


def choice_for(at: Evaluation, formulation: Formulation) -> Choice | None:
    """Return the choice of independent constraints at a state; None if all are independent.

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
    """Return the compiled kernel of a right-hand side.

    Args:
        scene: the scene.
        formulation: the formulation.
        stabilized: whether it reads a rate of feedback.
        also: a further output, as for `trace_rates`.
        width: number of SIMD lanes.
        choice: choice of the partition, as for `trace_rates`.
        effort: optimization level of LLVM.

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
    return traced_kernel(trace_rates, scene, formulation, outputs, width, effort, **options)


class RightHandSide:
    """The right-hand side of one scene: a kernel, and the block of memory with its parameters.

    Args:
        scene: the scene.
        formulation: the formulation.
        feedback: rate of Baumgarte's feedback, 1/s, or None without.
        choice: choice of the partition, as for `trace_rates`.

    Attributes:
        address: address of the C function (derivatives, t, state, arguments).
        arguments: its last argument: the address of the block, as a float64.
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
        """Number of evaluated right-hand sides."""
        return int(self._counts[CALLS])

    @property
    def failed(self) -> int:
        """Number of evaluations that were not finite."""
        return int(self._counts[FAILED])

    @property
    def failure_time(self) -> float:
        """Time of the first evaluation that was not finite, s; NaN without any."""
        return float(self.block[FAILURE_TIME])

    @property
    def time(self) -> float:
        """Time of the last evaluation, s; another thread may read it during a run."""
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
        at: evaluation with coordinates, velocities and time.
        formulation: the formulation.
        y: state vector instead of the one of `at`.

    Raises:
        RefusedError: it is not clear which constraints are independent.
    """
    choice = choice_for(at, formulation)
    kernel = kernel_of(at.scene, formulation, also=ACCELERATION, choice=choice, effort=LEAST_EFFORT)
    state = state_of(at, formulation) if y is None else y
    return kernel(block_of(kernel, at.scene), np.array([at.t]), state)["vdot"]


def exact_jacobian(
    scene: Scene, formulation: Formulation, choice: Choice | None = None
) -> Callable[[float, Array], Array]:
    """Return the function (t, y (k,)) -> ∂ẏ/∂y (k, k), by automatic differentiation of the tape.

    For implicit integrators that take a Jacobian (SciPy's). Not for two threads at once. It raises
    `InputError` for a y of another shape. `choice` of the partition is that of `trace_rates`.
    """
    kernel = kernel_of(scene, formulation, also=JACOBIAN, choice=choice)
    block, size = block_of(kernel, scene), state_size(scene, formulation)

    def at(t: float, y: Array) -> Array:
        outputs = kernel(block, np.array([t]), state_vector(y, size))
        return outputs["jacobian"].reshape(size, size)

    return at


__getattr__ = getattr_of(__name__)

"""From a scene on a tape to machine code, made once for scenes of a kind with the same terms.

The generic functions of a scene and a formulation are run once on a tape, and what they left there
becomes machine code (`eomcheck.kernels`). It reads the parameters from a block of memory.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from eomcheck.evaluation.point import Quantities
from eomcheck.formulations import Formulation
from eomcheck.kernels.kernel import Kernel
from eomcheck.kernels.machine import EFFORT
from eomcheck.kernels.program import NotRegularError, Program, continued, program_of
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.state import number_of_speeds, state_size
from eomcheck.numbers.contract import Array
from eomcheck.numbers.float64 import FLOAT64
from eomcheck.numbers.tape import Tape

MANY_LINKS = 48
"""A longer chain continues the programs of shorter ones."""

SHORTER = 20, 4
"""Their numbers of links: from 20 on, in steps of 4, for a pattern may take turns."""


FEEDBACK = "rate_of_feedback"
"""Name of the parameter that a stabilized right-hand side has besides those of the scene, 1/s."""


JACOBIAN, ACCELERATION = "jacobian", "acceleration"
"""What a right-hand side gives besides, if asked: `jacobian`, the derivatives of its rates by the
state, row by row; or the whole `vdot` and, if the formulation has them, `multipliers`."""


class Traced(NamedTuple):
    """A tape, and its entries that are parameters, state and outputs.

    Attributes:
        tape: the tape.
        at: the scene at the state y.
        y: the state vector.
        outputs: places of the outputs, by name.
    """

    tape: Tape
    at: Quantities
    y: Array
    outputs: dict[str, list[int]]


def parameter_arrays(scene: Scene) -> dict[str, Array]:
    """Return the parameters of `scene` as arrays of doubles, by name; absent ones are left out."""
    record = scene.parameters(FLOAT64)
    fields = zip(record._fields, record, strict=True)
    return {name: np.asarray(x, np.float64) for name, x in fields if x is not None}


def quantities_on(tape: Tape, scene: Scene, q: Array) -> Quantities:
    """Return the scene on a tape; its parameters and the time are inputs."""
    at = Quantities(scene, tape, q, tape.inputs("t", (1,))[0])
    given = {name: tape.inputs(name, x.shape) for name, x in parameter_arrays(scene).items()}
    at.parameters = record_of(scene, given)
    return at


def record_of(scene: Scene, given: Mapping[str, Any]) -> Any:
    """Return the record of the scene's parameters with these values, by name; None for others."""
    record = scene.parameters(FLOAT64)
    return record._make(map(given.get, record._fields))


def state_on_tape(scene: Scene, formulation: Formulation) -> tuple[Tape, Quantities, Array, Array]:
    """Return a new tape, the scene on it, the state vector, an input, and the speeds in it."""
    tape, n = Tape(), scene.n
    y = tape.inputs("y", (state_size(scene, formulation),))
    speeds = y[n : n + number_of_speeds(scene, formulation)]
    return tape, quantities_on(tape, scene, y[:n]), y, speeds


KEPT = 128
"""Kernels that a process keeps: of more than these the ones that were used last."""

_kernels: dict[Any, Kernel] = {}


def traced_kernel(
    trace: Callable[..., Traced],
    scene: Scene,
    formulation: Formulation,
    outputs: dict[str, int],
    width: int = 1,
    effort: int = EFFORT,
    **options: Any,
) -> Kernel:
    """Return the kernel of a trace, made once for scenes of this kind, terms and sizes.

    Args:
        trace: (scene, formulation, **options) to what is on the tape.
        scene: the scene.
        formulation: the formulation.
        outputs: number of entries of each output, by name.
        width: lanes.
        effort: LLVM's in generating code.
        options: as in `kernel_of`.
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
        along = formulation.linear and options.get("also") != JACOBIAN
        program = _program(lambda one: trace(one, formulation, **options), scene, along)
        kernel = Kernel(program, parameters, outputs, width, effort)
    _kernels[key] = kernel
    if len(_kernels) > KEPT:
        del _kernels[next(iter(_kernels))]
    return kernel


def _program(trace: Callable[[Scene], Traced], scene: Scene, along: bool) -> Program:
    """Return the program of a trace; `along` a chain of many links, that of shorter ones."""
    links = getattr(scene, "links", 0)
    if scene.has_links and along and links > MANY_LINKS:
        first, step = SHORTER
        first += (links - first) % step

        def shorter(count: int) -> Program:
            traced = trace(_alike(scene, count))
            return program_of(traced.tape, traced.outputs, short=0)

        try:
            return continued(shorter, links, first, step)
        except NotRegularError:
            pass  # what follows no pattern is traced as it is
    traced = trace(scene)
    return program_of(traced.tape, traced.outputs)


def _alike(scene: Scene, links: int) -> Scene:
    """Return a scene of this kind, with the same terms, of so many links.

    Raises:
        NotRegularError: the kind has none.
    """
    names = parameter_arrays(scene).keys()
    for other in type(scene).structures(links):
        if parameter_arrays(other).keys() == names:
            return other
    raise NotRegularError(f"no {scene.key} of {links} links has the terms of {scene.structure}")


def block_of(kernel: Kernel, scene: Scene, **more: float) -> Array:
    """Return the block of a kernel with the parameters of `scene`, and more by name."""
    given = {name: np.ravel(x) for name, x in parameter_arrays(scene).items()}
    return kernel.block({**given, **{name: np.array([x]) for name, x in more.items()}})

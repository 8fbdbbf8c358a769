"""What is seen of a motion: velocities, speeds, energy and constraint error of a state vector.

In machine code like the right-hand side, and with its parameters.
"""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.formulations import Formulation
from eomcheck.kernels.kernel import Kernel
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.right_hand_side import rates_on
from eomcheck.motion.state import state_of, take_speeds
from eomcheck.motion.trace import Traced, block_of, state_on_tape, traced_kernel
from eomcheck.numbers.banded import solve_banded
from eomcheck.numbers.contract import Array
from eomcheck.numbers.linear import Solve, solve, watching
from eomcheck.numbers.tape import BAND, FACTORS, live


def observations_on(scene: Scene, formulation: Formulation) -> Traced:
    """Put on a tape what is seen of a state vector of `formulation`.

    Its outputs are `v` (n,), `u` (p,), the `energy` T + U (1,), J, and, where there are
    constraints, their values `constraint` (r,), m/s, by the scene's second derivation.
    """
    tape, at, y, speeds = state_on_tape(scene, formulation)
    here = at.parameters, at.prepared, at.q
    take_speeds(at, formulation, speeds)
    if formulation.uses == "bodies":  # as its right-hand side does: others round differently
        at.v = at.qdot
    T, U = scene.energies(*here, at.v)
    seen = {"v": at.v, "u": at.u, "energy": (T if U is None else T + U,)}
    if scene.r > 0:
        seen["constraint"] = scene.constraint(*here, at.v)
    outputs = {name: [tape.number(x).place for x in values] for name, values in seen.items()}
    return Traced(tape, at, y, outputs)


def observer_of(scene: Scene, formulation: Formulation, width: int = 1) -> Kernel:
    """Return the kernel of `observations_on`, made once for scenes of this kind.

    Args:
        scene: the scene.
        formulation: the formulation.
        width: lanes.

    Raises:
        NotRationalError: a function of the scene branches on a value.
    """
    outputs = {"v": scene.n, "u": scene.p, "energy": 1}
    if scene.r > 0:
        outputs["constraint"] = scene.r
    return traced_kernel(observations_on, scene, formulation, outputs, width=width)


def as_integrated(at: Evaluation, formulation: Formulation) -> tuple[Evaluation, Array]:
    """Return the evaluation at what the state vector of `formulation` stands for, and that vector.

    Where it holds speeds or the independent velocities, all velocities follow from them: others
    than those given, by rounding times the condition of what is solved, or by what cancels in W u.
    """
    y = state_of(at, formulation)
    if formulation.state in ("q, v", "q, v, μ"):
        return at, y
    kernel = observer_of(at.scene, formulation)
    v = kernel(block_of(kernel, at.scene), np.array([at.t]), y)["v"]
    return (Evaluation(at.scene, at.q, v, at.t) if np.isfinite(v).all() else at), y


def solves_on(scene: Scene, formulation: Formulation) -> Traced:
    """Put a right-hand side on a tape; its outputs are the matrices that it solves, by name.

    A band matrix has its right-hand side behind it.
    """
    tape, at, y, rates = rates_on(scene, formulation)
    used = sorted(live(tape, rates["rates"])[1])
    groups = ((number, tape.groups[number]) for number in used)
    matrices = {
        f"{number} {group.kind} {group.name}": list(group.reads)
        for number, group in groups
        if group.kind in (FACTORS, BAND)
    }
    return Traced(tape, at, y, matrices)


def solves_of(scene: Scene, formulation: Formulation, t: float, y: Array) -> list[Solve]:
    """Return what there is to know of each matrix that machine code solves at a state.

    Its reciprocal condition number, the sign and size of its determinant and the steps of
    refinement are found by the law that machine code follows, from the matrix that it made.

    Args:
        scene: the scene.
        formulation: the formulation.
        t: time, s.
        y: state vector (k,).
    """
    sizes = {name: len(reads) for name, reads in solves_on(scene, formulation).outputs.items()}
    kernel = traced_kernel(solves_on, scene, formulation, sizes)
    found = kernel(block_of(kernel, scene), np.array([t]), y) if sizes else {}
    with watching() as watch, np.errstate(all="ignore"):
        for title, entries in found.items():
            _, kind, name = title.split(" ", 2)
            with suppress(RefusedError):
                if kind == BAND:
                    size = len(entries) // 8
                    solve_banded(entries[: 7 * size].reshape(size, 7), entries[7 * size :], name)
                else:
                    size = math.isqrt(len(entries))
                    solve(entries.reshape(size, size), np.zeros(size), name)
    return watch.solves

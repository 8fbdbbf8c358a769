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
    if formulation.state == "q, u":
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


def as_integrated(at: Evaluation, formulation: Formulation) -> Evaluation:
    """Return the evaluation at the velocities that the state vector of `formulation` stands for.

    Where it holds the independent ones, the others follow from them, by rounding times the
    condition of what is solved another v than the one given.
    """
    if formulation.state != "q, v2":
        return at
    kernel = observer_of(at.scene, formulation)
    v = kernel(block_of(kernel, at.scene), np.array([at.t]), state_of(at, formulation))["v"]
    return Evaluation(at.scene, at.q, v, at.t) if np.isfinite(v).all() else at


def solves_partition(scene: Scene, formulation: Formulation) -> bool:
    """Return whether a right-hand side solves the constraints for the dependent velocities."""
    by_speeds = formulation.state == "q, u" and not scene.natural_speeds
    return scene.r > 0 and (formulation.partitioned or by_speeds)


def partition_on(scene: Scene, formulation: Formulation) -> Traced:
    """Put on a tape a_1 (r, r), the columns of a of the paper's dependent velocities."""
    tape, at, y, _ = state_on_tape(scene, formulation)
    a, _ = at.call(scene.constraints, at.parameters, at.prepared, at.q)
    a_1 = a[:, at.partition.dependent].ravel()
    return Traced(tape, at, y, {"a_1": [tape.number(x).place for x in a_1]})


ENTRIES = 2**20
"""Most entries of matrices that are looked at at a time."""


def partition_signs(
    scene: Scene, formulation: Formulation, parameters: dict[str, Array], t: Array, y: Array
) -> Array:
    """Return the sign of det a_1 (k, lanes) at times t (k, lanes) of states y (k, size, lanes).

    Between states of other signs there is one in which a_1 is singular, and nothing that solves
    with it gets there. Of a state that is not finite it means nothing.

    Args:
        scene: a scene of this kind, where `solves_partition`.
        formulation: the formulation.
        parameters: of each lane, by name.
        t: times, s.
        y: state vectors.
    """
    r, lanes = scene.r, t.shape[1]
    kernel = traced_kernel(partition_on, scene, formulation, {"a_1": r * r}, lanes)
    block, piece = kernel.block(parameters), max(1, ENTRIES // (r * r * lanes))
    signs = []
    for first in range(0, len(t), piece):
        some = slice(first, first + piece)
        a_1 = kernel.rows(block, t[some], y[some])["a_1"].transpose(0, 2, 1)
        with np.errstate(all="ignore"):
            signs.append(np.linalg.slogdet(a_1.reshape(-1, lanes, r, r)).sign)
    return np.concatenate(signs)


def crossed(signs: Array) -> int | None:
    """Return the first place where signs (k,) are not that of the first; None where all are."""
    others = np.flatnonzero(signs != signs[0])
    return int(others[0]) if others.size else None


def crossing(t: Array, place: int) -> RefusedError:
    """Return what is said of a motion that went on to t[place] from a state with another sign."""
    return RefusedError(
        "a_1",
        0.0,
        0.0,
        f"between t = {t[place - 1]:.9g} s and {t[place]:.9g} s the determinant of a_1, the columns"
        " of a of the dependent velocities, changes its sign: there it is singular, and no motion "
        "that is solved by it crosses such a pose",
    )


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

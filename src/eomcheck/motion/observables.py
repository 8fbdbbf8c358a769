"""Observables of a state vector: velocities, speeds, energy, constraint error; singular crossings.

They are compiled like the right-hand side, and read the same parameters.

A motion cannot cross a singular configuration of its formulation's partition. But no step need
fall on it, and an integration step over it divides by no zero: the motion continues on the other
side with fewer correct digits. `singular_crossings` finds the states A and B before and behind it
by negative real eigenvalues of A⁻¹ B.
"""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import Formulation
from eomcheck.kernels.kernel import Kernel
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.right_hand_side import (
    Traced,
    block_of,
    set_speeds,
    state_of,
    state_on_tape,
    trace_rates,
    traced_kernel,
)
from eomcheck.numbers.banded_solve import solve_banded
from eomcheck.numbers.generic import Array
from eomcheck.numbers.linear import SolveRecord, recording_solves, solve
from eomcheck.numbers.tape import BAND, FACTORS, live_entries

# ---- Observables ---------------------------------------------------------------------------------


def trace_observables(scene: Scene, formulation: Formulation) -> Traced:
    """Trace the observables of a state vector of `formulation`.

    Outputs of the trace are `v` (n,), `u` (p,), the `energy` T + U (1,), J, and, with constraints,
    their values `constraint` (r,), m/s, by the scene's second derivation.
    """
    tape, at, y, speeds = state_on_tape(scene, formulation)
    here = at.parameters, at.prepared, at.q
    set_speeds(at, formulation, speeds)
    if formulation.uses == "bodies":  # as its right-hand side does: others round differently
        at.v = at.qdot
    T, U = scene.energies(*here, at.v)
    observables = {"v": at.v, "u": at.u, "energy": (T if U is None else T + U,)}
    if scene.r > 0:
        observables["constraint"] = scene.constraint(*here, at.v)
    outputs = {name: [tape.number(x).index for x in values] for name, values in observables.items()}
    return Traced(tape, at, y, outputs)


def observer_of(scene: Scene, formulation: Formulation, width: int = 1) -> Kernel:
    """Return the kernel of `trace_observables`, cached for scenes of the same class and terms.

    Args:
        scene: the scene.
        formulation: the formulation.
        width: number of SIMD lanes.

    Raises:
        NotRationalError: a function of the scene branches on a value.
    """
    outputs = {"v": scene.n, "u": scene.p, "energy": 1}
    if scene.r > 0:
        outputs["constraint"] = scene.r
    return traced_kernel(trace_observables, scene, formulation, outputs, width=width)


def as_integrated(at: Evaluation, formulation: Formulation) -> tuple[Evaluation, Array]:
    """Return the evaluation at the state vector of `formulation`, and that vector.

    If it holds speeds or the independent velocities, all velocities are computed from them and
    differ from the given ones: by rounding times the condition number of the solved matrix, or by
    cancellation in W u.
    """
    y = state_of(at, formulation)
    if formulation.state in ("q, v", "q, v, μ"):
        return at, y
    kernel = observer_of(at.scene, formulation)
    v = kernel(block_of(kernel, at.scene), np.array([at.t]), y)["v"]
    return (Evaluation(at.scene, at.q, v, at.t) if np.isfinite(v).all() else at), y


def trace_solves(scene: Scene, formulation: Formulation) -> Traced:
    """Trace a right-hand side; its outputs are the matrices that it solves, by name.

    A band matrix is followed by its right-hand side.
    """
    tape, at, y, rates = trace_rates(scene, formulation)
    used = sorted(live_entries(tape, rates["rates"])[1])
    groups = ((number, tape.groups[number]) for number in used)
    matrices = {
        f"{number} {group.kind} {group.name}": list(group.reads)
        for number, group in groups
        if group.kind in (FACTORS, BAND)
    }
    return Traced(tape, at, y, matrices)


def solves_of(scene: Scene, formulation: Formulation, t: float, y: Array) -> list[SolveRecord]:
    """Return the solve records of all matrices that machine code solves at a state.

    Reciprocal condition number, sign and size of the determinant and number of refinement steps
    are computed from the matrix in machine code, by the same algorithm.

    Args:
        scene: the scene.
        formulation: the formulation.
        t: time, s.
        y: state vector (k,).
    """
    sizes = {name: len(reads) for name, reads in trace_solves(scene, formulation).outputs.items()}
    kernel = traced_kernel(trace_solves, scene, formulation, sizes)
    matrices = kernel(block_of(kernel, scene), np.array([t]), y) if sizes else {}
    with recording_solves() as recorder, np.errstate(all="ignore"):
        for title, entries in matrices.items():
            _, kind, name = title.split(" ", 2)
            with suppress(RefusedError):
                if kind == BAND:
                    size = len(entries) // 8
                    solve_banded(entries[: 7 * size].reshape(size, 7), entries[7 * size :], name)
                else:
                    size = math.isqrt(len(entries))
                    solve(entries.reshape(size, size), np.zeros(size), name)
    return recorder.solves


# ---- Singular configurations between states ------------------------------------------------------

ENTRIES = 2**20
"""Largest number of matrix entries that are checked at a time."""


def solves_partition(scene: Scene, formulation: Formulation) -> bool:
    """Return whether a right-hand side solves the constraints for the dependent velocities."""
    by_speeds = formulation.state == "q, u" and not scene.natural_speeds
    return scene.r > 0 and (formulation.partitioned or by_speeds)


def trace_partition(scene: Scene, formulation: Formulation) -> Traced:
    """Trace a_1 (r, r), the columns of a of the paper's dependent velocities."""
    tape, at, y, _ = state_on_tape(scene, formulation)
    a, _ = at.call(scene.constraints, at.parameters, at.prepared, at.q)
    a_1 = a[:, at.partition.dependent].ravel()
    return Traced(tape, at, y, {"a_1": [tape.number(x).index for x in a_1]})


def singular_crossings(
    scene: Scene, formulation: Formulation, parameters: dict[str, Array], t: Array, y: Array
) -> list[tuple[int, int] | None]:
    """Return for each motion the states before and behind a singular configuration, or None.

    States that are not finite are skipped, and those in which a_1 is exactly singular: there the
    right-hand side itself is not finite.

    Args:
        scene: a scene of this class, where `solves_partition`.
        formulation: the formulation.
        parameters: parameters of each motion, by name.
        t: times (k, motions), s.
        y: state vectors (k, size, motions).

    Returns:
        A pair of indices into the states, or None, for each motion.
    """
    r, motions = scene.r, t.shape[1]
    kernel = traced_kernel(trace_partition, scene, formulation, {"a_1": r * r}, motions)
    block, piece = kernel.block(parameters), max(1, ENTRIES // (r * r * motions))
    crossings: list[tuple[int, int] | None] = [None] * motions
    known = [(np.empty(0, int), np.empty((0, r, r)))] * motions
    for first in range(0, len(t), piece):
        some = slice(first, first + piece)
        a_1 = kernel.rows(block, t[some], y[some])["a_1"]
        for i in range(motions):
            all_matrices = a_1[:, :, i].reshape(-1, r, r)
            usable = np.isfinite(y[some, :, i]).all(axis=1)
            with np.errstate(all="ignore"):
                usable &= np.linalg.slogdet(all_matrices).sign != 0
            indices = np.concatenate((known[i][0], first + np.flatnonzero(usable)))
            matrices = np.concatenate((known[i][1], all_matrices[usable]))
            between = np.flatnonzero(singular_between(matrices))
            if crossings[i] is None and between.size:
                before, behind = indices[between[0] :][:2]
                crossings[i] = int(before), int(behind)
            known[i] = indices[-1:], matrices[-1:]
    return crossings


def singular_between(A: Array) -> Array:
    """Return whether matrices are singular between each of A (k, r, r), invertible, and the next.

    On the straight line from A to B = A (1 + X) a matrix is singular where A⁻¹ B has a negative
    real eigenvalue: with one such eigenvalue the determinant changes its sign; with two, as where
    two equal windows of a linkage fold at once, it does not. Rounding makes r equal eigenvalues
    complex, up to an angle of ε^(1/r).
    """
    A, B = A[:-1], A[1:]
    singular = np.zeros(len(A), bool)
    with np.errstate(all="ignore"):
        # The sum of 1 and a matrix of smaller norm has no negative eigenvalue.
        size = np.abs(np.linalg.solve(A, B - A)).sum(axis=2).max(axis=1, initial=0.0)
        far = np.flatnonzero((size >= 1.0) & np.isfinite(size))
        if far.size:
            turned = np.linalg.eigvals(np.linalg.solve(A[far], B[far]))
            flat = np.pi - np.abs(np.angle(turned)) <= allowed_error(1.0) ** (1.0 / A.shape[1])
            singular[far] = flat.any(axis=1)
    return singular


def crossing_refusal(before: float, behind: float) -> RefusedError:
    """Return the error of a motion that crossed a singular configuration between two times, s."""
    return RefusedError(
        "a_1",
        0.0,
        0.0,
        f"between t = {before:.9g} s and {behind:.9g} s the matrix a_1, the columns of a of "
        "the dependent velocities, is singular: no motion that is solved by it crosses such a pose",
    )

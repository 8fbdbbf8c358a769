"""Poses that a motion cannot cross: where the partition by which it is solved is singular.

No step need hit such a pose, and one that goes over it divides by no zero: it comes out on the
other side with some of its digits.
"""

from __future__ import annotations

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import Formulation
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.trace import Traced, state_on_tape, traced_kernel
from eomcheck.numbers.contract import Array

ENTRIES = 2**20
"""Most entries of matrices that are looked at at a time."""


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


def crossed(
    scene: Scene, formulation: Formulation, parameters: dict[str, Array], t: Array, y: Array
) -> list[tuple[int, int] | None]:
    """Return, of each motion, the states before and behind such a pose, or None.

    States that are not finite are passed over, and those in which a_1 is singular exactly: there
    the right-hand side itself is not finite.

    Args:
        scene: a scene of this kind, where `solves_partition`.
        formulation: the formulation.
        parameters: of each motion, by name.
        t: times (k, motions), s.
        y: state vectors (k, size, motions).
    """
    r, motions = scene.r, t.shape[1]
    kernel = traced_kernel(partition_on, scene, formulation, {"a_1": r * r}, motions)
    block, piece = kernel.block(parameters), max(1, ENTRIES // (r * r * motions))
    found: list[tuple[int, int] | None] = [None] * motions
    known = [(np.empty(0, int), np.empty((0, r, r)))] * motions
    for first in range(0, len(t), piece):
        some = slice(first, first + piece)
        a_1 = kernel.rows(block, t[some], y[some])["a_1"]
        for i in range(motions):
            here = a_1[:, :, i].reshape(-1, r, r)
            usable = np.isfinite(y[some, :, i]).all(axis=1)
            with np.errstate(all="ignore"):
                usable &= np.linalg.slogdet(here).sign != 0
            places = np.concatenate((known[i][0], first + np.flatnonzero(usable)))
            matrices = np.concatenate((known[i][1], here[usable]))
            between = np.flatnonzero(singular_between(matrices))
            if found[i] is None and between.size:
                before, behind = places[between[0] :][:2]
                found[i] = int(before), int(behind)
            known[i] = places[-1:], matrices[-1:]
    return found


def singular_between(A: Array) -> Array:
    """Return whether matrices are singular between each of A (k, r, r), invertible, and the next.

    On the straight line from A to B = A (1 + X) a matrix is singular where A⁻¹ B has a negative
    real eigenvalue: one such, and the determinant changes its sign; two, as where two equal windows
    of a linkage fold at once, and it does not. Of r equal eigenvalues rounding makes complex ones,
    up to an angle of ε^(1/r).
    """
    A, B = A[:-1], A[1:]
    found = np.zeros(len(A), bool)
    with np.errstate(all="ignore"):
        # A sum of 1 and what is smaller has no negative eigenvalue.
        size = np.abs(np.linalg.solve(A, B - A)).sum(axis=2).max(axis=1, initial=0.0)
        far = np.flatnonzero((size >= 1.0) & np.isfinite(size))
        if far.size:
            turned = np.linalg.eigvals(np.linalg.solve(A[far], B[far]))
            flat = np.pi - np.abs(np.angle(turned)) <= allowed_error(1.0) ** (1.0 / A.shape[1])
            found[far] = flat.any(axis=1)
    return found


def crossing(before: float, behind: float) -> RefusedError:
    """Return what is said of a motion that went over such a pose between two times, s."""
    return RefusedError(
        "a_1",
        0.0,
        0.0,
        f"between t = {before:.9g} s and {behind:.9g} s the matrix a_1, the columns of a of "
        "the dependent velocities, is singular: no motion that is solved by it crosses such a pose",
    )

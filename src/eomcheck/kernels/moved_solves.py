"""Solves in which matrix, right-hand sides and solutions are moved by noise, in machine code.

What noise measures takes a solve for each of several copies of one matrix. All are done in one
call: scaled, eliminated and substituted as `eomcheck.numbers.linear` does it for the matrix as it
is, with the pivots that were taken there.
"""

from __future__ import annotations

import numpy as np

from eomcheck.kernels.code import LANES
from eomcheck.kernels.moved_elimination import moved_elimination
from eomcheck.numbers.linear import SOLVERS, Solve, like_present, noise_present, record
from eomcheck.numbers.noise import Noise


def moved_solve(A: np.ndarray, b: np.ndarray, name: str) -> np.ndarray:
    """Solve with A, b and x moved, and each right-hand side by the backward error of its own.

    Where solutions for several right-hand sides are summed and cancel, the latter shows. Nothing is
    refused; what is singular is NaN. Of several noises the first axis of A (..., k, k) and of b
    (..., k) or (..., k, m) is theirs.

    Args:
        A: matrix.
        b: right-hand sides.
        name: what `eomcheck.numbers.linear.solve` is told, and `Watch.like` has.
    """
    noise = noise_present()
    assert noise is not None
    size, copies = A.shape[-1], A[..., 0, 0].size
    many = b[..., 0, :].size // copies if b.ndim == A.ndim else 1
    changes, like, pivots, factors = np.empty(0), None, np.full(size, -1.0), ()
    if noise.moves:
        changes = noise.changes((*noise.shape, size * (size + 3 * many)))
        like = like_present(name)
    if like is not None and like.pivots is not None and like.size == size:
        pivots, rounding = like.pivots, like.rounding
        if rounding is not None:
            factors = rounding.sizes.lu, rounding.scale, rounding.row_scale
    read = b, A, changes, pivots, *factors
    work = np.concatenate([np.asarray(x, np.float64).ravel() for x in read])
    found = np.empty((copies, size + 2))
    room = np.zeros(size * (size + LANES) + 3 * size * (many + LANES) + 3 * size)
    addresses = (x.ctypes.data for x in (work, found, room))
    moved_elimination()(size, many, copies, int(noise.moves), int(factors != ()), *addresses)
    x = work[: b.size].reshape(b.shape).copy()
    if noise.moves:
        sign, exponent, diagonal = found[:, 0], found[:, 1], found[:, 2:]
        with np.errstate(all="ignore"):
            log = np.log2(np.abs(diagonal)).sum(axis=-1) - exponent
        if not noise.shape:
            sign, log = float(sign[0]), float(log[0])
        record(Solve(name, size, np.nan, sign, log), A)
    return noise.array(x)


SOLVERS[Noise] = moved_solve

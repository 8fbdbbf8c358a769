"""Faults to plant into the source: each must be caught, and named."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from pathlib import Path

import eomcheck
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import (
    SCENES,
    Andrews,
    Bicycle,
    Bricard,
    ChainPendulum,
    FlyballGovernor,
    FourBarChain,
    Snake,
)


@dataclass(frozen=True)
class Fault:
    """A change of the source, the claim that must fail first, and what its Finding must say."""

    file: str
    old: str
    new: str
    claim: str
    says: str
    scene: type[Scene] | None = None
    """The one that is looked at, where it is not that of the file."""

    @property
    def id(self) -> str:
        return f"{Path(self.file).stem}: {self.old} => {self.new}"


SNAKE = "scenes/snake.py"
DESCRIBED = "descriptions/"
MOTION, ENERGIES = DESCRIBED + "first_derivation.py", DESCRIBED + "second_derivation.py"
CLOSURES, FORCES = DESCRIBED + "constraint_rows.py", DESCRIBED + "forces.py"
WEIGHED = "generalized-forces", "row θ_"
SLEIGH = "scenes/sleigh.py"
DISK = "scenes/rolling_disk.py"
BALL = "scenes/turntable_ball.py"
BICYCLE = "scenes/bicycle.py"
COMPOSED = "mechanics/derived_functions.py"
SLIPS, WANDERS = ("constraint-jacobian", " wheel "), ("constraint-drift", " wheel ")
WINDOW, PULLED = ("constraint-jacobian", "window"), ("generalized-forces", "row β", Andrews)
RING, MIXED = ("constraint-jacobian", "", Bricard), ("mass-matrix", "entry", Bricard)
WHIRLED = "bias", "row ", Bricard
DAMPED = "generalized-forces", "row ", FlyballGovernor
TURNED = "mass-matrix", "", FlyballGovernor
CLOSING, DRIFTING = ("constraint-jacobian", "K2 at K"), ("constraint-drift", "K2 at K")
SHARED = {
    COMPOSED: ChainPendulum,
    CLOSURES: Andrews,
    FORCES: ChainPendulum,
    MOTION: ChainPendulum,
    ENERGIES: ChainPendulum,
}
"""File of functions that many scenes call -> one of the scenes."""
BANDED, UK = "formulations/banded.py", "formulations/uk.py"
COUPLING = "chain-coupling", "coupling of a chain, entry (joint "
REMAINDER = "chain-remainder", "remainder of a chain, entry (joint "
RESULT = "equations-residual", "[banded]"
KANE = "kane-ml-force", "F_Kane - N q̇ - G"
RATE = "position-rate", "rate of closed positions, "
FAULTS = [
    # M
    Fault(SNAKE, "-mu[i] * sin[i]", "mu[i] * sin[i]", "mass-matrix", "sign"),
    Fault(SNAKE, "mass[i] / 4 + tail", "mass[i] / 2 + tail", "mass-matrix", "(θ_"),
    Fault(SNAKE, " + inertia[i]\n", "\n", "mass-matrix", "(θ_"),
    Fault(SNAKE, "length[j] * mu[i] *", "length[i] * mu[j] *", "mass-matrix", "(θ_"),
    Fault(SNAKE, "cos[j] + sin[i] * sin[j]", "cos[j] - sin[i] * sin[j]", "mass-matrix", "(θ_"),
    Fault(SNAKE, "tail[i] + mass[i]\n", "tail[i] + mass[i - 1]\n", "mass-matrix", "entry"),
    Fault(SNAKE, "length * (mass / 2 + tail)", "length * (mass + tail)", "mass-matrix", "entry"),
    Fault(
        SNAKE,
        "M[i + 2, j + 2] = M[j + 2, i + 2] = c",
        "M[i + 2, j + 2] = c",
        "mass-matrix",
        "missing",
    ),
    # B
    Fault(SNAKE, "B[0] -= mu", "B[0] += mu", "bias", "row x: sign"),
    Fault(SNAKE, "    return B\n", "    return 0 * B\n", "bias", "missing"),
    Fault(SNAKE, "mu[i] * (sin[i] * along -", "mu[i] * (sin[i] * along +", "bias", "row θ_"),
    Fault(SNAKE, "B[i + 2] += length[i]", "B[i + 2] -= length[i]", "bias", "row θ_"),
    Fault(SNAKE, "B[i + 2] += length[i]", "B[i + 2] += 2 * length[i]", "bias", "row θ_"),
    # Q
    Fault(SNAKE, "Q[k + 2] -= torque", "Q[k + 2] += torque", "generalized-forces", "row θ_"),
    Fault(SNAKE, "(theta[joint] - theta", "(-theta[joint] + theta", "generalized-forces", "sign"),
    Fault(SNAKE, "Q[k + 3] += torque", "pass", "generalized-forces", "row θ_"),
    # a and gamma
    Fault(SNAKE, "= -cos_phi[i]\n", "= cos_phi[i]\n", "constraint-jacobian", ", y): sign"),
    Fault(
        SNAKE,
        "-length[i] / 2 * cos_alpha[i]",
        "-length[i] * cos_alpha[i]",
        "constraint-jacobian",
        "2 times too large",
    ),
    Fault(SNAKE, "-length[j] * (cos_phi", "-length[i] * (cos_phi", "constraint-jacobian", "θ_"),
    Fault(
        SNAKE,
        "return cos_alpha * cos - sin",
        "return cos_alpha * cos + sin",
        "constraint-jacobian",
        "wheel",
    ),
    Fault(SNAKE, "    return gamma\n", "    return -gamma\n", "constraint-drift", "sign"),
    Fault(
        SNAKE,
        "cos_phi[i] + omega * (Vx",
        "cos_phi[i] - omega * (Vx",
        "constraint-drift",
        "wheel",
    ),
    Fault(
        SNAKE,
        "        half = length[i] / 2\n",
        "        half = length[i]\n",
        "constraint-drift",
        "wheel",
    ),
    # w′ and its remainder
    Fault(SNAKE, "ww_w = -before", "ww_w = before", "null-space-speeds", "w′"),
    Fault(
        SNAKE,
        "sin_psi + offset * ww_w",
        "sin_psi - offset * ww_w",
        "null-space-speeds",
        "w′",
    ),
    Fault(
        SNAKE,
        "= sin_phi, -half * cos[0]",
        "= sin_phi, half * cos[0]",
        "null-space-speeds",
        "w′",
    ),
    Fault(
        SNAKE,
        "sin_alpha[0] * v[2]",
        "-sin_alpha[0] * v[2]",
        "speeds-velocity",
        "generalized speeds",
    ),
    Fault(
        SNAKE,
        "- offset * omega * omega",
        "+ offset * omega * omega",
        "speeds-remainder",
        "remainder",
    ),
    Fault(
        SNAKE,
        "            turning * sin_delta",
        "            -turning * sin_delta",
        "speeds-remainder",
        "remainder",
    ),
    Fault(SNAKE, "- lever * omega * omega", "", "speeds-remainder", "remainder"),
    Fault(
        SNAKE,
        "spin * cos[0] - turning",
        "spin * cos[0] + turning",
        "speeds-remainder",
        "remainder",
    ),
    Fault(SNAKE, "v[k + 2] = omega", "v[k + 2] = -omega", "speeds-velocity", "q̇"),
    # Kane's bodies
    Fault(
        SNAKE,
        "omega_u[k + 1, 0, i] - omega_u[k, 0, i]",
        "omega_u[k, 0, i] - omega_u[k + 1, 0, i]",
        "active-forces",
        "sign",
    ),
    Fault(SNAKE, "inertia[:, np.new", "inertia[::-1, np.new", "kane-ml-mass", "M_Kane"),
    Fault(SNAKE, "rolling.s_rest,", "-rolling.s_rest,", "kane-ml-force", "N q̇"),
    # the second derivation
    Fault(SNAKE, "v[0], v[1], v[2:]", "v[1], v[0], v[2:]", "mass-matrix", "[casadi]"),
    Fault(
        SNAKE,
        "(x[k + 1] - x[k]) / 2",
        "(x[k + 1] - x[k])",
        "generalized-forces",
        "half of it",
    ),
    # not a number, and nothing at all
    Fault(SNAKE, "    return B\n", "    return B * np.nan\n", "finite-terms", "[B]"),
    Fault(SNAKE, "    return M\n", "    return M * np.nan\n", "finite-terms", "[M]"),
    Fault(SNAKE, "    return Q\n", "    return Q * np.nan\n", "finite-terms", "[Q]"),
    Fault(SNAKE, "    return a, None\n", "    return a * np.nan, None\n", "finite-terms", "[a]"),
    Fault(
        SNAKE,
        "    return a, None\n",
        "    return 0 * a, None\n",
        "constraint-jacobian",
        "missing",
    ),
    Fault(
        "formulations/au.py", "M_Au[n:, :n] = -a", "pass", "refusals", "au, M_Au: refused in vain"
    ),
    Fault(
        "formulations/au.py", "M_Au[:n, :n] = M", "pass", "refusals", "au, M_Au: refused in vain"
    ),
    Fault(
        "formulations/el.py", "M_El[n - r :] = a", "pass", "refusals", "el, M_El: refused in vain"
    ),
    Fault("formulations/im.py", "M_IM[i, i] = 1", "pass", "refusals", "im, M_IM: refused in vain"),
    Fault("formulations/gw.py", "columns[:, :r] = a.T", "pass", "refusals", "refused in vain"),
    Fault("formulations/gw.py", '"M_GW"), lambda_', '"M_GW"), None', "multipliers", "[gw]"),
    # formulations
    Fault("formulations/im.py", "(v, F_Au)", "(v, -F_Au)", "equations-residual", "[im]"),
    Fault("formulations/im.py", "[v.size :]", "[: -v.size]", "equations-residual", "[im]"),
    Fault("formulations/au.py", "n:] = -a.T", "n:] = a.T", "equations-residual", "[au]"),
    Fault("formulations/au.py", "(F, gamma)", "(F, -gamma)", "constraint-acceleration", "[au]"),
    Fault(
        "formulations/au.py",
        "M_Au[n:, :n] = -a",
        "M_Au[n:, :n] = -a[::-1]",
        "constraint-acceleration",
        "[au]",
    ),
    Fault(
        "formulations/el.py",
        "M[second] - reduced",
        "M[second] + reduced",
        "equations-residual",
        "[el]",
    ),
    Fault(
        "formulations/el.py",
        "F[second] - reduced[:, n], -gamma",
        "F[second] - reduced[:, n], gamma",
        "constraint-acceleration",
        "[el]",
    ),
    Fault(
        "formulations/el.py",
        "primed[:, n] = F[first]",
        "primed[:, n] = F[first[::-1]]",
        "equations-residual",
        "[el]",
    ),
    Fault(
        "formulations/gw.py",
        "mobility[:, r] + gamma",
        "mobility[:, r] - gamma",
        "constraint-acceleration",
        "[gw]",
    ),
    Fault(
        "formulations/gw.py", "F + a.T @ lambda_", "F - a.T @ lambda_", "equations-residual", "[gw]"
    ),
    Fault(
        "formulations/em.py",
        "w[first] = -dep",
        "w[first] = dep",
        "null-space-embedding",
        "w of the embedding",
    ),
    Fault(
        "formulations/em.py",
        "rest[first] = -dep",
        "rest[first] = dep",
        "constraint-acceleration",
        "[em]",
    ),
    Fault(
        "formulations/em.py",
        "a[:, first])",
        "a[:, first[::-1]])",
        "null-space-embedding",
        "w of the embedding",
    ),
    Fault(
        "formulations/ml.py", "solve(M_ML, F_ML", "solve(M_ML, -F_ML", "equations-residual", "[ml]"
    ),
    # a chain
    Fault(
        SNAKE,
        "+ Vy * sin_phi[k]",
        "- Vy * sin_phi[k]",
        "chain-velocity",
        "velocity of a chain",
    ),
    Fault(SNAKE, "x[0] * cos_phi + across", "x[0] * cos_phi - across", "chain-velocity", "row x"),
    Fault(SNAKE, "D[1::2] = inertia", "D[1::2] = mass", "chain-energy", "mass of a chain"),
    Fault(SNAKE, "torque[k] - torque[k - 1]", "torque[k] + torque[k - 1]", "chain-forces", "θ_"),
    Fault(SNAKE, "f[-1] = -torque[-1]", "f[-1] = torque[-1]", "chain-forces", "row θ_4"),
    Fault(SNAKE, "sin[j]\n        sin_psi", "cos[j]\n        sin_psi", *COUPLING),
    Fault(SNAKE, "cos_delta, before * sin_psi", "cos_delta, -before * sin_psi", *COUPLING),
    Fault(SNAKE, "sin_delta, -before", "sin_delta, before", *COUPLING),
    Fault(SNAKE, "= -1, half", "= -1, -half", *COUPLING),
    Fault(SNAKE, "= -half * cos_alpha[k]", "= -length[k] * cos_alpha[k]", *COUPLING),
    Fault(SNAKE, "turning * sin_delta - spin", "turning * sin_delta + spin", *REMAINDER),
    Fault(SNAKE, "d[j, 1] = s * omega - turning", "d[j, 1] = -s * omega - turning", *REMAINDER),
    Fault(SNAKE, " - spin * sin_alpha[k]", "", *REMAINDER),
    Fault(SNAKE, "* sin + spin * cos", "* sin - spin * cos", "chain-acceleration", "row x"),
    Fault(SNAKE, "[j + 1] += across", "[j + 1] -= across", *RESULT),
    Fault(SNAKE, "-mass[k] * x", "mass[k] * x", *RESULT),
    Fault(BANDED, "right[i + 2] = rest", "right[i + 2] = -rest", *RESULT),
    Fault(BANDED, "bands[i + 3, 0] = -before", "_ = -before", *RESULT),
    Fault(BANDED, "bands[i, 6] = bands", "bands", *RESULT),
    Fault(
        BANDED, "right[i + 1] = force", "right[i + 1] = -force", "equations-residual", "[banded]"
    ),
    Fault(BANDED, "mass[2 * k + 1]\n", "mass[2 * k]\n", *RESULT),
    Fault(BANDED, "xdot[::2] = found[::4]", "xdot[::2] = found[1::4]", *RESULT),
    Fault(UK, "right[:n] = heavy", "right[:n] = -heavy", "redundant-rows", "[uk, aᵀλ]"),
    Fault(UK, "square[i, i] += 1", "square[i, i] += 2", "redundant-rows", "[uk, |λ|]"),
    Fault(UK, "square[i, i] += 1", "pass", "redundant-rows", "[uk, |λ|]"),
    Fault(UK, "= mu - np", "= mu + np", "redundant-rows", "[uk, aᵀλ]"),
    Fault(UK, "square, G @ mu", "square, 0 * (G @ mu)", "redundant-rows", "[uk, |λ|]"),
    Fault(UK, "F, a[kept], gamma[kept]", "F, a[kept], -gamma[kept]", "redundant-rows", "[uk, q̈]"),
    Fault(UK, "F, a[kept], gamma[kept]", "F, a[kept], gamma[:-1]", "redundant-rows", "[uk, q̈]"),
    Fault(
        UK,
        "mu = au.split(solve(M_UK, F",
        "mu = au.split(solve(M_UK, -F",
        "redundant-rows",
        "[uk, q̈]",
    ),
    Fault(
        UK,
        "return au.split(solve(M_UK, F",
        "return au.split(solve(M_UK, -F",
        "equations-residual",
        "[uk]",
    ),
    Fault(
        UK,
        'return au.split(solve(M_UK, F_UK, "M_UK"), a)',
        'return au.split(solve(M_UK, F_UK, "M_UK"), a)[0], None',
        "multipliers",
        "[uk]",
    ),
    Fault(
        "formulations/kane.py",
        "M_Kane[j, i] = M_Kane[i, j]",
        "M_Kane[j, i] = 0",
        "kane-ml-mass",
        "M_Kane",
    ),
    Fault(
        "formulations/kane.py",
        "partial_velocity, mass, remainder",
        "partial_velocity, mass, -remainder",
        "kane-ml-force",
        "N q̇",
    ),
    Fault(
        "formulations/kane.py",
        "force[i] - left[i]",
        "force[i] + left[i]",
        "kane-ml-force",
        "F_Kane",
    ),
    Fault(SNAKE, "y + length[i] / 2", "y - length[i] / 2", "mass-matrix", "[casadi]"),
    Fault(
        SNAKE,
        "2 * omega[i] * angles.cos",
        "2 * omega[i] * angles.sin",
        "mass-matrix",
        "θ_",
    ),
    # What is made of a description: how bodies move, what weighs, and the second derivation.
    Fault(MOTION, "arm if run.arm else", "at if run.arm else", "kane-ml-mass", "M_Kane"),
    Fault(MOTION, "else cross(axis, reach)", "else cross(reach, axis)", *KANE),
    Fault(MOTION, "centripetal(rates.omega, arm))", "rates.acceleration)", "bias", "row θ_"),
    Fault(MOTION, "ZERO_VECTOR if slot.absolute else L", "L", "mass-matrix", "θ_"),
    Fault(MOTION, "as_point_mass(own) if slot.absolute else own", "own", "mass-matrix", "θ_"),
    Fault(MOTION, "M[slot.coordinate, i] += share", "pass", "mass-matrix", "missing"),
    Fault(MOTION, "ZERO_VECTOR if slot.absolute else moment[k]", "moment[k]", "bias", "row θ_"),
    Fault(MOTION, "cross(frame.arm, force[k])", "cross(force[k], frame.arm)", "bias", "row θ_"),
    Fault(
        MOTION,
        "mass, add_vectors(rates[k].acceleration, relative_acceleration(",
        "mass, add_vectors(ZERO_VECTOR, relative_acceleration(",
        "bias",
        "row θ_",
    ),
    Fault(FORCES, "Q[slot.coordinate] += work", "Q[slot.coordinate] -= work", *WEIGHED),
    Fault(FORCES, "ZERO_VECTOR if slot.absolute else moment[k]", "moment[k]", *WEIGHED),
    Fault(FORCES, "cross(frame.arm, force[k])", "cross(force[k], frame.arm)", *WEIGHED),
    Fault(ENERGIES, "U, times(parameters.mass", "U, times(-parameters.mass", *WEIGHED),
    Fault(ENERGIES, "parent, seat), a)", "parent, a), seat)", *WEIGHED),
    Fault(ENERGIES, "rotate_back(V, axis", "rotate(V, axis", "mass-matrix", "[casadi]"),
    Fault(ENERGIES, "V), ZERO_VECTOR\n", "V), omega\n", "mass-matrix", "[casadi]"),
    Fault(ENERGIES, "cross(omega, a))", "cross(a, omega))", "mass-matrix", "θ_"),
    # What closes loops, springs between points, constant torques.
    Fault(
        CLOSURES,
        "subtract_vectors(a.value, b.value)",
        "subtract_vectors(b.value, a.value)",
        *RATE,
        FourBarChain,
    ),
    Fault(
        CLOSURES,
        "subtract_vectors(a.rate, b.rate)",
        "subtract_vectors(b.rate, a.rate)",
        *WINDOW,
        FourBarChain,
    ),
    Fault(
        CLOSURES,
        "subtract_vectors(a.columns.get",
        "subtract_vectors(b.columns.get",
        *WINDOW,
        FourBarChain,
    ),
    Fault(
        CLOSURES,
        "subtract_vectors(a.acceleration, b.acceleration)",
        "subtract_vectors(b.acceleration, a.acceleration)",
        *DRIFTING,
        Andrews,
    ),
    Fault(CLOSURES, "put(gamma, i, row.drift)", "put(gamma, i, row.rate)", *DRIFTING),
    Fault(CLOSURES, "put(a, (i, j), x)", "put(a, (i, j), -x)", *CLOSING),
    Fault(CLOSURES, "put(c, i, row.rate)", "put(c, i, row.position)", *CLOSING),
    Fault(CLOSURES, "put(residual, i, functions[k]", "put(residual, 0, functions[k]", *RATE),
    Fault(CLOSURES, "x[i] for j, x in", "x[0] for j, x in", *CLOSING),
    Fault(
        CLOSURES,
        "a.columns.items()}, a.acceleration[i]",
        "a.columns.items()}, a.acceleration[0]",
        *DRIFTING,
    ),
    Fault(FORCES, "Q[j] -= share", "Q[j] += share", "generalized-forces", "row γ", Andrews),
    Fault(FORCES, "longer * longer / 2", "longer * longer", "generalized-forces", "row γ", Andrews),
    Fault(FORCES, "force / length", "force", "generalized-forces", "row γ", Andrews),
    Fault(FORCES, "Q[i] += times(grows, t", "Q[i] -= times(grows, t", *PULLED),
    Fault(ENERGIES, "U, parameters.torque", "U, -parameters.torque", *PULLED),
    # The sleigh.
    Fault(SLEIGH, "= -moment * sin,", "= moment * sin,", "mass-matrix", "sign"),
    Fault(SLEIGH, " + moment * offset", "", "mass-matrix", "entry (θ, θ)"),
    Fault(SLEIGH, "omega, -moment", "omega, moment", "bias", "row y: sign"),
    Fault(SLEIGH, "angle.sin[0], -angle", "angle.sin[0], angle", "constraint-jacobian", "y): sign"),
    Fault(SLEIGH, "[omega * (v", "[-omega * (v", "constraint-drift", "row edge: sign"),
    Fault(SLEIGH, "[[cos, 0], [sin, 0]", "[[sin, 0], [cos, 0]", "null-space-speeds", "w′"),
    Fault(SLEIGH, "[-u[0] * u[1]", "[u[0] * u[1]", "speeds-remainder", "remainder"),
    Fault(
        SLEIGH, "u[0] * angle.sin[0], u[1]", "-u[0] * angle.sin[0], u[1]", "speeds-velocity", "q̇"
    ),
    Fault(
        SLEIGH,
        "v[1] * angle.sin[0], v[2]",
        "v[1] * angle.cos[0], v[2]",
        "speeds-velocity",
        "row u_1",
    ),
    Fault(SLEIGH, "[0, offset]", "[0, 2 * offset]", "kane-ml-mass", "M_Kane"),
    Fault(SLEIGH, "[-offset * u[1]", "[offset * u[1]", "kane-ml-force", "N q̇"),
    Fault(SLEIGH, "u[1], u[0] * u[1]]", "u[1], -u[0] * u[1]]", "kane-ml-force", "N q̇"),
    Fault(SLEIGH, "v[0] - swing", "v[0] + swing", "mass-matrix", "[casadi]"),
    # The rolling disk.
    Fault(DISK, "= axial * sin\n    M[3", "= -axial * sin\n    M[3", "mass-matrix", "sign"),
    Fault(DISK, "cos * cos + axial", "cos * cos - axial", "mass-matrix", "entry (ψ, ψ)"),
    Fault(DISK, "R * R * sin * sin", "R * R * cos * cos", "mass-matrix", "entry (θ, θ)"),
    Fault(DISK, "Q[3] = mass", "Q[3] = -mass", "generalized-forces", "row θ: sign"),
    Fault(DISK, "- 2 * across", "- across", "bias", "row ψ"),
    Fault(DISK, "- axial * roll) * turn", "+ axial * roll) * turn", "bias", "row θ"),
    Fault(DISK, "B[4] = axial", "B[4] = -axial", "bias", "row φ: sign"),
    Fault(DISK, "-R * sin[1], 0, -R", "R * sin[1], 0, -R", "constraint-jacobian", "ψ): sign"),
    Fault(DISK, "- R * turn * cos", "+ R * turn * cos", "constraint-drift", "row along"),
    Fault(DISK, "[0, 1, -sin", "[0, 1, sin", "null-space-speeds", "w′"),
    Fault(DISK, "rest[4] = -turn", "rest[4] = turn", "speeds-remainder", "remainder"),
    Fault(DISK, "u[1] - turn * sin", "u[1] + turn * sin", "speeds-velocity", "q̇"),
    Fault(DISK, "[-spin * u[2]", "[spin * u[2]", *KANE),
    Fault(DISK, "R * u[0] * u[2], R", "R * u[0] * u[2], -R", *KANE),
    Fault(DISK, "[(across - axial)", "[(axial - across)", *KANE),
    Fault(DISK, "0, (axial - across)", "0, (across - axial)", *KANE),
    Fault(DISK, "ahead - sin[2]", "ahead + sin[2]", "mass-matrix", "[casadi]"),
    Fault(DISK, "+ R * v[3]", "- R * v[3]", "constraint-jacobian", "[casadi]"),
    # The ball on a turntable.
    Fault(BALL, "= inertia * sin[1]", "= -inertia * sin[1]", "mass-matrix", "sign"),
    Fault(BALL, "B[3] = -inertia", "B[3] = inertia", "bias", "row θ: sign"),
    Fault(BALL, "0, -R * sin[0]", "0, R * sin[0]", "constraint-jacobian", "θ): sign"),
    Fault(BALL, "q.dtype), -table", "q.dtype), table", "constraint-velocity", "row along"),
    Fault(BALL, "gamma = -table", "gamma = table", "constraint-drift", "row along"),
    Fault(BALL, "gamma[0] -= R", "gamma[0] += R", "constraint-drift", "row along x"),
    Fault(BALL, "change[1] += accel", "change[1] -= accel", "constraint-drift", "row along y"),
    Fault(BALL, "W[1, 0] = R, -R", "W[1, 0] = R, R", "null-space-speeds", "w′"),
    Fault(BALL, "offset[:2] = table", "offset[:2] = -table", "speeds-velocity", "speeds"),
    Fault(BALL, "rest[3] = turn", "rest[3] = -turn", "speeds-remainder", "remainder"),
    Fault(BALL, "= u[2] - v[4]", "= u[2] + v[4]", "speeds-velocity", "q̇"),
    Fault(BALL, "= table.reshape", "= -table.reshape", *KANE),
    Fault(BALL, "left * cos[0]\n    return np", "left\n    return np", "mass-matrix", "casadi"),
    Fault(BALL, "+ rate * q[1]", "- rate * q[1]", "constraint-velocity", "row along x"),
    Fault(FORCES, "force + spring.damping", "force - spring.damping", *DAMPED),
    Fault(FORCES, "spring.damping * rate * rate / 2", "spring.damping * rate * rate", *DAMPED),
    Fault(FORCES, "dot(apart.value, apart.rate)", "dot(apart.value, apart.value)", *DAMPED),
    Fault(ENERGIES, "to_local(seat, V), to_local(seat", "V, to_local(seat", *TURNED),
    # The bicycle, and what rolls.
    Fault(BICYCLE, "holonomic = slice(2, 5, 2)", "holonomic = slice(2, 4, 1)", *RATE),
    Fault(
        CLOSURES,
        "add_vectors(scale_vector(share, spoke_rate)",
        "add_vectors(scale_vector(-share, spoke_rate)",
        *WANDERS,
        Bicycle,
    ),
    Fault(
        CLOSURES,
        "share, spoke_rate), scale_vector(shorter, arm)",
        "share, spoke_rate), ZERO_VECTOR",
        *WANDERS,
        Bicycle,
    ),
    Fault(
        CLOSURES,
        "center.rate, cross(spin.rate, arm)",
        "center.rate, cross(arm, spin.rate)",
        *SLIPS,
        Bicycle,
    ),
    Fault(
        CLOSURES,
        "subtract_vectors(apart, cross(arm",
        "subtract_vectors(apart, cross(reach",
        *SLIPS,
        Bicycle,
    ),
    Fault(
        CLOSURES,
        "cross(spin.acceleration, arm), cross(spin",
        "ZERO_VECTOR, cross(spin",
        *WANDERS,
        Bicycle,
    ),
    Fault(CLOSURES, "times(R, rise)", "rise", *RATE, Bicycle),
    Fault(
        CLOSURES,
        "else dot(told[0].value, normal",
        "else dot(told[0].value, told[0]",
        *RATE,
        Bicycle,
    ),
    Fault(
        CLOSURES,
        "cross(normal.value, axis.value)), Z",
        "cross(axis.value, normal.value)), Z",
        *SLIPS,
        Bicycle,
    ),
    Fault(CLOSURES, "omega, found, rates.alpha", "omega, found, rates.omega", *WANDERS, Bicycle),
    # In space
    Fault(CLOSURES, "dot(a.value, b.value),", "dot(a.value, a.value),", *RATE, Bricard),
    Fault(MOTION, "rotate_back(one, axis", "rotate_back(one, 0", "kane-ml-mass", "M_Kane", Bricard),
    Fault(MOTION, "cross(omega, momentum", "cross(rates[k].omega, momentum", *KANE, Bricard),
    Fault(MOTION, "add_vectors(alpha, carried)", "alpha", "bias", "row ", Bricard),
    Fault(MOTION, "cross(rates.omega, inertia_times", "cross(rates.alpha, inertia_times", *WHIRLED),
    Fault(MOTION, "halves[k][i], axes[k][j]", "halves[k][i], axes[j][k]", *MIXED),
    Fault(MOTION, "times(2, square)", "square", *MIXED),
    Fault(CLOSURES, "cross(x, along) for", "cross(along, x) for", *RING),
    Fault(CLOSURES, "cross(rates.alpha, along), ", "along, ", "constraint-drift", "hinge", Bricard),
    Fault(CLOSURES, "in (a, cross(omega, a))", "in (a, cross(a, omega))", *RING),
    Fault(ENERGIES, "rotate_back(omega, axis", "rotate_back(V, axis", *MIXED),
    # What is composed for every scene that gives Jacobians.
    Fault(COMPOSED, "= inertia[k, c, f]", "= -inertia[k, c, f]", "mass-matrix", "entry", Bicycle),
    Fault(
        COMPOSED,
        "            M[j, i] = M[i, j]\n",
        "            pass\n",
        "mass-matrix",
        "missing",
        Bicycle,
    ),
    Fault(
        COMPOSED,
        "B[i] += momentum * linear_rest",
        "B[i] -= momentum * linear_rest",
        "bias",
        "row ",
        Bicycle,
    ),
    Fault(COMPOSED, "return v + 0", "return -v", "speeds-velocity", "sign"),
    Fault(COMPOSED, "        return J_rest\n", "        return -J_rest\n", "kane-ml-force", "N q̇"),
    Fault(
        COMPOSED,
        "    if W is None:\n        return Q\n",
        "    if W is None:\n        return -Q\n",
        "active-forces",
        "sign",
    ),
    Fault(COMPOSED, "return T / 2", "return T", "mass-matrix", "[casadi]"),
]


PACKAGE = Path(eomcheck.__file__).parent


def changed(fault: Fault, package: Path = PACKAGE) -> str:
    """Return the source with the fault; the place must exist, or the fault would test nothing."""
    source = (package / fault.file).read_text(encoding="utf-8")
    head, *rest = source.split(fault.old)
    assert rest, f"{fault.old!r} is no longer in {fault.file}"
    return head + fault.new + fault.old.join(rest)


def scene_of(fault: Fault) -> type[Scene]:
    """Return the kind of scene that shows a fault; one of a formulation shows in a snake."""
    files = {
        Path(inspect.getfile(kind)).relative_to(PACKAGE).as_posix(): kind
        for kind in SCENES.values()
    }
    return fault.scene or SHARED.get(fault.file) or files.get(fault.file, Snake)

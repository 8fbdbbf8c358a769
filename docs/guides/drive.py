"""A differential drive with a caster, as plain NumPy functions.

q = (x, y, φ, θ_r, θ_l, δ, ψ): the middle of the axle, m, the heading, both driven wheels, the
caster's angle to the heading and its roll, rad. Every wheel rolls and does not slip: five
constraints leave two ways to move. The motors' torques are constant, and their bearings take k θ̇.
"""

import numpy as np

m, inertia, ahead = 12.0, 0.4, 0.08  # body: its centre of mass is ahead of the axle
half, radius, J_wheel = 0.2, 0.075, 0.004  # driven wheels
behind, trail, rho, J_caster, J_roll = 0.3, 0.03, 0.025, 0.001, 0.0002  # caster
torque, k = np.array([0.5, 0.2]), 0.01


def M(q):
    full = np.diag([m, m, m * ahead**2 + inertia + J_caster, J_wheel, J_wheel, J_caster, J_roll])
    full[0, 2] = full[2, 0] = -m * ahead * np.sin(q[2])
    full[1, 2] = full[2, 1] = m * ahead * np.cos(q[2])
    full[2, 5] = full[5, 2] = J_caster
    return full


def bias(q, v):
    pull = -m * ahead * v[2] ** 2
    return np.array([pull * np.cos(q[2]), pull * np.sin(q[2]), 0.0, 0.0, 0.0, 0.0, 0.0])


def Q(q, v):
    return np.array([0.0, 0.0, 0.0, *torque, 0.0, 0.0])


def a(q):
    c, s, delta = np.cos(q[2]), np.sin(q[2]), q[5]
    cc, cs = np.cos(q[2] + delta), np.sin(q[2] + delta)
    return np.array(
        [
            [-s, c, 0.0, 0.0, 0.0, 0.0, 0.0],
            [c, s, half, -radius, 0.0, 0.0, 0.0],
            [c, s, -half, 0.0, -radius, 0.0, 0.0],
            [-cs, cc, -behind * np.cos(delta) - trail, 0.0, 0.0, -trail, 0.0],
            [cc, cs, -behind * np.sin(delta), 0.0, 0.0, 0.0, -rho],
        ]
    )


def gamma(q, v):
    chi, turn, swivel = q[2] + q[5], v[2] + v[5], behind * v[2] * v[5]
    sideways = -v[0] * np.sin(q[2]) + v[1] * np.cos(q[2])
    return np.array(
        [
            -v[2] * (v[0] * np.cos(q[2]) + v[1] * np.sin(q[2])),
            v[2] * sideways,
            v[2] * sideways,
            -turn * (v[0] * np.cos(chi) + v[1] * np.sin(chi)) + swivel * np.sin(q[5]),
            turn * (v[1] * np.cos(chi) - v[0] * np.sin(chi)) - swivel * np.cos(q[5]),
        ]
    )


def qdd(q, v):
    A, damping = a(q), np.array([0.0, 0.0, 0.0, k * v[3], k * v[4], 0.0, 0.0])
    full = np.block([[M(q), -A.T], [A, np.zeros((5, 5))]])
    return np.linalg.solve(full, np.concatenate((Q(q, v) - bias(q, v) - damping, -gamma(q, v))))[:7]


# A second derivation: energies and slip, from velocities.


def T(q, v):
    V = v[:2] + ahead * v[2] * np.array([-np.sin(q[2]), np.cos(q[2])])
    turning = inertia * v[2] ** 2 + J_caster * (v[2] + v[5]) ** 2
    return 0.5 * (m * V @ V + turning + J_wheel * (v[3] ** 2 + v[4] ** 2) + J_roll * v[6] ** 2)


def R(q, v):
    return 0.5 * k * (v[3] ** 2 + v[4] ** 2)


def c(q, v):
    def across(x):
        return np.array([-np.sin(x), np.cos(x)])

    def along(x):
        return np.array([np.cos(x), np.sin(x)])

    chi, turn = q[2] + q[5], v[2] + v[5]
    right = v[:2] + v[2] * half * along(q[2])
    left = v[:2] - v[2] * half * along(q[2])
    contact = v[:2] - v[2] * behind * across(q[2]) - turn * trail * across(chi)
    slip = [v[:2] @ across(q[2]), right @ along(q[2]) - radius * v[3]]
    slip += [left @ along(q[2]) - radius * v[4], contact @ across(chi)]
    return np.array([*slip, contact @ along(chi) - rho * v[6]])


if __name__ == "__main__":
    from eomcheck.testing import check_functions

    findings = check_functions(
        7, M=M, bias=bias, Q=Q, R=R, T=T, a=a, c=c, gamma=gamma, qdd=qdd, name="drive"
    )
    for finding in findings:
        if finding.verdict != "passed":
            print(finding)
    raise SystemExit(any(finding.verdict == "failed" for finding in findings))

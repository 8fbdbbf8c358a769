"""A cart on a rail that carries a double pendulum, as plain NumPy functions.

q = (x, θ₁, θ₂): where the cart is, m, and both angles from hanging down, rad. Point masses m₁ and
m₂ at the ends of rods without mass; the rail takes the force d ẋ.
"""

import numpy as np

m0, m1, m2, l1, l2, g, d = 2.0, 0.7, 0.4, 0.6, 0.5, 9.81, 0.3


def M(q):
    c1, c2, c12 = np.cos(q[1]), np.cos(q[2]), np.cos(q[1] - q[2])
    return np.array(
        [
            [m0 + m1 + m2, (m1 + m2) * l1 * c1, m2 * l2 * c2],
            [(m1 + m2) * l1 * c1, (m1 + m2) * l1**2, m2 * l1 * l2 * c12],
            [m2 * l2 * c2, m2 * l1 * l2 * c12, m2 * l2**2],
        ]
    )


def bias(q, v):
    s1, s2, s12 = np.sin(q[1]), np.sin(q[2]), np.sin(q[1] - q[2])
    pull = -(m1 + m2) * l1 * s1 * v[1] ** 2 - m2 * l2 * s2 * v[2] ** 2
    return np.array([pull, m2 * l1 * l2 * s12 * v[2] ** 2, -m2 * l1 * l2 * s12 * v[1] ** 2])


def gravity(q):
    return np.array([0.0, (m1 + m2) * g * l1 * np.sin(q[1]), m2 * g * l2 * np.sin(q[2])])


def qdd(q, v):
    return np.linalg.solve(M(q), -bias(q, v) - gravity(q) - np.array([d * v[0], 0.0, 0.0]))


# A second derivation: energies, from velocities.


def T(q, v):
    first = np.array([v[0] + l1 * np.cos(q[1]) * v[1], l1 * np.sin(q[1]) * v[1]])
    second = first + l2 * v[2] * np.array([np.cos(q[2]), np.sin(q[2])])
    return 0.5 * (m0 * v[0] ** 2 + m1 * first @ first + m2 * second @ second)


def U(q):
    return -m1 * g * l1 * np.cos(q[1]) - m2 * g * (l1 * np.cos(q[1]) + l2 * np.cos(q[2]))


def R(q, v):
    return 0.5 * d * v[0] ** 2


if __name__ == "__main__":
    from eomcheck.testing import check_functions

    findings = check_functions(
        3, M=M, bias=bias, gravity=gravity, qdd=qdd, T=T, U=U, R=R, name="cart"
    )
    for finding in findings:
        if finding.verdict != "passed":
            print(finding)
    raise SystemExit(any(finding.verdict == "failed" for finding in findings))

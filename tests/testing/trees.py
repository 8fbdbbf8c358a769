"""Random trees of bodies by Pinocchio as somebody's own functions: right equations, all."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin


def random_tree(seed: int) -> dict[str, Any]:
    """Return the functions of a random tree of 1 to 5 joints, by name."""
    rng = np.random.default_rng(seed)
    pin.seed(seed)
    model = pin.Model()
    model.gravity.linear = rng.uniform(-10.0, 10.0, 3)
    kinds = [
        pin.JointModelRX,
        pin.JointModelRY,
        pin.JointModelRZ,
        pin.JointModelPX,
        pin.JointModelPZ,
    ]
    scale = 10.0 ** rng.uniform(-3.0, 3.0)
    n = int(rng.integers(1, 6))
    branch = [0]
    for k in range(n):
        kind = kinds[rng.integers(len(kinds))]
        # Depth first, as Pinocchio's recursions want it: what else is cut off the branch.
        branch = branch[: int(rng.integers(len(branch))) + 1]
        joint = model.addJoint(branch[-1], kind(), pin.SE3.Random(), f"joint {k}")
        branch.append(joint)
        body = pin.Inertia.Random()
        body.mass *= scale
        body.inertia = body.inertia * scale
        model.appendBodyToJoint(joint, body, pin.SE3.Random())
    return functions_of_model(model) | {"name": f"tree {seed}"}


def functions_of_model(model: pin.Model) -> dict[str, Any]:
    """Return the functions of a Pinocchio model whose velocities are rates of coordinates."""
    data, n = model.createData(), model.nv
    zero = np.zeros(n)

    def M(q):
        upper = np.triu(pin.crba(model, data, q))
        return upper + np.triu(upper, 1).T

    def gravity(q):
        return pin.computeGeneralizedGravity(model, data, q).copy()

    return {
        "n": n,
        "M": M,
        "bias": lambda q, v: pin.nonLinearEffects(model, data, q, v) - gravity(q),
        "gravity": gravity,
        "C": lambda q, v: pin.computeCoriolisMatrix(model, data, q, v).copy(),
        "qdd": lambda q, v: pin.aba(model, data, q, v, zero).copy(),
        "T": lambda q, v: pin.computeKineticEnergy(model, data, q, v),
        "U": lambda q: pin.computePotentialEnergy(model, data, q),
    }

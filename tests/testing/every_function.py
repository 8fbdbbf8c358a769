"""Every function that equations of motion may have, by Pinocchio: right ones, and what they hold.

Velocities of trees with a fixed base are q̇. A tree with a free base has coordinates x, y, z, roll,
pitch, yaw of the base and then those of the joints, and Pinocchio's velocities, along the base.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
from tests.testing.trees import functions_of_model

Functions = dict[str, Any]

OURS = [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]
"""Index in Pinocchio's parameters of a body, with xx xy yy xz yz zz, of each of ours."""

TOOL = "tool"
WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def random_model(
    seed: int, free: bool = False, joints: int | None = None, chain: str = ""
) -> pin.Model:
    """Return a random tree of 1 to 5 joints with two frames, "tool" at its end and "side".

    With `chain`, such as "RX PZ", each joint hangs on the one before.
    """
    rng = np.random.default_rng(seed)
    pin.seed(seed)
    model = pin.Model()
    model.gravity.linear = rng.uniform(-10.0, 10.0, 3)
    kinds = [pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ]
    kinds += [pin.JointModelPX, pin.JointModelPZ]
    n = int(rng.integers(1, 6)) if joints is None else joints
    names = chain.split()
    branch = [0]
    if free:
        branch = [model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")]
        model.appendBodyToJoint(branch[0], pin.Inertia.Random(), pin.SE3.Random())
    for k in range(len(names) or n):
        # Turning ones first, so that no tree has slides alone; depth first, as recursions want it.
        kind = kinds[rng.integers(3 if k == 0 else len(kinds))]
        branch = branch[: int(rng.integers(len(branch))) + 1]
        if names:
            kind, branch = getattr(pin, f"JointModel{names[k]}"), [k]
        joint = model.addJoint(branch[-1], kind(), pin.SE3.Random(), f"joint {k}")
        branch.append(joint)
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Random())
    for name, joint in ((TOOL, branch[-1]), ("side", branch[0] or 1)):
        model.addFrame(pin.Frame(name, joint, 0, pin.SE3.Random(), pin.FrameType.OP_FRAME))
    return model


def every_function(model: pin.Model) -> Functions:
    """Return all functions of a model whose velocities are rates of its coordinates."""
    data, n = model.createData(), model.nv
    bodies = [model.inertias[k].toDynamicParameters()[OURS] for k in range(1, model.njoints)]

    def derivatives(q, v, tau):
        pin.computeABADerivatives(model, data, q, v, tau)
        upper = np.triu(data.Minv)
        return data.ddq_dq.copy(), data.ddq_dv.copy(), upper + np.triu(upper, 1).T

    def inverse(q, v, vdot):
        pin.computeRNEADerivatives(model, data, q, v, vdot)
        return data.dtau_dq.copy(), data.dtau_dv.copy()

    def inverse_mass_matrix(q):
        upper = np.triu(pin.computeMinverse(model, data, q))
        return upper + np.triu(upper, 1).T

    def regressor(q, v, vdot):
        columns = pin.computeJointTorqueRegressor(model, data, q, v, vdot)
        return columns.reshape(n, -1, 10)[:, :, OURS].reshape(n, -1)

    def center(q, v, vdot):
        pin.centerOfMass(model, data, q, v, vdot)
        return data.com[0].copy(), data.vcom[0].copy(), data.acom[0].copy()

    def momentum_rate(q, v, vdot):
        pin.computeCentroidalMomentumTimeVariation(model, data, q, v, vdot)
        return data.dhg.vector.copy()

    frames = {name: model.getFrameId(name) for name in (TOOL, "side")}

    def of_frames(function: Callable[..., Any]) -> dict[str, Any]:
        return {name: _of_frame(function, id) for name, id in frames.items()}

    def placement(id, q):
        pin.framesForwardKinematics(model, data, q)
        return data.oMf[id].rotation.copy(), data.oMf[id].translation.copy()

    def jacobian(id, q):
        return pin.computeFrameJacobian(model, data, q, id, WORLD).reshape(6, n)

    def velocity(id, q, v):
        pin.forwardKinematics(model, data, q, v)
        pin.updateFramePlacements(model, data)
        return pin.getFrameVelocity(model, data, id, WORLD).vector.copy()

    def acceleration(id, q, v, vdot):
        pin.forwardKinematics(model, data, q, v, vdot)
        pin.updateFramePlacements(model, data)
        return pin.getFrameClassicalAcceleration(model, data, id, WORLD).vector.copy()

    return functions_of_model(model) | {
        "name": "tree",
        "qdd": lambda q, v, tau: pin.aba(model, data, q, v, tau).copy(),
        "inverse_dynamics": lambda q, v, vdot: pin.rnea(model, data, q, v, vdot).copy(),
        "tau_q": lambda q, v, vdot: inverse(q, v, vdot)[0],
        "tau_v": lambda q, v, vdot: inverse(q, v, vdot)[1],
        "qdd_q": lambda q, v, tau: derivatives(q, v, tau)[0],
        "qdd_v": lambda q, v, tau: derivatives(q, v, tau)[1],
        "qdd_tau": lambda q, v, tau: derivatives(q, v, tau)[2],
        "inverse_mass_matrix": inverse_mass_matrix,
        "regressor": regressor,
        "parameters": np.concatenate(bodies),
        "mass": sum(body[0] for body in bodies),
        "com": lambda q: pin.centerOfMass(model, data, q).copy(),
        "com_jacobian": lambda q: pin.jacobianCenterOfMass(model, data, q).reshape(3, n),
        "com_velocity": lambda q, v: center(q, v, np.zeros(n))[1],
        "com_acceleration": lambda q, v, vdot: center(q, v, vdot)[2],
        "momentum_matrix": lambda q: pin.computeCentroidalMap(model, data, q).reshape(6, n),
        "momentum": lambda q, v: pin.computeCentroidalMomentum(model, data, q, v).vector.copy(),
        "momentum_rate": momentum_rate,
        "frame_placement": of_frames(placement),
        "J": of_frames(jacobian),
        "frame_velocity": of_frames(velocity),
        "frame_bias": of_frames(lambda id, q, v: acceleration(id, q, v, np.zeros(n))),
        "frame_acceleration": of_frames(acceleration),
    }


def _of_frame(function: Callable[..., Any], id: int) -> Callable[..., Any]:
    """Return a function of a frame as one of the state: of as many arguments as it has."""
    count = function.__code__.co_argcount - 1
    if count == 1:
        return lambda q: function(id, q)
    return (lambda q, v: function(id, q, v)) if count == 2 else lambda *x: function(id, *x)


def with_free_base(model: pin.Model) -> Functions:
    """Return the functions of a tree with a free base, at roll, pitch and yaw."""

    def configuration(q):
        turned = pin.Quaternion(pin.rpy.rpyToMatrix(*q[3:6])).coeffs()
        return np.concatenate((q[:3], turned, q[6:]))

    def at(function: Any) -> Any:
        if isinstance(function, dict):
            return {name: at(x) for name, x in function.items()}
        if not callable(function):
            return function
        return _with_first(function, configuration)

    def qdot(q, u):
        R = pin.rpy.rpyToMatrix(*q[3:6])
        rates = pin.rpy.computeRpyJacobianInverse(q[3:6], pin.ReferenceFrame.LOCAL) @ u[3:6]
        return np.concatenate((R @ u[:3], rates, u[6:]))

    n = model.nv
    functions = {name: at(x) for name, x in every_function(model).items()}
    return functions | {"n": n, "qdot": qdot, "speeds": n, "holonomic": True, "name": "free tree"}


def _with_first(function: Callable[..., Any], change: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that changes its first argument, with as many arguments as it has."""
    count = function.__code__.co_argcount
    if count == 1:
        return lambda q: function(change(q))
    if count == 2:
        return lambda q, v: function(change(q), v)
    return lambda q, v, more: function(change(q), v, more)

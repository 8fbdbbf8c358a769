"""Plant faults in the conformance quantities of an engine, and count those found by `validate`.

    python -m tests.trials.wrong_quantities [--jobs 2] [--seed 0] [--only ID] [--markdown FILE]

As `tests.trials.wrong_engines`, of which it takes the engines, the command and the table. Named is
a fault for which the output has the method and, where one is given, the sort of the fault. Faults
in derivatives and in maps of velocities are those of a robot with a free base, whose velocities in
the library are along axes of the base.
"""

from __future__ import annotations

from tests.trials import wrong_engines
from tests.trials.wrong_engines import TREE, Fault, Trial

from eomcheck.engines import FURTHER
from eomcheck.evaluation.conformance import QUANTITIES

LEAST = 101
"""So many faults must be found and named: all but "∂τ/∂v for ∂τ/∂q". The state that is shown is at
rest, where ∂τ/∂v vanishes, so that in its own coordinates ∂τ/∂q is "missing"."""

SCENE = "bicycle"
"""Scene in space, with slides and hinges, under gravity."""

FILE = "eomcheck.engines.pinocchio:PinocchioFile"
ROBOT = "tests/scenes/robots/walker.urdf:floating"
"""Robot with a free base, for engines that read files."""

CLAIMS = "mass-matrix,bias,engine-inverse-dynamics,"
CLAIMS += "engine-inverse-dynamics-derivatives,engine-forward-dynamics-derivatives"
"""Claims about what a map of velocities changes, for the robot: all of them take long."""

SIGNATURES = {
    one.name: (
        f"{one.name}(self, {', '.join(one.arguments)}, t=0.0)",
        f"{one.name}({', '.join(one.arguments)}, t)",
    )
    for one in QUANTITIES.values()
} | {name: (f"{name}(self, q, v)", f"{name}(q, v)") for name in FURTHER[:2]}

PLACE = "R, p = super().frame_placement(f, q, t)\n"
CENTER = "c = super().center_of_mass(q, t)\n"
OWN = "own axes"
ANGULAR_FIRST = "angular part first"
SIGN = "wrong sign"
SPATIAL = "spatial acceleration"


def _local(before: str = "") -> str:
    return PLACE + before + "return np.concatenate((R.T @ right[:3], R.T @ right[3:]))"


def _swapped() -> str:
    return "return np.concatenate((right[3:], right[:3]))"


def _float32(factor: str = "right") -> str:
    return f"return np.asarray(np.float32({factor}), float)"


def _sign(row: int) -> str:
    return f"right[{row}] = -right[{row}]\nreturn right"


def _stale(n: int = 3) -> str:
    return (
        f"self.calls += 1\nif self.last is None or self.calls % {n}: self.last = right\n"
        "return self.last"
    )


SPATIAL_VELOCITY = "return np.concatenate((right[:3] - np.cross(right[3:], p), right[3:]))"
OMEGA_CROSS_V = "V = super().frame_velocity(f, q, v, t)\nturning = np.cross(V[3:], V[:3])\n"
NO_BIAS = "return super().frame_acceleration(f, q, 0.0 * v, vdot, t)"
SLIDES = "slides = [kind[0] == 'p' for kind in self.scene.tree().joint]\n"

# ---- Free base ----

MAP, MAP_RATES = FURTHER[:2]
TAU, VDOT = "inverse_dynamics_derivatives", "forward_dynamics_derivatives"
OTHER_AXES = "of the free base turned by R, R its axes"

BASE = """import pinocchio
R = pinocchio.Quaternion(*{x}[[6, 3, 4, 5]]).toRotationMatrix()
W = np.eye(len(v))
W[:3, :3] = W[3:6, 3:6] = R
"""
"""Rotation W (m, m) of the velocity of a base from its own axes to the world's."""

OF_BASE = BASE.format(x="q")
PARTS = "parts = [np.array(x) for x in right]\n"


def _free(id: str, method: str, body: str, says: str) -> Fault:
    return Fault(id, method, body, FILE, says)


def _block(id: str, method: str, block: int, change: str, says: str) -> Fault:
    """Return a fault in one block of derivatives: a statement that changes `x`."""
    body = f"{PARTS}x = parts[{block}]\n{change}\nparts[{block}] = x\nreturn tuple(parts)"
    return _free(id, method, OF_BASE + body, says)


FREE_BASE: tuple[Fault, ...] = (
    # Maps of velocities
    _free("no ∂(S v)/∂q", MAP_RATES, "return 0.0 * right[0], right[1]", "missing"),
    _free("no ∂(Ṡ v)/∂q", MAP_RATES, "return right[0], 0.0 * right[1]", "∂(Ṡ v)/∂q|missing"),
    _free("no derivatives of S", MAP_RATES, "return 0.0 * right[0], 0.0 * right[1]", "missing"),
    _free("sign of ∂(S v)/∂q", MAP_RATES, "return -right[0], right[1]", f"∂(S v)/∂q|{SIGN}"),
    _free("sign of ∂(Ṡ v)/∂q", MAP_RATES, "return right[0], -right[1]", f"∂(Ṡ v)/∂q|{SIGN}"),
    _free("half of ∂(S v)/∂q", MAP_RATES, "return right[0] / 2.0, right[1]", "half"),
    _free(
        "∂(S v)/∂q transposed",
        MAP_RATES,
        "along = right[0].copy()\nalong[:6, :6] = along[:6, :6].T\nreturn along, right[1]",
        "transposed",
    ),
    _free(
        "∂(S v)/∂q and ∂(Ṡ v)/∂q exchanged",
        MAP_RATES,
        "return right[1], right[0]",
        "is not that of velocity_map",
    ),
    _free(
        "∂(S v)/∂q of the linear velocity alone",
        MAP_RATES,
        "along = right[0].copy()\nalong[3:] = 0.0\nreturn along, right[1]",
        "missing",
    ),
    _free("no Ṡ v", MAP, "x, S, rest = right\nreturn x, S, 0.0 * rest", "Ṡ v|missing"),
    _free("sign of Ṡ v", MAP, "x, S, rest = right\nreturn x, S, -rest", f"Ṡ v|{SIGN}"),
    _free(
        "Ṡ v of the angular velocity alone",
        MAP,
        "x, S, rest = right\nrest[:3] = 0.0\nreturn x, S, rest",
        "Ṡ v|missing",
    ),
    _free(
        "S along the world's axes",
        MAP,
        "x, S, rest = right\n" + BASE.format(x="x") + "w = S @ v\n"
        "rest = W @ rest\nrest[:3] += R @ np.cross(w[3:6], w[:3])\nreturn x, W @ S, rest",
        "rows of the free base turned by Rᵀ",
    ),
    # Derivatives of inverse dynamics
    _block("no rows of the base in ∂τ/∂q", TAU, 0, "x[:6] = 0.0", "rows w[0], w[1]|missing"),
    _block("no base columns in ∂τ/∂q", TAU, 0, "x[:, :6] = 0.0", "columns|missing"),
    _block("no base columns in ∂τ/∂v", TAU, 1, "x[:, :6] = 0.0", "columns|missing"),
    _block("sign of rows of the base", TAU, 1, "x[:6] = -x[:6]", f"rows w[0], w[1]|{SIGN}"),
    _block("rows along the world's axes", TAU, 0, "x = W @ x", f"rows {OTHER_AXES}"),
    _block("columns by the world's axes", TAU, 0, "x = x @ W.T", f"columns {OTHER_AXES}"),
    _block(
        "∂τ/∂v along the world's axes", TAU, 1, "x = W @ x @ W.T", f"rows and columns {OTHER_AXES}"
    ),
    _block("∂τ/∂q transposed", TAU, 0, "x = x.T", "transposed"),
    _free("∂τ/∂v for ∂τ/∂q", TAU, "return right[1], right[1]", "∂τ/∂v in place of ∂τ/∂q"),
    _free("∂τ/∂q for ∂τ/∂v", TAU, "return right[0], right[0]", "∂τ/∂q in place of ∂τ/∂v"),
    # Derivatives of forward dynamics
    _block("no rows of the base in ∂v̇/∂q", VDOT, 0, "x[:6] = 0.0", "rows w[0], w[1]|missing"),
    _block("no turns of the base in ∂v̇/∂q", VDOT, 0, "x[:, 3:6] = 0.0", "missing"),
    _block("half of the base in ∂v̇/∂v", VDOT, 1, "x[:, :6] /= 2.0", "columns|half"),
    _block("∂v̇/∂v by the world's axes", VDOT, 1, "x = x @ W.T", f"columns {OTHER_AXES}"),
    _block(
        "∂v̇/∂τ of forces along the world's axes", VDOT, 2, "x = x @ W.T", f"columns {OTHER_AXES}"
    ),
    _block("sign of ∂v̇/∂q", VDOT, 0, "x = -x", SIGN),
    _free(
        "∂τ/∂q for ∂v̇/∂q",
        VDOT,
        "vdot = super().forward_dynamics(q, v, tau, t)\n"
        "by_q, by_v = super().inverse_dynamics_derivatives(q, v, vdot, t)\n"
        "return -by_q, right[1], right[2]",
        "",
    ),
)
"""Faults in the map of the velocities of a free base, and in derivatives by them."""

FAULTS: tuple[Fault, ...] = (
    # Placement
    Fault("R transposed", "frame_placement", "R, p = right\nreturn R.T, p"),
    Fault("position along own axes", "frame_placement", "R, p = right\nreturn R, R.T @ p"),
    Fault("position of the centre of mass", "frame_placement", CENTER + "return right[0], c"),
    Fault("position 1e-6 off", "frame_placement", "R, p = right\nreturn R, p * (1 + 1e-6)"),
    Fault("float32 placement", "frame_placement", "R, p = right\nreturn np.float32(R) * 1.0, p"),
    # Velocity of frames
    Fault("velocity along own axes", "frame_velocity", _local(), says=OWN),
    Fault("velocity, angular first", "frame_velocity", _swapped(), says=ANGULAR_FIRST),
    Fault("velocity of the point at the origin", "frame_velocity", PLACE + SPATIAL_VELOCITY),
    Fault("sign of ω_z", "frame_velocity", _sign(5), says=SIGN),
    Fault(
        "angular velocity in degrees",
        "frame_velocity",
        "right[3:] *= 57.29577951308232\nreturn right",
    ),
    Fault("no angular velocity", "frame_velocity", "right[3:] = 0.0\nreturn right"),
    Fault("float32 velocity", "frame_velocity", _float32()),
    # Jacobian of frames
    Fault("Jacobian along own axes", "frame_jacobian", _local(), says=OWN),
    Fault("Jacobian, angular first", "frame_jacobian", _swapped(), says=ANGULAR_FIRST),
    Fault("sign of a row of J", "frame_jacobian", _sign(5), says=SIGN),
    Fault("no last column of J", "frame_jacobian", "right[:, -1] = 0.0\nreturn right"),
    Fault("columns of J reversed", "frame_jacobian", "return right[:, ::-1]"),
    Fault(
        "J of the point at the origin",
        "frame_jacobian",
        PLACE + "right[:3] -= np.cross(right[3:].T, p).T\nreturn right",
    ),
    Fault(
        "J kept by rounded q",
        "frame_jacobian",
        "return self.kept.setdefault((f, *np.round(q, 1)), right)",
    ),
    Fault(
        "J of the first link",
        "frame_jacobian",
        "self.last = self.last or f\nreturn super().frame_jacobian(self.last, q, t)",
    ),
    Fault("slides in J", "frame_jacobian", SLIDES + "right[:, slides] *= 1.001\nreturn right"),
    Fault(
        "hinges in J",
        "frame_jacobian",
        SLIDES + "right[:, np.logical_not(slides)] *= 1.001\nreturn right",
    ),
    # Acceleration of frames
    Fault(
        "spatial acceleration",
        "frame_acceleration",
        OMEGA_CROSS_V + "right[:3] -= turning\nreturn right",
        says=SPATIAL,
    ),
    Fault("acceleration along own axes", "frame_acceleration", _local(), says=OWN),
    Fault("acceleration without J̇ v", "frame_acceleration", NO_BIAS),
    Fault("acceleration, angular first", "frame_acceleration", _swapped(), says=ANGULAR_FIRST),
    Fault(
        "acceleration without J v̇", "frame_acceleration", "return super().frame_bias(f, q, v, t)"
    ),
    Fault("acceleration with gravity", "frame_acceleration", "right[1] += 9.81\nreturn right"),
    Fault("float32 acceleration", "frame_acceleration", _float32()),
    # Bias of frames
    Fault("no bias of frames", "frame_bias", "return 0.0 * right"),
    Fault("sign of the bias of frames", "frame_bias", "return -right", says=SIGN),
    Fault(
        "spatial bias",
        "frame_bias",
        OMEGA_CROSS_V + "right[:3] -= turning\nreturn right",
        says=SPATIAL,
    ),
    Fault("bias of frames twice", "frame_bias", "return 2.0 * right", says="twice"),
    Fault("bias along own axes", "frame_bias", _local(), says=OWN),
    # Centre of mass
    Fault("centre 1e-6 off", "center_of_mass", "return right * (1 + 1e-6)"),
    Fault("sign of the centre", "center_of_mass", "return -right", says=SIGN),
    Fault(
        "no fourth column of the centre",
        "center_of_mass_jacobian",
        "right[:, 3] = 0.0\nreturn right",
    ),
    Fault(
        "hinges of the centre",
        "center_of_mass_jacobian",
        SLIDES + "right[:, np.logical_not(slides)] *= 1.001\nreturn right",
    ),
    Fault("sign of ċ", "center_of_mass_velocity", "return -right", says=SIGN),
    Fault("stale ċ", "center_of_mass_velocity", _stale()),
    Fault(
        "c̈ without velocities",
        "center_of_mass_acceleration",
        "return super().center_of_mass_acceleration(q, 0.0 * v, vdot, t)",
    ),
    Fault("c̈ less gravity", "center_of_mass_acceleration", "right[2] += 9.81\nreturn right"),
    # Momentum
    Fault(
        "momentum about the origin",
        "momentum",
        CENTER + "right[3:] += np.cross(c, right[:3])\nreturn right",
        says="about",
    ),
    Fault("momentum, angular first", "momentum", _swapped(), says=ANGULAR_FIRST),
    Fault(
        "A about the origin",
        "momentum_matrix",
        CENTER + "right[3:] += np.cross(c, right[:3].T).T\nreturn right",
        says="about",
    ),
    Fault("A, angular first", "momentum_matrix", _swapped(), says=ANGULAR_FIRST),
    Fault("ḣ without Ȧ v", "momentum_rate", "return super().momentum_rate(q, 0.0 * v, vdot, t)"),
    Fault(
        "ḣ about the origin",
        "momentum_rate",
        CENTER + "right[3:] += np.cross(c, right[:3])\nreturn right",
        says="about",
    ),
    # Forces
    Fault("sign of gravity", "gravity", "return -right", says=SIGN),
    Fault("no gravity", "gravity", "return 0.0 * right"),
    Fault("a row of gravity", "gravity", "right[2] *= 1.001\nreturn right"),
    Fault(
        "inverse dynamics without gravity",
        "inverse_dynamics",
        "return right - super().gravity(q, t)",
        says="gravity",
    ),
    Fault(
        "inverse dynamics without bias", "inverse_dynamics", "return right - super().bias(q, v, t)"
    ),
    Fault(
        "gravity twice", "inverse_dynamics", "return right + super().gravity(q, t)", says="gravity"
    ),
    Fault("stale inverse dynamics", "inverse_dynamics", _stale()),
    Fault(
        "inverse dynamics at v̇ = 0",
        "inverse_dynamics",
        "return super().inverse_dynamics(q, v, 0.0 * vdot, t)",
    ),
    Fault(
        "forward dynamics without gravity",
        "forward_dynamics",
        "return super().forward_dynamics(q, v, tau + super().gravity(q, t), t)",
    ),
    Fault("sign of τ", "forward_dynamics", "return super().forward_dynamics(q, v, -tau, t)"),
    Fault("M for its inverse", "inverse_mass_matrix", "return super().mass_matrix(q, t)"),
    Fault(
        "upper triangle of the inverse",
        "inverse_mass_matrix",
        "return np.triu(right)",
        says="triangle",
    ),
    Fault(
        "inverse of the diagonal",
        "inverse_mass_matrix",
        "return np.diag(1.0 / np.diag(super().mass_matrix(q, t)))",
    ),
    Fault("C transposed", "coriolis_matrix", "return right.T"),
    Fault("half of C", "coriolis_matrix", "return right / 2.0", says="half"),
    # Energies and regressor
    Fault("T without 1/2", "kinetic_energy", "return 2.0 * right", says="twice"),
    Fault(
        "T of the other joints",
        "kinetic_energy",
        "w = v.copy()\nw[-1] = 0.0\nreturn super().kinetic_energy(q, w, t)",
    ),
    Fault("sign of U", "potential_energy", "return -right"),
    Fault("half of U", "potential_energy", "return right / 2.0", says="half"),
    Fault(
        "order of products of inertia",
        "regressor",
        "right[:, [6, 7]] = right[:, [7, 6]]\nreturn right",
    ),
    Fault(
        "regressor without gravity",
        "regressor",
        "g, self._gravity = self._gravity, np.zeros(3)\n"
        "wrong = super().regressor(q, v, vdot, t)\n"
        "self._gravity = g\nreturn wrong",
    ),
    Fault("no columns of a body", "regressor", "right[:, -10:] = 0.0\nreturn right"),
    Fault("sign of the regressor", "regressor", "return -right", says=SIGN),
    Fault("float32 regressor", "regressor", _float32()),
)
"""Faults in frames, order, points, signs, rates, gravity, kinds of joints and precision."""


def main() -> int:
    """Run all, print a table, and return the exit code."""
    # A line must have the method and the sort of the fault.
    every = (*FAULTS, *FREE_BASE)
    named = (one._replace(says=f"{one.method}|{one.says}".rstrip("|")) for one in every)
    options = {
        "": ("--scene", SCENE),
        FILE: ("--scene", ROBOT, "--examples", "4", "--claim", CLAIMS),
    }
    return wrong_engines.main(Trial(tuple(named), LEAST, (TREE, FILE), SIGNATURES, options))


if __name__ == "__main__":
    raise SystemExit(main())

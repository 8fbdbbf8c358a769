"""Right models by libraries, as arguments of `check_functions`: URDF, MJCF, random trees, SymPy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from tests.testing.trees import functions_of_model, random_tree

from eomcheck.descriptions.random_trees import urdf_tree
from eomcheck.descriptions.urdf_reader import urdf_text
from eomcheck.errors import required
from eomcheck.mechanics.scene import GeneratorChoices
from eomcheck.testing import EquationsOfMotion, from_kane, from_lagrange
from eomcheck.testing.equations_of_motion import equations_from

MOST_COORDINATES = 12
"""Larger models take minutes and try nothing else."""


class Model(NamedTuple):
    """A right model.

    Attributes:
        origin: the library or the kind that it is counted under.
        name: distinguishes it within its origin.
        make: () -> Functions; None where the file holds no such model.
        single: whether it computes in float32, so that `double-precision` fails, and it alone.
    """

    origin: str
    name: str
    make: Callable[[], EquationsOfMotion | None]
    single: bool = False


def files_of(package: str, *endings: str) -> list[Path]:
    """Return the files of an installed wheel that end so, in order; none where it is missing."""
    try:
        listed = metadata.files(package) or []
    except metadata.PackageNotFoundError:
        return []
    return sorted(Path(str(f.locate())) for f in listed if str(f).endswith(endings))


# ---- Pinocchio -----------------------------------------------------------------------------------


def _pinocchio_tree(seed: int) -> EquationsOfMotion:
    given = random_tree(seed)
    ranges = ((-1.0, 1.0), (-3.0, 3.0), (-10.0, 10.0))[seed % 3]
    return equations_from(given.pop("n"), given | {"ranges": ranges})


def _pinocchio_file(path: Path) -> EquationsOfMotion | None:
    try:
        model = pin.buildModelFromUrdf(str(path))
    except ValueError:  # a fragment, or what urdfdom does not read
        return None
    if not 0 < model.nv <= MOST_COORDINATES or model.nq != model.nv:
        return None
    low, high = np.maximum(model.lowerPositionLimit, -3), np.minimum(model.upperPositionLimit, 3)
    wide = high > low
    ranges = np.column_stack([np.where(wide, low, -1.0), np.where(wide, high, 1.0)])
    given = functions_of_model(model) | {"name": path.stem, "ranges": ranges}
    return equations_from(given.pop("n"), given)


# ---- Drake ---------------------------------------------------------------------------------------


def drake_functions(add: Callable[[Any], None]) -> EquationsOfMotion | None:
    """Return the functions of a plant; `add(parser)` adds a robot whose root is `ground`."""
    multibody = required("pydrake.multibody.plant", "drake")
    plant = multibody.MultibodyPlant(time_step=0.0)
    parser = required("pydrake.multibody.parsing", "drake").Parser(plant)
    add(parser)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("ground"))
    plant.Finalize()
    n = plant.num_velocities()
    if not 0 < n <= MOST_COORDINATES or plant.num_positions() != n:
        return None
    context = plant.CreateDefaultContext()

    def at(q: Any, v: Any = None) -> Any:
        plant.SetPositions(context, q)
        plant.SetVelocities(context, np.zeros(n) if v is None else v)
        return context

    damping = np.zeros(n)
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        start = joint.velocity_start()
        damping[start : start + joint.num_velocities()] = joint.default_damping_vector()

    def qdd(q: Any, v: Any) -> Any:
        return plant.get_generalized_acceleration_output_port().Eval(at(q, v)).copy()

    return EquationsOfMotion(
        n,
        M=lambda q: plant.CalcMassMatrix(at(q)),
        bias=lambda q, v: plant.CalcBiasTerm(at(q, v)),
        gravity=lambda q: -plant.CalcGravityGeneralizedForces(at(q)),
        T=lambda q, v: plant.CalcKineticEnergy(at(q, v)),
        U=lambda q: plant.CalcPotentialEnergy(at(q)),
        Q=lambda q, v: -damping * v,
        qdd=qdd,
        name="drake",
    )


def _drake_tree(seed: int) -> EquationsOfMotion | None:
    choices = GeneratorChoices(np.random.default_rng(seed))
    text = urdf_text(urdf_tree(1 + seed % 5, choices, mimic=False, massless=False))
    return drake_functions(lambda parser: parser.AddModelsFromString(text, "urdf"))


# ---- MuJoCo --------------------------------------------------------------------------------------


def mujoco_functions(model: Any) -> EquationsOfMotion | None:
    """Return the functions of a MuJoCo model without contacts, limits and constraints."""
    mujoco = required("mujoco", "mujoco")
    n = model.nv
    if not 0 < n <= MOST_COORDINATES or model.nq != n or model.na:
        return None
    disabled = mujoco.mjtDisableBit
    model.opt.disableflags |= disabled.mjDSBL_CONSTRAINT | disabled.mjDSBL_ACTUATION
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)

    def at(q: Any, v: Any = None) -> Any:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = q
        data.qvel[:] = 0.0 if v is None else v
        mujoco.mj_forward(model, data)
        return data

    def M(q: Any) -> Any:
        full = np.zeros((n, n))
        mujoco.mj_fullM(model, at(q), full)
        return full

    def weight(q: Any) -> Any:
        return at(q).qfrc_bias.copy()

    def Q(q: Any, v: Any) -> Any:
        found = at(q, v)
        return found.qfrc_passive - found.qfrc_spring

    return EquationsOfMotion(
        n,
        M=M,
        bias=lambda q, v: at(q, v).qfrc_bias.copy() - weight(q),
        gravity=lambda q: weight(q) - at(q).qfrc_spring,
        Q=Q,
        qdd=lambda q, v: at(q, v).qacc.copy(),
        T=lambda q, v: at(q, v).energy[1],
        U=lambda q: at(q).energy[0],
        name="mujoco",
    )


def _mujoco_file(path: Path) -> EquationsOfMotion | None:
    mujoco = required("mujoco", "mujoco")
    try:
        return mujoco_functions(mujoco.MjModel.from_xml_path(str(path)))
    except ValueError:  # a fragment, or files that the wheel leaves out
        return None


# ---- SymPy ---------------------------------------------------------------------------------------


def _numbers(expressions: Any, states: Any, seed: int) -> dict[Any, float]:
    """Return a number for each symbol that is no coordinate, speed or time."""
    import sympy

    dynamic = sympy.physics.mechanics.dynamicsymbols
    symbols = sorted(expressions.free_symbols - {dynamic._t, *states}, key=str)
    rng = np.random.default_rng(seed)
    return {symbol: float(rng.uniform(0.5, 3.0)) for symbol in symbols}


def _chain_on_cart(links: int, seed: int) -> EquationsOfMotion:
    from sympy.physics.mechanics.models import n_link_pendulum_on_cart

    kane = n_link_pendulum_on_cart(links, cart_force=False)
    parameters = _numbers(kane.mass_matrix.row_join(kane.forcing), [], seed)
    return from_kane(kane, parameters, holonomic=True, name=f"{links} on a cart")


def _masses_and_springs(masses: int, seed: int) -> EquationsOfMotion:
    from sympy.physics.mechanics.models import multi_mass_spring_damper

    kane = multi_mass_spring_damper(masses, apply_gravity=bool(seed % 2))
    parameters = _numbers(kane.mass_matrix.row_join(kane.forcing), [], seed)
    return from_kane(kane, parameters, holonomic=True, name=f"{masses} masses")


def _lagrange(which: int, seed: int) -> EquationsOfMotion:
    """Return one of three classical examples, by `LagrangesMethod`."""
    import sympy as sp
    from sympy.physics.mechanics import LagrangesMethod, dynamicsymbols

    m, length, g, k, J = sp.symbols("m l g k J")
    x, y = dynamicsymbols("x y")
    dx, dy = x.diff(), y.diff()
    mechanisms = {
        "a pendulum on a spring": (
            [x, y],
            m * (dx**2 + (length + x) ** 2 * dy**2) / 2
            + m * g * (length + x) * sp.cos(y)
            - k * x**2 / 2,
        ),
        "a spherical pendulum": (
            [x, y],
            m * length**2 * (dx**2 + sp.sin(1 + x / 3) ** 2 * dy**2) / 2
            + m * g * length * sp.cos(1 + x / 3),
        ),
        "a bead on a wheel": (
            [x, y],
            J * dx**2 / 2
            + m * length**2 * (dx**2 + dy**2 + 2 * dx * dy * sp.cos(x - y)) / 2
            - m * g * length * (sp.cos(x) + sp.cos(y)),
        ),
    }
    name, (q, lagrangian) = list(mechanisms.items())[which]
    method = LagrangesMethod(lagrangian, q)
    method.form_lagranges_equations()
    numbers = _numbers(sp.Matrix([lagrangian]), [], seed)
    return from_lagrange(method, numbers, name=name)


def _rolling_disc(seed: int) -> EquationsOfMotion:
    """Return the upright-free rolling disc of SymPy's tests, in its own speeds."""
    import sympy as sp
    from sympy.physics import mechanics as me

    q = me.dynamicsymbols("q1:4")
    u = me.dynamicsymbols("u1:4")
    r, m, g = sp.symbols("r m g")
    ground = me.ReferenceFrame("N")
    yaw = ground.orientnew("Y", "Axis", [q[0], ground.z])
    lean = yaw.orientnew("L", "Axis", [q[1], yaw.x])
    spin = lean.orientnew("R", "Axis", [q[2], lean.y])
    rates = spin.ang_vel_in(ground)
    contact = me.Point("C")
    contact.set_vel(ground, 0)
    center = contact.locatenew("D", r * lean.z)
    spin.set_ang_vel(ground, u[0] * lean.x + u[1] * lean.y + u[2] * lean.z)
    center.v2pt_theory(contact, ground, spin)
    kinematic = [rates.dot(axis) - speed for axis, speed in zip(lean, u, strict=True)]
    inertia = me.inertia(lean, m * r**2 / 4, m * r**2 / 2, m * r**2 / 4)
    disc = me.RigidBody("disc", center, spin, m, (inertia, center))
    kane = me.KanesMethod(ground, q, u, kinematic)
    kane.kanes_equations([disc], [(center, -m * g * yaw.z)])
    numbers = {r: 0.4, m: 1.7, g: 9.81}
    return from_kane(kane, numbers, name=f"disc {seed}")


# ---- All -----------------------------------------------------------------------------------------


def library_models() -> Iterator[Model]:
    """Yield all right models that libraries make, those of missing wheels left out."""
    for seed in range(60):
        yield Model("Pinocchio, random trees", str(seed), partial(_pinocchio_tree, seed))
    for path in files_of("example-robot-data", ".urdf"):
        yield Model("Pinocchio, robots", path.stem, partial(_pinocchio_file, path))
    for seed in range(24):
        yield Model("Drake, random trees", str(seed), partial(_drake_tree, seed))
    for package in ("dm_control", "gymnasium"):
        for path in files_of(package, ".xml"):
            name = f"{path.parent.name}/{path.stem}"
            yield Model(f"MuJoCo, {package}", name, partial(_mujoco_file, path))
    for links in (1, 2, 3):
        for seed in (0, 1):
            name = f"{links} links {seed}"
            yield Model("SymPy, KanesMethod", name, partial(_chain_on_cart, links, seed))
            name = f"{links} masses {seed}"
            yield Model("SymPy, KanesMethod", name, partial(_masses_and_springs, links, seed))
            name = f"lagrange {links} {seed}"
            yield Model("SymPy, LagrangesMethod", name, partial(_lagrange, links - 1, seed))
    yield Model("SymPy, KanesMethod", "rolling disc", partial(_rolling_disc, 0))

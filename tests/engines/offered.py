"""Quantities that each library computes, by the classes of its engines."""

from __future__ import annotations

from eomcheck.engines import Engine
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.engines.dart import DartEngine, DartFile
from eomcheck.engines.drake import DrakeEngine, DrakeFile
from eomcheck.engines.exudyn import ExudynEngine
from eomcheck.engines.idyntree import IdyntreeEngine, IdyntreeFile
from eomcheck.engines.mujoco import MjcfFile, MujocoEngine, MujocoFile
from eomcheck.engines.mujoco_warp import MujocoWarpEngine, MujocoWarpFile, MujocoWarpMjcf
from eomcheck.engines.newton import NewtonEngine, NewtonFile, NewtonMjcf
from eomcheck.engines.opensim import OpensimEngine
from eomcheck.engines.pybullet import PybulletEngine, PybulletFile
from eomcheck.engines.roboticstoolbox import RoboticsToolboxEngine, RoboticsToolboxFile
from eomcheck.engines.sympy_mechanics import SympyEngine

FRAMES = {"frame_placement", "frame_velocity"}
FRAME_MOTIONS = FRAMES | {"frame_jacobian", "frame_acceleration", "frame_bias"}
DERIVATIVES = {"inverse_dynamics_derivatives", "forward_dynamics_derivatives"}
MUJOCO = {
    *("inverse_dynamics", "forward_dynamics", "inverse_mass_matrix", "gravity"),
    *("kinetic_energy", "potential_energy", "center_of_mass", "center_of_mass_jacobian"),
    *("center_of_mass_velocity", "momentum", "momentum_matrix", "inverse_dynamics_derivatives"),
    *FRAME_MOTIONS,
}
PYBULLET = {"inverse_dynamics", "gravity", "frame_jacobian"} | FRAMES
EXUDYN = {"forward_dynamics", "gravity", "frame_acceleration", "frame_bias"} | FRAMES
DRAKE = {
    *("inverse_dynamics", "forward_dynamics", "gravity", "kinetic_energy", "potential_energy"),
    *("center_of_mass", "center_of_mass_jacobian", "center_of_mass_velocity"),
    *("center_of_mass_acceleration", "momentum"),
    *FRAME_MOTIONS | DERIVATIVES,
}
DART = {
    *("inverse_dynamics", "forward_dynamics", "inverse_mass_matrix", "gravity"),
    *("kinetic_energy", "potential_energy", "center_of_mass", "center_of_mass_jacobian"),
    *("center_of_mass_velocity", "center_of_mass_acceleration", "momentum"),
    *FRAME_MOTIONS,
}
MUJOCO_WARP = MUJOCO - {
    *("center_of_mass_jacobian", "momentum_matrix", "frame_bias", "inverse_dynamics_derivatives"),
}
NEWTON = {"inverse_dynamics", "forward_dynamics", "gravity", "frame_jacobian"} | FRAMES
IDYNTREE = {
    *("inverse_dynamics", "gravity", "coriolis_matrix", "regressor"),
    *("center_of_mass", "center_of_mass_jacobian", "center_of_mass_velocity"),
    *("center_of_mass_acceleration", "momentum", "momentum_matrix"),
    *FRAME_MOTIONS,
}
CASADI = {
    *("inverse_dynamics", "forward_dynamics", "gravity", "coriolis_matrix"),
    *("kinetic_energy", "potential_energy", "constraint_force_derivatives"),
    *DERIVATIVES,
}
OFFERED: dict[type[Engine], set[str]] = {
    CasadiEngine: CASADI,
    DrakeEngine: DRAKE,
    DrakeFile: DRAKE,
    DartEngine: DART,
    DartFile: DART,
    IdyntreeEngine: IDYNTREE,
    IdyntreeFile: IDYNTREE,
    MujocoEngine: MUJOCO,
    MujocoFile: MUJOCO,
    MjcfFile: MUJOCO,
    MujocoWarpEngine: MUJOCO_WARP,
    MujocoWarpFile: MUJOCO_WARP,
    MujocoWarpMjcf: MUJOCO_WARP,
    NewtonEngine: NEWTON,
    NewtonFile: NEWTON,
    NewtonMjcf: NEWTON,
    PybulletEngine: PYBULLET,
    PybulletFile: PYBULLET,
    ExudynEngine: EXUDYN,
}
"""Engine -> the quantities that its library computes."""

OPENSIM = {
    *("inverse_dynamics", "forward_dynamics", "inverse_mass_matrix", "gravity"),
    *("kinetic_energy", "potential_energy", "center_of_mass", "center_of_mass_velocity"),
    *("momentum", "frame_placement", "frame_velocity", "frame_jacobian", "frame_bias"),
}
TOOLBOX = {
    *("inverse_dynamics", "forward_dynamics", "gravity"),
    *("frame_placement", "frame_jacobian", "frame_bias"),
}
SYMPY = {
    *("inverse_dynamics", "gravity", "kinetic_energy", "center_of_mass", "momentum"),
    *FRAME_MOTIONS,
}
CLASSIC: dict[type[Engine], set[str]] = {
    OpensimEngine: OPENSIM,
    RoboticsToolboxEngine: TOOLBOX,
    RoboticsToolboxFile: TOOLBOX,
    SympyEngine: SYMPY,
}
"""Engine of a library that is not asked by default -> the quantities that it computes."""

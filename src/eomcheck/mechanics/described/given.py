"""The parameters of mechanisms by description: what there may be, and what equations make of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from eomcheck.mechanics.parameters import parameter
from eomcheck.numbers.generic import generic

if TYPE_CHECKING:
    from eomcheck.mechanics.described.mechanism import Made

DRAWN: dict[str, tuple[str, str, Any, Any]] = {
    "orientation": ("quaternions of seats that are turned, of any length", "1", "", (0.1, 1.0)),
    "offset": ("positions of seats", "m", "", (-1.0, 1.0)),
    "mass": ("of bodies", "kg", ">= 0", (0.1, 10.0)),
    "center": ("centres of mass", "m", "", (-1.0, 1.0)),
    "moments": ("I, central, about the axes", "kg m²", "", (0.6, 1.0)),
    "products": ("entries xy, xz, yz of I, central", "kg m²", "", (-0.02, 0.02)),
    "gravity": ("acceleration", "m/s²", "", (-20.0, 20.0, None)),
    "ratio": ("of joints that follow others", "1", "", (0.2, 2.0)),
    "shift": ("their position where the other's is 0", "rad or m", "", (-1.0, 1.0)),
    "stiffness": ("of springs at joints", "N m/rad or N/m", ">= 0", (0.0, 100.0)),
    "relaxed": ("where they rest", "rad or m", "", (-1.0, 1.0)),
    "damping": ("of dampers at joints", "N m s/rad or N s/m", ">= 0", (0.0, 10.0, None)),
    "armature": ("inertia of rotors", "kg m² or kg", ">= 0", (0.01, 1.0)),
    "points": ("of closures", "m", "", (-1.0, 1.0)),
    "directions": ("of closures, of any length", "1", "", (0.1, 1.0)),
    "lengths": ("of rods", "m", "> 0", (0.5, 2.0)),
    "surfaces": ("three bends, three slopes and a level", "1/m, 1, m", "", (0.1, 1.0)),
    "couplings": ("ratio and shift", "1, rad or m", "", (0.2, 2.0)),
    "drives": ("position, rate, acceleration", "rad or m, /s, /s²", "", (-1.0, 1.0)),
}
"""Name -> what it is, its unit, its sign, what it is drawn from."""

GEOMETRY = frozenset(
    {"orientation", "offset", "points", "directions", "lengths", "surfaces", "couplings"}
)
"""What decides whether a mechanism closes."""

NOT_READ = ("orientation", "moments", "products", "armature")
"""What equations read as something else."""

OPTIONAL = frozenset({"gravity", "damping"})


def fields_of(made: Made) -> dict[str, Any]:
    """Return the fields of the class of a description, its parameters."""
    found = {}
    for name, value in made.defaults:
        what, unit, sign, drawn = DRAWN[name]
        among = None if made.closed and name in GEOMETRY else drawn
        shape = (2 if made.topology.planar else 3,) if name == "gravity" else np.shape(value)
        found[name] = parameter(
            *(what, unit, sign, among, shape),
            default=value,
            optional=name in OPTIONAL,
            read=name not in NOT_READ,
        )
    return found


@generic
def inertias(moments: Any, products: Any, armature: Any, e: int) -> Any:
    """Return I (n_b, e, e) of bodies, then of rotors, about their last axis; each may be None."""
    counts = [0 if one is None else one.shape[0] for one in (moments, armature)]
    bodies, rotors = counts
    inertia = np.zeros((bodies + rotors, e, e), (armature if bodies == 0 else moments).dtype)
    for k in range(bodies):
        for i in range(e):
            inertia[k, i, i] = moments[k] if e == 1 else moments[k, i]
    for place, (i, j) in enumerate(((0, 1), (0, 2), (1, 2)) if e == 3 else ()):
        for k in range(bodies):
            inertia[k, i, j] = inertia[k, j, i] = products[k, place]
    for k in range(rotors):
        inertia[bodies + k, e - 1, e - 1] = armature[k]
    return inertia

"""The trailer once more, as a description: one link on a planar joint, and its axle."""

from typing import Any

import numpy as np

from eomcheck.descriptions import elements
from eomcheck.descriptions.described_scene import GROUND, Described, Description
from eomcheck.mechanics.parameters import parameter


def description(parameters):  # behind the hitch is -x; the axle's velocity along itself is along y
    back, axle = parameters.back[0], parameters.axle[0]
    return Description(
        links=[elements.Link("trailer", parameters.mass[0], center=(-back, 0, 0))],
        joints=[elements.Joint("hitch", "planar", GROUND, "trailer")],
        coordinates=("hitch_turn", "hitch_x", "hitch_y"),
        constraints=[elements.knife_edge("axle", "trailer", across=(0, 1, 0), at=(-axle, 0, 0))],
        planar=True,
    )


class Trailer(Described, description=description, closed=True, held=False):
    """A trailer on two wheels."""

    mass: Any = parameter("m", "kg", "> 0", (100.0, 1000.0), (1,), default=(300.0,))
    inertia: Any = parameter("central", "kg m²", ">= 0", (50.0, 500.0), (1,), default=(200.0,))
    back: Any = parameter("from the hitch back to the centre of mass", "m", default=2.5)
    axle: Any = parameter("from the hitch back to the axle", "m", default=2.8)

    key, conserves_energy, angle_coordinates = "trailer-in-words", True, slice(0, 1)
    named_coordinates, named_constraints = ("θ", "x", "y"), ("axle",)

    def initial_state(self):
        return np.zeros(3), np.array([0.5, 2.0, 1.4])  # turning: ẏ = 2.8 m θ̇

"""A four-bar mechanism by description: three links in a row, and a pin that closes them."""

from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import Joint, Link, pin


def rod(name, length):
    moment = length**3 / 12  # of a slender rod of 1 kg/m
    return Link(name, mass=length, center=(length / 2, 0, 0), moments=(0, moment, moment))


FourBar = mechanism(
    "FourBar",
    [Link("ground"), rod("crank", 0.8), rod("coupler", 1.2), rod("rocker", 1.0)],
    [
        Joint("α", "revolute", "ground", "crank"),
        Joint("β", "revolute", "crank", "coupler", origin=(0.8, 0, 0)),
        Joint("γ", "revolute", "coupler", "rocker", origin=(1.2, 0, 0), damping=0.2),
    ],
    [pin("window", "rocker", "ground", at=(1.0, 0, 0), at_other=(1.5, 0, 0))],
    gravity=(0, -9.81, 0),
    dependent=("β", "γ"),
    pose={"α": 1.3, "β": -1.0, "γ": -1.6},
)

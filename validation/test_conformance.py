"""Quantities of rigid-body libraries: rates of each other, terms of the scene, and an engine's."""

import pytest

from validation.harness import holds


@pytest.mark.parametrize(
    "claim",
    [
        "center-of-mass-rates",
        "momentum-rates",
        "frame-rates",
        "weight-gradient",
        "coriolis-identities",
        "regressor-identity",
    ],
)
@pytest.mark.sampled(2)
def test_quantities_of_the_tree_of_bodies_are_rates_of_each_other(claim: str, links, few):
    holds(claim, links, few)


@pytest.mark.parametrize(
    "claim",
    [
        "engine-inverse-dynamics",
        "engine-forward-dynamics",
        "engine-inverse-mass-matrix",
        "engine-gravity",
        "engine-coriolis-matrix",
        "engine-kinetic-energy",
        "engine-potential-energy",
        "engine-center-of-mass",
        "engine-center-of-mass-jacobian",
        "engine-center-of-mass-velocity",
        "engine-center-of-mass-acceleration",
        "engine-momentum",
        "engine-momentum-matrix",
        "engine-momentum-rate",
        "engine-frame-placement",
        "engine-frame-velocity",
        "engine-frame-jacobian",
        "engine-frame-acceleration",
        "engine-frame-bias",
        "engine-inverse-dynamics-derivatives",
        "engine-forward-dynamics-derivatives",
        "engine-constraint-force-derivatives",
        "engine-regressor",
    ],
)
@pytest.mark.sampled(4)
def test_a_library_computes_the_same_quantities(claim: str, links, few):
    holds(claim, links, few)

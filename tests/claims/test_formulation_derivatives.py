"""The claim about derivatives of accelerations by all formulations."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest
from tests.samples import random_state

import eomcheck
from eomcheck.claims import CLAIMS, formulation_derivatives
from eomcheck.claims.formulation_derivatives import EVERY, SYMBOLS
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES, ChainPendulum, Snake

ONLY = {"claims": ["derivatives"], "engines": []}
every_scene = pytest.mark.parametrize("kind", SCENES.values(), ids=lambda kind: kind.key)


class Pushed(Snake, functions=()):
    """A snake whose chain takes twice the additional forces."""

    @staticmethod
    def chain_load(parameters, prepared, tau):
        force, multipliers = Snake.chain_load(parameters, prepared, tau)
        return 2 * force, multipliers


class Carried(Snake, functions=()):
    """A snake whose chain has another λ under additional forces."""

    @staticmethod
    def chain_load(parameters, prepared, tau):
        force, multipliers = Snake.chain_load(parameters, prepared, tau)
        return force, -multipliers


def ordinary(scene: Scene) -> State:
    return random_state(scene, np.random.default_rng(0))


def snake(kind: type[Snake] = Snake) -> Snake:
    return kind([1.0, 2.0], [1.0, 0.5], [0.1, 0.2], [3.0], [0.1, -0.2])


@pytest.mark.sampled(3)
@every_scene
def test_all_formulations_have_the_same_derivatives_in_doubles_and_exactly(kind):
    scene = kind.example()
    state = ordinary(scene)
    found = eomcheck.check_state(scene, *state, **ONLY)
    keys = {one.subject.split(", ")[1].split(" ~ ")[0] for one in found}
    assert {one.verdict for one in found} == {"passed"}
    assert keys == set(eomcheck.formulations.applicable(scene)) - {"im"}
    proved = [one for one in eomcheck.prove(scene, points=1) if one.claim == "derivatives"]
    assert {one.verdict for one in proved} == {"passed"}
    assert {one.subject for one in proved} >= {one.subject for one in found}


@pytest.mark.parametrize(("kind", "symbol"), [(Pushed, "∂v̇/∂τ"), (Carried, "∂λ/∂τ")])
def test_a_wrong_derivative_is_named_with_its_formulation_matrix_row_and_column(kind, symbol):
    scene = snake(kind)
    found = eomcheck.check_state(scene, *ordinary(scene), **ONLY)
    failed = [one for one in found if one.verdict == "failed"]
    assert f"{symbol}, banded ~ im" in [one.subject for one in failed]
    assert all("banded" in one.subject for one in failed)
    assert all(one.detail.startswith("derivatives, entry (") for one in failed)
    disproofs = [one for one in eomcheck.prove(scene, points=1) if one.verdict == "failed"]
    assert {one.subject for one in disproofs} == {one.subject for one in failed}
    assert all(one.detail.startswith("derivatives, entry (") for one in disproofs)


def test_a_small_error_of_one_entry_is_found(monkeypatch):
    scene = ChainPendulum.example()
    state = ordinary(scene)
    claim = CLAIMS["derivatives"]
    right = eomcheck.claims.formulation_derivatives.derivative_arrays

    def wrong(at, formulation, directions):
        arrays = right(at, formulation, directions)
        if formulation.key == "kane":
            arrays["v"][1, 2] += 1e-9 * np.abs(arrays["v"]).max()
        return arrays

    monkeypatch.setattr("eomcheck.claims.formulation_derivatives.derivative_arrays", wrong)
    (one,) = [x for x in eomcheck.check_state(scene, *state, **ONLY) if x.verdict == "failed"]
    names = scene.coordinate_names
    assert one.subject == "∂v̇/∂v, kane ~ im" and claim.term == "derivatives"
    assert one.detail.startswith(f"derivatives, entry ({names[1]}, {names[2]})")


def test_what_is_allowed_is_the_sum_of_both_bounds():
    scene = ChainPendulum.example()
    state = ordinary(scene)
    kane, im = (eomcheck.derivatives(scene, key, *state[:2]) for key in ("kane", "im"))
    found = {x.subject: x.allowed for x in eomcheck.check_state(scene, *state, **ONLY)}
    for name in ("q", "v", "tau"):
        bounds = kane.error_bounds[name] + im.error_bounds[name]
        assert found[f"{SYMBOLS[name]}, kane ~ im"] == pytest.approx(bounds)


def test_it_runs_in_every_kth_state_of_a_run_unless_it_is_named():
    scene = ChainPendulum.example()
    states = {}
    for claims in (None, ["derivatives"]):
        selection = RunSelection.of(["im", "au"], [], claims, scenes=[scene])
        run = ValidationRun()
        run.validate_scene(scene, selection, EVERY + 1, 0)
        found = [one for one in run.findings if one.claim == "derivatives"]
        states[claims is None] = Counter(one.subject for one in found)[f"{SYMBOLS['q']}, au ~ im"]
    assert states == {True: 3, False: EVERY + 2}


def test_claims_about_engines_run_in_every_state_if_engines_are_named():
    scene, asked = ChainPendulum.example(), CLAIMS["engine-gravity"]
    rates = CLAIMS["center-of-mass-rates"]
    usual = RunSelection.of(["im"], None, None, scenes=[scene])
    named = RunSelection.of(["im"], ["pinocchio"], None, scenes=[scene])
    assert [usual.leaves_out(asked, i) for i in range(9)] == [i % asked.every > 0 for i in range(9)]
    assert not any(named.leaves_out(asked, i) for i in range(9))
    assert asked.every == rates.every == 4 and named.leaves_out(rates, 1)


def test_formulations_that_read_terms_are_compared_along_all_directions(monkeypatch):
    """They define accelerations at velocities that violate the constraints too."""

    def none(*_: Any) -> Any:
        raise AssertionError("along tangents alone")

    monkeypatch.setattr(formulation_derivatives, "tangent_directions", none)
    scene = SCENES["sleigh"].example()
    options: dict[str, Any] = {"claims": ["derivatives"], "formulations": ["im", "au"]}
    found = eomcheck.check_state(scene, *scene.initial_state(), **options)
    assert {x.verdict for x in found} == {"passed"}

"""Rolling constraints by declaration against hand-derived scenes with generalized speeds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.mechanics.descriptions import GROUND
from tests.samples import random_scene, random_state
from tests.scenes.by_hand import Residues

import eomcheck
from eomcheck import acceleration
from eomcheck.descriptions import elements
from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.described_scene import Described, Description
from eomcheck.descriptions.elements import Joint, Link
from eomcheck.descriptions.vector_algebra import rotation_matrix
from eomcheck.errors import InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import check_consistent
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.mechanics.parameters import diagonal, parameter
from eomcheck.scenes import RollingDisk, TurntableBall

X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
EULER = ("ψ", Z, "heading"), ("θ", X, "leaning"), ("φ", Y, "body")
LEAN = 4
"""Index of θ in x, y, z, ψ, θ, φ."""


def free(**last: Any) -> list[Joint]:
    """Return the joints from the ground to a body by x, y, z, ψ, θ, φ."""
    slides = zip("xyz", (X, Y, Z), ("ahead", "aside", "above"), strict=True)
    found, before = [], "ground"
    for name, axis, child in slides:
        found.append(Joint(name, "prismatic", before, child, axis=axis))
        before = child
    for name, axis, child in EULER:
        found.append(Joint(name, "revolute", before, child, axis=axis))
        before = child
    return [*found[:-1], found[-1]._replace(**last)]


# ---- The disk ------------------------------------------------------------------------------------


def disk_in_words(parameters: Any) -> Description:
    floor, spoke = ("ground", elements.ORIGIN), (("leaning", Z),)
    contact = elements.Contact(("body", elements.ORIGIN), floor, parameters.radius[0], spoke)
    closing = [
        contact.rolling("along", ("heading", X)),
        contact.rolling("across", ("heading", Y)),
        contact.touching("up", ("ground", Z)),
    ]
    down = (0, 0, -parameters.gravity[0])
    body, joints = Link("body", parameters.mass[0]), free(symmetric=True)
    return Description([body], joints, constraints=closing, gravity=down)


class DiskInWords(Described, description=disk_in_words, closed=True):
    """The rolling disk with its height as a coordinate."""

    mass: Any = parameter("m", "kg", "> 0", shape=(1,))
    radius: Any = parameter("R", "m", "> 0")
    inertia: Any = parameter("across, axial, across", "kg m²", shape=(1, 3, 3))
    gravity: Any = parameter("g", "m/s²")

    key, conserves_energy, angle_coordinates = "disk-in-words", True, slice(3, None)
    named_coordinates = "x", "y", "z", "ψ", "θ", "φ"
    named_constraints, holonomic = ("along", "across", "up"), slice(2, 3)

    def initial_state(self):
        return np.array([0.0, 0.0, float(self.radius), 0.0, 0.0, 0.0]), np.zeros(6)


def disks(seed: int) -> tuple[RollingDisk, DiskInWords]:
    disk = random_scene(RollingDisk, np.random.default_rng(seed))
    inertia = np.diag([disk.across, disk.axial, disk.across])[None]
    return disk, DiskInWords(np.full(1, disk.mass), disk.radius, inertia, disk.gravity)


def test_a_disk_in_words_has_exactly_the_terms_of_the_disk_by_hand():
    disk, described = disks(1)
    numbers: Any = Residues()
    q, v = (numbers.numbers(np.arange(k, k + 5.0) ** 2) for k in (2.0, 3.0))
    theirs = Quantities(disk, numbers, q)
    theirs.v = v
    cos, sin, R = theirs.prepared.cos[1], theirs.prepared.sin[1], theirs.parameters.radius[0]
    zero = 0 * R
    # z = R cos θ, which the hand-written disk does not have.
    T = np.insert(np.eye(5, dtype=int).astype(object) + zero, 2, zero, axis=0)
    T[2, 3], more = -R * sin, np.full(6, zero)
    more[2] = -R * cos * v[3] * v[3]
    ours = Quantities(described, numbers, np.insert(q, 2, R * cos))
    ours.v = T @ v
    M, Q, B, a, gamma, b = ours.terms
    assert (T.T @ M @ T == theirs.terms.M).all()
    assert (T.T @ Q == theirs.terms.Q).all()
    assert (T.T @ (B + M @ more) == theirs.terms.B).all()
    assert ((a @ T)[:2] == theirs.terms.a).all()
    assert ((gamma + a @ more)[:2] == theirs.terms.gamma).all()
    assert b is None
    # And its height is constant.
    assert (a @ T)[2].tolist() == [0] * 5
    assert (gamma + a @ more)[2] == 0
    (height,) = described.position_residual(ours.parameters, ours.prepared, ours.q)
    assert height == 0


@pytest.mark.night
def test_a_wheel_that_is_not_alike_all_round_is_disproved():
    disk, described = disks(1)
    # In a proof its inertia is arbitrary: only claims on the rotational symmetry then fail.
    found = {f.claim for f in eomcheck.prove(described, points=1, seed=0) if f.verdict == "failed"}
    assert "mass-matrix" in found
    assert not found & {"constraint-jacobian", "constraint-drift", "position-rate"}

    class Round(DiskInWords):
        """The same disk with the inertia of a disk."""

        def derived(self, arithmetic):
            given = arithmetic.numbers(self.inertia)
            return {"inertia": diagonal(given[:, [0, 1, 0], [0, 1, 0]])}

    round_one = Round(np.full(1, disk.mass), disk.radius, described.inertia, disk.gravity)
    findings = eomcheck.prove(round_one, points=1, seed=0)
    assert {f.verdict for f in findings} == {"passed"}


def leaning(disk: RollingDisk) -> Any:
    """Return the disk whose rim is given by its axis alone, on a tilted plane."""
    R, half = float(disk.radius), (0.8, 0.3, -0.2, 0.1)
    across, axial = float(disk.across), float(disk.axial)
    body = Link("body", float(disk.mass), moments=(across, axial, across))
    tilted = [free()[0]._replace(orientation=half), *free()[1:]]
    up = rotation_matrix(half) @ (0.0, 0.0, 1.0)
    closing = elements.rolling_disk("rim", "body", "ground", R, axis=(0, 2, 0), across=up.tolist())
    return mechanism(
        *("Leaning", [GROUND, *(Link(x.child) for x in tilted[:-1]), body], tilted, closing),
        gravity=tuple((-float(disk.gravity) * up).tolist()),
        dependent=("z", "x", "y"),
        pose={"z": R * 0.9, "θ": 0.4},
    )()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("lean", [-1.2, 0.0, 0.7])
def test_a_rim_told_by_its_axis_rolls_as_the_disk_by_hand(seed: int, lean: float):
    disk, _ = disks(seed)
    q, v, _ = random_state(disk, np.random.default_rng(seed))
    q[3] = lean
    v = v - np.linalg.pinv(a := Evaluation(disk, q, v).terms.a) @ (a @ v)
    cos, sin, R = np.cos(lean), np.sin(lean), float(disk.radius)
    scene = leaning(disk)
    order = [("x", "y", "z", "ψ", "θ", "φ").index(name) for name in scene.coordinate_names]
    full = np.insert(q, 2, R * cos)[order], np.insert(v, 2, -R * sin * v[3])[order]
    at = Evaluation(scene, *full)
    # The normal was rotated and rounded, so that the slides are not quite along the plane.
    assert np.abs(at.terms.a @ at.v).max() < 1e-14 * np.abs(at.v).max()
    assert np.abs(scene.position_residual(at.parameters, at.prepared, at.q)).max() < 1e-15 * (1 + R)
    expected = acceleration(disk, "im", q, v).vdot
    up = -R * (cos * v[3] ** 2 + sin * expected[3])
    found = acceleration(scene, "im", *full, consistent=False).vdot
    size = np.abs(expected).max() + abs(up)
    np.testing.assert_allclose(found, np.insert(expected, 2, up)[order], atol=1e-11 * size)


# ---- The ball ------------------------------------------------------------------------------------


def on_table(ball: TurntableBall, turning: bool, R: float, rates: tuple[float, float]) -> Any:
    """Return a ball on a table that a clock turns, or on a fixed one that it is driven over."""
    body = Link("body", float(ball.mass), moments=(float(ball.inertia),) * 3)
    joints = [
        Joint("α", "revolute", "ground", "table", axis=Z),
        *(x for x in free() if x.name != "z"),
    ]
    joints[3] = joints[3]._replace(parent="aside", origin=(0.0, 0.0, R))
    links = [GROUND, Link("table", 1.0, moments=(1.0, 1.0, 1.0))]
    links += [Link(x.child) for x in joints[1:-1]] + [body]
    normal = (("table" if turning else "ground", Z),)
    contact = elements.Contact(
        ("body", elements.ORIGIN), (normal[0][0], elements.ORIGIN), R, normal
    )
    rolls = [contact.rolling(f"along {x}", ("ground", along)) for x, along in (("x", X), ("y", Y))]
    clock = elements.drive("clock", "α", 0.4, *rates)
    first = ("α", "x", "y")
    return mechanism("OnTable", links, joints, [*rolls, clock], gravity=None, dependent=first)()


@pytest.mark.parametrize("seed", range(4))
def test_a_ball_on_a_driven_table_rolls_as_the_ball_by_hand(seed: int):
    random = np.random.default_rng(seed)
    ball = random_scene(TurntableBall, random)
    q, v, t = random_state(ball, random)
    at = Evaluation(ball, q, v, t)
    rates = [
        0.0 if x is None else float(x[0]) for x in (at.prepared.rate, at.prepared.acceleration)
    ]
    scene = on_table(ball, True, float(ball.radius), (rates[0], rates[1]))
    assert scene.depends_on_time
    # The first row is the drive: holonomic ones come before the others.
    full = np.insert(q, 0, 0.4), np.insert(v, 0, rates[0])
    check_consistent(Evaluation(scene, *full))
    expected = np.insert(acceleration(ball, "im", q, v, t).vdot, 0, rates[1])
    found = acceleration(scene, "im", *full).vdot
    np.testing.assert_allclose(found, expected, atol=1e-11 * np.abs(expected).max())
    other = on_table(ball, False, float(ball.radius), (rates[0], rates[1]))
    slips = Evaluation(other, *full).terms.a @ full[1]
    assert np.abs(slips[1:]).max() > 1e-3 * abs(rates[0]) * np.abs(q[:2]).max()


# ---- Words that do not fit -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("closing", "said"),
    [
        (
            elements.rolling_ball("b", "a", "ground", 0.0),
            "'b, touching': radius = 0.0 m, expect",
        ),
        (
            elements.rolling_ball("b", "a", "ground", -1.0),
            "radius = -1.0 m, expected a positive",
        ),
        (elements.rolling_ball("b", "a", "ground", np.nan), "its numbers = nan, expected a finite"),
        (elements.rolling_ball("b", "a", "a", 1.0), "'b, touching' is between 'a' and itself"),
        (
            elements.rolling_ball("b", "a", "c", 1.0),
            "'b, touching' is on the link 'c', no such link",
        ),
        (
            elements.rolling_ball("b", "a", "ground", 1.0),
            "direction .*, and all stays in the plane",
        ),
    ],
)
def test_what_cannot_roll_is_refused(closing: Any, said: str):
    joint = Joint("p", "planar", "ground", "a")
    with pytest.raises(InputError, match=said):
        mechanism("Wrong", [GROUND, Link("a", 1.0, moments=(1.0, 1.0, 1.0))], [joint], closing)


@pytest.mark.parametrize("wrong", [(0.0, 0.0, 0.0), (np.nan, 0.0, 1.0)])
def test_directions_of_what_rolls_are_some(wrong: Any):
    for say in (
        lambda: elements.rolling_ball("b", "a", "ground", 1.0, across=wrong),
        lambda: elements.rolling_disk("b", "a", "ground", 1.0, axis=wrong),
        lambda: elements.rolling_circle("b", "a", "ground", 1.0, wrong),
        lambda: elements.on_line("b", "a", "ground", wrong),
    ):
        with pytest.raises(InputError, match="'b' is made of the direction"):
            say()
    with pytest.raises(InputError, match=r"'b' is along .*, expected nothing along z"):
        elements.rolling_circle("b", "a", "ground", 1.0, (1.0, 0.0, 0.5))

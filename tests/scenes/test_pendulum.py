"""The scene of the guide with a holonomic constraint and speeds of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import eomcheck
from eomcheck.claims import CLAIMS
from eomcheck.errors import InputError
from eomcheck.evaluation.dynamics import assembled_position
from eomcheck.scene_lookup import scene_classes_named

PENDULUM = Path(__file__).parents[2] / "docs" / "guides" / "pendulum.py"
Q, V = np.array([0.6, -0.8]), np.array([1.6, 1.2])


def checked(path: Path) -> list:
    (kind,) = scene_classes_named(f"{path}:Pendulum")
    scene = kind.example()
    found = eomcheck.check_state(scene, Q, V, consistent=False)
    return found + eomcheck.prove(kind, points=1, seed=0)


def test_the_pendulum_passes_all_checks_and_proofs():
    assert {finding.verdict for finding in checked(PENDULUM)} == {"passed"}


def test_its_motion_is_that_of_a_pendulum():
    (kind,) = scene_classes_named(f"{PENDULUM}:Pendulum")
    scene = kind(length=0.7)
    found = eomcheck.simulate(scene, "kane", 2.0, rtol=1e-11, atol=1e-11)
    x, y = found.q.T
    assert np.abs(np.hypot(x, y) - 0.7).max() < 1e-8
    assert np.ptp(found.energy) < 1e-8
    # Let go level, ω² = 2 g |y| / L².
    states = zip(found.q, found.v, strict=True)
    omega = np.array([eomcheck.speeds_of(scene, *state)[0] for state in states])
    assert np.abs(omega**2 + 2 * 9.81 * y / 0.7**2).max() < 1e-6


@pytest.mark.parametrize("q", [(0.3, -0.2), (1.7, 1.1)])
def test_positions_are_closed_by_the_holonomic_row(q):
    (kind,) = scene_classes_named(f"{PENDULUM}:Pendulum")
    assert np.hypot(*assembled_position(kind(), q)) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("old", "new", "claim"),
    [
        ("gap / 2", "gap", "position-rate"),
        ("v[0] * v[0] + v[1] * v[1]", "v[0] * v[0] - v[1] * v[1]", "constraint-drift"),
        ("[[-y], [x]]", "[[y], [x]]", "null-space-speeds"),
        ("[-omega * omega * x", "[omega * omega * x", "speeds-remainder"),
        ("force = np.array([-p", "force = np.array([p", "active-forces"),
    ],
)
def test_a_mistake_in_the_pendulum_is_found_and_named(tmp_path, old, new, claim):
    source = PENDULUM.read_text(encoding="utf-8")
    assert source.count(old) == 1
    path = tmp_path / f"pendulum_{abs(hash(new))}.py"
    path.write_text(source.replace(old, new), encoding="utf-8")
    failed = [finding for finding in checked(path) if finding.verdict == "failed"]
    first = min(failed, key=lambda finding: list(CLAIMS).index(finding.claim))
    assert first.claim == claim, str(first)


def changed(tmp_path: Path, name: str, *changes: tuple[str, str]) -> type:
    """Return the pendulum with texts of its file replaced."""
    source = PENDULUM.read_text(encoding="utf-8")
    for old, new in changes:
        assert source.count(old) == 1
        source = source.replace(old, new)
    path = tmp_path / f"pendulum_{name}.py"
    path.write_text(source, encoding="utf-8")
    (kind,) = scene_classes_named(f"{path}:Pendulum")
    return kind


def test_speeds_may_share_single_numbers_which_are_not_rational_if_they_are_floats(tmp_path):
    kind = changed(
        tmp_path,
        "of_floats",
        ("Turning(q, u)", "Turning((float(q[0]), float(q[1])), float(u[0]))"),
        ("turning.q, turning.u[0]", "turning.q, turning.u"),
        ("turning.q.dtype), np.array(rest, turning.q.dtype)", "float), np.array(rest, float)"),
    )
    found = eomcheck.check_state(kind(), Q, V, consistent=False)
    assert {x.verdict for x in found} == {"passed", "skipped"}
    unseen = {x.claim for x in found if x.verdict == "skipped"}
    exact = {"speeds-remainder", "machine-code", "enclosures", "true-error"}
    assert unseen <= exact | {"derivatives"}
    assert "null-space-speeds" in {x.claim for x in found if x.verdict == "passed"}


@pytest.mark.parametrize(
    ("shared", "what"), [("list(q)", "list"), ("{'q': q}", "dict"), ("'q'", "str")]
)
def test_what_cannot_be_shared_is_refused_in_a_sentence(tmp_path, shared, what):
    kind = changed(tmp_path, f"of_{what}", ("Turning(q, u)", f"Turning({shared}, u)"))
    said = f"Pendulum.kinematics: a {what}, expected an array, a number, or a NamedTuple of these"
    with pytest.raises(InputError, match=said):
        eomcheck.check_state(kind(), Q, V, consistent=False)


def test_speeds_that_cannot_read_what_is_shared_fail_in_a_sentence_each(tmp_path):
    kind = changed(tmp_path, "of_three", ("Turning(q, u)", "(q, u, u)"))
    found = eomcheck.validate(kind(), examples=2)
    failed = [x for x in found if x.verdict == "failed"]
    assert failed
    assert all("Pendulum.speeds raised AttributeError: 'tuple' object" in x.detail for x in failed)

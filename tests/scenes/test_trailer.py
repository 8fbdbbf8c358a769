"""The tutorial's scene: short, right, and a mistake in it is found and named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import eomcheck
from eomcheck.claims import CLAIMS, Finding
from eomcheck.errors import InputError
from eomcheck.mechanics.scene import Scene
from eomcheck.scene_lookup import scene_classes_named

TRAILER = Path(__file__).parents[2] / "docs" / "guides" / "trailer.py"
Q, U = np.array([0.4, 1.0, 2.0]), np.array([1.5, 0.7])


def trailer(path: Path) -> type[Scene]:
    (kind,) = scene_classes_named(f"{path}:Trailer")
    return kind


def failures(findings: list[Finding]) -> list[Finding]:
    """Return the Findings that failed, the closest to the cause first."""
    failed = [finding for finding in findings if finding.verdict == "failed"]
    return sorted(failed, key=lambda finding: list(CLAIMS).index(finding.claim))


def checked(kind: type[Scene]) -> list[Finding]:
    scene = kind.example()
    return eomcheck.check_state(scene, Q, eomcheck.velocity(scene, Q, U), consistent=False)


def test_the_tutorial_takes_less_than_60_lines_and_passes_all_checks_and_proofs():
    assert len(TRAILER.read_text(encoding="utf-8").splitlines()) < 60
    kind = trailer(TRAILER)
    findings = checked(kind)
    assert len(findings) > 100
    assert {f.verdict for f in findings} == {"passed"}
    proved = eomcheck.prove(kind, points=1, seed=0)
    assert len(proved) > 60
    assert {f.verdict for f in proved} == {"passed"}


@pytest.mark.parametrize(
    ("old", "new", "claim", "says"),
    [
        ("array([-v[0]", "array([v[0]", "constraint-drift", "row axle: wrong sign"),
        ("[-back * cos", "[back * cos", "mass-matrix", "θ"),
        ("-angle.sin[0], angle", "angle.sin[0], angle", "constraint-jacobian", "axle"),
        ("[[back * cos", "[[back * sin", "bias", "row"),
        ("v[2] - swing", "v[2] + swing", "mass-matrix", "θ"),
    ],
)
@pytest.mark.sampled(3)
def test_a_mistake_in_the_trailer_is_found_and_named(tmp_path, old, new, claim, says):
    source = TRAILER.read_text(encoding="utf-8")
    assert source.count(old) == 1
    # A name of its own: Python keeps modules by name.
    path = tmp_path / f"trailer_{abs(hash(new))}.py"
    path.write_text(source.replace(old, new), encoding="utf-8")
    kind = trailer(path)
    for found in (failures(checked(kind)), failures(eomcheck.prove(kind, points=1, seed=0))):
        assert found, "not found"
        assert found[0].claim == claim, str(found[0])
        assert says in str(found[0])


def test_a_scene_with_constraints_and_no_drift_is_told_so(tmp_path):
    text = TRAILER.read_text(encoding="utf-8")
    begin = text.index("def drift(")
    end = text.index("\n\n\n", begin) + 3
    file = tmp_path / "driftless.py"
    file.write_text(text[:begin] + text[end:], encoding="utf-8")
    scene = trailer(file).example()
    calls: list[Callable[[], object]] = [
        lambda: eomcheck.check_state(scene, *scene.initial_state()),
        lambda: eomcheck.velocity(scene, Q, U),
        lambda: eomcheck.acceleration(scene, "im", Q, np.zeros(3)),
        lambda: eomcheck.acceleration(scene, "kane", Q, np.zeros(3)),
        lambda: eomcheck.simulate(scene, "kane", 1.0),
        lambda: eomcheck.prove(scene, points=1, seed=0),
    ]
    for call in calls:
        with pytest.raises(InputError, match=r"^Trailer has constraints but no `drift`$"):
            call()


def test_a_constraint_that_is_nan_fails_by_its_own_name_and_beside_the_engine_built_of_it(tmp_path):
    text = TRAILER.read_text(encoding="utf-8")
    old = "return np.array([slip], v.dtype)"
    assert text.count(old) == 1
    file = tmp_path / "undefined.py"
    file.write_text(text.replace(old, "return np.array([slip * float('nan')], v.dtype)"), "utf-8")
    kind = trailer(file)
    scene, state = kind.example(), (Q, eomcheck.velocity(kind.example(), Q, U))
    name = "Trailer.constraint: c is nan"
    for engines in ([], ["casadi"]):
        failed = failures(eomcheck.check_state(scene, *state, engines=engines))
        assert (failed[0].claim, failed[0].detail) == ("finite-terms", name)
        by_engine = [one.detail for one in failed[1:] if "returned nan" in one.detail]
        assert bool(by_engine) == bool(engines)
        assert all(detail.endswith(f"; {name}") for detail in by_engine)

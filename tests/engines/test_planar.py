"""The engine of the guide against all that a tree in the plane may hold, and what it refuses."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.engines.planar import PLANAR, planar, with_fault

import eomcheck
from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import Joint, Link, distance
from eomcheck.descriptions.random_mechanisms import RANDOM
from eomcheck.engines import Engine
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import Sleigh

ASKING = [one.id for one in CLAIMS.values() if one.asks]
TURNED = (0.8, 0.0, 0.0, 0.6)
"""A seat in the plane, turned by some 74 degrees."""


def crank(closed: bool = False, **last) -> Scene:
    """Four links: a hinge with a rotor, a slide on it, and a hinge that follows on a turned seat.

    Args:
        closed: whether a rod closes the loop.
        last: changes of the last joint.
    """
    body = {"mass": 1.3, "center": (0.4, 0.1, 0.0), "moments": (0.2, 0.3, 0.25)}
    names = ["a", "b", "c", "d"]
    follow = {"kind": "revolute", "orientation": TURNED, "mimics": ("p", -1.5, 0.3)} | last
    joints = [
        Joint("p", "revolute", "ground", "a", (0.2, 0.1, 0.0), armature=0.7),
        Joint("s", "prismatic", "a", "b", (0.7, 0.1, 0.0), axis=(1.0, 0.0, 0.0)),
        Joint("r", "revolute", "b", "c", (0.5, -0.2, 0.0), orientation=TURNED),
        Joint("f", parent="b", child="d", origin=(0.1, 0.3, 0.0), **follow),
    ]
    ends = [distance("rod", "c", "ground", 1.1, (0.3, 0, 0), (0.2, 1.2, 0))] if closed else []
    links = [Link("ground"), *(Link(name, **body) for name in names)]
    return mechanism("Crank", links, joints, ends)()


def failed(engine: type[Engine], scene: Scene, claims=ASKING) -> list[Finding]:
    found = eomcheck.validate(scene, examples=2, engines=[engine], claims=claims)
    assert any(one.verdict == "passed" for one in found) or len(claims) == 1
    return [one for one in found if one.verdict == "failed"]


@pytest.mark.parametrize("closed", [False, True])
def test_the_engine_of_the_guide_has_all_that_a_tree_in_the_plane_holds(closed: bool):
    assert failed(planar(), crank(closed)) == []


FIELDS = {
    "armature": (" + np.diag(self.tree.armature)", "", "mass-matrix"),
    "shift": (" + self.tree.shift", "", "mass-matrix"),
    "rotation": (" @ tree.rotation[j][:2, :2]", "", "mass-matrix"),
    "offset": ("R @ tree.offset[j][:2]", "0 * tree.offset[j][:2]", "mass-matrix"),
    "center": ("R @ tree.center[j][:2]", "0 * tree.center[j][:2]", "mass-matrix"),
    "slide after a hinge": ("x[j] * axis)", "0 * axis)", "mass-matrix"),
    "coriolis of a slide": ("rest + 2 * (spin", "rest + (spin", "bias"),
    "follows": (
        "return T @ np.linalg.solve(M, F), None",
        ("return np.linalg.solve(self.mass_matrix(q, t), Q - self.bias(q, v, t)), None"),
        "engine-acceleration",
    ),
}
"""Field -> text of the engine, what leaves the field out, and the claim that fails."""


@pytest.mark.sampled(3)
@pytest.mark.parametrize("field", FIELDS)
def test_a_field_of_the_tree_that_an_engine_leaves_out_fails(field: str, tmp_path: Path):
    old, new, claim = FIELDS[field]
    engine = planar(with_fault(tmp_path, f"planar_without_{field.replace(' ', '_')}", old, new))
    assert [one.claim for one in failed(engine, crank(), [claim])][:1] == [claim]


def test_the_reference_lists_every_field_of_a_tree_with_its_shape_in_the_order_of_the_code():
    reference = PLANAR.parent.parent / "reference" / "engine-interface.md"
    page = reference.read_text(encoding="utf-8")
    table = page.partition("## The tree of a scene")[2].partition("\n## ")[0]
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]+?) \|", table, re.M))
    tree, sizes = crank().tree(), {"m": 4, "n": 3}
    assert tree is not None
    # Where a scene names no joints and links, properties do. Both sorts of rotors stand together.
    fields = [x for x in tree._fields if x not in ("names", "links", "gimbal_armature")]
    fields.insert(fields.index("armature") + 1, "gimbal_armature")
    assert [*rows] == [*fields, "name", "frames"]
    assert rows.pop("gimbal_armature").endswith("or empty") and tree.gimbal_armature == ()
    assert rows.pop("frames") == "one a link" and len(tree.frames) == 5
    for field, shape in rows.items():
        held, listed = getattr(tree, field), re.match(r"\((.+?)\)", shape)
        if listed is None:
            assert shape.startswith("m ") and len(held) == 4
        else:
            words = [one.strip() for one in listed[1].split(",") if one.strip()]
            assert held.shape == tuple(sizes.get(one) or int(one) for one in words)


def test_the_engine_of_the_guide_refuses_what_leaves_the_plane():
    tilted = crank(orientation=(0.8, 0.6, 0.0, 0.0), mimics=None)
    tree = tilted.tree()
    assert tree is not None and set(tree.joint) <= {"px", "py", "rz"}
    over = crank(orientation=(0.0, 1.0, 0.0, 0.0), mimics=None)  # upside down
    along_z = crank(kind="prismatic", mimics=None)
    for scene in (tilted, over, along_z):
        assert not planar().represents(scene)
    assert planar().represents(crank())
    assert planar().represents(Sleigh())


def looked_at(key: str, examples: int, seed: int) -> ValidationRun:
    """Return the run of `validate --engine planar.py:Planar` on random scenes of a kind."""
    kind = RANDOM[key]
    selection = RunSelection.of(None, [planar()], ASKING, scenes=[kind])
    run = ValidationRun()
    run.validate_kind(kind, selection, (1, 12), examples, seed)
    run.finish(selection)
    return run


def assert_right(run: ValidationRun, least: int) -> None:
    assert [str(one) for one in run.findings if one.verdict == "failed"] == []
    passed = [one.claim for one in run.findings if one.verdict == "passed"]
    assert passed.count("mass-matrix") >= least


@pytest.mark.parametrize("key", RANDOM)
def test_the_engine_of_the_guide_passes_where_the_one_without_armature_failed(key: str):
    assert_right(looked_at(key, 6, 0), 2)


@pytest.mark.parametrize("key", RANDOM)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.night
def test_the_engine_of_the_guide_passes_on_random_scenes(key: str, seed: int):
    assert_right(looked_at(key, 300, seed), 60)

"""OpenSim, Robotics Toolbox, SymPy, and MJCFs of DART, where they are installed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.engines.offered import CLASSIC
from tests.robots import arm, body, joint
from tests.samples import ordinary, random_state

from eomcheck import check_state
from eomcheck.claims.engine_quantities import CONFORMANCE
from eomcheck.claims.finding import Finding
from eomcheck.engines import Answers, Engine
from eomcheck.engines.dart import DartMjcf
from eomcheck.engines.opensim import OpensimEngine
from eomcheck.engines.roboticstoolbox import RoboticsToolboxEngine, RoboticsToolboxFile
from eomcheck.engines.sympy_mechanics import MOST_JOINTS, SympyEngine
from eomcheck.evaluation.conformance import QUANTITIES
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES, Sleigh, from_mjcf, from_urdf

every_kind = pytest.mark.parametrize("kind", CLASSIC)


def scene_of(kind: type[Engine], folder: Path) -> Scene:
    """Return a robot with slides, hinges and frames off its joints that the library reads right."""
    more = body("tip") + joint("grip", "hand", "tip", "fixed", "1 0 0")
    path = arm(folder / "arm.urdf", more=more)
    if kind.reads_file:
        text = path.read_text(encoding="utf-8")
        path.write_text(text.replace('xyz="0.6 0 0.8"', 'xyz="1 0 0"'), encoding="utf-8")
    return from_urdf(path)


def findings(kind: type[Engine], scene: Scene, *claims: str, seed: int = 1) -> list[Finding]:
    """Return the Findings about an engine in an ordinary state, by default about all quantities."""
    state = random_state(scene, np.random.default_rng(seed))
    asked = claims or ("mass-matrix", "bias", *CONFORMANCE)
    found = check_state(scene, *state, engines=[kind], claims=asked)
    return [x for x in found if kind.key in x.subject]


@pytest.mark.night
@every_kind
def test_all_quantities_of_an_engine_are_ours(kind: type[Engine], tmp_path: Path):
    found = findings(kind, scene_of(kind, tmp_path))
    assert [str(x) for x in found if x.verdict not in ("passed", "skipped")] == []
    passed = {x.claim for x in found if x.verdict == "passed"}
    wanted = {f"engine-{name.replace('_', '-')}" for name in CLASSIC[kind]}
    assert passed - {"mass-matrix", "bias"} == wanted
    assert {"mass-matrix", "bias"} <= passed
    links = {x.subject.split(", ")[-1].split(" ~ ")[0] for x in found if x.verdict == "passed"}
    assert "tip" in links, "a frame off its joint"


@pytest.mark.parametrize("kind", [OpensimEngine, RoboticsToolboxEngine])
@pytest.mark.parametrize("key", ["four-bar-chain", "bricard"])
def test_branches_and_turned_seats_are_ours(kind: type[Engine], key: str):
    scene = ordinary(SCENES[key], 3)[0]
    assert kind.represents(scene)
    found = findings(kind, scene)
    assert "failed" not in {x.verdict for x in found}, found
    assert {"mass-matrix", "engine-inverse-dynamics"} <= {x.claim for x in found}


@pytest.mark.parametrize("kind", [SympyEngine])
def test_speeds_stand_for_the_rates_of_slides(kind: type[Engine]):
    found = findings(kind, Sleigh())
    assert {x.verdict for x in found} - {"skipped"} == {"passed"}
    assert any(x.claim == "engine-frame-bias" and x.verdict == "passed" for x in found)


@pytest.mark.night
@every_kind
def test_no_quantity_of_an_engine_depends_on_earlier_calls(kind: type[Any], tmp_path: Path):
    scene = scene_of(kind, tmp_path)
    state, elsewhere = (random_state(scene, np.random.default_rng(seed)) for seed in (1, 2))
    third, answers = np.cos(np.arange(scene.n)), Answers(kind(scene))

    def ask(name: str, at: Any) -> Any:
        frame = "tip" if QUANTITIES[name].of_frame else ""
        return answers.ask(name, at.q, at.v, third, frame, at.t)

    first = {name: ask(name, state) for name in CLASSIC[kind]}
    for name in CLASSIC[kind]:
        ask(name, elsewhere)
    for name in sorted(CLASSIC[kind], reverse=True):
        assert np.array_equal(ask(name, state), first[name]), name


MJCF = """
<mujoco><worldbody><body name="stand" pos="0 0 0">
<geom type="box" size=".1 .2 .3" mass="5" pos="1 2 3"/>
<body name="cart" pos=".1 .2 .3">
  <joint name="slide" type="slide" axis="1 0 0"/><geom type="box" size=".1 .2 .3" mass="2"/>
  <body name="pole" pos="0 .1 .4">
    <joint name="swing" type="hinge" axis="0 1 0" pos=".02 .05 -.03"/>
    <geom type="box" size=".02 .03 .5" mass="1" pos="0 0 .4"/>
  </body>
</body></body></worldbody></mujoco>
"""


@pytest.mark.parametrize("kind", [DartMjcf])
def test_dart_reads_all_of_an_mjcf_but_moments_of_inertia(kind: type[Engine], tmp_path: Path):
    pytest.importorskip("mujoco")
    path = tmp_path / "cart.xml"
    path.write_text(MJCF, encoding="utf-8")
    found = findings(kind, from_mjcf(path))
    wrong = {x.claim.removeprefix("engine-") for x in found if x.verdict == "failed"}
    right = {x.claim.removeprefix("engine-") for x in found if x.verdict == "passed"} - wrong
    assert {"mass-matrix", "kinetic-energy", "momentum", "inverse-dynamics"} <= wrong
    assert {"gravity", "center-of-mass", "center-of-mass-jacobian", "frame-placement"} <= right
    assert {"frame-velocity", "frame-jacobian", "frame-acceleration", "frame-bias"} <= right


def test_what_libraries_cannot_hold_is_not_represented(tmp_path: Path):
    massless = ordinary(SCENES["snake"], 1)[0]  # slides without mass, one on the other
    assert not OpensimEngine.represents(massless)
    assert OpensimEngine.represents(scene_of(OpensimEngine, tmp_path))
    links = SympyEngine.links(scene_of(SympyEngine, tmp_path).tree())
    assert SympyEngine.holds(links) and not SympyEngine.holds(links * MOST_JOINTS)
    free = from_urdf(_with_heavy_base(tmp_path), floating=True)
    held = from_urdf(_with_heavy_base(tmp_path))
    assert RoboticsToolboxFile.represents(held) and not RoboticsToolboxFile.represents(free)


def _with_heavy_base(folder: Path) -> Path:
    path = arm(folder / "heavy.urdf")
    text = path.read_text(encoding="utf-8").replace('<link name="base"/>', body("base"))
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("kind", [RoboticsToolboxFile])
@pytest.mark.parametrize(
    ("change", "claims"),
    [
        (lambda text: text, {"mass-matrix", "bias"}),  # an axis between x and z
        (lambda text: text.replace('xyz="0.6 0 0.8"', 'xyz="-1 0 0"'), {"mass-matrix"}),
    ],
)
def test_wrong_axes_of_the_toolbox_are_found(
    kind: type[Engine], change: Callable[[str], str], claims: set[str], tmp_path: Path
):
    path = arm(tmp_path / "arm.urdf")
    path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")
    found = findings(kind, from_urdf(path), "mass-matrix", "bias")
    assert claims <= {x.claim for x in found if x.verdict == "failed"}

"""The case of docs/evidence/engines.md: inertia that is lost from a URDF to a model."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

import eomcheck
from eomcheck.engines import Engine
from eomcheck.scenes import ChainPendulum

FILE = Path(__file__).parents[2] / "docs" / "guides" / "urdf_inertia.py"
SCENE = ChainPendulum.rods(2)
CLAIMS = ["mass-matrix", "bias"]


def engine_of(path: Path) -> type[Engine]:
    pytest.importorskip("mujoco", minversion="3.14")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.FromUrdf


def test_a_library_that_keeps_the_orientation_of_an_inertia_passes():
    found = eomcheck.validate(SCENE, examples=5, engines=[engine_of(FILE)], claims=CLAIMS)
    assert found
    assert {one.verdict for one in found} == {"passed"}


def test_an_orientation_that_is_lost_is_told_with_the_entry_of_the_mass_matrix(tmp_path):
    text = FILE.read_text(encoding="utf-8")
    assert text.count('rpy="{TILT} 0 0"') == 1
    lost = tmp_path / "lost.py"
    lost.write_text(text.replace('rpy="{TILT} 0 0"', 'rpy="0 0 0"'), encoding="utf-8")
    found = eomcheck.check_state(
        SCENE, [0.3, 0.8], [1.0, -0.5], engines=[engine_of(lost)], claims=CLAIMS
    )
    (failed,) = [one for one in found if one.verdict == "failed"]
    assert failed.claim == "mass-matrix"
    assert "mass matrix, entry (θ_2, θ_2): found" in failed.detail

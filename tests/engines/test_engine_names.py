"""Engines by name: keys, files, modules and entry points; and what the command line says."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest
from tests.engines.planar import PLANAR, planar, with_fault

import eomcheck
from eomcheck.engines import ENGINES, Engine, EngineFault, engine_of, engines_among
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.lab.report.registries import registry_table
from eomcheck.scenes import SCENES, Sleigh

COMMAND = [sys.executable, "-c", "from eomcheck.cli import main; main()", "validate"]


def command(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, cwd=cwd)


@pytest.fixture
def own_path(monkeypatch):
    """Let a test import what is nobody else's."""
    before = set(sys.modules)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield
    for name in set(sys.modules) - before:
        if not name.startswith(("eomcheck", "tests")) and "." not in name:
            file = getattr(sys.modules[name], "__file__", None) or ""
            if "pytest" in file and "site-packages" not in file:
                del sys.modules[name]


# ---- Keys ----------------------------------------------------------------------------------------


def test_an_engine_is_called_by_its_class_unless_it_says_otherwise():
    assert [kind.key for kind in ENGINES.values()] == list(ENGINES)
    assert planar().key == "planar"
    assert type("MujocoEngine", (planar(),), {}).key == "mujoco"
    assert type("My_Engine", (planar(),), {}).key == "my"
    assert type("Engine", (planar(),), {}).key == "engine"
    assert type("Named", (planar(),), {"key": "other"}).key == "other"


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"key": "casadi"}, "key = 'casadi' is that of something else"),
        ({"key": "kane"}, "key = 'kane' is that of something else"),
        ({"key": "my engine"}, "expected letters, digits and underscores"),
        ({"solves_like": "newton"}, "solves_like is none of im, au"),
        ({"solves_like": "kane"}, "solves_like is none of im, au, el, gw, em, uk"),
        ({"bias": Engine.bias}, "has no bias"),
        (
            {"center_of_mas_velocity": len},
            r"center_of_mas_velocity is no method that is called \(did you mean "
            r"'center_of_mass_velocity'\?\); begin the name of a helper with _",
        ),
        ({"gravty": len}, "did you mean 'gravity'"),
        ({"centre_of_mass": len}, "did you mean 'center_of_mass'"),
        ({"jacobian_frame": len}, "did you mean 'frame_jacobian'"),
        ({"velocity_map_derivative": len}, "did you mean 'velocity_map_derivatives'"),
    ],
)
def test_a_class_that_does_not_keep_the_contract_is_refused_in_one_sentence(changes, says):
    kind = type("Wrong", (planar(),), changes)
    with pytest.raises(InputError, match=says):
        engine_of(kind)
    with pytest.raises(InputError, match="engine Wrong"):
        eomcheck.check_state(Sleigh(), *Sleigh().initial_state(), engines=[kind])


def test_a_helper_is_no_misspelt_method():
    helpers = ("bodies", "force", "constraint_jacobian_rate", "frame", "base_frame", "momenta")
    assert engine_of(type("Helped", (planar(),), dict.fromkeys(helpers, len)))
    beside = {"gravity": len, "gravitys": len, "_momentun": len, "momentun": 1.0}
    assert engine_of(type("Helped", (planar(),), beside))


def test_keys_names_and_classes_stand_side_by_side():
    found = engines_among(["casadi", planar(), f"{PLANAR}:Planar", CasadiEngine])
    assert found == (CasadiEngine, planar())
    with pytest.raises(InputError, match="two have the key 'planar'"):
        engines_among([planar(), type("Planar", (planar(),), {})])
    with pytest.raises(InputError, match="expected a class that derives from Engine"):
        engine_of(int)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="expected a list of names"):
        engines_among("casadi")


# ---- Files and modules ---------------------------------------------------------------------------


def test_a_file_finds_what_lies_beside_it(tmp_path, own_path):
    (tmp_path / "beside_the_engine.py").write_text("NAME = 'beside 1'\n")
    source = PLANAR.read_text(encoding="utf-8").replace(
        'return f"planar {np.__version__}"', "return beside_the_engine.NAME"
    )
    path = tmp_path / "engine_with_neighbour.py"
    path.write_text(f"import beside_the_engine\n{source}", encoding="utf-8")
    assert planar(path).version() == "beside 1"
    assert sys.path[0] != str(tmp_path), "afterwards it comes last"
    assert sys.path[-1] == str(tmp_path)


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("none.py:Planar", None, "is not a file"),
        ("empty_engine.py:Planar", "", "has no engine 'Planar'; it has: none"),
        ("other_engine.py:Planar", "Planar = 3", "has no engine 'Planar'; it has: none"),
        ("broken_engine.py:Planar", "1 / 0", "cannot be imported: ZeroDivisionError"),
        ("spelled_engine.py:Planar", "def", "cannot be imported: SyntaxError"),
        ("leaving_engine.py:Planar", "raise SystemExit", "cannot be imported: SystemExit"),
        ("casadi.py:Planar", "", "has the name of another module, casadi"),
        ("my-engine.py:Planar", "", "is no name in Python"),
    ],
)
def test_a_file_without_an_engine_is_refused_in_one_sentence(name, text, says, tmp_path, own_path):
    if text is not None:
        (tmp_path / name.partition(":")[0]).write_text(text)
    with pytest.raises(InputError, match=says):
        engine_of(f"{tmp_path}/{name}")


def test_a_module_is_found_by_its_dotted_name(tmp_path, monkeypatch, own_path):
    package = tmp_path / "package_of_engines"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "flat.py").write_text(PLANAR.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    importlib.invalidate_caches()
    assert engine_of("package_of_engines.flat:Planar").key == "planar"
    with pytest.raises(InputError, match="it has: Planar"):
        engine_of("package_of_engines.flat:Flat")
    with pytest.raises(InputError, match=r"'package_of_engines\.round' cannot be imported"):
        engine_of("package_of_engines.round:Planar")


@pytest.mark.night
def test_an_entry_point_is_found_by_its_name(tmp_path, monkeypatch, own_path):
    (tmp_path / "announced_engine.py").write_text(
        PLANAR.read_text(encoding="utf-8"), encoding="utf-8"
    )
    info = tmp_path / "announced-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: announced\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[eomcheck.engines]\nflat = announced_engine:Planar\nlost = announced_engine:Lost\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert engine_of("flat").__module__ == "announced_engine"
    with pytest.raises(InputError, match="has no engine 'Lost'; it has: Planar"):
        engine_of("lost")
    with pytest.raises(UnknownNameError, match=r"known: pinocchio, casadi.*flat, lost"):
        engine_of("bullet")
    rows = {row[0]: row[1:] for row in registry_table("engines").rows}
    package = "none: package announced"
    assert rows["flat"] == (
        planar().version(),
        package,
        "no",
        "Bodies on a tree of joints, one after another from the ground outwards.",
    )
    assert rows["lost"][:2] == ("cannot be loaded", package)
    assert rows["lost"][3] == "'announced_engine:Lost' has no engine 'Lost'; it has: Planar"
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    found = command("--engine", "flat", "--scene", "sleigh", "--examples", "2", cwd=elsewhere)
    assert found.returncode == 2, "another process does not have the path"
    assert "unknown engine 'flat'" in found.stderr


@pytest.mark.parametrize("method", ["version", "represents"])
def test_a_class_method_without_its_decorator_is_named(method):
    kind = type("Wrong", (planar(),), {method: lambda self, *scene: "wrong 1"})
    said = f"engine Wrong: {method} is no class method, write @classmethod above it"
    with pytest.raises(InputError, match=said):
        engine_of(kind)


def test_an_engine_that_is_made_is_not_its_class():
    with pytest.raises(InputError, match=r"^engine = <.*>, expected its class Planar$"):
        engine_of(planar()(Sleigh()))  # type: ignore[arg-type]


# ---- What it represents --------------------------------------------------------------------------


def test_represents_that_raises_is_told_in_one_sentence():
    def represents(cls, scene):
        raise KeyError("tree")

    kind = type("Wrong", (planar(),), {"represents": classmethod(represents)})
    with pytest.raises(InputError, match=r"engine Wrong: represents\(sleigh\) raised KeyError"):
        eomcheck.check_state(Sleigh(), *Sleigh().initial_state(), engines=[kind])


def test_an_engine_is_made_once_for_each_scene():
    made = []

    def remember(self, scene):
        made.append(scene)
        planar().__init__(self, scene)

    kind = type("Counted", (planar(),), {"__init__": remember})
    eomcheck.validate(Sleigh(), examples=3, engines=[kind], claims=["mass-matrix", "bias"])
    assert len(made) == 1


# ---- The command line ----------------------------------------------------------------------------


@pytest.mark.night
def test_without_a_scene_every_scene_that_the_engine_represents_is_looked_at():
    found = command("--engine", f"{PLANAR}:Planar", "--examples", "2", "--executor", "local:2")
    assert found.returncode == 0, found.stderr
    trees = {key: kind.example().tree() for key, kind in SCENES.items()}
    represented = {
        key for key, tree in trees.items() if tree and {*tree.joint} <= {"px", "py", "rz"}
    }
    table = found.stdout
    assert represented == {"snake", "chain-pendulum", "sleigh", "four-bar-chain", "andrews"}
    assert all(key in table for key in represented)
    assert not {"rolling-disk", "bricard", "flyball-governor"} & {*table.split()}
    assert "equivalence" not in table, "our scenes are not on trial"
    assert "skipped: generalized-forces [planar]" in table
    assert " claims passed" in table


@pytest.mark.night
def test_an_engine_that_is_wrong_is_exit_code_1_and_named(tmp_path):
    path = with_fault(tmp_path, "planar_wrong", "rest - (spin", "rest + (spin")
    found = command("--engine", f"{path}:Planar", "--scene", "sleigh", "--examples", "3")
    assert found.returncode == 1
    assert "bias, row" in found.stdout and ": wrong sign" in found.stdout
    assert f"Planar = in_file({str(path)!r}, 'Planar')" in found.stdout
    assert "engines=[Planar]" in found.stdout


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--engine", "none.py:Planar"], "'none.py' is not a file"),
        (
            ["--engine", "pinocchio", "--scene", "rolling-disk"],
            "represents none of the scenes rolling-disk",
        ),
        (
            ["--engine", f"{PLANAR}:Planar", "--scene", "bicycle"],
            "represents none of the scenes bicycle",
        ),
        (["--engine", f"{PLANAR}:Round"], "has no engine 'Round'; it has: Planar"),
    ],
)
def test_what_cannot_be_loaded_or_represents_nothing_is_exit_code_2(arguments, says):
    found = command(*arguments, "--examples", "1")
    assert found.returncode == 2
    assert says in found.stderr
    errors = [line for line in found.stderr.splitlines() if not line.endswith(" ...")]
    assert "Traceback" not in found.stderr and len(errors) == 1


@pytest.mark.night
def test_nothing_compared_is_never_a_pass(tmp_path):
    source = PLANAR.read_text(encoding="utf-8")
    path = tmp_path / "planar_shy.py"
    # It says that it represents small scenes, and then none that is drawn or the example.
    old = "return bool((z"
    assert source.count(old) == 1
    source = source.replace(old, "return scene.n == 3 and bool((z")
    path.write_text(source, encoding="utf-8")
    few = ["--links", "4..5", "--examples", "2", "--formulation", "kane"]
    found = command("--engine", f"{path}:Planar", "--scene", "snake", *few)
    assert found.returncode == 2
    assert "engine planar: nothing could be compared with it" in found.stderr


@pytest.mark.night
def test_a_missing_library_is_exit_code_2(tmp_path):
    source = PLANAR.read_text(encoding="utf-8")
    old = 'return f"planar {np.__version__}"'
    assert source.count(old) == 1
    new = "from eomcheck.errors import required\n        return required('no_such_library')"
    path = tmp_path / "planar_missing.py"
    path.write_text(source.replace(old, new), encoding="utf-8")
    found = command("--engine", f"{path}:Planar", "--examples", "1")
    assert found.returncode == 2
    assert "'no_such_library' is not installed" in found.stderr


def test_a_fault_of_an_engine_is_known_by_what_it_did():
    fault = EngineFault("bias returned None")
    assert fault.what == str(fault) == "bias returned None"

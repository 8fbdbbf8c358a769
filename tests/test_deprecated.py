"""Old names still work for one release, and warn at the line that uses them."""

from __future__ import annotations

import importlib
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import typer
from click import Context

import eomcheck
from eomcheck import cli, deprecated, strategies
from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import Joint, Link
from eomcheck.descriptions.random_mechanisms import RANDOM
from eomcheck.errors import InputError
from eomcheck.mechanics.parameters import parameter
from eomcheck.mechanics.records import Range
from eomcheck.scenes import Bricard, Sleigh


@pytest.mark.parametrize("old", sorted(deprecated.MODULES))
def test_a_module_under_its_old_path_is_the_module_itself(old: str, monkeypatch):
    for name in [name for name in sys.modules if name in deprecated.MODULES]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.warns(DeprecationWarning, match="the old name is removed") as warned:
        module = importlib.import_module(old)
    new = deprecated.MODULES[old]
    assert module is importlib.import_module(new)
    assert module.__name__ == new and module.__spec__ is not None and module.__spec__.name == new
    last = warned[-1]
    assert f"{old} is now {new};" in str(last.message)


def test_the_warning_points_at_the_line_that_imports(monkeypatch):
    monkeypatch.delitem(sys.modules, "eomcheck.robots", raising=False)
    with pytest.warns(DeprecationWarning) as warned:
        import eomcheck.robots  # noqa: F401
    assert [one.filename for one in warned] == [__file__]


def test_no_old_path_hides_a_file_that_is_there():
    for old, new in deprecated.MODULES.items():
        file = importlib.import_module(new).__file__
        assert file is not None and new.rpartition(".")[2] in file
        assert old not in deprecated.MODULES.values()


def test_a_name_that_never_was_is_no_attribute():
    with pytest.raises(AttributeError, match=r"module 'eomcheck' has no attribute 'never'"):
        eomcheck.never  # noqa: B018


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [(m, old, new) for m, names in deprecated.NAMES.items() for old, new in names.items()],
)
def test_an_old_name_is_the_object_under_its_new_one(module: str, old: str, new: str):
    home = importlib.import_module(module)
    with pytest.warns(DeprecationWarning, match=f"{old} is now {module}.{new};") as warned:
        found = getattr(home, old)
    assert found is getattr(home, new)
    assert warned[0].filename == __file__


# ---- Keywords and attributes ---------------------------------------------------------------------

JOINT: dict[str, Any] = {
    "place": (1.0, 2.0, 3.0),
    "turn": (1.0, 0.0, 0.0, 0.0),
    "relaxed": 0.5,
    "follows": ("k", 2, 1),
}


def test_a_joint_takes_its_old_keywords_and_has_its_old_fields():
    head = "j", "revolute", "ground", "a"
    with pytest.warns(DeprecationWarning) as warned:
        joint = Joint(*head, **JOINT)  # pyright: ignore[reportCallIssue]
    assert {str(one.message).partition(" is now ")[0] for one in warned} == {
        f"Joint({old}=)" for old in JOINT
    }
    assert {one.filename for one in warned} == {__file__}
    new = deprecated.FIELDS["Joint"]
    assert joint == Joint(*head, **{new[old]: x for old, x in JOINT.items()})
    with pytest.warns(
        DeprecationWarning, match=r"Joint\._replace\(place=\) is now origin=;"
    ) as one:
        moved = joint._replace(**{"place": (0.0, 0.0, 1.0)})  # type: ignore
    assert moved == joint._replace(origin=(0.0, 0.0, 1.0)) and one[0].filename == __file__
    for old, value in JOINT.items():
        with pytest.warns(DeprecationWarning, match=rf"Joint\.{old} is now {new[old]};") as one:
            assert getattr(joint, old) == value
        assert one[0].filename == __file__


def test_a_mechanism_and_a_parameter_take_their_old_keywords():
    parts = [Link("ground"), Link("a", 1.0)], [Joint("j", "prismatic", "ground", "a")]
    more = [Link("b", 2.0)], [Joint("k", "prismatic", "a", "b")]
    links, joints = (one + two for one, two in zip(parts, more, strict=True))
    with pytest.warns(DeprecationWarning, match=r"mechanism\(first=\) is now dependent=;"):
        old = mechanism("Rails", links, joints, first=["k"])  # pyright: ignore[reportCallIssue]
    assert old().coordinate_names == ("k", "j")
    with pytest.warns(DeprecationWarning, match=r"parameter\(drawn=\) is now sample_range=;"):
        field = parameter("m", "kg", drawn=(1.0, 2.0))  # pyright: ignore[reportCallIssue]
    assert field.metadata["declared"].sample_range[:2] == (1.0, 2.0)
    assert field.metadata == parameter("m", "kg", sample_range=(1.0, 2.0)).metadata


def test_a_scene_may_name_its_sample_ranges_and_its_picture_by_their_old_names():
    with pytest.warns(DeprecationWarning) as warned:

        class Posed(Sleigh):
            pictured = 1.0, 2.0, 3.0
            drawn_coordinates = (Range(0.0, 1.0),) * 3

    assert [one.filename for one in warned] == [__file__] * 2
    assert Posed.display_pose == (1.0, 2.0, 3.0)
    assert Posed.coordinate_sample_ranges == (Range(0.0, 1.0),) * 3
    with pytest.warns(DeprecationWarning, match=r"Posed\.pictured is now display_pose;"):
        assert Posed.pictured == (1.0, 2.0, 3.0)  # pyright: ignore[reportAttributeAccessIssue]


def test_an_old_attribute_of_a_mixin_counts_and_one_that_is_assigned_later():
    class Mixin:
        pictured = 1.0, 2.0, 3.0

    with pytest.warns(DeprecationWarning, match=r"Mixin\.pictured is now display_pose;") as warned:

        class Mixed(Mixin, Sleigh):
            pass

    assert warned[0].filename == __file__
    assert Mixed.display_pose == Mixin.pictured == (1.0, 2.0, 3.0)
    Mixed.pictured = 3.0, 2.0, 1.0
    with pytest.warns(DeprecationWarning, match=r"Mixed\.pictured is now display_pose;") as warned:
        _, pose = Mixed.sketched()
    assert warned[0].filename == __file__ and pose.tolist() == [3.0, 2.0, 1.0]


@pytest.mark.night
def test_an_old_attribute_in_a_file_that_a_command_loads_is_reported(tmp_path):
    file = tmp_path / "posed_sleigh.py"
    file.write_text(
        "from eomcheck.scenes import Sleigh\n\nclass Posed(Sleigh):\n    pictured = 1.0, 2.0, 3.0\n"
    )
    command = "from eomcheck.cli import main; main()"
    words = [sys.executable, "-c", command, "validate", "--scene", f"{file}:Posed"]
    done = subprocess.run(
        [*words, "--examples", "1", "--engine", "none"], capture_output=True, text=True
    )
    warning = f"{file}:3: DeprecationWarning: Posed.pictured is now display_pose;"
    assert done.returncode == 0 and done.stderr.count(warning) == 1


def test_what_a_robot_file_became_is_found_by_its_old_names():
    scene: Any = RANDOM["random-trees"].example()
    with pytest.warns(DeprecationWarning) as warned:
        made = scene.made
        assert (made.left_out, made.doubtful, made.source) == (
            scene.source.ignored,
            scene.source.warnings,
            scene.source.file,
        )
    assert made is scene.source and len(warned) == 4


def test_check_of_a_scene_in_one_state_is_check_state_and_warns():
    scene = Sleigh.example()
    q, v = scene.initial_state()
    with pytest.warns(DeprecationWarning, match=r"is now eomcheck\.check_state") as warned:
        old = eomcheck.check(scene, q, v, claims=["bias"], engines=["casadi"])
    assert warned[0].filename == __file__
    new = eomcheck.check_state(scene, q, v, claims=["bias"], engines=["casadi"])
    assert [str(one) for one in old] == [str(one) for one in new] and old


def test_a_closed_ring_a_silent_error_and_states_of_scenes_have_their_old_names():
    ring = Bricard()
    with pytest.warns(DeprecationWarning, match=r"Bricard\.closed is now closed_state;"):
        q, v = ring.closed(0.5, 0.7)  # pyright: ignore[reportAttributeAccessIssue]
    assert np.array_equal([q, v], ring.closed_state(0.5, 0.7))
    sleigh = Sleigh.example()
    accuracy = eomcheck.accuracy(sleigh, "au", sleigh.initial_state()[0], [0.0, 0.0])
    with pytest.warns(DeprecationWarning, match=r"Accuracy\.silent is now silently_wrong;"):
        assert accuracy.silent is False  # pyright: ignore[reportAttributeAccessIssue]
    snakes = strategies.snakes(2, 2)
    with pytest.warns(DeprecationWarning, match=r"scene_states\(of=\) is now states_of=;"):
        old: Any = strategies.scene_states
        pairs = old(snakes, of=strategies.states)
    (scene, state), *_ = strategies.draw_samples(pairs, 1, 0)
    assert scene.links == 2 and len(state.q) == scene.n


def test_every_old_field_is_gone_from_what_it_was_of():
    for owner, names in deprecated.FIELDS.items():
        assert not names.keys() & set(names.values()), owner


# ---- Options of the command line -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "old", "new"),
    [(c, old, new) for c, names in deprecated.OPTIONS.items() for old, new in names.items()],
)
def test_an_old_option_is_read_as_the_new_one(command: str, old: str, new: str, capsys):
    words = command.split()
    given = [*words, "first", f"{old}=3", old, "x", "--", old]
    expected = [*words, "first", f"{new}=3", new, "x", "--", old]
    assert deprecated.current_options(given) == expected
    notice = f"eomcheck: {old} is now {new}; the old name is removed in 0.4\n"
    assert capsys.readouterr() == ("", 2 * notice)
    options = {option for parameter in command_at(words).params for option in parameter.opts}
    assert new in options and old not in options


def command_at(words: list[str]) -> Any:
    """Return the command of the command line with this name, such as ["study", "paper"]."""
    command: Any = typer.main.get_command(cli.app)
    for word in words:
        command = command.resolve_command(Context(command), [word])[1]
    return command


def test_words_without_old_options_stay_as_they_are(capsys):
    for words in ([], ["--version"], ["prove"], ["prove", "--links=3"], ["report", "--points"]):
        assert deprecated.current_options(words) == words
    assert capsys.readouterr() == ("", "")


def test_an_old_option_of_the_command_line_warns_once(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["eomcheck", "prove", "--points", "0"])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 2
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith("eomcheck: --points is now --examples;")
    assert second == "eomcheck: --examples 0, expected a whole number of at least 1"


def test_an_old_and_its_new_name_together_are_refused(monkeypatch, capsys):
    for words in (
        ["compare", "crane.urdf", "--examples", "2", "--states", "3"],
        ["study", "paper", "--records", "foo.db", "x.db"],
    ):
        monkeypatch.setattr(sys, "argv", ["eomcheck", *words])
        with pytest.raises(SystemExit) as end:
            cli.main()
        assert end.value.code == 2
        assert "are both given, expected one" in capsys.readouterr().err
    old: Any = Joint
    with pytest.raises(InputError, match="place and origin are both given"):
        old("x", "fixed", "b", place=(0, 0, 0), origin=(1, 0, 0))


@pytest.mark.parametrize("command", ["validate", "fuzz"])
def test_a_seed_is_not_negative(command, monkeypatch, capsys):
    monkeypatch.setattr("eomcheck.supervisor.can_supervise", lambda: False)
    monkeypatch.setattr(sys, "argv", ["eomcheck", command, "--seed", "-1"])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 2
    assert "--seed -1, expected a whole number of at least 0" in capsys.readouterr().err


def test_holonomic_is_a_truth_value():
    from eomcheck.testing import EquationsOfMotion

    old: Any = EquationsOfMotion
    with pytest.raises(InputError, match="holonomic = 'no', expected True or False"):
        old(1, M=lambda q: [[1.0]], holonomic="no")

"""Names and words of the command line: what each stands for, and what is said of a wrong one."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from eomcheck import class_lookup
from eomcheck.class_lookup import (
    announced,
    class_named,
    home_of_code,
    in_file,
    object_named,
    outside_error,
)
from eomcheck.cli import application
from eomcheck.errors import CallError, EngineError, InputError, UnknownNameError
from eomcheck.lab.option_parsing import (
    no_more_than,
    parse_interval,
    parse_parameters,
    parse_whole_numbers,
)
from eomcheck.scene_lookup import SCENE, scene_class_named
from eomcheck.scenes import Sleigh, Snake

OWN = """
from eomcheck.scenes import Sleigh, Snake

class Mine(Sleigh):
    key = "mine"

class Other(Snake):
    key = "other"

class Plain:
    def deep(self):
        raise ZeroDivisionError("by hand")

    def fail(self):
        self.deep()

number = 7
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file with classes, in a folder that nothing was imported from."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(sys, "modules", dict(sys.modules))
    path = tmp_path / f"own_{tmp_path.name.replace('-', '_')}.py"
    path.write_text(OWN)
    return path


# ---- Classes by name -----------------------------------------------------------------------------


def test_a_class_in_a_file_is_found_and_its_folder_is_the_last_place_to_look(own):
    before = [*sys.path]
    made = class_named(SCENE, f"{own}:Mine")
    assert (made.key, made.__module__, issubclass(made, Sleigh)) == ("mine", own.stem, True)
    assert sys.path == [*before, str(own.parent)]
    assert in_file(str(own), "Plain").__name__ == "Plain"
    assert object_named(f"{own}:number") == 7
    assert object_named(f"{own}:nothing") is object_named("sleigh") is None
    assert sys.path == [*before, str(own.parent)]


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("{own}:Min", "has no scene 'Min' (did you mean 'Mine'?); it has: Mine, Other"),
        ("{own}:number", "has no scene 'number'; it has: Mine, Other"),
        ("{own}:Plain", "Plain in '{own}' does not derive from eomcheck's Scene"),
        ("{own}", "scene = '{own}', expected {own}:Class"),
        ("{own}x.py:Mine", "'{own}x.py' is not a file"),
        ("no_such_module:Mine", "'no_such_module' cannot be imported: ModuleNotFoundError: No"),
        ("eomcheck.scenes:Sleig", "'eomcheck.scenes' has no scene 'Sleig'; it has: none"),
    ],
)
def test_what_is_no_class_of_that_kind_is_said_with_those_that_there_are(own, name, says):
    with pytest.raises(InputError) as error:
        class_named(SCENE, name.format(own=own))
    assert says.format(own=own) in str(error.value)


def test_a_file_is_told_from_an_installed_module_of_its_name(own):
    other = own.with_name("json.py")
    other.write_text(OWN)
    with pytest.raises(InputError, match="has the name of another module, json"):
        class_named(SCENE, f"{other}:Mine")
    bad = own.with_name("2nd.py")
    bad.write_text(OWN)
    with pytest.raises(InputError, match="'2nd' is no name in Python"):
        class_named(SCENE, f"{bad}:Mine")
    raising = own.with_name(f"{own.stem}_raising.py")
    raising.write_text("raise LookupError('by hand')\n")
    for _ in range(2):  # it is run again, and not taken for a module that is there
        with pytest.raises(InputError, match="cannot be imported: LookupError: by hand"):
            class_named(SCENE, f"{raising}:Mine")
    assert raising.stem not in sys.modules


def test_a_module_of_the_current_folder_is_found_after_all_others(own, monkeypatch):
    monkeypatch.chdir(own.parent)
    own.with_name("wave.py").write_text(OWN)
    with pytest.raises(InputError, match="'wave' has no scene 'Mine'"):
        class_named(SCENE, "wave:Mine")
    assert class_named(SCENE, f"{own.stem}:Other").key == "other"
    assert sys.path[-1] == str(own.parent)


def test_names_are_keys_or_homes_with_a_name_in_them():
    assert home_of_code("C:/a/own.py:Mine") == ("C:/a/own.py", "Mine")
    assert home_of_code("package.module:Mine") == ("package.module", "Mine")
    for name in ("sleigh", ":Mine", "own.py:", "own.py:1x", "arm.urdf:a b", 3, None):
        assert home_of_code(name) is None
    assert scene_class_named("coil") is Snake and class_named(SCENE, "sleigh") is Sleigh
    with pytest.raises(InputError, match="'all': expected one scene"):
        scene_class_named("all")
    with pytest.raises(UnknownNameError, match="did you mean 'pattern'") as error:
        scene_class_named("patern")
    assert {"paper", "coil", "snake"} <= set(error.value.known)


def test_what_packages_announce_is_known_beside_ours_which_stay_ours(own, monkeypatch):
    monkeypatch.chdir(own.parent)

    def point(name: str, value: str) -> Any:
        return SimpleNamespace(name=name, value=value)

    of = {"eomcheck.scenes": [point("sleigh", "x:Y"), point("mine", f"{own.stem}:Mine")]}
    monkeypatch.setattr(class_lookup, "entry_points", lambda group: of.get(group, []))
    assert [*announced(SCENE)] == ["mine"]
    assert class_named(SCENE, "mine").key == "mine" and class_named(SCENE, "sleigh") is Sleigh
    with pytest.raises(UnknownNameError, match="did you mean 'mine'"):
        class_named(SCENE, "min")


def test_an_error_of_code_that_was_looked_up_is_told_with_its_innermost_line(own, monkeypatch):
    monkeypatch.setattr(class_lookup, "_run_here", set())
    plain: Any = in_file(str(own), "Plain")

    def error_of(function: Any) -> BaseException:
        try:
            function()
        except Exception as error:
            return error
        raise AssertionError

    error = error_of(plain().fail)
    line = OWN.splitlines().index('        raise ZeroDivisionError("by hand")') + 1
    assert outside_error(error).startswith(f"{own.name}: deep raised ZeroDivisionError")
    assert f"line {line}" in outside_error(error)
    assert outside_error(error_of(lambda: in_file("no/such.py", "X"))).startswith(
        Path(__file__).name
    )
    assert outside_error(error_of(lambda: int("x"))).startswith(Path(__file__).name)
    assert outside_error(CallError("f", "raised it")) == "f raised it"
    monkeypatch.setattr(class_lookup, "_run_here", set())
    assert outside_error(error) == ""


# ---- Words ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("read", "text", "value"),
    [
        (parse_interval, "3", (3, 3)),
        (parse_interval, " 2..2 ", (2, 2)),
        (parse_interval, "1..100000", (1, 100_000)),
        (parse_interval, "0..3", "expected whole numbers of at least 1"),
        (parse_interval, "4..3", "expected first <= last"),
        (parse_interval, "100001", "expected at most 100000"),
        (parse_interval, "1...3", "expected a number or a range"),
        (parse_whole_numbers, "5,1..3,2..4", [1, 2, 3, 4, 5]),
        (no_more_than, 100_000, 100_000),
        (no_more_than, None, None),
        (no_more_than, 100_001, "links = 100001, expected at most 100000"),
        (parse_parameters, ["a=1", "a=2"], "a is given twice"),
        (parse_parameters, ["a="], "expected NAME=VALUE"),
        (parse_parameters, ["=1"], "expected NAME=VALUE"),
        (parse_parameters, ["a=,"], "expected a number after a="),
        (parse_parameters, ["a=-1e3", "b=none"], {"a": [-1000.0], "b": None}),
        (application.selected_engines, ["none"], []),
        (application.selected_engines, None, None),
        (application.selected_engines, ["none", "casadi"], ["none", "casadi"]),
        (application.raise_unread, [], None),
        (application.raise_unread, ["first"], "not all is shown: first"),
        (application.raise_unread, ["first", "b", "c"], "not all is shown: first (and 2 more)"),
        (application.check_figure, Path("a.svg"), None),
        (application.check_figure, Path("a.gif"), "a figure is written as .png, .svg or .pdf"),
        (application._patient, 0.0, "expected seconds, a positive number up to 1e6"),
        (application._patient, 1.1e6, "expected seconds"),
    ],
)
def test_words_are_read_up_to_their_bounds(read, text, value, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if isinstance(value, str):
        with pytest.raises(InputError) as error:
            read(text)
        assert value in str(error.value)
        assert read is not application.raise_unread or value == str(error.value)
    else:
        assert read(text) == value


def test_records_for_a_page_are_kept_where_they_are_asked_for_or_thrown_away(tmp_path, monkeypatch):
    page, path = tmp_path / "page.html", tmp_path / "r.db"
    installed = "eomcheck.lab.report.report_formats.check_installed"
    monkeypatch.setattr(installed, lambda: None)
    with application.records_to_report(None, None) as records:
        assert records is None
    with application.records_to_report(path, page) as records:
        assert records is not None and records.path == path
    assert path.exists()
    with application.records_to_report(None, page) as records:
        assert records is not None
        spare = records.path
        assert spare.exists() and spare.parent != tmp_path
    assert not spare.parent.exists()

    def missing() -> None:
        raise EngineError("no jinja2")

    monkeypatch.setattr(installed, missing)
    with application.records_to_report(path, None) as records:
        assert records is not None
    with pytest.raises(EngineError), application.records_to_report(path, page):
        pass


def test_a_page_is_never_written_over_records_whatever_they_are_called(tmp_path):
    path, link = tmp_path / "r.db", tmp_path / "link.db"
    path.write_text("x")
    link.symlink_to(path)
    other = tmp_path / "other.db"
    application.check_output(other, [path])
    application.check_output(None, [path])
    for records in ([path], [other, path], [link]):
        with pytest.raises(InputError, match="holds the records themselves"):
            application.check_output(path, records)


def test_a_folder_to_write_into_is_made_where_the_one_around_it_exists(tmp_path: Path, monkeypatch):
    application.check_folder(tmp_path)
    application.check_folder(None)
    application.check_folder(tmp_path / "new")
    monkeypatch.chdir(tmp_path)
    application.check_folder(Path("here"))
    assert sorted(x.name for x in tmp_path.iterdir() if x.is_dir()) == ["here", "new"]
    with pytest.raises(InputError, match=r"'no/such' cannot be made: there is no folder 'no'"):
        application.check_folder(Path("no/such"))
    Path("file").write_text("x")
    with pytest.raises(InputError, match="'file' is a file, expected a folder"):
        application.check_folder(Path("file"))

"""Old names still work for one release, and warn at the line that uses them."""

from __future__ import annotations

import importlib
import sys

import pytest

import eomcheck
from eomcheck import deprecated


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

"""Files are written whole or not at all, by one function."""

from __future__ import annotations

import ast
import errno
import os
import stat
from pathlib import Path

import pytest

import eomcheck
from eomcheck.atomic_write import check_regular, check_writable, read_text, replacing, write_text
from eomcheck.errors import InputError, UnwrittenError
from eomcheck.lab.store.record_file import Records
from eomcheck.motion.reference_solution import load_reference
from eomcheck.scenes import from_mjcf, from_urdf
from eomcheck.testing.suite import read_expected_failures

PACKAGE = Path(eomcheck.__file__).parent
NAME = "kept.json"


def names(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


def test_a_file_takes_the_place_of_another(tmp_path: Path):
    path = tmp_path / NAME
    write_text(path, "one θ\n")
    path.chmod(0o640)
    write_text(path, "two\n")
    assert path.read_bytes() == b"two\n"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert names(tmp_path) == [NAME]


def test_a_new_file_has_the_rights_of_any_other(tmp_path: Path):
    write_text(tmp_path / NAME, "")
    (tmp_path / "other").touch()
    assert (tmp_path / NAME).stat().st_mode == (tmp_path / "other").stat().st_mode


@pytest.mark.parametrize(
    ("ended", "error"),
    [
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), InputError),
        (KeyboardInterrupt(), KeyboardInterrupt),
        (ZeroDivisionError(), ZeroDivisionError),
    ],
)
@pytest.mark.parametrize("old", [None, "old"])
def test_whatever_ends_the_writing_leaves_the_old_file_whole(tmp_path, old, ended, error):
    path = tmp_path / NAME
    if old is not None:
        path.write_text(old)
    with pytest.raises(error) as raised, replacing(path) as beside:
        beside.write_text("half of wh")
        raise ended
    if error is InputError:
        assert str(raised.value) == f"{str(path)!r} cannot be written: No space left on device"
    assert names(tmp_path) == ([] if old is None else [NAME])
    assert old is None or path.read_text() == old


def test_a_disk_that_fills_up_leaves_the_old_file_whole(tmp_path: Path):
    resource = pytest.importorskip("resource")
    path = tmp_path / NAME
    write_text(path, "old")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(InputError, match=r"kept\.json' cannot be written"):
            write_text(path, "x" * 5000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert path.read_text() == "old"
    assert names(tmp_path) == [NAME]


def test_a_link_stays_one_and_what_it_leads_to_is_written(tmp_path: Path):
    real, link = tmp_path / "folder" / NAME, tmp_path / "link.json"
    real.parent.mkdir()
    real.write_text("old")
    link.symlink_to(real)
    check_writable(link)
    write_text(link, "new")
    assert link.is_symlink()
    assert real.read_text() == "new"


def test_a_device_is_written_into(tmp_path: Path):
    for path in (Path("/dev/null"), Path("/dev/full")):
        if not path.is_char_device():
            pytest.skip("no devices here")
        check_writable(path)
    write_text(Path("/dev/null"), "gone")
    with pytest.raises(InputError, match="/dev/full' cannot be written: No space"):
        write_text(Path("/dev/full"), "too much")
    assert Path("/dev/full").is_char_device()


@pytest.mark.parametrize(
    ("path", "why"), [("", "is a folder, expected a file"), ("none/x.json", "none' does not exist")]
)
def test_what_cannot_be_written_is_known_before(tmp_path: Path, path: str, why: str):
    with pytest.raises(InputError, match=why):
        check_writable(tmp_path / path)


def test_looking_whether_a_file_can_be_written_leaves_nothing(tmp_path: Path):
    check_writable(tmp_path / NAME)
    assert names(tmp_path) == []


def test_a_file_is_written_beside_under_a_hidden_name_of_its_kind(tmp_path: Path):
    path = tmp_path / NAME
    with replacing(path) as beside:
        assert (
            beside.parent == tmp_path and beside.name.startswith(".") and beside.suffix == ".json"
        )
        assert len(beside.name) == len(".json") + 17
        beside.write_bytes(b"new")
        assert not path.exists()
    with replacing(path) as again:
        assert again != beside
        again.write_bytes(b"newer")
        assert path.read_bytes() == b"new"
    assert path.read_bytes() == b"newer" and names(tmp_path) == [NAME]


@pytest.mark.parametrize(
    ("error", "why"),
    [
        (PermissionError(errno.EACCES, "Permission denied"), "Permission denied"),
        (OSError("no reason"), "no reason"),
    ],
)
@pytest.mark.parametrize("method", ["open", "touch"])
def test_a_file_or_a_folder_that_nobody_may_write_is_known_before(
    tmp_path: Path, monkeypatch, method, error, why
):
    path = tmp_path / NAME
    path.write_text("old")

    def refused(self: Path, *_: object, **__: object) -> None:
        assert self == path if method == "open" else self.parent == tmp_path and self != path
        raise error

    monkeypatch.setattr(Path, method, refused)
    with pytest.raises(UnwrittenError) as raised:
        check_writable(path)
    assert str(raised.value) == f"{str(path)!r} cannot be written: {why}"


def test_looking_whether_a_file_can_be_written_leaves_it_as_it_is(tmp_path: Path):
    path = tmp_path / NAME
    path.write_text("old")
    check_writable(path)
    check_writable(None)
    assert path.read_text() == "old" and names(tmp_path) == [NAME]


def test_a_text_is_read_in_utf_8_and_only_of_a_file(tmp_path: Path):
    path = tmp_path / NAME
    path.write_bytes("θ\n".encode())
    assert read_text(path) == "θ\n"
    check_regular(tmp_path / "none")
    for read in (read_text, check_regular):
        with pytest.raises(InputError) as raised:
            read(tmp_path)
        assert str(raised.value) == f"{str(tmp_path)!r} is not a regular file"
    path.write_bytes(b"\xff")
    with pytest.raises(UnicodeDecodeError):
        read_text(path)


WRITING = {"write_text", "write_bytes", "savefig", "touch"}


@pytest.mark.night
def test_every_writer_writes_beside():
    """Methods that write are called on what `replacing` yields, or in `eomcheck.atomic_write`."""
    found = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
                continue
            on, name = node.func.value, node.func.attr
            modes = [ast.unparse(x).strip("'") for x in node.args]
            opens = name == "open" and any(
                mode in {"w", "wb", "a", "ab", "x", "mode"} for mode in modes
            )
            given = [ast.unparse(x) for x in (on, *node.args)]
            if (name in WRITING or opens) and "beside" not in given:
                found.add((path.relative_to(PACKAGE).as_posix(), name))
    # Processes that are supervised write into pipes and into memory that they share.
    assert {file for file, _ in found} == {"atomic_write.py", "calls.py", "supervisor.py"}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes by name")
@pytest.mark.parametrize(
    "read",
    [
        lambda path: from_urdf(path.with_suffix(".urdf")),
        lambda path: from_mjcf(path.with_suffix(".xml")),
        load_reference,
        read_expected_failures,
        lambda path: Records(path, readonly=False),
    ],
    ids=["urdf", "mjcf", "reference", "expected", "records"],
)
def test_a_pipe_is_no_file_to_read(read, tmp_path: Path):
    path = tmp_path / "pipe"
    for suffix in ("", ".urdf", ".xml"):
        os.mkfifo(path.with_suffix(suffix))
    with pytest.raises(InputError, match="is not a regular file"):
        read(path)

"""Damaged and foreign records: one sentence, exit code 2, and what can be read is shown."""

from __future__ import annotations

import os
import random
import sqlite3
import sys
from pathlib import Path

import pytest

from eomcheck.cli import main
from eomcheck.errors import InputError
from eomcheck.lab.report.overview import Overview, read_records
from eomcheck.lab.report.report_formats import write_junit, write_markdown
from eomcheck.lab.store.record_file import Record, Records
from eomcheck.lab.studies import STUDIES
from eomcheck.motion.reference_solution import load_reference


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("sound") / "r.db"
    words = "validate", "--scene", "sleigh", "--examples", "2", "--records", str(path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["eomcheck", *words])
        with pytest.raises(SystemExit) as ended:
            main()
    assert ended.value.code in (0, None)
    return path.read_bytes()


@pytest.fixture
def path(sound: bytes, tmp_path: Path) -> Path:
    path = tmp_path / "r.db"
    path.write_bytes(sound)
    return path


def run(monkeypatch, *words: object) -> int:
    monkeypatch.setattr("sys.argv", ["eomcheck", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def change(path: Path, sql: str, *values: object) -> None:
    with sqlite3.connect(path) as connection:
        assert connection.execute(sql, values).rowcount == 1
    connection.close()


def report(monkeypatch, path: Path, capsys) -> tuple[int, str, list[str]]:
    """Return exit code, Markdown and what is said on standard error, but for what goes on."""
    page = path.with_suffix(".md")
    capsys.readouterr()
    code = run(monkeypatch, "report", path, "--markdown", page, "--junit", path.with_suffix(".xml"))
    said = [line for line in capsys.readouterr().err.splitlines() if not line.endswith(" ...")]
    return code, page.read_text(encoding="utf-8"), said


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.sampled(5)
def test_flipped_bytes_are_one_sentence_and_leave_what_can_be_read(path: Path, seed: int):
    """Seed 12 of another thousand: SQLite's message was no UTF-8, and a traceback was printed."""
    draw, content = random.Random(seed), bytearray(path.read_bytes())
    for _ in range(draw.choice([1, 3, 30])):
        content[draw.randrange(len(content))] = draw.randrange(256)
    path.write_bytes(content)
    unread: list[str] = []
    try:
        overview = Overview(read_records([path], unread), unread)
    except InputError as error:
        assert "\n" not in str(error)
        return
    write_markdown(overview, path.with_suffix(".md"))
    write_junit(overview, path.with_suffix(".xml"))
    assert overview.records or unread  # all rows may have been hit


def test_damage_in_one_place_leaves_most_records(path: Path, monkeypatch, capsys):
    with Records(path) as records:
        whole = len(records)
    content = bytearray(path.read_bytes())
    leaves = [at for at in range(4096, len(content), 4096) if content[at] == 13]  # of the table
    page = leaves[-1]
    on_it = int.from_bytes(content[page + 3 : page + 5], "big")
    assert 0 < on_it < whole, "a leaf of the table, and not all of it"
    content[page : page + 8] = bytes(8)  # the header of a page
    path.write_bytes(content)
    with pytest.raises(InputError, match="is damaged"), Records(path, readonly=True):
        pass
    unread: list[str] = []
    assert len(read_records([path], unread)) == whole - on_it
    assert unread
    code, page, said = report(monkeypatch, path, capsys)
    assert code == 2
    assert len(said) == 1
    assert said[0].startswith("eomcheck: not all is shown: ")
    assert "## Claims" in page


def test_rows_between_two_that_are_no_text_are_read(path: Path):
    with Records(path) as records:
        whole = [one.settings for one in records.all()]
    connection = sqlite3.connect(path)
    places = [row[0] for row in connection.execute("SELECT id FROM records ORDER BY id")]
    for place in (places[1], places[-2]):
        sql = "UPDATE records SET record = CAST(x'7b22ff22' AS TEXT) WHERE id = ?"
        connection.execute(sql, (place,))
    connection.commit()
    connection.close()
    unread: list[str] = []
    left = [one.settings for one in read_records([path], unread)]
    assert left == [whole[0], *whole[2:-2], whole[-1]] and len(left) > 2
    assert sum("is no text" in one for one in unread) == 2


DEEP = "[" * 100_000


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "record",
    [DEEP, "{}", "[1]", '{"study": "validation", "settings": {}}', "null", '{"study": 3}'],
    ids=["deep", "nothing", "list", "no scene", "null", "number"],
)
def test_a_record_that_is_none_is_said_and_the_others_are_shown(
    path: Path, record: str, monkeypatch, capsys
):
    sql = "UPDATE records SET record = ? WHERE id = (SELECT max(id) FROM records)"
    change(path, sql, record)
    code, page, said = report(monkeypatch, path, capsys)
    assert code == 2
    assert len(said) == 1
    assert said[0].startswith("eomcheck: not all is shown: ")
    assert "## Claims" in page
    code = run(monkeypatch, "export", path)
    exported = capsys.readouterr()
    assert len(exported.out.splitlines()) > 3
    assert code == 2
    written = path.with_suffix(".csv")
    assert run(monkeypatch, "export", path, written) == 2
    assert written.read_text(encoding="utf-8") == exported.out


@pytest.mark.parametrize("name", ["subject", "observed", "verdict", "proof"])
def test_a_finding_of_wrong_kinds_is_said(path: Path, name: str):
    unread: list[str] = []
    one = next(x for x in read_records([path]) if x.study == "validation")
    values = one.series[name]
    wrong = Record("validation", one.settings, series=one.series | {name: [{}] * len(values)})
    (said,) = Overview([one, wrong], unread).unread
    assert said.startswith("a record of 'validation' cannot be read: ")


@pytest.mark.sampled(3)
@pytest.mark.parametrize("study", STUDIES)
def test_records_of_what_this_install_lacks_are_said_or_shown(
    path: Path, study: str, monkeypatch, capsys
):
    lacking = {"scene": "hovercraft", "formulation": "hamel", "links": 3, "family": "ice"}
    with Records(path) as records:
        records.add(Record(study, lacking, seconds=1.0, series={"rows": [{"unheard": 1}]}))
        records.add(Record(study, lacking | {"links": 4}, "failed", "no such scene"))
    code, page, said = report(monkeypatch, path, capsys)
    assert (code, len(said)) in ((0, 0), (2, 1))
    assert code == 0 or f"the records of {study!r} cannot be shown" in said[0]
    assert "## Claims" in page


def test_findings_on_what_this_install_lacks_are_shown(path: Path, monkeypatch, capsys):
    one = next(x for x in read_records([path]) if x.study == "validation")
    subjects = ["hamel"] * len(one.series["subject"])
    settings = one.settings | {"scene": "hovercraft"}
    with Records(path) as records:
        records.add(Record("validation", settings, series=one.series | {"subject": subjects}))
    code, page, said = report(monkeypatch, path, capsys)
    assert (code, said) == (0, [])
    assert "hovercraft" in page


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_database_that_nobody_can_write_is_read_and_writing_it_is_one_sentence(path: Path):
    path.chmod(0o444)
    path.parent.chmod(0o555)
    for folder in path.parents:
        if os.getuid() == 0 and not folder.stat().st_mode & 0o001:
            folder.chmod(folder.stat().st_mode | 0o001)
    record = Record("study", {})
    child = os.fork()
    if child == 0:
        code = 1
        try:
            if os.getuid() == 0:
                os.setgroups([])
                os.setgid(65534)
                os.setuid(65534)
            assert len(read_records([path])) > 1
            try:
                with Records(path) as records:
                    records.add(record)
            except InputError as error:
                code = 0 if "cannot be used: attempt to write a readonly" in str(error) else 2
        finally:
            sys.stderr.flush()
            os._exit(code)
    _, status = os.waitpid(child, 0)
    path.parent.chmod(0o755)
    assert os.waitstatus_to_exitcode(status) == 0


def test_deep_json_is_no_reference_solution(tmp_path: Path):
    file = tmp_path / "deep.json"
    file.write_text(DEEP)
    with pytest.raises(InputError, match="is not JSON"):
        load_reference(file)

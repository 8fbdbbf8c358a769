"""Records: kept through `kill -9`, damage told from data, two writers, export."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest

from eomcheck import cli
from eomcheck.errors import EngineError, InputError, RefusedError
from eomcheck.lab import study as module
from eomcheck.lab.report.overview import record_columns, record_table
from eomcheck.lab.store import record_file
from eomcheck.lab.store.record_file import (
    Record,
    Records,
    blas_threads,
    key_of,
    machine,
    sources,
    versions,
)
from eomcheck.lab.study import run_cells


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "records.db"


def full(**other) -> Record:
    """Return a Record with something in every field."""
    given = {
        "study": "work-precision",
        "settings": {
            "scene": 'snake θ, "7"\nlinks',
            "rtol": 1e-12,
            "atol": math.inf,
            "n": 7,
            "partition": (0, 1),
            "more": {"b": None, "a": True},
        },
        "status": "failed",
        "reason": "step too small, at t = 0.1",
        "seconds": 0.1 + 0.2,
        "quartiles": (1e-300, math.inf),
        "cpu_seconds": 0.1,
        "runs": 20,
        "compile_seconds": math.nan,
        "counts": {"steps": 2**60, "rhs": 0},
        "errors": {"energy": -math.inf, "end": math.nan, "least": 5e-324},
        "series": {"times": [0.0, 0.1], "q": ((1.0, math.inf), (2.0, 5e-324))},
    }
    return Record(**(given | other))


def same(a: Record | None, b: Record) -> bool:
    """Return whether two Records are equal, NaN too."""
    return repr(a) == repr(b)


# ---- One Record ----------------------------------------------------------------------------------


def test_a_record_comes_back_as_it_was_infinities_and_nan_too(path: Path):
    record = full()
    with Records(path) as records:
        records.add(record)
    with Records(path) as records:
        found = records.find(record.study, record.settings)
        assert same(found, record)
        assert same(records.all()[0], record)
    assert found is not None and math.isnan(found.errors["end"])
    assert found.settings["partition"] == [0, 1]
    assert found.series["q"] == [[1.0, math.inf], [2.0, 5e-324]]


def test_a_record_says_where_and_when_it_was_made(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    record = Record("study", {})
    assert record.threads == 3
    assert record.machine.keys() == {"cpu", "cores", "os", "python"}
    assert {"eomcheck", "sources", "numpy", "llvmlite"} <= record.versions.keys()
    assert record.when.endswith("+00:00")


def test_threads_that_nothing_sets_are_unknown(monkeypatch):
    for library in ("OPENBLAS", "MKL", "OMP"):
        monkeypatch.delenv(f"{library}_NUM_THREADS", raising=False)
    assert blas_threads() is None
    monkeypatch.setenv("OMP_NUM_THREADS", "4,2")
    assert blas_threads() == 4


def test_versions_are_read_without_importing_libraries():
    code = (
        "import sys\n"
        "from eomcheck.lab.store.record_file import Record; print(Record('s', {}).versions);"
        "print(*{'numpy', 'scipy', 'numba', 'casadi', 'CyRK', 'distributed'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "llvmlite" in done.stdout.splitlines()[0]
    assert not done.stdout.splitlines()[1]


@pytest.mark.parametrize("file", ["__init__.py", "rooms.py", "rooms/one.py", "rooms/deep/two.py"])
def test_the_digest_of_the_sources_is_another_once_any_file_of_the_package_is(
    file: str, tmp_path: Path, monkeypatch
):
    for name in ("__init__.py", "rooms.py", "rooms/one.py", "rooms/deep/two.py", "notes.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    monkeypatch.setattr(record_file.eomcheck, "__file__", str(tmp_path / "__init__.py"))
    digest = sources.__wrapped__
    before = digest()
    assert len(before) == 16 and digest() == before
    (tmp_path / "notes.txt").write_text("other notes")
    assert digest() == before
    (tmp_path / file).write_text("other code")
    assert digest() != before


def test_what_is_said_of_machine_and_versions_is_the_callers_own():
    machine()["cpu"] = versions()["numpy"] = "changed"
    assert "changed" not in (machine()["cpu"], versions()["numpy"])


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"status": "good"}, "status = 'good'"),
        ({"settings": {"path": Path("x")}}, "Path is not JSON"),
        ({"settings": {1: 2}}, "names as keys"),
        ({"settings": [1]}, "names as keys"),
        ({"series": {"q": Path("x")}}, "series = .*Path is not JSON"),
    ],
)
def test_a_record_that_could_not_come_back_is_refused(given, says):
    with pytest.raises(InputError, match=says):
        full(**given)


def test_the_key_is_the_settings_and_not_how_they_are_written():
    assert key_of({"b": 1.0, "a": (1, 2)}) == key_of({"a": [1, 2.0], "b": 1}) == '{"a":[1,2],"b":1}'
    assert key_of({"a": 1}) != key_of({"a": True})
    assert key_of({"a": 1}) != key_of({"a": "1"})
    assert key_of({"a": 1e-12}) != key_of({"a": 1.0000000000000002e-12})
    assert key_of({"a": 2.0**53}) != key_of({"a": 2.0**60})


# ---- The file ------------------------------------------------------------------------------------


def test_a_repeated_add_replaces_and_keeps_its_place(path: Path):
    with Records(path) as records:
        for n in (1, 2, 1.0):
            records.add(Record("study", {"n": n}, reason=str(n)))
        assert len(records) == 2
        assert [record.reason for record in records.all()] == ["1.0", "2"]


def test_records_are_found_by_study_and_settings(path: Path):
    with Records(path) as records:
        for study in ("a", "b"):
            for n in (1, 2):
                for key in ("im", "kane"):
                    records.add(Record(study, {"n": n, "key": key}))
        assert records.find("c", {"n": 1, "key": "im"}) is None
        assert records.find("a", {"n": 1}) is None
        assert len(records.all()) == 8
        assert len(records.all("a")) == 4
        assert [r.settings["key"] for r in records.all("a", n=2.0)] == ["im", "kane"]
        assert len(records.all(key="im")) == 4
        assert records.all(no_such=None) == []


def test_forgotten_cells_are_gone_and_no_others(path: Path):
    with Records(path) as records:
        for n in (1, 2, 3):
            records.add(Record("study", {"n": n}))
        records.add(Record("other", {"n": 1}))
        records.forget("study", [{"n": 1}, {"n": 2}, {"n": 9}])
        assert [(r.study, r.settings["n"]) for r in records.all()] == [("study", 3), ("other", 1)]


def test_reading_makes_and_changes_nothing(path: Path):
    with pytest.raises(InputError, match="no such file"):
        Records(path, readonly=True)
    assert not path.exists()
    with Records(path) as records:
        records.add(Record("study", {}))
    before = path.read_bytes()
    with Records(path, readonly=True) as records:
        assert len(records) == 1
        with pytest.raises(InputError, match="readonly"):
            records.add(Record("study", {"n": 1}))
    assert path.read_bytes() == before
    assert os.listdir(path.parent) == [path.name]  # noqa: PTH208


def foreign_text(path: Path) -> None:
    path.write_text("not a database\n" * 100)


def foreign_database(path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE records (x)")
    connection.commit()
    connection.close()


def later_version(path: Path) -> None:
    change(path, "PRAGMA user_version = 2")


def no_record(path: Path) -> None:
    change(path, "UPDATE records SET record = '{\"study\": 1'")


def other_fields(path: Path) -> None:
    change(path, "UPDATE records SET record = '{\"colour\": 1}'")


def no_table(path: Path) -> None:
    change(path, "DROP TABLE records")


def change(path: Path, sql: str) -> None:
    connection = sqlite3.connect(made(path))
    connection.execute(sql)
    connection.commit()
    connection.close()


def made(path: Path) -> Path:
    with Records(path) as records:
        for n in range(200):
            records.add(Record("study", {"n": n}))
    return path


def cut_short(path: Path) -> None:
    content = made(path).read_bytes()
    path.write_bytes(content[: len(content) // 2])


def overwritten(path: Path) -> None:
    content = bytearray(made(path).read_bytes())
    content[4096:12288] = random.Random(0).randbytes(8192)
    path.write_bytes(content)


def folder(path: Path) -> None:
    path.mkdir()


@pytest.mark.parametrize(
    "spoil",
    [
        foreign_text,
        foreign_database,
        later_version,
        no_record,
        other_fields,
        no_table,
        cut_short,
        overwritten,
        folder,
    ],
    ids=lambda f: f.__name__,
)
@pytest.mark.parametrize("readonly", [False, True])
@pytest.mark.sampled(4)
def test_a_foreign_or_damaged_file_is_named_in_one_sentence_and_left_as_it_is(
    spoil, readonly, path: Path
):
    spoil(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(InputError) as caught, Records(path, readonly=readonly) as records:
        records.all()
    assert repr(str(path)) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert before is None or path.read_bytes() == before


def test_damage_is_noticed_before_anything_is_read(path: Path):
    overwritten(path)
    with pytest.raises(InputError, match="is damaged"):
        Records(path)


def test_a_folder_that_is_not_there_is_bad_input(path: Path):
    with pytest.raises(InputError, match="cannot be used"):
        Records(path / "no" / "records.db")


def test_an_empty_file_is_a_new_one(path: Path):
    path.touch()
    with Records(path) as records:
        assert len(records) == 0


# ---- Working off cells ---------------------------------------------------------------------------

CELLS = [{"n": n, "key": key} for n in (2, 3) for key in ("im", "kane")]


def test_a_second_run_repeats_nothing_and_works_what_is_new(path: Path):
    worked = []

    def work(settings):
        worked.append(settings)
        return Record("study", settings)

    with Records(path) as records:
        first = run_cells(records, "study", CELLS, work)
        again = run_cells(records, "study", [{"n": 4, "key": "im"}, *CELLS, *CELLS], work)
    assert worked == [*CELLS, {"n": 4, "key": "im"}]
    assert [record.settings for record in first] == CELLS
    assert [record.settings for record in again] == [{"n": 4, "key": "im"}, *CELLS]


def test_a_fresh_run_starts_over_and_can_be_resumed_too(path: Path):
    worked = []

    def work(settings):
        if len(worked) == 5:
            raise KeyboardInterrupt
        worked.append(settings)
        return Record("study", settings)

    with Records(path) as records:
        records.add(Record("study", {"n": 9}))
        run_cells(records, "study", CELLS, work)
        with pytest.raises(KeyboardInterrupt):
            run_cells(records, "study", CELLS, work, fresh=True)
        assert len(records) == 2
        worked.clear()
        run_cells(records, "study", CELLS, work)
        assert worked == CELLS[1:]
        assert len(records) == 5


def test_what_eomcheck_declines_is_a_record_with_its_reason(path: Path):
    def work(settings):
        if settings["n"] == 0:
            raise RefusedError("M", 1e-20, 1e-16, "M is singular")
        if settings["n"] == 1:
            raise EngineError("no such engine")
        return Record("study", settings, "failed", "step too small")

    with Records(path) as records:
        found = run_cells(records, "study", [{"n": n} for n in range(3)], work)
        assert [(r.status, r.reason) for r in found] == [
            ("refused", "M is singular"),
            ("failed", "no such engine"),
            ("failed", "step too small"),
        ]
        assert records.all() == found


def test_another_exception_is_raised_after_what_is_done_is_safe(path: Path):
    def work(settings):
        if settings["n"] == 2:
            raise ZeroDivisionError
        return Record("study", settings)

    with Records(path) as records, pytest.raises(ZeroDivisionError):
        run_cells(records, "study", [{"n": n} for n in range(4)], work)
    with Records(path) as records:
        assert [record.settings["n"] for record in records.all()] == [0, 1]


def test_a_record_of_another_cell_is_refused(path: Path):
    with Records(path) as records:
        for wrong in (Record("study", {"n": 1}), Record("other", {"n": 0})):
            with pytest.raises(InputError, match="other settings"):
                run_cells(records, "study", [{"n": 0}], lambda settings, wrong=wrong: wrong)
        assert len(records) == 0


def test_only_cells_that_are_left_advance_the_bar(path: Path, monkeypatch):
    from contextlib import contextmanager

    seen = []

    @contextmanager
    def progress(label, total):
        seen.append((label, total))
        yield lambda: seen.append("step")

    monkeypatch.setattr(module, "progress", progress)
    with Records(path) as records:
        records.add(Record("study", CELLS[0]))
        run_cells(records, "study", CELLS, lambda s: Record("study", s), label="timing")
    assert seen == [("timing", 3), *["step"] * 3]


# ---- Other processes -----------------------------------------------------------------------------

STUDY = """
import sys, time
from eomcheck.lab.study import run_cells
from eomcheck.lab.store.record_file import Record, Records

path, log, cells, seconds = sys.argv[1:]

def work(settings):
    with open(log, "a") as file:
        file.write(f"{settings['n']}\\n")
    time.sleep(float(seconds))
    return Record("study", settings, errors={"end": 0.5})

with Records(path) as records:
    run_cells(records, "study", [{"n": n} for n in range(int(cells))], work)
"""


def start(*arguments: object) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", STUDY, *map(str, arguments)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def lines(path: Path) -> list[int]:
    return [int(line) for line in path.read_text().split()] if path.exists() else []


@pytest.mark.night
def test_kill_9_loses_at_most_the_cell_in_flight(path: Path, tmp_path: Path):
    log = tmp_path / "log"
    for kill in range(1, 4):  # killed three times, at different moments
        process = start(path, log, 30, 0.05)
        deadline = time.monotonic() + 60
        while len(lines(log)) < 6 * kill and time.monotonic() < deadline:
            time.sleep(0.003 * kill)
        process.send_signal(signal.SIGKILL)
        _, said = process.communicate()
        assert process.returncode == -signal.SIGKILL, said
        assert len(lines(log)) >= 6 * kill
        with Records(path, readonly=True) as records:
            kept = [record.settings["n"] for record in records.all()]
        began = list(dict.fromkeys(lines(log)))
        assert kept == began[: len(kept)]
        assert len(began) - 1 <= len(kept) < 30
    process = start(path, log, 30, 0.0)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 0, said
    with Records(path) as records:
        assert [record.settings["n"] for record in records.all()] == list(range(30))
    assert len(lines(log)) - 30 <= 3  # the cell in flight, once per kill


WRITER = """
import sys
from eomcheck.lab.store.record_file import Record, Records

path, who = sys.argv[1:]
with Records(path) as records:
    for n in range(100):
        records.add(Record(who, {"n": n}))
        records.add(Record("both", {"n": n}, reason=who))
"""


@pytest.mark.night
def test_two_processes_write_at_once_from_the_making_of_the_file_on(path: Path):
    for _ in range(3):
        path.unlink(missing_ok=True)
        writers = [
            subprocess.Popen([sys.executable, "-c", WRITER, str(path), who]) for who in ("a", "b")
        ]
        assert [writer.wait(60) for writer in writers] == [0, 0]
        with Records(path) as records:
            assert len(records) == 300
            assert {record.reason for record in records.all("both")} <= {"a", "b"}


# ---- Export --------------------------------------------------------------------------------------


def table(records: list[Record]) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(record_table(records).csv())))


def test_a_table_has_every_value_in_full():
    record = full()
    (row,) = table([record])
    assert row["settings.scene"] == record.settings["scene"]
    assert float(row["settings.rtol"]) == 1e-12
    assert row["settings.partition"] == "[0, 1]"
    assert json.loads(row["settings.more"]) == {"a": True, "b": None}
    assert float(row["seconds"]) == 0.1 + 0.2
    assert (float(row["quartiles.low"]), float(row["quartiles.high"])) == (1e-300, math.inf)
    assert int(row["counts.steps"]) == 2**60
    assert float(row["errors.least"]) == 5e-324
    assert float(row["errors.energy"]) == -math.inf
    assert math.isnan(float(row["errors.end"]))
    assert json.loads(row["series.times"]) == [0.0, 0.1]
    assert row["machine.python"] == machine()["python"]
    assert row["versions.numpy"] == versions()["numpy"]


def test_columns_do_not_depend_on_the_order_of_records():
    a = Record("s", {"z": 1, "a": 2}, errors={"x": 1.0}, quartiles=(1, 2))
    b = Record("s", {"m": 1}, counts={"k": 1}, errors={"b": 1.0})
    assert record_columns([a, b]) == record_columns([b, a])
    assert record_columns([a, b])[:15] == [
        "study",
        *("settings.a", "settings.m", "settings.z"),
        *("status", "reason", "seconds", "quartiles.low", "quartiles.high"),
        *("cpu_seconds", "runs", "compile_seconds", "counts.k", "errors.b", "errors.x"),
    ]
    assert table([a, b])[1]["settings.z"] == ""


def export(*arguments: object, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["eomcheck", "export", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code or 0


def test_the_command_writes_a_table_to_a_file_or_to_standard_output(
    path: Path, tmp_path: Path, monkeypatch, capsys
):
    with Records(path) as records:
        records.add(full())
    target = tmp_path / "records.csv"
    assert export(path, "--csv", monkeypatch=monkeypatch) == 0
    printed = capsys.readouterr().out
    assert export(path, "--csv", target, monkeypatch=monkeypatch) == 0
    assert target.read_text(encoding="utf-8") == printed
    assert len(list(csv.reader(io.StringIO(printed)))) == 2


def test_the_command_does_not_write_over_the_records(path: Path, monkeypatch, capsys):
    with Records(path) as records:
        records.add(full())
    assert export(path, "--csv", path, monkeypatch=monkeypatch) == 2
    assert "holds the records themselves" in capsys.readouterr().err
    with Records(path) as records:
        assert len(records) == 1


def test_a_flipped_bit_of_a_record_is_damage_and_never_another_record(path: Path):
    with Records(path) as records:
        records.add(full())
        records.add(full(study="other"))
    query = "SELECT study, settings, record FROM records WHERE id = 1"
    with sqlite3.connect(path) as connection:
        row = connection.execute(query).fetchone()
    connection.close()
    rng, unseen = random.Random(0), []
    for _ in range(150):
        column = rng.choices((0, 1, 2), (1, 1, 4))[0]
        data = bytearray(row[column].encode())
        place = rng.randrange(len(data))
        data[place] ^= 1 << rng.randrange(7)
        name = ("study", "settings", "record")[column]
        changed = [x if i != column else data for i, x in enumerate(row)]
        sql = "UPDATE records SET study = ?, settings = ?, record = ? WHERE id = 1"
        with sqlite3.connect(path) as connection:
            connection.execute(
                sql,
                [x if isinstance(x, str) else bytes(x).decode(errors="replace") for x in changed],
            )
        connection.close()
        unread: list[str] = []
        with Records(path, readonly=True, unread=unread) as records:
            found = records.all("work-precision")
        if found or len(unread) != 1:
            unseen.append((name, place))
    assert not unseen


def test_a_record_without_a_digest_is_read_with_a_warning(path: Path):
    with Records(path) as records:
        records.add(full())
        records.add(full(study="other"))
        records._rows(
            "UPDATE records SET record = "
            "substr(record, 1, instr(record, ', \"digest\"') - 1) || '}'"
        )
        with pytest.warns(UserWarning, match="without a digest") as warned:
            assert len(records.all()) == 2
        assert len(warned) == 1

"""Records of studies with their provenance, and the SQLite file that holds them.

A `Record` is the result of one cell of a study; a cell is one combination of settings. Its
provenance is the machine, the versions, the digest of the sources, the threads and the time; no
library is imported to learn its version. Its key is the study and its settings as canonical JSON.

`Records` is a file of them: each `add` is one transaction, so that nothing added is lost by
`kill -9`; each Record carries a digest, by which damage is detected; and files of other programs or
versions are rejected.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import sqlite3
import subprocess
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, Literal, Self, TypeVar, get_args

import eomcheck
from eomcheck.atomic_write import check_regular
from eomcheck.deprecated import current_keys
from eomcheck.errors import InputError, UnwrittenError

# ---- Provenance ----------------------------------------------------------------------------------

LIBRARIES = ("numpy", "scipy", "llvmlite", "CyRK", "heyoka", "casadi", "pin")
LIBRARIES += ("python-flint", "distributed")
"""Distributions whose versions a Record stores, where they are installed."""


THREADS = tuple(f"{library}_NUM_THREADS" for library in ("OPENBLAS", "MKL", "OMP"))
"""Environment variables that set the number of BLAS threads; OpenBLAS prefers its own to OMP."""


def machine() -> dict[str, str | int]:
    """Return CPU model, number of logical cores, operating system and Python version."""
    return dict(_machine())


@cache
def _machine() -> dict[str, str | int]:
    return {
        "cpu": _cpu(),
        "cores": os.cpu_count() or 1,
        "os": platform.platform(),
        "python": platform.python_version(),
    }


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def versions() -> dict[str, str]:
    """Return the versions of eomcheck (with digest and commit) and of the libraries it uses."""
    return dict(_versions())


@cache
def _versions() -> dict[str, str]:
    installed = {"eomcheck": eomcheck.__version__, "sources": sources()}
    head = commit()
    if head is not None:
        installed["commit"] = head
    for name in LIBRARIES:
        try:
            installed[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return installed


@cache
def sources() -> str:
    """Return a digest of the package's sources, which identifies the code of a result."""
    root = Path(eomcheck.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def commit() -> str | None:
    """Return the commit of the package's sources, with "+" where they were changed since.

    None where they are not in a git checkout; `sources` identifies them there too.
    """
    root = Path(eomcheck.__file__).parent
    tracked, changed = _git(root, "ls-files", "__init__.py"), _git(root, "status", "-s", ".")
    head = _git(root, "rev-parse", "--short=12", "HEAD") if tracked else None
    return head and head + ("+" if changed else "")


def _git(folder: Path, *arguments: str) -> str | None:
    command = ("git", "-C", str(folder), *arguments)
    try:
        result = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return result.stdout.strip()


def blas_threads() -> int | None:
    """Return the number of BLAS threads that the environment sets, or None: the library chooses."""
    for variable in THREADS:
        value = os.environ.get(variable, "").split(",")[0].strip()
        if value.isdecimal():
            return int(value)
    return None


def now() -> str:
    """Return the time, UTC, as ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")


# ---- Settings and keys ---------------------------------------------------------------------------

Settings = dict[str, Any]
"""Setting of a study -> its value in this cell; values are numbers, text, None, lists, dicts."""


def json_of(what: str, given: object) -> str:
    """Return the JSON of a dict (with Python's Infinity and NaN), sorted.

    Raises:
        InputError: a value in `given` would not be read back unchanged; the message names it by
            `what`.
    """
    if not isinstance(given, dict) or not all(isinstance(name, str) for name in given):
        raise InputError(f"{what} = {given!r}, expected a dict with names as keys")
    try:
        return json.dumps(given, ensure_ascii=False, sort_keys=True, separators=(",", ":"))
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} = {given!r}: {error}") from None


def key_of(settings: Settings) -> str:
    """Return the canonical JSON of settings: names sorted, and 1.0 is 1."""
    return json_of("settings", canonical(settings))


def canonical(value: Any) -> Any:
    """Return the canonical form of a value, in which equal values have the same JSON: 1.0 is 1."""
    match value:
        case dict():
            return {name: canonical(entry) for name, entry in value.items()}
        case list() | tuple():
            return [canonical(entry) for entry in value]
        case float() if value.is_integer() and abs(value) <= 2**53:
            return int(value)
        case _:
            return value


# ---- Record --------------------------------------------------------------------------------------

Status = Literal["done", "failed", "refused"]

TEXTS = "study", "reason", "when"
"""Fields of a Record that are text."""


@dataclass(frozen=True)
class Record:
    """One cell of a study: its settings, results and provenance (by default this process, now).

    Attributes:
        study: name of the study.
        settings: settings of the cell: scene, formulation, integrator, rtol, ...
        status: "done", "failed" (an error) or "refused" (declined as ill-conditioned).
        reason: reason why it is not done, else "".
        seconds: best run time, s, or None where nothing was timed.
        quartiles: lower and upper quartile of the run times, s.
        cpu_seconds: CPU time of the best run, s; less than `seconds` where the core was shared.
        runs: number of timed runs.
        compile_seconds: time of compilation, s, not part of `seconds`.
        counts: right-hand sides, steps, ...
        errors: kind of error -> its size; infinities and NaN are kept.
        series: quantity over time, or over coordinates -> its values, a list (of lists).
        machine: cpu, cores, os, python; of a timed cell also core and load, see `RunTime`.
        versions: of eomcheck (and the digest of its sources) and of the libraries installed.
        threads: BLAS threads that the environment sets, None if it does not.
        when: time of the result, UTC, ISO 8601.
    """

    study: str
    settings: Settings
    status: Status = "done"
    reason: str = ""
    seconds: float | None = None
    quartiles: tuple[float, float] | None = None
    cpu_seconds: float | None = None
    runs: int = 0
    compile_seconds: float | None = None
    counts: dict[str, int] = field(default_factory=dict)
    errors: dict[str, float] = field(default_factory=dict)
    series: dict[str, list] = field(default_factory=dict)
    machine: dict[str, Any] = field(default_factory=machine)
    versions: dict[str, str] = field(default_factory=versions)
    threads: int | None = field(default_factory=blas_threads)
    when: str = field(default_factory=now)

    def __post_init__(self):
        if self.status not in get_args(Status):
            raise InputError(f"status = {self.status!r}, expected one of {get_args(Status)}")
        for kind, names in ((str, TEXTS), (dict, ("machine", "versions"))):
            for name in names:
                if not isinstance(getattr(self, name), kind):
                    raise InputError(f"{name} = {getattr(self, name)!r}, expected {kind.__name__}")
        # A Record must be read back equal to the one written: no tuples, no NumPy scalars.
        plain: dict[str, Any] = {
            "settings": json.loads(json_of("settings", self.settings)),
            "series": json.loads(json_of("series", self.series)),
            "counts": {name: int(value) for name, value in self.counts.items()},
            "errors": {name: float(value) for name, value in self.errors.items()},
        }
        for name in ("seconds", "cpu_seconds", "compile_seconds"):
            value = getattr(self, name)
            plain[name] = None if value is None else float(value)
        if self.quartiles is not None:
            low, high = self.quartiles
            plain["quartiles"] = (float(low), float(high))
        for name, value in plain.items():
            object.__setattr__(self, name, value)


# ---- Selecting and grouping ----------------------------------------------------------------------

Row = TypeVar("Row")
Thing = TypeVar("Thing")


def select(records: Iterable[Record], study: str | None = None, **settings: Any) -> list[Record]:
    """Return the finished Records, with a run time, of a study and with these settings."""
    return [
        r
        for r in records
        if study in (None, r.study)
        and r.seconds is not None
        and settings.items() <= r.settings.items()
    ]


def values(records: Iterable[Record], name: str) -> list[Any]:
    """Return the values of a setting in the Records that have it, each once."""
    return list(dict.fromkeys(r.settings[name] for r in records if name in r.settings))


def group(things: Iterable[Thing], key: Callable[[Thing], Any]) -> dict[Any, list[Thing]]:
    """Return the groups of things with equal `key`, in order: key -> things."""
    groups: dict[Any, list[Thing]] = {}
    for thing in things:
        groups.setdefault(key(thing), []).append(thing)
    return groups


def by_setting(records: Iterable[Record], name: str) -> dict[Any, list[Record]]:
    """Return the Records grouped by the value of a setting, in order: value -> Records."""
    return group(records, lambda record: record.settings[name])


def record_of_rows(study: str, settings: Settings, rows: Iterable[Any]) -> Record:
    """Return the Record of a cell with several results, each an instance of one dataclass.

    Its series `rows` holds them, fields by name.
    """
    return Record(study, settings, series={"rows": [asdict(row) for row in rows]})


def rows_in(records: Iterable[Record], kind: type[Row]) -> list[Row]:
    """Return the rows that `record_of_rows` stored, in order; none of Records that are not done."""
    return [kind(**row) for record in records for row in record.series.get("rows", ())]


# ---- The SQLite file -----------------------------------------------------------------------------

APPLICATION = int.from_bytes(b"eomc", "big")
"""SQLite's application id, by which files of Records are recognized."""
SCHEMA = 1
BUSY_SECONDS = 60.0
"""Longest wait for another writer, s. A write takes milliseconds."""

_TABLE = """
CREATE TABLE IF NOT EXISTS records (
    id INTEGER PRIMARY KEY,
    study TEXT NOT NULL,
    settings TEXT NOT NULL,
    record TEXT NOT NULL,
    UNIQUE (study, settings)
)
"""


class RecordsFile:
    """One open SQLite file of Records: created if absent, recognized, and checked for damage.

    Args:
        path: the file, created if there is none; None for one in memory.
        readonly: change nothing, and do not create the file.
        unread: list to which each unreadable part of a damaged file is appended, as a sentence;
            without it, damage raises.

    Raises:
        InputError: the file cannot be used, is damaged, or is not one of Records. Methods raise it
            too.
    """

    def __init__(
        self,
        path: str | Path | None,
        *,
        readonly: bool = False,
        unread: list[str] | None = None,
    ):
        self.path, self._unread = Path(":memory:" if path is None else path), unread
        if readonly and not os.path.isfile(self.path):  # noqa: PTH113 - False where it cannot be known
            raise InputError(f"{str(path)!r}: no such file")
        if path is not None:
            check_regular(self.path)
        mode = "rw" if readonly else "rwc"
        if readonly and self._fixed():
            mode = "ro&immutable=1"
        where = ":memory:" if path is None else f"{self.path.absolute().as_uri()}?mode={mode}"
        with self._sqlite():
            self._connection = sqlite3.connect(
                where, timeout=BUSY_SECONDS, isolation_level=None, uri=True
            )
        try:
            self._open(readonly)
        except BaseException:
            self.close()
            raise

    def _fixed(self) -> bool:
        """Return whether SQLite cannot write the file or its log here, and no log is left over."""
        log = self.path.with_name(f"{self.path.name}-wal")
        writable = os.access(self.path, os.W_OK) and os.access(self.path.absolute().parent, os.W_OK)
        return not writable and not (log.exists() and log.stat().st_size)

    def _open(self, readonly: bool) -> None:
        if readonly:
            # Not mode=ro, which leaves the files of SQLite's log behind.
            self._rows("PRAGMA query_only = ON")
        tables = self._value("SELECT count(*) FROM sqlite_master")
        if tables == self._value("PRAGMA application_id") == 0 and not readonly:
            self._make()
        if self._value("PRAGMA application_id") != APPLICATION:
            raise InputError(f"{str(self.path)!r} is not a file of records")
        schema = self._value("PRAGMA user_version")
        if schema != SCHEMA:
            raise InputError(
                f"{str(self.path)!r} has records of version {schema}, "
                f"this eomcheck reads version {SCHEMA}"
            )
        fault = self._value("PRAGMA quick_check(1)")
        if fault != "ok":
            self._note(str(fault))

    def _note(self, fault: str) -> None:
        """Append a fault to the list of unreadable parts, or raise InputError."""
        message = f"{str(self.path)!r} is damaged: {' '.join(fault.split())}"
        if self._unread is None:
            raise InputError(message)
        self._unread.append(message)

    def _make(self) -> None:
        deadline = time.monotonic() + BUSY_SECONDS
        while True:
            try:
                self._connection.execute("PRAGMA journal_mode = WAL")
                break
            except sqlite3.OperationalError as error:
                # Here SQLite does not wait for another process that creates the same file.
                if "locked" not in str(error) or time.monotonic() > deadline:
                    raise InputError(f"{str(self.path)!r} cannot be used: {error}") from None
                time.sleep(0.02)
            except sqlite3.DatabaseError as error:
                raise InputError(f"{str(self.path)!r} cannot be used: {error}") from None
        with self._transaction():  # idempotent: another process may have been here
            self._rows(_TABLE)
            self._rows(f"PRAGMA application_id = {APPLICATION}")
            self._rows(f"PRAGMA user_version = {SCHEMA}")

    @contextmanager
    def _sqlite(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.OperationalError as error:
            raise UnwrittenError(f"{str(self.path)!r} cannot be used: {error}") from None
        except (sqlite3.Error, UnicodeDecodeError) as error:
            raise InputError(f"{str(self.path)!r} is not a file of records: {error}") from None

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._rows("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            self._connection.rollback()
            raise
        self._rows("COMMIT")

    def _rows(self, sql: str, values: Sequence[object] = ()) -> list[tuple]:
        with self._sqlite():
            return self._connection.execute(sql, values).fetchall()

    def _value(self, sql: str) -> Any:
        return self._rows(sql)[0][0]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._connection.close()


# ---- Records in the file -------------------------------------------------------------------------

LAST_ID = 2**63 - 1
"""Largest row id of SQLite."""

_ADD = """
INSERT INTO records (study, settings, record) VALUES (?, ?, ?)
ON CONFLICT (study, settings) DO UPDATE SET record = excluded.record
"""


DIGEST = re.compile(r', "digest": "([0-9a-f]{32})"\}\Z')
"""End of the text of a Record: the digest of the text before it."""


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode(errors="surrogatepass"), digest_size=16).hexdigest()


class Records(RecordsFile):
    """The Records in one SQLite file; the key is the study and its settings.

    Each Record carries a digest, by which damage to it is detected; in a Record without one, of an
    earlier version, damage is not detected, which is a warning. Each `add` is one transaction:
    `kill -9` loses nothing that was added. Two processes may write to one file at the same time (on
    one machine: SQLite's log needs shared memory).

    Args:
        path: the file, created if there is none; None for Records in memory.
        readonly: change nothing, and do not create the file.
        unread: list to which each unreadable part of a damaged file is appended, as a sentence;
            `all` then returns the other Records. Without it, damage raises. Only with `readonly`.

    Raises:
        InputError: the file cannot be used, is damaged, or is not one of Records. Methods raise it
            too.
    """

    _undigested = False
    """Whether a Record without a digest was read; the warning is issued once."""

    def __len__(self) -> int:
        return self._value("SELECT count(*) FROM records")

    def add(self, record: Record) -> None:
        """Commit one Record; one with the same study and settings is replaced."""
        text = json.dumps(asdict(record), ensure_ascii=False)
        row = f'{text[:-1]}, "digest": "{_digest(text)}"}}'
        self._rows(_ADD, (record.study, key_of(record.settings), row))

    def find(self, study: str, settings: Settings) -> Record | None:
        """Return the Record of a cell, or None."""
        rows = self._rows(
            "SELECT record FROM records WHERE study = ? AND settings = ?", (study, key_of(settings))
        )
        return self._record(study, key_of(settings), rows[0][0]) if rows else None

    def all(self, study: str | None = None, **settings: Any) -> list[Record]:
        """Return the Records, oldest cell first: those of one study, with these settings."""
        records = []
        for row in self._texts(study):
            try:
                record = self._record(*row)
            except InputError:
                if self._unread is None:
                    raise
                self._note(f"{row[2][:60]!r} is no record")
                continue
            if study is None or record.study == study:
                records.append(record)
        wanted = canonical(settings).items()
        return [
            record
            for record in records
            if all(
                name in record.settings and canonical(record.settings[name]) == value
                for name, value in wanted
            )
        ]

    def _texts(self, study: str | None) -> list[tuple[str, str, str]]:
        """Return study, settings and text of each Record; if damaged, of those around the damage.

        For one study they include rows whose column names another study than their text.
        """
        query = (
            "SELECT id, study, settings, record FROM records WHERE (?1 IS NULL OR study = ?1 OR "
            """substr(record, 1, length(study) + 12) <> '{"study": "' || study || '"')"""
        )
        if self._unread is None:
            return [row[1:] for row in self._rows(f"{query} ORDER BY id", (study,))]
        rows: dict[int, list[bytes]] = {}
        for name in ("study", "settings", "record"):  # sqlite3 decodes nothing
            query = query.replace(name, f"CAST({name} AS BLOB)", 1)
        for sign, beyond, order in ((1, ">", "ASC"), (-1, "<", "DESC")):
            # One at a time: sqlite3 reads one row ahead, and would lose the one before the damage.
            one = f"{query} AND id {beyond} ?2 ORDER BY id {order} LIMIT 1"
            id_ = -sign * LAST_ID
            try:
                with self._sqlite():
                    while row := self._connection.execute(one, (study, id_)).fetchone():
                        if sign * row[0] <= sign * id_:
                            break  # damaged: the loop would never end
                        id_, rows[row[0]] = row[0], [bytes(x or b"") for x in row[1:]]
            except InputError as error:
                self._unread.append(str(error))
        texts = []
        for _, row in sorted(rows.items()):
            try:
                texts.append(tuple(one.decode() for one in row))
            except UnicodeDecodeError:
                self._note(f"{row[2][:60]!r} is no text")
        return texts

    def forget(self, study: str, cells: Iterable[Settings]) -> None:
        """Remove the Records of these cells, all or (if it fails) none."""
        with self._transaction():
            for settings in cells:
                self._rows(
                    "DELETE FROM records WHERE study = ? AND settings = ?",
                    (study, key_of(settings)),
                )

    def _record(self, study: str, settings: str, text: str) -> Record:
        """Return the Record of a row.

        Raises:
            InputError: the row is damaged.
        """
        end = DIGEST.search(text)
        body = text if end is None else f"{text[: end.start()]}}}"
        try:
            if end is not None and _digest(body) != end[1]:
                raise ValueError("another digest")
            record = Record(**json.loads(body))
            if (record.study, key_of(record.settings)) != (study, settings):
                raise ValueError("another key")
        except (ValueError, TypeError, AttributeError, ArithmeticError, RecursionError):
            raise InputError(f"{str(self.path)!r} is damaged: {text[:60]!r} is no record") from None
        for name in ("settings", "series"):
            object.__setattr__(record, name, current_keys(study, getattr(record, name)))
        if end is None and not self._undigested:
            self._undigested = True
            message = f"{str(self.path)!r} has records without a digest: damage to them is not seen"
            warnings.warn(message, stacklevel=2)
        return record

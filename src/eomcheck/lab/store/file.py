"""The file of Records: opened, made, guarded against other writers, and closed."""

from __future__ import annotations

import os
import sqlite3
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from eomcheck.atomic_write import check_regular
from eomcheck.errors import InputError, UnwrittenError

APPLICATION = int.from_bytes(b"eomc", "big")
"""SQLite's application id: tells our files from those of others."""
SCHEMA = 1
BUSY_SECONDS = 60.0
"""How long a writer waits for another one. A write takes milliseconds."""

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
    """One SQLite file, open: made, told apart from files of others, and looked at for damage.

    Args:
        path: the file, made if there is none; None for one in memory.
        readonly: change nothing, and do not make the file.
        unread: where to note, a sentence each, what cannot be read of a damaged file; without it,
            this raises.

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
        """Return whether nobody can write here, not even SQLite its log, and none is left over."""
        log = self.path.with_name(f"{self.path.name}-wal")
        here = os.access(self.path, os.W_OK) and os.access(self.path.absolute().parent, os.W_OK)
        return not here and not (log.exists() and log.stat().st_size)

    def _open(self, readonly: bool) -> None:
        if readonly:
            # Not mode=ro: that leaves the files of SQLite's log behind.
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
        """Note that something cannot be read, or raise InputError."""
        said = f"{str(self.path)!r} is damaged: {' '.join(fault.split())}"
        if self._unread is None:
            raise InputError(said)
        self._unread.append(said)

    def _make(self) -> None:
        deadline = time.monotonic() + BUSY_SECONDS
        while True:
            try:
                self._connection.execute("PRAGMA journal_mode = WAL")
                break
            except sqlite3.OperationalError as error:
                # Here SQLite does not wait for another process that makes the same file.
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

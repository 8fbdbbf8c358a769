"""Records: the cells of a study, kept in one SQLite file, each committed as it finishes."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from eomcheck.errors import InputError
from eomcheck.lab.store.file import RecordsFile
from eomcheck.lab.store.record import Record
from eomcheck.lab.store.settings import Settings, canonical, key_of

LAST_ID = 2**63 - 1
"""No row of SQLite has a larger number."""

_ADD = """
INSERT INTO records (study, settings, record) VALUES (?, ?, ?)
ON CONFLICT (study, settings) DO UPDATE SET record = excluded.record
"""


class Records(RecordsFile):
    """The Records in one SQLite file; the key is the study and its settings.

    Each `add` is one transaction: `kill -9` loses nothing that was added. Two processes may write
    to one file at the same time (on one machine: SQLite's log needs shared memory).

    Args:
        path: the file, made if there is none; None for Records that do not stay.
        readonly: change nothing, and do not make the file.
        unread: where to note, a sentence each, what cannot be read of a damaged file of which
            `all` then returns the rest; without it, this raises. Only with `readonly`.

    Raises:
        InputError: the file cannot be used, is damaged, or is not one of Records. Methods raise it
            too.
    """

    def __len__(self) -> int:
        return self._value("SELECT count(*) FROM records")

    def add(self, record: Record) -> None:
        """Commit one Record; one with the same study and settings is replaced."""
        row = json.dumps(asdict(record), ensure_ascii=False)
        self._rows(_ADD, (record.study, key_of(record.settings), row))

    def find(self, study: str, settings: Settings) -> Record | None:
        """Return the Record of a cell, or None."""
        rows = self._rows(
            "SELECT record FROM records WHERE study = ? AND settings = ?", (study, key_of(settings))
        )
        return self._record(rows[0][0]) if rows else None

    def all(self, study: str | None = None, **settings: Any) -> list[Record]:
        """Return the Records, oldest cell first: those of one study, with these settings."""
        records = []
        for text in self._texts(study):
            try:
                records.append(self._record(text))
            except InputError:
                if self._unread is None:
                    raise
                self._note(f"{text[:60]!r} is no record")
        wanted = canonical(settings).items()
        return [
            record
            for record in records
            if all(
                name in record.settings and canonical(record.settings[name]) == value
                for name, value in wanted
            )
        ]

    def _texts(self, study: str | None) -> list[str]:
        """Return the texts of Records; of a damaged file, those before and after the damage."""
        query = "SELECT id, record FROM records WHERE (? IS NULL OR study = ?)"
        if self._unread is None:
            return [text for _, text in self._rows(f"{query} ORDER BY id", (study, study))]
        found: dict[int, bytes] = {}
        query = query.replace("id, record", "id, CAST(record AS BLOB)")  # sqlite3 decodes nothing
        for sign, beyond, order in ((1, ">", "ASC"), (-1, "<", "DESC")):
            # One at a time: sqlite3 reads one row ahead, and would lose the one before the damage.
            one = f"{query} AND id {beyond} ? ORDER BY id {order} LIMIT 1"
            place = -sign * LAST_ID
            try:
                with self._sqlite():
                    while row := self._connection.execute(one, (study, study, place)).fetchone():
                        if sign * row[0] <= sign * place:
                            break  # damaged: it would go round for ever
                        place, found[row[0]] = row[0], bytes(row[1])
            except InputError as error:
                self._unread.append(str(error))
        texts = []
        for _, text in sorted(found.items()):
            try:
                texts.append(text.decode())
            except UnicodeDecodeError:
                self._note(f"{text[:60]!r} is no text")
        return texts

    def forget(self, study: str, cells: Iterable[Settings]) -> None:
        """Remove the Records of these cells, all or (if it fails) none."""
        with self._transaction():
            for settings in cells:
                self._rows(
                    "DELETE FROM records WHERE study = ? AND settings = ?",
                    (study, key_of(settings)),
                )

    def _record(self, text: str) -> Record:
        try:
            return Record(**json.loads(text))
        except (ValueError, TypeError, AttributeError, ArithmeticError, RecursionError):
            raise InputError(f"{str(self.path)!r} is damaged: {text[:60]!r} is no record") from None

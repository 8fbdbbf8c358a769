"""Records: the cells of a study, kept in one SQLite file, each committed as it finishes."""

from __future__ import annotations

import hashlib
import json
import re
import warnings
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


DIGEST = re.compile(r', "digest": "([0-9a-f]{32})"\}\Z')
"""How the text of a Record ends: the digest of what is before it."""


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode(errors="surrogatepass"), digest_size=16).hexdigest()


class Records(RecordsFile):
    """The Records in one SQLite file; the key is the study and its settings.

    Each Record carries a digest, by which damage to it is seen; of one without, by an earlier
    version, none is, which is a warning. Each `add` is one transaction: `kill -9` loses nothing
    that was added. Two processes may write to one file at the same time (on one machine: SQLite's
    log needs shared memory).

    Args:
        path: the file, made if there is none; None for Records that do not stay.
        readonly: change nothing, and do not make the file.
        unread: where to note, a sentence each, what cannot be read of a damaged file of which
            `all` then returns the rest; without it, this raises. Only with `readonly`.

    Raises:
        InputError: the file cannot be used, is damaged, or is not one of Records. Methods raise it
            too.
    """

    _undigested = False
    """Whether a Record without a digest was read, which is said once."""

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
        """Study, settings and text of each Record; of a damaged file, those around the damage.

        Of one study: also rows whose column says another one than their text.
        """
        query = (
            "SELECT id, study, settings, record FROM records WHERE (?1 IS NULL OR study = ?1 OR "
            """substr(record, 1, length(study) + 12) <> '{"study": "' || study || '"')"""
        )
        if self._unread is None:
            return [row[1:] for row in self._rows(f"{query} ORDER BY id", (study,))]
        found: dict[int, list[bytes]] = {}
        for name in ("study", "settings", "record"):  # sqlite3 decodes nothing
            query = query.replace(name, f"CAST({name} AS BLOB)", 1)
        for sign, beyond, order in ((1, ">", "ASC"), (-1, "<", "DESC")):
            # One at a time: sqlite3 reads one row ahead, and would lose the one before the damage.
            one = f"{query} AND id {beyond} ?2 ORDER BY id {order} LIMIT 1"
            place = -sign * LAST_ID
            try:
                with self._sqlite():
                    while row := self._connection.execute(one, (study, place)).fetchone():
                        if sign * row[0] <= sign * place:
                            break  # damaged: it would go round for ever
                        place, found[row[0]] = row[0], [bytes(x or b"") for x in row[1:]]
            except InputError as error:
                self._unread.append(str(error))
        texts = []
        for _, row in sorted(found.items()):
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
        """The Record of a row.

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
        if end is None and not self._undigested:
            self._undigested = True
            said = f"{str(self.path)!r} has records without a digest: damage to them is not seen"
            warnings.warn(said, stacklevel=2)
        return record

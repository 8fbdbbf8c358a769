"""What is picked from Records: those with some settings, in groups, and the rows in them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import Any, TypeVar

from eomcheck.lab.store.record import Record
from eomcheck.lab.store.settings import Settings

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
    """Return what a setting is in the Records that have it, each value once."""
    return list(dict.fromkeys(r.settings[name] for r in records if name in r.settings))


def group(things: Iterable[Thing], key: Callable[[Thing], Any]) -> dict[Any, list[Thing]]:
    """Return things by `key`, in order."""
    groups: dict[Any, list[Thing]] = {}
    for thing in things:
        groups.setdefault(key(thing), []).append(thing)
    return groups


def by_setting(records: Iterable[Record], name: str) -> dict[Any, list[Record]]:
    """Return Records by what a setting is in them, in order."""
    return group(records, lambda record: record.settings[name])


def record_of_rows(study: str, settings: Settings, rows: Iterable[Any]) -> Record:
    """Return the Record of a cell in which several things are found, each a dataclass of one kind.

    Its series `rows` holds them, fields by name.
    """
    return Record(study, settings, series={"rows": [asdict(row) for row in rows]})


def rows_of(records: Iterable[Record], kind: type[Row]) -> list[Row]:
    """Return what `record_of_rows` was given, in order; of Records that are not done, nothing."""
    return [kind(**row) for record in records for row in record.series.get("rows", ())]

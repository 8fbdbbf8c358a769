"""Working off the cells of a study that are not in a file of Records yet, each kept at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial

from eomcheck.console import progress
from eomcheck.errors import EomcheckError, InputError, RefusedError
from eomcheck.lab.store.groups import group
from eomcheck.lab.store.record import Record
from eomcheck.lab.store.records import Records
from eomcheck.lab.store.settings import Settings, key_of
from eomcheck.lab.store.workers import spread


def run_cells(
    records: Records,
    study: str,
    cells: Iterable[Settings],
    work: Callable[[Settings], Record],
    *,
    fresh: bool = False,
    label: str | None = None,
    where: str | None = None,
    by: Sequence[str] = (),
) -> list[Record]:
    """Work off the cells of a study that are not in `records` yet; return the Records of all.

    Each is committed as it finishes: after Ctrl-C, an error or `kill -9` the same call goes on with
    the cell that was in flight.

    Args:
        records: where they are kept.
        study: its name.
        cells: settings, one per cell; one named twice is worked once.
        work: settings -> Record of this study and these settings. An exception of eomcheck's own
            becomes a Record: "refused" for a `RefusedError`, otherwise "failed".
        fresh: forget what is known of these cells first.
        label: of `progress`, by default the name of the study; "" for none.
        where: where untimed cells are worked off, see `eomcheck.lab.store.workers.spread`; None:
            one after another, in this process.
        by: names of settings. Cells that share them go to one process together, in their order.
    """
    wanted = {key_of(settings): settings for settings in cells}
    if fresh:
        records.forget(study, wanted.values())
    found = {key: records.find(study, settings) for key, settings in wanted.items()}
    missing = [settings for key, settings in wanted.items() if found[key] is None]
    together = group(missing, lambda one: key_of({name: one[name] for name in by or one}))
    do, batches = partial(_work_off, study, work), together.values()
    finished = map(do, batches) if where is None else (x for _, x in spread(where, do, batches))
    with progress(study if label is None else label, len(together)) as advance:
        for made in finished:
            for record in made:
                records.add(record)
                found[key_of(record.settings)] = record
            advance()
    return [record for record in found.values() if record is not None]


def _work_off(
    study: str, work: Callable[[Settings], Record], together: list[Settings]
) -> list[Record]:
    return [_work_off_one(study, settings, work) for settings in together]


def _work_off_one(study: str, settings: Settings, work: Callable[[Settings], Record]) -> Record:
    try:
        record = work(settings)
    except RefusedError as refusal:
        return Record(study, settings, "refused", str(refusal))
    except EomcheckError as error:
        return Record(study, settings, "failed", str(error))
    if (record.study, key_of(record.settings)) != (study, key_of(settings)):
        # It would be stored under another key, and worked again by every run.
        raise InputError(f"the record of {study} {settings} is one of other settings: {record}")
    return record

"""Work that the processes of a test session share: the first one does it, the others read it."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable
from contextlib import closing
from hashlib import sha256
from pathlib import Path
from typing import Any

WAIT_SECONDS = 3600.0
"""How long a process waits for another that is at work."""


def done_once(folder: Path | None, name: str, work: Callable[[], Any]) -> Any:
    """Return what `work` returns, done once by all processes that share `folder`.

    SQLite is the lock: it goes with the process that holds it, however that ends. Where `work`
    raises nothing is kept, and the next process tries again.

    Args:
        folder: the folder, None where nothing is shared.
        name: of the work.
        work: returns plain data, as JSON has it.
    """
    if folder is None:
        return work()
    path = folder / f"eomcheck-{sha256(name.encode()).hexdigest()[:32]}.sqlite"
    with closing(sqlite3.connect(path, timeout=WAIT_SECONDS, isolation_level=None)) as database:
        database.execute("BEGIN EXCLUSIVE")
        database.execute("CREATE TABLE IF NOT EXISTS done (result TEXT)")
        kept = database.execute("SELECT result FROM done").fetchone()
        if kept is not None:
            return json.loads(kept[0])
        result = work()
        database.execute("INSERT INTO done VALUES (?)", (json.dumps(result),))
        database.execute("COMMIT")
        return result

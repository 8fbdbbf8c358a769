"""The states of one validation spread over processes; what is found is as in one process."""

from __future__ import annotations

import os
import pickle
from collections.abc import Iterator, Sequence
from functools import lru_cache, partial
from typing import NamedTuple

from eomcheck.calls import is_ours
from eomcheck.claims.run import Asked, Cases, Look, Looked, Selection, asked_of, look, often_at
from eomcheck.engines import Engine
from eomcheck.lab.store.workers import spread
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene

STATES_OF_ONE = 30
"""A process is started for so many states: its start takes as long as some ten of them."""


def place_for(
    examples: int, kinds: Sequence[type[Scene]], engines: Sequence[type[Engine]]
) -> str | None:
    """Return where so many states are looked at if nobody says: in more processes than this?

    Processes can import what is ours; a scene or an engine in somebody's file may be known here
    only.
    """
    processes = min(os.cpu_count() or 1, examples // STATES_OF_ONE)
    return f"local:{processes}" if processes > 1 and ours(*kinds, *engines) else None


def ours(*classes: type) -> bool:
    """Return whether all of these are of this package."""
    return all(map(is_ours, classes))


def looked_at(where: str | None, cases: Cases, selection: Selection) -> Looked:
    """Look at cases in the processes that `where` names, and yield them in their order.

    Args:
        where: see `eomcheck.lab.store.executors.executor`.
        cases: scenes in states.
        selection: what takes part.

    Raises:
        WorkerError, InputError, EngineError: see `eomcheck.lab.store.workers.spread`.
    """
    handed: dict[int, tuple[Scene, State]] = {}
    early: dict[int, Look] = {}
    following = 0

    def items() -> Iterator[_Item]:
        for i, (scene, state) in enumerate(cases):
            handed[i] = scene, state
            yield _Item(i, pickle.dumps(scene), state, f"{scene.structure} in {state}")

    for item, seen in spread(where, partial(_look, selection=selection), items()):
        early[item.number] = seen
        while following in early:
            yield *handed.pop(following), early.pop(following)
            following += 1


class _Item(NamedTuple):
    number: int
    scene: bytes
    state: State
    structure: str
    """What is said of it where it kills its process."""


def _look(item: _Item, selection: Selection) -> Look:
    return look(_asked(item.scene, selection), item.state, selection, often_at(item.number))


@lru_cache(1)
def _asked(scene: bytes, selection: Selection) -> Asked:
    """Return a scene with its engines, which states that follow each other may share."""
    return asked_of(pickle.loads(scene), selection)

"""The same tree in other frames: what a library is handed changes, and no answer may."""

from __future__ import annotations

import numpy as np

from eomcheck.engines.tree_engine import TreeLink
from eomcheck.mechanics.records import PLANAR_JOINTS


def twisted(links: list[TreeLink], seed: int) -> list[TreeLink]:
    """Return `links` with the frame of each joint turned at random, and its axis another one.

    In the plane moments of inertia about axes in it count for nothing, so they are drawn too: then
    the inertia has products in the turned frame.
    """
    rng = np.random.default_rng(seed)
    planar = all(link.kind in PLANAR_JOINTS for link in links)
    turns = [_turn(link, int(rng.integers(0, 3)), rng) for link in links]
    result = []
    for link, (turn, kind) in zip(links, turns, strict=True):
        before = np.eye(3) if link.parent < 0 else turns[link.parent][0]
        x, y = rng.uniform(0.6, 1.4, 2)
        inertia = link.inertia * np.array([x, y, 1.0]) if planar else link.inertia
        result.append(
            link._replace(
                kind=kind,
                rotation=before.T @ link.rotation @ turn,
                offset=before.T @ link.offset,
                center=turn.T @ link.center,
                inertia=turn.T @ inertia @ turn,
            )
        )
    return result


def _turn(link: TreeLink, axis: int, rng: np.random.Generator) -> tuple[np.ndarray, str]:
    """Return a rotation that takes the axis of that number to the joint's, and the kind then."""
    other = np.cross(link.axis, rng.normal(size=3))
    other /= np.linalg.norm(other)
    columns = [link.axis, other, np.cross(link.axis, other)]
    turn = np.roll(np.array(columns), axis, axis=0).T
    return turn, link.kind[0] + "xyz"[axis]

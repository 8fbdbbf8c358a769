"""Random mechanisms as they are drawn by a seed, word by word and number by number.

`draws.json` holds them: a seed that a report names draws the same mechanism in every version.
`python -m tests.scenes.draws` writes the file again, to be read where drawing changes on purpose.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from eomcheck.descriptions.random_mechanisms import RANDOM, with_random_constraint, with_random_pose
from eomcheck.descriptions.random_trees import (
    COMMON_JOINTS,
    SPACE,
    URDF_JOINTS,
    RandomDescription,
    joint_budgets,
    levels_of,
    random_tree,
    tree_factors,
    urdf_tree,
)
from eomcheck.descriptions.urdf_reader import urdf_text
from eomcheck.mechanics.scene import GeneratorChoices

STORED = Path(__file__).with_suffix(".json")

CLOSED = {
    "plane": ("pin", "weld", "distance", "on-quadric", "square", "edge", "coupling", "rolling"),
    "in space": (
        "pin", "weld", "hinge", "distance", "on-plane", "on-quadric", "square", "edge", "coupling",
        "drive", "touching", "rolling",
    ),
}  # fmt: skip
"""Kinds of constraints that a tree is closed by."""


def written(x: Any) -> str:
    """Return words and numbers, these to six digits; of a word, what is not as usual."""
    if isinstance(x, bool | str | None):
        return str(x)
    if isinstance(x, int | float | np.number):
        return f"{round(float(x), 9) + 0.0:.6g}"
    if not hasattr(x, "_fields"):
        return f"({' '.join(map(written, x))})"
    usual = x._field_defaults
    fields = {name: one for name, one in x._asdict().items() if one != usual.get(name, ...)}
    parts = (f"{name}={written(one)}" for name, one in fields.items())
    return f"{type(x).__name__}({' '.join(parts)})"


def lines(description: RandomDescription) -> list[str]:
    """Return a line for each link, joint and constraint, and one for all else."""
    parts = (*description.links, *description.joints, *description.constraints)
    rest = description.gravity, description.dependent, description.pose
    return [*map(written, parts), written(rest)]


def trees() -> dict[str, list[str]]:
    """Return trees of one to seven links, in ways that are drawn too."""
    found = {}
    for links in range(1, 8):
        random = GeneratorChoices(np.random.default_rng(links))
        for room in list(joint_budgets(links))[links % 3 :: 3]:
            ways = {name: random.one_of(of) for name, of in tree_factors(room, links).items()}
            least = random.whole(1, 9)
            one = random_tree(ways, links, random, least, turning=links > 2)
            name = f"{links} links, {', '.join(ways.values())}, {least}"
            planar = ways[SPACE] == "plane"
            found[name] = [written(tuple(levels_of(one, planar).values())), *lines(one)]
    return found


def loops() -> dict[str, list[str]]:
    """Return trees closed by each kind of constraint."""
    found = {}
    for space, kinds in CLOSED.items():
        for number, kind in enumerate(kinds):
            random = GeneratorChoices(np.random.default_rng(100 + number))
            room = next(one for one in joint_budgets(4) if one.space == space)
            ways = {name: random.one_of(of) for name, of in tree_factors(room, 4).items()}
            planar = space == "plane"
            grown = with_random_pose(random_tree(ways, 4, random, 7, turning=True), random)
            one = with_random_constraint(grown, kind, planar, random)
            found[f"{kind}, {space}"] = lines(one)[len(one.links) :]
    return found


def structures() -> dict[str, list[str]]:
    """Return the scenes that stand for all with so many links."""
    return {
        f"{key}[{links}]": [one.structure for one in kind.structures(links)]
        for key, kind in RANDOM.items()
        for links in (1, 2, 5)
    }


def urdfs() -> dict[str, list[str]]:
    """Return texts of URDFs, with all that there may be, and without."""
    found = {}
    for number, kinds in enumerate((COMMON_JOINTS, tuple(sorted(URDF_JOINTS)))):
        for there in (True, False):
            random = GeneratorChoices(np.random.default_rng(10 * number + there))
            text = urdf_text(urdf_tree(4, random, kinds, there, there, there), f"robot{number}")
            found[f"robot{number} {there}"] = [_rounded(line) for line in text.splitlines()]
    return found


def _rounded(line: str) -> str:
    """Return a line of XML, the digits of its numbers after the eighth left out."""
    parts = line.replace('"', ' " ').split(" ")
    return " ".join(f"{float(x):.8g}" if "." in x and x[-1].isdigit() else x for x in parts)


DRAWN = {"trees": trees, "loops": loops, "structures": structures, "urdfs": urdfs}

if __name__ == "__main__":
    everything = {name: draw() for name, draw in DRAWN.items()}
    STORED.write_text(json.dumps(everything, indent=0, ensure_ascii=False) + "\n", encoding="utf-8")

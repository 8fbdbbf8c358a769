"""Doubts about the numbers of a robot file: values that no body has, or that look like a mistake.

Readers use such numbers unchanged. A doubt is one sentence that names the elements: moments of
inertia that are impossible, inertia without mass, angles in degrees, axes that are no unit vectors,
centres of mass and inertias out of proportion with the size of their link.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal, InvalidOperation
from typing import NamedTuple

import numpy as np

from eomcheck.descriptions.elements import Joint, Link
from eomcheck.safe_output import listed

TOUCHING = 1e-9
"""Relative tolerance of the triangle inequality: a plate's largest moment is the sum of the
others, and files have few digits.
"""

MOST_NAMES = 5
"""Largest number of names in a sentence."""


def _named(names: Iterable[str]) -> str:
    """Return names as a list, the first `MOST_NAMES` of them."""
    return listed([*map(repr, names)], MOST_NAMES, "other")


# ---- Inertia -------------------------------------------------------------------------------------


def has_impossible_inertia(link: Link) -> bool:
    """Return whether moments of inertia are impossible: one exceeds the sum of the others."""
    moments = np.linalg.eigvalsh(link.inertia)
    # A negative one too, but for rounding: the sum of the lower two is below the larger of them.
    return bool(moments[2] > moments[:2].sum() * (1 + TOUCHING))


def inertia_warning(links: Iterable[Link]) -> str:
    """Return a sentence on links with impossible moments of inertia; "" without any."""
    names = [link.name for link in links if has_impossible_inertia(link)]
    if not names:
        return ""
    whose = _named(names)
    return f"No body has the moments of inertia of {whose}: one exceeds the sum of the others."


def massless_warning(links: Iterable[Link]) -> str:
    """Return a sentence on links with inertia and without mass; "" without any."""
    names = [link.name for link in links if link.has_inertia and not link.mass]
    return f"Inertia without mass: {_named(names)}." if names else ""


def default_warning(names: Iterable[str]) -> str:
    """Return a sentence on links without numbers of their own; "" without any."""
    names = [*names]
    return f"Mass 1 kg or moments 1 kg m² by default: {_named(names)}." if names else ""


# ---- Size ----------------------------------------------------------------------------------------

LARGE, SMALL = 10.0, 1e-3
"""Distances in sizes of a link beyond which its centre of mass, or its radius of gyration, is
doubtful. In 6 301 links of 12 packages centres of mass are at most at 1.7; radii of gyration are
from 0.003 to 3.2, but for those of dummy values.
"""


class LinkSize(NamedTuple):
    """Size of a link about the origin of its frame, from its shapes and the joints on it."""

    reach: float
    """Largest distance of a known point of it, m; 0 without any."""
    is_whole: bool = False
    """Whether its shapes are all known, and not meshes in other files."""


def link_sizes(
    links: Iterable[Link], joints: Iterable[Joint], shapes: Mapping[str, LinkSize]
) -> dict[str, float]:
    """Return the size of each link, m: its own, or that of the longest if its shape is not known.

    Args:
        links: all links.
        joints: all joints.
        shapes: name of a link -> size of its shapes.
    """
    sizes = {link.name: shapes.get(link.name, LinkSize(0.0)) for link in links}
    for joint in joints:
        if joint.parent in sizes:
            size = sizes[joint.parent]
            length = max(size.reach, math.hypot(*joint.origin))
            sizes[joint.parent] = size._replace(reach=length)
    longest = max((size.reach for size in sizes.values()), default=0.0)
    return {name: size.reach if size.is_whole else longest for name, size in sizes.items()}


def proportion_warning(links: Iterable[Link], sizes: Mapping[str, float]) -> str:
    """Return a sentence on centres of mass and inertias out of proportion; "" without any.

    Args:
        links: all links.
        sizes: name of a link -> its size, m; 0 where it is not known.
    """
    out: dict[str, list[str]] = {"far center of mass": [], "large inertia": [], "small inertia": []}
    for link in links:
        size = sizes[link.name]
        if not (link.mass > 0.0 and size > 0.0):
            continue
        gyration = math.sqrt(max(map(abs, link.moments)) / link.mass)
        doubts = (
            math.hypot(*link.center) > LARGE * size,
            gyration > LARGE * size,
            0.0 < gyration < SMALL * size,
        )
        for names, doubtful in zip(out.values(), doubts, strict=True):
            if doubtful:
                names.append(link.name)
    texts = [f"{what} of {_named(names)}" for what, names in out.items() if names]
    return f"Out of proportion with the size of the link: {'; '.join(texts)}." if texts else ""


def body_warnings(
    links: Sequence[Link], joints: Iterable[Joint], shapes: Mapping[str, LinkSize]
) -> tuple[str, ...]:
    """Return sentences on the bodies of a robot, "" for each without a doubt; see `link_sizes`."""
    sizes = link_sizes(links, joints, shapes)
    return (
        inertia_warning(links),
        massless_warning(links),
        proportion_warning(links, sizes),
    )


def joined(*sentences: str) -> str:
    """Return sentences as one text, without empty ones."""
    return " ".join(filter(None, sentences))


# ---- Printed numbers -----------------------------------------------------------------------------

FEWEST_DIGITS = 6
"""Number of significant digits from which on a file is taken to be rounded: programs write as many
at least, and people write fewer, which are exact."""


def half_digit(text: str) -> float:
    """Return half a unit of the last printed digit of a number; 0 if it is none."""
    try:
        exponent = Decimal(text).as_tuple().exponent
    except InvalidOperation:
        return 0.0
    return 0.5 * 10.0**exponent if isinstance(exponent, int) else 0.0


def _number(text: str) -> float:
    """Return a number of its text, NaN if it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def degree_warning(angles: Iterable[tuple[str, str]]) -> str:
    """Return a sentence on angles of more than a turn in radians; "" without any.

    Args:
        angles: name of the element and text of its angles.
    """
    names = [
        name
        for name, text in angles
        if any(abs(_number(x)) - 2.0 * math.pi > half_digit(x) for x in text.split())
    ]
    names = list(dict.fromkeys(names))
    return f"Angles of more than 2π rad, in degrees? {_named(names)}." if names else ""


def axis_warning(axes: Iterable[tuple[str, str]]) -> str:
    """Return a sentence on axes that are no unit vectors to their printed digits; "" without any.

    Args:
        axes: name of the joint and text of its axis.
    """
    names = []
    for name, text in axes:
        parts = text.split()
        length = math.hypot(*map(_number, parts))
        # A number of one digit such as 1 or 0.5 is exact.
        printed = math.hypot(*(half_digit(x) for x in parts if len(x.strip("-+0.")) > 1))
        if length > 0.0 and abs(length - 1.0) > max(printed, 0.5 * 10.0 ** (1 - FEWEST_DIGITS)):
            names.append(name)
    return f"Axes that are no unit vectors: {_named(names)}." if names else ""

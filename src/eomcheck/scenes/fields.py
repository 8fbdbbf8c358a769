"""Parameters that check themselves: what scenes that are frozen dataclasses have in common."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, Literal

import numpy as np

from eomcheck.errors import InputError
from eomcheck.model import finite_array

Sign = Literal["positive", "not negative", "any"]


def set_array(
    scene: Any, name: str, shape: tuple[int, ...], sign: Sign = "any", optional: bool = False
) -> None:
    """Replace the field `name` of a frozen dataclass by a checked array that cannot be changed.

    Args:
        scene: the dataclass.
        name: of the field.
        shape: of the array, () for one number.
        sign: of its entries.
        optional: whether the field may be None.

    Raises:
        InputError: wrong shape, not finite, or of another sign.
    """
    value = getattr(scene, name)
    if value is None and optional:
        return
    array = finite_array(name, value, shape)
    bad = array <= 0 if sign == "positive" else array < 0
    if sign != "any" and bad.any():
        expected = "a positive number" if sign == "positive" else "a number that is not negative"
        place = f"{name}[{int(bad.argmax())}]" if shape else name
        raise InputError(f"{place} = {array[bad].flat[0]}, expected {expected}")
    array.setflags(write=False)
    object.__setattr__(scene, name, array)


def as_code(scene: Any) -> str:
    """Return the Python that makes a dataclass of arrays again, its defaults left out."""
    shown = []
    for field in fields(scene):
        value = getattr(scene, field.name)
        value = value if value is None else value.tolist()
        usual = field.default
        if value != (np.array(usual).tolist() if isinstance(usual, tuple) else usual):
            shown.append(f"{field.name}={value!r}")
    return f"{type(scene).__name__}({', '.join(shown)})"


def whole_links(links: Any, name: str = "links") -> int:
    """Return a number of links as an int.

    Raises:
        InputError: it is no whole number of at least 1.
    """
    if isinstance(links, bool) or not isinstance(links, int | np.integer) or links < 1:
        raise InputError(f"{name} = {links!r}, expected a whole number of at least 1")
    return int(links)

"""Parameters that check themselves: what scenes that are frozen dataclasses have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, field, fields
from typing import Any, ClassVar, Literal, NamedTuple, TypeVar

import numpy as np

from eomcheck.errors import InputError, whole_number
from eomcheck.mechanics.records import Range
from eomcheck.mechanics.scene import Scene, finite_array
from eomcheck.numbers.contract import Arithmetic

R = TypeVar("R", bound=NamedTuple)
Sign = Literal["positive", "not negative", "any"]
Shape = tuple[int, ...] | Callable[[int], tuple[int, ...]]


class _Allowed(NamedTuple):
    shape: Shape
    sign: Sign
    drawn: Range | None
    optional: bool
    otherwise: Callable[[Any], Any] | None

    def shape_of(self, links: int) -> tuple[int, ...]:
        return self.shape(links) if callable(self.shape) else self.shape

    def checked(self, name: str, value: Any, links: int) -> np.ndarray | None:
        """Return the value as an array that cannot be changed, None where it is absent."""
        if value is None and self.optional:
            return None
        shape = self.shape_of(links)
        array = finite_array(name, value, shape)
        bad = array <= 0 if self.sign == "positive" else array < 0
        if self.sign != "any" and bad.any():
            positive = self.sign == "positive"
            expected = "a positive number" if positive else "a number that is not negative"
            place = f"{name}[{int(bad.argmax())}]" if shape else name
            raise InputError(f"{place} = {array[bad].flat[0]}, expected {expected}")
        array.setflags(write=False)
        return array


def parameter(
    default: Any = MISSING,
    sign: Sign = "any",
    shape: Shape = (),
    drawn: Range | None = None,
    optional: bool = False,
    otherwise: Callable[[Any], Any] | None = None,
) -> Any:
    """Return the field of a `Parametric` scene that is a number or an array of numbers.

    Args:
        default: its default, if any.
        sign: of its entries.
        shape: of the array, () for one number, or how it follows from the number of links.
        drawn: what it is drawn from in ordinary scenes, in its own shape.
        optional: whether it may be None, as it also may where `drawn` is optional.
        otherwise: makes it of the scene where it is None.
    """
    allowed = _Allowed(shape, sign, drawn, optional or bool(drawn and drawn.optional), otherwise)
    return field(default=default, metadata={"allowed": allowed})


def of_links(links: int) -> tuple[int, ...]:
    """Return the shape of what every link has one of."""
    return (links,)


def of_joints(links: int) -> tuple[int, ...]:
    """Return the shape of what every joint between two links has one of."""
    return (links - 1,)


class Parametric(Scene):
    """A scene that is a frozen dataclass, every field of it a `parameter`.

    What its coordinates and constraints are called it says in `named_coordinates` and
    `named_constraints` where that is the same for all scenes of its kind.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]
    named_coordinates: ClassVar[tuple[str, ...]] = ()
    named_constraints: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self):
        self.check_fields()

    def check_fields(self, links: int = 0) -> None:
        """Replace all fields by checked arrays that cannot be changed.

        Raises:
            InputError: wrong shape, not finite, or of another sign.
        """
        for one in fields(self):
            allowed, value = one.metadata["allowed"], getattr(self, one.name)
            if value is None and allowed.otherwise is not None:
                value = allowed.otherwise(self)
            object.__setattr__(self, one.name, allowed.checked(one.name, value, links))

    @classmethod
    def ranges(cls, links: int | None = None) -> dict[str, Range]:
        """Return what ordinary scenes of this kind are drawn from, by name of argument."""
        count = whole_links(links) if cls.has_links else 0
        allowed = {one.name: one.metadata["allowed"] for one in fields(cls)}
        return {
            name: one.drawn._replace(shape=one.shape_of(count))
            for name, one in allowed.items()
            if one.drawn is not None
        }

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Those of its kind."""
        return self.named_coordinates

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Those of its kind."""
        return self.named_constraints

    def in_numbers(self, arithmetic: Arithmetic, record: type[R], **made: Any) -> R:
        """Return a record of fields in the numbers of `arithmetic`, one number as an array (1,).

        Args:
            arithmetic: the kind of numbers.
            record: names the fields.
            made: those of the record that are no fields of the scene as they stand.
        """

        def one(name: str) -> Any:
            value = getattr(self, name)
            return None if value is None else arithmetic.numbers(np.atleast_1d(value))

        return record._make(made[x] if x in made else one(x) for x in record._fields)

    def __repr__(self) -> str:
        """Return the Python that makes it again, defaults left out."""
        shown = []
        for one in fields(self):
            value, usual = getattr(self, one.name), one.default
            value = value if value is None else value.tolist()
            if value != (np.array(usual).tolist() if isinstance(usual, tuple) else usual):
                shown.append(f"{one.name}={value!r}")
        return f"{type(self).__name__}({', '.join(shown)})"


def whole_links(links: Any, name: str = "links") -> int:
    """Return a number of links as an int.

    Raises:
        InputError: it is no whole number of at least 1.
    """
    return whole_number(name, links)

"""Parameters of a scene, each declared once: the field `parameter`, the base class `Parametric`.

A declaration holds description, unit, sign, shape, default and sampling range of a parameter;
checks, documentation and `repr` of a scene follow from it. Scenes are frozen dataclasses. Those
whose number of links can be chosen have the base class `OfLinks`.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass, replace
from functools import cache
from inspect import cleandoc
from typing import Any, ClassVar, Literal, NamedTuple, dataclass_transform

import numpy as np

from eomcheck.deprecated import old_keywords
from eomcheck.errors import InputError, registered, whole_number
from eomcheck.mechanics.records import Range
from eomcheck.mechanics.scene import Scene, finite_array
from eomcheck.numbers.generic import Arithmetic, generic

MOST_LINKS = 1_000_000
"""Largest number of links of a scene; its parameters then take some 50 MB."""


def number_of_links(links: Any) -> int:
    """Return the number of links as an int.

    Raises:
        InputError: it is no whole number, below 1 or above `MOST_LINKS`.
    """
    return whole_number("links", links, most=MOST_LINKS)


Sign = Literal["> 0", ">= 0", ""]
Shape = tuple[int, ...] | Callable[[int], tuple[int, ...]]


class _Declared(NamedTuple):
    what: str
    unit: str
    sign: Sign
    sample_range: Range | None
    shape: Shape
    optional: bool
    read: bool
    computed_default: Callable[[Any], Any] | None

    @property
    def documented(self) -> str:
        shape = self.shape.__name__.replace("_", " ") if callable(self.shape) else self.shape
        absent = "or None without" if self.optional else ""
        parts = self.what, str(shape or ""), self.unit, self.sign, absent
        return ", ".join(filter(None, parts))

    def shape_of(self, links: int) -> tuple[int, ...]:
        return self.shape(links) if callable(self.shape) else self.shape

    def checked(self, name: str, value: Any, links: int) -> np.ndarray | None:
        """Return the value as a read-only array; None if it is absent."""
        if value is None and self.optional:
            return None
        shape = self.shape_of(links)
        array = finite_array(name, value, shape)
        positive = self.sign == "> 0"
        bad = array <= 0 if positive else array < 0
        if self.sign and bad.any():
            expected = "a positive number" if positive else "a number that is not negative"
            place = f"{name}[{int(bad.argmax())}]" if shape else name
            raise InputError(f"{place} = {array[bad].flat[0]}, expected {expected}")
        array.setflags(write=False)
        return array


@old_keywords
def parameter(
    what: str,
    unit: str,
    sign: Sign = "",
    sample_range: tuple[float, float] | tuple[float, float, None] | None = None,
    shape: Shape = (),
    *,
    default: Any = MISSING,
    optional: bool = False,
    read: bool = True,
) -> Any:
    """Return a field of a `Parametric` scene that holds a number or an array of numbers.

    Args:
        what: description of the parameter, for its documentation.
        unit: its SI unit.
        sign: sign of its entries.
        sample_range: range from which ordinary scenes are sampled, in the parameter's own shape:
            low, high and, if it may also be None, None.
        shape: shape of the array, () for one number, or a function of the number of links.
        default: its default, if any; or a function of the scene that computes the value of a
            parameter that is None.
        optional: whether it may be None although it is never sampled so.
        read: whether the equations read it unchanged; False for parameters that enter only the
            initial state or the `derived` parameters.

    Returns:
        A dataclass field; its declaration is in the metadata.
    """
    absent = sample_range is not None and len(sample_range) == 3
    among = (
        None if sample_range is None else Range(sample_range[0], sample_range[1], optional=absent)
    )
    computed, default = (default, None) if callable(default) else (None, default)
    declared = _Declared(what, unit, sign, among, shape, optional or absent, read, computed)
    return field(default=default, metadata={"declared": declared})


def of_links(links: int) -> tuple[int, ...]:
    """Return the shape (links,) of a parameter with one entry per link."""
    return (links,)


def of_joints(links: int) -> tuple[int, ...]:
    """Return the shape (links - 1,) of a parameter with one entry per joint between two links."""
    return (links - 1,)


def stretched(scene: Any) -> np.ndarray:
    """Return the angles of a stretched chain, 0 for all links."""
    return np.zeros(scene.links)


def settable(scene: Any) -> dict[str, Field]:
    """Return the parameters that the scene's constructor takes, by name.

    Empty if the scene is no dataclass.
    """
    return {f.name: f for f in fields(scene) if f.init} if is_dataclass(scene) else {}


def with_parameters(scene: Any, changes: Mapping[str, Sequence[float] | None]) -> Any:
    """Return a scene with other parameters.

    Args:
        scene: the scene.
        changes: name -> its numbers in order, one number for all entries, or None to leave the
            parameter out.

    Raises:
        UnknownNameError: the scene has no such parameter.
        InputError: another count of numbers, or numbers that the scene refuses.
    """
    parameters = settable(scene)
    values = {}
    for name, numbers in changes.items():
        registered(f"parameter of {scene.key}", name, parameters)
        values[name] = numbers if numbers is None else _shaped(scene, name, numbers)
    return replace(scene, **values) if values else scene


def _shaped(scene: Any, name: str, numbers: Sequence[float]) -> np.ndarray:
    """Return numbers in the shape of a parameter."""
    declared = scene.declared.get(name) if isinstance(scene, Parametric) else None
    shape = np.shape(getattr(scene, name))
    if declared is not None:
        shape = declared.shape_of(getattr(scene, "links", 0))
    array, size = np.array(numbers, dtype=np.float64), int(np.prod(shape))
    if array.size == 1:
        return np.full(shape, array[0])
    if array.size != size:
        many = f"{size}, or one for all of them" if size > 1 else str(size)
        raise InputError(f"{name} = {list(numbers)}: {array.size} numbers, expected {many}")
    return array.reshape(shape)


@cache
def _record(name: str, names: tuple[str, ...]) -> Callable[..., NamedTuple]:
    return namedtuple(name, names)  # type: ignore[return-value]


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(parameter,))
class Parametric(Scene):
    """A scene that is a frozen dataclass, every field of it a `parameter`.

    Documentation, checks and ranges of the fields, their record for the equations and the `repr`
    as Python code follow from the declarations.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]
    immutable = True
    declared: ClassVar[dict[str, _Declared]] = {}
    """Declaration of each parameter, by name."""

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        declarations = {name: x for name, x in vars(cls).items() if isinstance(x, Field)}
        own = {name: x.metadata["declared"] for name, x in declarations.items()}
        cls.declared = cls.declared | own
        if own:
            listed = "\n".join(f"    {name}: {spec.documented}." for name, spec in own.items())
            raised = "Raises:\n    InputError: wrong shape, not finite, or out of its range."
            cls.__doc__ = f"{cleandoc(cls.__doc__ or '')}\n\nArgs:\n{listed}\n\n{raised}"
        dataclass(frozen=True, eq=False, repr=False)(cls)

    def __post_init__(self):
        self.check_fields()

    def __getstate__(self) -> dict[str, Any]:
        return {name: x for name, x in vars(self).items() if name != "_results"}

    def __setstate__(self, state: dict[str, Any]):
        for name, value in state.items():
            if name in self.declared and value is not None:
                value.setflags(write=False)  # the flag is not kept in a copied or unpickled array
            object.__setattr__(self, name, value)

    def check_fields(self, links: int = 0) -> None:
        """Replace all fields by checked, read-only arrays.

        Raises:
            InputError: wrong shape, not finite, or of another sign.
        """
        for name, declared in self.declared.items():
            value = getattr(self, name)
            if value is None and declared.computed_default is not None:
                value = declared.computed_default(self)
            object.__setattr__(self, name, declared.checked(name, value, links))

    @classmethod
    def ranges(cls, links: int | None = None) -> dict[str, Range]:
        """Return the sampling ranges of ordinary scenes of this class, by name of argument."""
        count = number_of_links(links) if cls.has_links else 0
        return {
            name: spec.sample_range._replace(shape=spec.shape_of(count))
            for name, spec in cls.declared.items()
            if spec.sample_range is not None
        }

    def derived(self, arithmetic: Arithmetic) -> dict[str, Any]:
        """Return derived parameters by name, which equations read beside or instead of fields."""
        return {}

    def parameters(self, arithmetic: Arithmetic) -> NamedTuple:
        """Return the inputs of the equations in the numbers of `arithmetic`, one number as (1,)."""
        values = {name: getattr(self, name) for name, spec in self.declared.items() if spec.read}
        numbers = {
            name: None if value is None else arithmetic.numbers(np.atleast_1d(value))
            for name, value in values.items()
        }
        numbers |= self.derived(arithmetic)
        return _record(f"{type(self).__name__}Parameters", tuple(numbers))(**numbers)

    def __repr__(self) -> str:
        """Return Python code that reconstructs the scene, defaults left out."""
        shown = []
        for argument in fields(self):
            value, usual = getattr(self, argument.name), argument.default
            value = value if value is None else value.tolist()
            if value != (np.array(usual).tolist() if isinstance(usual, tuple) else usual):
                shown.append(f"{argument.name}={value!r}")
        return f"{type(self).__name__}({', '.join(shown)})"


class OfLinks(Parametric):
    """A scene with a free number of links N, given by the length of `mass`, its first parameter."""

    has_links = True
    one_mass_each = "one mass each"
    """Expected number of masses, for error messages."""
    mass: Any

    @staticmethod
    def links_of(masses: int) -> int:
        """Return the number of links N of a scene with so many masses."""
        return masses

    def __post_init__(self):
        self.check_fields(self.counted_links())

    def counted_links(self) -> int:
        """Return N before the parameters are checked.

        Raises:
            InputError: no number of links has so many masses.
        """
        try:
            (masses,) = np.shape(self.mass)
        except ValueError:
            masses = 0
        links = self.links_of(masses)
        if links < 1 or self.declared["mass"].shape_of(links) != (masses,):
            raise InputError(f"mass = {self.mass!r}: {self.one_mass_each}")
        return links

    @property
    def links(self) -> int:
        """Number of links N."""
        return self.links_of(self.mass.size)

    @property
    def name(self) -> str:
        """The key with N."""
        return f"{self.key}[{self.links}]"


# ---- Moments of inertia in space -----------------------------------------------------------------


@generic
def diagonal(moments):
    """Return moments of inertia (n_b, 3) about principal axes as matrices (n_b, 3, 3)."""
    principal = [[[x, 0, 0], [0, y, 0], [0, 0, z]] for x, y, z in moments]
    return np.array(principal, moments.dtype)

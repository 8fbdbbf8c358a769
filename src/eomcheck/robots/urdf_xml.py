"""The XML of a robot, read with care: of bounded size, nothing expanded, every number a number."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree
from xml.parsers import expat

from eomcheck.atomic_write import check_regular
from eomcheck.errors import InputError

LARGEST = 20_000_000
"""Bytes that a file may have."""

MOST_ELEMENTS, DEEPEST = 200_000, 60

Element = ElementTree.Element


class Unreadable(InputError):
    """A robot description that is none, or not one that is understood."""


class Format(NamedTuple):
    """What a file should hold."""

    name: str
    roots: tuple[str, ...]
    """Tags that its root may have."""
    deepest: int = DEEPEST
    """Elements inside each other."""


URDF = Format("URDF", ("robot",))


def root_of(path: Path, expected: Format = URDF) -> Element:
    """Return the root of a file, <robot> of a URDF.

    Raises:
        InputError: it is no file, cannot be read, is empty, too large or no XML, declares entities,
            or holds something else.
    """
    check_regular(path)
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST + 1)
    except OSError as error:
        why = error.strerror or type(error).__name__
        raise Unreadable(f"{str(path)!r} cannot be read: {why}") from None
    if len(data) > LARGEST:
        raise Unreadable(f"{str(path)!r} has more than {LARGEST // 10**6} million bytes")
    if not data.strip():
        raise Unreadable(f"{str(path)!r} is empty")
    try:
        _look_through(data, str(path), expected.deepest)
        root = ElementTree.fromstring(data)
    except (expat.ExpatError, ElementTree.ParseError, LookupError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise Unreadable(f"{str(path)!r} is no XML: {error}") from None
    if root.tag not in expected.roots:
        wanted = f"expected <{expected.roots[0]}>: no {expected.name}"
        raise Unreadable(f"{str(path)!r} holds <{root.tag}>, {wanted}")
    return root


def _look_through(data: bytes, name: str, deepest: int) -> None:
    """Refuse what could grow while it is parsed, before it is."""
    parser, count, depth = expat.ParserCreate(), 0, 0

    def declared(*_: object) -> None:
        raise Unreadable(f"{name!r} declares a document type: entities are not expanded here")

    def opened(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count, depth
        count, depth = count + 1, depth + 1
        if count > MOST_ELEMENTS or depth > deepest:
            raise Unreadable(
                f"{name!r} has more than {MOST_ELEMENTS} elements, or more than {deepest} inside "
                "each other"
            )
        if tag.startswith("xacro:") or any("${" in value for value in attributes.values()):
            raise Unreadable(f"{name!r} is a template for xacro: have it expanded first")

    def closed(_: str) -> None:
        nonlocal depth
        depth -= 1

    parser.StartDoctypeDeclHandler = declared
    parser.StartElementHandler, parser.EndElementHandler = opened, closed
    parser.Parse(data, True)


# ---- Attributes ----------------------------------------------------------------------------------


def text(element: Element, name: str, where: str) -> str:
    """Return an attribute that has to be there."""
    value = element.get(name)
    if value is None or not value.strip():
        raise Unreadable(f"{where}: <{element.tag}> has no attribute {name!r}")
    return value.strip()


def number(element: Element, name: str, where: str, default: float | None = None) -> float:
    """Return an attribute as a number."""
    if default is not None and element.get(name) is None:
        return default
    return decimal(text(element, name, where), f"{where}: {name} of <{element.tag}>")


def triple(
    element: Element, name: str, where: str, default: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return an attribute of three numbers."""
    value = element.get(name)
    if value is None:
        return default
    said = f"{where}: {name} of <{element.tag}>"
    parts = value.split()
    if len(parts) != 3:
        raise Unreadable(f"{said} is {value!r}, expected three numbers")
    x, y, z = (decimal(part, said) for part in parts)
    return x, y, z


def decimal(value: str, said: str) -> float:
    """A finite number of its text.

    Raises:
        InputError: it is none.
    """
    try:
        if "_" in value:
            raise ValueError
        found = float(value)
    except ValueError:
        raise Unreadable(f"{said} is {value!r}, expected a number") from None
    if not math.isfinite(found):
        raise Unreadable(f"{said} is {value!r}, expected a finite number")
    return found


def only(element: Element, tag: str, where: str) -> Element | None:
    """Return the one child of this tag, None without any."""
    found = element.findall(tag)
    if len(found) > 1:
        raise Unreadable(f"{where} has {len(found)} of <{tag}>, expected one")
    return found[0] if found else None


def others(element: Element, known: frozenset[str], where: str) -> Iterator[str]:
    """Yield the tags of children that are known to be left out.

    Raises:
        InputError: one is not known at all.
    """
    for child in element:
        if child.tag not in known:
            raise Unreadable(f"{where} holds <{child.tag}>, which is no part of a URDF known here")
        yield child.tag

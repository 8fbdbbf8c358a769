"""Colours of pictures, on light and on dark ground."""

from __future__ import annotations

from typing import NamedTuple


class Colors(NamedTuple):
    """Those of Okabe and Ito, or darker ones of the same hue, so that text stands out."""

    ground: str
    ink: str
    body: str
    faint: str
    coordinate: str
    constraint: str
    axis: str
    spring: str


LIGHT = Colors(
    *("#ffffff", "#1a1a1a", "#333333", "#8a8a8a"), *("#0072B2", "#B34F00"), "#00785A", "#A8527F"
)
DARK = Colors(
    *("#131416", "#f0f0f0", "#d8d8d8", "#8a8a8a"), *("#56B4E9", "#F0A030"), "#3CC9A0", "#E08FBB"
)

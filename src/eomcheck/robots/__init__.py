"""Robots in files: a URDF or an MJCF is a description, and so a scene."""

from __future__ import annotations

from eomcheck.robots.mjcf import from_mjcf
from eomcheck.robots.urdf import from_urdf

__all__ = ["from_mjcf", "from_urdf"]

"""Robots by the names of their files: FILE.urdf, FILE.urdf:floating, FILE.xml or FILE.mjcf."""

from __future__ import annotations

from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.descriptions.mjcf_reader import from_mjcf, mjcf_kind
from eomcheck.descriptions.urdf_reader import FLOATING, from_urdf, urdf_kind
from eomcheck.errors import InputError

__all__ = ["from_mjcf", "from_urdf"]


URDF, MJCF = (".urdf",), (".xml", ".mjcf")


def _parts(name: str) -> tuple[str, str | None]:
    """Return the file and the suffix behind a colon; None without a colon."""
    home, colon, how = name.rpartition(":")
    return (home, how) if colon and home.lower().endswith(URDF + MJCF) else (name, None)


def is_robot(name: str) -> bool:
    """Return whether a name is that of a robot file."""
    return _parts(name)[0].lower().endswith(URDF + MJCF)


def robot_named(name: str) -> type[Mechanism]:
    """Return the scene class of a robot file; ":floating" frees the root of a URDF.

    Raises:
        InputError: see `from_urdf` and `from_mjcf`; or something else stands behind the colon.
        EngineError: MuJoCo, which reads an MJCF, is not installed.
    """
    file, how = _parts(name)
    if file.lower().endswith(MJCF):
        if how is not None:
            raise InputError(f"scene = {name!r}: {file} says itself what is free")
        return mjcf_kind(file)
    if how not in (None, FLOATING):
        raise InputError(f"scene = {name!r}, expected {file} or {file}:{FLOATING}")
    return urdf_kind(file, floating=how is not None)

"""A robot in an MJCF file as a scene: MuJoCo's compiler reads it, the equations are ours.

Defaults, classes, inertias that follow from shapes and the many ways to say an orientation are left
to MuJoCo, which comes with an extra. What it comes to is written in the words of a description:
its equations are as much ours as those of any other.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import qr

from eomcheck.errors import InputError
from eomcheck.mechanics.described.build import described
from eomcheck.mechanics.described.mechanism import Mechanism
from eomcheck.mechanics.described.words import Triple
from eomcheck.numbers.generic import FLOAT64
from eomcheck.robots.mjcf_model import read_mjcf
from eomcheck.robots.urdf import gravity_of
from eomcheck.robots.urdf_xml import Unreadable

FILES: Any = "the file's own"


def from_mjcf(path: str | os.PathLike[str], *, gravity: Triple | str | None = FILES) -> Mechanism:
    """Return the robot in an MJCF file, with the parameters of the file.

    Its coordinates are those of the file's joints, in their order, but for those that constraints
    determine, which come first; a free joint has three slides
    along axes of the ground, then turns about z, y and x, a ball joint such turns. Equalities
    between bodies, sites and joints are constraints that hold exactly. Its `made.left_out` says
    what of the file is left out.

    Args:
        path: the file.
        gravity: acceleration, m/s², or None without; by default that of the file.

    Raises:
        InputError: the file cannot be read, is no MJCF, is refused by MuJoCo, has something that is
            not understood here, or more than 200 coordinates.
        EngineError: MuJoCo is not installed.
    """
    return mjcf_kind(path, gravity=gravity)()


def mjcf_kind(
    path: str | os.PathLike[str], *, gravity: Triple | str | None = FILES
) -> type[Mechanism]:
    """Return the kind of scene of which `from_mjcf` returns the one with the file's parameters."""
    try:
        file = Path(path)
    except TypeError:
        raise InputError(f"path = {path!r}, expected the path of an MJCF file") from None
    changed = not isinstance(gravity, str)
    pulls = gravity_of(gravity) if changed else None
    model = read_mjcf(file)
    try:
        words = model.name, model.links, model.joints, model.constraints
        more = {"gravity": pulls if changed else model.gravity, "pose": model.pose}
        made = described(*words, **more)
        if model.constraints:
            made = described(*words, **more, first=_determined(made.kind()()))
        return made._replace(
            code=f"from_mjcf({str(path)!r}{f', gravity={pulls!r}' if changed else ''})",
            imported="from eomcheck.scenes import from_mjcf",
            left_out=model.left_out,
            source=str(file),
            format="mjcf",
        ).kind()
    except Unreadable:
        raise
    except InputError as error:
        raise Unreadable(f"{str(path)!r}: {error}") from None


def _determined(scene: Mechanism) -> list[str]:
    """Return names of as many coordinates as there are constraints, which these determine."""
    q = scene.initial_state()[0]
    # Beside the pose, which may be a singular one: many are drawn stretched.
    q = q + 0.1 * np.sin(1.0 + np.arange(scene.n))
    given = scene.parameters(FLOAT64)
    a, _ = scene.constraints(given, scene.prepare(FLOAT64, given, q, 0.0), q)
    found: Any = qr(a, mode="r", pivoting=True)
    order = found[-1]
    return [scene.coordinate_names[i] for i in order[: scene.r]]

"""A robot in a URDF file as a scene.

The reader is our own, on the XML parser of the standard library: what other libraries make of the
same file is something to compare with. What a file holds beside rigid bodies and ideal joints is
left out, and said in one sentence; what is not understood is refused.
"""

from __future__ import annotations

import os
from pathlib import Path

from eomcheck.errors import InputError
from eomcheck.mechanics.described.bodies import doubtful
from eomcheck.mechanics.described.build import described
from eomcheck.mechanics.described.mechanism import Mechanism
from eomcheck.mechanics.described.words import Joint, Link, Triple
from eomcheck.mechanics.scene import finite_array
from eomcheck.robots.urdf_robot import Robot, read_urdf
from eomcheck.robots.urdf_xml import Unreadable

FLOATING = "floating"


def from_urdf(
    path: str | os.PathLike[str],
    *,
    floating: bool = False,
    gravity: Triple | None = (0.0, 0.0, -9.81),
) -> Mechanism:
    """Return the robot in a URDF file, with the parameters of the file.

    Its coordinates are those of the file's joints, in their order; fixed joints have none, nor have
    joints that mimic others. Its `made.left_out` says what of the file is left out, `made.doubtful`
    which of its numbers no body has: they are taken as they are.

    Args:
        path: the file.
        floating: whether its root is free to move: three slides, then turns about z, y and x, come
            first. Otherwise the root is fixed to the ground.
        gravity: acceleration, m/s², or None without.

    Raises:
        InputError: the file cannot be read, is no URDF, contradicts itself, has more than
            200 coordinates, or a joint that moves nothing.
    """
    return urdf_kind(path, floating=floating, gravity=gravity)()


def urdf_kind(
    path: str | os.PathLike[str],
    *,
    floating: bool = False,
    gravity: Triple | None = (0.0, 0.0, -9.81),
) -> type[Mechanism]:
    """Return the kind of scene of which `from_urdf` returns the one with the file's parameters."""
    try:
        file = Path(path)
    except TypeError:
        raise InputError(f"path = {path!r}, expected the path of a URDF file") from None
    gravity = gravity_of(gravity)
    robot = read_urdf(file)
    if not (robot.joints or floating):
        name = str(path)
        raise Unreadable(f"{name!r} has no joint; {f'{name}:{FLOATING}'!r} sets its link free")
    options = (", floating=True" if floating else "") + (
        "" if gravity == (0.0, 0.0, -9.81) else f", gravity={gravity!r}"
    )
    links, joints = _floating(robot) if floating else (robot.links, robot.joints)
    name = f"{robot.name}_{FLOATING}" if floating else robot.name
    try:
        made = described(name, links, joints, gravity=gravity)
        return made._replace(
            code=f"from_urdf({str(path)!r}{options})",
            imported="from eomcheck.scenes import from_urdf",
            left_out=robot.left_out,
            doubtful=doubtful(robot.links),
            source=str(file),
            format="urdf",
            floating=joints[0].name if floating else "",
        ).kind()
    except Unreadable:
        raise
    except InputError as error:
        raise Unreadable(f"{str(path)!r}: {error}") from None


def gravity_of(given: Triple | None) -> Triple | None:
    """Return gravity as three numbers, or None.

    Raises:
        InputError: it is something else.
    """
    if given is None:
        return None
    x, y, z = finite_array("gravity", given, (3,)).tolist()
    return x, y, z


def _floating(robot: Robot) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Return links and joints with the root on a floating joint of its name, which comes first."""
    children = {joint.child for joint in robot.joints}
    roots = [link.name for link in robot.links if link.name not in children]
    if len(roots) != 1:
        return robot.links, robot.joints  # which is refused there
    ground = "the ground"
    joint = Joint(roots[0], "floating", ground, roots[0])
    return (Link(ground), *robot.links), (joint, *robot.joints)

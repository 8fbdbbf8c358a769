"""Scenes by name: from the registry, an installed package, a robot description or a user's file.

The values of `--scene` are interpreted here and in `eomcheck.class_lookup`, and nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from eomcheck.class_lookup import LookupKind, class_named
from eomcheck.descriptions.random_mechanisms import RANDOM
from eomcheck.descriptions.robot_files import is_robot, robot_named
from eomcheck.descriptions.urdf_reader import FLOATING
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.mechanics.parameters import with_parameters
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES
from eomcheck.scenes.snake import Snake

ALL = "all"

SCENE: LookupKind[Scene] = LookupKind("scene", Scene, {**SCENES, **RANDOM})

ROBOT_LINKS = 7

ROBOTS: dict[str, Callable[[int | None], Snake]] = {
    "paper": lambda links: _paper(links),
    "coil": lambda links: Snake.coil(ROBOT_LINKS if links is None else links),
    "pattern": lambda links: Snake.pattern(ROBOT_LINKS if links is None else links),
}
"""Names of single snakes, which stand for no kind -> the snake with so many links."""


def _paper(links: int | None) -> Snake:
    if links is not None:
        raise InputError(f"links = {links}: the robot of the paper has {ROBOT_LINKS}; coil has any")
    return Snake.paper()


def robot_file_warnings(kinds: Iterable[type[Scene]]) -> Iterator[str]:
    """Yield, a sentence each, what is left out of files of robots, and what in them is doubtful."""
    for kind in kinds:
        made = getattr(kind, "source", None)
        if made is not None:
            yield from (f"{made.file}: {x}" for x in (made.ignored, made.warnings) if x)


def scene_classes_named(name: str) -> tuple[type[Scene], ...]:
    """Return the kinds of scenes that `name` stands for.

    Args:
        name: "all" of the registry, a robot's file.urdf, file.urdf:floating with its root free,
            file.xml or file.mjcf, or a name as `eomcheck.class_lookup.class_named` understands it.

    Those of `RANDOM` hang together in another way with every draw, and are not among all.

    Raises:
        UnknownNameError: there is no such key.
        InputError: no such file, no such scene in it, or a robot that `from_urdf` refuses; or one
            snake instead of a kind.
    """
    if name in ROBOTS:
        raise InputError(f"scene = {name!r} is a single snake, expected a kind such as 'snake'")
    return tuple(SCENES.values()) if name == ALL else (_looked_up(name),)


def _looked_up(name: str) -> type[Scene]:
    """Return the kind of scene that a name stands for, whatever it is the name of."""
    if is_robot(name):
        return robot_named(name)
    if name.endswith(f":{FLOATING}"):
        raise InputError(f"scene = {name!r}: only the root of a robot in a .urdf can be set free")
    return class_named(SCENE, name)


def scene_class_named(name: str) -> type[Scene]:
    """Return the kind of the one scene that `name` stands for.

    Raises:
        UnknownNameError: there is no such key.
        InputError: there is none, or it is more than one.
    """
    if name in ROBOTS:
        return Snake
    if name == ALL:
        raise InputError(f"scene = {name!r}: expected one scene")
    try:
        return _looked_up(name)
    except UnknownNameError as error:
        raise UnknownNameError("scene", name, (*error.known, *ROBOTS)) from None


def scene_named(
    name: str, links: int | None = None, given: Mapping[str, Sequence[float] | None] | None = None
) -> Scene:
    """Return the one scene that `name` stands for: of a kind, the scene that is looked at first.

    Args:
        name: as `scene_classes_named` understands it, or that of a single snake.
        links: number of links, for kinds that have one.
        given: parameters that are other than usual, see `with_parameters`.

    Raises:
        UnknownNameError: no such scene, or it has no such parameter.
        InputError: see `scene_class_named`; it has no such number of links, or it refuses a
            parameter.
    """
    kind = scene_class_named(name)
    if name in ROBOTS:
        scene: Scene = ROBOTS[name](links)
    else:
        scene = kind.example() if links is None else next(kind.structures(links))
    return with_parameters(scene, given or {})

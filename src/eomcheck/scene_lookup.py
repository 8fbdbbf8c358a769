"""Lookup of scenes by name: registry, installed package, robot description or user's file.

The values of `--scene` are interpreted here and in `eomcheck.class_lookup`, and nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from eomcheck.class_lookup import LookupKind, class_named
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.descriptions.mjcf_reader import mjcf_kind
from eomcheck.descriptions.random_mechanisms import RANDOM
from eomcheck.descriptions.sdf_reader import sdf_kind
from eomcheck.descriptions.urdf_reader import FLOATING, urdf_kind
from eomcheck.errors import InputError, UnknownNameError, distinct
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
"""Single snakes, which are no scene classes: name -> function of the number of links."""


def _paper(links: int | None) -> Snake:
    if links is not None:
        raise InputError(f"links = {links}: the robot of the paper has {ROBOT_LINKS}; coil has any")
    return Snake.paper()


URDF, MJCF, SDF = (".urdf",), (".xml", ".mjcf"), (".sdf",)
"""Ends of the names of robot files."""

ROBOT_FILES = URDF + MJCF + SDF


def _file_and_suffix(name: str) -> tuple[str, str | None]:
    """Return the file and the suffix behind a colon; None without a colon."""
    file, colon, suffix = name.rpartition(":")
    if colon and file.rpartition(":")[0].lower().endswith(SDF):  # a model and "floating"
        file, _, model = file.rpartition(":")
        suffix = f"{model}:{suffix}"
    return (file, suffix) if colon and file.lower().endswith(ROBOT_FILES) else (name, None)


def is_robot(name: str) -> bool:
    """Return whether a name is that of a robot file."""
    return _file_and_suffix(name)[0].lower().endswith(ROBOT_FILES)


def robot_named(name: str) -> type[Mechanism]:
    """Return the scene class of a robot file; ":floating" frees the root of a URDF or SDF.

    Of an SDF with several models ":MODEL" is one of them, and ":MODEL:floating" frees its root.

    Raises:
        InputError: see `from_urdf`, `from_mjcf` and `from_sdf`; or something else stands behind the
            colon.
        EngineError: MuJoCo, which reads an MJCF, is not installed.
    """
    file, suffix = _file_and_suffix(name)
    if file.lower().endswith(SDF):
        model, colon, free = (suffix or "").rpartition(":")
        floating = free == FLOATING
        if colon and not floating:
            raise InputError(f"scene = {name!r}, expected {file}:{model} or {file}:{FLOATING}")
        model = model if floating else free
        return sdf_kind(file, model=model or None, floating=floating)
    if file.lower().endswith(MJCF):
        if suffix is not None:
            raise InputError(f"scene = {name!r}: {file} says itself what is free")
        return mjcf_kind(file)
    if suffix not in (None, FLOATING):
        raise InputError(f"scene = {name!r}, expected {file} or {file}:{FLOATING}")
    return urdf_kind(file, floating=suffix is not None)


def robot_file_warnings(kinds: Iterable[type[Scene]]) -> Iterator[str]:
    """Yield one sentence each on ignored elements of robot files, and on doubtful ones."""
    for kind in kinds:
        source = getattr(kind, "source", None)
        if source is not None:
            yield from (f"{source.file}: {x}" for x in (source.ignored, source.warnings) if x)


def scene_classes_named(name: str) -> tuple[type[Scene], ...]:
    """Return the scene classes of a name, or of several with commas between them.

    Args:
        name: "all" of the registry, a robot's file.urdf, file.urdf:floating with its root free,
            file.xml, file.mjcf, file.sdf or file.sdf:MODEL, or a name as in
            `eomcheck.class_lookup.class_named`.

    Classes of `RANDOM`, whose topology changes with every draw, are not included in "all".

    Raises:
        UnknownNameError: there is no such key.
        InputError: no such file, no such scene in it, or a robot that `from_urdf` rejects; or a
            single snake instead of a scene class.
    """
    if "," in name and not Path(_file_and_suffix(name)[0]).is_file():
        names = (one.strip() for one in name.split(","))
        return distinct("scene", [kind for one in names for kind in scene_classes_named(one)])
    if name in ROBOTS:
        raise InputError(f"scene = {name!r} is a single snake, expected a kind such as 'snake'")
    return tuple(SCENES.values()) if name == ALL else (_looked_up(name),)


def _looked_up(name: str) -> type[Scene]:
    """Return the scene class of a robot file, registry key, entry point or user's file."""
    if is_robot(name):
        return robot_named(name)
    if name.endswith(f":{FLOATING}"):
        files = "only the root of a robot in a .urdf or .sdf can be set free"
        raise InputError(f"scene = {name!r}: {files}")
    return class_named(SCENE, name)


def scene_class_named(name: str) -> type[Scene]:
    """Return the class of the scene that `scene_named` returns.

    Raises:
        UnknownNameError: there is no such key.
        InputError: no such scene, or "all".
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
    """Return a single scene by name: of a scene class, the example that is checked first.

    Args:
        name: name of a scene class as for `scene_classes_named`, or of a single snake.
        links: number of links, for scene classes that have one.
        given: parameters that differ from the example's, see `with_parameters`.

    Raises:
        UnknownNameError: no such scene, or it has no such parameter.
        InputError: see `scene_class_named`; it has no such number of links, or it rejects a
            parameter.
    """
    kind = scene_class_named(name)
    if name in ROBOTS:
        scene: Scene = ROBOTS[name](links)
    else:
        scene = kind.example() if links is None else next(kind.structures(links))
    return with_parameters(scene, given or {})


def lookup_name(kind: type[Scene], asked: str) -> str:
    """Return the name by which a scene class is looked up again: its key, or else `asked`."""
    return kind.key if SCENES.get(kind.key) is kind else asked

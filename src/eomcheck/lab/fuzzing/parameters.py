"""What makes a scene again, as plain data: its numbers, or the description of a random one."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from eomcheck.class_lookup import value_of
from eomcheck.descriptions.elements import Constraint, Joint, Link
from eomcheck.descriptions.random_elements import Description
from eomcheck.descriptions.random_mechanisms import Random
from eomcheck.descriptions.robot_files import is_robot
from eomcheck.errors import InputError, message_of
from eomcheck.lab.fuzzing.families import Case
from eomcheck.mechanics.parameters import settable
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import finite_array
from eomcheck.testing.equations_of_motion import Functions


def plain_random(scene: Random) -> dict[str, Any]:
    """Return the description of a random scene as lists, and the parameters that were changed."""
    usual: Any = type(scene)()
    found: dict[str, Any] = {"description": _listed(scene.made.description)}
    for name in settable(scene):
        x, y = getattr(scene, name), getattr(usual, name)
        if (x is None) != (y is None) or (x is not None and not np.array_equal(x, y)):
            found[name] = None if x is None else np.asarray(x).tolist()
    return found


def random_of(kind: type[Random], plain: dict[str, Any]) -> Random:
    """Return the scene that `plain_random` wrote down.

    Raises:
        InputError: it is no description.
    """
    given = dict(plain)
    try:
        links, joints, constraints, gravity, first, pose = _tupled(given.pop("description"))
        description = Description(
            tuple(Link(*one) for one in links),
            tuple(Joint(*one) for one in joints),
            tuple(Constraint(*one) for one in constraints),
            *(gravity, first, pose),
        )
    except (TypeError, ValueError, KeyError) as error:
        raise InputError(f"no description of a random scene: {error}") from None
    scene = kind.described_so(description)()
    return scene.changed(**given) if given else scene


def _listed(x: Any) -> Any:
    if isinstance(x, tuple | list):
        return [_listed(one) for one in x]
    return x.item() if isinstance(x, np.generic) else x


def _tupled(x: Any) -> Any:
    return tuple(_tupled(one) for one in x) if isinstance(x, list) else x


def case_of(
    kind: Any, parameters: dict[str, Any], q: Sequence[float], v: Sequence[float], t: float
) -> Case:
    """Return the scene that `parameters_of` is of, or functions, in a state.

    Raises:
        InputError: the scene has no such parameters or refuses them, or it has no such state.
    """
    if isinstance(kind, Functions):
        scene: Any = kind
        return scene, State(finite_array("q", q, (kind.n,)), finite_array("v", v, (kind.p,)), t)
    if issubclass(kind, Random):
        scene = random_of(kind, parameters)
    else:
        try:
            scene = kind(**parameters)
        except TypeError as error:  # another name, or one too few
            raise InputError(
                f"{kind.key} of {', '.join(parameters)}: {message_of(error)}"
            ) from None
    position, velocity = scene.check_state(q, v, t)
    return scene, State(position, velocity, t)


@lru_cache(16)
def functions_named(name: str) -> Functions | None:
    """Return the `eomcheck.testing.Functions` that a name stands for, None if it is a scene's.

    Args:
        name: path/to/file.py:NAME or package.module:NAME.

    Raises:
        InputError: no such file or module, or it cannot be run.
    """
    found = None if is_robot(name) else value_of(name)
    return found if isinstance(found, Functions) else None


def parameters_of(scene: Any) -> dict[str, Any]:
    """Return what makes a scene again, plain; functions need nothing.

    Of a random one that is its description, and what of it was changed.
    """
    if isinstance(scene, Random):
        return plain_random(scene)
    return {} if isinstance(scene, Functions) else numbers_of(scene)


def numbers_of(scene: Any) -> dict[str, Any]:
    """Return the arguments of a scene that are drawn, by name, plain; functions have none."""
    if isinstance(scene, Functions):
        return {}
    links = getattr(scene, "links", None) if scene.has_links else None
    values = {name: getattr(scene, name) for name in type(scene).ranges(links)}
    return {name: None if x is None else np.asarray(x).tolist() for name, x in values.items()}

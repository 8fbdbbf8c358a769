"""A scene with some of its constraints: the independent ones, selected by name.

Formulations that cannot handle redundant constraints get such a scene. It has a class of its
own, whose functions are those of the scene without the other rows.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np

from eomcheck.errors import InputError, distinct, registered
from eomcheck.mechanics.records import Terms
from eomcheck.mechanics.scene import Scene, checked_scene
from eomcheck.numbers.generic import Array, generic


def with_constraints(scene: Scene, names: Iterable[str]) -> Scene:
    """Return `scene` with a subset of its constraints.

    The others are neither checked nor enforced: the selected ones have to imply them, see
    `eomcheck.independent_constraints`.

    Args:
        scene: the scene.
        names: names of constraints, among `scene.constraint_names`.

    Returns:
        A scene with these rows, the holonomic ones first; `scene` itself if they are all.

    Raises:
        InputError: `names` is no list of names, no constraint is left, or the scene has generalized
            speeds of its own, which are constructed for all of its constraints.
        UnknownNameError: it has no such constraint.
    """
    index = {name: i for i, name in enumerate(checked_scene(scene).constraint_names)}
    rows = sorted(registered("constraint", name, index) for name in distinct("constraints", names))
    if not rows:
        raise InputError("constraints = (), expected the names of some")
    if len(rows) == scene.r:
        return scene
    if scene.natural_speeds:
        raise InputError(
            f"{scene.name} writes generalized speeds of its own, for all of its constraints: none "
            "can be left out"
        )
    closed = range(scene.r)[scene.holonomic] if scene.position_residual else ()
    # Holonomic rows come first, so that they are a slice again.
    order = tuple(sorted(rows, key=lambda i: i not in closed))
    subset = object.__new__(_scene_class_with_rows(type(scene), order, scene.r))
    vars(subset).update(vars(scene))
    return subset


def _restored(kind: type[Scene], rows: tuple[int, ...], total: int, state: dict[str, Any]) -> Scene:
    """Return an unpickled scene with these rows of its class `kind`."""
    scene: Any = object.__new__(_scene_class_with_rows(kind, rows, total))
    if hasattr(scene, "__setstate__"):
        scene.__setstate__(state)
    else:
        vars(scene).update(state)
    return scene


@cache
def _scene_class_with_rows(kind: Any, rows: tuple[int, ...], total: int) -> type[Scene]:
    """Return the scene class with these rows (k,) of `total`, the holonomic ones first."""
    closed = list(range(total)[kind.holonomic]) if kind.position_residual else []
    count = sum(i in closed for i in rows)
    indices = tuple(closed.index(i) for i in rows[:count])
    all_constraints, all_drift, every = kind.constraints, kind.drift, kind.constraint
    all_closed, all_terms = kind.position_residual, kind.terms

    def terms(parameters, prepared, q, v):
        M, Q, B, a, gamma, b = all_terms(parameters, prepared, q, v)
        return Terms(
            M, Q, B, selected_rows(a, rows), selected_rows(gamma, rows), selected_rows(b, rows)
        )

    def constraints(parameters, prepared, q):
        a, b = all_constraints(parameters, prepared, q)
        return selected_rows(a, rows), selected_rows(b, rows)

    def drift(parameters, prepared, q, v):
        return selected_rows(all_drift(parameters, prepared, q, v), rows)

    def constraint(parameters, prepared, q, v):
        return selected_rows(every(parameters, prepared, q, v), rows)

    def position_residual(parameters, prepared, q):
        return selected_rows(all_closed(parameters, prepared, q), indices)

    selecting = {"constraints": constraints, "drift": drift, "constraint": constraint}
    if "terms" not in kind.derived_functions:
        selecting["terms"] = terms
    if count:
        selecting["position_residual"] = position_residual
    functions: dict[str, Any] = {"position_residual": None}
    for name, function in selecting.items():
        function.__module__, function.__qualname__ = kind.__module__, f"{kind.__name__}.{name}"
        functions[name] = staticmethod(generic(function))

    def constraint_names(self) -> tuple[str, ...]:
        """Names of the remaining constraints.

        Raises:
            InputError: a change of the scene has changed the number of its constraints.
        """
        names = super(subset, self).constraint_names
        if len(names) != total:
            raise InputError(
                f"the scene has {len(names)} constraints, those left were chosen of {total}"
            )
        return tuple(names[i] for i in rows)

    def structure(self) -> str:
        """The structural variant of the scene, with the names of the constraints left out."""
        whole = super(subset, self)
        out = [name for i, name in enumerate(whole.constraint_names) if i not in rows]
        return f"{whole.structure}, without the constraint of {', '.join(out)}"

    def sketch(self, q: Array, t: float = 0.0) -> None:
        """Return None: pictures are of all constraints."""

    def represented(self) -> str:
        """Return Python code that reconstructs the scene."""
        return (
            f"eomcheck.with_constraints({super(subset, self).__repr__()}, {self.constraint_names})"
        )

    def reduce(self):
        return _restored, (kind, rows, total, self.__getstate__() or {})

    body = {
        "holonomic": slice(0, count),
        "constraint_names": property(constraint_names),
        "structure": property(structure),
        "sketch": sketch,
        "__repr__": represented,
        "__reduce__": reduce,
        "__module__": kind.__module__,
        "__doc__": kind.__doc__,
    }
    subset: Any = type(kind)(kind.__name__, (kind,), functions | body)
    return subset


@generic
def selected_rows(x, rows):
    """Return these rows (k,) of x; None if x is."""
    if x is None:
        return None
    return x[np.array(rows)]

"""The formulations: one file each, registered in `FORMULATIONS`, one line each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from eomcheck.errors import InputError, distinct, registered
from eomcheck.formulations import au, banded, el, em, gw, im, kane, ml, uk
from eomcheck.formulations.formulation import Formulation, Partition
from eomcheck.mechanics.scene import Scene

FORMULATIONS: dict[str, Formulation] = {
    formulation.key: formulation
    for formulation in (
        im.IM,
        au.AU,
        el.EL,
        gw.GW,
        em.EM,
        ml.ML,
        kane.KANE,
        banded.BANDED,
        uk.UK,
    )
}
"""Key -> formulation: those of the paper in the order of its Table I, then the others."""


def formulation_of(key: str) -> Formulation:
    """Return the formulation called `key`.

    Raises:
        UnknownNameError: there is none.
    """
    return registered("formulation", key, FORMULATIONS)


def applicable(scene: Scene | type[Scene]) -> dict[str, Formulation]:
    """Return the formulations that apply to `scene`, by key."""
    return {key: f for key, f in FORMULATIONS.items() if f.applies_to(scene)}


def formulations_for(
    scene: Scene | type[Scene], keys: Iterable[str] | None = None
) -> tuple[Formulation, ...]:
    """Return the formulations called `keys`, each once; by default all that apply to `scene`.

    Raises:
        InputError: one of them does not apply, or they are no list of names.
        UnknownNameError: there is no such formulation.
    """
    return formulations_among((scene,), keys)


def formulations_among(
    scenes: Sequence[Scene | type[Scene]], keys: Iterable[str] | None = None
) -> tuple[Formulation, ...]:
    """Return the formulations called `keys`, each once; by default all that apply to any scene.

    Raises:
        InputError: one of them applies to none of `scenes`.
        UnknownNameError: there is no such formulation.
    """
    if keys is None:
        return tuple(f for f in FORMULATIONS.values() if _apply(f, scenes))
    named = map(formulation_of, distinct("formulations", keys))
    return tuple(f if _apply(f, scenes) else formulation_for(scenes[0], f.key) for f in named)


def _apply(formulation: Formulation, scenes: Sequence[Scene | type[Scene]]) -> bool:
    """Return whether a formulation applies to any of the scenes."""
    return any(scene.offers(formulation.uses) for scene in scenes)


def formulation_for(scene: Scene | type[Scene], key: str) -> Formulation:
    """Return the formulation called `key`.

    Raises:
        InputError: it does not apply to `scene`.
        UnknownNameError: there is none.
    """
    formulation = formulation_of(key)
    if not formulation.applies_to(scene):
        raise InputError(
            f"{key} does not apply to the scene {scene.key}, which gives no {formulation.uses}; "
            f"those that apply: {', '.join(applicable(scene))}"
        )
    return formulation


__all__ = [
    "FORMULATIONS",
    "Formulation",
    "Partition",
    "applicable",
    "formulation_for",
    "formulation_of",
    "formulations_among",
    "formulations_for",
]

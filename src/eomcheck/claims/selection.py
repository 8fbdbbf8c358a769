"""What takes part in a run: formulations, engines made for a scene, and claims."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from eomcheck.claims import CLAIMS, Case, State
from eomcheck.claims.case import OFTEN
from eomcheck.claims.shapes import check_shapes
from eomcheck.engines import Engine, EngineFault, engines_among, made, represents
from eomcheck.engines.files import FileEngine, default_reader
from eomcheck.errors import message_of, named, some
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import Formulation, formulations_among
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import Snake


@dataclass(frozen=True)
class Selection:
    """What takes part in a run: all that is installed in any case, unless named."""

    formulations: tuple[Formulation, ...]
    engines: tuple[type[Engine], ...]
    claims: tuple[str, ...]
    reader: type[FileEngine] | None = None
    """The library among `engines` that reads a robot's file itself, where none were named."""
    named: bool = False
    """Whether engines were named: they are asked at states beyond the ordinary ones too."""

    @classmethod
    def of(
        cls,
        formulations: Iterable[str] | None = None,
        engines: Iterable[str | type[Engine]] | None = None,
        claims: Iterable[str] | None = None,
        *,
        scenes: Sequence[Scene | type[Scene]] = (Snake,),
    ) -> Selection:
        """Look the names up; None stands for all that apply to any scene, an empty list for none.

        Engines that an extra installs take part when named; without names the library of a robot's
        file does too, for which both derivations are made of one description.

        Raises:
            InputError: a formulation applies to none of `scenes`, or `claims` names none.
            UnknownNameError: a name is not registered.
        """
        ids = tuple(CLAIMS if claims is None else some("claims", claims))
        for one in ids:
            named("claim", one, CLAIMS)
        chosen, reader = engines_among(engines), None
        if engines is None and len(scenes) == 1 and (reader := default_reader(scenes[0])):
            chosen = (*chosen, reader)
        named_ones = engines is not None and bool(chosen)
        return cls(formulations_among(scenes, formulations), chosen, ids, reader, named_ones)


class Asked(NamedTuple):
    """A scene, the engines made for it, and those that could not be made."""

    scene: Scene
    engines: tuple[Engine, ...]
    broken: dict[type[Engine], str]
    reader: FileEngine | None = None
    """The one among them that reads the file of the scene because none were named."""
    unread: tuple[type[FileEngine], str] | None = None
    """The library that should and cannot, and why."""


def asked_of(scene: Scene, selection: Selection) -> Asked:
    """Return a scene with the engines of `selection` made for it.

    Raises:
        InputError: a function of the scene returns an array of wrong shape.
    """
    check_shapes(scene)
    engines: list[Engine] = []
    broken: dict[type[Engine], str] = {}
    for kind in selection.engines:
        if kind is not selection.reader and represents(kind, scene):
            try:
                engines.append(made(kind, scene))
            except EngineFault as fault:
                broken[kind] = fault.what
    reader = unread = None
    if selection.reader is not None and getattr(scene, "as_described", False):
        try:
            reader = selection.reader(scene)
            engines.append(reader)
        except Exception as error:  # whatever a library makes of a file it cannot read
            unread = selection.reader, message_of(error)
    return Asked(scene, tuple(engines), broken, reader, unread)


def case_of(asked: Asked, state: State, selection: Selection, asked_again: int = OFTEN) -> Case:
    """Case of a state, for the claims about a scene whose engines are made.

    Args:
        asked: the scene and its engines.
        state: (q, v, t).
        selection: what takes part.
        asked_again: how often engines on trial are asked again for each answer.
    """
    formulations = tuple(f for f in selection.formulations if f.applies_to(asked.scene))
    evaluation = Evaluation(asked.scene, *state)
    return Case(
        evaluation, formulations, asked.engines, broken=asked.broken, asked_again=asked_again
    )


def case_at(scene: Scene, state: State, selection: Selection) -> Case:
    """Return what claims look at in a state; engines are made for it."""
    return case_of(asked_of(scene, selection), state, selection)

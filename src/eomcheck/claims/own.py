"""Functions of a scene of somebody's own: whether they run on doubles, and on other numbers."""

from __future__ import annotations

import random

import numpy as np

from eomcheck.claims.blame import raised_in
from eomcheck.claims.point import Point
from eomcheck.claims.shapes import compare_shapes, returned
from eomcheck.errors import InputError, RefusedError, message_of
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.finite_field import DomainError, FiniteField, random_prime

_known: dict[tuple[type[Scene], str], str] = {}


def broken_on_doubles(scene: Scene, state: State) -> str:
    """Which function of the scene raises on doubles or returns another shape there; or ""."""
    try:
        compare_shapes(scene, Evaluation(scene, *state))
    except Exception as error:
        misshapen = message_of(error) if isinstance(error, InputError) else ""
        return raised_in(scene, error) or misshapen
    return ""


def not_rational(scene: Scene) -> str:
    """Return why a function of the scene does not run on exact numbers, "" where all do.

    It is asked once for each structure. Where one does not, digits could be lost on the way through
    balls as well, in a float of its own, and what is enclosed would not be true.
    """
    which = type(scene), scene.structure
    if which not in _known:
        source = random.Random(0)
        try:
            _run_all(Point(scene, FiniteField(random_prime(source), source)))
            _known[which] = ""
        except (TypeError, DomainError) as error:
            _known[which] = f"not rational: {message_of(error)}"
        except (RefusedError, ZeroDivisionError):
            _known[which] = ""  # defined nowhere near, which `prove` is to tell
        except Exception as error:
            if not (said := raised_in(scene, error)):
                raise
            _known[which] = f"not rational: {said}"
    return _known[which]


def _run_all(at: Quantities) -> None:
    with np.errstate(all="ignore"):
        for _ in returned(at.scene, at):
            pass

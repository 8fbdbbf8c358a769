"""Failures with rounder numbers: each is tried at 0, at 1 and with fewer digits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from eomcheck.claims import Finding
from eomcheck.errors import EomcheckError
from eomcheck.evaluation.dynamics import consistent_velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab.fuzzing.families import Case
from eomcheck.lab.fuzzing.parameters import numbers_of
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

MOST_TRIES = 150
"""States looked at while numbers are made round."""

F = TypeVar("F", bound=Finding)


def rounded(finding: F, look: Callable[[Case], Sequence[F]], most: int = MOST_TRIES) -> F:
    """Return a failure about the same subject, with rounder numbers.

    Args:
        finding: the failure.
        look: returns the failures of its claim at another case.
        most: other cases that are looked at, at most.
    """
    tries = 0
    for digits in (0, 1, 2, 4, 8):
        for part in _parts(finding):
            for i in range(part.size):
                scene, state = finding.scene, finding.state
                assert state is not None
                here = _parts(finding)
                same = next(one for one in here if one.name == part.name)
                x = float(same.values[i])
                for y in _rounder(x, digits):
                    if y == x or tries >= most:
                        continue
                    tries += 1
                    finding = _tried(finding, same, i, y, look) or finding
                    if finding.scene is not scene or finding.state is not state:
                        break
    return finding


def _rounder(x: float, digits: int) -> list[float]:
    return [0.0, 1.0] if digits == 0 else [float(f"{x:.{digits - 1}e}")]


@dataclass
class _Part:
    name: str
    values: Array

    @property
    def size(self) -> int:
        return self.values.size


def _parts(finding: Finding) -> list[_Part]:
    scene, state = finding.scene, finding.state
    assert state is not None
    found = [_Part(name, np.ravel(x)) for name, x in numbers_of(scene).items() if x is not None]
    return [*found, _Part("q", state.q), _Part("v", state.v)]


def _tried(
    finding: F, part: _Part, i: int, y: float, look: Callable[[Case], Sequence[F]]
) -> F | None:
    """Return the failure with one number replaced, None where it does not fail there."""
    scene, state = finding.scene, finding.state
    assert state is not None
    values = part.values.copy()
    values[i] = y
    try:
        if part.name in ("q", "v"):
            state = state._replace(**{part.name: values})
        else:
            given = numbers_of(scene)
            given[part.name] = values.reshape(np.shape(given[part.name])).tolist()
            scene = type(scene)(**given)
        if isinstance(scene, Scene):
            with np.errstate(all="ignore"):
                at = Evaluation(scene, *state)
                state = state._replace(v=consistent_velocity(at, state.v))
        found = look((scene, state))
    except (EomcheckError, np.linalg.LinAlgError):
        return None
    return next((one for one in found if one.subject == finding.subject), None)

"""What pictures of scenes show: a pose, a motion, a state whose matrices are drawn."""

from __future__ import annotations

import numpy as np
from scipy.linalg import null_space

from eomcheck.errors import InputError
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.dynamics import closed_position, consistent_velocity
from eomcheck.formulations import Formulation
from eomcheck.mechanics.scene import Scene
from eomcheck.mechanics.sketch import Sketch
from eomcheck.scenes.named import kinds_of

BETWEEN = 6
"""Points of a path from one frame to the next."""


def kind_to_draw(name: str) -> type[Scene]:
    """Return the kind of scene that is called `name`.

    Raises:
        UnknownNameError, InputError: there is none, or it is more than one.
    """
    kinds = kinds_of(name)
    if len(kinds) != 1:
        raise InputError(f"scene = {name!r}: a picture shows one scene")
    return kinds[0]


def sketch_of(scene: Scene, q: np.ndarray, t: float = 0.0) -> Sketch:
    """Return what a picture of `scene` in the pose q (n,) is made of.

    Raises:
        InputError: the scene does not say.
    """
    sketch = scene.sketch(q, t)
    if sketch is None:
        raise InputError(f"{scene.name} does not say what it looks like: it has no `sketch`")
    return sketch


def _sketched(kind: type[Scene], links: int | None) -> tuple[Scene, np.ndarray]:
    if links is not None:
        next(kind.structures(links))  # refuses a number of links that there cannot be
    return kind.sketched(links)


def posed(kind: type[Scene], links: int | None = None) -> tuple[Sketch, tuple[str, ...]]:
    """Return the sketch of a kind of scene and the names of its coordinates.

    The pose is the closed one next to that which it wants.

    Raises:
        InputError: it has no such number of links, or does not say what it looks like.
        RefusedError: there is no such pose.
    """
    scene, q = _sketched(kind, links)
    return sketch_of(scene, closed_position(scene, q)), scene.coordinate_names


def sketches_of_motion(
    kind: type[Scene], links: int | None, formulation: str, end: float, frames: int
) -> tuple[list[Sketch], np.ndarray, int]:
    """Return sketches of a motion at equal times, these times, s, and how many make a frame.

    It starts from the initial state of the example, or of the first structure with so many links.

    Raises:
        InputError: fewer than two frames, an end that is no positive time, no such formulation, or
            a scene that does not say what it looks like.
        EomcheckError: the motion does not come to its end.
    """
    from eomcheck.motion.simulate import simulate

    if frames < 2:
        raise InputError(f"frames = {frames}, expected at least 2")
    scene = kind.example() if links is None else next(kind.structures(links))
    times = np.linspace(0.0, end, BETWEEN * (frames - 1) + 1)
    found = simulate(scene, formulation, end, output_times=times)
    if found.status != "finished":
        raise InputError(
            f"the motion of {scene.name} by {formulation} {found.status}: {found.reason}"
        )
    return [sketch_of(scene, q, t) for q, t in zip(found.q, times, strict=True)], times, BETWEEN


def moving_state(
    kind: type[Scene], links: int | None, formulation: Formulation
) -> tuple[Scene, Formulation, np.ndarray, np.ndarray]:
    """Return a scene in motion: it, the formulation, q (n,) and a consistent v (n,).

    Of the pose that pictures show; the components of v along a basis of what the constraints allow
    are 1, 1/2, 1/3 ..., so that no entry vanishes by chance of the state.

    Raises:
        InputError: it has no such number of links.
    """
    scene, q = _sketched(kind, links)
    q = closed_position(scene, q)
    at = Evaluation(scene, q, np.zeros(scene.n))
    if at.terms.a is None:
        return scene, formulation, q, 1 / np.arange(1.0, scene.n + 1)
    basis = null_space(at.terms.a)
    v = basis @ (1 / np.arange(1.0, basis.shape[1] + 1))
    return scene, formulation, q, consistent_velocity(at, v)

"""What pictures of scenes show: a pose, a motion, a state whose matrices are drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.linalg import null_space

from eomcheck.errors import InputError
from eomcheck.evaluation.dynamics import closed_position, consistent_velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import Formulation
from eomcheck.mechanics.parameters import with_parameters
from eomcheck.mechanics.scene import Scene
from eomcheck.mechanics.sketch import Sketch
from eomcheck.scene_lookup import ROBOTS, kind_of, scene_of

BETWEEN = 6
"""Points of a path from one frame to the next."""


def scene_to_draw(
    name: str, links: int | None = None, given: Mapping[str, Sequence[float] | None] | None = None
) -> tuple[Scene, np.ndarray]:
    """Return the scene that is called `name`, and the pose q (n,) that pictures show.

    Args:
        name: its name.
        links: number of links, for kinds that have one.
        given: parameters that are other than usual.

    Raises:
        UnknownNameError, InputError: see `eomcheck.scene_lookup.scene_of`.
    """
    if name in ROBOTS:
        scene = scene_of(name, links, given)
        return scene, scene.initial_state()[0]
    scene, q = sketched(kind_of(name), links)
    return with_parameters(scene, given or {}), q


def sketch_of(scene: Scene, q: np.ndarray, t: float = 0.0) -> Sketch:
    """Return what a picture of `scene` in the pose q (n,) is made of.

    Raises:
        InputError: the scene does not say.
    """
    sketch = scene.sketch(q, t)
    if sketch is None:
        raise InputError(f"{scene.name} does not say what it looks like: it has no `sketch`")
    return sketch


def sketched(kind: type[Scene], links: int | None = None) -> tuple[Scene, np.ndarray]:
    """Return the scene of a kind and the pose q (n,) that pictures show.

    Raises:
        InputError: it has no such number of links.
    """
    if links is not None:
        next(kind.structures(links))  # refuses a number of links that there cannot be
    return kind.sketched(links)


def posed(scene: Scene, q: np.ndarray) -> tuple[Sketch, tuple[str, ...]]:
    """Return the sketch of a scene in the closed pose next to q (n,), and its coordinates' names.

    Raises:
        InputError: it does not say what it looks like.
        RefusedError: there is no such pose.
    """
    return sketch_of(scene, closed_position(scene, q)), scene.coordinate_names


def sketches_of_motion(
    scene: Scene, formulation: str, end: float, frames: int
) -> tuple[list[Sketch], np.ndarray, int]:
    """Return sketches of a motion at equal times, these times, s, and how many make a frame.

    It starts from the initial state.

    Raises:
        InputError: fewer than two frames, an end that is no positive time, no such formulation, or
            a scene that does not say what it looks like.
        EomcheckError: the motion does not come to its end.
    """
    from eomcheck.motion.simulate import simulate

    if frames < 2:
        raise InputError(f"frames = {frames}, expected at least 2")
    times = np.linspace(0.0, end, BETWEEN * (frames - 1) + 1)
    found = simulate(scene, formulation, end, output_times=times)
    if found.status != "finished":
        raise InputError(
            f"the motion of {scene.name} by {formulation} {found.status}: {found.reason}"
        )
    return [sketch_of(scene, q, t) for q, t in zip(found.q, times, strict=True)], times, BETWEEN


def moving_state(
    scene: Scene, q: np.ndarray, formulation: Formulation
) -> tuple[Scene, Formulation, np.ndarray, np.ndarray]:
    """Return a scene in motion: it, the formulation, q (n,) and a consistent v (n,).

    In the closed pose next to q (n,); the components of v along a basis of what the constraints
    allow are 1, 1/2, 1/3 ..., so that no entry vanishes by chance of the state.
    """
    q = closed_position(scene, q)
    at = Evaluation(scene, q, np.zeros(scene.n))
    if at.terms.a is None:
        return scene, formulation, q, 1 / np.arange(1.0, scene.n + 1)
    basis = null_space(at.terms.a)
    v = basis @ (1 / np.arange(1.0, basis.shape[1] + 1))
    return scene, formulation, q, consistent_velocity(at, v)

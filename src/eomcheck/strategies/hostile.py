"""Snakes and states at the edge of what is valid."""

from __future__ import annotations

import math

from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import Snake
from eomcheck.strategies.entries import links_between, magnitudes, vector
from eomcheck.strategies.states import case_of, consistent_state


def hostile_snakes(min_links: int = 1, max_links: int = 8) -> SearchStrategy[Snake]:
    """Return a strategy for snakes at the edge: huge and tiny parameters, wheels across the link.

    All are valid. Formulations may refuse them; none may answer with NaN.

    Raises:
        InputError: bounds that no snake can have.
    """
    sizes = magnitudes(-8.0, 8.0)
    across = st.builds(
        lambda sign, distance: sign * (math.pi / 2 - distance),
        st.sampled_from((-1.0, 1.0)),
        st.just(0.0) | magnitudes(-16.0, -1.0),
    )
    wheels = st.sampled_from((0.0, -0.0)) | st.floats(-math.pi, math.pi) | across

    def build(n: int) -> SearchStrategy[Snake]:
        return st.builds(
            Snake,
            mass=vector(sizes, n),
            length=vector(sizes, n),
            inertia=vector(st.just(0.0) | sizes, n),
            stiffness=st.none() | vector(st.just(0.0) | magnitudes(-8.0, 12.0), n - 1),
            wheel_angle=vector(wheels, n),
            damping=st.none() | vector(st.just(0.0) | magnitudes(-8.0, 12.0), n - 1),
        )

    return links_between(min_links, max_links).flatmap(build)


def hostile_states(scene: Scene) -> SearchStrategy[State]:
    """Return a strategy for consistent states at the edge of `scene`.

    Stretched poses, many turns, and speeds from 1e-150 to 1e150.
    """
    components = vector(
        st.just(0.0)
        | st.builds(lambda sign, x: sign * x, st.sampled_from((-1.0, 1.0)), magnitudes(-150, 150)),
        scene.p,
    )
    straight = st.floats(-math.pi, math.pi).map(lambda x: [x] * scene.n)
    anywhere = vector(st.floats(-1e9, 1e9), scene.n)
    numbers = st.tuples(straight | anywhere, components, st.just(0.0))
    return numbers.map(case_of(consistent_state, scene))

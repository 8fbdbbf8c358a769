"""Claims about kinematics and momentum: center of mass, momentum, and frames of links.

Each quantity is the rate of another one: the Jacobian belongs to the position, the velocity is J v,
the acceleration J v̇ + J̇ v. Rates are measured finite differences. Axes are those of the world,
6-vectors have their linear part first, accelerations are those of a point and not spatial, and the
angular momentum is about the center of mass; other conventions are recognized and named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from eomcheck.claims.confusions import ConfusionContext
from eomcheck.claims.registry import BlindSpot, Comparison, Decision, Skipped, function_claim
from eomcheck.evaluation.tolerance import INCONCLUSIVE, C
from eomcheck.numbers.generic import EPS, Array
from eomcheck.testing.claims_answers import FIXED_AXES
from eomcheck.testing.claims_motions import is_nonzero
from eomcheck.testing.claims_terms import explained_by, proportional, row_names
from eomcheck.testing.equations_of_motion import BrokenError
from eomcheck.testing.function_state import FunctionState, inertia
from eomcheck.testing.uncertain import UncertainArray, contract, exact, stack_uncertain

XYZ, SIX = FIXED_AXES["3"], FIXED_AXES["6"]

LEVI_CIVITA = np.array(
    [[[(i - j) * (j - k) * (k - i) / 2.0 for k in range(3)] for j in range(3)] for i in range(3)]
)
"""Tensor ε of a cross product, (x × y)_i = ε_ijk x_j y_k."""

Context = Callable[[], ConfusionContext]


def _rate(at: FunctionState, name: str) -> UncertainArray:
    """Return the rate of a function of (q, v) while q moves with q̇ and v with v̇."""
    f = at.raw(name)
    return at.rate_of(f) + contract("pi,p->i", at.by_v(f), exact(at.vdot))


def _rate_of_product(at: FunctionState, name: str) -> UncertainArray:
    """Return X v̇ + Ẋ v of a function X of q (..., p)."""
    product = at.quantity(name) @ exact(at.vdot)
    return product + at.rate_of(at.raw(name)) @ exact(at.v)


def _compare(
    at: FunctionState,
    subject: str,
    actual: UncertainArray,
    expected: UncertainArray,
    context: Context | None = None,
) -> Comparison:
    """Return the comparison of vectors (3,) or (6,), or of matrices of such columns (3 or 6, p)."""
    names = (XYZ if actual.shape[0] == 3 else SIX, *(row_names(at),) * (len(actual.shape) - 1))
    explain = proportional if context is None else explained_by(context)
    return Comparison(subject, actual, expected, names, explain=explain, context=context)


# ---- Center of mass ------------------------------------------------------------------------------

VECTOR: Context = lambda: ConfusionContext(rows="vector")  # noqa: E731


@function_claim(
    "com-jacobian",
    "J_c = ∂c/∂q",
    "Jacobian of the center of mass",
    ("com_jacobian", "com"),
    blind_spots=(
        BlindSpot(
            "com_jacobian",
            "whether the Jacobian of the center of mass belongs to it",
            ("com", "com_velocity", "against"),
        ),
    ),
)
def com_jacobian(at: FunctionState) -> Iterator[Comparison]:
    """Compare the Jacobian of the center of mass with its derivatives."""
    expected = at.along_velocities(at.raw("com"))
    yield _compare(at, "com_jacobian ~ com", at.quantity("com_jacobian"), expected, VECTOR)


@function_claim(
    "com-jacobian-symmetric",
    "∂J_k/∂q_j = ∂J_j/∂q_k of the center of mass",
    "Jacobian of the center of mass",
    ("com_jacobian",),
    without=("qdot",),
)
def com_jacobian_symmetric(at: FunctionState) -> Iterator[Comparison]:
    """Compare derivatives of the Jacobian of the center of mass: it is one of a position."""
    by_q = contract("jik->ikj", at.by_q(at.raw("com_jacobian")))
    yield _compare(at, "com_jacobian", by_q, contract("ikj->ijk", by_q))


@function_claim(
    "com-velocity",
    "ċ = J_c v",
    "velocity of the center of mass",
    ("com_velocity", "com_jacobian"),
)
def com_velocity(at: FunctionState) -> Iterator[Comparison]:
    """Compare the velocity of the center of mass with J_c v."""
    expected = at.quantity("com_jacobian") @ exact(at.v)
    yield _compare(at, "com_velocity ~ J v", at.quantity("com_velocity"), expected, VECTOR)


@function_claim(
    "com-rate",
    "ċ = d/dt c",
    "velocity of the center of mass",
    ("com_velocity", "com"),
    blind_spots=(
        BlindSpot(
            "com_velocity",
            "whether the velocity of the center of mass belongs to it",
            ("com", "com_jacobian", "against"),
        ),
    ),
)
def com_rate(at: FunctionState) -> Iterator[Comparison]:
    """Compare the velocity of the center of mass with its rate."""
    expected = at.rate_of(at.raw("com"))
    yield _compare(at, "com_velocity ~ com", at.quantity("com_velocity"), expected, VECTOR)


@function_claim(
    "com-acceleration",
    "c̈ = J_c v̇ + J̇_c v",
    "acceleration of the center of mass",
    ("com_acceleration", "com_velocity|com_jacobian"),
    blind_spots=(
        BlindSpot(
            "com_acceleration",
            "whether the acceleration of the center of mass belongs to it",
            ("com_velocity", "com_jacobian", "against"),
        ),
    ),
)
def com_acceleration(at: FunctionState) -> Iterator[Comparison]:
    """Compare the acceleration of the center of mass with the rate of its velocity."""
    expected, context = _expected_rate(at, "com_velocity", "com_jacobian", "vector")
    actual = at.quantity("com_acceleration")
    yield _compare(at, "com_acceleration ~ d/dt ċ", actual, expected, context)


def _expected_rate(
    at: FunctionState,
    velocity: str,
    jacobian: str,
    rows: Any,
    terms: tuple[str, str] = ("J̇ v", "J v̇"),
) -> tuple[UncertainArray, Context]:
    """Return the rate of a velocity, as given or J v, with the context of its two terms."""
    expected = _rate(at, velocity) if at.has(velocity) else _rate_of_product(at, jacobian)

    def context() -> ConfusionContext:
        f = at.raw(velocity) if at.has(velocity) else _product(at, jacobian)
        drift = at.rate_of(f).value
        return ConfusionContext(
            rows=rows, terms=dict(zip(terms, (drift, expected.value - drift), strict=True))
        )

    return expected, context


def _product(at: FunctionState, name: str) -> Callable[[Array, Array], Array]:
    """Return the function (q, v) -> X v of a function X of q (..., p)."""
    X = at.raw(name)
    return lambda q, v: X(q, v) @ v


def center_jacobian(at: FunctionState) -> UncertainArray:
    """Return the Jacobian of the center of mass (3, p): as given, else derivatives of it."""
    if at.has("com_jacobian"):
        return at.quantity("com_jacobian")
    return at.cached("J of com", lambda: at.along_velocities(at.raw("com")))


POSES = 4
"""Number of further coordinates that determine the weight, beside those of the state."""


def _weights(at: FunctionState) -> tuple[UncertainArray, UncertainArray]:
    """Return g (k,) and J_cᵀ (k, 3) at the state, its p rows first, and at drawn coordinates."""

    def rows_at(state: FunctionState) -> list[tuple[UncertainArray, UncertainArray]]:
        g, J = state.gravity(), center_jacobian(state)
        return [(g[i], J[:, i]) for i in range(len(at.v))]

    middle, half = (x[: len(at.q)] for x in at.functions.half_ranges())
    draws = np.random.default_rng(at.seed).uniform(-1.0, 1.0, (POSES, len(at.q)))
    rows = rows_at(at)
    for q in middle + half * draws:
        try:
            rows += rows_at(FunctionState(at.caller, q, at.v, at.seed))
        except BrokenError:  # such as outside of a table: fewer poses tell enough
            continue
    g, columns = zip(*rows, strict=True)
    return stack_uncertain(g), stack_uncertain(columns)


@function_claim(
    "com-gravity",
    "g = J_cᵀ w with one constant w at all q",
    "gravity at the center of mass",
    ("gravity", "com_jacobian|com"),
    blind_spots=tuple(
        BlindSpot(name, "whether gravity pulls at the center of mass", ("gravity", "against"))
        for name in ("com", "com_jacobian")
    ),
)
def com_gravity(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare gravity with that of the constant weight w that fits best, by least squares.

    The residual of least squares changes by that of the errors of g and J_cᵀ w. Directions in which
    J_c is not 0 by its error alone, as across the plane of a mechanism, do not determine w.
    """
    subject, (g, J) = "gravity ~ J_cᵀ w", _weights(at)
    if not is_nonzero(g).any():
        yield Skipped(subject, "gravity is 0, which tells nothing about the center of mass")
        return
    U, singular, V = np.linalg.svd(J.value, full_matrices=False)
    kept = singular > C * np.linalg.norm(J.error)
    U, p = U[:, kept], len(at.v)
    weight = V[kept].T @ (U.T @ g.value / singular[kept])
    size = J.size @ np.abs(weight)
    error = J.error @ np.abs(weight) + EPS * size
    fit, reach = U[:p] @ (U.T @ g.value), np.abs(U[:p] @ U.T)
    expected = UncertainArray(fit, error[:p] + reach @ (error + g.error + EPS * g.size), size[:p])

    def explain(actual: Array, expected: Array, _: float, worst: tuple[int, ...]) -> str:
        pair = f"{actual[worst]:.6g}, expected {expected[worst]:.6g}"
        return f"{pair} of the constant weight that fits best; forces of springs belong in Q"

    yield Comparison(subject, g[:p], expected, (row_names(at),), explain=explain)


@function_claim(
    "com-kinetic-energy",
    "½ m ċ² ≤ ½ vᵀ M v for all v",
    "mass at the center of mass",
    ("mass", "com_jacobian|com", "M|T"),
    natural=True,
)
def com_kinetic_energy(at: FunctionState) -> Iterator[Decision]:
    """Decide whether M - m J_cᵀ J_c is semidefinite: it belongs to motion about the center of mass.

    Eigenvalues are in units in which the diagonal of M is 1.
    """
    J, M, subject = center_jacobian(at), inertia(at), "mass ~ M"
    relative = M - contract(",ai,aj->ij", at.quantity("mass"), J, J)
    diagonal = np.diagonal(M.value)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    units = np.outer(scale, scale)
    values, vectors = np.linalg.eigh(0.5 * (relative.value + relative.value.T) * units)
    least, v = float(values[0]), scale * vectors[:, 0]
    allowed = C * float((relative.error * units).sum() + EPS * len(scale))
    if least < -allowed:
        times = 1.0 - (v @ relative.value @ v) / (v @ M.value @ v)
        text = f"mass at the center of mass, one motion: {times:.6g} times the energy that M gives"
        yield Decision(subject, -least, allowed, "failed", text)
    elif allowed > INCONCLUSIVE:
        yield Decision(subject, max(-least, 0.0), allowed, "inconclusive", "the error is as large")
    else:
        yield Decision(subject, max(-least, 0.0), allowed, "passed")


# ---- Momentum ------------------------------------------------------------------------------------

BODIES = "momentum|momentum_matrix", "com_velocity|com_jacobian"


def momentum_of(at: FunctionState) -> UncertainArray:
    """Return the momentum (6,): as given, else A v."""
    if at.has("momentum"):
        return at.quantity("momentum")
    return at.quantity("momentum_matrix") @ exact(at.v)


def _about_origin(at: FunctionState) -> Context:
    """Return the context of a momentum, whose angular part may be about another point."""

    def context() -> ConfusionContext:
        arms = {"the world's origin": -at.quantity("com").value} if at.has("com") else {}
        return ConfusionContext(rows="force", point="the center of mass", arms=arms)

    return context


@function_claim(
    "com-momentum",
    "m ċ is the linear momentum",
    "momentum",
    ("mass", *BODIES),
    blind_spots=(
        BlindSpot(
            "mass",
            "whether the mass is that of the bodies",
            (" & ".join(BODIES), "parameters", "against"),
        ),
    ),
)
def com_momentum(at: FunctionState) -> Iterator[Comparison]:
    """Compare the linear momentum with the mass times the velocity of the center of mass."""
    if at.has("com_velocity"):
        velocity = at.quantity("com_velocity")
    else:
        velocity = at.quantity("com_jacobian") @ exact(at.v)
    expected = contract(",i->i", at.quantity("mass"), velocity)
    momentum = momentum_of(at)

    def context() -> ConfusionContext:
        angular = {"angular part, expected linear": momentum.value[3:]}
        swapped = {} if np.array_equal(momentum.value[:3], momentum.value[3:]) else angular
        first = {"velocity, without the mass": velocity.value}
        return ConfusionContext(rows="vector", alternatives=first | swapped)

    yield _compare(at, "momentum ~ m ċ", momentum[:3], expected, context)


@function_claim(
    "mass-parameters", "m is the sum of the masses in π", "total mass", ("mass", "parameters")
)
def mass_parameters(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare the mass with the sum of those of the bodies."""
    parameters = at.quantity("parameters")
    if len(parameters.value) % 10:
        yield Skipped("mass ~ parameters", "there are not ten parameters for each body")
        return
    masses = exact(np.arange(len(parameters.value)) % 10 == 0)
    yield Comparison("mass ~ parameters", at.quantity("mass"), parameters @ masses, ())


@function_claim("momentum-linear", "h(q, 2v) = 2 h(q, v)", "momentum", ("momentum",))
def momentum_linear(at: FunctionState) -> Iterator[Comparison]:
    """Compare the momentum at 2 v with twice that at v."""
    twice = at.with_velocity(2.0 * at.v).quantity("momentum")
    yield _compare(at, "momentum", twice, 2.0 * at.quantity("momentum"))


@function_claim(
    "momentum-matrix",
    "h = A v",
    "momentum matrix",
    ("momentum_matrix", "momentum"),
    blind_spots=(
        BlindSpot(
            "momentum_matrix",
            "whether the momentum matrix is that of the bodies",
            ("momentum", "against"),
        ),
    ),
)
def momentum_matrix(at: FunctionState) -> Iterator[Comparison]:
    """Compare A v with the momentum."""
    actual = at.quantity("momentum_matrix") @ exact(at.v)
    yield _compare(at, "momentum_matrix ~ h", actual, at.quantity("momentum"), _about_origin(at))


@function_claim(
    "momentum-rate",
    "d/dt h = A v̇ + Ȧ v",
    "rate of the momentum",
    ("momentum_rate", "momentum|momentum_matrix"),
    blind_spots=(
        BlindSpot(
            "momentum_rate",
            "whether the rate of the momentum belongs to it",
            ("momentum", "momentum_matrix", "against"),
        ),
    ),
)
def momentum_rate(at: FunctionState) -> Iterator[Comparison]:
    """Compare the rate of the momentum with that of h, or of A v."""
    names = "Ȧ v", "A v̇"
    expected, of_rate = _expected_rate(at, "momentum", "momentum_matrix", "force", names)

    def context() -> ConfusionContext:
        return _about_origin(at)()._replace(terms=of_rate().terms)

    yield _compare(at, "momentum_rate ~ h", at.quantity("momentum_rate"), expected, context)


@function_claim(
    "com-momentum-rate",
    "m c̈ is the rate of the linear momentum",
    "rate of the momentum",
    ("mass", "momentum_rate", "com_acceleration"),
)
def com_momentum_rate(at: FunctionState) -> Iterator[Comparison]:
    """Compare the rate of the linear momentum with m c̈."""
    expected = contract(",i->i", at.quantity("mass"), at.quantity("com_acceleration"))
    yield _compare(at, "momentum_rate ~ m c̈", at.quantity("momentum_rate")[:3], expected, VECTOR)


# ---- Frames --------------------------------------------------------------------------------------


def _frames(at: FunctionState, *names: str) -> Iterator[tuple[str, list[int]]]:
    """Yield the suffix of each frame that all functions have, and its index in each of them."""
    frames = [at.functions.frames(name) for name in names]
    for frame in frames[0]:
        if all(frame in of_function for of_function in frames):
            yield f" [{frame}]" if frame else "", [x.index(frame) for x in frames]


def _no_frame(at: FunctionState, *names: str) -> Iterator[Skipped]:
    """Yield why nothing is compared where functions have no frame in common."""
    if not any(True for _ in _frames(at, *names)):
        yield Skipped(f"{names[0]} ~ {names[1]}", "they have no frame of one name")


def _frame_context(
    at: FunctionState, suffix: str, rows: Any, velocity: Array | None = None
) -> ConfusionContext:
    """Return the context of a frame: its axes and origin if its placement is given.

    Args:
        at: the state.
        suffix: that of the frame.
        rows: see `ConfusionContext`.
        velocity: its velocity (6,), by which spatial accelerations are recognized.
    """
    context = ConfusionContext(rows=rows)
    if velocity is not None:
        context = context._replace(velocity=velocity[:3], omega=velocity[3:])
    for other, (index,) in _frames(at, "frame_placement") if at.has("frame_placement") else ():
        if other == suffix:
            placement = at.quantity("frame_placement").value[index]
            arms = {"the world's origin": -placement[:, 3]}
            if at.has("com"):
                arms["the center of mass"] = at.quantity("com").value - placement[:, 3]
            return context._replace(R=placement[:, :3], arms=arms, point="the frame's origin")
    return context


@function_claim("frame-rotation", "R Rᵀ = 1, det R = 1", "frame placement", ("frame_placement",))
def frame_rotation(at: FunctionState) -> Iterator[Comparison]:
    """Compare R Rᵀ with 1, and the third axis with the cross product of the first two."""
    for suffix, (i,) in _frames(at, "frame_placement"):
        R = at.quantity("frame_placement")[i][:, :3]
        yield Comparison(f"frame_placement{suffix} ~ R Rᵀ", R @ R.T, exact(np.eye(3)), (XYZ, XYZ))
        third = contract("ijk,j,k->i", exact(LEVI_CIVITA), R[:, 0], R[:, 1])
        yield Comparison(
            f"frame_placement{suffix} ~ right-handed",
            R[:, 2],
            third,
            (XYZ,),
            explain=lambda *_: "left-handed axes, det R = -1",
        )


def _motion_of(at: FunctionState, index: int, change: Callable[[Array], Array]) -> UncertainArray:
    """Return the Jacobian (6, p) of a placement [R p], changed by `change` first."""
    placement = at.raw("frame_placement")

    def changed(q: Array, v: Array) -> Array:
        return change(placement(q, v)[index])

    return _jacobian_of(at.along_velocities(changed), at.measure(changed))


def _jacobian_of_placement(at: FunctionState, index: int) -> UncertainArray:
    """Return the Jacobian (6, p) of a placement."""
    placement = at.raw("frame_placement")
    return _jacobian_of(at.along_velocities(placement)[index], at.measure(placement)[index])


def _jacobian_of(by_velocity: UncertainArray, value: UncertainArray) -> UncertainArray:
    """Return the Jacobian (6, p) of a placement (3, 4) and its derivatives (3, 4, p)."""
    spin = contract("ijp,kj->ikp", by_velocity[:, :3], value[:, :3])
    angular = [0.5 * (spin[j, i] - spin[i, j]) for i, j in ((1, 2), (2, 0), (0, 1))]
    return stack_uncertain([*(by_velocity[i, 3] for i in range(3)), *angular])


def _inverse_placement(placement: Array) -> Array:
    """Return the placement of the world in a frame, of that of the frame in the world (3, 4)."""
    R, p = placement[:, :3], placement[:, 3]
    return np.column_stack((R.T, -R.T @ p))


def _transposed_rotation(placement: Array) -> Array:
    """Return a placement with R transposed."""
    return np.column_stack((placement[:, :3].T, placement[:, 3]))


@function_claim(
    "frame-jacobian",
    "J = ∂p/∂q, and R' Rᵀ",
    "frame Jacobian",
    ("J", "frame_placement"),
    blind_spots=(
        BlindSpot("J", "whether J belongs to the frame", ("frame_placement", "against")),
        BlindSpot(
            "frame_placement",
            "whether the placement is that of the frame",
            ("J", "frame_velocity", "against"),
        ),
    ),
)
def frame_jacobian(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare the frame Jacobian with derivatives of origin and rotation."""
    yield from _no_frame(at, "J", "frame_placement")
    for suffix, (i, k) in _frames(at, "J", "frame_placement"):

        def context(suffix: str = suffix, k: int = k) -> ConfusionContext:
            alternatives = {
                "frame_placement is that of the world in the frame": _inverse_placement,
                "R of frame_placement is transposed": _transposed_rotation,
            }
            known = _frame_context(at, suffix, "motion")
            return known._replace(
                alternatives={x: _motion_of(at, k, f).value for x, f in alternatives.items()}
            )

        expected = _jacobian_of_placement(at, k)
        subject = f"J{suffix} ~ frame_placement"
        yield _compare(at, subject, at.quantity("J")[i], expected, context)


@function_claim(
    "frame-jacobian-symmetric",
    "∂J_k/∂q_j = ∂J_j/∂q_k, and + ω_j × ω_k",
    "frame Jacobian",
    ("J",),
    without=("qdot",),
)
def frame_jacobian_symmetric(at: FunctionState) -> Iterator[Comparison]:
    """Compare derivatives of a frame Jacobian: it is one of a position and of a rotation."""
    by_q = contract("jfik->fikj", at.by_q(at.raw("J")))
    for suffix, (i,) in _frames(at, "J"):
        spin = at.quantity("J")[i][3:]
        turn = contract("iab,aj,bk->ikj", exact(LEVI_CIVITA), spin, spin)
        mirrored = contract("ikj->ijk", by_q[i])
        expected = stack_uncertain([*(mirrored[a] for a in range(3)), *(_sum(mirrored, turn))])

        def context(mirrored: UncertainArray = mirrored, turn: Any = turn) -> ConfusionContext:
            local = np.concatenate((mirrored.value[:3], mirrored.value[3:] - turn.value))
            own = "angular part along the frame's own axes, expected along the world's"
            return ConfusionContext(alternatives={own: local})

        yield _compare(at, f"J{suffix}", by_q[i], expected, context)


def _sum(x: UncertainArray, turn: UncertainArray) -> list[UncertainArray]:
    """Return the angular rows of an array (6, ...) with a term (3, ...) added."""
    return [x[3 + a] + turn[a] for a in range(3)]


@function_claim("frame-velocity", "V = J v", "frame velocity", ("frame_velocity", "J"))
def frame_velocity(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare the velocity of a frame with J v."""
    yield from _no_frame(at, "frame_velocity", "J")
    for suffix, (i, k) in _frames(at, "frame_velocity", "J"):
        actual, expected = at.quantity("frame_velocity")[i], at.quantity("J")[k] @ exact(at.v)
        context: Context = lambda suffix=suffix: _frame_context(at, suffix, "motion")  # noqa: E731
        yield _compare(at, f"frame_velocity{suffix} ~ J v", actual, expected, context)


@function_claim(
    "frame-rate",
    "V = ṗ, and Ṙ Rᵀ",
    "frame velocity",
    ("frame_velocity", "frame_placement"),
    blind_spots=(
        BlindSpot(
            "frame_velocity",
            "whether the velocity is that of the frame",
            ("J", "frame_placement", "against"),
        ),
    ),
)
def frame_rate(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare the velocity of a frame with the rate of its placement."""
    yield from _no_frame(at, "frame_velocity", "frame_placement")
    for suffix, (i, k) in _frames(at, "frame_velocity", "frame_placement"):
        expected = _jacobian_of_placement(at, k) @ exact(at.v)
        context: Context = lambda suffix=suffix: _frame_context(at, suffix, "motion")  # noqa: E731
        actual = at.quantity("frame_velocity")[i]
        yield _compare(at, f"frame_velocity{suffix} ~ frame_placement", actual, expected, context)


OF_FRAME = "frame_velocity|J"


def _frame_acceleration(
    at: FunctionState, name: str, still: bool
) -> Iterator[Comparison | Skipped]:
    """Yield comparisons of accelerations with the rate of J v, at v̇ = 0 where `still`."""
    source = "frame_velocity" if at.has("frame_velocity") else "J"
    velocity = at.raw("frame_velocity") if source != "J" else _product(at, "J")
    yield from _no_frame(at, name, source)
    drift = at.rate_of(velocity)
    along = contract("pfi,p->fi", at.by_v(velocity), exact(at.vdot))
    now = velocity(at.q, at.v)
    for suffix, (i, k) in _frames(at, name, source):

        def context(suffix: str = suffix, k: int = k) -> ConfusionContext:
            terms = {} if still else {"J̇ v": drift.value[k], "J v̇": along.value[k]}
            return _frame_context(at, suffix, "acceleration", now[k])._replace(terms=terms)

        expected = drift[k] if still else drift[k] + along[k]
        subject = f"{name}{suffix} ~ d/dt {source}"
        yield _compare(at, subject, at.quantity(name)[i], expected, context)


@function_claim(
    "frame-bias",
    "the bias of a frame is J̇ v",
    "frame bias",
    ("frame_bias", OF_FRAME),
    blind_spots=(
        BlindSpot(
            "frame_bias",
            "whether the bias is that of the frame",
            ("frame_velocity", "J", "frame_acceleration", "against"),
        ),
    ),
)
def frame_bias(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare the bias of a frame with the rate of J v at v̇ = 0."""
    yield from _frame_acceleration(at, "frame_bias", True)


@function_claim(
    "frame-acceleration",
    "the acceleration of a frame is J v̇ + J̇ v",
    "frame acceleration",
    ("frame_acceleration", OF_FRAME),
    blind_spots=(
        BlindSpot(
            "frame_acceleration",
            "whether the acceleration is that of the frame",
            ("frame_velocity", "J", "against"),
        ),
    ),
)
def frame_acceleration(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare the acceleration of a frame with the rate of its velocity."""
    yield from _frame_acceleration(at, "frame_acceleration", False)


@function_claim(
    "frame-acceleration-bias",
    "the acceleration of a frame at v̇ = 0 is its bias",
    "frame acceleration",
    ("frame_acceleration", "frame_bias"),
)
def frame_acceleration_bias(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare the acceleration of a frame at v̇ = 0 with its bias."""
    yield from _no_frame(at, "frame_acceleration", "frame_bias")
    still = at.with_loads(vdot=np.zeros(len(at.v))).quantity("frame_acceleration")
    for suffix, (i, k) in _frames(at, "frame_acceleration", "frame_bias"):
        expected = at.quantity("frame_bias")[k]
        context: Context = lambda suffix=suffix: _frame_context(  # noqa: E731
            at, suffix, "acceleration"
        )
        yield _compare(at, f"frame_acceleration{suffix} ~ bias", still[i], expected, context)

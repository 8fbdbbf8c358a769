"""Converters to `EquationsOfMotion`: from a scene, an engine, or equations that SymPy derived.

A converted scene or engine is the reference that functions are compared with. SymPy's `KanesMethod`
and `LagrangesMethod` become functions of arrays: their symbolic expressions are compiled by
`lambdify`. SymPy is imported when one of them is converted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from math import isfinite
from typing import Any

import numpy as np

from eomcheck.console import activity
from eomcheck.engines import Answers, Engine, EngineFault, engine_of, make_engine, represents
from eomcheck.errors import InputError, required, safe_repr
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import UNIT_ROUNDOFF
from eomcheck.formulations import FORMULATIONS, formulations_among
from eomcheck.mechanics.scene import Scene, checked_scene
from eomcheck.numbers.generic import Array
from eomcheck.testing.equations_of_motion import INPUTS, EquationsOfMotion
from eomcheck.testing.handed_over import EngineQuantities, SceneQuantities

# ---- Scenes and engines --------------------------------------------------------------------------


def from_scene(scene: Scene) -> EquationsOfMotion:
    """Return the equations of a scene as float64 functions, at t = 0 s.

    All forces are in `Q` where the scene has no potential energy; where it has one, forces at rest
    are `gravity` and damping follows from `R`. Derivatives are those by dual numbers; momentum,
    frames of its links and the regressor are those of its tree of bodies, where it has one.

    Raises:
        InputError: `scene` is no scene, such as the name of one.
    """
    checked_scene(scene)
    solver = formulations_among([scene], None)[0] if scene.r == 0 else FORMULATIONS["au"]
    quantities = SceneQuantities(scene, solver)
    example = Evaluation(scene, *scene.initial_state())
    _, U = scene.energies(example.parameters, example.prepared, example.q, example.v)
    damped = example.dissipation(example.v) is not None
    arguments = {"M": 1, "bias": 2, "T": 2}
    if U is not None:
        arguments["U"] = 1
    if damped:
        arguments["R"] = 2
    if U is None and not damped and example.terms.Q is not None:
        arguments["Q"] = 2
    if scene.r:
        arguments |= {"a": 1, "gamma": 2, "c": 2}
    functions: dict[str, Any] = {
        name: quantities.function(name, count) for name, count in arguments.items()
    }
    functions["qdd"] = quantities.function("forward_dynamics", 2)
    if U is not None:
        functions["gravity"] = quantities.function("rest force", 1)
    if example.terms.b is not None:
        functions["b"] = lambda q, t: Evaluation(scene, q, np.zeros(scene.n), t).terms.b
    return EquationsOfMotion(scene.n, name=scene.name, **quantities.functions() | functions)


def from_engine(engine: Any) -> EquationsOfMotion:
    """Return the quantities that an engine computes of its scene as float64 functions, at t = 0 s.

    Forces of the scene beside weight, which an engine's inverse and forward dynamics have not, are
    added on our side.

    Args:
        engine: an engine, made for its scene; of the optional methods those it overrides.

    Raises:
        InputError: it does not compute in float64.
    """
    if isinstance(engine, Engine) and engine.unit_roundoff > UNIT_ROUNDOFF:
        raise InputError(
            f"engine {type(engine).key}: unit_roundoff = {engine.unit_roundoff!r}, expected "
            f"{UNIT_ROUNDOFF!r}: functions are compared in float64"
        )
    scene, zero = engine.scene, np.zeros(engine.scene.n)
    # In the scene's coordinates, whatever coordinates the engine has itself.
    answers: Any = Answers(engine) if isinstance(engine, Engine) else engine
    functions: dict[str, Any] = {"M": answers.mass_matrix, "bias": answers.bias}
    optional = {"Q": "forces", "gamma": "constraint_drift"} if scene.r else {"Q": "forces"}
    for name, method in optional.items():
        if _offers(engine, method):
            functions[name] = getattr(answers, method)
    if scene.r and _offers(engine, "constraint_jacobian"):
        functions["a"] = lambda q: answers.constraint_jacobian(q, zero)
    if isinstance(engine, Engine):
        functions |= EngineQuantities(engine).functions()
    return EquationsOfMotion(scene.n, name=f"{type(engine).key} of {scene.name}", **functions)


def _offers(engine: Any, method: str) -> bool:
    """Return whether an engine overrides an optional method."""
    own = getattr(type(engine), method, None)
    return own is not None and own is not getattr(Engine, method, None)


def reference_functions(against: Any) -> EquationsOfMotion:
    """Return the reference that functions are compared with, as functions.

    Args:
        against: a scene, an engine made for one, (engine or its name, scene), or
            `EquationsOfMotion`.

    Raises:
        InputError: none of these, or the engine does not represent the scene.
        UnknownNameError: no engine has this key.
        EngineError: the library of the engine is not installed.
    """
    match against:
        case EquationsOfMotion():
            return against
        case Scene():
            return from_scene(against)
        case (engine, Scene() as scene):
            kind = engine_of(engine)
            if not represents(kind, scene):
                raise InputError(f"against = {kind.key}, which does not represent {scene.name}")
            try:
                return from_engine(make_engine(kind, scene))
            except EngineFault as fault:
                raise InputError(f"against = {kind.key}: {fault.what}") from fault
    if hasattr(against, "mass_matrix") and hasattr(against, "scene"):
        return from_engine(against)
    hint = (
        "; of functions make one: EquationsOfMotion(n, M=M, ...)"
        if isinstance(against, Mapping)
        else ""
    )
    raise InputError(
        f"against = {against!r}, expected a scene, an engine made for one, (engine, scene), or "
        f"EquationsOfMotion{hint}"
    )


# ---- SymPy ---------------------------------------------------------------------------------------


class _Numbers:
    """Compiler of expressions in SymPy's symbols to functions of arrays q and v.

    Args:
        what: source of the expressions, for messages.
        q: the coordinates.
        v: the velocities, symbols or functions of time.
        parameters: symbol -> number.
    """

    def __init__(self, method: str, q: Any, v: Any, parameters: Mapping[Any, float] | None):
        self._sympy = required("sympy", "sympy")
        self._plain: dict[int, tuple[Any, Any]] = {}
        self.what = method
        if not isinstance(parameters, Mapping | None):
            shown = safe_repr(parameters)
            raise InputError(f"parameters = {shown}, expected a dict, symbol -> number")
        symbols = [self._sympy.Dummy(str(i)) for i in range(len(q) + len(v))]
        # Rates are replaced before the coordinates that they are rates of.
        self._names = dict(zip([*v, *q], [*symbols[len(q) :], *symbols[: len(q)]], strict=True))
        self._arguments = symbols
        self._parameters = {
            self._sympy.sympify(x): _number(method, x, y) for x, y in (parameters or {}).items()
        }

    def plain(self, expression: Any) -> Any:
        """Return an expression as a matrix in symbols for q and v alone."""
        key = id(expression)
        if key not in self._plain:  # an expression that is kept has an id of its own
            plain = self._replace_names(expression).subs(self._parameters)
            self._plain[key] = expression, plain
        return self._plain[key][1]

    def _replace_names(self, expression: Any) -> Any:
        """Return an expression as a matrix, its coordinates and speeds replaced by `_arguments`."""
        sp, mechanics = self._sympy, required("sympy.physics.mechanics", "sympy")
        matrix = sp.Matrix(expression) if hasattr(expression, "shape") else sp.Matrix([expression])
        return mechanics.msubs(matrix, self._names)

    def check(self, *expressions: Any, others: Iterable[Any] = ()) -> None:
        """Raise InputError if a symbol has no number, or a number no symbol.

        Args:
            expressions: expressions of which every symbol needs a number.
            others: other expressions in the model, of which symbols may have cancelled.
        """
        unknown = _symbols(map(self.plain, expressions)) - set(self._arguments)
        used = _symbols(map(self._replace_names, (*expressions, *others)))
        unused = [symbol for symbol in self._parameters if not _symbols([symbol]) <= used]
        names = sorted(map(str, unknown))
        numbered = {str(symbol) for symbol in self._parameters if symbol not in unused}
        if alike := sorted({*names, *numbered} & {*map(str, unused)}):
            raise InputError(
                f"parameters of {self.what} have {', '.join(alike)} of other assumptions than its "
                "equations, such as positive=True: in SymPy these are other symbols"
            )
        if unknown:
            raise InputError(f"parameters of {self.what} have no number for {', '.join(names)}")
        if unused:
            listed = ", ".join(sorted(map(str, unused)))
            raise InputError(
                f"parameters of {self.what} have a number for {listed}, which it has not"
            )

    def __call__(self, expression: Any) -> Callable[[Array, Array], Array]:
        """Return the function (q, v) -> array (rows, columns) of an expression."""
        with activity("compiling the equations of SymPy"):
            plain = self.plain(expression)
            function = self._sympy.lambdify(self._arguments, plain, "numpy", cse=True)

        def numbers(q: Array, v: Array) -> Array:
            return np.asarray(function(*q, *v), np.float64)

        return numbers


def _number(method: str, symbol: Any, value: Any) -> Any:
    """Return the number of a symbol, checked to be a finite real one."""
    with suppress(TypeError, ValueError, OverflowError):
        if not isinstance(value, str) and isfinite(float(value)):
            return value
    raise InputError(
        f"parameters of {method} have {symbol}: {safe_repr(value)}, expected a finite real number"
    )


def _symbols(expressions: Iterable[Any]) -> set[Any]:
    """Return the symbols and functions of time in expressions, without the time."""
    mechanics, symbols = required("sympy.physics.mechanics", "sympy"), set()
    for expression in expressions:
        symbols |= expression.free_symbols | mechanics.find_dynamicsymbols(expression)
    return symbols - {mechanics.dynamicsymbols._t}


def _check_options(maker: str, options: Mapping[str, Any]) -> None:
    """Raise InputError if a function is among the options of `maker`, which makes it itself."""
    for name in filter(INPUTS.__contains__, options):
        raise InputError(
            f"{name} = {options[name]!r} beside {maker}, which has it from the equations: all "
            "loads are in Q, gravity too, and what is given twice counts twice"
        )


def from_kane(
    kane: Any, parameters: Mapping[Any, float] | None = None, *, name: str = "kane", **options: Any
) -> EquationsOfMotion:
    """Return the equations of a SymPy `KanesMethod` as functions of q and its independent speeds.

    Its speeds need not be q̇: its kinematic equations are the `qdot`. Dependent speeds follow from
    its velocity constraints, u = W u_i, so that M is p × p and symmetric. The kinetic energy of its
    bodies is a second derivation of M. All loads are in `Q`.

    Args:
        kane: a `KanesMethod` after `kanes_equations` was called.
        parameters: symbol -> number, for all that are neither coordinates nor speeds.
        name: name of the equations in reports.
        options: `ranges` and others, see `eomcheck.testing.EquationsOfMotion`.

    Raises:
        InputError: `kane` is no `KanesMethod`, its equations are not formed, a symbol has no
            number, a number no symbol, it has auxiliary speeds, its velocity constraints are not
            homogeneous in u, or a function is among the options.
        EngineError: SymPy is not installed.
    """
    mechanics = required("sympy.physics.mechanics", "sympy")
    _check_options("from_kane", options)
    if not isinstance(kane, mechanics.KanesMethod):
        raise InputError(f"kane = {kane!r}, expected a sympy.physics.mechanics.KanesMethod")
    try:
        Fr, p = kane._fr, len(kane._fr)
        mass, forcing = kane.mass_matrix, kane.forcing
    except (TypeError, ValueError):
        raise InputError("kane has no equations yet, call kane.kanes_equations first") from None
    if any(term != 0 for term in kane._f_nh):
        raise InputError("kane has velocity constraints that are not homogeneous in its speeds")
    if auxiliary := list(getattr(kane, "_uaux", ())):
        names = ", ".join(map(str, auxiliary))
        raise InputError(
            f"kane has auxiliary speeds {names}, which are 0 in every motion and only bring "
            "constraint forces into its equations: make it without u_auxiliary"
        )
    rates, t = kane.kindiffdict(), mechanics.dynamicsymbols._t
    numbers = _Numbers("kane", kane.q, kane.u, parameters)
    with activity("differentiating the kinematic equations of SymPy"):
        seconds = {x.diff(t): mechanics.msubs(y.diff(t), rates) for x, y in rates.items()}
    in_u = seconds | dict(rates)

    energy = mechanics.kinetic_energy(kane._inertial, *kane.bodies)
    speeds = required("sympy", "sympy").Matrix([rates[q.diff()] for q in kane.q])
    with activity("replacing rates by speeds in the equations of SymPy"):
        expressions = [mechanics.msubs(x, in_u) for x in (mass, forcing, Fr, speeds, energy)]
    inertias = (body.central_inertia.args for body in kane.bodies if hasattr(body, "inertia"))
    further = [body.mass for body in kane.bodies] + [x[0] for inertia in inertias for x in inertia]
    numbers.check(*expressions, others=[*further, kane._f_h])
    K, f, loads, qdot, T = map(numbers, expressions)
    o = len(kane.u)

    def W(q: Array) -> Array:
        """Matrix W of all speeds from the independent ones (o, p)."""
        if p == o:  # K is evaluated for dependent speeds alone
            return np.eye(p)
        a = K(q, np.zeros(o))[p:]
        return np.vstack((np.eye(p), -np.linalg.solve(a[:, p:], a[:, :p])))

    def rest(q: Array, u: Array) -> Array:
        """Velocity-dependent part of u̇ (o,), its value at u̇_i = 0; o > p."""
        a = K(q, u)[p:]
        return np.concatenate((np.zeros(p), np.linalg.solve(a[:, p:], f(q, u)[p:, 0])))

    def bias(q: Array, u: Array) -> Array:
        full = W(q) @ u
        known = loads(q, full)[:, 0] - f(q, full)[:p, 0]
        return known if p == o else K(q, full)[:p] @ rest(q, full) + known

    def qdd(q: Array, u: Array) -> Array:
        full = W(q) @ u
        return np.linalg.solve(K(q, full), f(q, full)[:, 0])[:p]

    return EquationsOfMotion(
        len(kane.q),
        M=lambda q: K(q, np.zeros(o))[:p] @ W(q),
        bias=bias,
        Q=lambda q, u: loads(q, W(q) @ u)[:, 0],
        qdd=qdd,
        T=lambda q, u: T(q, W(q) @ u),
        qdot=lambda q, u: qdot(q, W(q) @ u)[:, 0],
        speeds=p,
        derived=True,
        name=name,
        **{**_names(coordinates=kane.q, velocities=list(kane.u)[:p]), **options},
    )


def from_lagrange(
    lagrange: Any,
    parameters: Mapping[Any, float] | None = None,
    *,
    name: str = "lagrange",
    **options: Any,
) -> EquationsOfMotion:
    """Return the equations of a SymPy `LagrangesMethod` as functions of q and q̇.

    With its Lagrangian L(q, q̇), the potential energy is -L(q, 0) and the kinetic energy
    L(q, q̇) - L(q, 0). The bias includes gravity, forces of its force list are in `Q`.

    Args:
        lagrange: a `LagrangesMethod` after `form_lagranges_equations` was called.
        parameters: symbol -> number, for all that are not coordinates.
        name: name of the equations in reports.
        options: `ranges` and others, see `eomcheck.testing.EquationsOfMotion`.

    Raises:
        InputError: `lagrange` is no `LagrangesMethod`, its equations are not formed, a symbol has
            no number, a number no symbol, or a function is among the options.
        EngineError: SymPy is not installed.
    """
    mechanics = required("sympy.physics.mechanics", "sympy")
    _check_options("from_lagrange", options)
    if not isinstance(lagrange, mechanics.LagrangesMethod):
        raise InputError(
            f"lagrange = {lagrange!r}, expected a sympy.physics.mechanics.LagrangesMethod"
        )
    if lagrange.eom is None:
        hint = "call lagrange.form_lagranges_equations first"
        raise InputError(f"lagrange has no equations yet, {hint}")
    q, n, r = lagrange.q, len(lagrange.q), len(lagrange.coneqs)
    numbers = _Numbers("lagrange", q, q.diff(mechanics.dynamicsymbols._t), parameters)
    formed = lagrange.mass_matrix, lagrange.forcing_full, lagrange._term4, lagrange._L
    numbers.check(*formed, others=[lagrange._hol_coneqs])
    M, f = numbers(lagrange.mass_matrix[:, :n]), numbers(lagrange.forcing)
    loads, L = numbers(lagrange._term4), numbers(lagrange._L)
    full_mass, full_forcing = numbers(lagrange.mass_matrix_full), numbers(lagrange.forcing_full)
    at_rest = np.zeros(n)

    constraints: dict[str, Any] = {}
    if r:
        a, c = numbers(-lagrange.lam_coeffs), numbers(lagrange.coneqs)
        constraints["a"] = lambda q: a(q, at_rest)
        constraints["c"] = lambda q, v: c(q, v)[:, 0]
        constraints["gamma"] = lambda q, v: -full_forcing(q, v)[2 * n :, 0]
    return EquationsOfMotion(
        n,
        M=lambda q: M(q, at_rest),
        bias=lambda q, v: (loads(q, v) - f(q, v))[:, 0],
        bias_has_gravity=True,
        Q=lambda q, v: loads(q, v)[:, 0],
        qdd=lambda q, v: np.linalg.solve(full_mass(q, v), full_forcing(q, v)[:, 0])[n : 2 * n],
        T=lambda q, v: L(q, v) - L(q, at_rest),
        U=lambda q: -L(q, at_rest),
        derived=True,
        name=name,
        **constraints,
        **{**_names(coordinates=q), **options},
    )


def _names(**symbols: Iterable[Any]) -> dict[str, tuple[str, ...]]:
    """Return the names of SymPy's functions of time, without the time, where they are different."""
    names = {key: tuple(str(x).removesuffix("(t)") for x in each) for key, each in symbols.items()}
    return {key: each for key, each in names.items() if len({*each}) == len(each)}


# ---- Whatever holds equations --------------------------------------------------------------------


def as_equations(subject: Any, parameters: Mapping[Any, float] | None = None) -> EquationsOfMotion:
    """Return the equations of motion of an object.

    Args:
        subject: `EquationsOfMotion`, or a SymPy `KanesMethod` or `LagrangesMethod`.
        parameters: symbol -> number, for a SymPy model.

    Raises:
        InputError: it is none of these, with the call that checks it; or see `from_kane` and
            `from_lagrange`.
    """
    equations = equations_held_by(subject, parameters)
    if equations is None:
        raise InputError(f"subject = {safe_repr(subject)}, {sort_and_call(subject)}")
    return equations


def equations_held_by(
    subject: Any, parameters: Mapping[Any, float] | None = None
) -> EquationsOfMotion | None:
    """Return the equations of motion of an object, see `as_equations`; None if it holds none."""
    if isinstance(subject, EquationsOfMotion):
        return subject
    convert = _converter(subject)
    return None if convert is None else convert(subject, parameters)


def _converter(subject: Any) -> Callable[..., EquationsOfMotion] | None:
    """Return `from_kane` or `from_lagrange` for a SymPy model, None for another object."""
    convert = {"KanesMethod": from_kane, "LagrangesMethod": from_lagrange}
    for kind in type(subject).__mro__:
        # A function of time of SymPy has no module.
        if f"{kind.__module__}".startswith("sympy.") and kind.__name__ in convert:
            return convert[kind.__name__]
    return None


def is_sympy_model(subject: Any) -> bool:
    """Return whether an object is a SymPy `KanesMethod` or `LagrangesMethod`."""
    return _converter(subject) is not None


def drawn_parameters(model: Any, seed: int = 0) -> dict[Any, float]:
    """Return a random number in [0.5, 2] for each symbol that a SymPy model leaves open.

    Args:
        model: a `KanesMethod` or `LagrangesMethod` whose equations are formed.
        seed: seed of the numbers.
    """
    mechanics = required("sympy.physics.mechanics", "sympy")
    kane = isinstance(model, mechanics.KanesMethod)
    try:
        formed = [model.mass_matrix_full, model.forcing_full, *([model._fr] if kane else [])]
    except (AttributeError, TypeError, ValueError):
        return {}  # its converter says that the equations are not formed
    t = mechanics.dynamicsymbols._t
    own = {*model.q, *(model.u if kane else ())}
    rates = {x.diff(t, order) for x in own for order in (1, 2)}
    multipliers = set() if kane else {*model.lam_vec}
    symbols = _symbols(formed) - own - rates - multipliers
    ordered = sorted(symbols, key=str)
    numbers = np.random.default_rng(seed).uniform(0.5, 2.0, len(ordered))
    return {symbol: float(f"{x:.4g}") for symbol, x in zip(ordered, numbers, strict=True)}


def sort_and_call(subject: Any) -> str:
    """Return the sort of an object that holds no equations, and the call that checks it."""
    kind = subject if isinstance(subject, type) else type(subject)
    if issubclass(kind, Scene) and kind is subject:
        return "a scene class: eomcheck.validate and eomcheck.check_state check a scene of it"
    if issubclass(kind, Scene):
        return "a scene: eomcheck.validate checks it in random states, eomcheck.check_state in one"
    if issubclass(kind, Engine):
        return "an engine: eomcheck.validate(scene, engines=[...]) compares it with a scene"
    if isinstance(subject, Mapping):
        return "a dict: of functions call eomcheck.testing.check_functions(n, **functions)"
    if callable(subject):
        return "a single function: call eomcheck.testing.check_functions(n, M=...), or bias=..."
    return (
        "expected EquationsOfMotion, a KanesMethod or LagrangesMethod of SymPy, or the name "
        "FILE.py or FILE.py:NAME of a file with one or with functions"
    )

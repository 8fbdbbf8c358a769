"""Judge engines that compute in float32 at many states: none is called wrong, faults are found.

    python -m tests.trials.float32_engines [--states 2000] [--jobs 2] [--seed 0] [--scene KEY]
        [--engine KEY] [--links 1 5] [--markdown FILE]

The engines are copies of the scene's own equations and quantities, and trees of bodies in the plane
by others, all in real float32 arithmetic: every product and sum is rounded, and, where it is
installed, MJX, which is MuJoCo in JAX (`pip install --no-deps mujoco-mjx trimesh etils`), on scene
classes of few topologies: it compiles each once. At each state the claims about engines are
checked, also for two copies of each engine whose answers are too large by 1e-5 and by 1e-4. Prints
at how many states an answer passed or was inconclusive, of those at which it passed how many find
each fault, and the smallest relative error that any of them finds, which is 32 κ u of that state:
where it is above 1e-5, κ explains that this fault is found nowhere. The exit code is 1 if a right
engine is called wrong, or a fault above the smallest one is found nowhere in the answers of a
method.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import cache
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from tests.trials.progress import Progress, ignore_interrupts

from eomcheck.claims import CLAIMS
from eomcheck.claims import case as cases
from eomcheck.claims.case import ONCE
from eomcheck.claims.finding import Finding
from eomcheck.claims.run import RunSelection, evaluate_claim, make_case, make_scene_engines
from eomcheck.descriptions.random_mechanisms import RANDOM
from eomcheck.draws.pairwise_design import scene_cases, with_wide
from eomcheck.engines import Answers, Engine, EngineAcceleration, VelocityMap
from eomcheck.engines.answers import represents
from eomcheck.engines.mjx import MjxEngine
from eomcheck.evaluation.conformance import QUANTITIES, ConformancePoint, Quantity
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.lab.show.table import ResultTable, print_tables
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Angles
from eomcheck.scenes import SCENES

FAULTS = 1e-5, 1e-4
"""Relative errors of answers that are planted. The smaller is 168 u: the error that rounding
explains is 32 κ u, so that no state with κ above 5 can show it."""

LINKS = 1, 5
"""Smallest and largest number of links of a scene class that has one."""

SIZE = 3
"""Number of links of such a class that MJX compiles."""

METHODS = {
    "mass_matrix": "mass-matrix",
    "bias": "bias",
    "forces": "generalized-forces",
    "constraint_jacobian": "constraint-jacobian",
    "constraint_drift": "constraint-drift",
    "acceleration": "engine-acceleration",
    **{name: f"engine-{name.replace('_', '-')}" for name in QUANTITIES},
}
"""Method of an engine -> claim about it."""


# ---- float32 -------------------------------------------------------------------------------------


class Float32:
    """The arithmetic of float32 (`eomcheck.numbers.generic.Arithmetic`)."""

    def numbers(self, x: Any) -> np.ndarray:
        """Return x as float32."""
        return np.array(x, np.float32, order="C")

    def angles(self, x: Any) -> Angles:
        """Return the angles x (k,) with their cosines and sines."""
        x = self.numbers(x)
        return Angles(x, np.cos(x), np.sin(x))

    def root(self, x: Any) -> np.ndarray:
        """Return the positive square roots of x (k,)."""
        return np.sqrt(self.numbers(x))


FLOAT32 = Float32()


class Copy32(Engine):
    """The scene's own equations and quantities in float32; v̇ and λ by the whole system."""

    unit_roundoff = 2.0**-24
    solves_like = "au"

    def __init__(self, scene: Scene):
        super().__init__(scene)
        self.parameters = scene.parameters(FLOAT32)  # type: ignore[arg-type]

    @classmethod
    def version(cls) -> str:
        """Return its name."""
        return f"{cls.key} {np.__version__}"

    @classmethod
    def represents(cls, scene: Scene) -> bool:
        """Return True."""
        return True

    def position(self, q: np.ndarray) -> np.ndarray:
        """Return the scene's coordinates."""
        return FLOAT32.numbers(q)

    def terms(self, q: np.ndarray, v: np.ndarray, t: float) -> Any:
        """Return the terms, every entry in float32."""
        q, v = self.position(q), FLOAT32.numbers(v)
        clock: Any = np.float32(t)
        with np.errstate(all="ignore"):
            prepared = self.scene.prepare(FLOAT32, self.parameters, q, clock)
            terms = self.scene.terms(self.parameters, prepared, q, v)
        for term in terms:
            assert term is None or term.dtype == np.float32, f"{term.dtype} in float32"
        return terms

    def mass_matrix(self, q, t=0.0):
        return self.terms(q, np.zeros_like(q), t).M

    def bias(self, q, v, t=0.0):
        return self.terms(q, v, t).B

    def forces(self, q, v, t=0.0):
        Q = self.terms(q, v, t).Q
        return np.zeros(len(v), np.float32) if Q is None else Q

    def constraint_jacobian(self, q, v, t=0.0):
        a = self.terms(q, v, t).a
        return np.zeros((0, len(v)), np.float32) if a is None else a

    def constraint_drift(self, q, v, t=0.0):
        gamma = self.terms(q, v, t).gamma
        return np.zeros(self.scene.r, np.float32) if gamma is None else gamma

    def acceleration(self, q, v, Q, a, gamma, t=0.0):
        terms = self.terms(q, v, t)
        M, Q = terms.M, FLOAT32.numbers(Q)
        F = Q if terms.B is None else Q - terms.B
        if a is None:
            return EngineAcceleration(np.linalg.solve(M, F))
        a, gamma, n = FLOAT32.numbers(a), FLOAT32.numbers(gamma), len(M)
        whole = np.block([[M, -a.T], [a, np.zeros((len(a), len(a)), np.float32)]])
        x = np.linalg.solve(whole, np.concatenate([F, -gamma]))
        assert x.dtype == np.float32
        return EngineAcceleration(x[:n], x[n:])

    # ---- Conformance quantities ------------------------------------------------------------------

    def point(self, q, v, vdot=None, tau=None, t=0.0) -> ConformancePoint:
        """Return the quantities of the tree, every number in float32."""
        at = Quantities(self.scene, FLOAT32, self.position(q), np.float32(t))  # type: ignore[arg-type]
        at.v = FLOAT32.numbers(v)
        third = (None if x is None else FLOAT32.numbers(x) for x in (vdot, tau))
        vdot, tau = third
        return ConformancePoint(at, vdot, tau=tau)

    def quantity(self, one: Quantity, *arguments) -> np.ndarray:
        """Return a quantity; the system of constraints of its derivatives is solved in float64."""
        given = dict(zip((*one.arguments, "t"), arguments, strict=True))
        frame = given.pop("f", "")
        given.setdefault("v", np.zeros(self.scene.n))
        with np.errstate(all="ignore"):
            value = np.asarray(one.value(self.point(**given), frame))
        is_solved = one.name == "constraint_force_derivatives"
        if value.dtype == object:
            assert not any(isinstance(x, np.float64) for x in value.flat), f"{one.name} in float64"
        else:
            real32 = value.dtype == np.float32 or not value.any()
            assert is_solved or real32, f"{one.name} in {value.dtype}"
        return value.astype(np.float32)

    def inverse_mass_matrix(self, q, t=0.0):
        return np.linalg.inv(self.mass_matrix(q, t))

    def forward_dynamics(self, q, v, tau, t=0.0):
        rest = self.bias(q, v, t) + self.gravity(q, t)
        return np.linalg.solve(self.mass_matrix(q, t), FLOAT32.numbers(tau) - rest)

    def forward_dynamics_derivatives(self, q, v, tau, t=0.0):
        vdot = self.forward_dynamics(q, v, tau, t)
        by_state: Any = self.inverse_dynamics_derivatives(q, v, vdot, t)
        unit = np.eye(len(v), dtype=np.float32)
        return np.linalg.solve(self.mass_matrix(q, t), np.hstack((-by_state, unit)))


def _quantity_method(one: Quantity) -> Any:
    """Return the method of an engine for a quantity of the table."""
    return lambda self, *arguments: self.quantity(one, *arguments)


for _one in QUANTITIES.values():
    if _one.name not in vars(Copy32):
        setattr(Copy32, _one.name, _quantity_method(_one))


class HalfAngles32(Copy32):
    """The same with coordinates of its own: cosine and sine of half of each angle.

    These are rounded relative to 1, also where an angle is almost 0.
    """

    @classmethod
    def represents(cls, scene):
        """Return whether the scene names angles, and is the same after a full turn of any."""
        named, tree = range(scene.n)[scene.angle_coordinates], scene.tree()
        springs = (getattr(scene, name, None) for name in ("stiffness", "spring"))
        follows = tree is not None and bool((tree.coordinates % 1.0).any())
        return len(named) > 0 and all(x is None for x in springs) and not follows

    def velocity_map(self, q, v):
        angles = q[self.scene.angle_coordinates] / 2.0
        others = np.delete(q, np.arange(len(q))[self.scene.angle_coordinates])
        x = np.concatenate([others, np.cos(angles), np.sin(angles)])
        return VelocityMap(x, np.eye(len(q)), np.zeros(len(q)))

    def position(self, q):
        x, named = FLOAT32.numbers(q), np.arange(self.scene.n)[self.scene.angle_coordinates]
        others = np.delete(np.arange(self.scene.n), named)
        position, k = np.zeros(self.scene.n, np.float32), len(named)
        position[others], cos, sin = x[: len(others)], x[len(others) : -k], x[-k:]
        position[named] = np.float32(2.0) * np.arctan2(sin, cos)
        return position

    def mass_matrix(self, q, t=0.0):
        return self.terms(q, np.zeros(self.scene.n), t).M


class Planar32(Engine):
    """Bodies on a tree of joints in the plane, by joint coordinates x = T q + shift, in float32."""

    unit_roundoff = 2.0**-24
    reads_parameters = False
    solves_like = "au"

    def __init__(self, scene: Scene):
        super().__init__(scene)
        tree = scene.tree()
        assert tree is not None
        self.tree = tree._replace(
            **{
                name: FLOAT32.numbers(getattr(tree, name))
                for name in ("rotation", "offset", "mass", "center", "inertia", "armature")
            }
        )

    @classmethod
    def version(cls):
        return f"{cls.key} {np.__version__}"

    @classmethod
    def represents(cls, scene):
        tree = scene.tree()
        if tree is None or not {"px", "py", "rz"}.issuperset(tree.joint):
            return False
        z = tree.rotation[:, 2]
        return bool((z[:, 2] > 0).all()) and not z[:, :2].any()

    def velocity_map(self, q, v):
        T = self.tree.coordinates
        return VelocityMap(T @ q + self.tree.shift, T, np.zeros(len(T)))

    def bodies(self, x: np.ndarray, w: np.ndarray) -> Iterator[tuple]:
        """Yield mass, inertia, J (2, n) of the centre, J̇ w (2,), and ω as spin @ w, by body."""
        tree, x, w = self.tree, FLOAT32.numbers(x), FLOAT32.numbers(w)
        n = len(w)
        unit = np.eye(n, dtype=np.float32)
        ground = np.eye(2), np.zeros((2, n)), np.zeros(2), np.zeros(n)
        placed = {-1: tuple(map(FLOAT32.numbers, ground))}
        for j, (parent, kind) in enumerate(zip(tree.parent, tree.joint, strict=True)):
            R, J, rest, spin = placed[parent]
            J, rest = _shifted(J, rest, spin, w, R @ tree.offset[j][:2])
            R = R @ tree.rotation[j][:2, :2]
            if kind == "rz":
                c, s = np.cos(x[j]), np.sin(x[j])
                R, spin = R @ np.array([[c, -s], [s, c]]), spin + unit[j]
            else:
                axis = R[:, "xy".index(kind[1])]
                J, rest = _shifted(J, rest, spin, w, x[j] * axis)
                J = J + np.outer(axis, unit[j])
                rest = rest + np.float32(2.0) * (spin @ w) * w[j] * _across(axis)
            placed[j] = R, J, rest, spin
            J, rest = _shifted(J, rest, spin, w, R @ tree.center[j][:2])
            assert J.dtype == rest.dtype == np.float32
            yield tree.mass[j], tree.inertia[j][2, 2], J, rest, spin

    def mass_matrix(self, q, t=0.0):
        bodies = self.bodies(q, np.zeros(len(q)))
        M: Any = sum(m * J.T @ J + i * np.outer(spin, spin) for m, i, J, _, spin in bodies)
        return M + np.diag(self.tree.armature)

    def bias(self, q, v, t=0.0):
        B: Any = sum(m * J.T @ rest for m, _, J, rest, _ in self.bodies(q, v))
        return B

    def acceleration(self, q, v, Q, a, gamma, t=0.0):
        T, Q = FLOAT32.numbers(self.tree.coordinates), FLOAT32.numbers(Q)
        M, F = T.T @ self.mass_matrix(q, t) @ T, T.T @ (Q - self.bias(q, v, t))
        if a is None:
            return EngineAcceleration(T @ np.linalg.solve(M, F))
        a, n = FLOAT32.numbers(a) @ T, len(M)
        whole = np.block([[M, -a.T], [a, np.zeros((len(a), len(a)), np.float32)]])
        x = np.linalg.solve(whole, np.concatenate([F, -FLOAT32.numbers(gamma)]))
        return EngineAcceleration(T @ x[:n], x[n:])


def _across(arm: np.ndarray) -> np.ndarray:
    return np.array([-arm[1], arm[0]])


def _shifted(
    J: np.ndarray, rest: np.ndarray, spin: np.ndarray, w: np.ndarray, arm: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return J and J̇ w of the point that is `arm` away on the same body."""
    return J + np.outer(_across(arm), spin), rest - (spin @ w) ** 2 * arm


class Mjx32(MjxEngine):
    """MuJoCo's model of a scene in MJX, where it is installed."""

    installed = bool(find_spec("mujoco")) and find_spec("mujoco.mjx") is not None

    @classmethod
    def represents(cls, scene: Scene) -> bool:
        """Return whether it compiles the topology for many states."""
        few = type(scene) in SCENES.values() and getattr(scene, "links", SIZE) == SIZE
        return cls.installed and few and super().represents(scene)


ENGINES: tuple[type[Engine], ...] = (Copy32, HalfAngles32, Planar32, Mjx32)


# ---- Faults --------------------------------------------------------------------------------------

KNOWN: dict[Any, Any] = {}
"""Right engines at one state by their class, and their answers by class, method and arguments."""

RIGHT = 0.0


@cache
def with_fault(kind: type[Engine], fault: float) -> type[Engine]:
    """Return the engine whose every answer is too large by a relative error, in float32.

    An answer is computed once, for all faults of an engine, `RIGHT` among them.
    """
    factor = np.float32(1.0 + fault)

    def answered(method: str, self: Any, *arguments: Any) -> Any:
        parts = (x.tobytes() if isinstance(x, np.ndarray) else x for x in arguments)
        key = kind, method, *parts
        if key not in KNOWN:
            KNOWN[key] = getattr(kind, method)(self, *arguments)
        result = KNOWN[key]
        if method == "acceleration":
            return EngineAcceleration(result.vdot * factor, result.multipliers)
        return tuple(x * factor for x in result) if isinstance(result, tuple) else result * factor

    def made(self: Any, scene: Scene) -> None:
        if kind not in KNOWN:
            KNOWN[kind] = kind(scene)
        vars(self).update(vars(KNOWN[kind]))

    members = {name: partialmethod_of(answered, name) for name in METHODS if kind.offers(name)}
    version = kind.version()  # looked up once
    members |= {"__init__": made, "version": classmethod(lambda _: version)}
    name = f"{kind.key}_{FAULTS.index(fault)}" if fault else kind.key
    return type(f"{kind.__name__}Wrong", (kind,), {"key": name, **members})


def partialmethod_of(function: Any, name: str) -> Any:
    """Return the method that calls `function` with its name first."""
    return lambda self, *arguments: function(name, self, *arguments)


@contextmanager
def asked_once() -> Iterator[None]:
    """Leave out what is no subject here: results that engines keep, and which part is wrong."""
    with ExitStack() as stack:
        for name in ("provoke_stale_answers", "ask_elsewhere"):
            stack.enter_context(patch.object(Answers, name, lambda *_: None))
        stack.enter_context(patch.object(cases, "map_fault", lambda *_: ""))
        yield


# ---- States --------------------------------------------------------------------------------------


KINDS: dict[str, type[Scene]] = {**SCENES, **RANDOM}
"""Key -> scene class; those of random mechanisms have another topology at every state."""


class Judged(NamedTuple):
    """Verdicts about an engine at one state, by method."""

    engine: str
    verdicts: dict[str, str]
    found: dict[str, list[bool]]
    """Whether each fault is found, where the right engine passed."""
    smallest: dict[str, float]
    """The smallest relative error of the answer that is found: that planted, per observed error,
    times the allowed one."""
    alarms: list[str]
    ratio: float
    """The largest observed / allowed error."""


def drawn(
    key: str, count: int, seed: int, links: tuple[int, int] = LINKS
) -> list[tuple[Scene, State]]:
    """Return `count` random scenes of a class, each in one state, every other of them wide."""
    cases = with_wide(scene_cases(KINDS[key], links, count, seed), seed)
    return list(islice(cases, count))


def judged(
    key: str,
    count: int,
    seed: int,
    engines: tuple[str, ...] = (),
    links: tuple[int, int] = LINKS,
) -> list[Judged]:
    """Return the verdicts about engines with these keys, or all, at states of a scene class."""
    kinds = [kind for kind in ENGINES if kind.key in engines or not engines]
    cases = drawn(key, count, seed, links)
    return [result for scene, state in cases for result in judged_at(scene, state, kinds)]


def judged_at(
    scene: Scene, state: State, kinds: Sequence[type[Engine]] = ENGINES
) -> Iterator[Judged]:
    """Yield the verdicts of each engine at a state, with those of its faulty copies.

    Each answer is computed once: whether results are kept between calls is tried elsewhere.
    """
    right = [kind for kind in kinds if represents(kind, scene)]
    everyone = [with_fault(kind, fault) for kind in right for fault in (RIGHT, *FAULTS)]
    if not right:
        return
    KNOWN.clear()
    selection = RunSelection.of(None, everyone, METHODS.values(), scenes=[scene])
    scene_engines = make_scene_engines(scene, selection)
    case = make_case(scene_engines, state, selection, ONCE)
    with asked_once():
        findings = {
            method: evaluate_claim(scene_engines, case, CLAIMS[claim])
            for method, claim in METHODS.items()
        }
    for kind in right:
        verdicts, found, smallest, alarms, ratio = {}, {}, {}, [], 0.0
        for method, among in findings.items():
            if not kind.offers(method) or (kind.key, scene.key, method) in UNTRIED:
                continue
            own, *wrong = (
                [f for f in among if f.engine is with_fault(kind, fault)]
                for fault in (RIGHT, *FAULTS)
            )
            verdicts[method] = verdict = _worst(own)
            passed = (f for f in own if f.verdict == "passed" and f.allowed > 0.0)
            ratio = max([ratio, *(f.observed / f.allowed for f in passed)])
            alarms += [f"{f} {scene!r} {state!r}" for f in own if f.verdict == "failed"]
            if verdict == "passed":
                found[method] = [any(f.verdict == "failed" for f in each) for each in wrong]
                errors = (f for f in wrong[-1] if f.observed > 0.0)
                least = (FAULTS[-1] * f.allowed / f.observed for f in errors)
                smallest[method] = min(least, default=np.inf)
        yield Judged(kind.key, verdicts, found, smallest, alarms, ratio)


UNTRIED = {
    (Copy32.key, "andrews", name)
    for name in (
        "inverse_dynamics_derivatives",
        "forward_dynamics_derivatives",
        "constraint_force_derivatives",
    )
}
"""Engine, scene and methods that are not tried: a float32 among objects is no Python number, and
the description of Andrews' mechanism omits terms where numbers are 0."""


def _worst(findings: list[Finding]) -> str:
    """Return the verdict of findings of one claim; "absent" of a term that neither side has."""
    verdicts = [f.verdict for f in findings]
    return next((x for x in ("failed", "inconclusive", "passed") if x in verdicts), "absent")


BATCH = 20
"""Number of states of one task."""


def table(
    counts: dict[tuple[str, str], Counter[Any]], smallest: dict[tuple[str, str], float]
) -> ResultTable:
    """Return the numbers of states by engine and method, and the smallest error that is found."""
    verdicts = "passed", "inconclusive", "failed"
    counted = *verdicts, *FAULTS
    rows = [
        [*pair, *(str(counter[x]) for x in counted), f"{smallest[pair]:.1e}"]
        for pair, counter in counts.items()
        if counter["passed"] or counter["inconclusive"] or counter["failed"]
    ]
    columns = ["engine", "method", *verdicts, *(f"{x:g} found" for x in FAULTS), "smallest found"]
    return ResultTable("float32-engines", "Engines in float32", columns, rows)


def main() -> int:
    """Judge the engines, print the table and the false alarms, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--states", type=int, default=2000, help="of all scene classes together")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scene", action="append", choices=list(KINDS))
    parser.add_argument("--engine", action="append", choices=[kind.key for kind in ENGINES])
    parser.add_argument("--links", type=int, nargs=2, default=LINKS, help="fewest and most")
    parser.add_argument("--markdown", type=Path, help="write the table to this file too")
    options = parser.parse_args()
    keys, engines = options.scene or list(KINDS), tuple(options.engine or ())
    each = -(-options.states // len(keys))
    tasks = [
        (key, min(BATCH, each - first), options.seed + first, engines, tuple(options.links))
        for key in keys
        for first in range(0, each, BATCH)
    ]
    pairs = [(kind.key, name) for kind in ENGINES for name in METHODS if kind.offers(name)]
    counts: dict[tuple[str, str], Counter[Any]] = {pair: Counter() for pair in pairs}
    smallest = dict.fromkeys(pairs, np.inf)
    states, alarms, ratio = Counter[str](), 0, 0.0
    pool = ProcessPoolExecutor(options.jobs, initializer=ignore_interrupts)
    with pool, Progress(len(tasks)) as progress:
        for results in progress.of(pool.map(judged, *zip(*tasks, strict=True))):
            for result in results:
                states[result.engine] += 1
                ratio = max(ratio, result.ratio)
                for method, verdict in result.verdicts.items():
                    counts[result.engine, method][verdict] += 1
                for method, found in result.found.items():
                    pair = result.engine, method
                    smallest[pair] = min(smallest[pair], result.smallest[method])
                    counts[pair].update(
                        fault for fault, is_found in zip(FAULTS, found, strict=True) if is_found
                    )
                for alarm in result.alarms:
                    print(alarm, flush=True)
                alarms += len(result.alarms)
    sheet = table(counts, smallest)
    print_tables([sheet])
    if options.markdown is not None:
        options.markdown.write_text(sheet.markdown(), encoding="utf-8")
    if not Mjx32.installed:
        print("MJX is not installed and is skipped")
    each_engine = ", ".join(f"{key} {count}" for key, count in states.items())
    print(f"states: {each_engine}")
    print(f"{alarms} false alarms, largest error {ratio:.1%} of the allowed one")
    unseen = [
        f"{fault:g} in {' '.join(pair)}"
        for pair in pairs
        for fault in FAULTS
        if counts[pair]["passed"] and not counts[pair][fault] and smallest[pair] < fault
    ]
    if unseen:
        print(f"found nowhere, though less is allowed: {', '.join(unseen)}")
    nothing = not any(counter[FAULTS[0]] for counter in counts.values())
    return 130 if progress.interrupted else int(alarms > 0 or bool(unseen) or nothing)


if __name__ == "__main__":
    raise SystemExit(main())

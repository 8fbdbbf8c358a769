"""Judge engines that compute in float32 at many states: none is called wrong, faults are found.

    python -m tests.trials.float32_engines [--states 2000] [--jobs 2] [--seed 0] [--scene KEY]
        [--markdown FILE]

The engines are copies of the scene's own equations, and trees of bodies in the plane by others,
all in real float32 arithmetic: every product and sum is rounded, and, where it is installed, MJX,
which is MuJoCo in JAX (`pip install --no-deps mujoco-mjx trimesh etils`), on scene classes: it
compiles each number of links once. At each state the claims about engines are checked, also for two
copies of each engine whose answers are too large by 1e-5 and by 1e-4. Prints at how many states an
answer passed or was inconclusive, and of those at which it passed how many find each fault. The
exit code is 1 if a right engine is called wrong, or a fault of 1e-4 is found nowhere in the answers
of a method, or one of 1e-5 nowhere at all.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tests.trials.progress import Progress, ignore_interrupts

from eomcheck.claims import CLAIMS
from eomcheck.claims.case import ONCE
from eomcheck.claims.finding import Finding
from eomcheck.claims.run import RunSelection, evaluate_claim, make_case, make_scene_engines
from eomcheck.descriptions.random_mechanisms import RANDOM
from eomcheck.draws.pairwise_design import scene_cases, with_wide
from eomcheck.engines import Engine, EngineAcceleration, VelocityMap
from eomcheck.engines.answers import represents
from eomcheck.engines.mjx import MjxEngine
from eomcheck.lab.show.table import ResultTable, print_tables
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Angles
from eomcheck.scenes import SCENES

FAULTS = 1e-5, 1e-4
"""Relative errors of answers that are planted. The smaller is 168 u: the error that rounding
explains is 32 κ u, so that no state with κ above 5 can show it. B is of degree 1 in masses, 2 in
lengths and 2 in velocities: its κ is 5 and more but where these parts cancel, in every state."""

LINKS = 1, 5
"""Smallest and largest number of links of a scene class that has one."""

METHODS = {
    "mass_matrix": "mass-matrix",
    "bias": "bias",
    "forces": "generalized-forces",
    "constraint_jacobian": "constraint-jacobian",
    "constraint_drift": "constraint-drift",
    "acceleration": "engine-acceleration",
    "center_of_mass": "engine-center-of-mass",
    "frame_jacobian": "engine-frame-jacobian",
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
    """The scene's own equations in float32; v̇ and λ by the whole system."""

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
        """Return whether it compiles the topology for more than one state."""
        return cls.installed and type(scene) in SCENES.values() and super().represents(scene)


ENGINES: tuple[type[Engine], ...] = (Copy32, HalfAngles32, Planar32, Mjx32)


# ---- Faults --------------------------------------------------------------------------------------


@cache
def faulty(kind: type[Engine], fault: float) -> type[Engine]:
    """Return the engine whose every answer is too large by a relative error, in float32."""
    factor = np.float32(1.0 + fault)

    def made(self, scene: Scene) -> None:
        self.right = kind(scene)
        vars(self).update(vars(self.right))

    def answered(method: str, self: Any, *arguments: Any) -> Any:
        result = getattr(self.right, method)(*arguments)
        if method == "acceleration":
            return EngineAcceleration(result.vdot * factor, result.multipliers)
        return result * factor

    wrong = {name: partialmethod_of(answered, name) for name in METHODS if kind.offers(name)}
    members = {"__init__": made, "key": f"{kind.key}_{FAULTS.index(fault)}", **wrong}
    return type(f"{kind.__name__}Wrong", (kind,), members)


def partialmethod_of(function: Any, name: str) -> Any:
    """Return the method that calls `function` with its name first."""
    return lambda self, *arguments: function(name, self, *arguments)


# ---- States --------------------------------------------------------------------------------------


KINDS: dict[str, type[Scene]] = {**SCENES, **RANDOM}
"""Key -> scene class; those of random mechanisms have another topology at every state."""


class Judged(NamedTuple):
    """Verdicts about an engine at one state, by method."""

    engine: str
    verdicts: dict[str, str]
    found: dict[str, list[bool]]
    """Whether each fault is found, where the right engine passed."""
    alarms: list[str]
    ratio: float
    """The largest observed / allowed error."""


def drawn(key: str, count: int, seed: int) -> list[tuple[Scene, State]]:
    """Return `count` random scenes of a class, each in one state, every other of them wide."""
    cases = with_wide(scene_cases(KINDS[key], LINKS, count, seed), seed)
    return list(islice(cases, count))


def judged(key: str, count: int, seed: int) -> list[Judged]:
    """Return the verdicts about every engine at states of a scene class."""
    cases = drawn(key, count, seed)
    return [result for scene, state in cases for result in judged_at(scene, state)]


def judged_at(scene: Scene, state: State) -> Iterator[Judged]:
    """Yield the verdicts of each engine at a state, with those of its faulty copy."""
    right = [kind for kind in ENGINES if represents(kind, scene)]
    everyone = [*right, *(faulty(kind, fault) for kind in right for fault in FAULTS)]
    selection = RunSelection.of(None, everyone, METHODS.values(), scenes=[scene])
    scene_engines = make_scene_engines(scene, selection)
    case = make_case(scene_engines, state, selection, ONCE)
    findings = {
        method: evaluate_claim(scene_engines, case, CLAIMS[claim])
        for method, claim in METHODS.items()
    }
    for kind in right:
        verdicts, found, alarms, ratio = {}, {}, [], 0.0
        for method, among in findings.items():
            if not kind.offers(method):
                continue
            own = [f for f in among if f.engine is kind]
            verdicts[method] = verdict = _worst(own)
            passed = (f for f in own if f.verdict == "passed" and f.allowed > 0.0)
            ratio = max([ratio, *(f.observed / f.allowed for f in passed)])
            alarms += [f"{f} {scene!r} {state!r}" for f in own if f.verdict == "failed"]
            if verdict == "passed":
                found[method] = [
                    any(f.verdict == "failed" and f.engine is faulty(kind, fault) for f in among)
                    for fault in FAULTS
                ]
        yield Judged(kind.key, verdicts, found, alarms, ratio)


def _worst(findings: list[Finding]) -> str:
    """Return the verdict of findings of one claim; "absent" of a term that neither side has."""
    verdicts = [f.verdict for f in findings]
    return next((x for x in ("failed", "inconclusive", "passed") if x in verdicts), "absent")


BATCH = 20
"""Number of states of one task."""


def table(counts: dict[tuple[str, str], Counter[Any]]) -> ResultTable:
    """Return the numbers of states by engine and method."""
    verdicts = "passed", "inconclusive", "failed"
    counted = *verdicts, *FAULTS
    rows = [[*pair, *(str(counter[x]) for x in counted)] for pair, counter in counts.items()]
    columns = ["engine", "method", *verdicts, *(f"{x:g} found" for x in FAULTS)]
    return ResultTable("float32-engines", "Engines in float32", columns, rows)


def main() -> int:
    """Judge the engines, print the table and the false alarms, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--states", type=int, default=2000, help="of all scene classes together")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scene", action="append", choices=list(KINDS))
    parser.add_argument("--markdown", type=Path, help="write the table to this file too")
    options = parser.parse_args()
    keys = options.scene or list(KINDS)
    each = -(-options.states // len(keys))
    tasks = [
        (key, min(BATCH, each - first), options.seed + first)
        for key in keys
        for first in range(0, each, BATCH)
    ]
    pairs = [(kind.key, name) for kind in ENGINES for name in METHODS if kind.offers(name)]
    counts: dict[tuple[str, str], Counter[Any]] = {pair: Counter() for pair in pairs}
    states, alarms, ratio = 0, 0, 0.0
    pool = ProcessPoolExecutor(options.jobs, initializer=ignore_interrupts)
    with pool, Progress(len(tasks)) as progress:
        for results in progress.of(pool.map(judged, *zip(*tasks, strict=True))):
            states += sum(result.engine == Copy32.key for result in results)
            for result in results:
                ratio = max(ratio, result.ratio)
                for method, verdict in result.verdicts.items():
                    counts[result.engine, method][verdict] += 1
                for method, found in result.found.items():
                    counts[result.engine, method].update(
                        fault for fault, is_found in zip(FAULTS, found, strict=True) if is_found
                    )
                for alarm in result.alarms:
                    print(alarm, flush=True)
                alarms += len(result.alarms)
    sheet = table(counts)
    print_tables([sheet])
    if options.markdown is not None:
        options.markdown.write_text(sheet.markdown(), encoding="utf-8")
    if not Mjx32.installed:
        print("MJX is not installed and is skipped")
    print(f"{states} states, {alarms} false alarms, largest error {ratio:.1%} of the allowed one")
    judgeable = [pair for pair in pairs if counts[pair]["passed"]]
    unseen = [" ".join(pair) for pair in judgeable if not counts[pair][FAULTS[1]]]
    if unseen:
        print(f"{FAULTS[1]:g} is found nowhere in {', '.join(unseen)}")
    none = not any(counter[FAULTS[0]] for counter in counts.values())
    return 130 if progress.interrupted else int(alarms > 0 or bool(unseen) or none)


if __name__ == "__main__":
    raise SystemExit(main())

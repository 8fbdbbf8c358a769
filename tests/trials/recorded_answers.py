"""Judge recorded answers of Pinocchio, right ones and with planted faults, printed with few digits.

    python -m tests.trials.recorded_answers [--states 1000] [--robot FILE] [--seed 0]
        [--markdown FILE]

States of a robot are written, Pinocchio answers, and its numbers are printed with 4, 7 and 17
digits. Right answers must pass. Answers about the robot on a free base, and logs of motions of it
that integrators wrote, are judged likewise. Each fault changes the answers as another program
might: another convention, a term that is missing, one wrong entry, the row before. Prints which are
named, or "too few digits" where the change is smaller than what is printed, which must not fail
then. The exit code is 1 if right answers fail, or a fault that the digits show is not named.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import pinocchio
from tests.scenes.test_public_robots import found

from eomcheck.evaluation.conformance import ConformancePoint
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab.recorded_answers import check_answers, state_columns, write_states
from eomcheck.lab.recorded_base import BASE_COLUMNS, CONVENTIONS, twist_names, velocity_map
from eomcheck.lab.recorded_log import check_recorded
from eomcheck.lab.recorded_table import open_table
from eomcheck.lab.show.table import ResultTable, print_tables
from eomcheck.mechanics.scene import Scene
from eomcheck.scene_lookup import scene_named

FORMATS = ("%.4g", "%.7g", "%.17g")
"""Formats in which answers are printed."""

Answers = dict[str, Any]


class Model:
    """Pinocchio's model of a robot, and its answers at a state.

    Args:
        path: the URDF.
        tool: name of a frame.
    """

    def __init__(self, path: str, tool: str):
        self.model = pinocchio.buildModelFromUrdf(path)
        self.data, self.tool = self.model.createData(), tool

    def __call__(self, q: Any, v: Any, vdot: Any) -> Answers:
        """Return the answers by name of the quantity."""
        model, data = self.model, self.data
        M = pinocchio.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        gravity = np.array(pinocchio.computeGeneralizedGravity(model, data, q))
        bias = pinocchio.rnea(model, data, q, v, 0.0 * v) - gravity
        frame = model.getFrameId(self.tool)
        axes = pinocchio.LOCAL_WORLD_ALIGNED
        J = np.array(pinocchio.computeFrameJacobian(model, data, q, frame, axes))
        return {
            "M": M,
            "bias": bias,
            "gravity": gravity,
            "tau": np.array(pinocchio.rnea(model, data, q, v, vdot)),
            "qdd": np.array(pinocchio.aba(model, data, q, v, 0.0 * v)),
            "kinetic_energy": np.array(pinocchio.computeKineticEnergy(model, data, q, v)),
            "com": np.array(pinocchio.centerOfMass(model, data, q)),
            f"J[{self.tool}]": J,
        }

    def rotation(self) -> Any:
        """Return the axes of the tool, after its Jacobian was computed."""
        return np.array(self.data.oMf[self.model.getFrameId(self.tool)].rotation)


class Fault(NamedTuple):
    """A fault of recorded answers.

    Attributes:
        id: its name.
        says: words of the finding, alternatives with "|" between them.
        answer: function of (model, q, v, v̇, row, answers of the row before) -> answers.
    """

    id: str
    says: str
    answer: Callable[..., Answers]


def _changed(name: str, change: Callable[[Any], Any]) -> Callable[..., Answers]:
    """Return the answers with one of them changed."""

    def answer(model: Model, q: Any, v: Any, vdot: Any, row: int, before: Any) -> Answers:
        right = model(q, v, vdot)
        key = next(one for one in right if one.partition("[")[0] == name)
        return right | {key: change(right[key].copy())}

    return answer


def _at_state(change: Callable[[Any, Any], tuple[Any, Any]], order: Any = None) -> Callable:
    """Return the answers at another state; of vectors and matrices in another order."""

    def answer(model: Model, q: Any, v: Any, vdot: Any, row: int, before: Any) -> Answers:
        return model(*change(q, v), vdot)

    return answer


def _with(name: str, change: Callable[[Answers], Any]) -> Callable[..., Answers]:
    """Return the answers with one that is made from all of them."""

    def answer(model: Model, q: Any, v: Any, vdot: Any, row: int, before: Any) -> Answers:
        right = model(q, v, vdot)
        return right | {name: change(right)}

    return answer


def _stale(model: Model, q: Any, v: Any, vdot: Any, row: int, before: Any) -> Answers:
    right = model(q, v, vdot)
    return right | {"M": before["M"]} if row % 7 == 3 and before else right


def _local_axes(model: Model, q: Any, v: Any, vdot: Any, row: int, before: Any) -> Answers:
    right = model(q, v, vdot)
    key = f"J[{model.tool}]"
    return right | {key: np.kron(np.eye(2), model.rotation().T) @ right[key]}


def _entry(i: int, j: int, change: Callable[[float], float]) -> Callable[[Any], Any]:
    def changed(M: Any) -> Any:
        M[i, j] = change(M[i, j])
        return M

    return changed


def _row(i: int, change: Callable[[float], float]) -> Callable[[Any], Any]:
    def changed(x: Any) -> Any:
        x[i] = change(x[i])
        return x

    return changed


class FloatingModel(Model):
    """Pinocchio's model of a robot with a free base, whose twist has a convention.

    Args:
        path: the URDF.
        tool: name of a frame.
        convention: a key of `CONVENTIONS`.
    """

    def __init__(self, path: str, tool: str, convention: str):
        self.model = pinocchio.buildModelFromUrdf(path, pinocchio.JointModelFreeFlyer())
        self.data, self.tool = self.model.createData(), tool
        self.convention = CONVENTIONS[convention]

    def at(self, pose: Any, joints: Any, w: Any, wdot: Any) -> Answers:
        """Return the answers at position and quaternion w, x, y, z, with twist and rates.

        Pinocchio's twist is along the axes of the base, linear first: w = T (its own).
        """
        q = np.concatenate((pose[:3], np.roll(pose[3:], -1), joints))
        rotation = pinocchio.Quaternion(q[3:7]).matrix()
        n = self.model.nv
        T, spin = np.eye(n), np.zeros(n)
        if self.convention.linear == "ground":
            T[:3, :3] = rotation
        if self.convention.angular == "ground":
            T[3:6, 3:6] = rotation
        order = [3, 4, 5, 0, 1, 2] if self.convention.turns_first else range(6)
        T = T[[*order, *range(6, n)]]
        v = np.linalg.solve(T, w)
        if self.convention.linear == "ground":
            spin[:3] = np.cross(v[3:6], v[:3])  # of axes that turn
        back = np.linalg.inv(T)
        right = Model.__call__(self, q, v, back @ wdot - spin)
        weight, self.model.gravity.linear[:] = self.model.gravity.linear.copy(), 0.0
        still = back.T @ pinocchio.rnea(self.model, self.data, q, v, -spin)
        self.model.gravity.linear[:] = weight
        C = np.array(pinocchio.computeCoriolisMatrix(self.model, self.data, q, v))
        key = f"J[{self.tool}]"
        M = back.T @ right["M"] @ back
        return right | {
            "M": M,
            "bias": still,
            "gravity": back.T @ right["gravity"],
            "tau": back.T @ right["tau"],
            "qdd": T @ (right["qdd"] + spin),
            key: right[key] @ back,
            "C": back.T @ C @ back if not spin.any() else np.outer(still, w) / (w @ w),
        }


class FloatingFault(NamedTuple):
    """A fault of recorded answers about a free base.

    Attributes:
        id: its name.
        says: words of the finding, alternatives with "|" between them.
        change: function of (answers, pose, w) -> answers.
        state: function of (pose, w) -> pose and w as the program understood them.
        convention: that in which the program answers, "" for that of the header.
    """

    id: str
    says: str
    change: Callable[[Answers], Answers] = lambda x: x
    state: Callable[[Any, Any], Any] = lambda pose, w: (pose, w)
    convention: str = ""


def _other(name: str, change: Callable[[Any], Any]) -> Callable[[Answers], Answers]:
    return lambda answers: answers | {name: change(answers[name].copy())}


DEGREE = np.pi / 180.0
SWAP = [1, 0, 2, 3, 4, 5]
FAULTS: tuple[Fault, ...] = (
    Fault("M-one-entry-sign", "wrong sign", _changed("M", _entry(1, 2, lambda x: -x))),
    Fault("M-one-entry-half", "half", _changed("M", _entry(2, 1, lambda x: x / 2))),
    Fault("M-one-entry-missing", "missing", _changed("M", _entry(0, 1, lambda x: 0.0 * x))),
    Fault("M-upper-triangle-only", "triangle", _changed("M", np.triu)),
    Fault("M-lower-triangle-only", "triangle", _changed("M", np.tril)),
    Fault("M-twice", "twice|double", _changed("M", lambda M: 2 * M)),
    Fault("M-inverse", "M", _changed("M", np.linalg.inv)),
    Fault("M-diagonal-off", "M, ", _changed("M", _entry(1, 1, lambda x: x + 0.3))),
    Fault("M-order-reversed", "order", _changed("M", lambda M: M[::-1, ::-1])),
    Fault("M-two-joints-exchanged", "order", _changed("M", lambda M: M[SWAP][:, SWAP])),
    Fault("M-in-grams", "1000|unit", _changed("M", lambda M: 1000 * M)),
    Fault("M-stale", "stale", _stale),
    Fault("bias-sign", "wrong sign", _changed("bias", lambda x: -x)),
    Fault("bias-half", "half", _changed("bias", lambda x: x / 2)),
    Fault("bias-twice", "twice|double", _changed("bias", lambda x: 2 * x)),
    Fault("bias-one-row", "row", _changed("bias", _row(2, lambda x: -x))),
    Fault("bias-missing", "missing", _changed("bias", lambda x: 0.0 * x)),
    Fault(
        "bias-with-gravity", "with gravity in it", _with("bias", lambda x: x["bias"] + x["gravity"])
    ),
    Fault(
        "bias-with-gravity-of-the-other-sign",
        "gravity of the wrong sign",
        _with("bias", lambda x: x["bias"] - x["gravity"]),
    ),
    Fault("bias-reversed", "order", _changed("bias", lambda x: x[::-1])),
    Fault("gravity-sign", "wrong sign", _changed("gravity", lambda x: -x)),
    Fault("gravity-9.8", "gravity", _changed("gravity", lambda x: x * 9.8 / 9.81)),
    Fault("gravity-missing", "missing", _changed("gravity", lambda x: 0.0 * x)),
    Fault("gravity-one-row", "row", _changed("gravity", _row(1, lambda x: -x))),
    Fault("gravity-in-degrees", "degree|unit|180", _changed("gravity", lambda x: x * DEGREE)),
    Fault(
        "tau-without-gravity", "without gravity", _with("tau", lambda x: x["tau"] - x["gravity"])
    ),
    Fault("tau-gravity-sign", "gravity", _with("tau", lambda x: x["tau"] - 2 * x["gravity"])),
    Fault("tau-without-bias", "without the bias", _with("tau", lambda x: x["tau"] - x["bias"])),
    Fault("tau-sign", "wrong sign", _changed("tau", lambda x: -x)),
    Fault("qdd-sign", "wrong sign", _changed("qdd", lambda x: -x)),
    Fault(
        "qdd-without-gravity",
        "without gravity",
        _with("qdd", lambda x: -np.linalg.solve(x["M"], x["bias"])),
    ),
    Fault(
        "qdd-without-bias",
        "without the bias|gravity alone",
        _with("qdd", lambda x: -np.linalg.solve(x["M"], x["gravity"])),
    ),
    Fault("energy-twice", "twice|double", _changed("kinetic_energy", lambda x: 2 * x)),
    Fault("com-in-mm", "1000|unit", _changed("com", lambda x: 1000 * x)),
    Fault("com-axes-exchanged", "x and y exchanged", _changed("com", lambda x: x[[1, 0, 2]])),
    Fault("J-angular-first", "angular", _changed("J", lambda J: J[[3, 4, 5, 0, 1, 2]])),
    Fault("J-own-axes", "own axes", _local_axes),
    Fault("J-one-row", "row", _changed("J", _row(5, lambda x: -x))),
    Fault("J-order-reversed", "order", _changed("J", lambda J: J[:, ::-1])),
    Fault("q-degrees", "degrees", _at_state(lambda q, v: (q * DEGREE, v))),
    Fault("q-and-v-degrees", "degrees", _at_state(lambda q, v: (q * DEGREE, v * DEGREE))),
    Fault("q-radians-for-degrees", "degrees", _at_state(lambda q, v: (q / DEGREE, v))),
    Fault("q-other-sign", "other sign", _at_state(lambda q, v: (-q, v))),
    Fault("q-zero", "q were 0", _at_state(lambda q, v: (0.0 * q, v))),
    Fault("v-zero", "v were 0|missing", _at_state(lambda q, v: (q, 0.0 * v))),
    Fault("q-joints-exchanged", "order", _at_state(lambda q, v: (q[SWAP], v[SWAP]))),
    Fault("q-joints-reversed", "order", _at_state(lambda q, v: (q[::-1].copy(), v[::-1].copy()))),
)


FLIPPED = np.array([1.0, -1.0, -1.0, -1.0])
FLOATING_FAULTS: tuple[FloatingFault, ...] = (
    FloatingFault("twist-of-world-axes", "world axes, linear first", convention="world axes"),
    FloatingFault("twist-of-mixed-axes", "mixed axes, linear first", convention="mixed axes"),
    FloatingFault("twist-angular-first", "body axes, angular", convention="body axes, angular"),
    FloatingFault(
        "quaternion-inverse",
        "into the base, its inverse",
        state=lambda pose, w: (np.concatenate((pose[:3], FLIPPED * pose[3:])), w),
    ),
    FloatingFault(
        "quaternion-xyzw",
        "the quaternion was x, y, z, w",
        state=lambda pose, w: (np.concatenate((pose[:3], np.roll(pose[3:], 1))), w),
    ),
    FloatingFault("M-base-half", "half", _other("M", lambda M: M / 2)),
    FloatingFault("M-one-entry-sign", "wrong sign", _other("M", _entry(1, 7, lambda x: -x))),
    FloatingFault(
        "tau-without-gravity", "without gravity", lambda x: x | {"tau": x["tau"] - x["gravity"]}
    ),
    FloatingFault(
        "tau-without-bias", "without the bias", lambda x: x | {"tau": x["tau"] - x["bias"]}
    ),
    FloatingFault("gravity-sign", "wrong sign", _other("gravity", lambda x: -x)),
    FloatingFault("C-half", "half", _other("C", lambda C: C / 2)),
    FloatingFault("C-one-row", "row base.w_y", _other("C", _row(4, lambda x: -x))),
)


def floating_outcome(
    fault: FloatingFault | None,
    scene: Scene,
    path_of_robot: str,
    tool: str,
    states: Path,
    form: str,
    path: Path,
) -> str:
    """Return what became of a fault about a free base, see `outcome`; None is no fault."""
    table = open_table(states)
    header = next(iter(table.header.values()))
    answered = header
    if fault is not None and fault.convention:
        answered = next(x for x in CONVENTIONS if x.startswith(fault.convention))
    model = FloatingModel(path_of_robot, tool, answered)
    n = model.model.nv
    lines: list[list[str]] = []
    for row in np.vstack([chunk.values for chunk in table.chunks()]):
        places = {name: k for k, name in enumerate(table.names)}
        pose, w, wdot = (row[[places[x] for x in columns]] for columns in BASE_COLUMNS.values())
        turned = CONVENTIONS[header].turns_first
        w, wdot = (np.roll(x, 3) if turned else x for x in (w, wdot))
        joints, v, vdot = (
            np.array([row[places[x]] for x in table.names if x.startswith(f"{part}[")])
            for part in ("q", "v", "vdot")
        )
        state = fault.state(pose, w) if fault else (pose, w)
        answers = model.at(
            state[0], joints, np.concatenate((state[1], v)), np.concatenate((wdot, vdot))
        )
        answers = fault.change(answers) if fault else answers
        if not lines:
            names = [x for key, value in answers.items() for x in _names(key, value)]
            lines = [[f"# base: {header}"], [*table.names, *names]]
        numbers = (y for x in answers.values() for y in np.ravel(x).tolist())
        lines.append([*map(repr, row.tolist()), *(form % y for y in numbers)])
    assert n == scene.n
    head, *others = lines
    with path.open("w", newline="", encoding="utf-8") as file:
        file.write(head[0] + "\n")
        csv.writer(file).writerows(others)
    findings, _ = check_answers(path, scene)
    failed = [x for x in findings if x.verdict == "failed"]
    if not failed:
        return "missed"
    text = " ".join(f"{one.subject}: {one.detail}" for one in failed)
    says = fault.says.split("|") if fault else []
    return "named" if any(word in text for word in says) else f"found: {text}"


# ---- Logs ----------------------------------------------------------------------------------------


class LoggedMotion(NamedTuple):
    """A motion of a scene under applied forces: times (k,), and (k, n) each."""

    t: Any
    q: Any
    v: Any
    a: Any
    tau: Any


def logged_motion(scene: Scene, method: str, step: float, rows: int) -> LoggedMotion:
    """Return a motion from the initial state by "semi-implicit" Euler or "rk4"."""
    q, v = scene.initial_state()
    lines = []

    def applied(t: float) -> Any:
        return np.sin(3.0 * t + np.arange(scene.n))

    def acceleration(t: float, q: Any, v: Any) -> Any:
        at = Evaluation(scene, q, v)
        return np.linalg.solve(at.terms.M, at.F + applied(t))

    for k in range(rows):
        t = k * step
        a = acceleration(t, q, v)
        lines.append((t, q, v, a, applied(t)))
        if method == "semi-implicit":
            v = v + step * a
            q = q + step * v
            continue
        slopes = [np.array([v, a])]
        for share in (0.5, 0.5, 1.0):
            near, fast = np.array([q, v]) + share * step * slopes[-1]
            slopes.append(np.array([fast, acceleration(t + share * step, near, fast)]))
        mean = (slopes[0] + 2.0 * slopes[1] + 2.0 * slopes[2] + slopes[3]) / 6.0
        q, v = np.array([q, v]) + step * mean
    return LoggedMotion(*map(np.array, zip(*lines, strict=True)))


class LogFault(NamedTuple):
    """A fault of a log: its name, words of the finding or the note, and the wrong columns.

    Attributes:
        id: its name.
        says: words, alternatives with "|" between them.
        change: function of (motion, scene) -> changed columns by name.
    """

    id: str
    says: str
    change: Callable[[LoggedMotion, Scene], dict[str, Any]]


def _behind(x: Any) -> Any:
    return np.concatenate((x[:1], x[:-1]))


def _of_column(x: Any, column: int, factor: float) -> Any:
    x = x.copy()
    x[:, column] *= factor
    return x


def _glitch(x: Any, by: float) -> Any:
    x = x.copy()
    x[len(x) // 2, 1] += by
    return x


def _stale_row(x: Any) -> Any:
    x = x.copy()
    x[len(x) // 2] = x[len(x) // 2 - 1]
    return x


def _terms(motion: LoggedMotion, scene: Scene) -> tuple[Any, Any]:
    """Return gravity and the bias along a motion, (k, n) each."""
    points = [
        ConformancePoint(Evaluation(scene, q, v)) for q, v in zip(motion.q, motion.v, strict=True)
    ]
    return np.array([x.weight.gradient for x in points]), np.array([x.bias for x in points])


LOG_FAULTS: tuple[LogFault, ...] = (
    LogFault("v-sign", "wrong sign", lambda x, s: {"v": -x.v}),
    LogFault("v-one-sign", "wrong sign", lambda x, s: {"v": _of_column(x.v, 1, -1.0)}),
    LogFault("v-degrees", "in degrees", lambda x, s: {"v": x.v / DEGREE}),
    LogFault("q-degrees", "per degree", lambda x, s: {"q": x.q / DEGREE}),
    LogFault("v-row-before", "v is one step behind q", lambda x, s: {"v": _behind(x.v)}),
    LogFault("v-exchanged", "in another order", lambda x, s: {"v": x.v[:, ::-1]}),
    LogFault("a-row-before", "a are those of the row before", lambda x, s: {"a": _behind(x.a)}),
    LogFault(
        "a-and-tau-row-before",
        "a and tau are those of the state of the row before",
        lambda x, s: {"a": _behind(x.a), "tau": _behind(x.tau)},
    ),
    LogFault("a-half", "half", lambda x, s: {"a": x.a / 2.0}),
    LogFault("tau-sign", "wrong sign", lambda x, s: {"tau": -x.tau}),
    LogFault("tau-one-half", "half", lambda x, s: {"tau": _of_column(x.tau, 2, 0.5)}),
    LogFault(
        "tau-without-gravity", "without gravity", lambda x, s: {"tau": x.tau - _terms(x, s)[0]}
    ),
    LogFault("tau-without-bias", "without the bias", lambda x, s: {"tau": x.tau - _terms(x, s)[1]}),
    LogFault("tau-in-Nmm", "1000 times", lambda x, s: {"tau": 1000.0 * x.tau}),
    LogFault("t-in-ms", "1000 times", lambda x, s: {"t": 1000.0 * x.t}),
    LogFault("q-jumps", "jumps to row", lambda x, s: {"q": _glitch(x.q, 0.1)}),
    LogFault("q-stale", "jumps to row", lambda x, s: {"q": _stale_row(x.q)}),
)


def log_columns(scene: Scene, motion: LoggedMotion, base: str = "") -> dict[str, Any]:
    """Return the columns of a log; of a free base with a twist if a convention is given."""
    state = motion.q, motion.v, motion.a
    columns = state_columns(scene, *state, CONVENTIONS[base] if base else None)
    names = [(x.replace("vdot[", "a["), values) for x, values in columns.items()]
    tau = motion.tau
    joints = scene.coordinate_names
    if base:
        joints = twist_names(scene, CONVENTIONS[base])
        maps = [velocity_map(CONVENTIONS[base], *x)[0] for x in zip(*state[:2], strict=True)]
        tau = np.array([np.linalg.solve(S.T, x) for S, x in zip(maps, tau, strict=True)])
    forces = {f"tau[{name}]": tau[:, k] for k, name in enumerate(joints)}
    return {"t": motion.t, **dict(names), **forces}


def log_outcome(
    fault: LogFault | None,
    scene: Scene,
    motion: LoggedMotion,
    form: str,
    path: Path,
    base: str = "",
    header: str = "",
) -> str:
    """Return what became of a fault of a log, see `outcome`; None is no fault.

    `header` declares another convention than that of the columns, `base`.
    """
    changed = motion if fault is None else motion._replace(**fault.change(motion, scene))
    columns = log_columns(scene, changed, base)
    lines = [[form % x for x in row] for row in zip(*columns.values(), strict=True)]
    with path.open("w", newline="", encoding="utf-8") as file:
        file.write(f"# base: {header or base}\n" if base else "")
        csv.writer(file).writerows([[*columns], *lines])
    findings, notes, _ = check_recorded(path, scene)
    failed = [one for one in findings if one.verdict == "failed"]
    text = " ".join([*notes, *(f"{one.subject}: {one.detail}" for one in failed)])
    says = fault.says.split("|") if fault is not None else []
    if any(word in text for word in says):
        return "named"
    return f"found: {text}" if failed else "missed"


def table_of(
    model: Model, states: Sequence[Sequence[str]], form: str, fault: Fault | None
) -> Iterable[list[str]]:
    """Yield the rows of a table: the state and the printed answers, the header first."""
    head, *rows = states
    n = model.model.nv
    before: Answers = {}
    for k, row in enumerate(rows):
        q, v, vdot = np.array(row[: 3 * n], float).reshape(3, n)
        right = model(q, v, vdot)
        answers = right if fault is None else fault.answer(model, q, v, vdot, k, before)
        before = right
        if k == 0:
            yield [*head, *(name for key, x in answers.items() for name in _names(key, x))]
        numbers = (y for x in answers.values() for y in np.ravel(x).tolist())
        yield [*row, *(form % y for y in numbers)]


def _names(key: str, x: Any) -> list[str]:
    """Return the names of the columns of an answer."""
    if not np.ndim(x):
        return [key]
    return [f"{key}[{';'.join(map(str, index))}]" for index in np.ndindex(np.shape(x))]


def write_answers(path: Path, rows: Iterable[list[str]]) -> Path:
    """Write a table as CSV."""
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)
    return path


def outcome(fault: Fault, scene: Scene, model: Model, states: Any, form: str, path: Path) -> str:
    """Return what became of a fault: "named", "found", "too few digits" or "missed"."""
    rows = [*table_of(model, states, form, fault)]
    shown = rows != [*table_of(model, states, form, None)]
    findings, _ = check_answers(write_answers(path, rows), scene)
    failed = [finding for finding in findings if finding.verdict == "failed"]
    if not failed:
        return "missed" if shown else "too few digits"
    text = " ".join(f"{one.subject}: {one.detail}" for one in failed)
    return "named" if any(word in text for word in fault.says.split("|")) else f"found: {text}"


LOG_STEP, LOG_ROWS = 0.002, 200
"""Time step, s, and number of rows of the logs of the trial."""


def more_outcomes(path: str, tool: str, few: int, folder: Path) -> Iterable[list[str]]:
    """Yield rows of the table about free bases and logs: a name, an outcome for each format."""
    free, file = scene_named(f"{path}:floating"), folder / "more.csv"
    states = folder / "states-of-a-base.csv"
    for convention in CONVENTIONS:
        write_states(free, states, few, 1, convention)
        case = free, path, tool, states
        outcomes = [floating_outcome(None, *case, form, file) for form in FORMATS]
        yield [f"right: {convention}", *outcomes]
    write_states(free, states, few, 1, "body axes")
    for fault in FLOATING_FAULTS:
        case = free, path, tool, states
        yield [fault.id, *(floating_outcome(fault, *case, form, file) for form in FORMATS)]
    scene = scene_named(path)
    for method in ("semi-implicit", "rk4"):
        motion = logged_motion(scene, method, LOG_STEP, LOG_ROWS)
        outcomes = [log_outcome(None, scene, motion, form, file) for form in FORMATS]
        yield [f"right: log of {method}", *outcomes]
    for one in LOG_FAULTS:
        yield [f"log-{one.id}", *(log_outcome(one, scene, motion, x, file) for x in FORMATS)]
    motion = logged_motion(free, "rk4", LOG_STEP, LOG_ROWS // 4)
    for convention in CONVENTIONS:
        outcomes = [log_outcome(None, free, motion, x, file, convention) for x in FORMATS]
        yield [f"right: log of {convention}", *outcomes]


def main() -> int:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser("python -m tests.trials.recorded_answers", description=__doc__)
    parser.add_argument("--states", type=int, default=1000, help="number of right states")
    parser.add_argument("--few", type=int, default=40, help="number of states with a fault")
    parser.add_argument("--robot", help="a URDF of six joints; by default UR5")
    parser.add_argument("--tool", default="tool0", help="a link of it")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--markdown", type=Path)
    asked = parser.parse_args()
    path_of_robot = asked.robot or str(found("ur5_robot"))
    scene, model = scene_named(path_of_robot), Model(path_of_robot, asked.tool)
    wrong, lines = 0, []
    with TemporaryDirectory() as folder:
        path = Path(folder) / "states.csv"
        write_states(scene, path, asked.states, asked.seed)
        with path.open(newline="", encoding="utf-8") as file:
            states = list(csv.reader(file))
        for form in FORMATS:
            rows = table_of(model, states, form, None)
            findings, _ = check_answers(write_answers(Path(folder) / "right.csv", rows), scene)
            failed = [str(one) for one in findings if one.verdict == "failed"]
            wrong += len(failed)
            verdicts = [one.verdict for one in findings]
            print(form, {x: verdicts.count(x) for x in sorted({*verdicts})}, *failed, sep="\n  ")
        for fault in FAULTS:
            few = states[: asked.few + 1]
            outcomes = [
                outcome(fault, scene, model, few, form, Path(folder) / "wrong.csv")
                for form in FORMATS
            ]
            wrong += sum(x not in ("named", "too few digits") for x in outcomes)
            lines.append([fault.id, *outcomes])
            print(*lines[-1], sep=" | ", flush=True)
        for outcomes in more_outcomes(path_of_robot, asked.tool, asked.few, Path(folder)):
            right = outcomes[0].startswith("right")
            allowed = ("missed",) if right else ("named", "too few digits")
            wrong += sum(x not in allowed for x in outcomes[1:])
            lines.append(["passed" if right and x == "missed" else x for x in outcomes])
            print(*lines[-1], sep=" | ", flush=True)
    table = ResultTable("recorded", "", ["fault", *FORMATS], lines)
    print_tables([table])
    if asked.markdown:
        asked.markdown.write_text(table.markdown(), encoding="utf-8")
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())

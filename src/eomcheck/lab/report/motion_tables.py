"""Tables of one scene on a terminal: accelerations, redundant constraints, and trajectories.

Accelerations and constraints are those at the initial state. Trajectories are by several
formulations, a line each, or many by one formulation, as quantiles and as a chart.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.errors import RefusedError
from eomcheck.evaluation.constraint_rank import rank_of
from eomcheck.evaluation.dynamics import acceleration, assembled_position, velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import formulations_for
from eomcheck.lab.recorded_table import write_table
from eomcheck.lab.show.chart import Axis, Band, Chart, Panel, in_rows
from eomcheck.lab.show.table import ResultTable, print_tables, say, table_of
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.batch import Trajectories
from eomcheck.motion.reference_solution import constraint_error, energy_error
from eomcheck.motion.simulate import Trajectory
from eomcheck.numbers.generic import Array
from eomcheck.safe_output import counted


def units(scene: Scene) -> list[str]:
    """Return the unit of each coordinate (n,), "m" or "rad"."""
    angles = set(range(scene.n)[scene.angle_coordinates])
    if isinstance(scene, Mechanism):  # only some of its coordinates are angles, in any order
        angles = {joint.coordinate for joint in scene.source.topology.joints if not joint.slides}
    return ["rad" if i in angles else "m" for i in range(scene.n)]


# ---- Accelerations -------------------------------------------------------------------------------

MOST = 12
"""Largest number of coordinates printed of a state."""
NOTE = (
    "error bound: of every entry of q̈, m/s² of lengths and rad/s² of angles; rcond: reciprocal "
    "condition number of the matrix that is solved, 0 where it is singular."
)
KKT = "KKT: the matrix of the equations of motion and the constraints together."


def print_accelerations(scene: Scene, u=None, keys: Iterable[str] | None = None, q=None) -> int:
    """Print the accelerations of a scene in a pose; return the number of refusals.

    Args:
        scene: the scene.
        u: generalized speeds (p,), by default those of the initial state; 0 where q is given. At
            rest they need not exist.
        q: coordinates (n,), by default those of the initial state; the nearest position that
            satisfies the holonomic constraints.
        keys: formulations, by default all that apply.

    Raises:
        InputError, UnknownNameError: bad speeds, no such formulation, or one that does not apply.
        RefusedError: the scene has no such speeds at this pose.
    """
    chosen = [f.key for f in formulations_for(scene, keys)]
    start, v = scene.initial_state()
    if q is None:
        q = start
    else:
        q, v = assembled_position(scene, q), np.zeros_like(v)
    if u is not None:
        v = velocity(scene, q, u) if np.any(u) else np.zeros_like(v)
    rows, refusals = [], []
    for key in chosen:
        try:
            result = acceleration(scene, key, q, v)
        except RefusedError as refusal:
            refusals.append(f"{key} refuses: {refusal}")
            continue
        matrix = min(result.rcond, key=result.rcond.__getitem__)
        i = int(np.argmax(np.abs(result.vdot)))
        most = f"{abs(result.vdot[i]):.10g} {units(scene)[i]}/s²", scene.coordinate_names[i]
        rows.append(
            (key, *most, f"{result.error_bound:.2g}", f"{result.rcond[matrix]:.2g}", matrix)
        )
    columns = ("formulation", "largest |q̈|", "of", "error bound", "smallest rcond", "matrix")
    at = "its start" if np.array_equal(q, start) else "this position"
    title = f"{scene.name}: accelerations at {at}"
    print_tables([ResultTable("accelerations", title, columns, rows, note=NOTE if rows else "")])
    if any(row[-1] == "KKT" for row in rows):
        say(KKT)
    for sentence in (*refusals, _state(scene, q, v)):
        say(sentence)
    return len(refusals)


def write_trajectory(trajectory: Trajectory, path: Path) -> None:
    """Write a trajectory as a table: t, q, v, λ, energy and the residuals of the constraints.

    Args:
        trajectory: the trajectory.
        path: file to write, see `eomcheck.lab.recorded_table.write_table`.

    Raises:
        InputError: the file has another suffix, or cannot be written.
    """
    scene = trajectory.scene
    columns = {"t": trajectory.times}
    for name, values, names in (
        ("q", trajectory.q, scene.coordinate_names),
        ("v", trajectory.v, scene.coordinate_names),
        ("multiplier", trajectory.multipliers, scene.constraint_names),
        ("residual", trajectory.constraint_residual, scene.constraint_names),
    ):
        if values is not None:
            columns |= {f"{name}[{x}]": values[:, k] for k, x in enumerate(names)}
    write_table(path, columns | {"energy": trajectory.energy})


def _state(scene: Scene, q: Array, v: Array) -> str:
    """Return coordinates and velocities with their units, at most `MOST` of each."""
    names = [*zip(scene.coordinate_names, units(scene), strict=True)][:MOST]
    more = f" and {scene.n - MOST} more" if scene.n > MOST else ""
    pose = ", ".join(f"{name} = {x:.4g} {unit}" for (name, unit), x in zip(names, q, strict=False))
    if not v.any():
        return f"At t = 0 s, at rest: {pose}{more}."
    rates = (f"{name}: {x:.4g} {unit}/s" for (name, unit), x in zip(names, v, strict=False))
    return f"At t = 0 s: {pose}{more}. Their rates: {', '.join(rates)}{more}."


# ---- Constraints ---------------------------------------------------------------------------------


def print_constraints(scene: Scene) -> int:
    """Print the constraints that depend on others at the initial state; return their number.

    Raises:
        RefusedError: the rank of a is uncertain, or differs in nearby positions.
    """
    q, _ = scene.initial_state()
    at = Evaluation(scene, q, np.zeros(scene.n))
    redundant = at.independent_partition.redundant
    without = [] if redundant is None else redundant.tolist()
    if at.terms.a is None:
        say(f"{scene.name} has no constraint")
        return 0
    rank = rank_of(at)
    columns = {
        "constraint": lambda i: scene.constraint_names[i],
        "status": lambda i: "redundant" if i in without else "kept",
        "distance": lambda i: f"{rank.distance[i]:.2g}",
        "rounding error ≤": lambda i: f"{rank.uncertainty[i]:.2g}",
    }
    print_tables([table_of("constraints", "", range(scene.r), columns.items())])
    say(
        "distance: of the row of the constraint Jacobian from the span of the rows that are taken "
        "before it, relative to the size of the row; at most the rounding error where it follows "
        "from them"
    )
    say(f"{scene.structure}: n = {scene.n}, r = {scene.r}, rank {scene.r - len(without)}")
    return len(without)


# ---- Motions by several formulations -------------------------------------------------------------


def print_trajectories(trajectories: Iterable[Trajectory]) -> None:
    """Print one line per trajectory of one scene, then the reasons of failures."""
    trajectories = list(trajectories)
    scene = trajectories[0].scene
    energy = "energy error" if scene.conserves_energy else "energy left"
    columns = {
        "formulation": lambda t: t.key,
        "end (s)": lambda t: f"{t.times[-1]:g}" if t.times.size else "0",
        "steps": lambda t: str(t.steps),
        "right-hand sides": lambda t: str(t.right_hand_sides),
        "run time (s)": lambda t: f"{t.seconds:.2g}",
        energy: _energy,
        "constraint error (m/s)": _constraint,
    }
    why = f"The energy is no error here: {scene.why_not_conserved}."
    note = "" if scene.conserves_energy else why
    title = f"{scene.name}: motions from its start"
    print_tables([table_of("motions", title, trajectories, columns.items(), note=note)])
    for trajectory in trajectories:
        if trajectory.status != "finished":
            say(f"{trajectory.key} {trajectory.status}: {trajectory.reason}")


def _constraint(motion: Trajectory) -> str:
    return f"{constraint_error(motion).max():.1e}" if motion.scene.r and motion.times.size else ""


def _energy(motion: Trajectory) -> str:
    if not motion.times.size:
        return ""
    if motion.scene.conserves_energy:
        return f"{np.abs(energy_error(motion)).max():.1e} J"
    return f"{motion.energy[-1]:.6g} J of {motion.energy[0]:.6g} J"


# ---- Many motions --------------------------------------------------------------------------------

QUANTILES = {"least": 0.0, "quartile": 0.25, "median": 0.5, "3rd quartile": 0.75, "largest": 1.0}
PANELS = 12
"""Largest number of coordinates in a figure; of more, evenly spaced ones are shown."""
ACROSS = 3
"""Number of panels in a row."""


def print_many(batch: Trajectories) -> None:
    """Print the end states and errors of the finished trajectories, and the reasons of failures."""
    good = batch.status == "finished"
    title = f"{batch.key}, t = {batch.t[-1]:g} s"
    rows = list(_quantile_rows(batch, good)) if good.any() else []
    counts = ", ".join(f"{count} {status}" for status, count in Counter(batch.status).items())
    note = f"{counted(len(batch), 'motion')}: {counts}; {batch.seconds:.2g} s of integration"
    print_tables([ResultTable("many", title, ("at the end", *QUANTILES), rows, note=note)])
    for i in np.flatnonzero(~good)[:3]:
        say(f"motion {i} {batch.status[i]}: {batch.reason[i]}")


def _quantile_rows(batch: Trajectories, good: Array) -> Iterator[tuple[str, ...]]:
    """Yield the quantiles of each coordinate at the end, and of the errors."""
    scene = batch.scenes[0]
    for name, unit, x in zip(
        scene.coordinate_names, units(scene), batch.q[good, -1].T, strict=True
    ):
        yield f"{name} / {unit}", *(f"{value:.5g}" for value in _quantiles(x))
    energy = batch.energy[good]
    errors = {"energy / J": energy[:, -1]}
    if scene.conserves_energy:
        errors = {"energy error / J": np.abs(energy - energy[:, :1]).max(axis=1)}
    if batch.constraint_residual is not None:
        worst = batch.constraint_residual[good].max(axis=(1, 2))
        errors["constraint error / (m/s)"] = worst
    for name, x in errors.items():
        yield name, *(f"{value:.2e}" for value in _quantiles(x))


def _quantiles(x: Array) -> Array:
    """Return the `QUANTILES` along the first axis."""
    return np.quantile(x, list(QUANTILES.values()), axis=0)


def chart_of_many(batch: Trajectories) -> Chart:
    """Return a chart of deviations from the median over time: bands of half and of all
    trajectories.
    """
    scene, q = batch.scenes[0], batch.q[batch.status == "finished"]
    shown = np.unique(np.linspace(0, scene.n - 1, min(scene.n, PANELS)).astype(int))
    whole = f"{counted(len(q), 'motion')} of {scene.name} by {batch.key}"
    panels: dict[tuple[str, ...], Panel] = {}
    for i in shown:
        name = scene.coordinate_names[i]
        quantiles = _quantiles(q[:, :, i])
        least, low, _, high, most = (quantiles - quantiles[2]).tolist()
        panels[name,] = Panel(
            Axis("t / s"),
            Axis(f"({name} - median) / {units(scene)[i]}"),
            (),
            bands=(
                Band(batch.key, batch.t.tolist(), least, most, whole),
                Band(batch.key, batch.t.tolist(), low, high, "the middle half of them"),
            ),
            level=0.0,
        )
    return Chart(
        "many",
        f"How far {whole} are from their median",
        ["coordinate"],
        panels,
        grid=in_rows([*panels], ACROSS),
        height=2.0,
    )

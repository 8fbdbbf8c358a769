"""Many motions: how far they are apart, as a table and as a chart."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from eomcheck.lab.report.units import units
from eomcheck.lab.show.chart import Axis, Band, Chart, Panel, in_rows
from eomcheck.lab.show.table import Sheet, print_sheets, say
from eomcheck.motion.batch import Trajectories
from eomcheck.numbers.generic import Array
from eomcheck.safe_output import counted

QUANTILES = {"least": 0.0, "quartile": 0.25, "median": 0.5, "3rd quartile": 0.75, "largest": 1.0}
PANELS = 12
"""Coordinates in a figure at most, even ones where there are more."""
ACROSS = 3
"""Panels of a row."""


def print_many(found: Trajectories) -> None:
    """Print the ends of the motions that came to theirs, their errors, and why others did not."""
    good = found.status == "finished"
    title = f"{found.key}, t = {found.t[-1]:g} s"
    rows = list(_quantile_rows(found, good)) if good.any() else []
    counts = ", ".join(f"{count} {status}" for status, count in Counter(found.status).items())
    note = f"{counted(len(found), 'motion')}: {counts}; {found.seconds:.2g} s of integration"
    print_sheets([Sheet("many", title, ("at the end", *QUANTILES), rows, note=note)])
    for i in np.flatnonzero(~good)[:3]:
        say(f"motion {i} {found.status[i]}: {found.reason[i]}")


def _quantile_rows(found: Trajectories, good: Array) -> Iterator[tuple[str, ...]]:
    """Yield the quantiles of each coordinate at the end, and of the errors."""
    scene = found.scenes[0]
    for name, unit, x in zip(
        scene.coordinate_names, units(scene), found.q[good, -1].T, strict=True
    ):
        yield f"{name} / {unit}", *(f"{value:.5g}" for value in _quantiles(x))
    energy = found.energy[good]
    errors = {"energy / J": energy[:, -1]}
    if scene.conserves_energy:
        errors = {"energy error / J": np.abs(energy - energy[:, :1]).max(axis=1)}
    if found.constraint_residual is not None:
        worst = found.constraint_residual[good].max(axis=(1, 2))
        errors["constraint error / (m/s)"] = worst
    for name, x in errors.items():
        yield name, *(f"{value:.2e}" for value in _quantiles(x))


def _quantiles(x: Array) -> Array:
    """Return the `QUANTILES` along the first axis."""
    return np.quantile(x, list(QUANTILES.values()), axis=0)


def chart_of_many(found: Trajectories) -> Chart:
    """Return how far half and all of the motions are from the median, coordinate by coordinate."""
    scene, q = found.scenes[0], found.q[found.status == "finished"]
    shown = np.unique(np.linspace(0, scene.n - 1, min(scene.n, PANELS)).astype(int))
    whole = f"{counted(len(q), 'motion')} of {scene.name} by {found.key}"
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
                Band(found.key, found.t.tolist(), least, most, whole),
                Band(found.key, found.t.tolist(), low, high, "the middle half of them"),
            ),
            level=0.0,
        )
    return Chart(
        "many",
        f"How far {whole} are from their median",
        ["coordinate"],
        panels,
        grid=in_rows([*panels], ACROSS),
        size=(3.6, 2.3),
    )

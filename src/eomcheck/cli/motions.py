"""`eomcheck simulate`, `acceleration` and `constraints`: what is to be said of one scene."""

from __future__ import annotations

from contextlib import nullcontext
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eomcheck.cli.app import app
from eomcheck.cli.options import Formulations, Kind, Seed, check_figure
from eomcheck.errors import InputError, whole_number
from eomcheck.lab.options import MOST_LINKS, at_least_one

if TYPE_CHECKING:
    from eomcheck.scenes import Snake


class Robot(StrEnum):
    """The snakes that the command line knows by name."""

    PAPER = "paper"
    COIL = "coil"
    PATTERN = "pattern"


def _snake(robot: Robot, links: int) -> Snake:
    from eomcheck.scenes import Snake

    if whole_number("links", links) > MOST_LINKS:
        raise InputError(f"links = {links}, expected at most {MOST_LINKS}")
    makers = {Robot.COIL: Snake.coil, Robot.PATTERN: Snake.pattern}
    return Snake.paper() if robot is Robot.PAPER else makers[robot](links)


def _many(
    scene: Snake,
    key: str,
    t_end: float,
    speeds: tuple[float, float],
    options: dict,
    *,
    draws: int,
    scale: float,
    seed: int,
    executor: str | None,
    plot: Path | None,
) -> bool:
    """Integrate, print and draw motions; return whether one did not reach its end."""
    import numpy as np

    import eomcheck
    from eomcheck.lab.report.motions import chart_of_many, print_many
    from eomcheck.lab.store import workers as spread

    at_least_one(draws=draws)
    if not 0 <= scale < np.inf:
        raise InputError(f"scale = {scale}, expected a number that is not negative")
    if plot is not None:
        check_figure(plot)
    random = np.random.default_rng(seed)
    q, _ = scene.initial_state()
    q0 = q + scale * random.standard_normal((draws, scene.n))
    u0 = speeds + scale * random.standard_normal((draws, scene.p))
    there = nullcontext() if executor is None else spread.executor(executor)
    with there as pool:
        found = eomcheck.simulate_many(scene, key, t_end, q0=q0, u0=u0, executor=pool, **options)
    print_many(found)
    finished = found.status == "finished"
    if plot is not None and finished.any():
        from eomcheck.lab.show.by_matplotlib import draw

        draw([chart_of_many(found)], plot)
        print(f"written: {plot}")
    return not finished.all()


@app.command()
def simulate(
    robot: Annotated[Robot, typer.Argument(help="The paper's snake, or one of any length.")],
    t_end: Annotated[float, typer.Argument(help="End, s.")],
    links: Annotated[int, typer.Option(help="Number of links, of coil and pattern.")] = 7,
    speeds: Annotated[
        tuple[float, float], typer.Option(help="Generalized speeds at the start, m/s and rad/s.")
    ] = (0.0, 0.0),
    stiffness: Annotated[
        float | None, typer.Option(help="Stiffness of every joint, N m/rad.")
    ] = None,
    damping: Annotated[
        float | None, typer.Option(help="Damping of every joint, N m s/rad. Default none.")
    ] = None,
    formulation: Formulations = None,
    integrator: Annotated[str, typer.Option(help="Integrator.")] = "DOP853",
    tolerance: Annotated[float, typer.Option(help="rtol = atol.")] = 1e-9,
    max_steps: Annotated[int, typer.Option(help="Give up after so many; 0 for no limit.")] = 0,
    baumgarte: Annotated[
        float | None, typer.Option(help="Feed the constraint error back at this rate, 1/s.")
    ] = None,
    projection: Annotated[
        float | None, typer.Option(help="Project the velocity at intervals of so many s.")
    ] = None,
    draws: Annotated[
        int | None, typer.Option(help="Integrate so many motions near this one instead.")
    ] = None,
    scale: Annotated[
        float, typer.Option(help="Standard deviation of --draws: of q, m, rad; of u, m/s, rad/s.")
    ] = 0.01,
    seed: Seed = 0,
    executor: Annotated[str | None, typer.Option(help="Where to compute --draws.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw --draws to .png, .svg or .pdf.")] = None,
) -> None:
    """Integrate a motion by each formulation, and print how well it kept energy and constraints.

    With --baumgarte or --projection, by each formulation to which it applies. With --draws, motions
    by one formulation, kane by default, and DOP853: a normal deviate is added to each coordinate
    and generalized speed at the start, and printed is how far their ends are apart. Exit code 1 if
    a motion does not reach its end.
    """
    from dataclasses import replace

    import eomcheck
    from eomcheck.formulations import formulations_for
    from eomcheck.lab.report.motions import print_trajectories

    scene = _snake(robot, links)
    for name, value in (("stiffness", stiffness), ("damping", damping)):
        if value is not None:
            scene = replace(scene, **{name: [value] * (scene.links - 1)})
    if draws is not None:
        if baumgarte is not None or projection is not None or integrator != "DOP853":
            raise InputError("draws are integrated by DOP853, without stabilization")
        chosen = formulation or ["kane"]
        if len(chosen) > 1:
            raise InputError(f"formulation = {chosen}, expected one for draws")
        options = {"rtol": tolerance, "atol": tolerance, "max_steps": max_steps}
        near = {"draws": draws, "scale": scale, "seed": seed, "executor": executor, "plot": plot}
        if _many(scene, chosen[0], t_end, speeds, options, **near):
            raise typer.Exit(1)
        return
    asked = formulations_for(scene, formulation)
    if formulation is None and (baumgarte is not None or projection is not None):
        asked = tuple(one for one in asked if one.level == "acceleration")
    found = [
        eomcheck.simulate(
            scene,
            one.key,
            t_end,
            rtol=tolerance,
            atol=tolerance,
            integrator=integrator,
            u0=speeds,
            max_steps=max_steps,
            baumgarte=baumgarte,
            projection=projection,
        )
        for one in asked
    ]
    print_trajectories(found)
    if any(one.status != "finished" for one in found):
        raise typer.Exit(1)


@app.command()
def acceleration(
    robot: Annotated[Robot, typer.Argument(help="The paper's snake, or one of any length.")],
    links: Annotated[int, typer.Option(help="Number of links, of coil and pattern.")] = 7,
    speeds: Annotated[
        tuple[float, float], typer.Option(help="Generalized speeds, m/s and rad/s.")
    ] = (0.0, 0.0),
    formulation: Formulations = None,
) -> None:
    """Print what each formulation says at the start, how far to trust it, or why it refuses.

    Exit code 1 if one refuses.
    """
    from eomcheck.lab.report.motions import print_accelerations

    scene = _snake(robot, links)
    if print_accelerations(scene, speeds, formulation):
        raise typer.Exit(1)


@app.command()
def constraints(
    scene: Kind = "snake",
    links: Annotated[
        int | None, typer.Option(help="Number of links, of kinds that have one.")
    ] = None,
) -> None:
    """Tell which constraints of a scene are redundant at its start: which the others imply.

    Exit code 1 if some are.
    """
    from eomcheck.lab.report.motions import print_constraints
    from eomcheck.scenes.named import kinds_of

    kinds = kinds_of(scene)
    if links is not None and not any(kind.has_links for kind in kinds):
        raise InputError(f"links = {links}: {kinds[0].key} has no number of links to choose")
    count = 0
    for kind in kinds:
        sized = links is not None and kind.has_links
        count += print_constraints(next(kind.structures(links)) if sized else kind.example())
    if count:
        raise typer.Exit(1)

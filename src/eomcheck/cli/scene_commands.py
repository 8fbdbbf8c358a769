"""Commands about one scene: `eomcheck simulate`, `acceleration` and `constraints`."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eomcheck.atomic_write import check_writable
from eomcheck.calls import PATIENCE
from eomcheck.cli.application import (
    DEFAULT_SCENE,
    Formulations,
    Links,
    OptionalSceneOption,
    Patience,
    SceneOption,
    SetOption,
    SpeedsOption,
    app,
    check_figure,
    check_used,
    completer,
    seed_option,
    selected_scene,
    selected_speeds,
)
from eomcheck.deprecated import print_notice
from eomcheck.errors import InputError
from eomcheck.lab.option_parsing import check_count, parse_numbers

if TYPE_CHECKING:
    from eomcheck.mechanics.scene import Scene


def _simulate_near(
    scene: Scene,
    key: str,
    t_end: float,
    speeds: list[float] | None,
    options: dict,
    *,
    examples: int,
    scale: float,
    seed: int,
    executor: str | None,
    plot: Path | None,
) -> bool:
    """Integrate, print and draw motions near the start of a scene.

    Return whether one did not reach its end.
    """
    import numpy as np

    import eomcheck
    from eomcheck.evaluation.dynamics import assembled_position
    from eomcheck.lab.report.motion_tables import chart_of_many, print_many
    from eomcheck.lab.store import parallel_map

    check_count(examples=examples)
    if not 0 <= scale < np.inf:
        raise InputError(f"scale = {scale}, expected a number that is not negative")
    if plot is not None:
        check_figure(plot)
    random = np.random.default_rng(seed)
    q, v = scene.initial_state()
    moves = speeds is None and v.any()
    u = eomcheck.speeds_of(scene, q, v) if moves else speeds or scene.p * [0.0]
    q0 = q + scale * random.standard_normal((examples, scene.n))
    u0 = u + scale * random.standard_normal((examples, scene.p))
    if scene.position_residual is not None:
        q0 = np.array([assembled_position(scene, coordinates) for coordinates in q0])
    context = nullcontext() if executor is None else parallel_map.executor(executor)
    with context as pool:
        motions = eomcheck.simulate_many(scene, key, t_end, q0=q0, u0=u0, executor=pool, **options)
    print_many(motions)
    finished = motions.status == "finished"
    if plot is not None and finished.any():
        from eomcheck.lab.show.chart_matplotlib import draw_chart

        draw_chart(chart_of_many(motions), plot)
        print(f"written: {plot}")
    return not finished.all()


def _scene_and_end(
    words: list[str] | None, scene: str | None, end: float | None
) -> tuple[str | None, float]:
    """Return the named scene, if any, and the end of a motion, s.

    Until the next release the end may also be the last word.
    """
    *names, last = words or [""]
    if end is not None:  # then no word is one
        names = words or []
    else:
        try:
            end = float(last)
        except ValueError:
            raise InputError("no end of the motion is given, expected s: --end END") from None
        print_notice("simulate END", "simulate --end END")
    if len(names) > 1:
        raise InputError(f"{' '.join(names)!r}, expected one scene")
    return _named_once(names[0] if names else None, scene), end


def _named_once(name: str | None, option: str | None) -> str | None:
    """Return the name of the scene, given as an argument or by --scene, if any.

    Raises:
        InputError: it is named in both ways.
    """
    if name is not None and option is not None:
        raise InputError(f"two scenes are named, {name!r} and {option!r}")
    return name if option is None else option


@app.command("simulate")
def simulate_command(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SCENE]",
            help="Scene, as --scene names it. [default: paper]",
            autocompletion=completer("robot", "scene"),
        ),
    ] = None,
    end: Annotated[float | None, typer.Option(metavar="END", help="End of the motion, s.")] = None,
    scene: OptionalSceneOption = None,
    links: Links = None,
    settings: SetOption = None,
    speeds: SpeedsOption = None,
    formulation: Formulations = None,
    integrator: Annotated[str, typer.Option(metavar="KEY", help="Integrator.")] = "DOP853",
    tolerance: Annotated[float, typer.Option(help="rtol = atol.")] = 1e-9,
    max_steps: Annotated[int, typer.Option(help="Give up after so many; 0 for no limit.")] = 0,
    baumgarte: Annotated[
        float | None, typer.Option(help="Feed the constraint error back at this rate, 1/s.")
    ] = None,
    projection: Annotated[
        float | None, typer.Option(help="Project the velocity at intervals of so many s.")
    ] = None,
    examples: Annotated[
        int | None, typer.Option(help="Number of motions to integrate near this one instead.")
    ] = None,
    scale: Annotated[
        float | None,
        typer.Option(
            help="Standard deviation of --examples: of q, m, rad; of u, m/s, rad/s. [default: 0.01]"
        ),
    ] = None,
    seed: Annotated[int | None, seed_option("Seed of --examples. [default: 0]")] = None,
    executor: Annotated[
        str | None,
        typer.Option(
            metavar="PLACE",
            help="Where to compute --examples: local, local:PROCESSES or dask:ADDRESS.",
        ),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw --examples to .png, .svg or .pdf.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Write the motion by one --formulation to .csv, .json or .npz."
        ),
    ] = None,
    patience: Patience = PATIENCE,
) -> None:
    """Integrate a motion by each formulation, and print its errors of energy and constraints.

    With --baumgarte or --projection, by each formulation to which it applies. With --examples, many
    motions by one formulation, kane by default, and DOP853: a normal deviate is added to each
    coordinate and generalized speed at the start, and the spread of their ends is printed. Exit
    code 1 if a motion does not reach its end.
    """
    name, t_end = _scene_and_end(words, scene, end)
    if examples is None:
        check_used("without --examples", scale=scale, seed=seed, executor=executor, plot=plot)
    else:
        check_used("with --examples", output=output)
    if output is not None and len(formulation or ()) != 1:
        raise InputError(f"output = {str(output)!r} holds one motion: expected one --formulation")
    check_writable(output)

    import eomcheck
    from eomcheck.formulations import formulations_for
    from eomcheck.lab.report.motion_tables import print_trajectories, write_trajectory

    chosen_scene = selected_scene(name or DEFAULT_SCENE, links, settings)
    u0 = selected_speeds(chosen_scene, speeds)
    if examples is not None:
        if baumgarte is not None or projection is not None or integrator != "DOP853":
            raise InputError("--examples are integrated by DOP853, without stabilization")
        chosen = formulation or ["kane"]
        if len(chosen) > 1:
            raise InputError(f"formulation = {chosen}, expected one for --examples")
        options = {"rtol": tolerance, "atol": tolerance, "max_steps": max_steps}
        near = {"examples": examples, "scale": 0.01 if scale is None else scale, "seed": seed or 0}
        if _simulate_near(
            chosen_scene, chosen[0], t_end, u0, options, **near, executor=executor, plot=plot
        ):
            raise typer.Exit(1)
        return
    formulations = formulations_for(chosen_scene, formulation)
    if formulation is None and (baumgarte is not None or projection is not None):
        formulations = tuple(f for f in formulations if f.level == "acceleration")
    trajectories = [
        eomcheck.simulate(
            chosen_scene,
            f.key,
            t_end,
            rtol=tolerance,
            atol=tolerance,
            integrator=integrator,
            u0=u0,
            max_steps=max_steps,
            baumgarte=baumgarte,
            projection=projection,
        )
        for f in formulations
    ]
    if output is not None:
        write_trajectory(trajectories[0], output)
    print_trajectories(trajectories)
    if output is not None:
        print(f"written: {output}")
    if any(trajectory.status != "finished" for trajectory in trajectories):
        raise typer.Exit(1)


@app.command("acceleration")
def acceleration_command(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[SCENE]",
            help="Scene, as --scene names it. [default: paper]",
            autocompletion=completer("robot", "scene"),
        ),
    ] = None,
    scene: OptionalSceneOption = None,
    links: Links = None,
    settings: SetOption = None,
    speeds: SpeedsOption = None,
    q: Annotated[
        list[str] | None,
        typer.Option(
            "--q",
            metavar="X,X",
            help="Coordinates: 1,0.5, or repeated; the nearest position where loops are closed, at "
            "rest without --speeds. [default: the scene's start]",
        ),
    ] = None,
    formulation: Formulations = None,
    patience: Patience = PATIENCE,
) -> None:
    """Print the acceleration in a state by each formulation with its error bound, or its refusal.

    Exit code 1 if one refuses.
    """
    name = _named_once(name, scene)
    from eomcheck.lab.report.motion_tables import print_accelerations

    chosen_scene = selected_scene(name or DEFAULT_SCENE, links, settings)
    position = parse_numbers("q", q) if q else None
    if position is not None and len(position) != chosen_scene.n:
        size = f"{chosen_scene.name} has {chosen_scene.n}, expected so many numbers"
        raise InputError(f"q = {position}: {size}")
    if print_accelerations(
        chosen_scene, selected_speeds(chosen_scene, speeds), formulation, position
    ):
        raise typer.Exit(1)


@app.command("constraints")
def constraints_command(
    scene: SceneOption = DEFAULT_SCENE,
    links: Links = None,
    settings: SetOption = None,
    patience: Patience = PATIENCE,
) -> None:
    """Print which constraints of a scene are redundant at its start: implied by the others.

    Exit code 1 if some are.
    """
    from eomcheck.lab.report.motion_tables import print_constraints

    if print_constraints(selected_scene(scene, links, settings)):
        raise typer.Exit(1)

"""Command `eomcheck compare`: one robot description, read and evaluated by several libraries."""

from __future__ import annotations

from typing import Annotated

import typer

from eomcheck.atomic_write import check_writable
from eomcheck.calls import PATIENCE, require_supervision
from eomcheck.cli.app import app
from eomcheck.cli.shared_options import Json, Patience, Seed, completer
from eomcheck.errors import InputError
from eomcheck.lab.option_parsing import check_count, split_list


@app.command("compare")
def compare_command(
    robot: Annotated[
        str,
        typer.Argument(
            metavar="ROBOT",
            help="Its description: robot.urdf, robot.urdf:floating with a free base, robot.xml.",
        ),
    ],
    engine: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY,KEY",
            help="Library to compare with, or several: a,b. [default: all installed]",
            callback=split_list,
            autocompletion=completer("engine"),
        ),
    ] = None,
    states: Annotated[int, typer.Option(help="Number of random states.")] = 20,
    seed: Seed = 0,
    pairs: Annotated[
        bool, typer.Option("--pairs", help="Also print each library beside each other.")
    ] = False,
    json: Json = None,
    patience: Patience = PATIENCE,
) -> None:
    """Compare the equations that libraries read from one file: M, bias, forces and accelerations.

    Exit code 1 if some differ by more than rounding, or one that is installed gives no answer; 2 if
    nothing was decided about any.
    """
    require_supervision()
    check_count(states=states)
    check_writable(json)
    from eomcheck.console import progress
    from eomcheck.lab.library_comparison import (
        compare_libraries,
        print_comparison,
        write_comparison,
    )
    from eomcheck.scene_lookup import is_robot, scene_named

    if not is_robot(robot):
        raise InputError(
            f"robot = {robot!r}, expected robot.urdf, robot.urdf:floating or robot.xml"
        )
    scene = scene_named(robot)
    with progress("comparing libraries at {state}", states) as advance:
        found = compare_libraries(scene, engine, states, seed, advance)
    if json is not None:
        write_comparison(found, json)
    print_comparison(found, pairs)
    if json is not None:
        print(f"written: {json}")
    if found.disagree or found.unanswered:
        raise typer.Exit(1)
    found.check_decided()

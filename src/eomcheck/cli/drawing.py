"""`eomcheck draw scene` and `draw structure`: pictures of mechanisms and of matrices."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eomcheck.cli.options import Kind, check_figure
from eomcheck.cli.study import draw
from eomcheck.errors import InputError
from eomcheck.files import check_writable

Links = Annotated[int | None, typer.Option(help="Number of links of scenes that have one.")]
Dark = Annotated[bool, typer.Option("--dark", help="For a dark ground.")]


@draw.command("scene")
def draw_scene(
    path: Annotated[
        Path, typer.Argument(help="File to write: .svg, .png, .pdf, or .gif, which moves.")
    ],
    scene: Kind = "snake",
    links: Links = None,
    dark: Dark = False,
    end: Annotated[float, typer.Option(help="A .gif: time at which the motion ends, s.")] = 2.0,
    frames: Annotated[int, typer.Option(help="A .gif: number of its pictures.")] = 40,
    formulation: Annotated[str, typer.Option(help="A .gif: by which it moves.")] = "au",
) -> None:
    """Draw a scene with its coordinates, axes and constraints named, or its motion."""
    moving = path.suffix == ".gif"
    if moving:
        check_writable(path)
    else:
        check_figure(path)
    from eomcheck.lab.mechanisms import kind_to_draw, posed, sketches_of_motion
    from eomcheck.lab.show import mechanism

    kind = kind_to_draw(scene)
    if moving and dark:
        raise InputError("--dark: a .gif has a light ground")
    if moving:
        sketches, times, every = sketches_of_motion(kind, links, formulation, end, frames)
        mechanism.draw_motion(sketches, times.tolist(), path, every)
    else:
        mechanism.draw_scene(*posed(kind, links), path, dark)
    print(f"written: {path}")


@draw.command("structure")
def draw_structure(
    path: Annotated[Path, typer.Argument(help="File to write, .svg, .png or .pdf.")],
    formulation: Annotated[str, typer.Option(help="Formulation.")] = "au",
    scene: Kind = "snake",
    links: Links = None,
    dark: Dark = False,
) -> None:
    """Draw which entries of a formulation's matrices are not zero, with their blocks named."""
    check_figure(path)
    from eomcheck.errors import named
    from eomcheck.formulations import FORMULATIONS
    from eomcheck.lab.mechanisms import kind_to_draw, moving_state
    from eomcheck.lab.show import structure
    from eomcheck.lab.structures import structure_of

    one = named("formulation", formulation, FORMULATIONS)
    structure.draw_structure(
        structure_of(*moving_state(kind_to_draw(scene), links, one)), path, dark
    )
    print(f"written: {path}")

"""`eomcheck draw scene` and `draw structure`: pictures of mechanisms and of matrices."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eomcheck.cli.complete import completing
from eomcheck.cli.options import (
    Formulation,
    Given,
    Links,
    One,
    check_figure,
    check_used,
    scene_asked,
)
from eomcheck.cli.study import draw
from eomcheck.files import check_writable
from eomcheck.lab.options import no_more_than, parameters

Dark = Annotated[bool, typer.Option("--dark", help="For a dark ground.")]


@draw.command("scene")
def draw_scene(
    path: Annotated[
        Path, typer.Argument(help="File to write: .svg, .png, .pdf, or .gif, which moves.")
    ],
    scene: One = "snake",
    links: Links = None,
    given: Given = None,
    dark: Dark = False,
    end: Annotated[
        float | None, typer.Option(help="A .gif: time at which the motion ends, s. [2]")
    ] = None,
    frames: Annotated[int | None, typer.Option(help="A .gif: number of its pictures. [40]")] = None,
    formulation: Annotated[
        str | None,
        typer.Option(
            metavar="KEY",
            help="A .gif: by which it moves. [au]",
            autocompletion=completing("formulation"),
        ),
    ] = None,
) -> None:
    """Draw a scene with its coordinates, axes and constraints named, or its motion."""
    moving = path.suffix == ".gif"
    if moving:
        check_writable(path)
        check_used("in a .gif, which has a light ground", dark=dark)
    else:
        check_figure(path)
        check_used("in a picture that is no .gif", end=end, frames=frames, formulation=formulation)
    known = parameters(given)
    from eomcheck.lab.mechanisms import posed, scene_to_draw, sketches_of_motion
    from eomcheck.lab.show.animation import draw_motion
    from eomcheck.lab.show.mechanism import draw_scene

    if moving:
        one = scene_asked(scene, links, given)
        until, count = 2.0 if end is None else end, 40 if frames is None else frames
        how = "au" if formulation is None else formulation
        sketches, times, every = sketches_of_motion(one, how, until, count)
        draw_motion(sketches, times.tolist(), path, every)
    else:
        draw_scene(*posed(*scene_to_draw(scene, no_more_than(links), known)), path, dark)
    print(f"written: {path}")


@draw.command("structure")
def draw_structure(
    path: Annotated[Path, typer.Argument(help="File to write, .svg, .png or .pdf.")],
    formulation: Formulation = "au",
    scene: One = "snake",
    links: Links = None,
    given: Given = None,
    dark: Dark = False,
) -> None:
    """Draw which entries of a formulation's matrices are not zero, with their blocks named."""
    check_figure(path)
    known = parameters(given)
    from eomcheck.formulations import formulation_of
    from eomcheck.lab.mechanisms import moving_state, scene_to_draw
    from eomcheck.lab.show import structure
    from eomcheck.lab.structures import structure_of

    one = formulation_of(formulation)
    state = moving_state(*scene_to_draw(scene, no_more_than(links), known), one)
    structure.draw_structure(structure_of(*state), path, dark)
    print(f"written: {path}")

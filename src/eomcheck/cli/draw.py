"""`eomcheck draw`: figures of what needs no records."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eomcheck.cli.options import Examples, Links, Seed, at_least_one, check_figure, interval

draw = typer.Typer(name="draw", help="Draw figures.", no_args_is_help=True)


@draw.command("agreement")
def draw_agreement(
    path: Annotated[Path, typer.Argument(help="File to write, .png or .svg.")],
    links: Annotated[int, typer.Option(help="Largest number of links.")] = 40,
    per_size: Annotated[int, typer.Option(help="Number of random snakes of each size.")] = 3,
    seed: Seed = 0,
) -> None:
    """Draw how far the formulations are apart on random snakes."""
    at_least_one(**{"links": links, "per-size": per_size})
    check_figure(path)
    from eomcheck.lab.show import figures
    from eomcheck.lab.studies.agreement import measure_agreement

    figures.draw_agreement(measure_agreement(links, per_size, seed), path)
    typer.echo(f"written: {path}")


@draw.command("accuracy")
def draw_accuracy(
    path: Annotated[Path, typer.Argument(help="File to write, .png or .svg.")],
    links: Links = "1..30",
    examples: Examples = 200,
    seed: Seed = 0,
) -> None:
    """Draw how many digits each formulation delivers in doubles."""
    check_figure(path)
    low, high = interval(links)
    at_least_one(examples=examples)
    from eomcheck.lab.show import figures
    from eomcheck.lab.studies.accuracy import measure_accuracy

    figures.draw_accuracy(measure_accuracy(low, high, examples, seed), path)
    typer.echo(f"written: {path}")

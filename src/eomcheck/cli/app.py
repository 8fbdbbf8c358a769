"""The command line itself, which commands of the other files join."""

from __future__ import annotations

from typing import Annotated

import typer

from eomcheck import __version__

app = typer.Typer(
    name="eomcheck",
    help="gradcheck for equations of motion: are they right, how accurate are they, what do they "
    "cost?",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"eomcheck {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print version."),
    ] = False,
) -> None:
    pass

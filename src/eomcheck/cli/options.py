"""What commands share: types of their options, and checks of what was asked for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from eomcheck import calls
from eomcheck.cli.complete import completing
from eomcheck.errors import InputError
from eomcheck.files import check_writable
from eomcheck.lab.options import ONE_HELP, SCENE_HELP, SET_HELP, listed, no_more_than, parameters

if TYPE_CHECKING:
    from eomcheck.lab.store.records import Records
    from eomcheck.mechanics.scene import Scene

SUITE = Path("validation")
REFERENCES = SUITE / "references"

_SCENES = completing("scene", more=["all"])

Kind = Annotated[str, typer.Option(metavar="SCENE", help=SCENE_HELP, autocompletion=_SCENES)]
ONE = "paper"
"""The scene of commands that look at one, unless another is named."""
One = Annotated[
    str, typer.Option(metavar="SCENE", help=ONE_HELP, autocompletion=completing("scene", "robot"))
]
OneOrNot = Annotated[
    str | None,
    typer.Option(metavar="SCENE", help=ONE_HELP, autocompletion=completing("scene", "robot")),
]
Links = Annotated[int | None, typer.Option(help="Number of links, of scenes that have one.")]
Given = Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help=SET_HELP)]
Formulation = Annotated[
    str, typer.Option(metavar="KEY", help="Formulation.", autocompletion=completing("formulation"))
]
Seed = Annotated[int, typer.Option(help="Seed of the draws.")]
Where = Annotated[
    str,
    typer.Option(metavar="PLACE", help="Where to compute: local, local:PROCESSES or dask:ADDRESS."),
]
Formulations = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KEY,KEY",
        help="Formulation, or several: a,b. Default all.",
        callback=listed,
        autocompletion=completing("formulation"),
    ),
]
Engines = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KEY,KEY",
        help="Engine to compare with, several: a,b, or your own to check: FILE.py:CLASS. "
        "Default those that no extra installs; none for no engine.",
        callback=listed,
        autocompletion=completing("engine", more=["none"]),
    ),
]
References = Annotated[Path, typer.Option(help="Folder of the reference solutions.")]
Measured = Annotated[Path, typer.Argument(help="SQLite file of the results, made or continued.")]
Fresh = Annotated[bool, typer.Option("--fresh", help="Measure everything anew.")]
Json = Annotated[Path | None, typer.Option("--json", help="Write the results to this file.")]
Kept = Annotated[
    Path | None,
    typer.Option("--records", help="Keep the results in this SQLite file, for `eomcheck report`."),
]


def _patient(seconds: float) -> float:
    if not 0 < seconds <= 1e6:
        raise InputError(f"patience = {seconds}, expected seconds, a positive number up to 1e6")
    calls.set_patience(seconds)
    return seconds


Patience = Annotated[
    float,
    typer.Option(
        metavar="SECONDS",
        callback=_patient,
        help="How long a call of your own code or of an outside library may take; the first call "
        f"of a function, and an import, {calls.FIRST} times as long.",
    ),
]


def scene_asked(name: str, links: int | None, given: list[str] | None) -> Scene:
    """Return the one scene that `--scene`, `--links` and `--set` stand for.

    Raises:
        InputError: there is none, see `eomcheck.named.scene_of`.
    """
    known = parameters(given)
    from eomcheck.named import scene_of

    return scene_of(name, no_more_than(links), known)


def engines_asked(names: list[str] | None) -> list[str] | None:
    """Return the engines that `--engine` names; an empty list of "none", None if not given."""
    return [] if names == ["none"] else names


def check_used(where: str, **options: object) -> None:
    """Raise InputError if an option was given that says nothing here.

    Args:
        where: what it would need, such as "without --draws".
        options: name -> value, None or False where it was not given.
    """
    for name, value in options.items():
        if value is not None and value is not False:
            raise InputError(f"--{name.replace('_', '-')} says nothing {where}")


def records_or_none(path: Path | None) -> AbstractContextManager[Records | None]:
    """Return the Records in a file, to enter; None without a file."""
    if path is None:
        return nullcontext()
    from eomcheck.lab.store.records import Records

    return Records(path)


@contextmanager
def records_to_report(path: Path | None, page: Path | None) -> Iterator[Records | None]:
    """Yield the Records in a file, or for a page without one, in a file that is thrown away.

    Raises:
        EngineError: there is to be a page, and what draws it is not installed.
    """
    if page is not None:
        from eomcheck.lab.report.page import check_installed

        check_installed()
    spare = TemporaryDirectory() if page is not None and path is None else nullcontext()
    with spare as folder, records_or_none(Path(folder) / "r.db" if folder else path) as records:
        yield records


def check_output(path: Path | None, records: list[Path]) -> None:
    """Check that `path` can be written and is none of the files of records, there yet or not."""
    check_writable(path)
    if path is None:
        return
    for one in records:
        there = path.exists() and one.exists()
        if path.samefile(one) if there else path.resolve() == one.resolve():
            raise InputError(f"{str(path)!r} holds the records themselves")


def raise_unread(unread: list[str]) -> None:
    """Raise InputError, once what can be read is shown, if something could not be read."""
    if unread:
        more = f" (and {len(unread) - 1} more)" if len(unread) > 1 else ""
        raise InputError(f"not all is shown: {unread[0]}{more}")


def check_folder(path: Path | None) -> None:
    """Raise InputError unless `path` is a folder that exists; None needs no folder."""
    if path is not None and not path.is_dir():
        raise InputError(f"{str(path)!r} is not a folder that exists")


def check_figure(path: Path | None) -> None:
    """Raise InputError unless `path` can be written and its name is a figure's, or it is None."""
    if path is not None and path.suffix not in (".png", ".svg", ".pdf"):
        raise InputError(f"{str(path)!r}: a figure is written as .png, .svg or .pdf")
    check_writable(path)

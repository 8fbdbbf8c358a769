"""`eomcheck study`: a command for every study, with the options of its cells."""

from __future__ import annotations

from inspect import Parameter, Signature
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer
from typer.core import TyperCommand, TyperGroup

from eomcheck.cli.options import (
    Examples,
    Fresh,
    Json,
    Kept,
    Links,
    Measured,
    Seed,
    at_least_one,
    check_folder,
    check_writable,
    interval,
    records_or_none,
)
from eomcheck.errors import InputError
from eomcheck.lab.studies import STUDIES, study_of

if TYPE_CHECKING:
    from eomcheck.lab.study import Study

Figures = Annotated[
    Path | None, typer.Option(help="Draw the figures and write the tables into this folder.")
]


class _Studies(TyperGroup):
    """All studies; the command of one is made, and its code imported, when it is run."""

    def list_commands(self, ctx: Any) -> list[str]:
        return [*STUDIES, *super().list_commands(ctx)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name in STUDIES:
            return TyperCommand(cmd_name, help=STUDIES[cmd_name], rich_markup_mode=None)
        return super().get_command(ctx, cmd_name)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name, command, rest = super().resolve_command(ctx, args)
        return name, command_of(name) if name in STUDIES else command, rest


study = typer.Typer(
    name="study",
    help="Study what formulations deliver and cost.",
    no_args_is_help=True,
    cls=_Studies,
)


def command_of(key: str) -> Any:
    """Return the command of a study: the file of its Records, its own options, and those of all."""
    one = study_of(key)

    def command(**given: Any) -> None:
        _run(one, **given)

    file = (Kept, None) if one.small else (Measured, Parameter.empty)
    shared = {"records": file, "fresh": (Fresh, False), "json": (Json, None)}
    parameters = {
        name: Parameter(name, Parameter.KEYWORD_ONLY, annotation=kind, default=default)
        for name, (kind, default) in (shared | {"figures": (Figures, None)}).items()
    }
    for name, parameter in one.options().items():
        parameters[name] = parameter.replace(annotation=_option(name, parameter.annotation))
    command.__signature__ = Signature([*parameters.values()])  # type: ignore[attr-defined]
    command.__annotations__ = {name: p.annotation for name, p in parameters.items()}
    alone = typer.Typer(rich_markup_mode=None, add_completion=False)
    alone.command(key, help=STUDIES[key])(command)
    return typer.main.get_command(alone)


def _option(name: str, annotation: Any) -> Any:
    """Return what typer reads of an option: its kind and help, a flag without its opposite."""
    kind, said = get_args(annotation)
    return Annotated[kind, typer.Option(*([f"--{name}"] if kind is bool else []), help=said)]


def _run(
    one: Study,
    records: Path | None,
    fresh: bool,
    json: Path | None,
    figures: Path | None,
    **options: Any,
) -> None:
    check_folder(figures)
    check_writable(json)
    one.check(**options)
    from eomcheck.lab.show.layout import write_json
    from eomcheck.lab.show.sheet import print_sheets
    from eomcheck.lab.store.records import Records

    with TemporaryDirectory() as spare, Records(records or Path(spare) / "r.db") as kept:
        found = one.measure(kept, fresh, **options)
    print_sheets(one.sheets(found))
    for sentence in one.said(found):
        typer.echo(sentence)
    written = [] if figures is None else one.write(found, figures)
    if json is not None:
        write_json(json, one.document(found))
        written.append(json)
    if written:
        typer.echo(f"written: {', '.join(map(str, written))}")
    if one.alarm(found):
        raise typer.Exit(1)


@study.command("accuracy")
def study_accuracy(
    links: Links = "1..30",
    examples: Examples = 200,
    seed: Seed = 0,
    hostile: Annotated[
        bool, typer.Option("--hostile", help="Draw snakes and states at the edge.")
    ] = False,
    json: Json = None,
) -> None:
    """Certify how many digits each formulation delivers in doubles, against ball arithmetic.

    Beside the public path, which states a bound of its error, machine code is held against it.
    """
    low, high = interval(links)
    at_least_one(examples=examples)
    check_writable(json)
    from eomcheck.lab.report.accuracy import print_accuracy
    from eomcheck.lab.report.benchmarks import write_records
    from eomcheck.lab.studies.accuracy import measure_accuracy

    records = measure_accuracy(low, high, examples, seed, hostile)
    print_accuracy(records)
    if json is not None:
        write_records(json, "accuracy", records)


@study.command("operations")
def study_operations(
    links: Annotated[
        str | None, typer.Option(help="Numbers of links, N or N..M. [2..100, with --scene 3]")
    ] = None,
    formulation: Annotated[
        list[str] | None, typer.Option(help="Formulation to count; repeat for more. Default all.")
    ] = None,
    scene: Annotated[
        str | None,
        typer.Option(help="Show what absent terms save instead, on a kind of scene or all."),
    ] = None,
    repeats: Annotated[
        int, typer.Option(help="With --scene: timed runs; the median counts. 0 for counts alone.")
    ] = 15,
    json: Json = None,
    records: Kept = None,
) -> None:
    """Count the operations of one right-hand side, exactly, for every number of links."""
    low, high = interval(links or ("2..100" if scene is None else "3"))
    check_writable(json)
    if scene is not None:
        _study_absent(scene, high, formulation, repeats, json)
        return
    from eomcheck.lab.report.operations import print_operations, write_operations
    from eomcheck.lab.studies.operations import (
        compare_springs,
        fit,
        measure,
        record_of,
        solved_systems,
    )

    with records_or_none(records) as kept:
        counted = measure(range(low, high + 1), formulation)
        if kept is not None:
            for one in counted:
                kept.add(record_of(one))
    fits, systems = fit(counted), solved_systems(counted)
    print_operations(counted, fits, systems, compare_springs(high, formulation))
    if json is not None:
        write_operations(json, counted, fits, systems)
        typer.echo(f"written: {json}")


def _study_absent(
    scene: str, links: int, formulation: list[str] | None, repeats: int, json: Path | None
) -> None:
    if repeats < 0:
        raise InputError(f"repeats = {repeats}, expected at least 0")
    from eomcheck.lab.report.absent import print_savings, write_savings
    from eomcheck.lab.studies.absent import savings
    from eomcheck.scenes.named import kinds_of

    found = savings(kinds_of(scene), links, formulation, repeats)
    print_savings(found)
    if json is not None:
        write_savings(json, found)
        typer.echo(f"written: {json}")

"""Commands `eomcheck study`, `bench` and `draw`: one for every study, and pictures of scenes.

The command of a study is generated: its options are those of the study's cells and worker. `draw`
also has `draw scene` and `draw structure`: pictures of mechanisms and of matrices.
"""

from __future__ import annotations

from inspect import Parameter, Signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin

import typer

from eomcheck.atomic_write import check_writable
from eomcheck.calls import PATIENCE
from eomcheck.cli.application import (
    Command,
    CommandEnd,
    CommandGroup,
    CommandLine,
    DeviationsOption,
    FormulationOption,
    Fresh,
    Json,
    Links,
    OldRecords,
    Patience,
    RecordsOption,
    SceneOption,
    SetOption,
    SpeedsOption,
    check_figure,
    check_folder,
    check_used,
    checked_seed,
    completer,
    selected_scene,
    selected_speeds,
)
from eomcheck.deprecated import print_notice
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.lab.option_parsing import (
    no_more_than,
    parse_numbers,
    parse_parameters,
    parse_whole_numbers,
    split_list,
)
from eomcheck.lab.studies import BENCHMARKS, DRAWN, STUDIES, study_of

if TYPE_CHECKING:
    from eomcheck.lab.store.record_file import Record
    from eomcheck.lab.study import Study


Picture = Annotated[Path, typer.Argument(metavar="FILE", help="File to write, .png, .svg or .pdf.")]
Dark = Annotated[bool, typer.Option("--dark", help="For a dark ground.")]
Figures = Annotated[
    Path | None,
    typer.Option(
        help="Draw the figures, .svg for a light and a dark ground, and write the tables into this "
        "folder."
    ),
]

Extend = Annotated[
    bool, typer.Option("--extend", help="Keep the libraries of the tables in --figures.")
]
Stored = Annotated[bool, typer.Option("--stored", help="Run nothing: use what --records has.")]


class _Studies(CommandGroup):
    """Command group of studies; a command is generated, and its module imported, when it is run."""

    def list_commands(self, ctx: Any) -> list[str]:
        return [*GROUPS[self.name or ""], *super().list_commands(ctx)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name in GROUPS[self.name or ""]:
            return Command(cmd_name, help=STUDIES[cmd_name], rich_markup_mode=None)
        return super().get_command(ctx, cmd_name)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        names = self.list_commands(ctx)
        if args[0] not in names:
            raise UnknownNameError(f"command of {self.name}", args[0], names)
        name, command, rest = super().resolve_command(ctx, args)
        if name in GROUPS[self.name or ""]:
            command = command_of(str(name), figure_only=self.name == "draw")
        return name, command, rest


GROUPS = {
    "study": [key for key in STUDIES if key not in BENCHMARKS],
    "bench": BENCHMARKS,
    "draw": DRAWN,
}
"""Command group -> keys of its studies."""

study, bench, draw = (
    CommandLine(name=name, help=help, no_args_is_help=True, cls=_Studies)
    for name, help in (
        ("study", "Study what formulations deliver and cost."),
        ("bench", "Measure run times and tolerances."),
        ("draw", "Draw figures."),
    )
)


def command_of(key: str, figure_only: bool = False) -> Any:
    """Return the command of a study: its own options, and those that all studies share.

    Typer reads options from a signature. This one is composed, of the shared options and those of
    `Study.cells`, so that no option is declared twice.

    Args:
        key: key of the study.
        figure_only: whether the command only draws the first chart into a file.
    """
    one = study_of(key)

    def command(file: Path | None = None, **options: Any) -> None:
        del options["patience"]
        if file is not None:
            if options.get("records") is not None:
                raise InputError(f"{str(file)!r} and --records are both given, expected one")
            print_notice(f"study {key} FILE", f"study {key} --records FILE")
            options["records"] = file
        if options["records"] is None and not one.small:
            raise InputError(f"no file is given, and {key} takes long: --records FILE")
        (_draw if figure_only else _run)(one, **options)

    options: dict[str, tuple[Any, Any]] = {
        **({"path": (Picture, Parameter.empty), "dark": (Dark, False)} if figure_only else {}),
        **({} if one.small else {"file": (OldRecords, None)}),
        "records": (RecordsOption, None),
        "fresh": (Fresh, False),
        "patience": (Patience, PATIENCE),
        "stored": (Stored, False),
        **({} if figure_only else {"json": (Json, None), "figures": (Figures, None)}),
        **({"extend": (Extend, False)} if one.extends and not figure_only else {}),
        **({} if one.observations is None else {"deviations": (DeviationsOption, None)}),
        **{x: (_option(x, p.annotation), p.default) for x, p in one.options().items()},
    }
    command.__signature__ = Signature(  # type: ignore[attr-defined]
        [
            Parameter(name, Parameter.KEYWORD_ONLY, annotation=kind, default=default)
            for name, (kind, default) in options.items()
        ]
    )
    command.__annotations__ = {name: kind for name, (kind, _) in options.items()}
    alone = CommandLine(rich_markup_mode=None, add_completion=False)
    alone.command(key, help=STUDIES[key])(command)
    return typer.main.get_command(alone)


COMPLETED = {
    "scene": completer("scene", more=["all"]),
    "formulation": completer("formulation"),
    "engine": completer("engine"),
}
"""Option name -> shell completion of its values."""
METAVARS = {
    **{"links": "N..M", "set": "NAME=VALUE", "executor": "PLACE", "scene": "SCENE"},
    **{"robot": "FILE,FILE", "free": "FILE,FILE"},
}
"""Option name -> placeholder of its value in help."""


def _option(name: str, annotation: Any) -> Any:
    """Return the typer annotation of an option: its type and help, a flag without its opposite.

    Lists are parsed from "1,0.5" and from repeated options; values of `--set` contain commas of
    their own.
    """
    kind, help_text = get_args(annotation)
    parse: Any = checked_seed if name == "seed" else None
    lists = [get_args(one)[0] for one in (kind, *get_args(kind)) if get_origin(one) is list]
    if lists and name != "set":
        (of,) = lists
        kinds = {str: split_list, int: lambda texts: _whole(name, texts)}
        parse = kinds.get(of, lambda texts: parse_numbers(name, texts, of) or None)
        kind = list[str] | None
    flag = [f"--{name}"] if kind is bool else []
    listed_as = "KEY,KEY" if str in lists else "X,X" if lists else None
    shown = METAVARS.get(name, listed_as)
    how = {"callback": parse, "metavar": shown, "autocompletion": COMPLETED.get(name)}
    return Annotated[kind, typer.Option(*flag, help=help_text, **how)]


def _whole(name: str, texts: list[str] | None) -> list[int] | None:
    """Return the whole numbers of a list option; those of `--links` may be ranges."""
    if name != "links":
        return parse_numbers(name, texts, int) or None
    return (
        list(
            dict.fromkeys(x for text in split_list(texts) or [] for x in parse_whole_numbers(text))
        )
        or None
    )


def _run(
    one: Study,
    records: Path | None,
    fresh: bool,
    json: Path | None,
    figures: Path | None,
    deviations: Path | None = None,
    extend: bool = False,
    **options: Any,
) -> None:
    check_folder(figures)
    if extend and figures is None:
        raise InputError("--extend is given without --figures, expected the folder of the tables")
    check_writable(json)
    from eomcheck.lab.deviations import read_deviations
    from eomcheck.lab.show.table import print_tables, say, write_json
    from eomcheck.lab.study import failed

    known = None if deviations is None else read_deviations(deviations)
    results = _run_study(one, records, fresh, options)
    # Files first, so that they are written even if printing fails.
    end, written = CommandEnd(), list[Path]()
    with end.collected():
        written += [] if figures is None else one.write(results, figures, extend)
        if json is not None:
            write_json(json, one.document(results))
            written.append(json)
    print_tables(one.tables(results))
    for sentence in one.remarks(results):
        say(sentence)
    alarm = one.alarm(results)
    if known is not None and one.observations is not None:
        alarm = known.differ(one.observations(results)) or failed(results)
    end.conclude(written, alarm)


def _run_study(
    one: Study, records: Path | None, fresh: bool, options: dict[str, Any]
) -> list[Record]:
    """Run a study; on an interrupt, print how to resume it."""
    from eomcheck.console import interruptible

    try:
        with interruptible():
            return one.run(records, fresh, **options)
    except KeyboardInterrupt:
        again = " without --fresh" if fresh else ""
        print(
            "interrupted: nothing is kept without a file of records"
            if records is None
            else f"interrupted: {str(records)!r} has all cells that were finished; the same command"
            f"{again} goes on with the others"
        )
        raise typer.Exit(130) from None


def _draw(
    one: Study, path: Path, dark: bool, records: Path | None, fresh: bool, **options: Any
) -> None:
    check_figure(path)
    from eomcheck.lab.show.chart_matplotlib import draw_chart

    chart = next(iter(one.charts(_run_study(one, records, fresh, options))))
    draw_chart(chart.files()[0], path, dark)
    print(f"written: {path}")


# ---- Pictures of scenes and of matrices ----------------------------------------------------------


@draw.command("scene")
def draw_scene_command(
    path: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="File to write: .svg, .png, .pdf, .gif, which moves, or .html, which is turned.",
        ),
    ],
    scene: SceneOption = "snake",
    links: Links = None,
    settings: SetOption = None,
    dark: Dark = False,
    end: Annotated[
        float | None,
        typer.Option(
            metavar="END",
            help="A .gif or .html: end of its motion, s. [default: 2; in a .html no motion]",
        ),
    ] = None,
    frames: Annotated[
        int | None,
        typer.Option(help="A .gif or .html: number of poses of its motion. [default: 40]"),
    ] = None,
    speeds: SpeedsOption = None,
    formulation: Annotated[
        str | None,
        typer.Option(
            metavar="KEY",
            help="A .gif or .html: by which it moves. [default: au]",
            autocompletion=completer("formulation"),
        ),
    ] = None,
) -> None:
    """Draw a scene with its coordinates, axes and constraints named, or its motion."""
    page = path.suffix == ".html"
    moving = path.suffix == ".gif" or (page and end is not None)
    check_figure(path, ".gif", ".html")
    if moving or page:
        check_used("in a .gif, which has a light ground, and in a .html, which has both", dark=dark)
    if not moving:
        check_used(
            "in a .html without --end" if page else "in a picture that is no .gif or .html",
            **{"end": end, "frames": frames, "formulation": formulation, "speeds": speeds},
        )
    parameters = parse_parameters(settings)
    from eomcheck.lab.show.pictures import (
        draw_motion,
        draw_scene,
        posed_sketch,
        scene_to_draw,
        sketches_of_motion,
    )

    if moving:
        chosen_scene = selected_scene(scene, links, settings)
        until, count = 2.0 if end is None else end, 40 if frames is None else frames
        how = "au" if formulation is None else formulation
        u0 = selected_speeds(chosen_scene, speeds)
        if page:
            from eomcheck.lab.show.viewer_plotly import states_of_motion, write_viewer

            write_viewer(chosen_scene, states_of_motion(chosen_scene, how, until, count, u0), path)
            print(f"written: {path}")
            return
        sketches, times, every = sketches_of_motion(chosen_scene, how, until, count, u0)
        draw_motion(sketches, times.tolist(), path, every)
    elif page:
        from eomcheck.lab.show.viewer_plotly import shown_state, write_viewer

        shown, q = scene_to_draw(scene, no_more_than(links), parameters)
        write_viewer(shown, [shown_state(shown, q)], path)
    else:
        draw_scene(
            *posed_sketch(*scene_to_draw(scene, no_more_than(links), parameters)), path, dark
        )
    print(f"written: {path}")


@draw.command("structure")
def draw_structure_command(
    path: Picture,
    formulation: FormulationOption = "au",
    scene: SceneOption = "snake",
    links: Links = None,
    settings: SetOption = None,
    dark: Dark = False,
) -> None:
    """Draw the nonzero entries of a formulation's matrices, with their blocks named."""
    check_figure(path)
    parameters = parse_parameters(settings)
    from eomcheck.formulations import formulation_of
    from eomcheck.lab.show.pictures import (
        draw_structure,
        moving_state,
        scene_to_draw,
        structure_of,
    )

    chosen_formulation = formulation_of(formulation)
    state = moving_state(*scene_to_draw(scene, no_more_than(links), parameters), chosen_formulation)
    draw_structure(structure_of(*state), path, dark)
    print(f"written: {path}")

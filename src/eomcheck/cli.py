"""The command line: `eomcheck validate`, `eomcheck list`, `eomcheck bench`, `eomcheck study`.

Exit codes: 0 all claims hold, 1 some claim fails, 2 bad input, 130 interrupted (what was found
until then is printed and saved). Each command imports what it needs when it runs.
"""

from __future__ import annotations

import os
import re
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from eomcheck import __version__
from eomcheck.errors import EomcheckError, InputError, WorkerError

app = typer.Typer(
    name="eomcheck",
    help="gradcheck for equations of motion: are they right, how accurate are they, what do they "
    "cost?",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
bench = typer.Typer(help="Measure run times and tolerances.", no_args_is_help=True)
app.add_typer(bench, name="bench")
study = typer.Typer(help="Study what formulations deliver and cost.", no_args_is_help=True)
app.add_typer(study, name="study")
draw = typer.Typer(help="Draw figures.", no_args_is_help=True)
app.add_typer(draw, name="draw")


class Registry(StrEnum):
    """What `eomcheck list` can list."""

    FORMULATIONS = "formulations"
    SCENES = "scenes"
    ENGINES = "engines"
    CLAIMS = "claims"


def main() -> None:
    """Run the command line; bad input is one sentence and exit code 2."""
    # Matrices of a few hundred rows gain nothing from threads, and lose much where other programs
    # run. Libraries read this when they are loaded, which is after this line.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    try:
        app()
    except EomcheckError as error:
        typer.echo(f"eomcheck: {error}", err=True)
        sys.exit(2)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"eomcheck {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print version."),
    ] = False,
) -> None:
    pass


MOST_LINKS = 100_000
REFERENCES = Path("validation/references")


def whole_numbers(text: str) -> list[int]:
    """Return the numbers of "3", "1..12" or "1..12,20,50".

    Raises:
        InputError: none of these.
    """
    numbers: set[int] = set()
    for part in text.split(","):
        low, high = interval(part)
        numbers |= set(range(low, high + 1))
    return sorted(numbers)


def interval(text: str) -> tuple[int, int]:
    """Return (low, high) of "3" or "1..12".

    Raises:
        InputError: neither.
    """
    match = re.fullmatch(r"(\d+)(?:\.\.(\d+))?", text.strip())
    if match is None:
        raise InputError(f"links = {text!r}, expected a number or a range such as 1..12")
    low, high = int(match[1]), int(match[2] or match[1])
    if not 1 <= low <= high:
        raise InputError(f"links = {text!r}, expected 1 <= first <= last")
    if high > MOST_LINKS:
        raise InputError(f"links = {text!r}, expected at most {MOST_LINKS}")
    return low, high


Links = Annotated[str, typer.Option(help="Number of links of the random snakes, N or N..M.")]
Kind = Annotated[
    str, typer.Option(help="Kind of scene, all of them, or one in a file: path/to/file.py:Class.")
]
Examples = Annotated[int, typer.Option(help="Number of random snakes and states.")]
Seed = Annotated[int, typer.Option(help="Seed of the draws.")]
Where = Annotated[
    str, typer.Option(help="Where to compute: local, local:PROCESSES or dask:ADDRESS.")
]
Json = Annotated[Path | None, typer.Option("--json", help="Write the results to this file.")]


@app.command()
def validate(
    scene: Kind = "snake",
    links: Annotated[
        str | None, typer.Option(help="Number of links of the random scenes, N or N..M. [1..12]")
    ] = None,
    examples: Annotated[int, typer.Option(help="Number of random scenes and states.")] = 60,
    seed: Seed = 0,
    engine: Annotated[
        list[str] | None, typer.Option(help="Engine to compare with; repeat for more. Default all.")
    ] = None,
    formulation: Annotated[
        list[str] | None, typer.Option(help="Formulation to check; repeat for more. Default all.")
    ] = None,
    json: Json = None,
) -> None:
    """Check every claim on the example of a scene (the paper's robot) and on random ones."""
    bounds = interval("1..12" if links is None else links)
    _at_least_one(examples=examples)
    _check_writable(json)

    from eomcheck.checks.validate import Run, Selection
    from eomcheck.console import console, progress
    from eomcheck.report.findings import print_run, print_scenes, write_json
    from eomcheck.scenes.named import kinds_of

    kinds = kinds_of(scene)
    if links is not None and not any(kind.has_links for kind in kinds):
        raise InputError(f"links = {links!r}: {kinds[0].key} has no number of links to choose")
    selection = Selection.of(formulation, engine, scenes=kinds)
    for made in selection.engines:
        made.version()  # a missing library is bad input, said before anything is computed
    runs = {kind.key: Run() for kind in kinds}
    interrupted = False
    with progress("checking", (examples + 2) * len(kinds)) as advance:
        try:
            for kind in kinds:
                runs[kind.key].look_at_kind(kind, selection, bounds, examples, seed, advance)
        except KeyboardInterrupt:
            interrupted = True
    findings = [finding for run in runs.values() for finding in run.finish(selection)]
    if len(kinds) == 1:
        print_run(runs[kinds[0].key], selection)
    else:
        print_scenes(runs, selection)
    if json is not None:
        write_json(json, runs.values(), selection)
        typer.echo(f"written: {json}")
    if interrupted:
        console.print("interrupted: the table holds what was checked until then")
        raise typer.Exit(130)
    if any(finding.verdict == "failed" for finding in findings):
        raise typer.Exit(1)


@app.command()
def prove(
    links: Annotated[
        str | None,
        typer.Option(help="Numbers of links, such as 2..100 or 1..12,20,50. [1..12,20,50,100]"),
    ] = None,
    points: Annotated[int, typer.Option(help="Random points per identity.")] = 4,
    seed: Annotated[
        int | None, typer.Option(help="Seed of the draws. Default: drawn by the operating system.")
    ] = None,
    scene: Kind = "snake",
    formulation: Annotated[
        list[str] | None, typer.Option(help="Formulation to prove; repeat for more. Default all.")
    ] = None,
    executor: Where = "local",
    json: Json = None,
) -> None:
    """Prove the claims that are identities, for all parameters and states of a scene at once."""
    numbers = None if links is None else whole_numbers(links)
    _check_writable(json)

    from eomcheck.report.proofs import print_proofs
    from eomcheck.studies.proofs import Proofs, proof_jobs
    from eomcheck.studies.spread import check_place

    proofs = Proofs(proof_jobs(scene, numbers, points, seed, formulation), json, executor)
    check_place(executor)
    try:
        proofs.run()
    except WorkerError:
        print_proofs(proofs)
        raise
    except KeyboardInterrupt:
        print_proofs(proofs)
        raise typer.Exit(130) from None
    print_proofs(proofs)
    if json is not None:
        proofs.write()
        typer.echo(f"written: {json}")
    if proofs.failed:
        raise typer.Exit(1)


def _at_least_one(**numbers: int) -> None:
    for name, value in numbers.items():
        if value < 1:
            raise InputError(f"{name} = {value}, expected at least 1")


def _check_writable(path: Path | None) -> None:
    if path is None:
        return
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise InputError(f"{str(path)!r} is not a file in a folder that exists")
    new = not path.exists()
    try:
        with path.open("a", encoding="utf-8"):
            pass
        if new:
            path.unlink()
    except OSError as error:
        raise InputError(f"{str(path)!r} cannot be written: {error.strerror}") from None


def _check_folder(path: Path) -> None:
    if not path.is_dir():
        raise InputError(f"{str(path)!r} is not a folder that exists")


def _check_figure(path: Path) -> None:
    if path.suffix not in (".png", ".svg", ".pdf"):
        raise InputError(f"{str(path)!r}: a figure is written as .png, .svg or .pdf")
    _check_writable(path)


class Robot(StrEnum):
    """The snakes that the command line knows by name."""

    PAPER = "paper"
    COIL = "coil"
    PATTERN = "pattern"


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
    formulation: Annotated[
        list[str] | None, typer.Option(help="Formulation; repeat for more. Default all.")
    ] = None,
    integrator: Annotated[str, typer.Option(help="Integrator.")] = "DOP853",
    tolerance: Annotated[float, typer.Option(help="rtol = atol.")] = 1e-9,
    max_steps: Annotated[int, typer.Option(help="Give up after so many; 0 for no limit.")] = 0,
    baumgarte: Annotated[
        float | None, typer.Option(help="Feed the constraint error back at this rate, 1/s.")
    ] = None,
    projection: Annotated[
        float | None, typer.Option(help="Project the velocity at intervals of so many s.")
    ] = None,
) -> None:
    """Integrate a motion by each formulation, and print how well it kept energy and constraints.

    With --baumgarte or --projection, by each formulation to which it applies. Exit code 1 if a
    motion does not reach its end.
    """
    from dataclasses import replace

    import eomcheck
    from eomcheck.formulations import formulations_for
    from eomcheck.report.trajectories import print_trajectories
    from eomcheck.scenes import Snake
    from eomcheck.scenes.snake import whole_links

    makers = {Robot.COIL: Snake.coil, Robot.PATTERN: Snake.pattern}
    if whole_links(links) > MOST_LINKS:
        raise InputError(f"links = {links}, expected at most {MOST_LINKS}")
    scene = Snake.paper() if robot is Robot.PAPER else makers[robot](links)
    for name, value in (("stiffness", stiffness), ("damping", damping)):
        if value is not None:
            scene = replace(scene, **{name: [value] * (scene.links - 1)})
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
    formulation: Annotated[
        list[str] | None, typer.Option(help="Formulation; repeat for more. Default all.")
    ] = None,
) -> None:
    """Print what each formulation says at the start, how far to trust it, or why it refuses.

    Exit code 1 if one refuses.
    """
    from eomcheck.report.accelerations import print_accelerations
    from eomcheck.scenes import Snake
    from eomcheck.scenes.snake import whole_links

    makers = {Robot.COIL: Snake.coil, Robot.PATTERN: Snake.pattern}
    if whole_links(links) > MOST_LINKS:
        raise InputError(f"links = {links}, expected at most {MOST_LINKS}")
    scene = Snake.paper() if robot is Robot.PAPER else makers[robot](links)
    if print_accelerations(scene, speeds, formulation):
        raise typer.Exit(1)


@app.command("list")
def list_registry(
    registry: Annotated[Registry, typer.Argument(help="What to list.")],
) -> None:
    """List formulations, scenes, engines or claims."""
    from eomcheck.report.registries import print_registry

    print_registry(registry.value)


@app.command("export")
def export_records(
    records: Annotated[Path, typer.Argument(help="File of records that a study wrote.")],
    file: Annotated[
        Path | None, typer.Argument(help="File to write. Default: standard output.")
    ] = None,
    csv: Annotated[
        bool, typer.Option("--csv", help="As CSV; there is no other format yet.")
    ] = True,
) -> None:
    """Write the records of a study as a table: one line per cell, one column per value."""
    _check_writable(file)
    if file is not None and file.exists() and records.exists() and file.samefile(records):
        raise InputError(f"{str(file)!r} holds the records themselves")
    from eomcheck.report.records import write_csv
    from eomcheck.studies.records import Records

    with Records(records, readonly=True) as opened:
        found = opened.all()
    if file is None:
        write_csv(found, sys.stdout)
        return
    with file.open("w", encoding="utf-8", newline="") as output:
        write_csv(found, output)
    typer.echo(f"written: {file}")


@bench.command("rhs")
def bench_rhs(
    links: Annotated[
        list[int] | None, typer.Option(help="Number of links; repeat for more.")
    ] = None,
    formulation: Annotated[
        list[str] | None, typer.Option(help="Formulation to time; repeat for more. Default all.")
    ] = None,
    repeats: Annotated[int, typer.Option(help="Timed runs; the median counts.")] = 15,
    json: Json = None,
) -> None:
    """Time one right-hand side of each formulation over the number of links."""
    _check_writable(json)
    from eomcheck.studies.rhs import measure_all
    from eomcheck.report.benchmarks import print_rhs, write_records  # isort: skip

    records = measure_all(links, formulation, repeats)
    print_rhs(records)
    if json is not None:
        write_records(json, "timings", records)


@bench.command("motion")
def bench_motion(
    formulation: Annotated[
        list[str] | None, typer.Option(help="Formulation to time; repeat for more. Default all.")
    ] = None,
    json: Json = None,
) -> None:
    """Time a motion of the paper's robot, compiled throughout and through Python."""
    _check_writable(json)
    from eomcheck.studies.motion import measure_motions
    from eomcheck.report.benchmarks import print_motions, write_records  # isort: skip

    records = measure_motions(formulation)
    print_motions(records)
    if json is not None:
        write_records(json, "motions", records)


@bench.command("tolerance")
def bench_tolerance(
    links: Links = "1..40",
    examples: Examples = 200,
    seed: Seed = 0,
) -> None:
    """Measure observed / (κ ε scale) per claim: what the constant C of the tolerances rests on."""
    low, high = interval(links)
    from eomcheck.report.benchmarks import print_tolerance
    from eomcheck.studies.tolerance import measure_constant

    print_tolerance(measure_constant(low, high, examples, seed))


@study.command("accuracy")
def study_accuracy(
    links: Links = "1..30",
    examples: Examples = 200,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Certify how many digits each formulation delivers in doubles, against ball arithmetic."""
    low, high = interval(links)
    _at_least_one(examples=examples)
    _check_writable(json)
    from eomcheck.report.accuracy import print_accuracy
    from eomcheck.report.benchmarks import write_records
    from eomcheck.studies.accuracy import measure_accuracy

    records = measure_accuracy(low, high, examples, seed)
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
) -> None:
    """Count the operations of one right-hand side, exactly, for every number of links."""
    low, high = interval(links or ("2..100" if scene is None else "3"))
    _check_writable(json)
    if scene is not None:
        _study_absent(scene, high, formulation, repeats, json)
        return
    from eomcheck.report.operations import print_operations, write_operations
    from eomcheck.studies.operations import compare_springs, fit, measure, solved_systems

    records = measure(range(low, high + 1), formulation)
    fits, systems = fit(records), solved_systems(records)
    print_operations(records, fits, systems, compare_springs(high, formulation))
    if json is not None:
        write_operations(json, records, fits, systems)
        typer.echo(f"written: {json}")


def _study_absent(
    scene: str, links: int, formulation: list[str] | None, repeats: int, json: Path | None
) -> None:
    if repeats < 0:
        raise InputError(f"repeats = {repeats}, expected at least 0")
    from eomcheck.report.absent import print_savings, write_savings
    from eomcheck.scenes.named import kinds_of
    from eomcheck.studies.absent import savings

    found = savings(kinds_of(scene), links, formulation, repeats)
    print_savings(found)
    if json is not None:
        write_savings(json, found)
        typer.echo(f"written: {json}")


@app.command()
def reference(
    names: Annotated[
        list[str] | None, typer.Argument(help="References to compute. Default all.")
    ] = None,
    folder: Annotated[Path, typer.Option(help="Folder to write to.")] = REFERENCES,
    executor: Where = "local",
) -> None:
    """Compute reference solutions, each by two derivations, and write them."""
    _check_folder(folder)
    from eomcheck.report.references import print_references
    from eomcheck.studies.references import CASES, case_of, produce_all, write_reference
    from eomcheck.studies.spread import check_place

    cases = {name: case_of(name) for name in names or CASES}
    for name in cases:
        _check_writable(folder / f"{name}.json")
    check_place(executor)
    for made in produce_all(cases, executor):
        path = write_reference(made, folder)
        print_references([made])
        typer.echo(f"written: {path}")


@study.command("work-precision")
def study_work_precision(
    records: Annotated[Path, typer.Argument(help="SQLite file of the results, made or continued.")],
    reference: Annotated[
        list[str] | None, typer.Option(help="Reference solution; repeat for more. [paper-rest]")
    ] = None,
    formulation: Annotated[
        list[str] | None, typer.Option(help="Formulation; repeat for more. Default all.")
    ] = None,
    integrator: Annotated[
        list[str] | None, typer.Option(help="Integrator; repeat for more. Default all.")
    ] = None,
    tolerance: Annotated[
        list[float] | None, typer.Option(help="rtol = atol; repeat for more. [1e-3 .. 1e-13]")
    ] = None,
    references: Annotated[
        Path, typer.Option(help="Folder of the reference solutions.")
    ] = REFERENCES,
    fresh: Annotated[bool, typer.Option("--fresh", help="Measure everything anew.")] = False,
    figure: Annotated[
        Path | None, typer.Option(help="Draw the errors against run time into this file.")
    ] = None,
) -> None:
    """Measure error against run time: formulations, integrators and tolerances."""
    if figure is not None:
        _check_figure(figure)
    from eomcheck.report.work_precision import draw_work_precision, print_work_precision
    from eomcheck.studies.records import Records
    from eomcheck.studies.work_precision import measure, plan

    planned = plan(references, reference, formulation, integrator, tolerance)
    with Records(records) as kept:
        found = measure(planned, kept, fresh)
    print_work_precision(found)
    if figure is not None:
        draw_work_precision(found, figure)
        rates = figure.with_stem(f"{figure.stem}-rhs")
        draw_work_precision(found, rates, "right-hand sides")
        typer.echo(f"written: {figure}, {rates}")


@study.command("stability")
def study_stability(
    records: Annotated[Path, typer.Argument(help="SQLite file of the results, made or continued.")],
    family: Annotated[
        list[str] | None, typer.Option(help="Family of states; repeat for more. Default all.")
    ] = None,
    formulation: Annotated[
        list[str] | None, typer.Option(help="Formulation; repeat for more. Default all.")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="A few severities of each family.")
    ] = False,
    fresh: Annotated[bool, typer.Option("--fresh", help="Measure everything anew.")] = False,
    executor: Where = "local",
    figures: Annotated[
        Path | None, typer.Option(help="Folder to draw the atlas and a figure a family into.")
    ] = None,
) -> None:
    """Drive every formulation through states of growing severity, and certify what it delivers."""
    if figures is not None:
        _check_folder(figures)
    from eomcheck.report.stability import draw_all, print_stability
    from eomcheck.studies.records import Records
    from eomcheck.studies.spread import check_place
    from eomcheck.studies.stability import Outcome, measure, outcome, plan

    planned = plan(family, formulation, quick)
    check_place(executor)
    with Records(records) as kept:
        found = measure(planned, kept, executor, fresh)
    print_stability(found)
    if figures is not None:
        paths = draw_all(found, figures)
        typer.echo(f"written: {', '.join(map(str, paths))}")
    if any(outcome(record) is Outcome.SILENT for record in found):
        raise typer.Exit(1)


@study.command("stiff")
def study_stiff(
    records: Annotated[Path, typer.Argument(help="SQLite file of the results, made or continued.")],
    stiffness: Annotated[
        list[float] | None, typer.Option(help="Joint stiffness, N m/rad; repeat for more.")
    ] = None,
    formulation: Annotated[
        list[str] | None, typer.Option(help="Formulation; repeat for more. [kane]")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="A few stiffnesses and tolerances.")
    ] = False,
    references: Annotated[
        Path, typer.Option(help="Folder of the reference solutions.")
    ] = REFERENCES,
    fresh: Annotated[bool, typer.Option("--fresh", help="Measure everything anew.")] = False,
    figures: Annotated[Path | None, typer.Option(help="Draw the figures into this folder.")] = None,
) -> None:
    """Compare explicit and implicit integrators on joints that are stiff, damped and not."""
    if figures is not None:
        _check_folder(figures)
    from eomcheck.report.stiff import draw_stiff, print_stiff
    from eomcheck.studies.records import Records
    from eomcheck.studies.stiff import measure, plan

    planned = plan(quick, stiffness, formulation)
    with Records(records) as kept:
        found = measure(planned, kept, references, fresh)
    print_stiff(found)
    if figures is not None:
        typer.echo(f"written: {', '.join(map(str, draw_stiff(found, figures)))}")


@study.command("long-run")
def study_long_run(
    records: Annotated[Path, typer.Argument(help="SQLite file of the results, made or continued.")],
    formulation: Annotated[
        list[str] | None, typer.Option(help="Formulation; repeat for more. Default all.")
    ] = None,
    t_end: Annotated[float | None, typer.Option(help="End, s. [1000]")] = None,
    tolerance: Annotated[float | None, typer.Option(help="rtol = atol. [1e-6]")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="30 s by two formulations only.")] = False,
    fresh: Annotated[bool, typer.Option("--fresh", help="Measure everything anew.")] = False,
    figure: Annotated[
        Path | None, typer.Option(help="Draw the errors over time into this file.")
    ] = None,
) -> None:
    """Measure how constraint and energy errors grow in 1 000 s, stabilized and not."""
    if figure is not None:
        _check_figure(figure)
    from eomcheck.report.long_run import draw_long_run, print_long_run
    from eomcheck.studies.long_run import measure, plan
    from eomcheck.studies.records import Records

    planned = plan(quick, t_end, tolerance, formulation)
    with Records(records) as kept:
        found = measure(planned, kept, fresh)
    print_long_run(found)
    if figure is not None:
        draw_long_run(found, figure)
        typer.echo(f"written: {figure}")


@study.command("paper")
def study_paper(
    records: Annotated[Path, typer.Argument(help="SQLite file of the results, made or continued.")],
    quick: Annotated[
        bool, typer.Option("--quick", help="Four numbers of links and one tolerance only.")
    ] = False,
    fresh: Annotated[bool, typer.Option("--fresh", help="Measure everything anew.")] = False,
    figures: Annotated[
        Path | None, typer.Option(help="Draw the figures and write the tables into this folder.")
    ] = None,
) -> None:
    """Repeat the paper's simulations, Table I and Figs. 2 to 7, and judge its claims by them."""
    if figures is not None:
        _check_folder(figures)
    from eomcheck.report.paper import print_paper, write_sheets
    from eomcheck.report.paper_figures import draw_paper
    from eomcheck.studies.paper import FULL, QUICK, Found, measure
    from eomcheck.studies.records import Records

    with Records(records) as kept:
        found = measure(QUICK if quick else FULL, kept, fresh)
    print_paper(found)
    if figures is not None:
        written = [*draw_paper(Found(found), figures), *write_sheets(found, figures)]
        typer.echo(f"written: {', '.join(map(str, written))}")


@draw.command("agreement")
def draw_agreement(
    path: Annotated[Path, typer.Argument(help="File to write, .png or .svg.")],
    links: Annotated[int, typer.Option(help="Largest number of links.")] = 40,
    per_size: Annotated[int, typer.Option(help="Number of random snakes of each size.")] = 3,
    seed: Seed = 0,
) -> None:
    """Draw how far the formulations are apart on random snakes."""
    _at_least_one(**{"links": links, "per-size": per_size})
    _check_figure(path)
    from eomcheck.report import figures
    from eomcheck.studies.agreement import measure_agreement

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
    _check_figure(path)
    low, high = interval(links)
    _at_least_one(examples=examples)
    from eomcheck.report import figures
    from eomcheck.studies.accuracy import measure_accuracy

    figures.draw_accuracy(measure_accuracy(low, high, examples, seed), path)
    typer.echo(f"written: {path}")

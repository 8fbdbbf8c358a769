"""Commands that check and report: `validate`, `prove`, `list`, `report`, `compare` and others."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eomcheck.atomic_write import check_writable, write_text
from eomcheck.calls import PATIENCE, require_supervision
from eomcheck.cli.application import (
    REFERENCES,
    SUITE,
    Claims,
    CommandEnd,
    DeviationsOption,
    Engines,
    ExecutorOption,
    Formulations,
    IsolatedOption,
    Json,
    Links,
    OptionalSceneOption,
    Patience,
    RecordsOption,
    ReportedClaims,
    SceneClassOption,
    SceneOption,
    Seed,
    SetOption,
    SpeedsOption,
    app,
    check_folder,
    check_output,
    check_used,
    executor_option,
    keys_option,
    raise_unread,
    records_or_none,
    records_to_report,
    scene_option,
    seed_option,
    selected_engines,
    selected_scene,
    selected_speeds,
)
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.lab.option_parsing import (
    SCENE_HELP,
    check_count,
    parse_interval,
    parse_parameters,
    parse_whole_numbers,
)

if TYPE_CHECKING:
    from eomcheck.claims.finding import Finding
    from eomcheck.mechanics.scene import Scene

BaseOption = Annotated[
    str | None,
    typer.Option(
        metavar="CONVENTION",
        help="Twist of a free base: world, body or mixed axes (linear along the world, angular the "
        "body), linear or angular first, such as 'body axes, angular first'.",
    ),
]

REGISTRIES = ("formulations", "scenes", "engines", "claims", "quantities")
"""Arguments of `eomcheck list`."""


@app.command("check")
def check_command(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            help="FILE.py with functions M(q), bias(q, v), and so on, or FILE.py:NAME; or recorded "
            "answers or a log, a table .csv, .json, .npz or .parquet, with --scene.",
        ),
    ],
    scene: Annotated[
        str | None, scene_option("Scene that recorded answers are about, such as robot.urdf.")
    ] = None,
    n: Annotated[
        int | None,
        typer.Option(
            "--n", help="Number of coordinates. [default: n in the file, or found from the results]"
        ),
    ] = None,
    against: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Reference: a scene, robot.urdf, or FILE.py[:NAME]."),
    ] = None,
    examples: Annotated[int, typer.Option(help="Number of random states.")] = 20,
    seed: Seed = 0,
    claim: Annotated[
        list[str] | None,
        keys_option("Claim to check, or several: a,b. [default: all]", more=()),
    ] = None,
    base: BaseOption = None,
    precision: Annotated[
        str | None,
        typer.Option(
            metavar="TYPE", help="Numbers of the program with recorded answers: float64 or float32."
        ),
    ] = None,
    figures: Annotated[
        Path | None, typer.Option(help="Draw the errors of a log over time into this folder.")
    ] = None,
    json: Json = None,
    report: Annotated[
        Path | None, typer.Option(help="Write the HTML page of `eomcheck report` to this file.")
    ] = None,
    patience: Patience = PATIENCE,
) -> None:
    """Check equations of motion in a Python file, or answers or a log of another program.

    Exit code 1 if a claim fails; 2 if nothing was decided.
    """
    check_count(examples=examples)
    for path in (json, report):
        check_writable(path)
    from eomcheck.lab.recorded_table import FORMATS

    if Path(file).suffix in FORMATS:
        check_used("with recorded answers", n=n, against=against, claim=claim)
        findings = _check_recorded(Path(file), scene, json, base, precision, figures)
        _end_check(file, findings, report)
        return
    recorded = {"scene": scene, "base": base, "precision": precision, "figures": figures}
    check_used("with equations of motion", **recorded)
    from eomcheck.console import activity
    from eomcheck.lab.report.equations_output import print_equations, write_equations
    from eomcheck.testing.equations_of_files import read_equations, reference_named
    from eomcheck.testing.function_checks import check_equations

    with activity("checking"):
        read = read_equations(file, n, seed=seed)
        equations = read.equations
        reference = None if against is None else reference_named(against, equations.n, seed)
        findings = check_equations(
            equations, states=examples, seed=seed, against=reference, claims=claim
        )
    if json is not None:
        write_equations(json, read, findings, examples, seed)
    print_equations(read, findings, examples, seed, against or "")
    if json is not None:
        print(f"written: {json}")
    _end_check(file, findings, report)


def _check_recorded(
    file: Path,
    scene: str | None,
    json: Path | None,
    base: str | None,
    precision: str | None,
    figures: Path | None,
) -> list[Finding]:
    """Check a recorded table, print the Findings and return them."""
    from eomcheck.console import activity
    from eomcheck.lab.recorded_log import check_recorded
    from eomcheck.lab.report.equations_output import print_checked, write_answers
    from eomcheck.scene_lookup import scene_named

    if scene is None:
        raise InputError(f"file = {str(file)!r}: recorded answers need --scene")
    check_folder(figures)
    with activity("checking"):
        subject = scene_named(scene)
        findings, notes, chart = check_recorded(file, subject, base, precision)
    if figures is not None and chart is None:
        raise InputError(f"figures = {str(figures)!r}: only a log, with a column t, is drawn")
    title = f"{file.name} about {subject.name}"
    if json is not None:
        write_answers(json, title, notes, findings)
    print_checked(title, notes, findings, "subject")
    if json is not None:
        print(f"written: {json}")
    if figures is not None and chart is not None:
        from eomcheck.lab.show.chart_matplotlib import draw_both

        for path in draw_both(chart, figures):
            print(f"written: {path}")
    return findings


def _end_check(file: str, findings: Sequence[Finding], report: Path | None) -> None:
    """Write the page of a check, and end the command with its exit code."""
    from eomcheck.lab.report.equations_output import equations_records

    with records_to_report(None, report) as kept:
        if report is not None and kept is not None:
            for record in equations_records(findings):
                kept.add(record)
            _write_page([kept.path], report)
    if any(finding.verdict == "failed" for finding in findings):
        raise typer.Exit(1)
    if not any(finding.verdict == "passed" for finding in findings):
        raise InputError(f"file = {file!r}: nothing could be decided")


@app.command("states")
def states_command(
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Table to write: .csv, .json, .npz or .parquet.")
    ],
    scene: SceneOption = "snake",
    links: Links = None,
    settings: SetOption = None,
    examples: Annotated[int, typer.Option(help="Number of states.")] = 100,
    seed: Seed = 0,
    base: BaseOption = None,
    patience: Patience = PATIENCE,
) -> None:
    """Write random states of a scene for another program, whose answers `check` then reads."""
    check_count(examples=examples)
    check_writable(output)
    from eomcheck.lab.recorded_answers import write_states

    write_states(selected_scene(scene, links, settings), output, examples, seed, base)
    print(f"written: {output}")


@app.command("validate")
def validate_command(
    scene: Annotated[
        str | None,
        scene_option(
            f"{SCENE_HELP} [default: snake; with an engine of your own all and random ones]", "all"
        ),
    ] = None,
    links: Annotated[
        str | None,
        typer.Option(
            metavar="N..M", help="Number of links of the random scenes, N or N..M. [default: 1..12]"
        ),
    ] = None,
    settings: SetOption = None,
    examples: Annotated[
        int,
        typer.Option(
            help="Number of random scenes of a kind, each in one state, or of random states of one "
            "scene. Beside them its example, or that scene, is checked in its initial state, "
            "and an example in one random state too."
        ),
    ] = 120,
    seed: Seed = 0,
    engine: Engines = None,
    isolated: IsolatedOption = False,
    formulation: Formulations = None,
    claim: Claims = None,
    executor: Annotated[str | None, executor_option("local")] = None,
    json: Json = None,
    records: RecordsOption = None,
    report: Annotated[
        Path | None, typer.Option(help="Write the HTML page of `eomcheck report` to this file.")
    ] = None,
    wide: Annotated[
        bool, typer.Option("--wide", help="Print every formulation, engine or scene by itself.")
    ] = False,
    deviations: DeviationsOption = None,
    patience: Patience = PATIENCE,
) -> None:
    """Check every claim on the example of a scene (the paper's robot) and on random ones.

    With --set, or for one snake, on that scene alone, in random states.
    """
    bounds, parameters = (
        parse_interval("1..12" if links is None else links),
        parse_parameters(settings),
    )
    check_count(examples=examples)
    for path in (json, report):
        check_output(path, [records] if records else [])

    from eomcheck.claims import CLAIMS
    from eomcheck.claims.run import RunSelection, ValidationRun, check_compared, check_decided
    from eomcheck.console import console, deferring_interrupts, interruptible, progress
    from eomcheck.descriptions.random_mechanisms import RANDOM
    from eomcheck.draws.pairwise_design import link_count
    from eomcheck.engines import engines_among, is_under_test, version_of
    from eomcheck.engines.answers import represented
    from eomcheck.lab.deviations import (
        names_engine,
        read_deviations,
        run_observations,
    )
    from eomcheck.lab.report.finding_output import print_runs, write_findings
    from eomcheck.lab.store.parallel_map import check_executor
    from eomcheck.lab.store.validation_runs import (
        all_built_in,
        default_executor,
        validate_kind,
        validate_kinds,
    )
    from eomcheck.scene_lookup import (
        ALL,
        ROBOTS,
        scene_classes_named,
        scene_named,
    )

    engine = selected_engines(engine, isolated)
    engines = engines_among(engine)
    known = None if deviations is None else read_deviations(deviations)
    tried = tuple(filter(is_under_test, engines))
    name, chosen_scene = scene or (ALL if tried else "snake"), None
    if parameters or name in ROBOTS:
        if bounds[0] != bounds[1] and links is not None:
            raise InputError(f"links = {links!r}, expected one number: one scene is checked")
        chosen_scene = scene_named(name, None if links is None else bounds[0], parameters)
        bounds = (link_count(chosen_scene) or 1, link_count(chosen_scene) or 1)
    kinds = scene_classes_named(name) if chosen_scene is None else (type(chosen_scene),)
    if scene is None and tried:
        kinds += tuple(RANDOM.values())
    if engine:
        kinds = represented(tried if scene is None and tried else engines, kinds)
    if links is not None and not any(kind.has_links for kind in kinds):
        raise InputError(f"links = {links!r}: {kinds[0].key} has no number of links to choose")
    default = None
    if scene is None and tried:  # the engine is under test, not the scenes
        default = [entry.id for entry in CLAIMS.values() if entry.asks]
    selection = RunSelection.of(formulation, engine, claim, scenes=kinds, default=default)
    if len(kinds) == 1:
        if executor is None:
            executor = default_executor(examples, kinds, selection.engines)
        elif not all_built_in(*kinds, *selection.engines):
            own = "a user-supplied scene or engine is checked in one process"
            raise InputError(f"executor = {executor!r}: {own}")
    check_executor(executor)
    for kind in selection.engines:
        version_of(kind)  # a missing library is bad input, reported before anything is computed
    runs = {kind.key: ValidationRun() for kind in kinds}
    how = selection, bounds, examples, seed
    end = CommandEnd()
    with (
        interruptible(),
        records_to_report(records, report) as kept,
        progress(
            "checking {state}", (examples + (1 if chosen_scene else 2)) * len(kinds)
        ) as advance,
    ):
        with end.collected():
            if len(kinds) == 1:
                validate_kind(
                    kinds[0], runs[kinds[0].key], *how, advance, kept, chosen_scene, executor
                )
            else:
                validate_kinds(runs, *how, advance, kept, executor)
        # Files first, so that they are written even if printing fails.
        with end.collected(), deferring_interrupts():
            if json is not None:
                write_findings(json, runs.values(), selection)
            if report is not None and kept is not None and end.unwritten is None:
                _write_page([kept.path], report)
    findings = [finding for run in runs.values() for finding in run.findings]
    print_runs(runs, selection, wide)
    _print_warnings(kinds)
    if end.interrupted:
        console.print("interrupted: the table holds what was checked until then")
    failures = [finding for finding in findings if finding.verdict == "failed"]
    failed = bool(failures)
    if known is not None:
        undeclared = known.differ(run_observations(findings))
        failed = undeclared or not all(names_engine(x.claim, x.subject) for x in failures)
    end.conclude(json, failed)
    if engine:
        check_compared(engines, findings)
    check_decided(findings)


def _print_warnings(kinds: Iterable[type[Scene]]) -> None:
    """Print the warnings of the files that scene classes were read from, wrapped."""
    from eomcheck.console import console
    from eomcheck.scene_lookup import robot_file_warnings

    for warning in robot_file_warnings(kinds):
        console.print(warning, markup=False, highlight=False)


@app.command("prove")
def prove_command(
    links: Annotated[
        str | None,
        typer.Option(
            metavar="N..M",
            help="Numbers of links, such as 2..100 or 1..12,20,50. [default: 1..12,20,50,100]",
        ),
    ] = None,
    examples: Annotated[int, typer.Option(help="Number of random points per identity.")] = 4,
    seed: Annotated[int | None, seed_option("Seed of the draws. [default: random]")] = None,
    scene: SceneClassOption = "snake",
    formulation: Formulations = None,
    claim: Claims = None,
    executor: ExecutorOption = "local",
    json: Json = None,
    records: RecordsOption = None,
    patience: Patience = PATIENCE,
) -> None:
    """Prove the claims that are identities, for all parameters and states of a scene at once."""
    numbers = None if links is None else parse_whole_numbers(links)
    check_count(examples=examples)
    check_writable(json)

    from eomcheck.console import interruptible
    from eomcheck.lab.proofs import Proofs, proof_jobs
    from eomcheck.lab.report.finding_output import print_proofs
    from eomcheck.lab.store.parallel_map import check_executor
    from eomcheck.scene_lookup import scene_classes_named

    jobs = proof_jobs(scene, numbers, examples, seed, formulation, claim)
    check_executor(executor)
    with interruptible(), records_or_none(records) as kept:
        proofs, end, whole = Proofs(jobs, json, executor, kept), CommandEnd(), False
        with end.collected():
            proofs.run()
            whole = True
            if json is not None:
                proofs.write()
    print_proofs(proofs)
    if end.interrupted and json is not None:
        print("interrupted: the same command goes on with the structures that are left")
    _print_warnings(scene_classes_named(scene) if whole else ())
    end.conclude(json if whole else None, proofs.failed)
    if not proofs.decided:
        raise InputError(f"scene = {scene!r}: no identity could be tested")


@app.command("list")
def list_registry(
    registry: Annotated[
        str,
        typer.Argument(
            metavar="WHAT",
            help="formulations, scenes, engines, claims or quantities.",
            autocompletion=lambda incomplete: [x for x in REGISTRIES if x.startswith(incomplete)],
        ),
    ],
) -> None:
    """List formulations, scenes, engines, claims or quantities."""
    if registry not in REGISTRIES:
        raise UnknownNameError("list", registry, REGISTRIES)
    from eomcheck.lab.report.registries import registry_table
    from eomcheck.lab.show.table import print_tables

    print_tables([registry_table(registry)])


def _write_page(records: list[Path], path: Path) -> None:
    from eomcheck.lab.report.overview import Overview, read_records
    from eomcheck.lab.report.report_formats import write_page

    write_page(Overview(read_records(records)), path)
    print(f"written: {path}")


@app.command("report")
def report_command(
    records: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECORDS", help="Files of records: of validate, prove and the studies."
        ),
    ],
    html: Annotated[
        Path | None,
        typer.Option(help="Page to write. [default: report.html, if nothing else is written]"),
    ] = None,
    markdown: Annotated[Path | None, typer.Option(help="Write Markdown into this file.")] = None,
    junit: Annotated[Path | None, typer.Option(help="Write JUnit XML into this file.")] = None,
    equivalences: Annotated[
        Path | None, typer.Option(help="Write the page of verified equivalences into this file.")
    ] = None,
    suite: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the suite, of which that page names tests. [default: validation]"
        ),
    ] = None,
    claim: ReportedClaims = None,
) -> None:
    """Report stored results: verdict, claims, failing states, and the studies there are.

    Exit code 1 if a claim fails.
    """
    if equivalences is None:
        check_used("without --equivalences", suite=suite)
    if html is markdown is junit is equivalences is None:
        html = Path("report.html")
    for path in (html, markdown, junit, equivalences):
        check_output(path, records)
    from functools import partial

    from eomcheck.lab.report.overview import Overview, read_records
    from eomcheck.lab.report.report_formats import (
        write_equivalences,
        write_junit,
        write_markdown,
        write_page,
    )
    from eomcheck.lab.show.table import say

    unread: list[str] = []
    overview = Overview(read_records(records, unread), unread, claim)
    for path, write in (
        (html, write_page),
        (markdown, write_markdown),
        (junit, write_junit),
        (equivalences, partial(write_equivalences, suite=suite or SUITE)),
    ):
        if path is not None:
            write(overview, path)
            print(f"written: {path}")
    say(f"{overview.headline} {overview.basis}" if overview.rows else overview.headline)
    raise_unread(overview.unread)
    if overview.verdict == "failed":
        raise typer.Exit(1)


@app.command("export")
def export_records(
    records: Annotated[
        Path, typer.Argument(metavar="RECORDS", help="File of records that a study wrote.")
    ],
    file: Annotated[
        Path | None,
        typer.Argument(metavar="[FILE]", help="File to write. [default: standard output]"),
    ] = None,
    csv: Annotated[bool, typer.Option(help="As CSV, or as a table in Markdown.")] = True,
) -> None:
    """Write the records of a study as a table: one line per cell, one column per value."""
    check_output(file, [records])
    from eomcheck.lab.report.overview import record_table
    from eomcheck.lab.store.record_file import Records

    unread: list[str] = []
    with Records(records, readonly=True, unread=unread) as opened:
        table = record_table(opened.all())
    text = table.csv() if csv else table.markdown()
    if file is None:
        sys.stdout.write(text)
        raise_unread(unread)
        return
    write_text(file, text)
    print(f"written: {file}")
    raise_unread(unread)


@app.command("reference")
def reference_command(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAMES",
            help="References to compute; with --scene the name of its one. [default: all, and that "
            "of the scene]",
        ),
    ] = None,
    scene: OptionalSceneOption = None,
    links: Links = None,
    settings: SetOption = None,
    speeds: SpeedsOption = None,
    end: Annotated[
        float | None,
        typer.Option(metavar="END", help="With --scene: end of the motion, s. [default: 1]"),
    ] = None,
    folder: Annotated[Path, typer.Option(help="Folder to write to.")] = REFERENCES,
    executor: ExecutorOption = "local",
    patience: Patience = PATIENCE,
) -> None:
    """Compute reference solutions, each by two derivations, and write them.

    With --scene that of any scene or robot, from its initial state.
    """
    check_folder(folder)
    from eomcheck.lab.references import (
        REFERENCE_CASES,
        case_of,
        produce_all,
        reference_case,
        reference_name,
        reference_table,
        write_reference,
    )
    from eomcheck.lab.show.table import print_tables
    from eomcheck.lab.store.parallel_map import check_executor

    if scene is None:
        check_used("without --scene", links=links, set=settings, speeds=speeds, end=end)
        cases = {name: reference_case(name) for name in names or REFERENCE_CASES}
    else:
        chosen_scene = selected_scene(scene, links, settings)
        name, *more = names or [reference_name(chosen_scene)]
        if more:
            raise InputError(f"names = {names}, expected one for the reference of {scene}")
        if name in REFERENCE_CASES:
            raise InputError(f"name = {name!r} is that of a reference of eomcheck")
        u0 = selected_speeds(chosen_scene, speeds)
        cases = {name: case_of(chosen_scene, u0, 1.0 if end is None else end)}
    for name in cases:
        check_writable(folder / f"{name}.json")
    check_executor(executor)
    for reference in produce_all(cases, executor):
        path = write_reference(reference, folder, scene)
        print_tables([reference_table([reference])])
        print(f"written: {path}")


@app.command("badge")
def badge_command(
    result: Annotated[
        Path,
        typer.Argument(
            metavar="RESULT", help="Result of `eomcheck validate --json` or `compare --json`."
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="SVG to write.")],
    engine: Annotated[
        str | None,
        typer.Option(metavar="KEY", help="Engine, where the result is about several."),
    ] = None,
    label: Annotated[
        str | None,
        typer.Option(metavar="WORDS", help="Text on the left. [default: eomcheck and the engine]"),
    ] = None,
) -> None:
    """Write a badge of a result, a static SVG: the quantities of an engine that agree."""
    check_output(output, [result])
    from eomcheck.lab.badge import write_badge

    print(write_badge(result, output, label, engine))
    print(f"written: {output}")


@app.command("compare")
def compare_command(
    robot: Annotated[
        str,
        typer.Argument(
            metavar="ROBOT",
            help="Its description: robot.urdf, robot.urdf:floating with a free base, robot.xml, "
            "robot.sdf.",
        ),
    ],
    other: Annotated[
        str | None,
        typer.Argument(
            metavar="[OTHER]",
            help="Another description: whether both are the same robot, and where they part.",
        ),
    ] = None,
    match: Annotated[
        list[str] | None,
        typer.Option(
            metavar="A=B",
            help="Joint of the first and of the other robot, where names differ; repeatable.",
        ),
    ] = None,
    engine: Annotated[
        list[str] | None,
        keys_option(
            "Library to compare with, or several: a,b, or your own: FILE.py:CLASS. [default: all "
            "installed]",
            "engine",
        ),
    ] = None,
    isolated: IsolatedOption = False,
    examples: Annotated[int, typer.Option(help="Number of random states.")] = 20,
    seed: Seed = 0,
    claim: Claims = None,
    pairs: Annotated[
        bool, typer.Option("--pairs", help="Also print each library beside each other.")
    ] = False,
    wide: Annotated[
        bool, typer.Option("--wide", help="Print quantities on which all libraries agree, too.")
    ] = False,
    patch: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write the inertials of the first robot as a patch of the other's file, for "
            "`patch -p0`.",
        ),
    ] = None,
    json: Json = None,
    deviations: DeviationsOption = None,
    patience: Patience = PATIENCE,
) -> None:
    """Compare the equations that libraries read from one file, or two files with each other.

    Exit code 1 if libraries or robots differ by more than rounding, or a library that is installed
    gives no answer; 2 if nothing was decided about any.
    """
    require_supervision()
    check_count(examples=examples)
    check_writable(json)
    check_writable(patch)
    if other is not None:
        check_used(
            "with two robots",
            **{"engine": engine, "claim": claim, "deviations": deviations},
            **{"isolated": isolated or None, "pairs": pairs or None, "wide": wide or None},
        )
        _compare_robots(robot, other, match or [], examples, json, patch)
        return
    check_used("with one robot", match=match, patch=patch)
    from eomcheck.console import progress
    from eomcheck.lab.deviations import read_deviations
    from eomcheck.lab.library_comparison import (
        compare_libraries,
        comparison_observations,
        print_comparison,
        write_comparison,
    )
    from eomcheck.scene_lookup import is_robot, scene_named

    if not is_robot(robot):
        raise InputError(
            f"robot = {robot!r}, expected robot.urdf, robot.urdf:floating, robot.xml or robot.sdf"
        )
    known = None if deviations is None else read_deviations(deviations)
    scene = scene_named(robot)
    with progress("comparing libraries at {state}", examples) as advance:
        comparison = compare_libraries(scene, engine, examples, seed, advance, claim, isolated)
    if json is not None:
        write_comparison(comparison, json)
    print_comparison(comparison, pairs, wide)
    _print_warnings([type(scene)])
    if json is not None:
        print(f"written: {json}")
    if known is not None:
        undeclared = known.differ(comparison_observations(comparison))
        failed = undeclared or bool(comparison.self_failures)
    else:
        failed = comparison.disagree or bool(comparison.unanswered)
    if failed:
        raise typer.Exit(1)
    comparison.check_decided()


def _compare_robots(
    robot: str,
    other: str,
    match: list[str],
    examples: int,
    json: Path | None,
    patch: Path | None,
) -> None:
    """Compare two robots, print their differences and end with the exit code."""
    from eomcheck.atomic_write import write_text
    from eomcheck.lab.inertial_patch import inertial_patch
    from eomcheck.lab.robot_comparison import compare_robots, print_robots, write_robots
    from eomcheck.scene_lookup import scene_named

    pairs = {}
    for text in match:
        name, equal, partner = text.partition("=")
        if not (equal and name and partner):
            raise InputError(f"match = {text!r}, expected JOINT=JOINT")
        pairs[name] = partner
    scenes = scene_named(robot), scene_named(other)
    comparison = compare_robots(*scenes, pairs, examples)
    if json is not None:
        write_robots(comparison, json)
    if patch is not None:
        write_text(patch, inertial_patch(*scenes, comparison))
    print_robots(comparison)
    _print_warnings(map(type, scenes))
    for written in filter(None, (json, patch)):
        print(f"written: {written}")
    if not comparison.is_same:
        raise typer.Exit(1)

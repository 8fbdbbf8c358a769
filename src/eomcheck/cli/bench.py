"""`eomcheck bench`: run times and tolerances, measured."""

from __future__ import annotations

from typing import Annotated

import typer

from eomcheck.cli.options import Examples, Json, Kind, Links, Seed, check_writable, interval

Timed = Annotated[
    list[str] | None, typer.Option(help="Formulation to time; repeat for more. Default all.")
]

bench = typer.Typer(name="bench", help="Measure run times and tolerances.", no_args_is_help=True)


@bench.command("rhs")
def bench_rhs(
    scene: Kind = "snake",
    links: Annotated[
        list[int] | None, typer.Option(help="Number of links; repeat for more.")
    ] = None,
    formulation: Timed = None,
    repeats: Annotated[int, typer.Option(help="Timed runs; the median counts.")] = 15,
    json: Json = None,
) -> None:
    """Time one right-hand side of each formulation, over the number of links where there is one."""
    check_writable(json)
    from eomcheck.lab.studies.rhs import measure_all
    from eomcheck.scenes.named import kinds_of
    from eomcheck.lab.report.benchmarks import print_rhs, write_records  # isort: skip

    records = []
    for kind in kinds_of(scene):
        found = measure_all(kind, links, formulation, repeats)
        print_rhs(found)
        records += found
    if json is not None:
        write_records(json, "timings", records)


@bench.command("motion")
def bench_motion(
    formulation: Timed = None,
    json: Json = None,
) -> None:
    """Time a motion of the paper's robot, in machine code and through Python."""
    check_writable(json)
    from eomcheck.lab.studies.motion import measure_motions
    from eomcheck.lab.report.benchmarks import print_motions, write_records  # isort: skip

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
    from eomcheck.lab.report.benchmarks import print_tolerance
    from eomcheck.lab.studies.tolerance import measure_constant

    print_tolerance(measure_constant(low, high, examples, seed))

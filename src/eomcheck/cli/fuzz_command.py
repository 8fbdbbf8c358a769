"""Command `eomcheck fuzz`: random states and hill climbing; failures are stored and replayed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eomcheck.atomic_write import check_writable
from eomcheck.calls import PATIENCE
from eomcheck.cli.application import (
    Claims,
    CommandEnd,
    Engines,
    Formulations,
    IsolatedOption,
    Patience,
    RecordsOption,
    Seed,
    app,
    check_used,
    completer,
    executor_option,
    keys_option,
    records_or_none,
    selected_engines,
)
from eomcheck.deprecated import print_notice
from eomcheck.errors import InputError
from eomcheck.lab.option_parsing import SCENE_HELP, check_count, parse_interval
from eomcheck.safe_output import counted

if TYPE_CHECKING:
    from eomcheck.claims.run import RunSelection
    from eomcheck.lab.fuzzing.motion_rounds import MotionPlan
    from eomcheck.lab.fuzzing.state_rounds import FunctionsPlan, StatePlan
    from eomcheck.mechanics.scene import Scene


UNITS = {"s": 1.0, "m": 60.0, "h": 3600.0}


def parse_duration(text: str) -> float:
    """Return the seconds of a duration such as "20s", "10m" or "1.5h".

    Raises:
        InputError: the text is no duration.
    """
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([smh])", text)
    if match is None or not float(match[1]):
        raise InputError(f"time = {text!r}, expected a time such as 20s, 10m or 3h")
    return float(match[1]) * UNITS[match[2]]


CHECKS = "enclosures", "balls", "engines", "checks", "scalar-only"
"""Names in `--check-frequency`, in the order of the fields of `CheckFrequency`."""


def parse_check_frequency(text: str) -> dict[str, int]:
    """Return the sampling rates of a text such as "balls=0,checks=50", by field.

    Five numbers without names, as up to release 0.2, are taken in the order of `CHECKS`.

    Raises:
        InputError: the text holds anything else.
    """
    rates = [one.partition("=")[::2] for one in text.split(",")]
    if re.fullmatch(r"\d+(,\d+){4}", text):
        rates = [*zip(CHECKS, text.split(","), strict=True)]
        named = ",".join(f"{name}={x}" for name, x in rates)
        print_notice(f"--check-frequency {text}", f"--check-frequency {named}")
    if not all(name in CHECKS and x.isdecimal() for name, x in rates):
        expected = f"NAME=NUMBER of {', '.join(CHECKS)}, such as balls=20,checks=200"
        raise InputError(f"--check-frequency {text!r}, expected {expected}")
    return {name.replace("-", "_"): int(x) for name, x in rates}


@app.command("fuzz")
def fuzz_command(
    scene: Annotated[
        str | None,
        typer.Option(
            metavar="SCENE",
            help=f"{SCENE_HELP} [snake] With --replay: whose code the file may import.",
            autocompletion=completer("scene", "robot"),
        ),
    ] = None,
    links: Annotated[
        str | None,
        typer.Option(metavar="N..M", help="Number of links, N or N..M. [default: 1..12]"),
    ] = None,
    engine: Engines = None,
    isolated: IsolatedOption = False,
    formulation: Formulations = None,
    claim: Claims = None,
    time: Annotated[
        str | None,
        typer.Option(
            metavar="TIME", help="How long: 20s, 10m, 3h. [default: 1m, without --examples]"
        ),
    ] = None,
    examples: Annotated[
        int | None,
        typer.Option(
            help="Least number of states or motions instead, those in --records included: rounds "
            "are finished, so that there are more."
        ),
    ] = None,
    seed: Seed = 0,
    motions: Annotated[
        bool, typer.Option("--motions", help="Compare motions by all formulations.")
    ] = False,
    family: Annotated[
        list[str] | None,
        keys_option(
            "What is drawn, of ordinary, wide, special and fast: a,b. "
            "[default: all; of motions the first and the third]",
            more=("ordinary", "wide", "special", "fast"),
        ),
    ] = None,
    climb: Annotated[bool, typer.Option(help="Climb, or only draw.")] = True,
    check_frequency: Annotated[
        str | None,
        typer.Option(
            metavar="NAME=N",
            help="Expensive checks, each at one state in so many: a=1,b=2; 0 for none. [default: "
            "enclosures=4,balls=20,engines=10,checks=200,scalar-only=20]",
        ),
    ] = None,
    executor: Annotated[str | None, executor_option("here")] = None,
    records: RecordsOption = None,
    replay: Annotated[
        Path | None,
        typer.Option(
            help="Check the failures in this file again, and nothing else; code that they name is "
            "imported only if --scene or --engine names it too."
        ),
    ] = None,
    keep: Annotated[
        Path | None, typer.Option(help="Add failures to this file, such as validation/found.json.")
    ] = None,
    patience: Patience = PATIENCE,
) -> None:
    """Search thousands of states for one at which a claim fails, and store the failures.

    States are screened in batches; every suspicious one is judged by `eomcheck.check_state`, as are
    a few of the others. With --motions, motions by all formulations are compared. A campaign with
    --records goes on where it stopped. Exit code 1 if there is a failure, 2 if a stored one cannot
    be checked again, 130 if interrupted.
    """
    check_writable(keep)
    engine = selected_engines(engine, isolated)
    if replay is not None:
        elsewhere = {"links": links, "claim": claim, "family": family}
        many = {"time": time, "examples": examples, "records": records, "keep": keep}
        how = {"seed": seed or None, "no-climb": not climb, "executor": executor}
        how["check-frequency"] = check_frequency
        check_used("with --replay", motions=motions, **elsewhere, **many, **how)
        _replay(replay, formulation, scene, engine)
        return
    scene = "snake" if scene is None else scene
    if time is not None and examples is not None:
        raise InputError("--time and --examples: expected one of them, not both")
    most = None if examples is not None else parse_duration("1m" if time is None else time)
    if examples is not None:
        check_count(examples=examples)

    from eomcheck.console import activity, console, deferring_interrupts, interruptible
    from eomcheck.draws.fuzz_cases import StructuralVariant, structural_variants
    from eomcheck.lab.fuzzing.campaign import Campaign
    from eomcheck.lab.fuzzing.failures import add_failures, equations_of, read_failures
    from eomcheck.lab.report.finding_output import ProgressPrinter, print_campaign
    from eomcheck.lab.store.parallel_map import check_executor

    if keep is not None:
        read_failures(keep)  # a damaged file is bad input, reported before anything is computed
    low, high = parse_interval("1..12" if links is None else links)
    if executor is not None:
        check_executor(executor)
    end = CommandEnd()
    with interruptible(), records_or_none(records) as kept:
        if (equations := equations_of(scene)) is not None:
            unused = {"links": links, "engine": engine, "formulation": formulation}
            unused |= {"motions": motions, "check-frequency": check_frequency}
            check_used(f"of {scene}, which are functions", **unused)
            plan, name = _functions(scene, seed, claim, family, climb), scene
            variants = [StructuralVariant(None, ())]
            for note in equations.notes:
                print(note)
        else:
            kind, name = _kind(scene)
            if links is not None and not kind.has_links:
                raise InputError(f"links = {links!r}: {scene} has no number of links to choose")
            variants = structural_variants(kind, range(low, high + 1))
            if motions:
                unused = {"claim": claim, "check-frequency": check_frequency}
                check_used("with --motions", engine=engine, **unused)
                plan = _motions(kind, formulation, seed, family, climb)
            else:
                selection = _selection(kind, engine, formulation, claim)
                wide = bool(engine) and bool(selection.engines)
                plan = _states(kind, selection, seed, family, climb, check_frequency, wide)
        campaign = Campaign(plan, name, variants, kept)
        with end.collected(), activity(f"fuzzing {name}"):
            campaign.run(examples, most, executor, ProgressPrinter())
        added = keep is not None and (bool(campaign.failure_records) or not keep.exists())
        if keep is not None and added:
            # InputError: the file was damaged in the meantime.
            with end.collected(InputError), deferring_interrupts():
                add_failures(keep, campaign.failure_records.values())
    print_campaign(campaign)
    if end.interrupted:
        console.print("interrupted: the tables hold what was checked until then")
    end.conclude(keep if added else None, bool(campaign.failure_records))


def _kind(scene: str) -> tuple[type[Scene], str]:
    from eomcheck.scene_lookup import lookup_name, scene_classes_named

    kinds = scene_classes_named(scene)
    if len(kinds) > 1:
        raise InputError(f"scene = {scene!r}, expected one kind of scene")
    kind = next(iter(kinds))
    return kind, lookup_name(kind, scene)


def _selection(
    kind: type[Scene],
    engine: list[str] | None,
    formulation: list[str] | None,
    claim: list[str] | None,
) -> RunSelection:
    from eomcheck.claims.run import RunSelection
    from eomcheck.engines import ALWAYS, version_of
    from eomcheck.engines.answers import represented

    # Random robots have other parameters than their files, so the files' library has no result.
    engines = ALWAYS if engine is None else engine
    selection = RunSelection.of(formulation, engines, claim, scenes=[kind])
    if engine:
        represented(selection.engines, (kind,))
    for needed in selection.engines:
        version_of(needed)  # a missing library is bad input, reported before anything is computed
    return selection


def _states(
    kind: type[Scene],
    selection: RunSelection,
    seed: int,
    family: list[str] | None,
    climb: bool,
    check_frequency: str | None,
    wide: bool,
) -> StatePlan:
    from eomcheck.descriptions.random_mechanisms import RandomScene
    from eomcheck.draws.fuzz_cases import FAMILIES
    from eomcheck.lab.fuzzing.screening import ALONE, CheckFrequency, runs_in_lanes
    from eomcheck.lab.fuzzing.state_rounds import BATCH, LANES, RandomStatePlan, StatePlan

    families = _families(family, FAMILIES)
    claims = tuple(one for one in selection.claims if one != "coverage")
    formulations = tuple(f.key for f in selection.formulations)
    rates = {} if check_frequency is None else parse_check_frequency(check_frequency)
    what = kind, seed, claims, formulations, selection.engines, families, climb
    frequency = CheckFrequency(**rates)
    if issubclass(kind, RandomScene):
        return RandomStatePlan(*what, frequency, LANES, wide)
    return StatePlan(*what, frequency, BATCH if runs_in_lanes(kind) else ALONE, wide)


def _functions(
    name: str, seed: int, claim: list[str] | None, family: list[str] | None, climb: bool
) -> FunctionsPlan:
    from eomcheck.draws.fuzz_cases import ORDINARY, SPECIAL
    from eomcheck.errors import distinct, registered
    from eomcheck.lab.fuzzing.state_rounds import FunctionsPlan
    from eomcheck.testing.function_checks import FUNCTION_CLAIMS

    claims = tuple(FUNCTION_CLAIMS if claim is None else distinct("claim", claim))
    for one in claims:
        registered("claim", one, FUNCTION_CLAIMS)
    return FunctionsPlan(name, seed, claims, _families(family, (ORDINARY, SPECIAL)), climb)


def _families(family: list[str] | None, available: Sequence[str]) -> tuple[str, ...]:
    """Return the families asked for, by default all that are available."""
    from eomcheck.errors import distinct, registered

    families = tuple(available if family is None else distinct("family", family))
    for one in families:
        registered("family", one, dict.fromkeys(available))
    return families


def _motions(
    kind: type[Scene],
    formulation: list[str] | None,
    seed: int,
    family: list[str] | None,
    climb: bool,
) -> MotionPlan:
    from eomcheck.draws.fuzz_cases import FAMILIES, ORDINARY, SPECIAL
    from eomcheck.formulations import formulations_for
    from eomcheck.lab.fuzzing.motion_rounds import MotionPlan

    keys = tuple(f.key for f in formulations_for(kind, formulation))
    families = (ORDINARY, SPECIAL) if family is None else _families(family, FAMILIES)
    return MotionPlan(kind, seed, keys, families, climb)


def _replay(
    path: Path, formulation: list[str] | None, scene: str | None, engine: list[str] | None
) -> None:
    """Check stored failures again.

    Raises:
        InputError: there is no such file, or one could not be checked and none fails.
        typer.Exit: with 1, one still fails.
    """
    from eomcheck.console import progress
    from eomcheck.errors import registered
    from eomcheck.formulations import FORMULATIONS
    from eomcheck.lab.fuzzing.failures import read_failures, replay_failures
    from eomcheck.lab.report.finding_output import print_replayed

    for key in formulation or ():
        registered("formulation", key, FORMULATIONS)
    if not path.is_file():
        raise InputError(f"{str(path)!r} is no file")
    stored = read_failures(path)
    if not stored:
        print(f"{str(path)!r} holds no failures")
        return
    allowed = (*([] if scene is None else [scene]), *(engine or ()))
    with progress("checking {failure} again", len(stored)) as advance:
        results = replay_failures(stored, formulation or tuple(FORMULATIONS), advance, allowed)
    print_replayed(results)
    if any(one.outcome == "failed" for one in results):
        raise typer.Exit(1)
    unchecked = [one for one in results if one.outcome == "not checked"]
    if unchecked:
        raise InputError(
            f"{counted(len(unchecked), 'failure')} could not be checked: {unchecked[0].reason}"
        )

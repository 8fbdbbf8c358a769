"""Every option of every command changes what the command hands on, and every exit code is told."""

from __future__ import annotations

import inspect
import sys
from dataclasses import fields, is_dataclass
from functools import cache
from inspect import Parameter
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest
import typer

from eomcheck import cli
from eomcheck.cli.study_commands import GROUPS, command_of
from eomcheck.draws.fuzz_cases import structural_variants
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing import campaign as campaigns
from eomcheck.lab.store.record_file import Record, Records
from eomcheck.lab.studies import study_of
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import Snake

URDF = str(Path(__file__).parents[2] / "docs" / "guides" / "crane.urdf")
PLANAR = str(Path(__file__).parents[2] / "docs" / "guides" / "planar.py") + ":Planar"
REFERENCES = Path(__file__).parents[2] / "validation" / "references"

Seen = dict[str, Any]
"""Function.argument -> its value, plain, in the last call of it."""


# ---- What a command hands on ---------------------------------------------------------------------


def plain(x: Any) -> Any:
    """Return a value that can be compared and read: names of classes, text of paths."""
    if isinstance(x, type):
        return x.__name__
    if isinstance(x, Path):
        return str(x)
    if isinstance(x, np.ndarray):
        return x.tolist()
    if isinstance(x, Scene):
        return repr(x)
    if isinstance(x, Records):
        return "records"
    if isinstance(x, tuple) and hasattr(x, "_fields"):
        return {name: plain(getattr(x, name)) for name in x._fields}  # type: ignore[attr-defined]
    if isinstance(x, dict):
        return {plain(key): plain(y) for key, y in x.items()}
    if isinstance(x, list | tuple):
        return [plain(y) for y in x]
    if hasattr(x, "key"):
        return x.key
    if is_dataclass(x):
        return {one.name: plain(getattr(x, one.name)) for one in fields(x)}
    return x if isinstance(x, str | int | float | None) else f"<{type(x).__name__}>"


def stub(monkeypatch: pytest.MonkeyPatch, seen: Seen, name: str, value: Any = None) -> None:
    """Replace a function by one that notes its arguments in `seen` and returns `value`."""
    where, _, attribute = name.rpartition(".")
    module = __import__(where, fromlist=["x"])
    original = getattr(module, attribute)
    signature = inspect.signature(original)

    def noting(*arguments: Any, **options: Any) -> Any:
        bound = signature.bind(*arguments, **options)
        bound.apply_defaults()
        for key, x in bound.arguments.items():
            many = signature.parameters[key].kind is Parameter.VAR_KEYWORD
            for inner, y in (x if many else {key: x}).items():
                seen[f"{attribute}.{inner}"] = plain(y)
        return value(*arguments, **options) if callable(value) else value

    monkeypatch.setattr(module, attribute, noting)


DEVIATIONS: dict[str, Any] = {
    "eomcheck.lab.deviations.read_deviations": SimpleNamespace(differ=lambda observations: False),
}
"""Function that reads a file of known deviations, and what stands for its result."""

ISOLATED = {"eomcheck.engines.isolated_names": ["pinocchio"]}
"""Function that has libraries run in environments of their own, and its result."""

STUBS: dict[str, dict[str, Any]] = {
    "check": {
        "eomcheck.testing.equations_of_files.read_equations": SimpleNamespace(
            equations=SimpleNamespace(n=1)
        ),
        "eomcheck.testing.equations_of_files.reference_named": lambda name, n, seed: name,
        "eomcheck.testing.function_checks.check_equations": [SimpleNamespace(verdict="passed")],
        "eomcheck.lab.report.equations_output.print_equations": None,
        "eomcheck.lab.report.equations_output.write_equations": None,
        "eomcheck.lab.report.equations_output.equations_records": [],
        "eomcheck.lab.report.equations_output.print_checked": None,
        "eomcheck.lab.recorded_log.check_recorded": (
            [SimpleNamespace(verdict="passed")],
            ["a note"],
            SimpleNamespace(name="a"),
        ),
        "eomcheck.lab.show.chart_matplotlib.draw_both": [],
        "eomcheck.cli.check_commands._write_page": None,
    },
    "states": {"eomcheck.lab.recorded_answers.write_states": None},
    "validate": {
        **DEVIATIONS,
        **ISOLATED,
        "eomcheck.lab.store.validation_runs.validate_kind": None,
        "eomcheck.lab.store.validation_runs.validate_kinds": None,
        "eomcheck.lab.report.finding_output.print_runs": None,
        "eomcheck.lab.report.finding_output.write_findings": None,
        "eomcheck.claims.run.check_compared": None,
        "eomcheck.claims.run.check_decided": None,
        "eomcheck.cli.check_commands._write_page": None,
    },
    "prove": {
        "eomcheck.lab.proofs.proof_jobs": SimpleNamespace(),
        "eomcheck.lab.proofs.Proofs": lambda *given, **how: SimpleNamespace(
            run=lambda: None, write=lambda: None, failed=False, decided=True
        ),
        "eomcheck.lab.report.finding_output.print_proofs": None,
    },
    "list": {"eomcheck.lab.report.registries.registry_table": lambda name: name}
    | {"eomcheck.lab.show.table.print_tables": None},
    "report": {
        "eomcheck.lab.report.report_formats.write_page": None,
        "eomcheck.lab.report.report_formats.write_markdown": None,
        "eomcheck.lab.report.report_formats.write_junit": None,
        "eomcheck.lab.report.report_formats.write_equivalences": None,
        "eomcheck.lab.report.overview.read_records": lambda paths, unread=None: [],
        "eomcheck.lab.report.overview.Overview": SimpleNamespace(
            rows=[], headline="", unread=[], verdict="passed"
        ),
    },
    "export": {"eomcheck.cli.check_commands.write_text": None},
    "badge": {"eomcheck.lab.badge.write_badge": "5 of 5 quantities"},
    "reference": {
        "eomcheck.lab.references.produce_all": lambda cases, executor=None: ["made"],
        "eomcheck.lab.references.write_reference": Path("there.json"),
        "eomcheck.lab.references.reference_table": None,
        "eomcheck.lab.show.table.print_tables": None,
    },
    "fuzz": {
        **ISOLATED,
        "eomcheck.lab.report.finding_output.print_campaign": None,
        "eomcheck.lab.fuzzing.failures.read_failures": lambda path: ["kept"],
        "eomcheck.lab.fuzzing.failures.write_failures": None,
        "eomcheck.lab.fuzzing.failures.replay_failures": [],
    },
    "simulate": {
        "eomcheck.simulate": SimpleNamespace(status="finished"),
        "eomcheck.simulate_many": SimpleNamespace(status=np.array(["finished"])),
        "eomcheck.lab.report.motion_tables.print_trajectories": None,
        "eomcheck.lab.report.motion_tables.write_trajectory": None,
        "eomcheck.lab.report.motion_tables.print_many": None,
        "eomcheck.lab.report.motion_tables.chart_of_many": None,
        "eomcheck.lab.show.chart_matplotlib.draw_chart": None,
    },
    "acceleration": {"eomcheck.lab.report.motion_tables.print_accelerations": 0},
    "constraints": {"eomcheck.lab.report.motion_tables.print_constraints": 0},
    "compare": {
        **DEVIATIONS,
        "eomcheck.lab.library_comparison.compare_libraries": SimpleNamespace(
            disagree=False, unanswered=[], self_failures=[], check_decided=lambda: None
        ),
        "eomcheck.lab.library_comparison.comparison_observations": [],
        "eomcheck.lab.library_comparison.print_comparison": None,
        "eomcheck.lab.library_comparison.write_comparison": None,
        "eomcheck.lab.robot_comparison.compare_robots": SimpleNamespace(is_same=True),
        "eomcheck.lab.robot_comparison.print_robots": None,
        "eomcheck.lab.inertial_patch.inertial_patch": "",
    },
    "draw scene": {
        "eomcheck.lab.show.pictures.draw_scene": None,
        "eomcheck.lab.show.pictures.draw_motion": None,
        "eomcheck.lab.show.pictures.sketches_of_motion": ([], np.zeros(1), 1),
    },
    "draw structure": {
        "eomcheck.lab.show.pictures.draw_structure": None,
        "eomcheck.lab.show.pictures.structure_of": lambda scene, formulation, *state: (
            f"{formulation.key} of {scene!r}"
        ),
    },
}
"""Command -> the functions that it calls, and what stands for their results."""

BASES = {
    "check": "of_options.py",
    "states": "-o a.csv",
    "validate": "--examples 1",
    "list": "claims",
    "report": "r.db",
    "export": "r.db",
    "badge": "f.json -o a.svg",
    "fuzz": "--examples 1",
    "simulate": "--end 0.1 --formulation kane",
    "compare": URDF,
    "draw scene": "a.svg",
    "draw structure": "a.svg",
}
"""Command -> what it needs at least."""

MANY, GIF, REPLAY = "--end 0.1 --examples 2", "a.gif", "--replay f.json"
TABLE = "a.csv --scene snake"
FUNCTIONS = "--scene of_options.py:own --examples 1"
"""Other words to begin with, for options that say nothing otherwise."""

OWN = "from eomcheck.testing import EquationsOfMotion as E\nown = E(1, M=lambda q: [[1.0]])\n"
"""A file with functions."""

Case = tuple[str, Seen] | tuple[str, Seen, str]
"""Words with the option, what follows of it, and the words to begin with if not the usual ones."""

PATIENT = {"patience": ("--patience 7", {"set_patience.seconds": 7.0})}
APART = {"isolated": ("--engine pinocchio --isolated", {"isolated_names.names": ["pinocchio"]})}
DECLARED = {"deviations": ("--deviations a.toml", {"read_deviations.path": "a.toml"})}
"""The option of every command that runs code that is not ours."""

CASES: dict[str, dict[str, Case]] = {
    "check": {
        **PATIENT,
        "file": ("", {"read_equations.name": "of_options.py:own"}, "of_options.py:own"),
        "scene": ("--scene sleigh", {"check_recorded.scene": "~Sleigh("}, TABLE),
        "n": ("--n 3", {"read_equations.n": 3}),
        "against": (
            "--against sleigh",
            {"reference_named.name": "sleigh", "check_equations.against": "sleigh"},
        ),
        "examples": ("--examples 7", {"check_equations.states": 7, "print_equations.states": 7}),
        "seed": ("--seed 9", {"check_equations.seed": 9, "read_equations.seed": 9}),
        "claim": (
            "--claim bias-even,bias-power",
            {"check_equations.claims": ["bias-even", "bias-power"]},
        ),
        "base": ("--base world", {"check_recorded.base": "world"}, TABLE),
        "precision": ("--precision float32", {"check_recorded.precision": "float32"}, TABLE),
        "figures": ("--figures .", {"draw_both.folder": "."}, TABLE),
        "json": ("--json a.json", {"write_equations.path": "a.json"}),
        "report": ("--report a.html", {"_write_page.path": "a.html"}),
    },
    "states": {
        **PATIENT,
        "output": ("-o b.csv", {"write_states.path": "b.csv"}),
        "scene": ("--scene sleigh", {"write_states.scene": "~Sleigh("}),
        "links": ("--links 3 --scene coil", {"write_states.scene": "~Snake("}),
        "settings": ("--set mass=2 --scene sleigh", {"write_states.scene": "~mass=2"}),
        "examples": ("--examples 7", {"write_states.examples": 7}),
        "seed": ("--seed 9", {"write_states.seed": 9}),
        "base": ("--base world", {"write_states.base": "world"}),
    },
    "validate": {
        **PATIENT,
        **APART,
        **DECLARED,
        "scene": ("--scene sleigh", {"validate_kind.kind": "Sleigh"}),
        "links": ("--links 2..5", {"validate_kind.links": [2, 5]}),
        "settings": ("--set mass=2 --scene sleigh", {"validate_kind.one": "~mass=2"}),
        "examples": ("--examples 7", {"validate_kind.examples": 7}),
        "seed": ("--seed 9", {"validate_kind.seed": 9}),
        "engine": ("--engine casadi", {"validate_kind.selection": "~'engines': ['CasadiEngine']"}),
        "engine that is named": (
            "--engine casadi",
            {"validate_kind.selection": "~'engines_named': True"},
        ),
        "engine none": ("--engine none", {"validate_kind.selection": "~'engines': []"}),
        "engine of one's own": (
            f"--engine {PLANAR}",
            {"validate_kinds.runs": "~'random-trees': {'findings'"},
        ),
        "engine of one's own and mechanisms": (
            f"--engine {PLANAR}",
            {"validate_kinds.runs": "~'random-mechanisms': {'findings'"},
        ),
        "formulation": (
            "--formulation au,el",
            {"validate_kind.selection": "~'formulations': ['au', 'el']"},
        ),
        "claim": (
            "--claim bias,kinetic-energy",
            {"validate_kind.selection": "~'claims': ['bias', 'kinetic-energy']"},
        ),
        "executor": ("--executor local:2", {"validate_kind.executor": "local:2"}),
        "json": ("--json a.json", {"write_findings.path": "a.json"}),
        "records": ("--records new.db", {"validate_kind.records": "records"}),
        "report": ("--report a.html --records new.db", {"_write_page.path": "a.html"}),
        "wide": ("--wide", {"print_runs.wide": True}),
    },
    "prove": {
        **PATIENT,
        "links": ("--links 2..3,7", {"proof_jobs.links": [2, 3, 7]}),
        "examples": ("--examples 9", {"proof_jobs.points": 9}),
        "seed": ("--seed 8", {"proof_jobs.seed": 8}),
        "scene": ("--scene sleigh", {"proof_jobs.scene": "sleigh"}),
        "formulation": ("--formulation au", {"proof_jobs.formulations": ["au"]}),
        "claim": ("--claim bias", {"proof_jobs.claims": ["bias"]}),
        "executor": ("--executor local:2", {"Proofs.executor": "local:2"}),
        "json": ("--json a.json", {"Proofs.path": "a.json"}),
        "records": ("--records new.db", {"Proofs.records": "records"}),
    },
    "list": {"registry": ("scenes", {"registry_table.name": "scenes"}, "")},
    "report": {
        "records": ("--junit a.xml other.db", {"read_records.paths": ["r.db", "other.db"]}),
        "html": ("--html a.html", {"write_page.path": "a.html"}),
        "markdown": ("--markdown a.md", {"write_markdown.path": "a.md"}),
        "junit": ("--junit a.xml", {"write_junit.path": "a.xml"}),
        "claim": ("--claim bias", {"Overview.claims": ["bias"]}),
        "equivalences": ("--equivalences e.md", {"write_equivalences.path": "e.md"}),
        "suite": (
            "--suite there",
            {"write_equivalences.suite": "there"},
            "r.db --equivalences e.md",
        ),
    },
    "badge": {
        "result": ("", {"write_badge.result": "f.json"}),
        "output": ("-o b.svg", {"write_badge.path": "b.svg"}),
        "engine": ("--engine casadi", {"write_badge.engine": "casadi"}),
        "label": ("--label own", {"write_badge.label": "own"}),
    },
    "export": {
        "records": ("a.csv", {"write_text.text": "~\nother,done,"}, "other.db"),
        "file": ("a.csv", {"write_text.path": "a.csv"}),
        "csv": ("a.md --no-csv", {"write_text.text": "~| other | done |"}, "other.db"),
    },
    "reference": {
        "names": ("disk", {"produce_all.cases": "~{'disk': {"}),
        "folder": ("--folder .", {"write_reference.folder": "."}),
        "executor": ("--executor local:2", {"produce_all.executor": "local:2"}),
        **PATIENT,
        "scene": (
            "--scene sleigh",
            {"produce_all.cases": "~{'sleigh-motion': {", "write_reference.scene": "sleigh"},
        ),
        "links": ("--links 2", {"produce_all.cases": "~links=2"}, "--scene snake"),
        "settings": ("--set offset=0.25", {"produce_all.cases": "~0.25"}, "--scene sleigh"),
        "speeds": ("--speeds 1,7", {"produce_all.cases": "~7.0"}, "--scene sleigh"),
        "end": ("--end 7", {"produce_all.cases": "~7.0"}, "--scene sleigh"),
    },
    "fuzz": {
        **PATIENT,
        **APART,
        "scene": ("--scene sleigh", {"plan.kind": "Sleigh", "name": "sleigh"}),
        "links": ("--links 3", {"strata": "~['3 links', '3 links, without damping',"}),
        "links of a range": (
            "--links 1..3",
            {"strata": [x.name for x in structural_variants(Snake, (1, 2, 3))]},
        ),
        "links as usual": (
            "--examples 2",
            {"strata": [x.name for x in structural_variants(Snake, range(1, 13))]},
        ),
        "engine": ("--engine none", {"plan.engines": [], "plan.wide": False}),
        "engine of ours": (
            "--engine casadi",
            {"plan.engines": ["CasadiEngine"], "plan.wide": True},
        ),
        "formulation": ("--formulation au,el", {"plan.formulations": ["au", "el"]}),
        "claim": ("--claim bias,kinetic-energy", {"plan.claims": ["bias", "kinetic-energy"]}),
        "time": ("--time 3m", {"run.states": None, "run.seconds": 180.0}, ""),
        "examples": ("--examples 5", {"run.states": 5, "run.seconds": None}),
        "seed": ("--seed 9", {"plan.seed": 9}),
        "motions": ("--motions", {"plan": "MotionPlan"}),
        "family": ("--family wide,fast", {"plan.families": ["wide", "fast"]}),
        "climb": ("--no-climb", {"plan.climbing": False}),
        "check_frequency": (
            "--check-frequency enclosures=1,balls=2,engines=3,checks=4,scalar-only=5",
            {
                "plan.check_frequency.enclosures": 1,
                "plan.check_frequency.balls": 2,
                "plan.check_frequency.engines": 3,
                "plan.check_frequency.checks": 4,
                "plan.check_frequency.scalar_only": 5,
            },
        ),
        "executor": ("--executor local:2", {"run.executor": "local:2"}),
        "records": ("--records new.db", {"records": "records"}),
        "replay": (
            REPLAY,
            {
                "read_failures.path": "f.json",
                "replay_failures.failures": ["kept"],
                "replay_failures.formulations": list(FORMULATIONS),
                "replay_failures.allowed": [],
            },
            "",
        ),
        "formulation of a replay": (
            "--formulation au,el",
            {"replay_failures.formulations": ["au", "el"]},
            REPLAY,
        ),
        "engine of a replay": (
            f"--engine {PLANAR}",
            {"replay_failures.allowed": [PLANAR]},
            REPLAY,
        ),
        "scene of a replay": ("--scene sleigh", {"replay_failures.allowed": ["sleigh"]}, REPLAY),
        "seed of motions": ("--seed 9", {"plan.seed": 9}, "--motions --examples 1"),
        "formulation of motions": (
            "--formulation au,el",
            {"plan.formulations": ["au", "el"]},
            "--motions --examples 1",
        ),
        "family of motions": (
            "--family special",
            {"plan.families": ["special"]},
            "--motions --examples 1",
        ),
        "climb of motions": ("--no-climb", {"plan.climbing": False}, "--motions --examples 1"),
        "seed of functions": ("--seed 9", {"plan.seed": 9}, FUNCTIONS),
        "claim of functions": ("--claim motion", {"plan.claims": ["motion"]}, FUNCTIONS),
        "family of functions": ("--family special", {"plan.families": ["special"]}, FUNCTIONS),
        "climb of functions": ("--no-climb", {"plan.climbing": False}, FUNCTIONS),
        "keep": (
            "--keep k.json",
            {"write_failures.path": "k.json", "write_failures.failures": ["kept", "find"]},
        ),
    },
    "simulate": {
        **PATIENT,
        "words": ("sleigh", {"simulate.scene": "~Sleigh("}),
        "end": ("--end 0.2", {"simulate.t_end": 0.2}, ""),
        "scene": ("--scene sleigh", {"simulate.scene": "~Sleigh("}),
        "links": ("--scene coil --links 3", {"simulate.scene": "~length=[1.0, 1.0, 1.0]"}),
        "settings": ("--scene sleigh --set offset=0.25", {"simulate.scene": "~offset=0.25"}),
        "speeds": ("--speeds 1,0.5", {"simulate.u0": [1.0, 0.5]}),
        "formulation": ("--formulation au", {"simulate.key": "au"}, "--end 0.1"),
        "integrator": ("--integrator RK45", {"simulate.integrator": "RK45"}),
        "tolerance": ("--tolerance 1e-5", {"simulate.rtol": 1e-5, "simulate.atol": 1e-5}),
        "max_steps": ("--max-steps 7", {"simulate.max_steps": 7}),
        "baumgarte": ("--baumgarte 10", {"simulate.baumgarte": 10.0}),
        "projection": ("--projection 0.5", {"simulate.projection": 0.5}),
        "examples": ("--examples 3", {"simulate_many.t_end": 0.1, "simulate_many.key": "kane"}),
        "tolerance of examples": (
            "--tolerance 1e-5",
            {"simulate_many.rtol": 1e-5, "simulate_many.atol": 1e-5},
            MANY,
        ),
        "max_steps of examples": ("--max-steps 7", {"simulate_many.max_steps": 7}, MANY),
        "formulation of examples": ("--formulation au", {"simulate_many.key": "au"}, MANY),
        "scale": ("--scale 0", {}, MANY),
        "seed": ("--seed 5", {}, MANY),
        "executor": (
            "--executor local:2",
            {"simulate_many.executor": "<ProcessPoolExecutor>"},
            MANY,
        ),
        "plot": ("--plot a.svg", {"draw_chart.path": "a.svg"}, MANY),
        "output": ("-o a.csv", {"write_trajectory.path": "a.csv"}),
    },
    "acceleration": {
        **PATIENT,
        "q": ("--scene sleigh --q 1,2,3", {"print_accelerations.q": [1.0, 2.0, 3.0]}),
        "name": ("sleigh", {"print_accelerations.scene": "~Sleigh("}),
        "scene": ("--scene sleigh", {"print_accelerations.scene": "~Sleigh("}),
        "links": (
            "--scene coil --links 3",
            {"print_accelerations.scene": "~length=[1.0, 1.0, 1.0]"},
        ),
        "settings": (
            "--scene sleigh --set offset=0.25",
            {"print_accelerations.scene": "~offset=0.25"},
        ),
        "speeds": ("--speeds 1,0.5", {"print_accelerations.u": [1.0, 0.5]}),
        "formulation": ("--formulation au,el", {"print_accelerations.keys": ["au", "el"]}),
    },
    "constraints": {
        **PATIENT,
        "scene": ("--scene sleigh", {"print_constraints.scene": "~Sleigh("}),
        "links": ("--scene coil --links 3", {"print_constraints.scene": "~length=[1.0, 1.0, 1.0]"}),
        "settings": (
            "--scene sleigh --set offset=0.25",
            {"print_constraints.scene": "~offset=0.25"},
        ),
    },
    "compare": {
        **PATIENT,
        **DECLARED,
        "robot": ("", {"compare_libraries.scene": "~crane"}),
        "other": (URDF, {"compare_robots.second": "~crane"}),
        "match": ("--match a=b", {"compare_robots.match": {"a": "b"}}, f"{URDF} {URDF}"),
        "patch": ("--patch a.diff", {"inertial_patch.second": "~crane"}, f"{URDF} {URDF}"),
        "engine": (
            "--engine mujoco,pinocchio",
            {"compare_libraries.engines": ["mujoco", "pinocchio"]},
        ),
        "examples": ("--examples 3", {"compare_libraries.states": 3}),
        "seed": ("--seed 4", {"compare_libraries.seed": 4}),
        "claim": (
            "--claim mass-matrix,engine-gravity",
            {"compare_libraries.claims": ["mass-matrix", "engine-gravity"]},
        ),
        "isolated": ("--isolated", {"compare_libraries.isolated": True}),
        "pairs": ("--pairs", {"print_comparison.pairs": True}),
        "wide": ("--wide", {"print_comparison.wide": True}),
        "json": ("--json a.json", {"write_comparison.path": "a.json"}),
    },
    "draw scene": {
        "path": ("b.svg", {"draw_scene.path": "b.svg"}, ""),
        "scene": ("--scene sleigh", {}),
        "links": ("--links 3", {}),
        "settings": ("--scene sleigh --set offset=0.25", {}, "a.svg --scene sleigh"),
        "dark": ("--dark", {"draw_scene.dark": True}),
        "end": ("--end 3", {"sketches_of_motion.end": 3.0}, GIF),
        "frames": ("--frames 9", {"sketches_of_motion.frames": 9}, GIF),
        "formulation": ("--formulation el", {"sketches_of_motion.formulation": "el"}, GIF),
        "speeds": ("--speeds 1,2", {"sketches_of_motion.u0": [1.0, 2.0]}, GIF),
    },
    "draw structure": {
        "path": ("b.svg", {"draw_structure.path": "b.svg"}, ""),
        "formulation": ("--formulation im", {"draw_structure.structure": "~im of "}),
        "scene": ("--scene sleigh", {}),
        "links": ("--links 3", {}),
        "settings": ("--scene sleigh --set offset=0.25", {}, "a.svg --scene sleigh"),
        "dark": ("--dark", {"draw_structure.dark": True}),
    },
}
"""Command -> option -> case; an option may have several, with " of ..." behind its name.

An option without any fails `test_no_option_is_left_out`."""

USUAL: dict[tuple[str, str], Seen] = {}
"""Command, words to begin with -> what is handed on without the option."""


@cache
def commands() -> dict[str, Any]:
    """Return every command that is no study, by its words."""
    top: Any = typer.main.get_command(cli.app)
    return {
        " ".join((name, *inner)): command
        for name, group in top.commands.items()
        for inner, command in (
            [((key,), one) for key, one in group.commands.items()]
            if name in GROUPS
            else [((), group)]
        )
    }


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files that are read."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("eomcheck.console.PATIENCE", 1e4)
    for name in ("r.db", "other.db"):
        with Records(tmp_path / name) as records:
            records.add(Record(name.removesuffix(".db"), {}))
    (tmp_path / "f.json").write_text("[]")
    (tmp_path / "of_options.py").write_text(OWN)
    monkeypatch.delitem(sys.modules, "of_options", raising=False)
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "validation" / "references").mkdir(parents=True)
    return tmp_path


def handed_on(command: str, words: list[str], monkeypatch: pytest.MonkeyPatch) -> Seen:
    """Return what a command hands on to what it calls."""
    seen: Seen = {}
    with monkeypatch.context() as patched:
        for name, value in STUBS.get(command, {}).items():
            stub(patched, seen, name, value)
        stub(patched, seen, "eomcheck.calls.set_patience")
        patched.setattr(campaigns, "Campaign", lambda *given: Campaign(seen, *given))
        patched.setattr(sys, "argv", ["eomcheck", *command.split(), *words])
        with pytest.raises(SystemExit) as stop:
            cli.main()
    assert stop.value.code in (0, 1, None)
    return seen


class Campaign:
    """A campaign that finds something at once, and notes what it is given."""

    def __init__(self, seen: Seen, plan: Any, name: str, strata: Any, kept: Any):
        self.seen, self.failure_records = seen, {"key": "find"}
        seen |= {"plan": type(plan).__name__, "name": name, "records": plain(kept)}
        seen["strata"] = [one.name for one in strata]
        for key, x in {one: getattr(plan, one) for one in plan.__dataclass_fields__}.items():
            for inner, y in (x._asdict() if key == "check_frequency" else {}).items():
                seen[f"plan.check_frequency.{inner}"] = y
            seen[f"plan.{key}"] = plain(x)

    def run(self, states: int | None, seconds: float | None, executor: str | None, told: Any):
        self.seen |= {"run.states": states, "run.seconds": seconds, "run.executor": executor}


def holds(expected: Any, found: Any) -> bool:
    """Return whether a value is the one expected, or holds the text behind a "~"."""
    if isinstance(expected, str) and expected.startswith("~"):
        return expected[1:] in str(found)
    return found == expected


def test_no_option_is_left_out():
    for command, one in commands().items():
        options = {x.name for x in one.params}
        assert options == {x.split()[0] for x in CASES[command]}, command
    assert commands().keys() == CASES.keys()


@pytest.mark.parametrize(
    ("command", "option"), [(command, option) for command in CASES for option in CASES[command]]
)
@pytest.mark.sampled(6)
def test_every_option_changes_what_its_command_hands_on(command, option, here, monkeypatch):
    words, expected, *begin = CASES[command][option]
    base = begin[0] if begin else BASES.get(command, "")
    default = BASES.get(command, "")
    usual = USUAL.get((command, base))
    if usual is None:
        usual = handed_on(command, (base or default).split(), monkeypatch)
        USUAL[command, base] = usual
    changed = handed_on(command, f"{base} {words}".split(), monkeypatch)
    wrong = {x: changed.get(x) for x, y in expected.items() if not holds(y, changed.get(x))}
    assert not wrong
    assert changed != usual or option in ("robot", "result", "file")


# ---- Studies -------------------------------------------------------------------------------------

STUDIES = [(group, key) for group, keys in GROUPS.items() for key in keys]


def value_of(name: str, parameter: Parameter, place: int) -> tuple[list[str], Any]:
    """Return words for an option of a study, and the value that they stand for, of each its own."""
    (kind, *_), flag = get_args(parameter.annotation), f"--{name.replace('_', '-')}"
    text = str(kind)
    if kind is bool:
        return [flag], True
    if "list[str]" in text:
        both = [f"mass={place}", "offset=1"] if name == "set" else [f"first{place}", "second"]
        return ([flag, both[0], flag, both[1]] if name == "set" else [flag, ",".join(both)]), both
    for of, number in ((int, place), (float, place / 64)):
        if of.__name__ in text:
            many = f"list[{of.__name__}]" in text
            return [flag, f"{number},{2 * number}" if many else str(number)], (
                [number, 2 * number] if many else number
            )
    return [flag, f"some{place}"], Path(f"some{place}") if "Path" in text else f"some{place}"


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("group", "key"), STUDIES, ids=[" ".join(x) for x in STUDIES])
def test_every_option_of_every_study_is_handed_on(group, key, here, monkeypatch):
    study, given, patient = study_of(key), dict[str, Any](), list[float]()
    monkeypatch.setattr("eomcheck.calls.set_patience", patient.append)

    def run(self, file: Path | None = None, fresh: bool = False, **options: Any) -> list[Record]:
        given.update(options | {"records": file, "fresh": fresh})
        return []

    def write(self, found: Any, folder: Path, extend: bool) -> list[Path]:
        given.update({"figures": folder} | ({"extend": extend} if extend else {}))
        return []

    monkeypatch.setattr(type(study), "run", run)
    monkeypatch.setattr(type(study), "write", write)
    monkeypatch.setattr(
        "eomcheck.lab.show.chart_matplotlib.draw_chart",
        lambda file, path, dark: given.update(path=path, dark=dark),
    )
    chart = SimpleNamespace(files=lambda: ["a"])
    how = {"charts": lambda found: [chart], "tables": lambda found: [], "remarks": lambda found: []}
    for name, value in (how | {"alarm": lambda found: False}).items():
        monkeypatch.setitem(study.__dict__, name, value)
    command = command_of(key, figure_only=group == "draw")
    options = study.options()
    shared = {"records", "fresh", "stored", "patience"}
    shared |= {"path", "dark"} if group == "draw" else {"json", "figures"}
    shared |= set() if study.small else {"file"}
    shared |= {"deviations"} if group != "draw" and study.observations is not None else set()
    extends = group != "draw" and study.extends is not None
    shared |= {"extend"} if extends else set()
    assert {x.name for x in command.params} == options.keys() | shared
    base = [group, key, *(["a.svg"] if group == "draw" else []), "--records", "k.db"]

    def ran(*more: str) -> dict[str, Any]:
        given.clear()
        monkeypatch.setattr(sys, "argv", ["eomcheck", *base, *more])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        assert not stop.value.code
        return dict(given)

    usual = ran()
    assert usual["records"] == Path("k.db") and not usual["fresh"]
    assert usual.keys() - {"path", "dark"} == options.keys() | {"records", "fresh", "stored"}
    assert all(usual[name] == one.default for name, one in options.items())
    words, values = ["--fresh", "--patience", "7"], {"fresh": True}
    for place, (name, one) in enumerate(options.items(), 7):
        more, values[name] = value_of(name, one, place)
        words += more
    if group == "draw":
        assert usual["path"] == Path("a.svg") and not usual["dark"]
        assert ran(*words, "--dark") == usual | values | {"dark": True}
    else:
        assert ran(*words, "--figures", ".", "--json", "a.json") == usual | values | {
            "figures": Path()
        }
        assert Path("a.json").is_file()
    assert patient[0] == 60.0 and patient[-1] == 7.0
    if extends:
        assert ran("--figures", ".", "--extend") == usual | {"figures": Path(), "extend": True}
        monkeypatch.setattr(sys, "argv", ["eomcheck", *base, "--extend"])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        assert stop.value.code == 2

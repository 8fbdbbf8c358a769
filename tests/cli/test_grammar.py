"""One grammar for all commands: scenes, links, parameters, lists, hints, completion, exit codes."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from tests.cli.test_cli import run

import eomcheck
from eomcheck import cli, console
from eomcheck.cli.application import EXIT_CODES, KEY_PATTERNS, QUICK_START, declared_keys
from eomcheck.engines import LIBRARIES, engine_of
from eomcheck.errors import InputError, UnknownNameError, did_you_mean
from eomcheck.lab.option_parsing import parse_numbers, parse_parameters, split_list
from eomcheck.mechanics.parameters import with_parameters
from eomcheck.scene_lookup import ROBOTS, scene_classes_named, scene_named
from eomcheck.scenes import FourBarChain, Sleigh, Snake

PENDULUM = Path(__file__).parents[2] / "docs" / "guides" / "pendulum.py"


# ---- Scenes --------------------------------------------------------------------------------------


def test_a_scene_is_named_alike_by_key_by_file_and_by_module():
    assert type(scene_named("sleigh")) is Sleigh
    assert scene_named("snake").links == 7 and scene_named("snake", 3).links == 3
    assert scene_named(f"{PENDULUM}:Pendulum").key == "pendulum"
    assert type(scene_named("eomcheck.scenes:Sleigh")) is Sleigh
    assert scene_named("coil", 4).links == 4 and scene_named("pattern").links == 7


def test_single_snakes_are_those_of_snake_and_no_kinds():
    for name, made in (("coil", Snake.coil(5)), ("pattern", Snake.pattern(5))):
        assert np.array_equal(scene_named(name, 5).wheel_angle, made.wheel_angle)
    assert np.array_equal(scene_named("paper").inertia, Snake.paper().inertia)
    with pytest.raises(InputError, match="links = 5: the robot of the paper has 7"):
        scene_named("paper", 5)
    for name in ROBOTS:
        with pytest.raises(InputError, match="single snake"):
            scene_classes_named(name)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"mass": [2.0]}, {"mass": [2.0] * 3}),
        ({"mass": [1.0, 2.0, 3.0]}, {"mass": [1.0, 2.0, 3.0]}),
        ({"stiffness": None}, {"stiffness": None}),
        ({"damping": [0.5]}, {"damping": [0.5, 0.5]}),  # absent before: its shape is declared
        ({}, {"length": [1.0] * 3}),
    ],
)
def test_parameters_take_one_number_for_all_or_each_or_none(given, expected):
    scene = with_parameters(Snake.coil(3), given)
    for name, value in expected.items():
        found = getattr(scene, name)
        assert value is None if found is None else found.tolist() == value


def test_a_scalar_and_a_scene_with_links_of_another_count_take_parameters():
    assert with_parameters(Sleigh(), {"offset": [0.25]}).offset == 0.25
    scene = with_parameters(FourBarChain.rods(2), {"mass": [2.0]})
    assert scene.links == 2 and set(scene.mass) == {2.0}


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (
            {"mas": [1.0]},
            r"parameter of snake 'mas' \(did you mean 'mass'\?\); known: mass, length",
        ),
        ({"mass": [1.0, 2.0]}, "2 numbers, expected 3, or one for all"),
        ({"mass": [-1.0]}, r"mass\[0\] = -1.0, expected a positive number"),
        ({"mass": None}, "mass = None"),
    ],
)
def test_parameters_that_a_scene_does_not_have_or_refuses_are_named(given, says):
    with pytest.raises(InputError, match=says):
        with_parameters(Snake.coil(3), given)


def test_acceleration_says_of_a_scene_what_the_library_says(monkeypatch, capsys):
    arguments = ("--scene", "coil", "--links", "3", "--set", "stiffness=7", "--set", "damping=none")
    assert run("acceleration", *arguments, "--speeds", "1,0.5", monkeypatch=monkeypatch) == 0
    snake = with_parameters(Snake.coil(3), {"stiffness": [7.0]})
    q, _ = snake.initial_state()
    v = eomcheck.velocity(snake, q, [1.0, 0.5])
    printed = capsys.readouterr().out
    for key in eomcheck.FORMULATIONS:
        found = eomcheck.acceleration(snake, key, q, v)
        assert f"{np.abs(found.vdot).max():.9g}"[:8] in printed


def test_a_positional_scene_and_scene_are_the_same_command(monkeypatch, capsys):
    ways = [
        ["acceleration", "sleigh", "--speeds", "1,0.5"],
        ["acceleration", "--scene", "sleigh", "--speeds", "1", "--speeds", "0.5"],
    ]
    printed = []
    for way in ways:
        assert run(*way, monkeypatch=monkeypatch) == 1, "its first column vanishes: two refuse"
        printed.append(capsys.readouterr().out)
    assert printed[0] == printed[1]


def test_validate_of_one_scene_looks_at_that_scene_alone(monkeypatch, capsys, tmp_path):
    import json

    file = tmp_path / "f.json"
    arguments = ("--set", "mass=2", "--links", "2", "--examples", "2", "--formulation", "kane,au")
    found = run("validate", *arguments, "--json", str(file), monkeypatch=monkeypatch)
    assert found == 0, capsys.readouterr()
    cases = json.loads(file.read_text(encoding="utf-8"))["cases"]
    assert len(cases) == 3 and {case["scene"] for case in cases} == {cases[0]["scene"]}
    document = json.loads(file.read_text(encoding="utf-8"))
    assert document["formulations"] == ["au", "kane"] or document["formulations"] == ["kane", "au"]


def test_simulate_moves_any_scene_and_keeps_loops_closed_in_draws(monkeypatch, capsys):
    assert run("simulate", "rolling-disk", "--end", "0.05", monkeypatch=monkeypatch) == 0
    assert "banded" not in capsys.readouterr().out, "it does not apply"
    many = (
        "0.01",
        "--scene",
        "four-bar-chain",
        "--links",
        "2",
        "--examples",
        "3",
        "--scale",
        "0.05",
    )
    assert run("simulate", *many, monkeypatch=monkeypatch) == 0
    printed = capsys.readouterr().out
    (row,) = [line for line in printed.splitlines() if line.startswith("│ θ_1")]
    (same,) = [line for line in printed.splitlines() if line.startswith("│ θ_2")]
    assert row.split("│")[2:] == same.split("│")[2:], "rods of closed loops stay parallel"


# ---- What says nothing is refused, what is misspelled is hinted at -------------------------------


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["acceleration", "--scene", "sleigh", "--links", "3"], "sleigh has no number of links"),
        (["acceleration", "paper", "--links", "9"], "--links 9: the robot of the paper has 7"),
        (["acceleration", "paper", "--scene", "coil"], "two scenes are named, 'paper' and 'coil'"),
        (["acceleration", "--scene", "all"], "'all': expected one scene"),
        (["acceleration", "papr"], "did you mean 'paper'"),
        (["acceleration", "--speeds", "1"], "--speeds [1.0]: snake[7] has 2"),
        (["acceleration", "--speeds", "1,x"], "--speeds 'x', expected numbers"),
        (["acceleration", "--set", "mass"], "--set 'mass', expected NAME=VALUE"),
        (["acceleration", "--set", "mass=1", "--set", "mass=2"], "mass is given twice"),
        (["acceleration", "--set", "mass=,"], "expected a number after mass="),
        (["acceleration", "--formulation", "kane,aux"], "'aux' (did you mean 'au'?)"),
        (["simulate", "paper"], "no end of the motion is given, expected s: --end END"),
        (["simulate", "paper", "coil", "--end", "1"], "expected one scene"),
        (["simulate", "--end", "1", "--scale", "0"], "--scale has no effect without --examples"),
        (["simulate", "--end", "1", "--seed", "0"], "--seed has no effect without --examples"),
        (["simulate", "--end", "1", "--plot", "x.png"], "--plot has no effect without --examples"),
        (["simulate", "--end", "1", "--integrator", "DOP85"], "did you mean 'DOP853'"),
        (["draw", "scene", "x.png", "--frames", "9"], "--frames has no effect in a picture"),
        (["draw", "scene", "x.svg", "--end", "2"], "--end has no effect in a picture"),
        (
            ["draw", "scene", "x.svg", "--formulation", "em"],
            "--formulation has no effect in a pict",
        ),
        (["draw", "scen", "x.png"], "unknown command of draw 'scen' (did you mean 'scene'?)"),
        (["study", "stabilty"], "did you mean 'stability'"),
        (
            ["study", "stability", "--records", "x.db", "--scene", "snake", "--family", "speed"],
            "both given",
        ),
        (["study", "stability", "--records", "x.db", "--family", "sped"], "did you mean 'speed'"),
        (["study", "operations", "--repeats", "3"], "nothing is timed without a scene"),
        (["study", "operations", "--scene", "sleigh", "--links", "3"], "sleigh has no number"),
        (["study", "engines", "--engine", "casadi,pinochio"], "did you mean 'pinocchio'"),
        (["bench", "rhs", "--links", "3,x"], "--links 'x', expected a number or a range"),
        (["bench", "rhs", "--links", "3", "--set", "mas=1"], "did you mean 'mass'"),
        (["bench", "rhs", "--scene", "sleigh", "--links", "3"], "sleigh has no number of links"),
        (["validate", "--scene", "sleig"], "did you mean 'sleigh'"),
        (["validate", "--scene", "all", "--set", "mass=1"], "'all': expected one scene"),
        (["validate", "--scene", "coil", "--links", "1..3"], "expected one number"),
        (["prove", "--scene", "coil"], "'coil' is a single snake"),
        (["report", "x.db", "--suite", "x"], "--suite has no effect without --equivalences"),
        (["list", "claim"], "did you mean 'claims'"),
        (
            ["study", "stiff", "--records", "x.db", "--quick"],
            "compute it: eomcheck reference paper-rest",
        ),
        (
            ["study", "work-precision", "--records", "x.db", "--reference", "own"],
            "references of eomcheck are",
        ),
        (["reference", "paper-res"], "did you mean 'paper-rest'"),
        (["fuzz", "--family", "ordinary,wid", "--examples", "1"], "did you mean 'wide'"),
        (["fuzz", "--claim", "bias,bia", "--examples", "1"], "did you mean 'bias'"),
        (["fuzz", "--scene", "sleigh", "--links", "3"], "sleigh has no number of links"),
        (
            ["fuzz", "--motions", "--check-frequency", "balls=1"],
            "--check-frequency has no effect with",
        ),
        (
            ["fuzz", "--replay", "x.json", "--examples", "3"],
            "--examples has no effect with --replay",
        ),
        (["fuzz", "--replay", "x.json", "--seed", "3"], "--seed has no effect with --replay"),
        (["fuzz", "--replay", "x.json", "--no-climb"], "--no-climb has no effect with --replay"),
        (["fuzz", "--replay", "x.json", "--executor", "local"], "--executor has no effect with"),
        (["validate", "--seed", "-1"], "--seed -1, expected a whole number of at least 0"),
        (["prove", "--seed", "-1"], "--seed -1, expected a whole number of at least 0"),
        (["simulate", "--seed=-1"], "--seed -1, expected a whole number of at least 0"),
        (
            ["study", "agreement", "--links", "2", "--per-size", "1", "--seed", "-1"],
            "--seed -1, expected a",
        ),
        (["draw", "scene", "x.foo"], "a figure is written as .png, .svg, .pdf or .gif"),
        (
            ["draw"],
            "draw needs a command: accuracy, agreement, scene, structure",
        ),
        (["validate", "--engine", ","], "',' names nothing"),
        (["validate", "--formulation", " , "], "' , ' names nothing"),
        (["prove", "--formulation", ""], "'' names nothing"),
        (["acceleration", "--formulation", ","], "',' names nothing"),
        (["acceleration", "--speeds", ","], "',' names nothing"),
        (["simulate", "--end", "1", "--formulation", ",,"], "',,' names nothing"),
        (["compare", "x.urdf", "--engine", ","], "',' names nothing"),
        (["fuzz", "--claim", ","], "',' names nothing"),
        (["fuzz", "--family", ","], "',' names nothing"),
        (["fuzz", "--engine", ","], "',' names nothing"),
        (["fuzz", "--formulation", ","], "',' names nothing"),
        (["study", "stability", "--records", "x.db", "--family", ","], "',' names nothing"),
        (["bench", "rhs", "--links", ","], "',' names nothing"),
        (["valdate"], "Did you mean 'validate'"),
        (["validate", "--sceen", "x"], "--sceen (did you mean '--scene'?)"),
        (["validate", "--seed"], "'--seed' requires an argument"),
        (["simulate"], "no end of the motion is given, expected s: --end END"),
        (["study", "paper", "--quick"], "no file is given, and paper takes long: --records FILE"),
    ],
)
def test_what_says_nothing_is_refused_and_names_are_hinted_at(
    arguments, says, monkeypatch, capsys, tmp_path
):
    monkeypatch.chdir(tmp_path)
    Path("validation/references").mkdir(parents=True)
    assert run(*arguments, monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert says in error and len(error.strip().splitlines()) == 1
    assert {path.name for path in tmp_path.iterdir()} == {"validation"}, "nothing was begun"


def test_a_hint_is_given_where_one_name_is_near_and_else_none():
    assert did_you_mean("Kane", ["au", "kane"]) == " (did you mean 'kane'?)"
    assert did_you_mean("zzz", ["au", "kane"]) == ""
    assert did_you_mean(3, ["au"]) == ""
    assert did_you_mean("--nonsense", ["--scene", "--seed"]) == ""
    assert did_you_mean("--sceen", ["--seed", "--scene"]) == " (did you mean '--scene'?)"
    assert did_you_mean("--s", ["--e"]) == "", "dashes are alike in all options"
    error = UnknownNameError("claim", "bia", eomcheck.CLAIMS)
    assert "did you mean 'bias'" in str(error)


@pytest.mark.parametrize("command", ["validate", "prove"])
def test_functions_where_a_scene_is_expected_are_told_where_to_go(
    command, monkeypatch, capsys, tmp_path
):
    text = "from eomcheck.testing import EquationsOfMotion as E\ngood, other = E(2, T=max), 3\n"
    (tmp_path / f"fun_{command}.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    name = f"fun_{command}.py:good"
    assert run(command, "--scene", name, monkeypatch=monkeypatch) == 2
    said = capsys.readouterr().err
    assert f"good in 'fun_{command}.py' is no scene" in said
    assert f"`eomcheck fuzz --scene {name}`" in said and f"eomcheck.check({name!r})" in said
    other = name.replace("good", "other")
    assert run(command, "--scene", other, monkeypatch=monkeypatch) == 2
    assert "has no scene 'other'; it has: none" in capsys.readouterr().err
    with pytest.raises(InputError, match="has no engine 'good'; it has: none"):
        engine_of(name)


# ---- Lists ---------------------------------------------------------------------------------------


def test_lists_are_read_with_commas_and_repeated():
    assert (
        split_list(["a,b", "c"]) == ["a", "b", "c"]
        and split_list([]) is None
        and split_list(None) is None
    )
    assert split_list(["some,folder/own.py:Own", "a,b"]) == ["some,folder/own.py:Own", "a", "b"]
    assert parse_numbers("speeds", ["1,-0.5", "2e3"]) == [1.0, -0.5, 2e3]
    assert parse_numbers("links", ["3", "5,7"], int) == [3, 5, 7]
    assert parse_parameters(["mass=1,2", " a = none"]) == {"mass": [1.0, 2.0], "a": None}
    for bad in ("3.5", "x"):
        with pytest.raises(InputError, match=f"links = '{bad}', expected whole numbers"):
            parse_numbers("links", [bad], int)


def test_a_study_reads_lists_both_ways(monkeypatch, capsys):
    arguments = ("bench", "rhs", "--links", "2..3", "--links", "4", "--repeats", "1")
    assert run(*arguments, "--formulation", "kane,au", monkeypatch=monkeypatch) == 0
    printed = capsys.readouterr().out
    for text in ("N = 2", "N = 3", "N = 4", "kane", "au"):
        assert text in printed
    assert " gw " not in printed


# ---- Doors, exit codes, completion ---------------------------------------------------------------


@pytest.mark.parametrize(("columns", "beside"), [(40, False), (80, True), (140, True)])
def test_alone_it_shows_a_quick_start_as_wide_as_the_terminal(columns, beside, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(columns))
    assert run(monkeypatch=monkeypatch) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 15 and max(map(len, lines)) <= min(columns, 100)
    for have, typed in QUICK_START.items():
        assert any(line.split("   ") == [have] for line in lines) != beside
        assert (
            any(line.startswith(have) and line.endswith(f"  {typed}") for line in lines) == beside
        )


def test_the_exit_codes_are_one_table_in_help_and_in_the_docs(monkeypatch, capsys):
    assert run("--help", monkeypatch=monkeypatch) == 0
    printed = " ".join(capsys.readouterr().out.split())
    file = Path(__file__).parents[2] / "docs/reference/command-line.md"
    page = file.read_text(encoding="utf-8")
    for code, what in EXIT_CODES.items():
        assert f"{code} {what}" in printed
        assert f"| {code} | {what} |" in page


@pytest.mark.parametrize("word", KEY_PATTERNS)
def test_keys_that_are_completed_are_those_that_there_are(word):
    others = {"robot": ROBOTS, "engine": LIBRARIES}
    known = others[word] if word in others else getattr(eomcheck, f"{word.upper()}S")
    assert sorted(declared_keys(word)) == sorted(known)


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("validate --scene sl", ["sleigh"]),
        ("validate --formulation kane,b", ["kane,banded"]),
        ("validate --engine mu", ["mujoco"]),
        ("simulate co", ["coil"]),
        ("study stab", ["stability"]),
        ("bench rhs --scene bri", ["bricard"]),
        ("list cl", ["claims"]),
    ],
)
@pytest.mark.night
def test_a_shell_is_told_the_rest_of_a_name_without_anything_heavy(typed, completed):
    code = (
        "import sys; sys.argv[0] = 'eomcheck'\n"
        "from eomcheck import cli\n"
        "try:\n    cli.main()\n"
        "finally:\n    print('loaded', 'numpy' in sys.modules, file=sys.stderr)"
    )
    words = f"eomcheck {typed}"
    asked = {"COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)}
    environment = os.environ | asked | {"_EOMCHECK_COMPLETE": "complete_bash"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False
    )
    assert done.stdout.split() == completed
    if not typed.startswith("bench"):  # whose options are those of the study
        assert done.stderr.split() == ["loaded", "False"]


# ---- What goes on --------------------------------------------------------------------------------


def test_what_takes_long_says_so_once_and_what_does_not_says_nothing(monkeypatch, capsys):
    monkeypatch.setattr(console, "PATIENCE", 0.05)
    with console.slow_work_notice("starting validate"):
        pass
    time.sleep(0.15)
    assert capsys.readouterr().err == ""
    with console.slow_work_notice("starting validate"):
        time.sleep(0.15)
    with console.slow_work_notice("starting validate"), console.progress("checking {state}", 12):
        time.sleep(0.15)
    said = capsys.readouterr().err
    assert said == "eomcheck: starting validate ...\neomcheck: checking 12 states ...\n"


def test_in_a_pipe_what_goes_on_is_named_every_few_seconds_with_its_steps(monkeypatch, capsys):
    monkeypatch.setattr(console, "PATIENCE", 0.02)
    monkeypatch.setattr(console, "EVERY", 0.3)
    notice, bar = "starting compare", "comparing at {state}"
    with console.slow_work_notice(notice), console.progress(bar, 12) as advance:
        advance()
        advance()
        time.sleep(0.5)
    first, *later = capsys.readouterr().err.splitlines()
    assert first in ("eomcheck: starting compare ...", "eomcheck: comparing at 12 states ...")
    assert later and {*later} <= {
        f"eomcheck: comparing at 12 states, 2 done ... {k} s" for k in range(60)
    }
    with console.slow_work_notice("starting fuzz"):
        time.sleep(0.1)
        console.report_progress("512 states")
        time.sleep(0.5)
    printed = capsys.readouterr()
    assert (printed.err, printed.out) == ("eomcheck: starting fuzz ...\n", "512 states\n")


def test_the_command_line_is_said_at_work(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["eomcheck", "list", "scenes"])
    monkeypatch.setattr(console, "PATIENCE", 0.0)
    with pytest.raises(SystemExit):
        cli.main()
    assert "eomcheck: starting list ..." in capsys.readouterr().err

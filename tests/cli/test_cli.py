from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from itertools import count
from pathlib import Path

import pytest
from tests.samples import NOT_OF_SNAKES

import eomcheck
from eomcheck import cli
from eomcheck.claims import run as run_of_claims
from eomcheck.cli.check_commands import REGISTRIES
from eomcheck.errors import DiedError, InputError, WorkerError
from eomcheck.evaluation.conformance import QUANTITIES
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.option_parsing import check_count
from eomcheck.lab.store.record_file import Records, record_of_rows
from eomcheck.lab.store.validation_runs import RUNS
from eomcheck.lab.studies import rhs
from eomcheck.scenes import SCENES, Snake


def run(*arguments: str, monkeypatch: pytest.MonkeyPatch) -> int:
    """Run the command line in this process and return its exit code."""
    monkeypatch.setattr(sys, "argv", ["eomcheck", *arguments])
    monkeypatch.setattr("eomcheck.console.PATIENCE", 1e4)  # on slow machines too it says no more
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code or 0


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["validate", "--links", "0"], "--links '0'"),
        (["validate", "--links", "5..2"], "--links '5..2'"),
        (["validate", "--links", "many"], "--links 'many'"),
        (["validate", "--examples", "0"], "--examples 0"),
        (["validate", "--examples", "9" * 40], "expected at most 1000000000"),
        (["validate", "--json", "x" * 5000], "5000 characters are no name of a file"),
        (["validate", "--scene", "x" * 5000 + ".py:S"], "5003 characters are no name of a file"),
        (
            ["validate", "--engine", "bullet"],
            "'bullet' (did you mean 'pybullet'?); known: pinocchio",
        ),
        (["validate", "--formulation", "xx"], "unknown formulation 'xx'; known: im, au"),
        (["validate", "--json", "no/such/folder/x.json"], "does not exist"),
        (["validate", "--scene", "all", "--executor", "ray:1"], "expected local, local:NUMBER"),
        (
            ["validate", "--scene", "tests/lab/test_states.py:HeavyInside", "--executor", "local"],
            "executor = 'local': a user-supplied scene or engine is checked in one process",
        ),
        (["fuzz", "--links", "0"], "--links '0'"),
        (["fuzz", "--time", "5"], "--time '5', expected a time such as 20s"),
        (["fuzz", "--time", "0s"], "--time '0s'"),
        (["fuzz", "--time", "5s", "--examples", "5"], "--time and --examples: expected one"),
        (["fuzz", "--examples", "0"], "--examples 0"),
        (["fuzz", "--family", "mild"], "unknown family 'mild'; known: ordinary, wide"),
        (["fuzz", "--check-frequency", "1,2"], "--check-frequency '1,2', expected NAME=NUMBER"),
        (["fuzz", "--scene", "all"], "expected one kind of scene"),
        (["fuzz", "--claim", "beauty"], "unknown claim 'beauty'"),
        (["fuzz", "--executor", "ray:1"], "expected local, local:NUMBER"),
        (["fuzz", "--replay", "no-such.json"], "'no-such.json' is no file"),
        (["fuzz", "--keep", "no/such/folder/x.json"], "does not exist"),
        (["prove", "--links", "3,0"], "--links '0'"),
        (["prove", "--links", "2..1"], "--links '2..1'"),
        (["prove", "--examples", "0"], "--examples 0"),
        (["prove", "--scene", "worm"], "unknown scene 'worm'; known: snake"),
        (["prove", "--formulation", "xx"], "unknown formulation 'xx'"),
        (["prove", "--json", "no/such/folder/x.json"], "does not exist"),
        (["prove", "--executor", "ray:1"], "expected local, local:NUMBER or dask:ADDRESS"),
        (["export", "no-such.db"], "no such file"),
        (["export", "pyproject.toml", "--csv"], "'pyproject.toml' is not a file of records"),
        (["export", "no-such.db", "--csv", "no/such/folder/x"], "does not exist"),
        (["study", "accuracy", "--links", "x"], "--links 'x'"),
        (["study", "work-precision", "--records", "x.db", "--reference", "none"], "none.json"),
        (
            ["study", "work-precision", "--records", "x.db", "--integrator", "Euler"],
            "integrator 'Euler'",
        ),
        (["study", "work-precision", "--records", "x.db", "--tolerance", "2"], "--tolerance 2.0"),
        (
            ["study", "work-precision", "--records", "x.db", "--figures", "no/such"],
            "'no/such' cannot be made: there is no folder 'no'",
        ),
        (["study", "accuracy", "--examples", "0"], "--examples 0"),
        (
            ["study", "stability", "--records", "x.db", "--family", "none"],
            "unknown family 'none'; known: stiff",
        ),
        (
            ["study", "stability", "--records", "x.db", "--formulation", "xx"],
            "unknown formulation 'xx'",
        ),
        (
            ["study", "stability", "--records", "x.db", "--figures", "no/such"],
            "'no/such' cannot be made: there is no folder 'no'",
        ),
        (
            ["study", "stability", "--records", "x.db", "--executor", "ray:1"],
            "expected local, local:NUMBER",
        ),
        (["acceleration", "coil", "--links", "0"], "--links 0"),
        (["acceleration", "paper", "--formulation", "xx"], "unknown formulation 'xx'"),
        (["acceleration", "pattern", "--links", "95", "--speeds", "1,1"], "wheel_angle[89]"),
        (["draw", "accuracy", "a.png", "--examples", "0"], "--examples 0"),
        (["draw", "accuracy", "picture.gif"], "written as .png, .svg or .pdf"),
        (["bench", "rhs", "--links", "0"], "--links '0'"),
        (["study", "agreement", "--per-size", "0"], "--per-size 0"),
        (["bench", "rhs", "--repeats", "0"], "--repeats 0"),
        (["bench", "tolerance", "--examples", "-3"], "--examples -3"),
        (["study", "operations", "--links", "0"], "--links '0'"),
        (["study", "operations", "--formulation", "xx"], "unknown formulation 'xx'; known: im, au"),
        (["study", "operations", "--json", "no/such/folder/x"], "does not exist"),
        (["draw", "agreement", "picture.gif"], "written as .png, .svg or .pdf"),
        (["draw", "agreement", "a.png", "--links", "0"], "--links '0'"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(arguments, says, monkeypatch, capsys):
    assert run(*arguments, monkeypatch=monkeypatch) == 2
    captured = capsys.readouterr()
    assert says in captured.err
    assert len(captured.err.strip().splitlines()) == 1
    assert "Traceback" not in captured.err
    assert not Path("x.db").exists()  # nothing was begun


def test_a_count_is_1_to_1000000000():
    check_count(examples=1, states=10**9)
    for number in (0, 10**9 + 1, 10**400):
        with pytest.raises(InputError, match="states = "):
            check_count(states=number)


def test_accelerations_are_printed_with_what_to_trust_them(monkeypatch, capsys):
    assert run("acceleration", "paper", monkeypatch=monkeypatch) == 0
    printed = capsys.readouterr().out
    for key in eomcheck.FORMULATIONS:
        assert key in printed
    assert "1415.777043 rad/s²" in printed and "θ_2" in printed
    assert "refuses" not in printed
    assert "snake[7]" in printed and "at rest: x = 0 m" in printed and "θ_1 = 0.7679 rad" in printed
    assert "KKT: the matrix of" in printed
    assert run("acceleration", "paper", "--speeds", "1,0.5", "--formulation", "kane",
               monkeypatch=monkeypatch) == 0  # fmt: skip
    printed = capsys.readouterr().out
    assert "Their rates: x: 0.88" in printed and "KKT" not in printed


def test_units_are_those_of_each_coordinate(monkeypatch, capsys):
    crane = Path(__file__).parents[2] / "docs" / "guides" / "crane.urdf"
    assert run("acceleration", str(crane), "--formulation", "kane", monkeypatch=monkeypatch) == 0
    printed = capsys.readouterr().out
    assert "slew = 0 rad, travel = 0 m, swing = 0 rad" in printed
    assert (
        run(
            "simulate",
            str(crane),
            "--end",
            "0.01",
            "--formulation",
            "kane",
            monkeypatch=monkeypatch,
        )
        == 0
    )
    assert "run time (s)" in capsys.readouterr().out


def test_redundant_constraints_are_named(monkeypatch, capsys, tmp_path):
    path = tmp_path / "twice.py"
    path.write_text(
        "from eomcheck.scenes import Bricard\n"
        "class Five(Bricard):\n"
        "    key = 'five'\n"
        "    @classmethod\n"
        "    def structures(cls, links=None):\n"
        "        yield cls(angle=1.0, redundant=1.0)\n"
    )

    def said(*arguments: str) -> tuple[int, str]:
        code = run("constraints", "--scene", *arguments, monkeypatch=monkeypatch)
        return code, capsys.readouterr().out

    code, out = said(f"{path}:Five")
    assert code == 1
    lines = [line for line in out.splitlines() if "along" in line]
    assert ["redundant" in line for line in lines] == [False, False, False, False, True]
    assert "hinge along z" in lines[-1]
    assert "n = 5, r = 5, rank 4" in out
    code, out = said("snake", "--links", "2")
    assert code == 0 and "redundant" not in out and "rank 2" in out
    code, out = said("chain-pendulum")
    assert code == 0 and "has no constraint" in out
    assert said("bricard", "--links", "2")[0] == 2


def test_a_refusal_names_the_matrix_and_its_rcond_and_is_exit_code_1(monkeypatch, capsys):
    arguments = ["acceleration", "pattern", "--links", "60", "--speeds", "1", "--speeds", "0.5"]
    assert run(*arguments, monkeypatch=monkeypatch) == 1
    printed = capsys.readouterr().out
    assert "kane refuses: the 2 x 2 matrix M_Kane is singular to working precision" in printed
    assert "its reciprocal condition number is" in printed


def test_unknown_options_are_exit_code_2(monkeypatch, capsys):
    assert run("validate", "--no-such-option", monkeypatch=monkeypatch) == 2
    assert "no-such-option" in capsys.readouterr().err


def test_version_and_help_import_no_compiler_no_engine_and_no_plots():
    code = (
        "import sys; from eomcheck import cli\n"
        "sys.argv = ['eomcheck', '--help']\n"
        "try:\n    cli.main()\nexcept SystemExit:\n    pass\n"
        "heavy = {'numba', 'llvmlite', 'numpy', 'scipy', 'casadi', 'pinocchio', 'matplotlib'}\n"
        "print('loaded', sorted((heavy | {'hypothesis'}) & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "validate" in done.stdout
    assert done.stdout.splitlines()[-1] == "loaded []"
    version = subprocess.run(
        [sys.executable, "-c", "import sys; from eomcheck import cli; sys.argv[1:] = ['--version']"
         "; cli.main()"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert version.stdout.strip() == f"eomcheck {eomcheck.__version__}"


@pytest.mark.parametrize("registry", REGISTRIES)
def test_list_names_everything_registered(registry, monkeypatch, capsys):
    assert run("list", registry, monkeypatch=monkeypatch) == 0
    printed = capsys.readouterr().out
    named = QUANTITIES if registry == "quantities" else getattr(eomcheck, registry.upper())
    for key in named:
        assert key in printed


def test_validate_prints_tables_writes_json_and_exits_0(monkeypatch, capsys, tmp_path):
    file = tmp_path / "findings.json"
    arguments = ["validate", "--wide", "--links", "1..3", "--examples", "3", "--json", str(file)]
    assert run(*arguments, monkeypatch=monkeypatch) == 0
    printed = capsys.readouterr().out
    document = json.loads(file.read_text(encoding="utf-8"))
    named = {finding["claim"] for finding in document["findings"]}
    assert named >= set(eomcheck.CLAIMS) - {"refusals"} - NOT_OF_SNAKES
    assert all(claim in printed for claim in named)
    assert " claims passed" in printed
    assert {finding["verdict"] for finding in document["findings"]} <= {"passed", "inconclusive"}
    assert len(document["cases"]) == 5
    for name, of in document["factors"]["snake"].items():
        assert name in printed
        assert sum(of.values()) == 4, "all but the initial state are drawn"
    assert max(finding["case"] for finding in document["findings"]) == 4


def test_only_the_engines_and_formulations_asked_for_take_part(monkeypatch, capsys, tmp_path):
    file = tmp_path / "findings.json"
    arguments = ["--engine", "casadi", "--formulation", "au", "--formulation", "kane"]
    limits = ["--links", "2", "--examples", "2", "--json", str(file)]
    assert run("validate", *arguments, *limits, monkeypatch=monkeypatch) == 0
    findings = json.loads(file.read_text(encoding="utf-8"))["findings"]
    assert not [f for f in findings if "pinocchio" in f["evidence"]]
    pairs = {f["subject"] for f in findings if f["claim"] == "equivalence"}
    assert pairs == {"au ~ kane"}


def plant_in_au(monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(M, F, a, gamma, v, partition):
        return right(M, F, a, -gamma, v, partition)

    right = FORMULATIONS["au"].solution
    monkeypatch.setitem(FORMULATIONS, "au", replace(FORMULATIONS["au"], solution=wrong))


def test_a_failing_claim_is_exit_code_1_with_a_minimal_state_that_can_be_pasted(
    monkeypatch, capsys
):
    plant_in_au(monkeypatch)
    assert run("validate", "--links", "1..6", "--examples", "30", monkeypatch=monkeypatch) == 1
    printed = capsys.readouterr().out
    _, verdict, _, first, *_ = printed.splitlines()
    assert re.fullmatch(r"\d+ of \d+ claims failed: constraint-acceleration, .*", verdict)
    assert first.startswith("FAIL constraint-acceleration (au) on snake, N = ")
    code = printed[printed.index("import eomcheck") :]
    scene = code[code.index("scene = Snake(") :].splitlines()[0]
    assert scene.count("1.0") and "mass=[1.0]" in scene, "hypothesis shrinks to one link"
    exec(code, {})
    assert "constraint-acceleration [au] failed on snake[1]" in capsys.readouterr().out


def test_an_interrupted_run_keeps_what_it_has_and_exits_130(monkeypatch, capsys, tmp_path):
    look, looks = run_of_claims.evaluate_state, count()

    def interrupted(*arguments):
        if next(looks) == 3:
            raise KeyboardInterrupt
        return look(*arguments)

    monkeypatch.setattr(run_of_claims, "evaluate_state", interrupted)
    file = tmp_path / "findings.json"
    arguments = ["validate", "--links", "2", "--examples", "9", "--json", str(file)]
    assert run(*arguments, monkeypatch=monkeypatch) == 130
    assert len(json.loads(file.read_text(encoding="utf-8"))["cases"]) == 3
    assert "interrupted" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("ended", "code"),
    [
        (KeyboardInterrupt(), 130),
        (DiedError("1 item killed every worker: bicycle"), 1),
        (WorkerError("the workers have another version of eomcheck"), 2),
    ],
    ids=["Ctrl-C", "killed", "other sources"],
)
@pytest.mark.sampled(3)
def test_a_validation_of_all_scenes_that_ends_early_keeps_the_scenes_that_are_done(
    monkeypatch, capsys, tmp_path, ended, code
):
    def spread(where, function, items):
        yield items[0], function(items[0])
        raise ended

    monkeypatch.setattr("eomcheck.lab.store.validation_runs.parallel_map", spread)
    files = {name: str(tmp_path / name) for name in ("json", "records")}
    options = [word for name, file in files.items() for word in (f"--{name}", file)]
    arguments = ["validate", "--scene", "all", "--examples", "2", "--links", "2", *options]
    assert run(*arguments, monkeypatch=monkeypatch) == code
    cases = json.loads((tmp_path / "json").read_text(encoding="utf-8"))["cases"]
    assert len(cases) >= 4 and len({case["scene"].split("[")[0] for case in cases}) == 1
    with Records(tmp_path / "records") as records:
        of_runs = [record.status for record in records.all(RUNS)]
    assert sorted(of_runs) == ["done"] + ["failed"] * (len(SCENES) - 1), "not finished"
    said = capsys.readouterr()
    assert " claims passed" in said.out
    assert ("interrupted" if code == 130 else str(ended)) in said.out + said.err


def test_bench_rhs_times_what_was_asked_for(monkeypatch, capsys, tmp_path):
    file = tmp_path / "timings.json"
    arguments = ["--links", "3", "--links", "5", "--formulation", "kane", "--repeats", "2"]
    assert run("bench", "rhs", *arguments, "--json", str(file), monkeypatch=monkeypatch) == 0
    timings = json.loads(file.read_text(encoding="utf-8"))["timings"]
    names = {"sin, cos", "kane", "kane, 8 lanes", "pinocchio"}
    if shutil.which("gcc") or shutil.which("cc"):
        names.add("casadi, C")
    assert {(t["what"], t["links"]) for t in timings} == {
        (what, links) for what in names for links in (3, 5)
    }
    assert all(t["seconds"] > 0 for t in timings)
    printed = capsys.readouterr().out
    assert "N = 5" in printed


def test_bench_rhs_times_what_has_no_constraints_beside_aba(monkeypatch, capsys, tmp_path):
    # Not all its coordinates are angles, nor those that are in a row.
    file = tmp_path / "timings.json"
    crane = Path(__file__).parents[2] / "docs" / "guides" / "crane.urdf"
    arguments = ["--scene", str(crane), "--formulation", "kane", "--repeats", "2"]
    arguments += ["--json", str(file)]
    assert run("bench", "rhs", *arguments, monkeypatch=monkeypatch) == 0
    timings = json.loads(file.read_text(encoding="utf-8"))["timings"]
    assert {"sin, cos", "kane", "kane, 8 lanes", "pinocchio, aba"} <= {t["what"] for t in timings}


def test_bench_rhs_counts_lanes_by_the_state(monkeypatch):
    called = []
    monkeypatch.setattr(rhs, "timing_loop", lambda *_: called.append)
    rhs._lanes_call(FORMULATIONS["kane"], *rhs.bench_state(Snake, 3))(17)
    assert called == [3]


def test_bench_rhs_needs_no_angles():
    timings = [rhs.Timing("slide", "kane", 0, 1e-9, (1e-9, 1e-9), 0.1)]
    (sheet,) = rhs.tables([record_of_rows("rhs", {}, timings)])
    assert tuple(sheet.rows[0][:2]) == ("kane", "1 ns") and not sheet.note


def test_bench_tolerance_prints_the_constant(monkeypatch, capsys):
    arguments = ["bench", "tolerance", "--links", "2", "--examples", "3"]
    assert run(*arguments, monkeypatch=monkeypatch) == 0
    assert "the constant C is 32" in capsys.readouterr().out


def test_study_operations_prints_counts_polynomials_systems_and_springs(
    monkeypatch, capsys, tmp_path
):
    file = tmp_path / "operations.json"
    arguments = ["study", "operations", "--links", "2..9", "--json", str(file)]
    assert run(*arguments, monkeypatch=monkeypatch) == 0
    printed = capsys.readouterr().out
    assert max(len(line) for line in printed.splitlines()) <= 140
    for text in ("N = 9", "39 N - 23", "66 N - 41", "108 N - 67", "2n + r: the same at every N"):
        assert text in printed
    assert "no fit" not in printed
    document = json.loads(file.read_text(encoding="utf-8"))
    counted = {(x["formulation"], x["links"]): x for x in document["operations"]}
    assert set(counted) == {(key, links) for key in FORMULATIONS for links in range(2, 10)}
    full = {"name": "M_Kane", "order": 2, "columns": 1, "half": None}
    assert counted["kane", 7]["solves"] == [full]
    assert counted["banded", 7]["solves"] == [full | {"name": "KKT", "order": 26, "half": 3}]
    for fitted in document["polynomials"]:
        for links in range(2, 10):
            factors = map(Fraction, fitted["coefficients"]["additions"])
            value = sum(factor * links**power for power, factor in enumerate(factors))
            assert value == counted[fitted["formulation"], links]["additions"]
    assert {x["formulation"] for x in document["systems"] if x["final"]} == set(FORMULATIONS)


def test_study_operations_says_where_nothing_fits_and_shows_no_springs_where_there_are_none(
    monkeypatch, capsys
):
    arguments = ["study", "operations", "--links", "1", "--formulation", "kane"]
    assert run(*arguments, monkeypatch=monkeypatch) == 0
    printed = capsys.readouterr().out
    assert "no fit: no polynomial of degree 4 or less" in printed
    assert "2 at N = 1" in printed
    assert "Springs" not in printed
    assert "gw" not in printed


def test_draw_agreement_writes_a_picture(monkeypatch, capsys, tmp_path):
    file = tmp_path / "agreement.png"
    arguments = ["draw", "agreement", str(file), "--links", "2", "--per-size", "1"]
    assert run(*arguments, monkeypatch=monkeypatch) == 0
    assert file.read_bytes().startswith(b"\x89PNG")


def test_a_scene_of_which_nothing_can_be_proved_is_exit_code_2_and_told_why(
    monkeypatch, capsys, tmp_path
):
    own = tmp_path / "own.py"
    own.write_text(
        "import numpy as np\n"
        "from eomcheck.scenes import Sleigh\n"
        "class Roots(Sleigh):\n"
        "    @staticmethod\n"
        "    def terms(*arguments):\n"
        "        terms = Sleigh.terms(*arguments)\n"
        "        return terms._replace(M=terms.M * (1 + 0 * np.cbrt(arguments[2][0])))\n"
    )
    place = f"{own}:Roots"
    assert run("prove", "--scene", place, monkeypatch=monkeypatch) == 2
    printed = capsys.readouterr()
    assert "skipped: finite-terms [terms]" in printed.out and "0 disproved" in printed.out
    assert "no identity could be tested" in printed.err


def test_prove_prints_the_bounds_and_the_probability(monkeypatch, capsys):
    assert (
        run("prove", "--links", "1,3", "--examples", "2", "--seed", "7", monkeypatch=monkeypatch)
        == 0
    )
    printed = capsys.readouterr().out
    assert "0 disproved on 5 of 5 structures" in printed
    assert "2 random points and primes each).\nseed 7\n" in printed
    assert "equivalence" in printed and "bits" in printed


def test_accuracy_is_measured_printed_and_written(tmp_path, monkeypatch, capsys):
    path = tmp_path / "accuracy.json"
    arguments = ("--links", "1..3", "--examples", "3", "--json", str(path))
    assert run("study", "accuracy", *arguments, monkeypatch=monkeypatch) == 0
    assert "3 states; errors against the enclosed truth" in capsys.readouterr().out
    rows = json.loads(path.read_text(encoding="utf-8"))["accuracy"]
    assert len(rows) == 3 * len(FORMULATIONS)
    assert {row["key"] for row in rows} == set(FORMULATIONS)


def test_accuracy_is_drawn(tmp_path, monkeypatch):
    path = tmp_path / "accuracy.png"
    arguments = ("--links", "1..3", "--examples", "3")
    assert run("draw", "accuracy", str(path), *arguments, monkeypatch=monkeypatch) == 0
    assert path.stat().st_size > 10_000


def test_bench_motion_times_the_same_motion_twice(monkeypatch, capsys, tmp_path):
    path = tmp_path / "motions.json"
    arguments = ("--formulation", "kane", "--json", str(path))
    monkeypatch.setattr("eomcheck.lab.studies.motion.END", 0.01)
    assert run("bench", "motion", *arguments, monkeypatch=monkeypatch) == 0
    assert "DOP853, rtol = atol = 1e-12" in capsys.readouterr().out
    (row,) = json.loads(path.read_text(encoding="utf-8"))["motions"]
    assert row["formulation"] == "kane"
    # 12 stages a step at least.
    assert row["right_hand_sides"] > 12
    assert 0 < row["seconds"] < row["seconds_in_python"]


def test_python_dash_m_is_the_command():
    command = [sys.executable, "-m", "eomcheck", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == f"eomcheck {eomcheck.__version__}"

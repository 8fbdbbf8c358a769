"""Recorded answers: tables, printed digits, what is judged, and how failures are explained."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.trials.recorded_answers import FAULTS, FORMATS, Model, outcome, table_of, write_answers

from eomcheck import cli
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.evaluation.conformance import ConformancePoint, quantity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab.recorded_answers import check_answers, table_layout, write_states
from eomcheck.lab.recorded_table import (
    EXACT,
    Digits,
    digits_of,
    index_in,
    most_digits,
    open_table,
    parse_name,
    write_table,
)
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES, from_urdf

CHAIN = SCENES["chain-pendulum"].example()

# ---- Digits --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("texts", "decimals", "significant"),
    [
        (["0.1234", "12.3400"], 4, 6),
        (["12.34", "0.001234", "0.5"], 6, 4),
        (["1.234e+01", "-1.2e-3"], 4, 4),
        (["100", "-7"], 0, 3),
        (["1e3"], -3, 1),
        (["nan", "1.5"], 1, 2),
    ],
)
def test_digits_are_the_most_of_a_column(texts, decimals: int, significant: int):
    assert digits_of(texts) == Digits(decimals, significant)


@pytest.mark.parametrize("form", ["%.4f", "%.4g", "%.7g", "%.3e", "%.12f"])
def test_a_printed_number_is_known_to_half_a_unit_of_its_last_digit(form: str):
    random = np.random.default_rng(0)
    x = random.normal(size=400) * 10.0 ** random.uniform(-3, 3, 400)
    texts = [form % y for y in x]
    printed = np.array(texts, float)
    allowed = digits_of(texts).error_of(printed)
    assert (np.abs(printed - x) <= allowed * (1 + 1e-9)).all()
    # And not to much more: some numbers are off by nearly as much.
    assert np.max(np.abs(printed - x) / allowed) > 0.9


def test_all_digits_have_no_error():
    assert not EXACT.error_of(np.array([1.0, 0.0])).any()
    assert not digits_of([repr(0.1 + 0.2)]).error_of(np.array([0.3])).any()


def test_zero_is_known_to_its_decimals():
    np.testing.assert_allclose(Digits(4, 4).error_of(np.zeros(1)), [5e-5])


def test_columns_of_one_format_have_the_digits_of_the_one_that_shows_most():
    assert most_digits([Digits(0, 1), Digits(4, 5)]) == Digits(4, 5)


# ---- Tables --------------------------------------------------------------------------------------

COLUMNS = {"q[0]": np.array([0.1, -2.0, 1e-300]), "M[0;0]": np.array([1.0, 2.0, 3.0])}


@pytest.mark.parametrize("suffix", [".csv", ".json", ".npz", ".parquet"])
def test_what_is_written_is_read_with_all_digits(suffix: str, tmp_path: Path):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    path = tmp_path / f"table{suffix}"
    write_table(path, COLUMNS)
    table = open_table(path)
    assert table.names == tuple(COLUMNS)
    (chunk,) = table.chunks()
    np.testing.assert_array_equal(chunk.values, np.column_stack(list(COLUMNS.values())))


def test_a_long_table_is_read_in_chunks(tmp_path: Path, monkeypatch):
    monkeypatch.setattr("eomcheck.lab.recorded_table.CHUNK", 4)
    for suffix in (".csv", ".npz"):
        path = tmp_path / f"long{suffix}"
        write_table(path, {"q[0]": np.arange(10.0)})
        chunks = list(open_table(path).chunks())
        assert [chunk.first for chunk in chunks] == [0, 4, 8]
        np.testing.assert_array_equal(np.concatenate([x.values[:, 0] for x in chunks]), range(10))


def test_comments_spaces_and_quotes_are_read(tmp_path: Path):
    path = tmp_path / "a.csv"
    path.write_text('# by hand\n q[0] , "M[0,0]"\n1, 2\n\n3,4\n')
    table = open_table(path)
    assert table.names == ("q[0]", "M[0,0]")
    assert [x.values.tolist() for x in table.chunks()] == [[[1.0, 2.0], [3.0, 4.0]]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no names of columns"),
        ("q[0]\n", "has no rows"),
        ("1,2\n3,4\n", "no names of columns"),
        ("q[0],q[0]\n1,2\n", "two columns 'q[0]'"),
        ("q[0],b\n1,2\n3\n", "row 1 (line 3): 1 columns, expected 2"),
        ("q[0],b\n1,2\n3,x\n", "row 1 (line 3): b = 'x' is no number"),
        ("q[0],b\n1,2,3\n1,2,3\n", "has no rows"),
    ],
)
def test_a_wrong_table_is_one_sentence(text: str, message: str, tmp_path: Path):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        list(open_table(path).chunks())
    assert message in str(error.value)


def test_a_wrong_file_is_one_sentence(tmp_path: Path):
    for name, text, message in (
        ("a.txt", "", "expected a file .csv"),
        ("none.csv", None, "is not a file"),
        ("a.json", "[", "cannot be read"),
        ("b.json", '{"q[0]": [1], "a": [1, 2]}', "'q[0]' has 1 rows, others more"),
        ("c.json", '{"q[0]": []}', "has no rows"),
        ("d.json", '{"q[0]": [[1]]}', "expected one column"),
        ("e.npz", "x", "cannot be read"),
    ):
        if text is not None:
            (tmp_path / name).write_text(text)
        with pytest.raises(InputError) as error:
            open_table(tmp_path / name)
        assert message in str(error.value)


def test_names_of_columns_have_a_quantity_and_indices():
    assert parse_name("J[tool][x;elbow]") == ("J", ("tool", "x;elbow"))
    assert parse_name("kinetic_energy") == ("kinetic_energy", ())
    assert parse_name("J[tool") is None
    names = (("x", "ω_z"), ("a", "b", "c"))
    assert (
        index_in("ω_z;b", names, "") == index_in("wz;1".replace("wz", "w_z"), names, "") == (1, 1)
    )
    assert index_in("0,2", names, "") == (0, 2)
    for text in ("x", "x;d", "2;a", "x;a;b", "x;-1"):
        with pytest.raises(InputError, match="column 'J'"):
            index_in(text, names, "J")


# ---- States --------------------------------------------------------------------------------------


def test_states_are_written_with_names_and_all_digits(tmp_path: Path):
    path = tmp_path / "states.csv"
    write_states(CHAIN, path, 12, 3)
    with path.open(newline="") as file:
        head, *rows = csv.reader(file)
    names = CHAIN.coordinate_names
    assert head == [f"{x}[{name}]" for x in ("q", "v", "vdot") for name in names]
    values = np.array(rows, float)
    assert values.shape == (12, 9)
    np.testing.assert_array_equal(values[0, :6], np.concatenate(CHAIN.initial_state()))
    assert np.abs(values[:, :3]).max() > 2 * np.pi  # many turns
    assert len({tuple(row) for row in values[:, 6:].tolist()}) == 12
    write_states(CHAIN, tmp_path / "again.csv", 12, 3)
    assert path.read_text() == (tmp_path / "again.csv").read_text()
    write_states(CHAIN, tmp_path / "other.csv", 12, 4)
    assert path.read_text() != (tmp_path / "other.csv").read_text()


def test_states_of_constraints_satisfy_them_and_have_their_time(tmp_path: Path):
    scene = SCENES["turntable-ball"].example()
    write_states(scene, tmp_path / "a.npz", 6)
    with np.load(tmp_path / "a.npz") as file:
        q, v = (np.column_stack([file[f"{x}[{n}]"] for n in scene.coordinate_names]) for x in "qv")
        t = file["t"] if scene.depends_on_time else np.zeros(6)
    for k in range(6):
        scene.check_state(q[k], v[k], float(t[k]))


# ---- Judging -------------------------------------------------------------------------------------


def recorded(
    path: Path, change: Callable[[str, int, Any], Any] = lambda name, row, x: x, form: str = "%.17g"
) -> Path:
    """Write states of a chain with our own answers, changed by name and row."""
    states = path.with_name("states.csv")
    write_states(CHAIN, states, 8, 1)
    with states.open(newline="") as file:
        head, *rows = csv.reader(file)
    lines, names = [], []
    for k, row in enumerate(rows):
        q, v, vdot = np.array(row, float).reshape(3, 3)
        point = ConformancePoint(Evaluation(CHAIN, q, v), vdot)
        answers = {"M": point.at.terms.M, "bias": point.bias, "U": point.weight.U}
        changed = {name: np.asarray(change(name, k, x)) for name, x in answers.items()}
        names = [
            f"{name}[{';'.join(map(str, i))}]" if i else name
            for name, x in changed.items()
            for i in np.ndindex(x.shape)
        ]
        lines.append([*row, *(form % y for x in changed.values() for y in x.ravel())])
    write_answers(path, [[*head, *names], *lines])
    return path


def failures(path: Path) -> dict[str, str]:
    findings, _ = check_answers(path, CHAIN)
    return {x.subject: x.detail for x in findings if x.verdict == "failed"}


def test_right_answers_pass_and_the_rows_and_digits_are_told(tmp_path: Path):
    findings, notes = check_answers(recorded(tmp_path / "a.csv", form="%.6g"), CHAIN)
    assert {x.subject for x in findings if x.verdict == "passed"} == {
        "M",
        "bias",
        "potential_energy",
    }
    assert notes[0].startswith("8 rows; printed with 6 digits")


def test_the_row_the_entry_and_the_mistake_are_named(tmp_path: Path):
    def wrong(name, row, x):
        return x * np.where(np.eye(3)[1] > 0, -1, 1) if (name, row) == ("bias", 4) else x

    detail = failures(recorded(tmp_path / "a.csv", wrong))["bias"]
    assert "wrong sign" in detail
    assert detail.endswith("row 4 (line 6); 1 of 8 rows differ")


def test_an_error_of_a_digit_that_is_printed_is_found_and_one_below_is_not(tmp_path: Path):
    def off(error):
        return lambda name, row, x: x + error if name == "bias" else x

    assert failures(recorded(tmp_path / "a.csv", off(2e-4), "%.4f")).keys() == {"bias"}
    assert not failures(recorded(tmp_path / "b.csv", off(1e-6), "%.4f"))


def test_a_constant_of_a_potential_energy_is_free_and_a_slope_is_not(tmp_path: Path):
    assert not failures(
        recorded(tmp_path / "a.csv", lambda name, k, x: x + 7 if name == "U" else x)
    )
    wrong = recorded(tmp_path / "b.csv", lambda name, k, x: 1.01 * x if name == "U" else x)
    assert failures(wrong).keys() == {"potential_energy"}


def test_entries_that_the_digits_cannot_tell_are_named(tmp_path: Path):
    findings, _ = check_answers(recorded(tmp_path / "a.csv", form="%.0f"), CHAIN)
    assert not [x for x in findings if x.verdict == "failed"]
    (found,) = [x for x in findings if (x.subject, x.verdict) == ("M", "inconclusive")]
    assert "cannot be told with the digits that are printed" in found.detail


def test_the_worst_of_many_rows_is_judged(tmp_path: Path, monkeypatch):
    monkeypatch.setattr("eomcheck.lab.recorded_answers.MOST_JUDGED", 2)
    path = recorded(tmp_path / "a.csv", lambda n, k, x: x + 1 if (n, k) == ("M", 3) else x)
    assert "row 3 (line 5)" in failures(path)["M"]


def test_a_row_without_numbers_is_named(tmp_path: Path):
    path = recorded(tmp_path / "a.csv", lambda n, k, x: x * np.nan if (n, k) == ("M", 5) else x)
    assert failures(path)["M"] == "M, row 5 (line 7): no finite numbers; 1 such rows"


def test_some_entries_are_judged_alone(tmp_path: Path):
    table = open_table(recorded(tmp_path / "a.csv"))
    columns = dict(zip(table.names, next(table.chunks()).values.T, strict=True))
    few = {n: c for n, c in columns.items() if n[0] in "qv" or n in ("M[2;0]", "bias[1]")}
    write_table(tmp_path / "few.npz", few)
    assert not failures(tmp_path / "few.npz")
    write_table(tmp_path / "wrong.npz", few | {"M[2;0]": -few["M[2;0]"]})
    assert "entry (θ_3, θ_1): wrong sign" in failures(tmp_path / "wrong.npz")["M"]


def test_forces_that_are_applied_are_read(tmp_path: Path):
    q, v, force = np.random.default_rng(0).normal(size=(3, 3))
    columns = {f"q[{k}]": [x] for k, x in enumerate(q)} | {f"v[{k}]": [x] for k, x in enumerate(v)}
    qdd = quantity(CHAIN, "forward_dynamics", q, v, tau=force)
    columns |= {f"qdd[{k}]": [x] for k, x in enumerate(qdd)}
    path = tmp_path / "a.json"
    path.write_text(json.dumps(columns))
    assert failures(path).keys() == {"forward_dynamics"}
    path.write_text(json.dumps(columns | {f"force[{k}]": [x] for k, x in enumerate(force)}))
    assert not failures(path)


STATE = {f"{x}[{k}]": np.zeros(1) for x in ("q", "v", "vdot") for k in range(3)}


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"M[0;3]": 1.0}, "'3' is none of θ_1, θ_2, θ_3"),
        ({"M[0]": 1.0}, "expected 2 indices, not 1"),
        ({"C[0;0]": 1.0}, "a Coriolis matrix is not unique"),
        ({"J[0;0]": 1.0}, "'0;0'"),
        (
            {"bias[0]": 1.0, "bias[θ_1]": 1.0},
            "columns 'bias[0]' and 'bias[θ_1]' are the same entry",
        ),
        ({"masses[0]": 1.0}, "'masses[0]'"),
        ({}, "has no answers"),
        ({"b 1": 1.0}, "is no name such as"),
        ({"com": 1.0}, "expected 1 indices, not 0"),
    ],
)
def test_a_column_that_is_nothing_is_one_sentence(columns, message: str, tmp_path: Path):
    write_table(tmp_path / "a.npz", STATE | {name: np.full(1, x) for name, x in columns.items()})
    with pytest.raises((InputError, UnknownNameError)) as error:
        table_layout(open_table(tmp_path / "a.npz"), CHAIN)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("column", "missing"), [("M[0;0]", "q"), ("bias[0]", "v"), ("tau[0]", "vdot")]
)
def test_a_column_of_the_state_that_is_missing_is_named(column: str, missing: str, tmp_path: Path):
    columns = {name: x for name, x in STATE.items() if name != f"{missing}[1]"}
    write_table(tmp_path / "a.npz", columns | {column: np.ones(1)})
    with pytest.raises(InputError, match=rf"has no column {missing}\[θ_2\]"):
        table_layout(open_table(tmp_path / "a.npz"), CHAIN)


def test_a_state_that_is_no_number_is_bad_input(tmp_path: Path):
    write_table(tmp_path / "a.npz", STATE | {"q[1]": np.full(1, np.nan), "M[0;0]": np.ones(1)})
    with pytest.raises(InputError, match="row 0: the state has no finite numbers"):
        check_answers(tmp_path / "a.npz", CHAIN)


# ---- Explanations --------------------------------------------------------------------------------


AXES = "0 0 1", "0 1 0", "0 0.6 0.8", "1 0 0", "0 1 0", "0.8 0 0.6"


def arm_text() -> str:
    """Return the URDF of an arm of six joints with oblique axes and inertias."""
    parts = ['<robot name="arm"><link name="base"/>']
    for k, axis in enumerate(AXES):
        parent = f"link{k - 1}" if k else "base"
        parts.append(
            f'<link name="link{k}"><inertial><origin xyz="0.1 0.05 {0.1 + 0.02 * k:.6g}" '
            f'rpy="0.3 {0.1 * k:.6g} 0"/><mass value="{3.0 - 0.4 * k:.6g}"/><inertia ixx="0.04" '
            f'ixy="0.004" ixz="-0.003" iyy="0.05" iyz="0.002" izz="0.03"/></inertial></link>'
            f'<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="link{k}"/>'
            f'<origin xyz="0 0.1 {0.3 - 0.03 * k:.6g}" rpy="0.2 0 0"/><axis xyz="{axis}"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
    return "".join([*parts, "</robot>"])


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, Model, list[list[str]]]:
    """An arm, Pinocchio's model of it, and states."""
    folder = tmp_path_factory.mktemp("arm")
    path = folder / "arm.urdf"
    path.write_text(arm_text())
    scene = from_urdf(path)
    write_states(scene, folder / "states.csv", 12, 2)
    with (folder / "states.csv").open(newline="") as file:
        return scene, Model(str(path), "link5"), list(csv.reader(file))


def test_right_answers_of_another_library_pass_with_any_digits(arm, tmp_path: Path):
    scene, model, states = arm
    for form in FORMATS:
        path = write_answers(tmp_path / "a.csv", table_of(model, states, form, None))
        findings, _ = check_answers(path, scene)
        assert [x for x in findings if x.verdict == "failed"] == []
        assert len({x.subject for x in findings if x.verdict == "passed"}) == 8


@pytest.mark.sampled(4)
@pytest.mark.parametrize("fault", FAULTS, ids=lambda x: x.id)
def test_a_fault_of_recorded_answers_is_named(fault, arm, tmp_path: Path, sized):
    scene, model, states = arm
    for form in sized(FORMATS, FORMATS[1:2]):
        assert outcome(fault, scene, model, states, form, tmp_path / "a.csv") in (
            "named",
            "too few digits",
        )


@pytest.mark.parametrize("id", ["M-stale", "q-degrees", "J-own-axes", "com-axes-exchanged"])
def test_a_fault_of_the_state_the_row_or_the_axes_is_named(id: str, arm, tmp_path: Path):
    (fault,) = [x for x in FAULTS if x.id == id]
    assert outcome(fault, *arm, "%.7g", tmp_path / "a.csv") == "named"


# ---- The command ---------------------------------------------------------------------------------


def test_states_are_written_and_answers_checked_by_commands(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("eomcheck.console.PATIENCE", 1e4)

    def run(*words: str) -> int:
        monkeypatch.setattr(sys, "argv", ["eomcheck", *words])
        with pytest.raises(SystemExit) as stop:
            cli._run()
        return int(stop.value.code or 0)

    assert run("states", "--scene", "chain-pendulum", "--examples", "3", "-o", "s.csv") == 0
    assert "written: s.csv" in capsys.readouterr().out
    recorded(tmp_path / "right.csv")
    assert run("check", "right.csv", "--scene", "chain-pendulum") == 0
    assert "3 quantities passed, 0 failed" in capsys.readouterr().out
    recorded(tmp_path / "wrong.csv", lambda name, k, x: -x if name == "bias" else x)
    words = "--json", "a.json", "--report", "a.html"
    assert run("check", "wrong.csv", "--scene", "chain-pendulum", *words) == 1
    out = capsys.readouterr().out
    assert "1 of 3 quantities failed: bias" in out
    assert "wrong sign" in out
    document = json.loads(Path("a.json").read_text())
    assert [x["subject"] for x in document["findings"] if x["verdict"] == "failed"] == ["bias"]
    assert "bias" in Path("a.html").read_text(encoding="utf-8")
    for wrong, message in (
        (("check", "right.csv"), "recorded answers need --scene"),
        (("check", "right.csv", "--scene", "chain-pendulum", "--n", "3"), "--n"),
        (("check", "model.py", "--scene", "sleigh"), "--scene"),
        (("states", "-o", "a.txt"), "expected a file .csv"),
    ):
        assert run(*wrong) == 2
        assert message in capsys.readouterr().err

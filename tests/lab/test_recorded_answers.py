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
from tests.trials.recorded_answers import (
    FAULTS,
    FLOATING_FAULTS,
    FORMATS,
    Model,
    floating_outcome,
    outcome,
    table_of,
    write_answers,
)

from eomcheck import cli
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.evaluation.conformance import ConformancePoint, quantity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab.recorded_answers import check_answers, table_layout, write_states
from eomcheck.lab.recorded_base import CONVENTIONS, base_state, parse_convention, recorded_base
from eomcheck.lab.recorded_finding import compared_entries
from eomcheck.lab.recorded_log import compared_row
from eomcheck.lab.recorded_table import (
    EXACT,
    Digits,
    digits_of,
    digits_of_type,
    index_in,
    most_digits,
    open_table,
    parse_name,
    write_table,
)
from eomcheck.mechanics.scene import Scene
from eomcheck.scene_lookup import scene_named
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


def test_binary_numbers_are_known_to_the_roundoff_of_their_type():
    single = digits_of_type(np.float32)
    np.testing.assert_array_equal(single.error_of(np.array([2.0, -1.0])), [2.0**-23, 2.0**-24])
    assert digits_of_type(np.float64) == digits_of_type(np.int64) == EXACT
    assert most_digits([EXACT, single]) == single


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


@pytest.mark.parametrize("suffix", [".csv", ".json", ".npz", ".parquet"])
def test_a_header_is_read_and_lines_are_counted_behind_it(suffix: str, tmp_path: Path):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    path = tmp_path / f"table{suffix}"
    write_table(path, COLUMNS, {"base": "body axes", "precision": "float32"})
    table = open_table(path)
    assert table.header == {"base": "body axes", "precision": "float32"}
    assert table.names == tuple(COLUMNS)
    assert table.line_of(0) == ("row 0 (line 4)" if suffix == ".csv" else "row 0")


def test_columns_of_float32_are_read_as_such(tmp_path: Path):
    np.savez(tmp_path / "a.npz", **{name: x.astype(np.float32) for name, x in COLUMNS.items()})
    table = open_table(tmp_path / "a.npz")
    assert {digits.roundoff for digits in table.digits} == {2.0**-24}
    assert all(chunk.values.dtype == np.float64 for chunk in table.chunks())


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


@pytest.mark.parametrize("text", ["nan", "", "inf"])
def test_one_entry_without_a_number_is_no_right_answer(text: str, tmp_path: Path):
    path = recorded(tmp_path / "a.csv")
    with path.open(newline="") as file:
        head, *rows = csv.reader(file)
    rows[5][head.index("M[1;2]")] = text
    write_answers(path, [head, *rows])
    assert failures(path) == {"M": "M, row 5 (line 7): no finite numbers; 1 such rows"}


def test_rows_behind_the_first_chunk_are_judged_as_those_in_it(tmp_path: Path, monkeypatch):
    monkeypatch.setattr("eomcheck.lab.recorded_table.CHUNK", 4)
    later = recorded(tmp_path / "a.csv", lambda n, k, x: x + 7 * (k > 3) if n == "U" else x)
    assert failures(later)["potential_energy"].endswith("4 of 8 rows differ")
    before: dict[int, Any] = {}

    def stale(name: str, k: int, x: Any) -> Any:
        if name != "M":
            return x
        before[k] = x
        return before[3] if k == 4 else x

    found = failures(recorded(tmp_path / "b.csv", stale))["M"]
    assert "as the row before: stale" in found
    assert "row 4 (line 6)" in found


def test_some_entries_are_judged_alone(tmp_path: Path):
    table = open_table(recorded(tmp_path / "a.csv"))
    columns = dict(zip(table.names, next(table.chunks()).values.T, strict=True))
    few = {n: c for n, c in columns.items() if n[0] in "qv" or n in ("M[2;0]", "bias[1]")}
    write_table(tmp_path / "few.npz", few)
    assert not failures(tmp_path / "few.npz")
    write_table(tmp_path / "wrong.npz", few | {"M[2;0]": -few["M[2;0]"]})
    assert "entry (θ_3, θ_1): wrong sign" in failures(tmp_path / "wrong.npz")["M"]


def printed_by(code: str, capsys) -> list[str]:
    """Return the lines that code prints."""
    exec(code, {})
    return capsys.readouterr().out.splitlines()


def test_the_code_of_a_failure_reads_its_row_and_prints_what_differs(tmp_path: Path, capsys):
    def wrong(name, row, x):
        if name == "U":
            return x + 3 + (row == 6)
        return x * np.where(np.eye(3)[1] > 0, -1, 1) if (name, row) == ("bias", 4) else x

    path = recorded(tmp_path / "a.csv", wrong, "%.9f")
    failed = {x.subject: x for x in check_answers(path, CHAIN)[0] if x.verdict == "failed"}
    place, *entries = printed_by(failed["bias"].as_python(), capsys)
    table = open_table(path)
    (chunk,) = table.chunks()
    row = dict(zip(table.names, chunk.values[4], strict=True))
    q = np.array([row[f"q[{name}]"] for name in CHAIN.coordinate_names])
    v = np.array([row[f"v[{name}]"] for name in CHAIN.coordinate_names])
    assert place == f"row 4 (line 6): q = {q}, v = {v}, t = 0.0"
    ours = ConformancePoint(Evaluation(CHAIN, q, v)).bias[1]
    x, y = row["bias[1]"], float(ours)
    assert len(entries) == 1
    assert entries[0].startswith(f"bias[1]: {x:.6g} recorded, {y:.6g} expected; off by {x - y:.3g}")
    # The constant of a potential energy is that of the first row.
    place, energy = printed_by(failed["potential_energy"].as_python(), capsys)
    assert place.startswith("row 6 (line 8): ") and "; off by 1, allowed" in energy


@pytest.mark.parametrize("kind", ["coriolis", "float32", "nan", "parts"])
def test_the_code_of_any_failing_answers_shows_a_difference(kind: str, tmp_path: Path, capsys):
    path, options = tmp_path / "a.npz", {}
    match kind:
        case "coriolis":
            own_answers(path, lambda x: {"C": x["C"] / 2})
        case "float32":
            own_answers(path, lambda x: {"M": x["M"] * (1 + 2e-4)})
            options = {"precision": "float32"}
        case "nan":
            path = recorded(tmp_path / "a.csv", lambda n, k, x: x * np.nan if n == "M" else x)
        case "parts":
            whole = open_table(recorded(tmp_path / "all.csv"))
            columns = dict(zip(whole.names, next(whole.chunks()).values.T, strict=True))
            few = {n: -c if n[0] == "M" else c for n, c in columns.items() if n[:4] != "bias"}
            write_table(path, {n: c for n, c in few.items() if n[0] in "qv" or n == "M[2;0]"})
    failed = [x for x in check_answers(path, CHAIN, **options)[0] if x.verdict == "failed"]
    assert failed
    for one in failed:
        _, *entries = printed_by(one.as_python(), capsys)
        assert entries and all("recorded" in x and "off by" in x for x in entries)
        assert all(f"{name}={text!r}" in one.as_python() for name, text in options.items())


def test_entries_that_differ_or_are_no_numbers_are_shown_and_all_where_none_does():
    names, zeros = "abc", np.zeros(3)
    for recorded_, shown in (
        ([0.0, np.nan, 2.0], "bc"),
        ([np.inf, 0.5, -1.0], "a"),
        ([0.0, 0.5, -1.0], "abc"),
    ):
        found = compared_entries(names, np.array(recorded_), zeros, np.ones(3))
        assert "".join(one.column for one in found) == shown


def test_the_code_of_a_failure_runs_in_any_folder(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    path = recorded(Path("a.csv"), lambda name, row, x: -x if name == "bias" else x)
    (failed,) = [x for x in check_answers(path, CHAIN)[0] if x.verdict == "failed"]
    code = failed.as_python()
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    assert len(printed_by(code, capsys)) > 1


def test_a_row_or_a_quantity_that_is_not_there_is_one_sentence(tmp_path: Path):
    path = recorded(tmp_path / "a.csv")
    with pytest.raises(InputError, match=r"row = 8: '.*' has 8 rows"):
        compared_row(path, CHAIN, "M", 8)
    with pytest.raises(InputError, match=r"'qdd': nothing in row 1 of '.*' is about it"):
        compared_row(path, CHAIN, "qdd", 1)


def own_answers(path: Path, change: Callable[[dict[str, Any]], Any], header=None) -> Path:
    """Write states with M, bias and C of ours, in the numbers of `change`."""
    write_states(CHAIN, path.with_name("states.npz"), 6, 5)
    table = open_table(path.with_name("states.npz"))
    (chunk,) = table.chunks()
    columns = dict(zip(table.names, chunk.values.T, strict=True))
    for q, v, vdot in chunk.values.reshape(6, 3, 3):
        point = ConformancePoint(Evaluation(CHAIN, q, v), vdot)
        C = point.coriolis_matrix
        answers = change({"v": v, "M": point.at.terms.M, "bias": point.bias, "C": C})
        for name, x in answers.items():
            for i in np.ndindex(np.shape(x)):
                key = f"{name}[{';'.join(map(str, i))}]"
                columns[key] = np.append(columns.get(key, []), x[i]).astype(x.dtype)
    write_table(path, columns, header)
    return path


def test_a_coriolis_matrix_is_judged_by_its_product_with_v(tmp_path: Path):
    def only(C: Callable[[Any, Any], Any]) -> Callable[[dict[str, Any]], Any]:
        return lambda x: {"C": C(x["C"], x)}

    rank_one = only(lambda C, x: np.outer(x["bias"], x["v"]) / (x["v"] @ x["v"] or 1.0))
    assert not failures(own_answers(tmp_path / "a.npz", only(lambda C, x: C)))
    assert not failures(own_answers(tmp_path / "b.npz", rank_one))
    wrong = failures(own_answers(tmp_path / "c.npz", only(lambda C, x: C / 2)))
    assert wrong.keys() == {"C v"}
    assert "half the expected value" in wrong["C v"]


def test_a_coriolis_matrix_gives_the_rate_of_M_where_it_is_declared(tmp_path: Path):
    declared = {"coriolis": "skew"}
    right = own_answers(tmp_path / "a.npz", lambda x: {"C": x["C"]}, declared)
    assert not failures(right)

    def rank_one(x: dict[str, Any]) -> dict[str, Any]:
        return {"C": np.outer(x["bias"], x["v"]) / (x["v"] @ x["v"] or 1.0)}

    assert failures(own_answers(tmp_path / "b.npz", rank_one, declared)).keys() == {"C + Cᵀ"}


def test_a_program_in_float32_is_allowed_its_rounding_and_no_more(tmp_path: Path):
    def single(factor: float) -> Callable[[dict[str, Any]], Any]:
        return lambda x: {k: np.float32(factor * x[k]) for k in ("M", "bias")}

    assert not failures(own_answers(tmp_path / "a.npz", single(1.0 + 2e-7)))
    assert failures(own_answers(tmp_path / "b.npz", single(1.0 + 2e-4))).keys() == {"M", "bias"}
    double = own_answers(
        tmp_path / "c.npz", lambda x: {"M": x["M"] * (1 + 2e-7)}, {"precision": "float32"}
    )
    assert not failures(double)
    findings, _ = check_answers(double, CHAIN, precision="float64")
    assert [x.subject for x in findings if x.verdict == "failed"] == ["M"]
    with pytest.raises(InputError, match="precision = 'half': expected float64 or float32"):
        check_answers(double, CHAIN, precision="half")


def test_inputs_of_a_program_in_float32_are_rounded_first(tmp_path: Path):
    q = np.array([0.1, 0.7, -0.3])
    columns = {f"q[{k}]": q[k : k + 1] for k in range(3)}
    M = Evaluation(CHAIN, q.astype(np.float32).astype(float), np.zeros(3)).terms.M
    columns |= {f"M[{i};{j}]": M[i, j : j + 1] for i, j in np.ndindex(3, 3)}
    write_table(tmp_path / "a.csv", columns)
    findings, _ = check_answers(tmp_path / "a.csv", CHAIN, precision="float32")
    assert [x.observed for x in findings if x.subject == "M"] == [0.0]


def test_rows_that_cannot_be_computed_in_batches_are_compared_one_by_one(
    tmp_path: Path, monkeypatch
):
    def wrong(name, row, x):
        return -x if (name, row) == ("M", 6) else x

    path = recorded(tmp_path / "a.csv", wrong)
    in_batches = failures(path)

    def unable(*arguments):
        raise TypeError

    monkeypatch.setattr("eomcheck.lab.recorded_answers.batch_data", unable)
    assert failures(path) == in_batches
    assert in_batches.keys() == {"M"}


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
        ({"C[0;0]": 1.0}, "has some entries of C: all are needed"),
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


@pytest.mark.parametrize(
    ("column", "missing"), [("M[0;0]", "q"), ("bias[0]", "v"), ("tau[0]", "vdot")]
)
def test_an_input_that_is_missing_wholly_is_not_0(column: str, missing: str, tmp_path: Path):
    columns = {name: x for name, x in STATE.items() if not name.startswith(f"{missing}[")}
    write_table(tmp_path / "a.npz", columns | {column: np.ones(1)})
    with pytest.raises(InputError, match=rf"has no column {missing}\[θ_1\]"):
        table_layout(open_table(tmp_path / "a.npz"), CHAIN)


def test_a_state_that_is_no_number_is_bad_input(tmp_path: Path):
    write_table(tmp_path / "a.npz", STATE | {"q[1]": np.full(1, np.nan), "M[0;0]": np.ones(1)})
    with pytest.raises(InputError, match="row 0: the state has no finite numbers"):
        check_answers(tmp_path / "a.npz", CHAIN)


# ---- Explanations --------------------------------------------------------------------------------


AXES = "0 0 1", "0 1 0", "0 0.6 0.8", "1 0 0", "0 1 0", "0.8 0 0.6"


def arm_text(joints: int = len(AXES)) -> str:
    """Return the URDF of an arm with oblique axes and inertias."""
    parts = ['<robot name="arm"><link name="base"/>']
    for k, axis in enumerate(AXES[:joints]):
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


# ---- Free bases ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def floating(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, str]:
    """An arm on a free base, and its file."""
    path = tmp_path_factory.mktemp("floating") / "arm.urdf"
    base = (
        '<link name="base"><inertial><origin xyz="0.1 0 0.02"/><mass value="3"/>'
        '<inertia ixx="0.1" iyy="0.12" izz="0.09" ixy="0.01" ixz="0" iyz="0"/></inertial></link>'
    )
    few = arm_text(3).replace('<link name="base"/>', base)
    path.write_text(few)
    return scene_named(f"{path}:floating"), str(path)


def floating_case(
    floating, fault: Any, convention: str, form: str, folder: Path, examples: int = 6
) -> str:
    scene, path = floating
    write_states(scene, folder / "states.csv", examples, 3, convention)
    files = folder / "states.csv", form, folder / "answers.csv"
    return floating_outcome(fault, scene, path, "link2", *files)


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_right_answers_about_a_free_base_pass_in_every_convention(
    convention: str, floating, tmp_path: Path
):
    assert floating_case(floating, None, convention, "%.17g", tmp_path) == "missed"


@pytest.mark.sampled(4)
@pytest.mark.parametrize("fault", FLOATING_FAULTS, ids=lambda x: x.id)
def test_a_fault_of_answers_about_a_free_base_is_named(fault, floating, tmp_path: Path, sized):
    for form in sized(FORMATS, FORMATS[1:2]):
        assert floating_case(floating, fault, "body axes", form, tmp_path) == "named"


@pytest.mark.parametrize("convention", CONVENTIONS.values(), ids=CONVENTIONS)
def test_a_state_of_a_free_base_is_read_as_it_was_written(convention):
    q, v, vdot = np.random.default_rng(2).uniform(-1.4, 1.4, (3, 6))
    pose, twist, rates = recorded_base(convention, q, v, vdot)
    state = base_state(convention, pose, twist, rates)
    for x, y in zip(state[:3], (q, v, vdot), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-12)


def test_a_convention_of_a_free_base_is_read_from_words():
    body = CONVENTIONS["body axes, angular first"]
    assert parse_convention("Body, angular") == body == parse_convention("body axes,angular first")
    assert parse_convention("world") == CONVENTIONS["world axes, linear first"]
    for wrong in ("", "angular", "local axes", "world axes, last"):
        with pytest.raises(InputError, match="expected world, body or mixed axes"):
            parse_convention(wrong)


def test_a_free_base_that_cannot_be_read_is_one_sentence(floating, tmp_path: Path):
    scene, path = floating
    write_states(scene, tmp_path / "s.csv", 3, 0, "world axes")
    table = open_table(tmp_path / "s.csv")
    (chunk,) = table.chunks()
    columns = dict(zip(table.names, chunk.values.T, strict=True)) | {"M[0;0]": np.ones(3)}

    def message(change: dict[str, Any], header: dict[str, str], robot: Scene = scene) -> str:
        kept = {name: x for name, x in (columns | change).items() if x is not None}
        write_table(tmp_path / "a.csv", kept, header)
        with pytest.raises((InputError, UnknownNameError)) as error:
            check_answers(tmp_path / "a.csv", robot)
        return str(error.value)

    header = dict(table.header)
    twice = {"base.quat_w": 2 * columns["base.quat_w"]}
    assert "row 0 (line 3): base.quat has length" in message(twice, header)
    half = {name: x / 2 for name, x in columns.items() if name.startswith("base.quat")}
    assert "row 0 (line 3): base.quat has length 0.5, expected 1" in message(half, header)
    assert "no header line '# base: world axes, linear first'" in message({}, {})
    assert "has no column base.quat_x" in message({"base.quat_x": None}, header)
    assert "'base.q'" in message({"base.q": np.ones(3)}, header)
    derived = {"inverse_dynamics_derivatives[0;0]": np.ones(3)}
    assert "derivatives are not compared" in message(derived, header)
    fixed = from_urdf(path)
    assert "has no free base: expected robot.urdf:floating" in message({}, header, fixed)
    with pytest.raises(InputError, match="has no free base"):
        write_states(fixed, tmp_path / "b.csv", 2, 0, "world")


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
    assert "3 of 3 quantities passed; " in capsys.readouterr().out
    recorded(tmp_path / "single.csv", lambda name, k, x: np.float32(x))
    for precision, code in ((["--precision", "float32"], 0), ([], 1)):
        assert run("check", "single.csv", "--scene", "chain-pendulum", *precision) == code
        capsys.readouterr()
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

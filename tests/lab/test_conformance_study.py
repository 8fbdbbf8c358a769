"""The study of conformance: libraries that fail, and what the cells of a robot share."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from tests import robots

from eomcheck.claims import CLAIMS
from eomcheck.claims.run import RunSelection, SceneEngines, make_case
from eomcheck.engines import Answers, EngineFault, PinocchioFile, make_engine
from eomcheck.engines.answers import inertia_size, turning_size
from eomcheck.errors import InputError, RemoteError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.lab.show.table import table_of_markdown
from eomcheck.lab.store.record_file import Record, record_of_rows
from eomcheck.lab.studies import conformance
from eomcheck.mechanics.records import State
from eomcheck.scenes import from_urdf


class Leaving(PinocchioFile):
    """Reader of files that ends its process while it builds its model."""

    def __init__(self, scene):
        raise SystemExit(3)


class Remote(PinocchioFile):
    """Reader of files in a process of its own, where it raises an exception."""

    def __init__(self, scene):
        raise RemoteError("Remote(scene)", "raised ValueError: no such mesh")


class Picky(PinocchioFile):
    """Reader of files that raises an exception."""

    def __init__(self, scene):
        raise ValueError("no such mesh")


class Counting(PinocchioFile):
    """Reader of files that counts its calls."""

    calls: ClassVar[list[str]] = []

    def bias(self, q, v, t=0.0):
        """Return B."""
        self.calls.append("bias")
        return super().bias(q, v, t)


@pytest.fixture
def arm(tmp_path: Path) -> str:
    """Return the file of a small robot."""
    return str(robots.arm(tmp_path / "arm.urdf"))


def record(arm: str, kind: type[PinocchioFile], states: int = 1) -> Record:
    """Return the Record of the cell of a robot and a class of this file."""
    engine = f"{__file__}:{kind.__name__}"
    settings = {"robot": arm, "free": False, "engine": engine, "states": states, "seed": 0}
    return conformance._check(settings)


@pytest.mark.parametrize(
    "kind, status, reason",
    [
        (Leaving, "failed", "Leaving(scene) raised SystemExit: 3"),
        (Remote, "refused", "no such mesh"),
        (Picky, "refused", "no such mesh"),
    ],
)
def test_a_library_that_ends_its_process_at_a_file_is_an_alarm_and_one_that_raises_refuses_it(
    kind: type[PinocchioFile], status: str, reason: str, arm: str
):
    found = record(arm, kind)
    assert (found.status, conformance.alarm([found])) == (status, status == "failed")
    assert kind.__name__ in found.reason and reason in found.reason
    assert ("unread" in found.counts) == (status == "refused")
    assert [one.differs for one in conformance.observations([found])] == (
        [True] if status == "refused" else []
    )


def test_only_an_end_of_a_process_is_one():
    scene = conformance.SCENES["sleigh"].example()
    for kind, ended in ((Leaving, True), (Remote, False), (Picky, False)):
        with pytest.raises(EngineFault) as fault:
            make_engine(kind, scene)
        assert conformance.has_ended(fault.value) == ended


def test_what_a_robot_computes_at_its_states_is_shared_by_libraries(arm: str, monkeypatch):
    settings = arm, False, 2, 0
    scene, evaluations = conformance._sampled_scene(*settings)
    assert conformance._sampled_scene(*settings).states is evaluations and len(evaluations) == 2
    assert not np.array_equal(evaluations[0].q, evaluations[1].q)
    assert len(conformance._sampled_scene(arm, False, 3, 0).states) == 3
    answers, at = Answers(PinocchioFile(scene)), evaluations[0]
    digits = partial(conformance.true_digits, at, answers, PinocchioFile)
    first = dict(digits())
    monkeypatch.setattr(conformance, "enclosed_quantity", None)  # a truth is computed once
    assert dict(digits()) == first and min(first.values()) > 10


def test_an_engine_is_asked_once_where_no_repeats_are_wanted(arm: str):
    scene, (at,) = conformance._sampled_scene(arm, False, 1, 0)
    selection = RunSelection.of(["gw"], [Counting], ["bias"], scenes=[scene])
    engines = SceneEngines(scene, (Counting(scene),), {})
    for repeats, least, most in ((0, 1, 1), (2, 3, 20)):
        Counting.calls.clear()
        case = make_case(engines, State(at.q, at.v, at.t), selection, repeats, at)
        (finding,) = case.evaluate(CLAIMS["bias"])
        assert finding.verdict == "passed" and least <= len(Counting.calls) <= most


def test_engines_of_few_digits_share_the_rounded_state_if_their_own_coordinates_agree(arm: str):
    class Single(PinocchioFile):
        unit_roundoff = 2.0**-24

    class Other(Single):
        pass

    scene, (at,) = conformance._sampled_scene(arm, False, 1, 0)
    state, rounded = State(at.q, at.v, at.t), []
    for kind in (Single, Other):
        engine = kind(scene)
        selection = RunSelection.of(["gw"], [], ["bias"], scenes=[scene])
        case = make_case(SceneEngines(scene, (engine,), {}), state, selection, at=at)
        case.claim = CLAIMS["bias"]
        rounded.append(case.rounded_for(engine).at)
    assert rounded[0] is rounded[1] and rounded[0].unit_roundoff == 2.0**-24
    assert np.array_equal(rounded[0].q, at.q.astype(np.float32))
    other = make_case(SceneEngines(scene, (), {}), state, selection, at=Evaluation(scene, *state))
    other.claim = CLAIMS["bias"]
    assert other.rounded_for(Single(scene)).at is not rounded[0]


WHEEL = """<robot name="far"><link name="base"/><link name="wheel"><inertial><mass value="2"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="axle" type="continuous"><parent link="base"/><child link="wheel"/>
<origin xyz="3 4 0"/><axis xyz="0 0 1"/></joint></robot>"""


def test_centrifugal_forces_of_arms_in_the_world_may_cancel_in_a_bias(tmp_path: Path):
    """An engine about the world's origin sums m ω² r where the centre of mass is on the axis."""
    path = tmp_path / "wheel.urdf"
    path.write_text(WHEEL)
    scene = from_urdf(path)
    engine, at = PinocchioFile(scene), Evaluation(scene, [0.3], [7.0])
    assert turning_size(at) == pytest.approx(2.0 * 7.0**2 * 5.0)
    selection = RunSelection.of(["gw"], [], ["bias"], scenes=[scene])
    case = make_case(SceneEngines(scene, (engine,), {}), State(at.q, at.v, at.t), selection, at=at)
    (finding,) = case.evaluate(CLAIMS["bias"])
    assert finding.allowed >= allowed_error(inertia_size(at) + turning_size(at))
    assert turning_size(Evaluation(conformance.SCENES["rolling-disk"].example(), *disk())) == 0.0


def disk() -> State:
    """Return a state of a scene that is no tree."""
    return State(*conformance.SCENES["rolling-disk"].example().initial_state())


def test_states_are_counted_over_the_pairs_that_were_compared():
    cell = {"robot": "arm", "free": False, "engine": "a", "states": 3}
    others = [cell | {"free": True}, cell | {"engine": "b==*", "states": 5}, cell | {"robot": "z"}]
    records = [Record("conformance", one) for one in (cell, *others)]
    records += [Record("conformance", cell | {"robot": "y"}, "refused", "it cannot be read")]
    assert next(iter(conformance.remarks(records))) == (
        "14 states compared, in 4 pairs of one of 2 libraries and one of 3 robots and scenes"
    )


# ---- Tables of an earlier run --------------------------------------------------------------------


def of_engine(engine: str, *rows: tuple[str, str, str, float | None]) -> Record:
    """Return the Record of an engine: robot, quantity, verdict or "no answer", digits of rows."""
    settings = {"robot": rows[0][0], "free": False, "engine": engine, "states": 20, "seed": 0}
    kept = []
    for robot, quantity, verdict, digits in rows:
        fault = verdict == "no answer"
        about = engine, f"{engine} 1", robot, quantity, 20, "failed" if fault else verdict
        kept.append(conformance.ConformanceRow(*about, digits, "", fault))  # type: ignore[arg-type]
    return record_of_rows("conformance", settings, kept)


OLD = [
    of_engine("a", ("x", "bias", "failed", None), ("x", "gravity", "passed", 12.0)),
    of_engine("b_c", ("y", "bias", "failed", None), ("y", "forces", "inconclusive", None)),
]
DIFFERING = [("a", "x"), ("b_c", "y"), ("d", "z")]
AGREEING = [of_engine("a", (robot, "bias", "passed", 8.0)) for robot in "xy"]
NEW = [of_engine("a", ("y", "bias", "passed", None)), of_engine("d", ("z", "bias", "failed", None))]


def test_tables_are_extended_by_engines_and_keep_the_columns_of_others(tmp_path: Path):
    study = conformance.STUDY
    study.write(OLD, tmp_path)
    study.write(NEW, tmp_path, extend=True)
    read = {
        name: table_of_markdown(name, (tmp_path / f"conformance{name}.md").read_text())
        for name in ("", "-by-robot", "-libraries", "-differences")
    }
    cells = {row[0]: row[1:] for row in read[""].rows}
    assert read[""].columns == ["quantity", "a", "b_c", "d"]
    assert cells["bias"] == ["differs on 1 of 2", "differs on 1 of 1", "differs on 1 of 1"]
    assert cells["gravity"] == ["12 digits", "-", "-"]
    assert cells["forces"] == ["-", "inconclusive", "-"]
    assert read["-by-robot"].rows == [
        ["x", "1 of 2", "-", "-"],
        ["y", "1 of 1", "1 of 2", "-"],
        ["z", "-", "-", "0 of 1"],
    ]
    assert read["-libraries"].rows == [
        ["a", "a 1", "2", "2", "40", "1"],
        ["b_c", "b_c 1", "2", "1", "20", "1"],
        ["d", "d 1", "1", "1", "20", "1"],
    ]
    assert read["-differences"].rows == [
        ["a", "bias", "x"],
        ["b_c", "bias", "y"],
        ["d", "bias", "z"],
    ]
    (chart,) = conformance.extends(NEW, tmp_path)[1]
    (heat,) = chart.panels.values()
    drawn = {
        name: [box and (box.text, box.hatched) for box in x] for name, (_, x) in heat.rows.items()
    }
    assert drawn == {
        "bias": [("1", False)] * 3,
        "forces": [None, ("", True), None],
        "gravity": [("", False), None, None],
    }


def written_cells(folder: Path, *runs: Sequence[Record]) -> dict[str, list[str]]:
    """Return the table of quantities after runs that extend each other: quantity -> cells."""
    for number, run in enumerate(runs):
        conformance.STUDY.write(run, folder, extend=number > 0)
    read = table_of_markdown("conformance", (folder / "conformance.md").read_text())
    return {row[0]: row[1:] for row in read.rows}


def test_an_engine_asked_on_all_its_robots_again_is_replaced(tmp_path: Path):
    again = [
        of_engine("a", ("x", "bias", "passed", 9.0)),
        of_engine("a", ("y", "bias", "passed", 8.0)),
    ]
    assert written_cells(tmp_path, OLD, again)["bias"] == ["8 digits", "differs on 1 of 1"]


def test_an_engine_asked_on_some_of_its_robots_again_has_their_results(tmp_path: Path):
    again = [*AGREEING[:1], *NEW[1:]]
    cells = written_cells(tmp_path, AGREEING, again)
    assert cells["bias"] == ["8 digits", "differs on 1 of 1"]
    assert written_cells(tmp_path, AGREEING, again, again, AGREEING)["bias"] == cells["bias"]
    worse = [of_engine("a", ("x", "bias", "failed", None))]
    reason = "a has another result on x than in .* on all 2 robots there again"
    with pytest.raises(InputError, match=reason):
        written_cells(tmp_path, AGREEING, worse)


def test_tables_are_the_same_if_they_are_extended_by_one_robot_after_another(tmp_path: Path):
    records = [
        of_engine("a", ("x", "bias", "failed", None), ("x", "gravity", "passed", 5.0)),
        of_engine("b", ("x", "bias", "passed", 8.0), ("x", "gravity", "failed", None)),
        of_engine("a", ("y", "bias", "failed", None), ("y", "gravity", "passed", 3.0)),
        of_engine("b", ("z", "bias", "passed", 7.0), ("z", "gravity", "passed", None)),
    ]
    (tmp_path / "once").mkdir()
    conformance.STUDY.write(records, tmp_path / "once")
    for count in range(1, 5):
        conformance.STUDY.write(records[:count], tmp_path, extend=count > 1)
    for file in sorted((tmp_path / "once").glob("*.md")):
        assert (tmp_path / file.name).read_text() == file.read_text(), file.name


@pytest.mark.parametrize(
    ("old", "new", "cell"),
    [
        (("passed", 9.0), ("passed", 12.0), "9 digits"),
        (("passed", 12.0), ("passed", 9.0), "9 digits"),
        (("passed", None), ("passed", 9.0), "9 digits"),
        (("passed", None), ("inconclusive", None), "agrees"),
        (("inconclusive", None), ("passed", None), "agrees"),
        (("inconclusive", None), ("inconclusive", None), "inconclusive"),
        (("passed", 9.0), ("failed", None), "differs on 1 of 2"),
        (("failed", None), ("passed", 9.0), "differs on 1 of 2"),
        (("failed", None), ("failed", None), "differs on 2 of 2"),
        (("no answer", None), ("no answer", None), "no answer on 2 of 2"),
        (("no answer", None), ("failed", None), "no answer on 1 of 2"),
        (("failed", None), ("no answer", None), "no answer on 1 of 2"),
        (("passed", 9.0), ("no answer", None), "no answer on 1 of 2"),
        (("no answer", None), ("passed", None), "no answer on 1 of 2"),
        (("skipped", 7.0), ("skipped", 4.0), "4 digits by differences"),
    ],
)
def test_cells_of_earlier_robots_and_new_ones_are_those_of_one_run(old, new, cell, tmp_path: Path):
    first, second = of_engine("a", ("x", "bias", *old)), of_engine("a", ("y", "bias", *new))
    assert written_cells(tmp_path, [first], [second])["bias"] == [cell]
    assert written_cells(tmp_path, [first, second])["bias"] == [cell]


def test_a_quantity_that_engines_have_of_files_alone_agreed_on_no_scenes(tmp_path: Path):
    every = "bias", "forces", "acceleration"
    first = [
        of_engine("a", *(("x", name, "passed", None) for name in every)),
        of_engine("a", ("sleigh", "bias", "passed", None)),
    ]
    second = [of_engine("a", *(("y", name, "failed", None) for name in every))]
    cells = written_cells(tmp_path, first, second)
    assert [cells[name] for name in every] == [["differs on 1 of 3"], *[["differs on 1 of 2"]] * 2]
    assert written_cells(tmp_path, [*first, *second]) == cells


def test_a_quantity_that_agreed_on_an_unknown_number_of_robots_is_not_extended_by_a_difference(
    tmp_path: Path,
):
    first = [
        of_engine("a", ("x", "bias", "passed", None), ("x", "gravity", "passed", None)),
        of_engine("a", ("y", "gravity", "passed", None)),
    ]
    with pytest.raises(InputError, match="'agrees' of the earlier tables has no number of robots"):
        written_cells(tmp_path, first, [of_engine("a", ("z", "bias", "failed", None))])


@pytest.mark.parametrize(
    "text, reason",
    [
        ("", "is not a table in Markdown"),
        ("| library |\n| --- |\n| `a` | 3 |\n", "is not a table in Markdown: rows of different"),
        ("| library |\n| --- |\n| `a` |\n", "has other columns, expected"),
    ],
)
def test_tables_that_cannot_be_extended_are_refused(text: str, reason: str, tmp_path: Path):
    conformance.STUDY.write(OLD, tmp_path)
    (tmp_path / "conformance-libraries.md").write_text(text)
    with pytest.raises(InputError, match=reason):
        conformance.STUDY.write(NEW, tmp_path, extend=True)


def test_tables_are_extended_in_a_folder_that_has_them(tmp_path: Path):
    with pytest.raises(InputError, match=r"conformance\.md' cannot be read"):
        conformance.STUDY.write(NEW, tmp_path, extend=True)

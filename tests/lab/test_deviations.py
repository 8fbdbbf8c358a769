"""Known deviations and badges: read, compared with findings, and one sentence for each mistake."""

from __future__ import annotations

import json
import math
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from tests.robots import arm

from eomcheck import cli
from eomcheck.claims import CLAIMS
from eomcheck.claims.finding import Finding
from eomcheck.errors import InputError
from eomcheck.lab import deviations
from eomcheck.lab.badge import badge_svg, badge_text, width_of, write_badge
from eomcheck.lab.deviations import (
    ALL,
    READING,
    Deviation,
    KnownDeviations,
    Observation,
    engine_in,
    observations_of,
    read_deviations,
    robot_of,
    run_observations,
)
from eomcheck.lab.show.chart import Heat
from eomcheck.lab.show.chart_plotly import chart_json
from eomcheck.lab.store.record_file import Record, record_of_rows
from eomcheck.lab.studies import study_of
from eomcheck.lab.studies.conformance import ConformanceRow
from eomcheck.mechanics.records import State
from eomcheck.scenes import Sleigh, from_urdf

FILE = Path("deviations.toml")
SLEIGH = Sleigh.example()
STATE = State(*SLEIGH.initial_state(), 0.0)


def run(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    """Run the command line in this process and return its exit code."""
    monkeypatch.setattr(sys, "argv", ["eomcheck", *words])
    monkeypatch.setattr("eomcheck.console.PATIENCE", 1e4)  # on slow machines too it says no more
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return int(stop.value.code or 0)


# ---- The file ------------------------------------------------------------------------------------

WHOLE = """
[[deviation]]
engine = "pinocchio"
quantity = ["acceleration", "forces"]
robots = ["iiwa", "z1"]
reason = "no damping"
since = "2.0"
script = "damping.py"
issue = "https://example.org/1"

[[deviation]]
engine = "mujoco"
quantity = "reading"
robots = "*"
reason = "moments of inertia"
"""


def test_deviations_are_read_as_they_are_written(tmp_path: Path):
    (tmp_path / "d.toml").write_text(WHOLE, encoding="utf-8")
    more = "2.0", "damping.py", "https://example.org/1"
    assert read_deviations(tmp_path / "d.toml").deviations == (
        Deviation("pinocchio", ("acceleration", "forces"), ("iiwa", "z1"), "no damping", *more),
        Deviation("mujoco", (READING,), (ALL,), "moments of inertia"),
    )
    (tmp_path / "none.toml").write_text("", encoding="utf-8")
    assert read_deviations(tmp_path / "none.toml") == (tmp_path / "none.toml", ())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("deviation = 3", "has 'deviation', expected tables"),
        ("other = 3", "has 'other', expected tables"),
        ("deviation = [3]", "deviation 1 is 3, expected a table"),
        ("[[deviation", "is not TOML"),
        (WHOLE.replace('reason = "no damping"\n', ""), "deviation 1 has no 'reason'"),
        (WHOLE.replace("since", "sinse"), "deviation 1 has 'sinse', expected one of engine,"),
        (WHOLE.replace('"moments of inertia"', "4"), "deviation 2: reason = 4, expected a text"),
        (WHOLE.replace('robots = "*"', "robots = []"), r"deviation 2: robots = \[\], expected"),
        (WHOLE.replace('"forces"', '"force"'), "quantity = 'force', expected one of mass_matrix"),
    ],
)
def test_a_mistake_in_the_file_is_one_sentence(text: str, said: str, tmp_path: Path):
    (tmp_path / "d.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=said) as error:
        read_deviations(tmp_path / "d.toml")
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path):
    with pytest.raises(InputError, match=r"nosuch\.toml"):
        read_deviations(tmp_path / "nosuch.toml")


# ---- Comparing -----------------------------------------------------------------------------------

NAMED = Deviation("lib", ("forces",), ("a", "b"), "why")
ANY = Deviation("lib", ("forces",), (ALL,), "why")


def seen(robot: str, differs: bool | None, engine: str = "lib") -> Observation:
    """Return an observation of the forces on a robot."""
    return Observation(engine, "forces", robot, differs, "by 3")


@pytest.mark.parametrize(
    ("observed", "known", "sentences"),
    [
        ([seen("a", True), seen("b", True)], [NAMED], []),
        ([seen("a", True), seen("c", True)], [ANY], []),
        ([seen("a", True), seen("c", False)], [ANY], []),
        ([seen("a", True)], [NAMED], []),
        ([seen("a", True), seen("b", None)], [NAMED], []),
        ([seen("a", True, "lib==2.1")], [NAMED], []),
        ([seen("c", False), seen("d", None)], [], []),
        (
            [seen("a", True), seen("c", True)],
            [NAMED],
            ["not declared in deviations.toml: lib differs in forces on c: by 3"],
        ),
        (
            [seen("a", True, "lib==2.1")],
            [NAMED._replace(engine="lib==2.0")],
            ["not declared in deviations.toml: lib==2.1 differs in forces on a: by 3"],
        ),
        (
            [seen("a", True, "library")],
            [NAMED],
            ["not declared in deviations.toml: library differs in forces on a: by 3"],
        ),
        (
            [seen("a", True)],
            [NAMED._replace(quantities=("bias",))],
            ["not declared in deviations.toml: lib differs in forces on a: by 3"],
        ),
        (
            [seen("a", True), seen("b", False)],
            [NAMED],
            ["declared in deviations.toml and not observed: lib agrees in forces on b (why)"],
        ),
        (
            [seen("a", False), seen("c", False)],
            [ANY],
            ["declared in deviations.toml and not observed: lib agrees in forces on a, c (why)"],
        ),
        ([], [NAMED, ANY], []),
    ],
)
def test_unknown_differences_and_those_that_are_gone_are_reported(observed, known, sentences):
    assert list(KnownDeviations(FILE, tuple(known)).sentences(observed)) == sentences


def finding(claim: str, subject: str, verdict: str, detail: str = "") -> Finding:
    """Return a finding on the sleigh."""
    return Finding(claim, subject, SLEIGH, STATE, 1.0, 2.0, verdict, "compared", detail)  # type: ignore[arg-type]


def test_the_worst_finding_on_a_quantity_is_its_observation():
    observed = run_observations(
        [
            finding("mass-matrix", "lib", "passed"),
            finding("mass-matrix", "lib", "failed", "by 2"),
            finding("mass-matrix", "lib", "inconclusive"),
            finding("bias", "lib", "inconclusive"),
            finding("bias", "B", "failed", "our own"),
            finding("engine-gravity", "lib", "passed"),
            finding("engine-acceleration", "gw ~ lib_file", "failed", "by 4"),
            finding("kinetic-energy", "T", "failed"),
        ]
    )
    assert list(observed) == [
        Observation("lib", "mass_matrix", "sleigh", True, "by 2"),
        Observation("lib", "bias", "sleigh", None),
        Observation("lib", "gravity", "sleigh", False),
        Observation("lib", "acceleration", "sleigh", True, "by 4"),
    ]


@pytest.mark.parametrize(
    ("subject", "engine"),
    [
        ("lib", "lib"),
        ("lib_file", "lib"),
        ("lib_mjcf", "lib"),
        ("gw ~ lib_file==2.0", "lib==2.0"),
        ("lib, hand ~ 3, left", "lib"),
    ],
)
def test_the_engine_of_a_subject_is_its_key_without_frame_and_formulation(subject, engine):
    assert engine_in(subject) == engine


def test_robots_are_named_by_their_files_and_scenes_by_their_keys(tmp_path: Path):
    path = arm(tmp_path / "arm.urdf")
    assert robot_of(SLEIGH) == "sleigh" and robot_of(from_urdf(path)) == "arm"
    heavy = path.read_text(encoding="utf-8").replace(
        '<link name="base"/>',
        '<link name="base"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" '
        'ixz="0" iyz="0"/></inertial></link>',
    )
    path.write_text(heavy, encoding="utf-8")
    assert robot_of(from_urdf(path, floating=True)) == "arm, free"


def test_every_quantity_of_a_claim_about_engines_can_be_declared():
    assert {claim.asks for claim in CLAIMS.values() if claim.asks} | {READING} == set(
        deviations.judged_quantities()
    )


# ---- Commands ------------------------------------------------------------------------------------


@pytest.fixture
def damped(tmp_path: Path) -> Path:
    """Return a robot whose damper Pinocchio's accelerations leave out."""
    return arm(tmp_path / "damped.urdf", damping="0.7")


def declared(folder: Path, *entries: str) -> str:
    """Write a file of deviations of Pinocchio on robots by quantity; return its path."""
    text = "".join(
        f'[[deviation]]\nengine = "pinocchio"\nquantity = "{one}"\nrobots = "*"\nreason = "r"\n'
        for one in entries
    )
    (folder / "known.toml").write_text(text, encoding="utf-8")
    return str(folder / "known.toml")


CASES = [
    ((), 1, "not declared in known.toml: pinocchio differs in acceleration on damped"),
    (("acceleration",), 0, "all differences are declared in known.toml"),
    (("acceleration", "bias"), 1, "not observed: pinocchio agrees in bias on damped (r)"),
]


@pytest.mark.parametrize(("entries", "code", "said"), CASES)
def test_compare_is_red_for_unknown_differences_and_for_those_that_are_gone(
    damped: Path, entries, code: int, said: str, monkeypatch, capsys
):
    how = "--engine", "pinocchio", "--examples", "2", "--claim", "bias,engine-acceleration"
    known = declared(damped.parent, *entries)
    assert run(monkeypatch, "compare", str(damped), *how, "--deviations", known) == code
    assert said in " ".join(capsys.readouterr().out.split())


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("entries", "code", "said"), CASES)
def test_validate_is_red_for_unknown_differences_and_for_those_that_are_gone(
    damped: Path, entries, code: int, said: str, monkeypatch, capsys
):
    how = "--engine", "eomcheck.engines:PinocchioFile", "--examples", "3"
    how += "--claim", "bias,engine-acceleration", "--deviations", declared(damped.parent, *entries)
    assert run(monkeypatch, "validate", "--scene", str(damped), *how) == code
    assert said in " ".join(capsys.readouterr().out.split())


def rows(*verdicts: tuple[str, str]) -> list[Record]:
    """Return the Record of a robot with verdicts by quantity, and that of an unread one."""
    settings = {"robot": "ur5", "free": False, "engine": "pinocchio", "states": 1, "seed": 0}
    about = "pinocchio", "pinocchio 4", "ur5"
    kept = (ConformanceRow(*about, name, 1, v, None, "by 1") for name, v in verdicts)  # type: ignore[arg-type]
    why = "iiwa, pinocchio: refused"
    other = settings | {"robot": "iiwa"}
    unread = Record("conformance", other, "refused", why, counts={"unread": 1})
    absent = Record("conformance", settings | {"robot": "z1"}, "refused", "reads no MJCF")
    return [record_of_rows("conformance", settings, kept), unread, absent]


def test_the_study_of_conformance_observes_quantities_and_robots_that_are_not_read():
    study = study_of("conformance")
    assert study.observations is not None
    records = rows(("bias", "failed"), ("forces", "passed"), ("gravity", "inconclusive"))
    assert list(study.observations(records)) == [
        Observation("pinocchio", "bias", "ur5", True, "by 1"),
        Observation("pinocchio", "forces", "ur5", False, "by 1"),
        Observation("pinocchio", "gravity", "ur5", None, "by 1"),
        Observation("pinocchio", READING, "ur5", False),
        Observation("pinocchio", READING, "iiwa", True, "iiwa, pinocchio: refused"),
    ]


@pytest.mark.parametrize(("known", "code"), [(("bias", READING), 0), (("bias",), 1), ((), 1)])
def test_the_study_of_conformance_is_red_only_with_a_file_of_deviations(
    known, code, tmp_path: Path, monkeypatch, capsys
):
    study = study_of("conformance")
    monkeypatch.setattr(type(study), "run", lambda *_, **__: rows(("bias", "failed")))
    words = "study", "conformance", "--robot", "ur5"
    assert run(monkeypatch, *words) == 0, "that libraries differ is a result"
    monkeypatch.setattr(type(study), "run", lambda *_, **__: rows(("bias", "failed")))
    assert run(monkeypatch, *words, "--deviations", declared(tmp_path, *known)) == code
    assert ("not declared in known.toml" in capsys.readouterr().out) == bool(code)


# ---- Badges --------------------------------------------------------------------------------------


def result(path: Path, *findings: tuple[str, str, str]) -> Path:
    """Write a result with findings: claim, subject, verdict; return its path."""
    names = "claim", "subject", "verdict"
    plain = [dict(zip(names, one, strict=True)) | {"detail": ""} for one in findings]
    path.write_text(json.dumps({"findings": plain}), encoding="utf-8")
    return path


TWO = (
    ("mass-matrix", "lib", "passed"),
    ("mass-matrix", "lib", "failed"),
    ("bias", "lib", "passed"),
    ("engine-gravity", "lib", "inconclusive"),
    ("bias", "B", "failed"),
)


def test_a_badge_counts_the_quantities_that_agree_of_those_that_are_decided(tmp_path: Path):
    path = result(tmp_path / "r.json", *TWO)
    key, message, orange = badge_text(path, None)
    assert (key, message) == ("lib", "1 of 2 quantities")
    assert badge_text(result(path, *TWO[2:]), "lib")[1] == "1 of 1 quantity"
    assert badge_text(path, None)[2] != orange
    assert badge_text(result(path, *TWO[3:]), None)[1] == "nothing decided"


def test_a_badge_is_well_formed_accessible_and_as_wide_as_its_text(tmp_path: Path):
    write_badge(result(tmp_path / "r.json", *TWO), tmp_path / "b.svg", "a < b & c", None)
    root = ElementTree.parse(tmp_path / "b.svg").getroot()
    name = "{http://www.w3.org/2000/svg}"
    said = "a < b & c: 1 of 2 quantities"
    assert root.tag == f"{name}svg" and root.get("role") == "img"
    assert root.get("aria-label") == said and root.findtext(f"{name}title") == said
    texts = list(root.iter(f"{name}text"))
    assert [one.text for one in texts] == ["a < b & c", "1 of 2 quantities"]
    lengths = [float(one.get("textLength", "nan")) for one in texts]
    assert lengths == [round(width_of(str(one.text)), 1) for one in texts]
    assert sum(lengths) < float(root.get("width", "nan")) < sum(lengths) + 40
    for element in root.iter():
        assert not any("http" in value for value in element.attrib.values()), "no network"
    assert width_of("WWW") > width_of("aaa") > width_of("iii")
    wide = ElementTree.fromstring(badge_svg("W" * 30, "x", "#000"))
    assert float(wide.get("width", "nan")) > 30 * 10


@pytest.mark.parametrize(
    ("text", "engine", "said"),
    [
        ("{", None, "is not JSON"),
        ("[]", None, "has no findings"),
        ('{"findings": [1]}', None, "has no findings"),
        ('{"findings": []}', None, "no engine, expected one of those judged there: no engine"),
        ("TWO", "other", "engine = 'other', expected one of those judged there: lib"),
        ("BOTH", None, "is about lib, second: --engine KEY"),
    ],
)
def test_a_result_without_a_badge_is_one_sentence(
    text: str, engine: str | None, said: str, tmp_path: Path, monkeypatch, capsys
):
    path, more = tmp_path / "r.json", [] if engine is None else ["--engine", engine]
    if text in ("TWO", "BOTH"):
        second = [("bias", "second", "passed")] if text == "BOTH" else []
        result(path, *TWO, *second)
    else:
        path.write_text(text, encoding="utf-8")
    assert run(monkeypatch, "badge", str(path), "-o", str(tmp_path / "b.svg"), *more) == 2
    printed = capsys.readouterr().err
    assert said in printed and len(printed.splitlines()) == 1
    assert not (tmp_path / "b.svg").exists()


def test_the_result_of_a_comparison_has_a_badge(damped: Path, monkeypatch, capsys):
    folder = damped.parent
    how = "--engine", "pinocchio", "--examples", "2", "--claim", "bias,engine-acceleration"
    assert run(monkeypatch, "compare", str(damped), *how, "--json", str(folder / "r.json")) == 1
    assert run(monkeypatch, "badge", str(folder / "r.json"), "-o", str(folder / "b.svg")) == 0
    assert "eomcheck pinocchio: 1 of 2 quantities" in capsys.readouterr().out
    assert (folder / "b.svg").read_text(encoding="utf-8").startswith("<svg")


def test_findings_on_unknown_claims_are_left_out():
    plain = {"claim": "of-another-version", "subject": "lib", "verdict": "failed", "detail": ""}
    assert not list(observations_of([("", plain)]))


# ---- Our own page --------------------------------------------------------------------------------

DOCS = Path(__file__).parents[2] / "docs"


def test_the_page_of_conformance_shows_the_differences_that_are_declared_and_no_others():
    table = (DOCS / "figures" / "conformance-differences.md").read_text(encoding="utf-8")
    rows = [line.strip("|").split(" | ") for line in table.splitlines()[2:]]
    shown = {
        (engine.strip("` "), quantity.strip("` "), robot)
        for engine, quantity, robots in rows
        for robot in robots.strip().split("; ")
    }
    known = read_deviations(DOCS / "conformance" / "deviations.toml").deviations
    declared = {
        (one.engine, quantity, robot)
        for one in known
        for quantity in one.quantities
        for robot in one.robots
        if quantity != READING
    }
    assert shown == declared
    assert len(shown) > 20


def test_every_deviation_has_a_script_or_is_one_of_at_most_five_that_are_not_understood():
    known = read_deviations(DOCS / "conformance" / "deviations.toml").deviations
    understood = [one for one in known if not one.reason.startswith("not understood")]
    assert [one.reason for one in understood if not one.script] == []
    assert len(known) - len(understood) <= 5
    page = (DOCS / "evidence" / "conformance.md").read_text(encoding="utf-8")
    folder = {path.name for path in (DOCS / "conformance").glob("*.py")}
    assert {one.script for one in understood} <= folder
    assert folder == {*re.findall(r"^  ```{literalinclude} \.\./conformance/(\S+)$", page, re.M)}


def test_the_picture_of_conformance_counts_the_robots_on_which_a_quantity_differs(tmp_path: Path):
    def row(engine: str, robot: str, quantity: str, verdict: str) -> ConformanceRow:
        return ConformanceRow(engine, "1", robot, quantity, 1, verdict, None, "")  # type: ignore[arg-type]

    kept = [
        row("one", "a", "bias", "failed"),
        row("one", "b", "bias", "passed"),
        row("one", "c", "bias", "inconclusive"),
        row("two", "a", "bias", "passed"),
        row("one", "a", "gravity", "skipped"),
        *(row("two", robot, "gravity", "failed") for robot in "abc"),
    ]
    study, settings = study_of("conformance"), {"robot": "a", "engine": "one", "states": 1}
    records = [record_of_rows("conformance", settings, kept)]
    (chart,) = study.charts(records)
    (heat,) = chart.panels.values()
    assert isinstance(heat, Heat)
    assert list(heat.columns) == ["one", "two"] and list(heat.rows) == ["bias", "gravity"]
    (differs, agrees), (unjudged, all_differ) = (boxes for _, boxes in heat.rows.values())
    assert differs and agrees and unjudged and all_differ
    assert (differs.text, agrees.text, unjudged.text, all_differ.text) == ("1", "", "", "3")
    assert agrees.value == 0.0 < 0.4 < differs.value < all_differ.value == 1.0
    assert unjudged.hatched and math.isnan(unjudged.value) and not differs.hatched
    figures = [path.name for path in study.write(records, tmp_path) if path.suffix == ".svg"]
    assert figures == ["conformance.svg", "conformance-dark.svg"]
    assert len(json.loads(chart_json(chart))) == 1


def test_libraries_are_listed_with_what_they_were_asked():
    records = rows(("bias", "failed"), ("forces", "passed"))
    (table,) = [x for x in study_of("conformance").tables(records) if x.name.endswith("libraries")]
    assert list(map(list, table.rows)) == [["pinocchio", "pinocchio 4", "2", "1", "1", "1"]]

"""The stability atlas, drawn and posed: each family as severe as it says, each box from Records."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from eomcheck.errors import InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab.show.chart import Heat, Panel
from eomcheck.lab.store.record_file import Record
from eomcheck.lab.studies import study_of
from eomcheck.lab.studies.stability import FAMILIES, STUDY, Method, cells, settings_of
from eomcheck.scenes import bicycle

ATLAS = study_of("stability")
AU, EL, PIVOTED = Method("au"), Method("el"), Method("el", True)

# ---- What is drawn and told ----------------------------------------------------------------------


def cell(
    method: Method, severity: float, variant: str, *of: float | str, family="straight"
) -> Record:
    """Return a cell: relative error, bound and what was predicted, or why it was not solved."""
    settings = settings_of(family, variant, severity, method)
    if isinstance(of[0], str):
        status: Any = of[0]
        return Record(STUDY.key, settings, status, str(of[1]))
    relative, bound, predicted = map(float, of)
    errors = {"relative": relative, "bound": bound, "predicted": predicted, "condition": 4e7}
    return Record(STUDY.key, settings, errors=errors | {"condition M": 3e2, "condition a_1": 4e7})


FOUND = (
    cell(EL, 1e-1, "3 links", 1e-15, 1e-12, 1e-14),
    cell(EL, 1e-1, "7 links", 1e-13, 1e-12, 1e-13),
    cell(EL, 1e-4, "3 links", 1e-9, 1e-5, 1e-8),
    cell(EL, 1e-4, "7 links", "refused", "a'T is singular"),
    cell(EL, 1e-8, "3 links", "refused", "a'T is singular"),
    cell(EL, 1e-8, "7 links", "refused", "a'T is flat"),
    cell(PIVOTED, 1e-4, "3 links", 1e-3, 1e-5, 1e-6),
    cell(PIVOTED, 1e-8, "3 links", 1e-2, 1e-1, 1e-3),
    cell(AU, 1e-1, "3 links", 0.0, 0.0, 1e-16),
    cell(AU, 1e-8, "3 links", "failed", "no state"),
    cell(AU, 1.0, "moving", 1e-5, 1e-4, 1e-6, family="dependent"),
)
DOUBLES = -math.log10(2.0**-53)


def test_boxes_of_the_heat_map_are_the_worst_variant_at_each_severity_looked_at():
    chart, *_ = ATLAS.charts(FOUND)
    ((where, heat),) = chart.panels.items()
    assert isinstance(heat, Heat) and where == ("snake",) and chart.name == "stability"
    assert heat.columns == {"Straight snake": 3, "Dependent constraints": 1}
    assert {name: key for name, (key, _) in heat.rows.items()} == {
        **{"el": "el", "el, pivoted": "el", "au": "au"},
    }
    told = {
        name: [
            None if x is None else (x.value if math.isnan(x.value) else round(x.value, 1), *x[1:3])
            for x in boxes
        ]
        for name, (_, boxes) in heat.rows.items()
    }
    lost = {digits: round(DOUBLES - digits, 1) for digits in (2, 3, 5, 9, 13)}
    ((refused, *marks),) = [x for x in told["el"][2:3] if x is not None]
    assert math.isnan(refused) and marks == [True, False]
    assert told["el"][:2] == [(lost[13], False, False), (lost[9], True, False)]
    assert told["el"][3] is None
    assert told["el, pivoted"] == [None, (lost[3], False, True), (lost[2], False, False), None]
    assert told["au"][0] == (0.0, False, False) and told["au"][1] is None
    assert told["au"][3] == (lost[5], False, False)
    said = [list(x.hover_text) for x in heat.rows["el"][1] if x is not None]
    assert said[1] == [
        "el, severity 0.0001",
        "1 of 2 variants solved",
        f"{DOUBLES - 9:.1f} digits lost, {DOUBLES - 8:.1f} predicted by κ ε",
        "refused",
        "a'T is singular",
    ]
    assert said[2][1] == "0 of 2 variants solved" and len(said[2]) == 4
    assert heat.limit == pytest.approx(DOUBLES - 6)
    assert heat.colors.range == (0.0, pytest.approx(DOUBLES))


def test_digits_lost_are_drawn_of_all_methods_and_of_one_by_its_variants():
    _, chart, straight, dependent = ATLAS.charts(FOUND)
    panel = chart.panels["Straight snake", "all"]
    assert isinstance(panel, Panel)
    assert panel.bad == pytest.approx((DOUBLES - 6, DOUBLES))
    lines = [(x.key, list(x.x), x.appearance, x.dashed, list(x.hollow)) for x in panel.lines]
    assert lines == [
        ("el", ["0.1", "0.0001", "1e-08"], "line", False, [False, True, True]),
        ("el", ["0.0001", "1e-08"], "crosses", False, [True, False]),
        ("el", ["0.0001", "1e-08"], "line", True, [False, False]),
        ("au", ["0.1", "1e-08"], "line", False, [False, True]),
        ("au", ["1e-08"], "crosses", False, [False]),
    ]
    heights = [set(x.y) for x in panel.lines if x.appearance == "crosses"]
    assert heights == [{DOUBLES + 1}, {DOUBLES + 1 + 2 * 0.4}]
    alone = chart.panels["Straight snake", "el"]
    assert isinstance(alone, Panel)
    assert {x.appearance for x in alone.lines} == {"dotted", "thin", "line", "crosses"}
    ys = [
        (x.appearance, [None if math.isnan(y) else round(DOUBLES - y, 1) for y in x.y])
        for x in alone.lines
    ]
    assert ys[:4] == [
        ("dotted", [13.0, None, None]),
        ("thin", [15.0, 9.0, None]),
        ("thin", [13.0, None, None]),
        ("line", [13.0, None, None]),
    ]
    rings = chart.panels["Straight snake", "el, pivoted"]
    assert isinstance(rings, Panel)
    assert [list(x.x) for x in rings.lines if x.appearance == "rings"] == [["0.0001"]]
    assert chart.files() == [] and chart.on_page
    assert [straight.name, dependent.name] == ["stability-straight", "stability-dependent"]
    assert straight.grid == [[("el",), ("el, pivoted",)], [("au",)]]
    assert not straight.on_page


def test_methods_that_break_alike_share_a_panel_and_flat_ones_are_named():
    def steps(method: Method, *relative: float | str) -> list[Record]:
        where = ((1.0, "heavy tail"), (1e8, "heavy tail"))
        return [
            cell(method, severity, variant, error, 1.0, 1e-13, family="mass-ratio")
            for (severity, variant), error in zip(where, relative, strict=True)
        ]

    found = [
        *steps(AU, 1e-15, 1e-14),
        *steps(EL, 1e-15, 1e-3),
        *steps(Method("gw"), 1e-15, 1e-4),
        *steps(Method("kane"), 1e-15, 1e-15),
        *steps(Method("uk"), 1e-2, 1e-3),
    ]
    *_, chart = ATLAS.charts(found)
    assert chart.grid == [[("el; gw",), ("uk",)]]
    assert chart.title.splitlines()[1] == f"flat, at most {DOUBLES - 14:.1f} digits lost: au; kane"
    alike = chart.panels["el; gw",]
    assert isinstance(alike, Panel)
    assert [(line.key, line.appearance) for line in alike.lines] == [
        ("el", "dotted"),
        ("el", "line"),
        ("gw", "line"),
    ]
    *_, chart = ATLAS.charts(steps(AU, 1e-15, 1e-14))
    assert chart.title.endswith("digits lost: all methods")
    assert list(chart.panels) == [("au",)]


def test_where_methods_break_is_told_with_the_digits_lost_before_and_why():
    tables = {sheet.name: [tuple(row) for row in sheet.rows] for sheet in ATLAS.tables(FOUND)}
    large = "true error 1e-03; condition number of a_1 4e+07"
    assert tables["stability-straight"] == [
        ("el", "0.0001", "refused", f"{DOUBLES - 13:.1f}", "a'T is singular"),
        ("el, pivoted", "0.0001", "SILENT", "", large),
        ("au", "1e-08", "refused", "0.0", "no state"),
    ]
    assert tables["stability-breaks"] == [
        ("el", "0.0001 refused", "–"),
        ("el, pivoted", "0.0001 SILENT", "–"),
        ("au", "1e-08 refused", "1"),
    ]
    assert tables["stability-wrong"] == [
        (
            *("el, pivoted", "SILENT", "straight", "3 links", "0.0001"),
            "relative 0.001, bound 1e-05, predicted 1e-06, condition 4e+07, condition M 300, "
            "condition a_1 4e+07",
        ),
        ("au", "failed", "straight", "3 links", "1e-08", "no state"),
    ]
    (text,) = ATLAS.remarks(FOUND)
    counts = "4 refused, 2 worse as their error bound tells, 1 silently wrong."
    assert text.startswith("11 cells: 4 good") and text.endswith(counts)


def test_scenes_beside_the_snake_share_a_table_a_line_each_family():
    others = [
        cell(AU, 1.0, "heavier", 1e-15, 1e-14, 1e-15, family="sleigh-mass"),
        cell(EL, 1.0, "heavier", 1e-2, 1e-1, 1e-3, family="sleigh-mass"),
        cell(AU, 1.0, "fast", "refused", "M is singular", family="rolling-disk-speed"),
    ]
    tables = {sheet.name: sheet for sheet in ATLAS.tables([*FOUND, *others])}
    assert {"stability-breaks", "stability-scenes-breaks"} <= set(tables)
    shared = tables["stability-scenes-breaks"]
    assert list(shared.columns) == ["family", "au", "el"]
    assert {tuple(row) for row in shared.rows} == {
        ("sleigh: mass", "", "1"),
        ("rolling-disk: fast and slow", "1 refused", "–"),
    }
    charts = [chart.name for chart in ATLAS.charts([*FOUND, *others])]
    families = ["stability-straight", "stability-dependent"]
    assert charts == ["stability", "stability-scenes", "stability-families", *families]
    alone = {sheet.name for sheet in ATLAS.tables(others[:2])}
    assert "stability-sleigh-breaks" in alone
    together = {sheet.name for sheet in ATLAS.tables(others) if sheet.name.endswith("-breaks")}
    assert together == {"stability-scenes-breaks"}


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"scene": "snake", "family": ["straight"]}, "scene and family are both given"),
        ({"formulation": []}, "formulation"),
        ({"family": []}, "family"),
    ],
)
def test_cells_of_the_atlas_that_there_cannot_be_are_refused(options, says):
    with pytest.raises(InputError, match=says):
        list(cells(**options))


def test_the_atlas_is_about_the_snake_unless_asked_and_quick_takes_a_few_severities():
    planned = list(cells(formulation=["au"]))
    about = {FAMILIES[one["family"]].about for one in planned}
    assert about == {"snake"} and "dependent" in {one["family"] for one in planned}
    quick = list(cells(family=["turns"], formulation=["el"], quick=True))
    assert [(x["variant"], x["severity"], x["pivoted"]) for x in quick] == [
        (variant, severity, pivoted)
        for variant in ("all alike", "each more than the last")
        for severity in (1.0, 1e4, 1e8, 1e12)
        for pivoted in (False, True)
    ]
    assert {x["family"] for x in cells(scene="sleigh", formulation=["au"], quick=True)} == {
        *("sleigh-mass", "sleigh-speed", "sleigh-turns", "sleigh-violated", "sleigh-offset")
    }


# ---- How severe states are -----------------------------------------------------------------------


def pose(family: str, variant: str, severity: float) -> Any:
    return FAMILIES[family].pose(variant, severity)


@pytest.mark.parametrize(
    ("variant", "u"),
    [("at rest", [0.0, 0.0]), ("moving", [1.0, 0.5]), ("nearly relaxed", [1.0, 0.5])],
)
def test_springs_of_all_joints_are_as_stiff_as_said(variant, u):
    posed = pose("stiffness", variant, 3e4)
    assert posed.scene.stiffness.tolist() == [3e4] * 6 and posed.u.tolist() == u
    steps = np.diff(posed.q[2:])
    if variant == "nearly relaxed":
        assert steps == pytest.approx(1e-6 + 0.5e-9 * np.arange(1, 13, 2), rel=1e-8)
    else:
        assert abs(steps).min() > 0.1


@pytest.mark.parametrize(("sign", "wheel"), [("+", 1), ("-", 2), ("-", 5)])
def test_one_wheel_is_across_by_its_sign_and_turns_its_link_slowly(sign, wheel):
    posed = pose("wheel-angle", f"{sign}π/2, wheel {wheel}", 1e-3)
    alpha = posed.scene.wheel_angle
    expected = 0.1 * np.arange(1, 6)
    expected[wheel - 1] = float(f"{sign}1") * (math.pi / 2 - 1e-3)
    assert alpha == pytest.approx(expected) and posed.u == pytest.approx([1e-3, 0.5e-3])


@pytest.mark.parametrize(
    ("variant", "links", "heading"), [("2 links, turned", 2, 0.3), ("7 links", 7, 0.0)]
)
def test_a_straight_snake_is_bent_by_the_severity_between_neighbours(variant, links, heading):
    posed = pose("straight", variant, 1e-3)
    assert posed.q[2:] == pytest.approx(heading + 1e-3 * np.arange(links), abs=1e-15)
    assert not posed.scene.wheel_angle.any() and posed.u.tolist() == [1.0, 0.5]


@pytest.mark.parametrize(
    ("what", "variant", "large"),
    [
        ("mass", "heavy head", [0]),
        ("mass", "alternating", [0, 2, 4]),
        ("length", "long tail", [5]),
    ],
)
def test_ratios_of_links_are_of_those_that_the_variant_names(what, variant, large):
    scene = pose(f"{what}-ratio", variant, 1e3).scene
    sizes = {"mass": np.ones(6), "length": np.ones(6)}
    sizes[what][large] = 1e3
    assert (scene.mass.tolist(), scene.length.tolist()) == tuple(map(list, sizes.values()))
    assert scene.inertia == pytest.approx(sizes["mass"] * sizes["length"] ** 2 / 12)


@pytest.mark.parametrize(
    ("variant", "u", "springs"),
    [
        ("fast", [1e20, 5e19], False),
        ("fast, springs", [1e20, 5e19], True),
        ("slow", [1e-20, 5e-21], False),
        ("slow, springs", [1e-20, 5e-21], True),
    ],
)
def test_speeds_are_large_or_small_with_springs_or_without(variant, u, springs):
    posed = pose("speed", variant, 1e20)
    assert posed.u == pytest.approx(u) and (posed.scene.stiffness is not None) == springs


def test_turns_are_whole_and_of_each_angle():
    alike, apart = (
        pose("turns", variant, 100.0) for variant in ("all alike", "each more than the last")
    )
    rest = 0.4 * np.arange(5)
    assert (alike.q[2:] - rest) / (2 * math.pi) == pytest.approx(np.full(5, 100.0))
    assert (apart.q[2:] - rest) / (2 * math.pi) == pytest.approx(100.0 * np.arange(1, 6))
    assert alike.q[:2].tolist() == [0.0, 0.0] and alike.u.tolist() == [1.0, 0.5]


@pytest.mark.parametrize("variant", ["coil", "random, bent a little", "random, bent"])
def test_long_chains_move_as_fast_as_one_and_bend_as_named(variant):
    posed = pose("links", variant, 10.0)
    at = Evaluation(posed.scene, posed.q, np.zeros(12))
    at.u = posed.u
    assert posed.scene.links == 10 and np.abs(at.velocity).max() == pytest.approx(1.0)
    assert posed.u[1] == pytest.approx(posed.u[0] / 2)
    if variant != "coil":
        turns, most = np.abs(np.diff(posed.q[2:])), 0.2 if "little" in variant else 1.0
        assert most / 2 < turns.max() <= most
        assert posed.scene.stiffness.tolist() == [5000.0] * 9


def test_a_pattern_of_many_links_rests():
    assert pose("links", "pattern", 20.0).u.tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("family", "variant"),
    [("violated", "coil"), ("violated", "free"), ("sleigh-violated", "all alike")],
)
def test_every_constraint_is_violated_by_its_share_of_the_largest_speed(family, variant):
    posed, kept = (pose(family, variant, x) for x in (1e-2, 0.0))
    a = Evaluation(posed.scene, posed.q, posed.v).terms.a
    assert a @ posed.v == pytest.approx(np.full(len(a), 1e-2 * np.abs(kept.v).max()))
    assert posed.u is None


@pytest.mark.parametrize(("variant", "factor"), [("heavier", 1e3), ("lighter", 1e-3)])
def test_the_first_mass_is_heavier_or_lighter_by_the_severity(variant, factor):
    mild, severe = (pose("sleigh-mass", variant, x).scene for x in (1.0, 1e3))
    assert severe.mass == pytest.approx(factor * mild.mass)
    assert mild.mass == type(mild).example().mass
    mild, severe = (pose("chain-pendulum-mass", variant, x).scene for x in (1.0, 1e3))
    assert severe.mass[0] == pytest.approx(factor * mild.mass[0])
    assert severe.mass[1:] == pytest.approx(mild.mass[1:])


def test_other_scenes_go_fast_or_slow_from_an_ordinary_state_and_turn_their_angles_alone():
    fast, slow, once = (
        *(pose("sleigh-speed", variant, 1e3) for variant in ("fast", "slow")),
        pose("sleigh-speed", "fast", 1.0),
    )
    assert once.u == pytest.approx(1 / np.arange(1, once.scene.p + 1))
    assert fast.u == pytest.approx(1e3 * once.u) and slow.u == pytest.approx(1e-3 * once.u)
    turned = pose("sleigh-turns", "all alike", 10.0)
    turns = (turned.q - once.q) / (2 * math.pi)
    expected = np.zeros(turned.scene.n)
    expected[turned.scene.angle_coordinates] = 10.0
    assert turns == pytest.approx(expected, abs=1e-12) and expected.sum() == 10.0


def test_limits_of_single_scenes_are_as_near_as_the_severity_says():
    for sign in "+-":
        lean = pose("rolling-disk-flat", f"{sign}π/2", 1e-2).q[3]
        assert lean == pytest.approx(float(f"{sign}1") * (math.pi / 2 - 1e-2))
    assert pose("sleigh-offset", "moving", 1e-5).scene.offset == 1e-5
    assert pose("four-bar-chain-in-line", "moving", 1e-3).scene.angle == 1e-3
    assert pose("four-bar-chain-in-line", "moving", 1e-3).u.tolist() == [1.0]
    assert pose("chain-pendulum-links", "moving", 5.0).scene.n == 5
    assert pose("andrews-stiffness", "moving", 7e3).scene.stiffness == 7e3
    lying = pose("bicycle-lying", "moving", 0.2)
    radius = lying.scene.radius[0]
    assert lying.q[bicycle.LEAN] == 0.2
    assert lying.q[bicycle.HEIGHT] == pytest.approx(radius * math.sin(0.2))
    stretched = pose("bricard-stretched", "moving", 1e-2)
    assert stretched.q[1] == pytest.approx(-math.pi / 6 + 1e-2)

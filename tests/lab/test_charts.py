"""Charts: every point, share, mark and choice, of Records and panels that are made by hand."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from math import inf, nan
from pathlib import Path
from typing import Any

import pytest

from eomcheck.evaluation.tolerance import C
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show import chart_plotly
from eomcheck.lab.show.chart import (
    STYLES,
    Axis,
    Band,
    Box,
    Chart,
    File,
    Heat,
    Line,
    Panel,
    contrast,
    in_rows,
    keys_of,
    on_dark,
)
from eomcheck.lab.show.chart_matplotlib import (
    FONT,
    HOLLOW,
    MOST_MARKERS,
    TEXT_LINE,
    WIDTH,
    chart_figure,
    draw_both,
    draw_heat,
    draw_panel,
    plt,
    tick,
)
from eomcheck.lab.show.chart_plotly import chart_json
from eomcheck.lab.show.table import grouped, seconds_text
from eomcheck.lab.store.record_file import Record, record_of_rows
from eomcheck.lab.studies import study_of
from eomcheck.lab.studies.accuracy import Delivered
from eomcheck.lab.studies.agreement import Agreement


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (2.0, "2 s"),
        (1.0, "1 s"),
        (0.25, "250 ms"),
        (1e-3, "1 ms"),
        (4.56789e-5, "45.7 µs"),
        (1e-6, "1 µs"),
        (7.5e-8, "75 ns"),
    ],
)
def test_times_are_told_in_the_largest_unit_of_which_there_is_one(seconds: float, text: str):
    assert seconds_text(seconds) == text
    assert grouped(1234567).split() == ["1", "234", "567"]


# ---- Charts of studies ---------------------------------------------------------------------------


def drawn(key: str, *found: Record) -> dict[tuple[str, ...], list[Line]]:
    """Return the lines of each panel of the charts of a study."""
    charts = list(study_of(key).charts(found))
    return {name: list(x.lines) for one in charts for name, x in one.panels.items()}


def _panels(key: str, found: Sequence[Record]) -> list[Any]:
    """Return the panels of the charts of a study."""
    return [panel for one in study_of(key).charts(found) for panel in one.panels.values()]


def points(lines: list[Line]) -> dict[str, list[tuple[Any, float]]]:
    """Return the points of lines that have some, by their keys."""
    return {one.key: [*zip(one.x, one.y, strict=True)] for one in lines if one.x}


def test_accuracy_draws_digits_of_what_was_solved_and_shares_of_what_was_foreseen():
    one = Delivered("im", 2, None, 15.0, 1e-15, ratio=0.25)
    rows = [
        one,
        replace(one, links=5, digits=9.0, ratio=nan),
        replace(one, links=3, digits=12.0, ratio=1e-9),
        Delivered("im", 4, "M"),
        replace(one, key="uk", digits=7.0, ratio=2.0),
    ]
    panels = drawn("accuracy", record_of_rows("accuracy", {}, rows))
    digits, shares = points(panels["digits",]), points(panels["share of states",])
    assert list(FORMULATIONS)[0::8] == ["im", "uk"]
    third, two = 1 / 3, 2 / 3
    assert digits == {
        "im": [(9.0, 0.0), (9.0, third), (12.0, third), (12.0, two), (15.0, two), (15.0, 1.0)],
        "uk": [(7.0, 0.0), (7.0, 1.0)],
    }
    # Steps at the ratios, up to all states of which something was foreseen.
    assert shares == {
        "im": [(1e-3, 0.0), (1e-3, 0.5), (0.25, 0.5), (0.25, 1.0)],
        "uk": [(2.0, 0.0), (2.0, 1.0)],
    }
    (chart,) = study_of("accuracy").charts([])
    share: Any = chart.panels["share of states",]
    assert share.marks == (C,)


def test_agreement_draws_each_distance_and_each_fault_once():
    rows = [
        Agreement("im", 2, 0.0, 1e-14, 1e-3),
        Agreement("el", 2, 3e-15, 2e-14, 1e-3),
        Agreement("im", 3, 4e-15, 8e-15, 0.0),
        Agreement("el", 2, 1e-15, 3e-14, 5e-3),
    ]
    found = points(drawn("agreement", record_of_rows("agreement", {}, rows))["distance",])
    assert found == {
        "allowed by rounding": [(2, 1e-14), (2, 2e-14), (3, 8e-15), (2, 3e-14)],
        "one sign flipped": [(2, 1e-3), (2, 5e-3)],
        "im": [(2, 1e-18), (3, 4e-15)],
        "el": [(2, 3e-15), (2, 1e-15)],
    }


def test_long_runs_draw_both_errors_of_each_remedy_over_time():
    def run(key: str, remedy: str, *, size: float) -> Record:
        series = {"times": [1.0, 2.0], "constraint": [size, 0.0], "energy": [2 * size, 3 * size]}
        return Record("long-run", {"formulation": key, "remedy": remedy}, series=series)

    failed = Record("long-run", {"formulation": "el", "remedy": "none"}, "failed", "singular")
    found = run("au", "none", size=1e-8), run("au", "feedback", size=1e-9), failed
    panels = drawn("long-run", run("kane", "none", size=1e-12), *found)
    told = {name: points(lines) for name, lines in panels.items()}
    constraint, energy = "‖c‖ / (m/s)", "|E - E₀| / E₀"
    assert {panel.y.title for panel in _panels("long-run", found)} == {
        f"largest {constraint} up to t",
        f"largest {energy} up to t",
    }
    assert told == {
        (constraint, "none"): {
            "au": [(1.0, 1e-8), (2.0, 1e-8)],
            "kane": [(1.0, 1e-12), (2.0, 1e-12)],
        },
        (constraint, "feedback"): {"au": [(1.0, 1e-9), (2.0, 1e-9)]},
        (constraint, "projection"): {},
        (energy, "none"): {
            "au": [(1.0, 2e-8), (2.0, 3 * 1e-8)],
            "kane": [(1.0, 2e-12), (2.0, 3 * 1e-12)],
        },
        (energy, "feedback"): {"au": [(1.0, 2e-9), (2.0, 3 * 1e-9)]},
        (energy, "projection"): {},
    }


def test_work_and_precision_draw_each_error_over_time_and_over_right_hand_sides():
    def run(tolerance: float, seconds: float, sides: int, **how: Any) -> Record:
        settings = {"reference": "disk", "formulation": "kane", "integrator": "Radau"}
        settings |= {"tolerance": tolerance} | how.pop("of", {})
        errors = {"final": tolerance, "energy": 0.0, "constraint": 2 * tolerance, "floor": 1e-13}
        counts = {"right-hand sides": sides, "steps": 1}
        how = {"seconds": seconds, "counts": counts, "errors": errors} | how
        return Record("work-precision", settings, **how)

    found = [
        run(1e-9, 4.0, 900, cpu_seconds=1.0),
        run(1e-3, 1.0, 100, cpu_seconds=1.0),
        run(1e-5, 2.0, 300, of={"integrator": "BDF"}),
        run(1e-5, 3.0, 500, of={"formulation": "au"}),
    ]
    (chart,) = study_of("work-precision").charts(found)
    time, sides = "run time", "right-hand sides"
    panels: dict[Any, Any] = {
        (name[0], name[1].split()[0], name[2]): panel for name, panel in chart.panels.items()
    }
    told = {name: points(panel.lines) for name, panel in panels.items()}
    assert told["Radau", "error", time] == {"kane": [(1.0, 1e-3), (4.0, 1e-9)], "au": [(3.0, 1e-5)]}
    assert told["Radau", "constraint", sides]["kane"] == [(100, 2e-3), (900, 2e-9)]
    assert told["Radau", "energy", time]["kane"] == [(1.0, 1e-17), (4.0, 1e-17)]
    assert told["BDF", "error", sides] == {"kane": [(300, 1e-5)]}
    hollow = {what: list(panels["Radau", "error", what].lines[0].hollow) for what in (time, sides)}
    assert hollow == {time: [False, True], sides: [False, False]}
    final = panels["Radau", "error", time]
    assert (final.unknown, final.y.range) == (1e-13, (pytest.approx(2e-10), None))
    assert panels["Radau", "energy", time].unknown is None
    first, second = final.lines[0].hover_text
    assert first[:2] == ["kane, Radau", "tolerance 1e-03"] and "1 step" in first[3]
    assert second[2] == "run time 4 s, disturbed: shared its core"


# ---- Charts as data ------------------------------------------------------------------------------

X, Y = Axis("x / m"), Axis("y / s", log=True)


def panel(*lines: Line, **how: Any) -> Panel:
    return Panel(X, Y, lines, **how)


def test_a_chart_lays_its_panels_out_by_its_lists_and_leaves_out_what_is_not_there():
    names = [("a", "p"), ("b", "q"), ("a", "q")]
    chart = Chart("c", "t", ["first", "second"], {name: panel() for name in names})
    assert chart.choices == {"first": ["a", "b"], "second": ["p", "q"]}
    assert chart.rows() == [[("a", "p"), ("a", "q")], [("b", "q")]]
    grid = [[("b", "q"), ("b", "p")], [("a", "p")]]
    assert replace(chart, grid=grid).rows() == [[("b", "q")], [("a", "p")]]
    assert chart.files() == [chart]
    parts = [File("one", "1", grid[:1]), File("two", "2", grid[1:])]
    first, second = replace(chart, parts=parts).files()
    assert (first.name, first.title, first.rows()) == ("one", "1", [[("b", "q")]])
    assert (second.name, second.parts) == ("two", None)
    assert in_rows([("a",), ("b",), ("c",)], 2) == [[("a",), ("b",)], [("c",)]]
    lines = Line("kane", [1.0], [2.0]), Line("au", [1.0], [2.0])
    other = replace(chart, panels={("a",): panel(*lines), ("b",): panel(lines[1])})
    assert keys_of([chart, other]) == ["kane", "au"]


HEAT = Heat(
    {"one": 2, "two": 1},
    {
        "first": ("kane", [Box(1.0, False, True), None, Box(nan, True, False)]),
        "second": ("au", [Box(3.0, True, False), Box(4.0, False, False), Box(2.0, False, True)]),
    },
    Axis("digits", range=(0.0, 8.0)),
    limit=5.0,
    hatched="refused",
    framed="wrong",
)


def test_a_steep_heat_map_has_each_box_under_its_heading_hatched_where_it_is():
    assert HEAT.edges == [0.0, 0.5, 1.0, 2]
    assert HEAT.keys == ["kane", "au"]
    assert replace(HEAT, columns={"a": 4, "b": 1}).edges == [0.0, 0.25, 0.5, 0.75, 1.0, 2]
    figure, axes = plt.subplots()
    draw_heat(axes, replace(HEAT, steep=True))
    boxes = [
        (round(x.get_x(), 3), round(x.get_y(), 3), round(x.get_width(), 3), x.get_hatch(),
         x.get_label().partition("_")[0])
        for x in axes.patches
    ]  # fmt: skip
    hatch = "//////"
    assert boxes == [
        (0.04, 0.1, 0.46, None, ""),
        (1.04, 0.1, 0.92, hatch, "refused"),
        (0.04, 1.1, 0.46, hatch, "refused in part"),
        (0.5, 1.1, 0.46, None, ""),
        (1.04, 1.1, 0.92, None, ""),
    ]
    assert axes.get_ylim() == (2.0, 0.0), "the first row is above"
    plt.close(figure)


def test_bars_tell_reported_errors_refusals_and_silent_ones_apart_without_their_shade():
    boxes = [Box(1.0, False, False), Box(5.0, False, False), Box(6.0, False, True)]
    refused = [Box(nan, True, False), Box(2.0, True, False), None]
    heat = replace(
        HEAT,
        columns={"good": 1, "bad": 3},
        rows={
            "first": ("kane", [Box(4.9, False, False), *boxes]),
            "second": ("au", [None, *refused]),
        },
        beyond="reported",
    )
    assert heat.flat == ["good"]
    assert heat.under("bad") == [boxes, refused]
    figure, axes = plt.subplots()
    draw_heat(axes, heat)
    marks = {patch.get_label(): patch for patch in axes.patches}
    bars = {
        name: round(-marks[name].get_height() / 0.82 * 8.0, 9)
        for name in ("digits", "reported", "wrong")
    }
    assert bars == {"digits": 2.0, "reported": 5.0, "wrong": 6.0}
    colors = [marks[name].get_facecolor() for name in bars]
    assert len(set(colors)) == 3
    (cross,) = axes.lines
    assert cross.get_marker() == "x", "a silent error has a shape of its own"
    assert 0.06 + 0.88 * 2 / 3 < cross.get_xdata()[0] < 0.94
    hatches = [patch for patch in axes.patches if patch.get_hatch()]
    assert [round(x.get_width(), 9) for x in hatches] == [round(0.88 * 2 / 3, 9)], "together"
    assert hatches[0].get_label() == "refused"
    assert [x.get_text() for x in axes.get_yticklabels()] == ["bad"]
    assert axes.get_xlabel() == "good throughout: good"
    plt.close(figure)


def test_a_heat_map_of_a_page_marks_hatched_and_framed_boxes():
    (made,) = json.loads(chart_json(Chart("c", "t", ["x"], {("a",): HEAT}))).values()
    marks = [
        (x["name"], x["marker"]["symbol"], x["x"], x["y"])
        for x in made["data"]
        if x["type"] == "scatter"
    ]
    assert marks == [
        ("kane", "x-thin-open", [1.5], [0]),
        ("kane", "square-open", [0.25], [0]),
        ("au", "x-thin-open", [0.25], [1]),
        ("au", "square-open", [1.5], [1]),
    ]
    heats = [x["z"] for x in made["data"] if x["type"] == "heatmap"]
    assert heats == [[[1.0, None, None]], [[3.0, 4.0, 2.0]]]
    assert made["layout"]["yaxis"]["autorange"] == "reversed"
    colors = made["layout"]["coloraxis"]
    assert (colors["cmin"], colors["cmax"]) == (0.0, 8.0)


def test_a_panel_draws_its_lines_its_hollow_points_and_what_stands_across():
    lines = (
        Line("kane", [1.0, 2.0, 4.0], [1e-3, 1e-5, 1e-4], hollow=[False, True, False]),
        Line("au", [1.0], [1e-2], label="other", dashed=True, joined=False),
    )
    band = Band("au", [1.0, 2.0], [1e-6, 1e-5], [1e-4, 1e-3], "half")
    one = panel(*lines, marks=(3.0,), level=1e-4, unknown=1e-6, bad=(1e-2, 1.0), bands=(band,))
    figure, axes = plt.subplots()
    draw_panel(axes, one)
    kane, hollow, au, mark, level = axes.lines
    assert (kane.get_xdata().tolist(), kane.get_ydata().tolist()) == (
        [1.0, 2.0, 4.0],
        [1e-3, 1e-5, 1e-4],
    )
    assert (hollow.get_gid(), *hollow.get_xdata(), *hollow.get_ydata()) == (HOLLOW, 2.0, 1e-5)
    assert (kane.get_label(), au.get_label()) == ("kane: Kane (variant)", "other")
    assert (kane.get_linestyle(), au.get_linestyle()) == ("-", "None")
    assert kane.get_color() == STYLES["kane"].color
    assert mark.get_xdata()[0] == 3.0 and level.get_ydata()[0] == 1e-4
    spans = [x.get_extents().transformed(axes.transData.inverted()) for x in axes.patches]
    ends = [y for x in spans for y in (x.y0, x.y1)]
    assert ends == pytest.approx([1e-2, 1.0, 1e-300, 1e-6], rel=1e-6, abs=1e-30)
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "log")
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x / m", "y / s")
    axes.clear()
    draw_panel(axes, replace(panel(level=0.0), y=X))
    assert [x.get_ydata()[0] for x in axes.lines] == [0.0]
    plt.close(figure)
    (made,) = json.loads(chart_json(Chart("c", "t", ["x"], {("a",): one}))).values()
    kane, au = made["data"]
    circle = STYLES["kane"].symbol
    assert kane["marker"]["symbol"] == [circle, f"{circle}-open", circle]
    assert (kane["mode"], au["mode"]) == ("lines+markers", "markers")
    assert (kane["line"]["dash"], au["line"]["dash"]) == ("solid", "dot")
    assert (kane["x"], kane["y"]) == ([1.0, 2.0, 4.0], [1e-3, 1e-5, 1e-4])
    assert made["layout"]["yaxis"]["type"] == "log" and "type" not in made["layout"]["xaxis"]


@pytest.mark.parametrize(
    ("axis", "limits", "ticks"),
    [
        (Axis("x", categories="abcdefghi"), (-0.5, 8.5), ["i", "f", "c"]),
        (Axis("x", categories="abcd"), (-0.5, 3.5), ["d", "c", "b", "a"]),
        (Axis("x", log=True, ticks=(1, 2, 5, 10, 50)), (2.0, 20.0), ["2", "5", "10"]),
    ],
)
def test_ticks_are_few_the_last_category_among_them_and_none_outside(axis, limits, ticks):
    figure, axes = plt.subplots()
    if axis.log:
        axes.set_xscale("log")
    axes.set_xlim(*limits)
    tick(axes.xaxis, axis)
    figure.canvas.draw()
    assert [x.get_text() for x in axes.get_xticklabels()] == ticks
    assert axes.get_xlim() == limits
    plt.close(figure)


def test_what_is_not_finite_is_null_in_a_document():
    rows = [Delivered("au", 2, None, 15.0, inf, nan), Delivered("el", 3, "M")]
    (told,) = study_of("accuracy").document([record_of_rows("accuracy", {}, rows)]).values()
    heads = "key", "links", "refused", "digits", "relative", "ulps"
    assert [tuple(one[x] for x in heads) for one in told] == [
        ("au", 2, None, 15.0, None, None),
        ("el", 3, "M", 0.0, None, None),
    ]


# ---- Figures -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("limits", "ticks"),
    [
        ((1.0, 1e6), [1.0, 1e2, 1e4, 1e6]),
        ((1.0, 60.0), [1.0, 3.0, 10.0, 30.0]),
        ((1.0, 9.0), [1.0, 2.0, 5.0]),
    ],
)
def test_ticks_of_logarithms_are_at_decades_or_within_them(limits, ticks):
    figure, axes = plt.subplots()
    axes.set_xscale("log")
    axes.set_xlim(*limits)
    tick(axes.xaxis, Axis("x", log=True))
    figure.canvas.draw()
    low, high = limits
    assert [x for x in axes.get_xticks() if low <= x <= high] == pytest.approx(ticks)
    tick(axes.xaxis, Axis("x", log=True, unit="s"))
    figure.canvas.draw()
    assert axes.get_xticklabels()[1].get_text().endswith("s")
    plt.close(figure)


def drawn_figure(chart: Chart) -> Any:
    figure = chart_figure(chart)
    plt.close(figure)
    return figure


def test_a_figure_has_a_panel_a_choice_whose_axes_are_shared_and_named_once():
    lines = [[Line("kane", [1.0, 2.0], [1.0, y])] for y in (10.0, 1000.0, 0.1)]
    panels = {(place,): Panel(X, Y, mine, place) for place, mine in zip("pqr", lines, strict=True)}
    grid = [[("p",), ("q",)], [("r",)]]
    chart = Chart("c", "A title", ["place"], panels, grid=grid, height=2.0)
    figure = drawn_figure(chart)
    assert figure.get_size_inches() == pytest.approx((WIDTH, 4.0 + 3 * TEXT_LINE))
    first, second, third, none = figure.axes
    assert [x.get_title() for x in (first, second, third)] == ["p", "q", "r"]
    assert [x.get_ylabel() for x in (first, second, third)] == ["y / s", "", "y / s"]
    assert [x.get_xlabel() for x in (first, second, third)] == ["", "", ""]
    assert figure.get_supxlabel() == "x / m"
    assert first.get_ylim() == second.get_ylim() != third.get_ylim()
    assert first.get_ylim()[1] > 1000.0 and third.get_xlim() == first.get_xlim()
    assert not none.axison
    (legend,) = figure.legends
    assert [x.get_text() for x in legend.get_texts()] == ["kane: Kane (variant)"]
    assert legend.get_title().get_text() == "A title"
    own = {(place,): replace(panel, y=Y._replace(own=True)) for (place,), panel in panels.items()}
    figure = drawn_figure(replace(chart, panels=own))
    first, second, *_ = figure.axes
    assert first.get_ylim()[1] < second.get_ylim()[1] and second.get_ylabel() == ""


EVERY = Chart(
    "every",
    "All formulations",
    ["x"],
    {("a",): panel(*(Line(key, [1.0, 2.0], [2.0, 3.0]) for key in FORMULATIONS))},
)


def test_a_legend_spells_out_every_formulation_as_the_registry_names_it():
    (legend,) = drawn_figure(EVERY).legends
    told = [text.get_text() for text in legend.get_texts()]
    assert len(told) == len(FORMULATIONS)
    for text, (key, formulation) in zip(told, FORMULATIONS.items(), strict=True):
        assert text in (f"{key}: {formulation.name}", key)
        assert text != key or formulation.name.lower() == key


def test_a_chart_of_a_page_is_written_for_both_grounds_and_has_none_of_its_own(tmp_path: Path):
    paths = draw_both(EVERY, tmp_path)
    assert [path.name for path in paths] == ["every.svg", "every-dark.svg"]
    light, dark = (path.read_text(encoding="utf-8") for path in paths)
    style = STYLES["au"].color
    assert style.lower() in light and on_dark(style) in dark
    for text in (light, dark):
        (patch,) = re.findall(r'<g id="patch_1">\s*<path d="[^"]*" style="([^"]*)"', text)
        assert "fill: none" in patch or "opacity: 0" in patch, "the ground of the figure"
        assert "<image" not in text
    draw_both(EVERY, tmp_path)
    assert paths[0].read_text(encoding="utf-8") == light, "its bytes are the same each time"


def test_many_points_are_dots_in_an_svg_and_its_lines_and_letters_stay(tmp_path: Path):
    count = [float(x) for x in range(1, MOST_MARKERS + 2)]
    chart = replace(
        EVERY,
        panels={("a",): panel(Line("au", count, count, joined=False), Line("im", [1.0], [2.0]))},
    )
    path, _ = draw_both(chart, tmp_path)
    text = path.read_text(encoding="utf-8")
    assert text.count("<image") == 1
    assert path.stat().st_size < 400_000


def test_letters_can_be_read_on_a_page_of_390_pixels_and_lines_be_seen_on_both_grounds():
    figure = drawn_figure(EVERY)
    (legend,) = figure.legends
    (axes,) = figure.axes
    letters = [*legend.get_texts(), *axes.get_xticklabels(), axes.yaxis.label, axes.title]
    assert {text.get_fontsize() for text in letters} == {FONT}
    margins = 2 * 16
    assert FONT / 72 * (390 - margins) / WIDTH >= 9.0
    for style in STYLES.values():
        assert contrast(style.color, "#ffffff") >= 3.0
        assert contrast(on_dark(style.color), "#131416") >= 3.0


def test_a_mark_of_all_lines_is_grey_in_the_legend_and_comes_last():
    lines = [
        Line("kane", [1.0], [2.0], label="not finished", appearance="crosses"),
        Line("em", [2.0], [2.0], label="not finished", appearance="crosses"),
        Line("au", [1.0], [2.0]),
    ]
    (legend,) = drawn_figure(replace(EVERY, panels={("a",): panel(*lines)})).legends
    assert [x.get_text() for x in legend.get_texts()] == ["au: Augmented", "not finished"]
    colors = {STYLES[key].color for key in ("kane", "em")}
    assert legend.get_lines()[-1].get_color() not in colors


@pytest.mark.parametrize(
    ("axis", "made"),
    [
        (Axis("x", range=(0, 1)), {"range": (0, 1)}),
        (Axis("x", log=True, range=(1, 2)), {"type": "log", "exponentformat": "power"}),
        (Axis("x", categories="ab"), {"type": "category", "categoryarray": ["a", "b"]}),
        (
            Axis("x", log=True, unit="s", ticks=(1, 2)),
            {"type": "log", "exponentformat": "SI", "ticksuffix": "s", "tickvals": [1, 2]},
        ),
    ],
)
def test_an_axis_of_a_page_has_its_title_its_kind_and_its_ticks(axis, made):
    assert chart_plotly._axis(axis) == {"title": {"text": "x"}, "automargin": True} | made


@pytest.mark.parametrize(
    ("values", "unit", "ticks"),
    [
        ([3e-9, 2e-2], "", "10<sup>−8</sup> 10<sup>−7</sup> 10<sup>−6</sup> 10<sup>−5</sup> "
         "10<sup>−4</sup> 10<sup>−3</sup> 10<sup>−2</sup>"),
        ([0.09, 2e3], "", "0.1 1 10 100 10<sup>3</sup>"),
        ([1e-16, 1.0], "", "10<sup>−16</sup> 10<sup>−14</sup> 10<sup>−12</sup> 10<sup>−10</sup> "
         "10<sup>−8</sup> 10<sup>−6</sup> 10<sup>−4</sup> 10<sup>−2</sup> 1"),
        ([0.0, 0.004, float("nan"), 0.026], "s", "5 ms,10 ms,20 ms"),
        ([2e-6, 3.0], "s", "10 µs,100 µs,1 ms,10 ms,100 ms,1 s"),
    ],
)  # fmt: skip
def test_ticks_of_logarithms_of_a_page_are_powers_of_ten(values, unit, ticks):
    made = chart_plotly._ticks(Axis("x", log=True, unit=unit), values)
    assert made["ticktext"] == ticks.split("," if unit else " ")
    assert min(values) <= made["tickvals"][0] < made["tickvals"][-1] <= 1.1 * max(values)
    assert made["ticksuffix"] == ""


@pytest.mark.parametrize(
    ("axis", "values"),
    [
        (Axis("x"), [1.0, 100.0]),
        (Axis("x", log=True, ticks=(1, 2)), [1.0, 100.0]),
        (Axis("x", log=True), [0.0]),
        (Axis("x", log=True), [6.0, 7.0]),
    ],
)
def test_other_axes_and_narrow_ones_have_the_ticks_of_plotly(axis, values):
    assert chart_plotly._ticks(axis, values) == {}


def test_what_points_say_is_wrapped_and_no_markup():
    long = "word " * 12
    assert chart_plotly._wrapped(["<a> & b", long]) == [
        "&lt;a&gt; &amp; b",
        "word word word word word word word word word",
        "word word word",
    ]
    told = chart_plotly._trace_options("kane", [["a", "b"], ["c"]])
    assert (told["name"], told["hovertext"]) == ("kane", ["a<br>b", "c"])
    assert told["hovertemplate"] == "%{hovertext}<extra></extra>"
    assert chart_plotly._trace_options("au", ()) == {"name": "au", "meta": {"formulation": "au"}}

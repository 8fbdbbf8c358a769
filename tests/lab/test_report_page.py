"""The report in a browser: it opens without a complaint, its legend works, nothing overflows."""

from __future__ import annotations

import shutil
from collections.abc import Iterator

import pytest
from tests import reports

from eomcheck.lab.report.overview import Overview, read_records
from eomcheck.lab.report.report_formats import DARK, LIGHT, write_page
from eomcheck.lab.show.chart import STYLES, on_dark

sync_api = pytest.importorskip("playwright.sync_api")
NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason=f"none of {', '.join(NAMES)} installed")

PATIENCE = 10 * 60 * 1000
"""Milliseconds after which nothing will come any more, on a machine that does other things too."""
OPTIONS = [
    *("--no-sandbox", "--disable-gpu", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
]


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("page")
    for name, kind in (("good.db", reports.Sleigh), ("bad.db", reports.Heavy)):
        reports.validated(folder / name, kind)
    reports.counted(folder / "good.db")
    reports.studied(folder / "good.db")
    overview = Overview(read_records([folder / "good.db", folder / "bad.db"]))
    write_page(overview, folder / "report.html")
    return (folder / "report.html").as_uri()


@pytest.fixture(scope="module")
def browser() -> Iterator[sync_api.Browser]:
    with sync_api.sync_playwright() as playwright:
        made = playwright.chromium.launch(executable_path=CHROMIUM, args=OPTIONS, timeout=PATIENCE)
        yield made
        made.close()


@pytest.fixture(params=[(1280, "light"), (1280, "dark"), (390, "light"), (390, "dark")])
def page(request: pytest.FixtureRequest, browser, url: str) -> Iterator[sync_api.Page]:
    width, scheme = request.param
    viewport = {"width": width, "height": 900}
    with browser.new_context(viewport=viewport, color_scheme=scheme, offline=True) as context:
        made = context.new_page()
        made.set_default_timeout(PATIENCE)
        made.complaints = []
        made.on("console", lambda message: made.complaints.append(message.text))
        made.on("pageerror", lambda error: made.complaints.append(str(error)))
        made.on("request", lambda request: made.complaints.append(request.url))
        made.goto(url)
        assert made.complaints.pop(0) == url
        yield made


def test_it_opens_without_a_complaint_and_draws_every_chart(page):
    charts = page.locator(".chart").count()
    assert charts == 6
    drawn = page.locator(".chart .main-svg :is(.scatterlayer, .heatmaplayer)").count()
    assert drawn >= charts
    assert page.complaints == []


def test_nothing_overflows(page):
    page.evaluate("document.querySelectorAll('details').forEach((one) => one.open = true)")
    wide = page.evaluate(
        """() => [...document.querySelectorAll("body *")].filter((one) => {
            const inside = one.parentElement.closest(".scroll, nav, pre, svg, .plot");
            return !inside && one.getBoundingClientRect().right > innerWidth + 0.5;
        }).map((one) => one.outerHTML.slice(0, 80))"""
    )
    assert wide == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_the_contents_stay_in_sight_and_mark_the_section_that_is_read(page):
    links = page.locator("nav .contents a")
    ids = [one.get_attribute("href") for one in links.all()]
    assert {"#failures", "#claims", "#states", "#mechanisms"} < {*ids}
    assert [one.get_attribute("id") for one in page.locator("main > section").all()] == [
        one.removeprefix("#") for one in ids
    ]
    for id in ("#states", "#claims"):
        page.locator(f'nav a[href="{id}"]').click()
        current = page.locator(f'nav a[href="{id}"][aria-current]')
        current.wait_for()
        assert page.locator("nav a[aria-current]").count() == 1
        box, bar = current.bounding_box(), page.locator("nav").bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= page.viewport_size["width"]
        assert page.locator(f"{id} h2").bounding_box()["y"] >= bar["y"] + bar["height"]


def test_the_legend_lights_one_formulation_everywhere(page):
    button = page.locator('#legend button[data-key="kane"]')
    button.click()
    assert button.get_attribute("aria-pressed") == "true"
    dim = "(e) => e.classList.contains('dim')"
    cells = page.locator(".matrix td[data-f]").all()
    assert {(one.get_attribute("data-f"), one.evaluate(dim)) for one in cells} == {
        ("au", True),
        ("ml", True),
        ("kane", False),
        ("casadi", False),  # no formulation
    }
    opacity = """() => [...document.querySelectorAll(".plot")].flatMap(
        (plot) => plot._fullData.map((trace) => [trace.name, trace.opacity]))"""
    drawn = page.evaluate(opacity)
    assert {name for name, at in drawn if at == 1} == {"kane"}
    assert {name for name, at in drawn if at < 0.5} == {"au", "ml"}
    button.click()
    assert button.get_attribute("aria-pressed") == "false"
    assert {at for _, at in page.evaluate(opacity)} == {1}
    assert page.locator(".dim").count() == 0
    assert page.complaints == []


RUNS = '[data-chart="work-precision-paper-rest"]'


def test_a_choice_changes_the_chart(page):
    title = f"() => document.querySelector('{RUNS} .plot')._fullLayout.yaxis.title.text"
    before = page.evaluate(title)
    page.locator(f"{RUNS} select").nth(1).select_option(index=1)
    assert page.evaluate(title) != before
    assert page.complaints == []


def test_a_point_tells_tolerance_counts_and_status(page):
    said = page.evaluate(f"document.querySelector('{RUNS} .plot')._fullData[0].hovertext[0]")
    assert "tolerance 1e-04" in said
    assert "right-hand sides" in said and "steps" in said
    assert "disturbed" in said or "done" in said
    page.locator(f"{RUNS} .plot").scroll_into_view_if_needed()
    box = page.evaluate(
        f"""() => {{ const point = document.querySelector('{RUNS} .plot .point');
        const r = point.getBoundingClientRect();
        return [r.x + r.width / 2, r.y + r.height / 2]; }}"""
    )
    page.mouse.move(*box)
    page.wait_for_selector(f"{RUNS} .hoverlayer .hovertext")
    assert "tolerance" in (page.locator(f"{RUNS} .hoverlayer").first.text_content() or "")


def test_a_link_to_a_failing_state_unfolds_it(page):
    link = page.locator("#failures a", has_text="failing state").first
    state = page.locator(link.get_attribute("href"))
    assert state.get_attribute("open") is None
    link.click()
    page.wait_for_function("(e) => e.open", arg=state.element_handle())
    assert "eomcheck.check_state(scene" in state.inner_text()


def test_colours_are_those_of_the_scheme(page):
    drawn = page.evaluate(
        """() => [...document.querySelector(".plot")._fullData].map(
        (trace) => [trace.name, trace.line.color])"""
    )
    dark = page.evaluate("matchMedia('(prefers-color-scheme: dark)').matches")
    for key, color in drawn:
        assert color == (on_dark(STYLES[key].color) if dark else STYLES[key].color)
    back = page.evaluate("getComputedStyle(document.body).backgroundColor")
    background = DARK if dark else LIGHT
    assert back == f"rgb({', '.join(str(int(background[i : i + 2], 16)) for i in (1, 3, 5))})"

"""Claims about the report in a browser: its answer stands first, readable on any screen, in any theme, without script;
its charts hold data, zoom keeps peaks."""

import csv
import time

import pytest
from objections import violations

DRAWN = "figure.chart:not([hidden])"
PLOTS = """[...document.querySelectorAll("figure.chart:not([hidden]) .plot")].map(
    e => [e.id, e.getBoundingClientRect().top / innerHeight, e.querySelector(".main-svg")?.clientWidth ?? 0])"""


def seen(page, chart):
    """Scroll to a chart, and wait until it is drawn."""
    place = page.locator(f'[id="{chart}"]')
    place.scroll_into_view_if_needed()
    place.locator(".main-svg").first.wait_for()
    return place


def until(page, condition, seconds=30):
    """Wait until a page's expression is true; asked anew from outside, because the page forbids `eval` to itself."""
    end = time.monotonic() + seconds
    while not page.evaluate(f"(() => {condition})()"):
        assert time.monotonic() < end, f"still false after {seconds} s: {condition}"
        page.wait_for_timeout(50)


@pytest.fixture
def opened(page, report):
    page.goto(report.as_uri())
    page.wait_for_selector("html[data-ready=true]")
    return page


CONTRAST = """() => {
  const light = c => { const [r, g, b] = c.match(/[\\d.]+/g).map(v => v / 255).map(
      v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  const paper = light(getComputedStyle(document.body).backgroundColor);
  return [...document.querySelectorAll("#verdict text, #verdict p, #verdict h2, #verdict dt, #verdict td")].map(e => {
    const style = getComputedStyle(e), ink = light(e.tagName === "text" ? style.fill : style.color);
    return (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05);
  });
}"""


def test_the_answer_and_its_place_are_on_the_first_screen(opened):
    assert "The model lacks stribeck at 2A" in opened.locator("#answer").inner_text()
    marked = opened.locator("#verdict .drive-wide rect[stroke-width='3.5']")
    assert marked.count() == 1
    for part in (opened.locator("#answer"), marked, opened.locator("#verdict dt").first):
        box = part.bounding_box()
        assert 0 <= box["y"] and box["y"] + box["height"] < 900
    assert opened.locator("nav").bounding_box()["y"] > opened.locator("#verdict dl").bounding_box()["y"]


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_every_word_of_the_answer_is_readable(opened, theme):
    opened.emulate_media(color_scheme=theme)
    opened.wait_for_selector(f"html[data-theme={theme}]")
    found = opened.evaluate(CONTRAST)
    assert len(found) > 40 and min(found) >= 4.5


@pytest.mark.parametrize("width", [390, 1000, 1150, 1280])
def test_every_number_of_the_answer_is_seen_without_scrolling_its_table(opened, width):
    opened.set_viewport_size({"width": width, "height": 900})
    hidden = opened.evaluate("""[...document.querySelectorAll("#verdict .wide")].filter(
        e => e.scrollWidth > e.clientWidth + 1).map(e => e.innerText.slice(0, 60))""")
    assert hidden == []


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_core_finds_no_violation(opened, theme):
    opened.emulate_media(color_scheme=theme)
    opened.wait_for_selector(f"html[data-theme={theme}]")
    assert violations(opened) == []


def test_on_a_phone_the_drive_train_runs_down_and_nothing_is_wider_than_the_screen(page, report):
    page.set_viewport_size({"width": 390, "height": 800})
    page.goto(report.as_uri())
    page.wait_for_selector("html[data-ready=true]")
    assert page.locator(".drive-narrow").is_visible() and not page.locator(".drive-wide").is_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    small = page.evaluate("""[...document.querySelectorAll("#verdict .drive-narrow text")].map(
        t => t.getBoundingClientRect().height)""")
    assert min(small) >= 9


def test_the_answer_needs_no_script_and_prints(browser, report):
    context = browser.new_context(viewport={"width": 1000, "height": 1200}, java_script_enabled=False)
    page = context.new_page()
    page.goto(report.as_uri())
    page.emulate_media(media="print")
    assert page.locator("#answer").is_visible() and page.locator("#verdict .drive-wide svg").is_visible()
    assert page.locator("#verdict dt").count() >= 7 and not page.locator("nav").is_visible()
    assert page.locator(".plot:visible").count() == 0 == page.locator("button:visible").count()  # nothing that is dead
    context.close()


def test_a_chart_is_drawn_when_the_reader_comes_near_it_and_not_before(opened):
    first = opened.evaluate(PLOTS)
    far = [name for name, top, width in first if top > 2]
    assert len(far) >= 5 and not any(width for name, top, width in first if name in far)
    assert all(width for name, top, width in first if top < 1.5)
    for name in far:
        seen(opened, name)


def test_paper_shows_every_chart_in_ink_as_wide_as_the_paper_and_the_screen_is_as_before(opened):
    opened.emulate_media(color_scheme="dark")
    opened.wait_for_selector("html[data-theme=dark]")
    opened.evaluate(f"""window.addEventListener("beforeprint", () => {{
        window.printed = [{PLOTS}, getComputedStyle(document.body).backgroundColor]; }})""")
    assert opened.pdf(format="A4").startswith(b"%PDF")
    charts, ground = opened.evaluate("window.printed")
    assert len(charts) >= 8 and all(0 < width <= 1000 for _, _, width in charts) and ground == "rgb(255, 255, 255)"
    for name, _, _ in charts[1:3]:
        assert seen(opened, name).locator(".main-svg").first.evaluate("e => e.clientWidth") > 1000
        assert opened.evaluate(f"document.getElementById('{name}').layout.paper_bgcolor") == "#15181c"


def test_the_charts_open_on_the_variable_that_is_to_blame(opened):
    for chooser in ("#maps", "#profiles"):
        assert "speed of 2A" in opened.locator(f"{chooser} {DRAWN} .charttitle").inner_text()


def test_long_tables_are_folded_and_open_with_the_keyboard(opened):
    fold = opened.locator("#next details").last
    assert not fold.locator("table").is_visible()
    fold.locator("summary").focus()
    opened.keyboard.press("Enter")
    assert fold.locator("table").is_visible()


def test_every_shown_chart_has_data(opened):
    charts = opened.locator(DRAWN)
    assert charts.count() >= 8
    for k in range(charts.count()):
        seen(opened, charts.nth(k).get_attribute("data-chart"))
        shapes = charts.nth(k).locator(".trace path, .heatmaplayer image, .heatmap image, .point path")
        assert shapes.count() > 0, charts.nth(k).get_attribute("data-chart")


def test_zooming_shows_more_of_the_same_signals_on_one_time_axis(opened):
    seen(opened, "timeline")
    layer = opened.locator("#timeline .nsewdrag").nth(2)
    box = layer.bounding_box()
    y = box["y"] + box["height"] / 2
    opened.mouse.move(box["x"] + 0.3 * box["width"], y)
    opened.mouse.down()
    opened.mouse.move(box["x"] + 0.5 * box["width"], y, steps=5)
    opened.mouse.up()
    until(opened, "Math.max(...document.getElementById('timeline').data.at(-1).x) < 67.8 * 0.6")
    low, high = opened.evaluate("(() => document.getElementById('timeline').layout.xaxis.range)()")
    assert 0.1 * 67 < high - low < 0.35 * 67
    axes = opened.evaluate("(() => document.getElementById('timeline').data.map(t => t.xaxis || 'x'))()")
    assert set(axes) == {"x"}


def test_another_map_can_be_chosen_with_the_keyboard(opened):
    select = opened.locator("#maps select")
    before = opened.locator(f"#maps {DRAWN}").get_attribute("data-chart")
    select.focus()
    opened.keyboard.press("ArrowDown")
    opened.keyboard.press("Enter")
    after = opened.locator(f"#maps {DRAWN}").get_attribute("data-chart")
    seen(opened, after)
    assert after != before and opened.locator(f"#maps {DRAWN} image").count() > 0


def test_the_theme_can_be_changed(opened):
    def ground():
        return opened.evaluate("(() => getComputedStyle(document.body).backgroundColor)()")
    light = ground()
    seen(opened, "ladder")
    opened.get_by_role("button", name="Light or dark").click()
    assert ground() != light
    seen(opened, "ladder")
    until(opened, "document.getElementById('ladder').layout.paper_bgcolor === '#15181c'")


def test_the_numbers_of_a_chart_can_be_saved(opened, tmp_path):
    with opened.expect_download() as waiting:
        opened.locator("figure[data-chart=ladder] .csv").click()
    waiting.value.save_as(tmp_path / "ladder.csv")
    rows = list(csv.DictReader((tmp_path / "ladder.csv").open()))
    first, last = (float(rows[k]["C_H held-out passes: y"]) for k in (0, 1))
    assert last < 0.6 * first

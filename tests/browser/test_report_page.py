"""Claims about the report in a browser: it opens from a file, its charts hold data, zoom keeps peaks, themes change."""

import csv

import pytest

DRAWN = "figure.chart:not([hidden])"


@pytest.fixture
def opened(page, report):
    page.goto(report.as_uri())
    page.wait_for_selector("html[data-ready=true]")
    return page


def test_every_shown_chart_has_data(opened):
    charts = opened.locator(DRAWN)
    assert charts.count() >= 8
    for k in range(charts.count()):
        shapes = charts.nth(k).locator(".trace path, .heatmaplayer image, .heatmap image, .point path")
        assert shapes.count() > 0, charts.nth(k).get_attribute("data-chart")


def test_zooming_shows_more_of_the_same_signals_on_one_time_axis(opened):
    chart = opened.locator("#timeline")
    chart.scroll_into_view_if_needed()
    layer = opened.locator("#timeline .nsewdrag").nth(2)
    box = layer.bounding_box()
    y = box["y"] + box["height"] / 2
    opened.mouse.move(box["x"] + 0.3 * box["width"], y)
    opened.mouse.down()
    opened.mouse.move(box["x"] + 0.5 * box["width"], y, steps=5)
    opened.mouse.up()
    opened.wait_for_timeout(600)
    low, high = opened.evaluate("(() => document.getElementById('timeline').layout.xaxis.range)()")
    whole = opened.evaluate("(() => Math.max(...document.getElementById('timeline').data.at(-1).x))()")
    assert 0.1 * 67 < high - low < 0.35 * 67 and whole < 67.8 * 0.6
    axes = opened.evaluate("(() => document.getElementById('timeline').data.map(t => t.xaxis || 'x'))()")
    assert set(axes) == {"x"}


def test_another_map_can_be_chosen_with_the_keyboard(opened):
    select = opened.locator("#maps select")
    before = opened.locator(f"#maps {DRAWN}").get_attribute("data-chart")
    select.focus()
    opened.keyboard.press("ArrowDown")
    opened.keyboard.press("Enter")
    after = opened.locator(f"#maps {DRAWN}").get_attribute("data-chart")
    assert after != before and opened.locator(f"#maps {DRAWN} image").count() > 0


def test_the_theme_can_be_changed(opened):
    def ground():
        return opened.evaluate("(() => getComputedStyle(document.body).backgroundColor)()")
    light = ground()
    opened.get_by_role("button", name="Light or dark").click()
    assert ground() != light
    assert opened.evaluate("(() => document.getElementById('ladder').layout.paper_bgcolor)()") == "#15181c"


def test_the_numbers_of_a_chart_can_be_saved(opened, tmp_path):
    with opened.expect_download() as waiting:
        opened.locator("figure[data-chart=ladder] .csv").click()
    waiting.value.save_as(tmp_path / "ladder.csv")
    rows = list(csv.DictReader((tmp_path / "ladder.csv").open()))
    first, last = (float(rows[k]["C_H held-out passes: y"]) for k in (0, 1))
    assert last < 0.6 * first

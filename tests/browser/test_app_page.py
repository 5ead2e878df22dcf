"""Claims about the app in a browser: the loop of adding and undoing, refusals, mapping, and an FMU to take away."""

import math
import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from objections import violations

from pycosim.study.parse import load_study

LONG = 90_000  # ms; two noisy cores


def held_out(page):
    """Held-out error of the hip that the page shows [N.m]."""
    return float(re.search(r"C_H ([\d.]+)", page.locator("[data-held-out]").inner_text()).group(1))


def tab(page, name):
    page.get_by_role("tab", name=name).click()


def charted(page):
    """Wait for a chart with data."""
    page.locator(".js-plotly-plot .trace path").first.wait_for(state="attached", timeout=LONG)


def test_add_lowers_the_held_out_error_and_undo_brings_it_back(app, page, study):
    address, folder = app(study)
    page.goto(address)
    charted(page)
    before = held_out(page)
    tab(page, "Effects")
    page.get_by_role("button", name="Diagnose").click()
    add = page.get_by_role("button", name="Add stribeck at 2A", exact=True)
    add.wait_for(timeout=LONG)
    assert page.locator(".drive-wide rect[stroke-width='3.5']").count() == 1  # the place, in the drawing
    add.click()
    page.get_by_text("study: + stribeck at 2A").wait_for(timeout=LONG)
    after = held_out(page)
    assert after < 0.6 * before
    tab(page, "Comparison")
    charted(page)
    page.get_by_text("+ stribeck at 2A").nth(1).wait_for(timeout=LONG)  # in the summary, and in the chart of two models
    page.get_by_role("button", name="What does the error depend on here?").click()
    page.get_by_text("of the error's energy. What bins").wait_for(timeout=LONG)
    tab(page, "Export")
    page.get_by_role("button", name="Save study").click()
    page.get_by_text("Saved: ").wait_for(timeout=LONG)
    assert load_study(folder / "study.toml").effects == [("stribeck", "2A")]
    assert load_study(study).effects == []
    page.get_by_role("button", name="Undo").click()
    page.get_by_text("study: base model").wait_for(timeout=LONG)
    assert held_out(page) == before


def test_a_bad_file_gets_the_sentence_of_the_command_line(app, page, study, tmp_path):
    address, folder = app(study)
    page.goto(address)
    lines = (study.parent / "run.csv").read_text().splitlines()
    lines[40] = "nonsense" + lines[40][lines[40].index(","):]
    bad = tmp_path / "bad.csv"
    bad.write_text("\n".join(lines) + "\n")
    tab(page, "Data")
    page.locator("input[type=file]").set_input_files(bad)
    alert = page.get_by_role("alert").filter(has_text="bad.csv")
    alert.wait_for(timeout=LONG)
    told = subprocess.run([sys.executable, "-m", "pycosim.cli", "compare", study, "--data", folder / "bad.csv"],
                          capture_output=True, text=True, cwd=tmp_path)
    assert told.returncode == 2 and told.stderr == f"pycosim: {alert.inner_text()}\n"
    assert held_out(page) > 0  # what was there before stays


def choose(page, label, answer):
    page.get_by_label(label, exact=True).click()
    page.get_by_role("option", name=answer, exact=True).click()


def odd(study, folder):
    """The log as a German recorder would export it: preamble, semicolons, decimal commas, UTF-16, degrees, ms."""
    frame = pd.read_csv(study.parent / "run.csv").drop(columns="manoeuvre")
    frame["time"] *= 1000
    frame[["theta1", "theta2"]] *= 180 / math.pi
    frame = frame.rename(columns={"time": "Zeit", "theta1": "Winkel 1 [°]", "theta2": "Winkel 2 [°]",
                                  "tau1": "Moment 1 [Nm]", "tau2": "Moment 2 [Nm]"})
    path = folder / "messung.csv"
    path.write_bytes(("Rekorder 7\n\n" + frame.to_csv(index=False, sep=";", decimal=",")).encode("utf-16"))
    return path


def test_from_a_dropped_file_to_the_first_comparison_with_two_tabs_and_a_reload(app, page, browser, study, tmp_path):
    address, _ = app()
    other = browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
    try:
        page.goto(address)
        other.goto(address)
        page.locator("input[type=file]").set_input_files(odd(study, tmp_path))
        use = page.get_by_role("button", name="Use these columns")
        use.wait_for(timeout=LONG)
        assert page.get_by_text('separator = ";", decimal = ",", encoding = "utf-16", preamble = 2').count() == 1
        assert page.get_by_label("Unit of the time").input_value() == "ms"
        assert page.get_by_label("Unit of motor1.phi").input_value() == "deg"
        assert page.locator("svg[role=img][aria-label^='Winkel 1']").count() >= 1  # a picture of each signal
        use.click()
        page.get_by_role("alert").filter(has_text="1 question is open, beside the fields above").wait_for(timeout=LONG)
        assert page.get_by_role("alert").filter(has_text="In which unit are 'C_H'").count() == 2  # at both fields
        choose(page, "Unit of C_H", "N.m")
        other.get_by_role("alert").filter(has_text="In which unit is 'C_K'").wait_for(timeout=LONG)
        choose(other, "Unit of C_K", "N.m")  # the other tab goes on
        # the fields follow one after the other: none is left in the end
        page.get_by_role("alert").filter(has_text="In which unit").first.wait_for(state="detached", timeout=LONG)
        use.click()
        page.locator("[data-stages]").filter(has_text="left: ").wait_for(timeout=LONG)
        page.reload()  # in the middle of work
        for tab_of in (page, other):
            tab_of.locator("[data-held-out]").wait_for(timeout=LONG)
            charted(tab_of)
        assert held_out(page) == held_out(other) > 0.1
        for tab_of in (page, other):
            tab_of.locator("[data-first]").filter(has_text="stribeck at 2A").wait_for()  # provisional, before any test
    finally:
        other.context.close()


def test_work_begun_in_one_tab_is_followed_and_given_up_in_another(app, page, browser, study):
    address, _ = app(study)
    other = browser.new_context().new_page()
    try:
        page.goto(address)
        other.goto(address)
        tab(page, "Effects")
        page.get_by_role("button", name="Diagnose").click()
        cancel = other.get_by_role("button", name="Cancel")
        cancel.wait_for(timeout=LONG)
        tab(other, "Effects")
        other.get_by_role("button", name="Diagnose").click()
        other.get_by_text("something is being computed already").wait_for(timeout=LONG)
        cancel.click()
        for tab_of in (page, other):
            tab_of.get_by_text("Given up; everything is as it was before.").wait_for(timeout=LONG)
    finally:
        other.context.close()


@pytest.mark.slow
def test_parameters_plan_and_report_are_shown(app, page, study):
    address, folder = app(study)
    page.goto(address)
    tab(page, "Parameters")
    page.get_by_role("cell", name="s1A.f0", exact=True).wait_for(timeout=LONG)
    tab(page, "Plan")
    page.get_by_role("button", name="Plan", exact=True).click()
    page.get_by_role("group", name="The motion of the motors over time").wait_for(timeout=3 * LONG)
    with page.expect_download(timeout=LONG) as waiting:
        page.get_by_role("button", name="Take the motion (CSV)").click()
    assert waiting.value.suggested_filename == "plan.csv"
    tab(page, "Report")
    page.get_by_role("button", name="Search and report").click()
    link = page.get_by_role("link", name="Open the report")
    link.wait_for(timeout=3 * LONG)
    page.get_by_text("study: + stribeck at 2A").wait_for(timeout=LONG)
    with page.context.expect_page() as opened:
        link.click()
    opened.value.get_by_text("stribeck").first.wait_for(timeout=LONG)


def test_a_phone_shows_all_of_it_without_scrolling_sideways(app, page, study, tmp_path):
    address, _ = app()
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto(address)
    page.locator("input[type=file]").set_input_files(odd(study, tmp_path))
    page.get_by_role("button", name="Use these columns").wait_for(timeout=LONG)
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    page.get_by_text("Columns that state no unit are in SI units").click()
    page.get_by_role("button", name="Use these columns").click()
    page.locator("[data-held-out]").wait_for(timeout=LONG)
    charted(page)
    assert page.locator(".drive-narrow svg").is_visible()  # the drive train, coloured by error
    for name in ("Comparison", "Effects", "Parameters", "Plan", "Export"):
        tab(page, name)
        page.wait_for_timeout(500)
        assert page.evaluate("document.documentElement.scrollWidth") == 390, name


def test_the_keyboard_alone_goes_from_a_log_to_a_comparison(app, page, study):
    address, _ = app()
    page.goto(address)

    def reach(name):
        for _ in range(80):
            page.keyboard.press("Tab")
            at = page.evaluate("""(e => [e.ariaLabel, e.innerText, ...[...(e.labels || [])].map(l => l.innerText),
                                  e.closest("[role=checkbox]")?.innerText].filter(Boolean).join(" "))
                                  (document.activeElement)""")
            if name.lower() in at.lower():
                return
        raise AssertionError(f"{name} is not reached")
    page.get_by_label("Log file on this machine").wait_for(timeout=LONG)
    reach("Log file on this machine")
    page.keyboard.type(str(study.parent / "run.csv"))
    reach("Use log")
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Use these columns").wait_for(timeout=LONG)
    reach("Unit of motor1.phi")
    page.keyboard.press("Enter")
    page.get_by_role("option", name="rad", exact=True).wait_for(timeout=LONG)
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    page.get_by_role("alert").filter(has_text="In which unit is 'theta2'").wait_for(timeout=LONG)
    assert page.get_by_label("Unit of motor1.phi").input_value() == "rad"
    # what was filled in place meanwhile has not taken the focus away
    assert "motor1.phi" in page.evaluate("document.activeElement.ariaLabel")
    page.keyboard.press("Shift+Tab")
    page.locator("body").evaluate("document.querySelector('[role=checkbox][aria-label*=\"no unit\"], "
                                  "[role=checkbox]').focus()")
    page.keyboard.press("Space")
    reach("Use these columns")
    page.keyboard.press("Enter")
    page.locator("[data-held-out]").wait_for(timeout=LONG)


@pytest.mark.parametrize("theme", ["light", pytest.param("dark", marks=pytest.mark.slow)])
def test_axe_core_finds_no_violation_on_any_tab(app, page, study, theme):
    address, _ = app()
    page.emulate_media(color_scheme=theme)
    page.goto(address)
    page.locator("input[type=file]").wait_for(state="attached", timeout=LONG)
    assert violations(page) == []
    page.locator("input[type=file]").set_input_files(study.parent / "run.csv")
    page.get_by_role("button", name="Use these columns").wait_for(timeout=LONG)
    page.wait_for_timeout(1000)  # colours fade in
    assert violations(page) == []
    page.get_by_text("Columns that state no unit are in SI units").click()
    page.get_by_role("button", name="Use these columns").click()
    page.locator("[data-held-out]").wait_for(timeout=LONG)
    charted(page)
    assert page.locator(".drive-wide svg").is_visible()  # the drive train, coloured by error
    for name in ("Comparison", "Effects", "Parameters", "Plan", "Report", "Export"):
        tab(page, name)
        page.wait_for_timeout(1500)
        assert violations(page) == [], name
    assert page.get_by_role("heading", level=1).count() == 1 and page.get_by_role("main").count() == 1


def test_paper_holds_the_widest_chart_and_no_button(app, page, study):
    address, _ = app(study)
    page.goto(address)
    charted(page)
    wide = page.evaluate("document.querySelector('.js-plotly-plot .main-svg').getBoundingClientRect().right")
    page.emulate_media(media="print")
    assert wide * float(page.evaluate("getComputedStyle(document.body).zoom")) <= 718  # px of A4 within its margins
    assert page.locator("button:visible").count() == 0 == page.locator("header:visible").count()


def test_work_can_be_given_up_and_leaves_nothing(app, page, study):
    address, _ = app(study)
    page.goto(address)
    charted(page)
    tab(page, "Effects")
    page.get_by_role("button", name="Diagnose").click()
    page.get_by_role("button", name="Cancel").click(timeout=LONG)
    page.get_by_text("Given up; everything is as it was before.").wait_for(timeout=LONG)
    assert page.get_by_role("button", name=re.compile("^Add ")).count() == 0


@pytest.mark.slow
def test_an_fmu_can_be_taken_away_and_is_valid(app, page, study, tmp_path):
    fmpy = pytest.importorskip("fmpy")
    address, _ = app(study)
    page.goto(address)
    tab(page, "Export")
    with page.expect_download(timeout=LONG) as waiting:
        page.get_by_role("button", name="Export FMU").click()
    name = waiting.value.suggested_filename
    waiting.value.save_as(tmp_path / name)
    from fmpy.validation import validate_fmu
    assert name.endswith("_fmi2.fmu") and validate_fmu(str(tmp_path / name)) == []
    assert fmpy.read_model_description(str(Path(tmp_path / name))).modelName


def test_every_button_is_reached_with_the_keyboard(app, page, study):
    address, _ = app(study)
    page.goto(address)
    charted(page)
    reached = set()
    for _ in range(30):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.innerText || document.activeElement.ariaLabel"))
    assert {"LIGHT OR DARK", "COMPARISON", "COMPARE"} <= {str(r).upper().strip() for r in reached}

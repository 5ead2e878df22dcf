"""Claims about the app in a browser: the loop of adding and undoing, refusals, mapping, and an FMU to take away."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

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
    add.click()
    page.get_by_text("study: + stribeck at 2A").wait_for(timeout=LONG)
    after = held_out(page)
    assert after < 0.6 * before
    tab(page, "Comparison")
    charted(page)
    assert page.get_by_text("+ stribeck at 2A").count() >= 2  # in the summary, and in the chart of two models
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


def test_a_log_without_a_study_is_mapped_by_its_names(app, page, study):
    address, _ = app()
    page.goto(address)
    page.locator("input[type=file]").set_input_files(study.parent / "run.csv")
    page.get_by_role("button", name="Use these columns").wait_for(timeout=LONG)
    page.get_by_role("button", name="Use these columns").click()
    page.locator("[data-held-out]").wait_for(timeout=LONG)
    assert held_out(page) > 0.1


def test_work_can_be_given_up_and_leaves_nothing(app, page, study):
    address, _ = app(study)
    page.goto(address)
    charted(page)
    tab(page, "Effects")
    page.get_by_role("button", name="Diagnose").click()
    page.get_by_role("button", name="Cancel").click(timeout=LONG)
    page.get_by_text("Given up; everything is as it was before.").wait_for(timeout=LONG)
    assert page.get_by_role("button", name=re.compile("^Add ")).count() == 0


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

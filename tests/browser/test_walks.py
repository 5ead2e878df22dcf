"""Claims about whole walks in the app, as a new user goes them: a wiring mistake is mended, rivals are told apart by a
planned experiment, what nothing explains ends as an effect of one's own, and a verdict as an FMU that a controller
moves."""

import importlib.util
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from test_app_page import LONG, charted, tab

from pycosim.study.parse import load_study

BARRIER = Path(__file__).parents[2] / "examples" / "barrier"


def example(name):
    """A script of the example as a module."""
    spec = importlib.util.spec_from_file_location(name, BARRIER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def barrier(tmp_path):
    """A study of the barrier with limits, and a log that leaves four effects open."""
    folder = tmp_path / "alike"
    folder.mkdir()
    shutil.copy(BARRIER / "Barrier.mo", folder)
    (folder / "study.toml").write_text((BARRIER / "study.toml").read_text() + (BARRIER / "limits.toml").read_text())
    log = example("make_log").record(np.random.default_rng(1), "alike")
    log.to_csv(folder / "monday.csv", index=False, float_format="%.7g")
    return folder


def diagnosed(page):
    """Diagnose, and wait for what it says."""
    first = page.locator("[data-first]")
    first.filter(has_text="First look, before any check or test: C errs by").wait_for(timeout=LONG)
    first.filter(has_text="viscous asymmetry at worm").wait_for()
    tab(page, "Effects")
    page.get_by_role("button", name="Diagnose").click()
    page.get_by_text("Missing: viscous_asymmetry at worm").wait_for(timeout=3 * LONG)


@pytest.mark.slow
def test_rivals_are_told_apart_by_the_experiment_that_the_app_plans(app, page, barrier, tmp_path):
    address, _ = app(barrier / "study.toml")
    page.goto(address)
    diagnosed(page)
    page.get_by_text("These data cannot tell it from direction_asymmetry at worm").first.wait_for(timeout=LONG)
    tab(page, "Plan")
    page.get_by_label("The experiment should").click()
    page.get_by_role("option", name="separate what the diagnosis could not").click()
    page.get_by_label("longest duration [s]").fill("60")
    page.get_by_role("button", name="Plan", exact=True).click()
    page.get_by_text("If viscous_asymmetry at worm is true, direction_asymmetry at worm").wait_for(timeout=3 * LONG)
    assert page.get_by_label("longest duration [s]").input_value() == "60"  # what was asked stays beside the answer
    with page.expect_download(timeout=LONG) as waiting:
        page.get_by_role("button", name="Take the motion (CSV)").click()
    waiting.value.save_as(tmp_path / "plan.csv")
    log = example("make_log").record(np.random.default_rng(2), "alike", tmp_path / "plan.csv")
    log.to_csv(tmp_path / "tuesday.csv", index=False, float_format="%.7g")
    tab(page, "Data")
    page.locator("input[type=file]").set_input_files(tmp_path / "tuesday.csv")  # the machine has moved as planned
    page.get_by_role("tab", name="Comparison", selected=True).wait_for(timeout=LONG)  # read and fitted
    diagnosed(page)
    assert page.get_by_text("These data cannot tell it from").count() == 0


def test_a_wiring_mistake_is_mended_where_the_columns_were_mapped(app, page, study, tmp_path):
    frame = pd.read_csv(study.parent / "run.csv").assign(tau1=lambda f: -f["tau1"])
    frame.to_csv(tmp_path / "wired.csv", index=False)
    address, _ = app()
    page.goto(address)
    page.locator("input[type=file]").set_input_files(tmp_path / "wired.csv")
    page.get_by_role("button", name="Use these columns").wait_for(timeout=LONG)
    page.get_by_text("Columns that state no unit are in SI units").click()
    page.get_by_role("button", name="Use these columns").click()
    told = page.locator("[data-check]").filter(has_text="Negate tau1")
    told.first.wait_for(timeout=LONG)
    tab(page, "Effects")
    page.get_by_role("button", name="Diagnose").click()
    page.get_by_role("alert").filter(has_text="tau1").wait_for(timeout=LONG)  # no physics is looked for
    tab(page, "Data")
    page.get_by_role("checkbox", name="motor1.tau is negated").click()
    page.get_by_role("button", name="Use these columns").click()
    told.first.wait_for(state="detached", timeout=LONG)
    charted(page)


@pytest.fixture
def rubbing(barrier):
    """The same study with a log of an effect that the library lacks."""
    log = example("make_log").record(np.random.default_rng(1), "unknown")
    log.to_csv(barrier / "monday.csv", index=False, float_format="%.7g")
    return barrier


def test_what_no_effect_explains_ends_as_an_effect_file_of_the_user_s_own(app, page, rubbing):
    address, folder = app(rubbing / "study.toml")
    page.goto(address)
    charted(page)  # nothing moves under a click any more
    tab(page, "Effects")
    page.get_by_role("button", name="Diagnose").click()
    page.get_by_text("Something is missing that no effect of the library explains").wait_for(timeout=3 * LONG)
    before = float(re.search(r"C ([\d.]+)", page.locator("[data-held-out]").inner_text()).group(1))
    page.get_by_text("A guess: 0.11 N.m more friction at worm, as a hump").wait_for()
    assert page.get_by_text("slower than noise and does not repeat").count() == 0  # it follows an angle, pass by pass
    page.get_by_text("The guess, as a Modelica file").click()
    page.get_by_text('model Guess "Friction of a shape guessed').wait_for()
    assert "extends DriveTrain.Interfaces.SegmentEffect" in (folder / "guess.mo").read_text()
    (rubbing / "Rub.mo").write_text((BARRIER / "Rub.mo").read_text().replace("(q - at)", "(q - att)"))
    path = page.get_by_label("Effect of your own: a Modelica file on this machine")
    path.fill(str(rubbing / "Rub.mo"))
    page.get_by_role("button", name="Use effect file").click()
    page.get_by_role("alert").filter(has_text="att").wait_for(timeout=LONG)  # a slip is told where the file was named
    shutil.copy(BARRIER / "Rub.mo", rubbing)
    page.get_by_role("button", name="Use effect file").click()
    page.get_by_text("Something is missing that no effect").wait_for(state="detached", timeout=LONG)
    tab(page, "Effects")
    page.get_by_role("button", name="Diagnose").click()
    page.get_by_text("Missing: rub at worm").wait_for(timeout=3 * LONG)
    page.get_by_role("button", name="Add rub at worm", exact=True).click()
    page.get_by_text("study: + rub at worm").wait_for(timeout=LONG)
    after = float(re.search(r"C ([\d.]+)", page.locator("[data-held-out]").inner_text()).group(1))
    assert after < 0.3 * before
    tab(page, "Export")
    page.get_by_role("button", name="Save study").click()
    page.get_by_text("Saved: ").wait_for(timeout=LONG)
    saved = load_study(folder / "study.toml")
    assert saved.effects == [("rub", "worm")] and rubbing / "Rub.mo" in saved.modelica


def test_a_verdict_becomes_an_fmu_that_a_controller_moves_better_than_before(app, page, barrier, tmp_path):
    pytest.importorskip("fmpy")
    from pycosim.cosim.master import cosimulate
    track = example("track")
    address, folder = app(barrier / "study.toml")
    page.goto(address)
    tab(page, "Report")
    page.get_by_role("button", name="Search and report").click()
    page.get_by_role("link", name="Open the report").wait_for(timeout=4 * LONG)
    tab(page, "Export")
    page.get_by_role("button", name="Save study").click()
    page.get_by_text("Saved: ").wait_for(timeout=LONG)
    with page.expect_download(timeout=2 * LONG) as waiting:
        page.get_by_role("button", name="Export FMU").click()
    waiting.value.save_as(tmp_path / "arm.fmu")
    time = np.linspace(0, 6, 601)
    motion = pd.DataFrame({"time": time, "motor.phi": 40 * (0.6 + 0.2 * time)})
    motion.to_csv(tmp_path / "plan.csv", index=False)
    errors = []
    for known in (barrier / "study.toml", folder / "study.toml"):
        scenario = tmp_path / "track.toml"
        scenario.write_text(track.SCENARIO.format(known=known.as_posix(), fmu="arm.fmu", start=24.0))
        log = cosimulate(scenario).log
        late = log["time"] > track.SETTLED
        errors.append(float(np.sqrt(np.mean((log["wanted"] - log["actual"])[late] ** 2))))
    assert errors[1] < 0.2 * errors[0]

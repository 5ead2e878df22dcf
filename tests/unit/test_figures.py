"""Claims about figures: axes say what they show and in which unit, no peak of a long log is lost, files are written."""

import os
import re
import time
from dataclasses import replace

import numpy as np
import pytest

from pycosim.cli import beside, demo
from pycosim.compile import Library, compile_model
from pycosim.core.executors import in_turn
from pycosim.data.dataset import Dataset
from pycosim.diagnosis import compare
from pycosim.diagnosis.dependence import noise_floor
from pycosim.fit import least_squares
from pycosim.fit.nullspace import number
from pycosim.project import Search, open_project
from pycosim.report import charts, drawings, figures, outcomes, records, sentences
from pycosim.report.values import PIXELS, envelope
from pycosim.study.parse import load_study


@pytest.fixture
def dataset(searched):
    """A short log of the demo's machine."""
    return searched[0]


@pytest.fixture
def improvement(searched):
    """The hidden effect added."""
    return searched[1]


def _all(dataset, improvement):
    steps = improvement.steps
    base, last = ((s.model, s.fit) for s in steps)
    floor = noise_floor(dataset, *base)
    plots = {
        "manoeuvres": drawings.manoeuvres(dataset), "over_time": drawings.timeline(
            dataset, [base, last], window=drawings.worst_window(dataset, *base)),
        "where_it_fails": drawings.where_it_fails(dataset, *base, floor),
        "residuals": drawings.residuals(dataset, *base, floor),
        "signature": drawings.signature(dataset, base, last, steps[1].added),
        "maps": drawings.first_maps(dataset, *base)[0],
        "intervals": outcomes.intervals(records.parameters(*reversed(last), 0)),
        "ladder": outcomes.ladder(dataset.units, steps, floor), "candidates": outcomes.candidates(improvement.first)}
    return {name: figures.figure(plot) for name, plot in plots.items()}


# axes of names and of ratios: no unit
NAMES = ("Manoeuvre", *(f"Branch of {place}" for place in ("1A", "2A", "1B", "2B")), "Run", "Model",
         "Candidate", "Parameter", "Log", "Sign of the speed", "Share of the interval's larger end")


@pytest.mark.long
def test_every_axis_has_a_label_with_a_unit_where_there_is_one_and_every_figure_a_title(dataset, improvement):
    for name, figure in _all(dataset, improvement).items():
        assert figure.get_size_inches()[0] <= figures.PAGE
        titles = [figure.get_suptitle(), *(legend.get_title().get_text() for legend in figure.legends)]
        assert max(map(len, titles)) > 10, name
        for axes in figure.axes:
            assert not axes.get_title(), name
            if axes.get_label() == "<colorbar>":
                assert re.search(r"\[.+\]$", axes.get_ylabel()), name
                continue
            bottom, left = axes.get_subplotspec().is_last_row(), axes.get_subplotspec().is_first_col()
            for text, needed in ((axes.get_xlabel(), bottom), (axes.get_ylabel(), left)):
                rows = [t.get_text() for t in axes.get_yticklabels()][-1:] == ["manoeuvre"]  # named one by one
                assert not needed or rows or text in NAMES or re.search(r"\[[^-1].*\]$", text), f"{name}: '{text}'"


@pytest.mark.long
def test_candidates_are_told_apart_by_what_they_leave_and_what_became_of_them(improvement):
    base, last = improvement.steps
    told = [replace(c, held_out_error=last.held_out_error) if c.accepted else c for c in improvement.first.candidates]
    figure = figures.figure(outcomes.candidates(replace(improvement.first, candidates=told),
                                                held_out=base.held_out_error))
    fates = [t.get_text() for t in figure.axes[0].texts]
    bars = {round(p.get_y() + p.get_height() / 2): p.get_width() for p in figure.axes[0].patches}
    assert fates[0] == "accepted" and "explained by stribeck at 2A" in fates
    assert len(bars) == len(fates) and bars[0] == min(bars.values()) < 70
    assert bars[0] == pytest.approx(100 * np.sqrt(np.mean([last.held_out_error[c] ** 2 / v ** 2
                                                           for c, v in base.held_out_error.items()])))


@pytest.mark.long
def test_curves_differ_without_colour(dataset, improvement):
    for name, figure in _all(dataset, improvement).items():
        for axes in figure.axes:
            named = [line for line in axes.get_lines() if not line.get_label().startswith("_")]
            looks = [(line.get_linestyle(), line.get_marker(), line.get_markerfacecolor() == "white",
                      line.get_linewidth()) for line in named if "floor" not in line.get_label()]
            assert len(set(looks)) == len(looks), f"{name}: {looks}"


@pytest.mark.long
def test_signature_shows_the_hidden_effect_against_its_speed(dataset, improvement):
    base, last = ((s.model, s.fit) for s in improvement.steps)
    figure = figures.figure(drawings.signature(dataset, base, last, improvement.steps[1].added))
    assert figure.axes[0].get_xlabel() == "Speed of 2A [rad/s]"
    lines = {line.get_label(): line for line in figure.axes[1].get_lines()}
    missing, left = (np.asarray(lines[k].get_ydata()) for k in ("without the effect", "with it"))
    speed = np.abs(lines["the fitted effect"].get_xdata())
    _, _, hidden = demo.HIDDEN
    truth = hidden["fs"] * np.exp(-(speed / hidden["ws"]) ** 2)
    assert np.abs(missing - truth).max() < 0.15 * hidden["fs"]
    assert np.abs(left).max() < 0.1 * hidden["fs"]


@pytest.mark.long
def test_still_lines_follow_from_the_motion(dataset):
    found = drawings.still_directions(dataset)
    for place, (x, y) in {"1A": (0, 1), "2A": (1, 0), "1B": (1, 1), "2B": (1, 1)}.items():
        assert abs(found[place][0] * y - found[place][1] * x) < 1e-3 * np.hypot(x, y)


def test_a_long_signal_keeps_its_peaks():
    time = np.linspace(0, 100, 200_000)
    values = np.sin(time)
    values[77_777], values[123_456], values[5:500] = 9.0, -9.0, np.nan
    t, v = envelope(time, values)
    assert len(t) == len(v) <= 2 * PIXELS and np.nanmax(v) == 9.0 and np.nanmin(v) == -9.0
    short = envelope(time[:100], values[:100])
    np.testing.assert_array_equal(short[1], values[:100])


@pytest.mark.long
def test_files_are_written_as_pdf_and_png(dataset, improvement, tmp_path):
    figures.write_figures(tmp_path, dataset, improvement)
    written = {p.name for p in (tmp_path / "figures").iterdir()}
    for name in ("manoeuvres", "over_time", "where_it_fails", "residuals", "signature", "ladder", "candidates"):
        assert {f"{name}.pdf", f"{name}.png"} <= written
    assert all(p.stat().st_size > 5000 for p in (tmp_path / "figures").iterdir())
    drawing = (tmp_path / "figures" / "drive_train.svg").read_text()
    base = improvement.steps[0]
    error = compare.errors(dataset, base.model, base.fit)
    assert all(f">{number(v)} N.m</text>" in drawing for v in error.values()) and len(error) == 2


@pytest.mark.long
@pytest.mark.parametrize("ends", [pytest.param(False, marks=[pytest.mark.long, pytest.mark.slow]), True])
def test_figures_of_another_process_are_the_same_also_when_it_ends(dataset, improvement, tmp_path, monkeypatch, ends):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    steps = [(s.model, s.fit) for s in improvement.steps]
    plots = [drawings.manoeuvres(dataset), *(drawings.first_maps(dataset, *step)[0] for step in steps)]
    with beside.Beside(dataset.library) as second:
        for k, plot in enumerate(plots):
            second.save(plot, tmp_path / "there", f"plot{k}")
        for process in [*second.pool._processes.values()] if ends else ():
            process.kill()
        second.begin()
        second.finish()
    for k, plot in enumerate(plots):
        figures.save(plot, tmp_path / "here", f"plot{k}")
    here, there = ({p.name: p.read_bytes() for p in (tmp_path / w).iterdir()} for w in ("here", "there"))
    assert here == there and len(here) == 6


@pytest.mark.long
@pytest.mark.parametrize("kept_once", [False, True])
def test_a_second_core_takes_fits_unless_the_data_are_large_or_others_have_it(kept_once, dataset, monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    for large, within in ((0, None), (len(dataset.time), object())) if kept_once else ((len(dataset.time), None),):
        monkeypatch.setattr(beside, "LARGEST", large)
        monkeypatch.setattr("multiprocessing.parent_process", lambda within=within: within)
        with beside.Beside(dataset.library) as second, second.fits(dataset):
            second.pool.submit(len, "").result()  # it has come up
            took = set(in_turn((_slowly, k) for k in range(4)))
            assert (took == {os.getpid()}) == kept_once


def _slowly(number):
    time.sleep(0.1)
    return os.getpid()


@pytest.mark.long
def test_what_the_second_core_compiles_ahead_is_found_on_disk(tmp_path, monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setenv("PYCOSIM_CACHE", str(tmp_path))
    library, rig, attached = Library(), "DriveTrain.Rigs.GearedJoint", [("viscous", "gear")]
    with beside.Beside(library) as second:
        library.ahead(rig, [attached])
        second.pool.submit(len, "").result()  # one process, one after the other
    kept = {p.name for p in tmp_path.iterdir()}
    compile_model(library, rig, attached).question("estimate")
    assert {p.name for p in tmp_path.iterdir()} == kept and len(kept) > 2
    library.ahead(rig, [attached])  # nobody listens any more


@pytest.mark.long
def test_the_demo_tells_what_was_found_and_what_was_hidden(dataset, improvement):
    said = []
    demo._tell(Search(open_project(dataset.study), improvement), lambda *lines: said.extend(lines))
    effect, place, _ = demo.HIDDEN
    told = "\n".join(said)
    assert f"Missing: {effect} at {place}" in told and f"Hidden was: {effect} at {place}" in told


@pytest.mark.long
def test_the_map_of_what_no_effect_explains_tells_energy_and_sign(dataset):
    left = {"channel": "C_H", "map": {"x": "theta1", "y": "theta2", "x_edges": [0, 1, 2], "y_edges": [0, 1, 2],
                                      "mean": [[0.1, np.nan], [-0.2, 0.0]], "energy": [[0.5, 0.0], [0.49, 0.01]]}}
    plot = drawings.unexplained(dataset, left)
    assert [t.get_text() for t in figures.figure(plot).axes[0].texts] == ["+50", "", "-49", ""]
    chart = charts.chart(plot)
    assert chart.traces[0]["text"] == [["+50", ""], ["-49", ""]] and "energy in percent" in chart.caption
    assert drawings.unexplained(dataset, {**left, "map": None}) is None


def test_where_every_run_is_one_sample_no_noise_floor_is_drawn_or_told(tmp_path):
    for k, speed in enumerate((-8.0, -4.0, -2.0, 2.0, 4.0, 8.0)):
        torque = np.sign(speed) * 3e-3 + 5e-5 * speed + 1e-4
        rows = [f"{t:g},{speed:g},{torque:.6g}" for t in np.arange(10) / 100]
        (tmp_path / f"{k}.csv").write_text("\n".join(["time,velocity,torque", *rows]) + "\n")
    (tmp_path / "study.toml").write_text(
        '[rig]\nmodel = "DriveTrain.Rigs.ScrewDrive"\n[parameters]\n"screw.f0" = { fixed = false }\n'
        '[data]\nruns = ["*.csv"]\nheld_out = ["1.csv"]\naverage = "file"\n[columns]\n'
        'velocity = { variable = "motor.w", unit = "rad/s" }\ntorque = { variable = "tau", unit = "N.m" }\n')
    means = Dataset(load_study(tmp_path / "study.toml"), Library())
    fit = least_squares.fit(means, means.base)
    floor = noise_floor(means, means.base, fit)
    assert np.isnan(floor["tau"]) and sentences.errors_text(floor, means.units) == "unknown"
    figures.write_comparison(tmp_path, means, means.base, fit)
    bars = figures.figure(drawings.where_it_fails(means, means.base, fit, floor))
    assert [t.get_text() for t in bars.axes[0].get_xticklabels()] == ["screw\nspeed < 0", "screw\nspeed > 0"]
    assert not bars.axes[0].get_lines() and "means held out" in sentences.summary_data(means)[0]


def test_the_two_main_colours_differ_in_grey():
    def lightness(colour):
        channels = [int(colour[k:k + 2], 16) / 255 for k in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
        return 116 * np.dot(linear, (0.2126, 0.7152, 0.0722)) ** (1 / 3) - 16
    assert abs(lightness(figures.INKS["before"]) - lightness(figures.INKS["after"])) > 20


@pytest.mark.long
def test_drawing_leaves_the_users_settings_alone(dataset):
    import matplotlib as mpl
    before = dict(mpl.rcParams)
    figures.figure(drawings.manoeuvres(dataset))
    assert dict(mpl.rcParams) == before


@pytest.mark.long
def test_a_log_without_reference_or_labels_is_drawn_too(dataset, tmp_path):
    import pandas as pd
    log = pd.read_csv(dataset.logs[0].path).drop(columns=["C_H", "C_K", "manoeuvre"])
    log.to_csv(tmp_path / "run.csv", index=False)
    text = dataset.study.path.read_text().replace('"gravity_model"', '"unknown"')
    (tmp_path / "study.toml").write_text(text)
    other = Dataset(load_study(tmp_path / "study.toml"), dataset.library)
    assert other.paired
    figures.write_comparison(tmp_path, other, other.base, least_squares.fit(other, other.base))
    assert (tmp_path / "figures" / "residuals.pdf").exists()

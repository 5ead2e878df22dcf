"""Claims about the report: one file that asks no server, every section, honest thinning, words that are not markup."""

import base64
import gzip
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest

from pycosim.cli import demo
from pycosim.compile import Library, compile_model
from pycosim.data.dataset import Dataset
from pycosim.diagnosis.decide import diagnose
from pycosim.diagnosis.search import Improvement, step_of
from pycosim.fit import least_squares
from pycosim.report import charts, values
from pycosim.report.folder import Folder
from pycosim.report.page import SECTIONS, Page, write_numbers, write_report
from pycosim.study.parse import load_study


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """A short log of the demo's machine, its search, and the page."""
    library = Library()
    with Folder(tmp_path_factory.mktemp("report") / "study", "demo") as folder:
        demo._make(library, folder, speeds=(0.4, 1.6), longest=2.0)
    dataset = Dataset(load_study(folder.path / "study.toml"), library)
    base = least_squares.fit(dataset, dataset.base)
    first = diagnose(dataset, dataset.base, base)
    winner = first.winner
    larger = compile_model(library, dataset.study.rig, [winner.key])
    steps = [step_of(dataset, dataset.base, base), step_of(dataset, larger, winner.fit, winner)]
    improvement = Improvement(first, first, steps)
    path = folder.path / "report.html"
    return dataset, improvement, path, write_report(path, dataset, improvement, "pycosim report study.toml")


class _Reader(HTMLParser):
    """Tags, ids and addresses of a page."""

    def __init__(self, text):
        super().__init__()
        self.ids, self.addresses, self.pictures = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.ids.append(attributes.get("id"))
        self.addresses += [attributes[k] for k in ("href", "src", "action") if k in attributes]
        if attributes.get("role") == "img":
            self.pictures.append(attributes)


def payload(text):
    packed = re.search(r'id="payload">([^<]+)<', text).group(1)
    return json.loads(gzip.decompress(base64.b64decode(packed)))


def test_one_file_with_every_section_that_asks_no_server(found):
    text = found[2].read_text()
    page = _Reader(text)
    assert {name for name, _ in SECTIONS} <= set(page.ids)
    assert all(a.startswith("#") for a in page.addresses)
    assert "default-src 'none'" in text and len(text) < 8e6


def test_every_chart_has_words_that_stand_for_it_and_a_place(found):
    _, _, path, drawn = found
    page = _Reader(path.read_text())
    told = payload(path.read_text())
    assert {c["id"] for c in told["charts"]} == {c.id for c in drawn} <= set(page.ids)
    assert len({c.id for c in drawn}) == len(drawn) == len(page.pictures)
    assert all(len(p["aria-label"]) > 30 for p in page.pictures)
    assert all(c["traces"] for c in told["charts"])


def test_the_error_that_is_shown_to_fall_is_the_ladders(found):
    dataset, improvement, _, drawn = found
    ladder = next(c for c in drawn if c.id == "ladder")
    shown = next(t["y"] for t in ladder.traces if t["name"] == "C_H held-out passes")
    assert shown == [s.held_out_error["C_H"] for s in improvement.steps] and shown[1] < 0.6 * shown[0]


def test_signature_follows_the_hidden_effect(found):
    dataset, improvement, _, _ = found
    before, after = ((s.model, s.fit) for s in improvement.steps)
    chart = charts.signature(dataset, before, after, improvement.steps[1].added)
    line = next(t for t in chart.traces if t["name"] == "the fitted effect")
    hidden = demo.HIDDEN[2]
    truth = hidden["fs"] * np.exp(-(line["x"] / hidden["ws"]) ** 2)
    assert np.abs(line["y"] - truth).max() < 0.1 * hidden["fs"]


def test_energy_of_a_map_is_whole_and_its_half_is_where_the_error_is():
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 1, (2, 20000))
    r = np.where((x > 0.75) & (y > 0.75), 1.0, 0.01)[None]
    found = values.residual_map(x, y, r)
    assert np.nansum(found["energy"]) == pytest.approx(1) and found["samples"].sum() == pytest.approx(1)
    assert values.half_energy(found["energy"][0], found["samples"]) < 0.05
    even = values.residual_map(x, y, np.ones_like(r))
    assert values.half_energy(even["energy"][0], even["samples"]) == pytest.approx(0.5, abs=0.02)


def test_a_long_signal_keeps_its_extremes_in_the_page(found, monkeypatch):
    dataset, improvement, _, _ = found
    monkeypatch.setattr(charts, "BUCKETS", 500)
    step = improvement.steps[0]
    chart = charts.timeline(dataset, [(step.model, step.fit)])
    for channel in dataset.channels:
        residual = values.residual_over_time(dataset, step.model, step.fit)[channel]
        y = f"y{3 + 2 * dataset.channels.index(channel) + 1}"
        shown = next(t["y"] for t in chart.traces if t.get("yaxis") == y)
        assert len(shown) <= 1000 < len(residual)
        assert np.nanmax(shown) == pytest.approx(np.nanmax(residual)) and np.nanmin(shown) == pytest.approx(
            np.nanmin(residual))


def test_runs_stand_one_after_the_other(found):
    dataset = found[0]
    twice = Dataset(dataset.study, dataset.library, [dataset.logs[0], replace(dataset.logs[0], name="again")])
    time = values.clock(twice)
    assert (np.diff(time) > 0).all() and time[0] == 0


def test_names_of_the_user_are_words_not_markup(found):
    dataset, improvement, _, _ = found
    logs = [replace(dataset.logs[0], name="<script>alert(1)</script>")]
    text = Page(Dataset(dataset.study, dataset.library, logs), improvement, "x").html()
    assert "<script>alert(1)" not in text and "&lt;script&gt;alert(1)" in text


def test_new_keys_of_a_diagnosis_are_shown(found):
    dataset, improvement, _, _ = found
    page = Page(dataset, improvement, "x")
    page.first["candidates"][0] |= {"sentence": "It sticks when slow.", "predicted_fall": {"C_H": 0.5},
                                    "realised_fall": {"C_H": 0.49}, "experiment": "creep along the line"}
    page.first["excitation"] = [{"variable": "speed@1A", "min": -1, "max": 1, "levels": 7, "unit": "rad/s"}]
    page.last["smallest_detectable"] = [{"effect": "viscous", "place": "1B", "coefficient": "b", "value": 0.0123,
                                         "unit": "N.m.s/rad", "error_share": 0.03}]
    page.last["unexplained"] = {"share": 0.37, "map": None, "proposal": {"text": "a bump near 1 rad"}}
    text = page.html()
    for words in ("It sticks when slow.", "C_H 50 %", "C_H 49 %", "creep along the line", "<td>7</td>", "b = 0.0123",
                  "37 % of the residual", "a bump near 1 rad"):
        assert words in text, words


def test_numbers_of_the_charts_are_files(found, tmp_path):
    write_numbers(tmp_path / "data", found[3])
    assert {p.stem for p in (tmp_path / "data").iterdir()} == {c.id for c in found[3]}
    ladder = pd.read_csv(tmp_path / "data" / "ladder.csv")
    assert ladder["C_H fitted passes: y"].tolist() == [s.error["C_H"] for s in found[1].steps]


def test_inks_are_readable_on_their_paper():
    def light(hex_):
        rgb = [int(hex_[k:k + 2], 16) / 255 for k in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in rgb]
        return np.dot(linear, [0.2126, 0.7152, 0.0722])
    for theme in charts.THEMES.values():
        for name in ("@ink", "@muted", "@before", "@after", "@third"):
            a, b = sorted((light(theme[name]), light(theme["@paper"])))
            assert (b + 0.05) / (a + 0.05) >= 4.5, name


def test_curves_differ_without_colour(found):
    for chart in found[3]:
        looks = [(t["type"], t.get("mode"), (t.get("line") or {}).get("dash"), (t.get("line") or {}).get("width"),
                  str((t.get("marker") or {}).get("symbol")), str((t.get("marker") or {}).get("pattern")))
                 for t in chart.traces if t.get("showlegend", True) and t["type"] != "heatmap" and chart.id != "plane"]
        assert len(set(looks)) == len(looks), chart.id

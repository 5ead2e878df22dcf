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
from pycosim.data.checks.finding import Checked, Finding
from pycosim.data.dataset import Dataset
from pycosim.diagnosis.search import Improvement
from pycosim.fit.nullspace import number
from pycosim.report import charts, consequence, controller, drawings, sentences, values
from pycosim.report.page import SECTIONS, Page, write_numbers, write_report


@pytest.fixture(scope="module")
def found(searched, tmp_path_factory):
    """A short log of the demo's machine, its search, and the page."""
    path = tmp_path_factory.mktemp("report") / "report.html"
    return *searched, path, write_report(path, *searched, "pycosim report study.toml")


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
        if attributes.get("role") == "img" or attributes.get("class") == "plot":
            self.pictures.append(attributes)


def payload(text):
    packed = re.search(r'id="payload">([^<]+)<', text).group(1)
    return json.loads(gzip.decompress(base64.b64decode(packed)))


@pytest.mark.long
def test_one_file_with_every_section_that_asks_no_server(found):
    text = found[2].read_text()
    page = _Reader(text)
    assert {name for name, _ in SECTIONS} <= set(page.ids)
    assert all(a.startswith("#") for a in page.addresses)
    assert "default-src 'none'" in text and len(text) < 3e6
    assert text.index('id="answer"') < text.index("<svg") < text.index("<script")  # words and drawing wait for nothing


@pytest.mark.long
def test_every_chart_has_words_that_stand_for_it_and_a_place(found):
    _, _, path, drawn = found
    page = _Reader(path.read_text())
    told = payload(path.read_text())
    assert {c["id"] for c in told["charts"]} == {c.id for c in drawn} <= set(page.ids)
    drawings = [p for p in page.pictures if p.get("class", "").startswith("drive")]
    assert len({c.id for c in drawn}) == len(drawn) == len(page.pictures) - len(drawings) and len(drawings) == 2
    assert all(len(p["aria-label"]) > 30 for p in page.pictures)
    assert all(c["traces"] for c in told["charts"])


@pytest.mark.long
def test_the_error_that_is_shown_to_fall_is_the_ladders(found):
    dataset, improvement, _, drawn = found
    ladder = next(c for c in drawn if c.id == "ladder")
    shown = next(t["y"] for t in ladder.traces if t["name"] == "C_H held-out passes")
    assert shown == [s.held_out_error["C_H"] for s in improvement.steps] and shown[1] < 0.6 * shown[0]


@pytest.mark.long
def test_signature_follows_the_hidden_effect(found):
    dataset, improvement, _, _ = found
    before, after = ((s.model, s.fit) for s in improvement.steps)
    chart = charts.chart(drawings.signature(dataset, before, after, improvement.steps[1].added))
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


@pytest.mark.long
def test_a_long_signal_keeps_its_extremes_in_the_page(found, monkeypatch):
    dataset, improvement, _, _ = found
    monkeypatch.setattr(charts, "BUCKETS", 500)
    step = improvement.steps[0]
    chart = charts.chart(drawings.timeline(dataset, [(step.model, step.fit)]))
    for channel in dataset.channels:
        residual = values.residual_over_time(dataset, step.model, step.fit)[channel]
        y = f"y{3 + 2 * dataset.channels.index(channel) + 1}"
        shown = next(t["y"] for t in chart.traces if t.get("yaxis") == y)
        assert len(shown) <= 1000 < len(residual)
        assert np.nanmax(shown) == pytest.approx(np.nanmax(residual)) and np.nanmin(shown) == pytest.approx(
            np.nanmin(residual))


@pytest.mark.long
def test_the_page_of_forty_thousand_samples_weighs_less_than_three_megabytes(found):
    dataset, improvement, _, _ = found
    log, n = dataset.logs[0], -(-40_000 // len(dataset.time))
    rng = np.random.default_rng(0)  # noise packs worst
    logs = [replace(log, name=f"run {k}", signals={v: x + 1e-3 * np.std(x) * rng.standard_normal(len(x))
                                                   for v, x in log.signals.items()}) for k in range(n)]
    many = Dataset(dataset.study, dataset.library, logs)
    assert len(many.time) >= 40_000
    assert len(Page(many, improvement, "x").html()) < 3e6


@pytest.mark.long
def test_runs_stand_one_after_the_other(found):
    dataset = found[0]
    twice = Dataset(dataset.study, dataset.library, [dataset.logs[0], replace(dataset.logs[0], name="again")])
    time = values.clock(twice)
    assert (np.diff(time) > 0).all() and time[0] == 0


@pytest.mark.long
def test_names_of_the_user_are_words_not_markup(found):
    dataset, improvement, _, _ = found
    logs = [replace(dataset.logs[0], name="<script>alert(1)</script>")]
    text = Page(Dataset(dataset.study, dataset.library, logs), improvement, "x").html()
    assert "<script>alert(1)" not in text and "&lt;script&gt;alert(1)" in text


@pytest.mark.long
def test_new_keys_of_a_diagnosis_are_shown(found):
    dataset, improvement, _, _ = found
    page = Page(dataset, improvement, "x")
    page.first["excitation"] = [{"variable": "speed@1A", "min": -1, "max": 1, "levels": 7, "unit": "rad/s"}]
    page.last["smallest_detectable"] = [{"effect": "viscous", "place": "1B", "coefficient": "b", "value": 0.0123,
                                         "unit": "N.m.s/rad", "error_share": 0.03}]
    page.last["unexplained"] = {"share": 0.37, "map": None, "proposal": {"text": "a bump near 1 rad"}}
    text = page.html()
    for words in ("<td>7</td>", "b = 0.0123", "37 % of the residual", "a bump near 1 rad"):
        assert words in text, words


# --- the verdict


def rows(page):
    """Rows of a page's verdict: heading to words."""
    return {name: " ".join(lines) for name, lines, _ in page.verdict.card()["rows"]}


def numbers_of(page, heading):
    """Table of a row of the verdict: what it is about to the cells beside it."""
    table = next(t for name, _, t in page.verdict.card()["rows"] if name == heading)
    return {what: cells for what, *cells in table["rows"]}


@pytest.mark.long
def test_the_verdict_says_what_where_how_large_how_sure_and_what_comes_next(found):
    dataset, improvement, path, _ = found
    page = Page(dataset, improvement, "x")
    told = rows(page)
    assert page.verdict.title() == "The model lacks stribeck at 2A"
    assert list(told) == ["What is missing", "How large", "How sure", "Error before and after",
                          "What else it could be", "What it changes", "What is left", "Next experiment"]
    assert "At 2A: loss that falls" in told["What is missing"] and "fs = 0.0" in told["What is missing"]
    assert "among all" in told["How sure"] and "p ≤ 0.001" in told["How sure"]
    changes = numbers_of(page, "What it changes")
    before, after, change = next(cells for what, cells in changes.items() if what.startswith("tracking error of q_H"))
    assert float(after) < 0.1 * float(before) and change.startswith("\u2212") and "mrad" in " ".join(changes)
    assert any(what.startswith("tau2 left to the feedback") for what in changes)
    assert any(what.startswith("heat") for what in changes)
    assert "with the improved model as the machine" in told["What it changes"]
    text = path.read_text()
    assert text.index("The model lacks stribeck at 2A") < text.index("<nav") < text.index('id="checked"')


@pytest.mark.long
def test_the_verdict_says_each_thing_once(found):
    card = Page(*found[:2], "x").verdict.card()
    said = [line for _, lines, _ in card["rows"] for line in lines]
    assert len(set(said)) == len(said)
    numbers = [n for line in said for n in re.findall(r"\d+\.\d{3,}", line)]
    assert len(set(numbers)) == len(numbers)


@pytest.mark.long
def test_the_size_of_an_effect_is_the_hidden_ones_largest_torque_of_the_motors(found):
    dataset, improvement, _, _ = found
    before, after = ((s.model, s.fit) for s in improvement.steps)
    told = consequence.size(dataset, before, after, improvement.steps[1].added)
    slowest = np.abs(dataset.speeds[list(dataset.base.segments).index("s2A")][dataset.moving]).min()
    hidden = demo.HIDDEN[2]
    assert told["value"] == pytest.approx(hidden["fs"] * np.exp(-(slowest / hidden["ws"]) ** 2), rel=0.15)
    assert told["unit"] == "N.m" and told["of"] == "the largest tau2 in the log"
    assert told["share"] == pytest.approx(told["value"] / np.abs(dataset.measured["motor2.tau"]).max())


@pytest.mark.long
def test_what_is_rated_is_the_studys_limit_where_it_has_one(found):
    dataset, improvement, _, _ = found
    limited = Dataset(replace(dataset.study, limits={"motor2.tau": (None, 20.0)}), dataset.library, dataset.logs)
    assert consequence.rated(limited, "motor2.tau") == (20.0, "what [limits] allow motor2.tau")
    assert consequence.rated(limited, "nothing.tau") is None


@pytest.mark.long
def test_a_controllers_feedforward_is_better_with_the_effect(found):
    dataset, improvement, _, _ = found
    told = controller.feedforward(dataset, *((s.model, s.fit) for s in improvement.steps))["motor2.tau"]
    assert told["error"][1] < 0.8 * told["error"][0] and abs(told["heat"][1]) < abs(told["heat"][0])
    same = [(s.model, s.fit) for s in (improvement.steps[0], improvement.steps[0])]
    assert controller.feedforward(dataset, *same) == {}


@pytest.mark.long
def test_a_simulated_controller_tracks_better_with_the_effect_and_says_where_it_cannot_be(found):
    dataset, improvement, _, _ = found
    first, last = ((s.model, s.fit) for s in improvement.steps)
    told = controller.closed_loop(dataset, first, last)
    for e in told["tracking_error"].values():
        assert e["rms"][1] < 0.1 * e["rms"][0] < 0.1 * e["largest"][0]
    assert told["to"] - told["from"] <= controller.STRETCH and set(told["gains"]) == {"motor1", "motor2"}
    for h in told["heat"].values():  # the motors give what the motion needs, whatever was worked out ahead
        assert h["given"][0] == pytest.approx(h["given"][1], rel=0.05) and h["given"][1] > 0
    same = controller.changes(dataset, first, first)
    assert same["closed_loop"] is None and same["why_not"] == "nothing was added"


@pytest.mark.long
def test_findings_of_the_data_check_come_first_and_their_mend_once(found):
    dataset, improvement, _, _ = found
    one = Finding("outliers", "7 samples of C_H are off", ["C_H"], 0.99, mend="[fit]\nrobust = true")
    two = replace(one, columns=["C_K"], text="9 samples of C_K are off")
    wrong = replace(one, kind="sign", text="<b>tau1</b> has the wrong sign", mend="sign = -1")
    page = Page(dataset, improvement, "x", Checked([one, two, wrong]))
    shown = page.verdict.card()["findings"]
    assert [mend for *_, mend in shown].count("[fit] robust = true") == 1 and shown[0][0]
    text = page.html()
    assert text.index("7 samples of C_H") < text.index("The model lacks") and "<b>tau1" not in text


@pytest.mark.long
def test_a_search_that_added_nothing_says_so_and_what_it_could_not_see(found):
    dataset, improvement, _, _ = found
    nothing = replace(improvement.first, verdict="nothing_missing", candidates=[
        replace(c, accepted=False, p_value=0.4) for c in improvement.first.candidates])
    page = Page(dataset, Improvement(nothing, nothing, improvement.steps[:1]), "x")
    told = rows(page)
    assert page.verdict.title() == "Nothing is missing that these data could show"
    assert "the likeliest is" in told["How sure"] and "p = 0.4" in told["How sure"] and "What it changes" not in told
    assert told["Next experiment"] and "stroke-width=\"3.5\"" not in page.html()


@pytest.mark.long
def test_an_unexplained_residual_asks_for_what_it_depends_on(found):
    dataset, improvement, _, _ = found
    left = replace(improvement.first, verdict="unexplained", unexplained=None, candidates=[
        replace(c, accepted=False, refused="it fits by chance") for c in improvement.first.candidates])
    page = Page(dataset, Improvement(left, left, improvement.steps[:1]), "x")
    assert "no effect of the library explains" in page.verdict.title()
    assert "speed of 2A" in rows(page)["What is missing"] and "speed of 2A" in rows(page)["Next experiment"]
    assert "refused: it fits by chance" in page.html()
    sure = rows(page)["How sure"]
    worst = max((c for c in left.channels.values()), key=lambda c: c["error"] / c["floor"])
    assert "in at most one log of 1000" in sure and "is missing; that it is one of these is refused" in sure
    assert f"{number(worst['error'] / worst['floor'])} times its noise floor" in sure
    assert all(line in sentences.summary_diagnosis(page.first)
               for line in sentences.certainty_of_unknown(page.first))
    page.verdict.first["unexplained"] = {"proposal": {"text": "A guess: a hump.", "place": "2A"}}
    told = page.verdict.card()
    assert ">a guess</text>" in told["drawing"] and "stroke-width=\"3.5\"" not in told["drawing"]


@pytest.mark.long
def test_a_beat_is_what_the_page_tells_first_and_asks_for(found):
    dataset, improvement, _, _ = found
    channel = next(iter(improvement.first.channels))
    own = {**improvement.first.channels[channel], "beat": {"frequency": 3.37, "share": 0.66}}
    left = replace(improvement.first, verdict="unexplained", unexplained=None,
                   channels={**improvement.first.channels, channel: own},
                   candidates=[replace(c, accepted=False) for c in improvement.first.candidates])
    told = rows(Page(dataset, Improvement(left, left, improvement.steps[:1]), "x"))
    assert f"{channel} at 3.37 Hz (66 % of the squared error)" in told["What is missing"]
    assert f"Record {channel} while nothing moves" in told["Next experiment"]
    assert "at several values" not in told["Next experiment"]


@pytest.mark.parametrize(("channel", "said"), [
    ({"depends_on": [{"variable": "speed@2A", "strength": 0.3}], "slow": False},
     "Very likely: what is left of C_H depends on speed of 2A also in parts of the log that this was not fitted to, by "
     "more than 4 standard errors or more than chance does in one log of 100."),
    ({"depends_on": [], "slow": True}, "Likely: the error is more than 1.4 times the noise floor, which no simulated "
                                       "machine with nothing hidden reached.")])
def test_an_unknown_that_no_candidate_tells_is_as_sure_as_the_test_that_found_it(channel, said):
    result = {"candidates": [{"p_value": 0.3}], "residual_depends_on": [{"variable": "time", "strength": 0.1}],
              "channels": {"C_H": {"verdict": "unexplained", "error": 2.0, "floor": 1.0, **channel},
                           "C_K": {"verdict": "nothing_missing", "error": 3.0, "floor": 1.0, "depends_on": []}}}
    assert sentences.certainty_of_unknown(result) == [
        said, "The error of C_H is 2 times its noise floor (75 % of its energy is not noise)."]


def test_held_out_passes_that_are_far_off_are_not_told_as_a_drift():
    own = {"verdict": "unexplained", "error": 0.1, "floor": 0.1, "slow": True, "depends_on": [], "held_out_error": 2.0}
    result = {"verdict": "unexplained", "candidates": [{"p_value": 0.3, "twins": []}], "residual_depends_on": [],
              "channels": {"C_H": own}, "error": {"C_H": 0.1}, "noise_floor": {"C_H": 0.1}, "units": {"C_H": "N.m"},
              "unexplained": None, "undetectable": [], "smallest_detectable": []}
    told = " ".join(sentences.summary_diagnosis(result))
    assert "Held-out passes are off by far more than the fitted ones (C_H 2 instead of 0.1)" in told
    assert "Very likely: held-out passes are off by more than 3 times" in told and "drifts" not in told
    own["held_out_error"] = 0.15
    told = " ".join(sentences.summary_diagnosis(result))
    assert "a reference that drifts" in told and "Held-out" not in told


@pytest.mark.long
def test_what_the_data_cannot_tell_apart_is_said_marked_and_asked_for(found):
    dataset, improvement, _, _ = found
    twins = [{"effect": "torque_offset", "place": "motor2"}]
    step = replace(improvement.steps[1], finding=replace(improvement.steps[1].finding, twins=twins))
    page = Page(dataset, Improvement(improvement.first, improvement.last, [improvement.steps[0], step]), "x")
    told = rows(page)
    assert told["What else it could be"] == "These data cannot tell stribeck at 2A from torque offset at motor2."
    assert "tells stribeck at 2A from torque offset at motor2" in told["Next experiment"]
    assert told["Next experiment"].count("; ") == 0  # one, not a list of them
    assert "stays open" in told["How sure"]
    assert page.verdict.title() == "The model lacks stribeck at 2A or torque offset at motor2"
    assert ">or torque offset</text>" in page.verdict.card()["drawing"]


@pytest.mark.long
def test_rivals_are_explained_once_the_winner_is_in(found):
    dataset, improvement, _, _ = found
    page = Page(dataset, improvement, "x")
    explained = [c for c in page.first["candidates"] if c["explained_by"] and c["refitted"]]
    assert explained
    assert page._fate(explained[0]) == "explained by stribeck at 2A"
    text = page.html()
    assert "explained by stribeck at 2A</span>" in text and "beside stribeck at 2A nothing is left" in text


@pytest.mark.long
def test_charts_open_on_what_is_to_blame(found):
    dataset, improvement, _, _ = found
    page = Page(dataset, improvement, "x")
    variable, channel = page._blamed()
    assert variable == "speed@2A"
    where = page._where()
    assert all("speed@2A" in where[k][0].over and where[k][0].channel == channel for k in ("maps", "profiles"))
    assert where["groups"][0].over == ("branch of 2A",)


@pytest.mark.long
def test_what_to_measure_next_is_ranked_and_short(found):
    page = Page(*found[:2], "x")
    told = page._next()
    assert 1 <= len(told["ranked"]) <= 5 and told["ranked"][0] == rows(page)["Next experiment"]


@pytest.mark.long
def test_no_words_of_the_workshop_are_shown(found):
    text = re.sub(r"<(script|style)[^>]*>.*?</\1>", "", found[2].read_text(), flags=re.S)
    shown = re.sub(r"<pre.*?</pre>|<[^>]+>", " ", text, flags=re.S)
    assert not re.search(r"\b(twins?|ladder|surprisal)\b|\[(-|1)\]", shown)


def test_a_packed_signal_is_the_signal_to_what_a_screen_can_show():
    rng = np.random.default_rng(0)
    signal = np.r_[rng.normal(3.0, 2.0, 5000), np.nan]
    told = charts.packed(signal)
    steps = np.frombuffer(base64.b64decode(told["steps"]), "<i2")
    back = np.where(steps == -2 ** 15, np.nan, told["low"] + told["step"] * steps)
    assert np.isnan(back[-1]) and np.nanmax(np.abs(back - signal)) <= 0.5001 * np.nanmax(np.ptp(signal[:-1])) / 65533
    time = np.cumsum(np.r_[0.0, np.full(100_000, 1e-3)])
    told = charts.packed(time, True)
    back = told["low"] + told["step"] * np.cumsum(np.frombuffer(base64.b64decode(told["steps"]), "<i4"), dtype=float)
    assert np.abs(back - time).max() < 1e-6


@pytest.mark.long
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


@pytest.mark.long
def test_curves_differ_without_colour(found):
    for chart in found[3]:
        looks = [(t["type"], t.get("mode"), (t.get("line") or {}).get("dash"), (t.get("line") or {}).get("width"),
                  str((t.get("marker") or {}).get("symbol")), str((t.get("marker") or {}).get("pattern")))
                 for t in chart.traces if t.get("showlegend", True) and t["type"] != "heatmap" and chart.id != "plane"]
        assert len(set(looks)) == len(looks), chart.id


def test_a_candidate_that_chance_does_not_explain_and_that_is_none_says_why():
    best = {"effect": "stribeck", "place": "2A", "p_value": 0.001, "refused": "too small to matter", "twins": []}
    result = {"candidates": [best], "error": {"C": 1.0}, "noise_floor": {"C": 1.0}, "units": {"C": "N.m"},
              "verdict": "nothing_missing", "undetectable": [], "smallest_detectable": [], "channels": {}}
    assert "p = 0.001 family-wise, but it is refused: too small to matter." in sentences.summary_diagnosis(result)[0]
    best.update(p_value=0.4, refused="no more than chance")
    assert "p = 0.4 family-wise." in sentences.summary_diagnosis(result)[0]


def test_a_small_error_of_the_load_is_told_as_one_with_what_rules_it_out():
    mass = {"effect": "reference_mass", "place": "thigh", "small": True}
    best = {"effect": "torque_offset", "place": "motor1", "p_value": 0.001, "contested": True, "experiment": "",
            "predicted_error": {"C": 0.9}, "twins": [{"effect": "direction_asymmetry", "place": "1A"}],
            "together": [[mass, {"effect": "torque_offset", "place": "motor2"}]]}
    result = {"candidates": [best], "error": {"C": 1.0}, "noise_floor": {"C": 0.8}, "units": {"C": "N.m"},
              "verdict": "unexplained", "undetectable": [], "smallest_detectable": [], "channels": {},
              "residual_depends_on": [], "between": False}
    told = " ".join(sentences.summary_diagnosis(result))
    assert ("reference_mass at thigh with torque_offset at motor2, where reference_mass at thigh would be an error of "
            "less than 5 % in the model of the load; the one is any of torque_offset at motor1 and") in told
    assert '[data] rejected = ["reference_mass"]' in told
    del mass["small"]
    told = " ".join(sentences.summary_diagnosis(result))
    assert "in the model of the load" not in told and "rejected" not in told


@pytest.mark.parametrize("share, told", [(-0.997, "-99.7"), (0.0213, "+2.1"), (1.0, "+100"), (12.34, "+1234")])
def test_a_share_is_told_in_percent_without_a_power_of_ten(share, told):
    assert sentences.percent(share, "+") == told


@pytest.mark.parametrize("at, said", [
    (None, "a = -1 (95 %: -1 to 0)"), ("min", "a = -1 (95 %: -1 to 0, at its lower bound)"),
    ("max", "a = -1 (95 %: -1 to 0, at its upper bound)")])
def test_a_coefficient_at_its_bound_is_said_to_be_there(at, said):
    told = {"value": -1.0, "ci95": [-1.0, 0.0], "unit": "1", "at_bound": at}
    assert sentences.coefficient_text("a", told) == said

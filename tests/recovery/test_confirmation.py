"""From one log to a study by `improve`, and from that study and another log to its confirmation by `confirm`."""

import json
from pathlib import Path

from benchmarks.hidden_effects.machine import PAPER, Effect, measure, six_manoeuvres, write_csv
from pycosim.cli.entry import main

STUDY = Path(__file__).parents[2] / "examples" / "hip_knee" / "study.toml"


def test_what_was_found_on_one_log_is_confirmed_on_another_and_not_on_that_of_a_sound_machine(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    searched = six_manoeuvres(speeds=(0.5, 1.6), repeats=2, rate=25, longest_pass=4)
    other = six_manoeuvres(speeds=(0.4, 1.1), repeats=2, rate=25, longest_pass=3)
    hidden = [Effect("viscous", "1A", b=0.05)]
    for name, motion, effects, seed in (("old", searched, hidden, 3), ("new", other, hidden, 4),
                                        ("sound", other, [], 5)):
        write_csv(measure(PAPER, motion, effects, rng=seed), f"{name}.csv")
    assert main(["improve", str(STUDY), "--data", "old.csv", "--out", "found", "--quiet"]) == 0
    told = {}
    for name in ("new", "sound"):
        assert main(["confirm", "found/study.toml", "--data", f"{name}.csv", "--out", name, "--quiet"]) == 0
        told[name] = json.loads(Path(name, "confirmation.json").read_text())
    of = {name: next(e for e in t["effects"] if (e["effect"], e["place"]) == ("viscous", "1A"))
          for name, t in told.items()}
    assert of["new"]["confirmed"] and of["new"]["p_value"] < 0.001
    assert not of["sound"]["confirmed"] and of["sound"]["p_value"] > 0.9
    for c, before in told["new"]["replay"]["before"].items():
        assert told["new"]["replay"]["after"][c] < 0.7 * before
    assert all(told["sound"]["replay"]["after"][c] > e for c, e in told["sound"]["replay"]["before"].items())

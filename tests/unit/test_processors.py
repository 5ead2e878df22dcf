"""Claims about the comparison of processors: what decides is told apart from what may change."""

from benchmarks.processors import run

SAME = {"verdict": "missing_effect", "added": ["stribeck@2A"], "left": "nothing_missing",
        "alternatives": [["stribeck@1A+2A"]], "errors": [{"C_H": 0.3}, {"C_H": 0.1}]}


def test_a_changed_effect_decides_and_a_changed_alternative_is_told():
    other = {**SAME, "added": ["stribeck@1A"], "errors": [{"C_H": 0.3}, {"C_H": 0.2}]}
    decided, rest = run.changes({"Haswell": SAME, "Zen": other})
    assert decided == ["added: ['stribeck@2A'] under Haswell, ['stribeck@1A'] under Zen"] and not rest
    decided, rest = run.changes({"Haswell": SAME, "Zen": {**SAME, "alternatives": [[]]}})
    assert not decided and rest[0].startswith("alternatives: [['stribeck@1A+2A']] under Haswell")
    assert run.changes({"Haswell": SAME, "Zen": dict(SAME)}) == ([], [])
    assert run.spread({"Haswell": SAME, "Zen": other}) == 1.0


def test_logs_are_disturbed_in_the_twelfth_digit_and_not_in_time(tmp_path, monkeypatch):
    import numpy as np
    import pandas as pd
    frame = pd.DataFrame({"time": [0.0, 0.1, 0.2], "tau1": [1.5, -2.5, 3.5], "manoeuvre": ["A", "A", "rest"]})
    monkeypatch.setattr(run, "KINDS", {"one": lambda: [frame]})
    run.make(tmp_path, ["one"])
    told, disturbed = (pd.read_csv(tmp_path / world / "one" / "run0.csv") for world in ("as it is", run.DISTURBED))
    assert told["tau1"].equals(frame["tau1"]) and disturbed["time"].equals(frame["time"])
    changed = np.abs(disturbed["tau1"] / frame["tau1"] - 1)
    assert (changed > 0).all() and (changed < 10 * run.SMALL).all()

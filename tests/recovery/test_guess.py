"""What no effect explains is guessed as a shape, which can be tried as an effect of one's own and lowers the error."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.hidden_effects import cases
from benchmarks.hidden_effects import machine as rig
from pycosim.cli.entry import main
from pycosim.study.parse import load_study
from pycosim.study.write import write_study

STUDY = Path(__file__).parents[2] / "examples" / "hip_knee" / "study.toml"


@pytest.mark.slow
def test_a_guess_is_written_marked_as_one_and_lowers_the_error_as_an_effect(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    case = cases.Case("outside", ("bump",), 4)
    rig.write_csv(cases.log(cases.draw(case), case.seed), tmp_path / "run.csv")
    write_study(replace(load_study(STUDY), runs=[tmp_path / "run.csv"]), tmp_path / "study.toml")
    assert main(["diagnose", "study.toml", "--out", "found"]) == 0
    told = capsys.readouterr().out
    assert "A guess:" in told and "guess.mo" in told
    result = json.loads(Path("found/diagnosis.json").read_text())
    guess = result["unexplained"]["proposal"]
    assert result["verdict"] == "unexplained" and guess["variable"] == "theta1" and guess["place"] == "2A"
    assert "not a known effect" in Path("found/guess.mo").read_text()
    tried = replace(load_study("study.toml"), modelica=[tmp_path / "found/guess.mo"])
    write_study(tried, tmp_path / "tried.toml")
    assert main(["improve", "tried.toml", "--out", "better", "--quiet"]) == 0
    steps = json.loads(Path("better/ladder.json").read_text())["steps"]
    assert steps[1]["added"] == {"effect": "guess", "place": "2A"}
    assert all(steps[1]["held_out_error"][c] < 0.6 * steps[0]["held_out_error"][c] for c in ("C_H", "C_K"))


@pytest.mark.slow
def test_every_candidate_has_a_card_and_the_log_says_what_it_could_have_shown(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    case = cases.Case("one", ("stribeck",), 0)
    drawn = cases.draw(case)
    rig.write_csv(cases.log(drawn, case.seed), tmp_path / "run.csv")
    assert main(["diagnose", str(STUDY), "--data", "run.csv", "--out", "found", "--quiet"]) == 0
    result = json.loads(Path("found/diagnosis.json").read_text())
    for card in result["candidates"]:
        assert card["sentence"] and card["experiment"] and set(card["predicted_fall"]) == {"C_H", "C_K"}
        assert card["conditional"] == card["refitted"]
    best = result["candidates"][0]
    assert best["variable"] == f"speed@{drawn.hidden[0].place[:2]}"
    assert {e["variable"] for e in result["excitation"]} >= {"speed@1A", "load@1A", "theta1", "time"}
    shown = {(e["effect"], e["place"]): e["value"] for e in result["smallest_detectable"]}
    assert shown["stribeck", drawn.hidden[0].place] < drawn.hidden[0]["fs"], "it was found, so it was large enough"
    assert result["unexplained"] is None

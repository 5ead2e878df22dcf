"""An effect that a user wrote beside their study takes part in everything: places, diagnosis, fit, next study."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.hidden_effects import machine as rig
from pycosim.cli.entry import main
from pycosim.study.parse import load_study
from pycosim.study.write import write_study

STUDY = Path(__file__).parents[2] / "examples" / "hip_knee" / "study.toml"
DRAG = '''model QuadraticDrag "Friction that grows with the square of the speed, as in churned oil"
  extends DriveTrain.Interfaces.SegmentEffect(dF=k * friction.w^2);
  parameter Real k(unit="N.m.s2/rad2", min=0, max=1, nominal=1e-3) = 0 "Drag coefficient";
  annotation(__pycosim(size="k", needs="speeds", experiment="repeat the passes at three or more speeds"));
end QuadraticDrag;
'''
K = 0.01


@pytest.fixture
def study(tmp_path):
    """A study beside its log and its own effect; without a load term, drag at 1A is a torque on motor 1."""
    (tmp_path / "drag.mo").write_text(DRAG)
    motion = rig.six_manoeuvres((0.3, 0.6, 1.2, 2.4), repeats=2, rate=50, longest_pass=4)
    frame = rig.measure(rig.without_load_dependence(rig.PAPER), motion, rng=4)
    speed = motion.at(motion.time)[1][:, 0]
    frame["tau1"] += K * speed * np.abs(speed)
    rig.write_csv(frame, tmp_path / "run.csv")
    given = replace(load_study(STUDY), modelica=[tmp_path / "drag.mo"], runs=[tmp_path / "run.csv"])
    return write_study(given, tmp_path / "study.toml")


def test_a_users_own_effect_is_found_placed_sized_and_kept(study, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["improve", str(study), "--out", "found", "--quiet"]) == 0
    best = json.loads(Path("found/diagnosis.json").read_text())["candidates"][0]
    assert (best["effect"], best["place"], best["accepted"]) == ("quadratic_drag", "1A", True)
    assert best["coefficients"]["k"]["value"] == pytest.approx(K, rel=0.1)
    assert best["coefficients"]["k"]["unit"] == "N.m.s2/rad2"
    again = load_study("found/study.toml")
    assert again.effects == [("quadratic_drag", "1A")] and again.modelica[0].name == "drag.mo"
    assert main(["identify", "found/study.toml", "--out", "fitted", "--quiet"]) == 0
    assert "quadratic_drag_1A.k" in json.loads(Path("fitted/parameters.json").read_text())["parameters"]


@pytest.mark.parametrize(("text", "says"), [
    (DRAG.replace("SegmentEffect", "SegmentEfect"), "SegmentEfect"),
    (DRAG.replace("^2);", "^2;"), "drag.mo")])
def test_a_slip_in_it_is_one_sentence_that_names_it(study, tmp_path, monkeypatch, capsys, text, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drag.mo").write_text(text)
    assert main(["improve", str(study), "--out", "found"]) == 2
    told = capsys.readouterr().err.strip()
    assert "\n" not in told and says in told
    assert not Path("found").exists()

"""Claims about `pycosim confirm`: a frozen effect holds on a log that was never searched, or it is said not to."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from scipy.stats import kstest

import pycosim as pc
from benchmarks.hidden_effects.machine import PAPER, Effect, measure, six_manoeuvres, write_csv
from pycosim.cli.entry import main
from pycosim.compile import Library, compile_model
from pycosim.cosim.replay import replay
from pycosim.data.copies import Record, shared
from pycosim.data.dataset import Dataset
from pycosim.data.logs import Log
from pycosim.diagnosis.confirm import FEWEST, chance, confirm, frozen
from pycosim.dynamics.simulate import estimate
from pycosim.study.parse import load_study
from pycosim.study.schema import Setting
from pycosim.study.write import write_study

ROOT = Path(__file__).parents[2]
STUDY = ROOT / "examples" / "hip_knee" / "study.toml"
OTHER = six_manoeuvres(speeds=(0.4, 1.1), repeats=2, rate=25, longest_pass=3)


@pytest.fixture(scope="module")
def library():
    return Library()


def log(path, b=0.0, seed=1, motion=OTHER):
    """A log of the paper's machine, with viscous friction of so much at 1A."""
    write_csv(measure(PAPER, motion, [Effect("viscous", "1A", b=b)] if b else [], rng=seed), path)
    return path


def claim(b, place="1A", **values):
    """A study that knows the paper's machine, and claims viscous friction of so much at a place."""
    known = {f"s{s}.{n}": PAPER[n][s] for s in PAPER["f0"] for n in ("f0", "mu")} | values
    study = load_study(STUDY)
    parameters = {n: replace(study.parameters[n], value=v) for n, v in known.items()}
    name = f"viscous_{place.replace('+', '_')}.b"
    return replace(study, effects=[("viscous", place)], parameters={**parameters, name: Setting(b, fixed=False)})


def asked(study, path, library):
    return confirm(Dataset(study.with_data([path]), library))[0]


def test_a_true_effect_is_confirmed_and_a_wrong_one_is_not(library, tmp_path):
    path = log(tmp_path / "new.csv", b=0.03)
    found = asked(claim(0.03), path, library)
    assert found.confirmed and found.p_value < 0.001 and found.why is None
    assert all(found.error_with[c] < 0.6 * e for c, e in found.error_without.items())
    wrong = asked(claim(0.03, "2A"), path, library)
    assert not wrong.confirmed and wrong.p_value > 0.9 and "no smaller" in wrong.why


def test_what_the_base_could_have_done_as_well_is_not_confirmed(library, tmp_path):
    """One speed: viscous friction that is not there, and a preload that is lower by what it takes."""
    path = log(tmp_path / "new.csv", motion=six_manoeuvres(speeds=(1.2,), repeats=5, rate=25, longest_pass=3))
    found = asked(claim(0.02, **{"s1A.f0": PAPER["f0"]["1A"] - 0.02 * 1.2}), path, library)
    assert found.p_value_frozen < 0.01 and not found.confirmed and "could have done the same" in found.why


def test_few_passes_confirm_nothing(library, tmp_path):
    path = log(tmp_path / "new.csv", b=0.03, motion=six_manoeuvres(speeds=(1.2,), repeats=1, rate=25, longest_pass=3))
    found = asked(claim(0.03), path, library)
    assert found.units < FEWEST and not found.confirmed and "only" in found.why


def test_chance_is_flat_where_an_effect_is_worth_nothing_and_counts_few_units_exactly():
    rng = np.random.default_rng(0)
    for n in (9, 40):
        found = []
        for _ in range(300):  # of true size one half of the frozen one, the squared errors are equal
            added = rng.gamma(1.0, 1.0, n)[:, None] * np.ones(20)
            residual = added / 2 + rng.standard_normal((n, 20))
            found.append(chance((2 * residual * added - added ** 2).sum(1)))
        assert kstest(found, "uniform").pvalue > 0.01
    assert chance(np.ones(8)) == 2.0 ** -8 and chance(-np.ones(8)) == 1.0 and chance(np.zeros(8)) == 1.0


@pytest.mark.long
def test_p_values_are_flat_where_the_frozen_effect_is_twice_the_true_one_and_near_one_where_there_is_none(
        library, tmp_path):
    half, none = ([asked(claim(0.004), log(tmp_path / f"{b}_{seed}.csv", b, seed), library) for seed in range(8)]
                  for b in (0.002, 0.0))
    assert kstest([f.p_value_frozen for f in half], "uniform").pvalue > 0.01
    assert not any(f.confirmed for f in (*half, *none))
    assert np.mean([f.p_value_frozen for f in none]) > 0.8


@pytest.mark.long
def test_the_fmu_replays_the_estimate_of_the_model_and_both_errors_fall(library, tmp_path):
    data = Dataset(claim(0.03).with_data([log(tmp_path / "new.csv", b=0.03)]), library)
    bare = compile_model(library, data.base.rig, [])
    before, after = (replay(data, m, frozen(data, m).parameters) for m in (bare, data.base))
    assert set(after) == {"C_H", "C_K"} and all(after[c] < 0.7 * before[c] for c in after)
    values = {n: v for n, v in frozen(data, data.base).parameters.items() if n in data.base.parameters}
    known = {n: data.signals[n] for n in data.base.question("estimate").inputs if n in data.signals}
    told = estimate(data.base, {n: v for n, v in known.items() if n != "time"}, data.time, values)
    for c in after:
        assert after[c] == pytest.approx(np.sqrt(np.mean((data.measured[c] - told[c])[data.view("all")] ** 2)), 1e-9)


def test_the_verb_leaves_its_file_and_refuses_what_it_cannot_answer(library, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    old = log(tmp_path / "old.csv", 0.03, 1)
    log(tmp_path / "new.csv", 0.03, 2)
    (tmp_path / "copy.csv").write_bytes(old.read_bytes())
    write_study(claim(0.03).with_data([old]), tmp_path / "found.toml")
    assert main(["confirm", "found.toml", "--data", "new.csv", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told == json.loads((tmp_path / "found_confirm" / "confirmation.json").read_text()) and told["schema"] == 1
    assert {"effect", "place", "p_value", "error_without", "error_with", "confirmed"} <= set(told["effects"][0])
    assert told["effects"][0]["confirmed"] is True
    assert all(told["replay"]["after"][c] < e for c, e in told["replay"]["before"].items()) and told["replay"]["before"]
    write_study(replace(claim(0.0), effects=[("viscous", "1A")]), tmp_path / "empty.toml")
    for line, what in ((["found.toml"], "--data FILE"), (["found.toml", "--data", "old.csv"], "never searched"),
                       (["found.toml", "--data", "copy.csv"], "holds the same as"),
                       ([str(STUDY), "--data", "new.csv"], "has no effects to confirm"),
                       (["empty.toml", "--data", "new.csv"], "has no size")):
        assert main(["confirm", *line, "--out", "refused"]) == 2
        assert what in capsys.readouterr().err and not (tmp_path / "refused").exists()


@pytest.fixture(scope="module")
def told(library, tmp_path_factory):
    """A study whose effect is true, the log it was made from, a new one, and what Python says of that."""
    folder = tmp_path_factory.mktemp("told")
    old, new = log(folder / "old.csv", 0.03, 1), log(folder / "new.csv", 0.03, 2)
    write_study(claim(0.03).with_data([old]), folder / "found.toml")
    return folder, old, new, pc.open(folder / "found.toml", data=new).confirm()


@pytest.mark.long
def test_python_gives_an_object_that_its_file_gives_back(told, tmp_path):
    folder, _, new, found = told
    assert found.confirmed == {"viscous@1A": True} and "is confirmed" in repr(found)
    frame = found.to_frame()
    assert frame.error_with_C_H["viscous@1A"] < 0.7 * frame.error_without_C_H["viscous@1A"] and frame.units.min() >= 7
    again = pc.Confirmation.load(found.save(tmp_path / "confirmation.json"))
    assert again.record == found.record and repr(again) == repr(found) and again.sentences == found.sentences
    assert again._repr_html_() == found._repr_html_() and again.replay == found.replay and found.replay["why"] is None
    assert isinstance(again.plot.errors(), Axes)
    pd.testing.assert_frame_equal(again.to_frame(), frame)
    assert pc.open(folder / "found.toml").confirm(new).record == found.record


@pytest.mark.long
def test_the_command_line_leaves_what_python_does(told, tmp_path):
    folder, _, new, found = told
    out = tmp_path / "out"
    assert main(["confirm", str(folder / "found.toml"), "--data", str(new), "--quiet", "--out", str(out)]) == 0
    assert pc.Confirmation.load(out / "confirmation.json").record == found.record


def test_python_refuses_what_was_searched_in_whatever_form_it_comes(told):
    folder, old, new, _ = told
    project = pc.open(folder / "found.toml")
    table = pd.read_csv(old)
    unsaved = pc.open(replace(load_study(folder / "found.toml"), path=folder / "no.toml"), data={"a": table})
    for asked in (lambda: project.confirm(old), lambda: project.confirm(table), lambda: project.confirm([new, table]),
                  lambda: unsaved.confirm({"b": table.copy()}), unsaved.confirm):
        with pytest.raises(pc.PycosimError, match="never searched"):
            asked()
    with pytest.raises(pc.PycosimError, match=r'found.toml: confirm needs a log .* project.confirm\("FILE"\)'):
        project.confirm()
    with pytest.raises(pc.PycosimError, match="has no effects to confirm"):
        pc.open(STUDY, data=old).confirm(new)


@pytest.mark.long
def test_a_log_that_was_written_anew_is_the_searched_one_all_the_same(told, tmp_path):
    """Time from elsewhere, fewer digits, a part, rows left out between, a part among new rows."""
    folder, old, new, _ = told
    project, table = pc.open(folder / "found.toml"), pd.read_csv(old)
    middle, other = len(table) // 2, pd.read_csv(new)
    mixed = pd.concat([other[:middle], table[middle:middle + 450], other[middle + 450:]])
    for copy in (table.assign(time=table.time + 1000), table.round(6), table.round(4), table[:middle], table[101::3],
                 table.astype(dict.fromkeys(table.columns[1:7], "float32")), mixed):
        with pytest.raises(pc.PycosimError, match=r"rows \d+ to \d+ hold the same as rows \d+ to \d+ of .*old.csv"):
            project.confirm(copy)
    table.assign(time=table.time + 1000).to_csv(tmp_path / "later.csv", index=False)
    assert main(["confirm", str(folder / "found.toml"), "--data", str(tmp_path / "later.csv")]) == 2
    fitted = pc.open(folder / "found.toml").as_given()
    with pytest.raises(pc.PycosimError, match="never searched"):
        fitted.confirm(table[:middle])


def test_the_searched_log_itself_is_said_to_be_that(told, capsys):
    folder, old, *_ = told
    assert main(["confirm", str(folder / "found.toml"), "--data", str(old)]) == 2
    assert "old.csv is what its effects were found on; record one" in capsys.readouterr().err


def signals(friction, noise=0.0, step=0.0, seed=0, n=6000):
    """A log of one motion: angle of an encoder, torque and reference, with noise or not, rounded or not."""
    time, rng = 0.01 * np.arange(n), np.random.default_rng(seed)
    angle, speed = (np.sin(time + p) + 0.69 * np.sin(2.3 * time + 1 + p) for p in (0.0, np.pi / 2))
    torque = friction * np.tanh(speed / 0.01) + 0.3 * angle + noise * rng.standard_normal(n)
    reference = 5 * np.sin(angle) + 5 * noise * rng.standard_normal(n)
    if step:
        torque, reference = np.round(torque / step) * step, np.round(reference / step) * step
    return Log("x", "x", time, {"phi": np.round(angle / 4e-4) * 4e-4, "tau": torque, "C": reference,
                                "stuck": np.ones(n)}, rows=np.arange(n) + 2)


def cut(log, rows):
    return replace(log, time=log.time[rows], rows=log.rows[rows], signals={n: v[rows] for n, v in log.signals.items()})


@pytest.mark.parametrize("noise, step", [(0.01, 0.0), (0.01, 0.02), (0.01, 0.1), (1e-4, 0.1), (0.0, 0.0), (0.0, 0.01)])
def test_logs_of_one_motion_are_not_the_same_and_parts_of_one_log_are(noise, step):
    one, other = (Record.of(signals(f, noise, step, seed)) for f, seed in ((0.3, 1), (0.3 if noise else 0.303, 2)))
    assert shared(one, other) is None and shared(other, one) is None
    for rows in (slice(100, 3000), slice(50, None, 3)):
        part = Record.of(cut(signals(0.3, noise, step, 1), rows))
        (first, _), (at, _) = shared(part, one)
        assert first == at and shared(one, part)[0][0] == at


@pytest.mark.slow
@pytest.mark.long
def test_a_fitted_model_is_confirmed_with_its_own_values(told):
    folder, old, new, _ = told
    fitted = pc.open(replace(load_study(folder / "found.toml"), effects=[], parameters={
        n: s for n, s in load_study(folder / "found.toml").parameters.items() if "viscous" not in n})).fit()
    found = fitted.add("viscous@1A").confirm(new)
    assert found.confirmed == {"viscous@1A": True}
    with pytest.raises(pc.PycosimError, match="is one of the logs that"):
        fitted.add("viscous@1A").confirm(old)


def test_what_is_no_confirmation_is_refused_in_a_sentence(told, tmp_path):
    record = told[3].to_dict()
    for content, why in (({**record, "effects": [{}]}, "something in it is missing"), ({"schema": 1}, "is no conf"),
                         ({**record, "schema": 99}, "has schema 99")):
        (tmp_path / "x.json").write_text(json.dumps(content))
        with pytest.raises(pc.ResultError, match=why) as said:
            pc.Confirmation.load(tmp_path / "x.json")
        assert "\n" not in str(said.value)
    with pytest.raises(pc.ResultError, match="pycosim.Confirmation.load reads"):
        pc.Diagnosis.load(told[3].save(tmp_path / "y.json"))

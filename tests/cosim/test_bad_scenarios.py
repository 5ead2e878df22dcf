"""Claims about refusals: one sentence that names file and place, exit 2, nothing written."""

import pytest
from joint import JOINT

from pycosim.cli.entry import main

PARTS = """\
class Bad:
    inputs, outputs = [], ["y"]

    def __init__(self, period):
        pass

    def step(self, time, inputs):
        return {"y": 1 / (0.05 - time) if time < 0.05 else float("nan")}


class Worse(Bad):
    def step(self, time, inputs):
        raise KeyError("oh")


class Greedy(Bad):
    def __init__(self, period, must):
        pass
"""

MOTION = """\
trajectory = "backdrive"
machine = "DriveTrain.Rigs.GearedJoint"
rate = 200
options = { cycle = 1.2, amplitude = 0.1 }"""
CASES = {  # what is wrong: (old text, new text, what the sentence must name)
    "unknown key": ("seed = 3", "sede = 3", "closest: 'seed'"),
    "unknown key of a component": ('run = "process"', 'rum = "process"', "closest: 'run'"),
    "no kind": ('plant = "DriveTrain.Rigs.GearedJoint"', 'plnt = "DriveTrain.Rigs.GearedJoint"', "closest: 'plant'"),
    "two kinds": ('plant = "DriveTrain', 'fmu = "a.fmu"\nplant = "DriveTrain', "exactly one of"),
    "no rate": ("rate = 500\n", "", "rate is missing"),
    "rate of zero": ("rate = 500\n", "rate = 0\n", "rate = 0 Hz"),
    "rates without a clock": ("rate = 500\n", "rate = 499.99987\n", "no common clock"),
    "duration": ("duration = 1.2", "duration = -1", "duration = -1 s"),
    "duration as text": ("duration = 1.2", 'duration = "long"', "must be a finite number"),
    "method": ("seed = 3", 'method = "seidel"', "gauss-seidel"),
    "unknown rig": ('plant = "DriveTrain.Rigs.GearedJoint"', 'plant = "DriveTrain.Rigs.GearedJiont"', "GearedJoint"),
    "unknown study": ('plant = "DriveTrain.Rigs.GearedJoint"', 'plant = "no.toml"', "no study"),
    "unknown controller": ('controller = "position"', 'controller = "positon"', "closest: 'position'"),
    "unknown option": ("parameters = { kp", "options = { sid = 1 }\nparameters = { kp", "closest: 'side'"),
    "wrong side": ("parameters = { kp", 'options = { side = "left" }\nparameters = { kp', "no side 'left'"),
    "unknown gain": ("{ kp = 1.0", "{ kq = 1.0", "closest: 'kp'"),
    "gain below its bound": ("{ kp = 1.0", "{ kp = -1.0", "outside 0 to"),
    "parameter as text": ("{ kp = 1.0", '{ kp = "1.0"', "'kp' must be a finite number"),
    "unknown start": ("start = { q = 0.5 }", "start = { qq = 0.5 }", "closest: 'q'"),
    "no machine": ('controller = "position"\nmachine = "DriveTrain.Rigs.GearedJoint"', 'controller = "position"',
                   "machine is missing"),
    "unknown trajectory": ('"backdrive"', '"backdive"', "closest: 'backdrive'"),
    "unknown option of a trajectory": ("{ cycle = 1.2", "{ cyle = 1.2", "closest: 'cycle'"),
    "option of another kind": ("{ cycle = 1.2", '{ cycle = "fast"', "cycle"),
    "truth for a number": ("{ cycle = 1.2", "{ cycle = true", "'cycle' must be a number or a list of numbers"),
    "lists for a number": ("{ cycle = 1.2", "{ cycle = [[1.2]]", "not [[1.2]]"),
    "motion for another rig": (MOTION, 'trajectory = "gait"\nmachine = "DriveTrain.Rigs.GearedJoint"\nrate = 200',
                               "hip and knee"),
    "share as text": ("parameters = { kp", 'options = { friction = "all" }\nparameters = { kp', "'friction'"),
    "unknown component": ('"plant -> estimator"', '"plant -> estimater"', "closest: 'estimator'"),
    "unknown input": ("-> plant.tau", "-> plant.tua", "closest: 'tau'"),
    "unknown output": ('"controller.motor.tau ->', '"controller.motor.tao ->', "closest: 'motor.tau'"),
    "no arrow": ('"plant -> estimator"', '"plant, estimator"', "is not of the form"),
    "one end": ('"plant -> estimator"', '"plant.q -> estimator"', "one end only"),
    "nothing in common": ('"plant -> estimator"', '"estimator -> plant"', "takes nothing that"),
    "two sources": ('"plant -> estimator"', '"plant -> estimator", "plant.q -> estimator.motor.phi"',
                    "is connected to"),
    "constant and connected": ('run = "process"', 'run = "process"\ninputs = { tau = 1 }', "a value and a connection"),
    "unknown column": ('"plant.gear.L"', '"plant.gear.LL"', "closest: 'gear.L'"),
    "column without variable": ('"plant.gear.L"', '"plant"', "names no variable"),
    "negative noise": ("noise = 1e-3", "noise = -1e-3", "noise = -0.001"),
    "column of time": ("wanted = ", "time = ", "always logged"),
    "missing FMU": ('plant = "DriveTrain.Rigs.GearedJoint"\nrun = "process"', 'fmu = "no.fmu"', "no FMU"),
    "no FMU at all": ('plant = "DriveTrain.Rigs.GearedJoint"\nrun = "process"', 'fmu = "joint.toml"',
                      "cannot be loaded"),
    "missing module": ('controller = "position"\nmachine = "DriveTrain.Rigs.GearedJoint"', 'python = "no_such:Thing"',
                       "cannot be imported"),
    "missing class": ('controller = "position"\nmachine = "DriveTrain.Rigs.GearedJoint"', 'python = "parts:Bed"',
                      "closest: 'Bad'"),
    "not TOML": ("duration = 1.2", "duration = = 1.2", "not valid TOML"),
}


def refuse(text, tmp_path, monkeypatch, capsys):
    """Sentence with which the command line refuses a scenario."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "parts.py").write_text(PARTS)
    (tmp_path / "joint.toml").write_text(text)
    assert main(["cosim", "joint.toml", "--allow-python", "parts.py", "no_such"]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and "Traceback" not in err
    assert {p.name for p in tmp_path.iterdir()} - {"__pycache__"} == {"joint.toml", "parts.py"}
    return err


@pytest.mark.parametrize("old, new, named", CASES.values(), ids=CASES)
def test_a_bad_scenario_is_refused_in_one_sentence(old, new, named, tmp_path, monkeypatch, capsys):
    assert JOINT.count(old) >= 1
    err = refuse(JOINT.replace(old, new, 1), tmp_path, monkeypatch, capsys)
    assert named in err and "joint.toml" in err


@pytest.mark.parametrize("name, named", [("Bad", "not finite at t = 0.0"), ("Worse", "KeyError"), ("Greedy", "must")])
def test_a_python_class_that_fails_is_named(name, named, tmp_path, monkeypatch, capsys):
    text = (f'duration = 1\n[components.c]\npython = "parts:{name}"\nrate = 100\n'
            '[log]\nrate = 100\ncolumns = { y = "c.y" }\n')
    err = refuse(text, tmp_path, monkeypatch, capsys)
    assert named in err and "'c'" in err


def test_without_duration_something_must_have_one(tmp_path, monkeypatch, capsys):
    text = '[components.c]\npython = "parts:Bad"\nrate = 100\n[log]\nrate = 100\ncolumns = { y = "c.y" }\n'
    assert "duration = 10.0" in refuse(text, tmp_path, monkeypatch, capsys)


def test_a_missing_scenario_or_checkpoint_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "joint.toml").write_text(JOINT)
    assert main(["cosim", "jont.toml"]) == 2 and "closest: 'joint.toml'" in capsys.readouterr().err
    assert main(["cosim", "joint.toml", "--resume", "gone.zip"]) == 2 and "gone.zip" in capsys.readouterr().err
    assert main(["cosim", "joint.toml", "--data", "a.csv"]) == 2 and "reads no log" in capsys.readouterr().err
    assert main(["cosim", "joint.toml", "--untl", "1"]) == 2 and "closest: '--until'" in capsys.readouterr().err

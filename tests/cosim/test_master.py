"""Claims about the master: rates, order of exchange, determinism, stopping and going on."""

import base64
import hashlib
import io
import json
import os
import pickle
import signal
import zipfile
from functools import partial

import numpy as np
import pytest

from pycosim.core.errors import CosimulationError, ScenarioError
from pycosim.cosim.master import cosimulate

ECHO = """\
class Echo:
    inputs, outputs = ["u"], ["y", "calls"]

    def __init__(self, period, gain=1.0):
        self.gain, self.calls = gain, 0

    def step(self, time, inputs):
        self.calls += 1
        return {"y": self.gain * inputs["u"], "calls": self.calls}


class Clock:
    inputs, outputs = [], ["t"]

    def __init__(self, period):
        pass

    def step(self, time, inputs):
        return {"t": time}
"""
CHAIN = """\
duration = 0.1
connections = ["clock.t -> first.u", "first.y -> second.u"]
method = "gauss-seidel"
[components.clock]
python = "parts:Clock"
rate = 100
[components.first]
python = "parts:Echo"
rate = 50
[components.second]
python = "parts:Echo"
rate = 100
parameters = { gain = 2.0 }
[log]
rate = 100
columns = { t = "clock.t", first = "first.y", second = "second.y", calls = "first.calls" }
"""


@pytest.fixture
def chain(scenario, tmp_path):
    (tmp_path / "parts.py").write_text(ECHO)
    return lambda *changes: cosimulate(scenario(*changes, text=CHAIN), allow_python=[tmp_path / "parts.py"]).log


def test_a_component_holds_its_answer_between_its_own_instants(chain):
    log = chain()
    assert np.allclose(log["t"], np.arange(11) / 100)
    assert np.allclose(log["first"], np.arange(11) // 2 * 2 / 100)
    assert log["calls"].tolist() == [k // 2 + 1 for k in range(11)]


def test_gauss_seidel_hands_on_at_once_and_jacobi_one_instant_later(chain):
    log = chain()
    assert np.allclose(log["second"], 2 * log["first"])
    late = chain(('"gauss-seidel"', '"jacobi"'))
    assert np.allclose(late["first"][2::2], late["t"][1:-1:2])
    assert np.allclose(late["second"][1:], 2 * late["first"][:-1])


def test_with_jacobi_the_order_of_the_file_does_not_matter(scenario, library):
    text = scenario().text.replace("seed = 3", 'seed = 3\nmethod = "jacobi"')
    head, *parts = text.split("[components.")
    last, log = parts[-1].split("[log]")
    turned = "[components.".join([head, *[last, *reversed(parts[:-1])]]) + "[log]" + log
    a, b = (cosimulate(scenario(text=t), library=library) for t in (text, turned))
    assert a.text == b.text and len(a.log) == 121


def test_gauss_seidel_depends_on_the_order(scenario, library):
    a = cosimulate(scenario(("duration = 1.2", "duration = 0.2")), library=library)
    b = cosimulate(scenario(("duration = 1.2", 'duration = 0.2\nmethod = "jacobi"')), library=library)
    assert not np.allclose(a.log["tau"], b.log["tau"], rtol=0, atol=1e-6)


def test_a_run_repeats_bit_for_bit_and_follows_its_motion(scenario, library):
    first, second = (cosimulate(scenario(), library=library) for _ in range(2))
    assert first.text == second.text and first.complete and first.checkpoint is None
    assert np.abs(first.log["q"] - first.log["wanted"]).max() < 0.05
    assert np.ptp(first.log["q"]) > 0.1


@pytest.mark.parametrize("method", ["gauss-seidel", "jacobi"])
def test_what_is_read_for_the_log_alone_changes_nothing(scenario, library, method):
    """Values that only the log takes are worked out at its instants, and are those of a log of every instant."""
    changes = (("seed = 3", f'method = "{method}"'), (", noise = 1e-3", ""), (", quantum = 1e-4", ""))
    every, some = (cosimulate(scenario(*changes, ("[log]\nrate = 100", f"[log]\nrate = {rate}")), library=library)
                   for rate in (1000, 100))
    assert len(some.log) == 121 and every.log[::10].reset_index(drop=True).equals(some.log)


def test_columns_have_the_resolution_and_the_noise_they_ask_for(scenario, library):
    noisy = cosimulate(scenario(), library=library).log
    exact = cosimulate(scenario((", noise = 1e-3", ""), (", quantum = 1e-4", "")), library=library).log
    assert 0.5e-3 < np.std(noisy["tau"] - exact["tau"]) < 2e-3
    steps = noisy["theta"] / 1e-4
    assert np.allclose(steps, np.round(steps), atol=1e-6) and np.abs(noisy["theta"] - exact["theta"]).max() <= 0.51e-4


@pytest.mark.parametrize("stop_at", [0.0, 0.004, 0.5, 1.198])
def test_resuming_gives_the_same_log_bit_for_bit(scenario, library, stop_at):
    whole = cosimulate(scenario(), library=library)
    part = cosimulate(scenario(), until=stop_at, library=library)
    assert not part.complete and part.time == pytest.approx(stop_at) and whole.text.startswith(part.text)
    rest = cosimulate(scenario(), resume=part.checkpoint, library=library)
    assert rest.complete and rest.text == whole.text


@pytest.mark.parametrize("run", ["process", "fmu"])
def test_checkpoints_on_the_way_change_nothing_and_each_leads_to_the_same_log(scenario, library, run):
    made, kept = scenario(('run = "process"', f'run = "{run}"')), []
    whole = cosimulate(made, library=library, save=kept.append, every=0)
    assert whole.text == cosimulate(made, library=library).text and len(kept) > 500
    for data in (kept[0], kept[len(kept) // 2], kept[-2]):
        assert cosimulate(made, resume=data, library=library).text == whole.text
    kept.clear()
    cosimulate(made, library=library, save=kept.append, every=3600)
    assert not kept


def test_python_controllers_go_on_where_they_were(scenario, tmp_path):
    (tmp_path / "parts.py").write_text(ECHO)
    made, run = scenario(text=CHAIN), partial(cosimulate, allow_python=[tmp_path / "parts.py"])
    part = run(made, until=0.05)
    assert run(made, resume=part.checkpoint).text == run(made).text


KEPT = """
import numpy as np


class Echo:
    inputs, outputs = ["u"], ["y", "calls"]

    def __init__(self, period, gain=1.0):
        self.kept = {"gain": gain, "calls": 0, (1, "a"): {3, 4}, "list": [1.5, None, True, float("inf")],
                     "array": np.arange(6.0).reshape(2, 3), "large": 1 << 80}

    def step(self, time, inputs):
        self.kept["calls"] += 1
        self.kept["array"][1] *= 1.001
        good = self.kept[1, "a"] == {3, 4} and self.kept["large"] == 1 << 80 and self.kept["list"][3] == float("inf")
        return {"y": good * self.kept["array"].sum(), "calls": self.kept["calls"]}
"""


def test_a_checkpoint_keeps_data_of_every_kind(scenario, tmp_path):
    clock = ECHO[ECHO.index("class Clock"):]
    (tmp_path / "parts.py").write_text(KEPT + "\n\n" + clock)
    made, run = scenario(text=CHAIN), partial(cosimulate, allow_python=[tmp_path / "parts.py"])
    whole, part = run(made), run(made, until=0.05)
    assert run(made, resume=part.checkpoint).text == whole.text and whole.log["first"].iloc[-1] > 15


def test_what_is_no_data_is_refused_in_a_checkpoint_by_name(scenario, tmp_path):
    (tmp_path / "parts.py").write_text(ECHO.replace("pass", "self.file = open(__file__)"))
    with pytest.raises(CosimulationError, match="'file' is a TextIOWrapper"):
        cosimulate(scenario(text=CHAIN), until=0.05, allow_python=[tmp_path / "parts.py"])


def repacked(data, change):
    """A checkpoint with changed content and a checksum that fits."""
    packed = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        content = json.loads(archive.read("checkpoint.json"))
    change(content)
    text = json.dumps(content).encode()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("checkpoint.json", text)
        archive.writestr("sha256", hashlib.sha256(text).hexdigest())
    return packed.getvalue()


def test_a_checkpoint_of_a_stranger_runs_no_code(scenario, tmp_path):
    """A pickle in it would; it is read as data, and refused."""
    (tmp_path / "parts.py").write_text(ECHO)
    made, run, trace = scenario(text=CHAIN), partial(cosimulate, allow_python=[tmp_path / "parts.py"]), tmp_path / "ran"

    class Evil:
        def __reduce__(self):
            return (open, (str(trace), "w"))

    def change(content):
        content["parts"]["first"] = base64.b64encode(pickle.dumps({"gain": Evil()})).decode()

    with pytest.raises(CosimulationError, match="cannot be read"):
        run(made, resume=repacked(run(made, until=0.05).checkpoint, change))
    assert not trace.exists()


def test_a_scenario_runs_no_python_that_is_not_allowed_by_name(scenario, tmp_path):
    (tmp_path / "parts.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n" + ECHO)
    (tmp_path / "other.py").write_text("")
    for allowed in ((), [tmp_path / "other.py"], ["parts"]):
        with pytest.raises(CosimulationError, match="--allow-python .*parts.py"):
            cosimulate(scenario(text=CHAIN), allow_python=allowed)
    with pytest.raises(CosimulationError, match="--allow-python this"):
        cosimulate(scenario(text=CHAIN.replace("parts:Clock", "this:Clock")), allow_python=[tmp_path / "parts.py"])
    assert not (tmp_path / "ran").exists()
    assert cosimulate(scenario(text=CHAIN), allow_python=[tmp_path / "parts.py"]).complete
    assert (tmp_path / "ran").exists()


def test_a_checkpoint_of_another_scenario_or_a_damaged_one_is_refused(scenario, library):
    data = cosimulate(scenario(), until=0.1, library=library).checkpoint
    with pytest.raises(ScenarioError, match="not the scenario of the checkpoint"):
        cosimulate(scenario(("seed = 3", "seed = 4")), resume=data, library=library)
    flipped = [data[:k] + bytes([data[k] ^ 255]) + data[k + 1:] for k in range(60, len(data) // 2, 60)]
    assert len(flipped) > 5
    for broken in (data[:-20], b"nothing", *flipped):
        with pytest.raises(ScenarioError, match="damaged"):
            cosimulate(scenario(), resume=broken, library=library)


def test_ctrl_c_leaves_a_log_up_to_there_and_a_way_to_go_on(scenario, library):
    def press():
        press.calls += 1
        if press.calls == 100:
            os.kill(os.getpid(), signal.SIGINT)
        return False
    press.calls, usual = 0, signal.getsignal(signal.SIGINT)
    part = cosimulate(scenario(), stop=press, library=library)
    assert signal.getsignal(signal.SIGINT) is usual
    whole = cosimulate(scenario(), library=library)
    assert 0 < part.time < 1.2 and whole.text.startswith(part.text) and len(part.log) > 3
    assert cosimulate(scenario(), resume=part.checkpoint, library=library).text == whole.text

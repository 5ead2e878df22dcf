"""What someone else sent, or left in a folder, is read as data: Modelica, studies, checkpoints, caches."""

import importlib.util
import json
import pickle
from pathlib import Path

import numpy as np
import pytest

from pycosim.compile import Library, compile_model, shared_library, tree_data
from pycosim.core import cache
from pycosim.core.errors import ModelicaError
from pycosim.dynamics.simulate import simulate
from pycosim.export.links import evaluate


@pytest.fixture(scope="module")
def library():
    return Library()


def test_the_tree_of_the_library_survives_the_cache_s_format(library):
    again = tree_data.load(tree_data.dump(library.tree))
    assert str(again) == str(library.tree)
    assert sorted(library.walk(again)) == sorted(library.walk())
    assert pickle.dumps(tree_data.load(tree_data.dump(again))) == pickle.dumps(again)  # sharing too


@pytest.mark.long
def test_a_model_compiles_the_same_from_the_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("PYCOSIM_CACHE", str(tmp_path))
    first, second = Library(), Library()
    a = first.flatten("DriveTrain.Rigs.HipKnee")
    kept = [p for p in tmp_path.iterdir() if p.name.startswith("tree-")]
    assert len(kept) == 1 and json.loads(kept[0].read_bytes())["format"] == tree_data.FORMAT
    b = second.flatten("DriveTrain.Rigs.HipKnee")
    assert list(map(str, a.equations)) == list(map(str, b.equations)) and a.parameters == b.parameters


@pytest.mark.long
def test_a_rig_moves_the_same_from_the_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("PYCOSIM_CACHE", str(tmp_path))
    time = np.linspace(0, 0.2, 50)
    made, kept = (simulate(compile_model(Library(), "DriveTrain.Rigs.GearedJoint", [("viscous", "gear")]),
                           {"tau": np.sin(40 * time)}, time) for _ in range(2))
    assert len([p for p in tmp_path.iterdir() if p.name.startswith("dynamics-")]) == 1
    assert made.keys() == kept.keys() and all((made[n] == kept[n]).all() for n in made) and np.ptp(made["q"]) > 0


def test_a_library_is_shared_until_a_text_changes(tmp_path):
    file = tmp_path / "my.mo"
    text = "model My extends DriveTrain.Rigs.GearedJoint; end My;"
    file.write_text(text)
    first = shared_library([file])
    assert shared_library([file]) is first and shared_library() is not first
    file.write_text(text.replace("My", "Mine"))
    assert "Mine" in shared_library([file]).walk() and "Mine" not in first.walk()


def test_what_the_cache_keeps_is_forgotten_when_any_source_changes(tmp_path, monkeypatch):
    """A helper of an effect's equation stands in another room than the compiler."""
    for room in ("core", "data"):
        (tmp_path / "its" / room).mkdir(parents=True)
    for name in ("cache.py", "whole.py"):
        (tmp_path / "its" / "core" / name).write_text(Path(cache.__file__).with_name(name).read_text())
    monkeypatch.syspath_prepend(tmp_path)
    spec = importlib.util.spec_from_file_location("its.core.cache", tmp_path / "its" / "core" / "cache.py")
    keys = []
    for text in ("a = 1\n", "a = 2\n", "a = 1\n"):
        (tmp_path / "its" / "data" / "helper.py").write_text(text)
        its = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(its)
        keys.append(its.digest("the same model"))
    assert keys[0] == keys[2] != keys[1]


class Evil:
    """Leaves a file when it is unpickled."""

    def __init__(self, trace):
        self.trace = str(trace)

    def __reduce__(self):
        return open, (self.trace, "w")


def test_a_pickle_in_the_cache_is_not_opened(monkeypatch, tmp_path):
    monkeypatch.setenv("PYCOSIM_CACHE", str(tmp_path))
    Library().tree
    kept = next(p for p in tmp_path.iterdir() if p.name.startswith("tree-"))
    kept.write_bytes(pickle.dumps(Evil(tmp_path / "ran")))
    assert "DriveTrain.Rigs.HipKnee" in Library().walk() and not (tmp_path / "ran").exists()


@pytest.mark.parametrize("data", [
    b"", b"[]", b'{"format": 0, "objects": []}', b'{"format": 1, "objects": []}',
    b'{"format": 1, "objects": [["open", []]]}', b'{"format": 1, "objects": [["Tree", [["classes", [7]]]]]}',
    b'{"format": 1, "objects": [["list", []]]}'])
def test_what_is_no_tree_is_refused(data):
    with pytest.raises(ValueError):
        tree_data.load(data)


@pytest.mark.parametrize("formula", [
    "ca.Function", "np.array(1)", "__import__('os').getcwd()", "m.real", "[m][0]", "m if m else 0", "(lambda: 1)()",
    "'a'*9", "m*q", "1/0", "9**9**9", "", "m;m"])
def test_a_formula_of_an_annotation_is_arithmetic_and_nothing_else(formula):
    with pytest.raises(ModelicaError, match="formula"):
        evaluate(formula, {"m": 2.0})


def test_formulas_are_worked_out():
    assert evaluate(" m*(l/2)**2 + -J", {"m": 3.0, "l": 4.0, "J": 1.0}) == 11.0

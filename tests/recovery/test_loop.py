"""The loop of examples/loop: it finds what its machine hides, and ends by itself."""

import importlib.util
from pathlib import Path

import pytest

PATH = Path(__file__).parents[2] / "examples" / "loop" / "loop.py"


@pytest.mark.slow
def test_the_loop_finds_the_hidden_effect_and_ends_by_itself(tmp_path):
    spec = importlib.util.spec_from_file_location("loop", PATH)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    history = example.loop(tmp_path, say=lambda text: None)
    assert history[-1]["done"] and 1 < len(history) < 6
    assert history[-1]["effects"] == ["viscous@2A"]
    assert all(w <= example.wanted(n) for n, w in history[-1]["widths"].items())

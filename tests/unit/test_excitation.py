"""Claims about what a log would have shown."""

from types import SimpleNamespace

import numpy as np

from pycosim.diagnosis import excitation


def scores(spread):
    """Scores of one candidate whose coefficient is known to a spread."""
    candidate = SimpleNamespace(parts=[0], lower=[-1.0], upper=[1.0], names=["b"], key=("viscous", "1A"), grid={},
                                effect=SimpleNamespace(id="viscous"), place=SimpleNamespace(name="1A"))
    table = SimpleNamespace(contribution=lambda effect: None,
                            described=lambda contribution: {"b": SimpleNamespace(unit="N.m.s/rad")})
    score = SimpleNamespace(visible=True, scanned=False, candidate=candidate, spread=np.array([spread]))
    return SimpleNamespace(threshold=lambda level, scanned: 12.0, weight=lambda candidate, size: 0.01, results=[score],
                           table=table)


def test_an_effect_that_could_hide_at_any_size_is_not_said_to_be_small():
    assert excitation.smallest(scores(np.inf), 0.01) == []
    assert excitation.smallest(scores(0.02), 0.01)[0]["value"] > 0.02

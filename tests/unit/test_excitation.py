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
    score = SimpleNamespace(visible=True, scanned=False, candidate=candidate, spread=np.array([spread]), limit=np.inf)
    return SimpleNamespace(threshold=lambda level, scanned: 12.0, weight=lambda candidate, size: size, results=[score],
                           table=table)


def test_an_effect_that_could_hide_at_any_size_is_not_said_to_be_small():
    assert excitation.smallest(scores(np.inf), 0.01, 0.05) == []
    assert excitation.smallest(scores(0.02), 0.01, 0.05)[0]["value"] > 0.02


def test_no_size_is_told_of_what_the_data_cannot_show():
    """At one speed the ramps alone tell a viscosity: it was said to be found above a size, and not to be visible."""
    hidden = [{"effect": "viscous", "place": "1A", "why": "one speed only"}]
    assert excitation.smallest(scores(0.02), 0.01, 0.05, hidden) == []


def test_a_size_that_takes_too_little_to_matter_is_not_said_to_show():
    found = excitation.smallest(scores(1e-4), 0.01, 0.05)[0]
    assert found["value"] ** 2 / (1 + found["value"] ** 2) >= 0.05 and found["value"] < 0.24

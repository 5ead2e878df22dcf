"""The answer of a search in; what it says, in short, out."""

from benchmarks.real_logs.make import make
from pycosim.compile import Library
from pycosim.data.dataset import Dataset
from pycosim.diagnosis import search
from pycosim.study.parse import load_study


def told(result):
    """Effects added, each with its twins."""
    return [[step.added, *(tuple(t.values()) for t in step.finding.twins)] for step in result.steps[1:]]


def summary(result):
    """What a failure shows."""
    best = result.first.candidates[:4]
    return result.first.verdict, told(result), result.last.verdict, [(c.effect, c.place, c.p_value) for c in best]


def hidden(case, folder):
    """What `improve` finds in a short log of a case, first and last verdict and the effects with their places."""
    result = search.improve(Dataset(load_study(make(case, folder, quick=True)), Library()))
    return result.first.verdict, result.last.verdict, [found[0] for found in told(result)], summary(result)

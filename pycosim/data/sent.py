"""A data set in, wherever it is; the same data set where it is worked with out."""

from __future__ import annotations

import uuid

from ..compile import shared_library

_MADE = {}
"""The data set that came here last, by its name."""


class Sent:
    """A data set among the arguments of work: in another process it is made again from its logs, once.

    Parameters
    ----------
    dataset : Dataset
        Here.
    """

    def __init__(self, dataset):
        self.dataset = dataset

    def __getstate__(self):
        name = self.dataset.memo("sent.name", lambda: uuid.uuid4().hex)
        return name, self.dataset.study, self.dataset.logs, self.dataset.early

    def __setstate__(self, state):
        from .dataset import Dataset  # here alone: who exports a model reads no logs
        name, study, logs, early = state
        if name not in _MADE:
            _MADE.clear()
            _MADE[name] = Dataset(study, shared_library(study.modelica), logs)
        self.dataset = _MADE[name].without(early)

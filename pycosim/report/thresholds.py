"""Nothing in but the modules that decide; the thresholds that a result hangs on, with what each means, out.

Each value stands once, with its reason and its source, where it is used; a result names it so that whoever reads the
file alone knows what was asked of the data. The modules are imported when a result is written: an export needs none.
"""

from __future__ import annotations

from importlib import import_module

_EVIDENCE = {
    "level": ("diagnosis.scores.LEVEL", "family-wise p-value below which a candidate counts"),
    "relevant": ("diagnosis.dependence.RELEVANT",
                 "least share of the error's energy that a variable must explain to matter"),
    "matters": ("diagnosis.decide.MATTERS", "least share of a channel's squared error that a candidate must take"),
    "beside": ("diagnosis.decide.BESIDE", "the same beside other effects, where it is less than `whole` of the whole"),
    "whole": ("diagnosis.decide.WHOLE",
              "share of the squared error without any effect below which a candidate beside others must take `beside`"),
    "few": ("diagnosis.decide.FEW", "blocks below which unseen ones do not disprove a candidate that takes much"),
    "bound_pressed": ("diagnosis.scores.PRESSED",
                      "fall of the squared error, over the noise's variance, that a parameter must bring outside its "
                      "bounds to count as held back by them"),
    "separate": ("diagnosis.rivals.SEPARATE", "standard errors by which unseen folds must tell two candidates apart"),
    "plain": ("diagnosis.rivals.PLAIN",
              "share of the plain squared error by which it must be lower to decide between two candidates"),
    "alike": ("diagnosis.rivals.ALIKE", "share of what the best candidate takes that an alternative may leave"),
    "left": ("diagnosis.remainder.LEFT",
             "share of what a candidate takes that one variable may still explain of the rest"),
    "varies": ("diagnosis.constancy.LACK",
               "share of what a candidate takes that it may gain where its coefficient varies"),
    "varies_sure": ("diagnosis.constancy.SURE",
                    "standard errors by which a varying coefficient must predict unseen data better"),
    "varies_chance": ("diagnosis.whitened.CHANCE",
                      "chance by which one of all variables may gain as much in correlated noise by a line, or less"),
}
_REST = {
    "contested": ("diagnosis.rivals.CONTESTED", "alternatives beyond which none is a name"),
    "contested_beside": ("diagnosis.rivals.BESIDE", "the same where other effects are in the model"),
    "kinds": ("diagnosis.rivals.KINDS", "effects that may be alternatives of one another at any number of places"),
    "depends_chance": ("diagnosis.whitened.CHANCE",
                       "chance by which one of all variables may do as much in correlated noise, or less"),
    "depends": ("diagnosis.dependence.ALARM",
                "standard errors by which a dependence must lower the error on unseen blocks"),
    "above_floor": ("diagnosis.remainder.SLOW",
                    "squared error over that of the noise floor above which something is left"),
    "above_floor_turning": ("diagnosis.remainder.SIGNED",
                            "the same where what is left changes its sign as a segment turns"),
    "visible": ("diagnosis.remainder.VISIBLE", "error over the size of the signal above which something is left"),
    "guess": ("diagnosis.lack_of_fit.ENOUGH",
              "share of the energy beyond noise that a guessed shape must explain on unseen folds"),
    "shown": ("diagnosis.scores.SEEN",
              "standard errors that an effect's largest size must exceed for the log to show it"),
}
_TABLES = {
    "check": {"stops": ("data.checks.finding.SURE",
                        "certainty from which a mistake of wiring or units stops a search")},
    "parameters": {
        "undetermined": ("fit.bounded.NULL",
                         "eigenvalue of the scaled normal matrix below which a combination is not determined"),
        "hardly": ("fit.nullspace.HARDLY", "correlation from which two parameters are told as hard to tell apart"),
        "at_bound": ("fit.least_squares.MARGIN",
                     "half the distance from a bound, over the nominal value, within which a parameter is at it")},
    "diagnosis": {**_EVIDENCE, **_REST},
    "ladder": {**_EVIDENCE, "most": ("diagnosis.search.MOST", "effects that one search may add")},
    "plan": {"separate": ("design.plan.SEPARATE",
                          "squares of the noise's standard deviation by which two candidates must differ to count as "
                          "told apart"),
             "same": ("design.plan.ALIKE", "squares of the noise's standard deviation below which they are one")},
}


def thresholds(kind):
    """Thresholds that decided a result.

    Parameters
    ----------
    kind : {"check", "parameters", "diagnosis", "ladder", "plan"}
        The result, by the name of its file.

    Returns
    -------
    dict of str to dict
        ``value``, and ``means``, in words with its unit.

    Examples
    --------
    >>> thresholds("diagnosis")["level"]["means"]
    'family-wise p-value below which a candidate counts'
    """
    return {name: {"value": _value(*where.rsplit(".", 1)), "means": means}
            for name, (where, means) in _TABLES[kind].items()}


def _value(module, constant):
    return getattr(import_module(f"pycosim.{module}"), constant)

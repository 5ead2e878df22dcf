"""What a check has seen in; a finding with its sentence, its certainty and the line that mends it, out."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, field, replace

from ...study.schema import COLUMN_KEYS, FINDINGS, Column, known_unit
from ...study.write import to_toml

KINDS = FINDINGS
"""What a study may accept is what a check may find."""
DISCRETE = ("sign", "swap", "unit", "wrap", "stuck", "clock")
"""Kinds that are right or wrong and nothing between: no physics acts like them, so a search stops at them."""
SURE = 0.9
"""Certainty from which a discrete mistake stops a search: a wrong stop costs a line in the study, a missed one a
wrong physical effect."""
QUESTION = 0.5
"""Certainty below which a finding is a question."""
FACTS = ("resolution", "rest", "rate")
"""Kinds that describe a log, sound or not."""


@dataclass(frozen=True)
class Finding:
    """Something that the data check has to say.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    text : str
        A plain sentence.
    columns : list of str
        Columns of the log.
    certainty : float
        0 to 1; below one half it is a question.
    error_before, error_after : dict of str to float
        Error of what was compared, without and with the mend, in SI units.
    mend : str
        Lines for the study; empty where no line can mend it.
    times : list of (float, float)
        Stretches [s] that are meant; empty for the whole log.
    """

    kind: str
    text: str
    columns: list = field(default_factory=list)
    certainty: float = 1.0
    error_before: dict = field(default_factory=dict)
    error_after: dict = field(default_factory=dict)
    mend: str = ""
    times: list = field(default_factory=list)

    @property
    def blocks(self):
        """Whether a search must not start before it is answered."""
        return self.kind in DISCRETE and self.certainty >= SURE

    @property
    def told(self):
        """Whether a verb says it unasked: all but what describes a sound log, and questions that no line answers."""
        return self.wrong and (self.certainty >= QUESTION or bool(self.mend))

    @property
    def wrong(self):
        """Whether it says or asks that something is wrong, and does not merely describe."""
        return self.kind not in FACTS

    def plain(self):
        """The finding as ``check.json`` holds it.

        Returns
        -------
        dict
        """
        return {"kind": self.kind, "columns": list(self.columns), "certainty": round(float(self.certainty), 4),
                "text": self.text, "error_before": _rounded(self.error_before),
                "error_after": _rounded(self.error_after), "mend": self.mend,
                "times": [[float(a), float(b)] for a, b in self.times]}


@dataclass(frozen=True)
class Checked:
    """Everything that the check of a study's logs has found, most important first.

    Attributes
    ----------
    findings : list of Finding
        Each with its kind, its certainty and the line of the study that mends it.
    accepted : list of str
        Kinds that the user has answered: they stop nothing.
    """

    findings: list
    accepted: list = field(default_factory=list)

    @property
    def blocking(self):
        """Findings that a search must not start with."""
        return [f for f in self.findings if f.blocks and f.kind not in self.accepted]

    def plain(self):
        """``check.json``.

        Returns
        -------
        dict
        """
        return {"schema": 1, "blocking": bool(self.blocking), "findings": [f.plain() for f in self.findings]}


def ordered(findings):
    """Findings, those that stop a search first, then what is wrong, then what merely describes.

    Parameters
    ----------
    findings : list of Finding
        In any order.

    Returns
    -------
    list of Finding
    """
    return sorted(findings, key=lambda f: (not f.blocks, not f.wrong, KINDS.index(f.kind), -f.certainty))


def _rounded(errors):
    return {n: float(f"{v:.6g}") for n, v in errors.items() if math.isfinite(v)}


_SPAN = ("data", "time")
"""What no column is called."""


# --- lines that mend ------------------------------------------------------------------------------------------------


def column_line(name, column):
    """The line of ``[columns]`` that maps a column.

    Parameters
    ----------
    name : str
        Column of the log.
    column : Column
        Its variable, unit, sign and gain, as the line is to say them.

    Returns
    -------
    str
    """
    given = {"variable": column.variable, "unit": column.unit}
    given |= {k: _short(getattr(column, k)) for k in COLUMN_KEYS[2:] if getattr(column, k) != getattr(Column, k)}
    return f"{_bare(name)} = {to_toml(given)}"


def _short(value):
    return value if isinstance(value, int) else float(f"{value:.6g}")


def _bare(name):
    return to_toml({name: 0})[2:].partition(" = ")[0]


def joined(findings, study):
    """Findings whose lines for one column hold what the findings before them change in it.

    Parameters
    ----------
    findings : list of Finding
        As they are told; of two lines for a column the later one is to stand in the study, where it may stand once.
    study : Study
        Its columns, as they are before any mend.

    Returns
    -------
    list of Finding
        What is a question is not taken into the lines after it.
    """
    given = {n: _said(column_line(n, c))[n] for n, c in study.columns.items()}
    held, made = dict(given), []
    for finding in findings:
        said = dict(held)
        lines = [_line_after(line, given, said) for line in finding.mend.splitlines()]
        made.append(replace(finding, mend="\n".join(lines)))
        held = held if finding.certainty < 0.5 else said
    return made


def _line_after(line, given, held):
    """A line with what is held of its column, or the part of a log that is left of both; that is held from then on."""
    name, new = next(iter(_said(line).items()), ("", None))
    if name == "time" and isinstance(new, list):  # the part of the logs that is used
        first, last = held.get(_SPAN, new)
        new = [max(first, new[0]), min(last, new[1])]
        if new[0] >= new[1]:
            return line
        held[_SPAN] = new
        return f"{name} = {to_toml(new)}"
    if not isinstance(new, dict):
        return line
    before, now = given.get(name, {}), held.get(name, {})
    new = {k: now.get(k) if new.get(k) == before.get(k) else new.get(k) for k in COLUMN_KEYS}
    held[name] = {k: v for k, v in new.items() if v is not None}
    return f"{_bare(name)} = {to_toml(held[name])}"


def _said(line):
    """What a line of a mend says; nothing where it names a table, or is a comment."""
    return {} if line.startswith(("[", "#")) else tomllib.loads(line)


def scaled(column, factor, unit=None, k_m=None):
    """A column whose readings, in SI units, become ``factor`` times what they were.

    Parameters
    ----------
    column : Column
        As the study has it.
    factor : float
        Of the readings in SI units; negative changes the sign too.
    unit : str, optional
        Unit that does it; else a sign or a gain does.
    k_m : float, optional
        Torque constant [N.m/A] where the unit is a current's.

    Returns
    -------
    Column
    """
    if unit is not None:
        return replace(column, unit=unit, k_m=k_m if known_unit(unit)[0] == "A" else None)
    if factor == -1.0:
        return replace(column, sign=-column.sign)
    return replace(column, gain=column.gain * factor)

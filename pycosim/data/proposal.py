"""A log nobody has described in; which column is likely which variable of a rig, in which unit, and what to ask, out.

What the log itself tells is proposed: names that fit one variable and no other, units that are stated, an interval that
makes a plausible rate in one unit of time alone, a slope that tells degrees from radians. All else is a question, the
same one on the command line and in the app.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..core.errors import DataError, UnknownNameError, closest
from ..core.units import to_si
from ..study.schema import COLUMN_KEYS, LOG_VARIABLES, Column, Setting, Study, known_unit
from ..study.template import first_parameters
from .likeness import WORDS, likeness, stated, words
from .readers import read_parts, stamped
from .readers.look import Look, look

UNITS = {"rad": ("rad", "deg", "rev", "mrad"), "rad/s": ("rad/s", "deg/s", "rpm", "rev/s"), "m": ("m", "mm"),
         "m/s": ("m/s", "mm/s"), "N.m": ("N.m", "mN.m", "N.cm"), "N": ("N", "kN"), "V": ("V", "mV"),
         "A": ("A", "mA"), "s": ("s", "ms", "us", "ns")}
"""Answers to the question for a unit; a current's are answers too where a torque is asked for."""
PLAUSIBLE = 5.0, 10e3
"""Rates [Hz] of logs of drives. An interval that fits one unit of time alone within them tells the unit."""
STEADY = 0.99
"""Share of intervals that must be above zero in a column of time; the rest are mistakes that a reader refuses."""
FEWEST, ALIKE, NEAR = 20, 0.95, 0.05
"""Samples from which on, and correlation above which, an angle and the integral of a speed are of one motion; how near
a slope must be to that of two units."""


@dataclass(frozen=True)
class Question:
    """What the log does not tell.

    Attributes
    ----------
    kind : str
        ``time``, ``column``, ``unit``, ``sign`` or ``k_m``.
    about : tuple of str
        The variable (of a column), or the columns.
    text : str
        The question.
    answers : tuple of str
        What can be answered in one word; empty for a number.
    option : str
        What answers it on the command line.
    """

    kind: str
    about: tuple
    text: str
    answers: tuple
    option: str


@dataclass(frozen=True)
class Given:
    """What the user has said of a log.

    Attributes
    ----------
    columns : dict of str to dict
        Settings of columns, as in a study; each has a ``variable``, a ``unit`` where that was said.
    rate : float or None
        Rows a second [Hz], of a log without a column of time.
    si : bool
        Columns that state no unit are in SI units.
    absent : frozenset of str
        Variables that the log does not hold.
    rated : dict of str to float
        Largest torque and speed of motors, by variable, SI.
    """

    columns: dict = field(default_factory=dict)
    rate: float | None = None
    si: bool = False
    absent: frozenset = frozenset()
    rated: dict = field(default_factory=dict)

    def with_column(self, name, **settings):
        """The same, with settings of one column on top of those that it has.

        Parameters
        ----------
        name : str
            Of the column, as the log's header has it.
        **settings
            Keys of a column of a study.

        Returns
        -------
        Given
        """
        return replace(self, columns={**self.columns, name: {**self.columns.get(name, {}), **settings}})


@dataclass(frozen=True)
class Sample:
    """A log, looked at.

    Attributes
    ----------
    look : Look
        Its head: columns, stated units, layout.
    rows : int
        Of data in the file.
    columns : dict of str to ndarray, shape (n,)
        The columns of numbers, from the first row on: all of it, or the first part of a long one.
    stamps : (str, float) or None
        Column of dates or times of day, and the rows a second [Hz] that they make.
    """

    look: Look
    rows: int
    columns: dict
    stamps: tuple | None = None


@dataclass(frozen=True)
class Proposal:
    """What a log likely holds, and what it does not tell.

    Attributes
    ----------
    sample : Sample
        The log, looked at.
    rig : str
        Full name of the class that the columns are to serve.
    columns : dict of str to Column
        By the column's name; those whose unit is not known have it as an empty text.
    time : str or None
        Column of the time.
    rate : float or None
        As given.
    questions : list of Question
        None are left when a study can be written.
    notes : list of str
        What was concluded from the numbers, and what is not used.
    rated : dict of str to float
        As given.
    """

    sample: Sample
    rig: str
    columns: dict
    time: str | None
    rate: float | None
    questions: list
    notes: list
    rated: dict

    @property
    def settings(self):
        """Keys of `[data]` that read the file, with their values."""
        found = dict(self.sample.look.layout.said)
        if self.sample.look.reader:
            found["reader"] = self.sample.look.reader
        if self.rate is not None:
            found["rate"] = self.rate
            if "time" in self.sample.look.header:  # it was said not to be the time
                found["time_column"] = ""
        elif self.time not in (None, "time"):
            found["time_column"] = self.time
        return found

    def study(self, path, model, runs=None):
        """The study that this makes.

        Parameters
        ----------
        path : path
            Where it would be.
        model : Model
            The rig.
        runs : list of path, optional
            Logs; the one that was looked at by default.

        Returns
        -------
        Study
        """
        free = {n: Setting(fixed=False) for n in first_parameters(model)}
        runs = [Path(p).absolute() for p in runs or [self.sample.look.path]]
        return Study(Path(path), self.rig, parameters=free, runs=runs, columns=self.columns,
                     limits={n: (None, most) for n, most in self.rated.items()}, **self.settings)


def sampled(path):
    """Look at a log, and read its first part.

    Parameters
    ----------
    path : path
        Of the log, in any format that is read.

    Returns
    -------
    Sample

    Raises
    ------
    DataError
        It is not there, or cannot be read as a table.
    """
    seen = look(path)
    rows, tables = read_parts(seen.path, seen.reader, set(seen.numeric), "", seen.layout)
    if rows < 2:
        raise DataError(f"{seen.path}: has one row of data; a log needs at least two")
    return Sample(seen, rows, next(tables).columns, _stamps(seen))


def _stamps(seen):
    """A column of text that is named as the time and holds dates, and the rows a second that they make."""
    for name in (n for n in seen.header if n not in seen.numeric and words(n) and words(n) <= WORDS["s"]):
        cells = next(read_parts(seen.path, seen.reader, set(), name, seen.layout)[1]).columns.get(name, ())
        rate = stamped(cells[:1000]) if len(cells) else None
        if rate:
            return name, rate
    return None


def wanted(model):
    """Variables of a rig that a log can hold.

    Parameters
    ----------
    model : Model
        The rig, without effects.

    Returns
    -------
    dict of str to (str, str)
        Unit, and what it is for: ``needed``, ``compared``, ``optional``.
    """
    outputs, known = model.alternatives("estimate")[0]
    flat = model.variables
    found = {n: (flat[n].unit, "needed") for n in known if n in flat}
    found.update({n: (flat[n].unit, "compared") for n in outputs})
    speeds = [f"{n[:-4]}.w" for n in known if n.endswith(".phi")]
    encoders = list(model.aliases("encoders"))
    found.update({n: (flat[n].unit, "optional") for n in [*speeds, *encoders] if n in flat and n not in found})
    found["temperature"] = LOG_VARIABLES["temperature"], "optional"
    return found


RATED = {"tau": ("N.m", "rated torque"), "w": ("rad/s", "largest speed")}
"""Quantities of a motor that a data sheet has: unit of a turning machine, and what it is called."""


def ratings(model):
    """Variables of a rig's motors that a data sheet rates.

    Parameters
    ----------
    model : Model
        The rig, without effects.

    Returns
    -------
    dict of str to (str, str)
        Unit, and what it is.
    """
    return {f"{m}.{kind}": (model.along(unit), f"{words} of {m}") for kind, (unit, words) in RATED.items()
            for m in model.components("signal") if f"{m}.{kind}" in model.variables}


def with_rating(given, model, name, value, unit=""):
    """What the user has said, with what a data sheet says of a motor.

    Parameters
    ----------
    given : Given
        What was said before.
    model : Model
        The rig, without effects.
    name : str
        As ``motor1.tau``; ``tau`` alone is that of every motor.
    value : float
        Above zero.
    unit : str
        SI by default.

    Returns
    -------
    Given

    Raises
    ------
    UnknownNameError
        The rig has no such quantity, or it has another unit.
    DataError
        The value is not above zero.
    """
    known = ratings(model)
    meant = [n for n in known if n == name or n.rpartition(".")[2] == name]
    if not meant:
        raise UnknownNameError(f"{model.rig}: a motor is rated by {', '.join(known) or 'nothing'}, not by '{name}'"
                               f"{closest(name, known)}")
    if not 0 < value < float("inf"):
        raise DataError(f"{name}: what a motor is rated for must be above zero, not {value:g}")
    sizes = {n: value * (to_si(unit, known[n][0], f"'{n}'") if unit else 1.0) for n in meant}
    return replace(given, rated={**given.rated, **sizes})


def propose(sample, model, given=Given()):
    """What the columns of a log likely are, and what is to be asked.

    Parameters
    ----------
    sample : Sample
        Head and first rows of a log.
    model : Model
        The rig.
    given : Given
        Stands above everything that is concluded.

    Returns
    -------
    Proposal

    Raises
    ------
    UnknownNameError
        What was given names a column, a variable or a unit that does not exist.
    DataError
        A rate was given, and a column is the time.
    """
    _refuse(sample, model, given)
    asked, notes = [], []
    time = _time(sample, given, asked, notes)
    columns, left = _named(sample, model, given, time)
    asked += _missing(model, given, columns, left, sample, time)
    columns = _units(sample, model, given, columns, time, asked, notes)
    unused = [n for n in sample.look.header if n not in columns and n != time]
    if unused:
        notes.append(f"Not used: {', '.join(unused)}.")
    return Proposal(sample, model.rig, columns, time, given.rate, asked, notes, dict(given.rated))


def rig_of(sample, models):
    """The rigs whose needed and compared variables a log's columns name best.

    Parameters
    ----------
    sample : Sample
        Head and first rows of a log.
    models : dict of str to Model
        By the rig's name.

    Returns
    -------
    list of str
        Those that fit equally well, in the given order; empty where no column's name is like a variable's.
    """
    scores = {}
    for rig, model in models.items():
        asked = [n for n, (_, role) in wanted(model).items() if role != "optional"]
        named = {c["variable"] for c in _named(sample, model, Given(), None)[0].values()}
        scores[rig] = sum(n in named for n in asked), -sum(n not in named for n in asked)
    best = max(scores.values())
    return [rig for rig, score in scores.items() if score == best] if best[0] else []


def answered(proposal, given, question, text):
    """What the user has said, with the answer to one question.

    Parameters
    ----------
    proposal : Proposal
        That asked.
    given : Given
        What was said before.
    question : Question
        Says what the answer is about.
    text : str
        One of its answers, or a number.

    Returns
    -------
    Given

    Raises
    ------
    DataError
        It is no answer.
    """
    text = text.strip()
    if question.kind in ("time", "k_m") and text not in question.answers:
        value = _positive(text.replace(",", "."))
        if value is not None and question.kind == "time":
            return replace(given, rate=value)
        if value is not None:
            return _whole(proposal, given, question.about[0], k_m=value)
    if text not in question.answers:
        number = " and no number above zero" if question.kind in ("time", "k_m") else ""
        raise DataError(f"'{text}' is no answer{number}{closest(text, question.answers)}")
    if question.kind == "time":
        return given.with_column(text, variable="time")
    if question.kind == "column":
        if text == NOT_THERE:
            return replace(given, absent=given.absent | {question.about[0]})
        return given.with_column(text, variable=question.about[0])
    if question.kind == "sign":
        return _whole(proposal, given, text, sign=-1)
    for name in question.about:
        given = _whole(proposal, given, name, unit=text)
    return given


NOT_THERE = "-"
"""Answers that the log does not hold a variable."""


def _whole(proposal, given, name, **settings):
    """With settings of a column whose variable may have been concluded, not said."""
    variable = "time" if name == proposal.time else proposal.columns[name].variable
    return given.with_column(name, **{"variable": variable, **settings})


def _positive(text):
    try:
        value = float(text)
    except ValueError:
        return None
    return value if 0 < value < float("inf") else None


def _refuse(sample, model, given):
    """Refuse what names nothing."""
    seen, known = sample.look, {**{n: u for n, (u, _) in wanted(model).items()}, **LOG_VARIABLES,
                                **{n: v.unit for n, v in model.variables.items()}}
    for name, settings in given.columns.items():
        if name not in seen.header:
            raise UnknownNameError(f"{seen.path}: no column '{name}'{closest(name, seen.header)}")
        if name not in seen.numeric:
            raise DataError(f"{seen.path}: column '{name}' holds no numbers")
        for key in settings:
            if key not in COLUMN_KEYS:
                raise UnknownNameError(f"column '{name}': unknown key '{key}'{closest(key, COLUMN_KEYS)}")
        variable, unit = settings["variable"], settings.get("unit")
        if variable not in known:
            raise UnknownNameError(f"column '{name}': no variable '{variable}' in {model.rig}"
                                   f"{closest(variable, [*wanted(model), *LOG_VARIABLES])}")
        if unit and not (unit in UNITS["A"] and known[variable] == "N.m"):
            to_si(unit, known[variable], f"column '{name}'")
    for variable in sorted(given.absent):
        if variable not in known:
            raise UnknownNameError(f"{seen.path}: the log cannot be without '{variable}', for {model.rig} has no such "
                                   f"variable{closest(variable, wanted(model))}")
    times = _times(sample, given)
    if given.rate is not None and len(times) == 1:
        raise DataError(f"{seen.path}: has a column '{times[0]}' that is the time, and a rate ({given.rate:g} Hz) is "
                        "for logs without one; leave the rate out, or take the column out of the log where it is not "
                        "the time")


# --- the time ---------------------------------------------------------------------------------------------------------


def _time(sample, given, asked, notes):
    """Column of the time, or None where there is a rate or a question; a unit of its own goes to the columns."""
    said = next((n for n, c in given.columns.items() if c["variable"] == "time"), None)
    if said is not None or given.rate is not None:
        return said
    rising = [n for n, x in sample.columns.items() if _rises(x) and n not in given.columns]
    named = _times(sample, given)
    if len(named) == 1:
        return named[0]
    stamps, rate = sample.stamps or ("", None)
    rate = f"--rate {rate:g}" if rate else "--rate HZ"
    option = f"--map {named[0] if named else rising[0]}=time:s, or {rate}" if rising else rate
    which = f"Which column is the time ({', '.join(named or rising)})" if rising else (
        f"'{stamps}' holds dates or times of day" if stamps else "No column is a time")
    text = f"{which}, or how many rows a second are there [Hz]?" if rising else (
        f"{which}; how many rows a second are there [Hz]?")
    asked.append(Question("time", (), text, tuple(named or rising), option))
    return None


def _times(sample, given):
    """Columns that are named as the time, and rise as it does."""
    return [n for n, x in sample.columns.items() if n not in given.columns and words(n) and words(n) <= WORDS["s"]
            and _rises(x)]


def _rises(x):
    steps = np.diff(x[np.isfinite(x)])
    return steps.size > 0 and np.mean(steps > 0) >= STEADY


def _time_unit(sample, time, asked, notes):
    """Unit of the time by its intervals; an empty text where two units make plausible rates."""
    x = sample.columns[time]
    step = float(np.median(np.diff(x[np.isfinite(x)])))
    fitting = [u for u in UNITS["s"] if PLAUSIBLE[0] <= 1 / (step * known_unit(u)[1]) <= PLAUSIBLE[1]]
    if len(fitting) == 1:
        rate = 1 / (step * known_unit(fitting[0])[1])
        notes.append(f"'{time}' states no unit; its steps of {step:.4g} make {rate:.4g} Hz in {fitting[0]}, and no "
                     "plausible rate in another unit.")
        return fitting[0]
    asked.append(Question("unit", (time,), f"In which unit is the time '{time}', which goes in steps of {step:.4g}?",
                          UNITS["s"], f"--map {time}=time:ms"))
    return ""


# --- which column is which variable -----------------------------------------------------------------------------------


def _named(sample, model, given, time):
    """Columns that were said, and those whose name is like one variable's and no other's; and likenesses left."""
    found = {n: dict(c) for n, c in given.columns.items() if c["variable"] != "time"}
    taken = {c["variable"] for c in found.values()}
    scores = {(name, variable): likeness(name, stated(sample.look, name), variable, unit, model)
              for name in sample.columns if name not in found and name != time
              for variable, (unit, _) in wanted(model).items() if variable not in taken | given.absent}
    scores = {pair: s for pair, s in scores.items() if s > 0}
    while True:
        clear = [(n, v) for (n, v), s in scores.items()
                 if all(s > other for (m, u), other in scores.items() if (m, u) != (n, v) and (m == n or u == v))]
        if not clear:
            return dict(sorted(found.items(), key=lambda c: sample.look.header.index(c[0]))), scores
        for name, variable in clear:
            found[name] = {"variable": variable}
            scores = {p: s for p, s in scores.items() if p[0] != name and p[1] != variable}


def _missing(model, given, columns, scores, sample, time):
    """Questions for variables that no column's name tells, of the form of the rig's question that is nearest."""
    have = {c["variable"] for c in columns.values()}
    lacking = [[n for n in [*known, *outputs] if n not in have and n in model.variables]
               for outputs, known in model.alternatives("estimate")]
    lacks = next((names for names in lacking if not names), lacking[0])
    free = [n for n in sample.columns if n not in columns and n not in given.columns and n != time]
    for variable in lacks:
        if variable in given.absent:
            continue
        likely = [n for n, v in scores if v == variable]
        unit = model.variables[variable].unit
        text = (f"Which column is {variable} [{unit}], {model.variables[variable].description or 'of the rig'}"
                f"{f' (likely {chr(44).join(likely)})' if likely else ''}? '{NOT_THERE}' if the log does not hold it")
        column = next(iter(likely), "COLUMN")
        yield Question("column", (variable,), text, (*free, NOT_THERE),
                       f"--map {column}={variable}:{unit}, or --without {variable}")


# --- in which unit ----------------------------------------------------------------------------------------------------


def _units(sample, model, given, columns, time, asked, notes):
    """Columns with their units, as far as these are known; questions for the others."""
    units = {n: v.unit for n, v in model.variables.items()} | LOG_VARIABLES
    seen, found = sample.look, {}
    for name, settings in columns.items():
        unit = settings.get("unit") or stated(seen, name) or ""
        quantity = _quantity(name, settings["variable"], units)
        if not unit and (given.si or seen.reader or quantity == "degC"):
            unit = quantity  # of a temperature only differences enter: K and degC are one
        found[name] = Column(**{**settings, "unit": unit})
    seconds = None
    if time is not None:
        said = given.columns.get(time, {"variable": "time"})
        unit = said.get("unit") or stated(seen, time) or ("s" if seen.reader else "")
        clock = Column(**{**said, "unit": unit or _time_unit(sample, time, asked, notes)})
        if clock != Column("time", "s"):
            found = {time: clock, **found}
        seconds = clock.si(sample.columns[time]) if clock.unit else None
    elif given.rate is not None:
        seconds = np.arange(next(iter(sample.columns.values())).size) / given.rate
    if seconds is not None:
        _slopes(sample, found, seconds, units, asked, notes)
    _ask_units(sample, found, units, asked)
    for name, column in found.items():
        if column.unit in UNITS["A"] and column.k_m is None and units[column.variable] == "N.m":
            asked.append(Question("k_m", (name,), f"How many N.m of {column.variable} does one A of '{name}' make "
                                  "(the torque constant k_m)?", (),
                                  f"--map {name}={column.variable}:{column.unit},k_m=0.1"))
    return found


def _quantity(name, variable, units):
    """SI unit of what a column holds: of its variable, or A where a torque was recorded as a current."""
    torque = variable.endswith(".tau") and units[variable] == "N.m"
    return "A" if torque and words(name) & WORDS["A"] else units[variable]


def _ask_units(sample, found, units, asked):
    """One question for all columns of one quantity whose unit is not known."""
    open_ones = {}
    for name, column in found.items():
        if not column.unit and column.variable != "time":
            quantity = _quantity(name, column.variable, units)
            torque = column.variable.endswith(".tau") and quantity == "N.m"
            open_ones.setdefault((quantity, torque), []).append(name)
    for (quantity, torque), names in open_ones.items():
        answers = UNITS.get(quantity, (quantity,)) + (UNITS["A"] if torque else ())
        listed = ", ".join(f"'{n}' ({_range(sample.columns[n])})" for n in names)
        asked.append(Question("unit", tuple(names), f"In which unit {'is' if len(names) == 1 else 'are'} {listed}?",
                              answers, "--map " + " ".join(f"{_quoted(n, found[n])}:{answers[0]}" for n in names)))


def _quoted(name, column):
    text = f"{name}={column.variable}"
    return text if text.isascii() and " " not in text else f"'{text}'"


def _range(x):
    x = x[np.isfinite(x)]
    return f"{x.min():.4g} to {x.max():.4g}" if x.size else "no number"


def _slopes(sample, found, seconds, units, asked, notes):
    """Angle and speed of one component against each other: a unit that one of them lacks, a sign that is not both's."""
    by = {c.variable: n for n, c in found.items()}
    for variable, angle in by.items():
        speed = by.get(f"{variable[:-4]}.w") if variable.endswith(".phi") else None
        slope = _slope(sample.columns[angle], sample.columns[speed], seconds) if speed else None
        if slope is None:
            continue
        for name, other, power in ((angle, speed, -1), (speed, angle, 1)):
            if found[name].unit or not found[other].unit:
                continue
            factor = known_unit(found[other].unit)[1] * abs(slope) ** power  # that this column must have
            fitting = [u for u in UNITS[units[found[name].variable]] if abs(known_unit(u)[1] / factor - 1) < NEAR]
            if len(fitting) == 1:
                found[name] = replace(found[name], unit=fitting[0])
                notes.append(f"'{name}' states no unit; its slope against '{other}' says {fitting[0]}.")
        if slope < 0 and found[angle].sign == found[speed].sign:
            unit = found[speed].unit or units[found[speed].variable]
            asked.append(Question("sign", (angle, speed), f"'{angle}' falls while '{speed}' is above zero: which of "
                                  "the two counts the other way?", (angle, speed),
                                  f"--map {speed}={found[speed].variable}:{unit},sign=-1"))


def _slope(angle, speed, seconds):
    """Change of the angle's numbers over the integral of the speed's, or None where they are not of one motion."""
    whole = np.isfinite(angle) & np.isfinite(speed) & np.isfinite(seconds)
    phi, w, t = angle[whole], speed[whole], seconds[whole]
    if phi.size < FEWEST:
        return None
    travel = np.append(0.0, np.cumsum(np.diff(t) * (w[1:] + w[:-1]) / 2))
    x, y = travel - travel.mean(), phi - phi.mean()
    power = np.sqrt((x @ x) * (y @ y))
    return float(x @ y) / float(x @ x) if power and abs(x @ y) > ALIKE * power else None

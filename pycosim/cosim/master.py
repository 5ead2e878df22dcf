"""A scenario in; its components stepped together at their own rates, a log of what they did, out."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import math
import signal
import threading
import time as clock
import zipfile
import zlib
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ..compile import shared_library
from ..core.errors import CosimulationError, ScenarioError, UnknownNameError, closest
from .components import check_names, make_component, naming
from .scenario import Scenario, cycle, load_scenario

__all__ = ["Cosimulation", "cosimulate"]
_FORMAT = 2  # of a checkpoint; 1 held pickles


@dataclass
class Cosimulation:
    """What came of a scenario.

    Attributes
    ----------
    log : pandas.DataFrame
        ``time`` and the columns of the scenario, as they stand in the file.
    text : str
        The log as CSV.
    time : float
        Simulated up to here [s].
    complete : bool
        False when it was stopped on the way.
    checkpoint : bytes or None
        To go on from; None when it is complete.
    description : dict
        Components, rates, order, connections, and the range of every column.
    """

    log: pd.DataFrame
    text: str
    time: float
    complete: bool
    checkpoint: bytes | None
    description: dict


def cosimulate(scenario, until=None, resume=None, progress=None, library=None, stop=None, save=None, every=60.0,
               allow_python=()):
    """Step the components of a scenario together.

    Parameters
    ----------
    scenario : Scenario or path
        As read, or its file.
    until : float, optional
        Stop at this time [s], with a checkpoint.
    resume : bytes, optional
        Checkpoint to go on from; the log that comes out is the same, bit for bit, as without the stop.
    progress : callable, optional
        Called with a sentence now and then.
    library : Library, optional
        Which holds rigs of plants and controllers; the package's own by default.
    stop : callable, optional
        Called at every instant; true ends the run there, as Ctrl-C does.
    save : callable, optional
        Called with a checkpoint on the way, for what ends a run without asking.
    every : float
        Seconds, by the clock on the wall, from one such checkpoint to the next.
    allow_python : sequence of str or path
        Files of Python classes beside the scenario, or names of installed modules, whose code may run; without it a
        scenario runs no code.

    Returns
    -------
    Cosimulation

    Raises
    ------
    ScenarioError
        The scenario contradicts itself, or the checkpoint is not its own.
    CosimulationError
        A component cannot be loaded, fails on the way, or runs code that is not allowed.
    UnknownNameError
        A variable, parameter, option or machine that does not exist.
    """
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario)
    with ExitStack() as stack:
        master = _Master(scenario, library or shared_library(), stack, progress or (lambda text: None), allow_python)
        if resume is not None:
            master.restore(resume)
        return master.run(until, stop or (lambda: False), _saving(save, every))


def _saving(save, every):
    """``(master)``: hands a checkpoint on when it is time to."""
    last = clock.monotonic()

    def check(master):
        nonlocal last
        if save is not None and clock.monotonic() - last >= every:
            save(master.checkpoint())
            last = clock.monotonic()
    return check


# --- the master ------------------------------------------------------------------------------------------------------


class _Master:
    """Steps the components of a scenario."""

    def __init__(self, scenario, library, stack, progress, allow_python):
        self.scenario, self.progress = scenario, progress
        self.parts = {}
        for c in scenario.components:
            progress(f"preparing {c.name}")
            with naming(scenario, c.name):
                self.parts[c.name] = make_component(scenario, c, library, stack, allow_python)
        self._connect()
        self._clock()
        self._readers()
        self.tick = 0
        self.random = np.random.Generator(np.random.PCG64(scenario.seed))
        self.values = np.zeros(self.size)
        self.rows = io.StringIO()
        self.rows.write(",".join(["time", *scenario.columns]) + "\n")
        self.fresh, self.current = True, ""

    # --- what is connected to what ---

    def _connect(self):
        """Number every value that someone reads, and tell each component which inputs it gets from where."""
        scenario, sources = self.scenario, {}
        for a, source, b, sink in scenario.connections:
            for x, y in [(source, sink)] if source else self._equal_names(a, b):
                self._check_signal(a, x, self.parts[a].known, "variable")
                self._check_signal(b, y, self.parts[b].inputs, "input")
                if (b, y) in sources and sources[b, y] != (a, x):
                    other = ".".join(sources[b, y])
                    raise ScenarioError(f"{scenario.path}: connections: {b}.{y} is connected to {other} and to {a}.{x}")
                sources[b, y] = a, x
        for c in scenario.components:
            check_names(c.inputs, self.parts[c.name].inputs, f"input of {c.name}")
            both = next((n for n in c.inputs if (c.name, n) in sources), None)
            if both:
                raise ScenarioError(f"{scenario.path}: [components.{c.name}]: '{both}' has a value and a connection; "
                                    "keep one")
        self.sources = sources
        self._number([*sources.values(), *(column.signal for column in scenario.columns.values())])

    def _equal_names(self, a, b):
        """Pairs for ``a -> b``: what a has and b takes under the same name."""
        found = [(n, n) for n in self.parts[b].inputs if n in self.parts[a].known and n not in self.parts[a].inputs]
        if not found:
            raise ScenarioError(f"{self.scenario.path}: connections: '{a} -> {b}', but {b} takes nothing that {a} has "
                                f"by the same name; it takes {', '.join(self.parts[b].inputs) or 'nothing'}")
        return found

    def _check_signal(self, component, name, known, what):
        if name not in known:
            raise UnknownNameError(f"{self.scenario.path}: no {what} '{name}' in component '{component}'"
                                   f"{closest(name, known)}")

    def _number(self, signals):
        for component, name in signals:
            self._check_signal(component, name, self.parts[component].known, "variable")
        wanted = {c: list(dict.fromkeys(n for owner, n in signals if owner == c)) for c in self.parts}
        self.slots, self.takes, self.size, where = {}, {}, 0, {}
        for c, names in wanted.items():
            self.slots[c] = slice(self.size, self.size + len(names))
            where.update({(c, n): self.size + k for k, n in enumerate(names)})
            self.size += len(names)
        for c in self.scenario.components:
            inputs = [y for b, y in self.sources if b == c.name]
            with naming(self.scenario, c.name):
                self.parts[c.name].prepare([*inputs, *c.inputs], wanted[c.name])
            self.takes[c.name] = (np.array([where[self.sources[c.name, n]] for n in inputs], int),
                                  np.array(list(c.inputs.values()), float))
        self.columns = [(where[column.signal], column, self.parts[column.signal[0]].labels.get(column.signal[1]))
                        for column in self.scenario.columns.values()]

    # --- time ---

    def _clock(self):
        scenario = self.scenario
        self.rate = cycle([*(c.rate for c in scenario.components), scenario.log_rate])
        self.every = {c.name: int(self.rate / c.rate) for c in scenario.components}
        self.period = {c.name: float(1 / c.rate) for c in scenario.components}
        self.log_every = int(self.rate / scenario.log_rate)
        lengths = [p.length for p in self.parts.values() if p.length is not None]
        duration = scenario.duration if scenario.duration is not None else max(lengths, default=None)
        if duration is None:
            raise ScenarioError(f"{scenario.path}: no duration, and no trajectory that has one; write duration = 10.0")
        self.end = math.floor(duration * float(self.rate) + 1e-6)

    def _time(self, tick):
        return tick * self.rate.denominator / self.rate.numerator

    def _next(self, tick):
        """The next tick at which anything happens."""
        return min((tick // n + 1) * n for n in {*self.every.values(), self.log_every})

    # --- running ---

    def run(self, until, stop, saving):
        """Up to the end, or to where it is stopped; checkpoints on the way."""
        last = self.end if until is None else min(self.end, math.floor(until * float(self.rate) + 1e-6))
        said = -math.inf
        with _interrupts() as interrupted, naming(self.scenario, lambda: self.current):
            if self.fresh:
                self._instant()
            while self.tick < last and not interrupted and not stop():
                self._advance()
                self.tick = min(self._next(self.tick), self.end)
                self._instant()
                saving(self)
                if self._time(self.tick) >= said + 0.01 * self._time(self.end):
                    said = self._time(self.tick)
                    self.progress(f"t = {said:.2f} of {self._time(self.end):g} s")
        return self._result()

    def _due(self):
        return [c.name for c in self.scenario.components if self.tick % self.every[c.name] == 0]

    def _advance(self):
        t = self._time(self.tick)
        for name in self._due():
            self.current = name
            self.parts[name].advance(t, self.period[name])

    def _readers(self):
        """Which components are read before they take their inputs, and which after that at every instant.

        The others are read for the log alone; working out what nobody reads would take as long as the rest.
        """
        order, jacobi = [c.name for c in self.scenario.components], self.scenario.method == "jacobi"
        self.before, self.after = set(), set()
        for c in order:
            readers = [b for (b, _), (a, _) in self.sources.items() if a == c]
            if any(jacobi or order.index(b) <= order.index(c) for b in readers):
                self.before.add(c)
            later = not jacobi and any(order.index(b) > order.index(c) for b in readers)
            alone = any(n % self.every[c] for n in (self.log_every, *(self.every[b] for b in readers)))
            if later or alone or not self.parts[c].readable:
                self.after.add(c)

    def _instant(self):
        """Everything that happens at a communication instant before time goes on."""
        self.fresh, t, due, logged = False, self._time(self.tick), self._due(), self.tick % self.log_every == 0
        for name in due:
            if name in self.before and self.parts[name].readable:
                self.current = name
                self.values[self.slots[name]] = self.parts[name].read()
        before = self.values.copy() if self.scenario.method == "jacobi" else self.values
        for name in due:
            self.current, part = name, self.parts[name]
            numbers, constants = self.takes[name]
            u = np.concatenate([before[numbers], constants]) if constants.size else before[numbers]
            if logged or name in self.after:
                self.values[self.slots[name]] = part.exchange(t, u)
            else:
                part.take(t, u)
        self._check_finite(due, t)
        if logged:
            self._log(t)

    def _check_finite(self, due, t):
        if np.isfinite(self.values).all():
            return
        for self.current in due:
            if not np.isfinite(self.values[self.slots[self.current]]).all():
                raise CosimulationError(f"it gave a value that is not finite at t = {t:g} s")

    def _log(self, t):
        cells = [f"{t:.9g}"]
        for number, column, labels in self.columns:
            value = self.values[number]
            if labels is not None:
                cells.append(labels[int(value)])
                continue
            if column.noise:
                value += column.noise * self.random.standard_normal()
            if column.quantum:
                value = round(value / column.quantum) * column.quantum
            cells.append(f"{value:.12g}")
        self.rows.write(",".join(cells) + "\n")

    def _result(self):
        text, complete = self.rows.getvalue(), self.tick >= self.end
        log = pd.read_csv(io.StringIO(text))
        return Cosimulation(log, text, self._time(self.tick), complete, None if complete else self.checkpoint(),
                            self._describe(log, complete))

    def _describe(self, log, complete):
        s = self.scenario
        ranges = {n: {"unit": self.parts[c.signal[0]].units.get(c.signal[1], "1"), "min": log[n].min(),
                      "max": log[n].max(), "rms": float(np.sqrt(np.mean(log[n] ** 2)))}
                  for n, c in s.columns.items() if pd.api.types.is_numeric_dtype(log[n])}
        return {"schema": 1, "scenario": s.name, "method": s.method, "duration": self._time(self.end),
                "time": self._time(self.tick), "complete": complete, "rows": len(log),
                "components": [{"name": c.name, "is": self.parts[c.name].kind, "what": c.what, "rate": float(c.rate)}
                               for c in s.components],
                "connections": [f"{a}.{x} -> {b}.{y}" for (b, y), (a, x) in self.sources.items()],
                "unconnected": [f"{n}.{i}" for n, p in self.parts.items() for i in p.inputs
                                if (n, i) not in self.sources and i not in self._component(n).inputs],
                "log_rate": float(s.log_rate), "columns": ranges}

    def _component(self, name):
        return next(c for c in self.scenario.components if c.name == name)

    # --- stopping and going on ---

    def checkpoint(self):
        """Everything to go on from."""
        parts = {}
        for name, part in self.parts.items():
            with naming(self.scenario, name):
                parts[name] = base64.b64encode(part.save()).decode()
        content = json.dumps({"format": _FORMAT, "scenario": _digest(self.scenario), "tick": self.tick,
                              "values": base64.b64encode(self.values.tobytes()).decode(), "parts": parts,
                              "random": self.random.bit_generator.state, "log": self.rows.getvalue()}).encode()
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("checkpoint.json", content)
            archive.writestr("sha256", hashlib.sha256(content).hexdigest())
        return packed.getvalue()

    def restore(self, data):
        """Go to where a checkpoint was made."""
        found = _opened(data)
        if found["scenario"] != _digest(self.scenario):
            raise ScenarioError(f"{self.scenario.path}: is not the scenario of the checkpoint, or was changed since; "
                                "start anew without --resume")
        self.tick, self.fresh = found["tick"], False
        self.values[:] = np.frombuffer(base64.b64decode(found["values"]))
        self.random.bit_generator.state = found["random"]
        self.rows = io.StringIO()
        self.rows.write(found["log"])
        for name, part in self.parts.items():
            with naming(self.scenario, name):
                part.load(base64.b64decode(found["parts"][name]))


def _opened(data):
    """Content of a checkpoint."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            content, expected = archive.read("checkpoint.json"), archive.read("sha256").decode()
        if hashlib.sha256(content).hexdigest() != expected:
            raise ValueError
        found = json.loads(content)
        if found["format"] != _FORMAT:
            raise ValueError
        return found
    except (zipfile.BadZipFile, zlib.error, KeyError, ValueError, OSError, EOFError, RuntimeError):
        raise ScenarioError("the checkpoint is damaged, or was written by another version; start anew without "
                            "--resume") from None


def _digest(scenario):
    return hashlib.sha256(scenario.text.encode()).hexdigest()


@contextmanager
def _interrupts():
    """A list that is filled at Ctrl-C, so that a step is never cut in half; a second Ctrl-C is an ordinary one."""
    seen = []
    if threading.current_thread() is not threading.main_thread():
        yield seen
        return
    usual = signal.getsignal(signal.SIGINT)

    def note(number, frame):
        seen.append(number)
        signal.signal(signal.SIGINT, usual)
    signal.signal(signal.SIGINT, note)
    try:
        yield seen
    finally:
        signal.signal(signal.SIGINT, usual)

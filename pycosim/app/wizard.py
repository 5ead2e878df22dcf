"""A log nobody has described in; its mapping, with a picture of each signal and each question beside its field, out."""

from __future__ import annotations

from dataclasses import replace
from html import escape
from pathlib import Path

import numpy as np
from nicegui import ui

from ..data.proposal import UNITS, ratings, wanted, with_rating
from ..study.schema import REFERENCES, known_unit
from ..study.template import rigs

NONE = "(not in the log)"
POINTS, WIDE, HIGH = 200, 220, 44  # of a preview: points, and pixels
# the head that Quasar gives an upload has a button without a name, and a field for files in it without a label
DROP = """
<div class="row items-center q-pa-sm q-gutter-sm no-wrap">
  <q-btn flat icon="add" aria-label="Choose a log" @click="props.pickFiles" />
  <label class="col relative-position cursor-pointer">or drop a log here (CSV and other text, Parquet, MAT, MCAP, MDF)
    <q-uploader-add-trigger /></label>
  <q-spinner v-if="props.isUploading" />
</div>"""


def preview(name, values):
    """A small picture of a column.

    Parameters
    ----------
    name : str
        Of the column.
    values : ndarray, shape (n,)
        In the column's own numbers; NaN leaves a gap.

    Returns
    -------
    str
        SVG with its range in words.
    """
    shown = values[::max(1, values.size // POINTS)]
    whole = values[np.isfinite(values)]
    if not whole.size:
        return f"<span>{escape(name)}: no numbers</span>"
    low, high = float(whole.min()), float(whole.max())
    x = np.linspace(2, WIDE - 2, shown.size)
    y = HIGH - 3 - (shown - low) / ((high - low) or 1.0) * (HIGH - 6)
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y) if np.isfinite(b))
    told = f"{escape(name)}: {low:.4g} to {high:.4g}"
    return (f'<svg role="img" aria-label="{told}" width="{WIDE}" height="{HIGH}" viewBox="0 0 {WIDE} {HIGH}">'
            f'<polyline points="{points}" fill="none" stroke="currentColor" stroke-width="1"/></svg>'
            f'<div style="font-size: 0.75rem">{told}</div>')


class Wizard:
    """From a dropped file to the first comparison, in four steps.

    Its fields are filled in place when what is known changes, in whichever tab: a field that has the focus keeps it.

    Parameters
    ----------
    session : Session
        Its log is mapped; what is answered goes there.
    notice : callable
        Makes a place for what goes wrong at a button.
    """

    def __init__(self, session, notice):
        self.session, self.notice, self.fields, self.filling, self.wrong = session, notice, {}, False, {}

    def build(self):
        """Draw the steps as far as they have come."""
        self.fields = {}
        self._file()
        if self.session.log is None or self.session.bench.study not in (None, self.session.mapped):
            return
        self._machine()
        if self.session.proposal is None:
            return
        self._columns()
        self._compare()
        self.fill()

    # ---- the steps

    def _heading(self, text):
        ui.label(text).classes("text-lg font-bold").props("role=heading aria-level=2")

    def _file(self):
        session = self.session
        self._heading("1. A log, or a study")
        with ui.row().classes("items-end w-full"):
            study = ui.input("Study file on this machine").classes("grow")
            ui.button("Open study", on_click=lambda: session.start("open", session.bench.open, study.value, None,
                                                                   after=("log", "steps", "diagnosis", "plan")))
        self.notice("open")
        with ui.row().classes("items-end w-full"):
            log = ui.input("Log file on this machine").classes("grow")
            ui.button("Use log", on_click=lambda: session.use(log.value))
        dropped = ui.upload(auto_upload=True, on_upload=self._dropped).props("flat bordered").classes("w-full")
        dropped.add_slot("header", DROP)
        self.notice("log")

    async def _dropped(self, event):
        session = self.session
        session.soon("log", session.bench.make)
        if "log" in session.errors:
            return
        path = session.bench.folder / Path(event.file.name).name
        await event.file.save(path)
        session.use(path)

    def _machine(self):
        session = self.session
        self._heading("2. The machine")
        names = {rig: name for name, rig in rigs(session.bench.library).items()}
        ui.select(names, value=session.rig, label="Rig", on_change=lambda e: session.choose(e.value)).classes("w-64")
        self.notice("rig")
        if len(session.likely) != 1:
            ui.label("The columns do not tell which machine it is"
                     + (f"; as likely: {', '.join(session.likely)}." if session.likely else ". Choose one."))
        if session.proposal is not None:
            self._ratings()

    def _ratings(self):
        """What a data sheet says of the motors, for who has it."""
        known = ratings(self.session.model)
        if not known:
            return
        ui.label("What the motors are rated for, if you know it: effects are then told in percent of it, and readings "
                 "beyond it are found.").classes("text-sm")
        with ui.row().classes("items-end"):
            for name, (unit, words) in known.items():
                unit = "rpm" if unit == "rad/s" else unit
                field = ui.number(f"{words} [{unit}]").classes("w-56")
                self.fields[f"rated {name}"] = field.on(
                    "change", lambda name=name, unit=unit, field=field: self._rate_motor(name, field.value, unit))

    def _columns(self):
        session = self.session
        seen = session.sample.look
        self._heading("3. What its columns are")
        ui.label(f"{seen.path.name}: {session.sample.rows} rows{''.join(f', {line}' for line in seen.layout.lines)}")
        self.notes = ui.column().classes("gap-0")
        self.fields["si"] = ui.checkbox("Columns that state no unit are in SI units (rad, rad/s, N.m, s)",
                                        on_change=lambda e: self._tell("si", replace(session.given, si=e.value)))
        with ui.row().classes("items-start w-full"):
            ui.label("time").classes("w-52 pt-4")
            self._select("time", [NONE, *seen.numeric], "Column of the time", lambda v: self._time(v))
            self._select("time unit", list(UNITS["s"]), "Unit of the time", lambda v: self._set("time", unit=v))
            self.fields["rate"] = ui.number("or rows a second [Hz]").classes("w-48").on(
                "change", lambda: self._rate(self.fields["rate"].value))
        for variable, (unit, role) in wanted(session.model).items():
            self._row(variable, unit, role)
        with ui.expansion("Every column of the log").classes("w-full"), ui.row():
            for name, values in session.sample.columns.items():
                ui.html(preview(name, values), sanitize=False)

    def _row(self, variable, unit, role):
        described = self.session.model.variables.get(variable)
        with ui.row().classes("items-start w-full").props(f'role=group aria-label="{variable}"'):
            with ui.column().classes("w-52 gap-0 pt-2"):
                ui.label(f"{variable} [{unit}], {role}")
                if described is not None and described.description:
                    ui.label(described.description).classes("text-xs opacity-80")
            self._select(f"column {variable}", [NONE, *self.session.sample.look.numeric], f"Column of {variable}",
                         lambda v: self._column(variable, v))
            torque = UNITS["A"] if unit == "N.m" and variable.endswith(".tau") else ()
            self._select(f"unit {variable}", [*UNITS.get(unit, (unit,)), *torque], f"Unit of {variable}",
                         lambda v: self._set(variable, unit=v))
            if torque:
                k_m = ui.number("k_m [N.m/A]").classes("w-32").props(f'aria-label="k_m of {variable}"')
                self.fields[f"k_m {variable}"] = k_m.on("change", lambda: self._set(variable, k_m=k_m.value or None))
            self.fields[f"sign {variable}"] = ui.checkbox(
                "negated", on_change=lambda e: self._set(variable, sign=-1 if e.value else 1)).props(
                    f'aria-label="{variable} is negated"')
            self.fields[f"preview {variable}"] = ui.html("", sanitize=False)

    def _select(self, key, options, label, change):
        self.fields[key] = ui.select(options, label=label, on_change=lambda e: change(e.value)).classes("w-52").props(
            "bottom-slots")

    def _compare(self):
        self._heading("4. The first comparison")
        with ui.row().classes("items-end"):
            reference = ui.select(list(REFERENCES), value="unknown", label="Reference torques come from").classes(
                "w-64")
            ui.button("Use these columns", on_click=lambda: self.session.map(reference.value))
        self.notice("map")

    # ---- what a field says

    def _tell(self, place, given):
        if not self.filling:
            self.session.tell(place, given)

    def _without(self, variable):
        """What was said, but for one variable."""
        given = self.session.given
        return replace(given, columns={n: c for n, c in given.columns.items() if c["variable"] != variable},
                       absent=given.absent - {variable})

    def _column(self, variable, name):
        given = self._without(variable)
        self._tell(f"column {variable}", replace(given, absent=given.absent | {variable}) if name in (NONE, None)
                   else given.with_column(name, variable=variable))

    def _time(self, name):
        given = self._without("time")
        self._tell("time", given if name in (NONE, None) else replace(given, rate=None).with_column(
            name, variable="time"))

    def _rate(self, rate):
        given = self._without("time")
        self._tell("rate", replace(given, rate=float(rate) if rate and rate > 0 else None))

    def _rate_motor(self, name, value, unit):
        if self.filling:
            return
        given, place = self.session.given, f"rated {name}"
        if value in (None, ""):
            self._tell(place, replace(given, rated={n: v for n, v in given.rated.items() if n != name}))
            return
        found = self.session.soon(place, with_rating, given, self.session.model, name, float(value), unit)
        if found is not None:
            self._tell(place, found)

    def _set(self, variable, **settings):
        if self.filling:
            return
        proposal = self.session.proposal
        held = {c.variable: n for n, c in proposal.columns.items()} | ({"time": proposal.time} if proposal.time else {})
        place = f"{next(iter(settings))} {variable}"
        if variable not in held:
            self.session.errors[place] = "choose the column first"
            return
        self._tell(place, self.session.given.with_column(held[variable], variable=variable, **settings))

    # ---- what a field shows

    def fill(self):
        """Fill the fields with what is known now, and put each question beside its own."""
        if not self.fields or self.session.proposal is None:
            return
        self.filling = True
        try:
            self._fill(self.session.proposal)
        finally:
            self.filling = False

    def fill_if(self, parts):
        """Fill the fields where answers have changed, or something went wrong at one of them.

        Parameters
        ----------
        parts : collection of str
            Of the session that have changed.
        """
        wrong = {k: t for k, t in self.session.errors.items() if k in self.fields}
        if "answers" in parts or wrong != self.wrong:
            self.wrong = wrong
            self.fill()

    def _fill(self, proposal):
        session, fields, held = self.session, self.fields, {c.variable: (n, c) for n, c in proposal.columns.items()}
        fields["si"].value, fields["rate"].value = session.given.si, proposal.rate
        fields["time"].value = proposal.time or NONE
        unit = held["time"][1].unit if "time" in held else "s" if proposal.time else None
        fields["time unit"].value = unit or None
        for name, (unit, _) in ratings(session.model).items():
            size = session.given.rated.get(name)
            fields[f"rated {name}"].value = (None if size is None else float(
                f"{size / (known_unit('rpm')[1] if unit == 'rad/s' else 1.0):.6g}"))
        for variable in wanted(session.model):
            name, column = held.get(variable, (None, None))
            fields[f"column {variable}"].value = name or NONE
            if column is not None and column.unit and column.unit not in fields[f"unit {variable}"].options:
                fields[f"unit {variable}"].set_options([*fields[f"unit {variable}"].options, column.unit])
            fields[f"unit {variable}"].value = column.unit or None if column else None
            if f"k_m {variable}" in fields:
                fields[f"k_m {variable}"].value = column.k_m if column else None
                fields[f"k_m {variable}"].set_visibility(column is not None and column.unit in UNITS["A"])
            fields[f"sign {variable}"].value = column is not None and column.sign < 0
            fields[f"preview {variable}"].content = (
                "" if name is None else preview(name, session.sample.columns[name]))
        self.notes.clear()
        with self.notes:
            for note in proposal.notes:
                ui.label(note).classes("text-sm")
        self._ask(proposal, held)

    def _ask(self, proposal, held):
        """Questions and refusals, each at its field."""
        told = {key: text for key, text in self.session.errors.items() if key in self.fields}
        variable_of = {n: v for v, (n, _) in held.items()} | ({proposal.time: "time"} if proposal.time else {})
        for question in proposal.questions:
            names = question.about or ("",)
            for name in names if question.kind == "unit" else names[-1:] if question.kind == "sign" else names[:1]:
                variable = variable_of.get(name, name)
                key = {"time": "time", "column": f"column {name}",
                       "unit": "time unit" if variable == "time" else f"unit {variable}",
                       "k_m": f"k_m {variable}", "sign": f"column {variable}"}[question.kind]
                told.setdefault(key, question.text)
        for key, field in self.fields.items():
            if hasattr(field, "error"):
                field.error = told.get(key)

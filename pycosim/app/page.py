"""A workbench in; its page in a browser, out."""

from __future__ import annotations

import socket
from dataclasses import replace
from pathlib import Path

from nicegui import run, ui

from ..compile import compile_model, find_effect
from ..core.errors import PycosimError
from ..diagnosis.compare import worded
from ..diagnosis.dependence import noise_floor
from ..fit.nullspace import number
from ..report import charts, records, sentences
from ..study.schema import Column
from ..study.template import rigs
from .jobs import Cancelled, Job
from .mapping import wanted
from .workbench import Given, Workbench

PRIMARY = "#2b6ea6"  # 5.3 to white, as text and as ground
# NiceGUI resizes a chart that a tab has hidden meanwhile, and Plotly refuses; that is no fault of the page
HIDDEN_CHARTS = """<script>
addEventListener("unhandledrejection", e => { if (/displayed plot div/.test(e.reason)) e.preventDefault(); });
</script>"""
CARDS, DRAWN = 12, 3  # candidates that are listed, and of these with their signature
NONE = "(not in the log)"


class Page:
    """What one browser shows of the workbench.

    Parameters
    ----------
    bench : Workbench
    dark : bool
        The reader's theme.
    """

    def __init__(self, bench, dark):
        self.bench, self.job = bench, None
        self.dark = ui.dark_mode(dark)
        self.window, self.timeline, self.pick, self.log, self.draft = None, None, {}, None, None
        self._header()
        with ui.element("main").classes("w-full max-w-screen-xl mx-auto p-4"):
            self.alert = ui.label().props('role=alert').classes("text-lg font-bold")
            self.alert.set_visibility(False)
            self.summary()
            with ui.tabs().props('aria-label="Steps"') as tabs:
                names = [ui.tab(n) for n in ("Data", "Comparison", "Effects", "Export")]
            panels = ui.tab_panels(tabs, value=names[1 if bench.steps else 0])
            with panels.classes("w-full bg-transparent"):
                for name, part in zip(names, (self.data, self.comparison, self.effects, self.export)):
                    with ui.tab_panel(name):
                        part()

    def _header(self):
        with ui.header().classes("items-center justify-between").style("background: #0b4f7d").props("elevated"):
            ui.label("pycosim").classes("text-xl").props('role=heading aria-level=1')
            with ui.row().classes("items-center"):
                self.state = ui.label("ready").props('role=status aria-live=polite')
                self.cancel = ui.button("Cancel", on_click=self._cancel).props("flat color=white")
                self.cancel.set_visibility(False)
                ui.button("Light or dark", on_click=self._toggle).props("flat color=white")
        ui.timer(0.3, self._tick)

    @property
    def theme(self):
        """Name of the theme."""
        return "dark" if self.dark.value else "light"

    def _toggle(self):
        self.dark.value = not self.dark.value
        self.refresh()

    def _cancel(self):
        if self.job:
            self.job.cancelled = True

    def _tick(self):
        self.cancel.set_visibility(self.job is not None)
        self.state.text = "ready" if self.job is None else (
            "giving up at the next stage" if self.job.cancelled else self.job.told)

    # ---- work

    def fail(self, text):
        """Say what went wrong, in the sentence of the command line.

        Parameters
        ----------
        text : str
        """
        self.alert.text = " ".join(text.split())
        self.alert.set_visibility(bool(text))

    async def work(self, function, *arguments):
        """Do something long in the background.

        Parameters
        ----------
        function : callable
            Takes ``progress``.
        *arguments
            Its arguments.

        Returns
        -------
        object
            What it returned, or True; False where it failed or was given up.
        """
        if self.job:
            self.fail("something is being computed already; wait for it, or cancel it")
            return False
        self.fail("")
        self.job = job = Job()
        try:
            found = await run.io_bound(lambda: function(*arguments, progress=job))
            return True if found is None else found
        except Cancelled:
            self.fail("Given up; everything is as it was before.")
        except PycosimError as error:
            self.fail(str(error))
        except Exception as error:
            self.fail(f"failed: {type(error).__name__}: {error}; this is a fault of pycosim")
        finally:
            self.job = None
        return False

    def refresh(self):
        """Draw everything as the workbench is now."""
        self.window = self.timeline = None
        for part in (self.summary, self.data, self.comparison, self.effects, self.export):
            part.refresh()

    def plot(self, chart):
        """A chart, with words that stand for it.

        Parameters
        ----------
        chart : Chart

        Returns
        -------
        nicegui.ui.plotly
        """
        drawn = ui.plotly(self._figure(chart)).classes("w-full")
        words = chart.caption.replace('"', "'")
        drawn.props(f'role=img aria-label="{words}"')
        ui.label(chart.caption).classes("text-sm opacity-80")
        return drawn

    def _figure(self, chart):
        return {**chart.themed(self.theme), "config": {"responsive": True, "displaylogo": False}}

    # ---- the parts

    def _errors(self, error):
        return sentences.errors_text(error, self.bench.dataset.units)

    @ui.refreshable_method
    def summary(self):
        """The errors now, and the way back."""
        if not self.bench.steps:
            ui.label("Open a study, or drop a log.").classes("text-lg")
            return
        step = self.bench.step
        for line in self.bench.told:
            ui.label(line).classes("font-bold").props("data-check")
        with ui.row().classes("items-center gap-6"):
            ui.label(f"{self.bench.study.name}: {self.bench.names()[-1]}").classes("text-lg")
            ui.label(f"error {self._errors(step.error)}")
            if step.held_out_error:
                held_out = ui.label(f"held-out {self._errors(step.held_out_error)}").classes("font-bold")
                held_out.props("data-held-out")
            undo = ui.button("Undo", on_click=self._undo)
            undo.set_enabled(len(self.bench.steps) > 1)

    @ui.refreshable_method
    def data(self):
        """Pick a study or a log, and say what its columns are."""
        with ui.row().classes("items-end w-full"):
            study = ui.input("Study file on this machine").classes("grow")
            ui.button("Open study", on_click=lambda: self._open(study.value))
        with ui.row().classes("items-end w-full"):
            log = ui.input("Log file on this machine").classes("grow")
            ui.button("Use log", on_click=lambda: self._use(Path(log.value)))
        ui.upload(label="or drop a log here (CSV, Parquet, MAT, MCAP, MDF)", auto_upload=True,
                  on_upload=self._dropped).props("flat bordered").classes("w-full")
        if self.log:
            self._mapping()
        if self.bench.steps:
            for line in sentences.summary_data(self.bench.dataset):
                ui.label(line)
            chart = charts.plane(self.bench.dataset)
            if chart:
                self.plot(chart)

    def _mapping(self):
        """Variables of the rig, and the column that holds each."""
        known = rigs(self.bench.library)
        rig = self.draft.rig
        ui.select({v: k for k, v in known.items()}, value=rig, label="Rig",
                  on_change=lambda e: self._suggest(e.value)).classes("w-64")
        model, by = compile_model(self.bench.library, rig), {c.variable: (n, c) for n, c in self.draft.columns.items()}
        self.pick = {}
        with ui.grid(columns="auto auto auto auto").classes("items-center"):
            for title in ("variable", "column of the log", "unit there", "k_m [N.m/A], of a current"):
                ui.label(title).classes("font-bold")
            for variable, (unit, role) in wanted(model).items():
                name, column = by.get(variable, (NONE, Column(variable, unit)))
                ui.label(f"{variable} [{unit}], {role}")
                self.pick[variable] = (
                    ui.select([NONE, *self.columns], value=name).props(f'dense aria-label="Column of {variable}"'),
                    ui.input(value=column.unit).props(f'dense aria-label="Unit of {variable}"'),
                    ui.number(value=column.k_m).props(f'dense aria-label="k_m of {variable}"')
                    if variable.endswith(".tau") else None)
                if self.pick[variable][2] is None:
                    ui.label("")
        with ui.row().classes("items-end"):
            self.reference = ui.select(["unknown", "sensor", "gravity_model"], value=self.draft.reference,
                                       label="Reference torques come from").classes("w-64")
            ui.button("Use these columns", on_click=self._mapped)

    @ui.refreshable_method
    def comparison(self):
        """Two models against the measurement."""
        if not self.bench.steps:
            ui.label("No data yet.")
            return
        names = self.bench.names()
        with ui.row().classes("items-end"):
            options = dict(enumerate(names))
            first = ui.select(options, value=0, label="Model").classes("w-64")
            second = ui.select(options, value=len(names) - 1, label="and model").classes("w-64")
            ui.button("Compare", on_click=lambda: self.against.refresh(first.value, second.value))
        self.against(0, len(names) - 1)

    @ui.refreshable_method
    def against(self, first, second):
        """Charts of one model, or of two.

        Parameters
        ----------
        first, second : int
            Numbers of the steps.
        """
        d, numbers = self.bench.dataset, list(dict.fromkeys((first, second)))
        models = [(self.bench.steps[k].model, self.bench.steps[k].fit) for k in numbers]
        names = [self.bench.names()[k] for k in numbers]
        if not d.averaged:
            self.timeline = charts.timeline(d, models, names)
            drawn = self.plot(charts.zoomed(self.timeline, self.window))
            drawn.on("plotly_relayout", lambda e: self._zoom(drawn, e.args))
            self._region()
        found = {**{c.choice: c for c in charts.maps(d, models, names)},
                 **{c.choice: c for c in charts.profiles(d, models, names)}}
        if found:
            choice = ui.select(list(found), value=next(iter(found)), label="Where the error is").classes("w-96")
            with ui.column().classes("w-full") as place:
                self.plot(found[choice.value])

            def show():
                place.clear()
                with place:
                    self.plot(found[choice.value])
            choice.on_value_change(show)

    def _region(self):
        """What the error depends on in a part of the log."""
        with ui.row().classes("items-end"):
            end = float(self.timeline.traces[-1]["x"][-1])
            self.begin = ui.number("From [s]", value=0.0, format="%.3g")
            self.end = ui.number("to [s]", value=round(end, 3), format="%.5g")
            ui.button("What does the error depend on here?", on_click=self._depends)
        self.answer = ui.column().props('aria-live=polite')

    @ui.refreshable_method
    def effects(self):
        """Candidates, best first, each to be added with a click."""
        bench = self.bench
        if not bench.steps:
            ui.label("No data yet.")
            return
        ui.button("Diagnose", on_click=self._diagnose)
        if bench.found is not None:
            told = records.diagnosis(bench.found, bench.dataset)
            for line in sentences.summary_diagnosis({**told, "undetectable": []}, bench.library, len(bench.steps) > 1):
                ui.label(line)
            for k, (candidate, finding) in enumerate(zip(told["candidates"][:CARDS], bench.found.candidates)):
                self._card(candidate, finding, k < DRAWN)
            with ui.expansion("What these data cannot show").classes("w-full"):
                for line in sentences.summary_undetectable(told["undetectable"]):
                    ui.label(line)
        floor = noise_floor(bench.dataset, bench.step.model, bench.step.fit)
        self.plot(charts.ladder(bench.dataset, bench.steps, floor))

    def _card(self, told, finding, drawn):
        effect, place = told["effect"], told["place"]
        with ui.card().classes("w-full"):
            with ui.row().classes("items-center justify-between w-full"):
                ui.label(f"{effect.replace('_', ' ')} at {place}" + (" - accepted" if told["accepted"] else "")
                         ).classes("text-lg font-bold").props("role=heading aria-level=3")
                ui.button("Add", on_click=lambda: self._add(effect, place)).props(
                    f'aria-label="Add {effect} at {place}"')
            for line in self._lines(told):
                ui.label(line)
            if drawn and finding.fit is not None:
                self._signature(finding)

    def _lines(self, told):
        yield told.get("sentence") or f"{find_effect(self.bench.library, told['effect']).description}."
        yield ", ".join(sentences.coefficient_text(n, c) for n, c in told["coefficients"].items()) + "."
        change = sentences.change_text(self.bench.step.fit.error, told["predicted_error"], self.bench.dataset.units)
        yield f"p = {number(told['p_value'])} over everything that was tested; error, predicted: {change}."
        yield from sentences.alternatives_text(told, self.bench.library)
        if told.get("experiment"):
            yield f"What would decide: {told['experiment']}."

    def _signature(self, finding):
        step = self.bench.step
        attached = step.model.keys
        model = compile_model(self.bench.library, step.model.rig, [*attached, finding.key])
        self.plot(charts.signature(self.bench.dataset, (step.model, step.fit), (model, finding.fit), finding.key))

    @ui.refreshable_method
    def export(self):
        """The study file and the FMU."""
        if not self.bench.steps:
            ui.label("No data yet.")
            return
        ui.label("The study with everything that was added; the command line reads it as it is.")
        ui.button("Save study", on_click=self._save)
        self.saved = ui.label().props('role=status')
        ui.separator()
        version = ui.select({2: "FMI 2", 3: "FMI 3"}, value=2, label="Version").classes("w-40")
        ui.button("Export FMU", on_click=lambda: self._export(version.value))

    # ---- what a click does

    async def _open(self, path):
        if await self.work(self.bench.open, path, None):
            self.refresh()

    async def _dropped(self, event):
        try:
            self.bench.make()
        except PycosimError as error:
            self.fail(str(error))
            return
        path = self.bench.folder / Path(event.file.name).name
        await event.file.save(path)
        await self._use(path)

    async def _use(self, path):
        """A log: with the columns of the open study, or to be mapped."""
        self.log = None
        if self.bench.study is not None:
            if await self.work(self.bench.take, self.bench.study.with_data([path])):
                self.refresh()
            return
        self.log = path
        self._suggest()

    def _suggest(self, rig=None):
        try:
            self.fail("")
            self.columns = self.bench.header(self.log)
            self.draft = self.bench.suggested(self.log, rig or self.bench.likely_rig(self.log))
        except PycosimError as error:
            self.log = None
            self.fail(str(error))
        self.data.refresh()

    async def _mapped(self):
        columns = {column.value: Column(variable, unit.value, k_m.value if k_m and unit.value in ("A", "mA") else None)
                   for variable, (column, unit, k_m) in self.pick.items() if column.value != NONE}
        study = replace(self.draft, columns=columns, reference=self.reference.value)
        if await self.work(self.bench.take, study):
            self.refresh()

    async def _diagnose(self):
        if await self.work(self.bench.diagnose):
            self.effects.refresh()

    async def _add(self, effect, place):
        if await self.work(self.bench.add, effect, place):
            self.refresh()

    def _undo(self):
        try:
            self.bench.undo()
            self.fail("")
        except PycosimError as error:
            self.fail(str(error))
        self.refresh()

    def _zoom(self, drawn, change):
        if change.get("xaxis.autorange"):
            self.window = None
        elif "xaxis.range[0]" in change:
            self.window = float(change["xaxis.range[0]"]), float(change["xaxis.range[1]"])
        elif "xaxis.range" in change:
            self.window = tuple(map(float, change["xaxis.range"]))
        else:
            return
        drawn.update_figure(self._figure(charts.zoomed(self.timeline, self.window)))
        if self.window:
            self.begin.value, self.end.value = (round(v, 3) for v in self.window)

    def _depends(self):
        self.answer.clear()
        try:
            found = self.bench.region(float(self.begin.value or 0), float(self.end.value or 0))
            self.fail("")
        except PycosimError as error:
            self.fail(str(error))
            return
        with self.answer:
            ui.label(f"{found['samples']} samples with {100 * found['energy']:.1f} % of the error's energy. What bins "
                     "of a variable take of it, in this region alone and without a test against chance:")
            for name, share in found["depends"][:6]:
                ui.label(f"{worded(name)}: {100 * share:.0f} %")

    def _save(self):
        try:
            self.saved.text = f"Saved: {self.bench.save()}"
            self.fail("")
        except PycosimError as error:
            self.fail(str(error))

    async def _export(self, fmi):
        made = await self.work(self.bench.export, fmi)
        if made:
            ui.download.file(made)


def refuse_taken(port):
    """Refuse a port that another program serves.

    Parameters
    ----------
    port : int

    Raises
    ------
    Given
    """
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            why = getattr(error, "strerror", None) or error
            raise Given(f"port {port} cannot be used ({why}); name another one with --port N") from None


def serve(study, data, folder, port, show, progress, say):
    """Serve the page until it is interrupted.

    Parameters
    ----------
    study : path or None
    data : list of path or None
        Logs instead of the study's.
    folder : path
        Where dropped logs, the study and exports go.
    port : int
    show : bool
        Whether to open a browser.
    progress : Progress
        Told what is done until the page is there.
    say : callable
        Told the address then.

    Raises
    ------
    PycosimError
        The given study cannot be used, or the port is taken.
    """
    bench = Workbench(folder)
    refuse_taken(port)
    if study is not None:
        bench.open(study, data, progress)
    progress.stop()
    say(f"http://127.0.0.1:{port} until Ctrl-C")

    @ui.page("/", title="pycosim")
    async def index():
        ui.add_head_html(HIDDEN_CHARTS)
        ui.colors(primary=PRIMARY)
        await ui.context.client.connected()
        Page(bench, bool(await ui.run_javascript("matchMedia('(prefers-color-scheme: dark)').matches")))

    # what is computed holds the interpreter for seconds at a time; a browser must not take that for a lost connection
    ui.run(host="127.0.0.1", port=port, show=show, reload=False, show_welcome_message=False, reconnect_timeout=120.0)

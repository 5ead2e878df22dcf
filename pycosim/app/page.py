"""A session in; its page in a browser, out."""

from __future__ import annotations

import socket

from nicegui import app, run, ui

from ..compile import compile_model
from ..diagnosis.compare import worded
from ..diagnosis.dependence import noise_floor
from ..report import charts, drawings, outcomes, plan_figures, records, schematic, sentences
from .session import Session
from .wizard import Wizard
from .workbench import Given, Workbench

PRIMARY = "#2b6ea6"  # 5.3 to white, as text and as ground
# NiceGUI resizes a chart that a tab has hidden meanwhile, and Plotly refuses; that is no fault of the page
HIDDEN_CHARTS = """<script>
addEventListener("unhandledrejection", e => { if (/displayed plot div/.test(e.reason)) e.preventDefault(); });
</script>"""
# Quasar's own red and the blue of the buttons are too dark on a dark ground: 2.9 and 3.2; these have 8.7 and 8.6; the
# others are the report's, for the drawing
READABLE = """<style>
.body--dark { --q-negative: #ff9a90 !important; }
.body--dark .text-primary { color: #7db8e8 !important; }
.body--dark { --paper: #121212; --muted: #a3adb8; --link: #6fb9f2; --bad: #ff9d5c; }
@media print {
  .q-header, .q-tabs, .q-btn, .q-field, .modebar-container { display: none !important }
  .q-tab-panels, .q-panel, .q-tab-panel { display: block !important; overflow: visible !important }
  .q-page-container { padding-top: 0 !important }
  body { zoom: .55 }  /* the widest page, 1280 px, on a sheet of 718 */
}
""" + schematic.STYLE + "</style>"
CARDS, DRAWN = 12, 3  # candidates that are listed, and of these with their signature
TICK = 0.3  # s between looks at what has changed
SLOW = 60.0  # s in which a browser answers, on a machine that is busy
SOON = 0.05  # s until figures are begun, so that words are there first
RESULTS = "/results"
PARTS = {"log": ("data",), "answers": (), "steps": ("summary", "data", "comparison", "effects", "parameters", "plan",
                                                    "search", "export"),
         "diagnosis": ("summary", "effects"), "plan": ("plan",), "search": ("search",), "saved": ("export",)}
"""What is drawn anew when a part of the session has changed; answers fill their fields instead."""


class Page:
    """What one browser shows of the session; all that it does not share is what it looks at.

    Parameters
    ----------
    session : Session
        Shared by all browsers that look at this app.
    dark : bool
        The reader's theme.
    """

    def __init__(self, session, dark):
        self.session, self.bench = session, session.bench
        self.dark = ui.dark_mode(dark)
        self.window, self.timeline, self.notices = None, None, []
        self.goal, self.budget = "parameters", 120  # of a plan; its fields are drawn anew when one has come
        self.wizard = Wizard(session, self.notice)
        self.seen = session.changed.copy()
        self._header()
        with ui.column().classes("w-full max-w-screen-xl mx-auto p-4 items-stretch"):
            with ui.column().classes("gap-0"):  # no room of their own while nothing goes on
                self.stages = ui.label().classes("text-sm").props("data-stages")
                self.known = ui.label().classes("font-bold").props("data-known role=status aria-live=polite").style(
                    "white-space: pre-line")
            self.summary()
            with ui.tabs().props('aria-label="Steps" mobile-arrows outside-arrows') as tabs:
                names = [ui.tab(n) for n in ("Data", "Comparison", "Effects", "Parameters", "Plan", "Report", "Export")]
            # a panel that slides in moves its buttons from under the pointer
            panels = ui.tab_panels(tabs, value=names[1 if self.bench.steps else 0], animated=False)
            with panels.classes("w-full bg-transparent"):
                for name, part in zip(names, (self.data, self.comparison, self.effects, self.parameters, self.plan,
                                              self.search, self.export)):
                    with ui.tab_panel(name).classes("px-0"):
                        part()
            self.tabs, self.steps = tabs, names
        ui.timer(TICK, self._tick)

    def _header(self):
        with ui.header().classes("items-center justify-between").style("background: #0b4f7d").props("elevated"):
            ui.label("pycosim").classes("text-xl").props('role=heading aria-level=1')
            with ui.row().classes("items-center"):
                self.state = ui.label("ready").props('role=status aria-live=polite')
                self.cancel = ui.button("Cancel", on_click=self.session.cancel).props("flat color=white")
                self.cancel.set_visibility(False)
                ui.button("Light or dark", on_click=self._toggle).props("flat color=white")

    @property
    def theme(self):
        """Name of the theme."""
        return "dark" if self.dark.value else "light"

    def _toggle(self):
        self.dark.value = not self.dark.value
        for part in PARTS["steps"]:
            getattr(self, part).refresh()

    # ---- what the session has meanwhile

    def notice(self, place):
        """A line for what goes wrong at a button.

        Parameters
        ----------
        place : str
            The button's, as in `Session.errors`.
        """
        line = ui.label().props("role=alert").classes("font-bold pl-2").style("border-left: 4px solid #c10015")
        self.notices.append((place, line))
        self._fill(place, line)

    def _fill(self, place, line):
        text = self.session.errors.get(place, "")
        if line.text != text:
            line.text = text
        line.set_visibility(bool(text))

    def _tick(self):
        """Show what has changed, in this tab or another."""
        job, changed = self.session.job, self.session.changed.copy()
        self.cancel.set_visibility(job is not None)
        self.state.text = "ready" if job is None else job.told
        self.stages.text = "" if job is None else "; ".join(
            f"{word}: {', '.join(texts)}" for word, texts in (("Done", job.done), ("now", (job.text,)),
                                                              ("left", job.left)) if texts)
        known = "" if job is None else "\n".join(job.known)
        if self.known.text != known:
            self.known.text = known
        parts = [k for k in changed if changed[k] != self.seen[k]]
        self.seen = changed
        if "steps" in parts:
            self.window = self.timeline = None
            if self.tabs.value in (self.steps[0], "Data"):
                self.tabs.value = "Comparison"
        for name in dict.fromkeys(n for part in parts for n in PARTS[part]):
            getattr(self, name).refresh()
        self.wizard.fill_if(parts)
        self.notices = [(place, line) for place, line in self.notices if not line.is_deleted]
        for place, line in self.notices:
            self._fill(place, line)

    def later(self, make, show=None):
        """Draw charts when the words are there, without holding anything else up.

        Parameters
        ----------
        make : callable
            Describes a plot, or None where there is none; or gives what ``show`` takes.
        show : callable, optional
            Draws it; as one chart by default.
        """
        place = ui.column().classes("w-full")
        with place:
            ui.label("drawing").props("role=status").classes("text-sm")

        async def draw():
            made = await run.io_bound(make)
            if not place.is_deleted:
                place.clear()
                with place:
                    if show:
                        show(made)
                    elif made:
                        self.plot(charts.chart(made))
        ui.timer(SOON, draw, once=True)

    def plot(self, chart):
        """A chart, with words that stand for it.

        Parameters
        ----------
        chart : Chart
            With its title and what it shows in words.

        Returns
        -------
        nicegui.ui.plotly
        """
        drawn = ui.plotly(self._figure(chart)).classes("w-full")
        words = chart.caption.replace('"', "'")
        drawn.props(f'role=group aria-label="{words}"')
        ui.label(chart.caption).classes("text-sm opacity-80")
        return drawn

    def drive_train(self, model, **marked):
        """The drive train, as the report draws it.

        Parameters
        ----------
        model : Model
            Of the rig that is drawn.
        **marked
            Of `pycosim.report.schematic.schematic`.
        """
        ui.html(schematic.figure(model, **marked), sanitize=False).classes("w-full")

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
        if self.bench.found is None and len(self.bench.steps) == 1:
            for line in self.bench.first:
                ui.label(line).props("data-first")
        with ui.row().classes("items-center gap-6"):
            ui.label(f"{self.bench.study.name}: {self.bench.names()[-1]}").classes("text-lg")
            ui.label(f"error {self._errors(step.error)}")
            if step.held_out_error:
                held_out = ui.label(f"held-out {self._errors(step.held_out_error)}").classes("font-bold")
                held_out.props("data-held-out")
            undo = ui.button("Undo", on_click=self._undo)
            undo.set_enabled(len(self.bench.steps) > 1)
        self.notice("undo")

    @ui.refreshable_method
    def data(self):
        """Pick a study or a log, say what its columns are, and see what was read."""
        self.wizard.build()
        if self.bench.steps:
            for line in sentences.summary_data(self.bench.dataset):
                ui.label(line)
            dataset = self.bench.dataset
            self.later(lambda: drawings.manoeuvres(dataset))

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
        error = self.bench.steps[numbers[-1]].error
        self.drive_train(models[-1][0], **schematic.coloured(models[-1][0], error, d.units))
        if not d.averaged:
            self.later(lambda: charts.chart(drawings.timeline(d, models, names)), self._timeline)
        self.later(lambda: {c.choice: charts.chart(c) for c in (
            *drawings.maps(d, models, names), *drawings.profiles(d, models, noise_floor(d, *models[-1]), names))},
            self._choice)

    def _timeline(self, chart):
        self.timeline = chart
        drawn = self.plot(charts.zoomed(chart, self.window))
        drawn.on("plotly_relayout", lambda e: self._zoom(drawn, e.args))
        self._region()

    def _choice(self, found):
        """Charts of where the error is, one at a time."""
        if not found:
            return
        choice = ui.select(list(found), value=next(iter(found)), label="Where the error is").classes("w-full max-w-sm")
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
        self.notice("region")
        self.answer = ui.column().props('aria-live=polite')

    @ui.refreshable_method
    def effects(self):
        """Candidates, best first, each to be added with a click."""
        bench = self.bench
        if not bench.steps:
            ui.label("No data yet.")
            return
        ui.button("Diagnose", on_click=lambda: self.session.start("diagnose", bench.diagnose, after=("diagnosis",)))
        self.notice("diagnose")
        if bench.found is not None:
            told = records.diagnosis(bench.found, bench.dataset)
            for line in sentences.summary_diagnosis({**told, "undetectable": []}, len(bench.steps) > 1):
                ui.label(line)
            self._guess()
            best = [f for f in bench.found.candidates if f.accepted or f.contested][:1]
            alike = [(t["effect"], t["place"]) for f in best for t in f.twins]
            self.drive_train(bench.step.model, **schematic.marked(bench.step.model, [f.key for f in best], alike))
            for k, (candidate, finding) in enumerate(zip(told["candidates"][:CARDS], bench.found.candidates)):
                self._card(candidate, finding, k < DRAWN)
            with ui.expansion("What these data cannot show").classes("w-full"):
                for line in sentences.summary_undetectable(told["undetectable"]):
                    ui.label(line)
        self._own()
        dataset, steps = bench.dataset, bench.steps
        if len(steps) < 2:
            return
        self.later(lambda: outcomes.ladder(dataset.units, steps, noise_floor(dataset, steps[-1].model, steps[-1].fit)))

    def _guess(self):
        """The guess of a shape, as a file, and a way to try it."""
        text = self.bench.diagnosed.guess
        if text:
            with ui.expansion(f"The guess, as a Modelica file: {self.bench.guess}").classes("w-full"):
                ui.label(text).classes("font-mono text-sm").style("white-space: pre-wrap")
            ui.button("Try the guess as an effect", on_click=lambda: self._name(self.bench.guess))

    def _own(self):
        """An effect of the user's own, one file."""
        with ui.row().classes("items-end w-full"):
            path = ui.input("Effect of your own: a Modelica file on this machine").classes("grow")
            ui.button("Use effect file", on_click=lambda: self._name(path.value))
        self.notice("own")

    def _name(self, path):
        self.session.start("own", self.bench.own, path, after=("steps", "diagnosis"))

    def _card(self, told, finding, drawn):
        effect, place = told["effect"], told["place"]
        key = f"add {effect}@{place}"
        with ui.card().classes("w-full"):
            with ui.row().classes("items-center justify-between w-full"):
                ui.label(f"{effect.replace('_', ' ')} at {place}" + (" - accepted" if told["accepted"] else "")
                         ).classes("text-lg font-bold").props("role=heading aria-level=2")
                ui.button("Add", on_click=lambda: self.session.start(key, self.bench.add, effect, place, after=(
                    "steps", "diagnosis"))).props(f'aria-label="Add {effect} at {place}"')
            self.notice(key)
            for line in self._lines(told):
                ui.label(line)
            if drawn and finding.fit is not None:
                self.later(self._signature(finding))

    def _lines(self, told):
        yield told["sentence"]
        change = sentences.change_text(self.bench.step.fit.error, told["predicted_error"], self.bench.dataset.units)
        yield f"Error with it, predicted: {change}."
        winner = told.get("explained_by")
        if winner:
            yield (f"Beside {winner['effect'].replace('_', ' ')} at {winner['place']}, which explains it, nothing is "
                   "left for it to explain.")
        elif told.get("experiment"):
            yield f"What would decide: {told['experiment']}."

    def _signature(self, finding):
        step, dataset = self.bench.step, self.bench.dataset

        def made():
            model = compile_model(self.bench.library, step.model.rig, [*step.model.keys, finding.key])
            return drawings.signature(dataset, (step.model, step.fit), (model, finding.fit), finding.key)
        return made

    @ui.refreshable_method
    def parameters(self):
        """Values, intervals, and what the data do not determine."""
        if not self.bench.steps:
            ui.label("No data yet.")
            return
        fitted = self.bench.fitted
        rows = [{"name": n, "value": sentences.finite(p.value), "unit": "" if p.unit == "1" else p.unit,
                 "description": p.description,
                 "interval": " to ".join(map(sentences.finite, p.ci95)) if p.identifiable
                 else "not determined by itself",
                 "note": f"at its {p.at_bound}" if p.at_bound else ""} for n, p in fitted.params.items()]
        titles = {"name": "parameter", "value": "value", "interval": "95 % interval", "unit": "unit", "note": "note",
                  "description": "what it is"}
        ui.table(rows=rows, row_key="name", columns=[{"name": k, "label": t, "field": k, "align": "left"}
                                                     for k, t in titles.items()]).classes("w-full")
        for line in fitted.undetermined:
            ui.label(line)
        self.later(lambda: outcomes.intervals(fitted.to_dict()))

    @ui.refreshable_method
    def plan(self):
        """The next experiment."""
        bench = self.bench
        if not bench.steps:
            ui.label("No data yet.")
            return
        goals = {"parameters": "narrow the intervals", "alternatives": "separate what the diagnosis could not",
                 "detect": "show what these data could not"}
        with ui.row().classes("items-end"):
            ui.select(goals, label="The experiment should").classes("w-72").bind_value(self, "goal")
            ui.number("longest duration [s]", min=1).classes("w-40").bind_value(self, "budget")
            ui.button("Plan", on_click=lambda: self.session.start(
                "plan", bench.plan, self.goal, float(self.budget or 0), after=("plan",)))
        self.notice("plan")
        if bench.planned is None:
            return
        planned = bench.planned
        for line in planned.sentences:
            ui.label(line)
        ui.button("Take the motion (CSV)", on_click=lambda: self._take(lambda: (
            bench.make(), planned.to_csv(bench.folder / "plan.csv"))[-1]))
        self.notice("take")
        self.later(lambda: plan_figures.motion(planned.planned))

    @ui.refreshable_method
    def search(self):
        """The whole search, and its report."""
        bench = self.bench
        if not bench.steps:
            ui.label("No data yet.")
            return
        ui.label("Effects are added to the base model until nothing is left to learn; the report tells how.")
        ui.button("Search and report", on_click=lambda: self.session.start(
            "search", bench.search, after=("steps", "diagnosis", "search")))
        self.notice("search")
        if bench.searched is None:
            return
        app.add_static_files(RESULTS, bench.folder)
        ui.link("Open the report", f"{RESULTS}/{bench.report.name}", new_tab=True).classes("text-lg").style(
            "color: inherit")
        for line in [*bench.searched.sentences, *bench.searched.changes]:
            ui.label(line)

    @ui.refreshable_method
    def export(self):
        """The study file and the FMU."""
        if not self.bench.steps:
            ui.label("No data yet.")
            return
        ui.label("The study with everything that was added; the command line reads it as it is.")
        ui.button("Save study", on_click=self._save)
        self.notice("save")
        ui.label(self.session.saved).props("role=status")
        ui.separator()
        version = ui.select({2: "FMI 2", 3: "FMI 3"}, value=2, label="Version").classes("w-40")
        ui.button("Export FMU", on_click=lambda: self._export(version.value))
        self.notice("export")

    # ---- what a click does

    def _undo(self):
        self.session.soon("undo", self.bench.undo, after=("steps", "diagnosis"))

    def _take(self, make):
        made = self.session.soon("take", make)
        if made:
            ui.download.file(made)

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
        found = self.session.soon("region", self.bench.region, float(self.begin.value or 0), float(self.end.value or 0))
        if found is None:
            return
        with self.answer:
            ui.label(f"{found['samples']} samples with {100 * found['energy']:.1f} % of the error's energy. What bins "
                     "of a variable take of it, in this region alone and without a test against chance:")
            for name, share in found["depends"][:6]:
                ui.label(f"{worded(name)}: {100 * share:.0f} %")

    def _save(self):
        made = self.session.soon("save", self.bench.save)
        if made:
            self.session.saved = f"Saved: {made}"
            self.session.changed.update(("saved",))

    async def _export(self, fmi):
        made = []
        thread = self.session.start("export", lambda progress: made.append(self.bench.export(fmi, progress)))
        if thread is not None:
            await run.io_bound(thread.join)
        if made:
            ui.download.file(made[0])


def refuse_taken(port):
    """Refuse a port that another program serves.

    Parameters
    ----------
    port : int
        Of this machine, 1 to 65535.

    Raises
    ------
    Given
        Another program serves it, or it is no port; name another one.
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
        Opened at once; without one, a log is asked for.
    data : list of path or None
        Logs instead of the study's.
    folder : path
        Where dropped logs, the study and exports go.
    port : int
        Of this machine, 1 to 65535.
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
    session = Session(bench)
    progress.stop()
    say(f"http://127.0.0.1:{port} until Ctrl-C")

    @ui.page("/", title="pycosim")
    async def index():
        ui.add_head_html(HIDDEN_CHARTS + READABLE)
        ui.colors(primary=PRIMARY)
        client = ui.context.client
        await client.connected()
        dark = await ui.run_javascript("matchMedia('(prefers-color-scheme: dark)').matches", timeout=SLOW)
        if not client.is_deleted:  # else the page was left before it was there
            Page(session, bool(dark))

    # what is computed holds the interpreter for seconds at a time; a browser must not take that for a lost connection
    ui.run(host="127.0.0.1", port=port, show=show, reload=False, show_welcome_message=False, reconnect_timeout=120.0,
           language="en-US")

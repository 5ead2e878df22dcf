"""What users of a page want in; the one state that all their tabs show, and the one piece of work that goes on, out.

No tab holds anything of its own but what it looks at: one that is reloaded, or opened beside another in the middle of
work, shows the same. Work runs in a thread; tabs ask what has changed.
"""

from __future__ import annotations

import threading
from collections import Counter
from pathlib import Path

from ..compile import compile_model
from ..core.errors import PycosimError
from ..data.proposal import Given, answered, propose, rig_of, sampled, wanted
from ..study.template import rigs
from .jobs import Cancelled, Job

FIT = ("reading the logs", "fitting", "looking at the error", "checking the logs", "computing errors")
TEST = ("testing every candidate", "refitting with", "looking at what is left")
STAGES = {"open": FIT, "log": FIT, "map": FIT, "own": FIT, "diagnose": TEST, "add": ("fitting", "computing errors"),
          "search": (*TEST[:1], "adding", "writing the report"), "export": ("building the FMU",),
          "plan": ("setting the experiment up", "optimising the experiment", "predicting the intervals")}
"""How the sentences begin that a piece of work says, in order."""
BUSY = "something is being computed already; wait for it, or cancel it"


class Session:
    """The state of the app.

    Parameters
    ----------
    bench : Workbench
        The study that is worked on.

    Attributes
    ----------
    job : Job or None
        What is going on.
    errors : dict of str to str
        What went wrong, by the button or field that caused it.
    changed : Counter
        How often each part has changed: ``log``, ``answers``, ``steps``, ``diagnosis``, ``plan``, ``search``.
    log : Path or None
        Dropped, and not yet mapped.
    rig : str or None
        Of the log.
    likely : list of str
        Rigs that the log's columns name equally well.
    given : Given
        What was said of the log.
    proposal : Proposal or None
        What its columns are.
    mapped : Study or None
        What became of it; as long as that is worked on, its mapping can be mended.
    """

    def __init__(self, bench):
        self.bench, self.job, self.errors, self.changed = bench, None, {}, Counter()
        self.log = self.rig = self.proposal = self.model = self.mapped = None
        self.likely, self.given, self.saved = [], Given(), ""
        self._lock = threading.Lock()

    # ---- work

    def start(self, place, function, *arguments, after=()):
        """Do something long in the background; refused in words where something is going on.

        Parameters
        ----------
        place : str
            Button that asks for it.
        function : callable
            Takes ``progress``.
        *arguments
            Its arguments.
        after : sequence of str
            Parts that have changed then.

        Returns
        -------
        threading.Thread or None
        """
        with self._lock:
            if self.job is not None:
                self.errors[place] = BUSY
                return None
            self.errors.clear()
            self.job = Job(place, STAGES.get(place.partition(" ")[0], ()))
        thread = threading.Thread(target=self._run, args=(self.job, function, arguments, after), daemon=True)
        thread.start()
        return thread

    def _run(self, job, function, arguments, after):
        try:
            function(*arguments, progress=job)
            self.changed.update(after)
        except Cancelled:
            self.errors[job.place] = "Given up; everything is as it was before."
        except PycosimError as error:
            self.errors[job.place] = " ".join(str(error).split())
        except Exception as error:
            self.errors[job.place] = f"failed: {type(error).__name__}: {error}; this is a fault of pycosim"
        finally:
            self.job = None

    def cancel(self):
        """Give the present work up at its next stage."""
        job = self.job
        if job is not None:
            job.cancelled = True

    def soon(self, place, function, *arguments, after=()):
        """Do something short at once.

        Parameters
        ----------
        place : str
            Button or field that asks for it.
        function : callable
            Too short for a job beside the page.
        *arguments
            Its arguments.
        after : sequence of str
            Parts that have changed then.

        Returns
        -------
        object
            What it returned, or None where it failed.
        """
        try:
            found = function(*arguments)
        except PycosimError as error:
            self.errors[place] = " ".join(str(error).split())
            return None
        self.errors.pop(place, None)
        self.changed.update(after)
        return found

    # ---- a log that has no study

    def use(self, path):
        """Take a log: with the columns of the open study, or to be mapped.

        Parameters
        ----------
        path : path
            Of the log.
        """
        if self.bench.study is not None:
            self.start("log", self.bench.take, self.bench.study.with_data([path]), after=("steps", "diagnosis"))
        else:
            self.soon("log", self._look, Path(path), after=("log", "answers"))

    def _look(self, path):
        sample = sampled(path)
        models = {}
        for name, rig in rigs(self.bench.library).items():
            try:
                models[name] = compile_model(self.bench.library, rig)
                wanted(models[name])
            except PycosimError:  # a rig that cannot be asked for joint torques
                models.pop(name, None)
        likely = rig_of(sample, models)
        self.log, self.given, self.sample, self.likely = Path(path), Given(), sample, likely
        self._choose(models[likely[0]].rig if likely else None)

    def _choose(self, rig):
        self.rig, self.model = rig, compile_model(self.bench.library, rig) if rig else None
        self.given = Given(rate=self.given.rate, si=self.given.si)
        self.proposal = propose(self.sample, self.model, self.given) if rig else None

    def choose(self, rig):
        """Take another rig for the log.

        Parameters
        ----------
        rig : str
            Modelica class.
        """
        self.soon("rig", self._choose, rig, after=("log", "answers"))

    def tell(self, place, given):
        """Take what was said of the log, where it holds.

        Parameters
        ----------
        place : str
            Field that says it.
        given : Given
            Taken over where a proposal can be made with it.
        """
        self.soon(place, self._tell, given, after=("answers",))

    def _tell(self, given):
        self.proposal = propose(self.sample, self.model, given)
        self.given = given

    def answer(self, question, text):
        """Answer a question.

        Parameters
        ----------
        question : Question
            One of the proposal's.
        text : str
            One of its answers, or a number.
        """
        self.tell(place_of(question), answered(self.proposal, self.given, question, text))

    def map(self, reference):
        """Fit the model to the log, once no question is open.

        Parameters
        ----------
        reference : str
            Where the joint torques come from.
        """
        left = len(self.proposal.questions)
        if left:
            self.errors["map"] = f"{left} question{'s are' if left > 1 else ' is'} open, beside the fields above"
            return
        self.mapped = self.bench.mapped(self.proposal, self.model, reference)
        self.start("map", self.bench.take, self.mapped, after=("steps", "diagnosis", "search", "plan"))


def place_of(question):
    """Field that a question stands beside.

    Parameters
    ----------
    question : Question
        One of the proposal's.

    Returns
    -------
    str
        ``time``, ``rate``, or the kind and what it is about.
    """
    return " ".join((question.kind, *question.about[:1]))

"""A study and its logs in; models fitted one after the other, what they leave, and what to add next, out.

What the page shows and does, without a page. Every step is computed first and put in place when whole, so that work
that is given up leaves nothing behind.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..compile import Library, catalogue, places
from ..core.early import tell_early
from ..core.errors import PycosimError, StudyError
from ..core.whole import write_whole
from ..project import open_project
from ..report import values

FEW = 200  # samples below which a region says nothing


class Given(PycosimError):
    """What was asked for cannot be done in this state."""


class _Relay:
    """Passes stages and partial answers on to whoever waits for the present work."""

    def __init__(self):
        self.listener = None

    def __call__(self, text):
        if self.listener is not None:
            self.listener(text)

    def early(self, text):
        """Pass a partial answer on."""
        tell_early(self.listener, text)


class Workbench:
    """The loop: data, comparison, diagnosis, one more effect, and back.

    Parameters
    ----------
    folder : path
        Where dropped logs, the study and exports go; made when first written to.

    Attributes
    ----------
    project : Project or None
        What is worked on.
    fits : list of Fitted
        The base model first; empty until data are read.
    first : list of str
        A first look at the base model, in words.
    diagnosed : Diagnosis or None
        Of the last model; None until asked for.
    searched : Search or None
        The last search, with its report.
    report : Path or None
        Page of the last search; None before one.
    planned : Plan or None
        The last planned experiment.
    """

    def __init__(self, folder):
        self.folder = Path(folder).absolute()
        self.project, self.fits, self.first, self.diagnosed = None, [], [], None
        self.searched = self.report = self.planned = None
        self._library, self._say, self._written = Library(), _Relay(), None

    # ---- what the page shows

    @property
    def library(self):
        """Modelica classes that are known."""
        return self.project.library if self.project else self._library

    @property
    def study(self):
        """The study, or None."""
        return self.project.study if self.project else None

    @property
    def dataset(self):
        """The logs, arranged for a fit, or None."""
        return self.project.dataset if self.project else None

    @property
    def steps(self):
        """Models so far with their errors; the base model first."""
        return [fitted.step for fitted in self.fits]

    @property
    def found(self):
        """What the diagnosis of the last model found, or None."""
        return self.diagnosed.found if self.diagnosed else None

    @property
    def told(self):
        """What the check of the data says, in words."""
        return self.project.check().told if self.project else []

    # ---- data

    def open(self, path, data=None, progress=None):
        """Read a study and its logs, and fit its model.

        Parameters
        ----------
        path : path
            Of the study.
        data : list of path, optional
            Logs instead of the study's.
        progress : callable, optional
            Called with a sentence before each stage.

        Raises
        ------
        PycosimError
            It cannot be done; the present state stays.
        """
        self._take(path, data, progress)

    def take(self, study, progress=None):
        """Work on a study from here on.

        Parameters
        ----------
        study : Study
            Checked against its rig first.
        progress : callable, optional
            Called with a sentence before each stage.

        Raises
        ------
        PycosimError
            The study, or one of its logs, cannot be used; what was there before stays.
        """
        self._take(study, None, progress)

    def _take(self, study, data, progress):
        self._say.listener = progress
        project, first = open_project(study, data, self._say), []
        with suppress(PycosimError):  # what cannot be used is refused below
            first = project.first_look()
        checked = project.check()
        fitted = project.fit()
        fitted.step  # noqa: B018  computed now, not while the page is drawn
        self._say("done")
        self.project, self.fits, self.diagnosed = project, [fitted], None
        self.first = [] if checked.blocking else first  # of a log that is mixed up it would speak of physics
        self.searched = self.report = self.planned = None

    def mapped(self, proposal, model, reference):
        """The study that a mapped log makes.

        Parameters
        ----------
        proposal : Proposal
            Without questions.
        model : Model
            The rig.
        reference : str
            Where the joint torques come from.

        Returns
        -------
        Study
        """
        return replace(proposal.study(self.folder / "study.toml", model), reference=reference)

    # ---- the loop

    @property
    def fitted(self):
        """The model as it is now."""
        if not self.fits:
            raise Given("no data are read yet; open a study or map a log first")
        return self.fits[-1]

    @property
    def step(self):
        """The model as it is now, with its errors."""
        return self.fitted.step

    def diagnose(self, progress=None):
        """Rank the effects that the present model may lack.

        Parameters
        ----------
        progress : callable, optional
            Called with a sentence before each stage.

        Raises
        ------
        PycosimError
            It cannot be done; the present state stays.
        """
        fitted, self._say.listener = self.fitted, progress
        found = fitted.diagnose()
        if self.fitted is fitted:
            if found.guess:
                self.make()
                write_whole(self.guess, found.guess)
            # the machine's own travels, if it found any, are in the study from now on
            self.project, self.fits = found.fitted.project, [*self.fits[:-1], found.fitted]
            self.diagnosed = replace(found, final=len(self.fits) > 1)

    @property
    def guess(self):
        """File of the shape that a diagnosis guesses where no effect explains what is left."""
        return self.folder / "guess.mo"

    def own(self, path, progress=None):
        """Name an effect of one's own in the study, beside those of the library; what was added before stays in.

        Parameters
        ----------
        path : path
            Modelica file of one effect.
        progress : callable, optional
            Called with a sentence before each stage.

        Raises
        ------
        PycosimError
            The file is no effect; what was there before stays.
        """
        if not str(path).strip():
            raise Given("no file is named; give the path of a Modelica file with one effect")
        study = self.fitted.study if len(self.fits) > 1 else self.fitted.project.study
        file = Path(path).expanduser().absolute()
        others = [f for f in study.modelica if f != file]
        _compiled(study, file, others)
        self._take(replace(study, modelica=[*others, file]), None, progress)

    def add(self, effect, place, progress=None):
        """Refit with one more effect.

        Parameters
        ----------
        effect, place : str
            As ``stribeck`` and ``2A``.
        progress : callable, optional
            Called with a sentence before each stage.

        Raises
        ------
        PycosimError
            The effect is there already, or cannot be fitted.
        """
        fitted, self._say.listener = self.fitted, progress
        added = fitted.add(f"{effect}@{place}")
        self._say("done")
        if self.fitted is fitted:
            self.fits, self.diagnosed = [*self.fits, added], None

    def undo(self):
        """Take the last effect out again.

        Raises
        ------
        Given
            Nothing was added.
        """
        if len(self.fits) < 2:
            raise Given("nothing was added yet, so nothing can be taken back")
        self.fits, self.diagnosed = self.fits[:-1], None

    def names(self):
        """What the models so far are called, in order.

        Returns
        -------
        list of str
        """
        return ["base model"] + [f"+ {s.added[0]} at {s.added[1]}" for s in self.steps[1:]]

    def region(self, begin, end, step=None):
        """What the error depends on within a stretch of time.

        Parameters
        ----------
        begin, end : float
            On the clock of the page [s].
        step : Step, optional
            The present one by default.

        Returns
        -------
        dict
            ``samples``, ``energy`` (share of the whole error's), and ``depends``: (variable, share of the region's
            energy that bins of it take away, corrected for their number), most first.

        Raises
        ------
        Given
            Too few samples are in it.
        """
        step = step or self.step
        residual, index, known = values.sampled(self.dataset, step.model, step.fit)
        time = values.clock(self.dataset)[index]
        inside = (time >= begin) & (time <= end)
        n = int(inside.sum())
        if n < FEW:
            raise Given(f"only {n} moving samples are between {begin:.4g} and {end:.4g} s; choose a stretch with at "
                        f"least {FEW}")
        part = residual[:, inside]
        all_of_it = np.ones(n, bool)
        depends = []
        for name, x in known.items():
            if np.ptp(x[inside]) > 0:
                share = values.explained_share(x[inside], part, all_of_it) / len(part)
                depends.append((name, max(0.0, 1 - (1 - share) * (n - 1) / (n - values.BINS))))
        depends.sort(key=lambda d: -d[1])
        return {"samples": n, "energy": float((part ** 2).sum() / (residual ** 2).sum()), "depends": depends}

    def search(self, progress=None):
        """Add effects to the base model until nothing is left to learn, and write the report.

        Parameters
        ----------
        progress : callable, optional
            Called with a sentence before each stage.

        Raises
        ------
        PycosimError
            It cannot be done; the present state stays.
        """
        project, self._say.listener = self.fitted.project, progress
        found = project.improve()
        self.make()
        report = found.report(self.folder / "report.html")
        self._say("done")
        if self.project is project:
            self.project = found.project
            self.fits, self.diagnosed = [step.fitted for step in found.steps], found.last
            self.searched, self.report = found, report

    def plan(self, goal, budget, progress=None):
        """Plan the next experiment from the present model.

        Parameters
        ----------
        goal : str
            As for `Project.plan`.
        budget : float
            Longest duration [s].
        progress : callable, optional
            Called with a sentence before each stage.

        Raises
        ------
        PycosimError
            The limits leave no experiment, or nothing can be learnt.
        """
        fitted, self._say.listener = self.fitted, progress
        planned = fitted.plan(goal, budget)
        self._say("done")
        if self.fitted is fitted:
            self.planned = planned

    # ---- results

    def save(self):
        """Write the study with everything that was added; the given one is never changed.

        Returns
        -------
        Path

        Raises
        ------
        PycosimError
            It cannot be done; the present state stays.
        """
        path = self.folder / "study.toml"
        given = self.study is not None and path.resolve() == self.study.path.resolve() and path.exists()
        if given and path != self._written:
            raise Given(f"{path}: is the given study, which is never changed; start the app with --out DIR")
        if given:  # of a log that was mapped here, and saved here before
            path.unlink()
        self.make()
        self._written = self.fitted.save(path)
        return self._written

    def make(self):
        """Make the folder.

        Raises
        ------
        StudyError
            It cannot be made.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StudyError(f"{self.folder}: cannot be made ({error.strerror}); name another folder with --out "
                             "DIR") from None

    def export(self, fmi=2, progress=None):
        """The present machine as an FMU.

        Parameters
        ----------
        fmi : int
            Version, 2 or 3.
        progress : callable, optional
            Called with a sentence before each stage.

        Returns
        -------
        Path

        Raises
        ------
        PycosimError
            It cannot be done; the present state stays.
        """
        self._say.listener = progress
        self.make()
        self._say("building the FMU")
        made = self.fitted.export(self.folder / "fmu", "fmu", fmi)
        self._say("done")
        return self.folder / "fmu" / next(f for f in made.files if f.endswith(".fmu"))


def _compiled(study, file, others):
    """Refuse a file whose effects cannot be compiled where they sit; a diagnosis would leave them out."""
    library, known = Library([*others, file]), catalogue(Library(others))
    new = [effect for name, effect in catalogue(library).items() if name not in known]
    if not new:
        raise Given(f"{file}: holds no effect; 'extends DriveTrain.Interfaces.SegmentEffect(...)' makes one")
    for effect in new:
        library.flatten(effect.model)
        if not places(library, study.rig, effect):
            raise Given(f"{file}: {effect.id} can sit nowhere in {study.rig}; another interface sits elsewhere")

"""What the diagnosis says: of one effect at one place, and of a fitted model."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Finding:
    """What the diagnosis says of one effect at one place.

    Attributes
    ----------
    twins : list of dict
        Candidates that these data cannot tell from it, each with ``effect`` and ``place``.
    together : list of list of dict
        Pairs of others that do as well, with as many coefficients, or with a small error of the load's model.
    outdone : bool
        Whether those do better, and which of them it is stays open.
    uncounted : set of (str, str)
        Twins that are over between two samples: each may be what it is, and none is a name of its own.
    contested : bool
        So many, or a pair, do as well that its name would be drawn by lot.
    joint : bool
        Chosen together with others, beside which it has not been looked at by itself.
    """

    effect: str
    place: str
    accepted: bool = False
    p_value: float = 1.0
    p_value_single: float = 1.0
    statistic: float = 0.0
    predicted_error: dict = field(default_factory=dict)
    held_out_error: dict | None = None
    coefficients: dict = field(default_factory=dict)
    twins: list = field(default_factory=list)
    together: list = field(default_factory=list)
    outdone: bool = False
    uncounted: set = field(default_factory=set)
    start: dict = field(default_factory=dict)
    sizes: dict = field(default_factory=dict)
    provisional: bool = False
    contested: bool = False
    joint: bool = False
    refused: str | None = None
    explained_by: dict | None = None
    varies_with: str | None = None
    outweighed_by: str | None = None
    selection: object = None
    fit: object = None

    @property
    def key(self):
        """Effect and place."""
        return self.effect, self.place


@dataclass
class Diagnosis:
    """What is missing in a fitted model.

    Attributes
    ----------
    verdict : str
        ``missing_effect``, ``nothing_missing``, ``unexplained`` or ``not_enough_excitation``.
    error, noise_floor : dict of str to float
        RMSE of each channel, and what noise alone would leave, in the channel's unit.
    candidates : list of Finding
        Best first.
    residual_depends_on : list of dict
        Variables, most first, each with its share of the residual's energy and how sure that is.
    undetectable : list of dict
        Effects and places that the log cannot show, each with the reason and an experiment that would.
    noise : list of Noise
        Of single samples, one a channel.
    smallest : list of dict
        Smallest size of each effect at each place that this log would have shown; see `excitation.smallest`.
    excitation : list of dict
        What the log varies.
    unexplained : dict or None
        Where a residual that no effect explains lives; see `unexplained.unexplained`.
    channels : dict of str to dict
        What each channel says for itself: ``verdict``, ``error``, ``floor``, ``resolution``, ``slow``, ``depends_on``.
    later : callable or None
        What finds `unexplained`, until `finish` calls it.
    between : bool
        Whether something is missing that is over between two samples, so that none of what may do it is a name.
    known : (Table, Scores), or None
        Of the model with the winner, for the next diagnosis.
    travels : dict of str to float
        Of the machine's own friction, where the log tells others than the rig's [rad] or [m]; see `own.travels`.
    """

    verdict: str
    error: dict
    noise_floor: dict
    candidates: list
    residual_depends_on: list
    undetectable: list
    noise: list = field(default_factory=list)
    smallest: list = field(default_factory=list)
    excitation: list = field(default_factory=list)
    unexplained: dict | None = None
    channels: dict = field(default_factory=dict)
    later: object = field(default=None, repr=False, compare=False)
    between: bool = False
    known: object = field(default=None, repr=False, compare=False)
    travels: dict = field(default_factory=dict)

    def finish(self):
        """Find where a residual that no effect explains lives, where a search has put that off.

        Returns
        -------
        Diagnosis
            Itself.
        """
        if self.later is not None:
            self.unexplained, self.later = self.later(), None
        return self

    @property
    def provisional(self):
        """What that would be added if, beside others, its coefficient is constant and its rivals fall; or None."""
        return next((c for c in self.candidates if c.provisional), None)

    def accept(self, finding):
        """Accept a finding: beside other effects its coefficient is constant, and few do as well.

        Parameters
        ----------
        finding : Finding
            The provisional one, or one of a pair that was fitted together.
        """
        for other in self.candidates:
            other.accepted = other.provisional = other.contested = False
        known = next(c for c in self.candidates if c.key == finding.key)
        finding.accepted, finding.provisional, finding.contested = True, False, False
        finding.predicted_error = known.predicted_error
        self.candidates = [finding, *(c for c in self.candidates if c is not known)]
        self.verdict, self.unexplained, self.later = "missing_effect", None, None

    def contest(self, pairs, outdone=False):
        """Take back the winner, or what would be gone on with: pairs of effects do as well, with as many coefficients.

        Parameters
        ----------
        pairs : list of list of dict
            Either with ``effect`` and ``place``, and ``small`` if it is a small error of the load's model.
        outdone : bool
            Whether all of them do better.
        """
        best = self.winner or self.provisional
        best.accepted, best.provisional, best.contested = False, True, True
        best.together, best.outdone = pairs, outdone
        self._unexplained()

    def refuse(self, out):
        """Take back the winner where it is one of the effects that a search has taken out at its end.

        Parameters
        ----------
        out : dict of (str, str) to str
            Why, by effect and place.
        """
        best = self.winner
        if best is not None and best.key in out:
            best.accepted, best.refused = False, out[best.key]
            self._unexplained()

    def _unexplained(self):
        for own in self.channels.values():
            own["verdict"] = "unexplained" if own["verdict"] == "missing_effect" else own["verdict"]
        self.verdict = "unexplained"

    @property
    def contested(self):
        """The finding that would be added, did not too many others do as well; or None."""
        return next((c for c in self.candidates if c.contested), None)

    @property
    def winner(self):
        """The finding that would be added, or None."""
        return next((c for c in self.candidates if c.accepted), None)

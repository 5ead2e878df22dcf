"""A study, its rig's model and its logs in; what is compared, and from what it is computed, out."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.errors import StudyError
from .logs import require, require_alike


@dataclass(frozen=True)
class Asked:
    """What the model of a rig is asked about logs.

    Attributes
    ----------
    name : str
        ``estimate``, or ``balance`` where the reference is computed by a model of the load.
    form : int
        Which of the forms of that question: the first whose outputs the logs hold.
    outputs, known : list of str
        Variables that are computed and compared, and those that they are computed from.
    channels : list of str
        Names of the errors: ``C_H``, or ``C_H_pair`` when no reference was measured.
    paired : bool
        Whether half differences between ways out and back are compared, because no reference was measured.
    aliases : dict of str to str
        Measured outputs to the variables of the model that stand for them.
    zeros : list of str
        Parameters that are the zeros of joint encoders.
    """

    name: str
    form: int
    outputs: list
    known: list
    channels: list
    paired: bool
    aliases: dict
    zeros: list

    @classmethod
    def of(cls, study, base, logs):
        """What these logs can be compared with.

        Parameters
        ----------
        study : Study
            Says which reference the torques are compared with.
        base : Model
            The study's rig with its effects.
        logs : list of Log
            A reference that one of them holds must be in all.

        Returns
        -------
        Asked

        Raises
        ------
        StudyError
            The study names a reference that no log holds.
        DataError
            Some logs hold a reference, and others do not.
        """
        have = {v for log in logs for v in log.signals}
        name, forms = "estimate", base.alternatives("estimate")
        form = next((k for k, (wanted, _) in enumerate(forms) if all(w in have for w in wanted)), None)
        balanced = form is None and study.reference == "gravity_model"
        paired = form is None and not balanced
        form = form or 0
        named = forms[form][0]
        if balanced:  # what the leg's model asks for beyond the transmission's torque is the error
            name, forms = "balance", base.alternatives("balance")
        outputs, known = forms[form]
        channels = [f"{c}_pair" for c in named] if paired else list(named)
        aliases, zeros = {}, []
        if not balanced:  # a computed reference knows the load alone
            aliases = base.aliases("sensor" if study.reference == "sensor" else "load")
        for channel, reading in base.aliases("encoders").items():
            if channel in have and not paired:
                aliases[channel], _, zero = reading.partition(":")
                outputs = [*outputs, channel]
                channels.append(channel)
                zeros.append(zero)
        require_alike(logs, outputs)
        if paired and study.reference != "unknown":
            lacking = [o for o in outputs if o not in have]
            beside = f", needed beside {' and '.join(there)}" if (there := [o for o in outputs if o in have]) else ""
            raise StudyError(f'{study.path}: reference = "{study.reference}", but no log holds '
                             f'{", ".join(lacking)}{beside}; log that, or write reference = "unknown"')
        return cls(name, form, outputs, known, channels, paired, aliases, zeros)

    def require(self, study, logs):
        """Refuse logs without what is compared or what that is computed from.

        Parameters
        ----------
        study : Study
            Its ``[columns]`` name what should hold a variable; a push that they do not name is none.
        logs : list of Log
            Each must hold all of it.

        Raises
        ------
        DataError
            Names the log and the column that should hold the first missing variable.
        """
        mapped = {c.variable for c in study.columns.values()}
        for log in logs:
            require(log, [k for k in self.known if k in mapped or not k.startswith("push")])

"""Findings of the data check in; sentences for a terminal, a report and the app, or the refusal to go on, out."""

from __future__ import annotations

import re

from ..core.errors import DataError
from ..data.checks.finding import QUESTION


def sentence(finding):
    """A finding in words: the log as it is, what is wrong and how sure that is.

    Parameters
    ----------
    finding : Finding
        Of a check.

    Returns
    -------
    str
    """
    text = finding.text[0].upper() + finding.text[1:] if finding.text[:1] not in finding.columns else finding.text
    if any(finding.text.startswith(c) for c in finding.columns):
        text = finding.text  # a column keeps its name
    end = "?" if finding.certainty < QUESTION and "?" not in text else "."
    sure = f" ({finding.kind}, {_percent(finding.certainty)})" if finding.wrong else ""
    return f"{text}{sure}{end}"


def _percent(certainty):
    return "more than 99 % sure" if certainty > 0.99 else f"{100 * certainty:.0f} % sure"


def told(checked):
    """What every verb says first, with the lines that mend it; nothing for a sound log.

    Parameters
    ----------
    checked : Checked
        Of a study's logs.

    Returns
    -------
    list of str
    """
    return [line for f in checked.findings if f.told
            for line in (f"Check: {sentence(f)}", *(f"    {mend}" for mend in f.mend.splitlines()))]


def every(checked):
    """All findings, with the lines that mend them.

    Parameters
    ----------
    checked : Checked
        Of a study's logs.

    Returns
    -------
    list of str
    """
    lines = []
    for finding in checked.findings:
        lines.append(sentence(finding))
        lines += [f"    {line}" for line in finding.mend.splitlines()]
        if finding.times and finding.wrong:
            shown = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in finding.times[:5])
            more = f" and {len(finding.times) - 5} more" if len(finding.times) > 5 else ""
            lines.append(f"    at {shown} s{more}")
    if checked.blocking:
        kinds = ", ".join(dict.fromkeys(f'"{f.kind}"' for f in checked.blocking))
        lines.append("diagnose, add, improve and report stop here until the study is mended, or says "
                     f"[data] accept = [{kinds}].")
    elif not any(f.wrong for f in checked.findings):
        lines.append("Nothing is wrong with the wiring, the units or the clocks, as far as these columns can tell.")
    return lines


def refuse(study, checked):
    """Stop a search where the log has a mistake that is no physics.

    Parameters
    ----------
    study : Study
        Named in the refusal, with the line that would go on all the same.
    checked : Checked
        Of a study's logs.

    Raises
    ------
    DataError
        Each mistake and its mend, and how to go on all the same.
    """
    if not checked.blocking:
        return
    wrong = []
    for finding in checked.blocking:
        mend = "; ".join(line for line in re.sub(r"(?m)^(\[\w+\])\n", r"\1 ", finding.mend).splitlines())
        wrong.append(f"{sentence(finding).rstrip('.')}" + (f"; in the study: {mend}" if mend else ""))
    kinds = ", ".join(dict.fromkeys(f'"{f.kind}"' for f in checked.blocking))
    raise DataError(f"{study.path}: {'. '.join(wrong)}. No physics is looked for in such a log; mend the study, or go "
                    f"on with [data] accept = [{kinds}]")

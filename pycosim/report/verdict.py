"""A search, its data set and the data check in; the card that stands first in a report, as words and numbers, out.

Each fact is said once: what is missing and where, how large, how sure, what it brings, what else it could be, what it
changes, what is left, and the one experiment that comes next.
"""

from __future__ import annotations

import math

from ..compile import Place, component_name, find_effect
from ..core.words import listed
from ..diagnosis.decide import FEW
from ..diagnosis.scores import LEVEL
from ..fit.nullspace import number
from . import cards, consequence, controller, findings, schematic, sentences

MOST = 5  # experiments that are listed
UNSEEN = 1e-6  # of what is rated, below which an effect acts only while samples do not move, as presliding
HIDING = 3  # effects that could still hide, in the card


class Verdict:
    """The answer of a search.

    Parameters
    ----------
    dataset : Dataset
        The logs that were searched.
    found : Improvement
        The search, with its steps and its last diagnosis.
    first, last : dict
        ``diagnosis.json`` and ``diagnosis_final.json``.
    parameters : dict
        ``parameters.json``.
    checked : Checked, optional
        What the check of the data found.
    notes : list of str
        Sentences on what the search learnt of the machine beside effects.
    """

    def __init__(self, dataset, found, first, last, parameters, checked=None, notes=()):
        self.notes = list(notes)
        self.dataset, self.library, self.steps = dataset, dataset.library, found.steps
        self.first, self.last, self.parameters, self.checked = first, last, parameters, checked
        self.added = self.steps[1:]
        self.tested = len(first["candidates"])

    def card(self):
        """Everything that the card says.

        Returns
        -------
        dict
            ``verdict``; ``title``; ``findings`` of the data check, as (blocking, sentence, mend); ``drawing`` (HTML,
            trusted); ``rows`` of a heading, its sentences, and a table or None.
        """
        several = len(self.added) > 1
        rows = [("What is missing", [], self._effects()) if several else ("What is missing", self._what()),
                ("How large", [] if several else self._large()), ("How sure", [] if several else self._sure()),
                ("Error before and after" if self.added else "Error", self._error(), self._errors()),
                ("What else it could be", self._else()), ("What it changes", *self._changes()),
                ("What else was learnt", self.notes),
                ("What is left" if self.added else "What could still hide", self._left()),
                ("Next experiment", self.experiments()[:1])]
        return {"verdict": self.first["verdict"], "title": self.title(), "findings": self._findings(),
                "drawing": schematic.figure(self.steps[0].model, **self._marks()),
                "rows": [(name, lines, table[0] if table else None) for name, lines, *table in rows
                         if lines or any(table)]}

    def _findings(self):
        """What the data check found: whether it stops a search, sentence, and the line that mends it, once."""
        told = [f for f in self.checked.findings if f.told] if self.checked is not None else []
        blocking = self.checked.blocking if self.checked is not None else []
        shown = []
        for f in sorted(told, key=lambda f: f not in blocking):
            mend = " ".join(f.mend.split("\n"))
            shown.append((f in blocking, findings.sentence(f), "" if any(mend == m for _, _, m in shown) else mend))
        return shown

    def title(self):
        """The answer in a line.

        Returns
        -------
        str
        """
        if self.added:
            first, more = _named(*self.added[0].added), len(self.added) - 1
            alike = self._alternatives(self.added[0])
            if alike and not more:
                other = _named(alike[0]["effect"], alike[0]["place"])
                return f"The model lacks {first} or {other if len(alike) == 1 else f'one of {len(alike)} alternatives'}"
            second = f" and {_named(*self.added[1].added)}" if more == 1 else ""
            return f"The model lacks {first}{second or (f' and {more} more effects' if more else '')}"
        contested = sentences.contested_of(self.first)
        if contested:
            kinds = {c["effect"] for c in [contested, *contested["twins"]]}
            if contested.get("outdone"):
                return "Something is missing: two effects at once explain it, and which two stays open"
            if contested.get("together"):
                return (f"Something is missing: {_named(contested['effect'], contested['place'])}, or two effects at "
                        "once that explain it no worse")
            return f"Something is missing, and {len(kinds)} effects explain it equally well"
        if sentences.between_of(self.first):
            return "Something is missing that is over within a few samples"
        if unsure := sentences.unconfirmed(self.first):
            return f"Too few passes to tell whether the model lacks {_named(unsure['effect'], unsure['place'])}"
        return {"nothing_missing": "Nothing is missing that these data could show",
                "unexplained": "Something is missing that no effect of the library explains",
                "not_enough_excitation": "These data move too little, or too much alike, to tell",
                "missing_effect": "An effect is missing"}[self.first["verdict"]]

    def _marks(self):
        """What the drawing marks: the effects that were added, and less, what they cannot be told from, or a guess."""
        guess = (self.first.get("unexplained") or {}).get("proposal")
        if not self.added and guess and guess.get("place"):
            return {"also": dict.fromkeys(schematic.components(self.dataset.base, guess["place"]), "a guess")}
        alike = [(t["effect"], t["place"]) for step in self.added for t in self._alternatives(step)]
        if not self.added and (contested := sentences.contested_of(self.first)):
            alike = [(c["effect"], c["place"]) for c in [contested, *contested["twins"]]]
        return schematic.marked(self.dataset.base, [step.added for step in self.added], alike)

    # ---- rows

    def _what(self):
        lines = []
        for step in self.added:
            effect, place = step.added
            base = component_name(find_effect(self.library, effect), Place(place, ()))
            numbers = [sentences.coefficient_text(n[len(base) + 1:], p)
                       for n, p in self.parameters["parameters"].items() if n.startswith(f"{base}.")]
            text = f"At {place}: {consequence.words_of_effect(self.library, effect)}"
            lines.append(f"{text}; {', '.join(numbers)}." if numbers else f"{text}.")
        if not self.added and self.first["verdict"] == "unexplained":
            lines += self._unknown(self.first)
        return lines

    def _unknown(self, told):
        """What a residual that no effect explains depends on, and a guess of its shape; or which explain it alike."""
        if contested := sentences.contested_of(told):
            return [f"{_capital(sentences.equals(contested))}."]
        if passing := sentences.between_of(told):
            names = listed([_named(c["effect"], c["place"]) for c in passing])
            return [f"These data do not show what: {names} would each lower the error."]
        depends = [f"{sentences.worded(d['variable'])} ({100 * d['strength']:.0f} % of its energy)"
                   for d in told["residual_depends_on"] if d["strength"] > 0][:2]
        lines = sentences.of_no_motion(told["channels"])
        lines += [f"What is left depends most on {listed(depends)}."] if depends else []
        left = told.get("unexplained")
        return lines + [left[key]["text"] for key in ("proposal", "free") if left and left.get(key)]

    def _effects(self):
        """Table of several effects: what each is, how large and how sure, in the order of the search."""
        rows = []
        for step, size in zip(self.added, self._sizes()):
            share = f"{sentences.percent(size['share'])} % of {size['of']}" if (size["share"] or 0) > UNSEEN else ""
            rows.append((_named(*step.added), consequence.words_of_effect(self.library, step.added[0]), _amount(size),
                         share,
                         cards.chance(step.finding.p_value) if step.finding is not None else ""))
        return {"caption": f"In the order in which they were found, among {self.tested} effects and places tested",
                "header": ("effect", "what it is", "up to", "that is", "chance alone does as much in"), "rows": rows}

    def _large(self):
        return [f"{_size(found)}." for found in self._sizes()]

    def _sizes(self):
        """Size of every effect that was added."""
        pairs = [((a.model, a.fit), (b.model, b.fit), b.added) for a, b in zip(self.steps, self.added)]
        return [consequence.size(self.dataset, *pair) for pair in pairs]

    def _sure(self):
        lines = [f"{cards.certainty(s.finding.p_value)}, among all {self.tested} effects and places tested."
                 for s in self.added if s.finding is not None]
        if self.added and self._alternatives(self.added[0]):
            lines.append("So sure it is that something is missing; which of the alternatives stays open.")
        if not self.added and self.first["verdict"] == "unexplained":
            lines += sentences.certainty_of_unknown(self.first)
        if not self.added and (unsure := sentences.unconfirmed(self.first)):
            lines.append(f"{cards.certainty(unsure['p_value'])}; but there are too few passes to see whether it "
                         "predicts one that it was not fitted to.")
        best = min(self.first["candidates"], key=lambda c: c["p_value"], default=None)
        if not self.added and best and self.first["verdict"] == "nothing_missing":
            lines.append(f"Of {self.tested} effects and places tested the likeliest is "
                         f"{_named(best['effect'], best['place'])}; chance alone would find something as large in "
                         f"{cards.chance(best['p_value'])} (p = {number(best['p_value'])}); an effect counts "
                         f"below p = {LEVEL:g}{sentences.but(best)}.")
        return lines

    def _error(self):
        floor = {c: v for c, v in self.last["noise_floor"].items() if v is not None}
        return [f"No model of this kind gets below the noise, {sentences.errors_text(floor, self.dataset.units)}."
                ] if floor else []

    def _errors(self):
        """Table of errors, a row a channel, in its unit and of what is rated."""
        first, last = self.steps[0], self.steps[-1]
        held = bool(first.held_out_error and last.held_out_error)
        before, after = (s.held_out_error if held else s.error for s in (first, last))
        shares = [consequence.errors_of_rated(self.dataset, e) for e in (before, after)]
        rows = []
        for c in [c for c in before if c in after]:
            ends = [(before[c], shares[0].get(c)), (after[c], shares[1].get(c))][:len(self.steps)]
            rows.append((sentences.labelled(c, self.dataset.units[c]), *(_of(*e) for e in ends), *(
                [f"{100 * (after[c] / before[c] - 1):+.0f} %".replace("-", "−")] if self.added and before[c] else [])))
        kinds = list(dict.fromkeys(s[1] for s in shares[0].values()))
        of = f"; in brackets: of {kinds[0] if len(kinds) == 1 else 'the largest in the log'}" if kinds else ""
        where = "passes held out of every fit and every choice" if held else "the fitted passes (none is held out)"
        header = ("", "before", "after", "change") if self.added else ("", "error")
        return {"caption": f"RMS error on {where}{of}", "header": header, "rows": rows}

    def _else(self):
        lines = []
        for step in self.added:
            twins = self._alternatives(step)
            if twins:
                names = listed([_named(t["effect"], t["place"]) for t in twins])
                lines.append(f"These data cannot tell {_named(*step.added)} from {names}.")
        if self.added and not lines:
            lines.append("Nothing else in the library explains these data as well.")
        return lines

    def _alternatives(self, step):
        """What the data cannot tell an added effect from, without what was added as well."""
        added = {s.added for s in self.added}
        twins = step.finding.twins if step.finding is not None else []
        return [t for t in twins if (t["effect"], t["place"]) not in added]

    def _changes(self):
        """What the effects change for a controller: how the numbers came about, and their table."""
        if not self.added:
            return [], None
        found = self._controller()
        rows = controller.table(self.dataset, found)
        table = {"caption": "A controller that works its torque out ahead, without and with what was added",
                 "header": ("", "before", "after", "change"), "rows": rows} if rows else None
        return controller.told(self.dataset, found), table

    def _controller(self):
        first, last = self.steps[0], self.steps[-1]
        return controller.changes(self.dataset, (first.model, first.fit), (last.model, last.fit))

    def _left(self):
        verdict, lines = self.last["verdict"], []
        if self.added:
            lines = {"nothing_missing": ["Nothing else is missing that these data could show."],
                     "unexplained": ["Something else is missing that no effect of the library explains."
                                     if sentences.contested_of(self.last) is None else
                                     "Something else is missing, and several effects explain it equally well.",
                                     *self._unknown(self.last), *sentences.certainty_of_unknown(self.last)],
                     "not_enough_excitation": ["What else may be missing these data move too little to tell."],
                     "missing_effect": ["More is missing than this search was allowed to add."]}[verdict]
        if verdict == "nothing_missing":
            lines += sentences.smallest_text([{**e, "effect": e["effect"].replace("_", " ")}
                                              for e in self.last["smallest_detectable"]], HIDING)
        return lines

    # ---- what to measure

    def experiments(self):
        """What to measure next, the most telling first.

        Returns
        -------
        list of str
            Sentences, at most `MOST`.
        """
        found = []
        for step in self.added:
            twins = self._alternatives(step)
            text = cards.experiment(self.library, step.finding, 1) if twins else ""
            if text:
                names = listed([_named(t["effect"], t["place"]) for t in twins])
                found.append(f"{_capital(text)}: that tells {_named(*step.added)} from {names}.")
        contested = sentences.contested_of(self.last)
        if contested and contested["experiment"]:
            found.append(f"{_capital(contested['experiment'])}: that tells apart what does equally well.")
        if unsure := sentences.unconfirmed(self.last):
            found.append(f"Record more of the same, so that {FEW} passes at least can be fitted and others held out: "
                         f"that shows whether {_named(unsure['effect'], unsure['place'])} predicts what it was not "
                         "fitted to.")
        if sentences.between_of(self.last):
            found.append("Record the same faster, by several times: that shows what happens in these few samples.")
        elif self.last["verdict"] == "unexplained" and not contested:
            beats = [c for c, own in self.last["channels"].items() if own.get("beat")]
            depends = next((d["variable"] for d in self.last["residual_depends_on"] if d["strength"] > 0), None)
            if beats:
                found.append(f"Record {listed(beats)} while nothing moves, once with the drives on and once "
                             "with them off: what beats then comes from elsewhere, and its source can be found.")
            elif depends:
                found.append(f"Repeat the same passes at several values of {sentences.worded(depends)}, all else "
                             "alike: what is left depends on it most, and its law shows then.")
        if self.added:
            found.append("Record the motion once more and run 'pycosim confirm' with the improved study: the log that "
                         "chose an effect cannot confirm it.")
        return (found + self._unseen())[:MOST]

    def _unseen(self):
        """Experiments that would show what these data cannot, the one that shows most effects first."""
        groups = {}
        for e in self.last["undetectable"]:
            if e["experiment"]:
                groups.setdefault(e["experiment"], {}).setdefault(e["effect"], []).append(e["place"])
        ranked = sorted(groups.items(), key=lambda g: -len(g[1]))
        return [f"{_capital(text)}: that shows "
                f"{listed([e.replace('_', ' ') for e in effects])}, invisible so far."
                for text, effects in ranked]


def _named(effect, place):
    return f"{effect.replace('_', ' ')} at {place}"


def _capital(text):
    return text[:1].upper() + text[1:]


def _of(value, share):
    """An error, and what it is of what is rated."""
    return number(value) + (f" ({sentences.percent(share[0])} %)" if share else "")


def _amount(found):
    """Largest value of an effect, with its unit."""
    unit = "" if found["unit"] in ("1", "") else f" {found['unit']}"
    if found["rated"] and found["value"] < UNSEEN * found["rated"]:
        return "nothing while moving"
    return f"{number(found['value'])}{unit}"


def _size(found):
    """How large an effect is, in words."""
    text = f"Up to {_amount(found)} at {found['where']}"
    if found["share"] is not None and math.isfinite(found["share"]):
        unit = "" if found["unit"] in ("1", "") else f" {found['unit']}"
        return f"{text}, {sentences.percent(found['share'])} % of {found['of']} ({number(found['rated'])}{unit})"
    if found.get("channel"):
        other = _size(found["channel"]).removeprefix("Up to ").replace(f" at {found['channel']['where']}", "", 1)
        return f"{text}, which changes {found['channel']['where']} by up to {other}"
    return text

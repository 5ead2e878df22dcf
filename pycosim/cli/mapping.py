"""A log and what the command line says of it in; its columns mapped, after asking what nobody has told, out."""

from __future__ import annotations

import sys

from ..compile import compile_model
from ..core.errors import DataError, PycosimError, closest
from ..core.words import listed
from ..data.proposal import RATED, Given, answered, propose, ratings, rig_of, sampled, with_rating
from ..study.template import rigs
from ..study.toml import to_toml
from .parser import UsageError

_NUMBERS = ("k_m", "zero", "gain", "offset", "sign", "wrap", "late", "clock")


def refuse_unused(arguments):
    """Refuse what is said of a log where there is none.

    Parameters
    ----------
    arguments : argparse.Namespace
        As `parser.parse` gives them, of the verb ``new``.

    Raises
    ------
    UsageError
        An option speaks of a log, and none is given.
    """
    said = {"--map": arguments.columns, "--rate": arguments.rate is not None, "--si": arguments.si,
            "--without": arguments.without, "--rated": arguments.rated}
    for option, used in said.items():
        if used:
            raise UsageError(f"{option} says something of a log; name the log with --data FILE")


def given(arguments, header):
    """What the command line says of the log.

    Parameters
    ----------
    arguments : argparse.Namespace
        As `parser.parse` gives them, of the verb ``new``.
    header : list of str
        Columns of the log.

    Returns
    -------
    Given

    Raises
    ------
    UsageError
        A rate is not above zero, or what is said of a column cannot be read.
    """
    if arguments.rate is not None and not 0 < arguments.rate < float("inf"):
        raise UsageError(f"--rate {arguments.rate:g}: must be above zero, in Hz")
    return Given(dict(_column(text, header) for text in arguments.columns), arguments.rate, arguments.si,
                 frozenset(arguments.without))


def rated(arguments, model, said):
    """What the command line says that motors are rated for.

    Parameters
    ----------
    arguments : argparse.Namespace
        As `parser.parse` gives them, of the verb ``new``.
    model : Model
        The rig, without effects.
    said : Given
        What was said of the columns; ratings are added to it.

    Returns
    -------
    Given

    Raises
    ------
    UsageError
        Not a name, a number and perhaps a unit.
    PycosimError
        The rig has no such quantity.
    """
    for text in arguments.rated:
        name, _, value = text.partition("=")
        number, _, unit = value.partition(":")
        try:
            size = float(number)
        except ValueError:
            raise UsageError(f"--rated {text}: write VARIABLE=VALUE[:UNIT], as motor1.tau=15 or w=3000:rpm") from None
        said = with_rating(said, model, name.strip(), size, unit.strip())
    return said


def _asked_rated(model, said, terminal):
    """What the motors are rated for, where the user knows it: one answer for all motors, none leaves it open."""
    for kind, (unit, words) in RATED.items():
        if any(n.endswith(f".{kind}") for n in ratings(model)):
            unit = model.along(unit)

            def take(text, kind=kind):
                if not text:
                    return said
                number, _, given_unit = text.replace(" ", ":", 1).partition(":")
                try:
                    size = float(number.replace(",", "."))
                except ValueError:
                    raise DataError(f"'{text}' is no number with a unit") from None
                return with_rating(said, model, kind, size, given_unit.strip())
            said = _asked(f"What is the {words} of the motors [{unit}], if you know it (Enter: not known)?", take,
                          terminal, "")
    return said


def _column(text, header):
    """Name and settings of ``q1=motor1.phi:deg,sign=-1``; a name may hold such signs itself."""
    names = [n for n in header if text.startswith(f"{n}=")]
    name = max(names, key=len) if names else text.partition("=")[0]
    what, *settings = text[len(name) + 1:].split(",")
    variable, _, unit = what.partition(":")
    if not variable:
        raise UsageError(f"--map {text}: write COLUMN=VARIABLE:UNIT, as q1=motor1.phi:deg")
    found = {"variable": variable.strip(), **({"unit": unit.strip()} if unit else {})}
    for setting in settings:
        key, _, value = setting.partition("=")
        if key not in _NUMBERS:
            raise UsageError(f"--map {text}: unknown key '{key}'{closest(key, _NUMBERS)}")
        try:
            found[key] = int(value) if key == "sign" else float(value)
        except ValueError:
            raise UsageError(f"--map {text}: {key} = '{value}' is not a number") from None
    return name, found


def rig_by_log(library, arguments, terminal):
    """The rig that the columns of a log name best; asked where several are alike.

    Parameters
    ----------
    library : Library
        Holds the rigs.
    arguments : argparse.Namespace
        As `parser.parse` gives them, of the verb ``new``.
    terminal : file
        Where answers come from.

    Returns
    -------
    str

    Raises
    ------
    UsageError
        Nobody is there to ask.
    """
    known = rigs(library)
    models = {}
    for short, rig in known.items():
        try:
            models[short] = compile_model(library, rig)
            models[short].alternatives("estimate")
        except PycosimError:  # a rig that cannot be asked for what is measured
            models.pop(short, None)
    likely = rig_of(sampled(arguments.data[0]), models)
    if len(likely) == 1:
        return known[likely[0]]
    question = f"Which machine is it ({', '.join(likely or models)})?"
    if not terminal.isatty():
        raise UsageError(f"{arguments.data[0]}: its columns do not tell which machine it is; name it: pycosim new "
                         f"{(likely or [*known])[0]} --data .., or {', '.join((likely or [*known])[1:])}, or a file of "
                         "your own, as winch.mo")
    return known[_asked(question, lambda text: _one(text, models), terminal)]


def _one(text, known):
    if text not in known:
        raise DataError(f"no rig '{text}'{closest(text, known)}")
    return text


def mapped(library, rig, arguments, terminal):
    """What the columns of the logs are, after asking.

    Parameters
    ----------
    library : Library
        Holds the rigs.
    rig : str
        Full name of the class that the columns are to serve.
    arguments : argparse.Namespace
        As `parser.parse` gives them, of the verb ``new``.
    terminal : file
        Where answers come from.

    Returns
    -------
    Proposal
        Without questions.

    Raises
    ------
    UsageError
        Nobody is there to ask; the message has what to give.
    DataError
        A log cannot be read, or another one lacks the columns of the first.
    """
    model, sample = compile_model(library, rig), sampled(arguments.data[0])
    said = rated(arguments, model, given(arguments, sample.look.header))
    proposal = propose(sample, model, said)
    if proposal.questions and not terminal.isatty():
        raise UsageError(f"{sample.look.path}: {_all_of(proposal.questions)}")
    if proposal.questions:
        print(*_layout(sample), sep="\n")
    while proposal.questions:
        question = proposal.questions[0]
        choices = f" ({', '.join(question.answers)})" if question.answers and question.kind != "column" else ""
        said = _asked(f"{question.text}{choices}", lambda text: answered(proposal, said, question, text), terminal)
        proposal = propose(sample, model, said)
    if terminal.isatty() and not said.rated:
        proposal = propose(sample, model, _asked_rated(model, said, terminal))
    for path in arguments.data[1:]:
        _refuse_other(sampled(path), proposal)
    return proposal


def _all_of(questions):
    """Questions as one sentence, and what to type."""
    by = {}
    for q in questions:
        by.setdefault(q.kind, []).append(q)
    open_ones = []
    if "time" in by:
        open_ones.append("the column of the time")
    if "column" in by:
        open_ones.append(f"the columns of {listed(q.about[0] for q in by['column'])}")
    if "unit" in by:
        open_ones.append(f"the units of {listed(repr(n) for q in by['unit'] for n in q.about)}")
    for q in by.get("k_m", []):
        open_ones.append(f"the torque constant of '{q.about[0]}'")
    for q in by.get("sign", []):
        open_ones.append(f"which of '{q.about[0]}' and '{q.about[1]}' counts the other way")
    options = [q.option.partition(", or ")[0] for q in questions]
    maps = [o.removeprefix("--map ") for o in options if o.startswith("--map")]
    typed = [*([f"--map {' '.join(maps)}"] if maps else []), *(o for o in options if not o.startswith("--map"))]
    plain = ", or --si where what states no unit is in SI units" if "unit" in by else ""
    none = "; --without VARIABLE where the log does not hold one" if "column" in by else ""
    return (f"the log does not tell {listed(open_ones)}; say it, with the columns and units of yours: "
            f"{' '.join(typed)}{plain}{none}")


def _asked(question, accept, terminal, otherwise=None):
    """An answer that was accepted; what is wrong with one is said, and asked again. Some can do without one."""
    while True:
        print(f"{question} ", end="", flush=True)
        line = terminal.readline()
        if not line and otherwise is not None:
            return accept(otherwise)
        if not line:
            raise UsageError(f"no answer to: {question}; give it as an option, see 'pycosim new --help'")
        try:
            return accept(line.strip())
        except PycosimError as error:
            print(f"  {error}", file=sys.stdout)


def _refuse_other(sample, proposal):
    """Refuse a further log that the study of the first one would not read."""
    first = proposal.sample.look
    if sample.look.layout != first.layout or sample.look.reader != first.reader:
        lines = ", ".join(sample.look.layout.lines) or "as plain text"
        raise DataError(f"{sample.look.path}: is laid out otherwise ({lines}) than {first.path.name}; give it a study "
                        "of its own")
    for name in proposal.columns:
        if name not in sample.look.header:
            raise DataError(f"{sample.look.path}: no column '{name}'{closest(name, sample.look.header)}, which "
                            f"{first.path.name} has; give it a study of its own")


def _layout(sample):
    said = sample.look.layout.lines
    yield f"{sample.look.path}: {sample.rows} rows{', ' + ', '.join(said) if said else ''}; columns: " + \
          ", ".join(sample.look.header)


def told(proposal):
    """What was made of a log, in lines.

    Parameters
    ----------
    proposal : Proposal
        Without questions.

    Returns
    -------
    list of str
    """
    lines = list(_layout(proposal.sample))
    for name, column in proposal.columns.items():
        more = "".join(f", {k} = {to_toml(getattr(column, k))}" for k in _NUMBERS
                       if getattr(column, k) != getattr(type(column), k))
        lines.append(f"  {name} is {column.variable}, in {column.unit}{more}")
    lines += [f"  {name} is rated {most:.4g} (SI)" for name, most in proposal.rated.items()]
    return [*lines, *proposal.notes]

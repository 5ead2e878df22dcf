"""A library in; its rigs, and what a first fit of one should find, out."""

from __future__ import annotations


def rigs(library):
    """Rigs of a library.

    Parameters
    ----------
    library : Library
        The package's own, or with files of a user's.

    Returns
    -------
    dict of str to str
        Full name by short name.
    """
    return {n.rsplit(".", 1)[-1]: n for n in library.walk() if ".Rigs." in n}


def first_parameters(model, question=None):
    """Parameters that a first fit should find: friction of the segments, and effects that the rig already holds.

    Parameters
    ----------
    model : Model
        A rig without effects.
    question : Question, optional
        ``estimate`` by default.

    Returns
    -------
    list of str
    """
    question, found = question or model.question("estimate"), []
    base = {n.split(".")[0] for n in model.parameters}
    effects = [n for n in base if any(n.endswith(f"_{c}") for c in model.segments)]
    for name in question.parameters:
        component, _, short = name.rpartition(".")
        if component in model.segments and short in ("f0", "mu"):
            if short == "f0" or model.parameters[name].value != 1.0:  # mu = 1: the rig's base has no load term
                found.append(name)
        elif component in effects:
            found.append(name)
    return found

"""What an experiment can be for, in; its name, whatever it was called before, out."""

GOALS = "parameters", "alternatives", "detect"
FORMER = {"twins": "alternatives"}  # goals under the names that they had


def goal_named(name):
    """A goal by its present or its former name.

    Parameters
    ----------
    name : str
        As ``alternatives``, or ``twins``, its former name.

    Returns
    -------
    str
        As it is where it is neither.
    """
    return FORMER.get(name, name)

"""The name of a package that only some uses need in; the package, or one sentence that says what to type, out."""

from __future__ import annotations

import importlib

from .errors import PycosimError


def extra(module, what, error=PycosimError):
    """Import what a plain installation does not bring.

    Parameters
    ----------
    module : str
        Its first part is the package to install.
    what : str
        What needs it, as ``an FMU in a co-simulation``.
    error : type
        Of PycosimError.

    Returns
    -------
    module

    Raises
    ------
    PycosimError
        It is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise error(f"{what} needs the package {package}, which is not installed; type 'pip install {package}'"
                    ) from None

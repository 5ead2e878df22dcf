"""Parameter sets that a fit allows in; the same with a line, a table and a summary, out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pandas as pd

from ..fit import draws
from .shown import Shown, xarray_module


@dataclass(frozen=True, eq=False, repr=False)
class Draws(Shown, draws.Draws):
    """Parameter sets that the data allow; what they hold is said of `pycosim.fit.draws.Draws`."""

    def _headline(self) -> str:
        cut = f"; {self.any_outside:.1%} of the unbounded draws lay beyond a bound" if self.any_outside else ""
        return f"{len(self.values)} sets of {len(self.names)} parameters{cut}"

    def to_frame(self) -> Any:
        """The parameter sets as a table.

        Returns
        -------
        pandas.DataFrame
            A row a set, a column a free parameter, SI units.
        """
        return pd.DataFrame(self.values, columns=self.names)

    def to_xarray(self) -> Any:
        """The parameter sets with named dimensions.

        Returns
        -------
        xarray.DataArray
            Over ``set`` and ``parameter``, SI units.

        Raises
        ------
        UnknownNameError
            xarray is not installed.
        """
        return xarray_module().DataArray(self.values, dims=("set", "parameter"), coords={"parameter": self.names})

"""What a study says of how a text file is laid out in; a checked Layout, and the lines that say it, out."""

from __future__ import annotations

from dataclasses import dataclass, fields

from .toml import to_toml

ENCODINGS = ("utf-8", "utf-16", "utf-16-le", "utf-16-be", "cp1252", "latin-1")
SEPARATORS = (",", ";", "\t", "|", " ")
DECIMALS = (".", ",")


@dataclass(frozen=True)
class Layout:
    """How a text file holds its table; the defaults are comma-separated text with one row of names.

    Attributes
    ----------
    header : bool
        Whether a row names the columns; else they are called "1", "2", ...
    separator : str
        Between columns; a blank stands for any number of blanks and tabs.
    decimal : str
        Mark before a number's fraction.
    encoding : str
        Of the text; UTF-8 may have a byte-order mark.
    preamble : int
        Lines above the header, or above the first row of numbers where there is no header.
    units_row : bool
        Whether the row below the header holds units.
    """

    header: bool = True
    separator: str = ","
    decimal: str = "."
    encoding: str = "utf-8"
    preamble: int = 0
    units_row: bool = False

    @property
    def above(self):
        """Rows above the first one of numbers."""
        return self.preamble + self.header + self.units_row

    @property
    def said(self):
        """Keys of `[data]` that say it, with their values; what is usual is not said."""
        return {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) != f.default}

    @property
    def lines(self):
        """The same as lines of a study."""
        return [f"{key} = {to_toml(value)}" for key, value in self.said.items()]


PLAIN = Layout()
LAYOUT_KEYS = tuple(f.name for f in fields(Layout))

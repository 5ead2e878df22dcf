"""A hook of MkDocs, before all others: the reference is that of this checkout, not of an installed package."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

"""``python -m pycosim.cli``, the command line."""

import sys

from .verbs import main

sys.exit(main())

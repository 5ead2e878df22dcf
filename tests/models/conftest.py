"""One library for all tests of the models: parsing and flattening are done once."""

import pytest

from pycosim.compile import Library, compile_model
from pycosim.compile.parse import LIBRARY

ROOT = LIBRARY / "DriveTrain"


@pytest.fixture(scope="session")
def library():
    return Library()


@pytest.fixture(scope="session")
def model(library):
    """Model of a rig or example by its short name, as ``Rigs.HipKnee``."""
    return lambda name, attached=(): compile_model(library, f"DriveTrain.{name}", attached)


@pytest.fixture(scope="session")
def rumoca_model():
    """The same class compiled by the second compiler."""
    rumoca = pytest.importorskip("rumoca")
    session = rumoca.Session(roots=[str(ROOT)])

    def load(name):
        return session.load(str(ROOT / (name.replace(".", "/") + ".mo")), model=f"DriveTrain.{name}")

    return load

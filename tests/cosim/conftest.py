"""Short scenarios of the geared joint, whose FMUs compile in seconds."""

import pytest
from joint import JOINT

from pycosim.compile import Library
from pycosim.cosim.scenario import load_scenario


@pytest.fixture(scope="session")
def library():
    return Library()


@pytest.fixture
def scenario(tmp_path):
    """The scenario with some of its text replaced."""
    def make(*changes, text=JOINT):
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new)
        path = tmp_path / "joint.toml"
        path.write_text(text)
        return load_scenario(path)
    return make

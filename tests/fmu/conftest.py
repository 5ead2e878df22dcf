"""FMUs of the rigs, built once."""

from pathlib import Path

import pytest

from pycosim.compile import Library
from pycosim.export.fmu import export_fmu
from pycosim.study import Setting, Study

from driver import Fmu


@pytest.fixture(scope="session")
def library():
    return Library()


@pytest.fixture(scope="session")
def study():
    """Studies of the rigs; the geared joint has an effect and values of its own."""
    def make(rig):
        effects = [("viscous", "gear"), ("stribeck", "gear")] if rig == "GearedJoint" else []
        given = {"gear.f0": Setting(0.04), "gear.mu": Setting(0.9), "viscous_gear.b": Setting(1e-4),
                 "stribeck_gear.fs": Setting(0.01)} if effects else {}
        return Study(Path(f"/studies/{rig}.toml"), f"DriveTrain.Rigs.{rig}", parameters=given, effects=effects)
    return make


@pytest.fixture(scope="session")
def model(library, study):
    return lambda rig: study(rig).validate(library)


@pytest.fixture(scope="session")
def built(library, study, model, tmp_path_factory):
    """An exported and unpacked FMU by rig and version."""
    made = {}

    def make(rig, fmi=2):
        if (rig, fmi) not in made:
            folder = tmp_path_factory.mktemp(f"{rig}{fmi}")
            path = export_fmu(study(rig), model(rig), folder, fmi)
            made[rig, fmi] = Fmu(path, folder / "unpacked")
        return made[rig, fmi]
    return make


@pytest.fixture(params=[2, 3], ids=["fmi2", "fmi3"])
def fmu(request, built):
    """The geared joint in both versions."""
    return built("GearedJoint", request.param)

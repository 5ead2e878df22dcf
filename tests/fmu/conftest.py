"""FMUs of the rigs, built once."""

from functools import cache
from pathlib import Path

import pytest
from driver import Fmu

from pycosim.compile import Library
from pycosim.export import build
from pycosim.export import fmu as fmu_module
from pycosim.export.description import describe
from pycosim.study.schema import Setting, Study


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
    return cache(lambda rig: study(rig).validate(library))


@pytest.fixture(scope="session", autouse=True)
def quick_builds():
    """Numbers are the same without optimisation, and a build takes a fraction of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "FLAGS", ["-O0" if f == "-O2" else f for f in build.FLAGS])
        yield


@pytest.fixture(scope="session")
def plant(study, model):
    """What is exported of a rig, described once."""
    return cache(lambda rig: describe(study(rig), model(rig)))


@pytest.fixture(scope="session")
def built(study, model, plant, tmp_path_factory):
    """An exported and unpacked FMU by rig and version."""
    @cache
    def make(rig, fmi=2):
        folder = tmp_path_factory.mktemp(f"{rig}{fmi}")
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(fmu_module, "describe", lambda *_: plant(rig))
            path = fmu_module.export_fmu(study(rig), model(rig), folder, fmi)
        return Fmu(path, folder / "unpacked")
    return make


@pytest.fixture(params=[2, 3], ids=["fmi2", "fmi3"])
def fmu(request, built):
    """The geared joint in both versions."""
    return built("GearedJoint", request.param)

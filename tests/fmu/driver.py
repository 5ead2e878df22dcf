"""The functions of FMI 2 and 3 by one set of names, straight through ctypes: tests see every status and message."""

import ctypes as c
import sys
import zipfile
from pathlib import Path

from fmpy import platform, platform_tuple, read_model_description, sharedLibraryExtension

OK, WARNING, DISCARD, ERROR = range(4)
RIGS = ("GearedJoint", "ScrewDrive", "ServoPendulum", "HipKnee")
_LOG2 = c.CFUNCTYPE(None, c.c_void_p, c.c_char_p, c.c_int, c.c_char_p, c.c_char_p, c.c_char_p)
_LOG3 = c.CFUNCTYPE(None, c.c_void_p, c.c_int, c.c_char_p, c.c_char_p)


class _Callbacks(c.Structure):
    _fields_ = [("logger", _LOG2), ("allocate", c.c_void_p), ("free", c.c_void_p), ("finished", c.c_void_p),
                ("environment", c.c_void_p)]


class Fmu:
    """An unpacked FMU: its description, and its library.

    Parameters
    ----------
    path : path
        FMU.
    folder : path
        Where it is unpacked.
    library : path, optional
        Another binary of the same sources.
    """

    def __init__(self, path, folder, library=None):
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
        self.path, self.folder = Path(path), Path(folder)
        self.description = read_model_description(str(folder))
        self.fmi = int(self.description.fmiVersion[0])
        self.token = self.description.guid if self.fmi == 2 else self.description.instantiationToken
        self.vr = {v.name: v.valueReference for v in self.description.modelVariables}
        where = platform if self.fmi == 2 else platform_tuple
        name = self.description.coSimulation.modelIdentifier + sharedLibraryExtension
        self.library = c.CDLL(str(library or self.folder / "binaries" / where / name))
        for kind in ("Instantiate",) if self.fmi == 2 else ("InstantiateCoSimulation", "InstantiateModelExchange"):
            self.function(kind).restype = c.c_void_p

    def function(self, name):
        """A function of the standard, without its prefix."""
        return getattr(self.library, f"fmi{self.fmi}{name}")

    def names(self, causality):
        """Names of the real variables of a causality."""
        return [v.name for v in self.description.modelVariables if v.causality == causality and v.type != "Boolean"]


class Instance:
    """One instance; methods return the status, and messages are kept."""

    def __init__(self, fmu, me=False, token=None, name=b"plant", started=True):
        self.fmu, self.fmi, self.me, self.messages = fmu, fmu.fmi, me, []
        token = fmu.token if token is None else token
        if self.fmi == 2:
            self._log = _LOG2(lambda e, n, s, k, f, m: self.messages.append(m.decode()))
            self._callbacks = _Callbacks(self._log, None, None, None, None)
            self.handle = fmu.function("Instantiate")(name, 0 if me else 1, token.encode(), None,
                                                      c.byref(self._callbacks), 0, 0)
        else:
            self._log = _LOG3(lambda e, s, k, m: self.messages.append(m.decode()))
            f = fmu.function("InstantiateModelExchange" if me else "InstantiateCoSimulation")
            between = [] if me else [False, False, None, c.c_size_t(0)]
            self.handle = f(name, token.encode(), None, False, False, *between, None, self._log,
                            *([] if me else [None]))
        if started and self.handle:
            self.set_up()

    def call(self, name, *arguments):
        """Status of a function."""
        return self.fmu.function(name)(c.c_void_p(self.handle), *arguments)

    # --- life ---

    def enter(self, start=0.0, stop=None):
        """Enter initialization mode."""
        given = (c.c_int(0) if self.fmi == 2 else c.c_bool(False), c.c_double(0), c.c_double(start),
                 (c.c_int if self.fmi == 2 else c.c_bool)(stop is not None), c.c_double(stop or 0.0))
        if self.fmi == 2:
            return self.call("SetupExperiment", *given) or self.call("EnterInitializationMode")
        return self.call("EnterInitializationMode", *given)

    def exit(self):
        """Leave initialization mode."""
        return self.call("ExitInitializationMode")

    def set_up(self, start=0.0, stop=None, **values):
        """Initialise with values by name, dots written as two underscores."""
        assert self.enter(start, stop) == OK, self.messages
        for name, value in values.items():
            assert self.set(name.replace("__", "."), value) == OK, self.messages
        assert self.exit() == OK, self.messages

    def free(self):
        """Free the instance."""
        self.call("FreeInstance")
        self.handle = None

    # --- values ---

    def references(self, names):
        """Array of value references of names or numbers."""
        numbers = [self.fmu.vr[n] if isinstance(n, str) else n for n in names]
        return (c.c_uint32 * max(1, len(numbers)))(*numbers)

    def set(self, names, values):
        """Set one or several real variables."""
        names, values = ([names], [values]) if isinstance(names, (str, int)) else (names, values)
        data = (c.c_double * max(1, len(values)))(*values)
        n = c.c_size_t(len(names))
        extra = [] if self.fmi == 2 else [n]
        return self.call("SetReal" if self.fmi == 2 else "SetFloat64", self.references(names), n, data, *extra)

    def try_get(self, names):
        """Status and values of real variables."""
        data, n = (c.c_double * max(1, len(names)))(), c.c_size_t(len(names))
        extra = [] if self.fmi == 2 else [n]
        status = self.call("GetReal" if self.fmi == 2 else "GetFloat64", self.references(names), n, data, *extra)
        return status, list(data)[:len(names)]

    def get(self, *names):
        """Values of real variables."""
        status, values = self.try_get(names)
        assert status == OK, self.messages
        return values if len(values) > 1 else values[0]

    def flag(self, name):
        """Value of a Boolean."""
        data = (c.c_int if self.fmi == 2 else c.c_bool)()
        extra = [] if self.fmi == 2 else [c.c_size_t(1)]
        assert self.call("GetBoolean", self.references([name]), c.c_size_t(1), c.byref(data), *extra) == OK
        return bool(data.value)

    # --- stepping ---

    def step(self, t, h):
        """One communication step."""
        if self.fmi == 2:
            return self.call("DoStep", c.c_double(t), c.c_double(h), 1)
        flags, last = [c.c_bool() for _ in range(3)], c.c_double()
        return self.call("DoStep", c.c_double(t), c.c_double(h), True, *map(c.byref, flags), c.byref(last))

    # --- saved states ---

    @property
    def _state(self):
        return "FMUstate" if self.fmi == 2 else "FMUState"

    def save(self, state=None):
        """Saved state."""
        state = state or c.c_void_p()
        assert self.call(f"Get{self._state}", c.byref(state)) == OK
        return state

    def restore(self, state):
        """Status of restoring."""
        return self.call(f"Set{self._state}", state)

    def drop(self, state):
        """Free a saved state."""
        return self.call(f"Free{self._state}", c.byref(state))

    def serialize(self):
        """Bytes of the current state."""
        state, size = self.save(), c.c_size_t()
        assert self.call(f"Serialized{self._state}Size", state, c.byref(size)) == OK
        data = (c.c_char * size.value)()
        assert self.call(f"Serialize{self._state}", state, data, size) == OK
        self.drop(state)
        return bytes(data)

    def deserialize(self, data):
        """Status of restoring from bytes."""
        state = c.c_void_p()
        name = "DeSerialize" if self.fmi == 2 else "Deserialize"
        status = self.call(f"{name}{self._state}", c.c_char_p(data), c.c_size_t(len(data)), c.byref(state))
        if status == OK:
            status = self.restore(state)
            self.drop(state)
        return status

    # --- derivatives ---

    def directional(self, unknowns, knowns, seed, adjoint=False):
        """Sensitivities; for the adjoint, seeds belong to the unknowns."""
        out = len(knowns) if adjoint else len(unknowns)
        result, data = (c.c_double * max(1, out))(), (c.c_double * max(1, len(seed)))(*seed)
        size = [] if self.fmi == 2 else [c.c_size_t(len(seed))]
        last = [] if self.fmi == 2 else [c.c_size_t(out)]
        name = "GetAdjointDerivative" if adjoint else "GetDirectionalDerivative"
        status = self.call(name, self.references(unknowns), c.c_size_t(len(unknowns)), self.references(knowns),
                           c.c_size_t(len(knowns)), data, *size, result, *last)
        assert status == OK, self.messages
        return list(result)[:out]

    def vector(self, name, n):
        """What model exchange reads as a whole."""
        data = (c.c_double * max(1, n))()
        assert self.call(name, data, c.c_size_t(n)) == OK, self.messages
        return list(data)[:n]


if __name__ == "__main__":  # restore a state that another process wrote, step on, and print
    where, folder, saved, names = sys.argv[1:]
    plant = Instance(Fmu(where, folder))
    assert plant.deserialize(Path(saved).read_bytes()) == OK, plant.messages
    t = plant.get("time")
    for k in range(20):
        assert plant.step(t + k * 1e-3, 1e-3) == OK
    print(" ".join(v.hex() for v in plant.get(*names.split(","))))

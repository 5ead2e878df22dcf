"""A controller's block in; the FMU that other tools take, by the plant's own wrapper, out."""

from __future__ import annotations

from pathlib import Path

import casadi as ca

from ..control.controllers import Block
from ..core.units import Variable
from .description import Entry, Plant, depend, derivatives
from .fmu import contents, write_fmu

_STEPPING = ("A controller has a clock of its own: it takes a sample at the start and once a <code>period</code> after "
             "it, whatever the communication steps are, and holds its outputs in between. At a communication point "
             "where a sample is due it answers at once to its inputs; a sample between two takes the inputs of the "
             "first.")


def describe_block(block: Block, name=None):
    """A block as the wrapper sees it: states that change once a period, and no differential equations.

    Parameters
    ----------
    block : Block
        Its last parameter, the period [s], sets the step.
    name : str, optional
        Instead of the block's own.

    Returns
    -------
    Plant
    """
    functions, sparsity = _functions(block)
    entries = [Entry(Variable("time", "s", "Time"), "independent", "continuous")]
    entries += [Entry(v, "local", "continuous", "exact") for v in block.states]
    entries += [Entry(Variable(f"der({v.name})", "1/s" if v.unit == "1" else f"{v.unit}/s",
                               f"Change of {v.name} over the next period, a second"),
                      "local", "continuous", "calculated", k) for k, v in enumerate(block.states)]
    entries += [Entry(v, "input", "continuous") for v in block.inputs]
    entries += [Entry(v, "parameter", "fixed" if v.name == "period" else "tunable", "exact") for v in block.parameters]
    entries += [Entry(v, "output", "continuous", "calculated") for v in block.outputs]
    sizes = {"x": len(block.states), "z": 0, "u": len(block.inputs), "p": len(block.parameters),
             "q": len(block.parameters), "y": len(block.outputs), "e": 0}
    depend(entries, sizes, sparsity)
    return Plant(name or block.name, block.model.rig, block.description, block.model, block.values, set(block.values),
                 entries, functions, sizes, [], _STEPPING, True)


def _functions(block):
    """The functions that the wrapper calls, and the sparsity of everything computed."""
    names = ["x", "z", "u", "p", "t"]
    x, u, p = (ca.SX.sym(n, len(v)) for n, v in zip("xup", (block.states, block.inputs, block.parameters)))
    z, t, h, u1 = ca.SX.sym("z", 0), ca.SX.sym("t"), ca.SX.sym("h"), ca.SX.sym("u1", len(block.inputs))
    after, y = block.update(x, u, p), block.output(x, u, p)
    arguments, change = [x, z, u, p, t], (after - x) / p[-1]
    initial = ca.Function("model_initial", arguments, [z], names, ["z_now"])
    prepare = ca.Function("model_prepare", [p], [p], ["p"], ["q"])
    step = ca.Function("model_step", [x, z, u, u1, p, t, h], [after, z, ca.SX(0)],
                       ["x", "z", "u0", "u1", "q", "t", "h"], ["x_next", "z_next", "error"])
    observe = ca.Function("model_observe", arguments, [ca.densify(change), ca.densify(y)], names, ["xdot", "y"])
    forward, reverse, sparsity = derivatives(arguments, change, y, ca.SX(0, 1))
    return [prepare, initial, step, observe, forward, reverse], sparsity


def export_block(block, folder, fmi=2, platforms="host", name=None):
    """Write a controller as ``<name>_fmi2.fmu`` or ``<name>_fmi3.fmu``, for co-simulation.

    Parameters
    ----------
    block : Block
        Its inputs, outputs and parameters are those of the FMU.
    folder : path
        Where the file goes.
    fmi : int
        2 or 3.
    platforms : str
        ``host`` or ``all``.
    name : str, optional
        Instead of the block's own.

    Returns
    -------
    Path

    Raises
    ------
    ExportError
        It cannot be built for a platform, or does not pass its check.
    """
    plant = describe_block(block, name)
    path = Path(folder) / f"{plant.name}_fmi{fmi}.fmu"
    write_fmu(path, contents(plant, fmi, ("cs",), platforms))
    return path

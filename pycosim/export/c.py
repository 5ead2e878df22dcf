"""Model and parameters in; a header and one C file out that estimate, compensate and simulate on a microcontroller.

The C is generated from the functions that Python evaluates: C99, no allocation, nothing global that is written, nothing
of the library but ``math.h``.
"""

from __future__ import annotations

import re
from pathlib import Path

import casadi as ca

from ..core.errors import StudyError, UnknownNameError, closest
from ..core.units import Variable
from ..core.whole import write_whole
from ..dynamics.simulate import dynamics, with_parameters
from ..dynamics.states import follow
from .generated import generated, index_name, literal, prototype, wrapper

_LOOSE = 2e-5  # tolerance of a step in single precision, whose rounding is 1e-7
_PRECISIONS = ("double", "float")


def export_c(model, parameters, folder, name, real="double"):
    """Write a rig as C for a microcontroller.

    Parameters
    ----------
    model : pycosim.compile.Model
        Every question that its rig offers becomes functions.
    parameters : dict of str to float
        Instead of the model's defaults.
    folder : path
        Where ``name.h`` and ``name.c`` go; made when missing.
    name : str
        A C identifier; every name of the header starts with it.
    real : {"double", "float"}
        Type of every number.

    Returns
    -------
    tuple of pathlib.Path
        Header and source.

    Raises
    ------
    StudyError
        The name is no C identifier, or the precision unknown.
    UnknownNameError
        The rig has no such parameter.
    """
    if not re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII):
        raise StudyError(f"'{name}' is no name in C; use letters, digits and _, a letter first")
    if real not in _PRECISIONS:
        raise StudyError(f"no precision '{real}'{closest(real, _PRECISIONS)}")
    values = {n: v.value for n, v in model.parameters.items()}
    for n in parameters:
        if n not in values:
            raise UnknownNameError(f"no parameter '{n}' in {model.rig}{closest(n, values)}")
    values.update(parameters)
    parts = [Part(f"{name}_{question}", model.question(question), model) for question in ("estimate", "compensate")
             if question in model.notes]
    moving = dynamics(model, _LOOSE) if real == "float" else dynamics(model)
    parts.append(_Simulation(f"{name}_simulate", model, moving))
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    texts = {folder / f"{name}.h": _header(model, name, real, parts, values),
             folder / f"{name}.c": _source(name, real, parts, values)}
    for path, text in texts.items():
        write_whole(path, text)
    return tuple(texts)


class Part:
    """A question: its answer for one sample, and its friction states after it.

    Parameters
    ----------
    name : str
        In C.
    question : pycosim.compile.Question
        What is known and what is asked for.
    model : pycosim.compile.Model
        Of the same rig; gives units and bounds.

    Attributes
    ----------
    vectors : dict of str to list of str
        Names of ``input``, ``state`` and ``output``.
    variables : dict of str to Variable
        Of all vectors, by name.
    functions : list of casadi.Function
        The answer; where there are friction states, what follows them.
    declared : list of (str, str, list)
        Of each function: a sentence, and what `generated.prototype` takes.
    """

    def __init__(self, name, question, model):
        self.name, self.variables = name, {**model.variables, **model.parameters, **question.variables}
        self.vectors = {"input": question.inputs, "state": question.states, "output": question.outputs}
        u, x, p = question.symbols()
        everything, h = ca.SX.sym("p", len(model.parameters)), ca.SX.sym("h")
        order = list(model.parameters)
        chosen = everything[[order.index(n) for n in question.parameters]]
        y = ca.densify(question.output(u, x, chosen))
        self.functions = [ca.Function(f"answer_{name}", [u, x, everything], [y])]
        real = "const {real}"
        self.declared = [(
            "Answer for one sample.", f"void {name}",
            [(f"{real} *", "inputs"), (f"{real} *", "states"), (f"{real} *", "parameters"), ("{real} *", "outputs")])]
        if question.states:
            after = follow(question)(u, x, chosen, h)
            self.functions.append(ca.Function(f"follow_{name}", [u, x, everything, h], [after]))
            self.declared.append((
                "States after h seconds, for the means of the inputs over them; next may be states.",
                f"void {name}_next",
                [(f"{real} *", "inputs"), (f"{real} *", "states"), (f"{real} *", "parameters"), (f"{real} ", "h"),
                 ("{real} *", "next")]))


class _Simulation:
    """The motion: a start that fits, one step, and what follows from both."""

    def __init__(self, name, model, d):
        self.name, self.variables = name, {**model.variables, **model.parameters}
        self.vectors = {"input": d.inputs, "state": d.states, "algebraic": d.algebraic, "output": d.outputs}
        self.functions = [with_parameters(d, d.initial, f"start_{name}"), with_parameters(d, d.step, f"step_{name}"),
                          _named(f"output_{name}", d.output)]
        real = "const {real}"
        at = [(f"{real} *", "states"), (f"{real} *", "algebraic"), (f"{real} *", "inputs"), (f"{real} *", "parameters"),
              (f"{real} ", "time")]
        self.declared = [
            ("Algebraic variables that fit the states, from a guess; fit may be algebraic.", f"void {name}_start",
             [*at, ("{real} *", "fit")]),
            ("States after h seconds, inputs linear in between. *error above 1, or not a number: not solved.",
             f"void {name}_step",
             [*at[:2], (f"{real} *", "inputs"), (f"{real} *", "inputs_next"), *at[3:], (f"{real} ", "h"),
              ("{real} *", "states_next"), ("{real} *", "algebraic_next"), ("{real} *", "error")]),
            ("All other variables, for algebraic variables that fit.", f"void {name}_output",
             [*at, ("{real} *", "outputs")])]


def _named(name, function):
    arguments = function.mx_in()
    return ca.Function(name, arguments, function.call(arguments))


def _header(model, name, real, parts, values):
    """Declarations, and the index of every name."""
    guard = f"{name.upper()}_H"
    lines = [f"/* {model.rig}: what is known in, what follows out. SI units; generated by pycosim. */",
             f"#ifndef {guard}", f"#define {guard}", "", "#ifdef __cplusplus", 'extern "C" {', "#endif", "",
             *_index(f"{name}_parameter", list(values), model.parameters), "",
             "/* Values that were identified, or the model's own. */", f"void {name}_parameters({real} *parameters);"]
    for part in parts:
        for kind, names in part.vectors.items():
            lines += ["", *_index(f"{part.name}_{kind}", names, part.variables)]
        for (note, start, arguments), function in zip(part.declared, part.functions):
            lines += ["", f"/* {note} Takes {function.sz_w()} numbers of stack, and its scalars. */",
                      prototype(start, arguments, real) + ";"]
    return "\n".join([*lines, "", "#ifdef __cplusplus", "}", "#endif", "", f"#endif /* {guard} */", ""])


def _index(prefix, names, variables):
    """An enumeration of a vector's elements; its last is their number."""
    lines = []
    for k, n in enumerate(names):
        base, dots = n, n.count("der(")
        for _ in range(dots):
            base = base[4:-1]
        v = Variable("time", "s", "Time") if n == "time" else variables[base]
        text = f"{n} [{_per_second(v.unit, dots)}] {'' if dots else v.description}".replace("*/", "* /").strip()
        lines.append(f"  {index_name(prefix, n)} = {k}, /* {text} */")
    return [f"enum {prefix} {{", *lines, f"  {prefix.upper()}_COUNT = {len(names)}", "};"]


def _per_second(unit, times):
    """Unit of a derivative: rad, rad/s, rad/s2."""
    base, _, power = unit.partition("/s")
    times += int(power or 1) if unit.endswith(("/s", "/s2")) else 0
    return f"{base if times else unit}{'' if not times else '/s' if times == 1 else f'/s{times}'}"


def _source(name, real, parts, values):
    """Generated functions, hidden, and a readable one around each."""
    code = generated([f for part in parts for f in part.functions], name, real)
    lines = [f'#include "{name}.h"', "#include <math.h>", "", code, f"void {name}_parameters({real} *parameters) {{"]
    lines += [f"  parameters[{index_name(f'{name}_parameter', n)}] = {literal(v, real)};" for n, v in values.items()]
    lines += ["}", ""]
    for part in parts:
        for (_, start, arguments), function in zip(part.declared, part.functions):
            lines += [wrapper(start, arguments, function, real), ""]
    return "\n".join(lines)

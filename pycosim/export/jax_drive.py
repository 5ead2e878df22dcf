"""The drive of a rig in, a Python file for JAX out that batches and differentiates, and needs nothing of this program.

The instructions of the CasADi functions are walked once and written as ``jax.numpy``; what is used once is put where it
is used.
"""

from __future__ import annotations

import casadi as ca

from .mujoco_plugin import ENGINES

_INFIX = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/"}
_COMPARE = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!="}
_LOGIC = {ca.OP_AND: "&", ca.OP_OR: "|"}
_CALL = {ca.OP_EXP: "exp", ca.OP_LOG: "log", ca.OP_SQRT: "sqrt", ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan",
         ca.OP_ASIN: "arcsin", ca.OP_ACOS: "arccos", ca.OP_ATAN: "arctan", ca.OP_SINH: "sinh", ca.OP_COSH: "cosh",
         ca.OP_TANH: "tanh", ca.OP_ASINH: "arcsinh", ca.OP_FABS: "abs", ca.OP_SIGN: "sign", ca.OP_FLOOR: "floor",
         ca.OP_CEIL: "ceil", ca.OP_EXPM1: "expm1", ca.OP_LOG1P: "log1p", ca.OP_POW: "power", ca.OP_CONSTPOW: "power",
         ca.OP_FMIN: "minimum", ca.OP_FMAX: "maximum", ca.OP_ATAN2: "arctan2", ca.OP_HYPOT: "hypot",
         ca.OP_COPYSIGN: "copysign", ca.OP_FMOD: "fmod"}
_WIDEST = 70  # characters of an expression that is put into another
_SCALARS = {"t", "h"}
_TOLD = {
    "prepare": "What the parameters alone ask for: the other functions take it, many times.",
    "torque": "Torque [N.m] and friction states at the end of a step of h seconds, from angle, speed and acceleration\n"
              "    there, the mean speed over the step and the states at its start.",
    "implicit": "Torque, and its Jacobian by v, for a speed v at the end of a step that moves by h v from phi and w.",
    "follow": "Friction states after a step of h seconds at a mean speed.",
}


def jax_source(law, name):
    """The drive as a Python file.

    Parameters
    ----------
    law : Law
        Of `pycosim.export.law.drive_law`.
    name : str
        Of the study.

    Returns
    -------
    str
        A module with ``torque``, ``implicit``, ``follow``, ``step_torque`` and the names of their vectors.
    """
    lines = [f'"""The drive of {law.rig} as the study {name} has it, for JAX.', "",
             "Made by pycosim, which it does not need. SI units; angles, speeds and torques are those of the motors.",
             "Bodies and rotors (INERTIA) are the engine's. step_torque is what a simulation loop calls. Functions are",
             "for one machine, jax.vmap takes many.",
             '"""', "", "import jax", "import jax.numpy as jnp", "",
             f"MOTORS = {law.motors!r}", f"INPUTS = {law.inputs!r}", f"STATES = {law.states!r}", "PARAMETERS = {"]
    lines += [f"    {n!r}: {float(law.values[n])!r},  # {law.variables[n].unit}: {law.variables[n].description}"
              for n in law.parameters]
    lines += ["}", f"INERTIA = {law.inertia.tolist()!r}  # kg.m2",
              "PLAIN, MOST = 12, 60  # corrections taken whole, and all", ""]
    for f in law.functions:
        lines += ["", *_function(f), ""]
    return "\n".join(lines).rstrip() + "\n" + (ENGINES / "jax_drive.py").read_text()


def _function(f):
    """One function, a line an intermediate result."""
    nodes, outputs = _nodes(f)
    uses = [0] * len(nodes)
    for op, given in nodes:
        for j in given if op not in ("in", "const") else ():
            uses[j] += 1
    for j in outputs.values():
        uses[j] += 2  # a name of its own
    body, texts = [], [None] * len(nodes)
    for k, (op, given) in enumerate(nodes):
        if op == "in":
            name = f.name_in(given[0])
            texts[k] = name if name in _SCALARS else f"{name}[{given[1]}]"
        elif op == "const":
            texts[k] = repr(given[0]) if given[0] >= 0 else f"({given[0]!r})"
        elif uses[k]:
            text = _text(op, [texts[j] for j in given], [nodes[j][0] for j in given])
            if uses[k] == 1 and len(text) <= _WIDEST:
                texts[k] = text if op in _CALL or op in (ca.OP_IF_ELSE_ZERO, ca.OP_SQ) else f"({text})"
            else:
                texts[k] = f"a{k}"
                body.append(f"    a{k} = {text}")
    results = [_result(f, i, outputs, texts) for i in range(f.n_out())]
    return [f"def {f.name()}({', '.join(f.name_in(i) for i in range(f.n_in()))}):", f'    """{_TOLD[f.name()]}"""',
            *body, f"    return {', '.join(results)}"]


def _nodes(f):
    """Operations with the numbers of those they use, and which of them is each element of the results."""
    nodes, work, outputs = [], {}, {}
    for k in range(f.n_instructions()):
        op, out, used = f.instruction_id(k), f.instruction_output(k), f.instruction_input(k)
        if op == ca.OP_OUTPUT:
            outputs[out[0], out[1]] = work[used[0]]
            continue
        if op == ca.OP_INPUT:
            nodes.append(("in", tuple(used)))
        elif op == ca.OP_CONST:
            nodes.append(("const", (float(f.instruction_constant(k)),)))
        else:
            nodes.append((op, tuple(work[j] for j in used)))
        work[out[0]] = len(nodes) - 1
    return nodes, outputs


def _text(op, given, kinds):
    """One operation in jax.numpy; comparisons stay conditions where they choose, and are 0 or 1 elsewhere."""
    if op == ca.OP_IF_ELSE_ZERO:
        condition = given[0] if kinds[0] in _TRUTH else f"{given[0]} != 0"
        return f"jnp.where({condition}, {_real(given[1], kinds[1])}, 0.0)"
    if op in _LOGIC or op == ca.OP_NOT:
        truths = [g if k in _TRUTH else f"({g} != 0)" for g, k in zip(given, kinds)]
        return f"~{truths[0]}" if op == ca.OP_NOT else f"{truths[0]} {_LOGIC[op]} {truths[1]}"
    given = [_real(g, k) for g, k in zip(given, kinds)]
    if op in _INFIX or op in _COMPARE:
        return f"{given[0]} {_INFIX.get(op) or _COMPARE[op]} {given[1]}"
    if op in _CALL:
        return f"jnp.{_CALL[op]}({', '.join(_bare(g) for g in given)})"
    one = given[0]
    return {ca.OP_NEG: f"-{one}", ca.OP_SQ: f"jnp.square({_bare(one)})", ca.OP_TWICE: f"2.0 * {one}",
            ca.OP_INV: f"1.0 / {one}", ca.OP_ASSIGN: one}[op]


_TRUTH = {*_COMPARE, *_LOGIC, ca.OP_NOT}


def _real(text, kind):
    return f"jnp.where({_bare(text)}, 1.0, 0.0)" if kind in _TRUTH else text


def _bare(text):
    """Without brackets that enclose all of it."""
    if not text.startswith("("):
        return text
    depth = 0
    for k, c in enumerate(text):
        depth += (c == "(") - (c == ")")
        if not depth:
            return text[1:-1] if k == len(text) - 1 else text
    return text


def _result(f, i, outputs, texts):
    """One result as an array of its shape."""
    rows, columns = f.size_out(i)
    element = [[_bare(texts[outputs[i, r + c * rows]]) if (i, r + c * rows) in outputs else "0.0"
                for c in range(columns)] for r in range(rows)]
    if not rows:
        return "jnp.zeros(0)"
    lines = [f"[{', '.join(row)}]" if f.name_out(i) == "slope" else row[0] for row in element]
    return f"jnp.stack([{', '.join(lines)}])" if f.name_out(i) != "slope" else f"jnp.array([{', '.join(lines)}])"

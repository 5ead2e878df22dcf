"""A CasADi function in, a C loop over many machines out, written so that a compiler works on several of them at a time.

CasADi's own C takes one machine, through pointers that may be null; here every element is a named constant, choices are
selections, not branches, and machines lie side by side.
"""

from __future__ import annotations

import textwrap

import casadi as ca

_INFIX = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*"}
_COMPARE = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!="}
_CALL = {ca.OP_EXP: "exp", ca.OP_LOG: "log", ca.OP_SQRT: "sqrt", ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan",
         ca.OP_ASIN: "asin", ca.OP_ACOS: "acos", ca.OP_ATAN: "atan", ca.OP_SINH: "sinh", ca.OP_COSH: "cosh",
         ca.OP_TANH: "tanh", ca.OP_ASINH: "asinh", ca.OP_FABS: "fabs", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil",
         ca.OP_EXPM1: "expm1", ca.OP_LOG1P: "log1p", ca.OP_POW: "pow", ca.OP_CONSTPOW: "pow", ca.OP_ATAN2: "atan2",
         ca.OP_HYPOT: "hypot", ca.OP_COPYSIGN: "copysign", ca.OP_FMOD: "fmod"}
_TEXT = {ca.OP_NEG: "-{0}", ca.OP_SQ: "{0} * {0}", ca.OP_TWICE: "2.0 * {0}", ca.OP_INV: "1.0 / {0}",
         ca.OP_ASSIGN: "{0}",
         ca.OP_FMIN: "{0} < {1} ? {0} : {1}", ca.OP_FMAX: "{0} > {1} ? {0} : {1}",
         ca.OP_SIGN: "({0} > 0.0 ? 1.0 : 0.0) - ({0} < 0.0 ? 1.0 : 0.0)",
         ca.OP_IF_ELSE_ZERO: "{0} != 0.0 ? {1} : 0.0", ca.OP_NOT: "{0} == 0.0 ? 1.0 : 0.0",
         ca.OP_AND: "({0} != 0.0) & ({1} != 0.0) ? 1.0 : 0.0", ca.OP_OR: "({0} != 0.0) | ({1} != 0.0) ? 1.0 : 0.0"}
# Else no compiler takes several machines at a time; products and sums are one instruction where there is one.
FLAGS = ("-O3", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast")
SIMD = r"""/* Where it can, GCC makes loops over machines for several kinds of processor, several machines at a time. */
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__GLIBC__)
#define LOOP static __attribute__((target_clones("avx512f", "avx2", "default")))
#define AT_A_TIME __attribute__((__simd__("notinbranch")))
extern double exp(double) AT_A_TIME, log(double) AT_A_TIME, sin(double) AT_A_TIME, cos(double) AT_A_TIME;
extern double pow(double, double) AT_A_TIME;
#else
#define LOOP static
#endif
"""


def loop(function, name, shared=("t", "h", "q")):
    """A function of one machine as a loop in C over many.

    Parameters
    ----------
    function : casadi.Function
        Of SX; names of arguments and results become those in C.
    name : str
        Of the C function.
    shared : collection of str
        Arguments that are the same for all machines; of those, what has one element is a number.

    Returns
    -------
    str
        C99 that needs ``math.h`` and `SIMD` before it. Elements of a machine lie together, machines follow each
        other.
    """
    given = [_argument(function.name_in(i), function.numel_in(i), shared) for i in range(function.n_in())]
    made = [f"double *restrict {function.name_out(i)}" for i in range(function.n_out())]
    lines, work, inverse = [], {}, {}
    for k in range(function.n_instructions()):
        op, out, used = function.instruction_id(k), function.instruction_output(k), function.instruction_input(k)
        if op == ca.OP_OUTPUT:
            size = function.numel_out(out[0])
            lines.append(f"    {function.name_out(out[0])}[i * {size} + {out[1]}] = {work[used[0]]};")
            continue
        if op == ca.OP_INPUT:
            text = _element(function, used, shared)
        elif op == ca.OP_CONST:
            text = repr(float(function.instruction_constant(k)))
        elif op == ca.OP_DIV:  # which takes as long as ten of the others: once for all that is divided by the same
            by = work[used[1]]
            if by not in inverse:
                inverse[by] = f"b{k}"
                lines.append(f"    const double b{k} = 1.0 / {by};")
            text = f"{work[used[0]]} * {inverse[by]}"
        else:
            text = _operation(op, [work[j] for j in used])
        work[out[0]] = f"a{k}"
        lines.append(f"    const double a{k} = {text};")
    arguments = textwrap.fill(", ".join(["int machines", *given, *made]), 116, initial_indent="  ",
                              subsequent_indent="  ").lstrip()
    return "\n".join([f"LOOP void {name}({arguments}) {{",
                      "  " + " ".join(f"(void){function.name_in(i)};" for i in range(function.n_in())),
                      "  for (int i = 0; i < machines; ++i) {", *lines, "  }", "}"])


def _argument(name, size, shared):
    return f"const double {name}" if name in shared and size == 1 else f"const double *restrict {name}"


def _element(function, used, shared):
    name, size = function.name_in(used[0]), function.numel_in(used[0])
    if name in shared:
        return name if size == 1 else f"{name}[{used[1]}]"
    return f"{name}[i * {size} + {used[1]}]"


def _operation(op, given):
    if op in _INFIX:
        return f"{given[0]} {_INFIX[op]} {given[1]}"
    if op in _COMPARE:
        return f"{given[0]} {_COMPARE[op]} {given[1]} ? 1.0 : 0.0"
    if op in _CALL:
        return f"{_CALL[op]}({', '.join(given)})"
    return _TEXT[op].format(*given)

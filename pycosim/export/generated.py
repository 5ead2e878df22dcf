"""CasADi's functions in; plain C99 out, hidden, and what gives each of them named arguments."""

from __future__ import annotations

import re

import casadi as ca

_MATH = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "expm1", "log", "log1p",
         "sqrt", "pow", "fabs", "floor", "ceil", "fmod", "hypot", "copysign")
_SIGNATURE = "(const casadi_real** arg, casadi_real** res, casadi_int* iw, casadi_real* w, int mem)"


def generated(functions, name, real="double"):
    """Functions as CasADi generates them, hidden from outside and free of what compilers warn of.

    Parameters
    ----------
    functions : iterable of casadi.Function
        Their names become those of the C functions.
    name : str
        Of the file.
    real : str
        ``double`` or ``float``, the type of every number.

    Returns
    -------
    str
        C99 that needs ``math.h``.
    """
    generator = ca.CodeGenerator(name, {"with_header": False, "main": False, "casadi_real": real, "casadi_int": "int"})
    for function in functions:
        generator.add(function)
    types = [f"typedef {real} casadi_real;", "typedef int casadi_int;"]
    return "\n".join([*types, "", _clean(generator.dump(), real)])


def index_name(prefix, variable):
    """Name of an index; the variable keeps its case, as f and F are two.

    Parameters
    ----------
    prefix, variable : str
        Vector and member, as ``u`` and ``motor1.phi``: ``U_motor1_phi``.

    Returns
    -------
    str
    """
    return f"{prefix.upper()}_{re.sub('[^A-Za-z0-9]+', '_', variable).strip('_')}"


def literal(value, real="double"):
    """A number as C writes it.

    Parameters
    ----------
    value : float
        Finite.
    real : str
        ``double`` or ``float``.

    Returns
    -------
    str
    """
    return f"{float(value)!r}{'f' if real == 'float' else ''}"


def prototype(start, arguments, real="double"):
    """Declaration of a function with named arguments.

    Parameters
    ----------
    start : str
        Type and name: ``void drive_prepare``.
    arguments : list of (str, str)
        Type, with ``{real}`` for that of numbers, and name of each; those to be read are ``const``.
    real : str
        ``double`` or ``float``.

    Returns
    -------
    str
        Without the semicolon.
    """
    return f"{start}({', '.join(kind.format(real=real) + n for kind, n in arguments)})"


def wrapper(start, arguments, function, real="double"):
    """A function with named arguments around one with CasADi's; results are copied last, so that they may be inputs.

    Parameters
    ----------
    start, arguments, real
        Of `prototype`.
    function : casadi.Function
        Of `generated`.

    Returns
    -------
    str
    """
    inputs = [(kind, n) for kind, n in arguments if kind.startswith("const")]
    outputs = [n for kind, n in arguments if not kind.startswith("const")]
    given = ", ".join(n if kind.endswith("*") else f"&{n}" for kind, n in inputs)
    lines = [f"{prototype(start, arguments, real)} {{",
             f"  const casadi_real *arg[{function.sz_arg()}] = {{{given}}};",
             f"  casadi_real *res[{max(1, function.sz_res())}];",
             f"  casadi_real w[{function.sz_w() + 1}];", f"  casadi_int iw[{function.sz_iw() + 1}];"]
    for k, n in enumerate(outputs):
        size = max(1, function.numel_out(k))
        lines.append(f"  casadi_real {n}_[{size}] = {{0}};")
        lines.append(f"  res[{k}] = {n}_;")
    lines.append(f"  {function.name()}(arg, res, iw, w, 0);")
    for k, n in enumerate(outputs):
        if function.numel_out(k):
            lines.append(f"  for (int i = 0; i < {function.numel_out(k)}; ++i) {n}[i] = {n}_[i];")
        else:
            lines.append(f"  (void){n};")
    return "\n".join([*lines, "}"])


def inline_choices(text):
    """CasADi's C with the smaller and the larger of two numbers as a choice, where it would call the library.

    A compiler cannot inline ``fmin`` and ``fmax`` (they must skip what is no number); a tenth of a step went there.

    Parameters
    ----------
    text : str
        As CasADi's generator gives it.

    Returns
    -------
    str
    """
    text = text.replace("/* Pre-c99 compatibility */\n", "")
    return re.sub(r"#if __STDC_VERSION__ < 199901L\n(  return x[<>]y.*?)#else\n.*?#endif\n", r"\1", text, flags=re.S)


def _clean(text, real):
    """CasADi's C without what compilers warn of: descriptions of functions, unused arguments and tables."""
    text = text[text.index("/* Symbol visibility"):]
    text = text[text.index("#endif\n\n", text.rindex("CASADI_SYMBOL_EXPORT __attribute__")) + 8:] if (
        "CASADI_SYMBOL_EXPORT __attribute__" in text) else text
    text = re.sub(r"#ifdef __cplusplus\n.*?#endif\n", "", text, flags=re.S)
    kept = []
    for block in re.split(r"(?=^CASADI_SYMBOL_EXPORT )", text, flags=re.M):
        if not block.startswith("CASADI_SYMBOL_EXPORT "):
            kept.append(block)
            continue
        body, end = block.split("\n}\n", 1) if "\n}\n" in block else (block.split("\n", 1)[0], block.split("\n", 1)[1])
        if _SIGNATURE[:-1] in body:
            kept.append("static " + body.removeprefix("CASADI_SYMBOL_EXPORT ") + "\n}\n")
        kept.append(end)
    text = "".join(kept)
    unused = " {\n  (void)arg; (void)res; (void)iw; (void)w; (void)mem;"
    text = re.sub(re.escape(_SIGNATURE) + r" ?\{", _SIGNATURE + unused, text)
    text = re.sub(r"^((?:casadi_real|void|int|casadi_int) casadi_\w+\()", r"static inline \1", text, flags=re.M)
    text = _without_unused(inline_choices(text))
    if real == "float":
        text = re.sub(rf"\b({'|'.join(_MATH)})\(", r"\1f(", text)
        text = re.sub(r"(?<![\w.])(\d+\.\d*(?:[eE][-+]?\d+)?)", r"\1f", text)
    return text


def _without_unused(text):
    """Drop tables and helpers that nothing uses."""
    for name in re.findall(r"^static const casadi_\w+ (casadi_s\d+)\[", text, re.M):
        if len(re.findall(rf"\b{name}\b", text)) == 1:
            text = re.sub(rf"^static const casadi_int {name}\[.*?;\n", "", text, flags=re.M | re.S)
    return text

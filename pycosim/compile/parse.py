"""Modelica files in, one pymoca tree and flat models out; errors carry file and line."""

from __future__ import annotations

import gc
import logging
import pickle  # of trees in memory only: no file is read by it
import re
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import casadi as ca
import pymoca
import pymoca.ast
import pymoca.parser
import pymoca.tree
from pymoca.backends.casadi._options import _merge_default_options
from pymoca.backends.casadi.generator import Generator, GeneratorWalker

from ..core import cache
from ..core.errors import ModelicaError, UnknownNameError, closest
from ..core.shipped import shipped
from ..core.units import Variable
from . import tree_data

logging.getLogger("pymoca").setLevel(logging.CRITICAL)
LIBRARY = shipped("modelica")
_SHARED = 4  # libraries that are kept, those last asked for; each holds the models that were compiled from it
_shared = {}


@dataclass
class Flat:
    """A flattened model: equations as CasADi residuals over named symbols.

    Attributes
    ----------
    symbols : dict of str to SX
        Every variable, parameter and ``der(x)``, and ``time``.
    variables, parameters : dict of str to Variable
        Descriptions with units.
    inputs : list of str
        Top-level inputs.
    derivatives : dict of str to str
        Name of a variable to the name of its derivative symbol.
    equations : list of SX
        Residuals.
    bindings : dict of str to SX
        Parameters that are expressions of other parameters.
    """

    name: str
    symbols: dict
    variables: dict
    parameters: dict
    inputs: list
    derivatives: dict
    equations: list
    bindings: dict = field(default_factory=dict)


class Library:
    """The Modelica sources a study sees: the shipped library and the user's own files.

    Parameters
    ----------
    extra : sequence of path
        Modelica files of the user.

    Raises
    ------
    ModelicaError
        A file does not parse; the message names file and line.
    """

    def __init__(self, extra=()):
        self.files = sorted(LIBRARY.rglob("*.mo")) + [Path(p) for p in extra]
        self.text = {}
        self.ahead = lambda rig, attached: None  # told what will be compiled next, where somebody can do so meanwhile
        self._memo = {}
        for path in self.files:
            try:
                self.text[path] = path.read_text(encoding="utf-8")
            except (OSError, UnicodeDecodeError) as error:
                raise ModelicaError(f"{path}: cannot be read as a Modelica file ({error})") from None

    def memo(self, key, make):
        """Return ``make()``, computed once a key.

        Parameters
        ----------
        key : hashable
            What `make` depends on besides the library.
        make : callable
            Without arguments.

        Returns
        -------
        object
        """
        if key not in self._memo:
            self._memo[key] = make()
        return self._memo[key]

    @cached_property
    def digest(self):
        """Hash of every source text and of the versions that turn it into functions."""
        return cache.digest(sorted(self.text.values()), pymoca.__version__, ca.CasadiMeta.version())

    @cached_property
    def tree(self):
        """The parsed tree of all files."""
        with _no_collection():
            return cache.remember("tree", self.digest, self._parse, tree_data.dump, tree_data.load)

    def _parse(self):
        tree = None
        for path, text in self.text.items():
            part = parse(text, str(path))
            if tree is None:
                tree = part
            else:
                tree.extend(part)
        return tree

    def find(self, name):
        """Return the pymoca class of a dotted name.

        Parameters
        ----------
        name : str
            As ``DriveTrain.Rigs.HipKnee``.

        Returns
        -------
        pymoca.ast.Class

        Raises
        ------
        UnknownNameError
            No such class; the nearest is named.
        """
        node, known = self.tree, []
        for part in name.split("."):
            if part not in node.classes:
                known = list(self.walk())
                raise UnknownNameError(f"no Modelica class '{name}'{closest(name, known)}")
            node = node.classes[part]
        return node

    def walk(self, node=None, prefix=""):
        """Yield the dotted names of all classes that are not packages.

        Parameters
        ----------
        node : pymoca.ast.Class, optional
            Where to begin; the whole tree by default.
        prefix : str
            Goes before each name.

        Yields
        ------
        str
            As ``DriveTrain.Rigs.HipKnee``.
        """
        for name, child in (node or self.tree).classes.items():
            if child.type != "package":
                yield prefix + name
            yield from self.walk(child, prefix + name + ".")

    def bases(self, name):
        """Yield a class and its base classes, nearest first.

        Parameters
        ----------
        name : str
            Dotted.

        Yields
        ------
        name : str
            Dotted.
        node : pymoca.ast.Class
            As parsed.

        Raises
        ------
        UnknownNameError
            The class, or one that it extends, does not exist.
        """
        node = self.find(name)
        yield name, node
        scope = name.rsplit(".", 1)[0] if "." in name else ""
        for clause in node.extends:
            yield from self.bases(self.resolve(str(clause.component), scope))

    def resolve(self, name, scope):
        """Dotted name of a class mentioned inside another, looked up outwards.

        Parameters
        ----------
        name : str
            As it is written, which may be a part of the dotted name.
        scope : str
            Dotted name of where it is mentioned; empty at the top.

        Returns
        -------
        str

        Raises
        ------
        UnknownNameError
            No such class; the nearest is named.
        """
        known = self.memo("names", lambda: set(self.walk()))
        while True:
            candidate = f"{scope}.{name}" if scope else name
            if candidate in known:
                return candidate
            if not scope:
                raise UnknownNameError(f"no Modelica class '{name}'{closest(name, known)}")
            scope = scope.rpartition(".")[0]

    def with_text(self, text, where="generated model"):
        """A copy of the tree with one more class, parsed from text.

        Parameters
        ----------
        text : str
            Modelica of one class.
        where : str
            Where the text is from, for the error.

        Returns
        -------
        pymoca.ast.Tree

        Raises
        ------
        ModelicaError
            The text does not parse.
        """
        tree = self.fresh_tree()
        tree.extend(parse(text, where))
        return tree

    def fresh_tree(self):
        """A copy of the tree; flattening changes what it is given, and pymoca's trees copy twice only by pickle.

        Returns
        -------
        pymoca.ast.Tree
        """
        return pickle.loads(self.memo("pickled", lambda: pickle.dumps(self.tree)))

    def flatten(self, name, text=None):
        """Flatten a class, or the class ``name`` defined in ``text`` on top of the library.

        Parameters
        ----------
        name : str
            Dotted; of the class in `text`, where there is one.
        text : str, optional
            Modelica of one class that the library does not have.

        Returns
        -------
        Flat

        Raises
        ------
        ModelicaError
            The class or the text does not compile.
        UnknownNameError
            The library has no such class.
        """
        with _no_collection():
            return self._flatten(name, text)

    def flattened(self, name):
        """The flat model of a class of the library, made once; whoever takes it changes nothing in it.

        Parameters
        ----------
        name : str
            Dotted.

        Returns
        -------
        Flat

        Raises
        ------
        ModelicaError, UnknownNameError
            As of `flatten`.
        """
        return self.memo(("flat", name), lambda: self.flatten(name))

    def _flatten(self, name, text):
        if text is None:
            self.find(name)
        tree = self.with_text(text) if text else self.fresh_tree()
        try:
            flat = pymoca.tree.flatten(tree, pymoca.ast.ComponentRef.from_string(name))
            generator = Generator(flat, name, _merge_default_options(None))
            GeneratorWalker().walk(generator, flat)
            model = generator.model
        except Exception as error:  # pymoca raises many types, bare Exception among them
            raise ModelicaError(f"{self._file_of(name)}: '{name}' does not compile: {_one_line(error)}") from None
        return _to_flat(name, model, next(iter(flat.classes.values())))

    def _file_of(self, name):
        short = name.rsplit(".", 1)[-1]
        for path, text in self.text.items():
            if f" {short} " in text and f"end {short};" in text:
                return path
        return "generated model"


def shared_library(extra=()):
    """The library with the user's own files; the same object again while every text is the same.

    What was compiled once is then there for every project, log and machine of a process that uses it.

    Parameters
    ----------
    extra : sequence of path
        Modelica files of the user.

    Returns
    -------
    Library

    Raises
    ------
    ModelicaError
        A file cannot be read.
    """
    made = Library(extra)
    key = made.digest, tuple(map(str, made.files))
    made = _shared.pop(key, made)
    _shared[key] = made
    while len(_shared) > _SHARED:
        del _shared[next(iter(_shared))]
    return made


@contextmanager
def _no_collection():
    """Hold Python's garbage collector: it walks trees of a hundred thousand live objects again and again, in a third of
    the time that parsing takes and half of that of flattening, and finds nothing."""
    running = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if running:
            gc.enable()


def parse(text, where):
    """Parse one Modelica text into a pymoca tree.

    Parameters
    ----------
    text : str
        Modelica, with or without a ``within`` line.
    where : str
        Where the text is from, for the error.

    Returns
    -------
    pymoca.ast.Tree

    Raises
    ------
    ModelicaError
        The text does not parse; the message names file and line.
    """
    _refuse_quoted(text, where)
    try:
        tree = pymoca.parser.parse(text, bypass_cache=True)
    except pymoca.parser.ModelicaSyntaxError as error:
        raise ModelicaError(f"{where}:{error.lineno}: {error.msg}") from None
    except Exception as error:
        raise ModelicaError(f"{where}: does not parse: {_one_line(error)}") from None
    if tree is None:
        line, found = _first_fault(text)
        raise ModelicaError(f"{where}:{line}: does not parse near '{found}'; mend the Modelica syntax there")
    return tree


_TEXTS = re.compile(r'"(?:[^"\\]|\\.)*"|//[^\n]*|/\*.*?\*/', re.S)  # texts, and comments


def _refuse_quoted(text, where):
    """Modelica lets a name between apostrophes hold anything; as names end up in C, XML and HTML, it stays out."""
    bare = _TEXTS.sub(lambda m: re.sub(r"[^\n]", " ", m[0]), text)
    if "'" in bare:
        line = bare[:bare.index("'")].count("\n") + 1
        raise ModelicaError(f"{where}:{line}: a name between apostrophes; names are made of letters, digits and _")


def _first_fault(text):
    """Line and text of the first syntax error, from the ANTLR parser that pymoca uses."""
    import antlr4
    from antlr4.error.ErrorListener import ErrorListener
    from pymoca.generated.ModelicaLexer import ModelicaLexer
    from pymoca.generated.ModelicaParser import ModelicaParser

    class First(ErrorListener):
        fault = None

        def syntaxError(self, recognizer, symbol, line, column, message, error):  # noqa: N802 (ANTLR's name)
            if self.fault is None:
                self.fault = line, getattr(symbol, "text", "") or message

    listener = First()
    parser = ModelicaParser(antlr4.CommonTokenStream(ModelicaLexer(antlr4.InputStream(text))))
    parser.removeErrorListeners()
    parser.addErrorListener(listener)
    parser.stored_definition()
    return listener.fault or (1, text.splitlines()[0] if text.strip() else "")


def _one_line(error):
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) < 300 else text[:297] + "..."


def _number(value, default):
    """A float from an attribute that may be a CasADi constant; the default when it is not a number."""
    if isinstance(value, (ca.MX, ca.DM)):
        if isinstance(value, ca.MX) and not value.is_constant():
            return default
        value = float(ca.DM(value.to_DM() if isinstance(value, ca.MX) else value))
    value = float(value)
    return default if value != value else value


def _describe(variable, symbols):
    name = variable.symbol.name()
    node = symbols.get(name)
    unit = getattr(getattr(node, "unit", None), "value", None) or "1"
    start = _number(variable.start, 0.0)
    nominal = _number(variable.nominal, 0.0) or 1.0
    return Variable(name, unit, (getattr(node, "comment", "") or "").strip('"'), _number(variable.value, start),
                    _number(variable.min, -ca.inf), _number(variable.max, ca.inf), nominal)


def _to_flat(name, model, flat_class):
    """Turn pymoca's MX model into SX residuals over named symbols."""
    groups = [model.states, model.alg_states, model.inputs, model.parameters, model.constants]
    if model.string_parameters:
        raise ModelicaError(f"'{name}' uses strings, which are not supported; use Real variables")
    every = [v for group in groups for v in group]
    for v in every:
        if v.symbol.numel() != 1:
            raise ModelicaError(f"'{name}' has the array '{v.symbol.name()}'; arrays are not supported, use scalars")
    mx = [model.time] + [v.symbol for v in every + model.der_states]
    names = ["time"] + [s.name() for s in mx[1:]]
    bound = [p for p in model.parameters if isinstance(p.value, ca.MX) and not p.value.is_constant()]
    function = ca.Function("flat", mx, list(model.equations) + [p.value for p in bound])
    symbols = dict(zip(names, (ca.SX.sym(n) for n in names)))
    outputs = function.call([symbols[n] for n in names])
    equations = outputs[:len(model.equations)]
    bindings = dict(zip((p.symbol.name() for p in bound), outputs[len(model.equations):]))
    for _ in bindings:  # a binding may name another bound parameter
        inner = [symbols[n] for n in bindings]
        bindings = {n: ca.substitute([e], inner, list(bindings.values()))[0] for n, e in bindings.items()}
    equations = ca.substitute(equations, [symbols[n] for n in bindings], list(bindings.values()))
    ast_symbols = flat_class.symbols
    parameters = {v.symbol.name(): _describe(v, ast_symbols) for v in list(model.parameters) + list(model.constants)
                  if v.symbol.name() not in bindings}
    variables = {v.symbol.name(): _describe(v, ast_symbols) for v in model.states + model.alg_states + model.inputs}
    return Flat(name, symbols, variables, parameters, [v.symbol.name() for v in model.inputs],
                {v.symbol.name(): d.symbol.name() for v, d in zip(model.states, model.der_states)}, equations, bindings)

"""The effects of the library, and the places of a rig where they can hang.

An effect is one Modelica file. What it is, where it can sit and what it needs is read from that file: the connectors it
extends say at which components it can hang, its inputs are bound to the rig's variables of the same name, and its
annotation ``__pycosim`` names the coefficient that measures its size and those that vanish with it. What a port offers
and takes is read from the library's probes, one for each kind of port.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from ..core.errors import ModelicaError, UnknownNameError, closest

PARTNER = "partner"  # connector that goes to the other component of a pair
# keys that an annotation __pycosim can have: of an effect, of a rig or an example, of a component
EFFECT_KEYS = ("size", "scan", "needs", "experiment", "replaces", "refines", "place", "measured", "means", "links",
               "by_name", "of")
RIG_KEYS = ("places", "joined", "channels", "load", "sensor", "encoders", "estimate", "balance", "compensate",
            "gravity_model", "simulate", "axis")
COMPONENT_KEYS = ("links", "gravity", "tilt")


@dataclass(frozen=True)
class Port:
    """One kind of port: what an effect may read there, and what it may add.

    Attributes
    ----------
    probe : str
        Modelica class whose parameters are the additions.
    potentials : tuple of str
        Members of the connector that are not flows.
    additions : tuple of str
        What an effect adds there, as ``dF``: parameters of the probe, zero without an effect.
    """

    probe: str
    potentials: tuple
    additions: tuple


@dataclass(frozen=True)
class Effect:
    """A candidate physical effect.

    Attributes
    ----------
    id : str
        Name in studies and results, as ``direction_asymmetry``.
    model : str
        Modelica class.
    connectors : dict of str to str
        Name to connector class; a place needs the same.
    inputs : tuple of str
        Variables of the rig it reads (``time`` is always there).
    size : tuple of str
        Coefficients that are zero (or neutral) when the effect is absent and that enter linearly at that point.
    scan : dict of str to str
        Coefficients that vanish with the effect, and how to lay a grid over them.
    replaces : str
        Parameter of the place that makes the effect superfluous while it is free.
    system : bool
        Whether one set of coefficients may act on all places at once.
    refines : str
        Effect that this one is a correction of; where the data cannot tell the two apart, that one is meant.
    measured : dict of str to str
        Inputs that come from the log alone, with their units: a rig without such a variable gets one.
    means : dict of str to str
        Parameters that stand for something of the logs: the mean of a measured input, as ``temperature``, or an end of
        what a variable of the place travels over, as ``min(friction.phi)``.
    channel : bool
        Whether it shifts recorded signals in time; its places are the rig's ``channels``.
    description : str
        What Modelica says of the class, which sentences of a diagnosis go on with.
    by_name : str
        Why it is added by name alone and stands in no ranking; empty for a candidate.
    of_load_model : bool
        Whether it is an error of the model of the load that a reference is computed with.
    """

    id: str
    model: str
    connectors: dict
    inputs: tuple
    size: tuple
    scan: dict = field(default_factory=dict)
    replaces: str = ""
    system: bool = False
    refines: str = ""
    measured: dict = field(default_factory=dict)
    means: dict = field(default_factory=dict)
    channel: bool = False
    description: str = ""
    by_name: str = ""
    of_load_model: bool = False

    @property
    def phases(self):
        """Coefficients of a periodic effect that say where its angle began to count: a list of str."""
        return [c for c, kind in self.scan.items() if kind == "quadrature" and "cycles" in self.scan.values()]

    @property
    def ports(self):
        """Connectors that a component must have to be a place; the partner of a pair is another component."""
        return {n: kind for n, kind in self.connectors.items() if n != PARTNER}


@dataclass(frozen=True)
class Place:
    """Where an effect sits: one or several components with one shared set of coefficients."""

    name: str
    components: tuple

    def partner(self, effect, component):
        """The other component of a pair, where the effect reads one; else None.

        Parameters
        ----------
        effect : Effect
            One that extends ``PairEffect`` reads a partner.
        component : str
            Where it hangs, as ``s1A``.

        Returns
        -------
        str or None
        """
        return next((c for c in self.components if c != component), None) if PARTNER in effect.connectors else None


def annotation(library, name):
    """Vendor annotation ``__pycosim`` of a class and its bases, as a dict of strings, nearest first.

    Parameters
    ----------
    library : Library
        Which holds the class and its bases.
    name : str
        Modelica class.

    Returns
    -------
    dict of str to str

    Raises
    ------
    UnknownNameError
        No such class, or a key that nothing reads.
    """
    return library.memo(("annotation", name), lambda: _annotation(library, name))


def _annotation(library, name):
    found, known = {}, EFFECT_KEYS if is_effect(library, name) else (*RIG_KEYS, *COMPONENT_KEYS)
    for _, node in library.bases(name):
        for argument in getattr(node.annotation, "arguments", None) or []:
            value = argument.value
            if str(getattr(value, "component", "")) == "__pycosim":
                for modification in value.modifications:
                    for inner in modification.arguments:
                        key = str(inner.value.component)
                        if key not in known:
                            raise UnknownNameError(f"{name}: the annotation __pycosim has no key '{key}'"
                                                   f"{closest(key, known)}")
                        text = inner.value.modifications[0]
                        found.setdefault(key, str(getattr(text, "value", text)))
    return found


def snake(name):
    """``TorqueOffset`` to ``torque_offset``.

    Parameters
    ----------
    name : str
        Name of a Modelica class, without its package.

    Returns
    -------
    str
    """
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


def components_of(library, name):
    """Components of a class and its bases.

    Parameters
    ----------
    library : Library
        Which holds the class and its bases.
    name : str
        Of the class.

    Returns
    -------
    dict of str to (str, tuple of str)
        By name: class or builtin type, and prefixes such as ``flow`` or ``parameter``.

    Raises
    ------
    StudyError
        The class is unknown.
    """
    return library.memo(("members", name), lambda: _members_of(library, name))


def _members_of(library, name):
    members = {}
    for cls, node in reversed(list(library.bases(name))):
        scope = cls
        for symbol in node.symbols.values():
            kind = str(symbol.type)
            if kind not in ("Real", "Integer", "Boolean", "String"):
                kind = library.resolve(kind, scope)
            members[symbol.name] = (kind, tuple(symbol.prefixes))
    return members


def is_connector(library, name):
    """Whether a class is a connector.

    Parameters
    ----------
    library : Library
        Which holds the class.
    name : str
        Modelica class or builtin type.

    Returns
    -------
    bool

    Raises
    ------
    UnknownNameError
        No such class.
    """
    return name not in ("Real", "Integer", "Boolean", "String") and library.find(name).type == "connector"


def is_effect(library, name):
    """Whether a class is an effect: it extends one of the library's effect interfaces.

    Parameters
    ----------
    library : Library
        Which holds the class and its bases.
    name : str
        Modelica class.

    Returns
    -------
    bool

    Raises
    ------
    UnknownNameError
        No such class.
    """
    return any(re.fullmatch(r"DriveTrain\.Interfaces\.\w+Effect", b) for b, _ in library.bases(name))


def ports(library):
    """Kinds of ports by connector name, from the library's probes.

    Parameters
    ----------
    library : Library
        Whose package ``Interfaces`` holds the probes.

    Returns
    -------
    dict of str to Port
    """
    return library.memo("ports", lambda: dict(_ports(library)))


def _ports(library):
    for name in library.walk():
        if not re.fullmatch(r"DriveTrain\.Interfaces\.\w+Probe", name):
            continue
        members = components_of(library, name)
        connector, kind = next((n, k) for n, (k, _) in members.items() if is_connector(library, k))
        yield connector, Port(name, potentials(library, kind),
                              tuple(n for n, (_, prefixes) in members.items() if "parameter" in prefixes))


def potentials(library, connector):
    """Members of a connector class that are not flows.

    Parameters
    ----------
    library : Library
        Which holds the connector.
    connector : str
        Modelica class.

    Returns
    -------
    tuple of str
    """
    return tuple(n for n, (_, prefixes) in components_of(library, connector).items() if "flow" not in prefixes)


def catalogue(library):
    """All effects the library holds, by id: every model that extends an effect interface.

    Parameters
    ----------
    library : Library
        The package's own, or with effects from files of a study.

    Returns
    -------
    dict of str to Effect
    """
    return library.memo("catalogue", lambda: dict(_effects(library)))


def corrections(library):
    """Effects that correct another, by id.

    Parameters
    ----------
    library : Library
        Of `catalogue`.

    Returns
    -------
    dict of str to str
        To the id of the effect that is meant where the data cannot tell the two apart.
    """
    return {e.id: e.refines for e in catalogue(library).values() if e.refines}


def ranked(library):
    """Effects that stand in a ranking: all but those that are added by name alone.

    Parameters
    ----------
    library : Library
        Of `catalogue`.

    Returns
    -------
    list of Effect
    """
    return [effect for effect in catalogue(library).values() if not effect.by_name]


def _effects(library):
    for name in library.walk():
        node = library.find(name)
        if node.type != "model" or node.partial:
            continue
        if not is_effect(library, name):
            continue
        members = components_of(library, name)
        notes = annotation(library, name)
        scan, means = (_pairs(name, key, notes.get(key, "")) for key in ("scan", "means"))
        _check_coefficients(name, notes, scan, means, members)
        units = _units(library, name)
        effect = Effect(
            snake(name.rsplit(".", 1)[-1]), name,
            {n: kind for n, (kind, _) in members.items() if is_connector(library, kind)},
            tuple(n for n, (kind, prefixes) in members.items() if "input" in prefixes),
            tuple(notes.get("size", "").split()), scan, notes.get("replaces", ""),
            notes.get("place") == "system", notes.get("refines", ""),
            {n: units.get(n, "1") for n in notes.get("measured", "").split()}, means, notes.get("place") == "channels",
            (node.comment or "").strip('"'), notes.get("by_name", ""), notes.get("of") == "load_model")
        yield effect.id, effect


def _pairs(name, key, text):
    """Coefficients and what each is, as ``n:cycles; phase:quadrature`` says it."""
    found = [item.split(":") for item in text.replace(" ", "").split(";") if item]
    for item in found:
        if len(item) != 2 or not all(item):
            raise ModelicaError(f"{name}: {key} = \"{text}\" of the annotation __pycosim must be coefficients with "
                                f"their kinds and semicolons between, as {key}=\"ws:speed; h:travel\"")
    return dict(found)


def _check_coefficients(name, notes, scan, means, members):
    """Refuse an effect whose annotation names coefficients that it does not have, or none."""
    own = [n for n, (_, prefixes) in members.items() if "parameter" in prefixes]
    size = notes.get("size", "").split()
    for key, names in (("size", size), ("scan", scan), ("means", means)):
        for n in names:
            if n not in own:
                raise UnknownNameError(f"{name}: {key} of the annotation __pycosim names no parameter of the effect, "
                                       f"'{n}'{closest(n, own)}")
    for source in means.values():
        if not re.fullmatch(r"\w+|(min|max)\([\w.]+\)", source):
            raise ModelicaError(f"{name}: means of the annotation __pycosim is '{source}'; write a measured input, or "
                                "an end of what the place travels over, as min(friction.phi)")
    if not size and not scan:
        raise UnknownNameError(f"{name}: the annotation __pycosim does not say which coefficient is the effect's size; "
                               f"write size=\"..\", one of {', '.join(own)}")


def _units(library, name):
    """Units of the variables that a class itself declares."""
    found = {}
    for symbol in library.find(name).symbols.values():
        for argument in getattr(symbol.class_modification, "arguments", None) or []:
            if str(argument.value.component) == "unit":
                found[symbol.name] = str(argument.value.modifications[0].value)
    return found


def places(library, rig, effect):
    """Places of a rig where an effect can hang, joined places after single ones.

    Parameters
    ----------
    library : Library
        Which holds the rig.
    rig : str
        Modelica class.
    effect : Effect
        Its connectors say where it fits.

    Returns
    -------
    list of Place
    """
    members = components_of(library, rig)
    if any(n not in members for n in effect.inputs if n not in effect.measured) or not effect.ports:
        return []
    notes = annotation(library, rig)
    single = _single(library, members, notes, effect)
    by_name = {p.name: p.components[0] for p in single}
    joined = [Place(g, tuple(by_name[m] for m in g.split("+"))) for g in notes.get("joined", "").split()
              if all(m in by_name for m in g.split("+"))]
    if effect.channel:
        groups = dict(pair.split("=") for pair in notes.get("channels", "").split())
        single, joined = [], [Place(n, tuple(g.split("+"))) for n, g in groups.items()]
    elif PARTNER in effect.connectors:
        single, joined = [], [p for p in joined if len(p.components) == 2]
    elif effect.system and len(single) > 1:
        joined.append(Place("system", tuple(p.components[0] for p in single)))
    return [p for p in single + joined if component_name(effect, p) not in members]  # the base model has it there


def _single(library, members, notes, effect):
    """Components of a rig that have the ports of an effect."""
    names = {c: p for p, c in (pair.split("=") for pair in notes.get("places", "").split())}
    found = []
    for component, (kind, _) in members.items():
        if kind in ("Real", "Integer", "Boolean", "String") or is_connector(library, kind):
            continue
        have = components_of(library, kind)
        if is_effect(library, kind):  # part of the base model
            continue
        if all(have.get(c, ("",))[0] == t for c, t in effect.ports.items()):
            found.append(Place(names.get(component, component), (component,)))
    return found


def find_effect(library, name):
    """Return the effect of this id.

    Parameters
    ----------
    library : Library
        Of `catalogue`.
    name : str
        Its id, as ``direction_asymmetry``.

    Returns
    -------
    Effect

    Raises
    ------
    UnknownNameError
        No such effect; the nearest is named.
    """
    effects = catalogue(library)
    if name not in effects:
        raise UnknownNameError(f"no effect '{name}'{closest(name, effects)}")
    return effects[name]


def find_place(library, rig, effect, name):
    """Return the place of this name.

    Parameters
    ----------
    library : Library
        Which holds the rig.
    rig : str
        Modelica class.
    effect : Effect
        Its connectors say where it fits.
    name : str
        As ``1A``, ``1A+2A`` or ``system``; elsewhere a component's name.

    Returns
    -------
    Place

    Raises
    ------
    UnknownNameError
        The rig has no such place for the effect.
    """
    options = places(library, rig, effect)
    for place in options:
        if place.name == name:
            return place
    if not options:
        raise UnknownNameError(f"effect '{effect.id}' has no place in {rig}: it needs "
                               f"{', '.join([*effect.ports, *effect.inputs])}")
    raise UnknownNameError(f"no place '{name}' for '{effect.id}' in {rig}{closest(name, [p.name for p in options])}")


def component_name(effect, place):
    """Modelica name of the component that carries an effect's coefficients: ``viscous_1A_2A``.

    Parameters
    ----------
    effect : Effect
        Its id is the first part of the name.
    place : Place
        Its name is the rest, ``+`` and ``.`` as underscores.

    Returns
    -------
    str
    """
    return component_called(effect.id, place.name)


def component_called(effect, place):
    """The same from names alone, as a result has them.

    Parameters
    ----------
    effect, place : str
        As ``viscous`` and ``1A+2A``.

    Returns
    -------
    str
    """
    return f"{effect}_{place.replace('+', '_').replace('.', '_')}"


def component_names(effect, place):
    """Modelica names of all components that an attached effect consists of, the one with the coefficients first.

    Parameters
    ----------
    effect : Effect
        At a joined place it hangs once at each component.
    place : Place
        The first of its components has the coefficients, the others take them from it.

    Returns
    -------
    list of str
    """
    base = component_name(effect, place)
    return [base, *(f"{base}_at_{c.replace('.', '_')}" for c in place.components[1:])]

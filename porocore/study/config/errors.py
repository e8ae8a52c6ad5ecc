"""Validation errors as texts: key, expected value, given value, advice, line of the file."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, Tag
from pydantic_core import ErrorDetails

from porocore.core.echo import choices, comma_advice, cut, did_you_mean, echo, joined
from porocore.core.files.yaml_document import Location, YamlDocument, dotted, leaves
from porocore.core.inputs import NAMES, input_meant
from porocore.core.models.strict import bare, bounds, is_section, is_union
from porocore.core.units import Unit, has_unit
from porocore.errors import ConfigurationError
from porocore.macro.laws.closure import CLOSURES
from porocore.plugins.hookspecs import CommandOffer
from porocore.plugins.kinds import Kind
from porocore.plugins.registry import registry

#: A key that is known at more places than these is not told where it belongs.
MOST_PLACES = 3

_NOT_MODELLED = (
    "the solid is elastic or viscoelastic and the fluid Newtonian, without inertia; this is not modelled"
)
_RELAXATION = (
    "a solid that relaxes has 'relaxation: {branches: [{strength: 0.5, time: 10 s}]}' under cell.material"
)
_CHARGES = "fixed charges are 'macro.charges:', with density and bath"
_OF_THE_CELL = (
    "a permeability in m² follows from cell.geometry and the square of the pore size, 'scales.pore:' (or that of "
    "voxel_size), and the hydraulic conductivity from it and 'cell.viscosity:'; 'porocore check' tells both"
)
_INDENTER = (
    "a rigid indenter stands under 'macro.contact:', with its shape, its place, its displacement or force and the "
    "surfaces that it may touch; one that is bonded to a part of a surface is a displacement under 'macro.boundary:'"
)
_LAYERS = (
    "parts of a body are 'macro.regions:', each with parameters of its own or with one of several 'cells:'; materials "
    "of one cell are given under 'cell.materials:' by region of a mesh file"
)
_FIBRES = "fibres are a kind of material: cell.material: {kind: holzapfel-gasser-ogden, ...}"
_MODULUS = (
    "stresses are in units of a modulus of the solid: give it as 'scales.modulus:', at the top level, and the numbers "
    "of the material relative to it"
)
_FORCE = (
    "forces are prescribed on a surface under 'macro.boundary:', as traction, follower or plate; 'macro.loads:' "
    "multiplies them"
)
_STRAIN = "a strain is prescribed by the displacement of a surface under 'macro.boundary:'"
#: What there is instead, by pattern of the key in small letters with underscores.
INSTEAD = {
    r"(layers?|regions?|zones?|inclusions?|heterogeneity)": _LAYERS,
    r"(indenters?|punch|indentation|tool|rigid_body)": _INDENTER,
    r"(fib(re|er)s?|fib(re|er)_(directions?|angles?|families)|anisotropy)": _FIBRES,
    r"(temperature|thermal|heat|thermal_expansion)": "porocore is isothermal; the temperature counts for fixed "
    "charges alone, as 'temperature:' under macro.charges",
    r"(gravity|weight|g|self_weight)": "the weight of the mixture is 'macro.body_force: [0, −ρ g, 0]', per reference "
    "volume; the fluid feels no gravity",
    r"(density|rho|mass|inertia|acceleration)": "there is no inertia, so no density; a weight is 'macro.body_force:'",
    r"(permeability|conductivity_tensor|hydraulic_conductivity|k)": _OF_THE_CELL,
    r"(fluid|water|mu|eta|dynamic_viscosity|fluid_viscosity)": "of the fluid the viscosity alone counts: 'viscosity: 1 "
    "mPa*s' under 'cell:', with scales, else a multiple of μ_c",
    r"(solid|skeleton|matrix)": "the solid is 'material:' under 'cell:', such as {kind: neo-hookean, poisson_ratio: "
    "0.3}",
    r"(fixed|fix|clamped|encastre|roller|sliding)": "a clamped surface has 'displacement: [0, 0, 0]', one that slides "
    "'normal: 0'",
    r"(drained|undrained|permeable|impermeable|open|sealed)": "a drained surface has 'pressure: 0'; one without "
    "'pressure:' and 'flux:' is impermeable",
    r"(nu|poisson|poissons?_ratio|v)": "Poisson's ratio is 'poisson_ratio:' under 'cell.material:'",
    r"(diameter|d)": "half of it is 'radius:'",
    r"(porosity|void_ratio|pore_size|pore_diameter)": "it follows from the shape of the pores, such as 'radius:' "
    "under cell.geometry, and 'porocore check' tells it; lengths are shares of the cell's edge, and the edge in "
    "metres is 'scales.pore:'",
    r"(e|youngs?_modulus|elastic_modulus|stiffness|bulk_modulus|shear_modulus|lame)": _MODULUS,
    r"(force|forces|stress|load|loading|pressure_load)": _FORCE,
    r"(strain|compression|stretch)": _STRAIN,
    r"(friction|contact_friction)": "a plate is smooth; a surface that sticks has a displacement with all three "
    "components",
    r"(growth|swelling.*|shrinkage|free_swelling)": "a solid that swells has its free stretch as "
    "'swelling:' under cell.material",
    r"(visco|viscoelastic.*|relaxation.*|prony.*)": _RELAXATION,
    r"(charges?|fixed_charge.*|fcd|donnan.*|osmotic.*|electric.*|chemical.*|salt.*|bath)": _CHARGES,
    r"(evol.*|clogging|degradation|remodell?ing)": "parameters of the cell that evolve are 'macro.evolution:'",
    r"(creep|plastic.*|yield.*|damage|fracture|saturation)": _NOT_MODELLED,
    r"(initial_(pressure|state|stress|conditions?))": "a body begins with the pressure and the gradient of "
    "'macro.initial:'",
    r"(dt|time_step|timestep|t_end|duration)": "the time plan is 'macro.time:', with step and end",
    r"(file|file_?name|image)": "a file is named by 'path:'",
    r"(sigma|std(_?dev)?|sd|standard_deviation|errors?|uncertainty|noise)": "the standard deviation of measured values "
    "is 'deviation:', or 'deviation_share:' as a share of the largest one",
    r"(units?)": "a unit is written behind its number, such as 3 mm, once 'scales:' is given at the top level; the "
    "units of results are 'output_units:'",
    r"(bcs?|boundary_conditions?|supports?|drainage)": "boundary conditions are 'macro.boundary:', by surface",
    r"(time_functions?|amplitude|curve|cycles?)": "a prescribed value may be a function of time: {table: ...}, {ramp: "
    "..., until: ...} or {expression: ...}; macro.time.load_curve is one for all",
}
#: The same at places where a key means something else, by pattern of the dotted location with the kinds of sections.
INSTEAD_AT = {
    r".*\.materials?\.(.*\.)?ogden\.(mu|alpha)": "mu and alpha of an Ogden solid are those of its terms: 'terms: [{mu: "
    "0.1, alpha: 2}]'",
    r".*\.materials?\..*\.mu": _MODULUS,
    r"macro\.boundary\..*\.(path|(csv_?)?file(_?name)?|csv|data)": "a measured history is 'table: [[time, value], "
    "...]', with the rows of its file",
    r"macro\.boundary\.[^.]+\.p": "the pressure of the fluid on a surface is 'pressure:'",
    r".*\.geometry\.voxels\.(resolution|spacing|pixel_?size)": "the edge of a voxel is 'voxel_size:'",
    r".*\.geometry\.voxels\.(invert(ed)?|inverse)": "the value of the pores is 'pore:'; of a grey image with "
    "'threshold:', 'bright_pores: true' takes the others",
}


def instead_of(place: Location) -> str:
    """Return what there is instead of a key that is expected but unknown; empty where nothing is known."""
    there = dotted(place)
    if advice := next((said for pattern, said in INSTEAD_AT.items() if re.fullmatch(pattern, there)), ""):
        return advice
    key = place[-1]
    name = re.sub(r"[\s-]+", "_", key.strip().lower()).replace("'", "")
    return next((advice for pattern, advice in INSTEAD.items() if re.fullmatch(pattern, name)), "")


def belongs_to(key: str, root: type[BaseModel]) -> str:
    """Return the places where a key is known, in words; empty where there are none or too many to name."""
    sections = [
        (at, names) for at, names in _sections(root, ()) if at[:1] != ("cells",)
    ]  # as those of 'cell'
    places = list(dict.fromkeys(".".join(at) for at, names in sections if key in names))
    named = " or ".join(f"'{place}:'" if place else "the top level" for place in places)
    return f"it belongs under {named}" if 0 < len(places) <= MOST_PLACES else ""


def _sections(annotation: Any, at: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Iterable[str]]]:
    """Yield the place and keys of every section below, those of several kinds at one place."""
    annotation, _ = bare(annotation)
    if is_union(annotation):
        for member in get_args(annotation):
            yield from _sections(member, at)
    elif is_section(annotation):
        yield at, annotation.model_fields
        for name, field in annotation.model_fields.items():
            yield from _sections(field.annotation, (*at, name))
    elif get_origin(annotation) is dict:
        yield from _sections(get_args(annotation)[1], (*at, "NAME"))


#: Said of a section at the top level that is like none.
OF_NO_COMMAND = (
    "no installed command has a section of this name; install its plugin ('porocore plugins' lists those that are "
    "there), or remove it"
)
#: Reason of a bound, by dotted key.
WHY = {
    "cell.geometry.radius": "at 0.5 a pore or an obstacle would touch its image in the next cell",
    "cell.material.poisson_ratio": "0.5 is an incompressible solid, which this formulation cannot take",
    "sampling.workers": "'auto' is one worker for each processor core",
    "macro.loads": "a load multiplies every prescribed value, so beside values with units under 'macro.boundary:' "
    "it is a bare number: [1] for these values, [1, 2] for them and for twice them",
}
#: So similar to a key is a slip of the pen, whatever else it may mean.
SLIP = 0.8
#: Keys of sections that have other keys for each ``kind``.
OF_KINDS = ("geometry", "material", "body", "angle", "density")
#: Mappings whose values are such sections.
OF_KINDS_BY_NAME = ("materials", "regions", "fields")
#: Keys that name a file.
FILES = ("cell.geometry.path", "macro.body.path")
#: Kind of the backend that a key names.
BACKENDS: dict[str, Kind] = {
    "fem.backend": "cell solver",
    "macro.backend": "macro solver",
    "sampling.sampler": "sampler",
    "surrogate.backend": "surrogate",
}
#: Of lists with an entry for each.
AXES = ("x", "y", "z")
#: Vectors of which usually one component is given, and what the others are then.
VECTORS = {"traction": "0", "body_force": "0", "displacement": "null"}
#: A section of more keys than these is not described by them.
MOST_KEYS = 8
#: Names that pydantic adds behind the key of a value that may be a number or a section.
FORMS = ("number", "course", "text", "vector", "in-plane", "by-surface")


def faults(
    document: YamlDocument, errors: Iterable[ErrorDetails], root: type[BaseModel]
) -> list[tuple[Location, str]]:
    """Return one text for each faulty key: ``dotted.key: expected ..., got ...; what to do``."""
    grouped: dict[Location, list[ErrorDetails]] = {}
    errors = list(errors)
    for error in errors:
        if error["type"] == "too_short" and any(_is_below(other, error) for other in errors):
            # Entries are missing only because they are refused.
            continue
        grouped.setdefault(_document_location(document, error), []).append(error)
    return [(at, _text(document, at, group, root)) for at, group in grouped.items()]


def _list_of(length: int, document: YamlDocument, at: Location) -> str:
    """Return the words for a list of so many entries, with what each is where that is known."""
    kind = (*at[:-1], "kind")
    meaning = ""
    if at[-2:] == ("body", "elements") and kind in document and document.value(kind) != "box":
        meaning = "from the axis to the mantle, along y and around"
    elif at[-1] != "gradient" and length == len(AXES):
        meaning = f"along {joined(AXES)}"
    elif at[-1] in ("range", *AXES):
        meaning = "its lower and its upper end"
    elif at[-2:-1] == ("load_curve",):
        meaning = "a time and a factor"
    return f"a list of {length} entries" + (f" ({meaning})" if meaning else "")


def _as_vector(at: Location, value: Any) -> str:
    """Return the form of a vector with one component, across the surface that it belongs to; empty for other lists."""
    rest = VECTORS.get(at[-1])
    if rest is None or isinstance(value, bool) or not isinstance(value, str | int | float):
        return ""
    if isinstance(value, str) and not has_unit(value):
        return ""
    across = at[-2][:1]
    entries = [rest] * len(AXES)
    entries[AXES.index(across) if across in AXES else 1] = value if isinstance(value, str) else echo(value)
    return f", such as [{', '.join(map(cut, entries))}]"


def _in_pairs(at: Location, value: Any) -> str:
    """Return the form of pairs along each axis that stand in one list; empty for other lists."""
    if at[-1] != "crop" or not isinstance(value, list) or len(value) != 2 * len(AXES):
        return ""
    return f", such as {echo([value[i : i + 2] for i in range(0, len(value), 2)])}"


def _is_below(error: ErrorDetails, whole: ErrorDetails) -> bool:
    """Return True if an error is of a part of what another is of."""
    n = len(whole["loc"])
    return len(error["loc"]) > n and error["loc"][:n] == whole["loc"]


def with_lines(document: YamlDocument, text: str) -> str:
    """Return complaints, one a line, with file and line before each that begins with a key of the document."""
    found = []
    for complaint in text.splitlines():
        for key in (*FILES, *(f"cells.{name}.geometry.path" for name in document.data.get("cells") or ())):
            # A complaint about a file that the configuration names.
            if (at := tuple(key.split("."))) in document and complaint.startswith(
                str((document.folder / str(document.value(at))).absolute())
            ):
                complaint = f"{key}: {complaint}"
        at = tuple(complaint.partition(":")[0].split("."))
        if at[:1] in document:
            complaint = f"{document.at_line(document.line(at))}: {_as_written(document, at, complaint)}"
        found.append(complaint)
    return "\n".join(found)


def refusal(document: YamlDocument, found: Iterable[tuple[Location, str]]) -> ConfigurationError:
    """Return one error of all faults, in the order of their lines, each once."""
    told = dict.fromkeys((document.line(at), _as_written(document, at, text)) for at, text in found)
    lines = sorted(told, key=lambda fault: fault[0])
    return ConfigurationError("\n".join(f"{document.at_line(line)}: {text}" for line, text in lines))


def _as_written(document: YamlDocument, at: Location, text: str) -> str:
    """Return a complaint about a value with the words that stand in the file, where YAML or a comma hides them."""
    if at in document.switches:
        value = echo(document.value(at))
        said = f"{cut(document.switches[at])}, which YAML reads as {value}"
        return text if said.startswith(f"{value},") else text.replace(f"got {value}", f"got {said}", 1)
    if at not in document or "number" not in text:
        return text
    whole = "a whole number" in text
    advice = next(filter(None, (comma_advice(value, whole) for _, value in leaves(document.value(at)))), "")
    return text if advice in text else f"{text}{advice}"


def switched(document: YamlDocument, root: type[BaseModel]) -> Iterator[tuple[Location, str]]:
    """Yield the faults of values that are true or false where the model wants a number or text.

    Pydantic would take 'yes' for 1.
    """
    for at, value in leaves(document.data):
        if not isinstance(value, bool):
            continue
        above = [_branches(_hint(root, at[: i + 1])[0]) for i in range(len(at))]
        if bool in above[-1] or any(Any in branches for branches in above):
            continue
        names = _options(_hint(root, at)[0])
        expected = f"one of {', '.join(names)}" if names else "text" if str in above[-1] else "a number"
        yield at, unexpected(at, expected, value)


@contextmanager
def located(document: YamlDocument) -> Iterator[None]:
    """Put file and line before every complaint about a key of the document that the block raises."""
    try:
        yield
    except ConfigurationError as error:
        raise ConfigurationError(with_lines(document, str(error))) from None


def unexpected(location: Location, expected: str, got: Any) -> str:
    """Return ``dotted.key: expected ..., got ...``, with the reason of the bound if it is known."""
    key, known = dotted(location), location
    if location[0] == "cells":
        known = ("cell", *location[2:])
    reason = WHY.get(dotted(known)) or (WHY.get(dotted(known[:-1])) if known[-1].isdigit() else None)
    why = f"; {reason}" if reason else ""
    return f"{key}: expected {expected}, got {echo(got)}{why}"


def _document_location(document: YamlDocument, error: ErrorDetails) -> Location:
    """Return the place of an error in the file, without the branch of a union and the '[key]' of pydantic."""
    location = _without_tags(tuple(str(part) for part in error["loc"]))
    if error["type"] == "union_tag_invalid":
        return (*location, "kind")
    if error["type"] == "missing":  # an entry of a list, within the branch tuple[…] of a union
        return tuple(part for part in location if not part.startswith("tuple["))
    while location and location not in document:
        location = location[:-1]
    return location


def _text(document: YamlDocument, at: Location, group: list[ErrorDetails], root: type[BaseModel]) -> str:
    error = group[0]
    key = dotted(at) or "the configuration"
    kind = error["type"]
    place = _with_tags(at, error)
    if kind == "extra_forbidden":
        # Of a section with kinds the keys of another kind are no advice.
        advice = instead_of(place) or ("" if len(place) > len(at) else belongs_to(at[-1], root))
        section = len(at) == 1 and isinstance(document.value(at), dict)
        return f"{key}: unknown key; {_other_keys(place, root, advice or (section and OF_NO_COMMAND) or '')}"
    if kind != "value_error" and error["loc"] and error["loc"][-1] == "[key]":
        names = _options(_hint(root, at[:-1])[0], keys=True)
        if set(names) == set(NAMES):
            advice = input_meant(at[-1]) or "remove it"
            return f"{key}: unknown key; {advice}; {choices(names, 'the keys here are')}".replace("?;", "?")
        return f"{key}: unknown key; {_nearest(at[-1], names)}"
    if kind == "missing":
        if at[-1].isdigit():
            (length, *_) = _lengths(_hint(root, place[:-1])[0])
            return unexpected(at[:-1], _list_of(length, document, at[:-1]), document.value(at[:-1]))
        return f"{key}: missing; add '{cut(at[-1])}:' {_under(at)}"
    if kind == "value_error":
        return f"{key}: {error['ctx']['error']}"
    if kind == "union_tag_invalid":
        tags = [tag for tag in _by_kind(_hint(root, at[:-1])[0]) if tag not in FORMS]
        text = unexpected(at, f"one of {', '.join(tags)}", document.value(at))
        tag = error["ctx"]["tag"]
        for other, branch in _by_kind(_hint(root, at[:-1])[0]).items():
            for name, field in branch.model_fields.items() if is_section(branch) else ():
                if name != at[-1] and tag in _options(field.annotation):
                    return f"{text}; write '{at[-1]}: {other}' and '{name}: {tag}'"
        return _with_question(text, tag, tags)
    if kind == "too_long" and (length := error["ctx"]["max_length"]) in _lengths(_hint(root, place)[0]):
        text = unexpected(
            at, _list_of(length, document, at) + _in_pairs(at, document.value(at)), document.value(at)
        )
        return f"{text}; commas separate the entries, and decimals stand after a point"
    expected = " or ".join(dict.fromkeys(_expected(e, document, at, place, root) for e in group))
    text = unexpected(at, expected, document.value(at) if at in document else error["input"])
    if "a number" in expected and Unit("cell") in _hint(root, place)[1]:
        text += "; it is a share of the cell's edge"
    if kind == "literal_error" and isinstance(error["input"], str):
        return _with_question(text, error["input"], _options(_hint(root, place)[0]))
    return text


def _lengths(annotation: Any) -> set[int]:
    """Return the lengths of the lists of a fixed length that a value may be."""
    lists = [get_args(branch) for branch in _branches(annotation) if get_origin(branch) is tuple]
    return {len(entries) for entries in lists if Ellipsis not in entries}


def _with_question(text: str, name: str, names: list[str]) -> str:
    question = did_you_mean(name, names)
    return f"{text}; {question}" if question else text


def _expected(
    error: ErrorDetails, document: YamlDocument, at: Location, place: Location, root: type[BaseModel]
) -> str:
    kind, context = error["type"], error.get("ctx", {})
    name = place[-1] if place and not place[-1].isdigit() else "value"
    if kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        return bounds(name, _hint(root, place)[1]) or error["msg"].removeprefix("Input should be ")
    if kind == "literal_error":
        return str(context["expected"])
    if kind == "string_pattern_mismatch":
        return _matching(context["pattern"])
    if kind == "too_long":
        return f"at most {context['max_length']} entries"
    if kind == "too_short":
        return f"at least {context['min_length']} {'entry' if context['min_length'] == 1 else 'entries'}"
    if kind.startswith("float_"):
        return _number(name, error["input"], _hint(root, place)[1])
    if kind == "finite_number":
        return "a finite number"
    if kind.startswith("int_"):
        return bounds(name, _hint(root, place)[1], "a whole number") or "a whole number"
    if kind == "tuple_type" and (length := next(iter(_lengths(_hint(root, place)[0])), 0)):
        return _list_of(length, document, at) + _as_vector(at, document.value(at))
    if kind in ("tuple_type", "list_type"):
        return "a list"
    if kind in ("model_type", "dict_type"):
        sections = [b for b in _branches(_hint(root, place)[0]) if is_section(b)]
        keys = dict.fromkeys(name for section in sections for name in section.model_fields)
        named = f" ({', '.join(keys)})" if 0 < len(keys) <= MOST_KEYS else ""
        form = "".join(_first(keys, error["input"]))
        if place[:-1] == ("cell", "materials"):
            return (
                "the solid of a region by its name, such as {matrix: {kind: neo-hookean, poisson_ratio: 0.3}} (one "
                "solid alone is 'material:' in place of 'materials:', and its modulus is 'scales.modulus:')"
            )
        return f"a section with keys below it{named}{form} (or leave the whole key out)"
    if kind == "string_too_long":
        return f"text of at most {context['max_length']} characters"
    if kind == "string_type":
        patterns = (extra.pattern for extra in _hint(root, place)[1] if getattr(extra, "pattern", None))
        names = _names(place)
        return f"one of {', '.join(names)}" if names else next(map(_matching, patterns), "text")
    return error["msg"].removeprefix("Input should be ")


def _first(keys: Iterable[str], value: Any) -> Iterator[str]:
    """Yield the form of a section with the key under which a value is meant that stands in its place."""
    for name, kind in (("kind", str), ("backend", str), ("range", list)):
        if name in keys and isinstance(value, kind) and not (isinstance(value, str) and value[:1].isdigit()):
            yield f", such as {{{name}: {cut(value) if isinstance(value, str) else echo(value)}}}"
    if {"lower", "upper"} <= set(keys) and isinstance(value, list) and len(value) == 2:
        lower, upper = (cut(end) if isinstance(end, str) else echo(end) for end in value)
        yield f", such as {{lower: {lower}, upper: {upper}}}"


def _number(name: str, value: Any, metadata: list[Any]) -> str:
    """Return the words for a number in place of ``value``; for a value with a unit that it has none, and its bounds."""
    if not isinstance(value, str) or not has_unit(value):
        return "a number"
    return f"{bounds(name, metadata) or 'a number'} without a unit"


def _matching(pattern: str) -> str:
    """Return the words for a text of a pattern, which may be a choice."""
    choice = re.fullmatch(r"\^\(([\w|]+)\)\$", pattern)
    return f"one of {choice[1].replace('|', ', ')}" if choice else f"text matching {pattern}"


def _names(at: Location) -> list[str]:
    """Return what a text at a location may name: closures or installed backends; nothing where it is any text."""
    if at == ("closure",):
        return list(CLOSURES)
    kind = BACKENDS.get(dotted(at))
    return registry().names(kind) if kind is not None else []


def _without_tags(location: Location) -> Location:
    """Return a location without the kinds that pydantic adds to sections of several kinds."""
    return tuple(part for i, part in enumerate(location) if not _is_tag(location, i))


def _is_tag(location: Location, i: int) -> bool:
    by_name = i > 1 and location[i - 2] in OF_KINDS_BY_NAME
    if i == 2 and location[0] == "cells":  # whatever the name of the cell is
        return False
    shape = i == 4 and location[:2] == ("macro", "contact") and location[3] == "shape"
    return i > 0 and (by_name or shape or location[i - 1] in OF_KINDS or location[i] in FORMS)


def _with_tags(at: Location, error: ErrorDetails) -> Location:
    """Return a location in the document with the kinds of its sections, as :func:`_hint` understands it."""
    whole = tuple(str(part) for part in error["loc"])
    for i, part in enumerate(whole):
        if _is_tag(whole, i) and len(at) > i:
            at = (*at[:i], part, *at[i:])
    return at


def _by_kind(annotation: Any) -> dict[str, Any]:
    """Return the branches of a section of several kinds by kind."""
    branches = map(bare, _branches(annotation, keep_annotated=True))
    return {extra.tag: branch for branch, more in branches for extra in more if isinstance(extra, Tag)}


def _hint(root: type[BaseModel], at: Location) -> tuple[Any, list[Any]]:
    """Return annotation and constraints of the value at a location; (None, []) without a value."""
    annotation: Any = root
    metadata: list[Any] = []
    for part in at:
        kinds = _by_kind(annotation)
        if part in kinds:
            annotation, metadata = kinds[part], []
            continue
        for branch in _branches(annotation):
            origin, arguments = get_origin(branch), get_args(branch)
            if is_section(branch) and part in branch.model_fields:
                field = branch.model_fields[part]
                annotation, metadata = field.annotation, list(field.metadata)
                break
            if origin is dict:
                annotation, metadata = arguments[1], []
                break
            if origin is tuple and part.isdigit():
                same = arguments[-1] is Ellipsis
                annotation, metadata = arguments[0 if same else min(int(part), len(arguments) - 1)], []
                break
        else:
            return None, []
        for branch in _branches(annotation, keep_annotated=True):
            for extra in bare(branch)[1]:
                metadata += getattr(extra, "metadata", [extra])
    return annotation, metadata


def _branches(annotation: Any, keep_annotated: bool = False) -> list[Any]:
    """Return the members of a union, without their constraints unless these are to be kept."""
    inner, _ = bare(annotation)
    if not keep_annotated or is_union(inner):
        annotation = inner
    if is_union(annotation):
        return [b for member in get_args(annotation) for b in _branches(member, keep_annotated)]
    return [annotation]


def _options(annotation: Any, keys: bool = False) -> list[str]:
    """Return the texts that a Literal allows, or with ``keys`` those that a dictionary allows as keys."""
    found = []
    for branch in _branches(annotation):
        if keys and get_origin(branch) is dict:
            found += _options(get_args(branch)[0])
        elif not keys and get_origin(branch) is Literal:
            found += [str(option) for option in get_args(branch)]
    return found


def _other_keys(at: Location, root: type[BaseModel], advice: str) -> str:
    """Return the ``advice`` on an unknown key, or the keys that there are where it is empty or one is as good as it."""
    branches = _branches(_hint(root, at[:-1])[0])
    names = [name for branch in branches if is_section(branch) for name in branch.model_fields]
    if len(at) == 1 and "macro" in names:
        offers = (offered.offer for offered in registry().offers)
        names += [offer.section for offer in offers if isinstance(offer, CommandOffer) and offer.section]
    before, colon, behind = at[-1].partition(":")
    if colon and before.strip() in names:
        return f"the blank behind the colon is missing: write '{before.strip()}: {cut(behind.strip())}'"
    if advice == OF_NO_COMMAND:
        return _nearest(at[-1], names) if did_you_mean(at[-1], names) else advice
    if advice and not did_you_mean(at[-1], names, cutoff=SLIP):
        return advice
    return _nearest(at[-1], names)


def _nearest(name: str, names: list[str]) -> str:
    question = did_you_mean(name, names) or "remove it;"
    return f"{question} {choices(names, 'the keys here are', 'this section has no keys')}"


def _under(at: Location) -> str:
    if len(at) > 1:
        return f"under '{dotted(at[:-1])}:'"
    return "at the top level; 'porocore init' lists examples to copy it from"

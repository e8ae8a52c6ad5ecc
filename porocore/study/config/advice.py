"""Advice on unknown keys: what there is instead, and where a known key belongs."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Any, get_args, get_origin

from pydantic import BaseModel

from porocore.core.models.walk import bare, is_section, is_union

#: A key that is known at more places than these is not told where it belongs.
MOST_PLACES = 3

_NOT_MODELLED = "the solid is elastic and the fluid Newtonian, without inertia; this is not modelled"
_OF_THE_CELL = "it follows from the pore and its viscosity: give cell.geometry and cell.viscosity"
_INDENTER = (
    "a rigid indenter is a part of a surface: name it under 'macro.surfaces:' and prescribe its displacement under "
    "'macro.boundary:', as the example brain-indentation does; contact that begins or ends is not modelled"
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
    r"(temperature|thermal|heat|thermal_expansion)": "porocore is isothermal; temperature is not modelled",
    r"(gravity|weight|g|self_weight)": "the weight of the mixture is 'macro.body_force: [0, −ρ g, 0]', per reference "
    "volume; the fluid feels no gravity",
    r"(density|rho|mass|inertia|acceleration)": "there is no inertia, so no density; a weight is 'macro.body_force:'",
    r"(permeability|conductivity_tensor|hydraulic_conductivity|k)": _OF_THE_CELL,
    r"(porosity|void_ratio|pore_size|pore_diameter)": "it follows from cell.geometry, which 'porocore check' tells; "
    "the pore size in metres is 'scales.pore:'",
    r"(e|youngs?_modulus|elastic_modulus|stiffness|bulk_modulus|shear_modulus|lame)": _MODULUS,
    r"(force|forces|stress|load|loading|pressure_load)": _FORCE,
    r"(strain|compression|stretch)": _STRAIN,
    r"(friction|contact_friction)": "a plate is smooth; a surface that sticks has a displacement with all three "
    "components",
    r"(growth|swelling.*|osmo.*|shrinkage|free_swelling)": "a solid that swells has its free stretch as "
    "'swelling:' under cell.material",
    r"(visco|viscoelastic.*|relaxation|creep|prony|plastic.*|yield.*|damage|fracture|fixed_charge.*|"
    r"saturation|electric.*|chemical.*)": _NOT_MODELLED,
    r"(initial_(pressure|state|stress|conditions?))": "a body begins with the pressure and the gradient of "
    "'macro.initial:'",
    r"(dt|time_step|timestep|t_end|duration)": "the time plan is 'macro.time:', with step and end",
    r"(file|file_?name|image)": "a file is named by 'path:'",
    r"(units?)": "a unit is written behind its number, such as 3 mm, once 'scales:' is given at the top level; the "
    "units of results are 'output_units:'",
    r"(bcs?|boundary_conditions?|supports?|drainage)": "boundary conditions are 'macro.boundary:', by surface",
    r"(time_functions?|amplitude|curve|cycles?)": "a prescribed value may be a function of time: {table: ...}, {ramp: "
    "..., until: ...} or {expression: ...}; macro.time.load_curve is one for all",
}


def instead_of(key: str) -> str:
    """Return what there is instead of a key that is expected but unknown; empty where nothing is known."""
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

"""Rows on the cell for the report: conductivity, linear coefficients, mesh, names of components."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from porocore.core.units import units_now
from porocore.interfaces.solution import Profile
from porocore.macro.laws.closure import is_isotropic
from porocore.macro.laws.linear import VOIGT, EffectiveProperties
from porocore.report.context import CellSummary, Published
from porocore.report.format import NONE, in_unit, measured, multiple, number, unit
from porocore.report.metrics import LoadCase
from porocore.report.words.parameters import BodyCells
from porocore.states import Array

#: What is printed of a value.
Say = Callable[[float], str]

#: A component off the diagonal below this share of the two diagonal ones is zero up to the mesh.
NOTHING = 1e-3
_SUBSCRIPTS = "₁₂₃"
#: Pairs i ≠ j of a symmetric tensor.
PAIRS = ((0, 1), (0, 2), (1, 2))


def name_of(symbol: str, *axes: int) -> str:
    """Return the name of a component, such as ``K₂₂``, or ``C_eff,1122`` of the symbol ``C_eff,``."""
    digits = "123" if symbol.endswith(",") else _SUBSCRIPTS
    return symbol + "".join(digits[i] for i in axes)


def is_one(values: Sequence[float], say: Say = number) -> bool:
    """Tell whether values along the axes are the same in the digits that are printed."""
    return len({say(float(value)) for value in values}) == 1


def together(names: Sequence[str], values: Sequence[float], say: Say = number) -> Iterator[tuple[str, float]]:
    """Yield name and value of each component, or one row where all are printed as the same."""
    if is_one(values, say):
        yield " = ".join(names), float(values[0])
    else:
        yield from zip(names, map(float, values), strict=True)


def symmetric(symbol: str, tensor: Array, say: Say = number) -> Iterator[tuple[str, float]]:
    """Yield name and value of the components of a tensor (3, 3); those off the diagonal where they are not zero."""
    entries = np.diag(tensor)
    yield from together([name_of(symbol, i, i) for i in range(3)], list(entries), say)
    least = np.finfo(float).eps ** 0.5 * np.abs(entries).max()
    for i, j in PAIRS:
        value = float(tensor[i, j])
        if abs(value) > max(NOTHING * float(np.sqrt(abs(entries[i] * entries[j]))), least):
            yield name_of(symbol, i, j), value


def of_fourth_order(symbol: str, tensor: Array) -> Iterator[tuple[str, float]]:
    """Yield name and value of the components iiii and iijj of a tensor (3, 3, 3, 3), iijj of both signs of i − j."""
    yield from family(symbol, tensor, [(i, i, i, i) for i in range(3)])
    mixed = [(i, i, j, j) for i in (1, 0, 2) for j in range(3) if i != j]
    values = [float(tensor[at]) for at in mixed]
    if is_one(values):
        yield f"{name_of(symbol, *mixed[0])} and all other {symbol}_iijj", values[0]
    else:
        yield from zip([name_of(symbol, *at) for at in mixed], values, strict=True)


def family(
    symbol: str, tensor: Array, places: Sequence[tuple[int, ...]], say: Say = number
) -> Iterator[tuple[str, float]]:
    """Yield name and value of components of one kind."""
    yield from together([name_of(symbol, *at) for at in places], [float(tensor[at]) for at in places], say)


#: Ends of the names of facts on the mesh of a part, as a reader finds them.
_PARTS = {"in the eighth": "in one eighth of the cell, by symmetry", "in the whole": "in the whole cell"}

_AXES = ("along x", "along y", "along z")


@dataclass(frozen=True)
class ComparisonRow:
    """Quantity with its published value and that of this run."""

    name: str
    published: str
    found: str


def cell_rows(cell: CellSummary, published: Published | None) -> list[ComparisonRow]:
    """Return porosity, conductivity and micro–macro tangents of the undeformed cell."""
    linear, scales = cell.linear, units_now().scales
    said = {} if published is None else _said(published, cell.viscosity)
    rows = [("porosity φ_f", measured(cell.porosity, ""))]
    if cell.image_porosity is not None:
        rows.append(("porosity of the image", measured(cell.image_porosity, "")))
    viscosity = units_now().text(cell.viscosity, "viscosity")
    for name, value in symmetric("K", linear.conductivity, _said_of("conductivity")):
        rows.append((f"{name} at μ_f = {viscosity}", measured(value, "conductivity")))
    if scales is not None:
        said_of = _said_of("permeability")
        for name, value in symmetric("k", cell.properties.permeability, said_of):
            rows.append((f"permeability {name}", said_of(value)))
    rows += [(name, measured(value, "")) for name, value in of_fourth_order("M", linear.mean_grad_grad_u)]
    said_of = _said_of("compliance")
    rows += [(name, said_of(value)) for name, value in symmetric("Q", linear.mean_grad_p, said_of)]
    return [
        ComparisonRow(name, next((text for part, text in said.items() if part in name), NONE), found)
        for name, found in rows
    ]


def _said_of(quantity: str) -> Callable[[float], str]:
    """Return what writes a value with its unit."""
    return partial(measured, quantity=quantity)


def _said(published: Published, viscosity: float) -> dict[str, str]:
    """Return what the publication says, by the name of its component."""
    return {
        "φ_f": number(published.porosity, 2),
        "K₁₁": measured(published.conductivity_viscosity / viscosity, "conductivity", 4),
        "M₂₂₂₂": number(published.mean_grad_2222, 2),
        "M₂₂₁₁": number(published.mean_grad_2211, 2),
        "Q₁₁": measured(published.mean_grad_p_11, "compliance", 3),
    }


def linear_rows(found: EffectiveProperties) -> list[tuple[str, str]]:
    """Return the coefficients of linear poroelasticity, along each axis where they differ."""
    said = _as_multiple("stress")
    return [
        *held_rows(found),
        *(
            (f"drained stiffness {name}", said(value))
            for name, value in _stiffness(found.stiffness_voigt, said)
        ),
        *moduli_rows(found),
    ]


def held_rows(found: EffectiveProperties) -> list[tuple[str, str]]:
    """Return the stress of a cell whose swelling is held; empty unless its solid swells."""
    said = _as_multiple("stress")
    held = symmetric("P_E,", found.held_stress, said) if found.held_stress.any() else ()
    return [(f"stress while the swelling is held {name}", said(value)) for name, value in held]


def _stiffness(C: Array, said: Callable[[float], str]) -> Iterator[tuple[str, float]]:
    """Yield name and value of the components of a stiffness (6, 6) that a cell with its mirrors has."""
    place = {frozenset(axes): k for k, axes in enumerate(VOIGT)}
    for kind in (
        [(i, i, i, i) for i in range(3)],
        [(i, i, j, j) for i, j in PAIRS],
        [(i, j, i, j) for i, j in PAIRS],
    ):
        values = [float(C[place[frozenset(at[:2])], place[frozenset(at[2:])]]) for at in kind]
        yield from together([name_of("C_eff,", *at) for at in kind], values, said)


def moduli_rows(found: EffectiveProperties) -> list[tuple[str, str]]:
    """Return engineering moduli, Biot's coefficients and c_v, along each axis where they differ."""
    said = _as_multiple("stress")
    contractions = [(i, j) for i in range(3) for j in range(3) if i != j]
    ratios = [float(found.poisson_ratios[at]) for at in contractions]
    poisson = (
        [("Poisson's ratio ν", ratios[0])]
        if is_one(ratios)
        else [(f"Poisson's ratio {name_of('ν', *at)}", x) for at, x in zip(contractions, ratios, strict=True)]
    )
    shears = [name_of("G", *axes) for axes in VOIGT[3:]]
    rows = [
        *_along("confined modulus", "H", found.confined_moduli, said),
        *_along("drained Young's modulus", "E", found.young_moduli, said),
        *((name, number(value)) for name, value in poisson),
        *((f"shear modulus {name}", said(x)) for name, x in together(shears, list(found.shear_moduli), said)),
    ]
    if math.isfinite(found.anisotropy_ratio):
        rows.append(("anisotropy ratio 2 G (1 + ν)/E, 1 if isotropic", number(found.anisotropy_ratio)))
    if not found.storage:
        return rows
    by_time, c_v = _as_multiple("diffusivity"), found.consolidation_coefficients
    along = (
        [("along each axis", c_v[0])] if is_one(list(c_v), by_time) else list(zip(_AXES, c_v, strict=True))
    )
    return [
        *rows,
        *((f"Biot coefficient {name}", number(value)) for name, value in symmetric("α", found.biot_tensor)),
        ("Biot modulus M_B", said(found.biot_modulus)),
        ("storage 1/M_B", multiple(found.storage, "compliance")),
        *((f"consolidation coefficient c_v {axis}", by_time(value)) for axis, value in along),
    ]


def _along(words: str, symbol: str, values: Array, said: Callable[[float], str]) -> Iterator[tuple[str, str]]:
    """Yield the rows of a property along the axes, one where all are printed as the same."""
    names = [name_of(symbol, axis) for axis in range(3)]
    yield from ((f"{words} {name}", said(value)) for name, value in together(names, list(values), said))


def _as_multiple(quantity: str) -> Callable[[float], str]:
    """Return what writes a value with its unit, or what it is a multiple of."""
    return partial(multiple, quantity=quantity)


def mesh_rows(mesh: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return the facts on the mesh; counts of tetrahedra of an eighth with those of the whole cell."""
    rows = []
    for name, value in mesh.items():
        part = next((each for each in _PARTS if name.endswith(each)), "")
        count = value.replace(",", "")
        if part == "in the eighth" and "tetrahedra" in name and count.isdigit():
            value = f"{value} ({8 * int(count):,} in the whole cell)"
        rows.append((name.removesuffix(part) + _PARTS.get(part, ""), value))
    return rows


#: Transformation of K, by whether it rotates with the solid.
_TRANSFORMED = {
    False: "transformed with the mean deformation gradient F̄ of the solid: K_t = F̄⁻¹ K F̄⁻ᵀ",
    True: "transformed with the mean deformation gradient F̄ = R̄ Ū of the solid, and it rotates with the solid: "
    "K_t = Ū⁻¹ K Ū⁻¹",
}


def conductivity_sentence(case: LoadCase, cell: CellSummary, body: BodyCells | None = None) -> str:
    """Return the conductivity of the flux in words, with its component 22 at the last profile.

    ``body`` are the cells of a body of many.
    """
    K = cell.linear.conductivity[None] if body is None else body.conductivity
    if cell.law == "deformed":
        found = (
            "The flux through reference area is −K_ref ∇p. K_ref is the conductivity of the deformed pore. For every "
            "sampled state, the flow was solved in the deformed pore, and a surrogate was trained on the results. "
            "The figures show K_t = K_ref/det F̄."
        )
    else:
        turned = cell.law == "piola" and not is_isotropic(K)
        found = (
            f"The conductivity K of the undeformed pore is {_TRANSFORMED[turned]}. The figures show K_t. "
            "The flux of the fluid through reference area is −K_ref ∇p with K_ref = det F̄ K_t: K_t is the "
            "conductivity of the deformed body, and K_ref decides how fast the body drains. In this model, "
            "compression along an axis raises K_t and K_ref along this axis, although the pores become narrower. "
            "Extension lowers them. The time of consolidation depends on K_ref along the axes along which the body "
            "drains."
        )
    if not case.nonlinear.profiles:
        return found
    last = case.nonlinear.profiles[-1]
    drained = drained_axes(case)
    at_first = " at t = 0" if body is not None and body.cells.varies else ""
    told = [_at_axis(i, last, K, at_first) for i in drained or ((1,) if is_isotropic(K) else range(3))]
    if drained:
        found += " The body drains along " + " and ".join("xyz"[i] for i in drained) + "."
    return f"{found} At t = {measured(last.time, 'time', 3)}, {' '.join(told)}"


def drained_axes(case: LoadCase) -> tuple[int, ...]:
    """Return the axes of the faces of a block (x+, y-) through which fluid moves; empty for other bodies."""
    flows = case.nonlinear.inflow.items()
    moved = {name[0] for name, flow in flows if name[1:] in ("+", "-") and np.any(flow)}
    return tuple(i for i, axis in enumerate("xyz") if axis in moved)


def _change(values: Array, rest: Array, largest: float) -> str:
    """Return whether K_ref along an axis lies above its value in the undeformed cell, below it, or on both sides.

    Where both are below 1e-6 of the ``largest`` of all axes, nothing flows along the axis.
    """
    if max(np.abs(values).max(), np.abs(rest).max()) <= 1e-6 * largest:
        return "unchanged"
    change = np.divide(values, rest, out=np.full_like(values, np.inf), where=rest != 0) - 1
    if np.abs(change).max() <= 1e-6:
        return "unchanged"
    if change.min() >= -1e-6:
        return "raised"
    return "lowered" if change.max() <= 1e-6 else "lowered in parts of the body and raised in others"


def _at_axis(i: int, profile: Profile, K: Array, at_first: str) -> str:
    """Return K_ref and K_t along an axis, from least to largest in the body, and K (1 or elements, 3, 3) at rest."""
    transformed, through_reference, undeformed = (
        " to ".join(
            dict.fromkeys(in_unit(float(end(values[:, i, i])), "conductivity", 3) for end in (np.min, np.max))
        )
        for values in (profile.conductivity, profile.reference_conductivity, K)
    )
    at, by = f"{i + 1}{i + 1}", unit("conductivity")
    if len(K) == 1:
        rest = f"In the undeformed cell, both are {measured(float(K[0, i, i]), 'conductivity', 3)}. Therefore"
    else:
        rest = f"In the undeformed cells{at_first}, both are {undeformed}{by}. Compared with the cell of its own place"
        rest += f"{at_first},"
    return (
        f"K_ref,{at} is {through_reference} in the body, and K_t,{at} is {transformed}{by}. "
        f"{rest} K_ref,{at} is {_change(profile.reference_conductivity[:, i, i], K[:, i, i], float(np.abs(K).max()))}."
    )

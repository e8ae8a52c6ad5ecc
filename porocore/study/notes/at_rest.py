"""Outline of a study from its undeformed cell: moduli, permeability, consolidation time, thin fluid."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import Domain
from porocore.core.files.store import ResultStore
from porocore.core.units import MULTIPLES, QUANTITIES, ResultUnits, Scales, length_text
from porocore.errors import PluginError
from porocore.interfaces.law import MacroLaw
from porocore.macro.boundary.drainage import (
    drainage_time,
    drained_axes,
    drained_surfaces,
    held_sideways,
    moved,
    relaxation_time,
)
from porocore.macro.composition.fields import AXES
from porocore.macro.composition.regions import by_region, cells_of_elements, regions_of_cell
from porocore.macro.laws.composed import NearestMemberLaw
from porocore.macro.laws.linear import (
    SAME,
    EffectiveProperties,
    LinearCoefficients,
    LinearPoroelasticity,
    RestCoefficients,
    coefficients_of_elements,
)
from porocore.macro.problem import MacroSetup, body_mesh
from porocore.plugins import registry
from porocore.report.format import number
from porocore.states import Array
from porocore.study.config.config import RunConfig, lines_of_cell
from porocore.study.notes.linear_reach import predicted_reach, prescribed_reach
from porocore.study.notes.magnitudes import run_times
from porocore.study.run.composition import law_of_body, with_memory
from porocore.study.run.reference import undeformed

#: Tetrahedra of the part of the cell that is solved, and nodes of the body, beyond which a check would take long.
MOST_TETRAHEDRA, MOST_NODES = 20_000, 40_000
#: No liquid in a tissue, soil or filter has less than this viscosity [Pa s].
THIN = 1e-4


def at_rest(config: RunConfig, store: ResultStore | None = None) -> Iterator[str]:
    """Yield what the undeformed cell makes of the study, line by line; the cell is solved, unless it is large.

    With its moduli the body is solved linearly, which predicts what leaves the sampled ranges.

    Raises
    ------
    PorocoreError
        The undeformed cell cannot be solved.
    """
    for name in config.cell_names:
        yield from lines_of_cell(name, thin_fluid(config.cell_named(name), config.scales))
    try:
        registry.get("cell solver", config.fem.backend)
    except PluginError:
        yield from _prescribed(config)
        return
    found = []
    for name in config.cell_names:
        with config.keys_of(name):
            of_cell = yield from _cell_at_rest(config, name, store)
            if of_cell is not None:
                found.append(of_cell)
    if len(found) < len(config.cell_names):  # the body is of larger cells too
        yield from _prescribed(config)
        return
    coefficients, laws = found[0][0], dict(zip(config.cell_names, (each for _, each in found), strict=True))
    law = law_of_body(config, laws)
    head = "consolidation" if config.cells else "  consolidation"  # else below the lines of the cell
    linear = linear_in_body(config.macro, law, coefficients)
    relaxes = any(config.relaxations.values())
    yield from _consolidation(config.macro, linear, config.result_units, head, relaxes=relaxes)
    remembering = {name: with_memory(each, config.of_cell(name), linear=True) for name, each in laws.items()}
    yield from predicted_reach(config, law_of_body(config, remembering))


def tetrahedra_solved(cell: Cell) -> int:
    """Return how many tetrahedra of solid and pores the part of a cell has that is solved."""
    part: Domain = "eighth" if cell.mirrored else "whole"
    return len(cell.make_mesh("solid", part).cells) + len(cell.make_mesh("fluid", part).cells)


def too_large_to_solve(tetrahedra: int, of: str = "the cell") -> str:
    """Return in words why a check does not solve a cell of so many tetrahedra; empty where it does."""
    if tetrahedra <= MOST_TETRAHEDRA:
        return ""
    return (
        f"not solved here, since {of} has {tetrahedra:,} tetrahedra, and a check solves up to {MOST_TETRAHEDRA:,}; "
        "'porocore cell' solves it"
    )


def _cell_at_rest(
    config: RunConfig, name: str | None, store: ResultStore | None
) -> Generator[str, None, tuple[LinearCoefficients, MacroLaw] | None]:
    """Yield what is known of a cell at rest, and return linear poroelasticity and law; None for a cell that is large.

    Those of a family are of its middle, and of the nearest of some of its members.
    """
    one, units = config.of_cell(name), config.result_units
    head, of = ("at rest", "the cell") if name is None else (f"cell {name} at rest", f"the cell {name}")
    count = tetrahedra_solved(one.cell)
    if said := too_large_to_solve(count, of):
        yield f"at rest: {said}"
        return None
    reference = undeformed(one.cell, one.fem, one.conductivity, store)
    coefficients, found = (
        reference.coefficients(one.cell, one.conductivity),
        reference.properties(one.cell, one.conductivity),
    )
    middle = ", in the middle of the ranges" if one.cell.is_family else ""
    turned = turned_by(config.macro, name)
    yield f"{head}, drained{middle}{f'; axes are those of the cell, turned by {turned}' if turned else ''}:"
    yield from (f"  {line}" for line in cell_lines(found, one.cell.viscosity, units))
    if axes := drained_axes(config.macro):
        yield f"  {coefficients_of_consolidation(found, axes, units, turned=bool(turned))}"
    if not one.cell.is_family:
        return coefficients, LinearPoroelasticity(coefficients)
    members = BodyMembers.solved(config, store, most=max(1, MOST_TETRAHEDRA // count), cell=name)
    yield from members.as_lines(one.result_units)
    return coefficients, members.law


#: Members of a family that are solved at most.
MOST_MEMBERS = 6
#: So near to the next member, as a share of the ranges, cells count as it.
NEAR = 0.05


@dataclass(frozen=True, eq=False)
class BodyMembers:
    """Undeformed members of a family that are like the cells of a body.

    Attributes
    ----------
    values : (k, m)
        Their parameters.
    coefficients
        Linear poroelasticity of each.
    """

    names: tuple[str, ...]
    values: Array
    coefficients: tuple[LinearCoefficients, ...]
    law: MacroLaw

    @classmethod
    def solved(
        cls, config: RunConfig, store: ResultStore | None, most: int = MOST_MEMBERS, cell: str | None = None
    ) -> BodyMembers:
        """Solve the members, or take them from the store; ``most`` of them, and no more than :data:`MOST_MEMBERS`.

        ``cell`` is the name of the family; None names that of the rest of the body.

        Raises
        ------
        ConfigurationError
            Fields do not suit the body, or a member is no cell.
        PorocoreError
            A member cannot be solved.
        """
        family = config.of_cell(cell).cell
        ranges = {each.name: (each.lower, each.upper) for each in family.parameters}
        end = config.macro.time.end
        there = np.concatenate(list(config.values_in_body(cell, (0.0, end / 2, end))))
        values = spread(there, ranges, min(most, MOST_MEMBERS))
        found = []
        for row in values:
            member = family.at(row)
            at = undeformed(member, config.fem, config.conductivity, store)
            found.append(
                LinearCoefficients.from_reference(
                    at.response, at.solid_fraction, member.solid, at.conductivity
                )
            )
        law = NearestMemberLaw([*map(LinearPoroelasticity, found)], values, ranges)
        return cls(tuple(ranges), values, tuple(found), law)

    def as_lines(self, units: ResultUnits) -> Iterator[str]:
        """Yield the parameters of the members and their least and largest moduli and conductivities."""
        ends = ", ".join(f"{name} {_from_to(self.values[:, k])}" for k, name in enumerate(self.names))
        count = len(self.values)
        yield (
            f"over the body, by {count} of its cells with {ends}:"
            if count > 1
            else f"in the body, with {ends}:"
        )
        moduli = np.array([np.einsum("iiii->i", c.stiffness) for c in self.coefficients])
        K = np.array([np.diag(c.conductivity) for c in self.coefficients])
        E = units.name("stress") if units.given else "E"
        conducted = f" {units.name('conductivity')}" if units.given else ""
        yield (
            f"  confined modulus {_from_to(moduli * units.factor('stress'))} {E}; conductivity K "
            f"{_from_to(K * units.factor('conductivity'))}{conducted}"
        )


def linear_in_body(
    macro: MacroSetup, law: MacroLaw, coefficients: LinearCoefficients
) -> LinearCoefficients | RestCoefficients:
    """Return linear poroelasticity of the elements of a body at first; of one cell everywhere its ``coefficients``."""
    cells = cells_of_elements(macro, body_mesh(macro), law, [0.0])
    return coefficients if cells is None else coefficients_of_elements(law, cells)


def spread(values: Array, ranges: dict[str, tuple[float, float]], most: int) -> Array:
    """Return rows of ``values`` (n, m) near which all others lie, ``most`` of them: the middle one, then the farthest.

    Distances are shares of the ranges.
    """
    low, high = np.array(list(ranges.values())).T
    unit = (values - low) / (high - low)
    chosen = [int(np.linalg.norm(unit - unit.mean(axis=0), axis=1).argmin())]
    away = np.full(len(unit), np.inf)
    while True:
        away = np.minimum(away, np.linalg.norm(unit - unit[chosen[-1]], axis=1))
        if len(chosen) >= most or away.max() <= NEAR:
            return values[chosen]
        chosen.append(int(away.argmax()))


def _from_to(values: Array) -> str:
    """Return the least and the largest value, or the only one."""
    low, high = (number(float(end(values)), 3) for end in (np.min, np.max))
    return low if low == high else f"{low} to {high}"


def turned_by(macro: MacroSetup, name: str | None) -> str:
    """Return the keys that turn the axes of a cell in the body, in words; empty where none does."""
    regions = set(regions_of_cell(macro.regions, name))
    return " and ".join(key for key, ks, _ in by_region(macro, AXES, sorted(regions)) if regions & set(ks))


def _prescribed(config: RunConfig) -> Iterator[str]:
    return (f"note: {note}" for note in prescribed_reach(config, body_mesh(config.macro)))


def thin_fluid(cell: Cell, scales: Scales | None) -> Iterator[str]:
    """Yield a note where a plain number was taken for a multiple of the scale, but most likely meant Pa s."""
    if scales is None:
        return
    viscosity = cell.viscosity * scales.factor("viscosity")
    if viscosity < THIN:
        yield (
            f"note: the fluid has a viscosity of {viscosity:.4g} Pa s, but water has 0.001; cell.viscosity = "
            f"{cell.viscosity:g} is a multiple of scales.viscosity = {scales.viscosity:g} Pa s; write it "
            "with its unit, such as 1 mPa s"
        )


def cell_lines(p: EffectiveProperties, viscosity: float, units: ResultUnits) -> Iterator[str]:
    """Yield moduli, Biot's coefficients and permeability of a cell; without scales in multiples of E, d and μ_c.

    The confined modulus is that of a sample that cannot give way sideways, also called aggregate or oedometer modulus.
    Young's modulus is that of one that can.
    """
    if not p.stiff:
        yield from _flow_lines(p, viscosity, units)
        return
    confined = _along(p.confined_moduli, "stress", units)
    if units.given:
        confined += f" ({_axes(p.confined_moduli, '')} of the reference modulus)"
    yield f"confined modulus {confined}"
    yield f"Young's modulus {_along(p.young_moduli, 'stress', units)}"
    if p.held_stress.any():
        yield f"stress while the swelling is held {_along(np.diag(p.held_stress), 'stress', units)}"
    if p.storage:
        storage = _along(np.full(3, p.storage), "compliance", units)
        yield f"Biot coefficient {_axes(np.diag(p.biot_tensor), '')}; storage 1/M_B {storage}"
    yield from _flow_lines(p, viscosity, units)


def _flow_lines(p: EffectiveProperties, viscosity: float, units: ResultUnits) -> Iterator[str]:
    """Yield the permeability of a cell."""
    permeability = _along(np.diag(p.permeability), "permeability", units)
    K = np.diag(p.conductivity)
    asked = _along(K, "conductivity", units)
    if units.scales is None:
        yield f"permeability {permeability}, conductivity K {asked}"
        return
    by = _axes(K * units.scales.factor("conductivity"), "m⁴/(N s)")
    fluid = f"{viscosity * units.scales.factor('viscosity'):.4g} {QUANTITIES['viscosity'].unit}"
    yield f"permeability {permeability}; of a fluid of {fluid}: {by} = {asked}"


def coefficients_of_consolidation(
    p: EffectiveProperties, axes: tuple[int, ...], units: ResultUnits, *, turned: bool = False
) -> str:
    """Return c_v along some axes as text; one value where they are the same.

    Of a cell that is ``turned`` in the body it is along all axes of the cell.
    """
    axes = (0, 1, 2) if turned else axes
    values = p.consolidation_coefficients[list(axes)] * units.factor("diffusivity")
    same = np.ptp(values) <= SAME * np.abs(values).max()
    texts = ", ".join(number(value, 3) for value in (values[:1] if same else values))
    unit = f" {units.name('diffusivity') if units.given else MULTIPLES['diffusivity']}"
    along = ", ".join("xyz"[axis] for axis in axes)
    of = f"{along} of the cell" if turned else along
    return (
        f"coefficient of consolidation c_v {texts}{unit} along {of}, of a layer compressed and drained there"
    )


def _consolidation(
    macro: MacroSetup,
    coefficients: LinearCoefficients | RestCoefficients,
    units: ResultUnits,
    head: str,
    *,
    relaxes: bool,
) -> Iterator[str]:
    """Yield in which time the body consolidates, and notes on times that do not fit it; ``head`` begins the line.

    A solid that ``relaxes`` has times of its own.
    """
    nodes = len(body_mesh(macro).points)
    if nodes > MOST_NODES:
        yield f"{head}: not computed, since the body has more than {MOST_NODES:,} nodes, {nodes:,}"
        return
    time = drainage_time(macro, coefficients)
    if time is None:
        return
    sideways = "; within a factor of two where it gives way sideways" if held_sideways(macro) is None else ""
    yield (
        f"{head}: after {units.text(time, 'time', 3)}, 95 % of the fluid that a sudden load drives out has "
        f"left this body through {', '.join(drained_surfaces(macro))} (by the confined moduli{sideways})"
    )
    one_cell = coefficients if isinstance(coefficients, LinearCoefficients) else None
    relaxation = None if one_cell is None else relaxation_time(macro, one_cell)
    if relaxation is not None:
        yield (
            f"  relaxation: {units.text(relaxation, 'time', 3)} until the force after a sudden displacement is "
            f"within 5 % of its final value{', if the solid did not relax' if relaxes else ''}"
        )
    elif moved(macro):
        yield "  the body is moved by displacements, not by a load: how fast its force relaxes is another time"
    yield from (f"note: {note}" for note in run_times(macro, time, units, slower=relaxes))


def _along(values: Array, quantity: str, units: ResultUnits) -> str:
    """Return the values of a quantity along x, y and z with its unit, or what they are multiples of."""
    return _axes(
        values * units.factor(quantity), units.name(quantity) if units.given else MULTIPLES[quantity]
    )


def _axes(values: Array, unit: str) -> str:
    """Return the values along x, y and z with their unit, or the only one where they are the same."""
    same = np.ptp(values) <= SAME * np.abs(values).max()
    texts = ", ".join(number(value, 3) for value in (values[:1] if same else values))
    return f"{texts} {unit}".rstrip() + ("" if same else " along x, y, z")


def edges(cell: Cell, length: float | None) -> Iterator[str]:
    """Yield the edges of a cell where its length [m] is known."""
    if length is not None:
        yield f"  edges of the cell: {length_text(*(length * side for side in cell.geometry.sides))}"

"""A study in the terms of its user, from its undeformed cell: moduli, permeability, time of consolidation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from porocore.cell.meshing.mesh import Domain
from porocore.core.files.store import ResultStore
from porocore.core.units.results import ResultUnits, length_text
from porocore.core.units.scales import QUANTITIES
from porocore.errors import PluginError
from porocore.macro.drainage import drainage_time
from porocore.macro.laws.linear import LinearCoefficients
from porocore.macro.problem import body_mesh
from porocore.plugins import registry
from porocore.report.format import number
from porocore.states import Array
from porocore.study.config.config import RunConfig
from porocore.study.preflight.reach_notes import predicted_reach, prescribed_reach
from porocore.study.stages.reference import undeformed
from porocore.study.stages.stage_files import linear_coefficients

#: Tetrahedra of the part of the cell that is solved, and nodes of the body, beyond which a check would take long.
MOST_TETRAHEDRA, MOST_NODES = 20_000, 40_000
#: Values along the axes that differ by less than this share are one.
SAME = 1e-3
#: The end of a run and its steps lie within this factor of the time of consolidation, else there is a note.
FAR = 100.0
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
    yield from thin_fluid(config)
    try:
        registry.get("cell solver", config.fem.backend)
    except PluginError:
        yield from _prescribed(config)
        return
    cell = config.cell
    part: Domain = "eighth" if cell.mirrored else "whole"
    count = len(cell.make_mesh("solid", part).cells) + len(cell.make_mesh("fluid", part).cells)
    if count > MOST_TETRAHEDRA:
        yield f"at rest: not solved here, since the cell has {count:,} tetrahedra; 'porocore cell' solves it"
        yield from _prescribed(config)
        return
    reference = undeformed(cell, config.fem, config.conductivity, store)
    coefficients = linear_coefficients(reference, config)
    yield "at rest, drained:"
    yield from (f"  {line}" for line in cell_lines(coefficients, cell.viscosity, config.result_units))
    if len(body_mesh(config.macro).points) <= MOST_NODES:
        yield from _consolidation(config, coefficients)
    yield from predicted_reach(config, coefficients)


def _prescribed(config: RunConfig) -> Iterator[str]:
    return (f"note: {note}" for note in prescribed_reach(config, body_mesh(config.macro)))


def thin_fluid(config: RunConfig) -> Iterator[str]:
    """Yield a note where a plain number was taken for a multiple of the scale, but most likely meant Pa s."""
    if config.scales is None:
        return
    viscosity = config.cell.viscosity * config.scales.factor("viscosity")
    if viscosity < THIN:
        yield (
            f"note: the fluid has a viscosity of {viscosity:.4g} Pa s, but water has 0.001; cell.viscosity = "
            f"{config.cell.viscosity:g} is a multiple of scales.viscosity = {config.scales.viscosity:g} Pa s; write it "
            "with its unit, such as 1 mPa s"
        )


def cell_lines(c: LinearCoefficients, viscosity: float, units: ResultUnits) -> Iterator[str]:
    """Yield moduli and permeability of a cell; without scales in multiples of E and of d².

    The confined modulus C_iiii is that of a sample that cannot give way sideways, also called aggregate or oedometer
    modulus. Young's modulus is that of one that can.
    """
    confined = np.einsum("iiii->i", c.stiffness)
    pairs = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
    shares = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    voigt = np.array([[c.stiffness[*one, *other] for other in pairs] for one in pairs])
    compliance = np.linalg.inv(voigt * shares)  # of e_11, …, e_23, …
    of_e = "" if units.given else " E"
    share = f" ({_along(confined, '', ResultUnits())} of the reference modulus)" if units.given else ""
    yield f"confined modulus {_along(confined, 'stress', units)}{of_e}{share}"
    yield f"Young's modulus {_along(1 / np.diag(compliance)[:3], 'stress', units)}{of_e}"
    K = np.diag(c.conductivity)
    if units.scales is None:
        yield f"permeability {_along(K * viscosity, '', units)} d², conductivity K {_along(K, '', units)}"
        return
    si = _axes([number(k, 3) for k in K * viscosity * units.scales.factor("permeability")], K)
    by = _axes([number(k, 3) for k in K * units.scales.factor("conductivity")], K)
    fluid = f"{viscosity * units.scales.factor('viscosity'):.4g} {QUANTITIES['viscosity'].unit}"
    asked = _along(K, "conductivity", units)
    yield f"permeability {si} m²; of a fluid of {fluid}: {by} m⁴/(N s) = {asked}"


def _consolidation(config: RunConfig, coefficients: LinearCoefficients) -> Iterator[str]:
    time, plan, units = drainage_time(config.macro, coefficients), config.macro.time, config.result_units
    if time is None:
        return
    yield (
        f"  consolidation: {units.text(time, 'time', 3)} until 95 % of what a sudden load drives out has left the body "
        "(for one that drains along one axis; else a scale)"
    )
    end, step = units.text(plan.end, "time"), units.text(plan.step, "time")
    if plan.end * FAR < time:
        said = f"ends after {end}, long before it consolidates"
    elif plan.end > time * FAR and plan.step > time:
        said = f"ends after {end}, and its steps of {step} are longer than the consolidation"
    else:
        return
    scales = "; a pore size (scales.pore) off by ten changes the time by a hundred" if units.given else ""
    yield f"note: the run {said}; check macro.time and the size of the body{scales}"


def _along(values: Array, quantity: str, units: ResultUnits) -> str:
    texts = _axes([number(v * units.factor(quantity), 3) for v in values], values)
    return f"{texts} {units.name(quantity)}" if units.given and quantity else texts


def _axes(texts: list[str], values: Array) -> str:
    """Return the values along x, y and z, or the only one where they are the same."""
    if np.ptp(values) <= SAME * np.abs(values).max():
        return texts[0]
    return f"{', '.join(texts)} along x, y, z"


def edges(config: RunConfig) -> Iterator[str]:
    """Yield the edges of the cell where it has a length."""
    length = cell_length(config)
    if length is not None:
        yield f"  edges of the cell: {length_text(*(length * side for side in config.cell.geometry.sides))}"


def cell_length(config: RunConfig) -> float | None:
    """Return the length of the cell [m]; None where it is not known."""
    return config.cell.geometry.length if config.scales is None else config.scales.pore

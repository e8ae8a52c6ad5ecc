"""Macro solutions for ParaView: a .vtu file for each profile and a .pvd file that joins them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from porocore.core.files.atomic import atomic_path, write_text
from porocore.core.units import ResultUnits
from porocore.errors import RunFolderError
from porocore.interfaces.cell import ElementCells
from porocore.interfaces.solution import MacroSolution, Profile
from porocore.states import Array, IntArray

#: Elements by their number of nodes.
VTK_CELLS = {4: "tetra", 6: "triangle6", 9: "quad9", 10: "tetra10", 27: "hexahedron27"}
#: Fields of the elements: name in the file, name in a profile, quantity.
FIELDS = {
    "H": ("grad_u", ""),
    "mean_grad": ("mean_grad", ""),
    "deformation": ("deformation", ""),
    "K_t": ("conductivity", "conductivity"),
    "P_E": ("stress", "stress"),
    "flux": ("flux", "velocity"),
    "element_p": ("element_p", "pressure"),
    "flagged": ("flagged", ""),
    "fluid_volume": ("fluid_volume", ""),
}
#: Of a body with fixed charges, of which the pressure of the body is the effective one.
OF_CHARGES = {
    "osmotic_pressure": "pressure",
    "fixed_charge_density": "concentration",
    "swelling_stretch": "",
}


def write_vtu_series(
    folder: Path,
    name: str,
    solution: MacroSolution,
    units: ResultUnits | None = None,
    quantities: Mapping[str, str] | None = None,
) -> Path:
    """Write ``name-000.vtu``, … and ``name.pvd`` into ``folder``, each atomically, the series last.

    Triquadratic hexahedra or quadratic tetrahedra (VTK types 29 and 24), of a body in two dimensions biquadratic
    quadrilaterals or quadratic triangles (28 and 22).
    At the nodes: ``u`` and ``p``. In the elements, as means:
    ``H``, ``mean_grad`` (<∇u¹>_s), ``deformation`` (F̄), ``K_t``, ``P_E`` (tensors of 9 components, row
    by row), ``flux`` (Ḡw), ``element_p``, ``flagged``, the share of the element's points that are flagged, and
    ``fluid_volume`` (φ). Of a body of many cells also the number of the ``region``, each
    parameter of the cell by its name, as it has evolved, and the material axes ``axis_1``, ``axis_2`` and ``axis_3``.
    Of a law with memory also its internal variables by their names, and ``cell_p``, the pressure at which it asks the
    cell, where that is another one. With fixed charges also ``osmotic_pressure`` (π), ``fixed_charge_density`` (c_F)
    and ``swelling_stretch`` (J₀^(1/3)); what is ``p`` without them is then ``effective_p`` (μ).

    Parameters
    ----------
    folder
        Created if it does not exist.
    name
        Start of the file names, without a folder.
    solution
        With at least one profile.
    units
        Of places, times and fields; the name of a field with a unit ends with it, ``u [mm]``. None: dimensionless.
    quantities
        Quantity of each parameter that has a unit.

    Returns
    -------
    Path
        The .pvd file, which ParaView opens as one series.

    Raises
    ------
    RunFolderError
        A file cannot be written.
    ValueError
        ``name`` holds a folder, or the solution has no profile.
    """
    if name in ("", "..") or Path(name).name != name:
        raise ValueError(f"expected a plain file name, got '{name}'")
    if not solution.profiles:
        raise ValueError(f"the {solution.law} solution has no profiles to write")
    units = units or ResultUnits()
    digits = max(3, len(str(len(solution.profiles) - 1)))
    entries = []
    for i, profile in enumerate(solution.profiles):
        file = f"{name}-{i:0{digits}d}.vtu"
        cells = element_fields(solution.element_cells, i, quantities or {})
        _write_profile(folder / file, solution, profile, units, memory_fields(solution, i) | cells)
        time = units.value(profile.time, "time")
        entries.append(f'    <DataSet timestep="{time!r}" part="0" file={quoteattr(file)}/>\n')
    return _write_series(folder / f"{name}.pvd", entries)


def _write_series(path: Path, entries: list[str]) -> Path:
    write_text(
        path,
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n'
        f"  <Collection>\n{''.join(entries)}  </Collection>\n</VTKFile>\n",
    )
    return path


def element_fields(
    cells: ElementCells | None, profile: int, quantities: Mapping[str, str]
) -> dict[str, tuple[Array, str]]:
    """Return regions, parameters and material axes of the elements at a profile, with their quantities."""
    if cells is None:
        return {}
    found: dict[str, tuple[Any, str]] = {"region": (cells.region, "")} if cells.regions else {}
    for name in cells.parameters:
        key = f"parameter {name}" if name in (*FIELDS, *found) else name
        found[key] = cells.field(name, profile), quantities.get(name, "")
    axes = cells.axes_at(profile)
    return found | {f"axis_{k + 1}": (axes[:, :, k], "") for k in range(3) if axes is not None}


def memory_fields(solution: MacroSolution, profile: int) -> dict[str, tuple[Array, str]]:
    """Return what the law remembers in the elements at a profile, but for parameters of the cell, with quantities."""
    at, found = solution.profiles[profile], {}
    if any(not np.array_equal(each.cell_p, each.element_p) for each in solution.profiles):
        found["cell_p"] = at.cell_p, "pressure"
    for name, values in at.internal.items():
        if name not in (*FIELDS, *solution.evolving):
            found[name] = values, solution.quantities[name]
    if solution.has_charges:
        found |= {name: (getattr(at, name), quantity) for name, quantity in OF_CHARGES.items()}
    return found


def _write_profile(
    path: Path,
    solution: MacroSolution,
    profile: Profile,
    units: ResultUnits,
    cells: Mapping[str, tuple[Array, str]],
) -> None:
    def named(fields: Mapping[str, tuple[Array, str]]) -> dict[str, Array]:
        return {
            units.titled(name, quantity): values * units.factor(quantity) if quantity else values
            for name, (values, quantity) in fields.items()
        }

    effective = "effective_" if solution.has_charges else ""
    in_elements = {
        name.replace("element_", f"element_{effective}"): (getattr(profile, field), quantity)
        for name, (field, quantity) in FIELDS.items()
    }
    at_nodes = {"u": (profile.u, "displacement"), f"{effective}p": (profile.p, "pressure")}
    if profile.contact_pressure.any():
        at_nodes["contact_pressure"] = (profile.contact_pressure, "pressure")
    points = solution.points * units.factor("displacement")
    write_vtu(path, points, solution.cells, named(at_nodes), named(in_elements | dict(cells)))


def write_vtu(
    path: Path, points: Array, cells: IntArray, at_nodes: Mapping[str, Any], in_elements: Mapping[str, Any]
) -> Path:
    """Write one mesh with its fields as a .vtu file, atomically; returns its path.

    Tensors (n, 3, 3) become 9 components, row by row.

    Raises
    ------
    RunFolderError
        The file cannot be written.
    """
    import meshio  # heavy, and needed here only

    def rows(field: Any) -> Any:
        return field.reshape(len(field), 9) if field.ndim == 3 else field

    mesh = meshio.Mesh(
        points,
        [(VTK_CELLS[cells.shape[1]], cells)],
        point_data={name: rows(field) for name, field in at_nodes.items()},
        cell_data={name: [rows(field)] for name, field in in_elements.items()},
    )
    with atomic_path(path) as part:
        try:
            meshio.write(part, mesh, file_format="vtu")
        except meshio.WriteError as error:
            raise RunFolderError(f"cannot write {path}: {error}") from error
    return path

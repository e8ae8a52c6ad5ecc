"""Macro solutions for ParaView: a .vtu file for each profile and a .pvd file that joins them."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

from porocore.core.files.atomic import atomic_path
from porocore.errors import RunFolderError
from porocore.interfaces.solution import MacroSolution, Profile
from porocore.states import Array


def write_vtu_series(folder: Path, name: str, solution: MacroSolution) -> Path:
    """Write ``name-000.vtu``, … and ``name.pvd`` into ``folder``, each atomically, the series last.

    Triquadratic hexahedra or quadratic tetrahedra (VTK types 29 and 24).
    At the nodes: ``u`` [–] and ``p`` [E]. In the elements, as means:
    ``H``, ``mean_grad`` (<∇u¹>_s), ``deformation`` (F̄), ``K_t``, ``P_E`` [E] (tensors of 9 components, row
    by row), ``flux`` (Ḡw), ``element_p`` [E] and ``outside``, the share of the element's points at which the
    cell law was asked beyond its sampled range.

    Parameters
    ----------
    folder
        Created if it does not exist.
    name
        Start of the file names, without a folder.
    solution
        With at least one profile.

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
    digits = max(3, len(str(len(solution.profiles) - 1)))
    entries = []
    for i, profile in enumerate(solution.profiles):
        file = f"{name}-{i:0{digits}d}.vtu"
        _write_vtu(folder / file, solution, profile)
        entries.append(f'    <DataSet timestep="{profile.time!r}" part="0" file={quoteattr(file)}/>\n')
    series = folder / f"{name}.pvd"
    with atomic_path(series) as part:
        part.write_text(
            '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n'
            f"  <Collection>\n{''.join(entries)}  </Collection>\n</VTKFile>\n",
            encoding="utf-8",
        )
    return series


def _write_vtu(path: Path, solution: MacroSolution, profile: Profile) -> None:
    import meshio  # heavy, and needed here only

    def rows(tensor: Array) -> list[Array]:
        return [tensor.reshape(len(tensor), -1)]

    mesh = meshio.Mesh(
        solution.points,
        [("hexahedron27" if solution.cells.shape[1] == 27 else "tetra10", solution.cells)],
        point_data={"u": profile.u, "p": profile.p},
        cell_data={
            "H": rows(profile.grad_u),
            "mean_grad": rows(profile.mean_grad),
            "deformation": rows(profile.deformation),
            "K_t": rows(profile.conductivity),
            "P_E": rows(profile.stress),
            "flux": [profile.flux],
            "element_p": [profile.element_p],
            "outside": [profile.outside_training_range],
        },
    )
    with atomic_path(path) as part:
        try:
            meshio.write(part, mesh, file_format="vtu")
        except meshio.WriteError as error:
            raise RunFolderError(f"cannot write {path}: {error}") from error

"""Law that random images and minimal surfaces stay open under a small strain."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
import pytest

from porocore.cell.geometry.kinds import Geometry, TriplyPeriodic, Voxels
from porocore.interfaces.cell import CellSolver
from porocore.states import Status
from porocore.testing.cell_laws.suite import CellSuite
from porocore.testing.expect import holds, state_text

#: Images by the seed of their noise, minimal surfaces by their name.
OPEN_CELLS = (0, 3, "gyroid", "diamond")


def noise(seed: int, voxels: int, smoothing: float) -> npt.NDArray[np.uint8]:
    """Return an image of smoothed periodic noise: 1 in the pores, which are half of it, and 0 in the solid."""
    from scipy.ndimage import gaussian_filter  # slow to import

    values = np.random.default_rng(seed).normal(size=(voxels,) * 3)
    smooth = gaussian_filter(values, smoothing, mode="wrap")
    return np.asarray(smooth < np.median(smooth), dtype=np.uint8)


def image_cell(
    path: Path, seed: int, voxels: int, repeat: Literal["periodic", "mirror"] = "periodic"
) -> Voxels:
    """Write an image of noise that is smoothed over an eighth of its edge, and return it as a cell or as its eighth."""
    np.save(path, noise(seed, voxels, voxels / 8))
    return Voxels(kind="voxels", path=str(path), pore=1, repeat=repeat)


class OpenCells(CellSuite):
    """Part of :class:`porocore.testing.cell_laws.meshed.MeshedCellSuite`."""

    @pytest.mark.parametrize("which", OPEN_CELLS)
    def test_a_strain_of_one_percent_is_no_overlap(
        self, solver: CellSolver, which: int | str, tmp_path: Path
    ) -> None:
        """Whatever the mesh at the wall and at the faces of the cell looks like."""
        geometry: Geometry
        if isinstance(which, int):
            geometry = image_cell(tmp_path / "image.npy", which, 16)
        else:
            geometry = TriplyPeriodic.model_validate({"kind": "tpms", "surface": which, "level": 0})
        prepared = solver.prepare(self.make_cell(geometry=geometry))
        H = -0.01 * np.diag([1.0, 0.0, 0.0])
        status = Status(int(solver.solve_one(prepared, H, tangent=False).status[0]))
        state = f"{geometry.description}, {state_text(H)}"
        holds(status.has_values, state, "the status converged or contact", status.name)

"""Solution of one sub-volume at rest: permeability, drained elasticity, Biot's coefficients."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.materials.moduli import voigt_moduli
from porocore.core.echo import cut
from porocore.core.files.plain_data import json_ready
from porocore.core.files.store import ResultStore
from porocore.errors import PluginError, PorocoreError
from porocore.macro.laws.linear import LinearCoefficients
from porocore.plugins.border import conductivity_of
from porocore.states import Array
from porocore.study.config.sections import FemSettings
from porocore.study.stages.reference import undeformed
from porocore.study.stages.stage_files import prepare_cell
from porocore.verification.representative.scan import Corner

#: Statuses: all results; permeability alone, of a solid that is not connected; none, for the reason in the message;
#: none, since its process ended.
SOLVED, LOOSE, FAILED, LOST = "solved", "no stiffness", "failed", "lost"
#: Characters of a message that are kept.
LONGEST = 300
#: Results by name, with their shapes.
SHAPES: dict[str, tuple[int, ...]] = {
    "porosity": (),
    "permeability": (3, 3),
    "stiffness": (3, 3, 3, 3),
    "biot": (3, 3),
    "storage": (),
    "M": (3, 3, 3, 3),
    "Q": (3, 3),
}


@dataclass(frozen=True, eq=False)
class Subvolume:
    """Results of one sub-volume; NaN where there are none.

    Attributes
    ----------
    size, corner
        Edge, and first voxel along x, y, z.
    cell
        Identity of its cell.
    status, message
        One of ``solved``, ``no stiffness``, ``failed`` and ``lost``, and why it is not solved.
    seconds
        Time that it took, whenever that was.
    porosity : ()
        φ_f of the mesh of the solid.
    permeability : (3, 3)
        K μ_f [voxel²].
    stiffness : (3, 3, 3, 3)
        Drained, C_eff [E].
    biot : (3, 3)
        α.
    storage : ()
        1/M_B [1/E].
    M : (3, 3, 3, 3)
        ∂<∇u¹>_s/∂H at rest.
    Q : (3, 3)
        ∂<∇u¹>_s/∂p at rest [1/E].
    """

    size: int
    corner: Corner
    cell: str
    status: str
    message: str
    seconds: float
    porosity: Array
    permeability: Array
    stiffness: Array
    biot: Array
    storage: Array
    M: Array
    Q: Array

    def scalars(self) -> dict[str, float]:
        """Return the results as averages over all directions; see ``settling.QUANTITIES``."""
        k = (
            np.linalg.eigvalsh(self.permeability)
            if np.isfinite(self.permeability).all()
            else np.full(3, np.nan)
        )
        mean = float(k.mean())
        return {
            "porosity": float(self.porosity),
            "permeability": mean,
            "anisotropy": float(np.ptp(k)) / mean if mean > 0 else float("nan"),
            "modulus": voigt_moduli(self.stiffness)[0],
            "biot": float(np.trace(self.biot)) / 3,
            "storage": float(self.storage),
        }

    def as_data(self) -> dict[str, Any]:
        """Return plain data."""
        found: dict[str, Any] = json_ready({each.name: getattr(self, each.name) for each in fields(self)})
        return found

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Subvolume:
        """Return what :meth:`as_data` was made of.

        Raises
        ------
        KeyError, TypeError, ValueError
            It was not.
        """
        arrays = {
            # None within becomes NaN.
            name: np.array(np.nan if data[name] is None else data[name], dtype=float).reshape(shape)
            for name, shape in SHAPES.items()
        }
        a, b, c = map(int, data["corner"])
        cell, status, message = (str(data[name]) for name in ("cell", "status", "message"))
        return cls(int(data["size"]), (a, b, c), cell, status, message, float(data["seconds"]), **arrays)


@dataclass(frozen=True, eq=False)
class SubvolumeJob:
    """A sub-volume that is to be solved.

    Attributes
    ----------
    cell, identity
        Its cell, and the identity of that.
    size, corner
        Edge, and first voxel along x, y, z.
    edge
        Edge of the cell [voxels].
    seconds
        Expected time.
    side_by_side
        Number of these that the memory allows at a time.
    """

    cell: Cell
    identity: str
    size: int
    corner: Corner
    edge: int
    seconds: float
    side_by_side: int

    def unsolved(self, status: str, message: str, seconds: float = 0.0, **known: Array) -> Subvolume:
        """Return what is recorded of a sub-volume of which at most some results are known."""
        message = cut(" ".join(message.split()), LONGEST)
        nothing = {name: np.full(shape, np.nan) for name, shape in SHAPES.items()}
        return Subvolume(
            self.size, self.corner, self.identity, status, message, seconds, **{**nothing, **known}
        )


def solve_subvolume(
    job: SubvolumeJob, fem: FemSettings, store: ResultStore | None, took: float | None = None
) -> Subvolume:
    """Solve one sub-volume at rest; what cannot be solved is recorded.

    Parameters
    ----------
    job
        The sub-volume.
    fem, store
        Backend, and results that studies share.
    took
        Seconds that a cell had taken that the store holds.

    Raises
    ------
    PluginError
        The backend is missing or returns what it may not.
    """
    cell, began = job.cell, time.perf_counter()
    try:
        reference = undeformed(cell, fem, "piola", store)
        found = LinearCoefficients.from_reference(
            reference.response, reference.solid_fraction, cell.solid, reference.conductivity
        )
    except PluginError:
        raise
    except PorocoreError as error:
        status, message, known = _what_is_left(error, job, fem)
        return job.unsolved(status, message, time.perf_counter() - began, **known)
    seconds = time.perf_counter() - began if took is None else took
    return Subvolume(
        job.size, job.corner, job.identity, SOLVED, "", seconds,
        np.array(reference.porosity), _permeability(found.conductivity, job), found.stiffness, found.biot,
        np.array(found.storage), found.mean_grad_grad_u, found.mean_grad_p,
    )  # fmt: skip


def _what_is_left(
    error: PorocoreError, job: SubvolumeJob, fem: FemSettings
) -> tuple[str, str, dict[str, Array]]:
    """Return the permeability of a solid that is not connected, else nothing but the reason."""
    try:
        if disconnected := job.cell.disconnected:
            K = conductivity_of(*prepare_cell(fem.backend, fem.options, job.cell))
            return LOOSE, disconnected, {"permeability": _permeability(K, job)}
    except PluginError:
        raise
    except PorocoreError as another:
        return FAILED, str(another), {}
    return FAILED, str(error), {}


def _permeability(conductivity: Array, job: SubvolumeJob) -> Array:
    """Return K μ_f in voxels²; K is in units of the edge of the cell, squared."""
    return np.asarray((conductivity + conductivity.T) / 2 * job.cell.viscosity * job.edge**2)

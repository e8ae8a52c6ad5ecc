"""Choice of a linear solver by size and memory; parts of its preconditioner; record of its work."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt
import psutil
from scipy import sparse

from porocore.core.echo import echo
from porocore.errors import ConfigurationError
from porocore.interfaces.law import MacroTangent
from porocore.interfaces.solution import MacroSolution, StepWork
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.boundary.conditions import BoundaryData
from porocore.states import Array

#: Option ``macro.options.solver``; ``auto`` goes by the number of unknowns.
Solver = Literal["auto", "direct", "iterative"]
KEY = "macro.options.solver"


def checked_solver(solver: object) -> Solver:
    """Return the option.

    Raises
    ------
    ConfigurationError
        It is none of the three.
    """
    for known in get_args(Solver):
        if solver == known:
            return known  # type: ignore[no-any-return]
    raise ConfigurationError(f"{KEY}: expected auto, direct or iterative, got {echo(solver)}")


def choose_solver(solver: Solver, unknowns: int, threshold: int, why: str = "") -> tuple[bool, str]:
    """Return whether to iterate, and the line that says so.

    Parameters
    ----------
    threshold
        Number of unknowns above which an iteration is the faster one.
    why
        Reason for this threshold beside the size, such as that a library is missing.
    """
    iterates = unknowns > threshold if solver == "auto" else solver == "iterative"
    name = "a preconditioned iteration" if iterates else "a direct factor"
    reason = f"{KEY} = {solver}"
    if solver == "auto":
        reason = f"{'more than' if iterates else 'up to'} {threshold:,}{f', {why}' if why else ''}"
    return iterates, f"{unknowns:,} unknowns are solved for by {name} ({reason})"


@dataclass(frozen=True, eq=False)
class LinearLevel:
    """Linear displacements of a body under its supports, three unknowns at each corner of the elements.

    Attributes
    ----------
    prolongation : (displacements, 3 · corners)
        Sparse, from these unknowns to those of the mesh; nodes with a frame of their own have it on both levels. A row
        is zero where a displacement is prescribed.
    active : (3 · corners,) bool
        False for those that take no part: columns of zeros.
    modes : (3 · corners, 6)
        Rigid motions, zero where inactive.
    """

    prolongation: sparse.csr_matrix
    active: npt.NDArray[np.bool_]
    modes: Array


def linear_level(mesh: BodyMesh, boundary: BoundaryData) -> LinearLevel:
    """Return the linear displacements of a body; those of a plate are one unknown, the first of its corners."""
    corners = (3 * mesh.p_nodes[:, None] + np.arange(3)).ravel()
    level = linear_prolongation(mesh)
    modes = rigid_modes(mesh.points[mesh.p_nodes])
    if boundary.rotation is not None:
        turn = boundary.rotation[: mesh.n_u, : mesh.n_u].tocsr()
        at_corners = turn[corners][:, corners]
        level, modes = turn @ level @ at_corners.T, at_corners @ modes
    is_free = np.ones(mesh.n_u, bool)
    is_free[boundary.prescribed[boundary.prescribed < mesh.n_u]] = False
    leader, active = np.arange(len(corners)), is_free[corners]
    for plate in boundary.plates:
        of_plate = np.flatnonzero(np.isin(corners, plate))
        leader[of_plate], active[of_plate[1:]] = of_plate[0], False
        modes[of_plate[0]] = modes[of_plate].mean(axis=0)
    kept = is_free[corners].astype(float)
    collapse = sparse.csr_matrix((kept, (np.arange(len(corners)), leader)), shape=(len(corners),) * 2)
    level = (sparse.diags(is_free.astype(float)) @ level @ collapse).tocsr()
    level.data[np.abs(level.data) < 1e-14] = 0.0
    level.eliminate_zeros()
    level.sort_indices()
    modes[~active] = 0.0
    return LinearLevel(level, active, modes)


def linear_prolongation(mesh: BodyMesh) -> sparse.csr_matrix:
    """Return the values (displacements, 3 · corners) at all nodes of the linear shape functions, Cartesian."""
    element, per_cell = mesh.element, mesh.cells.shape[1]
    _, first = np.unique(mesh.cells.ravel(), return_index=True)
    values = element.corner_values(element.nodes)[first % per_cell]
    columns = mesh.p_cells[first // per_cell]
    starts = np.arange(len(first) + 1) * element.corners
    shape = (len(mesh.points), len(mesh.p_nodes))
    scalar = sparse.csr_matrix((values.ravel(), columns.ravel(), starts), shape=shape)
    scalar.eliminate_zeros()
    return sparse.kron(scalar, sparse.identity(3), format="csr")


def rigid_modes(points: Array) -> Array:
    """Return the three translations and three rotations (3 n, 6) of ``points`` (n, 3), in units of their size."""
    x = points - points.mean(axis=0)
    x = x / max(float(np.abs(x).max()), np.finfo(float).tiny)
    modes = np.zeros((len(points), 3, 6))
    modes[:, :, :3] = np.eye(3)
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        modes[:, j, 3 + k], modes[:, i, 3 + k] = x[:, i], -x[:, j]
    return modes.reshape(-1, 6)


def work_figures(solution: MacroSolution) -> dict[str, Any]:
    """Return what a solve took, ready for JSON; times in seconds.

    ``most_iterations`` are those of one system, ``step_seconds`` the mean over the steps.
    """
    work = solution.work
    total = {name: float(work[name].sum()) for name in work}
    steps = max(len(solution.history.time) - 1, 1)
    return {
        "law": solution.law,
        "load": solution.load,
        "solver": solution.linear_solver,
        "systems": int(total["systems"]),
        "iterations": int(total["iterations"]),
        "most_iterations": int(work["most_iterations"].max()),
        "set_ups": int(total["set_ups"]),
        "set_up_seconds": total["set_up_seconds"],
        "solve_seconds": total["solve_seconds"],
        "step_seconds": total["seconds"] / steps,
    }


def work_in_words(work: Mapping[str, Array]) -> str:
    """Return what a solve took; empty where factors did it."""
    if not work or not work["iterations"].any():
        return ""
    steps = max(len(work["seconds"]) - 1, 1)
    return (
        f"{work['systems'].sum():.0f} linear systems in {work['iterations'].sum():.0f} iterations, at most "
        f"{work['most_iterations'].max():.0f} each; {work['set_ups'].sum():.0f} set-ups in "
        f"{work['set_up_seconds'].sum():.1f} s, iterations in {work['solve_seconds'].sum():.1f} s; "
        f"{work['seconds'].sum() / steps:.1f} s a step"
    )


def step_in_words(work: StepWork | None) -> str:
    """Return what a step took, to follow other words; empty where factors did it."""
    if work is None or not work.iterations:
        return ""
    set_up = f", set-up {work.set_up_seconds:.1f} s" if work.set_ups else ""
    return f", {work.iterations:.0f} iterations for {work.systems:.0f} systems{set_up}, {work.seconds:.1f} s a step"


#: Files of Linux that tell the limits of the present control group, in both versions.
_GROUPS = (
    (Path("/sys/fs/cgroup"), "memory.max", "memory.current"),
    (Path("/sys/fs/cgroup/memory"), "memory.limit_in_bytes", "memory.usage_in_bytes"),
)
#: Share of what is left that a factor may take.
SHARE = 0.8
GIB = 2**30


def available_bytes() -> float:
    """Return the memory that this machine has left for its processes."""
    found = [float(psutil.virtual_memory().available)]
    for folder, limit, used in _GROUPS:
        most, now = _text(folder / limit).strip(), _text(folder / used).strip()
        if most.isdigit() and now.isdigit():
            found.append(float(most) - float(now) + _cached(folder))
    return max(min(found), 0.0)


def factor_bytes(unknowns: int, at: int, gib: float, exponent: float) -> float:
    """Return the memory of a factor by a power law, which was measured as ``gib`` at the size ``at``."""
    return float(gib * GIB * (unknowns / at) ** exponent)


def fits(needed: float, available: float) -> bool:
    """Return whether a factor fits."""
    return needed <= SHARE * available


def spoken_bytes(size: float) -> str:
    """Return a size in GiB, for messages."""
    return f"{size / GIB:.1f} GiB" if size < 10 * GIB else f"{size / GIB:.0f} GiB"


def _cached(folder: Path) -> float:
    """Return the bytes of files that count as used and are given up when memory is short."""
    for line in _text(folder / "memory.stat").splitlines():
        name, _, size = line.partition(" ")
        if name == "inactive_file" and size.strip().isdigit():
            return float(size)
    return 0.0


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii")
    except OSError:
        return ""


#: A preconditioner is made anew when a digit costs so many times the iterations that it did at first. On marches of
#: 24 systems one or two are then made instead of 24.
AGED = 1.5
#: Digits that fewer iterations than these say nothing of.
FEWEST_DIGITS = 1.0
#: Relative residual of a linear system: at most this,
LOOSEST = 1e-4
#: else this times the square of the last reduction of Newton's misfit (Eisenstat & Walker 1996, choice 2),
SAFETY = 0.9
#: but never less than this share of what Newton's tolerance needs, nor than this.
ENOUGH, TIGHTEST = 0.1, 1e-10


@dataclass
class ReusePolicy:
    """Age of a preconditioner, told by iterations for each digit."""

    _fresh: float | None = None
    _aged: bool = True

    @property
    def due(self) -> bool:
        """True if the next system wants a new preconditioner."""
        return self._aged

    def renewed(self) -> None:
        """Take note that the preconditioner is new."""
        self._fresh, self._aged = None, False

    def expire(self) -> None:
        """Have the next system make a new one."""
        self._aged = True

    def add(self, iterations: int, reduction: float) -> None:
        """Take note of a solve that reduced the residual to ``reduction`` times that of the right-hand side."""
        digits = -math.log10(reduction) if 0 < reduction < 1 else 0.0
        if digits < FEWEST_DIGITS:
            return
        pace = iterations / digits
        if self._fresh is None:
            self._fresh = pace
        self._aged = self._aged or pace > AGED * self._fresh


def sufficient(misfit: float, tolerance: float) -> float:
    """Return the relative residual with which one system ends the iteration if the tangent does not change."""
    return max(ENOUGH * tolerance / misfit, TIGHTEST) if 0 < misfit < math.inf else TIGHTEST


def forcing(misfit: float, before: float | None, tolerance: float) -> float:
    """Return the relative residual to which Newton's linear system is to be solved.

    Parameters
    ----------
    misfit, before
        Of the present iterate, and of the one before; None for the first.
    tolerance
        Misfit that ends the iteration.
    """
    if not 0 < misfit < math.inf:
        return TIGHTEST
    quadratic = LOOSEST if before is None or not before > 0 else SAFETY * (misfit / before) ** 2
    return min(LOOSEST, max(quadratic, sufficient(misfit, tolerance)))


_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
#: (6, 9) orthonormal symmetric tensors, so that products of them are those of their components.
_SYMMETRIC = np.array(
    [
        (
            (np.eye(3)[i][:, None] * np.eye(3)[j] + np.eye(3)[j][:, None] * np.eye(3)[i])
            / (2 if i == j else 2**0.5)
        )
        for i, j in _PAIRS
    ]
).reshape(6, 9)
#: Elements that are treated at once, and the share of the stiffness that is added so that none is singular.
CHUNK, SHIFT = 4_000, 1e-10


def pressure_mass(tangent: MacroTangent, points: int) -> Array:
    """Return L (n,) at n points, for the Schur complement D − C A⁻¹ B ≈ D + ∫ L N N.

    L = a : ℂ⁻¹ : (−b) with a = ∂Δstorage/∂H, b = ∂P_E/∂p and ℂ = ∂P_E/∂H, all symmetrised: the storage that a change of
    the pressure brings about where the solid can follow it freely. Never negative. It is that of the mean tangent of an
    element, which no iteration of a preconditioner distinguishes from that of its points.

    Parameters
    ----------
    tangent
        At n points, those of an element one after another.
    points
        Points of an element.
    """
    elements = len(tangent.storage_p) // points
    mass = np.empty(elements)
    for first in range(0, elements, CHUNK):
        last = min(first + CHUNK, elements)
        stiffness, a, b = (
            x[first * points : last * points].reshape(last - first, points, -1).mean(axis=1)
            for x in (tangent.stress_grad_u, tangent.storage_grad_u, tangent.stress_p)
        )
        C = _SYMMETRIC @ stiffness.reshape(-1, 9, 9) @ _SYMMETRIC.T
        largest = np.abs(C).max(axis=(1, 2), keepdims=True)
        pressed = -(b @ _SYMMETRIC.T)[:, :, None]
        strain = np.linalg.solve(C + SHIFT * largest * np.eye(6), pressed)[:, :, 0]
        mass[first:last] = ((a @ _SYMMETRIC.T) * strain).sum(axis=1)
    return np.repeat(np.maximum(mass, 0.0), points)


@dataclass
class LinearWork:
    """Work of the linear solver of one discretisation since it was last taken, and lines for the log.

    Attributes
    ----------
    choice
        Chosen solver, and why, in one line.
    """

    choice: str = ""
    _work: StepWork = field(default_factory=StepWork)
    _notes: list[str] = field(default_factory=list)
    _taken: float = field(default_factory=perf_counter)

    def begin(self) -> None:
        """Forget what was not taken, such as the trials of a solve that failed, and start the clock."""
        self.take()

    def add_set_up(self, seconds: float, *, whole: bool = True) -> None:
        """Count one factor or preconditioner; a part of one takes time alone."""
        work = self._work
        self._work = replace(work, set_ups=work.set_ups + whole, set_up_seconds=work.set_up_seconds + seconds)

    def add_solve(self, iterations: int, seconds: float) -> None:
        """Count one system, solved in so many iterations; a factor needs none."""
        work = self._work
        self._work = replace(
            work,
            systems=work.systems + 1,
            iterations=work.iterations + iterations,
            most_iterations=max(work.most_iterations, float(iterations)),
            solve_seconds=work.solve_seconds + seconds,
        )

    def note(self, line: str) -> None:
        """Add a line for the log, such as that a factor takes over."""
        if line not in self._notes:
            self._notes.append(line)

    def take(self) -> tuple[StepWork, tuple[str, ...]]:
        """Return the work and the lines since this was last called, and begin anew."""
        now = perf_counter()
        work, notes = replace(self._work, seconds=now - self._taken), tuple(self._notes)
        self._work, self._notes, self._taken = StepWork(), [], now
        return work, notes

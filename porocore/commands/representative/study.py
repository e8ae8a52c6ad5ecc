"""The study of sub-volumes as a whole: one of them solved, all in parallel processes as the memory allows."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from porocore.cell.cell import Cell
from porocore.commands.representative.plan import Corner, Scan, SizeOutlook, SubvolumePlan, foresee
from porocore.commands.representative.results import (
    FAILED,
    FILE,
    LOOSE,
    LOST,
    SOLVED,
    RepresentativeVolume,
    Subvolume,
    holds_results,
    identity_of,
    judge,
    load,
    save,
    summary,
    write_tables,
)
from porocore.core.console import Console
from porocore.core.echo import cut
from porocore.core.files.store import ResultStore
from porocore.core.parallel.calls import Tell
from porocore.core.units import using_units
from porocore.errors import PluginError, PorocoreError
from porocore.macro.laws.linear import LinearCoefficients
from porocore.plugins.border import conductivity_of
from porocore.states import Array
from porocore.study.config.config import FemSettings, RunConfig, cell_identity
from porocore.study.notes.checks import find_backends
from porocore.study.run.composition import prepare_cell
from porocore.study.run.reference import undeformed
from porocore.study.series import Case, RunSeries, claim_record
from porocore.study.store import cell_key, chosen_store

#: Characters of a message that are kept.
LONGEST = 300


def solve_subvolume(
    tell: Tell, empty: Subvolume, cell: Cell, edge: int, fem: FemSettings, store: ResultStore | None
) -> Subvolume:
    """Solve one sub-volume at rest; what cannot be solved is recorded.

    Parameters
    ----------
    tell
        Not called: a sub-volume is one solve.
    empty
        The sub-volume without results.
    cell, edge
        Its cell, and the edge of that [voxels].
    fem, store
        Backend, and results that studies share.

    Raises
    ------
    PluginError
        The backend is missing or returns what it may not.
    """
    began = time.perf_counter()

    def permeability(K: Array) -> Array:
        # K is in units of the edge of the cell, squared.
        return np.asarray((K + K.T) / 2 * cell.viscosity * edge**2)

    try:
        reference = undeformed(cell, fem, "piola", store)
        found = LinearCoefficients.from_reference(
            reference.response, reference.solid_fraction, cell.solid, reference.conductivity
        )
    except PluginError:
        raise
    except PorocoreError as error:
        status, reason, known = FAILED, str(error), empty.permeability
        try:
            # A solid that is not connected has a permeability all the same.
            if disconnected := cell.disconnected:
                K = conductivity_of(*prepare_cell(fem.backend, fem.options, cell))
                status, reason, known = LOOSE, disconnected, permeability(K)
        except PluginError:
            raise
        except PorocoreError as another:
            reason = str(another)
        return replace(unsolved(empty, status, reason, time.perf_counter() - began), permeability=known)
    return replace(
        empty,
        status=SOLVED,
        seconds=time.perf_counter() - began,
        porosity=np.array(reference.porosity),
        permeability=permeability(found.conductivity),
        stiffness=found.stiffness,
        biot=found.biot,
        storage=np.array(found.storage),
        M=found.mean_grad_grad_u,
        Q=found.mean_grad_p,
    )


def unsolved(empty: Subvolume, status: str, message: str, seconds: float = 0.0) -> Subvolume:
    """Return a sub-volume with the reason why it has no results."""
    return replace(empty, status=status, message=cut(" ".join(message.split()), LONGEST), seconds=seconds)


class SubvolumeSeries(RunSeries[Subvolume]):
    """Sub-volumes of an image, in a record by the identities of their cells.

    Parameters
    ----------
    config, scan
        The study, and its image.
    record
        ``rev.json``.
    store
        Results that studies share.
    resume
        Take what the record holds.
    """

    title, unit = "rev", "cells"
    function = solve_subvolume

    def __init__(
        self, config: RunConfig, scan: Scan, record: Path, store: ResultStore | None, *, resume: bool
    ) -> None:
        self._fem, self._scan, self._record, self._store = config.fem, scan, record, store
        self.identity = identity_of(config, scan)
        # Further ones that the record holds stay in it.
        super().__init__(load(record, self.identity) if resume and record.exists() else {})

    def cases(self, outlooks: Iterable[SizeOutlook]) -> list[Case]:
        """Return the sub-volumes that are solved, in the order of their memory."""
        return [self._case(outlook, corner) for outlook in outlooks for corner in outlook.corners]

    def _case(self, outlook: SizeOutlook, corner: Corner) -> Case:
        size = outlook.size
        cell = self._scan.subvolume(corner, size)
        key = cell_identity(cell, self._fem)
        empty = Subvolume.unsolved(size, corner, key)
        return Case(
            key,
            (empty, cell, self._scan.edge(size), self._fem, self._store),
            f"{list(corner)} of {size} voxels",
            work=outlook.seconds,
            side_by_side=outlook.side_by_side,
        )

    def save(self, case: Case, result: Subvolume) -> None:
        """Write the record."""
        save(self._record, self.identity, self.known.values())

    def stored(self, case: Case) -> tuple[Subvolume, float] | None:
        """Return a sub-volume whose cell the store holds."""
        if self._store is None:
            return None
        kept = self._store.find(
            "cells", cell_key(self._fem.backend, self._fem.options, case.arguments[1], "piola")
        )
        if kept is None:
            return None
        took = float(kept.facts["seconds"])
        return replace(solve_subvolume(lambda told: None, *case.arguments), seconds=took), took

    def lost(self, case: Case, error: Exception) -> Subvolume:
        """Return a sub-volume without results; only a plugin that cannot be used ends the others."""
        if isinstance(error, PluginError):
            raise error
        kind = "" if isinstance(error, PorocoreError) else f"{type(error).__name__}: "
        return unsolved(case.arguments[0], LOST, f"{kind}{error}")

    def failed(self, result: Subvolume) -> bool:
        """Return whether results are missing."""
        return result.status != SOLVED

    def describe(self, case: Case, result: Subvolume) -> str:
        """Return size and status."""
        return f"{result.size} voxels {result.status}"


def study_representative_volume(
    config: RunConfig,
    folder: Path | str,
    plan: SubvolumePlan | None = None,
    *,
    workers: int | None = None,
    resume: bool = False,
    store: ResultStore | str | Path | bool = True,
    progress: bool = False,
) -> RepresentativeVolume:
    """Solve sub-volumes of growing size of an image, and judge from which size their results stay.

    Parameters
    ----------
    config
        The study; only its cell, finite elements, scales and workers count. The geometry is an image.
    folder
        Place of ``rev.json``, the tables and the picture.
    plan
        Sizes, numbers and places of the sub-volumes.
    workers
        Processes; by default as configured for sampling.
    resume
        Take the sub-volumes that the folder holds; the plan may be another one.
    store
        Folder of results that studies share; True: that of the user, False: none. A cell that it holds is not solved.
    progress
        Show the outlook of each size and the progress on standard error.

    Raises
    ------
    ConfigurationError
        The cell is no image, or its sub-volumes are too large for it or too small for a cell.
    RunFolderError, DataError
        The folder cannot be written, holds a study and ``resume`` is not given, or one of another image or backend.
    PluginError, PorocoreError
        The backend is missing, or all sub-volumes failed.
    """
    from porocore.commands.representative.figure import write_figure

    folder, plan = Path(folder), SubvolumePlan() if plan is None else plan
    if plan.solve:
        find_backends(config, ["cell solver"])
    scan = Scan.open(config, plan)
    sizes = scan.sizes(plan)
    record, console = folder / FILE, Console.shown(progress)
    # A record of the porosity alone may be replaced.
    claim_record(record, "study", resume=resume or not holds_results(record))
    series = SubvolumeSeries(config, scan, record, chosen_store(store), resume=resume)
    workers = config.sampling.worker_count() if workers is None else workers
    for line in scan.lines():
        console.note(line)
    outlooks = []
    for size in sizes:
        outlooks.append(foresee(scan, plan, size, workers))
        console.note(outlooks[-1].line(workers))
    solved = series.run(series.cases(outlooks), console, workers)
    settling = judge(solved, plan.tolerance)
    found = RepresentativeVolume(plan, scan, tuple(outlooks), tuple(solved), settling, record)
    save(record, series.identity, series.known.values(), **summary(found))
    with using_units(config.result_units):
        write_tables(found)
        write_figure(found)
    if solved and not any(each.status in (SOLVED, LOOSE) for each in solved):
        raise PorocoreError(
            f"none of {len(solved)} sub-volumes could be solved, the first one because: {solved[0].message}"
        )
    return found

"""Records of what the report page shows: cell, sampling, surrogate, costs, stages, published values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from porocore.core.inputs.input_space import InputSpace
from porocore.core.units.results import ResultUnits
from porocore.core.units.scales import Scales
from porocore.macro.laws.closure_error import ClosureError
from porocore.macro.laws.effective import EffectiveProperties
from porocore.macro.laws.linear import LinearCoefficients
from porocore.macro.laws.pull_back import ConductivityLaw
from porocore.report.loading_mode import LoadingMode
from porocore.report.metrics import LoadCase
from porocore.report.words.body_cells import BodyCells
from porocore.report.words.held_out import OutputCheck
from porocore.report.words.parameters import FamilySummary
from porocore.states import Array, IntArray


@dataclass(frozen=True)
class Published:
    """Results of a publication, shown beside those of the run.

    Attributes
    ----------
    source
        Citation.
    load
        Load of the statements on the settlement.
    porosity
        Fluid share of the cell [-].
    conductivity_viscosity
        K_11 μ_f [-].
    mean_grad_2222, mean_grad_2211, mean_grad_p_11
        M_2222, M_2211, Q_11 of the undeformed cell [-].
    settlement, steady_time, duration
        What it says of the final settlement against the linear one, the time at which the nonlinear column is
        steady [-], and how long it takes against the linear one.
    note
        What a reader must know of these numbers.
    """

    source: str
    load: float
    porosity: float
    conductivity_viscosity: float
    mean_grad_2222: float
    mean_grad_2211: float
    mean_grad_p_11: float
    settlement: str
    steady_time: float
    duration: str
    note: str = ""


@dataclass(frozen=True, eq=False)
class CellSummary:
    """The cell and its undeformed response.

    Attributes
    ----------
    description
        One line on geometry and material.
    porosity, viscosity
        φ_f, that of the mesh, and μ_f [-].
    linear
        The linear limit, which carries K, M and Q of the undeformed cell.
    mesh
        Facts on the mesh to be listed, such as ``{"solid tetrahedra": "3,344"}``.
    surface
        Points (N, 3) and tetrahedra (M, 4) or (M, 10) of the solid for the picture; None: no picture.
    crease : (2,)
        (a, b): squeezed beyond H_22 = a + b p the sharp ridges of the solid crease, on a very fine mesh;
        None: not known.
    law
        Which conductivity the flux goes by, see :data:`~porocore.macro.laws.pull_back.ConductivityLaw`.
    remarks
        Sentences on the pores, such as how an image was made periodic, and the edges of the cell.
    image_porosity
        Porosity of the image; None where there is none.
    which
        Member of a family that it is, such as ``in the middle of the ranges``; empty for a cell without parameters.
    """

    description: str
    porosity: float
    viscosity: float
    linear: LinearCoefficients
    mesh: Mapping[str, str] = field(default_factory=dict)
    surface: tuple[Array, IntArray] | None = None
    crease: tuple[float, float] | None = None
    law: ConductivityLaw = "piola"
    remarks: tuple[str, ...] = ()
    image_porosity: float | None = None
    which: str = ""

    @property
    def properties(self) -> EffectiveProperties:
        """Effective properties of the cell."""
        return EffectiveProperties.of(self.linear, self.porosity, self.viscosity)


@dataclass(frozen=True, eq=False)
class SamplingSummary:
    """The solved states.

    Attributes
    ----------
    inputs
        The d sampled inputs and their ranges.
    x : (n, d)
        Values of the inputs.
    status : (n,) int
        :class:`porocore.states.Status` of each.
    training : (n,) bool
        Rows that the surrogate was trained on; their hull is the sampled range.
    contact_share : (n,)
        Share of the pore wall that is in contact; None: not known.
    """

    inputs: InputSpace
    x: Array
    status: IntArray
    training: npt.NDArray[np.bool_]
    contact_share: Array | None = None


@dataclass(frozen=True, eq=False)
class TrainingCurve:
    """Losses against epochs, or iterations of L-BFGS, all (k,); without validation states the last is NaN."""

    epoch: Array
    loss: Array
    validation_loss: Array

    @property
    def validated(self) -> bool:
        """True if states were kept for validation."""
        return bool(np.isfinite(self.validation_loss).any())


@dataclass(frozen=True, eq=False)
class SurrogateSummary:
    """Surrogate, its errors on held-out states, and its training."""

    backend: str
    description: str
    training_states: int
    outputs: tuple[OutputCheck, ...]
    curve: TrainingCurve | None = None
    #: Of the closure itself on the stable states; None: not known.
    closure_error: ClosureError | None = None
    #: The closure that uses it.
    closure: str = "mean-gradient"
    #: Whether the closure takes stress and fluid volume from the surrogate itself.
    exact_closure: bool = False


@dataclass(frozen=True)
class DirectCost:
    """Cost of a solution by direct FE².

    Attributes
    ----------
    law, load
        Of the solution.
    points
        Responses that the quadrature points asked for.
    solves, failed
        Cells solved, and how many of them had no solution.
    solve_seconds
        Spent in these, added up over the processes.
    seconds
        Wall time of the macro solve.
    surrogate_seconds
        Wall time of the same solve with the surrogate and the same closure; None: not solved.
    """

    law: str
    load: float
    points: int
    solves: int
    failed: int
    solve_seconds: float
    seconds: float
    surrogate_seconds: float | None = None

    @property
    def speed_up(self) -> float | None:
        """Wall time of direct FE² over that of the surrogate; None: not known."""
        return self.seconds / self.surrogate_seconds if self.surrogate_seconds else None


@dataclass(frozen=True)
class AdaptiveSurrogateCost:
    """Cost of a solution with an adaptive surrogate beyond the sampled states.

    Attributes
    ----------
    law, load
        Of the solution.
    solves, failed, learned
        Cells solved outside the sampled range, how many of them had no solution, and how many were learned from.
    refits
        How often it was fitted again.
    solve_seconds, fit_seconds
        Spent in the solves, added up over the processes, and in the fits.
    """

    law: str
    load: float
    solves: int
    failed: int
    learned: int
    refits: int
    solve_seconds: float
    fit_seconds: float


@dataclass(frozen=True)
class Stage:
    """Wall time of one stage of the run, with an empty store; ``saved`` of it was not spent."""

    name: str
    seconds: float
    note: str = ""
    saved: float = 0.0


@dataclass(frozen=True, eq=False)
class ReportContext:
    """Input of :func:`porocore.report.html.write_report`.

    Attributes
    ----------
    title
        Heading of the page.
    cell, sampling, surrogate, cases
        The results; at least one case.
    stages, provenance, config_text
        Times; versions, seeds and identities, name to text; the resolved configuration.
    published
        What to set beside the results; None where the run is no repetition of a publication.
    warnings
        Shown in a box at the top, before those that the results themselves give rise to.
    other_surrogates
        Those of the other closures.
    direct, fallbacks
        Costs of direct FE², and of solutions with a fallback.
    scenarios, units
        Scales for which the main results are given in SI units, and units of the study's results.
    loading_mode
        What moves the body.
    family, body
        The cell over its parameters, and the cells of a body of many; None: there are none.
    parts
        Of several cells, each of them with the part of the body that has it; then ``cell``, ``sampling``, ``surrogate``
        and ``family`` are those of the rest of the body.
    of, name
        Of such a part, the place of the cell in words, and its name; that of the rest of the body has none.
    """

    title: str
    cell: CellSummary
    sampling: SamplingSummary
    surrogate: SurrogateSummary
    cases: tuple[LoadCase, ...]
    stages: tuple[Stage, ...]
    provenance: Mapping[str, str]
    config_text: str
    published: Published | None = None
    warnings: tuple[str, ...] = ()
    other_surrogates: tuple[SurrogateSummary, ...] = ()
    direct: tuple[DirectCost, ...] = ()
    scenarios: Mapping[str, Scales] = field(default_factory=dict)
    fallbacks: tuple[AdaptiveSurrogateCost, ...] = ()
    units: ResultUnits = field(default_factory=ResultUnits)
    loading_mode: LoadingMode = field(default_factory=LoadingMode)
    family: FamilySummary | None = None
    body: BodyCells | None = None
    parts: tuple[ReportContext, ...] = ()
    of: str = ""
    name: str = ""

    @property
    def of_each_cell(self) -> tuple[ReportContext, ...]:
        """Contexts of the sections of each cell."""
        return self.parts or (self,)

    def said_of_cell(self, text: str) -> str:
        """Return a sentence with the cell that it is about before it, where there are several."""
        return f"Cell {self.of}: {text}" if self.of and text else text

    @property
    def result_units(self) -> dict[str, ResultUnits]:
        """Units by the heading of their column: the study's own, if there are any, and those of the scenarios."""
        own = {"this study": self.units} if self.units.given else {}
        return own | {name: ResultUnits(scales) for name, scales in self.scenarios.items()}

"""Records of what the report page shows; words on the loading; differences of laws on one problem."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from porocore.cell.level_sets.grey_values import Parting
from porocore.cell.materials.prony import Relaxation
from porocore.core.formulas import TimeFunction, Value
from porocore.core.inputs import InputSpace
from porocore.core.units import ResultUnits, Scales
from porocore.interfaces.solution import History, MacroSolution, has_radius
from porocore.macro.boundary.rigid import RigidIndenter
from porocore.macro.laws.closure import ClosureError, ConductivityLaw
from porocore.macro.laws.linear import EffectiveProperties, LinearCoefficients
from porocore.macro.problem import Boundary, MacroSetup
from porocore.report.metrics import STEADY_TOLERANCE, LoadCase, is_remnant, moves_along_y, time_to_fraction
from porocore.report.words.held_out import OutputCheck
from porocore.report.words.memory import BodyMemory
from porocore.report.words.parameters import BodyCells, FamilySummary, ParameterRange
from porocore.states import Array, IntArray

#: A component of a force below this share of the largest of all surfaces is round-off.
VISIBLE = 1e-6
#: Components that differ by less than this share are the same.
SAME = 1e-3
#: A force that ends less than this share below its peak does not relax, and has no times of it.
LEAST_DROP = 1e-3


@dataclass(frozen=True)
class LoadingMode:
    """Loading by prescribed displacements or by stresses.

    Attributes
    ----------
    displaced
        Surfaces that are moved by a given displacement.
    pressed
        Indenters that are.
    stressed
        Whether a traction, a pressure or the force on a plate or an indenter is scaled by the load.
    follows
        Whether a pressure follows a deformed surface.
    scales
        Whether the load times E is a prescribed stress: some traction or pressure is 1 in the configuration, so that
        the load gives it as a share of E. A force, or a stress with a value of its own, makes it a mere factor.
    """

    displaced: tuple[str, ...] = ()
    stressed: bool = True
    follows: bool = False
    scales: bool = False
    pressed: tuple[str, ...] = ()

    @property
    def moves(self) -> bool:
        """True if a surface or an indenter is moved by a given displacement."""
        return bool(self.displaced or self.pressed)

    @property
    def settles(self) -> bool:
        """True if the settlement is a result and not prescribed."""
        return self.stressed or not self.moves

    @classmethod
    def from_setup(cls, macro: MacroSetup) -> LoadingMode:
        """Return the mode of the boundary conditions that are not zero."""
        faces = macro.boundary.items()
        return cls(
            tuple(name for name, b in faces if _any((*b.displacement, b.normal))),
            any(_any(_stresses(b)) for _, b in faces)
            or any(_any([each.force]) for each in macro.contact.values()),
            "follower" in macro.parts,
            any(_is_one(value) for _, b in faces for value in (*b.traction, b.follower, b.pressure)),
            tuple(name for name, each in macro.contact.items() if _any([each.displacement])),
        )


def _stresses(boundary: Boundary) -> tuple[Value | None, ...]:
    return (*boundary.traction, boundary.follower, boundary.plate, boundary.pressure)


def _is_one(value: Value | None) -> bool:
    return value is not None and not isinstance(value, TimeFunction) and abs(value) == 1


def _any(values: Iterable[Value | None]) -> bool:
    return any(isinstance(value, TimeFunction) or bool(value) for value in values if value is not None)


def reactions(solution: MacroSolution) -> dict[str, dict[str, Any]]:
    """Return the force on each surface that is held or moved, ready for JSON.

    It is that of the whole specimen: ``compressive`` or ``tensile`` on a plane surface that is pressed or pulled, and
    positive there; otherwise the component that becomes largest, from outside on the body, ``along x`` and so on, with
    its sign. Surfaces on which no force acts are left out. See :func:`relaxation` for the figures.
    """
    largest = max((float(np.abs(force).max()) for force in solution.reactions.values()), default=0.0)
    found = {}
    for name, force in solution.reactions.items():
        peaks = np.abs(force).max(axis=0)
        if peaks.max() <= VISIBLE * largest:
            continue
        # Of components that are the same by symmetry always the first.
        i = int(np.argmax(peaks >= (1 - SAME) * peaks.max()))
        sense, values = f"along {'xyz'[i]}", force[:, i]
        pressed = solution.compression.get(name)
        if pressed is not None and np.abs(pressed).max() >= (1 - SAME) * peaks[i]:
            pulled = pressed[int(np.abs(pressed).argmax())] < 0
            sense, values = ("tensile", -pressed) if pulled else ("compressive", pressed)
        found[name] = {"force": sense, **relaxation(solution.history.time, values)}
    return found


def force_name(force: dict[str, Any]) -> str:
    """Return what a force is called: ``compressive force``, ``force along x``."""
    sense = str(force["force"])
    return f"force {sense}" if sense.startswith("along") else f"{sense} force"


def end_words(force: dict[str, Any]) -> str:
    """Return what a force is at the end."""
    if force["drift"] is None:
        return "gone"
    return "in equilibrium" if force["equilibrium"] is not None else "still changing"


def no_relaxation(force: dict[str, Any]) -> str:
    """Return why a force has no times of relaxation."""
    if force["drift"] is None:
        return end_words(force)
    return f"drop below {100 * LEAST_DROP:g} %"


def contacts(solution: MacroSolution) -> dict[str, dict[str, Any]]:
    """Return for each indenter its largest values, and the :func:`relaxation` of its force, ready for JSON.

    A contact that is not round has no ``largest_radius``.
    """
    names = {1: "largest_displacement", 2: "largest_area", 3: "largest_radius", 5: "largest_penetration"}
    return {
        name: {
            **relaxation(solution.history.time, series[:, 0]),
            **{key: float(series[:, i].max()) for i, key in names.items() if i != 3 or has_radius(series)},
            "largest_contact_pressure": float(series[:, 4].max()),
        }
        for name, series in solution.contact.items()
    }


def relaxation(time: Array, force: Array) -> dict[str, Any]:
    """Return the summary of a force (steps,) that peaks and relaxes, ready for JSON.

    Returns
    -------
    dict
        ``peak`` with its sign, ``time_of_peak``, ``final``; ``drift``, the change over the last tenth of the time as a
        share of the final force; ``equilibrium``, the final force unless it drifts by more than 0.1 %, then None;
        ``peak_over_final``; ``drop``, by which share of the peak the final force lies below it; ``relaxed_50_percent``
        and ``relaxed_95_percent``, the times from the peak until the force has come so far toward the final one, None
        where it drops by less than 0.1 %. What is not defined is None: of a force that is gone, a remnant of its peak,
        drift, equilibrium, ratio and times of relaxation.
    """
    step = int(np.abs(force).argmax())
    peak, final, since = float(force[step]), float(force[-1]), time[step:] - time[step]
    before = float(np.interp(time[-1] - 0.1 * (time[-1] - time[0]), time, force))
    left = final != 0 and not is_remnant(final, peak)
    drift = abs(final - before) / abs(final) if left else None
    drop = (peak - final) / peak if peak else 0.0
    times = [
        time_to_fraction(since, peak - force[step:], share) if left and drop > LEAST_DROP else None
        for share in (0.5, 0.95)
    ]
    return {
        "peak": peak,
        "time_of_peak": float(time[step]),
        "final": final,
        "drift": drift,
        "equilibrium": final if drift is not None and drift <= STEADY_TOLERANCE else None,
        "peak_over_final": peak / final if left else None,
        "drop": drop,
        "relaxed_50_percent": times[0],
        "relaxed_95_percent": times[1],
    }


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
        Which conductivity the flux goes by, see :data:`~porocore.macro.laws.closure.ConductivityLaw`.
    remarks
        Sentences on the pores, such as how an image was made periodic, and the edges of the cell.
    image_porosity
        Porosity of the image; None where there is none.
    parting
        Grey values of the image and their threshold; None where there is no image, or a segmented one.
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
    parting: Parting | None = None
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
    indenters
        Rigid indenters by name.
    parts
        Of several cells, each of them with the part of the body that has it; then ``cell``, ``sampling``, ``surrogate``
        and ``family`` are those of the rest of the body.
    of, name
        Of such a part, the place of the cell in words, and its name; that of the rest of the body has none.
    relaxations
        Those of the cells whose solid relaxes.
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
    indenters: Mapping[str, RigidIndenter] = field(default_factory=dict)
    parts: tuple[ReportContext, ...] = ()
    of: str = ""
    name: str = ""
    relaxations: tuple[Relaxation, ...] = ()

    @property
    def of_each_cell(self) -> tuple[ReportContext, ...]:
        """Contexts of the sections of each cell."""
        return self.parts or (self,)

    def said_of_cell(self, text: str) -> str:
        """Return a sentence with the cell that it is about before it, where there are several."""
        return f"Cell {self.of}: {text}" if self.of and text else text

    @property
    def ranges(self) -> tuple[dict[str, ParameterRange], ...]:
        """Range of each parameter of the cell by its name, for each region of the body, the rest of it first."""
        of_cells = {
            each.name: {} if each.family is None else {one.name: one for one in each.family.parameters}
            for each in self.of_each_cell
        }
        regions = () if self.body is None else self.body.cells.regions
        names = ("",) * (1 + len(regions)) if self.body is None or not self.parts else self.body.cell_names
        return tuple(of_cells.get(name, of_cells[""]) for name in names)

    def memory_of(self, solution: MacroSolution) -> BodyMemory:
        """Return what the law remembered in a solution."""
        return BodyMemory(solution, self.ranges, self.relaxations)

    @property
    def result_units(self) -> dict[str, ResultUnits]:
        """Units by the heading of their column: the study's own, if there are any, and those of the scenarios."""
        own = {"this study": self.units} if self.units.given else {}
        return own | {name: ResultUnits(scales) for name, scales in self.scenarios.items()}


#: Histories that are compared, with their names for a reader.
COMPARED = {
    "settlement": "settlement",
    "pressure_max": "largest pore pressure",
    "drained": "drained volume",
}
SAME_TIME = 1e-9


def history_difference(reference: History, other: History, quantity: str) -> dict[str, float] | None:
    """Return the difference of one history for JSON, in per cent of the largest magnitude of the reference.

    Returns
    -------
    dict or None
        ``end_percent``, signed; ``largest_percent``, the largest magnitude over the times that both solutions have, and
        ``time_of_largest``. None where the reference is zero or no time is common.
    """
    rows, columns = _common(reference.time, other.time)
    one, two = getattr(reference, quantity)[rows], getattr(other, quantity)[columns]
    scale = float(np.abs(one).max(initial=0.0))
    if scale == 0:
        return None
    apart = 100 * (two - one) / scale
    worst = int(np.abs(apart).argmax())
    return {
        "end_percent": float(apart[-1]),
        "largest_percent": float(abs(apart[worst])),
        "time_of_largest": float(reference.time[rows][worst]),
    }


def law_differences(case: LoadCase) -> list[dict[str, Any]]:
    """Return the differences of all pairs of nonlinear laws of a load for JSON; the more exact one is the reference."""
    found = []
    for pair in combinations((case.nonlinear, *case.others), 2):
        reference, other = sorted(pair, key=_exactness)
        differences = {
            name: history_difference(reference.history, other.history, name)
            if name != "settlement" or moves_along_y(reference.history)
            else None
            for name in COMPARED
        }
        found.append({"law": other.law, "reference": reference.law, **differences})
    return found


def _exactness(solution: MacroSolution) -> tuple[bool, bool]:
    """Return the sorting key: cells before surrogates, the exact closure before the other."""
    return not solution.law.startswith("direct-"), solution.law.endswith("mean-gradient")


def _common(one: Array, other: Array) -> tuple[Any, Any]:
    """Return rows of equal times; a solution that had to halve its steps has more."""
    near = np.searchsorted(other, one)
    near = np.clip(near, 1, len(other) - 1)
    near -= np.abs(other[near - 1] - one) < np.abs(other[near] - one)
    rows = np.flatnonzero(np.abs(other[near] - one) <= SAME_TIME * np.maximum(1.0, one))
    return rows, near[rows]

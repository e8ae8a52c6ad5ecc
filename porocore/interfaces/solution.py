"""Solution of a macro problem: history, profiles, mesh, its file; its columns against time; report of a step."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from porocore.core.fields import provided
from porocore.core.files.plain_data import write_csv
from porocore.core.hdf5 import Contents, atomic_hdf5, link_to, name_of_link, numbered, opened
from porocore.core.units import QUANTITIES, ResultUnits
from porocore.errors import DataError
from porocore.interfaces.cell import ElementCells
from porocore.states import Array, Doubt, IntArray, MacroState

#: Fields of a solution that map names to values against time, with the shape of one value.
SERIES: dict[str, tuple[int, ...]] = {
    "probes": (4,),
    "reactions": (3,),
    "compression": (),
    "inflow": (),
    "contact": (7,),
    "work": (),
}


def pressure_name(charged: bool) -> str:
    """Return what the unknown p of a body is called; with fixed charges it is μ = p − π."""
    return "effective fluid pressure" if charged else "pore pressure"


@dataclass(frozen=True)
class StepWork:
    """Work of the linear solver in one accepted step, and in the attempts that failed before it."""

    systems: float = 0.0  #: linear systems solved
    iterations: float = 0.0  #: iterations over all of them; a factor needs none
    most_iterations: float = 0.0  #: iterations of the system that took most
    set_ups: float = 0.0  #: factors and preconditioners made
    set_up_seconds: float = 0.0  #: time that these took
    solve_seconds: float = 0.0  #: time that the systems took
    seconds: float = 0.0  #: time of the whole step


@dataclass(frozen=True)
class StepReport:
    """One accepted time step, for the progress display."""

    time: float
    end: float
    iterations: int
    settlement: float
    #: Of the linear solver, where it is known.
    work: StepWork | None = None
    #: Lines for the log.
    notes: tuple[str, ...] = ()
    #: Largest displacement in the direction +y.
    heave: float = 0.0
    #: Largest size of the displacement.
    displacement: float = 0.0


#: Internal variables of a law with fixed charges: the pressure p of the pores, and the charges per reference volume.
PORE_PRESSURE, FIXED_CHARGE = "pore_pressure", "charge"
#: Until version 4 the shares that are flagged were not told apart by their reason; until 5 there was no contact; until
#: 6 laws had no memory.
FORMAT, VERSION = "porocore-solution", 7


def _not_given() -> Array:
    return np.zeros(0)


@dataclass(frozen=True, eq=False)
class History:
    """Scalars against time, all (steps,); the first row is the state at rest."""

    time: Array
    #: Share of the load that acts.
    ramp: Array
    #: Largest displacement against the y axis, max(−u_2).
    settlement: Array
    #: Largest pore pressure.
    pressure_max: Array
    #: Volume of fluid that has left through the boundary, by mass balance: ∫∫ q·N dS dt.
    drained: Array
    #: The paper's measure of it: ∫∫ (1/det F̄) ∇·(Ḡw) dV dt.
    drained_paper: Array
    #: Volume share of the points that are flagged, for whatever reason.
    flagged: Array
    #: Largest deviation of the element means of P_E,22 from their average over the body.
    stress_spread: Array
    #: Newton iterations of the step.
    iterations: Array
    #: Largest displacement along the y axis, max(u_2).
    heave: Array
    #: Least pore pressure, negative where there is suction.
    pressure_min: Array
    #: Largest magnitude of the displacement u.
    displacement: Array
    #: Volume shares of the points that are flagged for each reason of :class:`~porocore.Doubt`; zeros if not given.
    flagged_outside: Array = field(default_factory=_not_given)
    flagged_error: Array = field(default_factory=_not_given)
    flagged_unstable: Array = field(default_factory=_not_given)
    flagged_closed: Array = field(default_factory=_not_given)
    flagged_not_sampled: Array = field(default_factory=_not_given)

    def __post_init__(self) -> None:
        """Fill the shares for each reason that are not given with zeros."""
        for each in Doubt:
            if not len(getattr(self, f"flagged_{each.name}")):
                object.__setattr__(self, f"flagged_{each.name}", np.zeros(len(self.time)))


@dataclass(frozen=True, eq=False)
class Profile:
    """Fields at one time. Nodal: all nodes of the quadratic mesh; the rest: element means."""

    time: float
    u: Array  #: (nodes, 3)
    p: Array  #: (nodes,)  the linear field, evaluated at all nodes
    grad_u: Array  #: (elements, 3, 3)  H
    mean_grad: Array  #: (elements, 3, 3)  <∇u¹>_s
    deformation: Array  #: (elements, 3, 3)  F̄
    conductivity: Array  #: (elements, 3, 3)  K_t = K_ref/det F̄
    stress: Array  #: (elements, 3, 3)  P_E
    flux: Array  #: (elements, 3)  Ḡw
    element_p: Array  #: (elements,)
    flagged: Array  #: (elements,)  share of the element's points that are flagged
    fluid_volume: Array  #: (elements,)  φ, fluid volume per reference volume
    #: (nodes,) contact pressure per reference area at the nodes that an indenter touches, else 0; zeros if not given.
    contact_pressure: Array = field(default_factory=_not_given)
    #: (elements,) pressure at which the law asks the cell; ``element_p`` if not given.
    cell_p: Array = field(default_factory=_not_given)
    #: Name → (elements,) or (elements, 3, 3), internal variables of the law.
    internal: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Fill what is not given: a contact pressure with zeros, the pressure of the cell with that of the body."""
        if not len(self.contact_pressure):
            object.__setattr__(self, "contact_pressure", np.zeros(len(self.p)))
        if not len(self.cell_p):
            object.__setattr__(self, "cell_p", self.element_p)

    def arrays(self) -> dict[str, Array]:
        """Return time and fields by their names in files."""
        found = {name: np.asarray(getattr(self, name)) for name in ("time", *PROFILE_SHAPES)}
        return found | {f"internal/{link_to(name)}": values for name, values in self.internal.items()}

    def write(self, file: Any, group: str) -> None:
        """Write it into a group of an open file."""
        for name, values in self.arrays().items():
            file[f"{group}/{name}"] = values

    def in_elements(self, elements: IntArray) -> Profile:
        """Return the profile with the means over some elements; nodal fields are those of the whole."""
        means = {
            name: getattr(self, name)[elements]
            for name, (at, *_) in PROFILE_SHAPES.items()
            if at == "elements"
        }
        return replace(
            self, **means, internal={name: values[elements] for name, values in self.internal.items()}
        )

    @property
    def osmotic_pressure(self) -> Array:
        """Osmotic pressure π = p − μ (elements,) of a body with fixed charges."""
        pi: Array = self.internal[PORE_PRESSURE] - self.element_p
        return pi

    @property
    def fixed_charge_density(self) -> Array:
        """Concentration c_F (elements,) of the fixed charges in the fluid of the deformed cell."""
        c_F: Array = self.internal[FIXED_CHARGE] / self.fluid_volume
        return c_F

    @property
    def swelling_stretch(self) -> Array:
        """Stretch J₀^(1/3) (elements,) of a ball with the volume of the element."""
        return np.asarray(np.cbrt(np.linalg.det(np.eye(3) + self.grad_u)))

    @property
    def reference_conductivity(self) -> Array:
        """Conductivity K_ref = det F̄ K_t (elements, 3, 3) of a cell's law, for the flux through reference area."""
        K_ref: Array = np.linalg.det(self.deformation)[:, None, None] * self.conductivity
        return K_ref

    @property
    def spatial_conductivity(self) -> Array:
        """Conductivity k = F₀ K_ref F₀ᵀ/J₀ (elements, 3, 3) of the deformed body in space, F₀ = I + H."""
        F0 = np.eye(3) + self.grad_u
        k: Array = F0 @ self.reference_conductivity @ F0.swapaxes(1, 2) / np.linalg.det(F0)[:, None, None]
        return k


#: Shapes of the fields of a profile; all but the time.
PROFILE_SHAPES: dict[str, tuple[str | int, ...]] = {
    "u": ("nodes", 3),
    "p": ("nodes",),
    "contact_pressure": ("nodes",),
    **{name: ("elements", 3, 3) for name in ("grad_u", "mean_grad", "deformation", "conductivity", "stress")},
    "flux": ("elements", 3),
    **{name: ("elements",) for name in ("element_p", "cell_p", "flagged", "fluid_volume")},
}


@dataclass(frozen=True, eq=False)
class MacroSolution:
    """History, profiles at rest, at the chosen times and at the end, and the mesh.

    What a macro solver returns is that of the part of a symmetric body that it solves. What a study keeps has the
    forces and volumes of the whole.

    Attributes
    ----------
    law
        Name of the law.
    load
        Factor of the prescribed values.
    points : (nodes, 3)
        Nodes of the quadratic mesh.
    cells : (elements, 27, 10, 9 or 6)
        Triquadratic hexahedra or quadratic tetrahedra in VTK order; of a body in two dimensions biquadratic
        quadrilaterals or quadratic triangles in the plane z = 0.
    backend
        Name of the macro solver, where it is known.
    probes : name → (steps, 4)
        u_1, u_2, u_3 and p of each probe against the history's time.
    reactions : name → (steps, 3)
        Force on each surface that is held or moved, from outside on the body, in the directions in which it is; see
        ``porocore.macro.boundary.reactions`` for nodes that several of them share.
    compression : name → (steps,)
        Force against the outward normal of each of them that is plane, positive in compression; of a study.
    inflow : name → (steps,)
        Rate of fluid that enters through each surface with a prescribed pressure, the mean over the step; of a study,
        through its images in the whole specimen too.
    contact : name → (steps, 7)
        Of each rigid indenter: force along its direction; displacement; reference area
        that it touches, and the radius of a circle of that area, 0 where it is not round; largest contact pressure;
        penetration; rate of fluid that leaves through its surfaces.
    work : name → (steps,)
        Fields of :class:`StepWork` against the history's time, where they are known; zero at rest.
    linear_solver
        Solver of the linear systems and the reason for it, in one line, where they are known.
    copies
        Parts like the mesh in the whole specimen that forces and volumes are those of.
    element_cells
        Regions, parameters and material axes of the elements; None for a body of one cell without parameters.
    units
        Units of the study that keeps it, with the factors from these dimensionless values; plain numbers have none.
    revolved
        Whether a body in two dimensions is a meridian: x the distance from the y axis, the third direction the hoop.
    depth
        Else the length that it stands for along the third axis.
    quantities
        Quantity of each internal variable of the law, by its name; see :class:`~porocore.InternalVariable`.
    """

    law: str
    load: float
    points: Array
    cells: npt.NDArray[np.int64]
    history: History
    profiles: tuple[Profile, ...]
    backend: str = ""
    probes: Mapping[str, Array] = field(default_factory=dict)
    reactions: Mapping[str, Array] = field(default_factory=dict)
    compression: Mapping[str, Array] = field(default_factory=dict)
    inflow: Mapping[str, Array] = field(default_factory=dict)
    contact: Mapping[str, Array] = field(default_factory=dict)
    work: Mapping[str, Array] = field(default_factory=dict)
    linear_solver: str = ""
    copies: float = 1.0
    element_cells: ElementCells | None = None
    units: ResultUnits = field(default_factory=ResultUnits)
    revolved: bool = False
    depth: float = 1.0
    quantities: Mapping[str, str] = field(default_factory=dict)

    @property
    def has_charges(self) -> bool:
        """True if the body has fixed charges, so that p is the effective fluid pressure μ = p − π."""
        return PORE_PRESSURE in self.quantities

    @property
    def pressure(self) -> str:
        """Name of the unknown p in words."""
        return pressure_name(self.has_charges)

    @property
    def evolving(self) -> tuple[str, ...]:
        """Names of the parameters of the cell that evolve."""
        names = () if self.element_cells is None else self.element_cells.parameters
        return tuple(name for name in names if name in self.quantities)

    @property
    def after_rest(self) -> tuple[Profile, ...]:
        """Profiles without that of the state at rest, t = 0."""
        return tuple(profile for profile in self.profiles if profile.time > 0)

    def cell_states(self, profile: int) -> MacroState:
        """Return the states of the elements at a profile as their cells see them; see :meth:`seen_by_cells`."""
        found = self.profiles[profile]
        return self._of_cells(MacroState(found.grad_u, found.cell_p), profile, slice(None))

    def seen_by_cells(self, states: MacroState, profile: int, elements: IntArray) -> MacroState:
        """Return states of a profile as their cells see them.

        They are in the material axes, at the pressure at which the law asks the cell and with the cell's parameters as
        they have evolved; of these two the means over each element are known.

        Parameters
        ----------
        states
            States (n,) in the axes of the body, at its pressure.
        profile
            Number of the profile.
        elements
            Element (n,) of each state.
        """
        found = self.profiles[profile]
        p = states.p + (found.cell_p - found.element_p)[elements]
        return self._of_cells(replace(states, p=p), profile, elements)

    def _of_cells(self, states: MacroState, profile: int, elements: Any) -> MacroState:
        cells = self.element_cells
        return states if cells is None else cells.given_to(states, profile, elements)

    def of_regions(self, regions: Collection[int], parameters: Sequence[str]) -> MacroSolution:
        """Return the part of the solution in some regions, whose cell has these parameters.

        History, forces and nodes are those of the whole.
        """
        cells = provided(self.element_cells)
        elements = np.flatnonzero(np.isin(cells.region, list(regions)))
        return replace(
            self,
            cells=self.cells[elements],
            profiles=tuple(profile.in_elements(elements) for profile in self.profiles),
            element_cells=cells.of_elements(elements, parameters),
        )

    def save(self, path: Path) -> None:
        """Write one HDF5 file, atomically."""
        with atomic_hdf5(path) as file:
            file.attrs.update(format=FORMAT, version=VERSION, law=self.law, load=self.load)
            file.attrs.update(
                backend=self.backend, copies=float(self.copies), linear_solver=self.linear_solver
            )
            if self.units.given:
                file.attrs["units"] = self.units.as_text()
            if self.revolved:
                file.attrs["revolved"] = "about y"
            if self.depth != 1:
                file.attrs["depth"] = float(self.depth)
            if self.quantities:
                file.attrs["internal"] = json.dumps(dict(self.quantities))
            file["points"], file["cells"] = self.points, self.cells
            for f in fields(History):
                file[f"history/{f.name}"] = getattr(self.history, f.name)
            for kind in SERIES:
                for name, values in getattr(self, kind).items():
                    file[f"{kind}/{link_to(name)}"] = values
            for i, profile in enumerate(self.profiles):
                profile.write(file, f"profiles/{i}")
            if self.element_cells is not None:
                self.element_cells.save(file)

    @classmethod
    def load_file(cls, path: str | Path) -> MacroSolution:
        """Read what :meth:`save` wrote.

        Raises
        ------
        DataError
            The file is truncated or foreign.
        """
        with opened(path, "porocore solution", "solve again") as file:
            if not file.is_of(FORMAT, VERSION):
                raise DataError(
                    f"{path}: expected a porocore solution of version {VERSION}; move it elsewhere and solve again"
                )
            history = {
                f.name: file.array(f"history/{f.name}", "steps", kind="number") for f in fields(History)
            }
            points = file.array("points", "nodes", 3)
            cells = file.array("cells", "elements", "nodes of an element", kind="int")
            if file.sizes["nodes of an element"] not in (6, 9, 10, 27):
                raise ValueError("'cells' are no hexahedra, tetrahedra, quadrilaterals or triangles")
            if cells.size and (cells.min() < 0 or cells.max() >= len(points)):
                raise ValueError("'cells' names nodes that are not there")
            quantities = _quantities(file)
            profiles = tuple(read_profile(file, name) for name in numbered(file, "profiles"))
            if any(each.internal.keys() != quantities.keys() for each in profiles):
                raise ValueError("'profiles' have other internal variables than attribute 'internal' names")
            return cls(
                file.attribute("law", str),
                file.attribute("load", float),
                points,
                cells,
                History(**history),
                profiles,
                _text(file, "backend"),
                **{
                    kind: {
                        name_of_link(link): file.array(f"{kind}/{link}", "steps", *width)
                        for link in file.members(kind)
                    }
                    for kind, width in SERIES.items()
                },
                linear_solver=_text(file, "linear_solver"),
                copies=file.attribute("copies", float),
                element_cells=ElementCells.read(file),
                units=ResultUnits.from_text(units) if (units := _text(file, "units")) else ResultUnits(),
                revolved="revolved" in file.attributes,
                depth=file.attribute("depth", float) if "depth" in file.attributes else 1.0,
                quantities=quantities,
            )


def _text(file: Contents, name: str) -> str:
    """Return a text that a file may lack."""
    return str(file.attribute(name, str)) if name in file.attributes else ""


def _quantities(file: Contents) -> dict[str, str]:
    """Return the quantities of the internal variables; ValueError where they are none."""
    found = json.loads(_text(file, "internal") or "{}")
    if not isinstance(found, dict) or not {*found.values()} <= {"", *QUANTITIES}:
        raise ValueError("attribute 'internal' gives no quantities of internal variables")
    return found


def read_profile(file: Contents, group: str) -> Profile:
    """Return the profile in a group of an open file."""
    arrays = {
        name: file.array(f"{group}/{name}", at, *shape) for name, (at, *shape) in PROFILE_SHAPES.items()
    }
    internal = {}
    for link in file.members(f"{group}/internal"):
        name = f"{group}/internal/{link}"
        tensor = (3, 3) if len(file.shape(name)) > 1 else ()
        internal[name_of_link(link)] = file.array(name, "elements", *tensor)
    return Profile(time=float(file.array(f"{group}/time")), **arrays, internal=internal)


#: Words for each reason of :class:`~porocore.Doubt`.
DOUBTS = {
    "outside": "beyond the sampled states",
    "error": "estimated error beyond the tolerance",
    "unstable": "unstable cell",
    "closed": "next to states whose pore walls touch",
    "not_sampled": "a component moves that was not sampled",
}
#: Of the fields of a history: the quantity ('' is a plain number), and in words.
HISTORY = {
    "time": ("time", "time"),
    "ramp": ("", "share of the load"),
    "settlement": ("displacement", "largest settlement max(-u_2)"),
    "pressure_max": ("pressure", "largest pore pressure"),
    "drained": ("volume", "drained volume, what has left through the boundary"),
    "drained_paper": ("volume", "the paper's measure of the drained volume"),
    "flagged": ("", "share of the body that is flagged"),
    "stress_spread": ("stress", "largest deviation of P_E,22 from its mean over the body"),
    "iterations": ("", "Newton iterations of the step"),
    "heave": ("displacement", "largest displacement along +y, max(u_2)"),
    "pressure_min": ("pressure", "least pore pressure"),
    "displacement": ("displacement", "largest size of the displacement max|u|"),
    **{f"flagged_{name}": ("", f"share that is flagged: {words}") for name, words in DOUBTS.items()},
}
#: Of the columns of a contact: name, quantity, and in words.
CONTACT = (
    ("force", "force", "force of the indenter along its direction"),
    ("displacement", "displacement", "displacement of the indenter along its direction"),
    ("area", "area", "reference area that the indenter touches"),
    # 0 where the contact is not round; no output has it then.
    ("radius", "displacement", "radius of a circle of the area that the indenter touches"),
    ("largest pressure", "pressure", "largest contact pressure, per reference area"),
    ("penetration", "displacement", "largest penetration of the indenter into the body"),
    ("outflow", "flow", "fluid that leaves through the surfaces of the indenter"),
)
#: Of the components of a probe.
PROBE = (("u_1", "displacement"), ("u_2", "displacement"), ("u_3", "displacement"), ("p", "pressure"))


@dataclass(frozen=True, eq=False)
class Series:
    """Column of a table against time.

    Attributes
    ----------
    name
        Such as ``settlement``, ``tip: u_2``, ``plate: force 2`` or ``top: inflow``.
    quantity
        Of :data:`porocore.core.units.QUANTITIES`; '' is a plain number.
    long_name
        In words.
    values : (steps,)
        Dimensionless.
    sign
        What a positive value means, or which pressure it is; empty where that is plain.
    """

    name: str
    quantity: str
    long_name: str
    values: Array
    sign: str = ""

    @property
    def column(self) -> str:
        """Name with what it means, such as ``plate: force 2 (+ along y)``."""
        return f"{self.name} ({self.sign})" if self.sign else self.name


def has_radius(values: Array) -> bool:
    """Return if the contact of an indenter is round, by its columns (steps, 7): no area of it is without radius."""
    area, radius = values[:, 2], values[:, 3]
    return bool(radius.any() or not area.any())


def words_of(solution: MacroSolution, words: str) -> str:
    """Return the words for a history of a solution, of which p is another pressure where there are fixed charges."""
    return words.replace("pore pressure", solution.pressure)


def all_series(solution: MacroSolution) -> Iterator[Series]:
    """Yield the history, then probes, forces and inflows; time comes first."""
    effective = solution.pressure if solution.has_charges else ""
    for f in fields(History):
        quantity, words = HISTORY[f.name]
        sign = effective if quantity == "pressure" else ""
        yield Series(f.name, quantity, words_of(solution, words), getattr(solution.history, f.name), sign)
    for name, values in solution.probes.items():
        for i, (component, quantity) in enumerate(PROBE):
            sign = effective if quantity == "pressure" else ""
            words = f"{component} at the probe {name}"
            yield Series(f"{name}: {component}", quantity, words, values[:, i], sign)
    for name, values in solution.compression.items():
        words = f"compressive force on the surface {name}"
        yield Series(f"{name}: compressive force", "force", words, values, "+ in compression")
    for name, values in solution.reactions.items():
        for i, axis in enumerate("xyz"):
            words = f"force on the body at the surface {name}, component {i + 1}"
            yield Series(f"{name}: force {i + 1}", "force", words, values[:, i], f"+ along {axis}")
    for name, values in solution.inflow.items():
        images = " and its images in the whole body" if solution.copies > 1 else ""
        words = f"fluid that enters through the surface {name}{images}"
        yield Series(f"{name}: inflow", "flow", words, values, "+ into the body")
    for name, values in solution.contact.items():
        for i, (column, quantity, words) in enumerate(CONTACT):
            if column == "radius" and not has_radius(values):
                continue
            yield Series(f"{name}: {column}", quantity, f"{words}, {name}", values[:, i])


def write_series(path: Path, solution: MacroSolution, units: ResultUnits) -> Path:
    """Write all series as one CSV table, a row for each step; sign convention and unit stand behind each name.

    Raises
    ------
    RunFolderError
        The file cannot be written.
    """
    columns = list(all_series(solution))
    header = [
        f"{c.column} [{units.name(c.quantity) if c.quantity and units.given else '-'}]" for c in columns
    ]
    values = [c.values * units.factor(c.quantity) for c in columns]
    return write_csv(path, header, ([float(x) for x in row] for row in zip(*values, strict=True)))

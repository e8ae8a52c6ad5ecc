"""Undeformed cell over its parameters, and errors of the surrogate on held-out states, for the report."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.family.family import parameter_quantities
from porocore.cell.family.mesh import parameter_kinds
from porocore.core.inputs import SampledRange
from porocore.interfaces.law import CellLaw, MacroLaw
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.laws.linear import LinearisedLaw
from porocore.plugins.border import prediction_of
from porocore.report.words.held_out import OutputCheck
from porocore.report.words.parameters import FamilySummary, ParameterRange, RestField
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import Array, IntArray, MacroState
from porocore.study.notes.abilities import LARGEST_DEFECT

#: Values of a parameter at which the surrogate is asked, and combinations of the others at most.
POINTS, OTHERS = 25, 16
#: Directions whose property differs by less than this share have one curve.
SAME = 0.02


def family_summary(cell: Cell, members: Dataset, law: MacroLaw, surrogate: CellLaw) -> FamilySummary:
    """Return the undeformed cell over the parameters of a family.

    Parameters
    ----------
    cell
        The family.
    members
        Its undeformed members.
    law
        Of the surrogate with a closure.
    surrogate
        Gives the porosity.
    """
    found, stable = members.states().parameters, members.responses().stable
    assert found is not None
    parameters = parameter_ranges(cell)
    points = np.linspace([p.lower for p in parameters], [p.upper for p in parameters], POINTS).T
    solved = _of_members(members, np.flatnonzero(stable))
    curves = [[_by_the_law(law, surrogate, rows) for rows in _rows(points, k)] for k in range(len(points))]
    fields = []
    for name, (label, quantity) in _shown(solved).items():
        of_field = [[at[name] for at in each] for each in curves]
        fields.append(
            RestField(
                label,
                name,
                quantity,
                solved[name],
                np.array([each[0] for each in of_field]),
                np.array([np.min(each, axis=0) for each in of_field]),
                np.array([np.max(each, axis=0) for each in of_field]),
            )
        )
    return FamilySummary(parameters, found[stable], points, tuple(fields), int((~stable).sum()))


def parameter_ranges(cell: Cell) -> tuple[ParameterRange, ...]:
    """Return the parameters of a family in their order, for the report."""
    quantities = parameter_quantities(cell)
    kinds = parameter_kinds(cell)
    swollen = "swelling" not in kinds and cell.material is not None and cell.material.swelling != 1
    return tuple(
        ParameterRange(
            each.name,
            each.key,
            each.lower,
            each.upper,
            quantities[each.name],
            solved=not swollen and kind != "swelling",
        )
        for each, kind in zip(cell.parameters, kinds, strict=True)
    )


#: Properties of the undeformed cell by their plain names: label and quantity.
PROPERTIES = {
    "porosity": (r"porosity $\varphi_f$", ""),
    "C_eff,1111": (r"drained stiffness $C_{1111}$", "stress"),
    "C_eff,2222": (r"drained stiffness $C_{2222}$", "stress"),
    "C_eff,3333": (r"drained stiffness $C_{3333}$", "stress"),
    "C_eff,1212": (r"shear stiffness $C_{1212}$", "stress"),
    "K11": (r"conductivity $K_{11}$", "conductivity"),
    "K22": (r"conductivity $K_{22}$", "conductivity"),
    "K33": (r"conductivity $K_{33}$", "conductivity"),
    "biot_22": (r"Biot coefficient $\alpha_{22}$", ""),
    "storage": (r"inverse Biot modulus $1/M_B$", "compliance"),
}
#: Those along the three axes, of which one is shown where they are alike.
ALONG_AXES = (("C_eff,1111", "C_eff,2222", "C_eff,3333"), ("K11", "K22", "K33"))


def _shown(solved: dict[str, Array]) -> dict[str, tuple[str, str]]:
    """Return label and quantity of the properties that are shown; those of three equal axes once."""
    left_out: set[str] = set()
    for first, *others in ALONG_AXES:
        left_out |= {name for name in others if np.allclose(solved[name], solved[first], rtol=SAME, atol=0)}
    return {name: shown for name, shown in PROPERTIES.items() if name not in left_out}


def _of_members(members: Dataset, rows: IntArray) -> dict[str, Array]:
    """Return the properties of the solved members (k,)."""
    found = members.responses()[rows]
    tangent = found.tangent
    assert tangent is not None
    assert tangent.stress_grad_u is not None
    assert tangent.fluid_volume_grad_u is not None
    assert tangent.fluid_volume_p is not None
    assert found.fluid_volume is not None
    assert found.conductivity is not None
    C = tangent.stress_grad_u
    return _properties(
        found.fluid_volume,
        (C + C.swapaxes(1, 2)) / 2,
        found.conductivity,
        tangent.fluid_volume_grad_u,
        tangent.fluid_volume_p,
    )


def _properties(porosity: Array, C: Array, K: Array, alpha: Array, storage: Array) -> dict[str, Array]:
    along, conducted = np.einsum("niiii->in", C), np.einsum("nii->in", K)
    shear = (C[:, 0, 1, 0, 1] + C[:, 0, 1, 1, 0]) / 2
    rows = [porosity, *along, shear, *conducted, alpha[:, 1, 1], storage]
    return dict(zip(PROPERTIES, rows, strict=True))


def _rows(points: Array, k: int) -> list[Array]:
    """Return parameters (points, m) over parameter ``k``: the others in the middle first, then at their ends."""
    m, count = points.shape
    middle = np.tile(points.mean(axis=1), (count, 1))
    middle[:, k] = points[k]
    others = [i for i in range(m) if i != k]
    found = [middle]
    ends = list(itertools.islice(itertools.product((0, -1), repeat=len(others)), OTHERS)) if others else []
    for corner in ends:
        rows = middle.copy()
        for i, end in zip(others, corner, strict=True):
            rows[:, i] = points[i, end]
        found.append(rows)
    return found


def _by_the_law(law: MacroLaw, surrogate: CellLaw, theta: Array) -> dict[str, Array]:
    """Return the properties (points,) of the undeformed cells with parameters ``theta``, by the surrogate."""
    at = LinearisedLaw(law).coefficients(MacroState.zeros(len(theta)).with_parameters(theta))
    cells = surrogate.undeformed(theta)
    assert cells is not None
    C, alpha = at.stiffness.reshape(-1, 3, 3, 3, 3), at.biot.reshape(-1, 3, 3)
    return _properties(cells.porosity, C, at.conductivity, alpha, at.storage)


#: An output whose values span less than this is zero up to the cell solver's tolerance and is not judged.
FLAT = 1e-9
#: A component that varies by less than this share of the largest of its tensor is zero up to the mesh, and not judged.
NOTHING = 1e-3
_SUBSCRIPTS = "₁₂₃"
#: Responses of a cell that have a unit.
_QUANTITIES = {"stress": "stress", "conductivity": "conductivity"}


def output_checks(
    dataset: Dataset, held_out: Dataset, surrogate: Surrogate, in_body: MacroState | None = None
) -> tuple[OutputCheck, ...]:
    """Compare the surrogate with the held-out states, for each predicted component that varies.

    ``in_body`` are the states of the body, which tell how much of a component's range the body uses.
    """
    used = None if in_body is None else prediction_of(surrogate, in_body, tangent=False)
    trained, tested = dataset.responses(), held_out.responses()
    training = trained.stable
    solved = np.flatnonzero(tested.stable)
    states = held_out.states()[solved]
    predicted = prediction_of(surrogate, states, tangent=False)
    outside = SampledRange.around(dataset.inputs, dataset.x()[training]).outside(states)
    checks = []
    for field, at, name, plain in _outputs():
        quantity = _QUANTITIES.get(field, "")
        every, exact, guess = (getattr(response, field) for response in (trained, tested, predicted))
        if every is None or exact is None or guess is None:
            continue
        # Some states have no conductivity of the deformed pore; its scale is that of the viscosity.
        taught, found = every[training][at], exact[solved][at]
        taught, known = taught[np.isfinite(taught)], np.isfinite(found)
        span = float(np.ptp(taught)) if len(taught) else 0.0
        flat = FLAT * (float(np.nanmax(np.abs(every[training]))) if field == "conductivity" else 1.0)
        if known.any() and span >= max(flat, _nothing(every[training], guess[at][known])):
            ends = None if used is None else _ends(getattr(used, field)[at])
            theta = None if states.parameters is None else states.parameters[known]
            shown = found[known], guess[at][known], span, outside[known]
            checks.append(OutputCheck(name, plain, *shown, quantity, ends, theta))
    return tuple(checks)


def _ends(values: Array) -> tuple[float, float] | None:
    """Return least and largest of the values that are finite."""
    known = values[np.isfinite(values)]
    return (float(known.min()), float(known.max())) if len(known) else None


def _nothing(taught: Array, guess: Array) -> float:
    """Return the span up to which a component is zero by symmetry, given all of its tensor and its predictions.

    It varies by the error of the mesh, which is no error of the surrogate. A mesh that breaks the symmetry by more is
    warned of.
    """
    largest = float(np.nanmax(np.ptp(taught.reshape(len(taught), -1), axis=0), initial=0.0))
    return (LARGEST_DEFECT if np.ptp(guess) <= FLAT * largest else NOTHING) * largest


def _outputs() -> Iterator[tuple[str, Any, str, str]]:
    """Yield field of the response, index of a component, and its name in mathematics and in plain text."""
    for i, j in np.ndindex(3, 3):
        name, plain = (
            rf"$\langle\nabla_Y u^1\rangle_{{{i + 1}{j + 1}}}$",
            f"⟨∇u¹⟩{_SUBSCRIPTS[i]}{_SUBSCRIPTS[j]}",
        )
        yield "mean_grad", (slice(None), i, j), name, plain
    for i, j in np.ndindex(3, 3):
        yield "stress", (slice(None), i, j), f"$P_{{E,{i + 1}{j + 1}}}$", f"P_E,{i + 1}{j + 1}"
    yield "fluid_volume", slice(None), r"$\varphi$", "fluid volume φ"
    for i, j in zip(*np.triu_indices(3), strict=True):
        plain = f"K{_SUBSCRIPTS[i]}{_SUBSCRIPTS[j]}"
        yield "conductivity", (slice(None), i, j), f"$K_{{{i + 1}{j + 1}}}$", plain

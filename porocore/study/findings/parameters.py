"""Undeformed cell over its parameters: solved members, and the law of the surrogate between them."""

from __future__ import annotations

import itertools

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.family.parameters import parameter_quantities
from porocore.cell.family.undeformed import parameter_kinds
from porocore.interfaces.law import CellLaw, MacroLaw
from porocore.macro.composition.linearised_law import LinearisedLaw
from porocore.report.words.parameters import FamilySummary, ParameterRange, RestField
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import Array, IntArray, MacroState

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

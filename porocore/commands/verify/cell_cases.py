"""Cases of the cell: identities, derivatives, channels, arrays of spheres and of cylinders."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from porocore.cell.cell import Cell, Geometry
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.geometry.drawn import CylinderArray, NoPores, SphereArray
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.cell.meshing.mesh import MeshSettings
from porocore.commands.crosscheck.bodies import AVERAGES
from porocore.commands.verify.case import Check, VerificationCase, observed_order, relative_check
from porocore.interfaces.cell import CellSolver
from porocore.macro.laws.linear import LinearCoefficients
from porocore.states import Array, CellResponse, MacroState
from porocore.testing.cell_checks import identities

#: What is checked holds on every mesh.
MESH, FINE = MeshSettings(size=0.2, fluid_size=0.14), MeshSettings(size=0.1, fluid_size=0.1)
LINEAR = MeshSettings(size=0.2, fluid_size=0.14, element="linear")
#: On the eighth, and without any symmetry on the whole cell.
DIAGONAL = np.diag([0.02, -0.08, 0.03]), 0.05
GENERAL = np.array([[0.03, 0.08, -0.02], [0.01, -0.06, 0.04], [0.0, 0.05, 0.02]]), 0.08
STEP = 1e-3
#: Of exact identities, which only round-off and the solver's tolerance disturb; and of differences.
EXACT, DIFFERENCE = 1e-8, 1e-6


def at_rest(solver: CellSolver, long: bool) -> Sequence[Check]:
    """Linear coefficients and conductivity of the paper's cell."""
    material = NeoHookean()
    cell, nu = Cell(mesh=FINE if long else MESH, material=material), material.poisson_ratio
    prepared = solver.prepare(cell)
    rest = solver.solve(prepared, MacroState.zeros(1)).response
    K = solver.conductivity(solver.prepare(Cell(mesh=MESH, symmetry="none")))
    assert rest.tangent is not None
    assert rest.tangent.mean_grad_grad_u is not None
    assert rest.fluid_volume is not None
    porosity = float(rest.fluid_volume[0])
    linear = LinearCoefficients.from_reference(rest, 1 - porosity, material, K)
    values = np.linalg.eigvalsh((K + K.T) / 2)
    return [
        Check("Q_ii = (1 − 2ν)(M_2222 + 2 M_2211)", identities.uniform_pressure(rest.tangent, nu), EXACT),
        Check("φ_f I − I:M = φ_f I − C:Q", identities.biot_forms(linear), EXACT),
        relative_check(
            "Biot modulus −1/tr Q > 0",
            identities.biot_modulus(linear, porosity, nu),
            linear.biot_modulus,
            EXACT,
            note="reference: K_s/(α − φ_f)",
        ),
        Check("cubic symmetry of M", identities.cubic_symmetry(rest.tangent.mean_grad_grad_u[0]), EXACT),
        Check("K = Kᵀ", identities.misfit(K.T, K), EXACT),
        relative_check("smallest over largest eigenvalue of K", 1.0, float(values[0] / values[-1]), EXACT),
    ]


def derivatives(state: tuple[Array, float], solver: CellSolver, prepared: Any) -> list[Check]:
    """Tangents against differences, and the potential behind them."""
    H, p = state
    rng = np.random.default_rng(1)
    dH, dp = rng.normal(size=(3, 3)), float(rng.normal())
    if np.abs(H - np.diag(np.diag(H))).max() == 0:
        dH = np.diag(np.diag(dH))
    at = solver.solve(prepared, MacroState.single(H, p)).response
    around = [solver.solve(prepared, s).response for s in identities.stencil_states(H, p, dH, dp, STEP)]
    differences = identities.difference_quotients(around, STEP)
    assert at.tangent is not None
    checks = [
        Check(
            "dW = P_E:dH − φ dp (Hill–Mandel)"
            if name == "potential"
            else f"tangent of {AVERAGES[name]} = slope",
            identities.misfit(differences[name], slope),
            DIFFERENCE,
        )
        for name, slope in identities.linear_changes(at, dH, dp).items()
    ]
    return [
        *checks,
        Check("∂P_E/∂H has major symmetry", identities.major_symmetry(at.tangent), EXACT),
        Check("∂P_E/∂p = −∂φ/∂H", identities.reciprocity(at.tangent), EXACT),
    ]


def diagonal(solver: CellSolver, long: bool) -> Sequence[Check]:
    """Check a diagonal state on the eighth, in the long form on the whole cell."""
    return derivatives(DIAGONAL, solver, solver.prepare(Cell(mesh=MESH, symmetry="none" if long else "auto")))


def general(solver: CellSolver, long: bool) -> Sequence[Check]:
    """Check a general state on the whole cell, with a rotation."""
    prepared = solver.prepare(Cell(mesh=MESH if long else LINEAR))
    H, p = GENERAL
    R = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()

    def solve(H: Array) -> CellResponse:
        return solver.solve(prepared, MacroState.single(H, p), tangent=False).response

    turned = identities.objectivity(solve(H), solve(R @ (np.eye(3) + H) - np.eye(3)), R)
    objective = [Check(f"objectivity of {AVERAGES[name]}", error, EXACT) for name, error in turned.items()]
    return [*objective, *derivatives(GENERAL, solver, prepared)]


def homogeneous(state: tuple[Array, float], solver: CellSolver, long: bool) -> Sequence[Check]:
    """⟨∇u¹⟩ = 0, P_E = P(I + H) whatever p is, no fluid, and K = 0."""
    cell = Cell(
        geometry=NoPores(kind="no-pores"),
        material=NeoHookean(),
        mesh=MeshSettings(size=0.15 if long else 0.3),
    )
    prepared = solver.prepare(cell)
    H, p = state
    found = solver.solve(prepared, MacroState.single(H, p)).response
    assert found.stress is not None
    assert found.fluid_volume is not None
    stress = NeoHookean().stress((np.eye(3) + H)[None])[0]
    return [
        Check("⟨∇u¹⟩ = 0, of H", float(np.abs(found.mean_grad).max() / np.abs(H).max()), EXACT),
        Check("P_E = P(I + H)", identities.misfit(found.stress[0], stress), EXACT),
        Check("φ = 0", float(abs(found.fluid_volume[0])), EXACT),
        Check("K = 0", float(np.abs(solver.conductivity(prepared)).max()), EXACT),
    ]


HOMOGENEOUS = VerificationCase(
    "homogeneous",
    "the material's own law",
    "cell solver",
    {
        "diagonal H": partial(homogeneous, (np.diag([0.1, -0.2, 0.05]), 0.3)),
        "general H": partial(homogeneous, (np.array([[0.1, 0.2, 0], [0, -0.15, 0.05], [0, 0, 0.1]]), 0.3)),
    },
)
IDENTITIES = VerificationCase(
    "identities",
    "Dehghani & Zilian 2022; reciprocity, objectivity, Hill–Mandel",
    "cell solver",
    {"at rest": at_rest, "diagonal H": diagonal, "general H": general},
)


#: Drag F = 6π μ a 𝒦 U of a sphere of radius a in a simple cubic array of concentration c (Zick & Homsy, table 2).
SPHERES = {0.027: 2.008, 0.064: 2.810, 0.125: 4.292, 0.216: 7.442, 0.343: 15.4, 0.45: 28.1, np.pi / 6: 42.1}
#: Drag F/(μ U) of a cylinder in a square array of concentration c (Sangani & Acrivos, table 1).
CYLINDERS = {
    0.05: 15.56,
    0.1: 24.83,
    0.2: 51.53,
    0.3: 102.90,
    0.4: 217.89,
    0.5: 532.55,
    0.6: 1763,
    0.7: 13520,
    0.75: 126300,
}
#: Of spheres that touch: it fills the gap where no mesh resolves it, and where next to nothing flows; short and long.
NECKS = 0.15, 0.1
#: Elements are not larger than this, and than 0.8 radii, on the coarsest mesh of a sequence.
COARSE = 0.2
ALLOWED = 0.01


def conductivities(
    solver: CellSolver, geometry: Geometry, radius: float, levels: Sequence[float], *, flat: bool = False
) -> tuple[list[float], list[Array]]:
    """Mean element sizes, and K μ_f (3, 3), on meshes finer than the coarsest by the factors ``levels``.

    The size is the edge of a cube of the elements' mean volume, or with ``flat`` of a square of their mean area: near
    narrow gaps and small radii the elements are smaller than the setting.
    """
    sizes, found = [], []
    for level in levels:
        mesh = MeshSettings(size=COARSE, fluid_size=min(COARSE, 0.8 * radius) / level)
        cell = Cell(geometry=geometry, viscosity=1.0, mesh=mesh)
        found.append(solver.conductivity(solver.prepare(cell)))
        count = len(cell.make_mesh("fluid", "eighth").cells)
        sizes.append((geometry.porosity / count) ** (1 / 2 if flat else 1 / 3))
    return sizes, found


def _levels(count: int, ratio: float = 1.4, first: int = 0) -> list[float]:
    return [ratio**i for i in range(first, first + count)]


def _check(quantity: str, reference: float, sizes: list[float], values: list[float], note: str = "") -> Check:
    order = observed_order(sizes, values) if len(values) > 3 else None
    return relative_check(quantity, reference, values[-1], ALLOWED, order=order, note=note)


def channel(radius: float, solver: CellSolver, long: bool) -> Sequence[Check]:
    """K μ = π r⁴/8, and nothing across."""
    geometry = OrthogonalChannels(radius=radius, axes="z")
    levels = _levels(5 if long else 3)
    _, K = conductivities(solver, geometry, radius, levels)
    exact = np.pi * radius**4 / 8
    values = [float(k[2, 2]) for k in K]
    order = observed_order([1 / level for level in levels], values, exact)
    return [
        relative_check("K μ along it", exact, values[-1], 1e-3, order=order),
        Check("K across it, of that along it", float(abs(K[-1][0, 0]) / values[-1]), 1e-5),
    ]


def spheres(concentration: float, solver: CellSolver, long: bool) -> Sequence[Check]:
    """K μ = 1/(6π a 𝒦)."""
    radius = min((3 * concentration / (4 * np.pi)) ** (1 / 3), 0.5)
    touching = radius > 0.499
    neck = NECKS[long] if touching else 0.0
    geometry = SphereArray(kind="sphere-array", radius=0.5 if touching else radius, neck=neck)
    narrow = concentration > 0.4
    if touching or not long:
        levels = _levels(1, first=int(long or not narrow))
    else:
        levels = _levels(4 if narrow else 5)
    sizes, K = conductivities(solver, geometry, radius, levels)
    note = f"touching: a neck of radius {neck} fills the gap" if touching else ""
    reference = 1 / (6 * np.pi * radius * SPHERES[concentration])
    return [_check("K μ", reference, sizes, [float(k[0, 0]) for k in K], note)]


def cylinders(concentration: float, solver: CellSolver, long: bool) -> Sequence[Check]:
    """K μ = 1/F across the axis."""
    radius = float(np.sqrt(concentration / np.pi))
    geometry = CylinderArray(kind="cylinder-array", radius=radius)
    narrow = concentration > 0.72
    count = 6 - narrow if long else 4 - 2 * narrow
    sizes, K = conductivities(solver, geometry, radius, _levels(count), flat=True)
    values = [float(k[0, 0] + k[1, 1]) / 2 for k in K]
    checks = [_check("K μ across the axis", 1 / CYLINDERS[concentration], sizes, values)]
    if narrow:
        reference = 2**1.5 / (9 * np.pi) * (1 - 2 * radius) ** 2.5
        note = "leading term of lubrication theory for a narrow gap, for comparison"
        checks.append(
            relative_check("K μ across the axis, lubrication", reference, values[-1], ALLOWED, note=note)
        )
    return checks


def _items(solve: Callable[..., Sequence[Check]], keys: Sequence[float], name: str) -> dict[str, Any]:
    return {f"{name} = {key:.4g}": partial(solve, key) for key in keys}


CHANNEL = VerificationCase("channel", "Hagen–Poiseuille", "cell solver", _items(channel, (0.15, 0.25), "r"))
SPHERE_ARRAY = VerificationCase(
    "spheres",
    "Zick & Homsy 1982, J. Fluid Mech. 115, table 2",
    "cell solver",
    _items(spheres, tuple(SPHERES), "c"),
)
CYLINDER_ARRAY = VerificationCase(
    "cylinders",
    "Sangani & Acrivos 1982, Int. J. Multiphase Flow 8, table 1",
    "cell solver",
    _items(cylinders, tuple(CYLINDERS), "c"),
)

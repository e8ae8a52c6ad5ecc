"""Cells of other materials than the neo-Hookean: small strains, fibres and mirrors, scaling, laminates."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import TypeAdapter

from porocore import MacroState, Status
from porocore.cell.cell import Cell
from porocore.cell.equilibrium.responses import respond
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.geometry.drawn import NoPores
from porocore.cell.materials.hyperelastic import AnyMaterial, Composite, MooneyRivlin, NeoHookean
from porocore.cell.meshing.mesh import MeshSettings
from porocore.cell.stability.map import _check_symmetric
from porocore.commands.fields.points import PointFields
from porocore.core.inputs import InputSpace
from porocore.errors import ConfigurationError
from porocore.interfaces.surrogate import TrainingSet
from porocore.macro.laws.closure import MeanGradientClosure, PotentialClosure
from porocore.macro.laws.linear import LinearCellLaw, LinearCoefficients
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing.cell_checks import identities
from porocore_fem_skfem.cell_solver import SkfemCellSolver
from porocore_fem_skfem.solid import SkfemSolid

make = TypeAdapter(AnyMaterial).validate_python
MESH = MeshSettings(size=0.3, fluid_size=0.3, element="linear")
#: Wide channels, so that elements may be large.
WIDE = OrthogonalChannels(radius=0.38)
SOLVER = SkfemCellSolver()
REST, ZERO = MacroState.zeros(1), np.zeros((3, 3))
NU = 0.35
LIKE_NEO_HOOKEAN = MooneyRivlin(
    kind="mooney-rivlin",
    c10=0.7 / (4 * (1 + NU)),
    c01=0.3 / (4 * (1 + NU)),
    bulk_modulus=1 / (3 * (1 - 2 * NU)),
)
FIBRES = make(
    {
        "kind": "expression",
        "energy": "c*(I1*J**(-2/3) - 3) + k*(J - 1)**2/2 + f*(I4 - 1)**2",
        "parameters": {"c": 0.2, "k": 1.0, "f": 0.2},
        "directions": [[1, 0, 0]],
    }
)
HGO = {"kind": "holzapfel-gasser-ogden", "shear_modulus": 0.3, "bulk_modulus": 1.0, "k1": 0.5, "k2": 1.0}
CROSSED = make({**HGO, "directions": [[1, 1, 0], [1, -1, 0]]})
OBLIQUE = make({**HGO, "directions": [[1, 1, 0]]})
OGDEN = make(
    {
        "kind": "ogden",
        "bulk_modulus": 1.0,
        "terms": [{"mu": 0.25, "alpha": 2.6}, {"mu": -0.05, "alpha": -1.5}],
    }
)


def solved(material, H=ZERO, p=0.0, **cell):
    cell = Cell(**{"geometry": WIDE, "material": material, "mesh": MESH, **cell})
    return SOLVER.solve_one(SOLVER.prepare(cell), H, p)


def test_the_same_moduli_at_small_strains_give_the_same_cell_at_rest():
    one, other = solved(NeoHookean(poisson_ratio=NU)), solved(LIKE_NEO_HOOKEAN)
    for name in ("mean_grad_grad_u", "mean_grad_p", "stress_grad_u", "fluid_volume_p"):
        assert identities.misfit(getattr(other.tangent, name), getattr(one.tangent, name)) < 1e-10
    assert identities.uniform_pressure(other.tangent, NU) < 1e-8


@pytest.mark.parametrize("material", [LIKE_NEO_HOOKEAN, OGDEN, FIBRES, CROSSED], ids=lambda m: m.kind)
def test_the_linear_limit(material):
    """C_eff from the elasticity of the solid is the slope of the cell's stress, and small loads follow it."""
    rest = solved(material)
    linear = LinearCoefficients.from_reference(rest, 1 - float(rest.fluid_volume[0]), material, np.eye(3))
    assert identities.misfit(linear.stiffness, rest.tangent.stress_grad_u[0]) < 1e-9
    assert identities.biot_forms(linear) < 1e-9
    H, p = 1e-6 * np.array([[0.3, 0.2, 0.0], [0.2, -1.0, 0.1], [0.0, 0.1, 0.5]]), 1e-6
    small = solved(material, H, p)
    stress = np.einsum("ijkl,kl->ij", linear.stiffness, H) - linear.biot * p
    assert identities.misfit(small.stress[0], stress) < 2e-5
    assert (
        identities.misfit(
            small.mean_grad[0], LinearCellLaw(rest).predict(MacroState.single(H, p)).mean_grad[0]
        )
        < 2e-5
    )


def test_without_pores_the_cell_is_the_solid():
    geometry, H = (
        NoPores(kind="no-pores"),
        np.array([[0.1, 0.05, 0.0], [0.0, -0.08, 0.02], [0.03, 0.0, 0.06]]),
    )
    for material in (FIBRES, OBLIQUE, OGDEN):
        found = solved(material, H, 0.1, geometry=geometry)
        assert identities.misfit(found.stress[0], material.stress(np.eye(3) + H)) < 1e-10
        assert identities.misfit(found.tangent.stress_grad_u[0], material.tangent(np.eye(3) + H)) < 1e-9
        assert np.abs(found.mean_grad).max() < 1e-12


@pytest.mark.parametrize("material", [CROSSED, FIBRES, OGDEN], ids=lambda m: m.kind)
def test_the_eighth_and_the_whole_cell_agree(material):
    """Crossed families of fibres keep the mirrors, though the axes are no longer alike."""
    H, p = np.diag([0.06, -0.05, 0.02]), 0.05
    eighth, whole = solved(material, H, p), solved(material, H, p, symmetry="none")
    assert (eighth.status, whole.status) == (Status.converged, Status.converged)
    for name in ("stress", "mean_grad", "potential", "fluid_volume"):
        assert identities.misfit(getattr(eighth, name), getattr(whole, name)) < 1e-9
    for name in ("stress_grad_u", "mean_grad_grad_u", "mean_grad_p"):
        assert identities.misfit(getattr(eighth.tangent, name), getattr(whole.tangent, name)) < 1e-8


def test_derivatives_are_slopes_with_fibres():
    # A long toe and a short step: third derivatives jump at the ends of the toe, which differences feel.
    prepared = SOLVER.prepare(
        Cell(geometry=WIDE, material=OBLIQUE.model_copy(update={"toe": 0.3}), mesh=MESH)
    )
    H, p, step = np.array([[0.08, 0.03, 0.0], [0.05, -0.04, 0.02], [0.0, 0.01, 0.03]]), 0.05, 2e-4
    dH, dp = np.random.default_rng(1).normal(size=(3, 3)), 0.4
    at = SOLVER.solve(prepared, MacroState.single(H, p)).response
    around = [
        SOLVER.solve(prepared, s, tangent=False).response
        for s in identities.stencil_states(H, p, dH, dp, step)
    ]
    differences = identities.difference_quotients(around, step)
    for name, slope in identities.linear_changes(at, dH, dp).items():
        assert identities.misfit(differences[name], slope) < 1e-6, name
    assert identities.major_symmetry(at.tangent) < 1e-9
    assert identities.reciprocity(at.tangent) < 1e-9


def test_fibres_off_the_axes_are_solved_on_the_whole_cell():
    prepared = SOLVER.prepare(Cell(geometry=WIDE, material=OBLIQUE, mesh=MESH))
    assert prepared.solid_for(np.diag([0.0, -0.1, 0.0])) is prepared.whole
    assert (
        SOLVER.prepare(Cell(geometry=WIDE, material=CROSSED, mesh=MESH)).solid_for(ZERO).mesh.domain
        == "eighth"
    )
    with pytest.raises(ConfigurationError, match="expected fibres along the axes"):
        _check_symmetric(prepared, np.zeros(10), np.zeros(10))


def test_axes_that_fibres_tell_apart_are_not_exchanged():
    solid = SOLVER.prepare(Cell(geometry=WIDE, material=OGDEN, mesh=MESH)).eighth
    assert solid.exchanged_axes(solid.iterate_at(ZERO, 0.0)) == ("xy", "xz", "yz")
    solid = SOLVER.prepare(Cell(geometry=WIDE, material=CROSSED, mesh=MESH)).eighth
    assert solid.exchanged_axes(solid.iterate_at(ZERO, 0.0)) == ()


def test_a_cell_with_fibres_is_not_taken_for_cubic():
    """Fibres that bear tension only leave its stiffness at rest cubic."""
    C = np.array(solved(CROSSED).tangent.stress_grad_u[0])
    assert identities.cubic_symmetry(C) < 1e-8
    assert Cell(geometry=WIDE, material=CROSSED).point_group.name == "4/mmm"
    assert Cell(geometry=WIDE, material=OBLIQUE).point_group.name == "mmm"
    assert Cell(geometry=WIDE).point_group.name == "m-3m"


@pytest.mark.parametrize("h", [0.05, 0.36])
def test_units_do_not_matter(h):
    """All moduli and the pressure times 400: the same deformation, also where the wall touches itself."""
    factor, H = 400.0, np.diag([0.0, -h, 0.0])
    large = LIKE_NEO_HOOKEAN.model_copy(
        update={name: factor * getattr(LIKE_NEO_HOOKEAN, name) for name in ("c10", "c01", "bulk_modulus")}
    )
    one, other = (
        solved(m, H, p, geometry=OrthogonalChannels())
        for m, p in ((LIKE_NEO_HOOKEAN, 0.02), (large, factor * 0.02))
    )
    assert (one.status == other.status).all()
    assert (h > 0.2) == (one.status[0] == Status.contact)
    assert identities.misfit(other.mean_grad, one.mean_grad) < 1e-8
    assert identities.misfit(other.stress, factor * one.stress) < 1e-8
    assert identities.misfit(other.tangent.stress_grad_u, factor * one.tangent.stress_grad_u) < 1e-6


def test_local_fields_take_the_stress_of_their_material():
    cell = Cell(geometry=WIDE, material=CROSSED, mesh=MESH)
    H = np.diag([0.05, -0.03, 0.02])
    solution = SOLVER.solve(SOLVER.prepare(cell), MacroState.single(H), fields=True)
    points = PointFields.from_cell_field(cell, solution.fields[0])
    assert identities.misfit(points.mean(points.stress), solution.response.stress[0]) < 1e-9
    assert float(points.energy.max()) == pytest.approx(float(solution.response.extrema.energy[0]), rel=1e-9)


def test_the_mean_gradient_closure_with_fibres():
    rest = solved(FIBRES)
    phi_s = 1 - float(rest.fluid_volume[0])
    law = ClosedLaw(LinearCellLaw(rest), MeanGradientClosure(phi_s, FIBRES, np.eye(3)))
    H, step = np.diag([0.03, -0.05, 0.01]), 1e-6
    memory, grad_p = law.initial(1), np.zeros((1, 3))
    at = law.respond(MacroState.single(H), grad_p, memory)
    mean = LinearCellLaw(rest).predict(MacroState.single(H)).mean_grad[0]
    assert identities.misfit(at.stress[0], phi_s * FIBRES.stress(np.eye(3) + H + mean / phi_s)) < 1e-12
    ahead, back = (
        law.respond(MacroState.single(H + s * step * np.diag([1.0, 0, 0])), grad_p, memory).stress
        for s in (1, -1)
    )
    assert identities.misfit((ahead - back)[0] / (2 * step), at.tangent.stress_grad_u[0, :, :, 0, 0]) < 1e-8


def test_what_is_learned_of_a_cell_with_fibres():
    """Solved states, a polynomial for W, both closures: at a state between the solved ones it is the cell."""
    prepared, space = (
        SOLVER.prepare(Cell(geometry=WIDE, material=FIBRES, mesh=MESH)),
        InputSpace(("H22", "p"), (-0.06, 0.0), (0.04, 0.04)),
    )
    grid = np.array([(h, p) for h in np.linspace(-0.06, 0.04, 4) for p in np.linspace(0.0, 0.04, 3)])
    states = space.scatter(grid)
    rest = SOLVER.solve(prepared, REST).response
    data = TrainingSet(
        states, SOLVER.solve(prepared, states).response, space, rest, "made up", {}, prepared.cell.point_group
    )
    surrogate = PolynomialSurrogate().fit(data, seed=0)
    between = space.scatter(np.array([[-0.035, 0.013]]))
    cell = SOLVER.solve(prepared, between).response
    phi_s, grad_p = 1 - float(rest.fluid_volume[0]), np.zeros((1, 3))
    for closure, tolerance in ((PotentialClosure, 1e-4), (MeanGradientClosure, 0.2)):
        law = ClosedLaw(surrogate, closure(phi_s, FIBRES, np.eye(3)))
        stress = law.respond(between, grad_p, law.initial(1)).stress
        assert identities.misfit(stress, cell.stress) < tolerance


# ---- several materials ---------------------------------------------------------------------------


def laminate(one, other):
    """Two layers across z of a cell without pores, at rest."""
    mesh = Cell(geometry=NoPores(kind="no-pores"), mesh=MESH).make_mesh("solid", "whole")
    upper = mesh.points[mesh.cells[:, :4]].mean(axis=1)[:, 2] > 0
    mesh = replace(mesh, regions=upper.astype(np.int64), region_names=("lower", "upper"))
    placed = Composite({"lower": one, "upper": other}).on(mesh)
    problem = SkfemSolid(mesh, placed, degree=mesh.quadrature_degree, solver="auto")
    return respond(problem, problem.iterate_at(ZERO, 0.0), tangent=True)


def test_a_laminate_has_the_stiffness_of_backus():
    """Backus 1962, J. Geophys. Res. 67, eq. 13."""
    one, other = (
        NeoHookean(poisson_ratio=0.1),
        make({"kind": "mooney-rivlin", "c10": 2, "c01": 1, "bulk_modulus": 9}),
    )
    rest = laminate(one, other)
    lam, mu = np.array([[one.lam, 9 - 2 / 3 * 6], [one.mu, 6.0]])
    M = lam + 2 * mu
    C = rest.tangent.stress_grad_u[0]
    across = 1 / np.mean(1 / M)
    coupling = np.mean(lam / M)
    assert C[2, 2, 2, 2] == pytest.approx(across, rel=1e-9)
    assert C[0, 0, 2, 2] == pytest.approx(coupling * across, rel=1e-9)
    assert C[0, 0, 0, 0] == pytest.approx(np.mean(M - lam**2 / M) + coupling**2 * across, rel=1e-9)
    assert C[0, 2, 0, 2] == pytest.approx(1 / np.mean(1 / mu), rel=1e-9)
    assert C[0, 1, 0, 1] == pytest.approx(np.mean(mu), rel=1e-9)


def test_the_linear_limit_of_several_materials_is_the_slope_of_the_cell():
    one = NeoHookean(poisson_ratio=0.3)
    porous = solved(one)
    alone = Composite({"solid": one})
    phi_s = 1 - float(porous.fluid_volume[0])
    several = LinearCoefficients.from_reference(porous, phi_s, alone, np.eye(3))
    single = LinearCoefficients.from_reference(porous, phi_s, one, np.eye(3))
    assert identities.misfit(several.stiffness, single.stiffness) < 1e-9
    assert identities.misfit(several.biot_of_stress, single.biot_of_stress) < 1e-9
    bare = replace(porous, tangent=replace(porous.tangent, stress_grad_u=None))
    with pytest.raises(ValueError, match="the cell solver does not provide them"):
        LinearCoefficients.from_reference(bare, phi_s, alone, np.eye(3))


def test_two_regions_of_one_material_are_one_material():
    H = np.array([[0.03, 0.08, -0.02], [0.01, -0.06, 0.04], [0.0, 0.05, 0.02]])
    mesh = Cell(geometry=WIDE, mesh=MESH).make_mesh("solid", "whole")
    upper = mesh.points[mesh.cells[:, :4]].mean(axis=1)[:, 2] > 0.1
    split = replace(mesh, regions=upper.astype(np.int64), region_names=("lower", "upper"))
    placed = Composite({"lower": OGDEN, "upper": OGDEN}).on(split)
    one, several = (
        SkfemSolid(m, material, degree=1, solver="auto").iterate_at(H, 0.1)
        for m, material in ((mesh, OGDEN), (split, placed))
    )
    np.testing.assert_allclose(several.residual, one.residual, rtol=0, atol=1e-14)
    np.testing.assert_allclose(several.tangent, one.tangent, rtol=0, atol=1e-13)
    assert several.energy == pytest.approx(one.energy, rel=1e-14)

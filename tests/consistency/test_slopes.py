"""Slopes by parameters of the cell against difference quotients on the same mesh moved, for each backend.

The mesh moves along a smooth field by hand, and the material changes with Poisson's ratio.
"""

from __future__ import annotations

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.conductivity.pore import Pore
from porocore.cell.equilibrium.responses import respond, respond_with_slopes
from porocore.cell.equilibrium.slopes import ExplicitDependence, hessian_slopes_at_rest
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.cell.meshing.mesh import MeshSettings, block, tiled
from porocore.core.tensors import cofactor, determinant
from tests.helpers.moved_cell import equilibrium, moved, quotient, velocity

NU = 0.35
COARSE = {"size": 0.35, "fluid_size": 0.25}
NO_CONTACT = {"kind": "none"}
PRESSED = np.diag([0.02, -0.15, 0.01])
SHEARED = np.array([[0.02, 0.06, -0.02], [0.03, -0.15, 0.04], [0.0, 0.05, 0.02]])
NAMES = ("potential", "stress", "fluid_volume", "mean_grad")


def by_poisson_ratio(F):
    """∂Ψ/∂ν and ∂P/∂ν of the neo-Hookean solid at F (..., 3, 3)."""
    mu = -1 / (2 * (1 + NU) ** 2)
    lam = (1 + 2 * NU**2) / ((1 + NU) * (1 - 2 * NU)) ** 2
    J = determinant(F)
    log_J = np.log(J)
    energy = mu / 2 * ((F * F).sum(axis=(-2, -1)) - 3) - mu * log_J + lam / 2 * log_J**2
    return energy, mu * F + ((lam * log_J - mu) / J)[..., None, None] * cofactor(F)


def lowered(F):
    """The same by −ν, which changes W as the motion does; else both nearly cancel."""
    energy, stress = by_poisson_ratio(F)
    return -energy, -stress


def cell_of(nu=NU, **settings):
    element = settings.pop("element", "quadratic-curved")
    mesh = MeshSettings(element=element, **COARSE)
    return Cell(mesh=mesh, **{"material": NeoHookean(poisson_ratio=nu), "contact": NO_CONTACT, **settings})


def close(found, expected, within=1e-8):
    np.testing.assert_allclose(found, expected, rtol=0, atol=within * np.abs(expected).max())


def held_against_differences(solver, mesh, H, p, nu_changes=True, within=1e-8, step=1e-3, **settings):
    """Compare the slopes of a state by one number, which moves the mesh and lowers ν, with differences by it."""
    V = velocity(mesh)
    dependence = ExplicitDependence(velocity=V, material=lowered if nu_changes else None)
    solid, at = equilibrium(solver, cell_of(**settings), mesh, H, p)
    response = respond_with_slopes(solid, at, [dependence], tangent=True)[0]

    def averages(d):
        cell = cell_of(NU - d if nu_changes else NU, **settings)
        found = respond(*equilibrium(solver, cell, moved(mesh, d, V), H, p), tangent=False)
        return tuple(getattr(found, name)[0] for name in NAMES)

    for name, expected in zip(NAMES, quotient(averages, step), strict=True):
        close(getattr(response.slopes, name)[0, ..., 0], expected, within)
    return response


@pytest.mark.parametrize("element", ["quadratic-curved", pytest.param("linear", marks=pytest.mark.slow)])
def test_slopes_of_the_solid_on_the_eighth(load, cell_solver, element):
    mesh = cell_of(element=element).make_mesh("solid", "eighth")
    held_against_differences(load("cell solver", cell_solver), mesh, PRESSED, 0.05, element=element)


@pytest.mark.slow
@pytest.mark.parametrize("element", ["quadratic-curved", "quadratic-straight", "linear"])
def test_slopes_of_the_solid_on_the_sheared_whole_cell(load, cell_solver, element):
    mesh = cell_of(element=element).make_mesh("solid", "whole")
    held_against_differences(load("cell solver", cell_solver), mesh, SHEARED, 0.05, element=element)


@pytest.mark.slow
def test_slopes_of_a_supercell_are_those_of_its_cell(load, cell_solver):
    solver, cell = load("cell solver", cell_solver), cell_of()
    one = cell.make_mesh("solid", "whole")
    V, periods = velocity(one), (2, 1, 1)
    found = []
    for mesh, field in ((one, V), (block(one, periods), tiled(one, V, periods))):
        solid, at = equilibrium(solver, cell, mesh, SHEARED, 0.05)
        dependence = ExplicitDependence(velocity=field, material=by_poisson_ratio)
        found.append(respond_with_slopes(solid, at, [dependence], tangent=True)[0].slopes)
    for name in (*NAMES, "porosity"):
        close(getattr(found[1], name), getattr(found[0], name), 1e-9)


def test_slope_of_the_porosity_is_that_of_the_fluid_volume_at_rest(load, cell_solver):
    mesh = cell_of().make_mesh("solid", "eighth")
    solid, rest = equilibrium(load("cell solver", cell_solver), cell_of(), mesh, np.zeros((3, 3)), 0.0)
    of_shape = [ExplicitDependence(velocity=velocity(mesh))]
    slopes = respond_with_slopes(solid, rest, of_shape, tangent=True)[0].slopes
    close(slopes.porosity, slopes.fluid_volume, 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("domain", ["eighth", "whole"])
def test_slopes_of_the_second_derivatives_at_rest(load, cell_solver, domain):
    solver, mesh = load("cell solver", cell_solver), cell_of().make_mesh("solid", domain)
    solid, V = solver.solid(cell_of(), mesh), velocity(mesh)
    C_slope = elasticity_by_poisson_ratio().reshape(1, 1, 3, 3, 3, 3)
    found = hessian_slopes_at_rest(solid, [ExplicitDependence(velocity=V, elasticity=C_slope)])[..., 0]
    close(found, found.T, 1e-11)

    def hessian(d):
        there = equilibrium(solver, cell_of(NU + d), moved(mesh, d, V), np.zeros((3, 3)), 0.0)
        t = respond(*there, tangent=True).tangent
        side = t.stress_p.reshape(9, 1)
        return np.block([[t.stress_grad_u.reshape(9, 9), side], [side.T, -t.fluid_volume_p.reshape(1, 1)]])

    close(found, quotient(hessian))


def test_slopes_at_rest_obey_the_identities_of_biot(load, cell_solver):
    """∂φ/∂H = I − C_d:I/(3 K_s) and ∂φ/∂p = (tr ∂φ/∂H/3 − φ_f)/K_s, whatever the pores' shape, so their slopes too."""
    solver, mesh = load("cell solver", cell_solver), cell_of().make_mesh("solid", "eighth")
    of_shape = [ExplicitDependence(velocity=velocity(mesh))]
    solid, rest = equilibrium(solver, cell_of(), mesh, np.zeros((3, 3)), 0.0)
    slopes = hessian_slopes_at_rest(solid, of_shape)[..., 0]
    porosity = respond_with_slopes(solid, rest, of_shape, tangent=True)[0].slopes.porosity[0, 0]
    drained, K_s = slopes[:9, :9].reshape(3, 3, 3, 3), 1 / (3 * (1 - 2 * NU))
    biot = -slopes[9, :9].reshape(3, 3)
    close(biot, -np.einsum("ijkk->ij", drained) / (3 * K_s), 1e-10)
    close(-slopes[9, 9], (np.trace(biot) / 3 - porosity) / K_s, 1e-10)


def elasticity_by_poisson_ratio():
    """∂C/∂ν of E = 1."""
    mu = -1 / (2 * (1 + NU) ** 2)
    lam = (1 + 2 * NU**2) / ((1 + NU) * (1 - 2 * NU)) ** 2
    one = np.eye(3)
    swapped = np.einsum("ik,jl->ijkl", one, one) + np.einsum("il,jk->ijkl", one, one)
    return lam * np.einsum("ij,kl->ijkl", one, one) + mu * swapped


@pytest.mark.slow
@pytest.mark.parametrize(
    ("domain", "H"),
    [
        ("eighth", np.diag([0.01, -0.26, -0.005])),
        pytest.param(
            "whole",
            np.diag([0.01, -0.26, -0.005]) + 0.02 * np.eye(3)[[1, 0, 2]],
        ),
    ],
)
def test_slopes_in_contact(load, cell_solver, domain, H):
    """The energy of contact counts; its second derivatives jump, and so the differences are less exact."""
    response = held_against_differences(
        load("cell solver", cell_solver),
        cell_of().make_mesh("solid", domain),
        H,
        0.02,
        nu_changes=False,
        within=1e-5,
        step=1e-5,
        contact={"kind": "frictionless"},
    )
    assert response.extrema.contact_share[0] > 0


@pytest.mark.slow
@pytest.mark.parametrize("domain", ["eighth", "whole"])
def test_slopes_of_the_conductivity(load, cell_solver, domain):
    """Of the undeformed pore, and of the deformed one, whose wall moves with the mesh and with u¹."""
    solver, cell, H = load("cell solver", cell_solver), cell_of(), PRESSED if domain == "eighth" else SHEARED
    solid, fluid = (cell.make_mesh(phase, domain) for phase in ("solid", "fluid"))
    V, W = velocity(solid), 1.1 * velocity(fluid)

    def pore(d):
        return Pore(solver.fluid(moved(fluid, d, W)), (solid, fluid))

    K, slopes = pore(0.0).undeformed_slopes(W[None])
    close(K, pore(0.0).undeformed)
    close(slopes[..., 0], quotient(lambda d: pore(d).undeformed))
    problem, at = equilibrium(solver, cell, solid, H, 0.05)
    dependence = ExplicitDependence(velocity=V, material=by_poisson_ratio)
    u_slopes = respond_with_slopes(problem, at, [dependence], tangent=True)[1]
    K_ref, _, slopes = pore(0.0).deformed_slopes(H, at.displacement, solid, V[None], W[None], u_slopes)

    def deformed(d):
        problem, at = equilibrium(solver, cell_of(NU + d), moved(solid, d, V), H, 0.05)
        return pore(d).deformed(H, at.displacement, problem.mesh)[0]

    close(K_ref, deformed(0.0))
    close(slopes[..., 0], quotient(deformed))


def test_slopes_of_a_single_channel(load, cell_solver):
    """K = π r⁴/8 and φ_f = π r²: dK/dr = π r³/2 and dφ_f/dr = 2 π r."""
    r, geometry = 0.25, {"kind": "orthogonal-channels", "axes": "x", "radius": 0.25}
    cell = cell_of(geometry=geometry)
    solver, fluid, solid = (
        load("cell solver", cell_solver),
        *(cell.make_mesh(f, "eighth") for f in ("fluid", "solid")),
    )
    W = fluid.points * [0.0, 1 / r, 1 / r]
    K_slope = Pore(solver.fluid(fluid)).undeformed_slopes(W[None])[1][0, 0, 0]
    assert K_slope == pytest.approx(np.pi * r**3 / 2, rel=1e-3)
    problem, rest = equilibrium(solver, cell, solid, np.zeros((3, 3)), 0.0)
    dependence = ExplicitDependence(velocity=radial(solid, r))
    porosity = respond_with_slopes(problem, rest, [dependence], tangent=True)[0].slopes.porosity[0, 0]
    assert porosity == pytest.approx(2 * np.pi * r, rel=1e-3)


def radial(solid, r):
    """V of the solid around a channel along x: radial and 1 at the wall, 0 on the far faces."""
    _, y, z = solid.points.T
    rho = np.hypot(y, z)
    to_face = 0.5 / np.maximum(np.maximum(y, z) / rho, 1e-300)
    V = np.stack([0 * y, y / rho, z / rho], axis=1) * ((to_face - rho) / (to_face - r))[:, None]
    return np.where(solid.on_mirrors, 0.0, V)

"""Forces on surfaces that share nodes, in states of which they are known."""

import numpy as np
import pytest

from porocore.macro.body.kinds import Box, make_body
from porocore.macro.body.mesh import BodyMesh, Facets
from porocore.macro.body.mesh_file import read_body
from porocore.macro.boundary.reactions import Support, shares
from porocore.testing.macro_checks.bodies import write_tetrahedra

SIZE = (1.0, 2.0, 1.5)
#: A rotation about no axis in particular.
TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
TURN = TURN * np.sign(np.linalg.det(TURN))
CLAMPED = np.eye(3)


@pytest.fixture(params=["hexahedra", "tetrahedra"])
def mesh(request, tmp_path):
    if request.param == "hexahedra":
        return make_body(Box(size=SIZE, elements=(2, 3, 2), grading=(1.5, 1.0, 0.5)))
    write_tetrahedra(tmp_path / "box.msh", Box(size=SIZE, elements=(2, 2, 2)), bend=0.05)
    return read_body(tmp_path / "box.msh", None, 1.0)


def turned(mesh):
    return BodyMesh(mesh.points @ TURN.T, mesh.cells, mesh.surfaces)


def normal_of(name):
    return ("-+".index(name[1]) * 2 - 1) * np.eye(3)["xyz".index(name[0])]


def supports(mesh, held, Q=CLAMPED):
    """``held``: name → directions of the unturned box."""
    return {
        name: Support(Facets(mesh, mesh.surfaces[name]), np.atleast_2d(directions) @ Q.T)
        for name, directions in held.items()
    }


def reactions(mesh, stress, names):
    """Of the nodes of surfaces under one stress (3, 3): ∫ P N φ dS."""
    total = np.zeros((len(mesh.points), 3))
    for name in names:
        facets = Facets(mesh, mesh.surfaces[name])
        reference = mesh.element.facet
        local = np.einsum("fqi,q,qa->fai", facets.normals, reference.weights, reference.values)
        np.add.at(total, facets.nodes, local @ stress.T)
    return np.concatenate([total.ravel(), np.zeros(len(mesh.p_nodes))])


def totals(mesh, held, stress, Q=CLAMPED):
    field = np.broadcast_to(stress, (len(mesh.cells), 3, 3))
    at_nodes = reactions(mesh, stress, held)
    return {
        name: share.total(at_nodes, field) for name, share in shares(mesh, supports(mesh, held, Q)).items()
    }


def area(name):
    return np.prod(SIZE) / SIZE["xyz".index(name[0])]


PLANES = {name: normal_of(name) for name in ("x-", "y-", "z+")}
#: What is held: independent directions at every node; a clamped face beside planes; two clamped faces.
HELD = {
    "planes": PLANES,
    "clamped": {**PLANES, "y-": CLAMPED},
    "edge": {"y-": CLAMPED, "x-": CLAMPED, "z-": normal_of("z-")},
}


@pytest.mark.parametrize("held", HELD)
def test_under_one_stress_each_surface_bears_what_it_does_alone(mesh, held):
    """P N of its area, to round-off, also where directions are shared and where the box is turned."""
    principal = np.diag([-0.3, -1.0, 0.4])
    for body, Q in ((mesh, np.eye(3)), (turned(mesh), TURN)):
        found = totals(body, HELD[held], Q @ principal @ Q.T, Q)
        needed = [share.needs_field for share in shares(body, supports(body, HELD[held], Q)).values()]
        assert any(needed) == (held != "planes")
        for name, force in found.items():
            expected = Q @ (principal @ normal_of(name)) * area(name)
            np.testing.assert_allclose(force, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("held", HELD)
def test_parts_add_up_and_do_not_depend_on_the_order(mesh, held):
    """Of any reactions within what is held, and of any stress."""
    rng = np.random.default_rng(0)
    field = rng.normal(size=(len(mesh.cells), 3, 3))
    directions = supports(mesh, HELD[held])
    at_nodes = np.zeros(mesh.size)
    for support in directions.values():
        nodes = np.unique(support.facets.nodes)
        forces = rng.normal(size=(len(nodes), 3)) @ (support.directions.T @ support.directions)
        at_nodes[(3 * nodes[:, None] + np.arange(3)).ravel()] += forces.ravel()
    found = {name: s.total(at_nodes, field) for name, s in shares(mesh, directions).items()}
    whole = at_nodes[: mesh.n_u].reshape(-1, 3).sum(axis=0)
    np.testing.assert_allclose(sum(found.values()), whole, atol=1e-10)
    other = dict(reversed(directions.items()))
    for name, share in shares(mesh, other).items():
        np.testing.assert_allclose(share.total(at_nodes, field), found[name], atol=1e-12)
    for name, support in directions.items():
        if len(support.directions) == 1:
            n = support.directions[0]
            assert np.abs(found[name] - n * (n @ found[name])).max() < 1e-15 * np.abs(whole).max() + 1e-15


def test_oblique_planes_that_are_not_at_right_angles_share_a_reaction_in_one_way():
    """R = a n₁ + b n₂ whatever the areas and the stress are."""
    mesh = make_body(Box(size=SIZE, elements=(1, 1, 1)))
    n = np.array([[1.0, 0, 0], [0.6, 0.8, 0]])
    parts = {name: Support(Facets(mesh, mesh.surfaces[name]), n[[i]]) for i, name in enumerate(("x-", "y-"))}
    edge = np.flatnonzero((mesh.points[:, 0] == 0) & (mesh.points[:, 1] == 0))
    at_nodes = np.zeros(mesh.size)
    at_nodes[(3 * edge[:, None] + np.arange(3)).ravel()] = np.tile(0.7 * n[0] - 0.2 * n[1], len(edge))
    field = np.random.default_rng(1).normal(size=(1, 3, 3))
    found = shares(mesh, parts)
    np.testing.assert_allclose(found["x-"].total(at_nodes, field), 0.7 * len(edge) * n[0], atol=1e-13)
    np.testing.assert_allclose(found["y-"].total(at_nodes, field), -0.2 * len(edge) * n[1], atol=1e-13)


def test_fluid_of_one_flux_enters_each_surface_by_its_area(mesh):
    flux = np.array([0.3, -1.0, 0.4])
    names = ("x-", "y-", "z+")
    drains = {name: Support(Facets(mesh, mesh.surfaces[name]), np.ones((1, 1))) for name in names}
    at_nodes = np.zeros(mesh.size)
    for name in names:
        facets, reference = Facets(mesh, mesh.surfaces[name]), mesh.element.facet
        local = np.einsum("fqi,q,qa,i->fa", facets.normals, reference.weights, reference.corner_values, -flux)
        places = np.searchsorted(mesh.p_nodes, facets.nodes[:, : local.shape[1]])
        np.add.at(at_nodes, mesh.n_u + places, local)
    field = np.broadcast_to(-flux, (len(mesh.cells), 3))
    for name, share in shares(mesh, drains, fluid=True).items():
        assert share.total(at_nodes, field)[0] == pytest.approx(
            -flux @ normal_of(name) * area(name), abs=1e-12
        )

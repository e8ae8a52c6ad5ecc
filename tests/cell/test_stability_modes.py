"""Classes of perturbations of the eighth against blocks of whole cells; their lowest eigenvalues against dense ones."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from porocore.cell.cell import Cell
from porocore.cell.contact.wall_contact import ContactSettings
from porocore.cell.equilibrium.discrete import lumped_mass
from porocore.cell.equilibrium.responses import follow, respond
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.cell.meshing.mesh import MeshSettings
from porocore.cell.stability.modes import (
    FAMILIES,
    WAVES,
    folded,
    lowest_eigenvalues,
    lowest_mode,
    lowest_of_class,
    negative_pivots,
)
from porocore.cell.symmetry import (
    CLASSES,
    bloch_classes,
    exchanged_axes,
    held_displacements,
    images,
    odd_axes,
)
from porocore.states import Status
from tests.helpers.stability_blocks import block

SkfemSolid = pytest.importorskip("porocore_fem_skfem.solid").SkfemSolid


def cell_of(radius):
    return Cell(
        geometry=OrthogonalChannels(radius=radius),
        mesh=MeshSettings(size=0.2, fluid_size=0.2, element="linear"),
        contact=ContactSettings(kind="none"),
    )


#: Radius, H, p. One stable; two beyond the onset of period two; slender walls beyond that of period one.
STATES = {
    "stable": (0.25, (0.01, -0.05, 0.02), 0.01),
    "pressed": (0.25, (0.0, -0.28, 0.0), 0.0),
    "sucked": (0.25, (0.0, 0.0, 0.0), -0.4),
    "slender": (0.4, (0.0, -0.4, 0.0), 0.0),
}


def solid_of(mesh):
    return SkfemSolid(mesh, NeoHookean(), degree=1, solver="auto")


@pytest.fixture(scope="module")
def states():
    """Name → solid of the eighth, and its equilibrium."""
    found = {}
    for name, (radius, H, p) in STATES.items():
        solid = solid_of(cell_of(radius).make_mesh("solid", "eighth"))
        outcome = follow(solid, solid.iterate_at(np.zeros((3, 3)), 0.0), np.diag(H), p, 1e-11)
        assert outcome.status == Status.converged, name
        found[name] = solid, outcome.equilibrium
    return found


def whole_mesh(name):
    return cell_of(STATES[name][0]).make_mesh("solid", "whole")


def unfolded(eighth, here, mesh):
    """The same state on another mesh."""
    there, signs = folded(mesh.points, "")
    distance, node = cKDTree(eighth.mesh.points).query(there)
    assert distance.max() < 1e-8
    solid = solid_of(mesh)
    same = solid.iterate_at(here.H, here.p, signs * here.displacement[node])
    assert np.linalg.norm(same.residual) < 1e-8
    return solid, same


def test_there_are_eight_classes_of_each_wave_vector():
    found = bloch_classes()
    assert tuple(found) == WAVES
    assert sorted(found["000"]) == sorted(CLASSES)
    names = [name for names in found.values() for name in names]
    assert len(set(names)) == 64
    for wave, classes in found.items():
        for name in classes:
            differ = set(odd_axes(name, 0)) ^ set(odd_axes(name, 1))
            assert differ == {axis for axis, k in zip("xyz", wave, strict=True) if k == "1"}
    assert sorted(wave for waves in FAMILIES.values() for wave in waves) == sorted(WAVES)


def test_the_classes_share_the_components_of_the_block_between_them():
    """Free unknowns: those of all classes of a block are as many as the block's, but for its three translations."""
    mesh, whole = cell_of(0.25).make_mesh("solid", "eighth"), cell_of(0.25).make_mesh("solid", "whole")
    names = [name for names in bloch_classes().values() for name in names]
    free = {name: 3 * len(mesh.points) - held_displacements(mesh, name).sum() for name in names}
    for counts, waves in (((1, 1, 1), ["000"]), ((2, 1, 1), ["000", "100"]), ((2, 2, 2), WAVES)):
        nodes = block(whole, counts).periodic_class.max() + 1
        assert sum(free[name] for wave in waves for name in bloch_classes()[wave]) == 3 * nodes - 3


@pytest.mark.parametrize("name", STATES)
def test_the_classes_of_period_one_are_the_whole_cell(states, name):
    eighth, here = states[name]
    solid, same = unfolded(eighth, here, block(whole_mesh(name), (1, 1, 1)))
    expected = negative_pivots(eighth, here, ["000"])["000"]
    assert solid.negative_pivots(same, "") == expected
    assert (expected > 0) == (name == "slender")


@pytest.mark.parametrize(
    ("name", "counts", "waves"),
    [
        ("stable", (2, 2, 1), ["000", "100", "010", "110"]),
        ("pressed", (2, 2, 1), ["000", "100", "010", "110"]),
        ("sucked", (2, 1, 2), ["000", "100", "001", "101"]),
        ("slender", (2, 1, 1), ["000", "100"]),
        ("slender", (1, 2, 1), ["000", "010"]),
        ("slender", (1, 2, 2), ["000", "010", "001", "011"]),
        pytest.param("pressed", (2, 2, 2), WAVES, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_the_classes_of_period_two_are_a_block_of_cells(states, name, counts, waves):
    eighth, here = states[name]
    solid, same = unfolded(eighth, here, block(whole_mesh(name), counts))
    expected = sum(negative_pivots(eighth, here, waves).values())
    assert solid.negative_pivots(same, "") == expected
    assert (expected > 0) == (name != "stable")


def test_the_response_counts_modes_that_no_load_excites(states):
    """Those of the slender cell are odd under one mirror only, where the loads are odd under none or two."""
    eighth, here = states["slender"]
    counts = {parity: eighth.negative_pivots(here, parity) for parity in CLASSES}
    assert {parity for parity, count in counts.items() if count} == {"x", "z"}
    response = respond(eighth, here, tangent=True)
    assert response.status[0] == Status.unstable
    assert response.extrema.negative_pivots[0] == sum(counts.values()) == 2
    assert respond(eighth, here, tangent=False).extrema.negative_pivots[0] == 2


def test_equal_axes_share_their_classes(states):
    expected = {"stable": (), "pressed": ("xz",), "sucked": ("xy", "xz", "yz"), "slender": ("xz",)}
    assert images("x|xy", ["xz"]) == {"x|xy", "z|yz"}
    assert images("x", ["xy", "yz"]) == {"x", "y", "z"}
    for name, (eighth, here) in states.items():
        assert exchanged_axes(eighth.mesh, here.H, here.displacement) == expected[name]
        every = {
            wave: sum(eighth.negative_pivots(here, parity) for parity in names)
            for wave, names in bloch_classes().items()
        }
        assert negative_pivots(eighth, here) == every


def test_a_bent_state_shares_nothing(states):
    eighth, here = states["sucked"]
    u = here.displacement.copy()
    u[len(u) // 2, 1] += 1e-4
    assert exchanged_axes(eighth.mesh, here.H, u) == ()


@pytest.mark.parametrize("parity", ["", "x", "y", "xyz", "xy|x", "|yz", "x|"])
def test_the_lowest_eigenvalue_against_a_dense_solution(states, parity):
    for name in ("stable", "pressed", "slender"):
        eighth, here = states[name]
        mode = lowest_of_class(eighth, here, parity)
        K, mass = eighth.tangent(here, parity).toarray(), eighth.masses(parity)
        M = np.diag(mass)
        if parity in ("x", "y"):
            # Each field stands for those that differ by a translation, and its mass is the least of theirs.
            along = np.zeros((len(eighth.mesh.points), 3))
            along[:, "xyz".index(parity)] = lumped_mass(eighth.mesh)
            a = eighth.reduced(along, parity)
            M -= np.outer(a, a) / lumped_mass(eighth.mesh).sum()
        inverse = np.linalg.eigvals(np.linalg.solve(K, M)).real
        expected = (1 / inverse[np.abs(inverse) > 1e-9]).min()
        assert mode.value == pytest.approx(expected, rel=1e-6)
        if parity not in ("x", "y"):  # Sylvester's law with a shift on either side
            assert eighth.negative_pivots(here, parity, mode.value - 1e-3) == 0
            assert eighth.negative_pivots(here, parity, mode.value + 1e-3) >= 1


def test_every_class_that_can_move_as_a_whole_is_held_once():
    mesh = cell_of(0.25).make_mesh("solid", "eighth")
    held = {name: held_displacements(mesh, name) for names in bloch_classes().values() for name in names}
    # A component that is held at one node only is held against a translation; any other is held on a plane.
    once = {(name, i) for name, here in held.items() for i in range(3) if here[:, i].sum() == 1}
    assert once == {("x", 0), ("y", 1), ("z", 2)}
    assert all(here.any(axis=0).all() for here in held.values())


def test_eigenvalues_of_a_block_are_those_of_its_waves(states):
    eighth, here = states["pressed"]
    of_wave = lowest_eigenvalues(eighth, here, ["000", "010", "001", "011"])
    least = min(of_wave.values())
    assert least == of_wave["011"] < 0
    solid, same = unfolded(eighth, here, block(whole_mesh("pressed"), (1, 2, 2)))
    assert solid.negative_pivots(same, "", least - 1e-3) == 0
    assert solid.negative_pivots(same, "", least + 1e-3) == 1


@pytest.mark.parametrize("wave", ["011", "100", pytest.param("111", marks=pytest.mark.slow)])
def test_a_mode_unfolds_to_one_of_the_block(states, wave):
    """Rayleigh's quotient of the unfolded mode is the eigenvalue; a shift by one cell changes its sign along k = π."""
    eighth, here = states["pressed"]
    mode = lowest_mode(eighth, here, wave)
    assert mode.periods == tuple(1 + int(k) for k in wave)
    mesh = block(whole_mesh("pressed"), mode.periods)
    solid, same = unfolded(eighth, here, mesh)
    u = mode.at(mesh.points)
    assert np.abs(u).max() == pytest.approx(1.0)
    for axis, k in enumerate(wave):
        shifted = mode.at(mesh.points + np.eye(3)[axis])
        np.testing.assert_allclose(shifted, -u if k == "1" else u, atol=1e-12)
    copies = np.bincount(mesh.periodic_class)[mesh.periodic_class]
    # The held node of the block moves in the mode, so the block is looked at from there.
    x = solid.reduced((u - u[mesh.periodic_class == 0][0]) / copies[:, None], "")
    energy = x @ (solid.tangent(same, "") @ x)
    assert energy / (lumped_mass(mesh) @ (u * u).sum(axis=1)) == pytest.approx(mode.value, rel=1e-6)
    with pytest.raises(ValueError, match="no mirror image"):
        mode.at(np.array([[0.01, 0.2, 0.3]]))


def test_the_lowest_eigenvalue_hardly_depends_on_the_mesh():
    """Of the undeformed cell; that of linear elements lies above, and comes down with their size."""
    meshes = {
        "coarse": MeshSettings(size=0.25, element="quadratic-curved"),
        "fine": MeshSettings(size=0.17, element="quadratic-curved"),
        "linear": MeshSettings(size=0.14, element="linear"),
        "finer linear": MeshSettings(size=0.08, element="linear"),
    }
    values = {}
    for name, settings in meshes.items():
        mesh = Cell(mesh=settings).make_mesh("solid", "eighth")
        solid = SkfemSolid(mesh, NeoHookean(), degree=mesh.quadrature_degree, solver="auto")
        values[name] = lowest_of_class(solid, solid.iterate_at(np.zeros((3, 3)), 0.0), "|xy").value
    exact = values["fine"]
    assert values["coarse"] == pytest.approx(exact, rel=0.01)
    assert exact < values["finer linear"] < values["linear"]
    assert values["finer linear"] - exact < 0.6 * (values["linear"] - exact)


def test_the_mass_is_the_volume_and_positive():
    for element in ("linear", "quadratic-straight", "quadratic-curved"):
        mesh = Cell(mesh=MeshSettings(size=0.2, element=element)).make_mesh("solid", "eighth")
        mass = lumped_mass(mesh)
        assert (mass > 0).all()
        corners = mesh.points[mesh.cells[:, :4]]
        volume = np.linalg.det(corners[:, 1:] - corners[:, :1]).sum() / 6
        assert mass.sum() == pytest.approx(volume, rel=1e-12 if element != "quadratic-curved" else 0.03)

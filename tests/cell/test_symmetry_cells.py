"""Solved cells whose symmetry is not that of the cube, and what is learned of them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import qmc

from porocore.cell.cell import Cell
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.materials.hyperelastic import HolzapfelGasserOgden
from porocore.cell.meshing.mesh import MeshSettings
from porocore.core.inputs import InputSpace
from porocore.core.tensors import CUBIC
from porocore.errors import SolveError
from porocore.interfaces.surrogate import TrainingSet
from porocore.macro.laws.closure import PotentialClosure
from porocore.macro.laws.direct import DirectCellLaw
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.problem import TimePlan
from porocore.sampling.execution import CellPool
from porocore.states import MacroState
from porocore.study.run.composition import prepare_cell
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing.cell_checks.identities import cubic_symmetry
from porocore.testing.synthetic.response import confined_column
from porocore_fem_skfem.macro import SkfemMacroSolver
from tests.helpers.cube_symmetry import symmetry_error

pytestmark = pytest.mark.slow

FIBRES = HolzapfelGasserOgden(
    kind="holzapfel-gasser-ogden",
    shear_modulus=0.3,
    bulk_modulus=1.0,
    k1=0.5,
    k2=1.0,
    directions=((1, 1, 0),),
)


def training_set(cell, space, count, conductivity="piola"):
    """States that fill the box, with its corners; K at rest; and what solves the cell at other states."""
    solver, prepared = prepare_cell("skfem", {}, cell, conductivity)
    d = len(space)
    corners = np.array(np.meshgrid(*[[0.0, 1.0]] * d)).reshape(d, -1).T
    unit = np.concatenate([corners, qmc.Halton(d, seed=1).random(count)])
    low, high = np.array(space.lower), np.array(space.upper)
    states = space.scatter(low + (high - low) * unit)
    responses = solver.solve(prepared, states).response
    rest = solver.solve(prepared, MacroState.zeros(1)).response
    K = solver.conductivity(prepared)
    if conductivity == "deformed":
        rest = replace(rest, conductivity=K[None], min_fluid_jacobian=np.ones(1))
    good = np.flatnonzero(responses.stable)
    data = TrainingSet(states[good], responses[good], space, rest, "made up", {}, cell.point_group)
    return data, K, lambda at: solver.solve(prepared, at).response


def test_crossing_channels_of_three_widths_are_not_taken_for_cubic(tmp_path):
    """Channels of 0.75 × 0.25 that cross cyclically: stiffness and K at rest are those of a cube, the cell is m-3."""
    x, y, z = np.indices((8, 8, 8))
    pore = ((y < 6) & (z < 2)) | ((z < 6) & (x < 2)) | ((x < 6) & (y < 2))
    np.save(tmp_path / "cell.npy", np.where(pore, 0, 1))
    cell = Cell(
        geometry=Voxels(kind="voxels", path=str(tmp_path / "cell.npy")),
        mesh=MeshSettings(size=0.17, fluid_size=0.17, element="linear"),
    )
    assert cell.point_group.name == "m-3"
    names = ("H11", "H22", "H33", "p")
    space = InputSpace.from_ranges({name: (-0.09, 0.09) for name in names[:3]} | {"p": (0.0, 0.05)})
    data, K, solve = training_set(cell, space, 32, "deformed")
    assert cubic_symmetry(np.array(data.reference.tangent.stress_grad_u[0])) < 1e-6
    assert np.abs(K - K[0, 0] * np.eye(3)).max() < 1e-6 * K[0, 0]
    at = space.scatter(np.array([[0.0, -0.08, 0.0, 0.0], [0.0, 0.08, 0.0, 0.0], [0.05, -0.05, 0.03, 0.01]]))
    true = solve(at)
    wrong_by = {}
    for group in (cell.point_group, CUBIC):
        found = PolynomialSurrogate().fit(replace(data, symmetry=group), seed=0).predict(at)
        ratio = np.diagonal(found.conductivity, axis1=1, axis2=2) / np.diagonal(
            true.conductivity, axis1=1, axis2=2
        )
        wrong_by[group.name] = np.abs(ratio - 1).max(), np.abs(found.potential - true.potential).max()
    assert wrong_by["m-3"][0] < 0.005
    assert wrong_by["m-3m"][0] > 0.15
    assert wrong_by["m-3"][1] < 0.3 * wrong_by["m-3m"][1]


OBLIQUE = Cell(
    geometry=OrthogonalChannels(radius=0.38),
    material=FIBRES.model_copy(update={"k1": 5.0, "toe": 0.1}),
    mesh=MeshSettings(size=0.3, fluid_size=0.3, element="linear"),
)
UNIAXIAL = {"H22": (-0.01, 0.12), "p": (-0.005, 0.005)}
SHEARED = {"H11": (-0.005, 0.005), "H22": (-0.005, 0.045), "H12": (-0.025, 0.01), "p": (-0.005, 0.002)}
COARSE = OBLIQUE.model_copy(update={"mesh": MeshSettings(size=0.35, fluid_size=0.35, element="linear")})
SIDES = {"x-": {"normal": 0}, "x+": {"normal": 0}, "z-": {"normal": 0}, "z+": {"normal": 0}}
PULLED = confined_column(
    1,
    load=0.004,
    size=(1, 1, 1),
    boundary=SIDES | {"y-": {"displacement": (0, 0, 0)}, "y+": {"traction": (0, 1, 0), "pressure": 0}},
    time={"ramp_increments": 1, "ramp_step": 20.0, "step": 4.0, "end": 24.0, "profiles": (24.0,)},
    newton={"tolerance": 1e-6},
)


@pytest.fixture(scope="module")
def oblique():
    """Fibres along [1, 1, 0], learned from H22 and p; K, and what solves the cell."""
    return training_set(OBLIQUE, InputSpace.from_ranges(UNIAXIAL), 12)


def test_a_shear_stress_across_the_inputs_is_learned(oblique):
    """P12 under H22, which does no work on any input; with the mirrors of a cube there would be none."""
    data, _, solve = oblique
    assert data.symmetry.name == "mmm"
    at = data.inputs.scatter(np.array([[0.1, 0.0], [0.06, 0.002]]))
    true = solve(at).stress
    found = PolynomialSurrogate().fit(data, seed=0).predict(at)
    without = PolynomialSurrogate().fit(replace(data, symmetry=CUBIC), seed=0).predict(at)
    assert not without.stress[:, 0, 1].any()
    assert not without.flagged.any()
    assert np.abs(true[:, 0, 1]).max() > 0.003
    assert np.abs(found.stress - true).max() < 0.1 * np.abs(true[:, 0, 1]).max()


def test_a_solved_cell_turns_with_its_group_alone():
    """On a mesh with the symmetry of the cube, with fibres along [1, 1, 0]."""
    solver, prepared = prepare_cell("skfem", {}, OBLIQUE)
    at = MacroState(np.array([[[0.01, 0.03, 0.01], [0.0, 0.05, 0.02], [0.0, 0.0, 0.02]]]), np.array([0.002]))

    def law(states):
        return replace(solver.solve(prepared, states).response, conductivity=None)

    for Q in CUBIC.matrices:
        worst = symmetry_error(law, at, Q)["potential"]
        assert worst < 1e-8 if Q in OBLIQUE.point_group else worst > 1e-5, Q


def test_a_column_of_a_cell_without_mirrors_settles_as_its_cells_do():
    """Between smooth walls, pulled: the corners of its top part, as in direct FE², once what moves is sampled."""
    data, K, _ = training_set(COARSE, InputSpace.from_ranges(SHEARED), 12)
    solver, porosity = SkfemMacroSolver(), float(data.reference.fluid_volume[0])
    closure = PotentialClosure(1 - porosity, COARSE.solid, K)
    prepared = solver.prepare(PULLED)

    def corners(cells):
        solution = solver.solve(prepared, ClosedLaw(cells, closure))
        rows = [np.flatnonzero((solution.points == (x, 1, 0)).all(axis=1))[0] for x in (0, 1)]
        return solution.profiles[-1].u[rows, 1]

    with CellPool(prepare_cell, ("skfem", {}, COARSE), workers=1) as pool:
        true = corners(DirectCellLaw(pool, data.reference, "column"))
    sampled = corners(PolynomialSurrogate().fit(data, seed=0))
    straight = corners(PolynomialSurrogate().fit(replace(data, symmetry=CUBIC), seed=0))
    assert true[0] > 1.1 * true[1]
    assert np.abs(sampled / true - 1).max() < 0.01
    # As if the cell had the mirrors of a cube.
    assert np.abs(straight / true - 1).max() > 0.1


def test_without_the_shear_among_the_inputs_the_failure_names_it(oblique):
    """The shear stress is learned, but the stiffness against shear is that at rest, and the law becomes unstable.

    Under smaller loads Newton's method may find another equilibrium of such a law, far away and flagged.
    """
    data, K, _ = oblique
    closure = PotentialClosure(float(1 - data.reference.fluid_volume[0]), OBLIQUE.solid, K)
    time = TimePlan(ramp_increments=8, ramp_step=1.0, smallest_step=0.5, step=1.0, end=9.0, profiles=())
    solver = SkfemMacroSolver()
    prepared = solver.prepare(PULLED.model_copy(update={"load": 0.04, "time": time}))
    with pytest.raises(
        SolveError, match=r"points are flagged, one of them for H12 = .*, which was not sampled"
    ):
        solver.solve(prepared, ClosedLaw(PolynomialSurrogate().fit(data, seed=0), closure))

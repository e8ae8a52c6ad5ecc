"""Bodies in two dimensions: exact states, closed forms, and the same bodies in three dimensions, on both backends."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from porocore.commands.verify.linear_cases import isotropic_law, unconfined_errors
from porocore.errors import ConfigurationError
from porocore.interfaces.sensitivities import (
    BoundaryChange,
    CellParameterChange,
    InitialPressureChange,
    LoadChange,
)
from porocore.macro.analytic import UnconfinedCompression
from porocore.macro.problem import MacroProblem, body_mesh
from porocore.plugins.registry import registry
from porocore.testing.synthetic.response import mean_gradient_law
from tests.consistency.test_gradients import compare
from tests.consistency.test_sensitivities import check
from tests.helpers.anisotropic_cell import anisotropic_law
from tests.helpers.flat_geometry import write_dome
from tests.helpers.sensitivity_bodies import law

#: Long enough for all pressure to vanish.
DRAINED = {"end": 4e6, "step": 1e6, "ramp_increments": 2, "ramp_step": 0.1, "profiles": ()}
TRANSIENT = {"end": 1.0, "step": 0.3, "ramp_increments": 2, "ramp_step": 0.1, "profiles": ()}
TUBE = {"kind": "axisymmetric", "radius": 0.5, "inner_radius": 0.1, "height": 0.8, "grading": (2, 1)}
PLUG = {"kind": "axisymmetric", "radius": 0.5, "height": 0.8}


@pytest.fixture(params=["skfem", pytest.param("dolfinx", marks=pytest.mark.slow)])
def make_solver(request):
    pytest.importorskip(request.param)
    return registry().get("macro solver", request.param)


def problem(body, boundary, time=DRAINED, **more):
    data = {"body": body, "boundary": boundary, "time": time, "newton": {"tolerance": 1e-12}}
    return MacroProblem.model_validate(data | more)


def solve(make_solver, given, law, **options):
    solver = make_solver(**options)
    return solver.solve(solver.prepare(given), law)


# ---- exact states --------------------------------------------------------------------------------


@pytest.mark.parametrize("body", [TUBE, PLUG], ids=["tube", "plug"])
def test_a_homogeneous_deformation_of_finite_strain_is_exact(make_solver, body):
    """u_r = 0.1 r, u_y = −0.1 y, whose H is that of three dimensions; forces are the stress times the areas."""
    free = {"pressure": 0}
    boundary = {
        "side": {"displacement": (0.05, None, None), **free},
        "y-": {"normal": 0, **free},
        "y+": {"displacement": (None, -0.08, None), **free},
    }
    if "inner_radius" in body:
        boundary["inner"] = {"displacement": (0.01, None, None), **free}
    given = problem(body | {"elements": (3, 2)}, boundary)
    found = solve(make_solver, given, law())
    last = found.profiles[-1]
    np.testing.assert_allclose(
        last.grad_u, np.broadcast_to(np.diag([0.1, -0.1, 0.1]), last.grad_u.shape), atol=1e-13
    )
    P = last.stress[0]
    assert P[0, 0] == pytest.approx(P[2, 2], rel=1e-10)
    area = np.pi * (0.25 - 0.01 * ("inner_radius" in body))
    assert found.reactions["y+"][-1] == pytest.approx([0, area * P[1, 1], 0], abs=1e-12)
    assert found.reactions["side"][-1] == pytest.approx([2 * np.pi * 0.5 * 0.8 * P[0, 0], 0, 0], abs=1e-12)
    assert body_mesh(given).weights.sum() == pytest.approx(0.8 * area, rel=1e-14)


@pytest.mark.parametrize("load", ["side", "y+"])
def test_a_pressure_that_follows_deforms_it_as_in_three_dimensions(make_solver, load):
    boundary = {"y-": {"normal": 0}, "side": {"pressure": 0}}
    boundary[load] = boundary.get(load, {}) | {"follower": 0.05}
    plug = solve(make_solver, problem(PLUG | {"elements": (2, 2)}, boundary), law())
    quarter = {"kind": "quarter-cylinder", "radius": 0.5, "height": 0.8, "elements": (1, 1, 1)}
    boundary |= {"x-": {"normal": 0}, "z-": {"normal": 0}}
    whole = solve(make_solver, problem(quarter, boundary), law())
    scale = np.abs(whole.profiles[-1].grad_u).max()
    for each in (plug, whole):
        H = each.profiles[-1].grad_u
        np.testing.assert_allclose(H, np.broadcast_to(H[0], H.shape), atol=1e-8 * scale)
    np.testing.assert_allclose(plug.profiles[-1].grad_u[0], whole.profiles[-1].grad_u[0], atol=1e-8 * scale)


@pytest.mark.parametrize("order", [0, 2], ids=["triangles", "quadrilaterals"])
def test_a_pressure_all_around_half_a_ball_from_a_file_deforms_it_alike(make_solver, order, tmp_path):
    """Curved elements of no regular pattern; the reaction is the pressure times the deformed base."""
    body = {"kind": "file", "path": str(write_dome(tmp_path, order)), "flat": "axisymmetric"}
    if not order:
        body["size"] = 0.15
    given = problem(body, {"base": {"normal": 0}, "dome": {"follower": 0.02, "pressure": 0}})
    found = solve(make_solver, given, law())
    H = found.profiles[-1].grad_u
    np.testing.assert_allclose(H, np.broadcast_to(H[0, 0, 0] * np.eye(3), H.shape), atol=1e-9)
    area = np.pi * (0.5 * (1 + H[0, 0, 0])) ** 2
    assert found.reactions["base"][-1, 1] == pytest.approx(0.02 * area, rel=1e-8)


def test_plane_strain_is_a_layer_of_three_dimensional_elements(make_solver):
    boundary = {
        "x-": {"normal": 0},
        "y-": {"displacement": (0, 0, None)},
        "x+": {"pressure": 0, "traction": (0.01, 0.005, 0)},
        "y+": {"follower": 0.03},
    }
    more = {"probes": {"inside": (0.3, 0.4, 0)}, "body_force": (0.01, -0.02, 0), "time": TRANSIENT}
    flat = {"kind": "plane-strain", "size": (1, 0.8), "elements": (3, 2), "grading": (2, 1), "depth": 0.3}
    box = {"kind": "box", "size": (1, 0.8, 0.3), "elements": (3, 2, 1), "grading": (2, 1, 1)}
    found = solve(make_solver, problem(flat, boundary, **more), law())
    layer = boundary | {"z-": {"normal": 0}, "z+": {"normal": 0}}
    whole = solve(make_solver, problem(box, layer, **more), law())
    np.testing.assert_allclose(found.probes["inside"], whole.probes["inside"], atol=1e-13)
    for name in ("x-", "y-"):
        np.testing.assert_allclose(found.reactions[name], whole.reactions[name], atol=1e-13)
    np.testing.assert_allclose(found.history.drained, whole.history.drained, atol=1e-13)
    np.testing.assert_allclose(found.inflow["x+"], whole.inflow["x+"], atol=1e-13)
    for a, b in zip(found.profiles, whole.profiles, strict=True):
        np.testing.assert_allclose(a.stress, b.stress, atol=1e-13)
    assert np.abs(whole.probes["inside"]).max() > 1e-3


def test_fields_regions_and_material_axes_are_those_of_a_layer(make_solver):
    """Axes that turn about z, beside a stiffer region."""
    more = {
        "fields": {"porosity": "0.3 + 0.05*x", "axes": {"about": (0, 0, 1), "angle": "30 + 20*x"}},
        "regions": {"low": {"kind": "layer", "below": 0.4, "fields": {"porosity": "0.25 + 0.02*y"}}},
        "time": TRANSIENT,
    }
    boundary = {
        "x-": {"normal": 0},
        "y-": {"displacement": (0, 0, None)},
        "x+": {"pressure": 0},
        "y+": {"traction": (0.005, -0.02, 0)},
    }
    given = anisotropic_law("porosity")
    flat = {"kind": "plane-strain", "size": (1, 0.8), "elements": (2, 2), "depth": 0.5}
    box = {"kind": "box", "size": (1, 0.8, 0.5), "elements": (2, 2, 1)}
    layer = boundary | {"z-": {"normal": 0}, "z+": {"normal": 0}}
    found, whole = (
        solve(make_solver, problem(body, held, **more), given)
        for body, held in ((flat, boundary), (box, layer))
    )
    np.testing.assert_allclose(found.profiles[-1].stress, whole.profiles[-1].stress, atol=1e-12)
    np.testing.assert_allclose(found.history.drained, whole.history.drained, atol=1e-12)
    np.testing.assert_array_equal(found.element_cells.region, whole.element_cells.region)
    assert np.ptp(whole.profiles[-1].stress, axis=0).max() > 1e-3


# ---- closed forms --------------------------------------------------------------------------------


def test_lame(make_solver):
    """A thick cylinder in plane strain under a pressure inside [Timoshenko & Goodier, Theory of Elasticity, §28]."""
    lame, shear, a, b, p = 1.2, 0.8, 0.1, 0.5, 1e-3
    constant = p * a**2 / (b**2 - a**2)

    def radial(r):
        return constant * (r / (2 * (lame + shear)) + b**2 / (2 * shear * r))

    boundary = {
        "inner": {"traction": (p, 0, 0), "pressure": 0},
        "side": {"pressure": 0},
        "y-": {"normal": 0},
        "y+": {"normal": 0},
    }
    errors, given = [], isotropic_law(lame, shear, 0.7, 0.1, 1.0)
    places = {"inside": (a, 0.2, 0), "middle": (0.23, 0.2, 0), "outside": (b, 0.3, 0)}
    for n in (6, 12):
        body = TUBE | {"elements": (n, 1), "grading": (5, 1)}
        found = solve(make_solver, problem(body, boundary, probes=places), given)
        errors.append(max(abs(found.probes[name][-1, 0] / radial(at[0]) - 1) for name, at in places.items()))
    assert errors[1] < 1e-4
    assert errors[0] > 6 * errors[1]
    # σ_yy = ν (σ_rr + σ_θθ) = 2 ν constant is uniform.
    nu = lame / (2 * (lame + shear))
    force = 2 * nu * constant * np.pi * (b**2 - a**2)
    assert found.reactions["y+"][-1, 1] == pytest.approx(force, rel=1e-4)


#: Poisson's ratio of the body that keeps its fluid.
UNDRAINED = (0.4, 0.4999, 0.499999)


def keeping_its_fluid(nu, shear=0.8):
    """Return a law with λ = 0.5 whose storage gives it ν_u, and λ_u."""
    biot, lame, undrained = 0.9, 0.5, 2 * shear * nu / (1 - 2 * nu)
    return isotropic_law(lame, shear, biot, biot**2 / (undrained - lame), 1.0), undrained


def test_lame_does_not_lock(make_solver):
    """A sealed thick cylinder under a pressure inside: the error is the same up to ν_u = 0.499999."""
    shear, a, b, p = 0.8, 0.1, 0.5, 1e-3
    body = TUBE | {"elements": (6, 1), "grading": (5, 1)}
    boundary = {"inner": {"traction": (p, 0, 0)}, "y-": {"normal": 0}, "y+": {"normal": 0}}
    given, errors = problem(body, boundary, probes={"outside": (b, 0.3, 0), "middle": (0.23, 0.2, 0)}), []
    for nu in UNDRAINED:
        made, lame = keeping_its_fluid(nu)
        found = solve(make_solver, given, made)
        constant = p * a**2 / (b**2 - a**2)
        error = 0.0
        for name, r in (("outside", b), ("middle", 0.23)):
            exact = constant * (r / (2 * (lame + shear)) + b**2 / (2 * shear * r))
            error = max(error, abs(found.probes[name][-1, 0] / exact - 1))
        errors.append(error)
    assert max(errors) < 1e-3
    assert max(errors) < 1.1 * errors[0]


@pytest.mark.parametrize("kind", ["axisymmetric", "plane-strain"])
def test_bonded_blocks_do_not_lock(make_solver, kind):
    """Squeezed between plates before any fluid leaves: the force converges as fast up to ν_u = 0.499999."""
    size = {"radius": 1.0, "height": 0.5} if kind == "axisymmetric" else {"size": (1.0, 0.5)}
    middle = {} if kind == "axisymmetric" else {"x-": {"normal": 0}}
    boundary = {"y-": {"displacement": (0, 0, 0)}, "y+": {"displacement": (0, -1e-4, 0)}} | middle
    time = {"end": 2e-12, "step": 1e-12, "ramp_increments": 1, "ramp_step": 1e-12, "profiles": ()}

    def force(n, nu):
        body = size | {"kind": kind, "elements": (n, n // 2)}
        return solve(make_solver, problem(body, boundary, time), keeping_its_fluid(nu)[0]).reactions["y+"][
            -1, 1
        ]

    errors = []
    for nu in UNDRAINED:
        exact = force(24, nu)
        errors.append([abs(force(n, nu) / exact - 1) for n in (4, 8)])
    compressible, *nearly = np.array(errors)
    assert compressible[0] > 2 * compressible[1]
    for each in nearly:
        assert each[0] > 2 * each[1]
        assert each[0] < 3e-2
    np.testing.assert_allclose(nearly[0], nearly[1], rtol=1e-2)


@pytest.mark.slow
def test_unconfined_compression_is_that_of_armstrong_lai_and_mow(make_solver):
    """The force, the radius and the pressure on the axis over time, of a disc that is squeezed along a ramp."""
    exact = UnconfinedCompression(1.0, -0.01, lame=0.3, shear=0.4, conductivity=1.0, ramp=0.05)
    body = {"kind": "axisymmetric", "elements": (36, 1)}
    assert max(unconfined_errors(make_solver(), exact, body, (), 4e-6)) < 1e-3


def test_a_plug_is_the_wedge_as_its_elements_become_finer(make_solver):
    boundary = {
        "y-": {"displacement": (0, 0, 0)},
        "y+": {"displacement": (0, -0.1, 0), "pressure": 0},
        "side": {"pressure": 0},
    }

    @cache
    def force(kind, n):
        body = {"kind": kind, "radius": 1.0, "height": 1.0}
        more = {"elements": (n, n), "grading": (0.5, 1)}
        sides = {}
        if kind == "wedge":
            more = {"elements": (n, n, 1), "grading": 0.5, "angle": 6}
            sides = {"z-": {"normal": 0}, "oblique": {"normal": 0}}
        found = solve(make_solver, problem(body | more, boundary | sides, TRANSIENT), law())
        turns = 60 if kind == "wedge" else 1
        return found.reactions["y+"][1:, 1] * turns

    differences = [np.abs(force("axisymmetric", n) / force("wedge", n) - 1).max() for n in (2, 4)]
    assert differences[1] < 5e-3
    assert differences[0] > 2 * differences[1]


def test_a_plug_is_the_cylinder_as_its_elements_become_finer(make_solver):
    """Squeezed between smooth plates and drained at its side; a quarter stands for the cylinder.

    The law is isotropic: the axes of a cell turn about the axis in the one and not in the other.
    """
    boundary = {
        "y-": {"normal": 0},
        "y+": {"displacement": (None, -1e-3, None)},
        "side": {"pressure": 0},
    }
    planes = {"x-": {"normal": 0}, "z-": {"normal": 0}}
    given = isotropic_law(0.5, 0.8, 0.9, 0.1, 1.0)

    def force(kind, elements, held):
        body = {"kind": kind, "radius": 1.0, "height": 1.0, "elements": elements}
        return solve(make_solver, problem(body, boundary | held, TRANSIENT), given).reactions["y+"][1:, 1]

    differences = [
        np.abs(
            force("axisymmetric", (2 * n, 1), {}) / (4 * force("quarter-cylinder", (n, 1, n), planes)) - 1
        ).max()
        for n in (1, 2, 4)
    ]
    assert differences[2] < 1e-3
    assert differences[1] > 3 * differences[2]


# ---- balance, tangents and derivatives -----------------------------------------------------------


SQUEEZED = {
    "follower": (BoundaryChange("inner", "follower"), 0.02),
    "plate": (BoundaryChange("y+", "plate"), 1.0),
    "load": (LoadChange(), 0.9),
    "initial": (InitialPressureChange(), 0.001),
    "radius": (CellParameterChange("radius"), 0.0),
}


def squeezed(*, follower, plate, load, initial, radius):
    """A hollow plug under a plate, a pressure inside that follows, and an inflow at its base."""
    return problem(
        TUBE | {"elements": (2, 2)},
        {
            "y-": {"normal": 0, "flux": 0.001},
            "y+": {"plate": {"ramp": -0.01 * plate, "until": 0.2}},
            "inner": {"follower": follower},
            "side": {"pressure": 0},
        },
        TRANSIENT,
        load=load,
        initial={"pressure": initial},
        fields={"radius": f"{0.2 + radius!r} + 0.01*x"},
        probes={"inside": (0.2, 0.3, 0)},
    )


def test_derivatives_are_the_limits_of_differences(make_solver):
    check(make_solver, squeezed, law("radius"), SQUEEZED)


def test_gradients_are_sums_of_sensitivities(make_solver):
    given = squeezed(**{name: value for name, (_, value) in SQUEEZED.items()})
    compare(make_solver, given, law("radius"), [change for change, _ in SQUEEZED.values()])


def test_the_force_on_the_base_is_the_load(make_solver):
    boundary = {
        "y-": {"displacement": (0, 0, None)},
        "y+": {"traction": (0.01, -0.03, 0)},
        "side": {"pressure": 0},
    }
    given = problem(PLUG | {"elements": (3, 3)}, boundary, TRANSIENT, body_force=(0, -0.02, 0))
    found = solve(make_solver, given, law())
    load = np.pi * 0.25 * (0.03 + 0.02 * 0.8)
    assert found.reactions["y-"][-1, 1] == pytest.approx(load, rel=1e-9)
    # What the sides take out of the body is what its volume loses.
    flows = found.inflow["side"][1:] * np.diff(found.history.time)
    assert -flows.sum() == pytest.approx(found.history.drained[-1], rel=1e-9)


@pytest.mark.parametrize("kind", ["axisymmetric", "plane-strain"])
def test_the_tangent_is_the_slope_of_the_residual(make_solver, kind):
    body = (
        TUBE | {"elements": (2, 2)}
        if kind == "axisymmetric"
        else {"kind": kind, "size": (1, 0.8), "elements": (2, 2)}
    )
    side = "inner" if kind == "axisymmetric" else "x+"
    given = problem(body, {"y-": {"displacement": (0, 0, 0)}, side: {"follower": 0.1, "pressure": 0}})
    d, L, rng = make_solver().prepare(given), mean_gradient_law(), np.random.default_rng(0)
    x = d.from_mesh(0.002 * rng.standard_normal(d.mesh.size))
    memory, loads, moved = L.initial(d.n_points), d.loads(1.0), np.zeros(len(x))
    moved[d.free] = rng.standard_normal(len(d.free))

    def residual(at):
        states, grad_p = d.states(at)
        response = L.respond(states, grad_p, memory)
        return d.residual(response, 0.3, loads, at).values[d.free], response

    h = 1e-6
    slope = (residual(x + h * moved)[0] - residual(x - h * moved)[0]) / (2 * h)
    right = np.zeros(len(x))
    right[d.free] = slope
    system = d.coupled(residual(x)[1].tangent, 0.3, x, loads).system
    found = d.solve(system, right, np.zeros(len(d.prescribed)))
    np.testing.assert_allclose(found[d.free], moved[d.free], atol=1e-5 * np.abs(moved).max())


def test_iterations_give_what_a_factor_gives(make_solver):
    boundary = {"y-": {"displacement": (0, 0, 0)}, "y+": {"follower": 0.03}, "side": {"pressure": 0}}
    given = problem(PLUG | {"elements": (6, 6)}, boundary, TRANSIENT)
    found = [solve(make_solver, given, law(), solver=name) for name in ("direct", "iterative")]
    assert found[1].work["iterations"].max() > 0
    np.testing.assert_allclose(found[0].profiles[-1].u, found[1].profiles[-1].u, atol=1e-9)


# ---- refusals ------------------------------------------------------------------------------------


def test_a_cell_that_would_turn_the_body_is_refused(make_solver):
    given = problem(
        PLUG | {"elements": (1, 1)},
        {"y-": {"displacement": (0, 0, 0)}, "side": {"pressure": 0}},
        fields={"axes": {"about": (0, 1, 0), "angle": "20"}},
    )
    with pytest.raises(ConfigurationError, match=r"its own mirror image .* turns it about its axis"):
        solve(make_solver, given, anisotropic_law())
    solve(make_solver, given.model_copy(update={"fields": {}}), law())

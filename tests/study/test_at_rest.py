"""``porocore check`` on the undeformed cell: moduli, permeability and time of consolidation in the user's units."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.special import jn_zeros

from porocore.core.units import OutputUnits, ResultUnits, Scales
from porocore.macro.analytic import Mandel, Terzaghi, UnconfinedCompression
from porocore.macro.boundary.drainage import drainage_time
from porocore.macro.laws.linear import EffectiveProperties, LinearCoefficients, LinearPoroelasticity
from porocore.macro.problem import MacroProblem, MacroSetup, TimePlan
from porocore.plugins import registry
from porocore.report.metrics import time_to_fraction
from porocore.study.config.loading import load_config
from porocore.study.notes.at_rest import (
    at_rest,
    cell_lines,
    coefficients_of_consolidation,
    thin_fluid,
    turned_by,
)
from tests.helpers.invoked import BENCHMARK

POISSON = 0.2


def coefficients(K=(2.0, 2.0, 2.0), biot=0.8, storage=0.05):
    """An isotropic solid with Young's modulus 0.4 and Poisson's ratio 0.2."""
    shear, lame = 0.4 / 2 / (1 + POISSON), 0.4 * POISSON / (1 + POISSON) / (1 - 2 * POISSON)
    one = np.eye(3)
    swap = np.einsum("ik,jl->ijkl", one, one)
    C = lame * np.einsum("ij,kl->ijkl", one, one) + shear * (swap + swap.swapaxes(2, 3))
    alpha = biot * one
    return LinearCoefficients(C, alpha, alpha, storage, np.diag(K), np.zeros((3, 3, 3, 3)), np.zeros((3, 3)))


def properties(c, viscosity=1.0):
    return EffectiveProperties.of(c, 0.4, viscosity)


def setup(size, boundary, elements, without="", **more):
    body = {"kind": "box", "size": list(size), "elements": list(elements)}
    sides = {side: {"normal": 0} for side in ("x-", "x+", "z-", "z+", "y-") if side != without}
    return MacroSetup.model_validate({"body": body, "boundary": sides | boundary, **more})


COLUMN = setup((0.1, 2.0, 0.1), {"y+": {"traction": [0, -0.01, 0], "pressure": 0}}, (1, 8, 1))


def test_a_cell_whose_swelling_is_held_tells_its_stress():
    dry = coefficients()
    wet = replace(dry, stress=np.diag([-0.05, -0.05, -0.03]))
    told = [list(cell_lines(properties(c), 1.0, ResultUnits())) for c in (dry, wet)]
    assert set(told[1]) - set(told[0]) == {
        "stress while the swelling is held −0.0500, −0.0500, −0.0300 E along x, y, z"
    }


def test_a_column_drains_in_the_time_of_terzaghi():
    c = coefficients((5.0, 2.0, 1.0))
    time = drainage_time(COLUMN, c)
    exact = Terzaghi.from_coefficients(c, 2.0, 0.01)
    first, last = exact.settlement(np.array([1e-9])), exact.settlement(np.array([1e9]))
    share = (exact.settlement(np.array([time])) - first) / (last - first)
    assert share.item() == pytest.approx(0.95, abs=1e-4)
    assert drainage_time(COLUMN, coefficients((5.0, 0.0, 1.0))) is None


def test_a_run_drains_in_the_time_that_was_told():
    c = coefficients()
    told = drainage_time(COLUMN, c)
    plan = {
        "end": 4 * told,
        "step": told / 200,
        "ramp_increments": 1,
        "ramp_step": told / 1000,
        "profiles": (),
    }
    problem = COLUMN.model_copy(update={"time": TimePlan(**plan)}).model_dump()
    solver = registry.get("macro solver", "skfem")()
    solution = solver.solve(solver.prepare(MacroProblem.model_validate(problem)), LinearPoroelasticity(c))
    history = solution.history
    assert time_to_fraction(history.time, history.drained, 0.95) == pytest.approx(told, rel=0.02)


def strip(c, width):
    """A block between plates that drains to one side."""
    sides = {"x+": {"pressure": 0}, "y+": {"plate": -0.01}}
    exact = Mandel(width, 0.01, c.stiffness[0, 0, 1, 1], c.stiffness[0, 1, 0, 1], 0.8, c.storage, 2.0)
    return setup((width, 0.1, 0.1), sides, (8, 1, 1), without="x+"), lambda t: float(exact.pressure(0.0, t))


def cylinder(c, radius):
    """A cylinder between plates that drains to its mantle."""
    body = {"kind": "cylinder", "radius": radius, "height": 0.3, "elements": [4, 1, 12]}
    held = MacroSetup.model_validate({"body": body, "boundary": {"side": {"pressure": 0}}})
    exact = UnconfinedCompression(radius, -0.01, c.stiffness[0, 0, 1, 1], c.stiffness[0, 1, 0, 1], 2.0)
    return held, lambda t: float(exact.pressure(0.0, t))


def fourier(t, length):
    """Mean of a pressure that is 1 at first between two drained planes, for a diffusivity of 1."""
    n = np.arange(1, 60, 2) * np.pi
    return float((8 / n**2 * np.exp(-((n / length) ** 2) * t)).sum())


def bessel(t, radius):
    """The same in a cylinder with a drained mantle."""
    j = jn_zeros(0, 60)
    return float((4 / j**2 * np.exp(-((j / radius) ** 2) * t)).sum())


ALL_DRAINED = {face: {"pressure": 0} for face in ("x-", "x+", "y-", "y+", "z-", "z+")}


@pytest.mark.parametrize("shape", ["slender", "cylinder", "layers"])
def test_the_time_to_rest_is_that_of_the_shape_and_of_the_drained_surfaces(shape):
    """A slow part counts with its own share, and parts that are alike as one."""
    c = coefficients((0.0, 2.0, 0.0) if shape == "layers" else (2.0, 2.0, 2.0))
    diffusivity = 2.0 / (c.storage + c.biot[0, 0] ** 2 / c.stiffness[0, 0, 0, 0])
    if shape == "slender":
        macro, left = (
            setup((1, 1, 10), ALL_DRAINED, (6, 6, 8)),
            lambda t: fourier(t, 1) ** 2 * fourier(t, 10),
        )
    elif shape == "cylinder":
        macro, left = cylinder(c, 1.5)[0], lambda t: bessel(t, 1.5)
    else:
        macro, left = setup((1, 2, 1), {"y+": {"pressure": 0}}, (3, 8, 3)), lambda t: fourier(t, 4)
    assert left(diffusivity * drainage_time(macro, c)) == pytest.approx(0.05, rel=5e-3)


@pytest.mark.parametrize(("body", "incompressible"), [(strip, False), (cylinder, True)])
def test_where_a_body_gives_way_it_is_a_scale(body, incompressible):
    """The pressure in the middle decays in the closed form at a rate within a factor of two."""
    c = coefficients(biot=1.0, storage=1e-9) if incompressible else coefficients()
    held, pressure = body(c, 1.5)
    told = drainage_time(held, c)
    decay = np.log(pressure(told) / pressure(2 * told)) / told
    share = 8 / np.pi**2 if body is strip else 4 / jn_zeros(0, 1)[0] ** 2
    assert 0.5 < np.log(share / 0.05) / told / decay < 2


ODD = OutputUnits(length="um", stress="mmHg", time="h")


def test_moduli_and_permeability_are_those_of_the_scales():
    """Of a psi, an inch's thousandth part and a centipoise, by hand."""
    scales = Scales(modulus=75 * 6894.757293168, length=1e-3, pore=23e-9, viscosity=1.0)
    confined, young, biot, flow = cell_lines(properties(coefficients(), 1e-3), 1e-3, ResultUnits(scales, ODD))
    psi = 75 * 51.71493
    assert confined.startswith(f"confined modulus {0.4 * 0.8 / 1.2 / 0.6 * psi:.0f} mmHg (0.444 of")
    assert young == f"Young's modulus {0.4 * psi:.0f} mmHg"
    assert biot == "Biot coefficient 0.800; storage 1/M_B 1.29 · 10⁻⁵ 1/mmHg"
    assert 0.05 / psi == pytest.approx(1.29e-5, rel=2e-3)
    assert flow == (
        "permeability 1.06 · 10⁻¹⁸ m²; of a fluid of 0.001 Pa s: 1.06 · 10⁻¹⁵ m⁴/(N s) = 508 µm²/(mmHg h)"
    )
    by_hand = 2 * 23e-9**2 * 133.322387415 * 3600 * 1e12
    assert round(by_hand) == 508
    assert list(cell_lines(properties(coefficients((2.0, 1.0, 0.0)), 0.5), 0.5, ResultUnits())) == [
        "confined modulus 0.444 E",
        "Young's modulus 0.400 E",
        "Biot coefficient 0.800; storage 1/M_B 0.0500 1/E",
        "permeability 1.00, 0.500, 0 d² along x, y, z, conductivity K 2.00, 1.00, 0 d²/μ_c along x, y, z",
    ]


def test_the_coefficient_of_consolidation_is_that_along_the_drained_axes():
    """Of Terzaghi's layer; in the units of the scales E d²/μ_c, by hand."""
    c = coefficients((5.0, 2.0, 2.0))
    known = Terzaghi.from_coefficients(c, 2.0, 0.01).consolidation_coefficient
    assert known == pytest.approx(2 / (0.05 + 0.8**2 / (0.4 * 0.8 / 1.2 / 0.6)))
    scales = Scales(modulus=75 * 6894.757293168, length=1e-3, pore=23e-9, viscosity=1.0)
    told = coefficients_of_consolidation(properties(c), (1,), ResultUnits(scales, ODD))
    by_hand = known * 75 * 6894.757293168 * 23e-9**2 * 1e12 * 3600
    assert by_hand == pytest.approx(1.32e6, rel=5e-3)
    assert told.startswith("coefficient of consolidation c_v 1.32 · 10⁶ µm²/h along y, of a layer")
    plain = [coefficients_of_consolidation(properties(c), axes, ResultUnits()) for axes in ((0, 1), (1, 2))]
    assert plain[0].startswith(
        f"coefficient of consolidation c_v {2.5 * known:.2f}, {known:.2f} E d²/μ_c along x, y,"
    )
    assert plain[1].startswith(f"coefficient of consolidation c_v {known:.2f} E d²/μ_c along y, z,")
    turned = coefficients_of_consolidation(properties(c), (1,), ResultUnits(), turned=True)
    assert turned.startswith(
        f"coefficient of consolidation c_v {2.5 * known:.2f}, {known:.2f}, {known:.2f} E d²/μ_c along "
    )
    assert "x, y, z of the cell, of a layer" in turned


def test_a_cell_whose_axes_the_body_turns_is_told_so(tmp_path):
    """Moduli, K and c_v were given along y, but the layer was drained along z of the cell."""
    side, turn = {"displacement": [0, None, 0]}, {"axes": {"about": [1, 0, 0], "angle": "90"}}
    cell = {"geometry": {"kind": "orthogonal-channels", "radius": 0.3}}
    data = {
        "cell": cell,
        "cells": {"felt": cell},
        "sampling": {"sampler": "sobol", "inputs": {"H22": {"range": [-0.1, 0.1]}}},
        "macro": {
            "body": {"kind": "box", "size": [1, 4, 1], "elements": [1, 4, 1]},
            "regions": {"foam": {"below": 1, "fields": turn}, "felt": {"above": 3, "cell": "felt"}},
            "boundary": dict.fromkeys(("x-", "x+", "z-", "z+"), side),
            "loads": [1],
        },
    }
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    config = load_config(path)
    assert turned_by(config.macro, None) == "macro.regions.foam.fields.axes"
    assert turned_by(config.macro, "felt") == ""
    data["macro"]["fields"] = turn
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    assert turned_by(load_config(path).macro, "felt") == "macro.fields.axes"


def test_a_plain_viscosity_that_was_meant_in_units_is_seen(tmp_path):
    """With ``scales.viscosity: 1 mPa s`` a plain 0.001 is a fluid a thousand times thinner than water."""
    text = BENCHMARK.with_name("brain-indentation.yaml").read_text(encoding="utf-8")
    path = tmp_path / "study.yaml"
    path.write_text(text, encoding="utf-8")

    def noted(path):
        config = load_config(path)
        return list(thin_fluid(config.cell, config.scales))

    assert noted(path) == []
    plain = text.replace("viscosity: 1 Pa s", "viscosity: 1 mPa s").replace(
        "viscosity: 1 mPa s\n", "viscosity: 0.001\n"
    )
    path.write_text(plain, encoding="utf-8")
    (note,) = noted(path)
    assert (
        "1e-06 Pa s, but water has 0.001; cell.viscosity = 0.001 is a multiple of scales.viscosity = 0.001"
        in note
    )
    assert noted(BENCHMARK) == []


def test_a_pore_size_that_is_off_by_ten_is_seen(tmp_path):
    """The brain's block consolidates in minutes; with pores of a hundredth it takes ten thousand times as long."""
    text = BENCHMARK.with_name("brain-indentation.yaml").read_text(encoding="utf-8")
    path, times = tmp_path / "study.yaml", []
    for size in ("5 um", "50 nm"):
        path.write_text(
            text.replace("pore: 5 um", f"pore: {size}").replace("fluid_size: 0.1", "fluid_size: 0.3"),
            encoding="utf-8",
        )
        lines = list(at_rest(load_config(path)))
        (line,) = [line for line in lines if "consolidation: " in line]
        times.append(float(line.split()[2]))
        assert any("check macro.time" in line for line in lines) == (size == "50 nm")
    assert times[1] == pytest.approx(10_000 * times[0], rel=1e-2)

"""Claims of Dehghani & Zilian 2022 on the cell: undeformed values, local fields, single loads."""

from __future__ import annotations

from functools import partial

import numpy as np

from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.commands.reproduce.claims import Claim, Claims, Finding, compare_number, judge_statement
from porocore.commands.reproduce.study import Results
from porocore.commands.sensitivity.figures import CORRESPONDING
from porocore.commands.sensitivity.results import LoadResponses, Sensitivity
from porocore.report.format import number, percent, plain
from porocore.states import Array

RADIUS = "the paper's text gives r = 0.2, but its K, M and Q belong to r = 0.25"
#: Value of the undeformed cell as published, and the coefficient of linear poroelasticity with its component.
UNDEFORMED: tuple[tuple[str, float, str, tuple[int, ...]], ...] = (
    ("conductivity K_jj = 1.943 with μ_f = 1e-3", 1.943, "conductivity", (0, 0)),
    ("M_2222 = −0.23 of the undeformed cell", -0.23, "mean_grad_grad_u", (1, 1, 1, 1)),
    ("M_2211 = −0.076 of the undeformed cell", -0.076, "mean_grad_grad_u", (1, 1, 0, 0)),
    ("Q_ii = −0.113 of the undeformed cell", -0.113, "mean_grad_p", (0, 0)),
)
CLAIMS = Claims()


@CLAIMS.claim("Cell tests", "porosity 0.29 for channels of radius 0.2")
def _porosity(results: Results) -> Finding:
    here, stated = (config.cell.geometry for config in (results.config, results.as_stated_config))
    return compare_number(0.29, stated.porosity, 0.02, "", f" for r = 0.2; r = 0.25: {number(here.porosity)}")


def _two_radii(published: float, coefficient: str, component: tuple[int, ...], results: Results) -> Finding:
    """Compare a value of the undeformed cell for r = 0.25, and tell that of the text's r = 0.2 beside it."""
    both = results.linear, results.linear_as_stated
    here, there = (float(getattr(linear, coefficient)[component]) for linear in both)
    why = RADIUS if abs(here / there - 1) > 0.5 else ""
    return compare_number(published, here, 0.01, why, f"; r = 0.2: {number(there)}")


CLAIMS += [
    Claim("Numerical example", said, partial(_two_radii, published, coefficient, component))
    for said, published, coefficient, component in UNDEFORMED
]


@CLAIMS.claim("Cell tests", "Poisson's ratio: not stated")
def _poisson(results: Results) -> Finding:
    nu = (1 - -0.113 / (-0.23 + 2 * -0.076)) / 2
    material = results.config.cell.material
    assert isinstance(material, NeoHookean)  # as the paper's
    return Finding(
        f"taken {plain(material.poisson_ratio)}; the published M and Q give {number(nu, 3)} by "
        "Q_ii = (1 − 2ν)(M_2222 + 2 M_2211)"
    )


@CLAIMS.claim("Cell tests", "147,043 tetrahedra with 25,440 nodes in the solid, 57,273 in the fluid")
def _mesh(results: Results) -> Finding:
    facts = results.reference.mesh
    solid, fluid = (
        int(facts[f"{phase} tetrahedra in the eighth"].replace(",", "")) for phase in ("solid", "fluid")
    )
    return Finding(
        f"{8 * solid:,} {facts['element']} tetrahedra in the solid and {8 * fluid:,} in the fluid of the whole cell",
        why="second-order elements need fewer for the same error; diagonal states are solved on an eighth",
    )


def _radius(results: Results) -> float:
    geometry = results.config.cell.geometry
    assert isinstance(geometry, OrthogonalChannels)
    return geometry.radius


def _intersection(results: Results, values: Array) -> Finding:
    """Judge the place of the largest nodal value; all ridges lie on or inside the box of half width r."""
    radius = _radius(results)
    points = results.fields["pressure"].nodal.points.mesh.points
    place = np.abs(points[int(np.argmax(values))])
    where = ", ".join(number(float(x), 2) for x in np.sort(place))
    return judge_statement(
        bool((place <= 1.05 * radius).all()),
        f"the largest value lies at |Y| = ({where}), in order of size; the channels of r = {plain(radius)} cross "
        f"within |Y_i| ≤ {plain(radius)}",
        "the largest value lies outside the crossing of the channels",
    )


@CLAIMS.claim("Figure 2a", "pressure: the displacement is higher at the intersection of the three cylinders")
def _displacement_pressure(results: Results) -> Finding:
    return _intersection(results, np.linalg.norm(results.fields["pressure"].nodal.points.u, axis=1))


@CLAIMS.claim("Figure 2b", "pressure: the energy concentrates at the intersection of the channels")
def _energy_pressure(results: Results) -> Finding:
    return _intersection(results, results.fields["pressure"].nodal.energy)


@CLAIMS.claim("Figure 3a", "H_11: an elongation along the X-axis")
def _elongation(results: Results) -> Finding:
    nodal = results.fields["uni"].nodal
    extents = np.ptp(nodal.points.mesh.points + nodal.displacement, axis=0)
    listed = ", ".join(number(float(x), 3) for x in extents)
    return judge_statement(
        bool(extents[0] > 1.05 * extents[1:].max()),
        f"the deformed solid measures {listed} along X, Y and Z at H_11 = 0.4",
    )


@CLAIMS.claim("Figure 3b", "H_11: the energy concentrates in the middle of the cell along X")
def _energy_uniaxial(results: Results) -> Finding:
    nodal = results.fields["uni"].nodal
    high = nodal.energy >= 0.5 * nodal.energy.max()
    farthest = float(np.abs(nodal.points.mesh.points[high, 0]).max())
    return judge_statement(
        farthest <= _radius(results),
        f"Ψ is above half of its largest value only where |Y_1| ≤ {number(farthest, 2)}",
    )


@CLAIMS.claim("Figure 4b", "H_12: a considerable concentration of energy")
def _concentration(results: Results) -> Finding:
    points = results.fields["shear"].nodal.points
    mean = float(points.mean(points.energy)) / float(points.volume.sum())
    ratio = float(points.energy.max()) / mean
    return judge_statement(ratio > 3, f"the largest Ψ is {number(ratio, 2)} times the mean at H_12 = 0.4")


@CLAIMS.claim("Figure 5", "the averages depend nonlinearly on the loads")
def _nonlinear_profiles(results: Results) -> Finding:
    texts, shares = [], []
    for load, name in (("uniaxial", "H_11"), ("pressure", "p"), ("shear", "H_12")):
        along = results.sensitivity.loads[load]
        mean, values = along.quantities[f"avg_grad_{CORRESPONDING[load][0]}"], along.values
        rest = int(np.argmin(np.abs(values)))
        slope = (mean[rest + 1] - mean[rest - 1]) / (values[rest + 1] - values[rest - 1])
        off = np.abs(mean - slope * values)
        farthest = int(np.nanargmax(off))
        shares.append(float(off[farthest] / np.nanmax(np.abs(mean))))
        texts.append(f"{percent(shares[-1], 0)} at {name} = {plain(round(float(values[farthest]), 3))}")
    return judge_statement(
        "yes" if min(shares) > 0.1 else "partly" if max(shares) > 0.1 else "no",
        "farthest from the tangent at rest, of the largest average: " + ", ".join(texts).replace("-", "−"),
        "the average that shear changes most is nearly linear",
    )


def _at(along: LoadResponses, quantity: Array, where: float) -> float:
    """Return a quantity (n,) along a load, linear between its values."""
    good = np.isfinite(quantity)
    return float(np.interp(where, along.values[good], quantity[good]))


@CLAIMS.claim(
    "Figure 5", "shear H_12 causes considerable diagonal components, neglected by the linear theory"
)
def _shear_diagonal(results: Results) -> Finding:
    shear = results.sensitivity.loads["shear"]
    top = float(shear.values[np.isfinite(shear.quantities["avg_grad_11"])][-1])
    found = {ii: _at(shear, shear.quantities[f"avg_grad_{ii}"], top) for ii in ("11", "22", "33")}
    listed = ", ".join(f"{number(value, 2)} ({ii})" for ii, value in found.items())
    return judge_statement(
        max(map(abs, found.values())) > 0.02,
        f"averages of ∂u¹_i/∂Y_i at H_12 = {plain(top)}: {listed}; the linear theory has 0",
    )


@CLAIMS.claim("Figure 6", "the largest components differ significantly from the averages")
def _max_against_average(results: Results) -> Finding:
    ratios = []
    for load, (component,) in CORRESPONDING.items():
        along = results.sensitivity.loads[load]
        moved = np.isfinite(along.quantities["avg_energy"]) & (np.abs(along.values) > 0.05)
        mean = np.abs(along.quantities[f"avg_grad_{component}"][moved])
        ratios.append(along.quantities[f"max_grad_{component}"][moved] / mean)
    ratio = np.concatenate(ratios)
    least, median, largest = (float(of(ratio)) for of in (np.min, np.median, np.max))
    return judge_statement(
        median > 2,
        f"the largest is {number(least, 2)} to {number(largest, 2)} times the average of the "
        f"corresponding component, in the median {number(median, 2)} times",
    )


@CLAIMS.claim("Figure 6", "where averages are zero or negligible, the largest values are considerable")
def _hidden_components(results: Results) -> Finding:
    along, mixed = results.sensitivity.loads["uniaxial"], ("12", "13", "21", "23", "31", "32")
    mean = max(float(np.nanmax(np.abs(along.quantities[f"avg_grad_{ij}"]))) for ij in mixed)
    tops = [_at(along, along.quantities[f"max_grad_{ij}"], 0.4) for ij in mixed]
    return judge_statement(
        mean < 1e-6 and min(tops) > 0.05,
        f"under H_11 the averages of ∂u¹_i/∂Y_j, i ≠ j, are 0 to {number(max(mean, 1e-16), 1)}, their largest "
        f"magnitudes {number(min(tops), 2)} to {number(max(tops), 2)} at H_11 = 0.4",
    )


@CLAIMS.claim("Figure 7", "the largest Ψ is approximately 10 times the average")
def _energy_ratio(results: Results) -> Finding:
    texts, medians = [], []
    for load, along in results.sensitivity.loads.items():
        moved = np.isfinite(along.quantities["avg_energy"]) & (np.abs(along.values) > 0.05)
        ratio = along.quantities["max_energy"][moved] / along.quantities["avg_energy"][moved]
        texts.append(f"{load} {number(float(ratio.min()), 2)} to {number(float(ratio.max()), 2)}")
        medians.append(float(np.median(ratio)))
    overall = float(np.median(medians))
    return judge_statement(
        "yes" if 7 <= overall <= 14 else "partly",
        f"largest over average: {', '.join(texts)}; median {number(overall, 2)}",
        "at the sharp ridges Ψ is singular, so that its largest value depends on the mesh",
    )


@CLAIMS.claim(
    "Figures 8 and 17 to 19",
    "pressure raises K_t in all directions; a negative H raises K_t along its direction and lowers it across",
)
def _conductivity_signs(results: Results) -> Finding:
    pressed, squeezed = results.sensitivity.loads["pressure"], results.sensitivity.loads["uniaxial"]
    directions = ("11", "22", "33")
    p = [_at(pressed, pressed.quantities[f"Kt_{ii}"], 0.2) for ii in directions]
    K_t = [squeezed.quantities[f"Kt_{ii}"] for ii in directions]
    H = [_at(squeezed, values, -0.2) for values in K_t]
    by_flux = [_at(squeezed, squeezed.quantities["J_bar"] * values, -0.2) for values in K_t]
    return judge_statement(
        min(p) > 1 and H[0] > 1 > max(H[1:]),
        f"K_t/K at p = 0.2: {number(p[0], 3)} in all directions; at H_11 = −0.2: {number(H[0], 3)} along (11), "
        f"{number(H[1], 3)} across (22). The flux through reference area goes by K_ref = det F̄ K_t: "
        f"{number(by_flux[0], 3)} along, {number(by_flux[1], 3)} across",
    )


@CLAIMS.claim("Figure 9", "M_1111, Q_11 and the Biot modulus vary less in the reference configuration")
def _less_variation(results: Results) -> Finding:
    texts, less = [], []
    for name, quantity in (("M_1111", "M{}_1111"), ("Q_11", "Q{}_11"), ("Biot modulus", "biot{}")):
        reference, hat = (_variation(results.sensitivity, quantity.format(form)) for form in ("", "_hat"))
        texts.append(f"{name} {number(reference, 2)} against {number(hat, 2)}")
        less.append(reference < hat)
    return judge_statement(
        "yes" if all(less) else "partly" if any(less) else "no",
        "range over all loads by the value at rest, reference against multiplied by Ĵ: " + ", ".join(texts),
        "which one varies less depends on the quantity and on how far the loads go",
    )


def _variation(study: Sensitivity, quantity: str) -> float:
    """Return the range of a quantity over all loads as a share of its value at rest."""
    values = np.concatenate([along.quantities[quantity] for along in study.loads.values()])
    rest = _at(study.loads["pressure"], study.loads["pressure"].quantities[quantity], 0.0)
    return float(np.ptp(values[np.isfinite(values)]) / abs(rest))

"""Materials in a configuration: what is refused, where, and with what advice; solids of several materials."""

import re
import textwrap
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from porocore.cell.cell import Cell
from porocore.cell.materials.hyperelastic import Composite, HolzapfelGasserOgden, NeoHookean
from porocore.cell.materials.invariants import Formula, derivatives
from porocore.cell.meshing.mesh import MeshSettings
from porocore.errors import ConfigurationError
from porocore.macro.laws.closure import MeanGradientClosure, PotentialClosure
from porocore.study.config.loading import benchmark_path, load_config

OTHER = "{kind: mooney-rivlin, c10: 0.1, c01: 0.05, bulk_modulus: 1}"
SOFT = "c*(I1*J**(-2/3) - 3) + k*(J - 1)**2/2"


def load(tmp_path, cell, closure="mean-gradient"):
    """The packaged benchmark with other lines for its material."""
    text = benchmark_path().read_text(encoding="utf-8")
    old = text[text.index("  material:") : text.index("  viscosity:")]
    path = tmp_path / "mine.yaml"
    text = text.replace(old, textwrap.indent(textwrap.dedent(cell).strip(), "  ") + "\n")
    path.write_text(text.replace("closure: mean-gradient", f"closure: {closure}"), encoding="utf-8")
    return load_config(path)


def refused(tmp_path, cell, **options):
    with pytest.raises(ConfigurationError) as caught:
        load(tmp_path, cell, **options)
    text = (tmp_path / "mine.yaml").read_text(encoding="utf-8").splitlines()
    line, message = str(caught.value).removeprefix(f"{tmp_path / 'mine.yaml'}:").split(": ", 1)
    key, _, why = message.partition(": ")
    return text[int(line) - 1].strip(), key, why


def expression(energy, parameters="{c: 0.2, k: 1.0}", more=""):
    return f'material:\n  kind: expression\n  energy: "{energy}"\n  parameters: {parameters}\n  {more}'


def test_each_kind_is_read_and_written_again(tmp_path):
    for cell in (
        f"material: {OTHER}",
        "material: {kind: ogden, bulk_modulus: 1, terms: [{mu: 0.3, alpha: 2.5}, {mu: -0.1, alpha: -2}]}",
        "material: {kind: holzapfel-gasser-ogden, shear_modulus: 0.3, bulk_modulus: 1, k1: 0.2, k2: 3, "
        "directions: [[1, 0, 0], [0, 2, 1]]}",
        expression(SOFT),
        expression(SOFT + " + c*(I4 - 1)**2", more="directions: [[1, 1, 1]]"),
    ):
        config = load(tmp_path, cell)
        again = tmp_path / "again.yaml"
        again.write_text(config.resolved_yaml(), encoding="utf-8")
        assert load_config(again) == config
        assert "materials" not in config.resolved_yaml()
        assert load_config(again).stages == config.stages


def test_without_any_the_solid_is_neo_hookean(tmp_path):
    config = load(tmp_path, "contact: {kind: none}")
    assert config.cell.material == config.cell.solid == NeoHookean()
    assert Cell(material=NeoHookean()).identity == Cell().identity
    assert Cell(material=NeoHookean(poisson_ratio=0.3)).identity != Cell().identity


@pytest.mark.parametrize(
    ("energy", "why"),
    [
        ("__import__('os').system('ls')", "'__import__('os').system('ls')' at character 1 "),
        ("c*I1.real + k", "'I1.real' at character 3 "),
        ("c*I1 + (lambda: k)", "'lambda: k' at character 9 "),
        ("c*[I1 for I1 in k]", "'[I1 for I1 in k]' at character 3 "),
        ("c*I1 + k if J else 0", "'c*I1 + k if J else 0' at character 1 "),
        ("c*I1[0] + k", "'I1[0]' at character 3 "),
        ("c*I1 + k*'J'", "''J'' at character 10 "),
        ("c*(I1 - 3 + k", "'c*(I1 - 3 + k' is no formula: "),
        (
            "c*I1 + k*eval(J)",
            "'eval(J)' at character 10 of 'c*I1 + k*eval(J)': unknown function; there are exp, log",
        ),
        ("c*I1 + k*abs(J - 1)", "'abs(J - 1)' at character 10 "),
        ("c*I1 + kk*J", "'kk' at character 8 of 'c*I1 + kk*J': unknown name; did you mean 'k'? "),
        ("c*I1 + k*(I4 - 1)**2", "I4 needs a fibre, such as directions: [[1, 0, 0]]"),
        ("c*I1", "the parameter 'k' does not occur; remove it from parameters, or use it"),
        ("c*I1 + k*sqrt(0 - 1)", "holds a number that is not real or too large"),
        ("c*I1/0 + k*J", "holds a number that is not real or too large"),
        ("c*I1*1e400 + k*J", "numbers beyond 1e+100 are refused"),
        ("c*I1*exp(9999) + k*J", "holds a number that is not real or too large"),
        ("c*exp(exp(exp(exp(9)))) + k*J", "holds a number that is not real or too large"),
        ("c*I1 + k*J**9**9**9", "'9 ** 9 ** 9': powers whose exponents multiply to more than 64 are refused"),
        ("c*((I1**40)**40) + k*J", "powers whose exponents multiply to more than 64 are refused"),
        ("c + k", "holds no invariant of the deformation"),
        ("c*" + "exp(" * 13 + "I1" + ")" * 13 + " + k*J", "nested more than 12 levels deep"),
        ("k*J + c*" + "*".join(f"(I1 + {i})" for i in range(40)), "the first derivatives of the energy take"),
        ("k*J + c*(" + "+".join(["I1"] * 201) + ")", "at most 400 are read"),
        ("c*I1 + k*J + " + "J + " * 300 + "J", "expected text of at most 1000 characters"),
    ],
)
def test_what_is_no_energy_is_refused_with_the_place(tmp_path, energy, why):
    began = time.process_time()
    line, key, found = refused(tmp_path, expression(energy))
    assert time.process_time() - began < 5
    assert (line.partition(":")[0], key) == ("energy", "cell.material.energy")
    assert any(part in found for part in why.split("|"))


def test_what_is_just_let_through_takes_seconds():
    known = (("I1", 3), ("I2", 3), ("J", 1), ("I4", 1), ("I5", 1))
    product = "*".join(f"({name} + J*{i + 1})" for i, (name, _) in enumerate(2 * known))
    began = time.process_time()
    derivatives(Formula("exp(" * 9 + product + ")" * 9, known))
    assert time.process_time() - began < 10


@pytest.mark.parametrize(
    ("parameters", "why"),
    [
        ("{lambda: 0.2, k: 1}", "'lambda' cannot be the name of a parameter"),
        ("{__class__: 0.2, k: 1}", "'__class__' cannot be the name of a parameter"),
        ("{exp: 0.2, k: 1}", "'exp' has a meaning already"),
        ("{I1: 0.2, k: 1}", "'I1' has a meaning already"),
        ("{J: 0.2, k: 1}", "'J' has a meaning already"),
    ],
)
def test_names_of_parameters(tmp_path, parameters, why):
    line, key, found = refused(tmp_path, expression(SOFT, parameters))
    assert (line.partition(":")[0], key) == ("parameters", "cell.material.parameters")
    assert found.startswith(why)


@pytest.mark.parametrize(
    ("cell", "why"),
    [
        (expression("c*(I1 - 3) + k*log(J)**2"), "got P_11 = 0.4 at F = I; add -2*c*log(J)"),
        (expression("c*(I2 - 3) + k*(J - 2)**2"), "got P_11 = -1.2 at F = I; add (-4*c + 2*k)*log(J)"),
        (
            expression(SOFT + " + c*(I4 - 1)", more="directions: [[1, 0, 0]]"),
            "got P_11 = 0.4 at F = I; let the terms of the fibres have no slope at I4 = 1",
        ),
        (
            expression(SOFT, "{c: 0.2, k: -1}"),
            "for a change of volume (smallest eigenvalue of the elasticity tensor at F = I); raise the bulk",
        ),
        (expression(SOFT, "{c: -0.2, k: 1}"), "got -0.8 for a change of shape"),
        (expression("c*(I1 - 3) - 2*c*log(J) + k*(J - 1)**1.5"), "not finite in the undeformed solid"),
        (expression("c*(I1 - 3) - 2*c*log(J) + k*log(J - 2)"), "not real|not finite in the undeformed solid"),
        (
            "material: {kind: mooney-rivlin, c10: -0.2, c01: 0.1, bulk_modulus: 1}",
            "got -0.4 for a change of shape",
        ),
        (
            "material: {kind: ogden, bulk_modulus: 1, terms: [{mu: 1, alpha: -2}]}",
            "raise the shear stiffness",
        ),
    ],
)
def test_a_solid_rests_without_stress_and_is_stiff(tmp_path, cell, why):
    line, key, found = refused(tmp_path, cell)
    assert (line.partition(":")[0], key) == ("material", "cell.material")
    assert any(part in found for part in why.split("|"))


@pytest.mark.parametrize(
    ("cell", "key", "why"),
    [
        ("material: {kind: ogdn}", "cell.material.kind", "got 'ogdn'; did you mean 'ogden'?"),
        ("material: {kind: mooney-rivlin, c10: 0.1, c01: 0.1}", "cell.material.bulk_modulus", "missing"),
        (
            "material: {c10: 0.1}",
            "cell.material.c10",
            "remove it; the keys here are swelling, relaxation, kind, poisson_ratio",
        ),
        (
            "material: {kind: ogden, bulk_modulus: 1, terms: [{mu: 1, alpha: 0}]}",
            "cell.material.terms.0.alpha",
            "expected an exponent other than 0",
        ),
        ("material: {kind: ogden, bulk_modulus: 1, terms: []}", "cell.material.terms", "expected 1 to 8 terms, got 0"),
        (
            expression(SOFT + " + c*(I4 - 1)**2", more="directions: [[0, 0, 0]]"),
            "cell.material.directions.0",
            "expected a direction",
        ),
        (expression(SOFT, more="directions: [[1, 0, 0]]"), "cell.material.energy", "neither I4 nor I5 occurs"),
        (f"materials:\n  solid: {OTHER}\nmaterial: {OTHER}", "cell", "expected either material or materials"),
        ("materials: {solid: {kind: mooney-rivlin, c10: 0.1, c01: 0, bulk_modulus: -1}}",
         "cell.materials.solid.bulk_modulus", "expected a number with 0 < bulk_modulus, got -1"),
        ("materials: {solid: {poisson_ratio: 0.5}}", "cell.materials.solid.poisson_ratio", "expected a number"),
        (f"materials: {{solid: {OTHER}}}", "closure", "each region its own; choose closure: potential"),
        ("material: {swelling: 1.1}", "closure", "swelling gives the cell a stress at rest; choose closure: potential"),
        ("material: {poisson_ratio: {range: [0.2, 0.4]}}", "closure",
         "cell.material.poisson_ratio is a range, which gives each point its own; choose closure: potential"),
    ],
)  # fmt: skip
def test_keys_of_materials(tmp_path, cell, key, why):
    _, found, message = refused(tmp_path, cell)
    assert found == key
    assert why in message


def test_a_solid_of_several_materials_needs_the_potential(tmp_path):
    config = load(tmp_path, f"materials:\n  solid: {OTHER}", closure="potential")
    assert isinstance(config.cell.solid, Composite)
    assert "material:" not in config.resolved_yaml()
    with pytest.raises(ConfigurationError, match="choose closure: potential"):
        config.with_closure("mean-gradient")
    with pytest.raises(ConfigurationError, match="choose closure: potential"):
        MeanGradientClosure(0.6, config.cell.solid, np.eye(3))
    PotentialClosure(0.6, config.cell.solid, np.eye(3))


def test_the_examples_of_the_page_are_materials():
    text = (Path(__file__).parents[2] / "docs" / "materials.md").read_text(encoding="utf-8")
    blocks = [
        yaml.safe_load(block)["cell"] for block in re.findall(r"^```yaml\n(.*?)^```", text, re.M | re.S)
    ]
    kinds = set()
    for cell in blocks:
        cell.pop("geometry", None)  # a mesh file
        kinds.add(getattr(Cell.model_validate(cell).material, "kind", "several"))
    assert kinds == {"mooney-rivlin", "ogden", "holzapfel-gasser-ogden", "expression", "several"}


COARSE = Cell(mesh=MeshSettings(size=0.35, fluid_size=0.3, element="linear")).make_mesh("solid", "eighth")


def two_regions(mesh):
    high = mesh.points[mesh.cells[:, :4]].mean(axis=1)[:, 2] > 0.25
    return replace(mesh, regions=high.astype(np.int64), region_names=("core", "coating"))


def test_regions_and_materials_must_match():
    soft, stiff = NeoHookean(poisson_ratio=0.2), NeoHookean(poisson_ratio=0.4)
    mesh = two_regions(COARSE)
    with pytest.raises(
        ConfigurationError, match=r"materials.coatng: .* did you mean 'coating'\? .* core, coating"
    ):
        Composite({"core": soft, "coatng": stiff}).on(mesh)
    with pytest.raises(ConfigurationError, match="got none for coating; add 'coating:' below it"):
        Composite({"core": soft}).on(mesh)
    with pytest.raises(ConfigurationError, match="no region of this name; its regions are solid"):
        Composite({"core": soft}).on(COARSE)
    assert Composite({"solid": soft}).on(COARSE).mean_moduli()[1] == pytest.approx(soft.mu)


def test_every_element_has_the_material_of_its_region():
    fibre = HolzapfelGasserOgden(
        kind="holzapfel-gasser-ogden",
        shear_modulus=0.3,
        bulk_modulus=1,
        k1=0.5,
        k2=1,
        directions=((1, 0, 0),),
    )
    plain, mesh = NeoHookean(), two_regions(COARSE)
    solid = Composite({"core": plain, "coating": fibre})
    placed = solid.on(mesh)
    assert (solid.isotropic, solid.mirrored, placed.isotropic) == (False, True, False)
    F = np.eye(3) + 0.1 * np.random.default_rng(0).normal(size=(len(mesh.cells), 2, 3, 3))
    for k, own in enumerate((plain, fibre)):
        mine = mesh.regions == k
        assert 0 < mine.sum() < len(mine)
        for name in ("energy_density", "stress", "tangent"):
            np.testing.assert_array_equal(getattr(placed, name)(F)[mine], getattr(own, name)(F[mine]))
    stiff = np.flatnonzero(mesh.regions == 1)
    assert placed.mean_moduli(stiff) == pytest.approx(fibre.mean_moduli())
    share = len(stiff) / len(mesh.cells)
    assert placed.mean_moduli()[1] == pytest.approx(share * 0.3 + (1 - share) * plain.mu)

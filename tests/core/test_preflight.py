"""What is found before anything is solved: ``porocore check``, and faults with file, line and key."""

import sys
from pathlib import Path

import meshio
import numpy as np
import pytest
import yaml
from pydantic import ValidationError

import porocore
from porocore import backends
from porocore.cell.geometry import OrthogonalChannels
from porocore.config import load_config
from porocore.errors import ConfigurationError
from porocore.preflight import check_backends, outline
from porocore.problem import TimePlan

sys.path.insert(0, str(Path(__file__).parent))
from invoked import BENCHMARK, invoke, refusal


def test_check_tells_what_a_run_would_do():
    done = invoke("check", BENCHMARK.with_name("brain-indentation.yaml"))
    assert done.exception is None, done.output
    for part in (
        "porosity: 0.41",
        "macro-driven, ",
        "body: box, 10 × 10 × 10 mm, 216 hexahedron elements",
        "surface punch",
        "u_2 = 0 to -0.6 mm until t = 20 s",
        "probe beneath the punch at 0, 8, 0 mm",
        "up to t = 2000 s",
        "no faults; next: porocore run",
    ):
        assert part in done.stdout, part


def study_of(tmp_path, **changes):
    """The strip of examples/ with other values, by dotted key with ``__`` for the dot."""
    data = yaml.safe_load(BENCHMARK.with_name("soil-strip.yaml").read_text(encoding="utf-8"))
    for key, value in changes.items():
        *sections, last = key.split("__")
        part = data
        for section in sections:
            part = part.setdefault(section, {})
        part[last] = value
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(data, allow_unicode=True), encoding="utf-8")
    return path


def test_check_refuses_a_solid_that_a_run_refuses(tmp_path):
    """By the same sentence; it was said before what the cell is like."""
    path = study_of(tmp_path, cell__geometry={"kind": "sphere-pores", "lattice": "bcc", "radius": 0.7})
    done = invoke("check", path)
    assert isinstance(done.exception, ConfigurationError)
    assert "the solid has no stiffness: there is no solid" in done.stdout
    assert "no faults" not in done.stdout
    with pytest.raises(ConfigurationError) as refused:
        load_config(path).cell.require_stiffness()
    assert str(refused.value) in str(done.exception)
    assert "does not hang together" in str(refused.value)


def test_check_refuses_a_cell_without_pores(tmp_path, monkeypatch):
    monkeypatch.setattr(OrthogonalChannels, "porosity", 0.0)
    with pytest.raises(ConfigurationError, match="has no pores"):
        list(outline(load_config(BENCHMARK)))


def test_check_notes_drained_surfaces_that_no_pore_leads_to(tmp_path):
    path = study_of(tmp_path, cell__geometry={"kind": "sphere-pores", "lattice": "cubic", "radius": 0.3})
    assert "note: the cell conducts no fluid in any direction" in invoke("check", path).stdout
    path = study_of(tmp_path, cell__geometry={"kind": "orthogonal-channels", "axes": "x", "radius": 0.2})
    assert "note: the cell conducts no fluid along y (K_22 = 0)" in invoke("check", path).stdout


def test_default_profile_times_beyond_the_end_are_left_out():
    assert TimePlan().profiles == (1.0, 10.0, 40.0)
    assert TimePlan(end=10).profiles == (1.0, 10.0)
    assert TimePlan.model_validate(TimePlan(end=5).model_dump()) == TimePlan(end=5)
    with pytest.raises(ValidationError, match="a profile time lies behind end = 5"):
        TimePlan(end=5, profiles=(1.0, 10.0, 40.0))


@pytest.mark.parametrize(("count", "noted"), [(4, True), (9, True), (10, False)])
def test_check_notes_too_few_states_to_train_on(count, noted, tmp_path):
    """Of four inputs."""
    path = study_of(tmp_path, sampling__sampler="sobol", sampling__options={"count": count})
    lines = list(outline(load_config(path)))
    assert (
        f"note: {count} states are too few to train on, at least 10 are needed" in "\n".join(lines)
    ) == noted


@pytest.mark.parametrize(
    ("course", "words"),
    [
        ({"ramp": -0.6, "until": 20}, "u_2 = 0 to -0.6 until t = 20"),
        ({"table": [[0, 0.1], [2, -0.5]]}, "u_2 = (0.1 at t = 0; -0.5 at t = 2)"),
        (
            {"table": [[i, i / 10] for i in range(9)]},
            "u_2 = (0 at t = 0; 0.1 at t = 1; 0.2 at t = 2; …; 0.8 at t = 8)",
        ),
        ({"expression": "0.1*sin(t)"}, "u_2 = 0.1*sin(t)"),
    ],
)
def test_check_says_how_a_course_goes(course, words, tmp_path):
    path = study_of(tmp_path, macro__boundary__strip={"displacement": [None, course, None], "pressure": 0})
    (line,) = [line for line in outline(load_config(path)) if "surface strip" in line]
    assert line.split(": ", 1)[1] == f"{words}, p = 0"


def test_check_notes_a_course_that_goes_on_beyond_the_end(tmp_path):
    text = BENCHMARK.with_name("brain-indentation.yaml").read_text(encoding="utf-8")
    path = tmp_path / "study.yaml"
    assert "until: 20 s}" in text
    for until, noted in (("2000 s", False), ("20000", True)):
        path.write_text(text.replace("until: 20 s}", f"until: {until}}}"), encoding="utf-8")
        lines = [
            line for line in outline(load_config(path)) if "a course on the surface punch goes on" in line
        ]
        assert len(lines) == noted
    assert "beyond the end, 2000 s" in lines[0]


def solid_mesh(folder):
    """A cube of two tetrahedra without names for its surface."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    meshio.Mesh(points, [("tetra", np.array([[0, 1, 2, 3]]))]).write(folder / "nameless.vtu")


BOX = "kind: box\n    size: [0.1, 7.5, 0.1]\n    elements: [1, 106, 1]"
SURFACES, BOUNDARY = "  surfaces: ", "  boundary:\n"
FAULTS = [
    # what is replaced, by what, the key that is named, a part of the message
    ("    kind: box", "    kind: boxx", "macro.body.kind", "expected one of box, cylinder"),
    (BOX, "kind: file\n    path: none.msh", "macro.body.path", "no such file"),
    (
        BOX,
        "kind: file\n    path: nameless.vtu",
        "macro.body.path",
        "names no part of its surface",
    ),
    (
        BOX,
        "kind: file\n    path: text.geo",
        "macro.body.size",
        "missing; text.geo is a geometry",
    ),
    (BOX, "kind: file\n    path: text.msh", "macro.body.path", "not a mesh that meshio can read"),
    (BOX, "kind: wedge\n    radius: 1", "macro.body.height", "missing; add 'height:'"),
    ("    x-: {", "    left: {", "macro.boundary.left", "no such surface"),
    (
        "  boundary:\n",
        "  surfaces: {strip: {of: yy+, x: [0, 1]}}\n  boundary:\n",
        "macro.surfaces.strip.of",
        "y+",
    ),
    (
        "  boundary:\n",
        "  surfaces: {strip: {of: y+, x: [3, 4]}}\n  boundary:\n",
        "macro.surfaces.strip",
        "none of the 1",
    ),
    (
        "  boundary:\n",
        "  surfaces: {strip: {of: y+}}\n  boundary:\n",
        "macro.surfaces.strip",
        "expected bounds",
    ),
    (
        "  boundary:\n",
        "  surfaces: {z+: {of: y+, x: [0, 1]}}\n  boundary:\n",
        "macro.surfaces.z+",
        "another name",
    ),
    ("  boundary:\n", "  probes: {tip: [0, 9, 0]}\n  boundary:\n", "macro.probes.tip", "outside the body"),
    ("  boundary:\n", "  probes: {tip: [0, 9]}\n  boundary:\n", "macro.probes.tip", "a list of 3 entries"),
    (
        "y-: {displacement: [0, 0, 0]}",
        "y-: {displacement: [0, null, 0]}",
        "macro.boundary",
        "nothing holds the body",
    ),
    ("y-: {displacement: [0, 0, 0]}", "y-: {displacement: [1, 0, 0]}", "macro.boundary.y-", "contradicts"),
    (
        "traction: [0, 1, 0]",
        "traction: [0, 1, 0], displacement: [null, 1, null]",
        "macro.boundary.y+",
        "keep one",
    ),
    ("traction: [0, 1, 0]", "traction: [0, {ramp: 1}, 0]", "macro.boundary.y+.traction.1", "ramp and until"),
    ("traction: [0, 1, 0]", "traction: [0, {}, 0]", "macro.boundary.y+.traction.1", "exactly one of"),
    (
        "traction: [0, 1, 0]",
        "traction: [0, {table: [[1, 1], [0, 0]]}, 0]",
        "macro.boundary.y+.traction.1",
        "do not ascend",
    ),
    (
        "traction: [0, 1, 0]",
        "traction: [0, {expression: 2*x}, 0]",
        "macro.boundary.y+.traction.1",
        "'x' at character 3 of '2*x'",
    ),
    (
        "traction: [0, 1, 0]",
        "traction: [0, {rmp: 1}, 0]",
        "macro.boundary.y+.traction.1.rmp",
        "did you mean 'ramp'?",
    ),
    ("traction: [0, 1, 0]", "traction: [0, 1 kPa, 0]", "macro.boundary.y+.traction.1", "has no scales"),
    (
        "  loads: [-0.2",
        "  initial: {gradient: [[0, 0, 0]]}\n  loads: [-0.2",
        "macro.initial.gradient",
        "3 entries",
    ),
    ("    profiles: [1, 10, 40]", "    profiles: [1000]", "macro.time", "lies behind end"),
    ("    kind: neo-hookean", "    kind: ogden", "cell.material.terms", "missing"),
    (
        "    kind: neo-hookean\n    poisson_ratio: 0.35",
        "    kind: expression\n    energy: I1 + K",
        "cell.material.energy",
        "'K'",
    ),
    (
        "    kind: orthogonal-channels",
        "    kind: voxels\n    path: no.npy",
        "cell.geometry.path",
        "no such file",
    ),
    (
        "    radius: 0.25\n    axes: xyz",
        "    fillet: 0.4",
        "cell.geometry.fillet",
        "expected 0 (sharp ridges)",
    ),
    ("  backend: skfem", "  backend: skfem\n  options: {solvr: amg}", "fem.options", "solvr"),
    ("  sampler: density-sweep", "  sampler: sobol", "sampling.inputs.p.step", "step"),
    ("  backend: torch", "  backend: polynomial\n  options: {degre: 3}", "surrogate.options.degre", "degree"),
    ("closure: mean-gradient", "closure: potentail", "closure", "did you mean 'potential'?"),
    ("scenarios:", "output_units: {length: mm}\nscenarios:", "output_units", "scales"),
    ("scenarios:", "scales: {length: 1, pore: 1}\nscenarios:", "scales", "either modulus"),
    (
        "scenarios:",
        "scales: {modulus: 1 kPa, length: 1 s, pore: 1}\nscenarios:",
        "scales.length",
        "which is a time",
    ),
    (
        "  brain tissue: {force: 1.0e-3,",
        "  brain tissue: {force: 1 m,",
        "scenarios.brain tissue.force",
        "a force",
    ),
]


@pytest.mark.parametrize(("old", "new", "key", "part"), FAULTS, ids=[f"{f[2]}: {f[3]}" for f in FAULTS])
def test_a_fault_is_told_with_file_line_and_key(old, new, key, part, tmp_path, monkeypatch):
    """By 'porocore run', before anything is sampled or written."""
    text = BENCHMARK.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "folder" / "study.yaml"
    path.parent.mkdir()
    solid_mesh(path.parent)
    (path.parent / "text.geo").write_text("nothing")
    (path.parent / "text.msh").write_text("nothing")
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    lines = refusal("run", path, "--out", tmp_path / "run").splitlines()
    (line,) = [line for line in lines if f" {key}: " in line and part in line]
    file, number, _ = line.split(":", 2)
    assert file == str(path)
    source = path.read_text(encoding="utf-8").splitlines()[int(number) - 1]
    nearest = [piece for piece in key.split(".") if f"{piece}:" in source]
    assert nearest, f"{line!r} points at {source!r}"
    assert not (tmp_path / "run").exists()


def test_the_checks_mesh_the_body_once(monkeypatch):
    """A large body is not meshed for each of them."""
    from porocore.body import kinds

    made = []
    original = kinds.Box.make
    monkeypatch.setattr(kinds.Box, "make", lambda self: made.append(1) or original(self))
    kinds.make_body.cache_clear()
    check_backends(porocore.load_config(BENCHMARK))
    assert len(made) == 1
    assert backends.backend_name("macro solver", porocore.load_config(BENCHMARK)) == "skfem"

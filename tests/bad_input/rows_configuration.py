"""Faults of a configuration that ``porocore run`` tells with file, line and key, before anything is written."""

from __future__ import annotations

import meshio
import numpy as np

from porocore.study.config.loading import benchmark_path
from tests.bad_input.bad_row import CONFIG, Row

TEXT = benchmark_path().read_text(encoding="utf-8")
BOX = "kind: box\n    size: [0.1, 7.5, 0.1]\n    elements: [1, 106, 1]"
SURFACES, BOUNDARY = "  surfaces: ", "  boundary:\n"
#: What is replaced, by what, the key that is named, a part of the message.
FAULTS = [
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
    (BOX, "kind: file\n    path: text.msh", "macro.body.path", "damaged, cut short or of another kind"),
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
        "nothing holds the body in direction 2; prescribe u_2 on some surface",
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
    (
        "  sampler: density-sweep",
        "  sampler: sobol\n  parameters: box",
        "sampling.parameters",
        "'body' or 'ranges'",
    ),
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


def nameless_mesh(path):
    """A tetrahedron without names for its surface."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    meshio.Mesh(points, [("tetra", np.array([[0, 1, 2, 3]]))]).write(path)


def row(old: str, new: str, key: str, part: str) -> Row:
    assert old in TEXT
    files = {
        CONFIG: TEXT.replace(old, new, 1),
        "nameless.vtu": nameless_mesh,
        "text.geo": "nothing",
        "text.msh": "nothing",
    }
    return Row(f"{key}: {part}", ("run", CONFIG, "--out", "run"), (f" {key}: ", part), files)


ROWS = [row(*fault) for fault in FAULTS]

"""The messages of docs/troubleshooting.md are those that porocore prints."""

from __future__ import annotations

import ast
import builtins
import errno
import io
import os
import re
import sys
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from unittest import mock

import pytest

from porocore.cli import main
from porocore.core.files.atomic import atomic_path
from porocore.core.files.gmsh_model import import_gmsh
from porocore.errors import PorocoreError
from porocore.macro.boundary.conditions import boundary_data
from porocore.macro.integration.stepping import Stepper
from porocore.macro.problem import MacroProblem, body_mesh
from porocore.plugins.discovery import Broken, Offered, Source
from porocore.plugins.hookspecs import Offer
from porocore.plugins.kinds import KINDS
from porocore.plugins.registry import Registry
from porocore.report.text import MEANINGS
from porocore.report.words.results import case_warnings
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import Status
from porocore.study.config.loading import load_config
from porocore.study.run.folder import RunFolder
from tests.docs.pages import ROOT, page

#: Stands for what differs from case to case.
GAP = "…"
#: Fewest letters of a part of a message between two gaps that say anything.
TELLING = 12
#: Its message is held against the words of the statuses.
STATUS = "A state that has no solution"
#: The geometry of the benchmark's cell, in its configuration.
CHANNELS = (
    "    kind: orthogonal-channels   # a unit cube from which straight channels are cut\n"
    "    radius: 0.25\n    axes: xyz\n"
)
PAGE = page("docs/troubleshooting.md")
ENTRIES = dict(re.findall(r"^### ([^\n]+)\n\n```text\n(.*?)\n```$", PAGE, flags=re.MULTILINE | re.DOTALL))


def one_line(text):
    return " ".join(text.split())


def test_every_heading_has_a_message_and_what_to_do():
    headings = re.findall(r"^### (.+)$", PAGE, flags=re.MULTILINE)
    assert list(ENTRIES) == headings
    assert len(headings) >= 35
    for part in re.split(r"^### .+$", PAGE, flags=re.MULTILINE)[1:]:
        said = re.sub(
            r"^## .*", "", re.sub(r"```text.*?```", "", part, flags=re.DOTALL), flags=re.DOTALL | re.MULTILINE
        )
        assert len(said.split()) >= 8, part


def test_every_status_of_a_failed_cell_is_explained():
    section = PAGE[PAGE.index(f"### {STATUS}") :].split("\n### ")[0]
    assert all(f"`{status.name}`" in section for status in Status if status is not Status.converged)
    assert one_line(ENTRIES[STATUS]) == f"status: not_converged – {MEANINGS[Status.not_converged]}"


# ---- messages that are printed here ---------------------------------------------------------------


class Reader:
    """Somebody who meets messages: a folder with the benchmark's configuration, and commands."""

    def __init__(self, folder, patch):
        self.folder, self.patch = folder, patch
        patch.chdir(folder)
        self.text = (ROOT / "examples/dehghani2022.yaml").read_text(encoding="utf-8")
        (folder / "my.yaml").write_text(self.text, encoding="utf-8")

    def type(self, *words):
        """What a command prints, on both streams; it has to end with an error."""
        out = io.StringIO()
        self.patch.setattr(sys, "argv", ["porocore", *words])
        with redirect_stdout(out), redirect_stderr(out), pytest.raises(SystemExit) as end:
            main()
        assert end.value.code in (2, 130)
        return out.getvalue()

    def changed(self, old, new):
        """The error of the configuration with another text in place of one."""
        assert self.text.count(old) == 1
        (self.folder / "my.yaml").write_text(self.text.replace(old, new), encoding="utf-8")
        return self.type("check", "my.yaml")

    @property
    def config(self):
        return load_config(self.folder / "my.yaml")

    def run(self):
        """The folder of a run that has been begun."""
        return RunFolder.claim("runs/mine", self.config)


def told(error_of):
    """An error as the command line begins it."""
    with pytest.raises(PorocoreError) as caught:
        error_of()
    return f"error: {caught.value}"


def offered(kind, name, source, **more):
    return Offered(kind, Offer(name=name, load=lambda: object, summary="", **more), source)


STRANGERS = ROOT / "tests" / "strangers"


def twice_in_a_mesh(reader):
    text = (STRANGERS / "volumes_overlap_msh22" / "core22.msh").read_text(encoding="utf-8")
    # All elements of the volume 'core' are given to 'all' instead, where they are already.
    text = re.sub(r"^(\d+ 4 2) 2 2 ", r"\1 1 2 ", text, flags=re.MULTILINE)
    (reader.folder / "twice.msh").write_text(text, encoding="utf-8")
    return on_a_mesh(
        reader, "volumes_overlap_msh22/core22.yaml", "core22.msh", str(reader.folder / "twice.msh")
    )


def two_names(reader):
    mesh = STRANGERS / "groups_second_lost_msh41" / "double.msh"
    new = 'x-": {normal: 0}\n    second: {traction: [0, -0.01, 0]}'
    return on_a_mesh(
        reader, "groups_second_lost_msh41/double.yaml", "double.msh", str(mesh), 'x-": {normal: 0}', new
    )


def on_a_mesh(reader, study, *pairs):
    text = (STRANGERS / study).read_text(encoding="utf-8")
    for old, new in zip(pairs[::2], pairs[1::2], strict=True):
        assert text.count(old) == 1
        text = text.replace(old, new)
    (reader.folder / "my.yaml").write_text(text, encoding="utf-8")
    return reader.type("check", "my.yaml")


def without_gmsh(reader):
    load = builtins.__import__

    def refuse(name, *rest, **named):
        if name == "gmsh":
            raise OSError("libGLU.so.1: cannot open shared object file: No such file or directory")
        return load(name, *rest, **named)

    with mock.patch.dict(sys.modules), mock.patch.object(builtins, "__import__", refuse):
        sys.modules.pop("gmsh", None)
        return told(import_gmsh)


def uninstalled(reader):
    return told(lambda: Registry([], []).find("cell solver", "skfem"))


def missing_module(reader):
    torch = offered(
        "surrogate",
        "torch",
        Source("porocore-surrogate-torch", "0.1.0", "torch"),
        requires=("torch",),
        install="pip install porocore-surrogate-torch",
    )
    with mock.patch("porocore.plugins.discovery._importable", return_value=False):
        return told(lambda: Registry([torch], []).find("surrogate", "torch"))


def broken(reader):
    failed = Broken(Source("porocore-fem-skfem", "0.1.0", "skfem"), "ImportError: no module named mkl")
    return told(lambda: Registry([], [failed]).find("cell solver", "skfem"))


def twice(reader):
    sources = [Source("porocore", "0.1.0", "builtin"), Source("their-samplers", "2.0", "theirs")]
    return told(
        lambda: Registry([offered("sampler", "sobol", s) for s in sources], []).find("sampler", "sobol")
    )


def other_interface(reader):
    source = Source("porocore-sampler-halton", "0.1.0", "halton")
    reason = KINDS["sampler"].versions.complaint("sampler", 2, source.distribution)
    return told(lambda: Registry([], [Broken(source, reason, "sampler", 2)]).find("sampler", "halton"))


def outside(reader):
    shares = {"flagged_reasons": {}, "flagged_largest": 0.2, "flagged_end": 0.1, "flagged_time_mean": 0.1}
    nonlinear = {**shares, "flagged_first_time": 0.2, "flagged_all_time": None, "steady_drift": 0.02}
    found = case_warnings(
        {"load": -0.2, "nonlinear": nonlinear, "linear": {"steady_drift": None}},
        "Beyond what was sampled: H22 = −0.2 at (0, 0, 0) at t = 1 (sampled in [−0.1, 0]). Write under "
        "'sampling.inputs:' H22: {range: [-0.23, 0]}.",
    )
    return [f"warning: {text}" for text in found]


def wrong_dimension(reader):
    reader.text += "scales: {modulus: 0.5 MPa, length: 1 mm, pore: 23 nm, viscosity: 1 Pa*s}\n"
    return reader.changed("end: 150\n", "end: 3 kPa\n")


def failed_step(reader):
    plan = reader.config.macro.time

    def halve():
        stepper = Stepper(plan)
        while True:
            stepper.reject(
                "the relative residual of Newton's method was still 0.3 after 12 iterations "
                "(newton.tolerance = 1e-08); before it 12 of 864 points are flagged, one of them for "
                "H12 = 0.016, which was not sampled"
            )

    return told(halve)


def plate_beside_another(reader):
    problem = MacroProblem.model_validate(
        {
            "body": {"kind": "wedge", "radius": 1, "height": 0.7, "elements": (1, 1, 1), "angle": 60},
            "boundary": {"oblique": {"normal": 0}, "z-": {"plate": 1}, "y-": {"normal": 0}},
        }
    )
    return told(lambda: boundary_data(body_mesh(problem), problem))


def same_run(reader):
    reader.run()
    return reader.type("run", "my.yaml", "--out", "runs/mine")


def other_run(reader):
    reader.run()
    (reader.folder / "my.yaml").write_text(
        reader.text.replace("poisson_ratio: 0.35", "poisson_ratio: 0.3"), "utf-8"
    )
    return reader.type("run", "my.yaml", "--out", "runs/mine", "--resume")


def missing_stage(reader):
    reader.run()
    return reader.type("solve", "runs/mine")


def interrupted(reader):
    def stop(*words, **named):
        raise KeyboardInterrupt

    reader.patch.setattr("porocore.study.run.pipeline.run", stop)
    return reader.type("run", "my.yaml", "--out", "runs/mine")


def full(reader):
    def refuse(number):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def write():
        with mock.patch("os.fsync", refuse), atomic_path(reader.folder / "samples.h5") as part:
            part.write_text("half", encoding="utf-8")

    return told(write)


def second_writer(reader):
    with reader.run():
        return reader.type("run", "my.yaml", "--out", "runs/mine", "--resume")


def damaged(reader):
    path = reader.folder / "samples.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(64))
    return told(lambda: Dataset.open(path))


def under_mpi(reader):
    reader.patch.setenv("OMPI_COMM_WORLD_RANK", "0")
    reader.patch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    return reader.type("run", "my.yaml")


PRINTED = {
    "System libraries of gmsh are missing": without_gmsh,
    "There is no backend": uninstalled,
    "A name that nobody offers": lambda reader: reader.type("check", "my.yaml", "--fem", "skfme"),
    "A module that a plugin needs is missing": missing_module,
    "A broken plugin": broken,
    "Two plugins with one name": twice,
    "A plugin for another porocore": other_interface,
    "There is no such file": lambda reader: reader.type("run", "nothing.yaml"),
    "Not valid YAML": lambda reader: reader.changed("\ncell:\n", "\ncell\n"),
    "An unknown key": lambda reader: reader.changed("radius: 0.25\n", "raduis: 0.25\n"),
    "A missing key": lambda reader: reader.changed("      range: [-0.02, 0.24]\n", ""),
    "A value of the wrong dimension": wrong_dimension,
    "A missing image or mesh": lambda reader: reader.changed(
        CHANNELS, "    kind: voxels\n    path: scan.npy\n"
    ),
    "A material that is not stable": lambda reader: reader.changed(
        "    kind: neo-hookean\n    poisson_ratio: 0.35 ",
        "    kind: mooney-rivlin\n    c10: -0.1\n    c01: 0.03\n    bulk_modulus: 1.1 ",
    ),
    "A probe outside the body": lambda reader: reader.changed(
        "\nmacro:\n", "\nmacro:\n  probes: {top: [0, 9, 0]}\n"
    ),
    "A value out of its bounds": lambda reader: reader.changed("radius: 0.25\n", "radius: 0.6\n"),
    "A value with a unit, and no scales": lambda reader: reader.changed("end: 150\n", "end: 150 s\n"),
    "An unknown surface": lambda reader: reader.changed("    y-: {", "    bottom: {"),
    "Elements that are in a mesh twice": twice_in_a_mesh,
    "Faces under two names": two_names,
    "Parts of the body are flagged": lambda reader: outside(reader)[0],
    "The end is not steady": lambda reader: outside(reader)[1],
    "A time step failed": failed_step,
    "A plate beside another surface": plate_beside_another,
    "The run is there already": same_run,
    "The settings changed": other_run,
    "A folder that is no run": lambda reader: reader.type("solve", "runs/nothing"),
    "A stage is missing": missing_stage,
    "A run was interrupted": interrupted,
    "The disk is full": full,
    "Somebody else is writing": second_writer,
    "A damaged file": damaged,
    "Started under mpirun": under_mpi,
}


@pytest.mark.parametrize("heading", PRINTED)
def test_a_message_is_printed_as_it_stands_there(heading, tmp_path, monkeypatch):
    said = one_line(PRINTED[heading](Reader(tmp_path, monkeypatch)))
    parts = map(re.escape, one_line(ENTRIES[heading]).split(GAP))
    assert re.fullmatch(".*".join(parts), said), f"{heading}: {said}"


# ---- the others: their fixed parts are in the source ------------------------------------------------


@cache
def templates():
    """Texts of the source, with a gap for each value that is put in."""
    found = [one_line((ROOT / "tools/setup.sh").read_text(encoding="utf-8"))]
    for path in [*ROOT.glob("porocore/**/*.py"), *ROOT.glob("plugins/*/porocore_*/*.py")]:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr):
                texts = [v.value if isinstance(v, ast.Constant) else GAP for v in node.values]
                found.append(one_line("".join(texts)))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(one_line(node.value))
    return found


@pytest.mark.parametrize("heading", [heading for heading in ENTRIES if heading not in (*PRINTED, STATUS)])
def test_the_fixed_parts_of_a_message_are_in_the_source(heading):
    text = re.sub(r"^(error|warning|setup|status): ", "", one_line(ENTRIES[heading]))
    parts = [part.strip() for part in text.split(GAP) if len(part.strip()) >= TELLING]
    assert parts
    for part in parts:
        assert any(part in template for template in templates()), f"{heading}: {part}"


def test_nothing_is_printed_that_the_page_does_not_have():
    assert set(PRINTED) <= set(ENTRIES)

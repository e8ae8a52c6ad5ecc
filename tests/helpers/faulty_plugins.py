"""Small projects of plugins, all but one with a fault, as a stranger would publish them; built and installed by pip."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from textwrap import dedent

PYPROJECT = """
[build-system]
requires = ["setuptools>=64"]
build-backend = "setuptools.build_meta"

[project]
name = "{name}"
version = "1.0"
dependencies = ["porocore"{needs}]

[project.entry-points.porocore]
{name} = "{module}"

[tool.setuptools]
py-modules = ["{module}"]
"""
#: A sampler, whose name is also that of another distribution.
GRID = """
    from porocore import Offer, hookimpl

    def _load():
        raise AssertionError("no class is imported of a name that is offered twice")

    @hookimpl
    def porocore_samplers():
        return [Offer(name="acme-grid", load=_load, summary="a grid")]
"""
#: Distribution → its module.
SOURCES = {
    # Nothing wrong with it: a cell in closed form.
    "acme-cell": """
        from porocore import Offer, hookimpl

        def _load():
            import numpy as np
            from porocore import CellSolution, CellSolver
            from porocore.testing.synthetic.cell import respond

            class AcmeCellSolver(CellSolver):
                def prepare(self, cell):
                    return cell

                def solve(self, prepared, states, *, start=None, tangent=True, fields=False):
                    return CellSolution(respond(states))

                def conductivity(self, prepared):
                    return np.eye(3)

            return AcmeCellSolver

        @hookimpl
        def porocore_cell_solvers():
            return [Offer(name="acme-cell", load=_load, summary="a cell in closed form")]
    """,
    "acme-grid-one": GRID,
    "acme-grid-two": GRID,
    "acme-broken": """
        raise OSError("libacme.so.3: cannot open shared object file")
    """,
    "acme-misspelt": """
        from porocore import Offer, hookimpl

        @hookimpl
        def porocore_macro_solver():
            return [Offer(name="acme-misspelt", load=dict, summary="a macro solver")]
    """,
    "acme-newer": """
        from porocore import Offer, hookimpl

        POROCORE_INTERFACES = {"surrogate": 2}

        @hookimpl
        def porocore_surrogates(interface, device):
            return [Offer(name="acme-newer", load=dict, summary="a surrogate")]
    """,
    "acme-lacking": """
        from porocore import Offer, hookimpl

        def _load():
            import acme_mathematics
            raise AssertionError("it needs a package that does not exist")

        @hookimpl
        def porocore_samplers():
            return [
                Offer(
                    name="acme-lacking",
                    load=_load,
                    summary="a sampler",
                    requires=("numpy", "acme_mathematics"),
                    install="pip install 'acme-lacking[mathematics]'",
                )
            ]
    """,
}


def write_project(folder: Path, name: str) -> Path:
    """The project of one distribution, complete."""
    module, project = name.replace("-", "_"), folder / name
    needs = ', "acme-mathematics>=2"' if name == "acme-lacking" else ""
    project.mkdir()
    (project / "pyproject.toml").write_text(PYPROJECT.format(name=name, module=module, needs=needs), "utf-8")
    (project / f"{module}.py").write_text(dedent(SOURCES[name]), "utf-8")
    return project


def install(folder: Path) -> Path:
    """All of them in a folder of their own, without the network; pip builds their wheels."""
    site = folder / "site"
    projects = [write_project(folder, name) for name in SOURCES]
    words = ["install", "--no-index", "--no-deps", "--no-build-isolation", "--target", site, *projects]
    done = subprocess.run(
        [sys.executable, "-m", "pip", "-q", "--disable-pip-version-check", *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return site

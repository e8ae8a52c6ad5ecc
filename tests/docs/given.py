"""What pages take for granted: the reader's own configuration, a finished run, files of data, a cluster's queue."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np

from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.meshing.mesh import MeshSettings, make_mesh
from tests.docs.clone import Clone

#: Words after which a name is one of something to be made.
_MADE = r"(?:--out|--to|-o|>|out=)\s*[\"']?"


def _configuration(clone: Clone, to: Path, finished: Callable[[], Path]) -> None:
    shutil.copyfile(clone.folder / "examples" / "dehghani2022.yaml", to)


def _run(clone: Clone, to: Path, finished: Callable[[], Path]) -> None:
    shutil.copytree(finished(), to)


def _samples(clone: Clone, to: Path, finished: Callable[[], Path]) -> None:
    shutil.copyfile(finished() / "samples.h5", to)


def _image(clone: Clone, to: Path, finished: Callable[[], Path]) -> None:
    """A cross of three square channels."""
    x, y, z = np.abs(np.indices((8, 8, 8)) - 3.5) < 2
    pores = (x & y) | (y & z) | (z & x)
    np.save(to, pores.astype(np.uint8))


def _mesh(*names: str) -> Callable[[Clone, Path, Callable[[], Path]], None]:
    """Channels with two solids, one above the other: names of both and of the fluid."""

    def write(clone: Clone, to: Path, finished: Callable[[], Path]) -> None:
        settings = MeshSettings(size=0.5, fluid_size=0.5, element="linear")
        meshes = [make_mesh(OrthogonalChannels(), settings, phase, "whole") for phase in ("solid", "fluid")]
        points = np.concatenate([mesh.points for mesh in meshes])
        cells = np.concatenate([meshes[0].cells, meshes[1].cells + len(meshes[0].points)])
        points, same = np.unique(points, axis=0, return_inverse=True)
        tags = np.repeat([1, 3], [len(mesh.cells) for mesh in meshes])
        tags[(points[same.reshape(-1)[cells]].mean(axis=1)[:, 2] > 0) & (tags == 1)] = 2
        data = {"gmsh:physical": [tags], "gmsh:geometrical": [tags]}
        field = {name: np.array([tag, 3]) for tag, name in enumerate(names, 1)}
        mesh = meshio.Mesh(points, [("tetra", same.reshape(-1)[cells])], cell_data=data, field_data=field)
        meshio.write(to, mesh, file_format="gmsh22")

    return write


def _surrogate(clone: Clone, to: Path, finished: Callable[[], Path]) -> None:
    to.write_text(
        "from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate\n\n\n"
        "class MySurrogate(PolynomialSurrogate):\n"
        "    def __init__(self, epochs):\n        super().__init__()\n",
        encoding="utf-8",
    )


def _queue(clone: Clone, to: Path, finished: Callable[[], Path]) -> None:
    """dask-jobqueue without SLURM: one worker in the process itself, whatever is asked for."""
    to.write_text(
        "from distributed import LocalCluster\n\n\n"
        "class SLURMCluster(LocalCluster):\n"
        "    def __init__(self, *, queue, account, cores, processes, memory, walltime, job_script_prologue,\n"
        "                 scheduler_options):\n"
        "        assert cores == processes and set(scheduler_options) == {'port'}\n"
        "        super().__init__(n_workers=0, threads_per_worker=1, processes=False, protocol='tcp',\n"
        "                         dashboard_address=None)\n\n"
        "    def scale(self, jobs):\n        super().scale(1)\n",
        encoding="utf-8",
    )


#: By name, for commands and Python; what imports a module needs its file.
GIVEN = {
    "my.yaml": _configuration,
    "runs/mine": _run,
    "a.h5": _samples,
    "b.h5": _samples,
    "pores.npy": _image,
    "cell.msh": _mesh("matrix", "fibres", "pores"),
    "bone.msh": _mesh("core", "coating", "marrow"),
    "my_surrogate": _surrogate,
    "dask_jobqueue": _queue,
}


def provide(text: str, folder: Path, clone: Clone, finished: Callable[[], Path]) -> None:
    """Make what a command or a piece of Python names and does not make itself, unless it is there."""
    for name, make in GIVEN.items():
        path = folder / (name if "." in name or "/" in name else f"{name}.py")
        used = re.search(rf"(?<![\w/.-]){re.escape(name)}(?![\w.-])", text)
        if used and not path.exists() and not re.search(_MADE + re.escape(name), text):
            path.parent.mkdir(parents=True, exist_ok=True)
            make(clone, path, finished)

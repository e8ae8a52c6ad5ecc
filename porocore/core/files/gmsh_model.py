"""Faces and volumes of a gmsh model or .msh file; gmsh's sessions, one at a time in a process."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from porocore.core.parallel.limits import memory_limited
from porocore.errors import ConfigurationError, PorocoreError

SYSTEM_LIBRARIES = (
    "libglu1-mesa libgl1 libxrender1 libxcursor1 libxfixes3 libxft2 libfontconfig1 libxinerama1 libgomp1"
)
_ONE_AT_A_TIME = threading.Lock()


def import_gmsh() -> Any:
    """Return the module gmsh, or raise an error that names the libraries it needs."""
    try:
        import gmsh
    except (ImportError, OSError) as error:
        raise PorocoreError(
            f"gmsh cannot be loaded ({error}); it needs some system libraries: on Debian or Ubuntu run "
            f"apt-get install {SYSTEM_LIBRARIES}"
        ) from error
    return gmsh


@contextmanager
def gmsh_session() -> Iterator[Any]:
    """Yield gmsh with an empty model, on one thread and without output; other threads wait until it ends.

    gmsh reads no configuration of the user's and leaves signals alone, so that it runs off the main thread too.

    Raises
    ------
    PorocoreError
        gmsh cannot be loaded, or the program that calls porocore has a session of its own, whose options would change
        the mesh.
    """
    gmsh = import_gmsh()
    with _ONE_AT_A_TIME:
        if gmsh.isInitialized():
            raise PorocoreError(
                "gmsh is in use by this program already, and its options would change the mesh; call gmsh.finalize() "
                "before porocore makes or reads a mesh"
            )
        gmsh.initialize(readConfigFiles=False, interruptible=False)
        try:
            gmsh.option.setNumber("General.Terminal", 0)
            gmsh.option.setNumber("General.NumThreads", 1)
            yield gmsh
        finally:
            gmsh.finalize()


def open_file(gmsh: Any, path: Path) -> None:
    """Read a file into the current model.

    Raises
    ------
    ConfigurationError
        A file of options lies beside it, which gmsh reads as well, and whose commands it executes.
    Exception
        gmsh cannot read it; gmsh raises nothing else.
    """
    options = path.with_name(f"{path.name}.opt")
    if options.exists():
        raise ConfigurationError(
            f"gmsh would also read {options.name}, which lies beside {path.name}, and execute its commands; move it "
            "elsewhere"
        )
    gmsh.open(str(path))


#: What reading a file may take beyond what its size explains: time [s] and memory [bytes].
SECONDS, MEMORY = 60.0, 1 << 30
#: Bytes that are read in a second at least, and memory for each byte of a file.
PER_SECOND, PER_BYTE = 1e6, 60
#: It finds what this process finds, whatever the environment and the folder say.
_COMMAND = "import sys; sys.path[:] = sys.argv[6:]; from porocore.core.files.gmsh_model import serve; serve()"
#: Exit status of the process after a refusal, whose text it prints.
_REFUSED = 3

Arrays = Mapping[str, Any]


def model_arrays(gmsh: Any, flat: bool = False) -> dict[str, Any]:
    """Return faces and volumes of gmsh's current model as plain arrays; of a ``flat`` one its edges and faces.

    Returns
    -------
    tags, points : (nodes,), (nodes, 3)
        Numbers of the nodes, ascending, and their places.
    blocks : (blocks, 3)
        Dimension, type and entity of each block of elements. Block i has ``elements{i}`` (k,), their numbers,
        ``nodes{i}`` (k, n), the numbers of their nodes, and ``groups{i}``, its physical groups.
    kinds, views
        Texts in JSON: gmsh's names of the types and of the data of elements. Data j have ``view{j}`` (k,), numbers of
        elements, and ``values{j}`` (k, components).
    """
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(tags)
    found: dict[str, Any] = {"tags": tags[order], "points": coordinates.reshape(-1, 3)[order]}
    # A node with the number 0 gets another from gmsh, which one of the file's own may have.
    if (twice := np.flatnonzero(np.diff(found["tags"]) == 0)).size:
        raise ConfigurationError(
            f"gmsh gives the number {found['tags'][twice[0]]} to two nodes, as in a file whose nodes are numbered from "
            "0; number nodes and elements from 1"
        )
    blocks, views = list[tuple[int, int, int]](), list[str]()
    kinds: dict[int, str] = {}
    for dim in (1, 2) if flat else (2, 3):
        for _, entity in gmsh.model.getEntities(dim):
            if entity < 0:
                raise ConfigurationError(
                    f"expected numbers of groups from 1, got {entity}; give that group a positive number"
                )
            groups = gmsh.model.getPhysicalGroupsForEntity(dim, entity)
            # Of a mesh that is divided among processes, which has parts of entities, and faces between such parts.
            parent_dim, parent = gmsh.model.getParent(dim, entity)
            if parent_dim > dim:
                continue
            for type_, elements, nodes in zip(*gmsh.model.mesh.getElements(dim, entity), strict=True):
                i = len(blocks)
                found[f"elements{i}"], found[f"nodes{i}"] = elements, nodes.reshape(len(elements), -1)
                found[f"groups{i}"] = np.abs(groups)
                blocks.append((dim, type_, parent if parent_dim == dim else entity))
                kinds[int(type_)] = gmsh.model.mesh.getElementProperties(type_)[0]
    joint = np.concatenate(
        [np.empty(0, dtype=np.uint64), *(found[f"elements{i}"] for i in range(len(blocks)))]
    )
    for view in gmsh.view.getTags():
        if len(np.unique(joint)) < len(joint):
            raise ConfigurationError(
                "two elements have one number, as where they are numbered from 0, so that their data are not known; "
                "number nodes and elements from 1"
            )
        kind, tags, values, _, _ = gmsh.view.getModelData(view, 0)
        if kind == "ElementData" and len({len(each) for each in values}) == 1:
            order = np.argsort(tags)
            found[f"view{len(views)}"] = np.asarray(tags)[order]
            found[f"values{len(views)}"] = np.array(values, dtype=float)[order]
            views.append(gmsh.view.option.getString(view, "Name"))
    texts = {"kinds": kinds, "views": views}
    found["blocks"] = np.array(blocks, dtype=np.int64).reshape(-1, 3)
    return found | {name: np.array(json.dumps(text)) for name, text in texts.items()}


def file_arrays(path: Path, by_group: bool, flat: bool = False) -> Arrays:
    """Return :func:`model_arrays` of a .msh file, read by another process, which a crash of gmsh ends instead of this.

    Parameters
    ----------
    path
        The file.
    by_group
        Take the physical group of each element for its entity. In formats before 4 each element has a group of its
        own, of which gmsh keeps only that some element of the entity has it.
    flat
        As in :func:`model_arrays`.

    Raises
    ------
    ConfigurationError
        gmsh cannot read it, crashes or comes to no end; the message begins with the path.
    PorocoreError
        gmsh cannot be loaded.
    """
    size = path.stat().st_size
    anew = "it is damaged or cut short: save it anew, as .msh of version 4.1 or 2.2"
    with TemporaryDirectory(prefix="porocore-") as folder:
        result = Path(folder) / "mesh.npz"
        memory = str(MEMORY + PER_BYTE * size)
        words = [str(path.absolute()), str(result), str(int(by_group)), memory, str(int(flat))]
        try:
            done = subprocess.run(
                [sys.executable, "-I", "-c", _COMMAND, *words, *sys.path],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=SECONDS + size / PER_SECOND,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise ConfigurationError(f"{path}: gmsh comes to no end with this file; {anew}") from error
        printed = done.stdout.decode("utf-8", "replace").strip()
        if done.returncode == _REFUSED:
            told = json.loads(printed)
            if told["kind"] == "other":
                raise PorocoreError(told["text"])
            if told["kind"] == "file":
                raise ConfigurationError(f"{path}: {told['text']}")
            raise ConfigurationError(f"{path}: not a mesh that gmsh can read; {anew}")
        if done.returncode != 0:
            raise ConfigurationError(f"{path}: gmsh crashes with this file; {anew}")
        with np.load(result, allow_pickle=False) as arrays:
            return dict(arrays)


def serve() -> None:
    """Read the file that the command line of this process names, and write its arrays to another one."""
    path, result, by_group, memory, flat = sys.argv[1:6]
    memory_limited(int(memory))
    kind = "other"
    try:
        with gmsh_session() as gmsh:
            gmsh.option.setNumber("Mesh.SwitchElementTags", float(by_group))
            kind = "gmsh"
            open_file(gmsh, Path(path))
            arrays = model_arrays(gmsh, flat == "1")
            kind = "other"
            np.savez(result, **arrays)
    except Exception as error:  # gmsh raises plain Exception
        kind = "file" if isinstance(error, ConfigurationError | UnicodeDecodeError) else kind
        # The words of gmsh are left out: such as 'Error loading' they say less than what is said of the file.
        text = "" if kind == "gmsh" else str(error) or type(error).__name__
        if isinstance(error, UnicodeDecodeError):
            text = "the name of data is not UTF-8; save the file as UTF-8, or use ASCII letters in names"
        sys.stdout.write(json.dumps({"kind": kind, "text": text}))
        sys.stdout.flush()
        raise SystemExit(_REFUSED) from error

"""The user's store, which all studies share: its folder, hashes (keys) of cells and trainings, files."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from platformdirs import user_cache_path

from porocore.cell.cell import Cell
from porocore.core.console import duration
from porocore.core.files.atomic import atomic_path
from porocore.core.files.plain_data import stable_hash
from porocore.core.files.store import ResultStore
from porocore.interfaces.records import flatten_response
from porocore.interfaces.surrogate import TrainingSet
from porocore.plugins.registry import registry
from porocore.sampling.execution.solved_store import SolvedStore
from porocore.states import Array, CellResponse, MacroState

#: Version of the equations of porocore and of their discretisation: raised with every correction that changes a number
#: of a cell or of a surrogate, so that no store returns the old one. ``tests/study/test_store.py`` holds it to numbers.
PHYSICS = 2
#: Environment variable with the folder of the store, or ``none``.
VARIABLE, NONE = "POROCORE_STORE", "none"
#: Packages whose versions change meshes or the last bits of a solution.
_PACKAGES = ("gmsh", "numpy", "scipy")


def user_store() -> ResultStore | None:
    """Return the store in the user's cache folder, or where ``POROCORE_STORE`` says; None if that says ``none``."""
    given = os.environ.get(VARIABLE, "")
    if given == NONE:
        return None
    return ResultStore(Path(given) if given else user_cache_path("porocore") / "store")


def chosen_store(store: ResultStore | str | Path | bool) -> ResultStore | None:
    """Return the store at a path; the user's for True, none for False."""
    if isinstance(store, ResultStore):
        return store
    if store is True:
        return user_store()
    return None if store is False else ResultStore(Path(store))


def solved_states(
    store: ResultStore | None,
    backend: str,
    options: dict[str, Any],
    cell: Cell,
    conductivity: str = "piola",
    *,
    tangent: bool = True,
    fields: bool = True,
) -> SolvedStore | None:
    """Return the solved states of a cell in the store, with ``tangent`` and ``fields`` of each solve.

    Those of a family are found by their members.
    """
    if store is None:
        return None
    identity = cell_key(backend, options, cell, conductivity)
    if not cell.is_family:
        return SolvedStore(store, identity, tangent, fields)

    @cache
    def key_of(values: tuple[float, ...]) -> str:
        return cell_key(backend, options, cell.at(values), conductivity)

    def member(values: Array) -> str:
        return key_of(tuple(values.tolist()))

    return SolvedStore(store, identity, tangent, fields, member=member)


def solved_members(
    store: ResultStore | None, backend: str, options: dict[str, Any], cell: Cell
) -> SolvedStore | None:
    """Return the undeformed members of a family in the store, which hold K besides what a solved state holds."""
    if store is None:
        return None

    def member(values: Array) -> str:
        return _hash("undeformed", cell_key(backend, options, cell.at(values), "piola"))

    identity = cell_key(backend, options, cell, "piola")
    return SolvedStore(store, identity, tangent=True, fields=False, member=member)


@contextmanager
def taken(known: SolvedStore | None, then: Callable[[int, float], None]) -> Iterator[None]:
    """Call ``then`` with the number of states that the block took from the store and the seconds that this saved."""
    found, saved = (known.found, known.saved) if known else (0, 0.0)
    try:
        yield
    finally:
        if known is not None and known.found > found:
            then(known.found - found, known.saved - saved)


@contextmanager
def told(
    known: SolvedStore | None,
    title: str,
    tell: Callable[[str], None],
    count: Callable[[float], None] = lambda seconds: None,
    workers: int = 1,
) -> Iterator[None]:
    """Tell how many states the block took from the store; tell and ``count`` the seconds that this saved."""

    def then(states: int, seconds: float) -> None:
        took, several = seconds / workers, "states" if states > 1 else "state"
        count(took)
        tell(f"{title}: {states} {several} came from the store, which saved about {duration(took)}")

    with taken(known, then):
        yield


def cell_key(backend: str, options: dict[str, Any], cell: Cell, conductivity: str) -> str:
    """Return the hash of all that the responses of a cell depend on, but the state."""
    solver = code_of(registry().get("cell solver", backend))
    # Slopes are those by its parameters, which the numbers of a member do not tell.
    varied = [parameter.key for parameter in cell.parameters]
    # The other laws of the flux change no response, only what is made of it.
    return _hash(
        solver, options, cell.specification(), conductivity == "deformed", *([varied] if varied else [])
    )


def training_key(backend: str, options: dict[str, Any], seed: int, data: TrainingSet) -> str:
    """Return the hash of all that a trained surrogate depends on."""
    fitted = code_of(registry().get("surrogate", backend))
    described = repr((data.inputs, data.identity, data.symmetry, data.tolerance))
    learned = arrays_hash(data.states, data.responses)
    return _hash(fitted, options, seed, described, learned, arrays_hash(MacroState.zeros(1), data.reference))


def arrays_hash(states: MacroState, responses: CellResponse) -> str:
    """Return the hash of states and their responses."""
    digest = hashlib.sha256()
    for array in (*states.arrays(), responses.status, *flatten_response(responses).values()):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def fetch_files(store: ResultStore | None, key: str, paths: Mapping[str, Path]) -> float | None:
    """Write files from the store.

    Parameters
    ----------
    store
        None: there is none.
    key
        The hash of all that the files depend on.
    paths
        Each file by its kind in the store; only the first must be there.

    Returns
    -------
    float or None
        Seconds that the files had taken; None if the store does not hold the first of them.
    """
    (first, main), *others = paths.items()
    found = None if store is None else store.find(first, key)
    if store is None or found is None:
        return None
    for kind, path in others:
        if more := store.find(kind, key):
            _write(path, more.payload)
    _write(main, found.payload)
    return float(found.facts["seconds"])


def keep_files(store: ResultStore | None, key: str, paths: Mapping[str, Path], seconds: float) -> None:
    """Keep the files that :func:`fetch_files` writes; those that do not exist are left out."""
    if store is None:
        return
    for kind, path in reversed(list(paths.items())):
        if path.exists():
            store.keep(kind, key, path.read_bytes(), {"seconds": seconds})


def _write(path: Path, payload: bytes) -> None:
    with atomic_path(path) as part:
        part.write_bytes(payload)


def code_of(implementation: type[Any]) -> dict[str, Any]:
    """Return the versions of porocore and of a plugin, and the hash of the plugin's sources.

    The sources count because a plugin that is being developed changes under one version.
    """
    package = implementation.__module__.partition(".")[0]
    names = ["porocore", *_distributions().get(package, ()), *_PACKAGES]
    digest = hashlib.sha256()
    if package != "porocore":
        file = sys.modules[package].__file__
        assert file is not None
        sources = Path(file).parent.rglob("*.py") if Path(file).name == "__init__.py" else [Path(file)]
        for source in sorted(sources):
            digest.update(source.read_bytes())
    return {
        "class": f"{implementation.__module__}.{implementation.__qualname__}",
        "physics": PHYSICS,
        "versions": {name: metadata.version(name) for name in sorted(set(names))},
        "sources": digest.hexdigest(),
    }


@cache
def _distributions() -> Mapping[str, list[str]]:
    """Return the distributions of each package; they are read once, which takes half a second."""
    return metadata.packages_distributions()


def _hash(*parts: Any) -> str:
    return stable_hash(json.dumps(parts, sort_keys=True, default=str), length=40)

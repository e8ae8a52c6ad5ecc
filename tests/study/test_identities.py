"""The digests by which files are recognised: those of earlier versions, to the last bit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import CellMesh
from porocore.commands.sensitivity.plan import StudyPlan
from porocore.commands.sensitivity.study import study_identity
from porocore.core.files.plain_data import json_hash, stable_hash
from porocore.interfaces.law import fingerprint
from porocore.macro.integration.checkpoint import CheckpointFile
from porocore.study.config.config import FemSettings
from porocore.study.config.loading import benchmark_path, load_config
from porocore.surrogates.file.file import _checksum
from porocore.surrogates.mean_gradient import ScaledData
from porocore.testing.synthetic.response import confined_column, linear_law

NUMBERS = np.arange(6.0).reshape(2, 3)
DATA = ScaledData(NUMBERS, (1, 4), NUMBERS[0], NUMBERS.T, NUMBERS[:1], NUMBERS)
FEM = FemSettings(backend="skfem")


def mesh_hash(*regions: str) -> str:
    mesh: Any = SimpleNamespace(
        points=NUMBERS, cells=np.array([[0, 1]]), regions=np.array([1]), region_names=regions
    )
    return CellMesh.__dict__["hash"].func(mesh)


def checkpoint_owner() -> str:
    discretisation: Any = SimpleNamespace(problem=confined_column(3))
    return CheckpointFile(None, discretisation, linear_law(), 1.0)._owner


#: Of the long ones, the first twenty digits.
DIGESTS = {
    "cell": (lambda: Cell().identity, "57951b453851917c"),
    "mesh": (lambda: mesh_hash("solid"), "a7b5110f29a507dd"),
    "mesh of two solids": (lambda: mesh_hash("matrix", "fibre"), "3a0d3742e41562a8"),
    "law": (lambda: fingerprint("a", 1.5, NUMBERS), "a56abe2c388e57fd"),
    "checkpoint": (checkpoint_owner, "155fef91a85989a0d4f8"),
    "run": (lambda: load_config(benchmark_path()).identity, "e3dad5a3bc1bd9a8"),
    "archive": (lambda: _checksum("head", {"b": NUMBERS, "a": NUMBERS[0]}), "ba5f7414ab288915af33"),
    "scaled data": (lambda: DATA.fingerprint("mlp", "5"), "d5f0794de7689fb0c1ee"),
    "sensitivity": (lambda: study_identity(Cell(), FEM, StudyPlan()), "ce8dbf99685e7c7d"),
    "deformed": (lambda: study_identity(Cell(), FEM, StudyPlan(), "deformed"), "00f7ba933dbb4aee"),
}


@pytest.mark.parametrize("name", DIGESTS)
def test_digests_are_those_of_earlier_versions(name):
    digest, expected = DIGESTS[name]
    assert digest()[:20] == expected


def test_parts_of_a_hash_are_joined():
    """``abc`` is the example of the standard, FIPS 180-2."""
    expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert stable_hash("abc") == stable_hash("a", b"bc") == expected
    assert stable_hash("abc", length=12) == expected[:12]
    assert json_hash({"b": 1, "a": 2}, sort_keys=True) == json_hash({"a": 2, "b": 1})

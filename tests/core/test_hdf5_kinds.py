"""Files of another kind: what porocore writes is known by its format, and is not called damaged."""

from __future__ import annotations

from pathlib import Path

import pytest

from porocore.cell.stability import map as stability
from porocore.commands.sensitivity import results as sensitivity
from porocore.core.hdf5 import KINDS
from porocore.errors import DataError
from porocore.macro.integration import checkpoint
from porocore.sampling.datasets import dataset
from porocore.surrogates.file import file as surrogate
from porocore.surrogates.network import training
from tests.helpers.hdf5_samples import KINDS as SAMPLES


def test_every_format_is_known() -> None:
    rooms = (checkpoint, dataset, sensitivity, stability, surrogate, training)
    assert KINDS.keys() == {"porocore-solution", *(room.FORMAT for room in rooms)}


@pytest.mark.parametrize("written", SAMPLES)
@pytest.mark.parametrize("wanted", SAMPLES)
def test_a_sound_file_of_another_kind_is_named(written: str, wanted: str, tmp_path: Path) -> None:
    path = tmp_path / "one.h5"
    write, read = SAMPLES[written][0], SAMPLES[wanted][1]
    write(path)
    if written == wanted:
        read(path)
        return
    with pytest.raises(DataError, match="which is undamaged; 'porocore ") as refused:
        read(path)
    assert "again" not in str(refused.value)
    assert "elsewhere" not in str(refused.value)

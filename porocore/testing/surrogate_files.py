"""Files of a surrogate: read as they were written, or refused, and nothing in them is executed."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from porocore.errors import DataError
from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.testing.compare import assert_identical
from porocore.testing.surrogate_fitting import Fitting


class Files(Fitting):
    """Part of :class:`porocore.testing.surrogate.SurrogateSuite`."""

    def test_saved_and_loaded_it_is_the_same(
        self, fitted: Surrogate, saved: Path, data: TrainingSet, unseen: TrainingSet
    ) -> None:
        loaded = type(fitted).load(saved)
        assert_identical(fitted.predict(unseen.states), loaded.predict(unseen.states))
        for surrogate in (fitted, loaded):
            assert surrogate.identity == data.identity
            assert surrogate.inputs == data.inputs
            assert surrogate.provenance == data.provenance
        assert [path.name for path in saved.parent.iterdir()] == [saved.name]

    @pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.7, 0.999])
    def test_a_truncated_file_is_refused(self, fitted: Surrogate, saved: Path, share: float) -> None:
        whole = saved.read_bytes()
        saved.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(DataError, match=saved.name):
            type(fitted).load(saved)

    def test_a_damaged_file_is_refused_or_harmless(
        self, fitted: Surrogate, saved: Path, unseen: TrainingSet
    ) -> None:
        """A byte may lie in a part of the file that means nothing; it must never change a number."""
        whole, refused = bytearray(saved.read_bytes()), 0
        places = np.random.default_rng(0).integers(len(whole), size=60)
        for place in places:
            damaged = whole.copy()
            damaged[place] ^= 0x55
            saved.write_bytes(damaged)
            try:
                loaded = type(fitted).load(saved)
            except DataError:
                refused += 1
            else:
                assert_identical(fitted.predict(unseen.states), loaded.predict(unseen.states))
        assert refused > len(places) / 3

    def test_a_foreign_file_is_refused(self, fitted: Surrogate, tmp_path: Path) -> None:
        text, other, missing = tmp_path / "notes.txt", tmp_path / "other.h5", tmp_path / "missing.h5"
        text.write_text("not a surrogate")
        with h5py.File(other, "w") as file:
            file["numbers"] = np.arange(3.0)
        for path in (text, other, missing):
            with pytest.raises(DataError, match=path.name):
                type(fitted).load(path)

    def test_reading_executes_nothing(self, fitted: Surrogate, tmp_path: Path) -> None:
        """A file whose unpickling would make a folder; written by hand, as pickle would."""
        made, path = tmp_path / "made", tmp_path / "surrogate.h5"
        path.write_bytes(b"cos\nmkdir\n(V" + str(made).encode() + b"\ntR.")
        with pytest.raises(DataError):
            type(fitted).load(path)
        assert not made.exists()

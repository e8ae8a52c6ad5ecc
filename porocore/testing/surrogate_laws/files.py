"""Laws of a surrogate's file: read as written, refused if damaged, nothing executed."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest

from porocore.errors import DataError
from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.testing import other_process
from porocore.testing.compare import assert_identical
from porocore.testing.expect import holds, near, refused
from porocore.testing.surrogate_laws.fitting import Fitting
from porocore.testing.surrogate_laws.other_process import arrays

#: Of the largest value of a response.
ROUND_OFF = 1e-13


class Files(Fitting):
    """Part of :class:`porocore.testing.surrogate_laws.base.SurrogateSuite`."""

    def test_saved_and_loaded_it_is_the_same(
        self, fitted: Surrogate, saved: Path, data: TrainingSet, unseen: TrainingSet
    ) -> None:
        loaded = type(fitted).load(saved)
        assert_identical(loaded.predict(unseen.states), fitted.predict(unseen.states), "read back")
        for surrogate, state in ((fitted, "trained"), (loaded, "read back")):
            for name in ("identity", "inputs", "provenance"):
                found, expected = getattr(surrogate, name), getattr(data, name)
                holds(found == expected, state, f"{name} of the training set, {expected!r}", repr(found))
        names = [path.name for path in saved.parent.iterdir()]
        holds(names == [saved.name], "saved", "one file", names)

    def test_a_file_that_was_moved_is_enough(
        self, fitted: Surrogate, unseen: TrainingSet, tmp_path: Path
    ) -> None:
        """Another process reads a moved file to round-off, and nothing is unpickled."""
        original, moved = tmp_path / "original", tmp_path / "elsewhere" / "moved.h5"
        original.mkdir()
        moved.parent.mkdir()
        fitted.save(original / "surrogate.h5")
        (original / "surrogate.h5").rename(moved)
        shutil.rmtree(original)
        states, answer = tmp_path / "states.npz", tmp_path / "answer.npz"
        np.savez(states, grad_u=unseen.states.grad_u, p=unseen.states.p)
        state = "its one file, moved to another folder, read by another process"
        question = "porocore.testing.surrogate_laws.other_process:predict"
        facts = {"file": str(moved), "states": str(states), "answer": str(answer)}
        calls = other_process.ask(type(self), question, state, moved.parent, **facts)
        with np.load(answer) as found:
            for name, values in arrays(fitted.predict(unseen.states)).items():
                # Another process may sum in another order.
                within = (
                    ROUND_OFF * float(np.nanmax(np.abs(values), initial=0.0))
                    if values.dtype == float
                    else 0.0
                )
                near(name, found.get(name), values, state, within=within)
        holds(not calls, state, "that reading it unpickles nothing", ", ".join(calls))

    @pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.7, 0.999])
    def test_a_truncated_file_is_refused(self, fitted: Surrogate, saved: Path, share: float) -> None:
        whole = saved.read_bytes()
        saved.write_bytes(whole[: int(share * len(whole))])
        state = f"the first {100 * share:g} % of the file"
        with refused(DataError, state=state, naming=(saved.name,)):
            type(fitted).load(saved)

    def test_a_damaged_file_is_refused_or_harmless(
        self, fitted: Surrogate, saved: Path, unseen: TrainingSet
    ) -> None:
        """A byte may lie in a part of the file that means nothing; it must never change a number."""
        whole, count = bytearray(saved.read_bytes()), 0
        places = np.random.default_rng(0).integers(len(whole), size=60)
        for place in places:
            damaged = whole.copy()
            damaged[place] ^= 0x55
            saved.write_bytes(damaged)
            try:
                loaded = type(fitted).load(saved)
            except DataError:
                count += 1
            else:
                state = f"byte {place} of {len(whole)} changed"
                assert_identical(loaded.predict(unseen.states), fitted.predict(unseen.states), state)
        state = f"one byte changed, at {len(places)} places"
        holds(count > len(places) / 3, state, "a DataError at a third of them", f"{count}")

    def test_a_foreign_file_is_refused(self, fitted: Surrogate, tmp_path: Path) -> None:
        text, other, missing = tmp_path / "notes.txt", tmp_path / "other.h5", tmp_path / "missing.h5"
        text.write_text("not a surrogate")
        with h5py.File(other, "w") as file:
            file["numbers"] = np.arange(3.0)
        for path in (text, other, missing):
            with refused(DataError, state=f"a foreign file, {path.name}", naming=(path.name,)):
                type(fitted).load(path)

    def test_reading_executes_nothing(self, fitted: Surrogate, tmp_path: Path) -> None:
        """A file whose unpickling would make a folder; written by hand, as pickle would."""
        made, path = tmp_path / "made", tmp_path / "surrogate.h5"
        path.write_bytes(b"cos\nmkdir\n(V" + str(made).encode() + b"\ntR.")
        state = "a pickle that makes a folder"
        with suppress(Exception):
            type(fitted).load(path)
        holds(not made.exists(), state, "that nothing is executed", "the folder")
        with refused(DataError, state=state):
            type(fitted).load(path)

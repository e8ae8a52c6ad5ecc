"""Surrogates that break one law of their files each."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import ClassVar
from unittest.mock import patch

from porocore.errors import DataError
from tests.testing.wrong.polynomials import Altered, Law


class TestLosesItsProvenance(Law):
    caught_by = "test_saved_and_loaded_it_is_the_same"

    class surrogate(Altered):
        def save(self, path):
            kept, self.provenance = self.provenance, {}
            super().save(path)
            self.provenance = kept


class TestLeavesAPart(Law):
    caught_by = "test_saved_and_loaded_it_is_the_same"

    class surrogate(Altered):
        def save(self, path):
            super().save(path)
            path.with_suffix(".part").touch()


class TestTakesAnyFile(Law):
    """What it saved last stands in where a file cannot be read."""

    caught_by = "test_a_truncated_file_is_refused"

    class surrogate(Altered):
        last = None

        def save(self, path):
            super().save(path)
            type(self).last = self

        @classmethod
        def load(cls, path):
            try:
                return super().load(path)
            except DataError:
                return cls.last


class TestTakesForeignFiles(TestTakesAnyFile):
    caught_by = "test_a_foreign_file_is_refused"


class TestNoChecksum(Law):
    caught_by = "test_a_damaged_file_is_refused_or_harmless"

    class surrogate(Altered):
        def save(self, path):
            with patch("porocore.surrogates.file.file._checksum", return_value="none"):
                super().save(path)

        @classmethod
        def load(cls, path):
            with (
                patch("porocore.surrogates.file.file._checksum", return_value="none"),
                patch("porocore.core.hdf5.check_ends", return_value=True),
            ):
                return super().load(path)


class TestUnpickles(Law):
    caught_by = "test_reading_executes_nothing"

    class surrogate(Altered):
        @classmethod
        def load(cls, path):
            try:
                return pickle.loads(path.read_bytes())
            except Exception as error:
                raise DataError(str(error)) from error


class TestHoldsAPath(Law):
    """Its file says where the numbers lie, which it keeps in memory too."""

    caught_by = "test_a_file_that_was_moved_is_enough"
    slow = True

    class surrogate(Altered):
        kept: ClassVar = {}

        def save(self, path):
            super().save(path)
            self.kept[str(path.absolute())] = path.read_bytes()
            path.write_text(str(path.absolute()))

        @classmethod
        def load(cls, path):
            place = path.read_text()
            copy = path.with_name("copy.h5")
            copy.write_bytes(cls.kept.get(place) or Path(place).read_bytes())
            return super().load(copy)


class TestNeedsAFileBesideIt(Law):
    caught_by = "test_a_file_that_was_moved_is_enough"
    slow = True

    class surrogate(Altered):
        def save(self, path):
            super().save(path)
            path.rename(path.with_suffix(".weights"))
            path.write_text("see beside")

        @classmethod
        def load(cls, path):
            return super().load(path.with_suffix(".weights"))


class TestPickles(Law):
    """A file of its own with numbers as a pickle, checked by a sum before it is read."""

    caught_by = "test_a_file_that_was_moved_is_enough"
    slow = True

    class surrogate(Altered):
        def save(self, path):
            super().save(path)
            path.write_bytes(pickle.dumps(path.read_bytes()))

        @classmethod
        def load(cls, path):
            copy = path.with_name("copy.h5")
            copy.write_bytes(pickle.loads(path.read_bytes()))
            return super().load(copy)

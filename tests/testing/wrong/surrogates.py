"""Surrogates that break one law each, made of the polynomial; the class attribute says which."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path
from typing import ClassVar
from unittest.mock import patch

import numpy as np

from porocore.errors import DataError
from porocore.interfaces.surrogate import TrainingProgress
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing import PotentialSuite

#: What was fitted to so many states: all sets of one size are alike here, and a fit takes longer than a law.
FITTED: dict[int, PolynomialSurrogate] = {}


class Altered(PolynomialSurrogate):
    """Answers what ``alter`` makes of the right response."""

    def fit(self, data, *, seed, checkpoint=None, on_progress=None):
        n = len(data.states)
        if n not in FITTED:
            FITTED[n] = PolynomialSurrogate(degree=4).fit(data, seed=seed)
        vars(self).update(vars(FITTED[n]))
        return self

    def alter(self, response, states):
        return response

    def predict(self, states, *, tangent=True):
        return self.alter(super().predict(states, tangent=tangent), states)


def with_slopes(response, **changed):
    if response.tangent is None:
        return response
    slopes = {name: change(getattr(response.tangent, name)) for name, change in changed.items()}
    return replace(response, tangent=replace(response.tangent, **slopes))


class _Law(PotentialSuite):
    kit_version = "3"
    random: ClassVar = False
    resumable: ClassVar = False
    caught_by: ClassVar[str]
    surrogate: ClassVar[type[PolynomialSurrogate]] = Altered

    @classmethod
    def make_surrogate(cls):
        return cls.surrogate()


class TestFine(_Law):
    caught_by = ""


class TestFlatDerivatives(_Law):
    caught_by = "test_shapes"

    class surrogate(Altered):
        def alter(self, response, states):
            return with_slopes(response, stress_p=lambda values: values.reshape(-1, 9))


class TestLearnsNothing(_Law):
    caught_by = "test_learns_the_map"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, mean_grad=0 * response.mean_grad)


class TestWrongSlopes(_Law):
    caught_by = "test_learns_the_derivatives"

    class surrogate(Altered):
        def alter(self, response, states):
            return with_slopes(response, fluid_volume_p=lambda values: 0.9 * values)


class TestWrongSign(_Law):
    caught_by = "test_derivatives_match_differences"

    class surrogate(Altered):
        def alter(self, response, states):
            return with_slopes(response, mean_grad_p=lambda values: -values)


class TestRowsKnowEachOther(_Law):
    caught_by = "test_rows_do_not_depend_on_the_batch_or_its_order"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, potential=response.potential + 1e-6 * len(states))


class TestValuesDependOnDerivatives(_Law):
    caught_by = "test_derivatives_only_where_they_are_wanted"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, stress=response.stress + 1e-9 * (response.tangent is None))


class TestChangesStates(_Law):
    caught_by = "test_inputs_are_not_changed"

    class surrogate(Altered):
        def alter(self, response, states):
            states.grad_u[:] *= 1.01
            return response


class TestChangesItsTrainingSet(_Law):
    caught_by = "test_inputs_are_not_changed"

    class surrogate(Altered):
        def fit(self, data, **how):
            super().fit(data, **how)
            data.responses.stress[:] *= 2
            return self


class TestProvidesLess(_Law):
    caught_by = "test_it_provides_what_it_says"

    class surrogate(Altered):
        provides = ("mean_grad", "stress", "conductivity")


class TestRestIsNotExact(_Law):
    caught_by = "test_reference_state_is_exact"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, fluid_volume=response.fluid_volume + 1e-6)


class TestNeverOutside(_Law):
    caught_by = "test_outside_is_flagged"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, outside_training_range=np.zeros(len(states), dtype=bool))


class TestSwallowsOptions(_Law):
    caught_by = "test_invalid_options_are_refused"

    class surrogate(Altered):
        def __init__(self, degree=None, model=None, **ignored):
            super().__init__(degree=degree)


class TestLosesItsProvenance(_Law):
    caught_by = "test_saved_and_loaded_it_is_the_same"

    class surrogate(Altered):
        def save(self, path):
            kept, self.provenance = self.provenance, {}
            super().save(path)
            self.provenance = kept


class TestLeavesAPart(_Law):
    caught_by = "test_saved_and_loaded_it_is_the_same"

    class surrogate(Altered):
        def save(self, path):
            super().save(path)
            path.with_suffix(".part").touch()


class TestTakesAnyFile(_Law):
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


class TestNoChecksum(_Law):
    caught_by = "test_a_damaged_file_is_refused_or_harmless"

    class surrogate(Altered):
        def save(self, path):
            with patch("porocore.surrogates.file.archive._checksum", return_value="none"):
                super().save(path)

        @classmethod
        def load(cls, path):
            with (
                patch("porocore.surrogates.file.archive._checksum", return_value="none"),
                patch("porocore.core.hdf5.contents.check_ends", return_value=True),
            ):
                return super().load(path)


class TestUnpickles(_Law):
    caught_by = "test_reading_executes_nothing"

    class surrogate(Altered):
        @classmethod
        def load(cls, path):
            try:
                return pickle.loads(path.read_bytes())
            except Exception as error:
                raise DataError(str(error)) from error


class TestChance(_Law):
    caught_by = "test_training_is_seeded"

    class surrogate(Altered):
        def fit(self, data, **how):
            self.bias = 1e-9 * np.random.default_rng().random()
            return super().fit(data, **how)

        def alter(self, response, states):
            return replace(response, potential=response.potential + self.bias)


class TestGlobalRandomNumbers(_Law):
    caught_by = "test_training_is_seeded"

    class surrogate(Altered):
        def fit(self, data, **how):
            np.random.random()  # noqa: NPY002
            return super().fit(data, **how)


class TestSeedIsIgnored(_Law):
    caught_by = "test_training_is_seeded"
    random: ClassVar = True


class TestNoise(_Law):
    """Of 1e-13, which every tolerance bears."""

    caught_by = "test_two_calls_give_the_same_to_the_last_bit"

    class surrogate(Altered):
        noise = np.random.default_rng(0)

        def alter(self, response, states):
            return replace(response, mean_grad=response.mean_grad * (1 + 1e-13 * self.noise.random()))


class TestHoldsAPath(_Law):
    """Its file says where the numbers lie, which it keeps in memory too."""

    caught_by = "test_a_file_that_was_moved_is_enough"

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


class TestNeedsAFileBesideIt(_Law):
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


class TestPickles(_Law):
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


class TestPromisesTooMuch(_Law):
    """It declares an error that it does not keep."""

    caught_by = "test_learns_the_map"

    class surrogate(Altered):
        expected_error = 1e-9


# ---- a training that can be resumed ---------------------------------------------------------------


class Stepwise(Altered):
    """Ten steps, of which each is noted in the checkpoint."""

    def fit(self, data, *, seed, checkpoint=None, on_progress=None):
        first = self.begin(checkpoint, [len(data.states), seed]) if checkpoint and checkpoint.exists() else 0
        for step in range(first, 10):
            if checkpoint:
                checkpoint.write_text(json.dumps([len(data.states), seed, step]))
            if on_progress:
                on_progress(TrainingProgress(step, 10, 1.0, 1.0))
        return super().fit(data, seed=seed)

    def begin(self, checkpoint, owner):
        try:
            *found, step = json.loads(checkpoint.read_text())
        except (ValueError, TypeError) as error:
            raise DataError(f"{checkpoint.name}: remove it") from error
        if found != owner:
            raise DataError(f"{checkpoint.name}: of another training; remove it")
        return step


class TestStepwise(_Law):
    resumable: ClassVar = True
    surrogate = Stepwise
    caught_by = ""


class TestBeginsAnew(_Law):
    resumable: ClassVar = True
    caught_by = "test_resumed_training_equals_an_uninterrupted_one"

    class surrogate(Stepwise):
        def begin(self, checkpoint, owner):
            super().begin(checkpoint, owner)
            return 0


class TestTakesOtherCheckpoints(_Law):
    resumable: ClassVar = True
    caught_by = "test_a_checkpoint_of_another_training_is_refused"

    class surrogate(Stepwise):
        def begin(self, checkpoint, owner):
            return json.loads(checkpoint.read_text())[-1]


class TestTakesTruncatedCheckpoints(_Law):
    resumable: ClassVar = True
    caught_by = "test_a_truncated_checkpoint_is_refused"

    class surrogate(Stepwise):
        def begin(self, checkpoint, owner):
            try:
                return super().begin(checkpoint, owner)
            except DataError as error:
                if "another" in str(error):
                    raise
                return 0


class TestLeavesACheckpoint(_Law):
    surrogate = Stepwise
    caught_by = "test_what_is_not_resumable_leaves_no_checkpoint"


# ---- potentials -----------------------------------------------------------------------------------


class TestNoFluidVolume(_Law):
    caught_by = "test_it_provides_a_potential"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, fluid_volume=None)


class TestEnergyAtRest(_Law):
    caught_by = "test_rest_is_free_of_energy_and_stress"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, potential=response.potential + 1e-9)


class TestSkewTangent(_Law):
    caught_by = "test_the_tangent_is_symmetric"

    class surrogate(Altered):
        def alter(self, response, states):
            return with_slopes(response, stress_grad_u=lambda A: A + 1e-6 * np.triu(np.ones((3, 3))))


class TestNotReciprocal(_Law):
    caught_by = "test_reciprocity"

    class surrogate(Altered):
        def alter(self, response, states):
            return with_slopes(response, stress_p=lambda values: 1.001 * values)


class TestNotObjective(_Law):
    caught_by = "test_objectivity"

    class surrogate(Altered):
        def alter(self, response, states):
            return replace(response, stress=response.stress + 1e-3 * states.grad_u)


class TestMakesEnergy(_Law):
    caught_by = "test_a_closed_cycle_does_no_work"

    class surrogate(Altered):
        def alter(self, response, states):
            stress = response.stress.copy()
            stress[:, 0, 1] += 0.1 * states.grad_u[:, 0, 0]
            return replace(response, stress=stress)

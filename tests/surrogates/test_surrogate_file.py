"""One file for every surrogate: the same to the last bit, or refused with one message; nothing in it is executed."""

import json
import pickle
import re
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from porocore.core.inputs import InputSpace, SampledRange
from porocore.core.tensors import TRIVIAL
from porocore.errors import DataError
from porocore.states import MacroState
from porocore.surrogates.conductivity import ConductivityModel
from porocore.surrogates.error_estimate.estimate import ErrorEstimate
from porocore.surrogates.file.file import FORMAT, VERSION, read, read_archive, write, write_archive
from porocore.surrogates.mean_gradient import AnchoredModel
from porocore.surrogates.model import PotentialModel
from porocore.surrogates.network.separable import SeparableNetwork
from porocore.surrogates.polynomial.monomials import Polynomial, plain
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.surrogates.portable import NumpySurrogate
from porocore.surrogates.rest import SingleRest
from porocore.surrogates.training_box import TrainingBox
from porocore.testing.expect import assert_identical
from porocore.testing.synthetic.porous_family import porous_training_set
from porocore.testing.synthetic.potential_cell import potential_training_set
from tests.helpers.surrogate_models import MODELS, RECORD, network


def entries(path):
    """Keys of the header and names of the arrays of a file."""
    header, arrays = read_archive(path, FORMAT, VERSION, "")
    return set(header) | {re.sub(r"/\d+/", "/l/", name) for name in arrays}


@pytest.fixture(params=MODELS)
def model(request):
    return MODELS[request.param]


@pytest.fixture
def path(tmp_path):
    """A whole file of a potential with a polynomial and a network."""
    write(tmp_path / "surrogate.h5", MODELS["network of some terms"], RECORD)
    return tmp_path / "surrogate.h5"


def states():
    random = np.random.default_rng(3)
    return MacroState(random.uniform(-0.1, 0.1, (20, 3, 3)), random.uniform(0, 0.2, 20))


def test_bit_by_bit(model, tmp_path):
    write(tmp_path / "one.h5", model, RECORD)
    found, record = read(tmp_path / "one.h5")
    assert record == RECORD
    assert_identical(
        found.predict(states(), tangent=True), model.predict(states(), tangent=True), "read back"
    )
    write(tmp_path / "two.h5", found, record)
    first, second = (read_archive(tmp_path / name, FORMAT, VERSION, "") for name in ("one.h5", "two.h5"))
    assert first[0] == second[0]
    assert first[1].keys() == second[1].keys()
    for name in first[1]:
        assert first[1][name].tobytes() == second[1][name].tobytes()


def test_numpy_reads_what_any_backend_wrote(model, tmp_path):
    write(tmp_path / "one.h5", model, RECORD)
    surrogate = NumpySurrogate.load(tmp_path / "one.h5")
    assert surrogate.identity == "cell-7"
    assert surrogate.accuracy == RECORD.accuracy
    assert surrogate.inputs == model.sampled.inputs
    assert surrogate.provides == (
        ("mean_grad",)
        if isinstance(model, AnchoredModel)
        else ("mean_grad", "potential", "stress", "fluid_volume")
    )
    assert_identical(surrogate.predict(states()), model.predict(states(), tangent=True), "read back")


def refused(path, *words):
    """Refused with one message that names the file, says what is wrong and what to do."""
    with pytest.raises(DataError) as error:
        NumpySurrogate.load(path)
    message = str(error.value)
    assert message.startswith(f"{path}: ")
    assert message.endswith("train the surrogate again")
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize("share", np.linspace(0, 0.999, 15))
def test_truncated(path, share):
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    refused(path, "not a complete file")


def test_edited(path):
    for name in ("rest/matrix", "network/0/weights", "coarse/coefficients", "range/offsets"):
        with h5py.File(path, "r+") as file:
            kept = file[name][...]
            changed = kept.copy()
            changed.flat[0] = np.nextafter(changed.flat[0], 9)
            file[name][...] = changed
        refused(path, "damaged or edited")
        with h5py.File(path, "r+") as file:
            file[name][...] = kept
        read(path)
    with h5py.File(path, "r+") as file:
        file["more"] = np.zeros(2)
    refused(path, "damaged or edited")


def test_an_edited_header(path):
    with h5py.File(path, "r+") as file:
        text = file["header"].asstr()[()]
        file["header"][()] = text.replace("cell-7", "cell-8")
    refused(path, "damaged or edited")


def test_another_version_or_kind(path):
    header, arrays = read_archive(path, FORMAT, VERSION, "")
    write_archive(path, FORMAT, VERSION + 1, header, arrays)
    refused(path, f"expected version {VERSION} of porocore-surrogate, got {VERSION + 1}")
    write_archive(path, "porocore-surrogate-training", VERSION, header, arrays)
    with pytest.raises(DataError, match="expected a trained surrogate, got the checkpoint of a training"):
        NumpySurrogate.load(path)
    write_archive(path, "my-surrogate", VERSION, header, arrays)
    refused(path, "expected a file of format porocore-surrogate, got my-surrogate")
    write_archive(path, FORMAT, VERSION, header | {"model": "tree"}, arrays)
    refused(path, "not a complete surrogate", "tree")


@pytest.mark.parametrize(
    "name",
    ["rest/matrix", "mean_grad/exponents", "network/1/biases", "range/normals", "network/terms/weights"],
)
def test_without_one_of_the_arrays(path, name):
    header, arrays = read_archive(path, FORMAT, VERSION, "")
    arrays.pop(name)
    write_archive(path, FORMAT, VERSION, header, arrays)
    refused(path, "not a complete surrogate", name)


WRONG = {
    "rest/matrix": np.zeros((6, 7)),
    "rest/mean": np.zeros(5),
    "network/0/weights": np.zeros((6, 9)),
    "network/1/biases": np.zeros(2),
    "network/terms/weights": np.ones(2),
    "network/terms/coefficients": np.ones((3, 2)),
    "coarse/coefficients": np.ones((1, 3)),
    "mean_grad/exponents": np.full((2, 7), -1.0),
    "inputs/lower": np.zeros(3),
    "range/normals": np.ones((4, 3)),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_shapes_with_a_right_checksum(path, name):
    header, arrays = read_archive(path, FORMAT, VERSION, "")
    write_archive(path, FORMAT, VERSION, header, arrays | {name: WRONG[name]})
    refused(path, "not a complete surrogate")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_none(path, value):
    header, arrays = read_archive(path, FORMAT, VERSION, "")
    for name in arrays:
        if not arrays[name].size:
            continue
        changed = arrays[name].copy()
        changed.flat[-1] = value
        write_archive(path, FORMAT, VERSION, header, arrays | {name: changed})
        refused(path, "not a complete surrogate", f"{name} holds numbers that are not finite")


@pytest.mark.parametrize("key", ["model", "inputs", "terms", "symmetry", "polynomials", "active", "options"])
def test_a_header_that_lacks_something(path, key):
    header, arrays = read_archive(path, FORMAT, VERSION, "")
    header.pop(key)
    write_archive(path, FORMAT, VERSION, header, arrays)
    refused(path, "not a complete surrogate", key)


# ---- nothing is executed ------------------------------------------------------------------------


class Payload:
    """Unpickling it makes a folder."""

    def __init__(self, folder):
        self.folder = folder

    def __reduce__(self):
        import os

        return os.mkdir, (str(self.folder),)


def test_a_pickle_is_refused_unread(tmp_path):
    made, path = tmp_path / "made", tmp_path / "surrogate.h5"
    path.write_bytes(pickle.dumps(Payload(made)))
    refused(path)
    assert not made.exists()
    pickle.loads(path.read_bytes())
    assert made.exists(), "the payload works, where it is read"


@pytest.mark.parametrize("place", ["rest/matrix", "header", "more"])
@pytest.mark.parametrize("kind", ["opaque", "bytes", "text"])
def test_pickled_content_is_refused_unread(path, tmp_path, place, kind):
    """In an HDF5 file that is otherwise whole."""
    made = tmp_path / "made"
    payload = pickle.dumps(Payload(made), protocol=0)
    with h5py.File(path, "r+") as file:
        if place in file:
            del file[place]
        if kind == "opaque":
            file.create_dataset(place, data=np.void(payload))
        elif kind == "bytes":
            file.create_dataset(place, data=np.frombuffer(payload, dtype=np.uint8))
        else:
            file.create_dataset(place, data=payload.decode("ascii"), dtype=h5py.string_dtype())
    refused(path)
    assert not made.exists()


def test_a_reference_to_another_file_is_not_followed(path, tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["matrix"] = np.eye(7)
    with h5py.File(path, "r+") as file:
        del file["rest/matrix"]
        file["rest/matrix"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "matrix")
    refused(path)


def test_json_is_all_that_the_header_is(path):
    with h5py.File(path) as file:
        header = json.loads(file["header"].asstr()[()])
    assert header["backend"] == "torch"
    assert header["identity"] == "cell-7"


def test_a_surrogate_says_how_good_it_was(tmp_path):
    surrogate = PolynomialSurrogate().fit(potential_training_set(30, seed=1), seed=0)
    surrogate.save(tmp_path / "surrogate.h5")
    loaded = PolynomialSurrogate.load(tmp_path / "surrogate.h5")
    assert loaded.accuracy == surrogate.accuracy
    assert 0 < loaded.accuracy["cross-validated slopes of W"] < 0.02
    assert loaded.settings == surrogate.settings


def test_the_documentation_lists_the_file(tmp_path):
    """Every array and every key of the header, and nothing else."""
    inputs = InputSpace(("H22", "p"), (-0.2, -0.02), (0.04, 0.24))
    sampled = SampledRange.around(inputs, np.random.default_rng(1).random((9, 2)))
    conductivity = ConductivityModel(
        SingleRest.from_numbers(TRIVIAL, np.eye(3), np.zeros((3, 3))),
        Polynomial(np.eye(2, dtype=np.int64), np.ones((6, 2))),
        (1, 6),
        TrainingBox((1, 6), np.zeros(2), np.ones(2)),
        sampled,
        ErrorEstimate(
            0.01,
            Polynomial(np.eye(2, dtype=np.int64), np.ones((42, 2))),
            None,
            (),
            np.ones(6),
            0.0,
            np.zeros((2, 2)),
        ),
    )
    page = Path(__file__).parents[2] / "docs" / "surrogates.md"
    found = set()
    for model in MODELS.values():
        slopes = isinstance(model, PotentialModel)
        o = 2 if slopes else len(model.components)
        estimate = ErrorEstimate(
            0.01,
            Polynomial(np.eye(2, dtype=np.int64), np.ones((7 if slopes else 7 * o, 2))),
            Polynomial(np.eye(7, dtype=np.int64)[:2], np.eye(2)) if slopes else None,
            (1, 6) if slopes else (),
            np.ones(o),
            0.0,
            np.zeros((2, 7 if slopes else 2)),
        )
        model = replace(model, estimate=estimate)
        write(tmp_path / "surrogate.h5", model, replace(RECORD, conductivity=conductivity))
        found |= entries(tmp_path / "surrogate.h5")
    family = PolynomialSurrogate(degree=5).fit(porous_training_set(30, 1, tolerance=0.01), seed=0)
    model = family.fitted
    part = SeparableNetwork(network(2, 3), plain(model.active), network(2, 3))
    write(
        tmp_path / "family.h5",
        replace(model, network=part),
        replace(RECORD, conductivity=family.conductivity),
    )
    found |= entries(tmp_path / "family.h5")
    listed = page.read_text(encoding="utf-8").split("## The file")[1]
    cells = [line.split("|")[1] for line in listed.splitlines() if line.startswith("| `")]
    assert {name for cell in cells for name in re.findall(r"`([\w/]+)`", cell)} == found
    assert f"version {VERSION} of `{FORMAT}`" in listed


@pytest.fixture(scope="module")
def with_conductivity(tmp_path_factory):
    """A whole file of a potential with a conductivity. Not to be changed."""
    path = tmp_path_factory.mktemp("conductivity") / "surrogate.h5"
    rest = potential_training_set(30, seed=1)
    K = np.tile(2 * np.eye(3), (31, 1, 1))
    data = replace(
        rest,
        responses=replace(rest.responses, conductivity=K[:30] * (1 + rest.states.p[:, None, None])),
        reference=replace(rest.reference, conductivity=K[30:]),
        tolerance=0.01,
    )
    PolynomialSurrogate(degree=3).fit(data, seed=0).save(path)
    return path


@pytest.mark.parametrize(
    "entry",
    [
        "polynomial/coefficients",
        "range/normals",
        "estimate/spread",
        "estimate/safe",
        "estimate/polynomials/coefficients",
    ],
)
def test_a_conductivity_of_wrong_shapes_is_refused(with_conductivity, tmp_path, entry):
    path = tmp_path / "surrogate.h5"
    header, arrays = read_archive(with_conductivity, FORMAT, VERSION, "")
    arrays[f"conductivity/{entry}"] = arrays[f"conductivity/{entry}"][:-1]
    write_archive(path, FORMAT, VERSION, header, arrays)
    with pytest.raises(DataError, match="not a complete surrogate"):
        NumpySurrogate.load(path)


@pytest.mark.parametrize("older", [5, 6])
def test_a_file_of_an_older_version_is_refused(path, older):
    header, arrays = read_archive(path, FORMAT, VERSION, "")
    write_archive(path, FORMAT, older, header, arrays)
    with pytest.raises(
        DataError,
        match=rf"expected version 7 of porocore-surrogate, got {older}; .* train the surrogate again",
    ):
        NumpySurrogate.load(path)

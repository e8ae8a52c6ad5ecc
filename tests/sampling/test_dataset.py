"""Solved states on the disk: nothing is lost, changed, or taken from a file that is not what it should be."""

from __future__ import annotations

import errno
import os
import shutil
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.errors import DataError, PluginError, RunFolderError
from porocore.interfaces.cell import CellField
from porocore.interfaces.records import SolvedState, build_response, flatten_response
from porocore.sampling.datasets import dataset as dataset_module
from porocore.sampling.datasets.dataset import Block, Dataset, Header, parts_folder, write_block
from porocore.states import CellResponse, MacroState, Status
from tests.helpers.fake_cell import response

INPUTS = InputSpace(("p", "H22"), (-0.1, -0.4), (0.2, 0.1))
PROVENANCE = {"configuration": "title: ∇u¹\n" * 9000, "numpy": np.__version__}


def record(i: int, *, field: str | None = "eighth", status: Status = Status.converged) -> SolvedState:
    """A solve whose numbers use all bits."""
    random = np.random.default_rng(i)
    x = (float(random.uniform(-0.1, 0.2)), float(random.uniform(-0.4, 0.1)))
    value = random.standard_normal((3, 3)) if status.has_values else np.full((3, 3), np.nan)
    state = INPUTS.scatter(x)
    kept = None
    if field:
        nodes = 5 if field == "eighth" else 40
        kept = CellField(state.grad_u[0], x[0], field, random.standard_normal((nodes, 3)))
    start = None if i == 0 else f"state {i - 1}"
    return SolvedState(
        f"state {i}", x, state, response(value, value[0, 0], status), random.random(), start, kept
    )


def records() -> list[SolvedState]:
    """Out of order, with a failed one, one without a field, and fields of two sizes."""
    return [
        record(4, field="whole"),
        record(0),
        record(2, field=None, status=Status.overlap),
        record(3, status=Status.unstable),
        record(1),
    ]


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    """Five states, none of them merged."""
    made = Dataset.create(tmp_path / "data.h5", inputs=INPUTS, identity="abc", provenance=PROVENANCE)
    for one in records():
        made.append(one)
    return made


def assert_holds(dataset: Dataset, expected: list[SolvedState]) -> None:
    """Every bit of ``expected``, sorted by key."""
    expected = sorted(expected, key=lambda one: one.key)
    assert len(dataset) == len(expected)
    assert dataset.keys == [one.key for one in expected]
    np.testing.assert_array_equal(dataset.x(), [one.x for one in expected])
    np.testing.assert_array_equal(dataset.seconds(), [one.seconds for one in expected])
    assert dataset.starts() == [one.start for one in expected]
    states = MacroState.concatenate([one.state for one in expected])
    np.testing.assert_array_equal(dataset.states().grad_u, states.grad_u)
    np.testing.assert_array_equal(dataset.states().p, states.p)
    whole = CellResponse.concatenate([one.response for one in expected])
    assert_same_response(dataset.responses(), whole)
    for one in expected:
        assert one.key in dataset
        assert dataset.inputs_of(one.key) == one.x
        assert_same_response(dataset.response(one.key), one.response)
        kept = dataset.field(one.key)
        assert (kept is None) == (one.field is None)
        if kept is not None and one.field is not None:
            assert (kept.domain, kept.p) == (one.field.domain, one.field.p)
            np.testing.assert_array_equal(kept.grad_u, one.field.grad_u)
            np.testing.assert_array_equal(kept.u, one.field.u)


def assert_same_response(got: CellResponse, expected: CellResponse) -> None:
    np.testing.assert_array_equal(got.status, expected.status)
    first, second = flatten_response(got), flatten_response(expected)
    assert first.keys() == second.keys()
    for name in first:
        assert first[name].dtype == np.float64
        np.testing.assert_array_equal(first[name], second[name])


def test_what_was_appended_is_there_before_and_after_merging_and_reopening(dataset: Dataset) -> None:
    assert_holds(dataset, records())
    assert len(list(parts_folder(dataset.path).iterdir())) == 5
    assert_holds(Dataset.open(dataset.path), records())
    digest = dataset.digest()
    dataset.consolidate()
    assert not parts_folder(dataset.path).exists()
    assert_holds(dataset, records())
    again = Dataset.open(dataset.path, inputs=INPUTS, identity="abc")
    assert_holds(again, records())
    assert (again.inputs, again.identity, again.provenance) == (INPUTS, "abc", PROVENANCE)
    assert dataset.digest() == again.digest() == digest


def test_merging_adds_to_what_was_merged_before(dataset: Dataset) -> None:
    dataset.consolidate()
    more = [record(7, field="whole"), record(5), record(6, field=None)]
    again = Dataset.open(dataset.path)
    for one in more:
        again.append(one)
    assert_holds(again, records() + more)
    assert_holds(Dataset.open(dataset.path), records() + more)
    again.consolidate()
    assert_holds(Dataset.open(dataset.path), records() + more)


def test_parts_are_merged_when_there_are_many(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dataset_module, "MOST_PARTS", 4)
    made = Dataset.create(tmp_path / "data.h5", inputs=INPUTS, identity="abc")
    for i in range(11):
        made.append(record(i))
        folder = parts_folder(made.path)
        assert not folder.exists() or len(list(folder.iterdir())) <= 4
    assert_holds(Dataset.open(made.path), [record(i) for i in range(11)])


def test_an_empty_dataset_says_so(tmp_path: Path) -> None:
    made = Dataset.create(tmp_path / "data.h5", inputs=INPUTS, identity="abc")
    made.consolidate()
    assert (len(made), made.keys, made.states().p.shape, made.x().shape) == (0, [], (0,), (0, 2))
    with pytest.raises(DataError, match=r"data\.h5: holds no states yet; sample first"):
        made.responses()


def test_the_digest_notices_one_bit(dataset: Dataset, tmp_path: Path) -> None:
    kept = record(4, field="whole")
    assert kept.field is not None
    u = kept.field.u.copy()
    u[7, 1] = np.nextafter(u[7, 1], 9)
    other = Dataset.create(tmp_path / "other.h5", inputs=INPUTS, identity="abc")
    for one in records():
        other.append(one if one.key != kept.key else replace(kept, field=replace(kept.field, u=u)))
    assert other.digest() != dataset.digest()
    slower = Dataset.create(tmp_path / "slower.h5", inputs=INPUTS, identity="abc")
    for one in records():
        slower.append(replace(one, seconds=one.seconds + 1))
    assert slower.digest() == dataset.digest()


def test_a_kill_between_merging_and_removing_the_parts_leaves_each_state_once(dataset: Dataset) -> None:
    folder = parts_folder(dataset.path)
    shutil.copytree(folder, folder.with_name("copy"))
    dataset.consolidate()
    shutil.copytree(folder.with_name("copy"), folder)
    (folder / ".half.h5.4711.part").write_bytes(b"\x89HDF")
    again = Dataset.open(dataset.path)
    assert_holds(again, records())
    again.append(record(9))
    again.consolidate()
    assert_holds(Dataset.open(dataset.path), [*records(), record(9)])
    assert not folder.exists()


def test_a_key_is_appended_once(dataset: Dataset) -> None:
    with pytest.raises(ValueError, match="'state 3' is in the dataset already"):
        dataset.append(record(3))


def test_an_existing_file_is_not_created_again(dataset: Dataset) -> None:
    with pytest.raises(RunFolderError, match=r"data\.h5 exists; resume"):
        Dataset.create(dataset.path, inputs=INPUTS, identity="abc")
    assert_holds(Dataset.create_or_open(dataset.path, inputs=INPUTS, identity="abc"), records())


def test_states_of_another_identity_or_of_other_inputs_are_refused(dataset: Dataset) -> None:
    with pytest.raises(
        DataError,
        match=r"data\.h5: .*identity abc, expected xyz\); choose another --out, or move it elsewhere",
    ):
        Dataset.open(dataset.path, identity="xyz")
    other = InputSpace(("p", "H22"), (-0.1, -0.4), (0.2, 0.2))
    with pytest.raises(DataError, match=r"other inputs .*H22 in \[-0.4, 0.1\], expected .*\[-0.4, 0.2\]"):
        Dataset.open(dataset.path, inputs=other)


def test_parts_of_another_dataset_are_refused(dataset: Dataset, tmp_path: Path) -> None:
    stranger = Dataset.create(tmp_path / "stranger.h5", inputs=INPUTS, identity="other")
    stranger.append(record(8))
    (part,) = parts_folder(stranger.path).iterdir()
    shutil.copy(part, parts_folder(dataset.path))
    with pytest.raises(
        DataError, match=r"belongs to another dataset than data\.h5; move the folder data\.h5\.parts"
    ):
        Dataset.open(dataset.path)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.7, 0.999])
def test_a_truncated_file_is_refused(dataset: Dataset, share: float) -> None:
    dataset.consolidate()
    os.truncate(dataset.path, int(share * dataset.path.stat().st_size))
    with pytest.raises(DataError, match=r"data\.h5: not a complete dataset .* sample again"):
        Dataset.open(dataset.path)


def test_a_truncated_part_is_refused_and_named(dataset: Dataset) -> None:
    part = min(parts_folder(dataset.path).iterdir())
    os.truncate(part, part.stat().st_size // 2)
    with pytest.raises(
        DataError, match=rf"{part.name}: not a complete dataset .*move it to {part.name}.damaged, then resume"
    ):
        Dataset.open(dataset.path)
    part.unlink()
    assert len(Dataset.open(dataset.path)) == 4


def test_a_changed_byte_is_noticed(dataset: Dataset) -> None:
    dataset.consolidate()
    content = dataset.path.read_bytes()
    for needle in (dataset.responses().mean_grad, dataset.states().p):
        place = content.index(needle.tobytes()) + 12
        dataset.path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        with pytest.raises(DataError, match=r"data\.h5: not a complete dataset"):
            Dataset.open(dataset.path)
    dataset.path.write_bytes(content)
    kept = dataset.field("state 4")
    assert kept is not None
    place = content.index(kept.u.tobytes()) + 12
    dataset.path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
    with pytest.raises(DataError, match=r"data\.h5: not a complete dataset"):
        Dataset.open(dataset.path).field("state 4")


def test_foreign_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "data.h5"
    with pytest.raises(DataError, match=r"data\.h5: no such file; sample first"):
        Dataset.open(path)
    path.write_text("key,p,H22\n")
    with pytest.raises(DataError, match=r"data\.h5: not a complete dataset"):
        Dataset.open(path)
    path.unlink()
    with h5py.File(path, "w") as file:
        file["mean_grad"] = np.zeros((2, 3, 3))
    with pytest.raises(DataError, match="an HDF5 file, but no dataset of porocore"):
        Dataset.open(path)


def test_another_version_is_refused(dataset: Dataset) -> None:
    with h5py.File(dataset.path, "r+") as file:
        file.attrs["version"] = 2
    with pytest.raises(DataError, match="dataset of version 2, expected 1"):
        Dataset.open(dataset.path)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("response/mean_grad", np.zeros((5, 9))),
        ("response/tangent/stress_p", np.zeros((4, 3, 3))),
        ("response/unheard_of", np.zeros(5)),
        ("status", np.zeros(4, dtype=np.int64)),
        ("x", np.zeros((5, 3))),
        ("grad_u", None),
        ("response/mean_grad", None),
        ("response/peaks/min_gap", None),
    ],
)
def test_arrays_that_do_not_belong_together_are_refused(
    dataset: Dataset, name: str, value: np.ndarray | None
) -> None:
    dataset.consolidate()
    with h5py.File(dataset.path, "r+") as file:
        if name in file:
            del file[name]
        if value is not None:
            file[name] = value
    with pytest.raises(DataError, match=r"data\.h5: not a complete dataset"):
        Dataset.open(dataset.path)


def test_a_solver_that_returns_other_shapes_or_parts_is_told(dataset: Dataset) -> None:
    good = record(9)
    with pytest.raises(PluginError, match=r"for state 'state 9': mean_grad: expected shape .*got \(1, 9\)"):
        dataset.append(replace(good, response=replace(good.response, mean_grad=np.zeros((1, 9)))))
    with pytest.raises(PluginError, match=r"other responses for state 'state 9' .*difference: potential\)"):
        dataset.append(replace(good, response=replace(good.response, potential=None)))
    assert_holds(Dataset.open(dataset.path), records())


def with_files_limited_to(size: int, work: Callable[[], None]) -> None:
    """``work`` in a child for which no file grows beyond ``size`` bytes, as on a full disk.

    In this process the limit would also hit the test runner's own files.
    """
    resource = pytest.importorskip("resource")
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
            work()
        except BaseException:  # noqa: BLE001 - the parent raises what it reads
            os.write(write, traceback.format_exc().encode())
        os._exit(0)
    os.close(write)
    with open(read) as pipe:
        assert pipe.read() == ""
    os.waitpid(child, 0)


@pytest.mark.parametrize("size", [0, 1000, 9000])
def test_a_full_disk_costs_no_finished_state(dataset: Dataset, size: int) -> None:
    def fill() -> None:
        with pytest.raises(RunFolderError, match=r"cannot write .*make room"):
            dataset.append(record(9))
        with pytest.raises(RunFolderError, match=r"cannot write .*data\.h5: .*make room"):
            dataset.consolidate()
        assert_holds(dataset, records())

    with_files_limited_to(size, fill)
    assert_holds(Dataset.open(dataset.path), records())
    assert not [path for path in dataset.path.parent.rglob("*") if path.suffix == ".part"]
    dataset.append(record(9))
    dataset.consolidate()
    assert_holds(Dataset.open(dataset.path), [*records(), record(9)])


def test_a_disk_that_is_full_at_the_last_moment(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*args: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", refuse)
        with pytest.raises(RunFolderError, match="No space left on device"):
            dataset.append(record(9))
        with pytest.raises(RunFolderError, match="No space left on device"):
            dataset.consolidate()
    assert_holds(Dataset.open(dataset.path), records())


def test_five_thousand_states_are_read_fast(tmp_path: Path) -> None:
    """CPU time, which does not depend on what else runs."""
    n = 5000
    random = np.random.default_rng(0)
    one = record(0)
    shapes = {name: array.shape[1:] for name, array in flatten_response(one.response).items()}
    arrays = {name: random.standard_normal((n, *shape)) for name, shape in shapes.items()}
    x = random.uniform(-0.1, 0.1, (n, 2))
    keys = [f"state {i:05d}" for i in range(n)]
    path = tmp_path / "data.h5"
    block = Block(
        path, keys, [""] * n, x, INPUTS.scatter(x), np.ones(n), build_response(np.zeros(n, dtype=int), arrays)
    )
    field = replace(one.field, u=random.standard_normal((150, 3)))
    write_block(path, Header(INPUTS, "abc", {}), block, [field] * n)
    began = time.process_time()
    dataset = Dataset.open(path)
    responses = dataset.responses()
    seconds = time.process_time() - began
    np.testing.assert_array_equal(responses.stress, arrays["stress"])
    assert seconds < 1.5
    began = time.process_time()
    for key in keys[::100]:
        np.testing.assert_array_equal(dataset.field(key).u, field.u)
    assert (time.process_time() - began) / 50 < 0.05

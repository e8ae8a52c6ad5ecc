"""porocore data: what it says of a file, what it finds wrong, and what it writes."""

from __future__ import annotations

import csv
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from porocore.cli.data import _input_range, data
from porocore.core.units import OutputUnits, ResultUnits, Scales
from porocore.errors import ConfigurationError, DataError, PluginError, RunFolderError
from porocore.interfaces.cell import CellField
from porocore.interfaces.records import SolvedState, flatten_response
from porocore.sampling.datasets.check import check_file, table
from porocore.sampling.datasets.dataset import Block, Dataset, Header, parts_folder, write_block
from porocore.states import CellTangent, Status
from tests.helpers.fake_cell import IDENTITY, INPUTS, response

rng = np.random.default_rng(0)


def tangent() -> CellTangent:
    """That of a potential."""
    A = rng.normal(size=(1, 9, 9))
    by_H = rng.normal(size=(1, 3, 3))
    stiffness = (A + A.transpose(0, 2, 1)).reshape(1, 3, 3, 3, 3)
    return CellTangent(A.reshape(1, 3, 3, 3, 3), by_H + 1, stiffness, -by_H, by_H, np.array([-0.3]))


def lawful(key: str, p: float, status: Status = Status.converged, start: str | None = None) -> SolvedState:
    x = (p, -0.1)
    state = INPUTS.scatter(x)
    if not status.has_values:
        empty = response(np.full((3, 3), np.nan), np.nan, status)
        return SolvedState(key, x, state, empty, 0.25, start)
    answer = replace(response(np.full((3, 3), p), 0.2, status), tangent=tangent())
    field = CellField(state.grad_u[0], p, "eighth", np.full((4, 3), p))
    return SolvedState(key, x, state, answer, 0.5, start, field)


def make(path: Path, records: list[SolvedState], **how: Any) -> Dataset:
    dataset = Dataset.create(
        path, **{"inputs": INPUTS, "identity": IDENTITY, "provenance": {"numpy": "1", "config": "a\nb"}} | how
    )
    for record in records:
        dataset.append(record)
    dataset.consolidate()
    return dataset


def with_part(dataset: Dataset, record: SolvedState) -> Path:
    """The file, with a solve beside it that no data set would take."""
    block = Block.from_record(parts_folder(dataset.path) / "wrong.h5", record)
    write_block(block.path, Header(dataset.inputs, dataset.identity, {}), block, [record.field])
    return dataset.path


RECORDS = [lawful("a", 0.0), lawful("b", 0.1, start="a"), lawful("c", -0.05, Status.lost), lawful("d", 0.2)]


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    return make(tmp_path / "data.h5", RECORDS)


def run(*words: object, status: int = 0) -> str:
    """What a command prints; an error of porocore is raised."""
    result = CliRunner().invoke(data, [str(word) for word in words])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == status, result.output
    return result.stdout


def test_info(dataset: Dataset) -> None:
    text = run("info", dataset.path)
    assert "4 states" in text
    assert "statuses: 3 converged, 1 lost" in text
    assert "p in [-0.1, 0.2] E, found [-0.05, 0.2] E" in text
    assert "3 with u¹" in text
    assert "config: 2 lines" in text
    assert "config:\n    a\n    b" in run("info", dataset.path, "--provenance")
    facts = json.loads(run("info", dataset.path, "--json"))
    assert facts["statuses"] == {"converged": 3, "lost": 1}
    assert facts["seconds"] == {"sum": 1.75, "median": 0.5}
    assert facts["inputs"]["p"] == {"range": [-0.1, 0.2], "found": [-0.05, 0.2]}
    assert facts["not_merged"] == 0


def test_ranges_have_the_units_of_the_study() -> None:
    units = ResultUnits(Scales(modulus=40e3, length=1e-3, pore=1e-5), OutputUnits(stress="kPa"))
    told = {"range": [-0.005, 0.025], "found": [-0.005, 0.02]}
    assert _input_range("p", told, units) == "  p in [-0.2, 1] kPa, found [-0.2, 0.8] kPa"
    assert _input_range("H22", {**told, "found": None}, units) == "  H22 in [-0.005, 0.025], nothing yet"


def test_info_of_a_running_and_of_an_empty_one(tmp_path: Path) -> None:
    dataset = make(tmp_path / "data.h5", [])
    assert "statuses: none" in run("info", dataset.path)
    dataset.append(RECORDS[0])
    assert "1 solves in files of their own" in run("info", dataset.path)
    with pytest.raises(DataError, match="no such file"):
        run("info", tmp_path / "other.h5")
    with pytest.raises(RunFolderError, match="is not a run folder"):
        run("info", tmp_path)


def test_a_sound_file(dataset: Dataset) -> None:
    text = run("check", dataset.path)
    assert "FAIL" not in text
    assert "∂P_E/∂p = −∂φ/∂H: largest misfit 0.0e+00" in text
    assert all(finding.holds for finding in check_file(dataset.path, tolerance=1e-15))


def broken(record: SolvedState, **parts: Any) -> SolvedState:
    change = {name: value for name, value in parts.items() if name in ("tangent", "stress", "extrema")}
    rest = {name: value for name, value in parts.items() if name not in change}
    return replace(record, response=replace(record.response, **change), **rest)


good = RECORDS[0].response
FAULTS = {
    "∂P_E/∂p = −∂φ/∂H": {"tangent": replace(good.tangent, stress_p=good.tangent.stress_p * (1 + 1e-5))},
    "∂P_E/∂H symmetric": {"tangent": replace(good.tangent, stress_grad_u=good.tangent.mean_grad_grad_u)},
    "finite": {"stress": np.full((1, 3, 3), np.inf)},
    "J > 0": {"extrema": replace(good.extrema, min_jacobian=np.array([-0.1]))},
    "states of their inputs": {"state": INPUTS.scatter((0.1, -0.1)), "field": None},
    "within the ranges": {"x": (0.3, -0.1), "state": INPUTS.scatter((0.3, -0.1)), "field": None},
    "fields of their states": {"field": replace(RECORDS[0].field, p=0.01)},
    "starts kept": {"start": "c"},
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_is_wrong_is_found(tmp_path: Path, name: str) -> None:
    wrong = broken(replace(RECORDS[0], key="e"), **FAULTS[name])
    text = run("check", with_part(make(tmp_path / "data.h5", RECORDS), wrong), status=1)
    wrong = [line.split(":")[0] for line in text.splitlines() if "FAIL" in line]
    assert wrong == [f"  FAIL  {name}"]
    assert "'e'" in text.split("FAIL")[1]


def test_a_failed_state_with_values_is_found(tmp_path: Path) -> None:
    record = broken(RECORDS[2], stress=np.zeros((1, 3, 3)))
    assert "FAIL  finite: 1 of 1" in run("check", with_part(make(tmp_path / "data.h5", []), record), status=1)


def test_damage_is_found(dataset: Dataset) -> None:
    with h5py.File(dataset.path, "r") as file:
        offset = file["field/u"].id.get_chunk_info(0).byte_offset
    with open(dataset.path, "rb+") as file:
        file.seek(offset + 8)
        file.write(b"\x12\x34\x56\x78")
    assert "FAIL  readable" in run("check", dataset.path, status=1)


def test_merge(tmp_path: Path, dataset: Dataset) -> None:
    other = make(
        tmp_path / "other.h5", [RECORDS[1], lawful("e", 0.15)], provenance={"numpy": "2", "config": "a\nb"}
    )
    out = tmp_path / "out.h5"
    assert run("merge", dataset.path, other.path, "--out", out).strip() == str(out)
    merged = Dataset.open(out, inputs=INPUTS, identity=IDENTITY)
    assert merged.keys == ["a", "b", "c", "d", "e"]
    assert merged.provenance == {"numpy": "1\n2", "config": "a\nb", "merged": "data.h5, other.h5"}
    for source in (dataset, other):
        for key in source.keys:
            theirs = flatten_response(source.response(key))
            for name, value in flatten_response(merged.response(key)).items():
                np.testing.assert_array_equal(value, theirs[name])
            field = source.field(key)
            assert (merged.field(key) is None) == (field is None)
            if field is not None:
                np.testing.assert_array_equal(merged.field(key).u, field.u)
    again = make(tmp_path / "again.h5", [*RECORDS, lawful("e", 0.15)])
    assert merged.keys == again.keys
    with pytest.raises(RunFolderError, match="exists"):
        run("merge", dataset.path, other.path, "--out", out)


def test_what_cannot_be_merged(tmp_path: Path, dataset: Dataset) -> None:
    out = tmp_path / "out.h5"
    others = {
        "another cell or other settings": make(tmp_path / "1.h5", [], identity="other"),
        "other inputs": make(tmp_path / "2.h5", [], inputs=replace(INPUTS, upper=(0.3, 0.1))),
        "'b' differs from that of .* in tangent/.*": make(tmp_path / "3.h5", [lawful("b", 0.1, start="a")]),
        "in the start": make(tmp_path / "4.h5", [replace(RECORDS[1], start=None)]),
        "in the field": make(tmp_path / "5.h5", [replace(RECORDS[1], field=None)]),
        "other responses": make(tmp_path / "6.h5", [broken(replace(RECORDS[1], key="z"), extrema=None)]),
    }
    for message, other in others.items():
        with pytest.raises(DataError, match=message):
            run("merge", dataset.path, other.path, "--out", out)
    with pytest.raises(ConfigurationError, match="at least two"):
        run("merge", dataset.path, "--out", out)
    assert not out.exists()


def test_export_loses_nothing(tmp_path: Path, dataset: Dataset) -> None:
    out = tmp_path / "x.csv"
    run("export", dataset.path, "--out", out, "--derivatives")
    with open(out, newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["key"] for row in rows] == dataset.keys
    assert [row["status"] for row in rows] == ["converged", "converged", "lost", "converged"]
    assert [row["start"] for row in rows] == ["", "a", "", ""]
    responses = dataset.responses()
    np.testing.assert_array_equal([float(row["H22"]) for row in rows], -0.1)
    np.testing.assert_array_equal([float(row["stress_12"]) for row in rows], responses.stress[:, 0, 1])
    np.testing.assert_array_equal(
        [float(row["tangent_stress_grad_u_1232"]) for row in rows],
        responses.tangent.stress_grad_u[:, 0, 1, 2, 1],
    )
    assert not [name for name in table(dataset) if name.startswith("tangent")]
    with pytest.raises(RunFolderError, match="exists"):
        run("export", dataset.path, "--out", out)


def test_parquet_is_the_same_table(tmp_path: Path, dataset: Dataset) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    out = tmp_path / "x.parquet"
    run("export", dataset.path, "--out", out)
    found, expected = parquet.read_table(out).to_pydict(), table(dataset)
    assert list(found) == list(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values)


def test_other_formats_and_a_missing_library(
    tmp_path: Path, dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ConfigurationError, match=r"ends in \.csv or \.parquet, got .*x\.xls"):
        run("export", dataset.path, "--out", tmp_path / "x.xls")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(PluginError, match=r"needs pyarrow.*choose \.csv"):
        run("export", dataset.path, "--out", tmp_path / "x.parquet")
    assert not (tmp_path / "x.parquet").exists()


def test_plot(tmp_path: Path, dataset: Dataset) -> None:
    out = tmp_path / "x.png"
    run("plot", dataset.path, "--out", out)
    assert out.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(ConfigurationError, match=r"--axes: expected two of p, H22 .*, got 'p,H11'"):
        run("plot", dataset.path, "--out", tmp_path / "y.png", "--axes", "p,H11")
    with pytest.raises(ConfigurationError, match=r"\.png or \.svg"):
        run("plot", dataset.path, "--out", tmp_path / "y.pdf")
    run("plot", dataset.path, "--out", tmp_path / "y.svg", "--axes", "p,H22")
    assert "<svg" in (tmp_path / "y.svg").read_text()

"""Fields of a response: declared once; shapes, NaN rows, checks and the documentation derive from that."""

import subprocess
import sys
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np
import pytest

from porocore.core.field_check import response_fault
from porocore.core.fields import declared_fields, documented, provided_fields, row, rows_of
from porocore.errors import PluginError
from porocore.interfaces.records import (
    SolvedState,
    build_response,
    check_record,
    failed_response,
    flatten_response,
)
from porocore.states import (
    CELL_FIELDS,
    RESPONSE_FIELDS,
    CellExtrema,
    CellResponse,
    CellSlopes,
    CellTangent,
    MacroState,
    Status,
)
from tests.helpers.fake_cell import response


def right(n=2):
    one = response(0.1 * np.eye(3), -0.2, Status.converged)
    return CellResponse.concatenate([one] * n)


def test_every_field_of_a_response_is_declared():
    expected = {f.name for f in fields(CellResponse)} - {"tangent", "slopes", "extrema"}
    expected |= {f"tangent/{f.name}" for f in fields(CellTangent)}
    expected |= {f"slopes/{f.name}" for f in fields(CellSlopes)}
    expected |= {f"peaks/{f.name}" for f in fields(CellExtrema)}
    assert set(RESPONSE_FIELDS) == expected
    assert all(declared.unit and declared.meaning for declared in RESPONSE_FIELDS.values())
    for batch in (CellResponse, CellTangent, CellSlopes, CellExtrema):
        assert all(f"{f.name}" in batch.__doc__ for f in fields(batch))
    assert "stress : (n, 3, 3)" in CellResponse.__doc__
    assert "stress : (n, 3, 3, m)" in CellSlopes.__doc__


def test_a_new_field_is_one_line():
    @documented
    @dataclass
    class Inner:
        """Inner."""

        heat: np.ndarray = field(metadata=row("J", "Heat.", 2))

    @documented
    @dataclass
    class Outer:
        """Outer."""

        inner: Inner = field(metadata=rows_of(Inner))

        other: Inner = field(metadata=rows_of(Inner, name="file_name"))

    assert declared_fields(Outer)["inner/heat"].heading == "(n, 2)"
    assert list(declared_fields(Outer)) == ["inner/heat", "file_name/heat"]
    assert list(provided_fields(Outer(None, Inner(np.zeros((1, 2)))))) == ["file_name/heat"]
    assert "heat : (n, 2)\n        Heat. [J]" in Inner.__doc__


@pytest.mark.parametrize("flags", [{}, {"tangent": False}, {"deformed": True}, {"parameters": 2}])
def test_a_row_without_values_holds_nan_in_what_was_asked_for(flags):
    failed = failed_response(Status.inverted, **flags)
    assert response_fault(failed, 1) is None
    assert failed.status.tolist() == [3]
    assert (failed.tangent is None) == (flags.get("tangent") is False)
    assert (failed.conductivity is None) == ("deformed" not in flags)
    assert (failed.slopes is None) == ("parameters" not in flags)
    arrays = flatten_response(failed)
    assert all(np.isnan(array).all() for array in arrays.values())
    assert all(array.shape == (1, *CELL_FIELDS[name].row_shape(2)) for name, array in arrays.items())
    like = flatten_response(failed_response(Status.lost, like=failed))
    assert {name: array.shape for name, array in like.items()} == {
        name: a.shape for name, a in arrays.items()
    }


def test_a_right_response_has_no_fault():
    assert response_fault(right(), 2) is None
    mixed = CellResponse.concatenate([right(1), failed_response(Status.overlap)])
    assert response_fault(mixed, 2) is None
    open_gap = replace(right(), extrema=replace(right().extrema, min_gap=np.full(2, np.nan)))
    assert response_fault(open_gap, 2) is None


def slopes(n=2, m=2):
    return CellSlopes(potential=np.zeros((n, m)), stress=np.zeros((n, 3, 3, m)))


def test_slopes_agree_on_the_number_of_parameters():
    assert response_fault(replace(right(), slopes=slopes()), 2) is None
    assert response_fault(replace(right(), slopes=slopes()), 2, parameters=2) is None
    torn = replace(slopes(), stress=np.zeros((2, 3, 3, 1)))
    assert response_fault(replace(right(), slopes=torn), 2).startswith(
        "slopes/stress: expected shape (2, 3, 3, 2)"
    )
    fault = response_fault(replace(right(), slopes=slopes()), 2, parameters=3)
    assert fault == "slopes/potential: expected shape (2, 3), got (2, 2)"
    arrays = flatten_response(replace(right(), slopes=slopes()))
    np.testing.assert_array_equal(build_response([0, 0], arrays).slopes.stress, slopes().stress)


def test_a_record_has_slopes_by_the_parameters_of_its_state():
    states = MacroState.zeros(1).with_parameters([0.2, 0.3, 0.4])
    record = SolvedState("a", (0.0,), states, replace(right(1), slopes=slopes(1)), 1.0)
    with pytest.raises(PluginError, match=r"slopes/potential: expected shape \(1, 3\), got \(1, 2\)"):
        check_record(record, None)


WRONG = {
    "stress: expected shape (2, 3, 3), got (2, 9)": {"stress": np.zeros((2, 9))},
    "stress: expected an array of shape (2, 3, 3), got list": {"stress": [[0.0]]},
    "stress: expected numbers of type float64, got complex128": {"stress": np.zeros((2, 3, 3), complex)},
    "potential: row 1, with status 'converged', holds numbers that are not finite": {
        "potential": np.array([0.0, np.inf])
    },
    "potential: row 0, with status 'overlap', holds values, and NaN belongs there": {
        "status": np.array([2, 0]),
        "mean_grad": np.where(np.arange(2)[:, None, None] == 0, np.nan, np.ones((2, 3, 3))),
    },
    "status: 9 of row 1 is no status": {"status": np.array([0, 9])},
    "status: expected numbers of type int64, got float64": {"status": np.array([0.0, 0.0])},
    "mean_grad: is missing": {"mean_grad": None},
}


@pytest.mark.parametrize("fault", WRONG)
def test_a_wrong_response_is_told_by_field_and_row(fault):
    assert response_fault(replace(right(), **WRONG[fault]), 2) == fault


def test_what_has_no_values_is_not_kept_as_a_result():
    """A row of NaN with status converged was accepted before."""
    wrong = replace(right(1), stress=np.full((1, 3, 3), np.nan))
    record = SolvedState("a", (0.0,), MacroState.zeros(1), wrong, 1.0)
    with pytest.raises(PluginError, match=r"for state 'a': stress: row 0, with status 'converged', holds"):
        check_record(record, None)


def test_only_declared_names_make_a_response():
    arrays = flatten_response(right(1))
    with pytest.raises(ValueError, match="'heat' is no response"):
        build_response([0], arrays | {"heat": np.zeros(1)})


def test_a_made_up_field_of_one_declaration_is_found_everywhere(tmp_path):
    """In rows of NaN, checks, the file, parts of the data and the documentation; in a process of its own."""
    root = Path(__file__).parents[2]
    script, generator = Path(__file__).with_name("made_up_field.py"), root / "docs/make_configuration.py"
    done = subprocess.run(
        [sys.executable, script, tmp_path / "samples.h5", generator],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == "found everywhere\n", done.stderr

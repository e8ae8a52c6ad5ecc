"""Record of every evaluation of a model in a file, so that a fit that was killed goes on to the same answer."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from porocore.calibration.problem import CurveModel, CurvePrediction
from porocore.core.echo import reason
from porocore.core.files.reading import read_text, set_aside
from porocore.errors import RunFolderError, SolveError
from porocore.states import Array

FORMAT = "porocore-evaluations"
#: Size of a record that is read [bytes].
LARGEST = 1 << 30


class EvaluationRecord:
    """Evaluations of one model in a file of JSON lines, each written when it is made.

    Parameters
    ----------
    path
        The file, made where there is none. A last line that is incomplete is removed.
    identity
        Hash of all that the curves depend on beside the values of the unknowns.

    Raises
    ------
    RunFolderError
        The file is of another model, damaged, or cannot be written.
    """

    def __init__(self, path: Path, identity: str) -> None:
        self.path, self.identity = path, identity
        self._known: dict[tuple[float, ...], dict[str, Any]] = {}
        try:
            text = read_text(path, LARGEST) if path.exists() else ""
            whole = text[: text.rfind("\n") + 1]
            if whole != text:
                path.write_text(whole, encoding="utf-8")
            self._read(whole.splitlines())
        except OSError as error:
            raise self._unusable(f"cannot be used: {error.strerror or error}") from None
        if not whole:
            self._append({"format": FORMAT, "identity": identity})

    def __len__(self) -> int:
        return len(self._known)

    def __iter__(self) -> Iterator[tuple[Array, CurvePrediction | None]]:
        """Yield values (k,) and curves of every evaluation, None where there were none, in the order they were made."""
        for values, line in self._known.items():
            yield np.array(values), None if "failed" in line else _prediction(line)

    def find(self, values: Array) -> CurvePrediction | None:
        """Return the curves for values (k,) of the unknowns; None where they are not known.

        Raises
        ------
        SolveError
            They could not be computed there.
        """
        line = self._known.get(tuple(values.tolist()))
        if line is None:
            return None
        if "failed" in line:
            raise SolveError(line["failed"])
        return _prediction(line)

    def keep(self, values: Array, found: CurvePrediction | SolveError) -> None:
        """Append the outcome of one evaluation.

        Raises
        ------
        RunFolderError
            The file cannot be written.
        """
        line: dict[str, Any] = {"unknowns": values.tolist()}
        if isinstance(found, SolveError):
            line["failed"] = str(found)
        else:
            line |= {
                "values": found.values.tolist(),
                "slopes": found.slopes.tolist(),
                "flagged": found.flagged,
            }
        self._append(line)
        self._known[tuple(values.tolist())] = line

    def _read(self, lines: list[str]) -> None:
        if not lines:
            return
        try:
            head, *rest = (json.loads(line) for line in lines)
            if (head["format"], head["identity"]) != (FORMAT, self.identity):
                raise self._unusable(
                    "holds evaluations of another calibration; choose another --out, or undo the change of the "
                    "configuration, data or version"
                )
            self._known = {tuple(line["unknowns"]): line for line in rest}
        except (ValueError, KeyError, TypeError) as error:
            raise self._unusable(
                f"is damaged ({reason(error)}); {set_aside(self.path, 'start again')}"
            ) from error

    def _append(self, line: dict[str, Any]) -> None:
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise self._unusable(f"cannot be written: {error.strerror or error}") from None

    def _unusable(self, why: str) -> RunFolderError:
        return RunFolderError(f"{self.path} {why}")


def _prediction(line: dict[str, Any]) -> CurvePrediction:
    values = np.array(line["values"], dtype=float)
    slopes = np.array(line["slopes"], dtype=float).reshape(len(values), len(line["unknowns"]))
    return CurvePrediction(values, slopes, bool(line["flagged"]))


class RecordedModel(CurveModel):
    """A model whose evaluations are kept, and not made again.

    Parameters
    ----------
    model
        Computes the curves.
    record
        Knows them.
    on_evaluation
        Called after each evaluation that was made.
    """

    def __init__(
        self, model: CurveModel, record: EvaluationRecord, on_evaluation: Callable[[], None] = lambda: None
    ) -> None:
        self.model, self.record, self.on_evaluation = model, record, on_evaluation
        self.unknowns = model.unknowns

    def curves(self, values: Array) -> CurvePrediction:
        """Return the curves; see :class:`~porocore.calibration.problem.CurveModel`."""
        known = self.record.find(values)
        if known is not None:
            return known
        try:
            found = self.model.curves(values)
        except SolveError as error:
            self.record.keep(values, error)
            raise
        self.record.keep(values, found)
        self.on_evaluation()
        return found

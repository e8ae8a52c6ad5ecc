"""A made-up report, and its page."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.inputs import InputSpace
from porocore.macro.laws.closure import ClosureError
from porocore.macro.laws.linear import LinearCoefficients
from porocore.report.context import (
    CellSummary,
    ReportContext,
    SamplingSummary,
    Stage,
    SurrogateSummary,
    TrainingCurve,
)
from porocore.report.html import render
from porocore.report.metrics import LoadCase
from porocore.report.words.held_out import OutputCheck
from porocore.states import CellResponse, CellTangent, Status
from porocore.study.run.summary import DEHGHANI_ZILIAN
from tests.helpers.report_page import ODD, Page


def reference() -> CellResponse:
    """M and Q of the benchmark's cell, the values that the table must show."""
    M = np.zeros((1, 3, 3, 3, 3))
    for i in range(3):
        for j in range(3):
            M[0, i, i, j, j] = -0.2297 if i == j else -0.0754
    Q = -0.1135 * np.eye(3)[None]
    tangent = CellTangent(mean_grad_grad_u=M, mean_grad_p=Q)
    return CellResponse(np.zeros((1, 3, 3)), np.zeros(1, int), tangent=tangent)


@pytest.fixture(scope="session")
def context(column) -> ReportContext:
    rng = np.random.default_rng(1)
    inputs = InputSpace(("p", "H22"), (-0.02, -0.4), (0.24, 0.04))
    x = rng.uniform(inputs.lower, inputs.upper, (60, 2))
    status = np.where(x[:, 1] < -0.2, int(Status.overlap), int(Status.converged))
    status[0] = Status.not_converged
    solved = rng.uniform(-0.02, 0.08, 40)
    check = OutputCheck(
        r"$\langle\nabla_Y u^1\rangle_{22}$", "⟨∇u¹⟩₂₂", solved, solved + 1e-4, 0.1, np.arange(40) >= 30
    )
    tetrahedron = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    epoch = np.arange(1.0, 50)
    return ReportContext(
        title=ODD,
        cell=CellSummary(
            "Three channels of radius 0.25 & a neo-Hookean solid",
            0.4123,
            1e-3,
            LinearCoefficients.from_reference(reference(), 0.5877, NeoHookean(), 1.94 * np.eye(3)),
            {"solid tetrahedra": "13,104"},
            (tetrahedron, np.array([[0, 1, 2, 3]])),
            (-0.15, -0.33),
        ),
        sampling=SamplingSummary(inputs, x, status, status == Status.converged),
        surrogate=SurrogateSummary(
            "torch",
            "3 × 40 sigmoid network",
            42,
            (check,),
            TrainingCurve(epoch, 1 / epoch, 2 / epoch),
            ClosureError(0.913, 7.48, 1.26, 3.57),
        ),
        cases=(LoadCase(column(), column(law="linear", final=2.6, rate=0.08, beyond=None)),),
        stages=(Stage("sampling", 312.4, "60 states <i>"), Stage("training", 28.0)),
        provenance={"porocore": "0.1.0", "seed <1>": "7"},
        config_text="cell: <radius> & {0.25}",
        published=DEHGHANI_ZILIAN,
        warnings=("Handed in <first> & shown",),
    )


@pytest.fixture(scope="session")
def html(context) -> str:
    return render(context)


@pytest.fixture(scope="session")
def page(html) -> Page:
    return Page(html)


@pytest.fixture
def unpictured(undrawn, monkeypatch):
    """Leave out the pictures of the body too, which take the most of the rest."""
    none = {"histories": [], "series": [], "bodies": [], "profiles": []}
    monkeypatch.setattr("porocore.report.html._case_pictures", lambda *arguments: none)
    monkeypatch.setattr("porocore.report.html._cell_picture", lambda *arguments: None)

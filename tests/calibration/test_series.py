"""Measured series: their places in solutions, derivatives and weights are the same."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from porocore.commands.calibration.observations import MeasuredSeries, weights_of
from porocore.commands.calibration.settings import Kind
from porocore.interfaces.sensitivities import HISTORY_SERIES, LoadChange, MacroSensitivities

STEPS, UNKNOWNS = 4, 3
SERIES = [
    MeasuredSeries("settlement"),
    MeasuredSeries("heave"),
    MeasuredSeries("pressure"),
    MeasuredSeries("pressure_min"),
    MeasuredSeries("drained"),
    MeasuredSeries("pressure", probe="inside"),
    MeasuredSeries("displacement", probe="inside", component=2),
    MeasuredSeries("displacement", probe="inside", component=3),
    MeasuredSeries("force", surface="y-"),
    MeasuredSeries("force", surface="y-", component=1),
    MeasuredSeries("inflow", surface="y+"),
    MeasuredSeries("force", indenter="ball"),
    MeasuredSeries("displacement", indenter="ball"),
    MeasuredSeries("contact_area", indenter="ball"),
    MeasuredSeries("contact_radius", indenter="ball"),
]


@pytest.fixture(scope="module")
def sensitivities() -> MacroSensitivities:
    """Derivatives each of which is another number."""
    numbers = np.random.default_rng(3)

    def of_shape(*shape: int) -> np.ndarray:
        return numbers.normal(size=(STEPS, *shape, UNKNOWNS))

    return MacroSensitivities(
        (LoadChange(),) * UNKNOWNS,
        **{name: of_shape() for name in HISTORY_SERIES},
        probes={"other": of_shape(4), "inside": of_shape(4)},
        reactions={"y-": of_shape(3), "x+": of_shape(3)},
        inflow={"y+": of_shape()},
        compression={"y-": of_shape()},
        contact={"cone": of_shape(7), "ball": of_shape(7)},
    )


def test_every_quantity_has_a_series() -> None:
    assert {one.kind for one in SERIES} == set(get_args(Kind))


def test_series_lie_where_their_names_say(sensitivities: MacroSensitivities) -> None:
    wanted = [
        sensitivities.settlement,
        sensitivities.heave,
        sensitivities.pressure_max,
        sensitivities.pressure_min,
        sensitivities.drained,
        sensitivities.probes["inside"][:, 3],
        sensitivities.probes["inside"][:, 1],
        sensitivities.probes["inside"][:, 2],
        sensitivities.compression["y-"],
        sensitivities.reactions["y-"][:, 0],
        sensitivities.inflow["y+"],
        *(sensitivities.contact["ball"][:, column] for column in range(4)),
    ]
    for one, each in zip(SERIES, wanted, strict=True):
        np.testing.assert_array_equal(one.slopes(sensitivities), each)


def test_weights_of_series_are_those_of_the_histories(sensitivities: MacroSensitivities) -> None:
    """Each sum over the series, some of them twice, is the sum over the histories."""
    series = [*SERIES, SERIES[0], SERIES[6], SERIES[8]]
    given = list(np.random.default_rng(4).normal(size=(len(series), STEPS, 2)))
    wanted = sum(each.T @ one.slopes(sensitivities) for one, each in zip(series, given, strict=True))
    found = weights_of(series, given)
    total = np.zeros((2, UNKNOWNS))
    for name in HISTORY_SERIES:
        total += getattr(found, name).T @ getattr(sensitivities, name)
    for group in ("probes", "reactions", "contact"):
        for name, each in getattr(found, group).items():
            total += np.einsum("scf,sck->fk", each, getattr(sensitivities, group)[name])
    for group in ("inflow", "compression"):
        for name, each in getattr(found, group).items():
            total += each.T @ getattr(sensitivities, group)[name]
    assert found.count == 2
    np.testing.assert_allclose(total, wanted, rtol=1e-12)

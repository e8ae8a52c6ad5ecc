"""Check of the predictions of a surrogate or another cell law."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from porocore.core.fields.check import number_fault, shape_fault
from porocore.plugins.border.origin import refuse
from porocore.states import CellResponse, MacroState


class Predicts(Protocol):
    """A surrogate, or another law of the cell."""

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return the responses of n states."""


def prediction_of(surrogate: Predicts, states: MacroState, *, tangent: bool = True) -> CellResponse:
    """Return what ``surrogate.predict`` returns.

    Raises
    ------
    PluginError
        As :func:`check_prediction`.
    """
    return check_prediction(surrogate, surrogate.predict(states, tangent=tangent), states)


def check_prediction(law: object, response: Any, states: MacroState) -> CellResponse:
    """Return the response that ``law`` predicts for n states.

    Beyond its sampled range nothing is asked of its numbers: there Newton's iteration may try anything, and refuses
    what is not finite.

    Raises
    ------
    PluginError
        It is not what its fields declare.
    """
    if fault := shape_fault(response, len(states)):
        raise refuse(law, fault)
    if fault := number_fault(response):
        finite = np.isfinite(states.grad_u).all(axis=(1, 2)) & np.isfinite(states.p)
        known = (
            finite if response.outside_training_range is None else finite & ~response.outside_training_range
        )
        if not known.all():
            fault = number_fault(response[known])
        if fault:
            raise refuse(law, fault)
    found: CellResponse = response
    return found

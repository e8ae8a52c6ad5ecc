"""Starts of solves from the field of the nearest known state instead of the undeformed cell."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from porocore.interfaces.cell import CellField
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import CellResponse, MacroState, Status

Mask = npt.NDArray[np.bool_]
#: First words of a start that lies in the data set of the samples, before its key.
OF_SAMPLES = "samples: "
#: A sample is a start where its distance is at most this share of that of the undeformed cell. With two inputs most
#: held-out states have one, and those in contact take half the time; with seven one that is as far saved nothing.
NEAR = 0.5
#: Share of the wall in contact below which no state starts from a sample in contact: where walls begin to touch there
#: may be two equilibria, and which one is reached depends on the path. One of 120 held-out states of the benchmark has
#: two.
ONSET = 0.02


class WarmStarts:
    """Stable states of a data set that is complete, so that the start of a state hangs on nothing but these.

    Parameters
    ----------
    samples
        Data set that is not written any more.
    modulus
        Young's modulus of the solid, by which pressures are measured like displacement gradients.
    """

    def __init__(self, samples: Dataset, modulus: float) -> None:
        self._samples, self._modulus = samples, modulus
        stable = samples.responses().stable
        self._keys = [key for key, good in zip(samples.keys, stable, strict=True) if good]
        self._states = samples.states()[np.flatnonzero(stable)]
        self._sheared = _sheared(self._states)
        self._begins = _begins_to_touch(samples.responses()[np.flatnonzero(stable)])

    def near(self, state: MacroState) -> tuple[str, CellField] | None:
        """Return the name and the field of the nearest state; None where the undeformed cell is as good.

        The distance is that of the load path: of the components of H, and of p over Young's modulus. A state without
        shear has another domain than one with shear, and one with other parameters is that of another cell.
        """
        if not self._keys:
            return None
        change = np.abs(self._states.grad_u - state.grad_u).max(axis=(1, 2))
        distance = np.maximum(change, np.abs(self._states.p - state.p) / self._modulus)
        distance[self._sheared != _sheared(state)] = np.inf
        if self._states.parameters is not None:
            distance[(self._states.parameters != state.parameters).any(axis=1)] = np.inf
        nearest = int(distance.argmin())
        at_rest = max(np.abs(state.grad_u).max(), np.abs(state.p).max() / self._modulus)
        if distance[nearest] > NEAR * at_rest or self._begins[nearest]:
            return None
        field = self._samples.field(self._keys[nearest])
        return None if field is None else (OF_SAMPLES + self._keys[nearest], field)


def _begins_to_touch(responses: CellResponse) -> Mask:
    touches: Mask = responses.status == Status.contact
    if responses.extrema is not None:
        touches &= responses.extrema.contact_share < ONSET
    return touches


def _sheared(states: MacroState) -> Mask:
    return np.asarray((np.abs(states.grad_u) * (1 - np.eye(3))).max(axis=(1, 2)) > 0)

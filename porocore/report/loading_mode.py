"""Loading by displacements or stresses; forces on moved surfaces: peak, end, relaxation, names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.core.formulas.time_function import TimeFunction, Value
from porocore.interfaces.solution import MacroSolution
from porocore.macro.problem import Boundary, MacroSetup
from porocore.report.metrics import STEADY_TOLERANCE, is_remnant, time_to_fraction
from porocore.states import Array

#: A component of a force below this share of the largest of all surfaces is round-off.
VISIBLE = 1e-6
#: Components that differ by less than this share are the same.
SAME = 1e-3
#: A force that ends less than this share below its peak does not relax, and has no times of it.
LEAST_DROP = 1e-3


@dataclass(frozen=True)
class LoadingMode:
    """Loading by prescribed displacements or by stresses.

    Attributes
    ----------
    displaced
        Surfaces that are moved by a given displacement.
    stressed
        Whether a traction, a pressure or the force on a plate is scaled by the load.
    follows
        Whether a pressure follows a deformed surface.
    scales
        Whether the load times E is a prescribed stress: some traction or pressure is 1 in the configuration, so that
        the load gives it as a share of E. A force, or a stress with a value of its own, makes it a mere factor.
    """

    displaced: tuple[str, ...] = ()
    stressed: bool = True
    follows: bool = False
    scales: bool = False

    @property
    def settles(self) -> bool:
        """True if the settlement is a result and not prescribed."""
        return self.stressed or not self.displaced

    @classmethod
    def from_setup(cls, macro: MacroSetup) -> LoadingMode:
        """Return the mode of the boundary conditions that are not zero."""
        faces = macro.boundary.items()
        return cls(
            tuple(name for name, b in faces if _any((*b.displacement, b.normal))),
            any(_any(_stresses(b)) for _, b in faces),
            "follower" in macro.parts,
            any(_is_one(value) for _, b in faces for value in (*b.traction, b.follower, b.pressure)),
        )


def _stresses(boundary: Boundary) -> tuple[Value | None, ...]:
    return (*boundary.traction, boundary.follower, boundary.plate, boundary.pressure)


def _is_one(value: Value | None) -> bool:
    return value is not None and not isinstance(value, TimeFunction) and abs(value) == 1


def _any(values: Iterable[Value | None]) -> bool:
    return any(isinstance(value, TimeFunction) or bool(value) for value in values if value is not None)


def reactions(solution: MacroSolution) -> dict[str, dict[str, Any]]:
    """Return the force on each surface that is held or moved, ready for JSON.

    It is that of the whole specimen: ``compressive`` or ``tensile`` on a plane surface that is pressed or pulled, and
    positive there; otherwise the component that becomes largest, from outside on the body, ``along x`` and so on, with
    its sign. Surfaces on which no force acts are left out. See :func:`relaxation` for the figures.
    """
    largest = max((float(np.abs(force).max()) for force in solution.reactions.values()), default=0.0)
    found = {}
    for name, force in solution.reactions.items():
        peaks = np.abs(force).max(axis=0)
        if peaks.max() <= VISIBLE * largest:
            continue
        # Of components that are the same by symmetry always the first.
        i = int(np.argmax(peaks >= (1 - SAME) * peaks.max()))
        sense, values = f"along {'xyz'[i]}", force[:, i]
        pressed = solution.compression.get(name)
        if pressed is not None and np.abs(pressed).max() >= (1 - SAME) * peaks[i]:
            pulled = pressed[int(np.abs(pressed).argmax())] < 0
            sense, values = ("tensile", -pressed) if pulled else ("compressive", pressed)
        found[name] = {"force": sense, **relaxation(solution.history.time, values)}
    return found


def force_name(force: dict[str, Any]) -> str:
    """Return what a force is called: ``compressive force``, ``force along x``."""
    sense = str(force["force"])
    return f"force {sense}" if sense.startswith("along") else f"{sense} force"


def end_words(force: dict[str, Any]) -> str:
    """Return what a force is at the end."""
    if force["drift"] is None:
        return "gone"
    return "in equilibrium" if force["equilibrium"] is not None else "still changing"


def no_relaxation(force: dict[str, Any]) -> str:
    """Return why a force has no times of relaxation."""
    if force["drift"] is None:
        return end_words(force)
    return f"drop below {100 * LEAST_DROP:g} %"


def relaxation(time: Array, force: Array) -> dict[str, Any]:
    """Return the summary of a force (steps,) that peaks and relaxes, ready for JSON.

    Returns
    -------
    dict
        ``peak`` with its sign, ``time_of_peak``, ``final``; ``drift``, the change over the last tenth of the time as a
        share of the final force; ``equilibrium``, the final force unless it drifts by more than 0.1 %, then None;
        ``peak_over_final``; ``drop``, by which share of the peak the final force lies below it; ``relaxed_50_percent``
        and ``relaxed_95_percent``, the times from the peak until the force has come so far toward the final one, None
        where it drops by less than 0.1 %. What is not defined is None: of a force that is gone, a remnant of its peak,
        drift, equilibrium, ratio and times of relaxation.
    """
    step = int(np.abs(force).argmax())
    peak, final, since = float(force[step]), float(force[-1]), time[step:] - time[step]
    before = float(np.interp(time[-1] - 0.1 * (time[-1] - time[0]), time, force))
    left = final != 0 and not is_remnant(final, peak)
    drift = abs(final - before) / abs(final) if left else None
    drop = (peak - final) / peak if peak else 0.0
    times = [
        time_to_fraction(since, peak - force[step:], share) if left and drop > LEAST_DROP else None
        for share in (0.5, 0.95)
    ]
    return {
        "peak": peak,
        "time_of_peak": float(time[step]),
        "final": final,
        "drift": drift,
        "equilibrium": final if drift is not None and drift <= STEADY_TOLERANCE else None,
        "peak_over_final": peak / final if left else None,
        "drop": drop,
        "relaxed_50_percent": times[0],
        "relaxed_95_percent": times[1],
    }

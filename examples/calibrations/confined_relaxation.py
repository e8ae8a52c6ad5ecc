"""Writes cartilage-confined-compression.csv: the stress of the linear biphasic theory for printed parameters.

A layer of height h rests on an impermeable base. A porous piston presses it at a constant speed up to the strain e0 at
the time t0, and holds it there. The displacement obeys the equation of diffusion with the coefficient c = H k of the
aggregate modulus H and the permeability k. On the piston the pressure is zero, so that its stress is H times the strain
there (Mow, Kuei, Lai & Armstrong 1980, J. Biomech. Eng. 102:73-84).

    .venv/bin/python examples/calibrations/confined_relaxation.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

#: Aggregate modulus [MPa] and axial permeability [mm⁴/(N s)] in confined compression: means of nine plugs, from the
#: abstract of Soltz & Ateshian (2000), J. Biomech. Eng. 122(6):576-586.
MODULUS, PERMEABILITY = 0.64, 3.62e-4
#: Height [mm], strain, and duration of the ramp [s]. The abstract does not tell them; they are assumed.
HEIGHT, STRAIN, RAMP = 1.0, 0.02, 1000.0
#: Times of the rows [s].
TIMES = (
    100,
    200,
    300,
    400,
    550,
    700,
    850,
    1000,
    1050,
    1100,
    1200,
    1350,
    1500,
    1750,
    2000,
    2500,
    3000,
    4000,
    5500,
    8000,
)
#: Terms of the series; at the first time the last one is exp(-90).
TERMS = 32


def stress(time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the compressive stress on the piston [MPa] at the times [s]."""
    return MODULUS * (_ramp(time) - _ramp(time - RAMP))


def _ramp(time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the compressive strain beneath a piston that moves at a constant speed since time 0."""
    n = np.arange(1, TERMS + 1)[:, None]
    t = np.maximum(time, 0.0)
    seconds = HEIGHT**2 / (MODULUS * PERMEABILITY)
    series = ((1 - np.exp(-((n * np.pi) ** 2) * t / seconds)) / n**2).sum(axis=0)
    rest = (np.pi**2 / 6 - (1 / n**2).sum()) * (t > 0)
    return STRAIN / RAMP * (t + 2 * seconds / np.pi**2 * (series + rest))


def table() -> str:
    """Return the text of the CSV file; the force is that on a square millimetre."""
    times = np.array(TIMES, dtype=float)
    rows = [f"{t:g}, {1000 * s:.3f}" for t, s in zip(times, stress(times), strict=True)]
    head = (
        "# Computed, not measured: by confined_relaxation.py from printed parameters. See README.md.",
        "time [s], force [mN]",
    )
    return "\n".join((*head, *rows)) + "\n"


if __name__ == "__main__":
    Path(__file__).with_name("cartilage-confined-compression.csv").write_text(table(), encoding="utf-8")

"""Writes filmed-plug.csv and plug-curves.csv: a plug with a graded stiffness that settles, seen at many points.

A plug of height h stands in a sealed ring. A porous piston presses it with the stress P since time 0, and fluid leaves
through the piston. Both constituents are incompressible, and strains are small. With the displacement u along the
height y, the aggregate modulus H(y) and the permeability k,

    p = H u' + P,    du/dt = k p',    u(0) = 0,    p(h) = 0,

(Terzaghi; Mow, Kuei, Lai & Armstrong 1980, J. Biomech. Eng. 102:73-84). Finite volumes in y and a stiff solver in time
solve them. Nothing of porocore is used.

    .venv/bin/python examples/calibrations/filmed_plug.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh_tridiagonal

#: Height [mm], stress [kPa], permeability [mm⁴/(N s)], and moduli H [kPa] at some heights [mm], linear between.
HEIGHT, STRESS, PERMEABILITY = 3.0, 0.5, 1e-2
HEIGHTS, MODULI = (0.0, 1.0, 2.0, 3.0), (350.0, 250.0, 140.0, 180.0)
#: Standard deviations of a displacement [µm] and a pressure [Pa].
DEVIATION, OF_PRESSURE = 0.1, 5.0
#: Times of the frames and of the curves [s].
FRAMES = (60, 120, 240, 400, 700, 1200, 2000, 3000, 4500, 6000)
TIMES = np.geomspace(60, 6000, 20).round()
#: Points of a frame across and along the window [mm], and cells of the solution.
ACROSS, ALONG = np.linspace(0.05, 0.45, 4), np.linspace(0.05, 2.95, 30)
CELLS = 1200

Floats = NDArray[np.float64]


def column(times: Floats) -> tuple[Floats, Floats, Floats]:
    """Return heights (n,) [mm], displacements (times, n) [mm] there, and pressures (times,) [MPa] on the base.

    Unknown are the displacements at the upper ends of n cells; strains and pressures belong to their middles. The
    equations M du/dt = K (u∞ − u), with the lengths in M, decay along the eigenvectors of the symmetric pencil.
    """
    d = HEIGHT / CELLS
    ends = d * np.arange(1, CELLS + 1)
    modulus = 1e-3 * np.interp(ends - d / 2, HEIGHTS, MODULI) / d
    final = -np.cumsum(1e-3 * STRESS / modulus)
    # The last node stands for half a cell, at whose upper end the pressure is zero.
    mass = np.r_[np.full(CELLS - 1, d), d / 2]
    scale = np.sqrt(PERMEABILITY / mass)
    diagonal = np.r_[modulus[:-1] + modulus[1:], modulus[-1]] * scale**2
    values, vectors = eigh_tridiagonal(diagonal, -modulus[1:] * scale[:-1] * scale[1:])
    first = vectors.T @ (final / scale)
    decayed = np.exp(-np.outer(times, values)) * first
    u = final - (decayed @ vectors.T) * scale
    return ends, u, modulus[0] * u[:, 0] + 1e-3 * STRESS


def main() -> None:
    folder, draws = Path(__file__).parent, np.random.default_rng(0)
    heights, u, _ = column(np.array(FRAMES, dtype=float))
    lines = ["x [mm],y [mm],t [s],u2 [um]"]
    for time, each in zip(FRAMES, u, strict=True):
        for y, exact in zip(ALONG, 1e3 * np.interp(ALONG, np.r_[0, heights], np.r_[0, each]), strict=True):
            lines += [
                f"{x:.3f},{y:.3f},{time},{exact + DEVIATION * draws.standard_normal():.3f}" for x in ACROSS
            ]
    (folder / "filmed-plug.csv").write_text("\n".join([*lines, ""]), encoding="utf-8")
    heights, u, p = column(TIMES)
    lines = ["time [s],settlement [um],pressure [Pa]"]
    for time, settlement, pressure in zip(TIMES, -1e3 * u[:, -1], 1e6 * p, strict=True):
        noise = draws.standard_normal(2)
        lines.append(
            f"{time:.0f},{settlement + DEVIATION * noise[0]:.3f},{pressure + OF_PRESSURE * noise[1]:.2f}"
        )
    (folder / "plug-curves.csv").write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()

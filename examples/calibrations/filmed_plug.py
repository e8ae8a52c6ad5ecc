"""Writes filmed-plug.csv and plug-curves.csv: a plug with a graded stiffness that settles, seen at many points.

A plug of height h stands in a sealed ring. A porous piston presses it with the stress P since time 0, and fluid leaves
through the piston. Strains are small, the fluid is incompressible, and the solid is slightly compressible. With the
displacement u along the height y, the aggregate modulus H(y), the permeability k, Biot's coefficient α and the storage
coefficient S at constant strain,

    H u' = α p − P,    α du'/dt + S dp/dt = (k p')',    p' = 0 at y = 0,    p(h) = 0,

(Biot 1941, J. Appl. Phys. 12:155-164). For a porous body of one solid with the bulk modulus K_s and the porosity φ,
α = 1 − K/K_s and S = (α − φ)/K_s, with the drained bulk modulus K: neither α nor S H changes with the stiffness of the
solid. Finite volumes in y and the eigenvectors in time solve them. Nothing of porocore is used.

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
#: Biot's coefficient, and storage coefficient by 1/H: porosity 0.5427, K_s = 52.5 H and K = 0.525 H, as in the cell.
BIOT, STORAGE = 0.99, 0.00852
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

    Unknown are the pressures in the middles of n cells. The equations C dp/dt = −K p, with the capacities in C, decay
    along the eigenvectors of the symmetric pencil from the pressure at which no fluid has left.
    """
    d = HEIGHT / CELLS
    ends = d * np.arange(1, CELLS + 1)
    modulus, load = 1e-3 * np.interp(ends - d / 2, HEIGHTS, MODULI), 1e-3 * STRESS
    scale = np.sqrt(modulus / ((BIOT**2 + STORAGE) * d))
    # The base is sealed; on the piston, half a cell away, the pressure is zero.
    flow = PERMEABILITY / d * np.r_[1.0, np.full(CELLS - 2, 2.0), 3.0]
    beside = -PERMEABILITY / d * scale[:-1] * scale[1:]
    values, vectors = eigh_tridiagonal(flow * scale**2, beside)
    first = vectors.T @ (BIOT / (BIOT**2 + STORAGE) * load / scale)
    p = (np.exp(-np.outer(times, values)) * first) @ vectors.T * scale
    return ends, np.cumsum((BIOT * p - load) / modulus * d, axis=1), p[:, 0]


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

"""A made-up consolidating column, complete as a macro solver would return it, to be drawn and written."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.interfaces.law import InternalVariable
from porocore.interfaces.solution import History, MacroSolution, Profile

HEIGHT, WIDTH = 7.5, 0.1
#: What the law of a column with a memory remembers.
REMEMBERED = (
    InternalVariable("overstress_1", (3, 3), "overstress", "stress"),
    InternalVariable("a/share", quantity=""),
)


def hexahedra(n: tuple[int, int, int], size: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and triquadratic hexahedra in VTK order of a box of ``n`` elements."""
    m = [2 * k + 1 for k in n]
    grid = np.meshgrid(*(np.linspace(0, s, k) for s, k in zip(size, m, strict=True)), indexing="ij")
    points = np.stack(grid, axis=-1).reshape(-1, 3)
    corners = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
    edges = [(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)]
    edges += [(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)]
    faces = [(0, 1, 1), (2, 1, 1), (1, 0, 1), (1, 2, 1), (1, 1, 0), (1, 1, 2)]
    local = np.array([*corners, *edges, *faces, (1, 1, 1)])
    start = 2 * np.stack(np.meshgrid(*(np.arange(k) for k in n), indexing="ij"), axis=-1).reshape(-1, 1, 3)
    i = start + local
    return points, (i[..., 0] * m[1] + i[..., 1]) * m[2] + i[..., 2]


def make_column(
    *,
    law: str = "nonlinear",
    load: float = -0.2,
    final: float = 2.0,
    rate: float = 0.1,
    beyond: float | None = -0.2,
    times: tuple[float, ...] = (1.0, 10.0, 40.0),
    end: float = 100.0,
    elements: tuple[int, int, int] = (1, 40, 1),
) -> MacroSolution:
    """A column that settles by exactly ``final`` (1 − exp(−``rate`` t)), flagged where H_22 < ``beyond``."""
    points, cells = hexahedra(elements, (WIDTH, HEIGHT, WIDTH))
    time = np.concatenate([np.linspace(0, 0.5, 11), np.arange(1.0, end + 0.25, 0.5)])
    settled = final * (1 - np.exp(-rate * time))

    def gradient(y: np.ndarray, t: float) -> np.ndarray:
        """H_22, whose integral over the height is minus the settlement."""
        s = np.exp(-rate * t)
        return -final / HEIGHT * ((1 - s) + 0.8 * s * (1 - s) * np.sin(np.pi * (y / HEIGHT - 0.5)))

    def settlement(y: np.ndarray, t: float) -> np.ndarray:
        s = np.exp(-rate * t)
        wave = -0.8 * s * (1 - s) * np.sin(np.pi * y / HEIGHT) / np.pi
        return final * ((1 - s) * y / HEIGHT + wave)

    def pressure(y: np.ndarray, t: float) -> np.ndarray:
        return 0.9 * abs(load) * np.exp(-rate * t) * np.cos(np.pi / 2 * y / HEIGHT) ** 0.7

    def flagged(h: np.ndarray) -> np.ndarray:
        return (h < beyond).astype(float) if beyond is not None else np.zeros(len(h))

    centre = points[cells[:, 26], 1]
    outside = np.array([flagged(gradient(centre, t)).mean() for t in time])

    def profile(t: float) -> Profile:
        h, y = gradient(centre, t), points[:, 1]
        grad = np.zeros((len(h), 3, 3))
        grad[:, 1, 1] = h
        p = pressure(centre, t)
        mean = np.zeros_like(grad)
        mean[:, 1, 1] = -0.23 * h - 0.113 * p
        mean[:, 0, 0] = mean[:, 2, 2] = -0.076 * h - 0.113 * p
        deformation = np.eye(3) + grad + mean / 0.59
        conductivity = np.eye(3) * 1.943 * (1 - h[:, None, None] * np.diag([-0.5, 0.7, -0.5]))
        stress = np.zeros_like(grad)
        stress[:, 1, 1] = load
        flux = np.zeros((len(h), 3))
        flux[:, 1] = 0.03 * np.exp(-rate * t) * (centre / HEIGHT)
        u = np.zeros_like(points)
        u[:, 1] = -settlement(y, t)
        return Profile(
            t,
            u,
            pressure(y, t),
            grad,
            mean,
            deformation,
            conductivity,
            stress,
            flux,
            p,
            flagged(h),
            0.41 + 0.8 * h + 0.3 * p,
        )

    history = History(
        time=time,
        ramp=np.minimum(1, time / 0.5),
        settlement=settled,
        pressure_max=0.9 * abs(load) * np.minimum(1, time / 0.5) * np.exp(-rate * time),
        drained_paper=0.98 * WIDTH**2 * settled * 1.12,
        drained=0.98 * WIDTH**2 * settled,
        flagged=outside,
        stress_spread=np.full(len(time), 1e-9),
        iterations=np.where(time > 0, 3, 0),
        heave=np.zeros(len(time)),
        pressure_min=np.zeros(len(time)),
        displacement=np.abs(settled),
    )
    return MacroSolution(law, load, points, cells, history, tuple(profile(t) for t in sorted({*times, end})))


def with_memory(column: MacroSolution) -> MacroSolution:
    """The column with internal variables."""
    profiles = [
        replace(
            each,
            internal={"overstress_1": 0.1 * each.stress, "a/share": 0.3 * each.element_p},
            cell_p=0.9 * each.element_p,
        )
        for each in column.profiles
    ]
    return replace(
        column, profiles=tuple(profiles), quantities={each.name: each.quantity for each in REMEMBERED}
    )

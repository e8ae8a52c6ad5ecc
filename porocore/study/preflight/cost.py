"""Measured time and memory of a cell problem by its number of nodes, interpolated.

``benchmarks/cell_cost.py`` measures them again and prints the ratio of each estimate to what it finds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Measured:
    """A quantity at several numbers of nodes; a power law between two of them, and beyond the last two."""

    nodes: tuple[float, ...]
    values: tuple[float, ...]

    def at(self, nodes: float) -> float:
        """Return the quantity at a number of nodes."""
        return self._line(nodes, self.nodes, self.values)

    def nodes_for(self, value: float) -> float:
        """Return the number of nodes at which the quantity has a value."""
        return self._line(value, self.values, self.nodes)

    @staticmethod
    def _line(x: float, xs: tuple[float, ...], ys: tuple[float, ...]) -> float:
        if x <= 0:
            return 0.0
        i = min(max(int(np.searchsorted(xs, x)), 1), len(xs) - 1)
        exponent = np.log(ys[i] / ys[i - 1]) / np.log(xs[i] / xs[i - 1])
        return float(ys[i] * (x / xs[i]) ** exponent)


@dataclass(frozen=True)
class Costs:
    """Costs of the problems of one domain by the nodes that are solved.

    Attributes
    ----------
    first, state
        Seconds of a process for a state with its derivatives, and for the first one beyond those.
    solid
        Bytes that the states take beyond those of the libraries.
    conductivity, fluid
        Seconds and bytes of K.
    """

    first: Measured
    state: Measured
    solid: Measured
    conductivity: Measured
    fluid: Measured


#: Nodes of the solids and of the fluids that were measured: images of smoothed noise of porosity ½ with 12³ to 64³
#: voxels at three voxels a tetrahedron, curved elements of second order, scikit-fem with PARDISO, one core of a machine
#: with some other work. Beyond 50,000 unknowns, three a node, multigrid takes over.
SOLIDS = (1_674, 4_236, 7_280, 16_797, 46_040, 111_804)
FLUIDS = (1_358, 3_861, 8_231, 17_604, 44_269, 110_201)
#: The whole cell.
WHOLE = Costs(
    first=Measured(SOLIDS, (0.16, 0.36, 0.97, 2.4, 3.2, 4.7)),
    state=Measured(SOLIDS, (0.27, 0.41, 0.71, 2.1, 8.0, 32)),
    solid=Measured(SOLIDS, (6.6e7, 1.5e8, 2.9e8, 7.3e8, 1.1e9, 2.7e9)),
    conductivity=Measured(FLUIDS, (0.052, 0.15, 0.32, 0.90, 3.5, 11)),
    fluid=Measured(FLUIDS, (2.0e7, 3.0e7, 6.5e7, 1.5e8, 4.3e8, 9.3e8)),
)
#: The same of images with mirrors, of 12³ to 48³ voxels, on the eighth. Every parity of the derivatives and every axis
#: of the flow has a problem of its own there. Two workers at 12,128 nodes held 1.45 GB each, and their parent 1.12 GB
#: (proportional set size), of which the table makes 1.42 GB.
SOLID_EIGHTHS = (1_348, 7_160, 16_421, 33_564, 45_643)
FLUID_EIGHTHS = (1_268, 8_073, 17_285, 43_785)
EIGHTH = Costs(
    first=Measured(SOLID_EIGHTHS, (0.21, 2.0, 5.4, 5.6, 9.7)),
    state=Measured(SOLID_EIGHTHS, (0.072, 1.0, 3.5, 11, 17)),
    solid=Measured(SOLID_EIGHTHS, (1.0e8, 7.6e8, 2.0e9, 2.6e9, 3.6e9)),
    conductivity=Measured(FLUID_EIGHTHS, (0.11, 0.76, 2.0, 9.3)),
    fluid=Measured(FLUID_EIGHTHS, (2.9e7, 1.1e8, 2.7e8, 5.6e8)),
)
#: Memory of one process that solves cells [bytes], shared pages counted once: in the benchmark with either
#: finite-element backend, and of the libraries alone.
PROCESS, LIBRARIES = 2.7e8, 2e8


def costs(share: float) -> Costs:
    """Return the costs of the domain that is this share of a cell: its eighth, or the whole."""
    return WHOLE if share == 1 else EIGHTH


def process_memory(nodes: float, share: float = 1.0) -> float:
    """Return the memory of one process that solves so many nodes, which are this share of a solid [bytes]."""
    return max(PROCESS, LIBRARIES + costs(share).solid.at(nodes))

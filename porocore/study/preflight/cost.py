"""Time and memory of one cell problem by its number of nodes, interpolated between measured ones.

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


#: Nodes of the solids and of the fluids that were measured: images of smoothed noise of porosity ½ with 16³ to 64³
#: voxels at three voxels a tetrahedron, curved elements of second order, scikit-fem with PARDISO, one core. The last
#: two are solved by multigrid, whose times were taken beside other work and divided by what that cost a factor, 1.24.
SOLIDS = (4_236, 7_280, 16_797, 46_040, 111_804)
FLUIDS = (3_861, 8_231, 17_604, 44_269, 110_201)
#: Nodes of eighths that were measured.
EIGHTHS = (3_853, 5_561, 12_128, 24_140)
#: Seconds: of the first state of a process beyond those of any other, of a state with its derivatives, and of K.
FIRST = Measured(SOLIDS, (0.33, 0.69, 3.7, 1.0, 3.8))
STATE = Measured(SOLIDS, (0.53, 0.93, 2.4, 12, 36))
CONDUCTIVITY = Measured(FLUIDS, (0.19, 0.39, 1.2, 3.7, 12))
#: Bytes beyond those of the libraries.
SOLID = Measured(SOLIDS, (1.6e8, 3.2e8, 8.1e8, 1.1e9, 2.7e9))
FLUID = Measured(FLUIDS, (3.2e7, 6.1e7, 1.4e8, 4.4e8, 9.1e8))
#: Bytes of an eighth of a cell with mirrors, by its nodes: every parity of the derivatives has its own factor there.
#: The largest resident set beyond that of the libraries, of an image of 18 × 18 × 26 voxels at mesh sizes of 0.1 to
#: 0.045. Two workers at 12,128 nodes held 1.45 GB each, and their parent 1.12 GB (proportional set size).
EIGHTH = Measured(EIGHTHS, (3.95e8, 5.82e8, 1.44e9, 2.54e9))
#: Memory of one process that solves cells [bytes], shared pages counted once: in the benchmark with either
#: finite-element backend, and of the libraries alone.
PROCESS, LIBRARIES = 2.7e8, 2e8


def process_memory(nodes: float, share: float = 1.0) -> float:
    """Return the memory of one process that solves so many nodes, which are this share of a solid [bytes]."""
    return max(PROCESS, LIBRARIES + memory_law(share).at(nodes))


def memory_law(share: float) -> Measured:
    """Return the memory by the nodes that are solved, where these are this share of a solid."""
    return SOLID if share == 1 else EIGHTH

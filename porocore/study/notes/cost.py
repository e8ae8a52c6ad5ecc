"""Measured time and memory of a cell problem by its number of nodes, and times of the other stages of a run.

``benchmarks/cell_cost.py`` measures those of cells again and prints the ratio of each estimate to what it finds.
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


#: Seconds of any state beside those of the tables, which are near rest: the 256 states of ``dehghani2022``, of which a
#: third are in contact, take 0.12 s of processor time in the mean, where these make 0.05 of their eighth.
LEAST = 0.07


@dataclass(frozen=True)
class CellCost:
    """Costs of the problems of one cell on one quiet core and in one process.

    Attributes
    ----------
    solid, fluid
        Nodes of the whole solid and fluid.
    parts
        Shares of them that are solved for a state and for K: an eighth, or the whole.
    deformed
        True if every state also has the flow through its deformed pore.
    """

    solid: float
    fluid: float
    parts: tuple[float, float] = (1.0, 1.0)
    deformed: bool = False

    @property
    def nodes(self) -> tuple[float, float]:
        """Nodes of the solid and of the fluid that are solved."""
        return self.solid * self.parts[0], self.fluid * self.parts[1]

    @property
    def first(self) -> float:
        """Time that the first state of a process takes longer than any other [s]."""
        return costs(self.parts[0]).first.at(self.nodes[0])

    @property
    def state(self) -> float:
        """Time of a state with its derivatives [s]."""
        of = costs(self.parts[0])
        # The flow through a deformed pore is solved on the domain of the state.
        flow = of.conductivity.at(self.fluid * self.parts[0]) if self.deformed else 0.0
        return LEAST + of.state.at(self.nodes[0]) + flow

    @property
    def conductivity(self) -> float:
        """Time of K [s]."""
        return costs(self.parts[1]).conductivity.at(self.nodes[1])

    @property
    def memory(self) -> float:
        """Memory of a process that solves states [bytes]."""
        return process_memory(self.nodes[0], self.parts[0])

    @property
    def memory_of_flow(self) -> float:
        """Memory of a process that solves K [bytes]."""
        return LIBRARIES + costs(self.parts[1]).fluid.at(self.nodes[1])


#: Seconds in which a process has loaded the libraries and prepared the cell: coarse cells. Of a run until it begins.
START, BEGIN = 0.7, 3.0
#: Seconds of the report, and more for each load: 4.7 and 5.5 with one, 10.7 with three.
REPORT, REPORT_OF_LOAD = 2.0, 3.0
#: Time steps between two kinks of the loads, times the root of the tolerance. The examples ``cartilage-confined``
#: and ``soil-strip`` took 115 and 102, which makes 1.8 and 2.3.
STEPS = 2.0
#: With indenters, whose contact grows by one point of a facet after the other: ``brain-indentation`` and
#: ``gel-indentation`` took 222 and 219, which is 3.9 and 2.4 times as many.
STEPS_OF_CONTACT = 3.0
#: Linear systems of a step, 2.1 to 2.5 in these and in ``filter``.
SYSTEMS = 2.35
#: Seconds of one by the quadrature points of the body: of the linear law in these examples, whose matrix changes with
#: the steps, and of the cubes of ``benchmarks/macro_size.py``.
POINTS = (972, 3_888, 5_832, 24_352, 76_432, 224_100)
SYSTEM = Measured(POINTS, (0.0085, 0.038, 0.096, 0.34, 1.6, 5.8))
#: Seconds of a law and of its tangent for each point by the closure: 0.007 to 0.014 ms in these examples, with two to
#: seven inputs, and less with the paper's closure in the column of ``benchmarks/macro_iteration.py``.
LAW = {"potential": 1.3e-5, "mean-gradient": 4e-6}
#: Systems of the linear law for each step of one length: its matrix stays.
LINEAR_FIXED = 0.3
#: A system of a column takes this share: 0.0011 s with 432 points in ``filter``, 0.004 to 0.007 with 2,862 in
#: ``dehghani2022``, whose body takes 15 s under both loads on a busy machine.
COLUMN = 0.3


@dataclass(frozen=True)
class Training:
    """Time of a training.

    Attributes
    ----------
    once, state
        Seconds without and for each state that is learned from.
    """

    once: float
    state: float

    def at(self, states: float) -> float:
        """Return the seconds of a training on so many states."""
        return self.once + self.state * states


#: By backend and model, on 8 to 300 states: torch with two to seven inputs, jax with two. A network for the mean
#: gradient ends early on fewer than 20 states, after 3 s. The polynomial took 0.44 s with seven inputs, 0.23 s here.
TRAINING = {
    ("torch", "potential"): Training(2.7, 0.004),
    ("torch", "mlp"): Training(7.0, 0.015),
    ("jax", "potential"): Training(3.2, 0.004),
    ("jax", "mlp"): Training(3.2, 0.02),
    ("polynomial", "potential"): Training(0.1, 0.005),
    ("polynomial", "mlp"): Training(0.1, 0.005),
}

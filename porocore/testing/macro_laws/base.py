"""Suite of macro solvers (MacroSolverSuite): all laws of this room together.

.. code-block:: python

    class TestMyMacroSolver(MacroSolverSuite):
        kit_version = "3"

        @classmethod
        def make_solver(cls, **options):
            return MyMacroSolver(**options)
"""

from __future__ import annotations

from porocore.testing.macro_laws.bodies import Bodies
from porocore.testing.macro_laws.histories import Histories
from porocore.testing.macro_laws.plates import Plates
from porocore.testing.macro_laws.runs import Runs
from porocore.testing.macro_laws.sensitivities import RunDerivatives
from porocore.testing.macro_laws.states import KnownStates


class MacroSolverSuite(KnownStates, Plates, Bodies, Histories, Runs, RunDerivatives):
    """Subclass it, name the class ``Test…`` and give it ``make_solver``.

    It expects that :meth:`~porocore.MacroSolver.prepare` returns a ``porocore.macro`` discretisation, that the
    solver runs on one process, and that it takes the option ``checkpoint_seconds``.
    """

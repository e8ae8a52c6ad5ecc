"""Interface of a macro solver: prepare and solve the u–p problem; parts of a problem that it may offer."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, get_args

from porocore.core.parallel import Communicator
from porocore.errors import ConfigurationError
from porocore.interfaces.cell import Prepared
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.sensitivities import HistoryWeights, MacroChange, MacroSensitivities
from porocore.interfaces.solution import MacroSolution, StepReport
from porocore.states import Array

if TYPE_CHECKING:
    from porocore.macro.problem import MacroProblem

#: What a problem may have beside displacements, tractions and pressures; not every macro solver offers all.
Part = Literal[
    "follower",
    "plate",
    "contact",
    "flux",
    "body_force",
    "initial",
    "probes",
    "surfaces",
    "tolerance",
    "load_curve",
    "regions",
    "fields",
]
PARTS: frozenset[Part] = frozenset(get_args(Part))


class MacroSolver(ABC, Generic[Prepared]):
    """Solver for u, p with ∫ P_E:∇δu = ∫ t̄·δu and ∫ Δstorage δp − Δt ∫ q·∇δp + Δt ∫ q̄ δp = 0 (backward Euler).

    The law is asked once an iteration for all quadrature points and returns the exact tangent; a step whose
    Newton iteration fails is halved. Inf–sup stable: quadratic u, linear p.
    ``porocore.macro`` has what all implementations share, and ``porocore.testing.macro_checks.states`` tests them.

    What a solver offers is declared by the attributes of its class; a study that needs more is refused before anything
    is solved, and the suite skips what is not offered.
    """

    #: Kinds of bodies that it solves, as ``macro.body.kind`` has them; ``column`` is a box whose sides move along y
    #: alone and which is loaded along y. None: every kind.
    bodies: ClassVar[tuple[str, ...] | None] = None
    #: Parts of a problem that it solves beside displacements, tractions and pressures.
    parts: ClassVar[frozenset[Part]] = PARTS
    #: Whether it writes checkpoints and continues from them; it then takes the option ``checkpoint_seconds``.
    checkpoints: ClassVar[bool] = True
    #: ``core``: :meth:`prepare` returns a ``porocore.macro`` discretisation of the body's mesh; ``own``: anything else.
    meshes: ClassVar[Literal["core", "own"]] = "core"
    #: Largest relative error of histories and fields on a column of ten elements; of a solver on the core's mesh the
    #: difference from others on it, which the tolerance of Newton's iteration decides.
    accuracy: ClassVar[float] = 1e-6
    #: Whether several MPI processes can share one problem; those that can set :attr:`communicator` too.
    distributed: ClassVar[bool] = False
    #: Whether :meth:`solve_with_sensitivities` returns derivatives of the histories.
    sensitivities: ClassVar[bool] = False
    #: Whether :meth:`solve_with_gradients` returns gradients of sums over the histories.
    gradients: ClassVar[bool] = False
    #: The processes that solve together, all of which call :meth:`prepare` and :meth:`solve`.
    communicator: Communicator = Communicator()

    def __init__(self, **options: Any) -> None:
        if options:
            raise TypeError(f"{type(self).__name__} takes no options, got {sorted(options)}")

    @abstractmethod
    def prepare(self, problem: MacroProblem) -> Prepared:
        """Return mesh, bases and boundary data, shared by solves with several laws."""

    def remark(self, prepared: Prepared) -> str:
        """Return a line for the log on how the linear systems are solved; empty where there is none."""
        return ""

    @abstractmethod
    def solve(
        self,
        prepared: Prepared,
        law: MacroLaw,
        *,
        checkpoint: Path | None = None,
        on_step: Callable[[StepReport], None] | None = None,
    ) -> MacroSolution:
        """Integrate the problem over its time plan.

        With ``checkpoint``, the state is written there from time to time, and a run that finds the file
        continues from it to the same solution.

        Raises
        ------
        SolveError
            Newton's iteration fails at the smallest step.
        DataError
            The checkpoint belongs to another problem or law.
        """

    def solve_with_sensitivities(
        self,
        prepared: Prepared,
        law: MacroLaw,
        changes: Sequence[MacroChange],
        *,
        profiles: bool = False,
        on_step: Callable[[StepReport], None] | None = None,
    ) -> tuple[MacroSolution, MacroSensitivities]:
        """Integrate as :meth:`solve` does, and return the exact derivatives of the histories by unknowns, too.

        They are those of the discrete equations at fixed time steps; with ``profiles`` also those of the nodal fields
        in the solution's profiles. A solver that declares :attr:`sensitivities` overrides this.

        Raises
        ------
        ConfigurationError
            The solver or the law offers no derivatives, or an unknown is of what the problem does not have.
        SolveError
            Newton's iteration fails at the smallest step, or a linear system has no solution.
        """
        raise ConfigurationError(
            f"macro.backend: the macro solver {type(self).__name__} gives no sensitivities (sensitivities = False); "
            "choose another, such as skfem"
        )

    def solve_with_gradients(
        self,
        prepared: Prepared,
        law: MacroLaw,
        changes: Sequence[MacroChange],
        weights: Callable[[MacroSolution], HistoryWeights],
        *,
        on_step: Callable[[StepReport], None] | None = None,
    ) -> tuple[MacroSolution, Array]:
        """Integrate as :meth:`solve` does, and return the gradients of sums over the histories by unknowns, too.

        They are the same derivatives as those of :meth:`solve_with_sensitivities`, by one pass backwards over the
        steps: it costs as much for any number of unknowns, but in proportion to the number of sums. A solver that
        declares :attr:`gradients` overrides this.

        Parameters
        ----------
        weights
            Returns the weights of f sums, which may depend on the solution, such as residuals over variances for the
            gradient of half a sum of squares.

        Returns
        -------
        solution, gradients : (f, k)
            Derivatives of each sum by each of the k unknowns.

        Raises
        ------
        ConfigurationError
            As :meth:`solve_with_sensitivities`; also weights of a series that the run does not have.
        SolveError
            Newton's iteration fails at the smallest step, or a linear system has no solution.
        """
        raise ConfigurationError(
            f"macro.backend: the macro solver {type(self).__name__} gives no gradients (gradients = False); choose "
            "another, such as skfem"
        )

"""The macro solver on scikit-fem: triquadratic displacement, trilinear pressure, backward Euler, Newton."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from porocore.interfaces.macro import MacroSolver
from porocore.laws import MacroLaw
from porocore.problem import MacroProblem
from porocore.solution import MacroSolution, StepReport
from porocore.stepping import Stepper
from porocore_fem_skfem import macro_checkpoint
from porocore_fem_skfem.macro_assembly import Assembler
from porocore_fem_skfem.macro_newton import StepFailed, newton_step
from porocore_fem_skfem.macro_record import Record
from porocore_fem_skfem.macro_space import make_space


class SkfemMacroSolver(MacroSolver):
    """Boxes of hexahedra (27-node displacement, 8-node pressure, 3 × 3 × 3 Gauss points), solved directly.

    Parameters
    ----------
    checkpoint_seconds
        Wall time between two checkpoints; 0 writes one after every step.
    """

    def __init__(self, *, checkpoint_seconds: float = 5.0) -> None:
        super().__init__()
        self.checkpoint_seconds = checkpoint_seconds

    def prepare(self, problem: MacroProblem) -> Assembler:
        """Mesh, bases, boundary data, constant matrices and sparsity.

        Raises
        ------
        ConfigurationError
            Two faces contradict each other, or a translation is not held.
        """
        return Assembler(make_space(problem))

    def solve(
        self,
        prepared: Any,
        law: MacroLaw,
        *,
        checkpoint: Path | None = None,
        on_step: Callable[[StepReport], None] | None = None,
    ) -> MacroSolution:
        """See :class:`porocore.MacroSolver`; ``prepared`` is what :meth:`prepare` returned."""
        assembler: Assembler = prepared
        problem = assembler.space.problem
        stepper, x = Stepper(problem.time), np.zeros(assembler.space.size)
        owner = macro_checkpoint.identity(problem, law)
        if checkpoint is not None and checkpoint.exists():
            x, memory, record = macro_checkpoint.load(checkpoint, owner, stepper, x, law, assembler.n_points)
        else:
            memory, record = law.initial(assembler.n_points), Record()
            states, grad_p = assembler.states(x)
            record.add_rest(assembler, law.respond(states, grad_p, memory, tangent=False))
        written = monotonic()
        while not stepper.done:
            time = stepper.next()
            dt, ramp = time - stepper.time, problem.ramp(time)
            try:
                step = newton_step(assembler, law, memory, x, dt, problem.load * ramp, problem.newton)
            except StepFailed as failure:
                stepper.reject(str(failure))
                continue
            x, memory = step.x, step.response.memory
            record.add_step(assembler, step, time, dt, ramp)
            if stepper.is_profile(time):
                record.add_profile(assembler, step, time)
            stepper.accept()
            if checkpoint is not None and (stepper.done or monotonic() - written >= self.checkpoint_seconds):
                macro_checkpoint.save(checkpoint, owner, stepper, x, memory, record)
                written = monotonic()
            if on_step is not None:
                settlement = float(record.column("settlement")[-1])
                on_step(StepReport(time, problem.time.end, step.iterations, settlement))
        return record.solution(assembler, law.name)

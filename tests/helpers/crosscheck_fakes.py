"""A plugin for the tests of crosscheck: backends that agree with scikit-fem's, that are a little wrong, and that fail.

Its hooks import nothing; the classes are made when they are asked for.
"""

from __future__ import annotations

from porocore import Offer, hookimpl


def cell_solvers():
    import porocore_fem_skfem.cell_solver as skfem

    class Twin(skfem.SkfemCellSolver):
        """The same equations."""

    def altered(name, change):
        def prepare(self, cell):
            return Twin.prepare(self, change(cell))

        return type(name, (Twin,), {"prepare": prepare})

    def stiffer(cell):
        nu = 1.01 * cell.material.poisson_ratio
        return cell.model_copy(update={"material": cell.material.model_copy(update={"poisson_ratio": nu})})

    def thicker(cell):
        return cell.model_copy(update={"viscosity": 1.01 * cell.viscosity})

    class Stumbling(Twin):
        def solve(self, prepared, states, **how):
            if states.grad_u[0, 0, 1] != 0:
                raise ArithmeticError("a pivot vanished\nin the whole cell")
            return super().solve(prepared, states, **how)

    class Late(Twin):
        def prepare(self, cell):
            raise RuntimeError("no licence")

    return {
        "twin": Twin,
        "poisson": altered("Poisson", stiffer),
        "viscosity": altered("Viscosity", thicker),
        "stumbling": Stumbling,
        "late": Late,
    }


def macro_solvers():
    from porocore import SolveError
    from porocore_fem_skfem.macro import SkfemMacroSolver

    class Twin(SkfemMacroSolver):
        """The same equations."""

    class Heavier(Twin):
        """A load that is too large by 1e-5."""

        def prepare(self, problem):
            return super().prepare(problem.model_copy(update={"load": (1 + 1e-5) * problem.load}))

    class Hasty(Twin):
        """Other time steps."""

        def prepare(self, problem):
            time = problem.time.model_copy(update={"step": 2 * problem.time.step})
            return super().prepare(problem.model_copy(update={"time": time}))

    class Stuck(Twin):
        def solve(self, prepared, law, **how):
            raise SolveError("the smallest step failed at t = 0.1")

    from partial.column import ColumnMacroSolver

    return {"twin": Twin, "heavier": Heavier, "hasty": Hasty, "stuck": Stuck, "volumes": ColumnMacroSolver}


def surrogates():
    import numpy as np

    from porocore import CellResponse, CellTangent, Surrogate
    from porocore.core.inputs import SampledRange

    class Cubic(Surrogate):
        """⟨∇u¹⟩ as a polynomial of third degree in the two sampled inputs, by least squares."""

        factor = 1.0

        def __init__(self, **options):
            self.options = options

        def fit(self, data, *, seed, checkpoint=None, on_progress=None):
            self.identity, self.inputs, self.provenance = data.identity, data.inputs, data.provenance
            x = self.inputs.gather(data.states)
            self.range = SampledRange.around(self.inputs, x)
            values = data.responses.mean_grad.reshape(len(x), 9)
            self.weights = np.linalg.lstsq(self.terms(x)[0], values, rcond=None)[0] * self.factor
            return self

        @staticmethod
        def terms(x):
            a, b = x.T
            powers = [(i, j) for i in range(4) for j in range(4 - i)]
            value = np.stack([a**i * b**j for i, j in powers], axis=1)
            by_a = np.stack([i * a ** max(i - 1, 0) * b**j for i, j in powers], axis=1)
            by_b = np.stack([j * a**i * b ** max(j - 1, 0) for i, j in powers], axis=1)
            return value, by_a, by_b

        def predict(self, states, *, tangent=True):
            x, n = self.inputs.gather(states), len(states)
            value, *slopes = (term @ self.weights for term in self.terms(x))
            flat = np.zeros((n, 9, 10))
            for column, slope in zip(self.inputs.columns, slopes, strict=True):
                flat[:, :, column] = slope
            derivatives = CellTangent(
                mean_grad_grad_u=flat[:, :, :9].reshape(n, 3, 3, 3, 3),
                mean_grad_p=flat[:, :, 9].reshape(n, 3, 3),
            )
            return CellResponse(
                mean_grad=value.reshape(n, 3, 3),
                status=np.zeros(n, dtype=int),
                doubt=(~self.range.contains(x)).astype(np.int64),
                tangent=derivatives if tangent else None,
            )

        def save(self, path):
            raise NotImplementedError

        @classmethod
        def load(cls, path):
            raise NotImplementedError

    class Biased(Cubic):
        """Two per cent too large."""

        factor = 1.02

    class Wavy(Cubic):
        """Right at the held-out states of the test, wrong between them."""

        def predict(self, states, *, tangent=True):
            response = super().predict(states, tangent=tangent)
            if len(states) > 100:
                response.mean_grad[7] += 0.01
            return response

    class Lazy(Cubic):
        def fit(self, data, **how):
            raise MemoryError("no room for the weights")

    from partial.kernel import KernelSurrogate

    return {"cubic": Cubic, "biased": Biased, "wavy": Wavy, "lazy": Lazy, "kernels": KernelSurrogate}


def _offers(classes, names):
    return [Offer(name, lambda name=name: classes()[name], "") for name in names]


@hookimpl
def porocore_cell_solvers():
    return _offers(cell_solvers, ["twin", "poisson", "viscosity", "stumbling", "late"])


@hookimpl
def porocore_macro_solvers():
    return _offers(macro_solvers, ["twin", "heavier", "hasty", "stuck", "unimportable", "volumes"])


@hookimpl
def porocore_surrogates():
    return _offers(surrogates, ["cubic", "biased", "wavy", "lazy", "kernels"])

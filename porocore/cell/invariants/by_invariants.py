"""Base of materials by a formula of invariants: energy, stress and tangent (InvariantMaterial)."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from porocore.cell.invariants.formula import Formula
from porocore.cell.invariants.generated import Derivatives, derivatives
from porocore.cell.invariants.invariants import Fibre, Invariant, Second, Trace, Volume, add_outer
from porocore.cell.materials.kinematics import Kinematics
from porocore.cell.materials.material import Material
from porocore.states import Array

#: Points in one batch, so that their tangents fit into the cache of the processor.
TOGETHER = 1024
#: Invariants by their names in a formula.
BASIC: dict[str, Invariant] = {"I1": Trace(), "I2": Second(), "J": Volume()}
#: Volumetric energy of the presets: convex in J, with a barrier at J = 0 and the bulk modulus K (Simo & Taylor 1991,
#: Comput. Methods Appl. Mech. Eng. 85, eq. 3.1).
VOLUMETRIC = "K/4*(J**2 - 1 - 2*log(J))"


class InvariantMaterial(Material):
    """Ψ = W(I_1, …, I_m) − W at rest, with the invariants I_a(F) that the formula names.

    P = Σ_a W_a ∂I_a/∂F and A = Σ_a W_a ∂²I_a/∂F² + Σ_ab W_ab ∂I_a/∂F ⊗ ∂I_b/∂F.
    """

    @property
    @abstractmethod
    def invariants(self) -> dict[str, Invariant]:
        """Invariants that the formula may use, by name."""

    @property
    @abstractmethod
    def formula(self) -> str:
        """Formula of W as text."""

    @property
    @abstractmethod
    def constants(self) -> dict[str, float]:
        """Parameters of the formula, by name."""

    @property
    def isotropic(self) -> bool:
        """True, unless a kind has fibres."""
        return True

    def energy_density(self, F: Array) -> Array:
        def compute(at: Kinematics, d: Derivatives, used: list[Invariant], out: Array) -> None:
            (rest,) = d.value(*(float(i.rest) for i in used), *self.constants.values())
            (energy,) = d.value(*(i.value(at) for i in used), *self.constants.values())
            out[:] = energy - rest

        return self._computed(F, (), compute)

    def stress(self, F: Array) -> Array:
        def compute(at: Kinematics, d: Derivatives, used: list[Invariant], out: Array) -> None:
            first = d.first(*(i.value(at) for i in used), *self.constants.values())
            out[:] = sum(W_a * i.gradient(at) for W_a, i in zip(first, used, strict=True))

        return self._computed(F, (3, 3), compute)

    def tangent(self, F: Array) -> Array:
        def compute(at: Kinematics, d: Derivatives, used: list[Invariant], out: Array) -> None:
            m = len(used)
            found = d.second(*(i.value(at) for i in used), *self.constants.values())
            gradients = [i.gradient(at) for i in used]
            second = np.empty((m, m), dtype=object)
            for (a, b), value in zip(np.transpose(np.triu_indices(m)), found[m:], strict=True):
                second[a, b] = second[b, a] = value
            for a in range(m):
                mixed = sum(second[a, b] * gradients[b] for b in range(m) if not _vanishes(second[a, b]))
                if not isinstance(mixed, int):
                    add_outer(out, gradients[a], mixed)
            for W_a, invariant in zip(found[:m], used, strict=True):
                if not _vanishes(W_a):
                    invariant.add_hessian(out, np.asarray(W_a), at)

        return self._computed(F, (3, 3, 3, 3), compute)

    def _kind_of_numbers(self, F: Array) -> np.dtype[Any]:
        """Return complex numbers where F or a number of the material is complex, as in a complex step."""
        directions = [i.direction for i in self.invariants.values() if isinstance(i, Fibre)]
        return np.result_type(F, *self.constants.values(), *map(np.asarray, directions))

    def _computed(self, F: Array, shape: tuple[int, ...], compute: Callable[..., None]) -> Array:
        """Return a quantity computed in batches of points, with components first in memory and last in its shape."""
        own = self.invariants
        generated = derivatives(formula_of(self.formula, own, self.constants))
        used = [tuple(own.values())[i] for i in generated.used]
        points = F.shape[:-2]
        flat = np.moveaxis(F.reshape(-1, 3, 3), 0, -1)
        n = flat.shape[-1]
        kind = self._kind_of_numbers(F)
        out = np.zeros((*shape, n), dtype=kind)
        # At unphysical strains an energy may overflow; the solver then shortens its step.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for start in range(0, n, TOGETHER):
                part = slice(start, start + TOGETHER)
                block = np.zeros((*shape, len(range(n)[part])), dtype=kind)
                compute(Kinematics(np.ascontiguousarray(flat[..., part])), generated, used, block)
                out[..., part] = block
        components = tuple(range(len(shape)))
        last = out.reshape((*shape, *points))
        return np.asarray(np.moveaxis(last, components, tuple(i - len(shape) for i in components)))


def formula_of(energy: str, invariants: Mapping[str, Invariant], constants: Iterable[str]) -> Formula:
    """Return the formula of an energy in the invariants and constants of these names."""
    return Formula(energy, tuple((name, i.rest) for name, i in invariants.items()), tuple(constants))


def _vanishes(value: Any) -> bool:
    """Return whether the generated code returned the number 0 instead of an array."""
    return np.ndim(value) == 0 and value == 0

"""Base of a configured material (Material): its Ψ, swelling, symmetry, and slopes by its numbers."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from porocore.cell.materials.energy import SWELLING, StrainEnergy, Swollen
from porocore.cell.materials.moduli import check_reference, voigt_moduli
from porocore.core.files.yaml_document import Location
from porocore.core.models.strict import StrictModel
from porocore.core.models.walk import with_number
from porocore.core.tensors.point_group import MIRRORS
from porocore.states import Array, IntArray

if TYPE_CHECKING:
    from porocore.cell.meshing.mesh import CellMesh

#: Imaginary step of a number; its square vanishes beside 1, whatever the number.
STEP = 1e-100


class Material(StrictModel, StrainEnergy):
    """Configuration of a homogeneous solid.

    A new kind derives this class, has a field ``kind`` with one allowed text, and stands in
    :data:`porocore.cell.materials.choice.AnyMaterial`. Its own methods are those of the elastic solid, without stress
    at F = I; :meth:`on` returns the swollen one. They are analytic in its numbers: with a complex number in the place
    of a real one they return complex results.
    """

    swelling: Annotated[float, Field(ge=0.2, le=5)] = 1.0
    """Stretch λ by which the solid swells in all directions where nothing holds it: F = λ I has no stress; 1: none."""

    @model_serializer(mode="wrap")
    def _only_what_is_given(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data: dict[str, Any] = handler(self)
        if self.swelling == 1:
            data.pop("swelling", None)
        return data

    @property
    @abstractmethod
    def description(self) -> str:
        """Short description, such as ``neo-hookean solid with Poisson's ratio 0.35``."""

    def turned(self, Q: IntArray) -> Material | None:
        """Return the solid after a signed permutation Q (3, 3) of the axes, Ψ'(F) = Ψ(QᵀFQ); None if unknown.

        An anisotropic kind turns its directions, so that its symmetry is used.
        """
        return self if self.isotropic else None

    def equals(self, other: Material) -> bool:
        """Return whether another solid has the same Ψ by its parameters."""
        return self == other

    def allows(self, Q: IntArray, regions: Mapping[str, str] | None) -> bool:
        """Return whether Q leaves the response unchanged; the images of the ``regions`` do not matter."""
        turned = self.turned(Q)
        return turned is not None and turned.equals(self)

    @property
    def mirrored(self) -> bool:
        """True where the response is invariant under the mirrors of the three axes, as on the eighth of a cell."""
        return all(self.allows(Q, None) for Q in MIRRORS.matrices)

    @property
    def swells(self) -> bool:
        """True where the solid is swollen, so that it has a stress at F = I."""
        return self.swelling != 1

    @property
    def identity(self) -> str:
        """Kind and parameters as text."""
        return self.model_dump_json()

    def on(self, mesh: CellMesh) -> StrainEnergy:
        """Return the strain energy of every element of a mesh of the solid: itself, or the swollen solid."""
        return self if self.swelling == 1 else Swollen(self, self.swelling)

    def parameter_slopes(self, key: Location, F: Array) -> tuple[Array, Array]:
        """Return ∂Ψ/∂θ and ∂P/∂θ by a complex step on a copy, exact to round-off; by λ those at λ = 1.

        References
        ----------
        Squire & Trapp (1998), SIAM Review 40, 110–112.
        """
        if key == (SWELLING,):
            return Swollen(self, 1.0).parameter_slopes(key, F)
        stepped = with_number(self, key, lambda number: complex(number, STEP))
        return stepped.energy_density(F).imag / STEP, stepped.stress(F).imag / STEP

    @property
    def elasticity(self) -> Array:
        """Elasticity C (3, 3, 3, 3) of small strains, A at F = I [E]."""
        return self.tangent(np.eye(3))

    def mean_moduli(self, elements: IntArray | None = None) -> tuple[float, float]:
        """See :class:`StrainEnergy`; Voigt's average over directions, exact where the solid is isotropic."""
        return voigt_moduli(self.elasticity)

    def stress_hint(self) -> str:
        """Return advice for an undeformed solid with a residual stress."""
        return ""

    @model_validator(mode="after")
    def _sound(self) -> Self:
        rest = np.eye(3)
        try:
            check_reference(self.energy_density(rest), self.stress(rest), self.elasticity, self.stress_hint)
        except OverflowError:
            raise ValueError(
                "the energy or a derivative of it is too large a number at F = I; give smaller powers"
            ) from None
        return self

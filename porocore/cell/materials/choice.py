"""List of the materials by ``kind``, and the default one."""

from __future__ import annotations

from typing import Annotated

from pydantic import Tag

from porocore.cell.invariants.expression import ExpressionMaterial
from porocore.cell.materials.holzapfel import HolzapfelGasserOgden
from porocore.cell.materials.material import Material
from porocore.cell.materials.mooney_rivlin import MooneyRivlin
from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.cell.materials.ogden import Ogden
from porocore.core.models.strict import by_kind

DEFAULT = "neo-hookean"


AnyMaterial = Annotated[
    Annotated[NeoHookean, Tag(DEFAULT)]
    | Annotated[MooneyRivlin, Tag("mooney-rivlin")]
    | Annotated[Ogden, Tag("ogden")]
    | Annotated[HolzapfelGasserOgden, Tag("holzapfel-gasser-ogden")]
    | Annotated[ExpressionMaterial, Tag("expression")],
    by_kind(Material, DEFAULT),
]

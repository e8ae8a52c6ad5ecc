"""The materials that a configuration may name by their ``kind``."""

from __future__ import annotations

from typing import Annotated

from pydantic import Tag

from porocore.kinds import by_kind
from porocore.materials.expression import ExpressionMaterial
from porocore.materials.holzapfel import HolzapfelGasserOgden
from porocore.materials.material import Material
from porocore.materials.mooney_rivlin import MooneyRivlin
from porocore.materials.neo_hookean import NeoHookean
from porocore.materials.ogden import Ogden

DEFAULT = "neo-hookean"


AnyMaterial = Annotated[
    Annotated[NeoHookean, Tag(DEFAULT)]
    | Annotated[MooneyRivlin, Tag("mooney-rivlin")]
    | Annotated[Ogden, Tag("ogden")]
    | Annotated[HolzapfelGasserOgden, Tag("holzapfel-gasser-ogden")]
    | Annotated[ExpressionMaterial, Tag("expression")],
    by_kind(Material, DEFAULT),
]

"""The materials that a configuration may name by their ``kind``."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Tag

from porocore.materials.expression import ExpressionMaterial
from porocore.materials.holzapfel import HolzapfelGasserOgden
from porocore.materials.material import Material
from porocore.materials.mooney_rivlin import MooneyRivlin
from porocore.materials.neo_hookean import NeoHookean
from porocore.materials.ogden import Ogden

DEFAULT = "neo-hookean"


def _kind(value: Any) -> Any:
    """Of a mapping or of a material; neo-Hookean where none is given."""
    if isinstance(value, Material):
        return getattr(value, "kind", None)
    return value.get("kind", DEFAULT) if isinstance(value, dict) else DEFAULT


AnyMaterial = Annotated[
    Annotated[NeoHookean, Tag(DEFAULT)]
    | Annotated[MooneyRivlin, Tag("mooney-rivlin")]
    | Annotated[Ogden, Tag("ogden")]
    | Annotated[HolzapfelGasserOgden, Tag("holzapfel-gasser-ogden")]
    | Annotated[ExpressionMaterial, Tag("expression")],
    Discriminator(_kind),
]

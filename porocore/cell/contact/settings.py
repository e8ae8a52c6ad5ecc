"""Keys of self-contact in the configuration with their defaults: ``kind``, stiffness of the penalty."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from porocore.core.models.strict import StrictModel
from porocore.core.units import Unit


class ContactSettings(StrictModel):
    """Frictionless self-contact of the pore wall by a penalty."""

    kind: Literal["frictionless", "none"] = "frictionless"
    """``frictionless``: the pore wall is held against itself; ``none``: a state whose wall has passed through itself
    has the status ``overlap``, and no values."""
    stiffness: Annotated[float, Field(gt=0, allow_inf_nan=False), Unit("E/h")] = 15.0
    """ε of the contact's energy ε/2 ⟨−gap⟩² per area, with the mean edge h of the wall's facets; E is Young's modulus
    at the wall for small strains."""

"""How the pore wall meets itself, as it stands in the configuration."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field


class ContactSettings(BaseModel):
    """Frictionless self-contact of the pore wall by a penalty."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["frictionless", "none"] = "frictionless"
    """none: a state whose wall has passed through itself has the status overlap, and no values."""
    stiffness: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 15.0
    """Of the penalty, in units of E/h with the mean edge h of the wall's facets; energy is ε/2 ⟨−gap⟩² per area."""

"""The settings of the network and of its training, and how a wrong one is refused."""

from __future__ import annotations

import difflib
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, Strict, ValidationError

from porocore import ConfigurationError

Count = Annotated[int, Strict(), Field(ge=1)]
Rate = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]
Share = Annotated[float, Field(gt=0, le=0.5, allow_inf_nan=False)]


class MlpOptions(BaseModel):
    """Options of :class:`~porocore_surrogate_torch.mlp.MlpSurrogate`; the descriptions are used in messages."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    hidden: tuple[Count, ...] = Field(
        (40, 40, 40),
        min_length=1,
        description="a list of layer widths, whole numbers ≥ 1, such as [40, 40, 40]",
    )
    activation: Literal["sigmoid", "tanh"] = Field("sigmoid", description="'sigmoid' or 'tanh'")
    epochs: Count = Field(15000, description="a whole number ≥ 1")
    learning_rate: Rate = Field(1e-2, description="a number above 0 and at most 1")
    validation_fraction: Share = Field(0.15, description="a number above 0 and at most 0.5")
    patience: Count = Field(4000, description="a whole number of epochs ≥ 1")

    @classmethod
    def parse(cls, options: dict[str, Any]) -> MlpOptions:
        """Validate options as they stand in the configuration.

        Raises
        ------
        ConfigurationError
            An unknown option or a value that cannot be used; all of them, one line each.
        """
        try:
            return cls.model_validate(options)
        except ValidationError as error:
            keys = dict.fromkeys(str(detail["loc"][0]) for detail in error.errors())
            raise ConfigurationError("\n".join(_complaint(key, options[key]) for key in keys)) from None


def _complaint(key: str, value: Any) -> str:
    fields = MlpOptions.model_fields
    if key in fields:
        return f"surrogate.options.{key}: expected {fields[key].description}, got {value!r}"
    near = difflib.get_close_matches(key, fields, n=1)
    advice = f"did you mean '{near[0]}'?" if near else f"the options are {', '.join(fields)}"
    return f"surrogate.options.{key}: the torch surrogate has no such option; {advice}"

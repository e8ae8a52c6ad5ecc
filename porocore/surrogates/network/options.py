"""Options of the network models and their training, the same in every library."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, Strict, ValidationError

from porocore.core.echo import choices, did_you_mean, echo
from porocore.core.models.strict import StrictModel
from porocore.errors import ConfigurationError

#: Hidden layers, units of one, and steps of training: larger networks than the data of any cell need.
MOST_LAYERS, MOST_WIDTH, MOST_EPOCHS = 20, 1024, 10_000_000
Width = Annotated[int, Strict(), Field(ge=1, le=MOST_WIDTH)]
Count = Annotated[int, Strict(), Field(ge=1, le=MOST_EPOCHS)]
Rate = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]
Share = Annotated[float, Field(gt=0, le=0.5, allow_inf_nan=False)]
Device = Literal["auto", "cpu", "cuda"]


class NetworkOptions(StrictModel):
    """Options of both models. A field's description goes into messages, its docstring into the documentation."""

    device: Device = Field("cpu", description="'auto', 'cpu' or 'cuda'")
    """Where networks are trained and evaluated; ``auto`` is a GPU where there is one."""

    @classmethod
    def parse(cls, options: dict[str, Any], backend: str) -> Self:
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
            complaints = [cls._complaint(key, options[key], backend) for key in keys]
            raise ConfigurationError("\n".join(complaints)) from None

    @classmethod
    def _complaint(cls, key: str, value: Any, backend: str) -> str:
        fields = cls.model_fields
        if key in fields:
            return f"surrogate.options.{key}: expected {fields[key].description}, got {echo(value)}"
        advice = did_you_mean(key, fields) or choices(fields, "the options are", "it has none")
        return f"surrogate.options.{key}: the {backend} surrogate has no such option for this model; {advice}"


def _hidden(*widths: int) -> Any:
    """Return the field of the hidden layers with its default."""
    expected = f"a list of at most {MOST_LAYERS} layer widths, whole numbers from 1 to {MOST_WIDTH}"
    description = f"{expected}, such as {list(widths)}"
    return Field(widths, min_length=1, max_length=MOST_LAYERS, description=description)


class MlpOptions(NetworkOptions):
    """Options of the model ``mlp``: the paper's network, trained by Adam on <∇u¹>_s."""

    hidden: tuple[Width, ...] = _hidden(40, 40, 40)
    """Widths of the hidden layers."""
    activation: Literal["sigmoid", "tanh"] = Field("sigmoid", description="'sigmoid' or 'tanh'")
    """Activation of the hidden layers."""
    epochs: Count = Field(15000, description="a whole number from 1 to 10000000")
    """Full-batch steps of Adam at most."""
    learning_rate: Rate = Field(1e-2, description="a number above 0 and at most 1")
    """Learning rate at the start; it falls to a hundredth along half a cosine."""
    validation_fraction: Share = Field(0.15, description="a number above 0 and at most 0.5")
    """Share of the states that chooses the best weights on the way."""
    patience: Count = Field(4000, description="a whole number of epochs from 1 to 10000000")
    """Epochs without a smaller validation loss after which training ends."""


class PotentialOptions(NetworkOptions):
    """Options of the model ``potential``: W(ln U, p), trained by L-BFGS on W and its first derivatives."""

    hidden: tuple[Width, ...] = _hidden(12, 12)
    """Widths of the hidden layers."""
    activation: Literal["softplus", "tanh", "sigmoid"] = Field(
        "softplus", description="'softplus', 'tanh' or 'sigmoid'"
    )
    """Activation of the hidden layers."""
    iterations: Count = Field(1500, description="a whole number from 1 to 10000000")
    """Steps of L-BFGS at most."""
    symmetry: Literal["auto", "none", "cubic"] = Field(
        "auto", description="'auto' (that of the cell), 'none' or 'cubic'"
    )
    """Symmetry of the network: ``auto`` gives it that of the cell exactly, ``none`` lets it see the variables as they
    are; ``cubic`` refuses cells that are not."""
    anchor: Literal["polynomial", "none"] = Field("polynomial", description="'polynomial' or 'none'")
    """``polynomial``: the network learns what a polynomial of degree 4 leaves over, which is also what is continued
    beyond the sampled states."""
    derivatives: Annotated[bool, Strict()] = Field(True, description="true or false")
    """Whether stress and fluid volume are learned beside W."""

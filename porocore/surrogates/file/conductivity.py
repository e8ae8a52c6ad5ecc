"""Model of the conductivity and sampled range in the file of a surrogate."""

from __future__ import annotations

from typing import Any

import numpy as np

from porocore.core.inputs.input_space import InputSpace
from porocore.core.inputs.sampled_range import SampledRange
from porocore.states import Array
from porocore.surrogates.conductivity.model import ConductivityModel, triangle
from porocore.surrogates.file import estimates
from porocore.surrogates.polynomial.arrays import pack_polynomial, unpack_polynomial
from porocore.surrogates.polynomial.terms import VARIABLES
from porocore.surrogates.training_box import TrainingBox


def unpack_range(arrays: dict[str, Array], name: str, inputs: InputSpace) -> SampledRange:
    """Return the sampled range that a file holds under a name.

    Raises
    ------
    KeyError, ValueError
        Something is missing, or does not fit together.
    """
    normals, offsets = arrays[f"{name}/normals"], arrays[f"{name}/offsets"]
    if offsets.ndim != 1 or not len(offsets) or normals.shape != (len(offsets), len(inputs)):
        raise ValueError(f"{name} has normals of shape {normals.shape} and offsets of shape {offsets.shape}")
    if (np.abs(normals).max(axis=1) == 0).any():
        raise ValueError(f"{name}/normals has one of length zero")
    return SampledRange(inputs, normals, offsets)


def pack_conductivity(model: ConductivityModel, header: dict[str, Any], arrays: dict[str, Array]) -> None:
    """Add a model of the conductivity to the header and the arrays of a file."""
    header["conductivity"] = {"active": model.active, "closing": model.closing}
    pack_polynomial(model.polynomial, "conductivity/polynomial", arrays)
    arrays |= {
        "conductivity/basis": model.basis,
        "conductivity/log_rest": model.log_rest,
        "conductivity/reach/low": model.training_box.low,
        "conductivity/reach/high": model.training_box.high,
        "conductivity/range/normals": model.sampled.normals,
        "conductivity/range/offsets": model.sampled.offsets,
    }
    if model.estimate is not None:
        estimates.pack(model.estimate, header["conductivity"], arrays, "conductivity/estimate")


def unpack_conductivity(
    header: dict[str, Any], arrays: dict[str, Array], inputs: InputSpace
) -> ConductivityModel:
    """Return the model of the conductivity of a file.

    Raises
    ------
    KeyError, TypeError, ValueError
        Something is missing, or does not fit together.
    """
    said = header["conductivity"]
    active = tuple(int(a) for a in said["active"])
    if any(a not in range(VARIABLES) for a in active):
        raise ValueError(f"active variables {active}")
    basis, log_rest = arrays["conductivity/basis"], arrays["conductivity/log_rest"]
    r = len(log_rest)
    if r not in (1, 2, 3) or log_rest.shape != (r, r) or basis.shape != (3, r):
        raise ValueError(f"a conductivity of the shapes {basis.shape} and {log_rest.shape}")
    sampled = unpack_range(arrays, "conductivity/range", inputs)
    v, outputs, estimate = len(active), len(triangle(3)), None
    if "estimate" in said:
        estimate = estimates.unpack_values(said, arrays, "conductivity/estimate", v, outputs)
    return ConductivityModel(
        basis,
        log_rest,
        unpack_polynomial(arrays, "conductivity/polynomial", v, outputs),
        active,
        TrainingBox(active, *(arrays[f"conductivity/reach/{end}"].reshape(v) for end in ("low", "high"))),
        sampled,
        estimate,
        bool(said["closing"]),
    )

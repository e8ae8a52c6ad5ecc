"""Conductivity model in the file of a surrogate: packed and unpacked."""

from __future__ import annotations

from typing import Any

from porocore.core.inputs import InputSpace
from porocore.states import Array
from porocore.surrogates.conductivity import ConductivityModel, triangle
from porocore.surrogates.file import estimates, parts


def pack_conductivity(model: ConductivityModel, header: dict[str, Any], arrays: dict[str, Array]) -> None:
    """Add a model of the conductivity to the header and the arrays of a file."""
    header["conductivity"] = {"active": model.active, "closing": model.closing}
    parts.pack_polynomial(model.polynomial, "conductivity/polynomial", arrays)
    arrays |= {
        "conductivity/basis": model.basis,
        "conductivity/log_rest": model.log_rest,
    }
    parts.pack_box(model.training_box, arrays, "conductivity/")
    parts.pack_range(model.sampled, arrays, "conductivity/")
    if model.estimate is not None:
        estimates.pack(model.estimate, header["conductivity"], arrays, "conductivity/estimate")


def unpack_conductivity(
    header: dict[str, Any], arrays: dict[str, Array], inputs: InputSpace
) -> ConductivityModel:
    """Return the model of the conductivity of a file."""
    said = header["conductivity"]
    box = parts.unpack_box(said, arrays, "conductivity/")
    basis, log_rest = arrays["conductivity/basis"], arrays["conductivity/log_rest"]
    r = len(log_rest)
    if r not in (1, 2, 3) or log_rest.shape != (r, r) or basis.shape != (3, r):
        raise ValueError(f"a conductivity of the shapes {basis.shape} and {log_rest.shape}")
    v, outputs, estimate = len(box.active), len(triangle(3)), None
    if "estimate" in said:
        estimate = estimates.unpack_values(said, arrays, "conductivity/estimate", v, outputs)
    return ConductivityModel(
        basis,
        log_rest,
        parts.unpack_polynomial(arrays, "conductivity/polynomial", v, outputs),
        box.active,
        box,
        parts.unpack_range(arrays, inputs, "conductivity/"),
        estimate,
        bool(said["closing"]),
    )

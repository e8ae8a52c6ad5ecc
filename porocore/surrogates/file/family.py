"""Model of a family in the file of a surrogate: packed and unpacked."""

from __future__ import annotations

from typing import Any

import numpy as np

from porocore.core.inputs import InputSpace, SampledRange
from porocore.core.tensors import PointGroup
from porocore.interfaces.records import KINDS
from porocore.states import Array
from porocore.surrogates.family.conductivity import FamilyConductivity
from porocore.surrogates.family.coordinates import ParameterMap
from porocore.surrogates.family.joint import JointPolynomial
from porocore.surrogates.family.model import FamilyModel
from porocore.surrogates.family.rest import RestModel
from porocore.surrogates.file import parts
from porocore.surrogates.network.separable import SeparableNetwork

#: Polynomials of θ̂ of the undeformed members, and their numbers of outputs.
REST = {"porosity": 1, "stiffness": 36, "affine": 8, "coupling": 7, "mean": 72}


def pack_family(model: FamilyModel, header: dict[str, Any], arrays: dict[str, Array]) -> None:
    """Add a model of a family to the header and the arrays of a file."""
    rest, parameters = model.rest, model.rest.parameters
    header |= {
        "active": model.active,
        "symmetry": rest.symmetry.rotations,
        "kinds": parameters.kinds,
        "young": parameters.young,
        "poisson": parameters.poisson,
        "stretch": parameters.stretch,
        "level": rest.level,
        "terms": None,
        "polynomials": [],
    }
    arrays |= {"rest/centre": rest.centre, "rest/half": rest.half, "rest/basis": rest.basis}
    for name in (*REST, "conductivity"):
        parts.pack_polynomial(getattr(rest, name), f"rest/{name}", arrays)
    parts.pack_polynomial(model.mean_grad, "mean_grad", arrays)
    parts.pack_box(model.training_box, arrays)
    for name, part in (("coarse", model.coarse), ("fine", model.fine)):
        if part is not None:
            header["terms"] = part.terms.name
            header["polynomials"].append(name)
            parts.pack_terms(part.terms, "terms", arrays)
            parts.pack_polynomial(part.polynomial, name, arrays)
    if model.network is not None:
        network, factors = model.network.network.as_numpy, model.network.factors
        header["network"] = {"terms": model.network.terms.name, "outputs": len(network.biases[-1])}
        header["factors"] = {}
        parts.pack_terms(model.network.terms, "network/terms", arrays)
        parts.pack_network(network, header["network"], arrays)
        parts.pack_network(factors, header["factors"], arrays, "factors")


def unpack_family(header: dict[str, Any], arrays: dict[str, Array], sampled: SampledRange) -> FamilyModel:
    """Return the model of a family that a file holds."""
    rest = _unpack_rest(header, arrays, sampled.inputs)
    box, l = parts.unpack_box(header, arrays), len(rest.centre)
    found: dict[str, JointPolynomial | None] = {"coarse": None, "fine": None}
    if header["polynomials"]:
        terms = parts.unpack_terms(header["terms"], "terms", arrays)
        for name in header["polynomials"]:
            if name not in found:
                raise ValueError(f"a polynomial {name!r}")
            inner = parts.unpack_polynomial(arrays, name, len(terms.weights) + l, 1)
            found[name] = JointPolynomial(terms, inner)
    mean_grad = parts.unpack_polynomial(arrays, "mean_grad", len(box.active) + l, 9)
    network = _unpack_network(header, arrays, l) if "network" in header else None
    return FamilyModel(
        rest, found["coarse"], found["fine"], mean_grad, box.active, sampled, box, network=network
    )


def _unpack_network(header: dict[str, Any], arrays: dict[str, Array], l: int) -> SeparableNetwork:
    said = header["network"]
    terms, outputs = parts.unpack_terms(said["terms"], "network/terms", arrays), int(said["outputs"])
    network = parts.unpack_network(said, arrays, len(terms.weights), outputs)
    factors = parts.unpack_network(header["factors"], arrays, l, outputs, "factors")
    return SeparableNetwork(network, factors, terms)


def _unpack_rest(header: dict[str, Any], arrays: dict[str, Array], inputs: InputSpace) -> RestModel:
    kinds = tuple(header["kinds"])
    if len(kinds) != len(inputs.parameters) or any(kind not in KINDS for kind in kinds):
        raise ValueError(f"the kinds of parameters {kinds}")
    young, poisson = (_solid(header[name], inputs) for name in ("young", "poisson"))
    parameters = ParameterMap(inputs, kinds, young, poisson, float(header.get("stretch", 1.0)))
    l = len(parameters.learned)
    basis = arrays["rest/basis"]
    if basis.ndim != 2 or len(basis) != 3 or basis.shape[1] > 3:
        raise ValueError(f"conducting directions of shape {basis.shape}")
    outputs = REST | {"conductivity": basis.shape[1] ** 2}
    polynomials = {
        name: parts.unpack_polynomial(arrays, f"rest/{name}", l, count) for name, count in outputs.items()
    }
    level, half = float(header["level"]), arrays["rest/half"].reshape(l)
    if not (level > 0 and parameters.stretch > 0 and (half > 0).all()):
        raise ValueError("scales that are not positive")
    return RestModel(
        parameters,
        PointGroup.generated([np.reshape(Q, (3, 3)) for Q in header["symmetry"]]),
        arrays["rest/centre"].reshape(l),
        half,
        level=level,
        basis=basis,
        **polynomials,
    )


def _solid(said: Any, inputs: InputSpace) -> float | str | None:
    """Return a modulus or Poisson's ratio of the solid: a number, the name of a parameter, or None."""
    if said is None or (isinstance(said, str) and said in inputs.parameters):
        return said
    if isinstance(said, str):
        raise ValueError(f"a solid whose number is the unknown parameter {said!r}")
    return float(said)


def pack_family_conductivity(
    model: FamilyConductivity, header: dict[str, Any], arrays: dict[str, Array]
) -> None:
    """Add a model of the conductivity of a family to the header and the arrays of a file."""
    header["conductivity"] = {"active": model.active, "closing": model.closing}
    parts.pack_polynomial(model.polynomial, "conductivity/polynomial", arrays)
    parts.pack_box(model.training_box, arrays, "conductivity/")
    parts.pack_range(model.sampled, arrays, "conductivity/")


def unpack_family_conductivity(
    header: dict[str, Any], arrays: dict[str, Array], model: FamilyModel
) -> FamilyConductivity:
    """Return the model of the conductivity that a file holds for its family."""
    said = header["conductivity"]
    box = parts.unpack_box(said, arrays, "conductivity/")
    l = len(model.rest.centre)
    return FamilyConductivity(
        model.rest,
        parts.unpack_polynomial(arrays, "conductivity/polynomial", len(box.active) + l, 6),
        box.active,
        box,
        parts.unpack_range(arrays, model.sampled.inputs, "conductivity/"),
        bool(said["closing"]),
    )

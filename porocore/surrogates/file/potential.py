"""Models of a potential and of a conductivity in the file of a surrogate: packed and unpacked.

A cell without parameters has numbers of its undeformed state, a family polynomials of θ̂; all else is alike.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from porocore.core.inputs import InputSpace, SampledRange
from porocore.core.tensors import TRIVIAL, PointGroup
from porocore.interfaces.records import KINDS
from porocore.states import Array
from porocore.surrogates.conductivity import ConductivityModel, triangle
from porocore.surrogates.family.coordinates import ParameterMap
from porocore.surrogates.family.joint import JointPolynomial
from porocore.surrogates.family.rest import RestModel
from porocore.surrogates.file import estimates, parts
from porocore.surrogates.mean_gradient import AnchoredModel
from porocore.surrogates.model import PotentialModel
from porocore.surrogates.network.separable import SeparableNetwork
from porocore.surrogates.rest import NUMBERS, Rest, SingleRest

#: Polynomials of θ̂ of the undeformed members, and their numbers of outputs.
MEMBERS = {"porosity": 1, "stiffness": 36, "affine": 8, "coupling": 7, "mean": 72}


def pack_potential(model: PotentialModel, header: dict[str, Any], arrays: dict[str, Array]) -> None:
    """Add a model of a potential to the header and the arrays of a file."""
    header |= {
        "active": model.active,
        "symmetry": model.rest.symmetry.rotations,
        "terms": None,
        "polynomials": [],
    }
    _pack_rest(model.rest, header, arrays)
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
        parts.pack_terms(model.network.terms, "network/terms", arrays)
        parts.pack_network(network, header["network"], arrays)
        if factors is not None:
            header["factors"] = {}
            parts.pack_network(factors, header["factors"], arrays, "factors")


def unpack_potential(
    header: dict[str, Any], arrays: dict[str, Array], sampled: SampledRange
) -> PotentialModel:
    """Return the model of a potential that a file holds."""
    symmetry = PointGroup.generated([np.reshape(Q, (3, 3)) for Q in header["symmetry"]])
    rest = (
        _unpack_members(header, arrays, sampled.inputs, symmetry)
        if sampled.inputs.parameters
        else _unpack_single(arrays, symmetry)
    )
    box, l = parts.unpack_box(header, arrays), rest.learned
    found: dict[str, JointPolynomial | None] = {"coarse": None, "fine": None}
    if header["polynomials"]:
        terms = parts.unpack_terms(header["terms"], "terms", arrays)
        for name in header["polynomials"]:
            if name not in found:
                raise ValueError(f"a polynomial {name!r}")
            inner = parts.unpack_polynomial(arrays, name, len(terms.weights) + l, 1)
            found[name] = JointPolynomial(terms, inner)
    mean_grad = parts.unpack_polynomial(arrays, "mean_grad", len(box.active) + l, 9)
    network = _unpack_network(header, arrays, rest) if "network" in header else None
    return PotentialModel(rest, found["coarse"], found["fine"], mean_grad, box.active, sampled, box, network)


def _unpack_network(header: dict[str, Any], arrays: dict[str, Array], rest: Rest) -> SeparableNetwork:
    said, factors = header["network"], None
    terms, outputs = parts.unpack_terms(said["terms"], "network/terms", arrays), int(said["outputs"])
    network = parts.unpack_network(said, arrays, len(terms.weights), outputs)
    if rest.parameters is not None:
        factors = parts.unpack_network(header["factors"], arrays, rest.learned, outputs, "factors")
    elif outputs != 1:
        raise ValueError(f"a network with {outputs} outputs for a cell without parameters")
    return SeparableNetwork(network, terms, factors)


def _pack_rest(rest: Rest, header: dict[str, Any], arrays: dict[str, Array]) -> None:
    arrays["rest/basis"] = rest.basis
    if isinstance(rest, RestModel):
        known = rest.parameters
        header |= {"kinds": known.kinds, "young": known.young, "poisson": known.poisson}
        header |= {"stretch": known.stretch, "level": rest.level}
        arrays |= {"rest/centre": rest.centre, "rest/half": rest.half}
        for name in (*MEMBERS, "conductivity"):
            parts.pack_polynomial(getattr(rest, name), f"rest/{name}", arrays)
        return
    values = rest.together(None)
    arrays["rest/log_conductivity"] = values.log_conductivity[0]
    arrays |= {f"rest/{name}": getattr(values, name)[..., 0] for name in NUMBERS}


def _unpack_single(arrays: dict[str, Array], symmetry: PointGroup) -> SingleRest:
    basis, log = arrays["rest/basis"], arrays["rest/log_conductivity"]
    r = len(log)
    if r > 3 or log.shape != (r, r) or basis.shape != (3, r):
        raise ValueError(f"a conductivity of the shapes {basis.shape} and {log.shape}")
    numbers = {name: arrays[f"rest/{name}"].reshape(shape) for name, shape in NUMBERS.items()}
    return SingleRest.from_numbers(symmetry, basis, log, **numbers)


def _unpack_members(
    header: dict[str, Any], arrays: dict[str, Array], inputs: InputSpace, symmetry: PointGroup
) -> RestModel:
    kinds = tuple(header["kinds"])
    if len(kinds) != len(inputs.parameters) or any(kind not in KINDS for kind in kinds):
        raise ValueError(f"the kinds of parameters {kinds}")
    young, poisson = (_solid(header[name], inputs) for name in ("young", "poisson"))
    parameters = ParameterMap(inputs, kinds, young, poisson, float(header.get("stretch", 1.0)))
    l = len(parameters.learned)
    basis = arrays["rest/basis"]
    if basis.ndim != 2 or len(basis) != 3 or basis.shape[1] > 3:
        raise ValueError(f"conducting directions of shape {basis.shape}")
    outputs = MEMBERS | {"conductivity": basis.shape[1] ** 2}
    polynomials = {
        name: parts.unpack_polynomial(arrays, f"rest/{name}", l, count) for name, count in outputs.items()
    }
    level, half = float(header["level"]), arrays["rest/half"].reshape(l)
    if not (level > 0 and parameters.stretch > 0 and (half > 0).all()):
        raise ValueError("scales that are not positive")
    return RestModel(
        parameters,
        symmetry,
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


def pack_conductivity(model: ConductivityModel, header: dict[str, Any], arrays: dict[str, Array]) -> None:
    """Add a model of the conductivity to the header and the arrays of a file."""
    header["conductivity"] = {"active": model.active, "closing": model.closing}
    # That of a potential is in the file, and then these are the same numbers.
    if isinstance(model.rest, SingleRest):
        _pack_rest(model.rest, header, arrays)
    parts.pack_polynomial(model.polynomial, "conductivity/polynomial", arrays)
    parts.pack_box(model.training_box, arrays, "conductivity/")
    parts.pack_range(model.sampled, arrays, "conductivity/")
    if model.estimate is not None:
        estimates.pack(model.estimate, header["conductivity"], arrays, "conductivity/estimate")


def unpack_conductivity(
    header: dict[str, Any], arrays: dict[str, Array], model: AnchoredModel | PotentialModel
) -> ConductivityModel:
    """Return the model of the conductivity of a file."""
    said = header["conductivity"]
    box = parts.unpack_box(said, arrays, "conductivity/")
    rest = model.rest if isinstance(model, PotentialModel) else _unpack_single(arrays, TRIVIAL)
    if not rest.basis.shape[1]:
        raise ValueError("a conductivity that conducts in no direction")
    variables, outputs, estimate = len(box.active) + rest.learned, len(triangle(3)), None
    if "estimate" in said:
        estimate = estimates.unpack_values(said, arrays, "conductivity/estimate", variables, outputs)
        estimate = replace(estimate, coordinates=rest.learned)
    return ConductivityModel(
        rest,
        parts.unpack_polynomial(arrays, "conductivity/polynomial", variables, outputs),
        box.active,
        box,
        parts.unpack_range(arrays, model.sampled.inputs, "conductivity/"),
        estimate,
        bool(said["closing"]),
    )

"""File of any surrogate: named arrays and a header with a checksum, written and read.

An archive (:mod:`porocore.surrogates.file.file`) whose header names the model, the inputs, the cell, who wrote it
and how good it was; the arrays are weights, scalings, polynomials and the sampled range. Reading executes nothing.

Layout: attributes ``format``, ``version``, ``checksum``; ``header``, a text in JSON; every array a dataset of
float64 under its name. The checksum is the SHA-256 of the header and of all names, shapes and numbers.
Reading executes nothing.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from porocore.core.files.plain_data import stable_hash
from porocore.core.files.reading import set_aside
from porocore.core.hdf5 import UNREADABLE, atomic_hdf5, damaged, opened
from porocore.core.inputs import InputSpace, SampledRange
from porocore.errors import DataError
from porocore.states import Array
from porocore.surrogates.conductivity import ConductivityModel
from porocore.surrogates.file import estimates, parts
from porocore.surrogates.file.potential import (
    pack_conductivity,
    pack_potential,
    unpack_conductivity,
    unpack_potential,
)
from porocore.surrogates.mean_gradient import AnchoredModel
from porocore.surrogates.model import PotentialModel
from porocore.surrogates.network.network import Evaluator, Network


def write_archive(
    path: Path, form: str, version: int, header: dict[str, Any], arrays: dict[str, Array]
) -> None:
    """Write one file, whole or not at all.

    Parameters
    ----------
    path
        Its folder is made if it does not exist.
    form, version
        Kind and version of the file.
    header
        Anything that JSON can hold; floats are kept to the last bit.
    arrays
        Float64 arrays by name; a ``/`` in a name makes a group.

    Raises
    ------
    RunFolderError
        The disk is full or read-only; ``path`` is as it was before.
    """
    text = json.dumps(header, ensure_ascii=False)
    with atomic_hdf5(path) as file:
        file.attrs.update(format=form, version=version, checksum=_checksum(text, arrays))
        file.create_dataset("header", data=text, dtype=h5py.string_dtype())
        for name, array in arrays.items():
            file[name] = array


def read_archive(path: Path, form: str, version: int, then: str) -> tuple[dict[str, Any], dict[str, Array]]:
    """Read what :func:`write_archive` wrote: the header and the arrays.

    Raises
    ------
    DataError
        There is no such file, or it is of another kind or version, truncated or edited; the message says
        what to do ``then``.
    """
    with opened(path, f"file of format {form}", then) as file:
        file.require_kind(form)
        found = file.attribute("format", str) if "format" in file.attributes else "another"
        if found != form:
            raise DataError(
                f"{path}: expected a file of format {form}, got {found[:40]}; move it elsewhere and {then}"
            )
        if (number := file.attribute("version", int)) != version:
            raise DataError(
                f"{path}: expected version {version} of {form}, got {number}; use the porocore that wrote it,"
                f" or move it elsewhere and {then}"
            )
        checksum, text = file.attribute("checksum", str), file.text("header")
        arrays = {name: file.array_of_any_shape(name) for name in file.arrays_below("") if name != "header"}
        if checksum != _checksum(text, arrays):
            raise DataError(
                f"{path}: its numbers do not match its checksum, so it was damaged or edited; {set_aside(path, then)}"
            )
        header = json.loads(text)
        if not isinstance(header, dict):
            raise ValueError(f"its header is a {type(header).__name__}")
    return header, arrays


def _checksum(text: str, arrays: dict[str, Array]) -> str:
    parts: list[str | bytes] = [text]
    for name, array in sorted(arrays.items()):
        parts += [f"\0{name}\0{array.shape}\0", np.asarray(array, dtype=np.float64).tobytes()]
    return stable_hash(*parts)


#: Until version 5 the symmetry of the cell was guessed, and stresses across the sampled components were dropped; until
#: version 6 a cell without parameters had a layout of its own.
FORMAT, VERSION = "porocore-surrogate", 7
AGAIN = "train the surrogate again"

#: Fields of the metadata that the header holds.
KINDS = {"backend": str, "options": dict, "identity": str, "provenance": dict, "accuracy": dict}

Model = AnchoredModel | PotentialModel
#: A network that evaluates as the caller likes, from the numbers of the file.
MakeEvaluator = Callable[[Network], Evaluator]


@dataclass(frozen=True)
class SurrogateMetadata:
    """Data of a surrogate's file besides the model.

    Attributes
    ----------
    backend
        Name of the surrogate that wrote it.
    options
        Options of the training.
    identity
        Hash of cell and material.
    provenance
        Versions and configuration.
    accuracy
        Named errors, each a share of the range of what was learned.
    conductivity
        Model of K_ref of the deformed pore; None where it was not learned.
    """

    backend: str
    options: dict[str, Any]
    identity: str
    provenance: dict[str, str] = field(default_factory=dict)
    accuracy: dict[str, float] = field(default_factory=dict)
    conductivity: ConductivityModel | None = None


def write(path: Path, model: Model, metadata: SurrogateMetadata) -> None:
    """Write one HDF5 file, whole or not at all.

    Raises
    ------
    RunFolderError
        The disk is full or read-only.
    """
    kinds: dict[type, tuple[str, Callable[..., None]]] = {
        AnchoredModel: ("mlp", _pack_anchored),
        PotentialModel: ("potential", pack_potential),
    }
    name, pack = kinds[type(model)]
    header: dict[str, Any] = {
        "model": name,
        **{name: getattr(metadata, name) for name in KINDS},
        "inputs": model.sampled.inputs.names,
    }
    arrays = {
        "inputs/lower": np.array(model.sampled.inputs.lower),
        "inputs/upper": np.array(model.sampled.inputs.upper),
    }
    if model.sampled.inputs.parameters:
        header["parameters"] = model.sampled.inputs.parameters
    if model.sampled.inputs.used:
        arrays["inputs/used"] = np.array(model.sampled.inputs.used)
    parts.pack_range(model.sampled, arrays)
    pack(model, header, arrays)
    if model.estimate is not None:
        estimates.pack(model.estimate, header, arrays)
    if metadata.conductivity is not None:
        pack_conductivity(metadata.conductivity, header, arrays)
    write_archive(path, FORMAT, VERSION, header, arrays)


def read(path: Path) -> tuple[Model, SurrogateMetadata]:
    """Read the file of :func:`write`; its network, if there is one, evaluates in numpy.

    Raises
    ------
    DataError
        The file is truncated, edited, foreign or of another version.
    """
    header, arrays = read_archive(path, FORMAT, VERSION, AGAIN)
    try:
        for name, array in arrays.items():
            if not np.isfinite(array).all():
                raise ValueError(f"{name} holds numbers that are not finite")
        low, high = (tuple(arrays[f"inputs/{end}"].tolist()) for end in ("lower", "upper"))
        used = tuple(map(tuple, arrays["inputs/used"].tolist())) if "inputs/used" in arrays else ()
        inputs = InputSpace(tuple(header["inputs"]), low, high, tuple(header.get("parameters", ())), used)
        sampled = parts.unpack_range(arrays, inputs)
        unpack: dict[str, Callable[..., Model]] = {
            "mlp": _unpack_anchored,
            "potential": unpack_potential,
        }
        model = unpack[header["model"]](header, arrays, sampled)
        if "estimate" in header:
            model = replace(model, estimate=estimates.unpack(header, arrays, model))
        metadata = _unpack_metadata(header, arrays, model)
    except UNREADABLE as error:
        raise damaged(path, "surrogate", error, AGAIN) from error
    return model, metadata


def _unpack_metadata(header: dict[str, Any], arrays: dict[str, Array], model: Model) -> SurrogateMetadata:
    for name, kind in KINDS.items():
        if not isinstance(header[name], kind):
            raise ValueError(f"its header says '{name}': {str(header[name])[:40]}")
    if not all(isinstance(text, str) for text in header["provenance"].values()):
        raise ValueError("its header has a provenance that is no text")
    if not all(isinstance(x, float | int) for x in header["accuracy"].values()):
        raise ValueError("its header has an accuracy that is no number")
    conductivity = unpack_conductivity(header, arrays, model) if "conductivity" in header else None
    return SurrogateMetadata(conductivity=conductivity, **{name: header[name] for name in KINDS})


def evaluated(model: Model, make_evaluator: MakeEvaluator) -> Model:
    """Return the model of a file with its network replaced by an evaluator."""
    if isinstance(model, AnchoredModel):
        return replace(model, network=make_evaluator(model.network.as_numpy))
    if model.network is None:
        return model
    network = make_evaluator(model.network.network.as_numpy)
    return replace(model, network=replace(model.network, network=network))


def _pack_anchored(model: AnchoredModel, header: dict[str, Any], arrays: dict[str, Array]) -> None:
    header["components"] = model.components
    arrays |= {
        "reference/M": model.linear[:, :9].reshape(3, 3, 3, 3),
        "reference/Q": model.linear[:, 9].reshape(3, 3),
        "network/output_scale": model.output_scale,
    }
    parts.pack_network(model.network.as_numpy, header, arrays)


def _unpack_anchored(
    header: dict[str, Any], arrays: dict[str, Array], sampled: SampledRange
) -> AnchoredModel:
    M, Q = arrays["reference/M"].reshape(9, 9), arrays["reference/Q"].reshape(9, 1)
    components = tuple(int(c) for c in header["components"])
    if any(c not in range(9) for c in components):
        raise ValueError(f"components {components}")
    return AnchoredModel(
        np.concatenate([M, Q], axis=1),
        components,
        arrays["network/output_scale"].reshape(len(components)),
        parts.unpack_network(header, arrays, len(sampled.inputs), len(components)),
        sampled,
    )

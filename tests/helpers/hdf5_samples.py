"""Small valid HDF5 files of every kind that is read back, and how each is read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from porocore.core.hdf5 import seal_of
from porocore.core.inputs import InputSpace, SampledRange
from porocore.core.parallel import Communicator
from porocore.interfaces.cell import CellField
from porocore.interfaces.law import LawMemory
from porocore.interfaces.records import SolvedState
from porocore.interfaces.solution import MacroSolution
from porocore.macro.integration.checkpoint import CheckpointFile, HistoryRecorder
from porocore.macro.integration.newton import Predictor
from porocore.macro.integration.stepping import ErrorControl, TimeState
from porocore.sampling.datasets.dataset import Block, Header, read_block, read_fields, write_block
from porocore.states import MacroState, Status
from porocore.surrogates.file import file as surrogate_file
from porocore.surrogates.mean_gradient import AnchoredModel
from porocore.surrogates.network.network import Network
from tests.helpers.fake_cell import response
from tests.helpers.made_up_column import REMEMBERED, make_column, with_memory

INPUTS = InputSpace(("p", "H22"), (-0.1, -0.4), (0.2, 0.1))
UNKNOWNS, POINTS = 7, 2
NUMBERS = sum(each.size for each in REMEMBERED)


def write_dataset(path: Path) -> None:
    random = np.random.default_rng(0)
    rows, kept = [], []
    for i, status in enumerate((Status.converged, Status.overlap, Status.unstable)):
        x = (0.05 * i, -0.1 * i)
        value = random.standard_normal((3, 3)) if status.has_values else np.full((3, 3), np.nan)
        record = SolvedState(
            f"state {i}", x, INPUTS.scatter(x), response(value, value[0, 0], status), 0.5, None
        )
        rows.append((Block.from_record(path, record), 0))
        kept.append(
            CellField(np.zeros((3, 3)), x[0], "eighth", random.standard_normal((4, 3))) if i else None
        )
    write_block(path, Header(INPUTS, "cell", {"numpy": "2"}), Block.join(path, rows, INPUTS), kept)


def read_dataset(path: Path) -> Any:
    header, block = read_block(path, "make it again")
    rows = [(block, row) for row in range(len(block.keys))]
    return header, block.keys, block.starts, block.x, block.states, block.response, list(read_fields(rows))


def write_surrogate(path: Path) -> None:
    random = np.random.default_rng(1)
    network = Network(
        "tanh", (random.normal(size=(4, 2)), random.normal(size=(3, 4))), (random.normal(size=4), np.zeros(3))
    )
    model = AnchoredModel(
        random.normal(size=(9, 10)),
        (0, 4, 8),
        np.array([0.1, 1 / 3, 0.7]),
        network,
        SampledRange.around(INPUTS, random.random((9, 2))),
    )
    metadata = surrogate_file.SurrogateMetadata("torch", {"hidden": [4]}, "cell", {}, {"stress": 0.1})
    surrogate_file.write(path, model, metadata)


def write_solution(path: Path) -> None:
    with_memory(make_column(elements=(1, 1, 1), times=(1.0,), end=2.0)).save(path)


def _discretisation() -> Any:
    """As much of one as a checkpoint asks for."""
    mesh = SimpleNamespace(
        size=UNKNOWNS, weights=np.ones((1, POINTS)), element=None, n_u=6, points=np.zeros((2, 3))
    )
    return SimpleNamespace(
        communicator=Communicator(), mesh=mesh, problem=SimpleNamespace(probes={}, specification=dict),
        unknowns=np.arange(UNKNOWNS), boundary=SimpleNamespace(supports={}, drains={}, contacts=()), n_points=POINTS,
        is_force=np.ones(UNKNOWNS, bool), owned=UNKNOWNS, gathered=np.copy, origin=None,
        contact_states=lambda x, loads: (), points_to_mesh=np.copy, points_from_mesh=np.copy,
    )  # fmt: skip


def _at_rest(n: int) -> LawMemory:
    return LawMemory(MacroState.zeros(n), np.zeros(n), np.ones((n, NUMBERS)))


def _response(memory: LawMemory) -> Any:
    return SimpleNamespace(memory=memory, mean_grad=np.zeros((POINTS, 3, 3)))


#: A law whose answers do not change.
LAW: Any = SimpleNamespace(
    name="fake",
    identity="made-up",
    initial=_at_rest,
    initial_at=lambda points: _at_rest(len(points)),
    respond=lambda s, g, memory, step, tangent: _response(memory),
    internal=REMEMBERED,
    memory_size=NUMBERS,
)


def _stepper() -> Any:
    return SimpleNamespace(time=0.5, halvings=1, streak=0, proposed=np.inf, done=True)


def write_checkpoint(path: Path) -> None:
    d, column = _discretisation(), with_memory(make_column(elements=(1, 1, 1), times=(), end=1.0))
    steps = HistoryRecorder(d, REMEMBERED)
    steps.rows, steps.profiles = [(0.5,) * len(steps.columns)] * 2, list(column.profiles)
    control = ErrorControl(_discretisation())
    control.rate, control.length = TimeState(np.ones(UNKNOWNS), np.ones((POINTS, NUMBERS))), 0.1
    control.scales = (1.0, 2.0)
    predictor = Predictor([0.2, 0.5], [np.zeros(UNKNOWNS), np.arange(7.0)])
    CheckpointFile(path, d, LAW, 0.0).save_if_due(
        _stepper(), control, predictor, np.arange(7.0), _response(_at_rest(POINTS)), steps
    )


def read_checkpoint(path: Path) -> Any:
    stepper, control, predictor = _stepper(), ErrorControl(_discretisation()), Predictor()
    found = CheckpointFile(path, _discretisation(), LAW, 0.0).load(stepper, control, predictor)
    assert found is not None
    x, memory, steps = found
    return (
        vars(stepper),
        control.rate,
        control.length,
        control.scales,
        predictor,
        x,
        memory,
        steps.rows,
        steps.profiles,
    )


#: Name to a writer and a reader.
KINDS: dict[str, tuple[Callable[[Path], None], Callable[[Path], Any]]] = {
    "data set": (write_dataset, read_dataset),
    "surrogate": (write_surrogate, surrogate_file.read),
    "solution": (write_solution, MacroSolution.load_file),
    "checkpoint": (write_checkpoint, read_checkpoint),
}


def unsealed(content: bytes) -> bytes:
    """Return a file of ours without its seal."""
    return content[: -len(seal_of(b""))]


def flat(content: Any, where: str = "") -> dict[str, Any]:
    """Return every number, text and array of what was read, by where it is."""
    if is_dataclass(content):
        content = {f.name: getattr(content, f.name) for f in fields(content)}
    if isinstance(content, (list, tuple)):
        content = dict(enumerate(content))
    if isinstance(content, dict):
        found = {f"{where}/": sorted(map(str, content))}
        for name, value in content.items():
            found |= flat(value, f"{where}/{name}")
        return found
    return {where: content}


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Return whether two flat contents are equal to the bit."""
    return one.keys() == other.keys() and all(_bits(one[name]) == _bits(other[name]) for name in one)


def _bits(value: Any) -> Any:
    if isinstance(value, (float, np.ndarray, np.generic)):
        array = np.asarray(value)
        return array.dtype.str, array.shape, array.tobytes()
    return value

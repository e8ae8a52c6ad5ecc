"""A sampling that explores, killed anywhere and resumed: the same data set to the last bit, hardly any work twice."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from porocore.interfaces.cell import CellField, CellSolution, CellSolver
from porocore.interfaces.sampler import Exploration, Sampler, StudyFacts
from porocore.interfaces.surrogate import TrainingSet
from porocore.sampling.campaign import is_complete, run_campaign
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.samplers.active import Active
from porocore.sampling.samplers.macro_driven import MacroDriven
from porocore.states import MacroState
from porocore.study.run import folder as decisions
from porocore.study.run.folder import DecisionRecord
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate, judge
from porocore.testing.synthetic import cell as synthetic_cell

INPUTS = synthetic_cell.INPUTS
RESPONSES = ("mean_grad", "stress", "fluid_volume")


class Cells(CellSolver[None]):
    """The synthetic cell."""

    def prepare(self, cell: Any) -> None:
        return None

    def conductivity(self, prepared: None) -> np.ndarray:
        return np.eye(3)

    def solve(
        self,
        prepared: None,
        states: MacroState,
        *,
        start: Sequence[CellField | None] | None = None,
        tangent: bool = True,
        fields: bool = False,
    ) -> CellSolution:
        return CellSolution(synthetic_cell.respond(states), [None] * len(states))


def make() -> tuple[CellSolver[None], None]:
    return Cells(), None


class Study:
    """What a sampler explores with, and how often it does."""

    def __init__(self, folder: Path, owner: str = "this run") -> None:
        self.folder, self.explored, self.judged = folder, 0, 0
        rest = synthetic_cell.respond(MacroState.zeros(1))
        record = DecisionRecord(folder / "decisions.json", owner)
        self.facts = StudyFacts(rest, "made up", RESPONSES, self.explore, self.judge, remember=record)

    def explore(self, data: TrainingSet, *, elements: int, steps: int) -> Exploration:
        """A path to where the stress of a fitted polynomial meets a load."""
        self.explored += 1
        H = np.zeros((200, 3, 3))
        H[:, 1, 1] = np.linspace(0, -0.2, 200)
        p = 0.1 * np.sin(np.linspace(0, np.pi, 200))
        stress = PolynomialSurrogate().fit(data, seed=0).predict(MacroState(H, p), tangent=False).stress
        assert stress is not None
        end = int(np.argmax(stress[:, 1, 1] < -0.12))
        return Exploration(MacroState(H[: end + 1], p[: end + 1]), (float(H[end, 1, 1]), float("nan")))

    def judge(self, *words: Any) -> Any:
        self.judged += 1
        return judge(*words)

    @property
    def work(self) -> int:
        return self.explored + self.judged

    @property
    def dataset(self) -> Dataset:
        return Dataset.create_or_open(self.folder / "data.h5", inputs=INPUTS, identity="made up")

    def sampler(self, kind: type[Active | MacroDriven]) -> Sampler:
        found = kind(INPUTS, count=18, initial=8, batch=3)
        found.inform(self.facts)
        return found

    def sample(self, kind: type[Active | MacroDriven]) -> Dataset:
        dataset = self.dataset
        with CellPool(make) as pool:
            run_campaign(self.sampler(kind), pool, dataset)
        return dataset


class Killed(BaseException):
    """What no program catches."""


@pytest.fixture
def killed_at(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], list[int]]:
    """From now on the process dies before or after something enters a file, when that has happened so many times."""

    def arm(last: int) -> list[int]:
        count = [0]

        def passed() -> None:
            count[0] += 1
            if count[0] == last:
                raise Killed

        def around(write: Callable[..., Any]) -> Callable[..., Any]:
            def watched(*words: Any, **named: Any) -> None:
                passed()
                write(*words, **named)
                passed()

            return watched

        monkeypatch.undo()
        monkeypatch.setattr(Dataset, "append", around(Dataset.append))
        monkeypatch.setattr(decisions, "write_json", around(decisions.write_json))
        return count

    return arm


@pytest.mark.parametrize("kind", [MacroDriven, Active])
def test_killed_anywhere_and_resumed(
    tmp_path: Path, kind: type[Active | MacroDriven], killed_at: Callable[[int], list[int]]
) -> None:
    count = killed_at(-1)
    undisturbed = Study(tmp_path / "undisturbed")
    expected = undisturbed.sample(kind).digest()
    assert undisturbed.work >= 4
    moments = range(1, count[0] + 1)
    assert len(moments) > 40
    for moment in moments[:: 5 if kind is MacroDriven else 9]:
        first, again = Study(tmp_path / f"{moment}"), Study(tmp_path / f"{moment}")
        killed_at(moment)
        with pytest.raises(Killed):
            first.sample(kind)
        killed_at(-1)
        assert again.sample(kind).digest() == expected
        # Only what was being decided when it was killed is decided again.
        assert first.work + again.work - undisturbed.work in (0, 1, 2)


@pytest.fixture
def finished(tmp_path: Path) -> tuple[Path, str]:
    return tmp_path, Study(tmp_path).sample(MacroDriven).digest()


def test_a_finished_sampling_explores_nothing(finished: tuple[Path, str]) -> None:
    folder, digest = finished
    again = Study(folder)
    assert again.sample(MacroDriven).digest() == digest
    assert is_complete(again.sampler(MacroDriven), again.dataset)
    assert again.work == 0


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-40])


def _changed(path: Path) -> None:
    """Another round, and the old checksum."""
    document = json.loads(path.read_text())
    for decision in document["decisions"].values():
        decision["points"] = [[0.5, 0.5] for _ in decision["points"]]
    path.write_text(json.dumps(document))


def _of_another_kind(path: Path) -> None:
    path.write_text('["decisions"]')


def _binary(path: Path) -> None:
    path.write_bytes(bytes(range(256)))


def _of_a_later_version(path: Path) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | {"version": 99}))


@pytest.mark.parametrize(
    "damage", [Path.unlink, _cut, _changed, _of_another_kind, _binary, _of_a_later_version]
)
def test_a_damaged_record_is_made_again(finished: tuple[Path, str], damage: Callable[[Path], None]) -> None:
    folder, digest = finished
    record = folder / "decisions.json"
    whole = json.loads(record.read_text())
    damage(record)
    again = Study(folder)
    assert again.sample(MacroDriven).digest() == digest
    assert again.explored >= 2
    assert json.loads(record.read_text()) == whole


def test_the_record_of_another_run_is_not_used(finished: tuple[Path, str]) -> None:
    folder, digest = finished
    other = Study(folder, "another run")
    assert other.sample(MacroDriven).digest() == digest
    assert other.explored >= 2
    # And it has not driven out what is there.
    again = Study(folder)
    again.sample(MacroDriven)
    assert again.work == 0


def test_a_decision_on_other_responses_is_not_used(finished: tuple[Path, str]) -> None:
    """A state of the opening fails this time: what follows from it is chosen anew."""
    folder, _ = finished
    again = Study(folder)
    sampler, dataset = again.sampler(MacroDriven), again.dataset
    opening = sampler.ask()
    assert again.work == 0
    for request in opening:
        response = dataset.response(request.key)
        if request is opening[2]:
            response = synthetic_cell.respond(MacroState(np.full((1, 3, 3), 0.001), np.zeros(1)))
        sampler.tell(request.key, response)
    sampler.ask()
    assert again.explored == 1

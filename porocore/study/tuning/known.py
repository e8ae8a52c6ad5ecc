"""Store of trained candidates, so that another search does not train them again."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict

from porocore.core.console import duration
from porocore.core.files.store import ResultStore
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import CellResponse, MacroState
from porocore.study.config.config import RunConfig
from porocore.study.store import arrays_hash, training_key
from porocore.study.tuning.candidates import Candidate, with_architecture
from porocore.study.tuning.training import Result

#: Kind of these results in the store.
TUNINGS = "tunings"


class KnownTrainings:
    """Results of candidates in the store, by all that they depend on.

    Parameters
    ----------
    data, held_out
        Samples that the candidates are trained on, and states with responses that they are measured on.
    """

    def __init__(
        self,
        store: ResultStore,
        config: RunConfig,
        data: TrainingSet,
        held_out: tuple[MacroState, CellResponse],
    ) -> None:
        self._store, self._config, self._data = store, config, data
        self._measured = arrays_hash(*held_out)

    def find(self, grid: Sequence[Candidate], tell: Callable[[str], None]) -> dict[Candidate, Result]:
        """Return the results that the store holds, and tell how many they are."""
        stored = {candidate: self._store.find(TUNINGS, self._key(candidate)) for candidate in grid}
        found = {
            candidate: Result(**json.loads(each.payload))
            for candidate, each in stored.items()
            if each is not None
        }
        if found:
            took = duration(sum(result.seconds for result in found.values()))
            tell(f"tuning: {len(found)} trained networks came from the store, which saved {took}")
        return found

    def keep(self, candidate: Candidate, result: Result) -> None:
        """Keep the result of a candidate."""
        payload = json.dumps(asdict(result)).encode()
        self._store.keep(TUNINGS, self._key(candidate), payload, {"seconds": result.seconds})

    def _key(self, candidate: Candidate) -> str:
        surrogate = with_architecture(self._config, candidate).surrogate
        options = surrogate.options | {"model": self._config.surrogate_model, "measured on": self._measured}
        return training_key(surrogate.backend, options, surrogate.seed, self._data)

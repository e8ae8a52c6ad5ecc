"""Where each file of a run lies, and the names of the laws in them."""

from __future__ import annotations

from pathlib import Path

from porocore.macro.laws import CLOSURES
from porocore.study.config.config import RunConfig

#: Name of the law of linear poroelasticity.
LINEAR = "linear"


class RunFiles:
    """The files of one run; nothing is read or written here.

    Attributes
    ----------
    path
        The folder.
    config
        Its configuration; of a run that goes on with other settings, these.
    written
        The configuration that the run began with, which names the files: a run that goes on with another closure
        keeps the solutions of each, and one surrogate for each model.
    """

    def __init__(self, path: Path, config: RunConfig) -> None:
        self.path = path
        self.config = self.written = config
        self._lock: int | None = None

    @property
    def reference(self) -> Path:
        """The undeformed cell."""
        return self.path / "cell.json"

    @property
    def training_curve(self) -> Path:
        """Losses against epochs."""
        return self.training_curve_of(self.config)

    def training_curve_of(self, config: RunConfig) -> Path:
        """Losses of the surrogate that ``config`` needs."""
        return self.path / f"training{self._suffix(config)}.csv"

    @property
    def dataset(self) -> Path:
        """Solved states to learn from."""
        return self.path / "samples.h5"

    @property
    def test_dataset(self) -> Path:
        """Solved random states that no surrogate is trained on."""
        return self.path / "test.h5"

    @property
    def surrogate(self) -> Path:
        """The trained surrogate."""
        return self.surrogate_of(self.config)

    def surrogate_of(self, config: RunConfig) -> Path:
        """The surrogate of the model that ``config`` needs.

        ``surrogate.h5`` is that of the closure that the run began with; another closure may need another model,
        which lies beside it as ``surrogate-MODEL.h5``.
        """
        return self.path / f"surrogate{self._suffix(config)}.h5"

    @property
    def training_checkpoint(self) -> Path:
        """From which an interrupted training continues."""
        return self.training_checkpoint_of(self.config)

    def training_checkpoint_of(self, config: RunConfig) -> Path:
        """From which an interrupted training of that surrogate continues."""
        return self.path / "checkpoints" / f"training{self._suffix(config)}.h5"

    def _suffix(self, config: RunConfig) -> str:
        model = config.surrogate_model
        return "" if model == self.written.surrogate_model else f"-{model}"

    def macro_checkpoint(self, law: str, load: float) -> Path:
        """From which an interrupted macro solve continues."""
        return self.path / "checkpoints" / f"{_file_name(law, load)}.h5"

    def solution(self, law: str, load: float) -> Path:
        """Macro solution under one law and load."""
        return self.path / "solutions" / f"{_file_name(law, load)}.h5"

    def solutions(self, *laws: str) -> list[Path]:
        """The macro solution for each load with each of ``laws``; by default with the closure and linearly."""
        laws = laws or (self.config.closure, LINEAR)
        return [self.solution(law, load) for load in self.config.macro.loads for law in laws]

    def solved(self, load: float) -> list[str]:
        """Names of the nonlinear laws with a solution under ``load``: closures, with fallback, direct FE²."""
        closures = dict.fromkeys((self.written.closure, *CLOSURES))
        laws = (*closures, *map(fallback_law, closures), *map(direct_law, closures))
        return [law for law in laws if self.solution(law, load).exists()]

    @property
    def shown_closure(self) -> str:
        """The closure that a report is about: the first one of which every load is solved, else the run's first."""
        loads = self.config.macro.loads
        complete = [c for c in CLOSURES if all(self.solution(c, load).exists() for load in loads)]
        first = self.written.closure
        return first if first in complete or not complete else complete[0]

    @property
    def direct_work(self) -> Path:
        """How many cells direct FE² has solved, and in what time."""
        return self.path / "direct.json"

    @property
    def fallback(self) -> Path:
        """States that macro solves with a fallback needed outside the sampled range."""
        return self.path / "fallback.h5"

    @property
    def fallback_work(self) -> Path:
        """How many cells the fallback has solved, and in what time."""
        return self.path / "fallback.json"

    @property
    def fields(self) -> Path:
        """Folder of the files for ParaView."""
        return self.path / "fields"

    def history(self, law: str, load: float) -> Path:
        """Everything against time of one macro solution, as a table."""
        return self.path / "histories" / f"{_file_name(law, load)}.csv"

    @property
    def timings(self) -> Path:
        """Seconds that each stage took."""
        return self.path / "timings.json"

    @property
    def metrics(self) -> Path:
        """Figures of merit."""
        return self.path / "metrics.json"

    @property
    def report(self) -> Path:
        """The page to read."""
        return self.path / "report.html"


def direct_law(closure: str) -> str:
    """Name of the law of direct FE² with a closure."""
    return f"direct-{closure}"


def fallback_law(closure: str) -> str:
    """Name of the law of a closure whose surrogate learns on the way."""
    return f"{closure}-fallback"


def _file_name(law: str, load: float) -> str:
    safe = "".join(c if c.isalnum() else "-" for c in law)
    return f"{safe}_load{load!r}"

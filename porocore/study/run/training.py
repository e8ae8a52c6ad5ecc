"""The training stage: fits the surrogate that the closure needs; table of its losses.

An interrupted training continues from its checkpoint.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np

from porocore.core.console import Console, Task, duration
from porocore.core.echo import reason
from porocore.core.files.reading import complete, read_text
from porocore.core.files.store import ResultStore
from porocore.core.parallel.calls import Call, CallProcesses, Tell
from porocore.core.units import using_units
from porocore.errors import DataError, RunFolderError
from porocore.interfaces.surrogate import Surrogate, TrainingProgress, TrainingSet
from porocore.states import Array
from porocore.study.config.config import SurrogateSettings
from porocore.study.run.composition import make_backend, training_set
from porocore.study.run.folder import RunFolder, StageClock, timed
from porocore.study.run.results import load_surrogate
from porocore.study.store import fetch_files, keep_files, training_key

HEADER = "epoch,loss,validation_loss"


def train(
    folder: RunFolder,
    *,
    console: Console,
    store: ResultStore | None = None,
    begun: Call | None = None,
) -> None:
    """Fit the surrogate that the closure needs to the stable states, unless folder or store hold it.

    ``begun`` is the call of :func:`begin_training` that does so in another process.
    """
    path, title = folder.surrogate, folder.stage_of_cell("training")
    if begun is None and path.exists():
        load_surrogate(folder)
        console.note(f"{title}: {path.name} is there already")
        return
    data, stage, checkpoint = training_set(folder), training_stage(folder), folder.training_checkpoint
    files = {"surrogates": path, "training-curves": folder.training_curve}
    key = "" if store is None else _key(folder.config.surrogate, folder.config.surrogate_model, data)
    saved = None if begun is not None or checkpoint.exists() else fetch_files(store, key, files)
    if saved is not None:
        with timed(folder.timings, stage) as clock:
            clock.add(saved)
        console.note(f"{title}: {path.name} came from the store, which saved {duration(saved)}")
        return
    if begun is not None:
        begun.begin()
    now = None if begun is None else begun.time
    with (
        timed(folder.timings, stage, now and StageClock(now)) as clock,
        console.task(title, "epochs", clock=now) as task,
    ):
        if begun is None:
            _fit(folder, data, partial(show_training, task))
        else:
            for progress in begun.reports():
                show_training(task, progress)
            begun.result()
        keep_files(store, key, files, clock.seconds)
    checkpoint.unlink(missing_ok=True)


def show_training(task: Task, progress: TrainingProgress) -> None:
    """Show the progress of a training."""
    if progress.epochs == 1:
        task.done_at_once(progress.words)
        return
    task.unit, work = progress.unit, (progress.epoch, progress.left)
    task.update(progress.epoch, progress.epochs, detail=progress.words, work=work)


def begin_training(folder: RunFolder, processes: CallProcesses, store: ResultStore | None) -> Call | None:
    """Begin the training in a process; None where folder or store hold the surrogate."""
    if folder.surrogate.exists():
        return None
    if store is not None and not folder.training_checkpoint.exists():
        with suppress(DataError):  # which is refused when it is trained
            config = folder.config
            key = _key(config.surrogate, config.surrogate_model, training_set(folder))
            if store.find("surrogates", key) is not None:
                return None
    return processes.submit("while it trained the surrogate", train_elsewhere, folder)


def train_elsewhere(tell: Tell, folder: RunFolder) -> None:
    """Fit the surrogate in this process and save it; ``tell`` receives the progress."""
    with using_units(folder.config.result_units):
        _fit(folder, training_set(folder), tell)


def training_stage(folder: RunFolder) -> str:
    """Return the name of the stage in the record of times."""
    model = folder.config.surrogate_model
    return "training" if model == folder.written.surrogate_model else f"training, {model}"


def _fit(folder: RunFolder, data: TrainingSet, show: Callable[[TrainingProgress], None]) -> None:
    surrogate: Surrogate = make_backend("surrogate", folder.config)
    curve = TrainingCurveFile(folder.training_curve)

    def note(progress: TrainingProgress) -> None:
        curve.add(progress)
        show(progress)

    seed, checkpoint = folder.config.surrogate.seed, folder.training_checkpoint
    surrogate.fit(data, seed=seed, checkpoint=checkpoint, on_progress=note)
    surrogate.save(folder.surrogate)


def _key(settings: SurrogateSettings, model: str, data: TrainingSet) -> str:
    return training_key(settings.backend, settings.options | {"model": model}, settings.seed, data)


class TrainingCurveFile:
    """Losses of a training as a CSV file, one row for each report of progress, written at once.

    Its first column counts epochs, or iterations of L-BFGS; without validation states the last one is ``nan``.
    A resumed training repeats the epochs since its checkpoint, so their rows stand twice.

    Parameters
    ----------
    path
        The file, made if it does not exist. An incomplete last row is removed.

    Raises
    ------
    RunFolderError
        The disk is full or read-only.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            text = read_text(path) if path.exists() else ""
            whole = text[: text.rfind("\n") + 1] or f"{HEADER}\n"
            if whole != text:
                path.write_text(whole, encoding="utf-8", newline="\n")
        except OSError as error:
            raise self._cannot_write(error) from None

    def add(self, progress: TrainingProgress) -> None:
        """Append one row."""
        row = f"{progress.epoch},{progress.loss:.6e},{progress.validation_loss:.6e}\n"
        try:
            with self.path.open("a", encoding="utf-8", newline="\n") as file:
                file.write(row)
        except OSError as error:
            raise self._cannot_write(error) from None

    def _cannot_write(self, error: OSError) -> RunFolderError:
        return RunFolderError(f"cannot write {self.path}: {reason(error)}; make room or choose another --out")


def read_training_curve(path: Path) -> Array | None:
    """Return rows (n, 3) of epoch, loss and validation loss, each epoch once; None without any.

    Raises
    ------
    DataError
        The file is damaged.
    """
    if not path.exists():
        return None
    with complete(path, "record of losses", "report without it"):
        header, *rows = read_text(path).splitlines() or [HEADER]
        if header != HEADER:
            raise ValueError(f"its first line is not '{HEADER}'")
        table = np.array([[float(word) for word in row.split(",")] for row in rows]).reshape(len(rows), 3)
    if not rows:
        return None
    _, first = np.unique(table[:, 0], return_index=True)
    once: Array = table[first]
    return once

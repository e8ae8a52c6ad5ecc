"""Share of noises for which the 95 % intervals of a calibration cover the truth.

    python benchmarks/calibration_coverage.py --study STUDY --out DIR [--repeats N --processes 2]

The studies stand in ``coverage_studies.py``. The cells are solved and learned once.
Each repeat makes up data by the model at the truth with noise of its own,
searches the unknowns from a guess that does not know the truth, and takes all intervals, by the classes that ``porocore
calibrate`` uses; plane and report are left out. ``viscosity/conductivity`` is no unknown; its interval is the profile
of the same curves with this ratio in place of the viscosity. DIR keeps everything, one line for each repeat, and an
interrupted script goes on. --show prints the table of what is there.
"""

from __future__ import annotations

import argparse
import io
import json
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import ExitStack
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from calibration import TRUTH
from common import table
from coverage_studies import STUDIES
from viscosity_ratio import PowerSeries, ratio_interval

from porocore.commands.calibration.cells import families
from porocore.commands.calibration.experiment import ExperimentModel, StudiesModel
from porocore.commands.calibration.fit import fit
from porocore.commands.calibration.infer import infer
from porocore.commands.calibration.loading import read_plan
from porocore.commands.calibration.observations import curve_data
from porocore.commands.calibration.plan import CalibrationPlan
from porocore.commands.calibration.problem import CurveModel, CurvePrediction, Misfit
from porocore.core.console import Console
from porocore.core.files.plain_data import json_hash
from porocore.core.files.store import ResultStore
from porocore.core.parallel.memory import one_blas_thread
from porocore.errors import PorocoreError

Array = npt.NDArray[np.float64]
RATIO = "viscosity/conductivity"


class KnownModel(CurveModel):
    """A model that computes no curves twice; the first ones are the same for all repeats."""

    def __init__(self, model: CurveModel, known: dict[bytes, CurvePrediction]) -> None:
        self.model, self.known, self.unknowns = model, dict(known), model.unknowns

    def curves(self, values: Array) -> CurvePrediction:
        """Curves, known or computed."""
        key = np.asarray(values, dtype=float).tobytes()
        if key not in self.known:
            self.known[key] = self.model.curves(values)
        return self.known[key]


@dataclass(frozen=True, eq=False)
class Repeated:
    """All that a repeat needs."""

    plan: CalibrationPlan
    model: StudiesModel
    conductivity: PowerSeries
    truth: Array
    known: dict[bytes, CurvePrediction] = field(default_factory=dict)

    def repeat(self, seed: int) -> dict[str, Any]:
        """Results of the calibration with the noise of a seed."""
        began = time.process_time()
        model = KnownModel(self.model, self.known)
        exact, curves, first = model.curves(self.truth).values, [], 0
        for number, curve in enumerate(self.plan.curves):
            curves.append(curve.made_up(exact[first : first + len(curve)], [seed, number]))
            first += len(curve)
        misfit = Misfit(model, curve_data(curves))
        found = fit(misfit, self.plan.fit, Console(io.StringIO()))
        searched = len(model.known)
        said = infer(misfit, found.best, rays=0)
        asked = len(model.known)
        value, ratio, is_known = ratio_interval(misfit, said.best, self.conductivity)
        truths = dict(zip(TRUTH, self.truth.tolist(), strict=True))
        truths[RATIO] = truths["viscosity"] / self.conductivity.value(truths["radius"])
        intervals = {
            **{n: each.values for n, each in zip(TRUTH, said.data_intervals, strict=True)},
            RATIO: ratio,
        }
        return {
            "seed": seed,
            "values": {**dict(zip(TRUTH, said.values.tolist(), strict=True)), RATIO: value},
            "intervals": intervals,
            "inside": {name: _inside(ends, truths[name]) for name, ends in intervals.items()},
            "identifiable": {**dict(zip(TRUTH, said.identifiable, strict=True)), RATIO: is_known},
            "directions": [
                {"words": words, "step": dict(zip(TRUTH, each.step.tolist(), strict=True))}
                for words, each in zip(said.words, said.directions, strict=True)
            ],
            "singular_values": said.without_priors.singular_values.tolist(),
            # Sum of squares at the truth over the least: a χ² with as many degrees of freedom as unknowns.
            "rise_at_truth": 2 * (misfit.at(misfit_coordinates(misfit, self.truth)).cost - said.best.cost),
            "flagged": said.best.prediction.flagged,
            "moved": said.moved,
            "evaluations": {
                "search": searched - len(self.known),
                "intervals": asked - searched,
                RATIO: len(model.known) - asked,
            },
            "seconds": round(time.process_time() - began, 1),
        }


def misfit_coordinates(misfit: Misfit, values: Array) -> Array:
    """Coordinates of values."""
    return np.array([one.coordinate(float(v)) for one, v in zip(misfit.unknowns, values, strict=True)])


def _inside(ends: Sequence[float | None], truth: float) -> bool:
    low, high = ends
    return (low is None or low <= truth) and (high is None or truth <= high)


def prepared(name: str, folder: Path) -> Repeated:
    """Cells, models, and the curves at truth and guess."""
    plan = read_plan(STUDIES[name].given(folder / name), synthetic=True)
    with ExitStack() as stack:
        (cells,) = families(plan, folder / name, stack, Console(), ResultStore(folder / "store"))
        cells.learn()
        law_of = cells.laws()
        law = law_of(plan.experiments[0].config)
    experiments = [ExperimentModel(each, plan.unknowns, law_of(each.config)) for each in plan.experiments]
    model = StudiesModel([each.unknown for each in plan.unknowns], experiments)
    truth = np.array(list(TRUTH.values()))
    first = Misfit(model, curve_data([curve.made_up(np.ones(len(curve)), [0]) for curve in plan.curves]))
    guess = first.values(first.start)
    known = {values.tobytes(): model.curves(values) for values in (truth, guess)}
    radius = model.unknowns[0]

    def conductivity(radii: Array) -> Array:
        given = {"radius": radii, "poisson_ratio": np.full(len(radii), TRUTH["poisson_ratio"])}
        cell_law = law.cell_law  # type: ignore[attr-defined]
        found = cell_law.undeformed(np.stack([given[each] for each in cell_law.parameters], axis=1))
        return np.asarray(found.conductivity[:, 1, 1])

    return Repeated(plan, model, PowerSeries.of(conductivity, radius.lower, radius.upper), truth, known)


_REPEATED: list[Repeated] = []


def _begin(repeated: Repeated) -> None:
    _REPEATED.append(repeated)


def _one(seed: int) -> dict[str, Any]:
    with one_blas_thread():
        return _REPEATED[0].repeat(seed)


def repeats(repeated: Repeated, path: Path, count: int, processes: int) -> None:
    """Make the repeats that a file lacks, and append each to it."""
    truth = repeated.known[repeated.truth.tobytes()]
    identity = json_hash([repeated.plan.fit.model_dump(), [round(v, 9) for v in truth.values.tolist()]])
    done = {each["seed"] for each in lines(path, identity)}
    if not path.exists():
        path.write_text(json.dumps({"identity": identity}) + "\n", encoding="utf-8")
    missing = [seed for seed in range(count) if seed not in done]
    if not missing:
        return
    with ProcessPoolExecutor(processes, get_context("spawn"), _begin, (repeated,)) as pool:
        for call in as_completed([pool.submit(_one, seed) for seed in missing]):
            found = call.result()
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(found) + "\n")
            print(f"{len(missing)} to do, seed {found['seed']}: {found['seconds']} s", flush=True)


def lines(path: Path, identity: str = "") -> Iterator[dict[str, Any]]:
    """Repeats that a file holds, a last line that is incomplete left out."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        path.write_text(whole, encoding="utf-8")
    for number, line in enumerate(whole.splitlines()):
        read = json.loads(line)
        if number:
            yield read
        elif identity and read["identity"] != identity:
            raise PorocoreError(f"{path} holds repeats of another study; choose another --out")


def shown(name: str, path: Path) -> str:
    """The table of what a file holds."""
    found = list(lines(path))
    rows = []
    for each in (*TRUTH, RATIO):
        inside = sum(one["inside"][each] for one in found)
        known = sum(one["identifiable"][each] for one in found)
        open_ends = sum(None in one["intervals"][each] for one in found)
        rows.append([each, f"{inside} of {len(found)}", f"{known} of {len(found)}", str(open_ends)])
    header = ["unknown", "truth in the 95 % interval", "identifiable", "with an open end"]
    made = table(f"{STUDIES[name].words}, {len(found)} repeats", header, rows)
    every = sum(all(one["inside"][each] for each in TRUTH) for one in found)
    rises = [one["rise_at_truth"] for one in found]
    evaluations = [sum(one["evaluations"].values()) for one in found]
    seconds = [one["seconds"] for one in found]
    directions = np.unique([len(one["directions"]) for one in found], return_counts=True)
    counts = ", ".join(f"{n} in {times}" for n, times in zip(*directions, strict=True))
    return made + (
        f"\nThe truth lies in all intervals of the unknowns in {every} of {len(found)}. Unseen directions: {counts}."
        f"\nRise of the sum of squares at the truth: mean {np.mean(rises):.2f} (expected {len(TRUTH)}),"
        f" least {min(rises):.2f}. Flagged: {sum(one['flagged'] for one in found)}."
        f"\nEvaluations {min(evaluations)} to {max(evaluations)}, median {np.median(evaluations):.0f}; processor time"
        f" {min(seconds):.0f} to {max(seconds):.0f} s, median {np.median(seconds):.0f} s.\n"
    )


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--study", choices=STUDIES, required=True)
    parser.add_argument("--out", type=Path, required=True, help="folder of all results")
    parser.add_argument("--repeats", type=int, help="number of noises; as many as the study has by default")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument(
        "--show", action="store_true", help="print the table of what is there, and make nothing"
    )
    given = parser.parse_args()
    path = given.out / f"{given.study}.jsonl"
    if not given.show:
        with one_blas_thread():
            repeated = prepared(given.study, given.out)
        repeats(repeated, path, given.repeats or STUDIES[given.study].repeats, given.processes)
    print(shown(given.study, path))


if __name__ == "__main__":
    main()

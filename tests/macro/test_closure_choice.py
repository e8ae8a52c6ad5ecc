"""Another closure in a run that is there: which files it uses, and what direct FE² notes beside them."""

from __future__ import annotations

import json
import sys

import pytest

from porocore.cli.entry import main
from porocore.core.units import Scales
from porocore.errors import ConfigurationError, DataError, RunFolderError
from porocore.interfaces.macro import MacroSolver
from porocore.macro.laws.direct import DirectWork, cost_recorded, direct_records
from porocore.plugins import registry
from porocore.plugins.discovery import Offered, Source
from porocore.plugins.hookspecs import Offer
from porocore.states import Status
from porocore.study.config.config import RunConfig, with_closure
from porocore.study.config.loading import benchmark_path, load_config
from porocore.study.run.folder import RunFolder, direct_law


@pytest.fixture
def config() -> RunConfig:
    return load_config(benchmark_path())


def touch(*paths):
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")


# --- the configuration ------------------------------------------------------------------------------


def test_the_options_of_one_model_do_not_go_over_to_another(config):
    settings = config.surrogate.model_copy(update={"options": {"epochs": 5}})
    config = config.model_copy(update={"surrogate": settings})
    other = with_closure(config, "potential")
    assert (other.closure, other.surrogate_model, other.surrogate.options) == ("potential", "potential", {})
    assert with_closure(config, None) is with_closure(config, "mean-gradient") is config
    for same in ({"model": "potential"}, {"backend": "polynomial"}, {"backend": "not-there"}):
        chosen = config.model_copy(update={"surrogate": settings.model_copy(update=same)})
        kept = with_closure(chosen, "potential")  # the same kind of surrogate serves both
        assert (kept.closure, kept.surrogate.options) == ("potential", {"epochs": 5})


def test_an_unknown_closure_is_refused_with_the_nearest(config):
    with pytest.raises(ConfigurationError, match="unknown closure 'potental'; did you mean 'potential'"):
        config.with_closure("potental")


def test_the_samples_do_not_depend_on_the_closure(config):
    one, other = config.stages, config.with_closure("potential").stages
    assert (one.cell, one.sampling, one.test) == (other.cell, other.sampling, other.test)
    assert one.training != other.training
    assert one.macro != other.macro


# --- the files --------------------------------------------------------------------------------------


def test_each_model_has_its_own_files(tmp_path, config):
    folder = RunFolder.claim(tmp_path, config)
    other = folder.with_config(config.with_closure("potential"))
    for place in ("surrogate", "training_curve", "training_checkpoint"):
        assert getattr(folder, place) != getattr(other, place)
        assert "potential" in getattr(other, place).name
    assert folder.surrogate == tmp_path / "surrogate.h5"
    assert folder.training_curve.name == "training.csv"


def test_a_run_goes_on_with_another_closure_and_keeps_its_names(tmp_path, config):
    RunFolder.claim(tmp_path, config)
    written = (tmp_path / "config.yaml").read_bytes()
    other = config.with_closure("potential")
    with pytest.raises(RunFolderError, match="add --resume"):
        RunFolder.claim(tmp_path, other)
    folder = RunFolder.claim(tmp_path, other, resume=True)
    assert folder.surrogate.name == "surrogate-potential.h5"
    assert folder.with_config(config).surrogate.name == "surrogate.h5"
    assert (tmp_path / "config.yaml").read_bytes() == written
    assert RunFolder.open(tmp_path).config.closure == "mean-gradient"
    changed = other.model_copy(update={"cell": config.cell.model_copy(update={"viscosity": 2e-3})})
    with pytest.raises(RunFolderError, match=r"holds another run; this one has cell.viscosity \(0.002, not"):
        RunFolder.claim(tmp_path, changed, resume=True)


def test_numbers_are_told_as_they_are_written(tmp_path, config):
    """It told an end of 135 for 90 s, and cut the course of a load before what differs."""
    scales = Scales(modulus=60e3, length=1e-3, pore=5e-6, viscosity=1.0)  # a unit of time is 2/3 s
    course = {"traction": [0, {"ramp": -0.05, "until": 3.0}, 0], "pressure": 0}

    def of(end: float, ramp: float) -> RunConfig:
        pressed = {**course, "traction": [0, {"ramp": ramp, "until": 3.0}, 0]}
        data = config.model_dump(mode="json") | {"scales": scales.model_dump(mode="json")}
        data["macro"]["boundary"]["y+"] = pressed
        data["macro"]["time"]["end"] = end
        data["output_units"] = {"stress": "kPa"}
        return RunConfig.model_validate(data)

    RunFolder.claim(tmp_path, of(90.0, -1 / 30))
    with pytest.raises(RunFolderError) as refused:
        RunFolder.claim(tmp_path, of(135.0, -0.05), resume=True)
    assert (
        "this one has macro.boundary.y+.traction.1.ramp (-3 kPa, not -2 kPa), macro.time.end (90 s, not 60 s); choose"
    ) in str(refused.value)


def test_other_scales_are_named_before_the_numbers_that_they_change(tmp_path, config):
    """With pores of ten times their size it named four keys in multiples of the scales, and not the pore size."""
    scales = Scales(modulus=3e6, length=0.03, pore=6e-5, viscosity=0.05)
    RunFolder.claim(tmp_path, config.model_copy(update={"scales": scales}))
    wider = scales.model_copy(update={"pore": 6e-4})
    other = config.cell.model_copy(update={"viscosity": 2e-3})
    with pytest.raises(
        RunFolderError, match=r"this one has scales.pore \(0.0006, not .*, cell.viscosity \(0.0001 Pa s, not"
    ):
        RunFolder.claim(tmp_path, config.model_copy(update={"scales": wider, "cell": other}), resume=True)


def test_the_report_is_about_the_first_closure_that_is_complete(tmp_path, config):
    folder = RunFolder.claim(tmp_path, config)
    one, *rest = config.macro.loads
    assert folder.shown_closure == "mean-gradient"
    assert folder.solved(one) == []
    touch(folder.solution("potential", one))
    assert folder.shown_closure == "mean-gradient"  # nothing is complete
    touch(*(folder.solution("potential", load) for load in rest))
    assert folder.shown_closure == "potential"
    touch(*folder.solutions())
    assert folder.shown_closure == "mean-gradient"
    touch(folder.solution(direct_law("potential"), one))
    assert folder.solved(one) == ["mean-gradient", "potential", "direct-potential"]
    assert folder.solved(rest[0]) == ["mean-gradient", "potential"]


# --- what direct FE² notes --------------------------------------------------------------------------


def test_work_adds_up_over_solutions_sessions_and_interruptions(tmp_path):
    path, work = tmp_path / "direct.json", DirectWork()

    def solve(converged, overlap, seconds):
        work.points += 10 * (converged + overlap)
        work.counts += {Status.converged: converged, Status.overlap: overlap}
        work.seconds += seconds

    with cost_recorded(path, "a", work):
        solve(3, 0, 1.5)
    with cost_recorded(path, "b", work):
        solve(2, 1, 1.0)

    def interrupted():
        with cost_recorded(path, "a", work):
            solve(1, 2, 0.5)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    later = DirectWork()
    with cost_recorded(path, "a", later):
        later.counts[Status.converged] += 5
    records = direct_records(path)
    assert records["a"] == {"points": 60, "solves": 11, "seconds": 2.0, "converged": 9, "overlap": 2}
    assert records["b"] == {"points": 30, "solves": 3, "seconds": 1.0, "converged": 2, "overlap": 1}


def test_a_damaged_record_is_refused_by_name(tmp_path):
    path = tmp_path / "direct.json"
    assert direct_records(path) == {}
    for text in ("{", '{"a": 3}', json.dumps({"a": {"solves": "many"}})):
        path.write_text(text)
        with pytest.raises(
            DataError,
            match=r"direct.json: not a complete record of direct solves .* move it to direct.json.damaged, then go on",
        ):
            direct_records(path)


class SharedSolver(MacroSolver):
    """One that MPI processes can share."""

    distributed = True

    def prepare(self, problem):
        raise AssertionError

    def solve(self, prepared, law, *, checkpoint=None, on_step=None):
        raise AssertionError


def test_direct_solves_are_not_started_by_mpirun(tmp_path, config, monkeypatch, capsys):
    """They share their cells among processes themselves."""
    folder = RunFolder.claim(tmp_path / "run", config)
    touch(folder.dataset)
    source = Source("acme", "1.0", "extra")
    offer = Offer(name="skfem", load=lambda: SharedSolver, summary="")
    shop = registry.Registry([Offered("macro solver", offer, source)], [])
    monkeypatch.setattr(registry, "registry", lambda: shop)
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    monkeypatch.setenv("OMPI_COMM_WORLD_RANK", "0")
    monkeypatch.setattr(sys, "argv", ["porocore", "solve", str(folder.path), "--law", "direct"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "share their cells among processes themselves; start it without mpirun" in (
        capsys.readouterr().err
    )

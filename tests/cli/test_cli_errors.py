"""The command line: what it calls, what it prints, and that every error is one message and a status."""

import errno
import json
import re
import shutil
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest

import porocore
import porocore.study.run
from porocore.cli.cell import as_text
from porocore.cli.common import shell_line
from porocore.cli.entry import main
from porocore.errors import ConfigurationError, SolveError
from porocore.plugins import registry
from porocore.plugins.discovery import Offered, Source
from porocore.plugins.hookspecs import Offer
from porocore.plugins.table import PluginRow
from porocore.study import run as stages
from porocore.study.config.loading import benchmark_path, load_config
from porocore.study.notes import checks
from porocore.study.run.folder import RunFolder


@pytest.fixture
def porocore_command(monkeypatch, capsys):
    """Run the command line in this process: status, standard output, standard error."""

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["porocore", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        captured = capsys.readouterr()
        return ended.value.code, captured.out, captured.err

    return run


@pytest.fixture
def pipeline(monkeypatch):
    """Stages that write empty files and note that they were called."""
    fake = types.ModuleType("porocore.study.run.pipeline")
    fake.calls = []

    def stage(name, files):
        def call(folder, *, console, **others):
            fake.calls.append((name, folder.path, folder.config))
            for file in files(folder):
                file.parent.mkdir(exist_ok=True)
                file.write_bytes(b"")
            console.note(f"{name} speaks")
            return folder.report

        setattr(fake, name, call)

    stage("solve_reference", lambda folder: [])
    stage("sample", lambda folder: [folder.dataset, folder.test_dataset])
    stage("train", lambda folder: [folder.surrogate])
    stage("solve", lambda folder: folder.solutions())
    stage("report", lambda folder: [folder.report])
    stage("run", lambda folder: [folder.report])
    monkeypatch.setitem(sys.modules, "porocore.study.run.pipeline", fake)
    monkeypatch.setattr(stages, "pipeline", fake, raising=False)
    monkeypatch.setattr(checks, "check_backend", lambda kind, config: None)
    return fake


@pytest.fixture(autouse=True)
def offers(monkeypatch):
    """Backends that exist by name only, so that no test depends on what is installed."""
    source = Source("acme", "1.0", "extra")
    names = {
        "cell solver": ["skfem", "other-fem"],
        "macro solver": ["skfem", "other-fem"],
        "sampler": ["density-sweep"],
        "surrogate": ["torch"],
    }
    offers = [
        Offered(kind, Offer(name=name, load=dict, summary=""), source)
        for kind, known in names.items()
        for name in known
    ]
    monkeypatch.setattr(registry, "registry", lambda: registry.Registry(offers, []))


def one_message(err):
    assert err.startswith("error: ")
    assert "Traceback" not in err
    return err.removeprefix("error: ").strip()


def test_run_without_configuration_is_the_benchmark(porocore_command, pipeline, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = porocore_command("run")
    assert (status, out.strip()) == (0, "runs/dehghani2022/report.html")
    assert err.strip() == "run speaks"
    ((_, path, config),) = pipeline.calls
    assert str(path) == "runs/dehghani2022"
    assert config == load_config(benchmark_path())


def test_backends_can_be_chosen_for_a_run(porocore_command, pipeline, tmp_path):
    status, *_ = porocore_command(
        "run", "--fem", "other-fem", "--surrogate", "torch", "--out", tmp_path / "a"
    )
    assert status == 0
    assert pipeline.calls[0][2].fem.backend == "other-fem"
    assert RunFolder.open(tmp_path / "a").config.fem.backend == "other-fem"


def test_the_macroscale_can_be_given_to_another_backend(porocore_command, pipeline, tmp_path):
    words = ("run", "--fem", "other-fem", "--macro", "skfem", "--out", tmp_path / "a")
    assert porocore_command(*words)[0] == 0
    assert RunFolder.open(tmp_path / "a").config.macro_backend == "skfem"


def test_the_steps_follow_one_another(porocore_command, pipeline, tmp_path):
    out = tmp_path / "run"
    assert porocore_command("sample", benchmark_path(), "--out", out)[:2] == (0, f"{out / 'samples.h5'}\n")
    for command, result in (("train", "surrogate.h5"), ("report", None)):
        if result is None:
            status, _, err = porocore_command("report", out)
            assert status == 2
            assert f"make it first: porocore solve {out}" in one_message(err)
        else:
            assert porocore_command(command, out)[:2] == (0, f"{out / result}\n")
    status, printed, err = porocore_command("solve", out)
    assert status == 0
    assert len(printed.splitlines()) == 4
    assert f"next: porocore report {out}" in err
    assert porocore_command("report", out)[:2] == (0, f"{out / 'report.html'}\n")
    assert [call[0] for call in pipeline.calls] == ["solve_reference", "sample", "train", "solve", "report"]


@pytest.mark.parametrize(("step", "before"), [("train", "sample"), ("solve", "sample"), ("report", "sample")])
def test_a_step_without_its_predecessor_names_the_command(porocore_command, pipeline, tmp_path, step, before):
    RunFolder.claim(tmp_path, load_config(benchmark_path()))
    status, out, err = porocore_command(step, tmp_path)
    assert (status, out) == (2, "")
    assert f"make it first: porocore {before} {tmp_path}" in one_message(err)
    assert pipeline.calls == []


def test_resume_without_a_folder_says_so(porocore_command, pipeline, tmp_path):
    out, other = tmp_path / "column", tmp_path / "colunm"
    status, _, err = porocore_command("sample", benchmark_path(), "--out", out, "--resume")
    assert status == 0
    assert f"nothing to resume in {out}; a new run begins\n" in err
    _, _, err = porocore_command("sample", benchmark_path(), "--out", other, "--resume")
    assert f"nothing to resume in {other}; a new run begins; did you mean 'column'?\n" in err
    _, _, err = porocore_command("sample", benchmark_path(), "--out", out, "--resume")
    assert "nothing to resume" not in err


def test_sampling_goes_on_in_a_run_folder_or_with_resume(porocore_command, pipeline, tmp_path):
    out = tmp_path / "run"
    assert porocore_command("sample", benchmark_path(), "--out", out)[0] == 0
    assert porocore_command("sample", out)[0] == 0
    status, _, err = porocore_command("sample", benchmark_path(), "--out", out)
    assert status == 2
    assert "add --resume" in one_message(err)
    assert porocore_command("sample", benchmark_path(), "--out", out, "--resume")[0] == 0
    status, _, err = porocore_command("sample", out, "--fem", "other-fem")
    assert status == 2
    assert "leave out --fem and --out" in one_message(err)


def test_an_unknown_backend_makes_no_folder(porocore_command, pipeline, tmp_path):
    status, out, err = porocore_command("run", "--fem", "skfme", "--out", tmp_path / "run")
    assert (status, out) == (2, "")
    assert "unknown cell solver 'skfme'; did you mean 'skfem'?" in one_message(err)
    assert not (tmp_path / "run").exists()


def test_faults_of_a_configuration_come_line_by_line(porocore_command, tmp_path):
    path = tmp_path / "study.yaml"
    text = benchmark_path().read_text(encoding="utf-8")
    path.write_text(text.replace("radius: 0.25", "radius: 0.5").replace("step: 0.75", "stop: 0.75"), "utf-8")
    status, out, err = porocore_command("run", path, "--out", tmp_path / "run")
    assert (status, out) == (2, "")
    first, *rest = one_message(err).splitlines()
    assert first == "2 faults"
    assert len(rest) == 2
    assert all(line.startswith(f"  {path}:") for line in rest)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("command", ["run", "sample"])
def test_what_only_a_backend_can_tell_has_its_line_too(porocore_command, tmp_path, monkeypatch, command):
    def refuse(kind, config):
        if kind == "sampler":
            raise ConfigurationError("sampling.inputs.H22.range: must include 0\nelsewhere: a fault\nno key")

    monkeypatch.setattr("porocore.study.notes.checks.check_backend", refuse)
    path = tmp_path / "study.yaml"
    path.write_text(benchmark_path().read_text(encoding="utf-8"), encoding="utf-8")
    (line,) = [
        i for i, text in enumerate(path.read_text().splitlines(), 1) if text.strip() == "range: [-0.40, 0.04]"
    ]
    status, out, err = porocore_command(command, path, "--out", tmp_path / "run")
    assert (status, out) == (2, "")
    assert [text.strip() for text in one_message(err).splitlines()] == [
        "3 faults",
        f"{path}:{line}: sampling.inputs.H22.range: must include 0",
        "elsewhere: a fault",
        "no key",
    ]


def test_an_error_of_a_stage_is_one_message(porocore_command, pipeline, tmp_path):
    def fail(folder, **how):
        raise SolveError("Newton's iteration fails at t = 1; take a smaller macro.time.step")

    pipeline.run = fail
    status, out, err = porocore_command("run", "--out", tmp_path / "run")
    assert (status, out) == (2, "")
    assert one_message(err) == "Newton's iteration fails at t = 1; take a smaller macro.time.step"


@pytest.mark.parametrize(
    ("code", "advice"), [(errno.ENOSPC, "make room"), (errno.EROFS, "--out"), (errno.EACCES, "--out")]
)
def test_a_disk_that_takes_no_more_is_explained(porocore_command, pipeline, tmp_path, code, advice):
    def fail(folder, **how):
        raise OSError(code, "the system's words", str(folder.dataset))

    pipeline.run = fail
    status, _, err = porocore_command("run", "--out", tmp_path / "run")
    assert status == 2
    message = one_message(err)
    assert "samples.h5: the system's words" in message
    assert advice in message


@pytest.mark.parametrize(
    ("words", "advice"),
    [
        (["run", "CONFIG", "--fem", "other-fem"], "porocore run CONFIG --fem other-fem --out OUT --resume"),
        (["sample", "CONFIG"], "porocore sample OUT"),
    ],
)
def test_an_interruption_says_how_to_go_on(porocore_command, pipeline, tmp_path, words, advice):
    def interrupt(folder, **how):
        raise KeyboardInterrupt

    pipeline.run = pipeline.solve_reference = interrupt
    out, config = tmp_path / "a run", str(benchmark_path())
    words = [config if word == "CONFIG" else word for word in words]
    status, printed, err = porocore_command(*words, "--out", out)
    assert (status, printed) == (130, "")
    expected = advice.replace("CONFIG", config).replace("OUT", shell_line([str(out)]))
    assert err.strip() == f"interrupted; continue with: {expected}"


@pytest.mark.parametrize(
    "words",
    [["run", "--frobnicate"], ["frobnicate"], ["sample"], ["stability", "--steps", "much"], ["train"]],
)
def test_usage_errors_have_status_2(porocore_command, words):
    status, out, err = porocore_command(*words)
    assert (status, out) == (2, "")
    assert "Usage: porocore" in err
    assert "Traceback" not in err


def solved(status="converged"):
    value = np.nan if status == "inverted" else 0.5
    return {
        "porosity": 0.4123,
        "conductivity": np.eye(3),
        "mean_grad": np.full((3, 3), value),
        "fluid_volume": value,
        "status": status,
        "tangent": {"mean_grad_p": np.full((3, 3), value), "mean_grad_grad_u": np.full((3, 3, 3, 3), value)},
        "seconds": np.float64(1.5),
    }


def test_cell_prints_one_json_object(porocore_command, pipeline):
    asked = []
    pipeline.solve_cell = lambda config, grad_u, p, **how: asked.append((config, grad_u, p)) or solved()
    status, out, err = porocore_command(
        "cell", benchmark_path(), "--grad-u", "-0.1 0 0; 0,0,1e-2; 0 0 0", "--p", "-0.05", "--json"
    )
    assert (status, err) == (0, "")
    result = json.loads(out)
    assert result["conductivity"] == np.eye(3).tolist()
    assert (result["fluid_volume"], result["status"], result["seconds"]) == (0.5, "converged", 1.5)
    assert np.shape(result["tangent"]["mean_grad_grad_u"]) == (3, 3, 3, 3)
    assert asked == [(load_config(benchmark_path()), [[-0.1, 0, 0], [0, 0, 0.01], [0, 0, 0]], -0.05)]


def test_a_state_without_solution_is_an_answer_with_nulls_and_its_status(porocore_command, pipeline):
    pipeline.solve_cell = lambda config, grad_u, p, **how: solved("inverted")
    status, out, err = porocore_command("cell", "--json")
    assert (status, err) == (0, "")
    result = json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert result["status"] == "inverted"
    assert result["fluid_volume"] is None
    assert result["mean_grad"] == [[None] * 3] * 3


def test_a_state_without_solution_reads_as_its_status_and_no_dashes(porocore_command, pipeline):
    pipeline.solve_cell = lambda config, grad_u, p, **how: solved("inverted")
    status, out, err = porocore_command("cell")
    assert (status, err) == (0, "")
    assert "status: inverted – even the smallest load step leads to J ≤ 0; no data\n" in out
    assert [line.split(":")[0] for line in out.splitlines() if not line.startswith(" ")] == [
        "porosity",
        "conductivity [d²/μ_c]",
        "status",
        "seconds",
        "dimensionless",
    ]
    assert "nan" not in out.lower()
    assert not re.search(r"(^|\s)-(\s|$)", out)


def test_cell_for_reading_shows_round_off_as_zero():
    rows = [[-0.0, -3e-17, 0.5], [9e-13, 1.1e-12, -0.1], [0.0, 1.0, -2.0]]
    text = as_text({"stress": rows, "potential": -1e-18})
    assert [line.split() for line in text.splitlines()[1:4]] == [
        ["0", "0", "0.5"],
        ["0", "1.1e-12", "-0.1"],
        ["0", "1", "-2"],
    ]
    assert text.endswith("potential [E]: 0")


def test_cell_for_reading_leaves_out_what_is_too_long():
    text = as_text({**solved(), "conductivity": np.eye(3).tolist(), "mean_grad": [[None] * 3] * 3})
    assert "status: converged" in text
    assert text.count("\n  ") >= 6
    assert "mean_grad_grad_u" not in as_text(
        {"tangent": {"mean_grad_grad_u": np.zeros((3, 3, 3, 3)).tolist(), "fluid_volume_p": 1.0}}
    )


def test_help_names_the_commands_and_version_is_that_of_the_package(porocore_command):
    """How light both are is tested by what they import, in test_imports."""
    status, out, _ = porocore_command("--help")
    assert status == 0
    assert all(name in out for name in ("run", "sample", "train", "solve", "report", "cell", "plugins"))
    assert porocore_command("--version")[:2] == (0, f"porocore {porocore.__version__}\n")


def test_plugins_lists_what_can_be_done(porocore_command, monkeypatch):
    rows = [
        PluginRow("surrogate", "torch", "acme 1.0", "missing dependency", "", "pip install acme"),
        PluginRow("", "odd", "odd 2.0", "broken", "", "ValueError: no"),
    ]
    monkeypatch.setattr(registry, "plugins_table", lambda: rows)
    status, out, _ = porocore_command("plugins")
    assert status == 0
    lines = [line.split() for line in out.splitlines()]
    assert lines[1] == ["surrogate", "torch", "missing", "dependency", "acme", "1.0"]
    assert lines[2] == ["pip", "install", "acme"]
    assert lines[4] == ["ValueError:", "no"]


@pytest.mark.parametrize(
    "words", [("cell", "--help"), ("run", "--sampels", "3"), ("check", "missing.yaml")], ids=" ".join
)
def test_the_module_is_the_program(words, tmp_path):
    """The same output, with the same name of the program, and the same status."""
    program = shutil.which("porocore", path=Path(sys.executable).parent)
    (one, other) = (
        subprocess.run([*command, *words], cwd=tmp_path, capture_output=True, text=True, check=False)
        for command in ((program,), (sys.executable, "-m", "porocore"))
    )
    assert (one.returncode, one.stdout, one.stderr) == (other.returncode, other.stdout, other.stderr)
    assert one.stdout + one.stderr

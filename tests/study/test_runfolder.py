"""Run folders: who may have one, what is refused, and that nothing is overwritten."""

import json
import multiprocessing
import os
import shutil
import tempfile
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml

from porocore.errors import RunFolderError
from porocore.study.config.loading import benchmark_path, load_config
from porocore.study.run import folder as runfolder
from porocore.study.run.folder import RunFolder
from tests.helpers.platform_parts import POSIX


@pytest.fixture(scope="module")
def config():
    return load_config(benchmark_path())


def with_radius(config, radius):
    geometry = config.cell.geometry.model_copy(update={"radius": radius})
    return config.model_copy(update={"cell": config.cell.model_copy(update={"geometry": geometry})})


def contents(path):
    return {
        str(file.relative_to(path)): file.read_bytes()
        for file in path.rglob("*")
        if file.is_file() and file.name != ".lock"
    }


def test_a_new_folder_holds_the_resolved_configuration_and_the_versions(tmp_path, config):
    folder = RunFolder.claim(tmp_path / "deep" / "run", config)
    assert load_config(folder.path / "config.yaml") == config
    record = json.loads((folder.path / "run.json").read_text())
    assert record["identity"] == config.identity
    assert record["stages"]["sampling"] == config.stages.sampling
    assert set(record["versions"]) >= {"python", "porocore", "numpy", "porocore-fem-skfem"}
    assert RunFolder.open(folder.path).config == config


def test_an_empty_folder_is_taken(tmp_path, config):
    assert RunFolder.claim(tmp_path, config).path == tmp_path


def test_the_same_run_comes_back_only_with_resume(tmp_path, config):
    RunFolder.claim(tmp_path, config)
    before = contents(tmp_path)
    with pytest.raises(RunFolderError, match="already holds this run; add --resume"):
        RunFolder.claim(tmp_path, config)
    assert RunFolder.claim(tmp_path, config, resume=True).config == config
    assert contents(tmp_path) == before


def test_title_and_workers_do_not_make_another_run(tmp_path, config):
    RunFolder.claim(tmp_path, config)
    sampling = config.sampling.model_copy(update={"workers": 3})
    same = config.model_copy(update={"title": "renamed", "sampling": sampling})
    assert RunFolder.claim(tmp_path, same, resume=True).config.sampling.workers == 3


@pytest.mark.parametrize("resume", [False, True])
def test_another_run_is_refused_and_what_differs_is_named(tmp_path, config, resume):
    RunFolder.claim(tmp_path, config)
    before = contents(tmp_path)
    with pytest.raises(RunFolderError, match="choose another --out") as error:
        RunFolder.claim(tmp_path, with_radius(config, 0.2), resume=resume)
    assert "cell.geometry.radius (0.2, not 0.25)" in str(error.value)
    assert contents(tmp_path) == before


@pytest.mark.parametrize("name", ["thesis.tex", "samples.h5", "config.yaml", ".download.part"])
def test_a_folder_with_foreign_files_is_refused_untouched(tmp_path, config, name):
    (tmp_path / name).write_text("mine")
    with pytest.raises(RunFolderError, match="holds no run of porocore") as error:
        RunFolder.claim(tmp_path, config, resume=True)
    assert name in str(error.value)
    assert sorted(os.listdir(tmp_path)) == [name]
    assert (tmp_path / name).read_text() == "mine"


def test_a_start_that_died_before_the_record_can_be_repeated(tmp_path, config, monkeypatch):
    def die(*args, **kwargs):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(runfolder, "versions", die)
        with pytest.raises(KeyboardInterrupt):
            RunFolder.claim(tmp_path, config)
    assert (tmp_path / "config.yaml").exists()
    assert not (tmp_path / "run.json").exists()
    (tmp_path / ".run.json.4711.part").write_text("{")
    RunFolder.claim(tmp_path, config)
    assert RunFolder.open(tmp_path).config == config


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path, config):
    (tmp_path / "run").write_text("")
    with pytest.raises(RunFolderError, match="expected a folder, got a file"):
        RunFolder.claim(tmp_path / "run", config)
    with pytest.raises(RunFolderError, match="run is a file, not a folder"):
        RunFolder.claim(tmp_path / "run" / "below", config)


@contextmanager
def unprivileged():
    """Root may write anywhere, so step down for a moment."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)


@pytest.fixture
def open_folder():
    """A folder that every user may enter; those of pytest are closed to others."""
    path = Path(tempfile.mkdtemp())
    path.chmod(0o755)
    yield path
    shutil.rmtree(path)


@POSIX
def test_a_read_only_place_is_refused(open_folder, config):
    open_folder.chmod(0o555)
    with unprivileged(), pytest.raises(RunFolderError, match="cannot be made: Permission denied"):
        RunFolder.claim(open_folder / "run", config)


@POSIX
def test_a_read_only_run_can_be_opened_but_not_written(open_folder, config):
    folder = RunFolder.claim(open_folder / "run", config)
    (folder.path / ".lock").unlink()
    folder.path.chmod(0o555)
    with unprivileged():
        held = RunFolder.open(folder.path)
        with pytest.raises(RunFolderError, match="cannot be written: Permission denied"), held:
            pass


def hold(path, ready, release):
    with RunFolder.open(path):
        ready.set()
        release.wait(20)


def test_two_processes_cannot_write_one_run(tmp_path, config):
    folder = RunFolder.claim(tmp_path, config)
    context = multiprocessing.get_context("spawn")
    ready, release = context.Event(), context.Event()
    other = context.Process(target=hold, args=(tmp_path, ready, release))
    other.start()
    try:
        assert ready.wait(20)
        with pytest.raises(RunFolderError, match=rf"process {other.pid}\) is working in"), folder:
            pass
        with pytest.raises(RunFolderError, match="is working in"):
            RunFolder.claim(tmp_path, config, resume=True)
    finally:
        release.set()
        other.join()
    with folder:
        assert (tmp_path / ".lock").read_text().strip() == str(os.getpid())


def test_the_lock_goes_with_a_killed_process(tmp_path, config):
    folder = RunFolder.claim(tmp_path, config)
    context = multiprocessing.get_context("spawn")
    ready, release = context.Event(), context.Event()
    other = context.Process(target=hold, args=(tmp_path, ready, release))
    other.start()
    assert ready.wait(20)
    other.kill()
    other.join()
    with folder:
        pass


def test_opening_what_is_no_run_says_how_to_start_one(tmp_path):
    for path in (tmp_path, tmp_path / "absent"):
        with pytest.raises(RunFolderError, match=r"is not a run folder.*porocore sample CONFIG --out"):
            RunFolder.open(path)


@pytest.mark.parametrize(
    ("record", "reason"),
    [
        ("{", "damaged"),
        ("[]", "damaged"),
        ('{"format": "porocore-run"}', "damaged"),
        (
            '{"format": "porocore-run", "version": 99, "identity": ""}',
            "version 2, got porocore-run version 99",
        ),
    ],
)
def test_a_damaged_or_newer_record_is_refused(tmp_path, config, record, reason):
    RunFolder.claim(tmp_path, config)
    (tmp_path / "run.json").write_text(record)
    with pytest.raises(RunFolderError, match=reason):
        RunFolder.open(tmp_path)


def test_a_run_of_before_is_told_for_what_it_is(tmp_path, config):
    """Its identity is another one, but nobody edited its configuration."""
    RunFolder.claim(tmp_path, config)
    path = tmp_path / "run.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"version": 1, "identity": "of before"}))
    before = contents(tmp_path)
    for again in (lambda: RunFolder.open(tmp_path), lambda: RunFolder.claim(tmp_path, config, resume=True)):
        with pytest.raises(
            RunFolderError, match=r"expected porocore-run version 2, got porocore-run version 1; use"
        ):
            again()
    assert contents(tmp_path) == before


#: Identity of the benchmark's configuration in run folders of each version.
IDENTITIES = {2: "e3dad5a3bc1bd9a8"}


def test_the_version_is_raised_where_identities_change(config):
    """Otherwise a newer porocore says of older runs that somebody edited their configuration."""
    assert config.identity == IDENTITIES[runfolder.VERSION], (
        "raise runfolder.VERSION, and note the identity here"
    )


def test_an_edited_configuration_is_noticed(tmp_path, config):
    RunFolder.claim(tmp_path, config)
    path = tmp_path / "config.yaml"
    data = yaml.safe_load(path.read_text())
    data["cell"]["viscosity"] = 2e-3
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    with pytest.raises(RunFolderError, match="was changed after the run began"):
        RunFolder.open(tmp_path)
    path.unlink()
    with pytest.raises(RunFolderError, match="so the run folder is incomplete"):
        RunFolder.open(tmp_path)


def test_every_file_of_a_run_has_its_own_place_inside(tmp_path, config):
    macro = config.macro.model_copy(update={"loads": (-0.2, -0.01, -0.2000001)})
    folder = RunFolder.claim(tmp_path, config.model_copy(update={"macro": macro}))
    files = [
        folder.dataset,
        folder.test_dataset,
        folder.surrogate,
        folder.training_checkpoint,
        folder.fields,
        folder.timings,
        folder.metrics,
        folder.report,
        *folder.solutions(),
        *(folder.macro_checkpoint(law, load) for law in ("linear", "a/b") for load in macro.loads),
    ]
    assert len(folder.solutions()) == 6
    assert len(set(files)) == len(files)
    assert all(file.parent in (tmp_path, tmp_path / "checkpoints", tmp_path / "solutions") for file in files)


def test_a_missing_file_of_the_step_before_names_the_command(tmp_path, config):
    folder = RunFolder.claim(tmp_path, config)
    with pytest.raises(RunFolderError, match=rf"is missing; make it first: porocore sample {tmp_path}"):
        folder.require(folder.dataset, "sample")
    folder.dataset.write_bytes(b"")
    assert folder.require(folder.dataset, "sample") == folder.dataset

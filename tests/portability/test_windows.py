"""Everything but dolfinx runs on macOS and Windows, and on Linux where Python looks as it does on Windows.

``windows/sitecustomize.py`` makes it look so. The other systems run the same commands as they are.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.sampling.datasets.dataset import Dataset, parts_folder
from tests.calibration.test_calibrate import STUDY as TWIN
from tests.cell.test_cell_files import channels, joined, written
from tests.e2e.study import QUICK, contents, write_study
from tests.helpers.hdf5_samples import unsealed as without_seal

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="another system is made up on Linux")
WINDOWS = Path(__file__).with_name("windows")
PACKAGES = ("porocore", "porocore_fem_skfem", "porocore_surrogate_torch", "porocore_surrogate_jax")
#: What a pipe of Windows has by default.
ENCODING = "utf-8" if sys.platform == "darwin" else "cp1252"
ENVIRONMENT = {
    **{name: value for name, value in os.environ.items() if name != "PYTHONUTF8"},
    "PYTHONPATH": os.pathsep.join([*[str(WINDOWS)] * (sys.platform == "linux"), *filter(None, sys.path)]),
    "PYTHONIOENCODING": ENCODING,
}


def python(*words: object, **how: object) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, *map(str, words)],
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        **how,
    )  # type: ignore[call-overload, no-any-return]


def printed(process: subprocess.Popen[bytes]) -> str:
    """Standard output of a process that does what it was asked."""
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err.decode(ENCODING)
    assert b"Traceback" not in err
    return out.decode(ENCODING).replace("\r\n", "\n")


def porocore(*words: object, cwd: Path) -> str:
    return printed(python("-m", "porocore", *words, cwd=cwd))


@LINUX
def test_what_windows_lacks_is_not_there(tmp_path: Path) -> None:
    wanted = [
        ("import fcntl", "ModuleNotFoundError"),
        ("from resource import getrlimit", "ModuleNotFoundError"),
        ("import os; os.fork()", "AttributeError"),
        ("from signal import SIGKILL", "ImportError"),
        ("open('/proc/meminfo')", "FileNotFoundError"),
        ("open('a:b', 'w')", "OSError"),
        ("open('nul.txt', 'w')", "OSError"),
        ("open('a', 'w'); open('A', 'w')", "FileExistsError"),
        ("open('a', 'w').write('φ')", "UnicodeEncodeError"),
        ("import os; f = open('a', 'w'); os.remove('a')", "PermissionError"),
        ("from pathlib import Path; f = open('a', 'w'); Path('b').touch(); Path('b').replace('a')", "PermissionError"),
        ("import subprocess; subprocess.run(['true'], preexec_fn=print)", "ValueError"),
        ("print('φ')", "UnicodeEncodeError"),
        ("f = open('c', 'w'); f.write('x\\n'); f.close()", ""),
    ]  # fmt: skip
    code = (
        f"for code, _ in {wanted}:\n"
        "    try:\n"
        "        exec(code, {'__name__': 'porocore.probe'})\n"
        "        print()\n"
        "    except Exception as error:\n"
        "        print(type(error).__name__)\n"
    )
    assert printed(python("-c", code, cwd=tmp_path)).split("\n")[:-1] == [said for _, said in wanted]
    assert (tmp_path / "c").read_bytes() == b"x\r\n"


def test_signs_that_an_encoding_lacks_do_not_end_a_command(tmp_path: Path) -> None:
    code = "from porocore.cli import _write_any_text; _write_any_text(); print('−1 ≤ φ²')"
    said = {"cp1252": "-1 \\u2264 \\u03c6²", "utf-8": "−1 ≤ φ²"}[ENCODING]
    assert printed(python("-c", code, cwd=tmp_path)) == f"{said}\n"


def test_every_module_is_imported(tmp_path: Path) -> None:
    code = (
        "import importlib, pkgutil\n"
        f"for top in {PACKAGES}:\n"
        "    package = importlib.import_module(top)\n"
        "    names = [found.name for found in pkgutil.walk_packages(package.__path__, top + '.', lambda name: 1 / 0)]\n"
        "    for name in names:\n"
        "        if not name.endswith('.__main__'):\n"
        "            importlib.import_module(name)\n"
        "    print(top, len(names))\n"
    )
    found = dict(line.split() for line in printed(python("-c", code, cwd=tmp_path)).splitlines())
    assert list(found) == list(PACKAGES)
    assert int(found["porocore"]) > 300


def a_study(folder: Path, **changes: object) -> Path:
    return write_study(folder / "study.yaml", {**QUICK, "sampling.workers": 2, **changes})


def solved(run: Path) -> dict[str, float]:
    """Seconds of each solved state."""
    samples = Dataset.open(run / "samples.h5")
    return dict(zip(samples.keys, samples.seconds(), strict=True))


def test_sampling_in_two_processes_is_killed_and_resumed(tmp_path: Path) -> None:
    study, run = a_study(tmp_path), tmp_path / "run"
    killed = python("-m", "porocore", "sample", study, "--out", run, "--no-store", cwd=tmp_path)
    while not (run / "samples.h5").exists() or len(list(parts_folder(run / "samples.h5").glob("*.h5"))) < 4:
        assert killed.poll() is None, killed.communicate()
        time.sleep(0.02)
    killed.kill()
    killed.communicate()
    before = solved(run)
    assert len(before) >= 4
    porocore("sample", study, "--out", run, "--resume", "--no-store", cwd=tmp_path)
    after = solved(run)
    assert before.items() <= after.items(), "states were solved again or lost"
    assert len(after) > len(before)
    assert not parts_folder(run / "samples.h5").exists()


@LINUX
@pytest.mark.slow
def test_a_run_has_the_numbers_that_it_has_elsewhere(tmp_path: Path) -> None:
    study = a_study(tmp_path)
    porocore("check", study, cwd=tmp_path)
    porocore("run", study, "--out", "run", "--no-store", cwd=tmp_path)
    assert str(Path("run", "report.html")) in porocore("report", "run", cwd=tmp_path)
    whole = subprocess.run(
        [sys.executable, "-m", "porocore", "run", study, "--out", "elsewhere", "--no-store"],
        cwd=tmp_path, capture_output=True, check=False,
    )  # fmt: skip
    assert whole.returncode == 0, whole.stderr
    here, elsewhere = tmp_path / "run", tmp_path / "elsewhere"
    names = {path.relative_to(here) for path in here.rglob("*") if path.is_file()}
    assert names == {path.relative_to(elsewhere) for path in elsewhere.rglob("*") if path.is_file()}
    for name in ("samples.h5", "test.h5"):
        assert Dataset.open(here / name).digest() == Dataset.open(elsewhere / name).digest()
    for path in (here / "solutions").iterdir():
        assert contents(path) == contents(elsewhere / "solutions" / path.name)
    for path in here.rglob("*"):
        if path.suffix in (".csv", ".json", ".yaml", ".html", ".pvd"):
            assert b"\r" not in path.read_bytes(), f"{path.name} has the ends of lines of Windows"
    assert (here / "config.yaml").read_bytes() == (elsewhere / "config.yaml").read_bytes()
    # Files of a run that goes on elsewhere.
    porocore("solve", elsewhere, cwd=tmp_path)


@pytest.mark.slow
def test_commands_run(tmp_path: Path) -> None:
    """Those that write files, start processes or print signs that Windows-1252 lacks."""
    polynomial = {"surrogate": {"backend": "polynomial"}, "sampling.test.count": 1}
    study = a_study(tmp_path, **polynomial)
    np.save(tmp_path / "pores.npy", channels(8).astype(np.uint8))
    _, points, cells, tags = joined(OrthogonalChannels(), "linear")
    written(tmp_path / "cell.msh", points, cells, tags)
    geometries = {
        "image": {"kind": "voxels", "path": str(tmp_path / "pores.npy")},
        "mesh": {"kind": "mesh-file", "path": str(tmp_path / "cell.msh"), "solid": [1], "fluid": [2]},
    }
    image, mesh = (a_study(tmp_path / name, **{"cell.geometry": kind}) for name, kind in geometries.items())
    unsealed, twin = tmp_path / "unsealed.h5", write_study(tmp_path / "twin.yaml", base=TWIN)
    for words in (
        ("--help",),
        ("init", "cartilage-confined", "--to", "mine.yaml"),
        ("check", "mine.yaml"),
        ("schema", "--to", "schema.json"),
        ("plugins",),
        ("units", "time=1"),
        ("cell", "state", study, "--at", "H22=-0.05,p=0.02", "--store", "store"),
        ("store", "list", "--store", "store"),
        ("cell", "show", image, "--no-pictures", "--out", "image"),
        ("cell", "state", mesh, "--no-store"),
        ("sample", study, "--out", "run", "--no-store"),
        ("train", "run"),
        ("solve", "run"),
        ("report", "run"),
        ("data", "info", "run"),
        ("data", "check", unsealed),
        ("data", "export", "run", "--out", "table.csv"),
        ("sweep", study, "--over", "radius=0.2,0.25", "--out", "sweep", "--no-store"),
        ("verify", "--case", "terzaghi", "--fem", "skfem"),
        ("calibrate", twin, "--synthetic", "--out", "calibrated", "--no-store"),
        ("plugin", "new", "mine", "--kind", "sampler"),
    ):
        porocore(*words, cwd=tmp_path)
        if words[0] == "sample":  # read by a process of its own, before anything else reads it
            unsealed.write_bytes(without_seal((tmp_path / "run" / "samples.h5").read_bytes()))
    assert (tmp_path / "calibrated" / "calibration.json").is_file()

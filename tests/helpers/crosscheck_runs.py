"""Runs of ``porocore crosscheck`` on a coarse case."""

from __future__ import annotations

import io
import json
import sys
from contextlib import redirect_stderr, redirect_stdout

import pytest
import yaml

from porocore.cli import main
from porocore.study.config.loading import crosscheck_path


def distribution(folder, name, module):
    """Files that make ``module`` a plugin of porocore once ``folder`` is on the path."""
    info = folder / f"porocore_{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: porocore-{name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[porocore]\n{name} = {module}\n")
    return str(folder)


def write_case(path, **changes):
    """The packaged case on linear elements, with the polynomial of the fakes and fewer steps."""
    settings = yaml.safe_load(crosscheck_path().read_text(encoding="utf-8"))
    settings["cell"]["mesh"]["element"] = "linear"
    settings["surrogate"] = {"backend": "cubic"}
    settings["sampling"] |= {"tolerance": 1.0, "test": {"count": 6, "seed": 3}}
    times = {"end": 1.0, "step": 0.2, "ramp_step": 0.02, "profiles": [1.0]}
    settings["macro"]["body"]["elements"] = [1, 4, 1]
    settings["macro"] |= {"time": times}
    path.write_text(yaml.safe_dump(settings | changes), encoding="utf-8")
    return path


def run(case, out, *words, fem=(), surrogate=()):
    """Exit status, standard output, standard error, and the document."""
    words = [*words, *(w for name in fem for w in ("--fem", name))]
    words += [w for name in surrogate for w in ("--surrogate", name)]
    streams = io.StringIO(), io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        redirect_stdout(streams[0]),
        redirect_stderr(streams[1]),
    ):
        patch.setattr(sys, "argv", ["porocore", "crosscheck", str(case), *words, "--out", str(out)])
        with pytest.raises(SystemExit) as ended:
            main()
    file = out / "crosscheck.json"
    document = json.loads(file.read_text(encoding="utf-8")) if file.exists() else None
    return ended.value.code or 0, *(stream.getvalue() for stream in streams), document

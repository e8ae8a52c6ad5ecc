"""In CI no test is skipped for want of something."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize(
    ("body", "ci", "without", "status"),
    [
        ("import pytest\ndef test_a(): pytest.importorskip('no_such_package')", "true", "", 1),
        pytest.param(
            "import pytest\ndef test_a(): pytest.importorskip('no_such_package')",
            "",
            "",
            0,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "import pytest\npytest.skip('it is not installed', allow_module_level=True)",
            "true",
            "",
            1,
            marks=pytest.mark.slow,
        ),
        ("import pytest\n@pytest.mark.slow\ndef test_a(): pass", "true", "", 0),
        pytest.param(
            "import pytest\ndef test_a(): pytest.skip('Own gives no access to its tangent')",
            "true",
            "",
            0,
            marks=pytest.mark.slow,
        ),
        (
            "import pytest\ndef test_a(): pytest.importorskip('no_such_package')",
            "true",
            "dolfinx,no_such_package",
            0,
        ),
        pytest.param(
            "import pytest\ndef test_a(): pytest.importorskip('no_such_package')",
            "true",
            "dolfinx",
            1,
            marks=pytest.mark.slow,
        ),
    ],
    ids=["missing package", "not in CI", "missing for a module", "slow", "not offered", "not here", "other"],
)
def test_a_skip_fails_in_ci_unless_it_is_a_good_one(body, ci, without, status, tmp_path):
    (tmp_path / "tests").mkdir()
    for name in ("conftest.py", "tests/slow_tests.txt"):
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    (tmp_path / "test_own.py").write_text(body)
    (tmp_path / "test_other.py").write_text("def test_b(): pass\n")
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-c",
        str(ROOT / "pyproject.toml"),
    ]
    done = subprocess.run(
        [*command, "--rootdir", str(tmp_path), str(tmp_path)],
        env={**os.environ, "CI": ci, "POROCORE_WITHOUT": without},
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == status, done.stdout
    if ci:
        assert "1 skipped: " in done.stdout

"""What GitHub runs is what a developer runs."""

import re
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
WORKFLOW = yaml.safe_load((ROOT / ".github/workflows/test.yml").read_text(encoding="utf-8"))
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))


def made(text: str) -> set[str]:
    return set(re.findall(r"^make ([a-z-]+)$", text, re.MULTILINE))


def test_the_workflow_runs_everything_that_must_pass_before_a_change_lands():
    found = {
        name
        for job in WORKFLOW["jobs"].values()
        for step in job["steps"]
        for name in made(step.get("run", ""))
    }
    assert found <= TARGETS
    assert found >= made((ROOT / ".ci/run").read_text(encoding="utf-8")) >= {"lint", "test", "dist"}


def test_the_workflow_keeps_what_the_makefile_writes():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    kept = [
        step["with"]["path"] for job in WORKFLOW["jobs"].values() for step in job["steps"] if "with" in step
    ]
    assert kept == ["dist/", "build/docs/", "build/coverage/"]
    assert "--out dist\n" in makefile
    assert " build/docs\n" in makefile
    assert "html:build/coverage\n" in makefile

"""How long a stage took, and over how many runs, whichever way they ended."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from porocore.errors import DataError
from porocore.study.run.folder import stage_times, timed


def test_a_resumed_stage_says_that_its_time_is_of_several_runs(tmp_path: Path) -> None:
    path = tmp_path / "timings.json"
    assert stage_times(path) == {}
    with pytest.raises(KeyboardInterrupt), timed(path, "sampling"):
        raise KeyboardInterrupt
    first = stage_times(path)["sampling"].seconds
    with timed(path, "sampling"):
        pass
    with timed(path, "training"):
        pass
    assert stage_times(path)["sampling"].seconds > first > 0
    assert {stage: each.runs for stage, each in stage_times(path).items()} == {"sampling": 2, "training": 1}


def test_a_stage_that_found_its_work_done_adds_nothing(tmp_path: Path) -> None:
    path = tmp_path / "timings.json"
    with timed(path, "sampling") as clock:
        clock.idle = True
    assert not path.exists()


def test_a_record_of_seconds_alone_is_of_one_run(tmp_path: Path) -> None:
    path = tmp_path / "timings.json"
    path.write_text(json.dumps({"sampling": 2.5}))
    with timed(path, "sampling"):
        pass
    assert stage_times(path)["sampling"].seconds > 2.5
    assert {stage: each.runs for stage, each in stage_times(path).items()} == {"sampling": 2}


@pytest.mark.parametrize(
    "content", ["[]", '{"a": {}}', '{"a": {"seconds": 1, "runs": 1e999}}', '{"a": "b"}', "{"]
)
def test_a_damaged_record_is_one_message(tmp_path: Path, content: str) -> None:
    (tmp_path / "timings.json").write_text(content)
    with pytest.raises(DataError, match="not a complete record of the stages' times"):
        stage_times(tmp_path / "timings.json")


def test_what_a_store_saved_counts_and_is_known(tmp_path: Path) -> None:
    path = tmp_path / "timings.json"
    for _ in range(2):
        with timed(path, "sampling") as clock:
            clock.add(30.0)
    found = stage_times(path)["sampling"]
    assert found.saved == 60
    assert 60 < found.seconds < 61

"""What launchers say, and what stands for a single process."""

import pytest

from porocore.core.parallel import Communicator, launched

NAMES = (
    "OMPI_COMM_WORLD_RANK",
    "OMPI_COMM_WORLD_SIZE",
    "PMI_RANK",
    "PMI_SIZE",
    "PMIX_RANK",
    "SLURM_PROCID",
    "SLURM_NTASKS",
    "SLURM_STEP_NUM_TASKS",
)


@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({}, (0, 1)),
        ({"OMPI_COMM_WORLD_RANK": "1", "OMPI_COMM_WORLD_SIZE": "2"}, (1, 2)),
        ({"PMI_RANK": "3", "PMI_SIZE": "4"}, (3, 4)),
        ({"PMIX_RANK": "0", "SLURM_PROCID": "0", "SLURM_STEP_NUM_TASKS": "8"}, (0, 8)),
        # Within a batch script that starts one process only.
        ({"SLURM_PROCID": "0", "SLURM_NTASKS": "8"}, (0, 1)),
        ({"OMPI_COMM_WORLD_RANK": "1"}, (0, 1)),
        ({"PMI_RANK": "one", "PMI_SIZE": "2"}, (0, 1)),
    ],
)
def test_rank_and_size_from_the_launcher(monkeypatch, variables, expected):
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert launched() == expected


class Resource:
    """Notes what happens to it."""

    def __init__(self):
        self.seen = []

    def __enter__(self):
        self.seen.append("enter")

    def __exit__(self, kind, error, trace):
        self.seen.append(("exit", kind))


def test_one_process_is_the_first_and_all():
    communicator, resource = Communicator(), Resource()
    assert (communicator.rank, communicator.size) == (0, 1)
    assert communicator.on_root(lambda: 7) == communicator.sum(7) == communicator.max(7) == 7
    with communicator.holding(resource):
        assert resource.seen == ["enter"]
    assert resource.seen == ["enter", ("exit", None)]
    resource.seen.clear()
    with pytest.raises(ZeroDivisionError), communicator.holding(resource):
        _ = 1 / 0
    assert resource.seen == ["enter", ("exit", ZeroDivisionError)]

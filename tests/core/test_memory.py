"""Memory of large problems: temporary arrays cost no page faults within the block, and all is handed back after it."""

import os
import subprocess
import sys

import pytest

SCRIPT = """
import resource
import numpy as np
from contextlib import nullcontext
from porocore.core.parallel.memory import LARGE, freed_memory_kept

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        np.ones(8_000_000)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

def resident():
    return int(open("/proc/self/statm").read().split()[1]) * 4096

np.ones(8_000_000)
outside = faults()
with freed_memory_kept(10 * LARGE):
    with freed_memory_kept(10 * LARGE):
        np.ones(8_000_000)
    inside = faults()
with freed_memory_kept(10):
    small = faults()
print(outside, inside, small, resident() // 2**20)
"""


@pytest.mark.skipif(
    not os.path.exists("/proc/self/statm"), reason="the size of the process is read from /proc"
)
def test_large_temporary_arrays_are_not_cleared_by_the_system_again_and_again():
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    outside, inside, small, megabytes = map(int, done.stdout.split())
    assert inside < outside / 4
    assert small > outside / 2
    assert megabytes < 200  # twenty arrays of 64 MB were made


FORBIDDEN = """
import ctypes
import numpy as np
from porocore.core.parallel.memory import return_freed_memory

for setting, value in ((-1, -1), (-4, 0)):  # as SuperLU_DIST has it
    ctypes.CDLL(None).mallopt(setting, value)

def kept(numbers):
    before = int(open("/proc/self/statm").read().split()[1])
    np.ones(numbers)
    return (int(open("/proc/self/statm").read().split()[1]) - before) * 4096 // 2**20

forbidden = kept(50_000_000)
return_freed_memory()
print(forbidden, kept(100_000_000))  # more than is kept already
"""


@pytest.mark.skipif(
    not os.path.exists("/proc/self/statm"), reason="the size of the process is read from /proc"
)
def test_what_a_library_forbade_is_allowed_again():
    done = subprocess.run([sys.executable, "-c", FORBIDDEN], capture_output=True, text=True, check=True)
    forbidden, allowed = map(int, done.stdout.split())
    assert forbidden > 300  # one array of 381 MB
    assert allowed < 50

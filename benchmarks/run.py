"""Run all benchmarks, each in a process of its own with one thread, and print their tables."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

SCRIPTS = (
    "felupe_newton",
    "elements",
    "paper_size",
    "surrogate_calls",
    "parameters_cost",
    "parameters_body",
    "backends",
    "direct_fe2",
    "contact",
    "executors",
    "voxels",
    "channels_of_voxels",
    "macro_iteration",
    "macro_size",
    "sensitivities",
    "start_up",
    "meridian",
)
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")


def main() -> int:
    chosen = sys.argv[1:] or SCRIPTS
    unknown = set(chosen) - set(SCRIPTS)
    if unknown:
        print(
            f"unknown benchmark {', '.join(sorted(unknown))}; choose from {', '.join(SCRIPTS)}",
            file=sys.stderr,
        )
        return 2
    folder = Path(__file__).parent
    codes = [
        subprocess.run(
            [sys.executable, folder / f"{name}.py"], env=os.environ | ONE_THREAD, check=False
        ).returncode
        for name in chosen
    ]
    return max(codes)


if __name__ == "__main__":
    sys.exit(main())

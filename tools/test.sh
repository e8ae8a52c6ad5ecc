#!/bin/sh
# All tests, on two processes with one thread each. Arguments go to pytest.
set -eu
cd "$(dirname "$0")/.."
export OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
exec .venv/bin/python -m pytest -n 2 --dist loadscope --durations=10 "$@"

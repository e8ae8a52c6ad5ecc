#!/bin/sh
# All tests, on two processes with one thread each. Arguments go to pytest. NEWEST=1 is as in tools/setup.sh.
set -eu
cd "$(dirname "$0")/.."
export OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
exec .venv${NEWEST:+-newest}/bin/python -m pytest -n 2 --dist loadscope --durations=10 "$@"

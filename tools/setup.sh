#!/bin/sh
# Make .venv with everything that `make run` (argument: run) or `make test` (argument: test) needs.
set -eu
what=$1
cd "$(dirname "$0")/.."

# The shared libraries that gmsh's wheel loads, and the Debian packages that hold them.
libraries="libGLU.so.1 libGL.so.1 libXrender.so.1 libXcursor.so.1 libXfixes.so.3 libXft.so.2 libfontconfig.so.1 libXinerama.so.1 libgomp.so.1"
packages="libglu1-mesa libgl1 libxrender1 libxcursor1 libxfixes3 libxft2 libfontconfig1 libxinerama1 libgomp1"

as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"; else sudo -n "$@"; fi
}

can_install() {
    command -v apt-get >/dev/null && { [ "$(id -u)" = 0 ] || sudo -n true 2>/dev/null; }
}

install() {
    echo "setup: installing system packages with apt-get: $*"
    as_root apt-get update -qq
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

python=${PYTHON:-python3}
if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
    echo "setup: porocore needs Python 3.11 or later; set PYTHON to one, as in: make run PYTHON=python3.12" >&2
    exit 2
fi
if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
    if can_install; then install python3-venv; else
        echo "setup: Python's venv module is missing; as root run: apt-get install python3-venv" >&2
        exit 2
    fi
fi

missing=""
for library in $libraries; do
    { ldconfig -p 2>/dev/null || /sbin/ldconfig -p; } | grep -q "$library" || missing="$missing $library"
done
if [ -n "$missing" ]; then
    # shellcheck disable=SC2086
    if can_install; then install $packages; else
        echo "setup: gmsh needs$missing; as root run: apt-get install $packages" >&2
        exit 2
    fi
fi

[ -x .venv/bin/python ] || "$python" -m venv .venv
extras=""
[ "$what" = test ] && extras="[dev,benchmarks]"
echo "setup: installing porocore and its plugins into .venv"
.venv/bin/python -m pip install -q --disable-pip-version-check -c constraints.txt \
    -e ".$extras" -e plugins/fem_skfem -e plugins/surrogate_torch
touch ".venv/.ready-$what"

#!/bin/sh
# Make .venv with everything that `make run` (argument: run) or `make test` (argument: test) needs.
# With NEWEST=1 it is .venv-newest, with the newest release of every package and no pins.
# Exit status 2: something is missing that only the user can provide; the last line says what.
set -eu
what=$1
cd "$(dirname "$0")/.."
newest=${NEWEST:-}
venv=.venv${newest:+-newest}

# The shared libraries that gmsh's wheel loads, and the Debian packages that hold them.
libraries="libGLU.so.1 libGL.so.1 libXrender.so.1 libXcursor.so.1 libXfixes.so.3 libXft.so.2 libfontconfig.so.1 libXinerama.so.1 libgomp.so.1"
library_packages="libglu1-mesa libgl1 libxrender1 libxcursor1 libxfixes3 libxft2 libfontconfig1 libxinerama1 libgomp1"
# dolfinx with PETSc; what compiles its forms; a BLAS with which MUMPS is eight times faster; mpirun.
dolfinx_packages="python3-dolfinx-real python3-dev gcc libopenblas0-pthread mpi-default-bin"
# What VTK draws with where there is no display.
picture_packages="libegl1 libgl1-mesa-dri"
# What lays out the pages that are tested, with the font that their words are drawn in.
page_packages="chromium fonts-dejavu-core"

# As in debian12.
release=$(. /etc/os-release 2>/dev/null && echo "${ID:-}${VERSION_ID:-}") || release=unknown

say() { echo "setup: $*"; }

give_up() {
    echo "setup: $*" >&2
    exit 2
}

as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"; else sudo -n "$@"; fi
}

# apt-get waits for dpkg's lock where it is told to, but never for that of its lists, which the daily update holds.
update_lists() {
    waited=0
    until said=$(as_root env LC_ALL=C apt-get update -qq 2>&1); do
        case $said in
            *"nable to lock"* | *"ould not get lock"*) ;;
            *) give_up "apt-get update: $said" ;;
        esac
        [ $waited -lt 600 ] || give_up "another process has held apt's lock for ten minutes: $said"
        [ $waited -gt 0 ] || say "another process holds apt's lock; waiting for it, ten minutes at most"
        sleep 5
        waited=$((waited + 5))
    done
}

# install WHY PACKAGE...: those that are not there yet, by apt-get.
install() {
    why=$1
    shift
    wanted=""
    for package in "$@"; do
        dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q "ok installed" || wanted="$wanted $package"
    done
    [ -n "$wanted" ] || return 0
    if [ "$(id -u)" = 0 ]; then how="as root"; elif sudo -n true 2>/dev/null; then how="through sudo"; else
        give_up "$why; neither root nor allowed to use sudo without a password; run as root: apt-get install --no-install-recommends$wanted"
    fi
    say "$why; installing with apt-get $how:$wanted"
    update_lists
    # Another process may hold dpkg's lock, such as the daily upgrade: wait for it, ten minutes at most.
    # shellcheck disable=SC2086
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq -o DPkg::Lock::Timeout=600 \
        --no-install-recommends $wanted >/dev/null
}

at_least_3_11() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }
has_dolfinx() { "$1" -c 'import sys; from importlib.util import find_spec; sys.exit(find_spec("dolfinx") is None)'; }
base_of() { "$1" -c 'import os, sys; print(os.path.realpath(sys._base_executable))' 2>/dev/null; }

# Debian's own Python, where it is new enough: it sees Debian's dolfinx, and pip has none.
system=/usr/bin/python3
if [ -n "${PYTHON:-}" ]; then python=$PYTHON; elif at_least_3_11 $system; then python=$system; else python=python3; fi
at_least_3_11 "$python" || give_up "porocore needs Python 3.11 or later; set PYTHON to one, as in: make run PYTHON=python3.12"

with_dolfinx=yes
if [ "$what" != test ]; then
    with_dolfinx=""
elif [ -n "$newest" ] && [ "$release" = debian12 ] && [ "$(base_of "$python")" = "$(base_of $system)" ]; then
    with_dolfinx="" # that of Debian 12 does not import with numpy 2
fi

if [ "$(base_of "$python")" = "$(base_of $system)" ] && command -v apt-get >/dev/null; then
    "$python" -c 'import ensurepip, venv' 2>/dev/null || install "Python's venv module is missing" python3-venv
    # shellcheck disable=SC2086
    [ -z "$with_dolfinx" ] || install "the tests run on dolfinx too" $dolfinx_packages
    if [ "$what" = test ]; then
        # shellcheck disable=SC2086
        install "the tests draw pictures without a display" $picture_packages
        # shellcheck disable=SC2086
        install "the tests lay out pages" $page_packages
        # Its torch comes without CUDA.
        [ "$release" != debian13 ] || [ -n "$newest" ] || install "the tests run on torch too" python3-torch
    fi
elif [ -n "$with_dolfinx" ] && [ -n "$newest" ] && ! has_dolfinx "$python"; then
    with_dolfinx=""
elif [ -n "$with_dolfinx" ] && ! has_dolfinx "$python"; then
    give_up "the tests need dolfinx, and $python cannot have it: pip has no dolfinx. On Debian 12 or 13 leave PYTHON unset, and" \
        "apt-get provides it. Elsewhere: conda create -n fenicsx -c conda-forge fenics-dolfinx, then" \
        "make test PYTHON=the Python of that environment"
fi
[ "$what" != test ] || [ -n "$with_dolfinx" ] || say "no dolfinx here that works with the newest numpy; its tests are skipped"

missing=""
for library in $libraries; do
    { ldconfig -p 2>/dev/null || /sbin/ldconfig -p; } | grep -q "$library" || missing="$missing $library"
done
if [ -n "$missing" ]; then
    command -v apt-get >/dev/null || give_up "gmsh needs$missing"
    # shellcheck disable=SC2086
    install "gmsh needs$missing" $library_packages
fi

# Packages of the system are let in where dolfinx is among them or will be; so `run` and `test` share one environment.
sees=""
if [ -n "$newest" ]; then
    sees=${with_dolfinx:+--system-site-packages}
elif [ "$(base_of "$python")" = "$(base_of $system)" ] || has_dolfinx "$python"; then
    sees=--system-site-packages
fi
if [ -e $venv ] && ! at_least_3_11 $venv/bin/python; then
    say "$venv is broken or of a Python before 3.11; making it anew"
    rm -rf $venv
elif [ -e $venv ] && [ -n "$with_dolfinx" ] && ! has_dolfinx $venv/bin/python; then
    say "$venv does not see dolfinx (another Python made it, or it shuts the system's packages out); making it anew"
    rm -rf $venv
fi
# shellcheck disable=SC2086
[ -e $venv ] || "$python" -m venv $sees $venv

constraints=constraints/other.txt
if [ "$(base_of $venv/bin/python)" = "$(base_of $system)" ]; then
    [ ! -f "constraints/$release.txt" ] || constraints="constraints/$release.txt"
fi
if [ "$what" = test ]; then
    set -- -e ".[dev,docs,release,benchmarks,pictures,dask,parquet,posterior,images]"
    for plugin in plugins/*/; do set -- "$@" -e "$plugin"; done
else
    set -- -e . -e plugins/fem_skfem -e plugins/surrogate_torch
fi
if [ -n "$newest" ]; then
    # Eager: else what the system has would do.
    versions="the newest of all packages" && set -- --upgrade --upgrade-strategy eager "$@"
else
    versions="the pins of $constraints" && set -- -c "$constraints" "$@"
fi
say "installing porocore and its plugins into $venv, with $versions"
$venv/bin/python -m pip install -q --disable-pip-version-check "$@"
if [ -n "$with_dolfinx" ]; then
    $venv/bin/python -c 'import porocore_fem_dolfinx.compat' || give_up "dolfinx is installed but does not work here, see above"
fi
[ "$what" != test ] || touch $venv/.ready-test
touch $venv/.ready-run

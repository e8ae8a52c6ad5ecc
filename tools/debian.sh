#!/bin/sh
# Test the dolfinx plugin on another Debian, in a chroot that debootstrap makes. No part of `make test`.
#
#     [NEWEST=1] sh tools/debian.sh SUITE [FOLDER [PYTEST-ARGUMENT...]]
#
# SUITE is trixie (Debian 13, dolfinx 0.9), sid (what is to be Debian's next release, dolfinx 0.11 at present) or another.
# Needs root, debootstrap, unshare, 5 GB and some minutes. FOLDER holds the chroot and is used again when it has one;
# without it a temporary one is made and removed. What is tested is the commit HEAD, by the plugin's own tests and
# tests/consistency unless pytest is given other arguments; with NEWEST=1 on the newest release of every package of
# Python, as by `make test NEWEST=1`, which may take 10 GB.
# Debian comes from DEBIAN_MIRROR, by default from where this machine has it; pip's settings are this machine's too.
set -eu
source=$(cd "$(dirname "$0")/.." && pwd)
checkout=/root/porocore # in the chroot

say() { echo "debian: $*"; }

give_up() {
    echo "debian: $*" >&2
    exit 2
}

# Files and folders of this machine that pip's settings name; an index has its files beside it.
named_by_pip() {
    {
        env | grep '^PIP_' || true
        cat /etc/pip.conf "$HOME/.config/pip/pip.conf" "$HOME/.pip/pip.conf" 2>/dev/null || true
    } | grep -oE '(file://)?/[^ ,/]+(/[^ ,]*)?' | sed -E 's,^file://(.*)/[^/]+/?$,\1,' | grep '^/[^/]' | sort -u
}

# The part that runs in a name space of its own, whose mounts end with it, whatever way it ends.
inside() {
    root=$1
    shift
    mount -t proc proc "$root/proc"
    mount --rbind /sys "$root/sys"
    mount --rbind /dev "$root/dev"
    cp -L /etc/resolv.conf "$root/etc/resolv.conf"
    cp -L /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/ca-certificates.crt"
    apt-config dump | grep -i 'proxy' >"$root/etc/apt/apt.conf.d/90proxy" || true
    for settings in /etc/pip.conf "$HOME/.config/pip/pip.conf" "$HOME/.pip/pip.conf"; do
        [ ! -f "$settings" ] || { mkdir -p "$root$(dirname "$settings")" && cp -L "$settings" "$root$settings"; }
    done
    named_by_pip | while read -r path; do
        if [ -d "$path" ]; then
            mkdir -p "$root$path"
            mount --bind "$path" "$root$path"
        elif [ -f "$path" ]; then
            mkdir -p "$root$(dirname "$path")"
            cp -L "$path" "$root$path"
        fi
    done

    mkdir -p "$root$checkout"
    find "$root$checkout" -mindepth 1 -maxdepth 1 ! -name '.venv*' -exec rm -rf {} +
    git -c safe.directory="$source" -C "$source" archive HEAD | tar -x -C "$root$checkout"

    cat >"$root/root/test.sh" <<'SCRIPT'
set -eu
cd "$1"
shift
export DEBIAN_FRONTEND=noninteractive OMP_NUM_THREADS=1
apt-get update -qq
apt-get install -y -qq --no-install-recommends git make python3 >/dev/null
apt-get dist-upgrade -y -qq >/dev/null # sid moves on
git init -q . && git add --all # tests ask git for the files of the project
sh tools/setup.sh test
python=.venv${NEWEST:+-newest}/bin/python
$python - <<'PYTHON'
import platform
from importlib.metadata import version

from mpi4py import MPI
from porocore_fem_dolfinx import compat

petsc = ".".join(map(str, compat.PETSc.Sys.getVersion()))
print(f"Debian {open('/etc/debian_version').read().strip()}, Python {platform.python_version()},", end=" ")
print(f"dolfinx {compat.dolfinx.__version__}, PETSc {petsc}, {MPI.Get_library_version().split(',')[0]},", end=" ")
print(", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "h5py", "torch", "jax", "scikit-fem")))
PYTHON
$python -m pytest -q "$@"
SCRIPT
    # CI: a backend that is missing fails.
    env -u PYTHON -u PYTHONPATH -u PYTHONHOME -u VIRTUAL_ENV -u XDG_CACHE_HOME -u TMPDIR HOME=/root LANG=C.UTF-8 CI=true \
        PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin chroot "$root" sh /root/test.sh "$checkout" "$@"
}

case ${1:-} in
--inside)
    shift
    inside "$@"
    exit
    ;;
-h | --help)
    sed -n '2,/^set/{/^set/d;s/^# \{0,1\}//;p;}' "$0"
    exit
    ;;
esac

[ "$(id -u)" = 0 ] || give_up "debootstrap and chroot need root; run: sudo sh tools/debian.sh $*"
for tool in debootstrap unshare git; do
    command -v "$tool" >/dev/null || give_up "$tool is missing; run: apt-get install debootstrap util-linux git"
done
mirror=${DEBIAN_MIRROR:-$(cat /etc/apt/sources.list /etc/apt/sources.list.d/*.list /etc/apt/sources.list.d/*.sources 2>/dev/null |
    grep -E '^(deb |URIs:)' | grep -oE '[a-z]+://[^ ]*/debian/?( |$)' | head -n 1 | tr -d ' ')}
[ -n "$mirror" ] || give_up "/etc/apt names no Debian mirror; set DEBIAN_MIRROR to one"

[ $# -gt 0 ] || give_up "which suite of Debian? For example: sudo sh tools/debian.sh trixie"
suite=$1
shift
if [ $# -gt 0 ]; then
    mkdir -p "$1"
    root=$(cd "$1" && pwd)
    shift
else
    root=$(mktemp -d)
    trap 'rm -rf --one-file-system "$root"' EXIT
    trap 'exit 130' INT TERM
fi
[ $# -gt 0 ] || set -- tests/test_environment.py plugins/fem_dolfinx/tests tests/consistency

if [ ! -f "$root/etc/debian_version" ] || [ -d "$root/debootstrap" ]; then
    say "making Debian's $suite in $root from $mirror"
    log=$(mktemp)
    debootstrap --variant=minbase --include=ca-certificates "$suite" "$root" "$mirror" >"$log" 2>&1 || {
        tail -n 20 "$log" >&2
        give_up "debootstrap failed; its log is $log"
    }
    rm "$log"
fi
say "testing $(git -c safe.directory="$source" -C "$source" rev-parse --short HEAD) in $root"
status=0
unshare --mount --propagation private sh "$0" --inside "$root" "$@" || status=$?
if [ $status = 0 ]; then say "passed"; else say "FAILED with exit status $status"; fi
exit $status

"""Memory that a direct factor would take, memory that the machine has left, and whether one fits."""

from __future__ import annotations

from pathlib import Path

#: Files of Linux that tell the memory of the machine, and the limits of the present control group, in both versions.
_MACHINE = Path("/proc/meminfo")
_GROUPS = (
    (Path("/sys/fs/cgroup"), "memory.max", "memory.current"),
    (Path("/sys/fs/cgroup/memory"), "memory.limit_in_bytes", "memory.usage_in_bytes"),
)
#: Share of what is left that a factor may take.
SHARE = 0.8
GIB = 2**30


def available_bytes() -> float | None:
    """Return the memory that this machine has left for its processes; None where the system does not tell."""
    found: list[float] = []
    for line in _text(_MACHINE).splitlines():
        if line.startswith("MemAvailable:"):
            found.append(float(line.split()[1]) * 1024)
    for folder, limit, used in _GROUPS:
        most, now = _text(folder / limit).strip(), _text(folder / used).strip()
        if most.isdigit() and now.isdigit():
            found.append(float(most) - float(now) + _cached(folder))
    return max(min(found), 0.0) if found else None


def factor_bytes(unknowns: int, at: int, gib: float, exponent: float) -> float:
    """Return the memory of a factor by a power law, which was measured as ``gib`` at the size ``at``."""
    return float(gib * GIB * (unknowns / at) ** exponent)


def fits(needed: float, available: float | None) -> bool:
    """Return whether a factor fits; where the system does not tell, it is tried."""
    return available is None or needed <= SHARE * available


def spoken_bytes(size: float) -> str:
    """Return a size in GiB, for messages."""
    return f"{size / GIB:.1f} GiB" if size < 10 * GIB else f"{size / GIB:.0f} GiB"


def _cached(folder: Path) -> float:
    """Return the bytes of files that count as used and are given up when memory is short."""
    for line in _text(folder / "memory.stat").splitlines():
        name, _, size = line.partition(" ")
        if name == "inactive_file" and size.strip().isdigit():
            return float(size)
    return 0.0


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii")
    except OSError:
        return ""

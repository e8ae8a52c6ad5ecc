"""(ac) A plug in its meridian against the wedge: time and force at the end of a transient, by one process.

The script's status is 1 where the meridian takes more than a fifth of the time, or the forces differ by 0.1 %.
"""

from __future__ import annotations

import sys

from common import in_turn, table

from porocore.commands.verify.linear_cases import isotropic_law
from porocore.macro.problem import MacroProblem
from porocore.plugins.registry import registry

LAW = isotropic_law(0.3, 0.4, 1.0, 4e-6, 1.0)
TIME = {"end": 1.0, "step": 0.02, "ramp_increments": 4, "ramp_step": 0.0125, "profiles": ()}
SQUEEZED = {"y-": {"normal": 0}, "y+": {"displacement": (None, -0.01, None)}, "side": {"pressure": 0}}
WEDGE = {"z-": {"normal": 0}, "oblique": {"normal": 0}}


def force(kind: str, n: int) -> float:
    """Return the last force on the whole of a plug with n elements along radius and height."""
    wedge = kind == "wedge"
    body = {"kind": kind, "radius": 1.0, "height": 1.0, "elements": (n, n, 1) if wedge else (n, n)}
    boundary = SQUEEZED | (WEDGE if wedge else {})
    problem = MacroProblem.model_validate({"body": body, "boundary": boundary, "time": TIME})
    solver = registry().get("macro solver", "skfem")()
    found = solver.solve(solver.prepare(problem), LAW)
    return float(found.reactions["y+"][-1, 1]) * (24 if wedge else 1)


def main() -> int:
    rows, failed = [], False
    for n in (8, 16, 24):
        (flat, wedge), (one, other) = in_turn(
            [lambda n=n: force("axisymmetric", n), lambda n=n: force("wedge", n)], rounds=1
        )
        failed |= flat > wedge / 5 or abs(one / other - 1) > 1e-3
        rows.append(
            [f"{n} × {n}", f"{flat:.2f}", f"{wedge:.2f}", f"1/{wedge / flat:.0f}", f"{one / other - 1:.1e}"]
        )
    header = ["elements", "meridian, s", "wedge, s", "ratio", "difference of the forces"]
    print(table("(ac) A plug in its meridian and as a wedge of 15°, scikit-fem", header, rows))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())

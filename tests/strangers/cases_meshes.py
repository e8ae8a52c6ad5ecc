"""Meshes of other programs, with names that overlap, are lost or are there twice."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import yaml

from porocore import Study
from tests.helpers.command_run import Ended
from tests.helpers.stranger_case import Case

#: Of the column under its load, which does not depend on its mesh: computed on a box of 8 hexahedra.
SETTLEMENT = 0.0201628026


def _settles(folder: Path, ended: Ended | None) -> None:
    found = json.loads((folder / "r" / "metrics.json").read_text(encoding="utf-8"))
    assert found["macro"][0]["nonlinear"]["final_settlement"] == pytest.approx(SETTLEMENT, rel=1e-7)


def _threads_agree(folder: Path, ended: Ended | None) -> None:
    def settlement(i: int) -> float:
        (result,) = Study("base.yaml", out=f"runs/{i}").solve().values()
        return float(result.nonlinear.settlement[-1])

    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(settlement, range(4)))
    assert found == pytest.approx([SETTLEMENT] * 4, rel=1e-7)


def _boundary(source: str, name: str, **surfaces: object) -> Callable[[Path], None]:
    """Write a file with other conditions on its surfaces than another has; null takes a surface out."""

    def write(folder: Path) -> None:
        settings = yaml.safe_load((folder / source).read_text(encoding="utf-8"))
        boundary = {**settings["macro"]["boundary"], **surfaces}
        settings["macro"]["boundary"] = {each: of for each, of in boundary.items() if of is not None}
        (folder / name).write_text(yaml.safe_dump(settings, sort_keys=False), encoding="utf-8")

    return write


def _mesh(name: str, content: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    """Write a file with a mesh whose bytes are others."""

    def write(folder: Path) -> None:
        (folder / f"{name}.msh").write_bytes(content((folder / "m40.msh").read_bytes()))
        text = (folder / "m40.yaml").read_text(encoding="utf-8")
        (folder / f"{name}.yaml").write_text(text.replace("m40.msh", f"{name}.msh"), encoding="utf-8")

    return write


def _numbered(folder: Path) -> None:
    """Write a file that calls two surfaces by their numbers, with and without quotes."""
    text = (folder / "m40.yaml").read_text(encoding="utf-8")
    (folder / "numbers.yaml").write_text(
        text.replace('"y+":', "4:").replace('"x-":', '"1":'), encoding="utf-8"
    )


#: The surfaces of a mesh whose sides x- and x+ lost their names.
_UNNAMED = {"x-": None, "x+": None, "side": {"normal": 0}}
_LAID_OVER = "macro.boundary.second: 4 of its 4 faces belong to the surface 'y+' too, and there "


CASES = [
    *(
        Case(
            "volumes_overlap_msh22",
            ("check", f"{name}.yaml"),
            says=("233 tetrahedron elements", "x-, 48 facets"),
        )
        for name in ("core22", "core41")
    ),
    *(
        Case("volumes_overlap_msh22", ("run", f"{name}.yaml", "--out", "r"), check=_settles, slow=True)
        for name in ("core22", "core41")
    ),
    *(
        Case(
            "groups_second_lost_msh41",
            ("check", f"{name}.yaml"),
            says=(
                "212 tetrahedron elements",
                "region up, 101 elements",
                "surface y+, 4 facets, area 0.01: t_2 = -0.01, p = 0",
            ),
        )
        for name in ("vols22", "vols41")
    ),
    Case(
        "groups_second_lost_msh41",
        ("check", "twice.yaml"),
        2,
        (_LAID_OVER, "a traction t_2 would act twice"),
        before=_boundary("double.yaml", "twice.yaml", second={"traction": [0, -0.01, 0]}),
    ),
    Case(
        "groups_second_lost_msh41",
        ("run", "drained.yaml", "--out", "r"),
        check=_settles,
        before=_boundary(
            "double.yaml", "drained.yaml", second={"pressure": 0}, **{"y+": {"traction": [0, -0.01, 0]}}
        ),
        slow=True,
    ),
    Case(
        "groups_second_lost_msh41",
        ("check", "double.yaml"),
        says=("surface second, 4 facets, area 0.01: free of traction and impermeable",),
    ),
    Case(
        "groups_one_name",
        ("check", "samename41.yaml"),
        says=("surface y+, 4 facets, area 0.01: t_2 = -0.01, p = 0",),
    ),
    Case(
        "groups_one_name",
        ("check", "dupname.yaml"),
        2,
        ("its surfaces are side, 2 (a number, without a name), y-, y+, z-, z+",),
    ),
    *(
        Case("groups_of_med_inp", ("check", f"q_{kind}.yaml"), 2, ("the body has no surface 'x-'", *names))
        for kind, names in (("inp", ("side", "y+")), ("med", ("side", "y+")), ("su2", ("side", "y+")))
    ),
    *(
        Case(
            "groups_of_med_inp",
            ("check", f"named_{kind}.yaml"),
            says=(
                "surface side, 40 facets, area 0.1: normal displacement = 0",
                "surface y+, 4 facets, area 0.01: t_2 = -0.01, p = 0",
            ),
            before=_boundary(f"q_{kind}.yaml", f"named_{kind}.yaml", **_UNNAMED, **{second: {"normal": 0}}),
        )
        for kind, second in (("inp", "PhysicalSurface2"), ("med", "G_2D_2"), ("su2", "PhysicalSurface2"))
    ),
    Case(
        "surface_without_volume",
        ("check", "partvol41.yaml"),
        2,
        ("macro.boundary.x-: 20 of its 40 faces in partvol41.msh belong to no element with a volume",),
    ),
    Case(
        "msh40",
        ("check", "numbers.yaml"),
        says=(
            "surface 4, 4 facets, area 0.01: t_2 = -0.01, p = 0",
            "surface 1, 40 facets, area 0.1: normal displacement = 0",
        ),
        before=_numbered,
    ),
    Case("msh40", ("check", "m40.yaml"), says=("207 tetrahedron elements", "surface y+, 4 facets")),
    *(
        Case("msh40", ("check", f"{name}.yaml"), 2, (says,), before=_mesh(name, content))
        for name, content, says in (
            ("marked", lambda content: b"\xef\xbb\xbf" + content, "got a byte order mark before it"),
            ("emptied", lambda content: b"", "emptied.msh: the file is empty"),
        )
    ),
    Case(
        "cell_wall_unmerged",
        ("check", "unmerged.yaml"),
        2,
        ("68 nodes lie at the same place as others", "merge them (gmsh: Coherence Mesh;)"),
    ),
    Case(
        "cell_wall_unmerged",
        ("check", "dup.yaml"),
        2,
        ("7 tetra elements are there more than once, with the same nodes, in 'solid'",),
    ),
    Case("threads_gmsh", "four studies in four threads", check=_threads_agree, slow=True),
]

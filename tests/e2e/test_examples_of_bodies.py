"""Examples of bodies of many cells in a coarse form: what each shows, and the same bits after kills in every stage."""

from __future__ import annotations

import signal

import numpy as np
import pytest

from porocore.interfaces.solution import MacroSolution
from porocore.sampling.datasets.dataset import Dataset
from tests.e2e.coarse_examples import COARSE, run, written
from tests.e2e.study import EAGER_SOLVING, PLAIN, assert_tidy, contents, parts, porocore, succeeded

pytestmark = pytest.mark.slow

LAYERS = COARSE | {
    "cells.clay.mesh": {"size": 0.4, "fluid_size": 0.2},
    "sampling.options": {"count": 8, "corners": True},
    "macro.body.elements": [1, 6, 1],
    "macro.time.tolerance": 1e-2,
}
GEL = COARSE | {
    "sampling.options": {"count": 16},
    "macro.body.elements": [1, 6, 1],
    "macro.time.tolerance": 1e-2,
}
ZONES = COARSE | {
    "sampling.options": {"count": 32},
    "macro.body.elements": [3, 10, 1],
    "macro.time.tolerance": 1e-2,
}
GYROID = COARSE | {
    "cell.mesh": {"size": 0.25, "fluid_size": 0.2, "element": "quadratic-straight"},
    "sampling.options": {"count": 8, "corners": True},
    "macro.body.elements": [1, 6, 1],
    "macro.time.tolerance": 1e-2,
}


#: Figures of the coarse forms may move by what quadrature and solvers are changed to; relative.
SAME = 1e-4
EXAMPLES = {"layered-soil": LAYERS, "swelling-gel": GEL, "cartilage-zones": ZONES, "graded-gyroid": GYROID}


def at_first_profile(solution: MacroSolution) -> int:
    """The step of the first profile, when all of the load is there."""
    return int(np.flatnonzero(np.isclose(solution.history.time, solution.after_rest[0].time))[0])


def test_silt_drains_while_the_clay_below_it_still_bears_its_load_by_pressure(tmp_path):
    found = run(tmp_path, "layered-soil", LAYERS)["potential_load1.0"]
    early = at_first_profile(found)
    surface, clay, base = (found.probes[name] for name in ("surface", "top of the clay", "base"))
    silt = surface[:, 1] - clay[:, 1]
    assert silt[early] < 0.8 * silt[-1] < 0
    assert clay[-1, 1] < clay[early, 1] < 0.4 * clay[-1, 1]
    assert base[early, 3] > 10 * clay[early, 3] > 0
    assert base[-1, 3] < 0.01 * base[:, 3].max()
    assert found.reactions["y-"][-1, 1] == pytest.approx(0.025, rel=1e-6)  # 50 kPa of 2 MPa on 1 m²
    assert (surface[early, 1], surface[-1, 1], clay[-1, 1]) == pytest.approx(SOIL, rel=SAME)


def test_a_gel_grows_out_of_its_well_and_draws_fluid_in(tmp_path):
    found = run(tmp_path, "swelling-gel", GEL)["potential_load1.0"]
    grown, base = found.probes["free end"][:, 1], found.probes["base"][:, 3]
    assert base[at_first_profile(found)] < 0  # the pores open before the fluid is there
    assert abs(base[-1]) < 0.05 * abs(base.min())
    assert grown[-1] > 0.08  # held sideways, it grows by more than its free stretch along the well
    assert found.history.drained[-1] < 0
    assert (grown[-1], base.min(), found.history.drained[-1]) == pytest.approx(SWOLLEN, rel=SAME)


def test_the_softest_zone_of_cartilage_is_held_by_its_fibres(tmp_path):
    law = run(tmp_path, "cartilage-zones", ZONES)["potential_load1.0"]
    cells, peak = law.element_cells, at_first_profile(law)
    assert cells is not None
    assert cells.regions == ("superficial", "middle", "deep")
    fibres = cells.axes_at(0)[:, :, 0]
    np.testing.assert_allclose(np.abs(fibres[cells.region == 3]) @ [0, 1, 0], 1.0, atol=1e-12)
    np.testing.assert_allclose(np.abs(fibres[cells.region != 3]) @ [1, 0, 0], 1.0, atol=1e-12)
    wide = {name: values[peak, 0] for name, values in law.probes.items()}
    assert wide["middle"] > 1.1 * wide["surface"] > 1.1 * wide["deep"] > 0
    force = law.compression["y+"]
    assert force[peak] == force.max() > 1.4 * force[-1]
    np.testing.assert_allclose(law.reactions["y-"][1:, 1], -law.reactions["y+"][1:, 1], rtol=1e-6)
    assert (wide["surface"], wide["middle"], force.max(), force[-1]) == pytest.approx(CARTILAGE, rel=SAME)


def test_the_open_end_of_a_graded_gyroid_is_compressed_most_and_its_densities_may_be_images(tmp_path):
    found = run(tmp_path / "table", "graded-gyroid", GYROID)["potential_load1.0"]
    strain = found.profiles[-1].grad_u[:, 1, 1].reshape(len(found.cells), -1).mean(axis=1)
    height = found.points[found.cells[:, :8], 1].mean(axis=1)
    assert strain[height.argmin()] < 2 * strain[height.argmax()] < 0
    assert found.history.pressure_max[-1] < 1e-6
    settled = -found.probes["surface"][-1, 1]
    # The tetrahedra of a level set follow the last bits of the machine's linear algebra: two kernels of OpenBLAS give
    # meshes that differ by 3e-4 of the stiffness at this size, and by 2.5e-4 here.
    assert (settled, found.history.drained[-1]) == pytest.approx(IMPLANT, rel=1e-3)
    # Relative densities at the middles of the elements, in voxels of 1 mm.
    void = np.interp(np.arange(6) + 0.5, [0, 2, 4, 5, 6], [0.74, 0.70, 0.62, 0.56, 0.56])
    np.save(tmp_path / "density.npy", np.tile(1 - void[:, None], (4, 1, 4)))
    field = {"kind": "image", "path": str(tmp_path / "density.npy"), "voxel_size": "1 mm"}
    images = {"macro.fields.void_fraction": field | {"values": [[0.25, 0.75], [0.45, 0.55]]}}
    stepped = run(tmp_path / "images", "graded-gyroid", GYROID | images)["potential_load1.0"]
    assert -stepped.probes["surface"][-1, 1] == pytest.approx(settled, rel=5e-3)


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_killed_in_every_stage_ends_with_the_same_bits(name, tmp_path, launch):
    config = written(tmp_path / "example.yaml", name, EXAMPLES[name])
    straight, killed = tmp_path / "straight", tmp_path / "killed"
    succeeded(porocore("run", config, "--out", straight, timeout=900))
    first = "cells/clay/samples.h5" if name == "layered-soil" else "undeformed.h5"
    moments = [
        (PLAIN, lambda: parts(killed, first) >= 3),
        (PLAIN, lambda: parts(killed, "samples.h5") >= 3),
        (EAGER_SOLVING, lambda: (killed / "checkpoints" / "potential_load1.0.h5").exists()),
    ]
    if name == "layered-soil":
        moments[:2] = reversed(moments[:2])  # the clay is sampled after the silt
    for i, (program, moment) in enumerate(moments):
        running = launch("run", config, "--out", killed, *["--resume"][: min(i, 1)], program=program)
        running.until(moment)
        assert running.stop(signal.SIGKILL) == -signal.SIGKILL
        running.assert_gone()
        assert not (killed / "report.html").exists()
    succeeded(porocore("run", config, "--out", killed, "--resume", timeout=900))
    datasets = sorted(path.relative_to(straight) for path in straight.rglob("*.h5"))
    assert datasets == sorted(path.relative_to(killed) for path in killed.rglob("*.h5"))
    for path in datasets:
        if path.name in ("samples.h5", "test.h5", "undeformed.h5"):
            assert Dataset.open(killed / path).digest() == Dataset.open(straight / path).digest(), path
        else:
            assert contents(killed / path) == contents(straight / path), path
    assert_tidy(killed)


#: Settlement of the surface at five days and at last, and of the clay at last.
SOIL = (-0.21093721, -0.29253309, -0.14747980)
#: Growth at last, least pressure, drained volume.
SWOLLEN = (0.12742150, -0.0028786125, -0.00069859329)
#: Widening of the superficial and the middle zone at the peak; largest and last force.
CARTILAGE = (0.061638320, 0.074425644, 0.028439367, 0.016935458)
#: Settlement and drained volume at last.
IMPLANT = (0.076315818, 0.10082136)

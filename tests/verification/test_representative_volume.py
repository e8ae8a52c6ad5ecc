"""Sub-volumes of a periodic image are its cell; places, refusals, interruptions, failures and the choice of a size."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import porocore
from porocore.commands.representative import plan as outlook
from porocore.commands.representative.plan import Scan, SubvolumePlan
from porocore.commands.representative.results import (
    FAILED,
    FILE,
    JUDGED,
    LOOSE,
    LOST,
    QUANTITIES,
    SHAPES,
    SOLVED,
    SizeStatistics,
    Subvolume,
    judge,
    typical,
    verdict,
)
from porocore.commands.representative.study import SubvolumeSeries
from porocore.core.parallel.calls import ProcessEnded
from porocore.errors import ConfigurationError, DataError, PorocoreError, RunFolderError
from porocore.study.config.loading import load_config
from tests.helpers.invoked import invoke

#: Voxels of a period.
PERIOD = 8
LINEAR = "{size: 0.25, fluid_size: 0.25, element: linear}"


def tile():
    """One period of smoothed noise, whose pores and solid run through."""
    noise = np.random.default_rng(4).standard_normal((PERIOD,) * 3)
    smooth = gaussian_filter(noise, 1.3, mode="wrap")
    return (smooth > np.quantile(smooth, 0.55)).astype(np.uint8)


def configuration(folder, image, mesh=LINEAR, more="", top=""):
    np.save(folder / "scan.npy", image)
    (folder / "scan.yaml").write_text(
        "cell:\n  geometry: {kind: voxels, path: scan.npy, pore: 1, repeat: periodic, smoothing: 0.5"
        + more
        + "}\n"
        f"  mesh: {mesh}\n" + top
    )
    return load_config(folder / "scan.yaml", cell_only=True)


@pytest.fixture(scope="module")
def tiled(tmp_path_factory):
    """A study of eight periods, one of which is a cell."""
    pytest.importorskip("skfem")
    folder = tmp_path_factory.mktemp("tiled")
    config = configuration(folder, np.tile(tile(), (2, 2, 2)), LINEAR.replace("linear", "quadratic-curved"))
    plan = SubvolumePlan((PERIOD, 2 * PERIOD), count=2, element=2.0)
    return porocore.study_representative_volume(config, folder / "out", plan, workers=1, store=False)


def test_sub_volumes_of_whole_periods_are_the_cell(tiled):
    """Of one period to round-off wherever it lies; of two to the error of meshes that differ at the sides."""
    one, another, two = tiled.subvolumes
    assert [each.status for each in tiled.subvolumes] == [SOLVED] * 3
    assert one.corner != another.corner
    for name in SHAPES:
        of_one, of_two = getattr(one, name), getattr(two, name)
        np.testing.assert_allclose(getattr(another, name), of_one, atol=1e-9)
        assert np.abs(of_two - of_one).max() < 0.03 * np.abs(of_one).max(), name


def test_a_sub_volume_is_what_a_cell_of_that_image_is(tiled, tmp_path):
    np.save(tmp_path / "one.npy", tile())
    problem = porocore.CellProblem(
        {
            "geometry": {
                "kind": "voxels", "path": str(tmp_path / "one.npy"), "pore": 1, "repeat": "periodic", "smoothing": 0.5
            },
            "mesh": {"size": 0.25, "fluid_size": 0.25},
            "viscosity": 0.5,
        },
        store=False,
    )  # fmt: skip
    found, rest = tiled.subvolumes[0], problem.response(np.zeros((3, 3)))
    np.testing.assert_allclose(
        found.permeability, problem.conductivity * 0.5 * PERIOD**2, rtol=1e-8, atol=1e-9
    )
    np.testing.assert_allclose(found.stiffness, rest.tangent.stress_grad_u[0], atol=1e-8)
    np.testing.assert_allclose(found.M, rest.tangent.mean_grad_grad_u[0], atol=1e-9)
    assert found.storage == pytest.approx(-np.trace(rest.tangent.mean_grad_p[0]), rel=1e-9)


def test_equal_sub_volumes_settle_at_once(tiled):
    assert tiled.settling.enough == tiled.settling.settled_all == PERIOD
    said = list(verdict(tiled))
    assert any(line.startswith("8 voxels suffice for 5 %: ") for line in said), said
    assert any("note: of 16 voxels" in line and "scatter is not known" in line for line in said)
    assert "crop: [" in said[-1]
    assert "{size: 0.25, fluid_size: 0.25}" in said[-1]
    np.testing.assert_allclose(tiled.voxels.mean, tile().mean())
    assert all(path.stat().st_size > 500 for path in (tiled.record, *tiled.tables, *tiled.pictures))


def made_up(size, corner=(0, 0, 0), value=1.0, status=SOLVED):
    arrays = {name: np.full(shape, np.nan) for name, shape in SHAPES.items()}
    if status == SOLVED:
        C = value * np.einsum("ik,jl->ijkl", np.eye(3), np.eye(3))
        arrays |= {"porosity": np.array(0.5), "permeability": value * np.eye(3), "stiffness": C}
        arrays |= {"biot": 0.8 * np.eye(3), "storage": np.array(0.3), "M": C, "Q": -0.1 * np.eye(3)}
    return Subvolume(
        size, corner, f"{size} {corner}", status, "" if status == SOLVED else "why", 1.0, **arrays
    )


@pytest.fixture
def solves(monkeypatch):
    """Sub-volumes are made up; the list holds those that were asked for."""
    asked = []

    def solve(tell, empty, cell, edge, fem, store):
        asked.append((empty.size, empty.corner))
        return replace(made_up(empty.size, empty.corner), cell=empty.cell)

    monkeypatch.setattr(SubvolumeSeries, "function", solve)
    monkeypatch.setattr("matplotlib.figure.Figure.draw", lambda figure, renderer: None)
    return asked


def run(config, folder, plan, **how):
    return porocore.study_representative_volume(config, folder, plan, workers=1, store=False, **how)


def test_the_plan_of_a_study_may_grow(tmp_path, solves):
    config = configuration(tmp_path, np.tile(tile(), (2, 2, 2)))
    plan, out = SubvolumePlan((6, 8), count=2, element=2.0), tmp_path / "out"
    run(config, out, plan)
    assert len(solves) == 4
    with pytest.raises(RunFolderError, match="already holds a study; add --resume"):
        run(config, out, plan)
    larger = SubvolumePlan((6, 8, 12), count=3, element=2.0)
    found, whole = run(config, out, larger, resume=True), run(config, tmp_path / "whole", larger)
    assert len(solves) == len(set(solves[:7])) + 7
    assert [each.as_data() for each in found.subvolumes] == [each.as_data() for each in whole.subvolumes]
    record = json.loads((out / FILE).read_text())
    assert [row["size"] for row in record["sizes"]] == [6, 8, 12]
    with pytest.raises(DataError, match="another image, cell, element size or backend"):
        run(config, out, SubvolumePlan((6, 8), element=1.9), resume=True)
    (out / FILE).write_text('{"format": []}')
    with pytest.raises(DataError, match=r"not a complete record|expected porocore"):
        run(config, out, larger, resume=True)


def test_one_failure_does_not_end_the_others(tmp_path):
    """A period, nothing but pores, and a solid that floats."""
    pytest.importorskip("skfem")
    loose = np.ones((PERIOD,) * 3, dtype=np.uint8)
    loose[2:6, 2:6, 2:6] = 0
    image = np.concatenate([tile(), np.ones_like(loose), loose])
    config = configuration(tmp_path, image)
    found = run(config, tmp_path / "out", SubvolumePlan((PERIOD,), count=3, element=2.0))
    by_place = {each.corner[0]: each for each in found.subvolumes}
    assert {place: each.status for place, each in by_place.items()} == {0: SOLVED, 8: FAILED, 16: LOOSE}
    assert "every voxel" in by_place[8].message
    assert np.linalg.eigvalsh(by_place[16].permeability).min() > 0
    assert np.isnan(by_place[16].stiffness).all()
    assert found.settling.scatter["permeability"].at(PERIOD)[0] == 2
    assert found.settling.scatter["modulus"].at(PERIOD)[0] == 1
    said = " ".join(verdict(found))
    assert "1 of 3 no stiffness" in said
    assert "sub-volumes of two sizes at least" in said
    read = [Subvolume.from_data(each.as_data()) for each in found.subvolumes]
    np.testing.assert_equal([vars(each) for each in read], [vars(each) for each in found.subvolumes])


def test_a_study_whose_cells_all_fail_is_an_error(tmp_path):
    config = configuration(tmp_path, np.ones((8, 8, 8), dtype=np.uint8))
    with pytest.raises(PorocoreError, match=r"none of 1 sub-volumes could be solved.*every voxel"):
        run(config, tmp_path / "out", SubvolumePlan((8,), element=2.0))
    assert (tmp_path / "out/subvolumes.csv").exists()


def test_a_sub_volume_that_is_lost_is_tried_again_by_the_next_run(tmp_path, solves, monkeypatch):
    config = configuration(tmp_path, np.tile(tile(), (2, 2, 2)))
    plan, solve = SubvolumePlan((6, 8), count=2, element=2.0), SubvolumeSeries.function

    def ends(tell, empty, *others):
        if empty.size == 6:
            raise ProcessEnded("a process ended without a message")
        return solve(tell, empty, *others)

    monkeypatch.setattr(SubvolumeSeries, "function", ends)
    found = run(config, tmp_path / "out", plan)
    assert [each.status for each in found.subvolumes] == [LOST, LOST, SOLVED, SOLVED]
    assert found.subvolumes[0].message == "a process ended without a message"
    monkeypatch.setattr(SubvolumeSeries, "function", solve)
    found = run(config, tmp_path / "out", plan, resume=True)
    assert [each.status for each in found.subvolumes] == [SOLVED] * 4
    assert len(solves) == 4


@pytest.mark.slow
def test_processes_change_nothing(tmp_path):
    pytest.importorskip("skfem")
    config = configuration(tmp_path, np.tile(tile(), (2, 2, 2)))
    plan = SubvolumePlan((8, 12), count=2, element=2.0)
    one, two = (
        porocore.study_representative_volume(config, tmp_path / f"{n}", plan, workers=n, store=False)
        for n in (1, 2)
    )
    for mine, other in zip(one.subvolumes, two.subvolumes, strict=True):
        np.testing.assert_allclose(mine.stiffness, other.stiffness, rtol=1e-9, atol=1e-10)


def test_cells_come_from_the_store(tmp_path, undrawn, capsys):
    pytest.importorskip("skfem")
    config = configuration(tmp_path, tile())
    plan = SubvolumePlan((6, 8), count=1, element=2.0)
    how = {"workers": 1, "store": tmp_path / "store", "progress": True}
    first = porocore.study_representative_volume(config, tmp_path / "first", plan, **how)
    assert "store" not in capsys.readouterr().err
    again = porocore.study_representative_volume(config, tmp_path / "again", plan, **how)
    solved = sum(each.status == SOLVED for each in first.subvolumes)
    cells = "1 cell" if solved == 1 else f"{solved} cells"
    assert f"\nrev: {cells} came from the store, which saved" in capsys.readouterr().err
    np.testing.assert_array_equal(
        [each.permeability for each in first.subvolumes], [each.permeability for each in again.subvolumes]
    )


@pytest.mark.parametrize("overlapping", [False, True])
def test_places_lie_in_the_image_and_more_of_them_add_to_the_first(tmp_path, overlapping):
    image = np.zeros((20, 13, 30), dtype=np.uint8)
    image[::2] = 1
    config = configuration(tmp_path, image, more=", crop: [[0, 20], [1, 13], [10, 30]]")
    for within_crop, low in ((False, (0, 0, 0)), (True, (0, 1, 10))):
        few, many = (
            SubvolumePlan((6,), count=n, overlapping=overlapping, within_crop=within_crop, element=2.0)
            for n in (3, 20)
        )
        scan = Scan.open(config, few)
        places = scan.places(6, many)
        assert places[:3] == scan.places(6, few)[:3]
        assert len(set(places)) == len(places)
        corners = np.array(places)
        assert (corners >= low).all()
        assert (corners + 6 <= image.shape).all()
        apart = np.abs(corners[:, None] - corners[None]).max(axis=2) + 6 * np.eye(len(corners))
        assert (apart >= 6).all() != overlapping
        expected = [image[x : x + 6, y : y + 6, z : z + 6].mean() for x, y, z in places]
        np.testing.assert_allclose(scan.porosities(6, places), expected)


def test_elements_have_the_same_number_of_voxels(tmp_path):
    config = configuration(tmp_path, np.tile(tile(), (2, 2, 2)), more=", crop: [[0, 8], [0, 8], [0, 8]]")
    scan = Scan.open(config, SubvolumePlan())
    assert scan.elements == pytest.approx((2.0, 2.0))
    for size in (6, 8, 13, 16):
        cell = scan.subvolume((0, 0, 0), size)
        assert cell.mesh.size * size == pytest.approx(2.0, rel=1e-3)
        assert cell.geometry.crop == ((0, size),) * 3
    mirrored = configuration(tmp_path, tile()).cell.geometry.model_copy(update={"repeat": "mirror"})
    assert Scan(config.cell, mirrored, scan.values, scan.region, (2.0, 2.0), None).mesh_sizes(8) == (
        0.125,
        0.125,
    )


def test_sizes_that_the_machine_cannot_solve_are_left_out_and_named(tmp_path, monkeypatch):
    config = configuration(tmp_path, np.tile(tile(), (6, 6, 6)))
    plan = SubvolumePlan((8, 48), element=1.0)
    scan = Scan.open(config, plan)
    monkeypatch.setattr(outlook, "memory_here", lambda: 1e9)
    small, large = (outlook.foresee(scan, plan, size, 2) for size in plan.sizes)
    assert small.left_out == ""
    assert len(small.corners) == 4
    assert large.corners == []
    assert "GB of memory, but this machine has 1 GB" in large.line(2)
    assert "side by side" in small.line(2)
    monkeypatch.setattr(outlook, "memory_here", lambda: 1e12)
    monkeypatch.setattr(outlook, "LONG", 60.0)
    assert outlook.foresee(scan, plan, 48, 2).left_out == ""
    free = SubvolumePlan(element=1.0)
    assert "name the size in --sizes" in outlook.foresee(scan, free, 48, 2).left_out
    fine = Scan.open(config, SubvolumePlan(element=0.5))
    assert "give a larger --element" in outlook.foresee(fine, free, 48, 2).left_out
    assert scan.sizes(free) == (8, 12, 16, 24, 32, 48)


def test_means_and_their_scatter():
    found = SizeStatistics.of({8: [1.0, 3.0, np.nan], 4: [10.0], 16: [2.0, 2.1], 12: [np.nan]})
    assert found.sizes == (4, 8, 16)
    np.testing.assert_allclose(found.mean, [10.0, 2.0, 2.05])
    np.testing.assert_allclose(found.deviation, [np.nan, np.sqrt(2), np.sqrt(0.005)])
    assert found.settled(0.05) == 8
    assert found.settled(0.01) is None
    assert not found.suffices(8, 0.05)
    assert found.suffices(8, 0.8)
    assert found.needed(8, 0.1) == 200  # (2 · √2/2 / 0.1)²
    assert SizeStatistics.of({8: [1.0]}).settled(0.5) is None


def test_the_size_is_that_of_the_slowest_quantity():
    values = {8: (1.0, 1.4), 16: (1.2, 1.24), 32: (1.22, 1.22)}
    subvolumes = [
        made_up(size, (i, 0, 0), value) for size, pair in values.items() for i, value in enumerate(pair)
    ]
    found = judge(subvolumes, 0.05)
    assert found.settled == dict.fromkeys(JUDGED, 8) | {"permeability": 8, "modulus": 8}
    assert found.enough == 16
    assert typical(subvolumes, found, 8) in subvolumes[:2]
    assert judge(subvolumes, 0.2).enough == 16
    assert judge(subvolumes, 0.3).enough == 8
    assert judge(subvolumes[:4], 0.001).settled_all is None
    assert set(made_up(8).scalars()) == set(QUANTITIES)


def test_the_command_prints_a_table_in_units_and_one_object(tmp_path, solves, monkeypatch):
    top = "  viscosity: 1 mPa s\nscales: {modulus: 2 MPa, length: 1 mm}\noutput_units: {stress: kPa}\n"
    configuration(tmp_path, np.tile(tile(), (2, 2, 2)), more=", voxel_size: 3 um", top=top)
    words = (
        "cell",
        "rev",
        tmp_path / "scan.yaml",
        "--sizes",
        "6,8,12",
        "--element",
        "2",
        "--no-store",
        "--workers",
        "1",
    )
    done = invoke(*words, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert "edge [µm]" in done.stdout
    assert "permeability [µm²]" in done.stdout
    assert "modulus [kPa]" in done.stdout
    row = next(line.split() for line in done.stdout.splitlines() if line.strip().startswith("6 "))
    assert row[1] == "18"
    assert "9.00" in row
    assert "6 voxels, 18 µm, suffice for 5 %" in done.stdout
    header = (tmp_path / "out/subvolumes.csv").read_text().splitlines()[0]
    assert "storage [1/kPa]" in header
    as_json = invoke(*words, "--out", tmp_path / "json", "--json")
    found = json.loads(as_json.stdout)
    assert found["enough"] == 6
    assert found["voxel [m]"] == pytest.approx(3e-6)
    assert found["sizes"][0]["permeability"]["mean"] == pytest.approx(1.0)
    looked = invoke(*words[:-3], "--porosity-only", "--out", tmp_path / "looked")
    assert looked.exit_code == 0, looked.output
    assert (
        "permeability and stiffness need larger ones" in looked.stdout or "scatters by more" in looked.stdout
    )
    assert len(solves) == 2 * (4 + 4 + 1)


def test_the_three_extents_of_a_subvolume_are_named_where_they_differ(tmp_path, solves):
    """Voxels of 12 × 12 × 15 µm: six of them are 72 × 72 × 90 µm and not 78 µm, the cube root of their volume."""
    sizes = ", voxel_size: [12 um, 12 um, 15 um]"
    configuration(tmp_path, np.tile(tile(), (2, 2, 2)), more=sizes)
    words = ("cell", "rev", tmp_path / "scan.yaml", "--sizes", "6,8,12", "--element", "1.5", "--no-store")
    done = invoke(*words, "--workers", "1", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert "6 voxels, 72 x 72 x 90 µm, suffice for 5 %" in done.stdout
    assert "voxels of 12 x 12 x 15 µm" in done.stderr
    row = next(line.split() for line in done.stdout.splitlines() if line.strip().startswith("6 "))
    assert row[1:4] == ["72", "72", "90"]
    table = (tmp_path / "out/sizes.csv").read_text().splitlines()
    assert table[0].startswith("size [voxels],edge along x [µm],along y [µm],along z [µm],solved")
    assert [float(x) for x in table[1].split(",")[1:4]] == pytest.approx([72, 72, 90])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"sizes": (8, 8)}, "sizes: expected increasing"),
        ({"sizes": ()}, "sizes: expected at least one"),
        ({"sizes": (3,)}, "sizes: expected edges of 4 to 400"),
        ({"count": 0}, "count: expected 1 to"),
        ({"seed": -1}, "seed: expected"),
        ({"element": 0.1}, "element: expected"),
        ({"tolerance": 1.0}, "tolerance: expected a share"),
    ],
)
def test_a_plan_that_cannot_be_is_refused(settings, message):
    with pytest.raises(ConfigurationError, match=message):
        SubvolumePlan(**settings)

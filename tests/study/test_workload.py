"""Memory and time that ``porocore check`` expects of the mesh of the cell, before it is meshed."""

from dataclasses import replace

import pytest
from invoked import BENCHMARK

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.errors import ConfigurationError
from porocore.study.config.loading import load_config
from porocore.study.preflight import cost, workload
from porocore.testing.cell_laws.open_cells import image_cell


def study(tmp_path, size, fluid_size=0.2, **sampling):
    geometry = image_cell(tmp_path / "image.npy", 0, 16)
    mesh = MeshSettings(size=size, fluid_size=fluid_size)
    config = load_config(BENCHMARK.with_name("soil-strip.yaml"))
    new = {
        "cell": Cell(geometry=geometry, mesh=mesh),
        "sampling": config.sampling.model_copy(update=sampling),
    }
    return config.model_copy(update=new)


def test_the_nodes_of_an_image_are_known_before_it_is_meshed(tmp_path):
    config = study(tmp_path, 0.1, 0.1)
    nodes = [len(config.cell.make_mesh(phase, "whole").points) for phase in ("solid", "fluid")]
    assert workload.expected_nodes(config) == pytest.approx(nodes, rel=0.3)


def test_a_mesh_beyond_the_memory_is_refused_with_a_size_that_fits(tmp_path, monkeypatch):
    monkeypatch.setattr(workload, "memory_here", lambda: 2e9)
    with pytest.raises(ConfigurationError, match=r"cell.mesh.size: at 0.046875 .*has 2 GB; take") as refused:
        workload.require_memory(study(tmp_path, 3 / 64, executor="serial"))
    size = float(str(refused.value).split("take ")[1].split()[0])
    assert 0.05 < size < 0.08
    workload.require_memory(study(tmp_path, size, executor="serial"))


def test_processes_share_the_memory_that_the_mesh_needs(tmp_path, monkeypatch):
    monkeypatch.setattr(workload, "memory_here", lambda: 6e9)
    with pytest.raises(
        ConfigurationError,
        match=r"sampling.workers: 8 workers and the run itself need .*; take at most [2-5]$",
    ):
        workload.require_memory(study(tmp_path, 0.07, executor="processes", workers=8))


def test_an_eighth_is_an_eighth():
    config = load_config(BENCHMARK.with_name("soil-strip.yaml"))
    config = config.model_copy(
        update={"sampling": config.sampling.model_copy(update={"inputs": {"H22": None}})}
    )
    sheared = config.model_copy(
        update={"sampling": config.sampling.model_copy(update={"inputs": {"H12": None}})}
    )
    assert workload.share_solved(config) == 1 / 8
    assert workload.share_solved(sheared) == 1


def test_a_state_that_takes_long_is_said_with_a_size_that_does_not():
    there = cost.STATE.nodes_for(60)
    assert workload.slow_states(0.99 * there, 0.1) == ""
    said = workload.slow_states(8 * there, 0.05)
    assert said.startswith(f"a state of {8 * there:,.0f} nodes of the solid takes about ")
    assert "beyond what was measured" in said
    assert said.endswith("cell.mesh.size: 0.1 takes 60 s")


def test_a_fluid_beyond_the_memory_is_refused_too(tmp_path, monkeypatch):
    monkeypatch.setattr(workload, "memory_here", lambda: 1e9)
    config = study(tmp_path, 0.2, executor="serial")
    fine = config.cell.model_copy(update={"mesh": MeshSettings(size=0.2, fluid_size=0.02)})
    workload.require_memory(config)
    with pytest.raises(ConfigurationError, match=r"cell.mesh.fluid_size: at 0.02 the fluid has"):
        workload.require_memory(config.model_copy(update={"cell": fine}))


@pytest.mark.parametrize(
    "law", [cost.FIRST, cost.STATE, cost.CONDUCTIVITY, cost.SOLID, cost.EIGHTH, cost.FLUID]
)
def test_the_cost_is_that_measured_and_grows_on_beyond(law):
    assert [law.at(n) for n in law.nodes] == pytest.approx(law.values)
    assert law.at(0) == 0
    n, last = law.nodes[-1], law.values[-1]
    assert 2 * last < law.at(3 * n) < 9 * last  # more than linear or nearly so, less than quadratic
    assert law.nodes_for(law.at(3 * n)) == pytest.approx(3 * n)
    assert law.at(law.nodes[0] / 4) < law.values[0]


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.3, "0.3 s"), (5.04, "5 s"), (119, "120 s"), (600, "10 min"), (1e5, "28 h")]
)
def test_a_rough_time_is_read_in_its_unit(seconds, text):
    assert workload.as_time(seconds) == text


def test_the_time_of_a_study_is_that_of_its_states_on_its_workers():
    one = workload.Workload(40, 1, 10, 2, 5, 2, 20_000, 30_000)
    four = replace(one, workers=4)
    each, flow, first = cost.STATE.at(20_000), cost.CONDUCTIVITY.at(30_000), cost.FIRST.at(20_000)
    assert one.cell_time == pytest.approx(first + 41 * each + flow)
    assert four.cell_time == pytest.approx(first + 11 * each + flow)
    assert replace(one, deformed=True).state == pytest.approx(each + flow)
    eighth = replace(one, parts=(1 / 8, 1 / 8))
    assert eighth.state == pytest.approx(cost.STATE.at(2_500))
    said = list(four.as_lines())
    assert "20,000 nodes of the solid and 30,000 of the fluid" in said[1]
    assert f"all cells {workload.as_time(four.cell_time)} on 4 quiet cores" in said[1]
    assert said[1].endswith("without training, macro runs and report")


def test_the_memory_is_that_of_all_processes_at_once():
    """An eighth of 12,128 nodes was told to take 1.5 GB; two workers and their parent held 4.0 to 4.5 GB."""
    two = workload.Workload(32, 2, 17, 2, 8, 4, 97_020, 107_653, (1 / 8, 1 / 8))
    assert two.memory == pytest.approx(3 * two.process)
    assert two.memory == pytest.approx(4.25e9, rel=0.2)
    assert two.process == pytest.approx(1.5e9, rel=0.2)
    assert replace(two, workers=1, serial=True).memory == pytest.approx(two.process)
    assert replace(two, workers=0).memory == pytest.approx(
        two.process
    )  # a scheduler has the workers elsewhere
    said = next(iter(two.as_lines()))
    assert (
        "4.9 GB of memory in all while cells are solved, 1.6 GB each of 2 workers and of the run itself"
        in said
    )
    alone = next(iter(replace(two, workers=1, serial=True).as_lines()))
    assert alone.endswith("1.6 GB of memory in all while cells are solved")

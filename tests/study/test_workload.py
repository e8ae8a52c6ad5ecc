"""Memory and time that ``porocore check`` expects of the mesh of the cell, before it is meshed."""

from dataclasses import replace

import pytest

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.errors import ConfigurationError
from porocore.study.config.loading import load_config
from porocore.study.notes import abilities as limits
from porocore.study.notes import cost, forecast
from porocore.testing.cell_checks.base import image_cell
from tests.helpers.invoked import BENCHMARK


def study(tmp_path, size, fluid_size=0.2, **sampling):
    geometry = image_cell(tmp_path / "image.npy", 0, 16)
    mesh = MeshSettings(size=size, fluid_size=fluid_size)
    config = load_config(BENCHMARK.with_name("soil-strip.yaml"))
    new = {
        "cell": Cell(geometry=geometry, mesh=mesh),
        "sampling": config.sampling.model_copy(update=sampling),
    }
    return config.model_copy(update=new)


def require_memory(config):
    limits.require_memory(config.cell, config.sampling)


def test_the_nodes_of_an_image_are_known_before_it_is_meshed(tmp_path):
    config = study(tmp_path, 0.1, 0.1)
    nodes = [len(config.cell.make_mesh(phase, "whole").points) for phase in ("solid", "fluid")]
    assert forecast.expected_cost(config.cell, config.sampling.inputs).nodes == pytest.approx(nodes, rel=0.3)


def test_a_mesh_beyond_the_memory_is_refused_with_a_size_that_fits(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "memory_here", lambda: 2e9)
    with pytest.raises(ConfigurationError, match=r"cell.mesh.size: at 0.046875 .*has 2 GB; take") as refused:
        require_memory(study(tmp_path, 3 / 64, executor="serial"))
    size = float(str(refused.value).split("take ")[1].split()[0])
    assert 0.05 < size < 0.08
    require_memory(study(tmp_path, size, executor="serial"))


def test_processes_share_the_memory_that_the_mesh_needs(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "memory_here", lambda: 6e9)
    with pytest.raises(
        ConfigurationError,
        match=r"sampling.workers: 8 workers and the run itself need .* cell.mesh.size = .*, or take at most [2-5]$",
    ):
        require_memory(study(tmp_path, 0.07, executor="processes", workers=8))


def test_an_eighth_is_an_eighth():
    config = load_config(BENCHMARK.with_name("soil-strip.yaml"))
    config = config.model_copy(
        update={"sampling": config.sampling.model_copy(update={"inputs": {"H22": None}})}
    )
    sheared = config.model_copy(
        update={"sampling": config.sampling.model_copy(update={"inputs": {"H12": None}})}
    )
    assert forecast.share_solved(config.cell, config.sampling.inputs) == 1 / 8
    assert forecast.share_solved(sheared.cell, sheared.sampling.inputs) == 1


@pytest.mark.parametrize(("costs", "share"), [(cost.WHOLE, 1.0), (cost.EIGHTH, 1 / 8)])
def test_a_state_that_takes_long_is_said_with_a_size_that_does_not(costs, share):
    there = costs.state.nodes_for(60)
    assert limits.slow_states(0.99 * there, 0.1, share) == ""
    said = limits.slow_states(8 * there, 0.05, share)
    assert said.startswith(f"a state of {8 * there:,.0f} nodes of the solid takes about ")
    assert "beyond what was measured" in said
    assert said.endswith("cell.mesh.size: 0.1 takes 60 s")


def test_sheared_states_are_whole_cells_and_those_at_rest_an_eighth():
    """K is that of an eighth; the flow through a deformed pore is solved where its state is."""
    sheared = forecast.Workload(
        40, 1, 10, 2, 5, 2, cost.CellCost(20_000, 30_000, (1.0, 1 / 8)), 1 / 8, serial=True
    )
    whole, eighth = cost.WHOLE, cost.EIGHTH
    first, rest = whole.first.at(20_000), cost.LEAST + eighth.state.at(2_500) + eighth.first.at(2_500)
    flow = eighth.conductivity.at(30_000 / 8)
    assert sheared.cell.state == pytest.approx(cost.LEAST + whole.state.at(20_000))
    assert sheared.cell_time == pytest.approx(rest + first + 40 * sheared.cell.state + flow)
    assert replace(sheared.cell, deformed=True).state - sheared.cell.state == pytest.approx(
        whole.conductivity.at(30_000)
    )
    config = load_config(BENCHMARK.with_name("soil-strip.yaml"))  # samples H12
    assert forecast.Workload.of(config, 8, 1, (8_000, 8_000)).cell.parts == (1.0, 1 / 8)
    assert forecast.Workload.of(config, 8, 1, (8_000, 8_000)).rest == 1 / 8


def test_a_fluid_beyond_the_memory_is_refused_too(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "memory_here", lambda: 1e9)
    config = study(tmp_path, 0.2, executor="serial")
    fine = config.cell.model_copy(update={"mesh": MeshSettings(size=0.2, fluid_size=0.02)})
    require_memory(config)
    with pytest.raises(ConfigurationError, match=r"cell.mesh.fluid_size: at 0.02 the fluid has"):
        require_memory(config.model_copy(update={"cell": fine}))


@pytest.mark.parametrize("domain", ["WHOLE", "EIGHTH"])
@pytest.mark.parametrize("name", ["first", "state", "solid", "conductivity", "fluid"])
def test_the_cost_is_that_measured_and_grows_on_beyond(domain, name):
    law = getattr(getattr(cost, domain), name)
    assert [law.at(n) for n in law.nodes] == pytest.approx(law.values)
    assert law.at(0) == 0
    n, last = law.nodes[-1], law.values[-1]
    least = 1.5 if name == "first" else 2  # beyond the others, of which multigrid needs less than a factor
    assert least * last < law.at(3 * n) < 9 * last  # nearly linear or more, less than quadratic
    assert law.nodes_for(law.at(3 * n)) == pytest.approx(3 * n)
    assert law.at(law.nodes[0] / 4) < law.values[0]


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.3, "0.3 s"), (5.04, "5 s"), (119, "120 s"), (600, "10 min"), (1e5, "28 h")]
)
def test_a_rough_time_is_read_in_its_unit(seconds, text):
    assert forecast.as_time(seconds) == text


def test_the_time_of_a_study_is_that_of_its_states_on_its_workers():
    one = forecast.Workload(40, 1, 10, 2, 5, 2, cost.CellCost(20_000, 30_000))
    four = replace(one, workers=4)
    whole, eighth = cost.WHOLE, cost.EIGHTH
    each, first = cost.LEAST + whole.state.at(20_000), whole.first.at(20_000)
    flow = whole.conductivity.at(30_000)
    assert one.cell_time == pytest.approx(2 * first + 41 * each + flow)  # the run itself has a first one too
    assert replace(one, serial=True).cell_time == pytest.approx(first + 41 * each + flow)
    assert four.cell_time == pytest.approx(2 * first + 11 * each + flow)
    assert replace(one.cell, deformed=True).state == pytest.approx(each + flow)
    part = replace(one, cell=replace(one.cell, parts=(1 / 8, 1 / 8)), rest=1 / 8)
    assert part.cell.state == pytest.approx(cost.LEAST + eighth.state.at(2_500))
    assert part.cell.conductivity == pytest.approx(eighth.conductivity.at(30_000 / 8))
    # Every parity of the derivatives has a factor of its own: an image of 13,010 nodes took 1.9 to 2.3 s, one of 25,596
    # nodes 9 to 13 s.
    assert 1.9 / 2 < eighth.state.at(13_010) < 2 * 2.3
    assert 9 / 2 < eighth.state.at(25_596) < 2 * 13
    assert eighth.state.at(25_596) > 1.5 * whole.state.at(25_596)
    said = list(forecast.work_lines({None: four}))
    assert "20,000 nodes of the solid and 30,000 of the fluid" in said[1]
    assert f"all cells {forecast.as_time(four.cell_time)} on 4 quiet cores" in said[1]


def test_the_memory_is_that_of_all_processes_at_once():
    """An eighth of 12,128 nodes was told to take 1.5 GB; two workers and their parent held 4.0 to 4.5 GB."""
    two = forecast.Workload(32, 2, 17, 2, 8, 4, cost.CellCost(97_020, 107_653, (1 / 8, 1 / 8)))
    assert two.memory == pytest.approx(3 * two.cell.memory)
    assert two.memory == pytest.approx(4.25e9, rel=0.2)
    assert two.cell.memory == pytest.approx(1.5e9, rel=0.2)
    assert replace(two, workers=1, serial=True).memory == pytest.approx(two.cell.memory)
    assert replace(two, workers=0).memory == pytest.approx(
        two.cell.memory
    )  # a scheduler has the workers elsewhere
    said = next(forecast.work_lines({None: two}))
    assert (
        "4.8 GB of memory in all while cells are solved, 1.6 GB each of 2 workers and of the run itself"
        in said
    )
    alone = next(forecast.work_lines({None: replace(two, workers=1, serial=True)}))
    assert alone.endswith("1.6 GB of memory in all while cells are solved")

"""Memory and time that ``porocore check`` expects of the mesh of the cell, before it is meshed."""

import pytest
from invoked import BENCHMARK

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.errors import ConfigurationError
from porocore.study.config.loading import load_config
from porocore.study.preflight import workload
from porocore.testing.cell_laws.open_cells import image_cell


def study(tmp_path, size, **sampling):
    geometry = image_cell(tmp_path / "image.npy", 0, 16)
    mesh = MeshSettings(size=size, fluid_size=0.2)
    config = load_config(BENCHMARK.with_name("soil-strip.yaml"))
    new = {
        "cell": Cell(geometry=geometry, mesh=mesh),
        "sampling": config.sampling.model_copy(update=sampling),
    }
    return config.model_copy(update=new)


def test_the_nodes_of_an_image_are_known_before_it_is_meshed(tmp_path):
    config = study(tmp_path, 0.1)
    nodes = len(config.cell.make_mesh("solid", "whole").points)
    assert workload.expected_nodes(config) == pytest.approx(nodes, rel=0.3)


def test_a_mesh_beyond_the_memory_is_refused_with_a_size_that_fits(tmp_path, monkeypatch):
    monkeypatch.setattr(workload, "memory_here", lambda: 2e9)
    with pytest.raises(ConfigurationError, match=r"cell.mesh.size: at 0.046875 .*has 2 GB; take") as refused:
        workload.require_memory(study(tmp_path, 3 / 64, executor="serial"))
    size = float(str(refused.value).split("take ")[1].split()[0])
    assert 0.055 < size < 0.08
    workload.require_memory(study(tmp_path, 1.02 * size, executor="serial"))


def test_processes_share_the_memory_that_the_mesh_needs(tmp_path, monkeypatch):
    monkeypatch.setattr(workload, "memory_here", lambda: 4e9)
    with pytest.raises(
        ConfigurationError, match=r"sampling.workers: 8 processes need .*; take at most [23]$"
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


def test_a_solid_larger_than_any_measured_one_is_said():
    assert workload.slow_states(12_000, 0.1) == ""
    said = workload.slow_states(96_000, 0.05)
    assert said.startswith("96,000 nodes of the solid")
    assert "cell.mesh.size: 0.1 has about 12,000" in said

"""Histogram of grey values in the report: every voxel is counted once, on its side of the threshold."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.cell.level_sets.grey_values import GreyValues, Parting
from porocore.report.figures import histogram_figure
from porocore.report.html import render

VALUES = np.random.default_rng(0).normal(120, 30, (16, 16, 16)).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("threshold", [117, 117.5, 9.0, 300.0, -5.0])
@pytest.mark.parametrize("scale", [1, 257, 1 / 255, 1e-3])
@pytest.mark.parametrize("bright", [True, False])
def test_every_voxel_stands_on_its_side_of_the_threshold(scale, threshold, bright):
    kind = {257: np.uint16, 1 / 255: np.float32}.get(scale, np.uint8)
    values = VALUES.astype(kind) / kind(255) if scale == 1 / 255 else VALUES.astype(kind) * scale
    level = threshold * scale if threshold != 117 else float(values[VALUES <= 117].max())
    figure = histogram_figure(Parting(GreyValues.of(values), level, "as given", bright))
    pores, solid = (patch.get_data() for patch in figure.axes[0].patches)
    assert (pores.values.sum(), solid.values.sum()) == (
        np.count_nonzero((values > level) == bright),
        np.count_nonzero((values > level) != bright),
    )
    np.testing.assert_allclose(np.diff(pores.edges), np.diff(pores.edges)[0])
    assert len(pores.values) < 300
    label = figure.axes[0].lines[0].get_label()
    assert label == f"threshold {level:.6g} (as given)"


@pytest.mark.parametrize("scale", [1, 257, 0.01])
def test_equally_frequent_values_have_bars_of_one_height(scale):
    values = np.tile(np.arange(200) * scale, (5, 3, 1))
    figure = histogram_figure(Parting(GreyValues.of(values), 99.5 * scale, "Otsu's", None))
    heights = figure.axes[0].patches[0].get_data().values
    assert set(heights[heights > 0]) == {30}


def test_the_page_has_the_histogram_of_a_grey_image_alone(context, unpictured):
    parted = Parting(GreyValues.of(VALUES), 117.5, "Otsu's", False)
    page = render(replace(context, cell=replace(context.cell, parting=parted)))
    words = "Voxels of the whole file by their grey value"
    assert words in page
    assert words not in render(context)

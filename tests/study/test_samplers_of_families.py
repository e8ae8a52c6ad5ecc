"""Samplers and families: what draws no parameters is refused before anything is solved."""

import pytest

from porocore.cell.cell import Cell
from porocore.errors import ConfigurationError
from porocore.sampling.samplers.density import DensitySweep
from porocore.sampling.samplers.designs import SobolDesign
from porocore.sampling.samplers.macro_driven import MacroDriven
from porocore.study.notes.abilities import require_parameters_sampled


def test_a_sampler_that_draws_no_parameters_is_refused():
    family, one = (Cell.model_validate({"geometry": {"radius": r}}) for r in ({"range": [0.2, 0.25]}, 0.2))
    require_parameters_sampled(SobolDesign, "sobol", family)
    require_parameters_sampled(MacroDriven, "macro-driven", family)
    require_parameters_sampled(DensitySweep, "density-sweep", one)
    with pytest.raises(ConfigurationError, match="'density-sweep' does not sample cells with parameters"):
        require_parameters_sampled(DensitySweep, "density-sweep", family)
